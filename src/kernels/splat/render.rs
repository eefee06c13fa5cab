//! Renders Gaussians: the chain project → color → plan → blend, and its adjoint, for C cameras of one picture size.
//!
//! | argument | shape | meaning |
//! |---|---|---|
//! | `means` | (N, 3) | centres, scene units |
//! | `shape` | quats (N, 4) + scales (N, 3), or factors (N, 3, 3) | Σ = R S Sᵀ Rᵀ or F Fᵀ |
//! | `opacities` | (N) | 0..1 |
//! | `color` | sh (N, K, 3) or rgb (N, 3) | sRGB-encoded |
//! | `cameras` | (C) | see [`Camera`] |
//! | `background` | (3) | sRGB-encoded |
//! | → `image`, `alpha`, `depth` | (C, H, W, 3), (C, H, W) ×2 | see [`super::blend`] |
//!
//! Equations, kinks and rounding are those of the stages. This file owns the loops: over blocks of [`BLOCK`] Gaussians
//! (which change no bit: Gaussians are independent up to `plan`, and again after the records are summed) and over
//! cameras. Gradients of several cameras are added camera by camera, in order.
//!
//! # Adjoint
//! blend's records → per Gaussian, in slot order → project, color → factors → covariance. Stages are recomputed from the
//! inputs; what is saved are the projected rows, colours' floor masks, the plan, and T and last index per pixel.
//!
//! Twin: `reference::splat::render`.

use super::blend::{self, FrozenMasks, Record, SplatBar};
use super::color::{self, Sh};
use super::covariance;
use super::plan::{self, Grid, Plan, Splat};
use super::project::{self, Decision, Lens, Row, RowBar};
use crate::num::par;
use crate::scene::camera::Camera;
use crate::scene::profile::Profile;
use crate::{Error, Result};

pub use super::blend::{Out, OutBar};

/// Gaussians per task.
pub const BLOCK: usize = 512;

/// Shape of the Gaussians.
#[derive(Clone, Copy, Debug)]
pub enum Shape<'a> {
    /// Rotation and scales.
    QuatScale {
        /// (N, 4) wxyz, any length but zero
        quats: &'a [[f32; 4]],
        /// (N, 3) linear
        scales: &'a [[f32; 3]],
    },
    /// (N, 3, 3) row-major, Σ = F Fᵀ
    Factors(&'a [[f32; 9]]),
}

/// Colour of the Gaussians.
#[derive(Clone, Copy, Debug)]
pub enum Color<'a> {
    /// Spherical harmonics.
    Sh(Sh<'a>),
    /// (N, 3)
    Rgb(&'a [[f32; 3]]),
}

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// (N, 3)
    pub means: &'a [[f32; 3]],
    /// Rotation and scales, or factors.
    pub shape: Shape<'a>,
    /// (N) in 0..1
    pub opacities: &'a [f32],
    /// Spherical harmonics or rgb.
    pub color: Color<'a>,
    /// (C), one picture size
    pub cameras: &'a [Camera],
    /// (3)
    pub background: [f32; 3],
}

/// How to render.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Constants of the semantics.
    pub profile: Profile,
    /// Tile side: 16, or 8 and 32 for pictures only. Never visible in the result.
    pub tile: usize,
    /// Skip by exact ellipses. Never visible in the result.
    pub cull: bool,
    /// Also sum |∂L/∂u| over pixels in the adjoint.
    pub absgrad: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self { profile: Profile::EXACT, tile: 16, cull: true, absgrad: false }
    }
}

/// Gradients; [`adjoint`] adds into them. Vectors that do not belong to the chosen shape and colour stay empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InBar {
    /// (N, 3)
    pub means: Vec<[f32; 3]>,
    /// (N, 4)
    pub quats: Vec<[f32; 4]>,
    /// (N, 3)
    pub scales: Vec<[f32; 3]>,
    /// (N, 3, 3)
    pub factors: Vec<[f32; 9]>,
    /// (N)
    pub opacities: Vec<f32>,
    /// (N, K, 3)
    pub sh: Vec<f32>,
    /// (N, 3)
    pub rgb: Vec<[f32; 3]>,
    /// (3)
    pub background: [f32; 3],
    /// (C, N, 2) ∂L/∂u in 1/pixels: a statistic for density control, overwritten.
    pub means_px: Vec<[f32; 2]>,
    /// (C, N, 2) Σ over pixels of |∂L/∂u|, overwritten, with `Settings::absgrad` only.
    pub means_px_abs: Vec<[f32; 2]>,
}

