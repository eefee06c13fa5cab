//! `nn.attention`: multi-head self-attention with its projections.
//!
//! [Q K V] = x·W_qkvᵀ + b_qkv, without the bias of K,   O = softmax(Q·Kᵀ/√d)·V per head,   y = [O₁ … O_H]·W_outᵀ + b_out
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | x | `x` | (T, D) |
//! | W_qkv, b_qkv | `w_qkv`, `b_qkv` | (3D, D), (3D) |
//! | W_out, b_out | `w_out`, `b_out` | (D, D), (D) |
//! | | `attended` | (T), optional |
//! | H | setting `heads` | () |
//! | y | `y` | (T, D) |
//!
//! # Rounding
//! Two passes over the keys: the largest logit, then the sums; left folds.
//!
//! # Kinks and domain
//! The bias of the keys adds the same to all logits of a query: y does not depend on it, and it is not read. The largest logit is not differentiated. Without a token that is attended to, O = 0.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `nn.attention`.
    pub struct In<'a, S> {
        x: &'a Arr<S> = Port::var("T,D", "tokens"),
        w_qkv: &'a Arr<S> = Port::var("D3,D", "rows of q, of k, of v"),
        b_qkv: &'a Arr<S> = Port::var("D3", "added to the projections"),
        w_out: &'a Arr<S> = Port::var("D,D", "of the joined heads"),
        b_out: &'a Arr<S> = Port::var("D", "added last"),
        attended: Option<&'a Arr<S>> = Port::fixed("T", "0: the token is not attended to; absent: all are"),
    }
}

/// `nn.attention`
pub static SIGNATURE: Signature = Signature {
    name: "nn.attention",
    summary: "multi-head self-attention with its projections",
    inputs: In::<f64>::PORTS,
    outputs: ports![y: Port::var("T,D", "")],
    settings: &[SettingSpec::number("heads", "1", "number of heads, a divisor of D")],
    ..Signature::EMPTY
};

/// W·x + b.
pub fn affine<S: Scalar>(weight: &[S], bias: &[S], x: &[S]) -> Vec<S> {
    let row = |(row, b): (&[S], &S)| row.iter().zip(x).fold(S::zero(), |sum, (w, x)| sum + *w * *x) + *b;
    weight.chunks_exact(x.len()).zip(bias).map(row).collect()
}

/// Attention of rows of tokens: y of every token.
///
/// # Errors
/// When the sizes do not fit.
pub fn attend<S: Scalar>(input: &In<'_, S>, tokens: &[Vec<S>], heads: usize) -> Result<Vec<Vec<S>>, String> {
    let width = input.b_out.data.len();
    if heads == 0 || !width.is_multiple_of(heads) || input.b_qkv.data.len() != 3 * width {
        return Err(format!(
            "setting heads: {heads} heads do not divide {width} columns, or w_qkv has not three times as many rows"
        ));
    }
    let d = width / heads;
    let projected: Vec<Vec<S>> =
        tokens.iter().map(|x| affine(&input.w_qkv.data, &input.b_qkv.data, x)).collect();
    let keys_of = &input.w_qkv.data[width * width..2 * width * width];
    let none = vec![S::zero(); width];
    let unbiased: Vec<Vec<S>> = tokens.iter().map(|x| affine(keys_of, &none, x)).collect();
    let counts = |i: usize| input.attended.is_none_or(|a| a.data[i].value() != 0.0);
    let keys: Vec<usize> = (0..tokens.len()).filter(|i| counts(*i)).collect();
    let mut made = Vec::new();
    for own in &projected {
        let mut joined = Vec::new();
        for h in 0..heads {
            let q = &own[h * d..(h + 1) * d];
            let logit = |i: &usize| {
                let k = &unbiased[*i][h * d..][..d];
                q.iter().zip(k).fold(S::zero(), |sum, (q, k)| sum + *q * *k) / (d as f64).sqrt()
            };
            let logits: Vec<S> = keys.iter().map(logit).collect();
            let most = logits
                .iter()
                .fold(f64::NEG_INFINITY, |most, x| if x.value() > most { x.value() } else { most });
            let parts: Vec<S> = logits.iter().map(|x| (*x - most).exp()).collect();
            let total = parts.iter().fold(S::zero(), |sum, p| sum + *p);
            for column in 0..d {
                let value = |i: &usize| projected[*i][2 * width + h * d + column];
                let sum = keys.iter().zip(&parts).fold(S::zero(), |sum, (i, p)| sum + *p * value(i));
                joined.push(if keys.is_empty() { S::zero() } else { sum / total });
            }
        }
        made.push(affine(&input.w_out.data, &input.b_out.data, &joined));
    }
    Ok(made)
}

/// The twin of `nn.attention`.
///
/// # Errors
/// As [`attend`].
pub fn forward<S: Scalar>(input: &In<'_, S>, heads: usize, out: &mut Out<'_, S>) -> Result<(), String> {
    let width = input.x.shape[1];
    let y = out.array("y", &input.x.shape);
    let tokens: Vec<Vec<S>> = input.x.data.chunks_exact(width).map(<[S]>::to_vec).collect();
    for (i, row) in attend(input, &tokens, heads)?.into_iter().enumerate() {
        for (j, value) in row.into_iter().enumerate() {
            out.put(y, i * width + j, value);
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
    forward(&In::of(call.arrays)?, call.settings.whole("heads", 1.0)?, out)
}

/// Number of products.
///
/// # Errors
/// As [`run`].
pub fn work(call: &Call<'_, f64>) -> Result<u64, String> {
    let In { x, .. } = In::of(call.arrays)?;
    let [t, d] = [x.shape[0], x.shape[1]];
    Ok((4 * t * d * d + 2 * t * t * d) as u64)
}
