//! `shade.ggx`: the metallic-roughness BRDF.
//!
//! f = (1−m)·a/π + D·G·F/(4 n·l n·v),   α = max(r², 1e-3),   h = (v + l)/‖v + l‖
//! D = α²/(π(α²(n·h)² + ‖n×h‖²)²),   G/(4 n·l n·v) = ½/(n·l √(n·v² + α²(1−n·v²)) + n·v √(n·l² + α²(1−n·l²)))
//! F = F₀ + (1−F₀)(1−v·h)⁵,   F₀ = 0.04(1−m) + m·a
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | n | `normal` | (P, 3) | any length; normalised; 0 reflects nothing |
//! | v, l | `view`, `light` | (P, 3) | towards the eye and the light, used as given |
//! | a, r, m | `albedo`, `roughness`, `metallic` | (P, 3), (P), (P) | 0..1 |
//! | f | `brdf` | (P, 3) | 1/sr, without the cosine |
//!
//! # Rounding
//! D is written through ‖n×h‖² = 1 − (n·h)², which does not cancel.
//!
//! # Kinks and domain
//! f = 0 with zero gradient where n·l ≤ 0 or n·v ≤ 0. α has no gradient below 1e-3. The denominator of ½/(…)
//! is at least 1e-15.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

pub(super) const NORMAL: Port = Port::var("P,3", "any length; 0 reflects nothing");
pub(super) const VIEW: Port = Port::fixed("P,3", "towards the eye, unit, used as given");
pub(super) const ALBEDO: Port = Port::var("P,3", "linear, 0 to 1");
pub(super) const ROUGHNESS: Port = Port::var("P", "0 to 1; α = max(r², 1e-3)");
pub(super) const METALLIC: Port = Port::var("P", "0 to 1");

inputs! {
    /// Inputs of `shade.ggx`.
    pub struct In<'a, S> {
        normal: &'a Arr<S> = NORMAL,
        view: &'a Arr<S> = VIEW,
        light: &'a Arr<S> = Port::fixed("P,3", "towards the light, unit, used as given"),
        albedo: &'a Arr<S> = ALBEDO,
        roughness: &'a Arr<S> = ROUGHNESS,
        metallic: &'a Arr<S> = METALLIC,
    }
}

/// `shade.ggx`
pub static SIGNATURE: Signature = Signature {
    name: "shade.ggx",
    summary: "metallic-roughness BRDF: Lambert and GGX with height-correlated Smith, without the cosine",
    inputs: In::<f64>::PORTS,
    outputs: ports![brdf: Port::var("P,3", "1/sr")],
    ..Signature::EMPTY
};

/// Albedo, roughness, metallic.
#[derive(Clone, Copy, Debug)]
pub struct Material<S> {
    /// linear
    pub albedo: [S; 3],
    /// 0..1
    pub roughness: S,
    /// 0..1
    pub metallic: S,
}

/// a·b.
pub fn dot<S: Scalar>(a: [S; 3], b: [S; 3]) -> S {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// a/‖a‖; 0 with zero gradient for 0.
pub fn unit<S: Scalar>(a: [S; 3]) -> [S; 3] {
    let length = dot(a, a).sqrt();
    if length.value() == 0.0 { [S::zero(); 3] } else { a.map(|x| x / length) }
}

/// f of a unit (or zero) normal.
pub fn brdf<S: Scalar>(n: [S; 3], v: [S; 3], l: [S; 3], m: &Material<S>) -> [S; 3] {
    let (nl, nv) = (dot(n, l), dot(n, v));
    if !(nl.value() > 0.0 && nv.value() > 0.0) {
        return [S::zero(); 3];
    }
    let square = m.roughness * m.roughness;
    let alpha = if square.value() >= 1e-3 { square } else { S::from_f64(1e-3) };
    let a2 = alpha * alpha;
    let h = unit([v[0] + l[0], v[1] + l[1], v[2] + l[2]]);
    let nh = dot(n, h);
    let cross = [n[1] * h[2] - n[2] * h[1], n[2] * h[0] - n[0] * h[2], n[0] * h[1] - n[1] * h[0]];
    let q = a2 * nh * nh + dot(cross, cross);
    let d = a2 / (q * q * std::f64::consts::PI);
    let one = S::one();
    let stretched = |c: S| (c * c + a2 * (one - c * c)).sqrt();
    let mut den = nl * stretched(nv) + nv * stretched(nl);
    if den.value() < 1e-15 {
        den = S::from_f64(1e-15);
    }
    let x = one - dot(v, h);
    let x = if x.value() > 0.0 { x } else { S::zero() };
    let fresnel = x * x * x * x * x;
    std::array::from_fn(|k| {
        let f0 = (one - m.metallic) * 0.04 + m.metallic * m.albedo[k];
        let specular = d * (S::from_f64(0.5) / den) * (f0 + (one - f0) * fresnel);
        (one - m.metallic) * m.albedo[k] / std::f64::consts::PI + specular
    })
}

/// The twin of `shade.ggx`.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) {
    let In { normal, view, light, albedo, roughness, metallic } = *input;
    let p = normal.shape[0];
    let slot = out.array("brdf", &[p, 3]);
    for i in 0..p {
        let m = Material { albedo: albedo.row(i), roughness: roughness.data[i], metallic: metallic.data[i] };
        out.put_row(slot, i, brdf(unit(normal.row(i)), view.row(i), light.row(i), &m));
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
