//! The output images of a render, and the sums from which a pixel is computed.

use crate::shade::vector::unit;

/// A part of an image, in pixels (x, y).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First pixel.
    pub origin: [usize; 2],
    /// Width and height.
    pub size: [usize; 2],
}

/// An image with per-pixel attributes; arrays are (H, W), row-major.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Passes {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Linear radiance; the background is the environment, if that is visible.
    pub color: Vec<[f32; 3]>,
    /// Fraction of the samples that hit a surface.
    pub alpha: Vec<f32>,
    /// Depth along the optical axis of the surface hit by the ray through the pixel's centre, 0 = nothing;
    /// for a moving camera at half of the exposure time, as for all attributes below.
    pub depth_z: Vec<f32>,
    /// Unit shading normal in world space with its normal map, before it is bent towards the view; mean over
    /// the samples that hit a surface; 0 = none.
    pub normal: Vec<[f32; 3]>,
    /// Linear albedo, mean over the samples that hit a surface.
    pub albedo: Vec<[f32; 3]>,
    /// Roughness, mean over the samples that hit a surface.
    pub roughness: Vec<f32>,
    /// Metallic, mean over the samples that hit a surface.
    pub metallic: Vec<f32>,
}

impl Passes {
    /// Returns passes of this size, all zero.
    pub(super) fn zeros([width, height]: [usize; 2]) -> Self {
        let n = width * height;
        Self {
            width,
            height,
            color: vec![[0.0; 3]; n],
            alpha: vec![0.0; n],
            depth_z: vec![0.0; n],
            normal: vec![[0.0; 3]; n],
            albedo: vec![[0.0; 3]; n],
            roughness: vec![0.0; n],
            metallic: vec![0.0; n],
        }
    }

    /// Writes the pixel at index `at`.
    pub(super) fn put(&mut self, at: usize, p: &Pixel) {
        self.color[at] = p.color;
        self.alpha[at] = p.alpha;
        self.depth_z[at] = p.depth_z;
        self.normal[at] = p.normal;
        self.albedo[at] = p.albedo;
        self.roughness[at] = p.roughness;
        self.metallic[at] = p.metallic;
    }
}

/// The first surface that a sample hits.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct FirstHit {
    /// Whether a surface is hit.
    pub(super) hit: bool,
    pub(super) normal: [f32; 3],
    pub(super) albedo: [f32; 3],
    pub(super) roughness: f32,
    pub(super) metallic: f32,
}

/// Sums over the samples of a pixel, then their means.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pixel {
    color: [f32; 3],
    alpha: f32,
    /// Number of samples that hit a surface from the pose at half time.
    met: f32,
    pub(super) depth_z: f32,
    normal: [f32; 3],
    albedo: [f32; 3],
    roughness: f32,
    metallic: f32,
}

impl Pixel {
    /// Adds the radiance of a sample, and whether it hits a surface.
    #[inline]
    pub(super) fn add_light(&mut self, radiance: &[f32; 3], first: &FirstHit) {
        for c in 0..3 {
            self.color[c] += radiance[c];
        }
        if first.hit {
            self.alpha += 1.0;
        }
    }

    /// Adds the attributes of the first surface of a sample, if any.
    #[inline]
    pub(super) fn add_surface(&mut self, first: &FirstHit) {
        if !first.hit {
            return;
        }
        self.met += 1.0;
        for c in 0..3 {
            self.normal[c] += first.normal[c];
            self.albedo[c] += first.albedo[c];
        }
        self.roughness += first.roughness;
        self.metallic += first.metallic;
    }

    /// Divides the sums over `samples` samples.
    pub(super) fn finish(&mut self, samples: u32) {
        let met = self.met;
        self.color = self.color.map(|c| c / samples as f32);
        self.alpha /= samples as f32;
        if met > 0.0 {
            self.normal = unit(self.normal).0;
            self.albedo = self.albedo.map(|c| c / met);
            self.roughness /= met;
            self.metallic /= met;
        }
    }
}
