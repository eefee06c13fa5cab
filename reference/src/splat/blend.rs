//! `splat.blend`: composites ellipses into images, front to back.
//!
//! α_i = min(α_max, o_i·exp(−½(w1² + w2²))),   w1 = d_p·k1,   w2 = (d_q − s·d_p)·k2,   d = pixel centre − u_i
//! C = Σ_i T_i α_i c_i + T·b,   T_{i+1} = T_i (1 − α_i),   T_0 = 1
//! (3DGS, eq. 3; conic form of [`super::project`])
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | u | `means_px` | (C, N, 2) | pixels |
//! | s, k1, k2 | `shape` | (C, N, 3) | k1 = 0: not drawn |
//! | p | `axis` | (C, N) | 0 or 1 |
//! | o | `opacities` | (N) or (C, N) | 0..1; per view in antialiased mode |
//! | c | `colors` | (C, N, 3) | sRGB-encoded |
//! | | `depths_z` | (C, N) | scene units |
//! | b | `background` | (3) | |
//! | C | `image` | (C, H, W, 3) | |
//! | Σ T α | `alpha` | (C, H, W) | 0..1 |
//! | Σ T α z | `depth` | (C, H, W) | not normalised, without background |
//! | | `counts` | (C, H, W) | contributing Gaussians; not differentiated |
//!
//! # Rounding
//! Left folds in list order; α and T as written above, the background last.
//!
//! # Kinks and domain
//! α < α_min does not contribute; above the cap the gradient of α is 0 (at it the uncapped branch is taken);
//! the end of the loop is in the plan (`last_index`). On a fixed plan everything is smooth.
//!
//! # Adjoint
//! With `inria_bwd` the cap is ignored in the backward pass.

use crate::array::{Arr, Named, Out, Slot};
use crate::inputs::inputs;
use crate::ports::{Port, Signature, Space, ports};
use crate::scalar::Scalar;
use crate::scene::camera;
use crate::scene::profile::{Profile, Stop};
use crate::splat::plan::{self, Lists, TILE};
use crate::splat::ports::{
    ALPHA, ALPHA_MASK, AXIS, BACKGROUND, CAMERA_START, CAP_MASK, COLORS, COUNTS, DEPTH, DEPTHS_Z, ENTRY_SLOT,
    HEIGHT, IMAGE, LAST_INDEX, MEANS_PX, ORDER, SETTINGS, SHAPE, TILE_ENTRY, TILE_START, WIDTH,
};
use crate::twins::Call;

inputs! {
    /// Inputs of `splat.blend`.
    pub struct In<'a, S> {
        means_px: &'a Arr<S> = MEANS_PX,
        shape: &'a Arr<S> = SHAPE.moved(Space::Log),
        axis: &'a Arr<S> = AXIS,
        opacities: &'a Arr<S> =
            Port::var("N|C,N", "0..1; per camera in antialiased mode").moved(Space::Logit),
        colors: &'a Arr<S> = COLORS,
        depths_z: &'a Arr<S> = DEPTHS_Z,
        background: &'a Arr<S> = BACKGROUND,
        width: &'a Arr<S> = WIDTH,
        height: &'a Arr<S> = HEIGHT,
    }
}

/// `splat.blend`
pub static SIGNATURE: Signature = Signature {
    name: "splat.blend",
    summary: "composites ellipses into images, front to back",
    inputs: In::<f64>::PORTS,
    outputs: ports![image: IMAGE, alpha: ALPHA, depth: DEPTH],
    intermediates: ports![counts: COUNTS],
    plan: ports![
        order: ORDER,
        camera_start: CAMERA_START,
        tile_start: TILE_START,
        tile_entry: TILE_ENTRY,
        entry_slot: ENTRY_SLOT,
        last_index: LAST_INDEX,
        alpha_mask: ALPHA_MASK,
        cap_mask: CAP_MASK,
    ],
    settings: SETTINGS,
    ..Signature::EMPTY
};

/// The parameters of one Gaussian in one view that blending uses.
#[derive(Clone, Copy, Debug)]
pub struct Ellipse<S> {
    /// u, pixels.
    pub mean_px: [S; 2],
    /// s, k1, k2.
    pub shape: [S; 3],
    /// Axis p.
    pub axis: usize,
    /// o.
    pub opacity: S,
}

