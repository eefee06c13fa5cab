//! `nn.fuse`: tokens of the last round and learned tokens, joined by a network of two layers.
//!
//! u = W₂·GELU(W₁·(S, P) + b₁) + b₂ for every token,   tokens = u, or P + u;   GELU(x) = x·Φ(x)
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | S | `state` | (T, D) |
//! | P | `position` | (T, D) |
//! | W₁, b₁ | `w1`, `b1` | (H, 2D), (H) |
//! | W₂, b₂ | `w2`, `b2` | (D, H), (D) |
//! | | setting `fuse` | `published`: u, `residual`: P + u |
//! | tokens | `tokens` | (T, D) |
//!
//! # Rounding
//! Left folds; the biases are added last, then P.
//!
//! # Kinks and domain
//! Smooth. D and H are at least 1.

use super::attention::affine;
use super::gelu;
use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `nn.fuse`.
    pub struct In<'a, S> {
        state: &'a Arr<S> = Port::var("T,D", "output tokens of the last round; zeros in the first"),
        position: &'a Arr<S> = Port::var("T,D", "learned tokens"),
        w1: &'a Arr<S> = Port::var("H,D2", "first layer; columns of the state, then of the learned tokens"),
        b1: &'a Arr<S> = Port::var("H", "added before GELU"),
        w2: &'a Arr<S> = Port::var("D,H", "second layer"),
        b2: &'a Arr<S> = Port::var("D", "added to the second layer"),
    }
}

/// `nn.fuse`
pub static SIGNATURE: Signature = Signature {
    name: "nn.fuse",
    summary: "tokens of the last round and learned tokens, joined by two linear layers with GELU between them",
    inputs: In::<f64>::PORTS,
    outputs: ports![tokens: Port::var("T,D", "")],
    settings: &[SettingSpec::choice(
        "fuse",
        &["published", "residual"],
        "published",
        "the network's result, or the learned tokens plus it",
    )],
    ..Signature::EMPTY
};

/// The twin of `nn.fuse`.
///
/// # Errors
/// When `w1` does not have 2D columns.
pub fn forward<S: Scalar>(input: &In<'_, S>, is_residual: bool, out: &mut Out<'_, S>) -> Result<(), String> {
    let In { state, position, w1, b1, w2, b2 } = *input;
    let d = b2.data.len();
    if w1.shape[1] != 2 * d {
        return Err(format!("input w1: expected {} columns, got {}", 2 * d, w1.shape[1]));
    }
    let tokens = out.array("tokens", &position.shape);
    for (t, own) in position.data.chunks_exact(d).enumerate() {
        let joined = [&state.data[t * d..(t + 1) * d], own].concat();
        let hidden: Vec<S> = affine(&w1.data, &b1.data, &joined).into_iter().map(gelu::of).collect();
        for (j, u) in affine(&w2.data, &b2.data, &hidden).into_iter().enumerate() {
            out.put(tokens, t * d + j, if is_residual { own[j] + u } else { u });
        }
        out.flush();
    }
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or as [`forward`].
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, call.settings.word("fuse") == "residual", out)
}

/// Number of products.
///
/// # Errors
/// As [`run`].
pub fn work(call: &Call<'_, f64>) -> Result<u64, String> {
    let input = In::of(call.arrays)?;
    Ok((input.position.shape[0] * (input.w1.data.len() + input.w2.data.len())) as u64)
}
