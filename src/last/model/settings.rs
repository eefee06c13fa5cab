//! Settings of the image-to-point model and its training, with the defaults of the program; the paper (eq. 7)
//! gives no values.

use super::structure::Kind;
use crate::last::avatar::guide::Framing;
use crate::{Error, Result};
use serde_json::{Value, json};

/// The reading of eq. 1–3 of the LAST paper.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Reading {
    /// The encoder outputs endogenous factors; their noise is obtained by abduction.
    #[default]
    Reference,
    /// The encoder outputs the noise; the structure is applied before the decoder.
    Literal,
}

impl Reading {
    /// The mechanism that corresponds to the reading.
    pub fn mechanism(self) -> Kind {
        match self {
            Self::Reference => Kind::Networks,
            Self::Literal => Kind::Printed,
        }
    }
}

/// Intervention labels available in training.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Supervision {
    /// No labels.
    None,
    /// Pairs, each with its own value (the negative control).
    PerSample,
    /// Groups that share a value, and the factor that was set.
    #[default]
    Groups,
    /// Groups, the factor and the value.
    Labels,
    /// Groups that share a value; the factor that was set is inferred from the noise.
    Unknown,
}

/// The variables to which the independence loss L_MI (eq. 5) applies.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Placement {
    /// Exogenous noise.
    #[default]
    Noise,
    /// Endogenous factors, as in the paper.
    Factors,
    /// Noise of factors without an edge between them.
    Conditional,
    /// No independence loss.
    Off,
}

/// Weights of the loss terms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weights {
    /// Weight w₁ of the reconstruction loss.
    pub reconstruction: f64,
    /// Weight w_KL after its warm-up.
    pub kl: f64,
    /// Weight w₂ of the independence loss.
    pub independence: f64,
    /// Weight w₄ of all group losses.
    pub groups: f64,
    /// Relative weight of L_int among the group losses.
    pub intervention: f64,
    /// Relative weight of the spread hinge among the group losses.
    pub spread: f64,
    /// Weight w_s of the sparsity term.
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

/// All settings that affect a training run, apart from the data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Number of factors n.
    pub factors: usize,
    /// Number of dimensions k per factor.
    pub width: usize,
    /// How parents act on a factor.
    pub kind: Kind,
    /// The reading of the paper.
    pub reading: Reading,
    /// The part of an image that the encoder reads.
    pub framing: Framing,
    /// Intervention labels available in training.
    pub supervision: Supervision,
    /// The variables to which the independence loss applies.
    pub placement: Placement,
    /// Weights of the loss terms.
    pub weights: Weights,
    /// Temperature τ of the mask.
    pub tau: f64,
    /// The constant α of h (eq. 6).
    pub alpha: f64,
    /// Number of steps of joint training.
    pub steps: u32,
    /// Number of further steps with the final graph.
    pub refit: u32,
    /// Step at which the logits start to train.
    pub freeze: u32,
    /// Step at which the group losses start; w₄ then increases until the logits start to train. With 0, w₄
    /// has its full value from the start.
    pub alone: u32,
    /// Number of steps over which w_KL increases.
    pub warm_up: u32,
    /// Number of steps between updates of the multiplier of h.
    pub round: u32,
    /// Learning rate of the networks.
    pub lr: f64,
    /// Learning rate of the logits.
    pub lr_logits: f64,
    /// Number of observed items of a batch.
    pub observed: usize,
    /// Number of groups of a batch.
    pub groups: usize,
    /// Number of coordinates decoded per item.
    pub points: usize,
    /// Seed of all random draws.
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
            /// The name used in settings and records.
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $name),+ }
            }

            /// The value with the given name.
            ///
            /// # Errors
            /// If there is no such name; the error lists the valid names.
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
names!(Placement, "independence loss", Noise => "noise", Factors => "factors", Conditional => "conditional", Off => "off");
names!(Kind, "mechanism", Linear => "linear", Networks => "networks", Printed => "printed");

