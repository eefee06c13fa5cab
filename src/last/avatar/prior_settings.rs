//! Weights of the prior for unseen surfaces, as settings.

use crate::{Error, Result};
use serde_json::{Value, json};

/// Weights of the prior; with all weights 0, the losses are as published.
pub use crate::loss::prior::Weights as Prior;

fn named(prior: &Prior) -> [(&'static str, f32); 8] {
    [
        ("prior_color", prior.color),
        ("prior_opacity", prior.opacity),
        ("prior_scale", prior.scale),
        ("prior_round", prior.round),
        ("prior_fill", prior.fill),
        ("prior_anchor", prior.anchor),
        ("prior_solid", prior.solid),
        ("prior_reach", prior.reach),
    ]
}

pub(super) fn validate(prior: &Prior) -> Result<()> {
    if !(prior.reach > 0.0) {
        return Err(Error::input("prior_reach").expected("above 0").got(prior.reach.to_string()));
    }
    match named(prior).into_iter().find(|(_, w)| !(*w >= 0.0 && w.is_finite())) {
        Some((name, w)) => {
            Err(Error::input(name).expected("a finite, non-negative weight").got(w.to_string()))
        }
        None => Ok(()),
    }
}

pub(super) fn describe(prior: &Prior, record: &mut Value) {
    for (name, w) in named(prior) {
        record[name] = json!(w);
    }
}
