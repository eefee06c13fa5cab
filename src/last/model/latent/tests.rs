//! Gradients of the latent part, compared with finite differences for every reading, kind of supervision,
//! mechanism and placement.

use super::super::settings::Weights;
use super::*;
use crate::last::model::structure::{Kind, Sizes};
use crate::num::order;
use crate::num::rng::Rng;
use crate::tape::Params;

const SIZES: Sizes = Sizes { factors: 3, width: 2, kind: Kind::Networks };

fn draws(part: u16, len: usize) -> Vec<f64> {
    (0..len).map(|i| Rng::new(3).normal_f64(i as u64, 0, 0x7e58, part)).collect()
}

/// The sum of the weighted terms and ⟨decoded, c⟩, as computed in a training step.
fn value(x: &In<'_>, c: &[f64]) -> f64 {
    let out = forward(x).expect("positive definite");
    let t = out.terms;
    let equal = if x.supervision == Supervision::PerSample { 0.0 } else { t.equal };
    let own = x.weights.kl * t.kl
        + x.weights.independence * t.independence
        + x.weights.groups * ((equal + t.invariant) + x.weights.spread * t.hinge);
    out.decoded.iter().zip(c).fold(own, |s, (d, c)| s + d * c)
}

/// In the literal reading, the KL of an after-image does not depend on the factor that was set.
#[test]
fn what_was_set_has_no_prior() {
    let layout = Layout { observed: 1, targets: vec![2], members: 2 };
    let sizes = Sizes { kind: Kind::Printed, ..SIZES };
    let (n, k, d) = (sizes.factors, sizes.width, sizes.latent());
    let mut params = Params::new();
    sizes.draw(1, &mut params);
    let structure = Structure::new(sizes, &params);
    let mu = draws(0, layout.items() * d);
    let zeros = vec![0.0; mu.len()];
    let mask = vec![0.0; n * n];
    let kl_by = |item: usize, factor: usize, by: f64| {
        let mut mu = mu.clone();
        (0..k).for_each(|c| mu[item * d + factor * k + c] += by);
        let x = In {
            structure: &structure,
            mask: &mask,
            layout: &layout,
            mu: &mu,
            ell: &zeros,
            eta: &zeros,
            spread: &[1.0; 3],
            labels: &[],
            reading: Reading::Literal,
            supervision: Supervision::Groups,
            weights: Weights::default(),
            placement: Placement::Off,
            carried: None,
        };
        forward(&x).expect("finite").terms.kl
    };
    let kl = |item: usize, factor: usize| kl_by(item, factor, 1.0);
    let (base, after) = (layout.base(1), layout.after(1));
    let untouched = kl(after, 2);
    assert_eq!(kl_by(after, 2, 17.0), untouched, "however far out");
    for (item, factor) in [(after, 0), (after, 1), (base, 2), (0, 2)] {
        assert_ne!(kl(item, factor), untouched, "factor {factor} of item {item} counts");
    }
    let free = |mu: &[f64]| -> Vec<f64> {
        let blocks = mu.chunks_exact(k).enumerate();
        let is_set = |at: usize| layout.set_in(at / n) == Some(at % n);
        blocks.filter(|(at, _)| !is_set(*at)).flat_map(|(_, b)| b).copied().collect()
    };
    assert_eq!(untouched, posterior_kl::forward(&free(&mu), &vec![0.0; free(&mu).len()], layout.items()));
}

