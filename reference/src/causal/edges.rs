//! `causal.edges`: cost of edge probabilities.
//!
//! L = Σ over i ≠ j of w p_ij + a (p_ij − q_ij)².
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | p, q | `probabilities`, `before` | (n, n) |
//! | w, a | settings `sparsity`, `anchor` | () |
//! | L | `value` | () |

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `causal.edges`.
    pub struct In<'a, S> {
        probabilities: &'a Arr<S> = Port::var("N,N", "of the edges i → j; the diagonal is ignored"),
        before: &'a Arr<S> = Port::fixed("N,N", "probabilities that the edges are anchored to"),
    }
}

/// `causal.edges`
pub static SIGNATURE: Signature = Signature {
    name: "causal.edges",
    summary: "cost of edge probabilities, and of their distance from previous ones",
    inputs: In::<f64>::PORTS,
    outputs: ports![value: Port::var("", "")],
    settings: &[
        SettingSpec::number("sparsity", "0.002", "cost of an edge"),
        SettingSpec::number("anchor", "0", "weight of the squared distance from the previous probabilities"),
    ],
    ..Signature::EMPTY
};

/// The twin of `causal.edges`.
pub fn forward<S: Scalar>(input: &In<'_, S>, [sparsity, anchor]: [f64; 2], out: &mut Out<'_, S>) {
    let In { probabilities, before } = *input;
    let n = probabilities.shape[0];
    let value = out.array("value", &[]);
    for at in (0..n * n).filter(|at| at / n != at % n) {
        let p = probabilities.data[at];
        let off = p - before.data[at];
        out.add(value, 0, p * sparsity + off * off * anchor, 1.0);
        out.flush();
    }
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, ["sparsity", "anchor"].map(|key| call.settings.number(key)), out);
    Ok(())
}
