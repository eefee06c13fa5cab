//! Settings of Adam except the learning rate.

use crate::{Error, Result};

/// Which step count the bias correction uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counters {
    /// Every row counts its own steps.
    Row,
    /// One counter for all rows, as in most programs.
    Global,
}

impl Counters {
    /// Parses `row` or `global`.
    ///
    /// # Errors
    /// When the name is neither.
    pub fn parse(name: &str) -> Result<Self> {
        match name {
            "row" => Ok(Self::Row),
            "global" => Ok(Self::Global),
            other => Err(Error::input("setting counters").expected("row or global").got(other)),
        }
    }
}

/// Form of weight decay.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decay {
    /// Added to the gradient (`adam`).
    Coupled,
    /// Shrinks the parameter before the step (`adamw`).
    Decoupled,
}

/// Settings of a step except the learning rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rule {
    /// β₁ in [0, 1).
    pub beta1: f64,
    /// β₂ in [0, 1).
    pub beta2: f64,
    /// ε > 0, representable in f32.
    pub eps: f64,
    /// w ≥ 0.
    pub weight_decay: f64,
    /// Form of weight decay.
    pub decay: Decay,
    /// Step counters.
    pub counters: Counters,
}

impl Default for Rule {
    fn default() -> Self {
        Self {
            beta1: 0.9,
            beta2: 0.999,
            eps: 1e-8,
            weight_decay: 0.0,
            decay: Decay::Coupled,
            counters: Counters::Row,
        }
    }
}

impl Rule {
    /// The rule of 3D Gaussian splatting: ε = 1e-15, no decay.
    pub const SPLAT: Self = Self {
        beta1: 0.9,
        beta2: 0.999,
        eps: 1e-15,
        weight_decay: 0.0,
        decay: Decay::Coupled,
        counters: Counters::Row,
    };

    pub(super) fn check(&self) -> Result<()> {
        let wrong = |name: &str, expected: &str, got: f64| {
            Err(Error::input("adam").at(format!("setting {name}")).expected(expected).got(got.to_string()))
        };
        for (name, beta) in [("beta1", self.beta1), ("beta2", self.beta2)] {
            if !(0.0..1.0).contains(&beta) {
                return wrong(name, "0 ≤ beta < 1", beta);
            }
        }
        if !(self.eps as f32 > 0.0 && self.eps.is_finite()) {
            return wrong("eps", "a positive number representable in single precision", self.eps);
        }
        if !(self.weight_decay >= 0.0 && self.weight_decay.is_finite()) {
            return wrong("weight_decay", "a finite number, not negative", self.weight_decay);
        }
        Ok(())
    }
}
