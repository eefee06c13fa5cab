//! The losses of a crop, and their cotangents of values and opacity.
//!
//! | term | weight | |
//! |---|---|---|
//! | colour, albedo | 1, 2 | mean (x − y)² of values in −1..1, and LPIPS or 0.1·(1 − SSIM) |
//! | foreground | 1 | mean (O − M)² |
//! | roughness, metallic | 1, 1 | mean (x − y)² of values in −1..1 |
//! | normal head | 1 | Σ ‖n − n*‖² over the compared pixels / number of all values |
//!
//! Means of colour and albedo are over the pixels that count, the others over all pixels of the crop. (LIRM, § 10.) Colours here are in 0..1, so their squares have the factor 4. The albedo of a pass is compared as it is,
//! without the scale of `loss.albedo`: its scale is known, and a factor would leave it free. Every crop has the same weight.

use super::adding::add;
use super::crops::Crop;
use super::targets::Target;
use crate::Result;
use crate::field::render::Channels;
use crate::loss::lpips::{self, Weights};
use crate::loss::mse::Over;
use crate::loss::{In, mse, ssim};

/// Factor of squares of values in 0..1 for values in −1..1.
const WIDE: f32 = 4.0;
/// That of roughness and metallic: two means of squares, so twice the mean over both.
const MATERIAL: f32 = 2.0 * WIDE;
/// Weight of LPIPS.
const PERCEPTUAL: f32 = 2.0;
/// Weight of 1 − SSIM where there are no weights for LPIPS.
const STRUCTURE: f32 = 0.2;

/// Rendered values of all rays, with their cotangents.
pub struct Rendered<'a> {
    /// (N, Q)
    pub values: &'a [f32],
    /// (N)
    pub opacity: &'a [f32],
    /// Where values are.
    pub channels: Channels,
    /// Q
    pub count: usize,
    /// (N, Q)
    pub values_bar: Vec<f32>,
    /// (N)
    pub opacity_bar: Vec<f32>,
}

impl<'a> Rendered<'a> {
    /// Begins with cotangents of 0.
    pub fn new(values: &'a [f32], opacity: &'a [f32], channels: Channels) -> Self {
        let count = values.len() / Ord::max(opacity.len(), 1);
        let (values_bar, opacity_bar) = (vec![0.0; values.len()], vec![0.0; opacity.len()]);
        Self { values, opacity, channels, count, values_bar, opacity_bar }
    }

    /// Returns `n` values from channel `at` of some rays.
    pub fn picked(&self, rays: impl Iterator<Item = usize>, at: usize, n: usize) -> Vec<f32> {
        rays.flat_map(|r| self.values[r * self.count + at..][..n].iter().copied()).collect()
    }

    /// Adds the cotangents of picked values where they were picked.
    pub fn put(&mut self, rays: impl Iterator<Item = usize>, at: usize, n: usize, picked_bar: &[f32]) {
        let firsts = rays.map(|r| r * self.count + at);
        for (first, part) in firsts.zip(picked_bar.chunks_exact(n)) {
            add(&mut self.values_bar[first..][..n], part);
        }
    }
}

/// The crop of an array with `n` values per pixel.
pub fn cropped(all: &[f32], width: usize, crop: &Crop, n: usize) -> Vec<f32> {
    crop.pixels(width).flat_map(|i| all[i * n..(i + 1) * n].iter().copied()).collect()
}

/// A loss of one crop.
#[derive(Clone, Copy)]
pub struct Terms<'a> {
    /// Weight of all terms.
    pub weight: f32,
    /// Whether passes of albedo, materials and normals are read.
    pub passes: bool,
    /// Weights of LPIPS; without them the structural similarity is compared.
    pub lpips: Option<&'a Weights>,
}

