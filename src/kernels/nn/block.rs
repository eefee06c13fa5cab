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
//! the two sums with h or x is rounded once more. The network is computed for 48 tokens at a time, whose hidden values stay in the
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
//! LN₁(x), LN₂(h) and GELU(z) are computed again. [`values`] saves nothing.
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

use super::{attention, gelu, layernorm, linear};
use crate::num::gemm::{Finish, Packed, View, gemm, gemm_packed_here};
use crate::num::{elem, par};
use std::mem::take;

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

/// The network of some tokens from the first on: writes W₁·n + b₁ to z, GELU of that to `hidden`, and y = h + W₂·hidden + b₂.
struct Network<'a> {
    x: &'a In<'a>,
    /// W₁ᵀ and W₂ᵀ.
    weights: [Packed; 2],
    /// LN₂(h).
    n: &'a [f32],
    h: &'a [f32],
}

impl Network<'_> {
    fn run(&self, first: usize, z: &mut [f32], hidden: &mut [f32], y: &mut [f32]) {
        let [_, d, f] = self.x.sizes();
        let (rows, own) = (y.len() / d, first * d..first * d + y.len());
        let n = View::new(&self.n[own.clone()], rows, d);
        gemm_packed_here(n, &self.weights[0], Finish::Bias(self.x.b_fc1), z);
        elem::gelu_slice(z, hidden);
        gemm_packed_here(View::new(hidden, rows, f), &self.weights[1], Finish::Bias(self.x.b_fc2), y);
        y.iter_mut().zip(&self.h[own]).for_each(|(y, h)| *y += h);
    }
}

/// Writes y (T, D) and returns what the adjoint needs.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn forward(x: &In<'_>, y: &mut [f32]) -> Saved {
    let f = x.b_fc1.len();
    let mut z = vec![0.0; x.tokens * f];
    let saved = run(x, y, |network, y| {
        let d = x.ln1_gain.len();
        par::chunks_mut2(&mut z, ROWS * f, y, ROWS * d, |c, z, y| {
            network.run(c * ROWS, z, &mut vec![0.0; z.len()], y);
        });
    });
    Saved { z, ..saved }
}

/// Writes y (T, D), of the same bits as by [`forward`], and keeps nothing: less memory and time if no adjoint follows, or if the caller
/// calls [`forward`] again before it.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn values(x: &In<'_>, y: &mut [f32]) {
    run(x, y, |network, y| {
        let [_, d, f] = x.sizes();
        par::chunks_mut(y, ROWS * d, |c, y| {
            let [mut z, mut hidden] = [(); 2].map(|()| vec![0.0; y.len() / d * f]);
            network.run(c * ROWS, &mut z, &mut hidden, y);
        });
    });
}

/// Attention, then the network by the given loop over its tokens; z is missing in the result.
fn run(x: &In<'_>, y: &mut [f32], network: impl FnOnce(&Network<'_>, &mut [f32])) -> Saved {
    let [t, d, f] = x.sizes();
    assert_eq!(y.len(), t * d, "y has the shape of x");
    let mut n = vec![0.0; t * d];
    let ln1 = layernorm::forward(&x.first(x.x), &mut n);
    let mut h = vec![0.0; t * d];
    let attention = attention::forward(&x.attention(&n), &mut h);
    add(&mut h, x.x);
    let ln2 = layernorm::forward(&x.second(&h), &mut n);
    let weights = [Packed::new(View::new(x.w_fc1, f, d).t()), Packed::new(View::new(x.w_fc2, d, f).t())];
    network(&Network { x, weights, n: &n, h: &h }, y);
    Saved { ln1, attention, h, ln2, z: vec![] }
}

