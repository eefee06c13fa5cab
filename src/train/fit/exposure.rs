//! Equalises the exposures of the input images of an object, as preparation for training.
//!
//! ```text
//! linear ──► × ē/e_v ──► × g ──► clamped to 0..1 ──► sRGB-encoded        ē = mean of e over the views
//!                                                                      g = clamp(0.08 / m, 1, 10)
//! ```
//!
//! Every image was exposed individually (e_v, [`crate::shade::exposure::auto`]), so an object that is
//! brighter from the left than from the right has the same brightness in both images. The first factor
//! reverses this: all views get the object's mean exposure, so that a surface has the same colour in all of
//! them. The second factor brightens objects that are dark in all views; m is the mean of the linear
//! foreground after the first factor, over channels, pixels and views, each pixel weighted by its coverage.
//! Without a foreground g = 1, with a black one g = 10.
//!
//! # Rounding
//! All computations use f64, and a value is rounded once. Sums are left folds: channels (r + g) + b, pixels
//! of a view in order, then views in order.
//!
//! # Kinks and domain
//! Results brighter than white are clamped to 1, as in the original exposure. Where the input image was
//! already clamped, the original values are not recovered.

use crate::loss::metric::orb::{decode, encode};
use crate::num::{order, par};
use crate::{Error, Result};

/// Mean of the linear foreground to which dark objects are brightened.
pub const FOREGROUND: f64 = 0.08;
/// Limits of that factor.
pub const LIFT: [f64; 2] = [1.0, 10.0];

/// One input image of an object.
#[derive(Clone, Debug, PartialEq)]
pub struct Photograph {
    /// Colours, sRGB-encoded, 0..1, row-major.
    pub color: Vec<[f32; 3]>,
    /// Coverage of the object, 0..1, one value per pixel.
    pub foreground: Vec<f32>,
    /// The factor from radiance to this image, before encoding; > 0.
    pub exposure: f64,
}

/// The factors by which the views of an object were multiplied, in linear values.
#[derive(Clone, Debug, PartialEq)]
pub struct Gains {
    /// The factor ē/e_v of each view.
    pub views: Vec<f64>,
    /// The factor g, the same for all views, and the mean exposure.
    pub common: Common,
}

/// The common exposure of the images of an object: what other images of it need to be exposed with the same
/// bits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Common {
    /// Factor from radiance to the linear values of the images, (ē/e₀)·e₀·g.
    pub factor: f64,
    /// The mean ē of the exposures.
    pub mean: f64,
    /// The factor g.
    pub lift: f64,
}

impl Common {
    /// The exposure with a given factor from radiance.
    pub fn of(factor: f64) -> Self {
        Self { factor, mean: factor, lift: 1.0 }
    }

    /// What the linear values of an image with exposure e are multiplied by.
    fn gain(&self, e: f64) -> f64 {
        self.mean / e * self.lift
    }
}

/// Converts the input images of one object to a common exposure and brightens dark objects; see the module.
/// An empty list is left unchanged.
///
/// # Errors
/// If a value is out of range or the sizes of an image differ; then no image is changed.
pub fn equalise(views: &mut [Photograph]) -> Result<Gains> {
    for (v, p) in views.iter().enumerate() {
        check(p).map_err(|e| e.within(format!("view {v}")))?;
    }
    let sum = views.iter().fold(0.0, |s, p| s + p.exposure);
    let mean = sum / Ord::max(views.len(), 1) as f64;
    let gains: Vec<f64> = views.iter().map(|p| mean / p.exposure).collect();
    let (mut light, mut area) = (0.0, 0.0);
    for (p, gain) in views.iter().zip(&gains) {
        let (mut l, mut a) = (0.0, 0.0);
        for (c, f) in p.color.iter().zip(&p.foreground).filter(|(_, f)| **f > 0.0) {
            let [r, g, b] = c.map(|x| decode(f64::from(x)));
            l += f64::from(*f) * (((r + g) + b) / 3.0);
            a += f64::from(*f);
        }
        light += gain * l;
        area += a;
    }
    let lift = if area > 0.0 { order::clamp(FOREGROUND * area / light, LIFT[0], LIFT[1]) } else { 1.0 };
    let first = views.first().map_or(1.0, |p| p.exposure);
    let factor = lift * (gains.first().copied().unwrap_or(1.0) * first);
    let common = Common { factor, mean, lift };
    views.iter_mut().for_each(|p| multiply(p, common.gain(p.exposure)));
    Ok(Gains { views: gains, common })
}

/// Gives images the exposure of others of the same object, with the bits that they would have among them.
///
/// # Errors
/// If a value is out of range or the sizes of an image differ; then no image is changed.
pub fn expose(views: &mut [Photograph], common: &Common) -> Result<()> {
    for (v, p) in views.iter().enumerate() {
        check(p).map_err(|e| e.within(format!("view {v}")))?;
    }
    views.iter_mut().for_each(|p| multiply(p, common.gain(p.exposure)));
    Ok(())
}

