//! `splat.render`: renders Gaussians with the chain project → color → plan → blend, and its adjoint, for C
//! cameras of one image size.
//!
//! | argument | shape | meaning |
//! |---|---|---|
//! | `means` | (N, 3) | centres, scene units |
//! | `shape` | quats (N, 4) + scales (N, 3), or factors (N, 3, 3) | Σ = R S Sᵀ Rᵀ or F Fᵀ |
//! | `opacities` | (N) | 0..1 |
//! | `color` | sh (N, K, 3) or rgb (N, 3) | sRGB-encoded |
//! | `cameras` | (C) | see [`Camera`](crate::scene::camera::Camera) |
//! | `background` | (3) | sRGB-encoded |
//! | → `image`, `alpha`, `depth` | (C, H, W, 3), (C, H, W) ×2 | see [`super::blend`] |
//!
//! Equations, kinks and rounding are those of the stages. This file contains the loops: over blocks of
//! [`BLOCK`] Gaussians (which change no bit: Gaussians are independent up to `plan`, and again after the
//! records are summed) and over cameras. Gradients of several cameras are added camera by camera, in order.
//! `inputs` and `gradients` contain the input and gradient arrays.
//!
//! # Adjoint
//! The records of blend are converted per Gaussian, in slot order, and then pass through project, color →
//! factors → covariance. Stages are recomputed from the inputs; the saved values are the projected rows, the
//! clamp masks of the colours, the plan, and T and last index per pixel.
//!
//! Twin: `reference::splat::render`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::scene::camera::{Camera, Model};
//! use lastlight::splat::render::{Color, In, InBar, OutBar, Settings, Shape, adjoint, forward};
//! let camera = Camera {
//!     rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
//!     translation: [0.0; 3],
//!     focal_px: [40.0; 2],
//!     center_px: [8.5; 2],
//!     width: 16,
//!     height: 16,
//!     model: Model::Pinhole,
//! };
//! let x = In {
//!     means: &[[0.0, 0.0, 4.0]],
//!     shape: Shape::QuatScale { quats: &[[1.0, 0.0, 0.0, 0.0]], scales: &[[0.2, 0.1, 0.1]] },
//!     opacities: &[0.5],
//!     color: Color::Rgb(&[[1.0, 0.5, 0.0]]),
//!     cameras: &[camera],
//!     background: [0.0, 0.0, 1.0],
//! };
//! let settings = Settings::default();
//! x.validate(&settings)?;
//! let (out, saved) = forward(&x, &settings);
//! // the centre is projected to (8.5, 8.5), the centre of pixel (8, 8), where α is the opacity
//! let at = 3 * (8 * 16 + 8);
//! assert_eq!(out.image[at..at + 3], [0.5, 0.25, 0.5]); // ½·colour + ½·background
//! // the loss is the red of that pixel, α·1 + (1 − α)·0 with α = opacity·1
//! let mut image_bar = vec![0.0; out.image.len()];
//! image_bar[at] = 1.0;
//! let mut bar = InBar::zeros_like(&x);
//! adjoint(&x, &settings, &saved, OutBar { image: Some(&image_bar), ..OutBar::default() }, &mut bar);
//! assert!((bar.opacities[0] - 1.0).abs() < 1e-6);
//! # Ok::<(), lastlight::Error>(())
//! ```

mod gradients;
mod inputs;

pub use super::blend::{Out, OutBar};
pub use gradients::{BLOCK, InBar};
pub use inputs::{Color, In, Settings, Shape};

use super::blend::{self, FrozenMasks, Record, SplatBar};
use super::plan::{self, Plan, Splat};
use super::project::{self, Decision, Lens, Row, RowBar};
use super::{color, covariance};
use crate::num::par;
use gradients::{Block, blocks};

