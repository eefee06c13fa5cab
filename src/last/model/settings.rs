//! What can be chosen about the image-to-point model and its training; the defaults are those of `last.md` §8.

use super::structure::Kind;
use crate::last::avatar::guide::Framing;
use crate::{Error, Result};
use serde_json::{Value, json};

/// Which reading of the paper (`last.md` §0, 1b).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Reading {
    /// the encoder gives endogenous factors, their noise is abducted
    #[default]
    Reference,
    /// the encoder gives the noise, the structure acts on the way to the decoder
    Literal,
}

impl Reading {
    /// The mechanism that belongs to it.
    pub fn mechanism(self) -> Kind {
        match self {
            Self::Reference => Kind::Networks,
            Self::Literal => Kind::Printed,
        }
    }
}

/// What the model is told about interventions (`last.md` §7.3).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Supervision {
    /// nothing
    None,
    /// pairs, each with a value of its own (the negative control)
    PerSample,
    /// groups that share a value, and which factor was set
    #[default]
    Groups,
    /// the value too
    Labels,
    /// groups that share a value; which factor was set is guessed from the noise
    Unknown,
}

/// What the loss of dependence looks at (`last.md` §6.1).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Placement {
    /// exogenous noise
    #[default]
    Noise,
    /// endogenous factors, as printed
    Factors,
    /// noise of factors without an edge between them
    Conditional,
    /// nothing
    Off,
}

/// Factors of the terms of the loss.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weights {
    /// w₁
    pub reconstruction: f64,
    /// w_KL, after its warm-up
    pub kl: f64,
    /// w₂
    pub independence: f64,
    /// w₄, of everything that groups say
    pub groups: f64,
    /// of L_int among that
    pub intervention: f64,
    /// of the spread hinge among that
    pub spread: f64,
    /// w_s
    pub sparsity: f64,
}

impl Default for Weights {
    fn default() -> Self {
        Self {
            reconstruction: 1.0,
            kl: 1e-3,
            independence: 0.1,
            groups: 1.0,
            intervention: 1.0,
            spread: 1.0,
            sparsity: 2e-3,
        }
    }
}

/// Everything that a training depends on besides data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// n
    pub factors: usize,
    /// k
    pub width: usize,
    /// how parents act
    pub kind: Kind,
    /// which model
    pub reading: Reading,
    /// what it sees of a picture
    pub framing: Framing,
    /// what it is told
    pub supervision: Supervision,
    /// where dependence is punished
    pub placement: Placement,
    /// factors of the terms
    pub weights: Weights,
    /// τ of the mask
    pub tau: f64,
    /// α of h
    pub alpha: f64,
    /// steps of joint training
    pub steps: u32,
    /// further steps with the final graph
    pub refit: u32,
    /// steps before the logits move
    pub freeze: u32,
    /// steps before groups count; from there w₄ grows until the logits move. 0: it is whole from the start
    pub alone: u32,
    /// steps over which w_KL grows
    pub warm_up: u32,
    /// steps between updates of the multiplier of h
    pub round: u32,
    /// rate of the networks
    pub lr: f64,
    /// rate of the logits
    pub lr_logits: f64,
    /// observed items of a batch
    pub observed: usize,
    /// groups of a batch
    pub groups: usize,
    /// coordinates decoded per item
    pub points: usize,
    /// of all draws
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            factors: 4,
            width: 4,
            kind: Kind::Networks,
            reading: Reading::default(),
            framing: Framing::default(),
            supervision: Supervision::default(),
            placement: Placement::default(),
            weights: Weights::default(),
            tau: 0.2,
            alpha: 1.0,
            steps: 12_000,
            refit: 1_000,
            freeze: 1_000,
            alone: 0,
            warm_up: 2_000,
            round: 500,
            lr: 1e-3,
            lr_logits: 3e-2,
            observed: 64,
            groups: 8,
            points: 256,
            seed: 0,
        }
    }
}

macro_rules! names {
    ($type:ident, $what:literal, $($variant:ident => $name:literal),+) => {
        impl $type {
            /// Its name in settings and records.
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $name),+ }
            }

            /// The one of that name.
            ///
            /// # Errors
            /// When there is none; the error lists the names.
            pub fn parse(name: &str) -> Result<Self> {
                match name {
                    $($name => Ok(Self::$variant),)+
                    other => Err(Error::input($what).expected([$($name),+].join(", ")).got(other)),
                }
            }
        }
    };
}
names!(Reading, "reading", Reference => "reference", Literal => "literal");
names!(Framing, "framing", Person => "person", Whole => "whole");
names!(Supervision, "supervision", None => "none", PerSample => "pairs", Groups => "groups", Labels => "labels", Unknown => "unknown");
names!(Placement, "loss of dependence", Noise => "noise", Factors => "factors", Conditional => "conditional", Off => "off");
names!(Kind, "mechanism", Linear => "linear", Networks => "networks", Printed => "printed");

