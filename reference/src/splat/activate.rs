//! `splat.activate`: maps stored, unconstrained parameters to scales and opacities.
//!
//! scales = exp(scales_log), opacities = 1/(1 + exp(−opacity_logits))     (3DGS and its code)
//!
//! | argument | shape | range |
//! |---|---|---|
//! | `scales_log` | (N, 3) | natural logarithm of standard deviations in scene units |
//! | `opacity_logits` | (N) | |
//! | `scales` | (N, 3) | > 0 |
//! | `opacities` | (N) | 0..1 |

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::num::elem::sigmoid;
use crate::ports::{Port, Signature, Space, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `splat.activate`.
    pub struct In<'a, S> {
        scales_log: &'a Arr<S> = Port::var("N,3", "ln of scene units"),
        opacity_logits: &'a Arr<S> = Port::var("N", "any"),
    }
}

/// `splat.activate`
pub static SIGNATURE: Signature = Signature {
    name: "splat.activate",
    summary: "stored parameters to scales (exp) and opacities (logistic)",
    inputs: In::<f64>::PORTS,
    outputs: ports![
        scales: Port::var("N,3", "scene units").moved(Space::Log),
        opacities: Port::var("N", "0..1").moved(Space::Logit),
    ],
    ..Signature::EMPTY
};

/// The twin of `splat.activate`.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) {
    let In { scales_log, opacity_logits } = *input;
    let n = scales_log.shape[0];
    let scales = out.array("scales", &[n, 3]);
    let opacities = out.array("opacities", &[n]);
    for i in 0..n {
        out.put_row(scales, i, scales_log.row::<3>(i).map(Scalar::exp));
        out.put(opacities, i, sigmoid(opacity_logits.data[i]));
        out.flush();
    }
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out);
    Ok(())
}