impl InBar {
    /// Zeros in the shapes of `x`.
    pub fn zeros_like(x: &In<'_>) -> Self {
        let mut bar = Self::default();
        bar.reset(x);
        bar
    }

    /// Zeros in the shapes of `x`, in the memory already there.
    pub fn reset(&mut self, x: &In<'_>) {
        fn zero<T: Clone + Default + Send>(v: &mut Vec<T>, n: usize) {
            v.resize(n, T::default());
            par::chunks_mut(v, 1 << 16, |_, c| c.fill(T::default()));
        }
        let n = x.means.len();
        zero(&mut self.means, n);
        zero(&mut self.opacities, n);
        let (quat_scale, factors) = match x.shape {
            Shape::QuatScale { .. } => (n, 0),
            Shape::Factors(_) => (0, n),
        };
        zero(&mut self.quats, quat_scale);
        zero(&mut self.scales, quat_scale);
        zero(&mut self.factors, factors);
        let (sh, rgb) = match x.color {
            Color::Sh(sh) => (sh.values.len(), 0),
            Color::Rgb(_) => (0, n),
        };
        zero(&mut self.sh, sh);
        zero(&mut self.rgb, rgb);
        self.background = [0.0; 3];
        self.means_px.clear();
        self.means_px_abs.clear();
    }
}

/// Discrete decisions to follow instead of making them; see `definitions` of the plan.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frozen {
    /// Order, tile lists, slots.
    pub plan: Plan,
    /// (C, N)
    pub decisions: Vec<Decision>,
    /// (C, N, 3) 1 = colour not floored; empty with rgb
    pub color_mask: Vec<[u8; 3]>,
    /// (C, H, W)
    pub last_index: Vec<f32>,
    /// (E, 32)
    pub alpha_mask: Vec<[u8; 32]>,
    /// (E, 32)
    pub cap_mask: Vec<[u8; 32]>,
}

impl Frozen {
    fn masks(&self) -> FrozenMasks<'_> {
        FrozenMasks { last_index: &self.last_index, alpha: &self.alpha_mask, cap: &self.cap_mask }
    }
}

/// What the adjoint needs; memory is reused when passed to [`forward_into`] again.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Saved {
    /// (C, N) projected rows
    pub rows: Vec<Row>,
    /// (C, N) what was blended
    pub splats: Vec<Splat>,
    /// (C, N, 3) 1 = colour not floored; empty with rgb
    pub color_mask: Vec<[u8; 3]>,
    /// Order, tile lists, slots.
    pub plan: Plan,
    /// T and last index per pixel.
    pub pixels: blend::Saved,
}

impl Saved {
    /// (C, N, 2) footprint half-widths in pixels, 0 = touches no pixel.
    pub fn radii(&self) -> Vec<[i32; 2]> {
        self.rows.iter().map(|r| r.radii).collect()
    }
}

/// Memory of [`adjoint_into`] that is worth keeping between calls.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    records: Vec<Record>,
}

