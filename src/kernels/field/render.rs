//! `field.render`: renders the rays of a crop through a field.
//!
//! Along a ray o + t·d, steps i = 0, 1, … of length δᵢ (see *Intervals*) have the density σᵢ and, at their
//! middles xᵢ, the values vᵢ (colour, albedo, roughness and metallic, normal):
//!
//! wᵢ = Tᵢ(1 − e^(−σᵢδᵢ)),   Tᵢ₊₁ = Tᵢ·e^(−σᵢδᵢ),   T₀ = 1          (Max 1995)
//! O = Σ wᵢ,   v = Σ wᵢvᵢ + T·b,   x̂ = Σ wᵢxᵢ / max(O, 0.98),   n̂ = N/‖N‖ with N = Σ wᵢnᵢ
//!
//! T is the transmittance behind the last sample: as in [`super::composite`], the background keeps what no
//! sample absorbs, which 1 − O in f32 would not resolve.
//!
//! With `least_weight` = τ, values are decoded where wᵢ ≥ τ, and the other samples have the values of the
//! background: vᵢ = b. Their weights count for O, x̂, n̂ and T as all others. Values change by at most Σ wᵢ|vᵢ − b|
//! over the samples below τ.
//!
//! s, σ and the heads are those of VolSDF (Yariv et al. 2021) on feature planes: [`super::fetch`],
//! [`super::sdf_head`], [`super::density`] or [`super::interval`], [`super::value_head`],
//! [`super::normal_head`], [`super::embed`], [`super::normal`].
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | o, d | `origins`, `directions` | (N, 3) | d of unit length; no gradient |
//! | | `planes` | (P, R, R, C) | P = 6 signed planes or 3 |
//! | | `panoramas` | (L, H, W, C') | optional; needs the heads ρ and normal, see *Directional embedding* |
//! | | `w…` of every head | (out, in) | without bias |
//! | β | `beta` | () | > 0 |
//! | v | `values` | (N, Q) | colour 3, albedo 3, roughness and metallic 2, normal 3: those that have a head |
//! | O | `opacity` | (N) | 0..1 |
//! | x̂ | `points` | (N, 3) | |
//! | n̂ | `normals` | (N, 3) | numerical normals; 0 where O ≤ 0.98 |
//!
//! # Intervals
//! A ray enters the box at t₀ (0 if it starts inside) and leaves it at t₁; its steps are [t₀ + ih, t₀ + (i+1)h]
//! with h = 2√3·R/`samples`, the last one cut at t₁. All of them take a sample, or those that an occupancy grid
//! keeps. `rule` determines σᵢ: `left` at the start of the step, `midpoint` at its middle, `analytic` the mean
//! density if s is linear between both ends; an end that two steps share is decoded once. With `early_stop` a
//! ray ends after the sample that brings T to that value or below.
//!
//! # Directional embedding
//! With panoramas the colour reads features ‖ h, and n·r behind them if its first layer has F + C' + 1 inputs: the
//! cosine between the normal of the normal head and the direction of reflection, without gradient. How much
//! is reflected depends on it (Fresnel). Wu et al. 2024 read it, LIRM does not.
//!
//! # Rounding
//! Values are left folds over the samples of a ray, and so is Σ wᵢ of those with the background's values, which is added to T. Gradients: a texel's is one left fold over rays, within a
//! ray over the points at which s is decoded (in order, then the stencils of numerical normals) and then the
//! middles; a weight's is such a fold over the rays of a block of 64, from +0, and the blocks are added by the
//! pairwise tree over the block index. β̄ and the gradient of the background are folded in f64. Neither threads
//! nor the number of rays per chunk (a multiple of 64) change a bit.
//!
//! # Kinks and domain
//! Those of the parts. At O = 0.98 a ray is not valid; at wᵢ = τ a sample has its own values. The plan contains
//! intervals, last samples and, with τ, which samples have their own values.
//!
//! # Adjoint
//! Deferred: nothing is saved but the sums of each ray, and every batch of rays is decoded again.
//! w̄ᵢ = v̄·(vᵢ − b) + Ō + x̄·xᵢ + N̄·nᵢ and σ̄ᵢδᵢ⁻¹ = w̄ᵢTᵢ₊₁ − Σ_{j>i} w̄ⱼwⱼ, then through densities, stencils and
//! heads to features, and from all features of a chunk to the planes. Where vᵢ = b the first term is 0, and b̄ takes wᵢ with T.
//!
//! Twin: `reference::field::render`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::field::fetch::{Combine, Planes};
//! use lastlight::field::network::Network;
//! use lastlight::field::render::{self, Heads, Plan, Rays, Scene, Settings};
//! // planes and weights of 0: a sphere of a tenth of the box, seen along the z axis, and a ray beside it
//! let (texels, w0, w1) = ([0.0; 12], [0.0; 3], [0.0; 1]);
//! let scene = Scene {
//!     rays: Rays { origins: &[[0.0, 0.0, -2.0], [0.5, 0.0, -2.0]], directions: &[[0.0, 0.0, 1.0]; 2] },
//!     planes: Planes { values: &texels, count: 3, side: 2, channels: 1, half_size: 1.0 },
//!     panoramas: None,
//!     heads: Heads {
//!         sdf: Network { weights: &[&w0, &w1], inputs: 3 },
//!         color: None,
//!         albedo: None,
//!         material: None,
//!         normal: None,
//!         rho: None,
//!     },
//!     beta: 0.002,
//!     settings: Settings { samples: 1000, ..Settings::default() },
//! };
//! let mut plan = Plan::new(scene.all_intervals());
//! let out = render::forward(&scene, &mut plan);
//! assert!(out.opacity[0] > 0.999 && out.opacity[1] < 1e-6);
//! assert!((out.points[0][2] + 0.1).abs() < 0.002); // the surface is at z = −0.1
//! ```

