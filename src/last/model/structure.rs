//! The structure layer: the graph between the factors and the mechanisms (eq. 2 and 3 of the LAST paper).
//!
//! | parameter | shape | |
//! |-----------|-------|-|
//! | `structure.logits` U | (n, n) | p(i → j) = σ(U/τ); the diagonal is ignored |
//! | `structure.weight` Ω | (n, n) | effects of the linear mechanism |
//! | `structure.nodes.w0 … w2` | (n, h, n·k) … (n, k, h) | networks of the nodes, h = 32, leaky ReLU 0.05 |
//! | `structure.values` w | (n, k) | code of a unit value of each factor, whose first entry is fixed to 1; only with labels |
//!
//! Parameters are stored in single precision like all others; [`Structure`] holds them in double precision,
//! in which this layer is computed.

use super::purpose;
use crate::causal::probability;
use crate::causal::structure::{Mechanism, MechanismBar, Networks};
use crate::optim::initial::Initial;
use crate::tape::{Grads, Params};
use ndarray::{ArrayD, IxDyn};

/// Slope of the leaky ReLU of the node networks at 0 and below.
pub const SLOPE: f64 = 0.05;
/// Width of the hidden layers of the node networks.
pub const HIDDEN: usize = 32;
/// Number of the first array drawn for the structure.
const FIRST_ARRAY: u32 = 128;
/// Largest magnitude of the initial logits.
const FIRST_LOGIT: f32 = 1e-10;

/// How parents act on a factor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Linearly, by one number per edge (eq. 2).
    Linear,
    /// By a network per factor (eq. 3).
    Networks,
    /// Linearly along all paths, followed by one evaluation of the networks: eq. 2 and eq. 3 as printed, one
    /// after the other.
    Printed,
}

/// Sizes of the structure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    /// Number of factors n.
    pub factors: usize,
    /// Number of dimensions k per factor.
    pub width: usize,
    /// How parents act on a factor.
    pub kind: Kind,
}

/// Name of the first layers of the networks, (n, h, n·k).
pub(super) const FIRST: &str = "structure.nodes.w0";
/// Name of their last layers, (n, k, h).
pub(super) const LAST: &str = "structure.nodes.w2";
/// Name of U.
pub(super) const LOGITS: &str = "structure.logits";
/// Name of Ω.
pub(super) const EFFECTS: &str = "structure.weight";

/// Names of the arrays of the networks, in the order of [`Networks`].
const NODES: [&str; 5] = ["w0", "b0", "w1", "b1", "w2"];

impl Sizes {
    /// The latent size d = n·k.
    pub fn latent(&self) -> usize {
        self.factors * self.width
    }

    /// Names and shapes of all parameters.
    pub fn shapes(&self) -> Vec<(String, Vec<usize>)> {
        let (n, k, h) = (self.factors, self.width, HIDDEN);
        let mut all = vec![(LOGITS.to_owned(), vec![n, n])];
        if self.kind != Kind::Networks {
            all.push((EFFECTS.into(), vec![n, n]));
        }
        if self.kind != Kind::Linear {
            let shapes = [vec![n, h, n * k], vec![n, h], vec![n, h, h], vec![n, h], vec![n, k, h]];
            all.extend(NODES.iter().zip(shapes).map(|(name, s)| (format!("structure.nodes.{name}"), s)));
        }
        all.push(("structure.values".into(), vec![n, k]));
        all
    }

    /// Initial values: logits in ±10⁻¹⁰, hidden layers He-uniform, last layers and Ω 0, codes (1, 0, …).
    pub fn draw(&self, seed: u64, params: &mut Params) {
        for (at, (name, shape)) in self.shapes().into_iter().enumerate() {
            let initial = Initial::numbered(seed, purpose::INITIAL, FIRST_ARRAY + at as u32);
            let array = match name.as_str() {
                LOGITS => initial.uniform(&shape, FIRST_LOGIT),
                "structure.values" => {
                    ArrayD::from_shape_fn(IxDyn(&shape), |i| if i[1] == 0 { 1.0 } else { 0.0 })
                }
                "structure.nodes.w0" | "structure.nodes.w1" => {
                    let (n, h) = (shape[0], shape[1]);
                    initial
                        .he_uniform(&[n * h, shape[2]], SLOPE as f32)
                        .into_shape_with_order(IxDyn(&shape))
                        .expect("the same size")
                }
                _ => ArrayD::zeros(IxDyn(&shape)),
            };
            params.set(&name, array);
        }
    }
}

