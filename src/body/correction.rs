//! The correction of a pose: a small network from the pose's angles to corrections of the same joints (GauHuman).
//!
//! δ = W₃ φ(W₂ φ(W₁ θ + b₁) + b₂) + b₃,   φ(x) = max(x, 0),   3J → 128 → 128 → 3J
//!
//! θ and δ are the angles of the joints without the root: 69 numbers for the 23 joints of SMPL. What it gives goes into `body.pose` as
//! `correction`. The first two layers begin uniform in ±1/√inputs, the last in ±1e-5 with biases 0: at first nothing is corrected.
//!
//! # Rounding
//! Layers are `nn.linear`, φ is `nn.leaky_relu` of slope 0; at 0 its slope is 0.
//!
//! # Adjoint
//! The layers' adjoints in reverse; the values before each φ are saved, those after it are computed again.

use crate::nn::act::{leaky_relu, leaky_relu_adjoint};
use crate::nn::linear;
use crate::num::rng::Rng;

/// Units of a hidden layer.
pub const HIDDEN: usize = 128;
/// The last layer begins within this bound.
pub const LAST: f32 = 1e-5;
/// Weights at the start; item: layer · 2³² + entry.
const INIT: u16 = 0x0980;

/// Weights and biases of three layers; also their gradients.
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    /// Angles in and out, 3J.
    pub size: usize,
    /// (outputs, inputs) of each layer
    pub weight: [Vec<f32>; 3],
    /// (outputs) of each layer
    pub bias: [Vec<f32>; 3],
}

/// Inputs and outputs of each layer.
fn shapes(size: usize) -> [[usize; 2]; 3] {
    [[size, HIDDEN], [HIDDEN, HIDDEN], [HIDDEN, size]]
}

/// What the adjoint needs.
#[derive(Clone, Debug)]
pub struct Saved {
    /// (N, 128) before each φ
    before: [Vec<f32>; 2],
}

fn layer<'a>(w: &'a Weights, l: usize, x: &'a [f32], rows: usize) -> linear::In<'a> {
    let [k, n] = shapes(w.size)[l];
    linear::In { x, weight: &w.weight[l], bias: &w.bias[l], m: rows, n, k }
}

fn positive(x: &[f32]) -> Vec<f32> {
    let mut y = vec![0.0; x.len()];
    leaky_relu(x, 0.0, &mut y);
    y
}

impl Weights {
    /// The network before training.
    pub fn new(size: usize, seed: u64) -> Self {
        let rng = Rng::new(seed);
        let draw =
            |l: usize, at: usize| 2.0 * rng.uniform_f32((l as u64) << 32 | at as u64, 0, INIT, 0) - 1.0;
        let shapes = shapes(size);
        let scale = |l: usize| if l == 2 { LAST } else { 1.0 / (shapes[l][0] as f32).sqrt() };
        let weight = std::array::from_fn(|l| {
            (0..shapes[l][0] * shapes[l][1]).map(|at| scale(l) * draw(l, at)).collect()
        });
        let bias = std::array::from_fn(|l| {
            let [k, n] = shapes[l];
            (0..n).map(|o| if l == 2 { 0.0 } else { scale(l) * draw(l, k * n + o) }).collect()
        });
        Self { size, weight, bias }
    }

    /// Zeros in the same shapes.
    pub fn zeros_like(&self) -> Self {
        let zeros = |x: &Vec<f32>| vec![0.0; x.len()];
        Self {
            size: self.size,
            weight: self.weight.each_ref().map(zeros),
            bias: self.bias.each_ref().map(zeros),
        }
    }

    /// Corrections (N, 3J) of N poses, and what the adjoint needs.
    ///
    /// # Panics
    /// When the poses are not rows of 3J angles.
    pub fn forward(&self, pose: &[f32]) -> (Vec<f32>, Saved) {
        let rows = self.rows(pose);
        let mut before = [vec![0.0; rows * HIDDEN], vec![0.0; rows * HIDDEN]];
        linear::forward(layer(self, 0, pose, rows), &mut before[0]);
        linear::forward(layer(self, 1, &positive(&before[0]), rows), &mut before[1]);
        let mut y = vec![0.0; pose.len()];
        linear::forward(layer(self, 2, &positive(&before[1]), rows), &mut y);
        (y, Saved { before })
    }

    fn rows(&self, pose: &[f32]) -> usize {
        assert!(self.size > 0 && pose.len().is_multiple_of(self.size), "rows of {} angles", self.size);
        pose.len() / self.size
    }

    /// Adds the gradients of the weights for the cotangent (N, 3J) to `bar`, and that of the poses to `pose_bar` unless it is empty.
    ///
    /// # Panics
    /// When a buffer does not have the size of its shape.
    pub fn adjoint(&self, pose: &[f32], saved: &Saved, y_bar: &[f32], bar: &mut Self, pose_bar: &mut [f32]) {
        let rows = self.rows(pose);
        let mut cotangent = y_bar.to_vec();
        for l in (0..3).rev() {
            let hidden = if l > 0 { positive(&saved.before[l - 1]) } else { Vec::new() };
            let x = layer(self, l, if l > 0 { &hidden } else { pose }, rows);
            let wanted = l > 0 || !pose_bar.is_empty();
            let mut x_bar = linear::InBar {
                x: if wanted { vec![0.0; x.x.len()] } else { Vec::new() },
                weight: std::mem::take(&mut bar.weight[l]),
                bias: std::mem::take(&mut bar.bias[l]),
            };
            linear::adjoint(x, &cotangent, &mut x_bar);
            (bar.weight[l], bar.bias[l]) = (x_bar.weight, x_bar.bias);
            if l > 0 {
                cotangent = vec![0.0; rows * HIDDEN];
                leaky_relu_adjoint(&saved.before[l - 1], 0.0, &x_bar.x, &mut cotangent);
            } else if wanted {
                assert_eq!(pose_bar.len(), pose.len(), "the gradient has the shape of the poses");
                for (to, g) in pose_bar.iter_mut().zip(&x_bar.x) {
                    *to += *g;
                }
            }
        }
    }
}
