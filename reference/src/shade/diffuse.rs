//! `shade.diffuse`: colours of Gaussians under light that is linear in their normals.
//!
//! c' = s · max(½ + Y₀ c, 0),   s = max(¼, 1 + n·d),   Y₀ = ½ √(1/π)
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | c | `sh` | (N, 3) |
//! | n | `normals` | (N, 3) |
//! | d | `toward` | (3) |
//! | c' | `colors` | (N, 3) |
//!
//! # Kinks and domain
//! s has slope 0 at and below its limit ¼; max(½ + Y₀ c, 0) has slope 0 where its argument is below 0, and Y₀
//! at 0.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `shade.diffuse`.
    pub struct In<'a, S> {
        sh: &'a Arr<S> = Port::var("N,3", "constant spherical-harmonic coefficients"),
        normals: &'a Arr<S> = Port::fixed("N,3", "unit vectors, or 0"),
        toward: &'a Arr<S> = Port::var("3", "toward the light, times its strength"),
    }
}

/// `shade.diffuse`
pub static SIGNATURE: Signature = Signature {
    name: "shade.diffuse",
    summary: "colours of Gaussians under light that is linear in their normals",
    inputs: In::<f64>::PORTS,
    outputs: ports![colors: Port::var("N,3", "sRGB-encoded")],
    ..Signature::EMPTY
};

/// The twin of `shade.diffuse`.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) {
    let In { sh, normals, toward } = *input;
    let n = sh.shape[0];
    let y0 = 0.5 * (1.0 / std::f64::consts::PI).sqrt();
    let colors = out.array("colors", &[n, 3]);
    for i in 0..n {
        let (normal, d): ([S; 3], [S; 3]) = (normals.row(i), toward.row(0));
        let light = normal[0] * d[0] + normal[1] * d[1] + normal[2] * d[2] + 1.0;
        let shade = if light.value() <= 0.25 { S::from_f64(0.25) } else { light };
        for c in 0..3 {
            let base = sh.data[3 * i + c] * y0 + 0.5;
            let base = if base.value() < 0.0 { S::zero() } else { base };
            out.put(colors, 3 * i + c, base * shade);
        }
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