impl<S: Scalar> Ellipse<S> {
    /// o·exp(−½(w1² + w2²)), without the cap, at a pixel centre.
    pub fn alpha(&self, pixel: [f64; 2]) -> S {
        let d: [S; 2] = std::array::from_fn(|k| -(self.mean_px[k] - pixel[k]));
        let (dp, dq) = (d[self.axis], d[1 - self.axis]);
        let [s, k1, k2] = self.shape;
        let (w1, w2) = (dp * k1, (dq - s * dp) * k2);
        self.opacity * ((w1 * w1 + w2 * w2) * -0.5).exp()
    }
}

/// The checked Gaussians in all views.
pub struct Ellipses<'a, S> {
    /// C.
    pub views: usize,
    /// N.
    pub n: usize,
    /// Width and height.
    pub size_px: [usize; 2],
    input: In<'a, S>,
    background: [S; 3],
}

impl<'a, S: Scalar> Ellipses<'a, S> {
    /// Checks the inputs.
    ///
    /// # Errors
    /// When the image size is invalid, or an axis is neither 0 nor 1.
    pub fn of(input: &In<'a, S>) -> Result<Self, String> {
        if let Some(axis) = input.axis.data.iter().find(|axis| ![0.0, 1.0].contains(&axis.value())) {
            return Err(format!("input axis: expected 0 or 1, got {}", axis.value()));
        }
        Ok(Self {
            views: input.means_px.shape[0],
            n: input.means_px.shape[1],
            size_px: camera::size_px(input.width, input.height)?,
            background: input.background.row(0),
            input: *input,
        })
    }

    /// Number of tile columns and rows.
    pub fn tiles(&self) -> [usize; 2] {
        self.size_px.map(|size| size.div_ceil(TILE))
    }
    /// Index of the tile that holds a pixel.
    pub fn tile(&self, c: usize, px: usize, py: usize) -> usize {
        let [columns, rows] = self.tiles();
        (c * rows + py / TILE) * columns + px / TILE
    }
    /// Gaussian `i` in view `c`.
    pub fn ellipse(&self, c: usize, i: usize) -> Ellipse<S> {
        let row = c * self.n + i;
        let In { means_px, shape, axis, opacities, .. } = self.input;
        Ellipse {
            mean_px: means_px.row(row),
            shape: shape.row(row),
            axis: axis.data[row].value() as usize,
            opacity: opacities.data[if opacities.shape.len() == 1 { i } else { row }],
        }
    }
    /// Depth of every Gaussian that is drawn, by row.
    pub fn depths(&self) -> Vec<Option<f64>> {
        let In { shape, depths_z, .. } = self.input;
        let drawn = |row: usize| shape.data[3 * row + 1].value() > 0.0;
        (0..self.views * self.n).map(|row| drawn(row).then(|| depths_z.data[row].value())).collect()
    }
}

/// Per-pixel decisions of a plan; those that are `None` are computed from the values.
struct StoredPlan<'a> {
    last_index: Option<&'a [f64]>,
    alpha_mask: Option<&'a [f64]>,
    cap_mask: Option<&'a [f64]>,
}

impl<'a> StoredPlan<'a> {
    fn of(plan: Option<&'a Named<f64>>, entries: usize, pixels: [usize; 3]) -> Result<Self, String> {
        let array = |name: &str, shape: &[usize], low: f64, high: f64| {
            let Some(array) = plan.and_then(|plan| plan.get(name)) else { return Ok(None) };
            if array.shape != shape {
                return Err(format!("plan {name}: expected shape {shape:?}, got {:?}", array.shape));
            }
            match array.data.iter().find(|&&x| !(x >= low && x <= high && x.fract() == 0.0)) {
                Some(x) => Err(format!("plan {name}: expected whole numbers from {low} to {high}, got {x}")),
                None => Ok(Some(array.data.as_slice())),
            }
        };
        Ok(Self {
            last_index: array("last_index", &pixels, -1.0, entries as f64)?,
            alpha_mask: array("alpha_mask", &[entries, 32], 0.0, 255.0)?,
            cap_mask: array("cap_mask", &[entries, 32], 0.0, 255.0)?,
        })
    }
}