/// Stored discrete decisions that replace new ones; the arrays are those of a stored plan.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frozen {
    /// Order, tile lists and slots.
    pub plan: Plan,
    /// Visibility, limits and pivots, shape (C, N).
    pub decisions: Vec<Decision>,
    /// Clamp mask of the colours, shape (C, N, 3), 1 = unclamped; empty with rgb.
    pub color_mask: Vec<[u8; 3]>,
    /// Last index per pixel, shape (C, H, W); see [`FrozenMasks`].
    pub last_index: Vec<f32>,
    /// Mask of contributions, shape (E, 32); see [`FrozenMasks`].
    pub alpha_mask: Vec<[u8; 32]>,
    /// Mask of the cap, shape (E, 32); see [`FrozenMasks`].
    pub cap_mask: Vec<[u8; 32]>,
}

impl Frozen {
    fn masks(&self) -> FrozenMasks<'_> {
        FrozenMasks { last_index: &self.last_index, alpha: &self.alpha_mask, cap: &self.cap_mask }
    }
}

/// Intermediate values that the adjoint needs; their memory is reused if they are passed to [`forward_into`]
/// again.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Saved {
    /// Projected rows, shape (C, N).
    pub rows: Vec<Row>,
    /// Splats that were blended, shape (C, N).
    pub splats: Vec<Splat>,
    /// Clamp mask of the colours, shape (C, N, 3), 1 = unclamped; empty with rgb.
    pub color_mask: Vec<[u8; 3]>,
    /// Order, tile lists and slots.
    pub plan: Plan,
    /// Transmittance T and last index per pixel.
    pub pixels: blend::Saved,
}

impl Saved {
    /// Returns the half-widths of the footprints in pixels (C, N, 2); 0 if a footprint covers no pixel.
    pub fn radii(&self) -> Vec<[i32; 2]> {
        self.rows.iter().map(|r| r.radii).collect()
    }
}

/// Memory of [`adjoint_into`] that can be reused between calls.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    records: Vec<Record>,
}

/// Renders the images; see [`forward_into`].
pub fn forward(x: &In<'_>, settings: &Settings) -> (Out, Saved) {
    let (mut out, mut saved) = (Out::default(), Saved::default());
    forward_into(x, settings, None, &mut out, &mut saved);
    (out, saved)
}

/// Renders into existing memory; `frozen` contains decisions that replace new ones.
///
/// The inputs must have passed [`In::validate`].
pub fn forward_into(
    x: &In<'_>,
    settings: &Settings,
    frozen: Option<&Frozen>,
    out: &mut Out,
    saved: &mut Saved,
) {
    project_all(x, settings, frozen, saved);
    saved.plan = match frozen {
        Some(f) => f.plan.clone(),
        None => {
            let grid = x.grid(settings);
            plan::build(&saved.splats, x.cameras.len(), &grid, &settings.profile, settings.cull)
        }
    };
    blend::forward(&blend_in(x, settings, frozen, &saved.splats, &saved.plan), out, &mut saved.pixels);
}

/// Returns the inputs of `blend`: parts of the inputs, the projected splats and their plan.
fn blend_in<'a>(
    x: &In<'a>,
    settings: &'a Settings,
    frozen: Option<&'a Frozen>,
    splats: &'a [Splat],
    plan: &'a Plan,
) -> blend::In<'a> {
    blend::In {
        splats,
        n: x.means.len(),
        plan,
        grid: x.grid(settings),
        profile: &settings.profile,
        background: x.background,
        cull: settings.cull,
        frozen: frozen.map(Frozen::masks),
    }
}

