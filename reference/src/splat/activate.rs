//! Stored, unconstrained parameters to scales and opacities.
//!
//! scales = exp(scales_log), opacities = 1/(1 + exp(−opacity_logits))     (3DGS, the 3DGS code)
//!
//! | argument | shape | range |
//! |---|---|---|
//! | `scales_log` | (N, 3) | natural logarithm of standard deviations in scene units |
//! | `opacity_logits` | (N) | |
//! | `scales` | (N, 3) | > 0 |
//! | `opacities` | (N) | 0..1 |

use crate::array::{ANY, Named, Out, expect};
use crate::num::elem::sigmoid;
use crate::scalar::Scalar;

/// The twin of `splat.activate`.
///
/// # Errors
/// When an input is missing or shaped otherwise.
pub fn forward<S: Scalar>(x: &Named<S>, out: &mut Out<S>) -> Result<(), String> {
    let scales_log = expect(x, "scales_log", &[ANY, 3])?;
    let n = scales_log.shape[0];
    let opacity_logits = expect(x, "opacity_logits", &[n])?;
    let scales = out.array("scales", &[n, 3]);
    let opacities = out.array("opacities", &[n]);
    for i in 0..n {
        out.put_row(scales, i, scales_log.row::<3>(i).map(Scalar::exp));
        out.put(opacities, i, sigmoid(opacity_logits.data[i]));
        out.flush();
    }
    Ok(())
}