impl Settings {
    /// For pictures, where factors do not matter alike: of what L_rec measures of the built-in figure about its mean, posture makes 88 %, the forearm 5 %,
    /// light 4 %, folds 3 %. With the constants of vectors, L_eq and L_inv cost more than any factor but posture gains: the codes of the others go to 0 before
    /// the decoder has learned what they are for, and the hinge, whose gradient is proportional to the code, does not bring them back. So here encoder
    /// and decoder learn alone for a third of the steps; then groups come in over another third; then the logits move. What is decoded weighs ten times as much and
    /// the hinge thirty times, which keeps the codes of all factors of one order.
    pub fn of_pictures() -> Self {
        Self {
            weights: Weights { reconstruction: 10.0, intervention: 10.0, spread: 30.0, ..Weights::default() },
            lr: 2e-3,
            freeze: 8_000,
            alone: 4_000,
            ..Self::default()
        }
    }

    /// The share of w₄ that counts in a step.
    pub fn told(&self, step: u32) -> f64 {
        if step < self.alone {
            0.0
        } else if self.alone == 0 || step >= self.freeze {
            1.0
        } else {
            f64::from(step - self.alone) / f64::from(self.freeze - self.alone)
        }
    }

    /// Everything, for records and checkpoints.
    pub fn json(&self) -> Value {
        let w = &self.weights;
        json!({
            "factors": self.factors, "width": self.width, "mechanism": self.kind.name(),
            "reading": self.reading.name(), "framing": self.framing.name(), "supervision": self.supervision.name(), "dependence": self.placement.name(),
            "w_reconstruction": w.reconstruction, "w_kl": w.kl, "w_independence": w.independence, "w_groups": w.groups,
            "w_intervention": w.intervention, "w_spread": w.spread, "w_sparsity": w.sparsity, "tau": self.tau, "alpha": self.alpha, "steps": self.steps, "refit": self.refit,
            "freeze": self.freeze, "alone": self.alone, "warm_up": self.warm_up, "round": self.round, "lr": self.lr, "lr_logits": self.lr_logits,
            "observed": self.observed, "groups": self.groups, "points": self.points, "seed": self.seed,
        })
    }

    /// The same schedule in another number of steps: the constants that count steps are scaled alike, at least 1.
    #[must_use]
    pub fn scaled(mut self, steps: u32) -> Self {
        let share = |x: u32| Ord::max(1, (u64::from(x) * u64::from(steps) / u64::from(self.steps)) as u32);
        [self.refit, self.freeze, self.warm_up, self.round] =
            [self.refit, self.freeze, self.warm_up, self.round].map(share);
        self.alone = if self.alone > 0 { share(self.alone) } else { 0 };
        self.steps = steps;
        self
    }

    /// Holds every number to its range.
    ///
    /// # Errors
    /// The first one outside.
    pub fn validate(&self) -> Result<()> {
        let whole = [
            ("factors", self.factors, 1..=8),
            ("width", self.width, 1..=16),
            ("observed pictures of a batch", self.observed, 1..=4096),
            ("groups of a batch", self.groups, 0..=512),
            ("points", self.points, 1..=1 << 16),
        ];
        for (name, value, range) in whole {
            if !range.contains(&value) {
                return Err(Error::input(name)
                    .expected(format!("{} to {}", range.start(), range.end()))
                    .got(value.to_string()));
            }
        }
        for (name, value) in
            [("tau", self.tau), ("alpha", self.alpha), ("lr", self.lr), ("lr of logits", self.lr_logits)]
        {
            if !(value > 0.0 && value.is_finite()) {
                return Err(Error::input(name).expected("a number above 0").got(value.to_string()));
            }
        }
        if self.freeze >= self.steps || self.refit == 0 {
            return Err(Error::input("steps")
                .expected(format!(
                    "more than the {} before edges move, and at least one to refit",
                    self.freeze
                ))
                .got(format!("{} and {}", self.steps, self.refit)));
        }
        if self.alone > self.freeze {
            return Err(Error::input("steps before groups count")
                .expected(format!("no more than the {} before edges move", self.freeze))
                .got(self.alone.to_string()));
        }
        if self.kind == Kind::Printed && self.reading == Reading::Reference {
            return Err(Error::input("mechanism printed")
                .expected("reading literal: eq. 2 followed by eq. 3 has no abduction")
                .got("reading reference"));
        }
        Ok(())
    }
}