fn networks([w0, b0, w1, b1, w2]: [&Vec<f64>; 5]) -> Networks<'_> {
    Networks { w0, b0, w1, b1, w2, hidden: HIDDEN, slope: SLOPE }
}

/// Parameters of the structure in double precision.
#[derive(Clone, Debug, PartialEq)]
pub struct Structure {
    /// Sizes of the structure.
    pub sizes: Sizes,
    /// The logits U, shape (n, n).
    pub logits: Vec<f64>,
    /// Codes of unit values, shape (n, k).
    pub values: Vec<f64>,
    /// Ω or the arrays of the networks.
    arrays: Vec<Vec<f64>>,
}

/// Gradients with respect to the parameters of a structure.
#[derive(Clone, Debug, PartialEq)]
pub struct StructureBar {
    /// Gradient with respect to the logits, shape (n, n).
    pub logits: Vec<f64>,
    /// Gradient with respect to the codes, shape (n, k).
    pub values: Vec<f64>,
    /// Gradient with respect to the mechanism.
    pub mechanism: MechanismBar,
}

impl Structure {
    /// Reads the structure from `params`.
    ///
    /// # Panics
    /// If a parameter is missing.
    pub fn new(sizes: Sizes, params: &Params) -> Self {
        let get = |name: &str| -> Vec<f64> {
            let array = params.get(name).unwrap_or_else(|| panic!("missing structure parameter '{name}'"));
            array.iter().map(|&x| f64::from(x)).collect()
        };
        let mut between = sizes.shapes();
        between.pop();
        let arrays = between[1..].iter().map(|(name, _)| get(name)).collect();
        Self { sizes, logits: get(LOGITS), values: get("structure.values"), arrays }
    }

    /// The mechanism by which parents act.
    pub fn mechanism(&self) -> Mechanism<'_> {
        match &self.arrays[..] {
            [weight] => Mechanism::Linear { weight },
            [w0, b0, w1, b1, w2] => Mechanism::Networks(networks([w0, b0, w1, b1, w2])),
            [weight, w0, b0, w1, b1, w2] => {
                Mechanism::Printed { weight, networks: networks([w0, b0, w1, b1, w2]) }
            }
            other => unreachable!("a mechanism of {} arrays", other.len()),
        }
    }

    /// Number of sweeps that reach every descendant.
    pub fn sweeps(&self) -> usize {
        match self.sizes.kind {
            Kind::Linear => self.sizes.factors - 1,
            Kind::Networks | Kind::Printed => self.sizes.factors,
        }
    }

    /// Probabilities p = σ(U/τ), with zero diagonal.
    pub fn probabilities(&self, tau: f64) -> Vec<f64> {
        probability::forward(&self.logits, self.sizes.factors, tau)
    }

    /// The array at the given position of [`Sizes::shapes`].
    #[cfg(test)]
    pub(super) fn array_mut(&mut self, at: usize) -> &mut Vec<f64> {
        let last = self.arrays.len() + 1;
        match at {
            0 => &mut self.logits,
            at if at == last => &mut self.values,
            at => &mut self.arrays[at - 1],
        }
    }

    /// Zero gradients.
    pub fn zeros(&self) -> StructureBar {
        StructureBar {
            logits: vec![0.0; self.logits.len()],
            values: vec![0.0; self.values.len()],
            mechanism: MechanismBar::zeros_like(&self.mechanism()),
        }
    }
}

impl StructureBar {
    /// The gradients in the order of [`Sizes::shapes`].
    pub fn arrays(&self, kind: Kind) -> Vec<&[f64]> {
        let m = &self.mechanism;
        let mut all: Vec<&[f64]> = vec![&self.logits];
        if kind != Kind::Networks {
            all.push(&m.weight);
        }
        if kind != Kind::Linear {
            all.extend([&m.w0[..], &m.b0, &m.w1, &m.b1, &m.w2]);
        }
        all.push(&self.values);
        all
    }

    /// The gradients by name, in single precision.
    pub fn grads(&self, sizes: Sizes) -> Grads {
        let of = |((name, shape), bar): ((String, Vec<usize>), &[f64])| {
            let values = bar.iter().map(|&g| g as f32).collect();
            (name, ArrayD::from_shape_vec(IxDyn(&shape), values).expect("the shape of the parameter"))
        };
        Grads(sizes.shapes().into_iter().zip(self.arrays(sizes.kind)).map(of).collect())
    }
}