mod batch;
mod block;
mod decode;
mod gradient;
mod intervals;
mod nets;
mod scene;

pub use block::VALID;
pub use decode::HeadsBar;
pub use intervals::{Intervals, Rays};
pub use scene::{Channels, Heads, Out, OutBar, Plan, Rule, Scene, Settings};

use crate::num::{par, sum};
use block::{RAYS, Scratch};
use decode::Nets;
use gradient::BlockBar;
use std::cell::Cell;

/// Gradients; the adjoint adds to them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InBar {
    /// Shape (P, R, R, C).
    pub planes: Vec<f32>,
    /// Shape (L, H, W, C'), or empty.
    pub panoramas: Vec<f32>,
    /// Weights.
    pub heads: HeadsBar,
    /// Shape ().
    pub beta: f32,
    /// Shape ().
    pub background: f32,
}

impl InBar {
    /// Returns zeros in the shapes of the inputs.
    pub fn zeros_like(scene: &Scene<'_>) -> Self {
        Self {
            planes: vec![0.0; scene.planes.values.len()],
            panoramas: vec![0.0; scene.panoramas.as_ref().map_or(0, |p| p.values.len())],
            heads: Nets::new(&scene.heads).zeros(),
            beta: 0.0,
            background: 0.0,
        }
    }
}

/// Largest number of blocks whose cotangents of features are in memory at once: they stay in the third-level
/// cache (64 rays of 96 samples and 32 features take 0.8 MB).
const GROUP: usize = 16;

thread_local! {
    static SCRATCH: Cell<Scratch> = Cell::default();
}

/// Runs `work` with this thread's buffers.
fn with_scratch<T>(work: impl FnOnce(&mut Scratch) -> T) -> T {
    let mut scratch = SCRATCH.take();
    let result = work(&mut scratch);
    SCRATCH.set(scratch);
    result
}

/// Renders all rays, and stores the number of samples that each takes in the plan, if it is not there yet.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn forward(scene: &Scene<'_>, plan: &mut Plan) -> Out {
    let (nets, n) = (Nets::new(&scene.heads), scene.rays.len());
    assert_eq!(plan.intervals.rays(), n, "the plan has the rays of the crop");
    let fixed: &Plan = plan;
    let blocks = par::map(n.div_ceil(RAYS), |b| {
        let rays = b * RAYS..n.min((b + 1) * RAYS);
        with_scratch(|scratch| block::forward(scene, &nets, fixed, rays, scratch))
    });
    let (mut out, mut last, mut shaded) = (Out::default(), Vec::with_capacity(n), Vec::new());
    for sums in blocks {
        finish(scene, &sums, &mut out);
        last.extend(sums.taken);
        shaded.extend(sums.shaded);
    }
    if plan.last.is_empty() {
        plan.last = last;
    }
    if plan.shaded.is_empty() {
        plan.shaded = shaded;
    }
    out
}

