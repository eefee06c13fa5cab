//! `nn.block`: a block of a transformer, which normalises before attention and before its two-layer network.
//!
//! h = x + MHA(LN₁(x)),   y = h + W₂·GELU(W₁·LN₂(h) + b₁) + b₂        (Vaswani et al. 2017; normalised first: Xiong et al. 2020)
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | x | `x` | (T, D), tokens | finite |
//! | LN₁ | `ln1_gain`, `ln1_bias` | (D) | finite; [`mod@super::layernorm`] |
//! | MHA | `w_qkv`, `b_qkv`, `w_out`, `b_out` | (3D, D), (3D), (D, D), (D) | finite; [`mod@super::attention`] |
//! | LN₂ | `ln2_gain`, `ln2_bias` | (D) | finite |
//! | W₁, b₁ | `w_fc1`, `b_fc1` | (F, D), (F) | finite; LIRM takes F = 4D |
//! | W₂, b₂ | `w_fc2`, `b_fc2` | (D, F), (D) | finite |
//! | H | `heads` | () | divides D |
//! | ε | `eps` | () | > 0, of both LN; LIRM takes 10⁻⁶ |
//! | y | `y` | (T, D) | |
//!
//! # Rounding
//! That of [`mod@super::layernorm`], [`mod@super::attention`], [`mod@super::linear`] and [`mod@super::gelu`] in the order of the equation; each of
//! the two sums with h or x is rounded once more. The network is computed for [`ROWS`] tokens at a time, whose hidden values stay in the
//! second-level cache; this changes no bit. Memory is linear in T.
//!
//! # Kinks and domain
//! Smooth. The bias of the keys is not read ([`mod@super::attention`]).
//!
//! # Adjoint
//! With z = W₁·LN₂(h) + b₁:
//!
//! z̄ = (W₂ᵀ·ȳ)·GELU′(z),   h̄ = ȳ + LN₂ᵀ(W₁ᵀ·z̄),   x̄ += h̄ + LN₁ᵀ(MHAᵀ(h̄))        (ᵀ of an operator: its adjoint at its input)
//!
//! and those of the weights, as the four operators state them. h, z, what `nn.attention` saves, and two numbers per row and LN are saved: (F + 5D + 2H)·4 bytes per token, and 32.
//! LN₁(x), LN₂(h) and GELU(z) are computed again. To save nothing, the caller calls [`forward`] again before [`adjoint`].
//!
//! Twin: `reference::nn::block`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::nn::block::{In, forward};
//! // Attention with weights of 0 adds its bias ½. Both tokens are then normalised to the bias of LN₂, 20: GELU(20) = 20.
//! let x = In {
//!     x: &[1.0, 3.0], ln1_gain: &[1.0], ln1_bias: &[0.0], w_qkv: &[0.0; 3], b_qkv: &[0.0; 3], w_out: &[0.0], b_out: &[0.5],
//!     ln2_gain: &[1.0], ln2_bias: &[20.0], w_fc1: &[1.0], b_fc1: &[0.0], w_fc2: &[0.25], b_fc2: &[0.0],
//!     tokens: 2, heads: 1, eps: 1e-6,
//! };
//! let mut y = [0.0; 2];
//! forward(&x, &mut y);
//! assert_eq!(y, [1.5 + 5.0, 3.5 + 5.0]);
//! ```

use super::{attention, layernorm, linear};
use crate::num::gemm::{Finish, Packed, View, gemm_packed_here};
use crate::num::{elem, par};

/// Tokens per task of the network. The number changes no bit.
const ROWS: usize = 48;

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (T, D).
    pub x: &'a [f32],
    /// Shape (D).
    pub ln1_gain: &'a [f32],
    /// Shape (D).
    pub ln1_bias: &'a [f32],
    /// Shape (3D, D).
    pub w_qkv: &'a [f32],
    /// Shape (3D).
    pub b_qkv: &'a [f32],
    /// Shape (D, D).
    pub w_out: &'a [f32],
    /// Shape (D).
    pub b_out: &'a [f32],
    /// Shape (D).
    pub ln2_gain: &'a [f32],
    /// Shape (D).
    pub ln2_bias: &'a [f32],
    /// Shape (F, D).
    pub w_fc1: &'a [f32],
    /// Shape (F).
    pub b_fc1: &'a [f32],
    /// Shape (D, F).
    pub w_fc2: &'a [f32],
    /// Shape (D).
    pub b_fc2: &'a [f32],
    /// Number of tokens T, at least 1.
    pub tokens: usize,
    /// Number of heads H.
    pub heads: usize,
    /// Added to the variances.
    pub eps: f64,
}

