//! The losses of a crop, and their cotangents of values and opacity.
//!
//! | term | weight | |
//! |---|---|---|
//! | colour, albedo | 1, 2 | mean (x − y)² of values in −1..1, and LPIPS or 0.1·(1 − SSIM) |
//! | foreground | 1 | mean (O − M)² |
//! | roughness, metallic | 1, 1, times `material` | mean (x − y)² of values in −1..1 |
//! | normal head | 1, times `normal` | Σ ‖n − n*‖² over the compared pixels / number of all values |
//!
//! Means of colour and albedo are over the pixels that count, the others over all pixels of the crop. (LIRM, § 10.) Colours here are in 0..1, so their squares have the factor 4. A fit compares the albedo of a pass as it is:
//! its scale is known, and a factor would leave it free. LIRM compares it up to a factor per object (`loss.albedo`). Every crop has the same weight.

use super::adding::add;
use super::crops::Crop;
use super::targets::Target;
use crate::Result;
use crate::field::render::Channels;
use crate::loss::lpips::{self, Weights};
use crate::loss::mse::Over;
use crate::loss::{In, albedo, mse, ssim};
use crate::num::order;

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
    /// Factor on the weight of roughness and metallic.
    pub material: f32,
    /// Factor on the weight of the normal head.
    pub normal: f32,
    /// Weights of LPIPS; without them the structural similarity is compared.
    pub lpips: Option<&'a Weights>,
    /// Factor of linear albedo ([`albedo_scale`]); `None` compares albedo as it is.
    pub scale: Option<f32>,
}

/// Albedo over black from its values over white, which cannot be below 0 but for rounding.
fn over_black(values: &[f32], opacity: &[f32]) -> Vec<f32> {
    let pixels = values.as_chunks::<3>().0.iter().zip(opacity);
    pixels.flat_map(|(v, o)| v.map(|v| order::max(v - (1.0 - o), 0.0))).collect()
}

/// The factor of linear albedo that makes its mean over the covered pixels of all crops the true one; `None` where there is no pass.
pub fn albedo_scale(targets: &[Target], crops: &[Crop], out: &Rendered<'_>) -> Option<f32> {
    let at = out.channels.albedo?;
    let (mut found, mut truth, mut kept, mut first) = (Vec::new(), Vec::new(), Vec::new(), 0);
    for crop in crops {
        let target = &targets[crop.view];
        let rays = first..first + crop.size[0] * crop.size[1];
        first = rays.end;
        found.extend(over_black(&out.picked(rays.clone(), at, 3), &out.opacity[rays]));
        truth.extend(cropped(target.albedo.as_ref()?, target.camera.width, crop, 3));
        let covered = cropped(&target.foreground, target.camera.width, crop, 1);
        kept.extend(covered.iter().map(|m| f32::from(u8::from(*m == 1.0))));
    }
    Some(albedo::scale(&found, &truth, &kept))
}

