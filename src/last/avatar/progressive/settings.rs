//! Settings of the progressive update.

use crate::math::digraph::Digraph;
use crate::{Error, Result};
use serde_json::{Value, json};

/// The meaning of λ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cap {
    /// λ limits the RMS of a child's step relative to that of its parents.
    Relative,
    /// λ limits the norm of the gradient, which is used directly as the step.
    Absolute,
    /// Local steps end when the norm of the gradient falls below λ, after at most five steps.
    Stop,
}

/// The order in which factors are updated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Parents first.
    Topological,
    /// As with all edges reversed.
    Reverse,
    /// As with the factors permuted; the permutation is drawn from the seed.
    Random,
    /// All factors at once.
    None,
}

/// How key Gaussians are selected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keys {
    /// By exchanging one factor at a time.
    Swap,
    /// The same number of Gaussians, drawn at random.
    Random,
    /// Every Gaussian is key to every factor.
    All,
}

macro_rules! named {
    ($kind:ident, $option:literal, $list:literal, $($variant:ident = $name:literal),*) => {
        impl $kind {
            /// The name used in settings.
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $name),* }
            }

            /// The value with the given name.
            ///
            /// # Errors
            /// If there is no such name.
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

/// Settings of the progressive update; iterations refer to the published schedule of 1 200.
#[derive(Clone, Debug, PartialEq)]
pub struct Progressive {
    /// The limit λ ≥ 0; an infinite value limits nothing.
    pub lambda: f64,
    /// The meaning of λ.
    pub cap: Cap,
    /// The order in which factors are updated.
    pub order: Order,
    /// How key Gaussians are selected.
    pub keys: Keys,
    /// Fraction q of the Gaussians that are key to a factor.
    pub share: f64,
    /// Key Gaussians are selected again at multiples of this number of iterations.
    pub every: usize,
    /// First iteration at which key Gaussians are selected.
    pub first: usize,
    /// Number of training images used for the selection.
    pub views: usize,
    /// A graph that replaces the graph of the guide.
    pub graph: Option<Digraph>,
}

impl Progressive {
    /// The default settings: eq. 10–12 of the LAST paper, with constants that the paper does not give chosen
    /// here.
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

    /// Whether a guide is required.
    pub fn needs_guide(&self) -> bool {
        self.graph.is_none() || self.keys == Keys::Swap
    }

    pub(crate) fn validate(&self) -> Result<()> {
        if !(self.lambda >= 0.0) {
            return Err(Error::input("--lambda")
                .expected("a non-negative number, or inf")
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
