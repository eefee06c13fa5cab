//! How bright each moment is, and from where: one colour per Gaussian cannot follow a light that moves.
//!
//! x' = e^γ (x − (1 − α) b) + (1 − α) b,   γ (T, 3) from 0
//!
//! and, with colours of degree 0, before that c' = s·c with the shade s = max(¼, 1 + n·d), d (T, 3) from 0: light of the first order in the normal n of
//! the nearest point of the template. What the front shows of it says how bright the side is that the camera never sees.
//!
//! | symbol | shape | meaning |
//! |---|---|---|
//! | x, α, b | (H, W, 3), (H, W), (3) | render, its coverage, the background, which has no gain |
//! | γ | (T, 3) | logarithms of the gains; a moment the fit has not seen takes their mean |
//! | d | (T, 3) | where the light comes from, world axes, likewise |
//!
//! # Rounding
//! f32 per pixel; γ̄ per row in f64 from the left, rows by the pairwise tree.
//!
//! # Kinks and domain
//! A shade at ¼ has no gradient.
//!
//! # Adjoint
//! x̄ = e^γ x̄',  ᾱ −= Σ_c (1 − e^γ_c) b_c x̄'_c,  γ̄_c = Σ e^γ_c (x − (1 − α) b)_c x̄'_c;
//! c̄ = s c̄', s̄ = Σ_c c c̄', d̄ = Σ_g s̄_g n_g: sums over Gaussians from the left in f64.

use crate::num::{elem, sum};
use crate::optim::adam::{Adam, Rule};
use crate::splat::blend::Out;
use crate::{Error, Result};

/// Gains of every moment, and their optimiser.
#[derive(Clone, Debug)]
pub struct Light {
    /// (T) γ
    pub gains: Vec<[f32; 3]>,
    /// (T) d
    pub toward: Vec<[f32; 3]>,
    /// (T) whether a fit has pictures of it
    pub seen: Vec<bool>,
    /// of γ and d
    pub(super) adam: [Adam; 2],
}

/// γ and d of a moment, or their gradients.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moment {
    /// γ
    pub gain: [f32; 3],
    /// d
    pub toward: [f32; 3],
}

/// Least shade.
const LEAST: f32 = 0.25;

impl Light {
    /// No gain for T moments, all of them seen.
    ///
    /// # Errors
    /// Never.
    pub fn new(moments: usize) -> Result<Self> {
        let adam = || Adam::new(Rule::SPLAT, moments, 3);
        let zeros = || vec![[0.0; 3]; moments];
        Ok(Self { gains: zeros(), toward: zeros(), seen: vec![true; moments], adam: [adam()?, adam()?] })
    }

    /// γ and d of a moment; the means of those the fit has seen where it is none of them.
    pub fn at(&self, moment: Option<usize>) -> Moment {
        let own = moment.filter(|t| self.seen.get(*t) == Some(&true));
        let of = |all: &[[f32; 3]]| match own {
            Some(t) => all[t],
            None => std::array::from_fn(|c| {
                let seen = all.iter().zip(&self.seen).filter(|(_, seen)| **seen);
                let (sum, count) = seen.fold((0.0, 0usize), |(s, n), (g, _)| (s + f64::from(g[c]), n + 1));
                (sum / Ord::max(1, count) as f64) as f32
            }),
        };
        Moment { gain: of(&self.gains), toward: of(&self.toward) }
    }

    /// One step of the optimiser for a moment.
    ///
    /// # Errors
    /// A result that is not finite.
    pub(super) fn step(&mut self, moment: usize, bar: Moment, rate: f64) -> Result<()> {
        let mut active = vec![0; self.gains.len()];
        active[moment] = 1;
        let all = [(&mut self.gains, bar.gain), (&mut self.toward, bar.toward)];
        for ((values, bar), adam) in all.into_iter().zip(&mut self.adam) {
            let mut grad = vec![[0.0; 3]; values.len()];
            grad[moment] = bar;
            adam.step(values.as_flattened_mut(), grad.as_flattened(), &[rate], Some(&active))
                .map_err(|e: Error| e.within("light"))?;
        }
        Ok(())
    }
}

/// Shade of a normal.
pub(super) fn shade(normal: [f32; 3], toward: [f32; 3]) -> f32 {
    let s = 1.0 + ((normal[0] * toward[0] + normal[1] * toward[1]) + normal[2] * toward[2]);
    if s > LEAST { s } else { LEAST }
}

/// d̄ from the cotangents of the shades (G).
pub(super) fn shade_adjoint(normals: &[[f32; 3]], shades: &[f32], bar: &[f32]) -> [f32; 3] {
    let mut sum = [0.0f64; 3];
    for ((n, _), b) in normals.iter().zip(shades).zip(bar).filter(|((_, s), _)| **s > LEAST) {
        for c in 0..3 {
            sum[c] += f64::from(n[c]) * f64::from(*b);
        }
    }
    sum.map(|x| x as f32)
}

