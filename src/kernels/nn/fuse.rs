//! `nn.fuse`: the tokens that a round of LIRM's update model starts from, made of the last round's and the learned ones.
//!
//! u = GELU([S P]·W₁ᵀ + b₁)·W₂ᵀ + b₂,   tokens = u (`published`) or P + u (`residual`)        (LIRM, Fig. 2)
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | S | `state` | (T, D) | finite; output tokens of the last round after their LayerNorm, zeros in the first |
//! | P | `position` | (T, D) | finite; learned, the same in every round |
//! | W₁, b₁ | `w1`, `b1` | (H, 2D), (H) | finite; the first D columns are those of S |
//! | W₂, b₂ | `w2`, `b2` | (D, H), (D) | finite |
//! | | `fuse` | `published`, `residual` | the rule |
//! | tokens | `tokens` | (T, D) | |
//!
//! The paper has two layers from 2D to D and one set of weights for all planes and panoramas; their width H (here D in a model), the GELU
//! and the rule `residual` are choices of this project. First values are those of a model, which has two sets of them. In the published
//! ones all weights are small random numbers, and the tokens are small at first; with `residual`, W₂ and b₂ are 0, and the tokens are P in
//! every round until training makes use of the state. In the scaled ones of `residual`, W₁ and W₂ have 0 and ±1 such that u is every second
//! channel of S (GELU(x) − GELU(−x) = x), and 0 in the others. A training that detaches the state (the default) does not request its
//! gradient, and a step then needs the memory of one round.
//!
//! # Rounding
//! Rows [S P] are written once; then [`super::linear`], [`super::gelu`], [`super::linear`]. With `residual`, P is added last.
//!
//! # Kinks and domain
//! Smooth. A state of zeros leaves the chains of P's columns: it changes no bit of them.
//!
//! # Adjoint
//! Those of the two layers and of GELU, in reverse; P̄ += (ȳ +) the last D columns of the gradient of [S P], S̄ += the first D. The sum of
//! ȳ and these columns is completed before it is added. The rows before and after GELU are saved.
//!
//! Twin: `reference::nn::fuse`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::nn::fuse::{In, Rule, forward};
//! let x = In {
//!     state: &[20.0],
//!     position: &[1.0],
//!     w1: &[1.0, 10.0], // 20 + 10; GELU(30) = 30
//!     b1: &[0.0],
//!     w2: &[2.0],
//!     b2: &[0.5],
//!     rule: Rule::Residual,
//! };
//! let mut tokens = [0.0];
//! forward(&x, &mut tokens);
//! assert_eq!(tokens, [61.5]);
//! ```

use super::{gelu, linear};
use crate::num::par;
use std::mem::take;

/// Rows per task of elementwise passes; the number changes no bit.
const ROWS: usize = 32;

/// How the result of the two layers becomes tokens.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rule {
    /// The result itself.
    #[default]
    Published,
    /// The learned tokens plus the result.
    Residual,
}

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (T, D).
    pub state: &'a [f32],
    /// Shape (T, D).
    pub position: &'a [f32],
    /// Shape (H, 2D).
    pub w1: &'a [f32],
    /// Shape (H), not empty.
    pub b1: &'a [f32],
    /// Shape (D, H).
    pub w2: &'a [f32],
    /// Shape (D), not empty.
    pub b2: &'a [f32],
    /// How the result becomes tokens.
    pub rule: Rule,
}

/// Rows of the hidden layer.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Saved {
    /// Shape (T, H), before GELU.
    pub before: Vec<f32>,
    /// Shape (T, H), after GELU.
    pub after: Vec<f32>,
}

/// Gradients; the adjoint adds to them. A gradient that is not requested is empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InBar {
    /// Shape (T, D).
    pub state: Vec<f32>,
    /// Shape (T, D).
    pub position: Vec<f32>,
    /// Shape (H, 2D).
    pub w1: Vec<f32>,
    /// Shape (H).
    pub b1: Vec<f32>,
    /// Shape (D, H).
    pub w2: Vec<f32>,
    /// Shape (D).
    pub b2: Vec<f32>,
}

impl InBar {
    /// Returns zeros in the shapes of the inputs.
    pub fn zeros_like(x: &In<'_>) -> Self {
        let zeros = |like: &[f32]| vec![0.0; like.len()];
        Self {
            state: zeros(x.state),
            position: zeros(x.position),
            w1: zeros(x.w1),
            b1: zeros(x.b1),
            w2: zeros(x.w2),
            b2: zeros(x.b2),
        }
    }
}