/// What the adjoint needs.
#[derive(Clone, Debug, Default)]
pub struct Saved {
    ln1: layernorm::Saved,
    attention: attention::Saved,
    /// Shape (T, D).
    h: Vec<f32>,
    ln2: layernorm::Saved,
    /// Shape (T, F).
    z: Vec<f32>,
}

/// Gradients; the adjoint adds to them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InBar {
    /// Shape (T, D).
    pub x: Vec<f32>,
    /// Shape (D).
    pub ln1_gain: Vec<f32>,
    /// Shape (D).
    pub ln1_bias: Vec<f32>,
    /// Shape (3D, D).
    pub w_qkv: Vec<f32>,
    /// Shape (3D).
    pub b_qkv: Vec<f32>,
    /// Shape (D, D).
    pub w_out: Vec<f32>,
    /// Shape (D).
    pub b_out: Vec<f32>,
    /// Shape (D).
    pub ln2_gain: Vec<f32>,
    /// Shape (D).
    pub ln2_bias: Vec<f32>,
    /// Shape (F, D).
    pub w_fc1: Vec<f32>,
    /// Shape (F).
    pub b_fc1: Vec<f32>,
    /// Shape (D, F).
    pub w_fc2: Vec<f32>,
    /// Shape (D).
    pub b_fc2: Vec<f32>,
}

impl InBar {
    /// Returns zeros in the shapes of the inputs.
    pub fn zeros_like(x: &In<'_>) -> Self {
        let zeros = |like: &[f32]| vec![0.0; like.len()];
        Self {
            x: zeros(x.x),
            ln1_gain: zeros(x.ln1_gain),
            ln1_bias: zeros(x.ln1_bias),
            w_qkv: zeros(x.w_qkv),
            b_qkv: zeros(x.b_qkv),
            w_out: zeros(x.w_out),
            b_out: zeros(x.b_out),
            ln2_gain: zeros(x.ln2_gain),
            ln2_bias: zeros(x.ln2_bias),
            w_fc1: zeros(x.w_fc1),
            b_fc1: zeros(x.b_fc1),
            w_fc2: zeros(x.w_fc2),
            b_fc2: zeros(x.b_fc2),
        }
    }
}

impl<'a> In<'a> {
    /// T, D and F.
    fn sizes(&self) -> [usize; 3] {
        let [t, d, f] = [self.tokens, self.ln1_gain.len(), self.b_fc1.len()];
        assert!(t > 0 && d > 0 && f > 0 && self.x.len() == t * d, "x is (T, D)");
        assert!(self.w_fc1.len() == f * d && self.w_fc2.len() == d * f, "w_fc1 is (F, D), w_fc2 is (D, F)");
        [t, d, f]
    }

    fn first<'b>(&self, x: &'b [f32]) -> layernorm::In<'b>
    where
        'a: 'b,
    {
        layernorm::In { x, gain: self.ln1_gain, bias: self.ln1_bias, eps: self.eps }
    }

    fn second<'b>(&self, x: &'b [f32]) -> layernorm::In<'b>
    where
        'a: 'b,
    {
        layernorm::In { x, gain: self.ln2_gain, bias: self.ln2_bias, eps: self.eps }
    }

    fn attention<'b>(&self, x: &'b [f32]) -> attention::In<'b>
    where
        'a: 'b,
    {
        attention::In {
            x,
            w_qkv: self.w_qkv,
            b_qkv: self.b_qkv,
            w_out: self.w_out,
            b_out: self.b_out,
            attended: &[],
            tokens: self.tokens,
            heads: self.heads,
        }
    }
}

/// x += y.
fn add(x: &mut [f32], y: &[f32]) {
    const CHUNK: usize = 1 << 14;
    par::chunks_mut(x, CHUNK, |c, x| x.iter_mut().zip(&y[c * CHUNK..]).for_each(|(x, y)| *x += y));
}

/// Writes y (T, D) and returns what the adjoint needs.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn forward(x: &In<'_>, y: &mut [f32]) -> Saved {
    let [t, d, f] = x.sizes();
    assert_eq!(y.len(), t * d, "y has the shape of x");
    let mut n = vec![0.0; t * d];
    let ln1 = layernorm::forward(&x.first(x.x), &mut n);
    let mut h = vec![0.0; t * d];
    let attention = attention::forward(&x.attention(&n), &mut h);
    add(&mut h, x.x);
    let ln2 = layernorm::forward(&x.second(&h), &mut n);
    let (w1, w2) = (Packed::new(View::new(x.w_fc1, f, d).t()), Packed::new(View::new(x.w_fc2, d, f).t()));
    let mut z = vec![0.0; t * f];
    par::chunks_mut2(&mut z, ROWS * f, y, ROWS * d, |c, z, y| {
        let (rows, at) = (z.len() / f, c * ROWS * d);
        gemm_packed_here(View::new(&n[at..at + rows * d], rows, d), &w1, Finish::Bias(x.b_fc1), z);
        let mut hidden = vec![0.0; z.len()];
        elem::gelu_slice(z, &mut hidden);
        gemm_packed_here(View::new(&hidden, rows, f), &w2, Finish::Bias(x.b_fc2), y);
        y.iter_mut().zip(&h[at..]).for_each(|(y, h)| *y += h);
    });
    Saved { ln1, attention, h, ln2, z }
}