/// Gradients with respect to all inputs are compared with central differences along one direction per input,
/// for every reading, kind of supervision and mechanism.
#[test]
fn gradients_are_those_of_differences() {
    let layout = Layout { observed: 4, targets: vec![0, 1, 0, 2, 2], members: 2 };
    let items = layout.items();
    let placements = [Placement::Noise, Placement::Factors, Placement::Conditional];
    let kinds = [Kind::Networks, Kind::Linear, Kind::Printed];
    for (kind, placement) in kinds.into_iter().flat_map(|kind| placements.map(|p| (kind, p))) {
        let readings = [Reading::Literal, Reading::Reference];
        for reading in readings.into_iter().take(if kind == Kind::Printed { 1 } else { 2 }) {
            for supervision in [Supervision::PerSample, Supervision::Groups, Supervision::Labels] {
                let sizes = Sizes { kind, ..SIZES };
                let d = sizes.latent();
                let carried: Vec<f64> =
                    (0..d * d).map(|at| if at / d == at % d { 0.5 } else { 0.05 }).collect();
                let mut params = Params::new();
                sizes.draw(1, &mut params);
                for (at, (name, shape)) in sizes.shapes().into_iter().enumerate() {
                    let size = crate::num::array::entries(&shape);
                    let values = draws(50 + at as u16, size);
                    let array = params.get_mut(&name).expect("drawn");
                    array.iter_mut().zip(values).for_each(|(a, v)| *a = (0.3 * v) as f32);
                }
                let structure = Structure::new(sizes, &params);
                let n = sizes.factors;
                let mask: Vec<f64> = (0..n * n)
                    .map(|at| if at / n == at % n { 0.0 } else { 0.2 + 0.07 * at as f64 })
                    .collect();
                let (mu, eta) = (draws(0, items * d), draws(2, items * d));
                let ell: Vec<f64> = draws(1, items * d).iter().map(|l| 0.3 * l - 1.0).collect();
                let labels = draws(3, layout.targets.len());
                let weights = Weights { kl: 0.7, groups: 1.3, spread: 1.7, ..Weights::default() };
                let x = In {
                    structure: &structure,
                    mask: &mask,
                    layout: &layout,
                    mu: &mu,
                    ell: &ell,
                    eta: &eta,
                    spread: &[0.5, 1.5, 1.0],
                    labels: &labels,
                    reading,
                    supervision,
                    weights,
                    placement,
                    carried: Some((&carried, 0.6)),
                };
                let out = forward(&x).expect("positive definite");
                let c = draws(4, out.decoded.len());
                let bars = adjoint(&x, &out, &c);
                let what = format!("{kind:?} {placement:?} {reading:?} {supervision:?}");
                let check = |name: &str, bar: &[f64], direction: &[f64], at: &dyn Fn(f64) -> f64| {
                    let ours = bar.iter().zip(direction).fold(0.0, |s, (b, d)| s + b * d);
                    // Kinks of the networks are close to each other; the smallest error is that of a step
                    // without a kink.
                    let error = |h: f64| {
                        let coarse = (at(2.0 * h) - at(-2.0 * h)) / (4.0 * h);
                        let fine = (at(h) - at(-h)) / (2.0 * h);
                        (ours - (4.0 * fine - coarse) / 3.0).abs() / (1e-3 + ours.abs())
                    };
                    let least =
                        [1e-4, 1e-5, 1e-6, 1e-7].map(error).into_iter().fold(f64::INFINITY, order::min);
                    assert!(least < 1e-7, "{what}, {name}: {ours} is off by {least:e}");
                };
                let moved = |values: &[f64], v: &[f64], t: f64| -> Vec<f64> {
                    values.iter().zip(v).map(|(x, v)| x + t * v).collect()
                };
                let v = draws(9, items * d);
                check("mu", &bars.mu, &v, &|t| value(&In { mu: &moved(&mu, &v, t), ..x }, &c));
                check("ell", &bars.ell, &v, &|t| value(&In { ell: &moved(&ell, &v, t), ..x }, &c));
                let mut w = draws(10, n * n);
                (0..n).for_each(|i| w[i * n + i] = 0.0);
                check("mask", &bars.mask, &w, &|t| value(&In { mask: &moved(&mask, &w, t), ..x }, &c));
                // Parameters in double precision, one array after the other.
                let shapes = sizes.shapes();
                for (at, bar) in bars.structure.arrays(kind).into_iter().enumerate() {
                    let name = &shapes[at].0;
                    if name == "structure.logits" {
                        continue; // logits act through the mask
                    }
                    let v = draws(20 + at as u16, bar.len());
                    check(name, bar, &v, &|t| {
                        let mut other = structure.clone();
                        let into = other.array_mut(at);
                        into.iter_mut().zip(&v).for_each(|(x, v)| *x += t * v);
                        value(&In { structure: &other, ..x }, &c)
                    });
                }
            }
        }
    }
}