impl In<'_> {
    /// Checks the shapes; returns T, D and H.
    fn checked(&self) -> [usize; 3] {
        let (d, hidden) = (self.b2.len(), self.b1.len());
        assert!(d > 0 && hidden > 0, "there are columns");
        assert!(self.position.len().is_multiple_of(d), "rows of D numbers");
        assert_eq!(self.state.len(), self.position.len(), "the state has the shape of the positions");
        [self.position.len() / d, d, hidden]
    }

    /// Rows [S P].
    fn joined(&self) -> Vec<f32> {
        let [t, d, _] = self.checked();
        let mut rows = vec![0.0; 2 * t * d];
        par::chunks_mut(&mut rows, 2 * ROWS * d, |task, rows| {
            for (i, row) in rows.chunks_exact_mut(2 * d).enumerate() {
                let at = (task * ROWS + i) * d;
                row[..d].copy_from_slice(&self.state[at..][..d]);
                row[d..].copy_from_slice(&self.position[at..][..d]);
            }
        });
        rows
    }

    /// The first layer, over rows [S P].
    fn first<'r>(&'r self, joined: &'r [f32]) -> linear::In<'r> {
        let [m, d, n] = self.checked();
        linear::In { x: joined, weight: self.w1, bias: self.b1, m, n, k: 2 * d }
    }

    /// The second layer, over rows after GELU.
    fn second<'r>(&'r self, after: &'r [f32]) -> linear::In<'r> {
        let [m, n, k] = self.checked();
        linear::In { x: after, weight: self.w2, bias: self.b2, m, n, k }
    }
}

/// Writes the tokens (T, D) and returns what the adjoint needs.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn forward(x: &In<'_>, tokens: &mut [f32]) -> Saved {
    let [t, d, hidden] = x.checked();
    assert_eq!(tokens.len(), t * d, "tokens have the shape of the positions");
    let [mut before, mut after] = [vec![0.0; t * hidden], vec![0.0; t * hidden]];
    linear::forward(x.first(&x.joined()), &mut before);
    gelu::forward(&before, &mut after);
    linear::forward(x.second(&after), tokens);
    if x.rule == Rule::Residual {
        par::chunks_mut(tokens, ROWS * d, |task, rows| {
            rows.iter_mut().zip(&x.position[task * ROWS * d..]).for_each(|(y, p)| *y += p);
        });
    }
    Saved { before, after }
}

/// Adds the gradients for the cotangent `tokens_bar` (T, D) to `x_bar`.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn adjoint(x: &In<'_>, saved: &Saved, tokens_bar: &[f32], x_bar: &mut InBar) {
    let [t, d, hidden] = x.checked();
    assert_eq!(tokens_bar.len(), t * d, "the cotangent has the shape of the tokens");
    let mut second =
        linear::InBar { x: vec![0.0; t * hidden], weight: take(&mut x_bar.w2), bias: take(&mut x_bar.b2) };
    linear::adjoint(x.second(&saved.after), tokens_bar, &mut second);
    (x_bar.w2, x_bar.b2) = (second.weight, second.bias);
    let mut before_bar = vec![0.0; t * hidden];
    gelu::adjoint(&saved.before, &second.x, &mut before_bar);

    let is_joined = !x_bar.state.is_empty() || !x_bar.position.is_empty();
    let mut first = linear::InBar {
        x: if is_joined { vec![0.0; 2 * t * d] } else { Vec::new() },
        weight: take(&mut x_bar.w1),
        bias: take(&mut x_bar.b1),
    };
    linear::adjoint(x.first(&x.joined()), &before_bar, &mut first);
    (x_bar.w1, x_bar.b1) = (first.weight, first.bias);
    for (bar, row) in x_bar.state.chunks_exact_mut(d).zip(first.x.chunks_exact(2 * d)) {
        bar.iter_mut().zip(&row[..d]).for_each(|(bar, g)| *bar += g);
    }
    let rows = first.x.chunks_exact(2 * d).zip(tokens_bar.chunks_exact(d));
    for (bar, (row, y_bar)) in x_bar.position.chunks_exact_mut(d).zip(rows) {
        for (bar, (g, y_bar)) in bar.iter_mut().zip(row[d..].iter().zip(y_bar)) {
            *bar += match x.rule {
                Rule::Published => *g,
                Rule::Residual => y_bar + g,
            };
        }
    }
}