/// Computes rows, colours and splats of every camera, block by block.
pub fn project_all(x: &In<'_>, settings: &Settings, frozen: Option<&Frozen>, saved: &mut Saved) {
    let (n, cameras) = (x.means.len(), x.cameras.len());
    saved.rows.resize(cameras * n, Row::default());
    saved.splats.resize(cameras * n, Splat::default());
    saved.color_mask.resize(if matches!(x.color, Color::Sh(_)) { cameras * n } else { 0 }, [0; 3]);
    for (c, camera) in x.cameras.iter().enumerate() {
        let (lens, center) = (Lens::new(camera, &settings.profile), camera.center());
        let span = c * n..(c + 1) * n;
        let rows = saved.rows[span.clone()].chunks_mut(BLOCK);
        let splats = saved.splats[span.clone()].chunks_mut(BLOCK);
        let mut masks = saved.color_mask.get_mut(span.clone()).map(|m| m.chunks_mut(BLOCK));
        let tasks: Vec<_> = rows
            .zip(splats)
            .map(|(r, s)| (r, s, masks.as_mut().and_then(Iterator::next).unwrap_or_default()))
            .collect();
        par::each(tasks, |b, (rows, splats, mask)| {
            let (from, to) = (b * BLOCK, b * BLOCK + rows.len());
            let mut buffer = Vec::new();
            let decisions = frozen.map(|f| &f.decisions[c * n + from..c * n + to]);
            let gaussians = project::In {
                means: &x.means[from..to],
                factors: x.factors(from, to, &mut buffer),
                opacities: &x.opacities[from..to],
                lens: &lens,
                profile: &settings.profile,
            };
            project::forward(&gaussians, decisions, rows);
            let mut made = Vec::new();
            let colors = match x.color {
                Color::Rgb(rgb) => &rgb[from..to],
                Color::Sh(sh) => {
                    made.resize(to - from, [0.0; 3]);
                    let kept = frozen.map(|f| &f.color_mask[c * n + from..c * n + to]);
                    color::forward(gaussians.means, sh.rows(from, to), center, kept, &mut made, mask);
                    &made
                }
            };
            for (i, splat) in splats.iter_mut().enumerate() {
                let row = &rows[i];
                *splat = if row.visible {
                    let opacity = gaussians.opacities[i] * row.compensation;
                    Splat::new(row.mean_px, row.shape, row.axis, row.z, opacity, colors[i], row.cut)
                } else {
                    Splat::default()
                };
            }
        });
    }
}

/// Adds the gradients for the cotangents `out_bar` to `x_bar`; see [`adjoint_into`].
pub fn adjoint(x: &In<'_>, settings: &Settings, saved: &Saved, out_bar: OutBar<'_>, x_bar: &mut InBar) {
    adjoint_into(x, settings, None, saved, out_bar, x_bar, &mut Scratch::default());
}

/// Adds the gradients for the cotangents `out_bar` to `x_bar`, reusing memory; `frozen` as in
/// [`forward_into`].
pub fn adjoint_into(
    x: &In<'_>,
    settings: &Settings,
    frozen: Option<&Frozen>,
    saved: &Saved,
    out_bar: OutBar<'_>,
    x_bar: &mut InBar,
    scratch: &mut Scratch,
) {
    let (n, cameras) = (x.means.len(), x.cameras.len());
    let blended = blend_in(x, settings, frozen, &saved.splats, &saved.plan);
    let background_bar =
        blend::adjoint(&blended, &saved.pixels, out_bar, settings.absgrad, &mut scratch.records);
    for (sum, b) in x_bar.background.iter_mut().zip(background_bar) {
        *sum += b;
    }
    x_bar.means_px.resize(cameras * n, [0.0; 2]);
    x_bar.means_px_abs.resize(if settings.absgrad { cameras * n } else { 0 }, [0.0; 2]);
    let lenses: Vec<(Lens, [f32; 3])> =
        x.cameras.iter().map(|c| (Lens::new(c, &settings.profile), c.center())).collect();
    let inputs = AdjointIn { x, settings, saved, records: &scratch.records, lenses: &lenses };
    par::each(blocks(x, x_bar), |b, mut block| adjoint_block(&inputs, b * BLOCK, &mut block));
}

