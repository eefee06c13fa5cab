//! Cases of the causal layer.

use reference::array::{Arr, Named};

use super::case::{Case, case};
use crate::scenes::{named, normal, uniform};

pub(super) fn cases() -> Vec<Case> {
    vec![
        case("acyclic", "causal.acyclic", graph(), &[], &["a"], &["value"]),
        case("mask", "causal.mask", edges(), &[], &["logits"], &["mask"]),
        case("structure", "causal.structure", mechanism(false), &[], NETWORKS, &["z"]),
        case("abduct", "causal.structure", mechanism(false), &[("mode", "abduct")], NETWORKS, &["z"]),
        case(
            "structure linear",
            "causal.structure",
            mechanism(true),
            &[("mode", "linear")],
            &["eps", "mask", "weight"],
            &["z"],
        ),
        case("posterior kl", "causal.posterior_kl", beliefs(false), &[], &["mu", "logvar"], &["value"]),
        case("posterior", "causal.posterior", beliefs(true), &[], &["mu", "logvar"], &["sample"]),
        case("scm kl", "causal.scm_kl", causes(), &[], &["eps", "logvar"], &["value"]),
        case(
            "scm kl linear",
            "causal.scm_kl",
            linear_beliefs(),
            &[("mode", "linear")],
            &["mu", "logvar", "mask", "weight"],
            &["value"],
        ),
        case("intervene", "causal.intervene", intervention(false), &[], INTERVENED, &["z"]),
        case(
            "intervene linear",
            "causal.intervene",
            intervention(true),
            &[],
            &["eps", "mask", "weight", "value"],
            &["z"],
        ),
        case("independence", "causal.independence", spread(), &[], &["mu", "logvar"], &["value"]),
        case(
            "independence total",
            "causal.independence",
            carried_spread(),
            &[("form", "total"), ("share", "0.6")],
            &["mu", "logvar", "mask", "weight"],
            &["value"],
        ),
    ]
}

const NETWORKS: &[&str] = &["eps", "mask", "w0", "b0", "w1", "b1", "w2"];

const INTERVENED: &[&str] = &["eps", "mask", "w0", "b0", "w1", "b1", "w2", "value"];

fn graph() -> Named<f64> {
    named([("a", uniform(&[4, 4], [0.1, 0.9], 40)), ("alpha", Arr::scalar(1.0))])
}

fn edges() -> Named<f64> {
    named([("logits", uniform(&[4, 4], [-0.5, 0.5], 41)), ("uniform", uniform(&[4, 4], [0.3, 0.7], 42))])
}

/// Three factors of two numbers, by weights or by networks of five hidden units.
fn mechanism(linear: bool) -> Named<f64> {
    let mut all = named([("eps", normal(&[3, 3, 2], 43)), ("mask", uniform(&[3, 3], [0.1, 0.9], 44))]);
    if linear {
        all.extend(named([("weight", normal(&[3, 3], 45))]));
    } else {
        all.extend(named([
            ("w0", uniform(&[3, 5, 6], [-0.6, 0.6], 46)),
            ("b0", normal(&[3, 5], 47)),
            ("w1", uniform(&[3, 5, 5], [-0.6, 0.6], 48)),
            ("b1", normal(&[3, 5], 49)),
            ("w2", uniform(&[3, 2, 5], [-0.6, 0.6], 50)),
        ]));
    }
    all
}

fn beliefs(noise: bool) -> Named<f64> {
    let mut all = named([("mu", normal(&[3, 2, 4], 51)), ("logvar", uniform(&[3, 2, 4], [-2.0, 1.0], 52))]);
    if noise {
        all.extend(named([("eta", normal(&[3, 2, 4], 53))]));
    }
    all
}

/// A mechanism whose three samples are held at their second factor, at their third, and not at all.
fn intervention(linear: bool) -> Named<f64> {
    let mut all = mechanism(linear);
    all.extend(named([("target", Arr::new(&[3], vec![1.0, 2.0, -1.0])), ("value", normal(&[3, 2], 54))]));
    all
}

fn causes() -> Named<f64> {
    named([
        ("eps", normal(&[3, 2, 4], 55)),
        ("logvar", uniform(&[3, 2, 4], [-2.0, 1.0], 52)),
        ("kept", Arr::new(&[3, 2], vec![1.0, 1.0, 0.0, 1.0, 1.0, 0.0])),
    ])
}

fn linear_beliefs() -> Named<f64> {
    named([
        ("mu", normal(&[2, 3, 2], 51)),
        ("logvar", uniform(&[2, 3, 2], [-2.0, 1.0], 52)),
        ("mask", uniform(&[3, 3], [0.1, 0.9], 44)),
        ("weight", normal(&[3, 3], 45)),
        ("kept", Arr::new(&[2, 3], vec![1.0, 1.0, 1.0, 1.0, 0.0, 1.0])),
    ])
}

fn spread() -> Named<f64> {
    named([("mu", normal(&[9, 3, 2], 56)), ("logvar", uniform(&[9, 3, 2], [-2.0, 1.0], 57))])
}

fn carried_spread() -> Named<f64> {
    let mut all = spread();
    let unit = |at: usize| if at / 6 == at % 6 { 0.4 } else { 0.02 };
    all.extend(named([
        ("mask", uniform(&[3, 3], [0.1, 0.9], 44)),
        ("weight", normal(&[3, 3], 45)),
        ("carried", Arr::new(&[6, 6], (0..36).map(unit).collect())),
    ]));
    all
}
