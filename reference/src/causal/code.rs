//! `causal.code`: codes of the values that interventions set.
//!
//! c_g = v_g (1, w_i2, …, w_ik) for the target i of group g.
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | v, i | `labels`, `target` | (G) |
//! | w | `values` | (n, k), the first entry of a row is not read |
//! | c | `codes` | (G, k) |

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Dtype, Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `causal.code`.
    pub struct In<'a, S> {
        labels: &'a Arr<S> = Port::fixed("G", "values that groups were set to"),
        target: &'a Arr<S> = Port::int("G", Dtype::I32, "the factor that was set"),
        values: &'a Arr<S> = Port::var("N,K", "code of the value 1 of each factor; the first entry is 1"),
    }
}

/// `causal.code`
pub static SIGNATURE: Signature = Signature {
    name: "causal.code",
    summary: "codes of the values that interventions set",
    inputs: In::<f64>::PORTS,
    outputs: ports![codes: Port::var("G,K", "")],
    ..Signature::EMPTY
};

/// The factor that is set in a group.
///
/// # Errors
/// When there is no such factor.
pub fn factor<S: Scalar>(target: S, n: usize) -> Result<usize, String> {
    let i = target.value();
    if i >= 0.0 && i < n as f64 {
        Ok(i as usize)
    } else {
        Err(format!("input target: expected a factor below {n}, got {i}"))
    }
}

/// The twin of `causal.code`.
///
/// # Errors
/// When a target is not a factor.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let In { labels, target, values } = *input;
    let [n, k] = [values.shape[0], values.shape[1]];
    let codes = out.array("codes", &[labels.data.len(), k]);
    for (g, v) in labels.data.iter().enumerate() {
        let i = factor(target.data[g], n)?;
        for c in 0..k {
            let w = if c == 0 { S::one() } else { values.data[i * k + c] };
            out.put(codes, g * k + c, *v * w);
        }
        out.flush();
    }
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or a target is not a factor.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out)
}
