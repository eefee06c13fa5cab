//! Settings of the progressive update.

use crate::math::digraph::Digraph;
use crate::{Error, Result};
use serde_json::{Value, json};

/// What λ means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cap {
    /// The RMS of a child's step, relative to its parents'.
    Relative,
    /// The norm of the gradient, which is the step itself.
    Absolute,
    /// The norm of the gradient at which local steps end; at most five.
    Stop,
}

/// Which factor comes when.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Parents first.
    Topological,
    /// Every edge turned round.
    Reverse,
    /// Factors exchanged by a permutation drawn from the seed.
    Random,
    /// All at once.
    None,
}

/// How key Gaussians are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keys {
    /// By exchanging one factor.
    Swap,
    /// As many, drawn.
    Random,
    /// Every Gaussian is key to every factor.
    All,
}

macro_rules! named {
    ($kind:ident, $option:literal, $list:literal, $($variant:ident = $name:literal),*) => {
        impl $kind {
            /// The name used by settings.
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $name),* }
            }

            /// The one of that name.
            ///
            /// # Errors
            /// When there is none.
            pub fn parse(name: &str) -> Result<Self> {
                match name {
                    $($name => Ok(Self::$variant),)*
                    other => Err(Error::input($option).expected($list).got(other)),
                }
            }
        }
    };
}

named!(Cap, "--lambda-mode", "rel, abs or stop", Relative = "rel", Absolute = "abs", Stop = "stop");
named!(
    Order,
    "--order",
    "topo, reverse, random or none",
    Topological = "topo",
    Reverse = "reverse",
    Random = "random",
    None = "none"
);
named!(Keys, "--keys", "swap, random or all", Swap = "swap", Random = "random", All = "all");

/// Settings of the progressive update; iterations are those of the published 1 200.
#[derive(Clone, Debug, PartialEq)]
pub struct Progressive {
    /// λ ≥ 0; infinite binds nothing
    pub lambda: f64,
    /// What it means.
    pub cap: Cap,
    /// Which factor comes when.
    pub order: Order,
    /// How keys are found.
    pub keys: Keys,
    /// q: share of the Gaussians that are key to a factor
    pub share: f64,
    /// Keys are found anew at multiples of this,
    pub every: usize,
    /// from this iteration on.
    pub first: usize,
    /// Training pictures that are looked at for that.
    pub views: usize,
    /// A graph to use instead of the guide's.
    pub graph: Option<Digraph>,
}

impl Progressive {
    /// The defaults of last.md §12.6.
    pub fn published() -> Self {
        Self {
            lambda: 0.1,
            cap: Cap::Relative,
            order: Order::Topological,
            keys: Keys::Swap,
            share: 0.25,
            every: 100,
            first: 200,
            views: 8,
            graph: None,
        }
    }

    /// Whether a guide has to say something.
    pub fn needs_guide(&self) -> bool {
        self.graph.is_none() || self.keys == Keys::Swap
    }

    pub(crate) fn validate(&self) -> Result<()> {
        if !(self.lambda >= 0.0) {
            return Err(Error::input("--lambda")
                .expected("a number, not negative, or inf")
                .got(self.lambda.to_string()));
        }
        if !(self.share > 0.0 && self.share <= 1.0) {
            return Err(Error::input("--key-share")
                .expected("above 0, at most 1")
                .got(self.share.to_string()));
        }
        for (name, n) in [("--key-every", self.every), ("--key-views", self.views)] {
            if n == 0 {
                return Err(Error::input(name).expected("at least 1").got("0"));
            }
        }
        Ok(())
    }

    pub(crate) fn describe(&self, record: &mut Value) {
        record["progressive"] = Value::from("on");
        for (key, value) in [
            ("lambda", json!(self.lambda.to_string())),
            ("lambda_mode", json!(self.cap.name())),
            ("order", json!(self.order.name())),
            ("keys", json!(self.keys.name())),
            ("key_share", json!(self.share)),
            ("key_every", json!(self.every)),
            ("key_first", json!(self.first)),
            ("key_views", json!(self.views)),
            ("graph_given", json!(self.graph.as_ref().map(|g| (g.n(), g.edges())))),
        ] {
            record[key] = value;
        }
    }
}
