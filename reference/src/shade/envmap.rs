//! `shade.envmap`: radiance of a point lit by an environment map, without shadows.
//!
//! L = Σᵢⱼ Eᵢⱼ·f(n, v, lᵢⱼ)·max(n·lᵢⱼ, 0)·Δωᵢ,   Δωᵢ = (2π/W)(cos θ_top − cos θ_bottom)
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | n, v, a, r, m | `normal`, `view`, `albedo`, `roughness`, `metallic` | (P, …) | as in `shade.ggx` |
//! | E | `env` | (H, W, 3) | linear radiance, z up: u = atan2(x, y)/2π + ½, v = acos(z)/π at texel centres |
//! | L | `radiance` | (P, 3) | linear |
//!
//! # Rounding
//! A left fold over texels in row-major order.
//!
//! # Kinks and domain
//! A texel behind the surface contributes nothing and has zero gradient.

use std::f64::consts::{PI, TAU};

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::shade::ggx::{ALBEDO, METALLIC, Material, NORMAL, ROUGHNESS, VIEW, brdf, dot, unit};
use crate::twins::Call;

inputs! {
    /// Inputs of `shade.envmap`.
    pub struct In<'a, S> {
        normal: &'a Arr<S> = NORMAL,
        view: &'a Arr<S> = VIEW,
        albedo: &'a Arr<S> = ALBEDO,
        roughness: &'a Arr<S> = ROUGHNESS,
        metallic: &'a Arr<S> = METALLIC,
        env: &'a Arr<S> =
            Port::var("H,W,3", "linear radiance, z up, columns from −y through −x, +y, +x"),
    }
}

/// `shade.envmap`
pub static SIGNATURE: Signature = Signature {
    name: "shade.envmap",
    summary: "radiance of a point lit by a latitude–longitude map, direct light without shadows",
    inputs: In::<f64>::PORTS,
    outputs: ports![radiance: Port::var("P,3", "linear")],
    ..Signature::EMPTY
};

/// Unit direction of the centre of texel (i, j) of an (H, W) map.
pub fn direction(h: usize, w: usize, i: usize, j: usize) -> [f64; 3] {
    let theta = PI * (i as f64 + 0.5) / h as f64;
    let azimuth = TAU * ((j as f64 + 0.5) / w as f64 - 0.5);
    [libm::sin(theta) * libm::sin(azimuth), libm::sin(theta) * libm::cos(azimuth), libm::cos(theta)]
}

/// Solid angle of a texel of row i.
pub fn solid_angle(h: usize, w: usize, i: usize) -> f64 {
    let edge = |i: usize| libm::cos(PI * i as f64 / h as f64);
    TAU / w as f64 * (edge(i) - edge(i + 1))
}

/// The twin of `shade.envmap`.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) {
    let In { normal, view, albedo, roughness, metallic, env } = *input;
    let [p, h, w] = [normal.shape[0], env.shape[0], env.shape[1]];
    let slot = out.array("radiance", &[p, 3]);
    for point in 0..p {
        let (n, v) = (unit(normal.row(point)), view.row(point));
        let (roughness, metallic) = (roughness.data[point], metallic.data[point]);
        let m = Material { albedo: albedo.row(point), roughness, metallic };
        let mut sum = [S::zero(); 3];
        for i in 0..h {
            for j in 0..w {
                let l = direction(h, w, i, j).map(S::from_f64);
                let nl = dot(n, l);
                if nl.value() > 0.0 {
                    let f = brdf(n, v, l, &m);
                    let e: [S; 3] = env.row(i * w + j);
                    for k in 0..3 {
                        sum[k] = sum[k] + f[k] * nl * solid_angle(h, w, i) * e[k];
                    }
                }
            }
        }
        out.put_row(slot, point, sum);
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

/// Number of (point, texel) pairs.
///
/// # Errors
/// As [`run`].
pub fn work(call: &Call<'_, f64>) -> Result<u64, String> {
    let In { normal, env, .. } = In::of(call.arrays)?;
    Ok((normal.shape[0] * env.shape[0] * env.shape[1]) as u64)
}
