//! What one camera cannot see, and what is assumed of it: neighbours look alike, Gaussians are about as deep as they are wide and stay at the template.
//!
//! P = Σ_a w_a/(G K) Σ_g Σ_{h ∈ near(g)} ‖a_g − a_h‖²  +  w_r/G Σ_g Σ_k (s_gk − s̄_g)²
//!   + w_f/G Σ_g (s̄_g − ln(κ d_g))²  +  w_t/G Σ_g ‖x_g − t_g‖²/r²  −  w_o/G Σ_g σ(l_g)
//!
//! | symbol | meaning |
//! |---|---|
//! | a | constant colour coefficients, opacity logit, logarithms of the scales; a weight each |
//! | d, κ | root mean squared distance to the three nearest Gaussians, found with them; how far a Gaussian reaches into the gap |
//! | σ(l) | opacity |
//! | near(g) | the K = 6 nearest Gaussians in the canonical pose, found when the number of Gaussians last changed |
//! | s, s̄ | logarithms of the scales and their mean |
//! | x, t, r | centre, nearest point of the template, distance beyond which Gaussians are removed |
//!
//! A Gaussian that the camera sees has a far larger gradient from the pictures; one that it never sees has this one alone, and Adam gives it the full
//! rate: colour, opacity and size spread over the hidden side from its border. Without it the back of a person who never turns round stays as it
//! began, grey and nearly transparent.
//!
//! # Rounding
//! f64 sums over Gaussians from the left; gradients in f32, Gaussian by Gaussian, neighbour by neighbour.

use super::avatar::Avatar;
use crate::math::knn;
use crate::num::{elem, order};
use crate::scene::gaussians::Gaussians;
use crate::{Error, Result};
use serde_json::{Value, json};

/// K
pub const NEAR: usize = 6;

/// Weights; all 0 is the published host.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// likeness of colours
    pub color: f32,
    /// likeness of opacity logits
    pub opacity: f32,
    /// likeness of sizes
    pub scale: f32,
    /// roundness
    pub round: f32,
    /// size as the gaps to neighbours are
    pub fill: f32,
    /// κ
    pub reach: f32,
    /// nearness to the template
    pub anchor: f32,
    /// opacity
    pub solid: f32,
}

impl Prior {
    /// Nothing is assumed.
    pub const NONE: Self = Self {
        color: 0.0,
        opacity: 0.0,
        scale: 0.0,
        round: 0.0,
        fill: 0.0,
        reach: 1.0,
        anchor: 0.0,
        solid: 0.0,
    };

    fn named(&self) -> [(&'static str, f32); 8] {
        [
            ("prior_color", self.color),
            ("prior_opacity", self.opacity),
            ("prior_scale", self.scale),
            ("prior_round", self.round),
            ("prior_fill", self.fill),
            ("prior_anchor", self.anchor),
            ("prior_solid", self.solid),
            ("prior_reach", self.reach),
        ]
    }

    pub(super) fn validate(&self) -> Result<()> {
        if !(self.reach > 0.0) {
            return Err(Error::input("prior_reach").expected("above 0").got(self.reach.to_string()));
        }
        match self.named().into_iter().find(|(_, w)| !(*w >= 0.0 && w.is_finite())) {
            Some((name, w)) => {
                Err(Error::input(name).expected("a finite weight, not negative").got(w.to_string()))
            }
            None => Ok(()),
        }
    }

    pub(super) fn describe(&self, record: &mut Value) {
        for (name, w) in self.named() {
            record[name] = json!(w);
        }
    }
}

/// Who is near whom: found when the number of Gaussians changes, and part of the state until then.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Near {
    /// (G) the nearest of each; `u32::MAX` where there are fewer
    pub(super) of: Vec<[u32; NEAR]>,
    /// (G) ln d
    pub(super) gap: Vec<f32>,
}

/// Squared gap below which the logarithm is not taken.
const LEAST_SQUARE: f64 = 1e-12;

impl Near {
    /// Of these Gaussians.
    ///
    /// # Errors
    /// When a centre is not finite.
    pub(super) fn new(g: &Gaussians) -> Result<Self> {
        let found = knn::neighbours::<NEAR>(&g.means)?;
        let gap = found.iter().map(|n| {
            let there = n[..3].iter().filter(|(_, i)| *i != u32::MAX);
            let (sum, count) = there.fold((0.0, 0.0), |(s, c), (d, _)| (s + d, c + 1.0));
            (0.5 * libm::log(order::max(sum / order::max(count, 1.0), LEAST_SQUARE))) as f32
        });
        Ok(Self { gap: gap.collect(), of: found.iter().map(|n| n.map(|(_, i)| i)).collect() })
    }
}

/// Adds the gradient; gives P. `most` is r, scene units.
pub(super) fn add(prior: &Prior, avatar: &Avatar, near: &Near, most: f64, grad: &mut Gaussians) -> f64 {
    if *prior == Prior::NONE {
        return 0.0;
    }
    let g = &avatar.gaussians;
    let n = g.len();
    let (pairs, each) = ((n * NEAR) as f32, n as f32);
    let width = 3 * g.sh_coefficients();
    let mut sums = [0.0f64; 7];
    let weights = [prior.color, prior.opacity, prior.scale].map(|w| 2.0 * w / pairs);
    for (i, near) in near.of.iter().enumerate() {
        for &j in near.iter().filter(|j| **j != u32::MAX) {
            let j = j as usize;
            for c in 0..3 {
                let d = g.sh[i * width + c] - g.sh[j * width + c];
                sums[0] += f64::from(d) * f64::from(d);
                grad.sh[i * width + c] += weights[0] * d;
                grad.sh[j * width + c] -= weights[0] * d;
                let d = g.scales_log[i][c] - g.scales_log[j][c];
                sums[2] += f64::from(d) * f64::from(d);
                grad.scales_log[i][c] += weights[2] * d;
                grad.scales_log[j][c] -= weights[2] * d;
            }
            let d = g.opacity_logits[i] - g.opacity_logits[j];
            sums[1] += f64::from(d) * f64::from(d);
            grad.opacity_logits[i] += weights[1] * d;
            grad.opacity_logits[j] -= weights[1] * d;
        }
    }
    let most2 = (most * most) as f32;
    let ln_reach = elem::ln(prior.reach);
    for i in 0..n {
        let s = g.scales_log[i];
        let mean = ((s[0] + s[1]) + s[2]) / 3.0;
        let lack = mean - (near.gap[i] + ln_reach);
        sums[4] += f64::from(lack) * f64::from(lack);
        let t = avatar.body.points[avatar.nearest[i] as usize];
        for c in 0..3 {
            let d = s[c] - mean;
            sums[3] += f64::from(d) * f64::from(d);
            grad.scales_log[i][c] += 2.0 * prior.round / each * d + 2.0 * prior.fill / (3.0 * each) * lack;
            let d = g.means[i][c] - t[c];
            sums[5] += f64::from(d) * f64::from(d) / (most * most);
            grad.means[i][c] += 2.0 * prior.anchor / each * d / most2;
        }
        let o = elem::sigmoid(g.opacity_logits[i]);
        sums[6] -= f64::from(o);
        grad.opacity_logits[i] -= prior.solid / each * (o * (1.0 - o));
    }
    let named = prior.named();
    (0..7).fold(0.0, |p, k| p + f64::from(named[k].1) * sums[k] / f64::from(if k < 3 { pairs } else { each }))
}