fn bit(mask: &[f64], entry: usize, bit: usize) -> bool {
    mask[32 * entry + bit / 8] as u8 >> (bit % 8) & 1 == 1
}

fn set_bit(mask: &mut [f64], entry: usize, bit: usize) {
    let byte = &mut mask[32 * entry + bit / 8];
    *byte = f64::from(*byte as u8 | 1 << (bit % 8));
}

/// One contributing Gaussian of a pixel.
struct Hit {
    entry: usize,
    gaussian: usize,
    capped: bool,
}

/// Decides which entries of a pixel's list contribute, on values alone.
fn decide(
    x: &Ellipses<'_, f64>,
    profile: &Profile,
    lists: &Lists,
    given: &StoredPlan<'_>,
    [c, py, px]: [usize; 3],
) -> (Vec<Hit>, isize) {
    let tile = x.tile(c, px, py);
    let (start, end) = (lists.tile_start[tile], lists.tile_start[tile + 1]);
    let place = TILE * (py % TILE) + px % TILE;
    let last = given.last_index.map(|last| last[(c * x.size_px[1] + py) * x.size_px[0] + px] as isize);
    let (mut hits, mut last_hit, mut transmittance) = (Vec::new(), -1_isize, 1.0);
    for entry in start..end {
        if last.is_some_and(|last| (entry - start) as isize > last) {
            break;
        }
        let gaussian = lists.tile_entry[entry];
        let raw = x.ellipse(c, gaussian).alpha([px as f64 + 0.5, py as f64 + 0.5]);
        let contributes = given.alpha_mask.map_or(raw >= profile.alpha_min, |mask| bit(mask, entry, place));
        if !contributes {
            continue;
        }
        let capped = given.cap_mask.map_or(raw > profile.alpha_max, |mask| bit(mask, entry, place));
        let next = transmittance * (1.0 - if capped { profile.alpha_max } else { raw });
        if last.is_none() {
            let stop_before = match profile.stop {
                Stop::Before => next <= profile.t_stop,
                Stop::BeforeStrict => next < profile.t_stop,
                Stop::After | Stop::Never => false,
            };
            if stop_before {
                break;
            }
        }
        transmittance = next;
        hits.push(Hit { entry, gaussian, capped });
        last_hit = (entry - start) as isize;
        if last.is_none() && profile.stop == Stop::After && transmittance <= profile.t_stop {
            break;
        }
    }
    (hits, last_hit)
}

/// Composites the hits of one pixel: colour with background, Σ T α, Σ T α z.
fn composite<S: Scalar>(
    x: &Ellipses<'_, S>,
    profile: &Profile,
    hits: &[Hit],
    [c, py, px]: [usize; 3],
) -> ([S; 3], S, S) {
    let (mut color, mut alpha_sum, mut depth) = ([S::zero(); 3], S::zero(), S::zero());
    let mut transmittance = S::one();
    for hit in hits {
        let row = c * x.n + hit.gaussian;
        let raw = x.ellipse(c, hit.gaussian).alpha([px as f64 + 0.5, py as f64 + 0.5]);
        let alpha = match (hit.capped, profile.inria_bwd) {
            (false, _) => raw,
            (true, false) => S::from_f64(profile.alpha_max),
            (true, true) => raw.chain(profile.alpha_max, 1.0),
        };
        let weight = transmittance * alpha;
        let c: [S; 3] = x.input.colors.row(row);
        color = std::array::from_fn(|channel| color[channel] + weight * c[channel]);
        alpha_sum = alpha_sum + weight;
        depth = depth + weight * x.input.depths_z.data[row];
        transmittance = transmittance * (S::one() - alpha);
    }
    (std::array::from_fn(|channel| color[channel] + transmittance * x.background[channel]), alpha_sum, depth)
}