impl In<'_> {
    /// Checks that lengths agree, cameras share one picture size, and the settings fit.
    ///
    /// # Errors
    /// Names the array.
    pub fn validate(&self, settings: &Settings) -> Result<()> {
        let n = self.means.len();
        let length = |name: &str, got: usize| {
            if got == n {
                Ok(())
            } else {
                Err(Error::input("splat.render")
                    .at(name)
                    .expected(format!("N = {n} rows"))
                    .got(got.to_string()))
            }
        };
        length("opacities", self.opacities.len())?;
        match self.shape {
            Shape::QuatScale { quats, scales } => {
                length("quats", quats.len())?;
                length("scales", scales.len())?;
            }
            Shape::Factors(f) => length("factors", f.len())?,
        }
        match self.color {
            Color::Sh(sh) => {
                length("sh", sh.values.len() / (3 * sh.coefficients))?;
                if (sh.degree + 1) * (sh.degree + 1) > sh.coefficients
                    || sh.degree > crate::math::sh::MAX_DEGREE
                {
                    return Err(Error::input("splat.render")
                        .at("sh_degree")
                        .expected(format!("at most 3, with (degree+1)² ≤ K = {}", sh.coefficients))
                        .got(sh.degree.to_string()));
                }
            }
            Color::Rgb(rgb) => length("rgb", rgb.len())?,
        }
        let Some(first) = self.cameras.first() else {
            return Err(Error::input("splat.render").at("cameras").expected("at least one").got("none"));
        };
        for camera in self.cameras {
            camera.validate()?;
            if (camera.width, camera.height) != (first.width, first.height) {
                return Err(Error::input("splat.render")
                    .at("cameras")
                    .expected("one picture size")
                    .got("several"));
            }
        }
        let tile_fits = match settings.profile.footprint {
            crate::scene::profile::Footprint::Alpha => matches!(settings.tile, 8 | 16 | 32),
            crate::scene::profile::Footprint::Inria3Sigma => settings.tile == 16,
        };
        if !tile_fits {
            return Err(Error::input("setting tile")
                .expected("8, 16 or 32; 16 in profile inria")
                .got(settings.tile.to_string()));
        }
        Ok(())
    }

    fn grid(&self, settings: &Settings) -> Grid {
        Grid { width: self.cameras[0].width, height: self.cameras[0].height, tile: settings.tile }
    }

    /// Factors of the rows `from..to`, into `buffer` if they have to be made.
    fn factors<'b>(&'b self, from: usize, to: usize, buffer: &'b mut Vec<[f32; 9]>) -> &'b [[f32; 9]] {
        match self.shape {
            Shape::Factors(f) => &f[from..to],
            Shape::QuatScale { quats, scales } => {
                buffer.resize(to - from, [0.0; 9]);
                covariance::forward_rows(&quats[from..to], &scales[from..to], buffer);
                buffer
            }
        }
    }
}

/// Renders. See [`forward_into`].
pub fn forward(x: &In<'_>, settings: &Settings) -> (Out, Saved) {
    let (mut out, mut saved) = (Out::default(), Saved::default());
    forward_into(x, settings, None, &mut out, &mut saved);
    (out, saved)
}

/// Renders into memory already there; `frozen` gives the decisions instead of making them.
///
/// The inputs have passed [`In::validate`].
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

/// What `blend` takes of the inputs, the projected splats and their plan.
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

/// Rows, colours and splats of every camera, block by block.
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

/// Adds the gradients of `out_bar` into `x_bar`. See [`adjoint_into`].
pub fn adjoint(x: &In<'_>, settings: &Settings, saved: &Saved, out_bar: OutBar<'_>, x_bar: &mut InBar) {
    adjoint_into(x, settings, None, saved, out_bar, x_bar, &mut Scratch::default());
}

/// One block of Gaussians in every gradient.
struct Block<'a> {
    means: &'a mut [[f32; 3]],
    opacities: &'a mut [f32],
    quats: &'a mut [[f32; 4]],
    scales: &'a mut [[f32; 3]],
    factors: &'a mut [[f32; 9]],
    sh: &'a mut [f32],
    rgb: &'a mut [[f32; 3]],
    /// per camera
    means_px: Vec<&'a mut [[f32; 2]]>,
    means_px_abs: Vec<&'a mut [[f32; 2]]>,
}

/// Adds the gradients of `out_bar` into `x_bar`, with kept memory; `frozen` as in [`forward_into`].
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
    let records = &scratch.records;
    par::each(blocks(x, x_bar), |b, mut block| {
        adjoint_block(x, settings, saved, records, &lenses, b * BLOCK, &mut block);
    });
}