/// Adds the gradients for the cotangent `y_bar` (T, D) to `x_bar`; the memory of what was saved is used and released on the way.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn adjoint(x: &In<'_>, saved: Saved, y_bar: &[f32], x_bar: &mut InBar) {
    let Saved { ln1, attention, h, ln2, z } = saved;
    let [t, d, _] = x.sizes();
    // h̄ = ȳ + LN₂ᵀ(n̄)
    let mut n_bar = vec![0.0; t * d];
    network_bar(x, (&h, z), y_bar, &mut n_bar, x_bar);
    let (gain, bias) = (take(&mut x_bar.ln2_gain), take(&mut x_bar.ln2_bias));
    let mut own = layernorm::InBar { x: y_bar.to_vec(), gain, bias };
    layernorm::adjoint(&x.second(&h), &ln2, &n_bar, &mut own);
    let h_bar;
    (h_bar, x_bar.ln2_gain, x_bar.ln2_bias) = (own.x, own.gain, own.bias);
    // x̄ += h̄ + LN₁ᵀ(n̄)
    let mut n = h;
    layernorm::forward(&x.first(x.x), &mut n);
    n_bar.fill(0.0);
    let mut own = attention::InBar {
        x: n_bar,
        w_qkv: take(&mut x_bar.w_qkv),
        b_qkv: take(&mut x_bar.b_qkv),
        w_out: take(&mut x_bar.w_out),
        b_out: take(&mut x_bar.b_out),
    };
    attention::adjoint(&x.attention(&n), &attention, &h_bar, &mut own);
    (x_bar.w_qkv, x_bar.b_qkv, x_bar.w_out, x_bar.b_out) = (own.w_qkv, own.b_qkv, own.w_out, own.b_out);
    let (n_bar, gain, bias) = (own.x, take(&mut x_bar.ln1_gain), take(&mut x_bar.ln1_bias));
    let mut own = layernorm::InBar { x: h_bar, gain, bias };
    layernorm::adjoint(&x.first(x.x), &ln1, &n_bar, &mut own);
    (x_bar.ln1_gain, x_bar.ln1_bias) = (own.gain, own.bias);
    add(&mut x_bar.x, &own.x);
}

/// The adjoint of the network: writes the cotangent of LN₂(h) to `n_bar`, and adds those of its weights.
fn network_bar(x: &In<'_>, (h, z): (&[f32], Vec<f32>), y_bar: &[f32], n_bar: &mut [f32], x_bar: &mut InBar) {
    let [t, d, f] = x.sizes();
    let mut hidden = vec![0.0; t * f];
    gelu::forward(&z, &mut hidden);
    // (F, D), whose right factor is the smaller one.
    let mut turned = vec![0.0; f * d];
    gemm(View::new(&hidden, t, f).t(), View::new(y_bar, t, d), Finish::Store, &mut turned);
    drop(hidden);
    par::chunks_mut(&mut x_bar.w_fc2, f, |row, bar| {
        bar.iter_mut().enumerate().for_each(|(i, bar)| *bar += turned[i * d + row]);
    });
    drop(turned);
    let outer = linear::In { x: &[], weight: &[], bias: x.b_fc2, m: t, n: d, k: f };
    let mut own = linear::InBar { bias: take(&mut x_bar.b_fc2), ..linear::InBar::default() };
    linear::adjoint(outer, y_bar, &mut own);
    x_bar.b_fc2 = own.bias;
    // z̄ takes the place of z.
    let mut z_bar = z;
    let w2 = Packed::new(View::new(x.w_fc2, d, f));
    par::chunks_mut(&mut z_bar, ROWS * f, |c, z| {
        let [mut slopes, mut bars] = [(); 2].map(|()| vec![0.0; z.len()]);
        let rows = z.len() / f;
        let y_bar = View::new(&y_bar[c * ROWS * d..][..rows * d], rows, d);
        gemm_packed_here(y_bar, &w2, Finish::Store, &mut bars);
        elem::gelu_slope_slice(z, &mut slopes);
        z.iter_mut().zip(bars.iter().zip(&slopes)).for_each(|(z, (bar, slope))| *z = bar * slope);
    });
    drop(w2);
    gemm(View::new(&z_bar, t, f), View::new(x.w_fc1, f, d), Finish::Store, n_bar);
    let mut n = vec![0.0; t * d];
    layernorm::forward(&x.second(h), &mut n);
    let inner = linear::In { x: &n, weight: x.w_fc1, bias: x.b_fc1, m: t, n: f, k: d };
    let (weight, bias) = (take(&mut x_bar.w_fc1), take(&mut x_bar.b_fc1));
    let mut own = linear::InBar { x: vec![], weight, bias };
    linear::adjoint(inner, &z_bar, &mut own);
    (x_bar.w_fc1, x_bar.b_fc1) = (own.weight, own.bias);
}