/// Declares `image`, `alpha`, `depth`, `counts`.
fn declare<S: Scalar>(out: &mut Out<S>, [c, h, w]: [usize; 3]) -> [Slot; 4] {
    [
        out.array("image", &[c, h, w, 3]),
        out.array("alpha", &[c, h, w]),
        out.array("depth", &[c, h, w]),
        out.array("counts", &[c, h, w]),
    ]
}

/// The twin of `splat.blend`. Completes the plan.
///
/// # Errors
/// When the image size is invalid, an axis is neither 0 nor 1, or the plan does not match.
pub fn forward<S: Scalar>(
    input: &In<'_, S>,
    profile: &Profile,
    plan: Option<&Named<f64>>,
    out: &mut Out<'_, S>,
) -> Result<(), String> {
    // Decisions are computed from values.
    let In { means_px, shape, axis, opacities, colors, depths_z, background, width, height } = *input;
    let all = [means_px, shape, axis, opacities, colors, depths_z, background, width, height];
    let [means_px, shape, axis, opacities, colors, depths_z, background, width, height] =
        &all.map(|array| array.map(|x| x.value()));
    let values = In { means_px, shape, axis, opacities, colors, depths_z, background, width, height };
    let (x, v) = (Ellipses::of(input)?, Ellipses::of(&values)?);
    plan::write_order(plan, &v.depths(), v.views, v.n, &mut out.plan);
    let order = plan::order(Some(&out.plan), v.views, v.n)?.expect("the order was just written");
    let lists = Lists::of(plan, &order, &v, profile)?;
    lists.write(&mut out.plan);
    let (entries, [w, h]) = (lists.tile_entry.len(), x.size_px);
    let pixels = [x.views, h, w];
    let given = StoredPlan::of(plan, entries, pixels)?;
    let [image, alpha, depth, counts] = declare(out, pixels);
    let mut last_index = Arr::filled(&pixels, -1.0);
    let mut alpha_mask = Arr::filled(&[entries, 32], 0.0);
    let mut cap_mask = Arr::filled(&[entries, 32], 0.0);
    for c in 0..x.views {
        for py in 0..h {
            for px in 0..w {
                let at = [c, py, px];
                let pixel = (c * h + py) * w + px;
                let (hits, last) = decide(&v, profile, &lists, &given, at);
                let place = TILE * (py % TILE) + px % TILE;
                for hit in &hits {
                    set_bit(&mut alpha_mask.data, hit.entry, place);
                    if hit.capped {
                        set_bit(&mut cap_mask.data, hit.entry, place);
                    }
                }
                last_index.data[pixel] = last as f64;
                let (c_pixel, a_pixel, d_pixel) = composite(&x, profile, &hits, at);
                out.put_row(image, pixel, c_pixel);
                out.put(alpha, pixel, a_pixel);
                out.put(depth, pixel, d_pixel);
                out.put(counts, pixel, S::from_f64(hits.len() as f64));
                out.flush();
            }
        }
    }
    out.plan.insert("last_index".to_owned(), last_index);
    out.plan.insert("alpha_mask".to_owned(), alpha_mask);
    out.plan.insert("cap_mask".to_owned(), cap_mask);
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or the plan does not match it.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, &Profile::of(&call.settings), call.plan, out)
}

/// Number of (Gaussian, pixel) pairs that are tested.
///
/// # Errors
/// As [`run`].
pub fn work(call: &Call<'_, f64>) -> Result<u64, String> {
    pairs(&In::of(call.arrays)?, &Profile::of(&call.settings))
}

/// Number of (Gaussian, pixel) pairs that are tested.
///
/// # Errors
/// As [`forward`].
pub fn pairs(input: &In<'_, f64>, profile: &Profile) -> Result<u64, String> {
    let x = Ellipses::of(input)?;
    let drawn = x.depths();
    let mut pairs = 0;
    for row in (0..x.views * x.n).filter(|&row| drawn[row].is_some()) {
        let ellipse = x.ellipse(row / x.n, row % x.n);
        let [columns, rows] = plan::reach(&ellipse, x.size_px, profile);
        pairs += (columns[1].saturating_sub(columns[0]) * rows[1].saturating_sub(rows[0])) as u64;
    }
    Ok(pairs)
}
