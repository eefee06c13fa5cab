//! Importance sampling of directions for a BRDF, and the densities.
//!
//! ```text
//! diffuse     cosine about n:                      p = n·l/π
//! specular    visible normals of GGX by spherical caps (Dupuy and Benyoub 2023):   p = D/(2(n·v + K(n·v)))
//! mixture     p = s·p_specular + (1−s)·p_diffuse,   s = F_v/(F_v + (1−m)·a) in luminance,
//!             F_v = F₀ + (1−F₀)(1−n·v)⁵
//! ```
//!
//! The density is that of the mixture, whichever lobe a direction was drawn from, so one direction serves
//! both lobes.

use super::environment::luminance;
use super::ggx::{Facet, Point};
use super::vector::{add, dot, frame, scale, unit};
use crate::num::elem;
use crate::num::lanes::Real;
use std::f32::consts::{FRAC_1_PI, PI, TAU};

/// Returns the probability of the specular lobe.
#[inline(always)]
pub fn specular_share<L: Real>(point: &Point<L>) -> L {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let x = (one - point.nv).max(zero);
    let x2 = x * x;
    let f0 = luminance(point.f0);
    let specular = f0 + (one - f0) * (x2 * x2 * x);
    let diffuse = luminance(point.diffuse) * L::splat(PI);
    // F₀ ≥ 0.04(1−m), and a black metal still has the Schlick term, except at normal incidence, where both
    // terms are 0.
    let total = specular + diffuse;
    L::select(total.gt(zero), specular / L::select(total.gt(zero), total, one), one)
}

/// Returns the density per steradian of the mixture at a facet, 0 where the facet is off.
#[inline(always)]
pub fn density<L: Real>(point: &Point<L>, facet: &Facet<L>, share: L) -> L {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let nv = L::select(facet.on, point.nv, one);
    let specular = facet.d / (L::splat(2.0) * (nv + point.kv));
    let diffuse = facet.nl * L::splat(FRAC_1_PI);
    L::select(facet.on, share * specular + (one - share) * diffuse, zero)
}

/// Returns a cosine-weighted direction (x, y, z) about z from two uniforms.
#[inline(always)]
fn cosine<L: Real>(u: [L; 2]) -> [L; 3] {
    let radius = u[0].sqrt();
    let phi = u[1] * L::splat(TAU);
    [radius * elem::cos(phi), radius * elem::sin(phi), (L::splat(1.0) - u[0]).sqrt()]
}

/// Returns a direction about the normal with density n·l/π.
#[inline(always)]
pub fn diffuse<L: Real>(normal: [L; 3], u: [L; 2]) -> [L; 3] {
    let [t, b] = frame(normal);
    let c = cosine(u);
    add(add(scale(t, c[0]), scale(b, c[1])), scale(normal, c[2]))
}

/// Returns a direction drawn from the mixture; `lobe` and `u` are uniforms.
#[inline(always)]
pub fn direction<L: Real>(point: &Point<L>, share: L, lobe: L, u: [L; 2]) -> [L; 3] {
    let s = L::splat;
    let (zero, one, two) = (s(0.0), s(1.0), s(2.0));
    let is_specular = lobe.lt(share);
    let [t, b] = frame(point.normal);
    // Spherical cap: the view is stretched to the hemisphere of the surface with unit roughness.
    let alpha = point.a2.sqrt();
    let wi = unit([alpha * dot(point.view, t), alpha * dot(point.view, b), point.nv]).0;
    let cap = (one - u[0]) * (one + wi[2]) - wi[2];
    let flat = u[0].sqrt();
    let z = L::select(is_specular, cap, (one - u[0]).sqrt());
    let ring = L::select(is_specular, (one - cap * cap).max(zero).sqrt(), flat);
    let phi = u[1] * s(TAU);
    let local = [ring * elem::cos(phi), ring * elem::sin(phi), z];
    let h = add(local, wi);
    let m = unit([alpha * h[0], alpha * h[1], h[2].max(zero)]).0;
    let half = add(add(scale(t, m[0]), scale(b, m[1])), scale(point.normal, m[2]));
    let twice = two * dot(point.view, half);
    let out = std::array::from_fn(|k| {
        let diffuse = t[k] * local[0] + b[k] * local[1] + point.normal[k] * local[2];
        let mirrored = twice * half[k] - point.view[k];
        L::select(is_specular, mirrored, diffuse)
    });
    unit(out).0
}
