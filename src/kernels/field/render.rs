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
//! s, σ and the heads are those of VolSDF (Yariv et al. 2021) on feature planes: [`super::fetch`],
//! [`super::sdf_head`], [`super::density`] or [`super::interval`], [`super::value_head`],
//! [`super::normal_head`], [`super::embed`], [`super::normal`].
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | o, d | `origins`, `directions` | (N, 3) | d of unit length; no gradient |
//! | | `planes` | (P, R, R, C) | P = 6 signed planes or 3 |
//! | | `panoramas` | (L, H, W, C') | optional; needs the heads ρ and normal |
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
//! # Rounding
//! Values are left folds over the samples of a ray. Gradients: a texel's is one left fold over rays, within a
//! ray over the points at which s is decoded (in order, then the stencils of numerical normals) and then the
//! middles; a weight's is such a fold over the rays of a block of 64, from +0, and the blocks are added by the
//! pairwise tree over the block index. β̄ and the gradient of the background are folded in f64. Neither threads
//! nor the number of rays per chunk (a multiple of 64) change a bit.
//!
//! # Kinks and domain
//! Those of the parts. At O = 0.98 a ray is not valid. The plan contains intervals and last samples.
//!
//! # Adjoint
//! Deferred: nothing is saved but the sums of each ray, and every batch of rays is decoded again.
//! w̄ᵢ = v̄·(vᵢ − b) + Ō + x̄·xᵢ + N̄·nᵢ and σ̄ᵢδᵢ⁻¹ = w̄ᵢTᵢ₊₁ − Σ_{j>i} w̄ⱼwⱼ, then through densities, stencils and
//! heads to features, and from all features of a chunk to the planes.
//!
//! Twin: `reference::field::render`.

mod adjoint;
mod batch;
mod block;
mod decode;
mod intervals;
mod nets;

pub use decode::HeadsBar;
pub use intervals::{Intervals, Rays};

use super::embed::{Panoramas, Place};
use super::fetch::{Combine, Planes};
use super::network::Network;
use super::normal::Stencil;
use crate::num::{par, sum};
use adjoint::BlockBar;
pub use block::VALID;
use block::{RAYS, Scratch};
use decode::Nets;
use std::cell::Cell;

/// Where the density of a step is taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rule {
    /// At its start.
    Left,
    /// At its middle.
    #[default]
    Midpoint,
    /// The mean density of a signed distance that is linear between its ends.
    Analytic,
}

/// Settings.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Steps along the diagonal of the box.
    pub samples: usize,
    /// Where densities are taken.
    pub rule: Rule,
    /// Whether the features of planes are concatenated or added.
    pub combine: Combine,
    /// Transmittance at which rays stop.
    pub early_stop: Option<f32>,
    /// Stencil and distance ε of numerical normals, if there are any.
    pub numerical_normals: Option<(Stencil, f32)>,
    /// Background of all values.
    pub background: f32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            samples: 128,
            rule: Rule::Midpoint,
            combine: Combine::Concat,
            early_stop: None,
            numerical_normals: None,
            background: 1.0,
        }
    }
}

/// Networks of a field. A network of the signed distance with four outputs is a trunk, which also gives the
/// colour.
#[derive(Clone, Debug)]
pub struct Heads<'a> {
    /// Signed distance before its bound: 1 output, or 4 for a trunk.
    pub sdf: Network<'a>,
    /// Colour: features, or features ‖ h, to 3.
    pub color: Option<Network<'a>>,
    /// Albedo: 3.
    pub albedo: Option<Network<'a>>,
    /// Roughness and metallic: 2.
    pub material: Option<Network<'a>>,
    /// Normal: 3.
    pub normal: Option<Network<'a>>,
    /// Roughness of the embedding: 1.
    pub rho: Option<Network<'a>>,
}

/// First channel of every kind of value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Channels {
    /// Three channels.
    pub color: Option<usize>,
    /// Three channels.
    pub albedo: Option<usize>,
    /// Roughness, metallic.
    pub material: Option<usize>,
    /// Three channels.
    pub normal: Option<usize>,
}

impl Heads<'_> {
    /// Whether the first network also gives the colour.
    pub fn is_trunk(&self) -> bool {
        self.sdf.widths().last() == Some(&4)
    }

    /// Whether there is any value besides the signed distance.
    pub fn has_values(&self) -> bool {
        self.channels() != Channels::default()
    }

    /// Returns the channels of the values.
    pub fn channels(&self) -> Channels {
        let mut next = 0;
        let mut place = |is_there: bool, n: usize| {
            let at = next;
            next += if is_there { n } else { 0 };
            is_there.then_some(at)
        };
        Channels {
            color: place(self.is_trunk() || self.color.is_some(), 3),
            albedo: place(self.albedo.is_some(), 3),
            material: place(self.material.is_some(), 2),
            normal: place(self.normal.is_some(), 3),
        }
    }
}