impl Terms<'_> {
    /// Colour or albedo: squares, and structure.
    fn image(&self, pair: &In<'_>) -> Result<(f32, Vec<f32>)> {
        let mut bar = vec![0.0; pair.x.len()];
        let (square, saved) = mse::forward(pair)?;
        let weight = WIDE * self.weight;
        mse::adjoint(pair, &saved, weight, &mut bar, None);
        let structure = self.structure(pair, &mut bar)?;
        Ok((weight * square + structure, bar))
    }

    /// Albedo up to a factor: squares, and structure. Returns the cotangents of values over white and of opacity.
    fn scaled(&self, pair: &In<'_>, opacity: &[f32], scale: f32) -> Result<(f32, Vec<f32>, Vec<f32>)> {
        let prediction = over_black(pair.x, opacity);
        let x = albedo::In { prediction: &prediction, truth: pair.y, opacity, scale };
        let (square, saved) = albedo::forward(&x);
        let adjusted = In { x: &saved.adjusted, ..*pair };
        let mut adjusted_bar = vec![0.0; pair.x.len()];
        let structure = self.structure(&adjusted, &mut adjusted_bar)?;
        let weight = WIDE * self.weight;
        let (mut bar, mut opacity_bar) = (vec![0.0; pair.x.len()], vec![0.0; opacity.len()]);
        albedo::adjoint(&x, &saved, weight, &adjusted_bar, &mut bar, &mut opacity_bar);
        // Over black is over white − (1 − O).
        let pixels = bar.as_chunks::<3>().0.iter().zip(&mut opacity_bar);
        pixels.for_each(|(p, o)| *o += (p[0] + p[1]) + p[2]);
        Ok((weight * square + structure, bar, opacity_bar))
    }

    /// LPIPS or structure, whose cotangents are added.
    fn structure(&self, pair: &In<'_>, bar: &mut [f32]) -> Result<f32> {
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
            return Ok(weight * distance);
        }
        let (alike, saved) = ssim::forward(pair)?;
        let weight = STRUCTURE * self.weight;
        ssim::adjoint(pair, &saved, -weight, bar, None);
        Ok(weight * (1.0 - alike))
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
            let pair = In { x: &x, y: &y, mask, height, width };
            let (loss, bar) = match self.scale.filter(|_| Some(at) == albedo) {
                None => self.image(&pair)?,
                Some(scale) => {
                    let (loss, bar, opacity_bar) = self.scaled(&pair, &out.opacity[rays.clone()], scale)?;
                    add(&mut out.opacity_bar[rays.clone()], &opacity_bar);
                    (loss, bar)
                }
            };
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
            let factor = self.material * MATERIAL;
            let (loss, bar) = self.square(&In { x: &x, y: &y, mask, height, width }, factor)?;
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
            let pair = In { x: &x, y: &y, mask: Some(&compared), height, width };
            let (loss, bar) = self.square(&pair, self.normal)?;
            out.put(rays, at, 3, &bar);
            sum += loss;
        }
        Ok(sum)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::elem::f64 as elem;
    use crate::num::rng::Rng;
    use crate::scene::camera::{Camera, Model};

    const SIZE: [usize; 2] = [12, 12];

    fn numbers(seed: u64, n: usize) -> Vec<f32> {
        let rng = Rng::new(seed);
        (0..n).map(|i| 0.1 + 0.8 * rng.uniform_f32(i as u64, 0, 1, 0)).collect()
    }

    const TERMS: Terms<'_> =
        Terms { weight: 0.5, passes: true, material: 1.0, normal: 1.0, lpips: None, scale: None };

    /// Values over white, opacities, and true albedo.
    fn images() -> [Vec<f32>; 3] {
        let n = SIZE[0] * SIZE[1];
        let opacity = numbers(1, n);
        let values = numbers(2, 3 * n)
            .into_iter()
            .enumerate()
            .map(|(i, v)| v * opacity[i / 3] + (1.0 - opacity[i / 3]));
        [values.collect(), opacity, numbers(3, 3 * n)]
    }

    #[test]
    fn gradients_of_scaled_albedo_are_difference_quotients() {
        let [values, opacity, truth] = images();
        let value = |v: &[f32], o: &[f32]| {
            let pair = In { x: v, y: &truth, mask: None, height: SIZE[0], width: SIZE[1] };
            TERMS.scaled(&pair, o, 0.9).expect("finite")
        };
        let (_, v_bar, o_bar) = value(&values, &opacity);
        for (name, gradient, is_opacity) in [("values", v_bar, false), ("opacity", o_bar, true)] {
            let square = gradient.iter().fold(0.0, |s, g| s + f64::from(*g) * f64::from(*g));
            let moved = |h: f64| {
                let (mut v, mut o) = (values.clone(), opacity.clone());
                let array = if is_opacity { &mut o } else { &mut v };
                let step = |(x, g): (&mut f32, &f32)| *x += (h * f64::from(*g) / square.sqrt()) as f32;
                array.iter_mut().zip(&gradient).for_each(step);
                f64::from(value(&v, &o).0)
            };
            let slope = (moved(0.01) - moved(-0.01)) / 0.02;
            assert!(
                (slope - square.sqrt()).abs() < 0.02 * square.sqrt(),
                "{name}: {slope} {}",
                square.sqrt()
            );
        }
    }

    #[test]
    fn a_colour_is_compared_by_four_squares_and_a_fifth_of_what_is_not_alike() {
        let [values, _, truth] = images();
        let pair = In { x: &values, y: &truth, mask: None, height: SIZE[0], width: SIZE[1] };
        let (loss, _) = TERMS.image(&pair).expect("finite");
        let square = mse::forward(&pair).expect("finite").0;
        let alike = ssim::forward(&pair).expect("finite").0;
        let expected = 0.5 * (4.0 * square + 0.2 * (1.0 - alike));
        assert!((loss - expected).abs() < 1e-6 && 1.0 - alike > 0.5, "{loss} {expected} {alike}");
    }

    #[test]
    fn gradients_with_lpips_are_difference_quotients_and_leave_out_what_does_not_count() {
        let (size, weights) = (24, Weights::by_formula());
        let n = size * size;
        let (values, truth) = (numbers(4, 3 * n), numbers(5, 3 * n));
        let mask: Vec<f32> = (0..n).map(|i| f32::from(u8::from(i % 5 != 0))).collect();
        let terms = Terms { lpips: Some(&weights), ..TERMS };
        let value = |v: &[f32]| {
            let pair = In { x: v, y: &truth, mask: Some(&mask), height: size, width: size };
            terms.image(&pair).expect("finite")
        };
        let (_, bar) = value(&values);
        let left_out = bar.as_chunks::<3>().0.iter().zip(&mask).filter(|(_, m)| **m == 0.0);
        assert!(left_out.into_iter().all(|(b, _)| *b == [0.0; 3]), "pixels that do not count");
        let square = bar.iter().fold(0.0, |s, g| s + f64::from(*g) * f64::from(*g));
        let moved = |h: f64| {
            let step = |(x, g): (&f32, &f32)| x + (h * f64::from(*g) / square.sqrt()) as f32;
            f64::from(value(&values.iter().zip(&bar).map(step).collect::<Vec<_>>()).0)
        };
        let slope = (moved(0.003) - moved(-0.003)) / 0.006;
        assert!((slope / square.sqrt() - 1.0).abs() < 0.02, "{slope} {}", square.sqrt());
        let without =
            TERMS.image(&In { x: &values, y: &truth, mask: Some(&mask), height: size, width: size });
        assert!(without.expect("finite").0 != value(&values).0, "LPIPS instead of structure");
    }

    #[test]
    fn the_normal_head_follows_numerical_normals_where_there_is_no_pass() {
        let n = SIZE[0] * SIZE[1];
        let (values, opacity) = (numbers(6, 3 * n), numbers(7, n));
        let pass = numbers(8, 3 * n);
        // Two rays of three have a surface.
        let followed: Vec<[f32; 3]> =
            (0..n).map(|i| if i % 3 == 0 { [0.0; 3] } else { [0.6, 0.0, -0.8] }).collect();
        let mut target = Target {
            name: String::new(),
            camera: Camera {
                rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
                translation: [0.0, 0.0, 3.0],
                focal_px: [12.0; 2],
                center_px: [6.0; 2],
                width: SIZE[1],
                height: SIZE[0],
                model: Model::Pinhole,
            },
            color: vec![1.0; 3 * n],
            foreground: opacity.clone(),
            kept: None,
            colored: None,
            albedo: None,
            material: None,
            normal: None,
            solid: vec![1.0; n],
            depth: None,
        };
        let channels = Channels { color: None, albedo: None, material: None, normal: Some(0) };
        let crop = Crop { view: 0, corner: [0; 2], size: SIZE };
        let compared = |target: &Target, followed: Option<&[[f32; 3]]>| {
            let mut out = Rendered::new(&values, &opacity, channels);
            let loss = TERMS.add(target, &crop, 0, followed, &mut out).expect("finite");
            (loss, out.values_bar)
        };
        // Of weight ½ over all values: ½ Σ (x − y)² / 3n, whose gradient is (x − y) / 3n.
        let expected = |y: &[f32], is_compared: &dyn Fn(usize) -> bool| {
            let of = |i: usize| if is_compared(i / 3) { values[i] - y[i] } else { 0.0 };
            let all: Vec<f32> = (0..3 * n).map(of).collect();
            let sum = all.iter().fold(0.0, |s, d| s + d * d);
            (0.5 * sum / (3 * n) as f32, all.iter().map(|d| d / (3 * n) as f32).collect::<Vec<_>>())
        };
        let agree = |found: (f32, Vec<f32>), wanted: (f32, Vec<f32>), what: &str| {
            let far = found.1.iter().zip(&wanted.1).fold(0.0, |m, (a, b)| order::max(m, (a - b).abs()));
            assert!(
                (found.0 - wanted.0).abs() < 1e-5 && far < 1e-6,
                "{what}: {} {} {far}",
                found.0,
                wanted.0
            );
        };
        let numerical = expected(followed.as_flattened(), &|ray| ray % 3 != 0);
        agree(compared(&target, Some(&followed)), numerical, "no pass");
        agree(compared(&target, None), (0.0, vec![0.0; 3 * n]), "nothing to follow");
        target.normal = Some(pass.clone());
        agree(compared(&target, Some(&followed)), expected(&pass, &|_| true), "a pass");
    }

    #[test]
    fn albedo_is_compared_up_to_one_factor() {
        let [_, _, truth] = images();
        let opaque = vec![1.0; SIZE[0] * SIZE[1]];
        // Half of the linear albedo.
        let halved = |t: &f32| elem::pow(0.5 * elem::pow(f64::from(*t), 2.2), 1.0 / 2.2) as f32;
        let half: Vec<f32> = truth.iter().map(halved).collect();
        let pair = In { x: &half, y: &truth, mask: None, height: SIZE[0], width: SIZE[1] };
        let scale = albedo::scale(&half, &truth, &opaque);
        let (scaled, ..) = TERMS.scaled(&pair, &opaque, scale).expect("finite");
        let (plain, _) = TERMS.image(&pair).expect("finite");
        assert!((scale - 2.0).abs() < 1e-5 && scaled < 1e-9 && plain > 1e-3, "{scale} {scaled} {plain}");
    }
}
