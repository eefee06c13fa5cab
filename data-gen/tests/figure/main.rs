//! The figure agrees with its documentation: causes, effects, shapes.

mod causes;
mod sortability;
mod surfaces;
mod template;
mod video;

use data_gen::figure::appearance::Appearance;
use data_gen::figure::graph::Graph;
use data_gen::figure::mechanism::{Mechanism, Scm, variance};
use data_gen::figure::samples::observed;

const P: usize = 0;
const O: usize = 1;
const W: usize = 2;
const L: usize = 3;

fn scm(graph: &str, n: usize, mechanism: Mechanism, standardised: bool, seed: u64) -> Scm {
    Scm::new(Graph::named(graph, n, seed).expect("a known graph"), mechanism, standardised, seed)
}

fn samples(scm: &Scm, seed: u64, n: usize) -> Vec<Vec<f64>> {
    (0..n).map(|i| observed(scm, seed, i, n, 1).u).collect()
}

fn column(samples: &[Vec<f64>], j: usize) -> Vec<f64> {
    samples.iter().map(|u| u[j]).collect()
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len() as f64;
    let mean = |x: &[f64]| x.iter().fold(0.0, |s, x| s + x) / n;
    let (ma, mb) = (mean(a), mean(b));
    let cross = a.iter().zip(b).fold(0.0, |s, (a, b)| s + (a - ma) * (b - mb)) / n;
    cross / (variance(a) * variance(b)).sqrt()
}

/// Appearances of every kind.
fn looks() -> Vec<Appearance> {
    (0..12).map(|i| Appearance::new(9, i)).collect()
}