/// Inputs.
#[derive(Clone, Debug)]
pub struct Scene<'a> {
    /// The rays of the crop.
    pub rays: Rays<'a>,
    /// Feature planes, with the half size of the box.
    pub planes: Planes<'a>,
    /// Panoramas of the directional embedding.
    pub panoramas: Option<Panoramas<'a>>,
    /// Networks.
    pub heads: Heads<'a>,
    /// Scale of the density.
    pub beta: f32,
    /// Settings.
    pub settings: Settings,
}

impl Scene<'_> {
    /// Returns the channels of the values.
    pub fn channels(&self) -> Channels {
        self.heads.channels()
    }

    /// Length of a step.
    pub fn step(&self) -> f32 {
        (2.0 * 3.0_f64.sqrt() * f64::from(self.planes.half_size) / self.settings.samples as f64) as f32
    }

    /// Returns all steps of all rays.
    pub fn all_intervals(&self) -> Intervals {
        Intervals::all(self.rays, self.planes.half_size, self.step())
    }
}

/// The discrete decisions: intervals, and the last sample of every ray.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    /// Steps that take a sample.
    pub intervals: Intervals,
    /// Number of samples taken per ray, (N); empty before the forward pass.
    pub last: Vec<u32>,
}

impl Plan {
    /// Returns a plan without last samples.
    pub fn new(intervals: Intervals) -> Self {
        Self { intervals, last: Vec::new() }
    }

    /// Returns the end of the samples that a ray takes.
    fn taken_end(&self, ray: usize) -> usize {
        match self.last.get(ray) {
            Some(n) => self.intervals.start[ray] + *n as usize,
            None => self.intervals.start[ray + 1],
        }
    }

    /// Number of samples taken.
    pub fn taken(&self) -> usize {
        self.last.iter().map(|n| *n as usize).sum()
    }
}

/// Outputs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Out {
    /// Shape (N, Q).
    pub values: Vec<f32>,
    /// Shape (N).
    pub opacity: Vec<f32>,
    /// Shape (N, 3).
    pub points: Vec<[f32; 3]>,
    /// Shape (N, 3); empty without numerical normals.
    pub normals: Vec<[f32; 3]>,
    /// ‖N‖ of the numerical normals, 0 where they are 0; shape (N).
    pub lengths: Vec<f32>,
    /// Transmittance behind the last sample, shape (N).
    pub transmittance: Vec<f32>,
}

/// Cotangents of the outputs.
#[derive(Clone, Copy, Debug, Default)]
pub struct OutBar<'a> {
    /// Shape (N, Q).
    pub values: &'a [f32],
    /// Shape (N), or empty for zeros.
    pub opacity: &'a [f32],
    /// Shape (N, 3), or empty for zeros.
    pub points: &'a [[f32; 3]],
    /// Shape (N, 3), or empty for zeros.
    pub normals: &'a [[f32; 3]],
}

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
    let (mut out, mut last) = (Out::default(), Vec::with_capacity(n));
    for sums in blocks {
        finish(scene, &sums, &mut out);
        last.extend(sums.taken);
    }
    if plan.last.is_empty() {
        plan.last = last;
    }
    out
}

/// Appends the outputs of the rays of a block.
fn finish(scene: &Scene<'_>, sums: &block::Sums, out: &mut Out) {
    let q = scene.channels().count();
    for (ray, opacity) in sums.opacity.iter().enumerate() {
        let rest = sums.through[ray] * scene.settings.background;
        out.values.extend(sums.values[ray * q..(ray + 1) * q].iter().map(|v| v + rest));
        out.opacity.push(*opacity);
        out.transmittance.push(sums.through[ray]);
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
    let per_chunk = chunk.div_ceil(RAYS).max(1);
    let blocks = n.div_ceil(RAYS);
    let mut sums = Vec::with_capacity(blocks);
    for first in (0..blocks).step_by(per_chunk) {
        let last = blocks.min(first + per_chunk);
        let made = par::map(last - first, |b| {
            let rays = (first + b) * RAYS..n.min((first + b + 1) * RAYS);
            with_scratch(|scratch| adjoint::adjoint(scene, &nets, plan, rays, (out, out_bar), scratch))
        });
        let all =
            |part: &dyn Fn(&BlockBar) -> &[f32]| made.iter().flat_map(part).copied().collect::<Vec<f32>>();
        let points: Vec<[f32; 3]> = made.iter().flat_map(|b| &b.points).copied().collect();
        let features = all(&|b| &b.features);
        scene.planes.scatter(scene.settings.combine, &points, &features, &mut x_bar.planes);
        if let Some(panoramas) = &scene.panoramas {
            let places: Vec<Place> = made.iter().flat_map(|b| &b.places).copied().collect();
            panoramas.scatter(&places, &all(&|b| &b.embedded), &mut x_bar.panoramas);
        }
        sums.extend(made.into_iter().map(|b| (b.heads, b.beta, b.background)));
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