/// Cuts every gradient into blocks of [`BLOCK`] Gaussians.
fn blocks<'a>(x: &In<'_>, bar: &'a mut InBar) -> Vec<Block<'a>> {
    let n = x.means.len();
    let width = match x.color {
        Color::Sh(sh) => 3 * sh.coefficients,
        Color::Rgb(_) => 1,
    };
    let mut px: Vec<_> = bar.means_px.chunks_mut(n.max(1)).map(|c| c.chunks_mut(BLOCK)).collect();
    let mut abs: Vec<_> = bar.means_px_abs.chunks_mut(n.max(1)).map(|c| c.chunks_mut(BLOCK)).collect();
    let (mut quats, mut scales) = (bar.quats.chunks_mut(BLOCK), bar.scales.chunks_mut(BLOCK));
    let mut factors = bar.factors.chunks_mut(BLOCK);
    let (mut sh, mut rgb) = (bar.sh.chunks_mut(BLOCK * width), bar.rgb.chunks_mut(BLOCK));
    let rest = bar.means.chunks_mut(BLOCK).zip(bar.opacities.chunks_mut(BLOCK));
    rest.map(|(means, opacities)| Block {
        means,
        opacities,
        quats: quats.next().unwrap_or_default(),
        scales: scales.next().unwrap_or_default(),
        factors: factors.next().unwrap_or_default(),
        sh: sh.next().unwrap_or_default(),
        rgb: rgb.next().unwrap_or_default(),
        means_px: px.iter_mut().filter_map(Iterator::next).collect(),
        means_px_abs: abs.iter_mut().filter_map(Iterator::next).collect(),
    })
    .collect()
}

fn adjoint_block(
    x: &In<'_>,
    settings: &Settings,
    saved: &Saved,
    records: &[Record],
    lenses: &[(Lens, [f32; 3])],
    from: usize,
    block: &mut Block<'_>,
) {
    let (n, len) = (x.means.len(), block.means.len());
    let to = from + len;
    let (means, opacities) = (&x.means[from..to], &x.opacities[from..to]);
    let mut buffer = Vec::new();
    let factors = x.factors(from, to, &mut buffer);
    let mut factors_bar = vec![[0.0; 9]; len];
    let mut rows_bar = vec![RowBar::default(); len];
    let mut colors_bar = vec![[0.0; 3]; len];
    for (c, (lens, center)) in lenses.iter().enumerate() {
        let at = c * n + from;
        let rows = &saved.rows[at..at + len];
        for i in 0..len {
            // undo blend: the records of this Gaussian in slot order
            let bar = blend::gather_records(&saved.plan, &saved.pixels.rows, records, at + i)
                .map_or_else(SplatBar::default, |sums| SplatBar::new(&saved.splats[at + i], sums));
            block.means_px[c][i] = bar.mean_px;
            if let Some(abs) = block.means_px_abs.get_mut(c) {
                abs[i] = bar.mean_px_abs;
            }
            // undo o_blended = o ρ
            block.opacities[i] += bar.opacity * rows[i].compensation;
            rows_bar[i] = RowBar {
                mean_px: bar.mean_px,
                z: bar.z,
                shape: bar.shape,
                compensation: bar.opacity * opacities[i],
            };
            colors_bar[i] = bar.color;
        }
        let gaussians = project::In { means, factors, opacities, lens, profile: &settings.profile };
        let x_bar = project::InBar { means: &mut *block.means, factors: &mut factors_bar };
        project::adjoint(&gaussians, rows, &rows_bar, x_bar);
        match x.color {
            Color::Sh(sh) => {
                let mask = &saved.color_mask[at..at + len];
                color::adjoint(means, sh.rows(from, to), *center, mask, &colors_bar, block.means, block.sh);
            }
            Color::Rgb(_) => {
                for (sum, bar) in block.rgb.iter_mut().zip(&colors_bar) {
                    for k in 0..3 {
                        sum[k] += bar[k];
                    }
                }
            }
        }
    }
    match x.shape {
        Shape::QuatScale { quats, scales } => {
            covariance::adjoint_rows(
                &quats[from..to],
                &scales[from..to],
                &factors_bar,
                block.quats,
                block.scales,
            );
        }
        Shape::Factors(_) => {
            for (sum, bar) in block.factors.iter_mut().zip(&factors_bar) {
                for k in 0..9 {
                    sum[k] += bar[k];
                }
            }
        }
    }
}
