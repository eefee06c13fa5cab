//! The edges of a step.

use super::super::latent::Bars;
use super::super::purpose;
use super::super::structure::Structure;
use crate::causal::mask;
use crate::num::order;
use crate::num::rng::Rng;

/// Counterfactuals so many times as far out as what is encoded come from a mask with a cycle.
const FAR: f64 = 10.0;

/// Whether counterfactuals have grown along a cycle, beyond what is encoded and what is told.
pub(super) fn grows(counterfactuals: &[f64], encoded: &[f64], told: &[f64]) -> bool {
    let mean_square = |x: &[f64]| x.iter().fold(0.0, |s, x| s + x * x) / Ord::max(1, x.len()) as f64;
    let usual = order::max(mean_square(encoded), mean_square(told));
    // A NaN grows, too.
    !(mean_square(counterfactuals) <= FAR * FAR * usual)
}

/// What a mask is drawn with.
#[derive(Clone, Copy)]
pub(super) struct Draw {
    pub(super) rng: Rng,
    /// number of the step
    pub(super) step: u32,
    /// n
    pub(super) factors: usize,
    /// temperature
    pub(super) tau: f64,
}

/// The mask of a step, and how it was made.
pub(super) struct Mask {
    /// (n, n) edges
    pub(super) edges: Vec<f64>,
    /// (n, n) uniform numbers that they were drawn with
    uniform: Vec<f64>,
    /// (n, n) the order that they were limited to, if counterfactuals grew
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

    /// Draws anew with the same numbers, only edges along an order of the factors that is drawn for the step.
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

    /// Adds what the gradient of drawn edges gives the logits.
    pub(super) fn to_logits(&self, structure: &Structure, draw: Draw, bars: &mut Bars) {
        mask::adjoint(&self.input(structure, draw), &bars.mask, &mut bars.structure.logits);
    }
}

/// (n, n) 1 where the first factor comes before the second in an order drawn for the step.
fn ordered(rng: &Rng, n: usize, step: u32) -> Vec<f64> {
    let place: Vec<f64> = (0..n).map(|i| rng.uniform_f64(i as u64, step, purpose::ORDER, 0)).collect();
    (0..n * n).map(|at| f64::from(u8::from(place[at / n] < place[at % n]))).collect()
}
