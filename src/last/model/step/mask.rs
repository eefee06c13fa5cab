//! The edge mask of a step.

use super::super::latent::Bars;
use super::super::purpose;
use super::super::structure::Structure;
use crate::causal::mask;
use crate::num::order;
use crate::num::rng::Rng;

/// Ratio of root mean squares above which counterfactuals are considered to have grown along a cycle.
const FAR: f64 = 10.0;

/// Whether counterfactuals have grown along a cycle, relative to the encoded factors and the given values.
pub(super) fn grows(counterfactuals: &[f64], encoded: &[f64], told: &[f64]) -> bool {
    let mean_square = |x: &[f64]| x.iter().fold(0.0, |s, x| s + x * x) / Ord::max(1, x.len()) as f64;
    let usual = order::max(mean_square(encoded), mean_square(told));
    // A NaN counts as growth.
    !(mean_square(counterfactuals) <= FAR * FAR * usual)
}

/// Settings of the draw of a mask.
#[derive(Clone, Copy)]
pub(super) struct Draw {
    pub(super) rng: Rng,
    /// Number of the step.
    pub(super) step: u32,
    /// Number of factors n.
    pub(super) factors: usize,
    /// Temperature τ.
    pub(super) tau: f64,
}

/// The mask of a step, with the data for its adjoint.
pub(super) struct Mask {
    /// Edges, shape (n, n).
    pub(super) edges: Vec<f64>,
    /// The uniform numbers from which the edges were drawn, shape (n, n).
    uniform: Vec<f64>,
    /// The order to which edges were restricted, shape (n, n), if counterfactuals grew.
    along: Option<Vec<f64>>,
}

impl Mask {
    /// The final graph, if there is one, or edges drawn from the logits.
    pub(super) fn new(structure: &Structure, graph: Option<&[f64]>, draw: Draw) -> Self {
        let Draw { rng, step, factors: n, tau } = draw;
        let uniform: Vec<f64> =
            (0..n * n).map(|at| rng.uniform_f64(at as u64, step, purpose::MASK, 0)).collect();
        let edges = match graph {
            Some(graph) => graph.to_vec(),
            None => mask::forward(&mask::In {
                logits: &structure.logits,
                uniform: &uniform,
                allowed: None,
                n,
                tau,
            }),
        };
        Self { edges, uniform, along: None }
    }

    /// Draws again with the same random numbers, restricted to edges along an order of the factors drawn for
    /// the step.
    pub(super) fn limit(&mut self, structure: &Structure, draw: Draw) {
        self.along = Some(ordered(&draw.rng, draw.factors, draw.step));
        self.edges = mask::forward(&self.input(structure, draw));
    }

    fn input<'a>(&'a self, structure: &'a Structure, draw: Draw) -> mask::In<'a> {
        mask::In {
            logits: &structure.logits,
            uniform: &self.uniform,
            allowed: self.along.as_deref(),
            n: draw.factors,
            tau: draw.tau,
        }
    }

    /// Adds the gradient of drawn edges to that of the logits.
    pub(super) fn to_logits(&self, structure: &Structure, draw: Draw, bars: &mut Bars) {
        mask::adjoint(&self.input(structure, draw), &bars.mask, &mut bars.structure.logits);
    }
}

/// Mask (n, n) with 1 where the first factor precedes the second in an order drawn for the step.
fn ordered(rng: &Rng, n: usize, step: u32) -> Vec<f64> {
    let place: Vec<f64> = (0..n).map(|i| rng.uniform_f64(i as u64, step, purpose::ORDER, 0)).collect();
    (0..n * n).map(|at| f64::from(u8::from(place[at / n] < place[at % n]))).collect()
}