/// Adds the gradients for the cotangent `y_bar` (T, D) to `x_bar`.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn adjoint(x: &In<'_>, saved: &Saved, y_bar: &[f32], x_bar: &mut InBar) {
    let [t, d, f] = x.sizes();
    let take = std::mem::take;
    // The network: h̄ = ȳ + LN₂ᵀ(n̄).
    let [mut n, mut n_bar] = [vec![0.0; t * d], vec![0.0; t * d]];
    let (w1, w2) = (Packed::new(View::new(x.w_fc1, f, d)), Packed::new(View::new(x.w_fc2, d, f)));
    let [mut hidden, mut z_bar] = [vec![0.0; t * f], vec![0.0; t * f]];
    par::chunks_mut2(&mut hidden, ROWS * f, &mut z_bar, ROWS * f, |c, hidden, z_bar| {
        let (rows, z) = (z_bar.len() / f, &saved.z[c * ROWS * f..][..z_bar.len()]);
        gemm_packed_here(View::new(&y_bar[c * ROWS * d..][..rows * d], rows, d), &w2, Finish::Store, z_bar);
        elem::gelu_slope_slice(z, hidden);
        z_bar.iter_mut().zip(&*hidden).for_each(|(bar, slope)| *bar *= slope);
        elem::gelu_slice(z, hidden);
    });
    par::chunks_mut(&mut n_bar, ROWS * d, |c, n_bar| {
        let rows = n_bar.len() / d;
        gemm_packed_here(View::new(&z_bar[c * ROWS * f..][..rows * f], rows, f), &w1, Finish::Store, n_bar);
    });
    let mut outer = linear::InBar { x: vec![], weight: take(&mut x_bar.w_fc2), bias: take(&mut x_bar.b_fc2) };
    linear::adjoint(linear::In { x: &hidden, weight: x.w_fc2, bias: x.b_fc2, m: t, n: d, k: f }, y_bar, &mut outer);
    (x_bar.w_fc2, x_bar.b_fc2) = (outer.weight, outer.bias);
    drop(hidden);
    let ln2 = x.second(&saved.h);
    layernorm::forward(&ln2, &mut n);
    let mut inner = linear::InBar { x: vec![], weight: take(&mut x_bar.w_fc1), bias: take(&mut x_bar.b_fc1) };
    linear::adjoint(linear::In { x: &n, weight: x.w_fc1, bias: x.b_fc1, m: t, n: f, k: d }, &z_bar, &mut inner);
    (x_bar.w_fc1, x_bar.b_fc1) = (inner.weight, inner.bias);
    drop(z_bar);
    let mut ln2_bar =
        layernorm::InBar { x: y_bar.to_vec(), gain: take(&mut x_bar.ln2_gain), bias: take(&mut x_bar.ln2_bias) };
    layernorm::adjoint(&ln2, &saved.ln2, &n_bar, &mut ln2_bar);
    (x_bar.ln2_gain, x_bar.ln2_bias) = (ln2_bar.gain, ln2_bar.bias);
    // Attention: x̄ += h̄ + LN₁ᵀ(n̄).
    let h_bar = ln2_bar.x;
    layernorm::forward(&x.first(x.x), &mut n);
    n_bar.fill(0.0);
    let mut attention_bar = attention::InBar {
        x: n_bar,
        w_qkv: take(&mut x_bar.w_qkv),
        b_qkv: take(&mut x_bar.b_qkv),
        w_out: take(&mut x_bar.w_out),
        b_out: take(&mut x_bar.b_out),
    };
    attention::adjoint(&x.attention(&n), &saved.attention, &h_bar, &mut attention_bar);
    let attention::InBar { x: n_bar, w_qkv, b_qkv, w_out, b_out } = attention_bar;
    (x_bar.w_qkv, x_bar.b_qkv, x_bar.w_out, x_bar.b_out) = (w_qkv, b_qkv, w_out, b_out);
    let mut ln1_bar =
        layernorm::InBar { x: h_bar, gain: take(&mut x_bar.ln1_gain), bias: take(&mut x_bar.ln1_bias) };
    layernorm::adjoint(&x.first(x.x), &saved.ln1, &n_bar, &mut ln1_bar);
    (x_bar.ln1_gain, x_bar.ln1_bias) = (ln1_bar.gain, ln1_bar.bias);
    add(&mut x_bar.x, &ln1_bar.x);
}
