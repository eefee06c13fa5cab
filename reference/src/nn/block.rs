//! `nn.block`: a transformer block that normalises before attention and before its network.
//!
//! h = x + MHA(LN₁(x)),   y = h + W₂·GELU(W₁·LN₂(h) + b₁) + b₂
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | x | `x` | (T, D) |
//! | LN₁, LN₂ | `ln1_gain`, `ln1_bias`, `ln2_gain`, `ln2_bias` | (D) |
//! | MHA | `w_qkv`, `b_qkv`, `w_out`, `b_out` | (3D, D), (3D), (D, D), (D) |
//! | W₁, b₁ | `w_fc1`, `b_fc1` | (F, D), (F) |
//! | W₂, b₂ | `w_fc2`, `b_fc2` | (D, F), (D) |
//! | H | setting `heads` | () |
//! | ε | setting `eps` | () |
//! | y | `y` | (T, D) |
//!
//! # Rounding
//! Left folds.
//!
//! # Kinks and domain
//! Smooth for ε > 0. The bias of the keys is not read ([`mod@super::attention`]).

use super::{attention, gelu, layernorm};
use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `nn.block`.
    pub struct In<'a, S> {
        x: &'a Arr<S> = Port::var("T,D", "tokens"),
        ln1_gain: &'a Arr<S> = Port::var("D", "of the normalisation before attention"),
        ln1_bias: &'a Arr<S> = Port::var("D", ""),
        w_qkv: &'a Arr<S> = Port::var("D3,D", "rows of q, of k, of v"),
        b_qkv: &'a Arr<S> = Port::var("D3", "added to the projections"),
        w_out: &'a Arr<S> = Port::var("D,D", "of the joined heads"),
        b_out: &'a Arr<S> = Port::var("D", ""),
        ln2_gain: &'a Arr<S> = Port::var("D", "of the normalisation before the network"),
        ln2_bias: &'a Arr<S> = Port::var("D", ""),
        w_fc1: &'a Arr<S> = Port::var("F,D", "first layer of the network"),
        b_fc1: &'a Arr<S> = Port::var("F", ""),
        w_fc2: &'a Arr<S> = Port::var("D,F", "second layer"),
        b_fc2: &'a Arr<S> = Port::var("D", ""),
    }
}

/// `nn.block`
pub static SIGNATURE: Signature = Signature {
    name: "nn.block",
    summary: "transformer block: attention and a two-layer network, each of normalised tokens and added to them",
    inputs: In::<f64>::PORTS,
    outputs: ports![y: Port::var("T,D", "")],
    settings: &[
        SettingSpec::number("heads", "1", "number of heads, a divisor of D"),
        SettingSpec::number("eps", "1e-6", "added to the variances, above 0"),
    ],
    ..Signature::EMPTY
};

/// LN of a token.
fn normalized<S: Scalar>(row: &[S], gain: &Arr<S>, bias: &Arr<S>, eps: f64) -> Vec<S> {
    let rows = layernorm::normalized(row, eps).into_iter();
    rows.zip(&gain.data).zip(&bias.data).map(|((n, gain), bias)| n * *gain + *bias).collect()
}

/// The twin of `nn.block`.
///
/// # Errors
/// As [`attention::attend`].
pub fn forward<S: Scalar>(
    input: &In<'_, S>,
    heads: usize,
    eps: f64,
    out: &mut Out<'_, S>,
) -> Result<(), String> {
    let In { x, w_qkv, b_qkv, w_out, b_out, .. } = *input;
    let width = x.shape[1];
    let y = out.array("y", &x.shape);
    let first: Vec<Vec<S>> =
        x.data.chunks_exact(width).map(|row| normalized(row, input.ln1_gain, input.ln1_bias, eps)).collect();
    let layer = attention::In { x, w_qkv, b_qkv, w_out, b_out, attended: None };
    let mixed = attention::attend(&layer, &first, heads)?;
    for (i, (row, mixed)) in x.data.chunks_exact(width).zip(mixed).enumerate() {
        let h: Vec<S> = row.iter().zip(mixed).map(|(x, m)| *x + m).collect();
        let second = normalized(&h, input.ln2_gain, input.ln2_bias, eps);
        let hidden: Vec<S> = attention::affine(&input.w_fc1.data, &input.b_fc1.data, &second)
            .into_iter()
            .map(gelu::of)
            .collect();
        let made = attention::affine(&input.w_fc2.data, &input.b_fc2.data, &hidden);
        for (j, (h, m)) in h.into_iter().zip(made).enumerate() {
            out.put(y, i * width + j, h + m);
        }
    }
    out.flush();
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or as [`forward`].
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, call.settings.whole("heads", 1.0)?, call.settings.number("eps"), out)
}

/// Number of products.
///
/// # Errors
/// As [`run`].
pub fn work(call: &Call<'_, f64>) -> Result<u64, String> {
    let In { x, b_fc1, .. } = In::of(call.arrays)?;
    let [t, d, f] = [x.shape[0], x.shape[1], b_fc1.shape[0]];
    Ok((4 * t * d * d + 2 * t * d * f + 2 * t * t * d) as u64)
}
