//! Reflection at eight surface points.

use crate::num::lanes::{Real, f32x8};
use crate::shade::ggx::{Facet, Point};
use crate::shade::sample;
use crate::shade::surface::Surface;
use crate::shade::vector::{dot, scale};

/// BRDF of eight points.
pub(super) struct Lobes<const LAMBERT: bool> {
    point: Point<f32x8>,
    share: f32x8,
}

impl<const LAMBERT: bool> Lobes<LAMBERT> {
    #[inline(always)]
    pub(super) fn new(s: &Surface, view: [f32x8; 3]) -> Self {
        let mut point = Point::new(s.normal, view, &s.material);
        if LAMBERT {
            point.diffuse = scale(s.material.albedo, f32x8::splat(std::f32::consts::FRAC_1_PI));
            return Self { point, share: f32x8::splat(0.0) };
        }
        let share = sample::specular_share(&point);
        Self { point, share }
    }

    #[inline(always)]
    pub(super) fn direction(&self, [lobe, u, v]: [f32x8; 3]) -> [f32x8; 3] {
        if LAMBERT {
            return sample::diffuse(self.point.normal, [u, v]);
        }
        sample::direction(&self.point, self.share, lobe, [u, v])
    }

    /// Returns f·cos and the density; both are zero where nothing is reflected.
    #[inline(always)]
    pub(super) fn eval(&self, towards: [f32x8; 3]) -> ([f32x8; 3], f32x8) {
        let zero = f32x8::splat(0.0);
        if LAMBERT {
            let nl = Real::max(dot(self.point.normal, towards), zero);
            return (scale(self.point.diffuse, nl), nl * f32x8::splat(std::f32::consts::FRAC_1_PI));
        }
        let facet: Facet<f32x8> = self.point.facet(towards);
        let nl = Real::max(facet.nl, zero);
        (scale(self.point.brdf(&facet), nl), sample::density(&self.point, &facet, self.share))
    }
}