/// Appends the outputs of the rays of a block.
fn finish(scene: &Scene<'_>, sums: &block::Sums, out: &mut Out) {
    let q = scene.channels().count();
    for (ray, opacity) in sums.opacity.iter().enumerate() {
        let rest = sums.rest[ray] * scene.settings.background;
        out.values.extend(sums.values[ray * q..(ray + 1) * q].iter().map(|v| v + rest));
        out.opacity.push(*opacity);
        out.rest.push(sums.rest[ray]);
        let divisor = if *opacity > VALID { *opacity } else { VALID };
        out.points.push(sums.points[ray].map(|x| x / divisor));
        if scene.settings.numerical_normals.is_some() {
            let n = sums.normals[ray];
            let length = ((n[0] * n[0] + n[1] * n[1]) + n[2] * n[2]).sqrt();
            let is_there = *opacity > VALID && length > 0.0;
            out.normals.push(if is_there { n.map(|x| x / length) } else { [0.0; 3] });
            out.lengths.push(if is_there { length } else { 0.0 });
        }
    }
}

/// Adds the gradients for the cotangents `out_bar` to `x_bar`, `chunk` rays at a time (rounded up to a multiple
/// of 64; this bounds the memory and changes no bit).
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn adjoint(
    scene: &Scene<'_>,
    plan: &Plan,
    out: &Out,
    out_bar: &OutBar<'_>,
    chunk: usize,
    x_bar: &mut InBar,
) {
    let (nets, n) = (Nets::new(&scene.heads), scene.rays.len());
    let blocks = n.div_ceil(RAYS);
    let group = chunk.div_ceil(RAYS).clamp(1, GROUP);
    let mut made: Vec<BlockBar> = (0..Ord::min(group, blocks)).map(|_| BlockBar::default()).collect();
    let mut sums = Vec::with_capacity(blocks);
    for first in (0..blocks).step_by(group) {
        let now = &mut made[..Ord::min(group, blocks - first)];
        par::each(now.iter_mut().collect(), |b, block| {
            let rays = (first + b) * RAYS..n.min((first + b + 1) * RAYS);
            with_scratch(|scratch| {
                gradient::block(scene, &nets, plan, rays, (out, out_bar), (scratch, block));
            });
        });
        let parts: Vec<_> = now.iter().map(|b| (&b.part, &b.features[..])).collect();
        scene.planes.scatter_parts(scene.settings.combine, &parts, &mut x_bar.planes);
        if let Some(panoramas) = &scene.panoramas {
            for b in &*now {
                panoramas.scatter(&b.places, &b.embedded, &mut x_bar.panoramas);
            }
        }
        sums.extend(now.iter_mut().map(|b| (std::mem::take(&mut b.heads), b.beta, b.background)));
    }
    let (heads, scalars): (Vec<HeadsBar>, Vec<[f64; 2]>) =
        sums.into_iter().map(|(heads, beta, background)| (heads, [beta, background])).unzip();
    add_heads(heads, &mut x_bar.heads);
    let tree = |k: usize| sum::tree_f64(&scalars.iter().map(|s| s[k]).collect::<Vec<_>>()) as f32;
    x_bar.beta += tree(0);
    x_bar.background += tree(1);
}

/// Adds the blocks of every weight by the pairwise tree.
fn add_heads(mut blocks: Vec<HeadsBar>, into: &mut HeadsBar) {
    let mut parts: Vec<Vec<Vec<f32>>> = into.arrays_mut().map(|_| Vec::with_capacity(blocks.len())).collect();
    for block in &mut blocks {
        for (part, array) in parts.iter_mut().zip(block.arrays_mut()) {
            part.push(std::mem::take(array));
        }
    }
    for (sum, part) in into.arrays_mut().zip(parts) {
        sum.iter_mut().zip(sum::tree_arrays(part)).for_each(|(sum, g)| *sum += g);
    }
}