/// The picture with its gain.
pub(super) fn apply(out: &mut Out, background: [f32; 3], gain: [f32; 3]) {
    let g = gain.map(elem::exp);
    for (rgb, a) in out.image.chunks_exact_mut(3).zip(&out.alpha) {
        for c in 0..3 {
            let behind = (1.0 - a) * background[c];
            rgb[c] = g[c] * (rgb[c] - behind) + behind;
        }
    }
}

/// Turns the cotangent of the picture with its gain (already applied to `out`) into that of the render, adds to that of alpha, and gives γ̄.
pub(super) fn adjoint(
    out: &Out,
    width: usize,
    background: [f32; 3],
    gain: [f32; 3],
    image_bar: &mut [f32],
    alpha_bar: &mut [f32],
) -> [f32; 3] {
    let g = gain.map(elem::exp);
    let rows = image_bar.chunks_exact_mut(3 * width).zip(alpha_bar.chunks_exact_mut(width)).enumerate();
    let sums: Vec<[f64; 3]> = rows
        .map(|(r, (image_bar, alpha_bar))| {
            let mut row = [0.0f64; 3];
            for (i, (bar, alpha_bar)) in image_bar.chunks_exact_mut(3).zip(alpha_bar).enumerate() {
                let at = r * width + i;
                let uncovered = 1.0 - out.alpha[at];
                for c in 0..3 {
                    let lit = out.image[3 * at + c] - uncovered * background[c];
                    row[c] += f64::from(lit) * f64::from(bar[c]);
                    *alpha_bar -= (1.0 - g[c]) * background[c] * bar[c];
                    bar[c] *= g[c];
                }
            }
            row
        })
        .collect();
    std::array::from_fn(|c| sum::tree_f64(&sums.iter().map(|s| s[c]).collect::<Vec<f64>>()) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_moment_without_pictures_takes_the_mean_of_those_with() {
        let mut light = Light::new(4).expect("a light");
        light.gains = vec![[1.0, 0.0, 2.0], [9.0; 3], [3.0, 1.0, -2.0], [9.0; 3]];
        light.toward = vec![[0.5; 3], [9.0; 3], [0.25; 3], [9.0; 3]];
        light.seen = vec![true, false, true, false];
        assert_eq!(light.at(Some(2)), Moment { gain: [3.0, 1.0, -2.0], toward: [0.25; 3] });
        for moment in [Some(1), Some(3), Some(4), None] {
            assert_eq!(light.at(moment), Moment { gain: [2.0, 0.5, 0.0], toward: [0.375; 3] }, "{moment:?}");
        }
    }

    #[test]
    fn gains_differentiate() {
        let out = Out {
            image: (0..12).map(|i| 0.2 + 0.05 * i as f32).collect(),
            alpha: vec![1.0, 0.5, 0.25, 0.9],
            depth: vec![0.0; 4],
        };
        let (b, gain) = ([0.2, 0.4, 0.6], [0.1, -0.3, 0.2]);
        let seeds: Vec<f32> = (0..12).map(|i| ((i * 5) % 7) as f32 - 3.0).collect();
        let value = |out: &Out, gain| {
            let mut out = out.clone();
            apply(&mut out, b, gain);
            out.image.iter().zip(&seeds).fold(0.0, |s, (x, w)| s + f64::from(*x) * f64::from(*w))
        };
        let mut lit = out.clone();
        apply(&mut lit, b, gain);
        let (mut image_bar, mut alpha_bar) = (seeds.clone(), vec![0.0; 4]);
        let bar = adjoint(&lit, 2, b, gain, &mut image_bar, &mut alpha_bar);
        let h = 1e-2f32;
        let close = |got: f32, up: f64, down: f64| {
            let slope = (up - down) / (2.0 * f64::from(h));
            assert!((f64::from(got) - slope).abs() < 2e-3 * (1.0 + slope.abs()), "{got} against {slope}");
        };
        for c in 0..3 {
            let moved = |d: f32| value(&out, std::array::from_fn(|k| gain[k] + if k == c { d } else { 0.0 }));
            close(bar[c], moved(h), moved(-h));
        }
        for i in 0..4 {
            let moved = |d: f32| {
                let mut out = out.clone();
                out.alpha[i] += d;
                value(&out, gain)
            };
            close(alpha_bar[i], moved(h), moved(-h));
        }
        for i in 0..12 {
            let moved = |d: f32| {
                let mut out = out.clone();
                out.image[i] += d;
                value(&out, gain)
            };
            close(image_bar[i], moved(h), moved(-h));
        }
    }
}