/// Multiplies the linear values of an image.
fn multiply(p: &mut Photograph, factor: f64) {
    // An image that keeps its exposure is not decoded and encoded unnecessarily.
    if factor != 1.0 {
        par::chunks_mut(&mut p.color, 4096, |_, pixels| {
            for x in pixels.as_flattened_mut() {
                *x = encode(order::min(decode(f64::from(*x)) * factor, 1.0)) as f32;
            }
        });
    }
}

fn check(p: &Photograph) -> Result<()> {
    if p.color.len() != p.foreground.len() {
        return Err(Error::input("input image").expected("one coverage value per pixel").got(format!(
            "{} for {} pixels",
            p.foreground.len(),
            p.color.len()
        )));
    }
    if !(p.exposure > 0.0 && p.exposure.is_finite()) {
        return Err(Error::input("exposure").expected("a positive number").got(p.exposure.to_string()));
    }
    let unit = |x: &f32| (0.0..=1.0).contains(x);
    let bad = p.color.iter().zip(&p.foreground).position(|(c, f)| !(c.iter().all(unit) && unit(f)));
    match bad {
        None => Ok(()),
        Some(i) => Err(Error::input("input image")
            .at(format!("pixel {i}"))
            .expected("colour and coverage from 0 to 1")
            .got(format!("{:?} and {}", p.color[i], p.foreground[i]))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An image with one radiance on a covered pixel, twice that radiance on a half-covered one, and a
    /// background.
    fn shot(radiance: f64, exposure: f64) -> Photograph {
        let pixel = |x: f64| [encode(x * exposure) as f32; 3];
        Photograph {
            color: vec![pixel(radiance), pixel(2.0 * radiance), pixel(0.9 / exposure)],
            foreground: vec![1.0, 0.5, 0.0],
            exposure,
        }
    }

    #[test]
    fn a_surface_has_one_colour_in_all_views() {
        let mut views = [shot(0.1, 0.5), shot(0.1, 2.0), shot(0.1, 3.5)];
        let gains = equalise(&mut views).expect("photographs");
        assert_eq!(gains.views, [4.0, 1.0, 2.0 / 3.5], "mean exposure 2 over each");
        // Mean foreground: (0.1 + 0.5·0.2)/1.5 · 2 = 0.2667, bright enough.
        assert_eq!(gains.common, Common::of(2.0), "not dark");
        for (v, p) in views.iter().enumerate() {
            let got = decode(f64::from(p.color[0][1]));
            assert!((got - 0.2).abs() < 1e-7, "view {v}: radiance 0.1 at exposure 2, got {got}");
        }
        assert_eq!(views[0].color[2], [1.0; 3], "a background beyond white is clamped");
    }

    #[test]
    fn dark_objects_are_lifted_within_limits() {
        // One view: its own exposure is kept, the mean foreground is 4/3 · radiance · exposure.
        for (radiance, want) in [(0.03, 2.0), (1e-4, 10.0), (0.0, 10.0), (0.06, 1.0), (0.5, 1.0)] {
            let mut views = [shot(radiance, 1.0)];
            let gains = equalise(&mut views).expect("valid images");
            let lift = gains.common.lift;
            assert!((lift - want).abs() < 1e-6, "radiance {radiance}: {lift}");
            assert_eq!(gains.common.factor, lift, "times the own exposure");
            assert_eq!(gains.views, [1.0], "alone");
            let got = decode(f64::from(views[0].color[0][0]));
            assert!((got - radiance * want).abs() < 1e-6, "radiance {radiance}: {got}");
        }
        let mut bare = shot(0.01, 1.0);
        bare.foreground = vec![0.0; 3];
        let before = bare.clone();
        let mut views = [bare];
        assert_eq!(equalise(&mut views).expect("valid images").common.lift, 1.0, "no foreground, no factor");
        assert_eq!(views[0], before, "bit for bit");
        assert!(equalise(&mut []).expect("none").views.is_empty(), "nothing to do");
    }

    #[test]
    fn an_image_that_comes_later_has_the_bits_that_it_would_have_among_the_others() {
        let all = || [0.3, 0.7, 1.9, 2.3].map(|e| shot(0.011, e));
        let mut together = all();
        let common = equalise(&mut together).expect("photographs").common;
        assert!(common.lift > 1.5, "dark: {}", common.lift);
        let mut later = all();
        expose(&mut later[2..], &common).expect("photographs");
        assert_eq!(later[2..], together[2..]);
    }

    #[test]
    fn bad_photographs_are_refused_and_none_is_changed() {
        let good = shot(0.1, 0.5);
        let spoil = |how: &dyn Fn(&mut Photograph)| {
            let mut bad = good.clone();
            how(&mut bad);
            let mut views = [good.clone(), bad];
            let e = equalise(&mut views).expect_err("out of range");
            assert_eq!(views[0], good, "unchanged");
            e.to_string()
        };
        assert!(
            spoil(&|p| p.color[1][2] = f32::NAN).starts_with("view 1: input image: pixel 1"),
            "a NaN is named"
        );
        assert!(spoil(&|p| p.foreground[2] = 1.5).contains("pixel 2"), "a coverage is named");
        for x in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(spoil(&|p| p.exposure = x).contains("exposure"), "exposure {x}");
        }
        assert!(spoil(&|p| p.foreground.truncate(2)).contains("2 for 3"), "sizes");
    }
}