impl Settings {
    /// Settings for images, in which factors contribute unequally to the reconstruction loss: for the
    /// built-in figure, posture accounts for 88 % of what L_rec measures about its mean, the forearm for 5 %,
    /// light for 4 % and folds for 3 %. With the constants used for vectors, L_eq and L_inv cost more than
    /// any factor except posture gains: the codes of the other factors shrink to 0 before the decoder has
    /// learned to use them, and the hinge, whose gradient is proportional to the code, does not restore them.
    /// Therefore only encoder and decoder are trained for the first third of the steps; the group losses are
    /// added over the second third; then the logits start to train. The reconstruction terms have ten times
    /// the weight and the hinge thirty times, which keeps the codes of all factors within one order of
    /// magnitude.
    pub fn of_pictures() -> Self {
        Self {
            weights: Weights { reconstruction: 10.0, intervention: 10.0, spread: 30.0, ..Weights::default() },
            lr: 2e-3,
            freeze: 8_000,
            alone: 4_000,
            ..Self::default()
        }
    }

    /// The fraction of w₄ that applies in a step.
    pub fn told(&self, step: u32) -> f64 {
        if step < self.alone {
            0.0
        } else if self.alone == 0 || step >= self.freeze {
            1.0
        } else {
            f64::from(step - self.alone) / f64::from(self.freeze - self.alone)
        }
    }

    /// All settings as JSON, for records and checkpoints.
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

    /// The same schedule with another number of steps: constants that count steps are scaled equally, to at
    /// least 1.
    #[must_use]
    pub fn scaled(mut self, steps: u32) -> Self {
        let share = |x: u32| Ord::max(1, (u64::from(x) * u64::from(steps) / u64::from(self.steps)) as u32);
        [self.refit, self.freeze, self.warm_up, self.round] =
            [self.refit, self.freeze, self.warm_up, self.round].map(share);
        self.alone = if self.alone > 0 { share(self.alone) } else { 0 };
        self.steps = steps;
        self
    }

    /// [`Self::scaled`] to a number of steps of joint training and refit together.
    #[must_use]
    pub fn scaled_to_all(self, all: u32) -> Self {
        let share = u64::from(all) * u64::from(self.refit) / u64::from(self.steps + self.refit);
        let refit = Ord::max(1, share as u32);
        Self { refit, ..self.scaled(all - refit) }
    }

    /// Checks the ranges of all settings.
    ///
    /// # Errors
    /// The first setting that is out of range.
    pub fn validate(&self) -> Result<()> {
        let whole = [
            ("factors", self.factors, 1..=8),
            ("width", self.width, 1..=16),
            ("observed images of a batch", self.observed, 1..=4096),
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
                    "more steps than the {} before edges start to train, and at least one refitting step",
                    self.freeze
                ))
                .got(format!("{} and {}", self.steps, self.refit)));
        }
        if self.alone > self.freeze {
            return Err(Error::input("steps before the group losses start")
                .expected(format!("at most the {} before edges start to train", self.freeze))
                .got(self.alone.to_string()));
        }
        if self.kind == Kind::Printed && self.reading == Reading::Reference {
            return Err(Error::input("mechanism printed")
                .expected("the literal reading, because eq. 2 followed by eq. 3 has no abduction")
                .got("reading reference"));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_schedule_has_exactly_the_steps_that_are_asked_for() {
        let full = Settings::of_pictures();
        assert_eq!(full.scaled_to_all(13_000), full, "the complete schedule");
        let shipped = full.scaled_to_all(6_500);
        assert_eq!(shipped, full.scaled(6_000), "half of it");
        for all in [3, 4, 20, 25, 26, 100, 1_000, 6_499, 40_000] {
            let s = full.scaled_to_all(all);
            s.validate().expect("a schedule");
            assert_eq!(s.steps + s.refit, all, "joint training and refit");
        }
    }
}