impl Terms<'_> {
    /// Colour or albedo: squares, and structure.
    fn image(&self, pair: &In<'_>) -> Result<(f32, Vec<f32>)> {
        let mut bar = vec![0.0; pair.x.len()];
        let (square, saved) = mse::forward(pair)?;
        let weight = WIDE * self.weight;
        mse::adjoint(pair, &saved, weight, &mut bar, None);
        let mut value = weight * square;
        if let Some(weights) = self.lpips {
            let is_kept = |pixel: usize| pair.mask.is_none_or(|m| m[pixel] != 0.0);
            let both = pair.x.iter().zip(pair.y).enumerate();
            // A pixel that does not count is the same in both images, and gets no gradient.
            let x: Vec<f32> = both.map(|(i, (x, y))| if is_kept(i / 3) { *x } else { *y }).collect();
            let (height, width) = (pair.height, pair.width);
            let x = lpips::In { x: &x, y: pair.y, height, width, rescale: true, weights };
            let (distance, _, saved) = lpips::forward(x, None)?;
            let weight = PERCEPTUAL * self.weight;
            let mut part = vec![0.0; bar.len()];
            lpips::adjoint(x, &saved, weight, &mut part, None);
            for pixel in (0..height * width).filter(|i| is_kept(*i)) {
                add(&mut bar[3 * pixel..][..3], &part[3 * pixel..][..3]);
            }
            value += weight * distance;
        } else {
            let (alike, saved) = ssim::forward(pair)?;
            let weight = STRUCTURE * self.weight;
            ssim::adjoint(pair, &saved, -weight, &mut bar, None);
            value += weight * (1.0 - alike);
        }
        Ok((value, bar))
    }

    /// Squares over all values, 0 where the mask is.
    fn square(&self, pair: &In<'_>, factor: f32) -> Result<(f32, Vec<f32>)> {
        let mut bar = vec![0.0; pair.x.len()];
        let (value, saved) = mse::forward_over(pair, Over::All)?;
        let weight = factor * self.weight;
        mse::adjoint(pair, &saved, weight, &mut bar, None);
        Ok((weight * value, bar))
    }

    /// Adds the losses of one crop, whose first ray is `first`; returns their sum. `followed` are the normals (N, 3) that the
    /// normal head follows where there is no pass, 0 where there are none.
    pub fn add(
        &self,
        target: &Target,
        crop: &Crop,
        first: usize,
        followed: Option<&[[f32; 3]]>,
        out: &mut Rendered<'_>,
    ) -> Result<f32> {
        let [height, width] = crop.size;
        let rays = first..first + height * width;
        let of = |all: &[f32], n: usize| cropped(all, target.camera.width, crop, n);
        let kept = target.kept.as_ref().map(|m| of(m, 1));
        if kept.as_ref().is_some_and(|m| m.iter().all(|k| *k == 0.0)) {
            return Ok(0.0);
        }
        let mask = kept.as_deref();
        let mut sum = 0.0;
        let Channels { color, albedo, material, normal } = out.channels;
        let colored = target.colored.as_ref().map(|m| of(m, 1));
        let [of_albedo, of_material, of_normal] = [&target.albedo, &target.material, &target.normal]
            .map(|pass| pass.as_ref().filter(|_| self.passes));
        let images = [(color, Some(&target.color), colored.as_deref()), (albedo, of_albedo, mask)];
        for (at, truth, mask) in images {
            let (Some(at), Some(truth)) = (at, truth) else { continue };
            if mask.is_some_and(|m| m.iter().all(|k| *k == 0.0)) {
                continue;
            }
            let (x, y) = (out.picked(rays.clone(), at, 3), of(truth, 3));
            let (loss, bar) = self.image(&In { x: &x, y: &y, mask, height, width })?;
            out.put(rays.clone(), at, 3, &bar);
            sum += loss;
        }
        let foreground = of(&target.foreground, 1);
        let x = &out.opacity[rays.clone()];
        let (loss, bar) = self.square(&In { x, y: &foreground, mask, height, width }, 1.0)?;
        add(&mut out.opacity_bar[rays.clone()], &bar);
        sum += loss;
        if let (Some(at), Some(truth)) = (material, of_material) {
            let (x, y) = (out.picked(rays.clone(), at, 2), of(truth, 2));
            let (loss, bar) = self.square(&In { x: &x, y: &y, mask, height, width }, MATERIAL)?;
            out.put(rays.clone(), at, 2, &bar);
            sum += loss;
        }
        if let Some(at) = normal {
            let (y, mut compared) = match (of_normal, followed) {
                (Some(truth), _) => (of(truth, 3), of(&target.solid, 1)),
                (None, Some(followed)) => {
                    let there = |n: &[f32; 3]| f32::from(u8::from(*n != [0.0; 3]));
                    let part = &followed[rays.clone()];
                    (part.as_flattened().to_vec(), part.iter().map(there).collect())
                }
                (None, None) => return Ok(sum),
            };
            if let Some(kept) = mask {
                compared.iter_mut().zip(kept).for_each(|(c, k)| *c *= k);
            }
            let x = out.picked(rays.clone(), at, 3);
            let (loss, bar) = self.square(&In { x: &x, y: &y, mask: Some(&compared), height, width }, 1.0)?;
            out.put(rays, at, 3, &bar);
            sum += loss;
        }
        Ok(sum)
    }
}