/// Inputs of the adjoint of every block of Gaussians.
struct AdjointIn<'a> {
    x: &'a In<'a>,
    settings: &'a Settings,
    saved: &'a Saved,
    /// Records of `blend`, shape (E).
    records: &'a [Record],
    /// Lenses with the camera centres in scene units, shape (C).
    lenses: &'a [(Lens, [f32; 3])],
}

/// Adds the gradients of the Gaussians from index `from` on, as many as `block` has.
fn adjoint_block(a: &AdjointIn<'_>, from: usize, block: &mut Block<'_>) {
    let (x, n, len) = (a.x, a.x.means.len(), block.means.len());
    let to = from + len;
    let mut buffer = Vec::new();
    let factors = x.factors(from, to, &mut buffer);
    let mut factors_bar = vec![[0.0; 9]; len];
    let mut bars = ProjectedBars { rows: vec![RowBar::default(); len], colors: vec![[0.0; 3]; len] };
    for (c, (lens, center)) in a.lenses.iter().enumerate() {
        let at = c * n + from;
        bars.blend_adjoint(a, c, from, block);
        let (means, opacities) = (&x.means[from..to], &x.opacities[from..to]);
        let gaussians = project::In { means, factors, opacities, lens, profile: &a.settings.profile };
        let x_bar = project::InBar { means: &mut *block.means, factors: &mut factors_bar };
        project::adjoint(&gaussians, &a.saved.rows[at..at + len], &bars.rows, x_bar);
        match x.color {
            Color::Sh(sh) => {
                let mask = &a.saved.color_mask[at..at + len];
                color::adjoint(means, sh.rows(from, to), *center, mask, &bars.colors, block.means, block.sh);
            }
            Color::Rgb(_) => add(block.rgb, &bars.colors),
        }
    }
    match x.shape {
        Shape::QuatScale { quats, scales } => {
            let (quats, scales) = (&quats[from..to], &scales[from..to]);
            covariance::adjoint_rows(quats, scales, &factors_bar, block.quats, block.scales);
        }
        Shape::Factors(_) => add(block.factors, &factors_bar),
    }
}

/// Adds `rows` to `sums`.
fn add<const M: usize>(sums: &mut [[f32; M]], rows: &[[f32; M]]) {
    for (sum, row) in sums.iter_mut().zip(rows) {
        for k in 0..M {
            sum[k] += row[k];
        }
    }
}

/// Cotangents of one block of Gaussians as projected into one image.
struct ProjectedBars {
    /// Cotangents of the projected rows.
    rows: Vec<RowBar>,
    /// Cotangents of the colours.
    colors: Vec<[f32; 3]>,
}

impl ProjectedBars {
    /// Overwrites the cotangents with those of camera `c`, computed from the records of `blend`. Also writes
    /// the statistics of ū to `block`, and adds the gradients of the opacities there.
    fn blend_adjoint(&mut self, a: &AdjointIn<'_>, c: usize, from: usize, block: &mut Block<'_>) {
        let (saved, at) = (a.saved, c * a.x.means.len() + from);
        for i in 0..block.means.len() {
            // Adjoint of blend: the records of this Gaussian in slot order.
            let bar = blend::gather_records(&saved.plan, &saved.pixels.rows, a.records, at + i)
                .map_or_else(SplatBar::default, |sums| SplatBar::new(&saved.splats[at + i], sums));
            block.means_px[c][i] = bar.mean_px;
            if let Some(abs) = block.means_px_abs.get_mut(c) {
                abs[i] = bar.mean_px_abs;
            }
            // Adjoint of o_blended = o ρ.
            block.opacities[i] += bar.opacity * saved.rows[at + i].compensation;
            self.rows[i] = RowBar {
                mean_px: bar.mean_px,
                z: bar.z,
                shape: bar.shape,
                compensation: bar.opacity * a.x.opacities[from + i],
            };
            self.colors[i] = bar.color;
        }
    }
}
