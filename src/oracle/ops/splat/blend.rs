//! `splat.blend`

use super::scene::Scene;
use super::{check_common, flatten, plan, profile};
use crate::ops::call::{Call, RunResult};
use crate::ops::op::{Case, CheckedCall, Op, Width};
use crate::scene::camera::MAX_SIDE;
use crate::scene::profile::Footprint;
use crate::splat::blend::{self, FrozenMasks, OutBar, SplatBar};
use crate::splat::plan::{Grid, Splat, build};
use crate::splat::project::cut_radius;
use crate::tape::check::Prediction;
use crate::{Error, Result};
use reference::settings::Setting;

/// `splat.blend`
pub(in crate::ops) static OP: Op = Op {
    signature: &reference::splat::blend::SIGNATURE,
    adjoint: true,
    width: Width::F32,
    work_unit: "pairs",
    work_ns: [60.0, 1200.0],
    check,
    run,
    predict,
    cases: 2,
    case,
};

fn check(x: &CheckedCall<'_>) -> Result<()> {
    check_common(x)?;
    x.rule("axis", "0 or 1", |a| a == 0.0 || a == 1.0)?;
    let shape = x.f64s("shape");
    if let Some(row) = shape.chunks_exact(3).position(|s| !(s[1] >= 0.0 && (s[1] == 0.0 || s[2] > 0.0))) {
        return Err(Error::input("array 'shape'")
            .at(format!("row {row}"))
            .expected("k1 > 0 and k2 > 0, or k1 = 0 for a Gaussian that is not drawn")
            .got(format!("{:?}", &shape[3 * row..3 * row + 3])));
    }
    for name in ["width", "height"] {
        let side = x.whole(name)?;
        if side == 0 || side > MAX_SIDE {
            return Err(Error::input(format!("array '{name}'"))
                .expected(format!("1 to {MAX_SIDE} pixels"))
                .got(side.to_string()));
        }
    }
    Ok(())
}

fn grid(x: &CheckedCall<'_>, tile: usize) -> Result<Grid> {
    Ok(Grid { width: x.whole("width")?, height: x.whole("height")?, tile })
}

fn splats(x: &CheckedCall<'_>, alpha_min: f32) -> Vec<Splat> {
    let (means_px, shape, colors) = (x.rows::<2>("means_px"), x.rows::<3>("shape"), x.rows::<3>("colors"));
    let (axis, depths_z, opacities) = (x.f32s("axis"), x.f32s("depths_z"), x.f32s("opacities"));
    let n = x.dim("N");
    let make = |row: usize| {
        let opacity = if opacities.len() == n { opacities[row % n] } else { opacities[row] };
        if shape[row][1] == 0.0 {
            return Splat::default();
        }
        let cut = cut_radius(opacity, alpha_min);
        Splat::new(means_px[row], shape[row], axis[row] as u8, depths_z[row], opacity, colors[row], cut)
    };
    (0..shape.len()).map(make).collect()
}

fn run(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (c, n, profile) = (x.dim("C"), x.dim("N"), profile(x)?);
    let stored = grid(x, 16)?;
    let cull = x.number("cull") != Some(0.0);
    let splats = splats(x, profile.alpha_min);
    let given = x.call.plan.as_ref().map(|p| plan::given(p, c, n, &stored)).transpose()?;
    let lists = match &given {
        Some(given) => given.plan.clone(),
        None => build(&splats, c, &stored, &profile, cull),
    };
    let frozen = given.as_ref().map(|g| FrozenMasks {
        last_index: &g.last_index,
        alpha: &g.alpha_mask,
        cap: &g.cap_mask,
    });
    let blended = blend::In {
        splats: &splats,
        n,
        plan: &lists,
        grid: stored,
        profile: &profile,
        background: x.rows::<3>("background")[0],
        cull,
        frozen,
    };
    let (mut out, mut saved) = (blend::Out::default(), blend::Saved::default());
    blend::forward(&blended, &mut out, &mut saved);
    let tile = x.number("tile").map_or(stored.tile, |tile| tile as usize);
    if tile != stored.tile && given.is_none() && profile.footprint == Footprint::Alpha {
        // the tile size changes no bit; plan and gradients are those of tiles of 16
        let grid = grid(x, tile)?;
        let plan = &build(&splats, c, &grid, &profile, cull);
        let other = blend::In { plan, grid, frozen: None, ..blended };
        blend::forward(&other, &mut out, &mut blend::Saved::default());
    }
    let [h, w] = [stored.height, stored.width];
    let mut ran = RunResult::default();
    plan::put_lists(&lists, &saved.last_index, [c, h, w], &mut ran.plan);
    let masks = plan::masks(&splats, n, &lists, &stored, &profile, &saved.last_index);
    match &x.call.plan {
        Some(p) => plan::keep(p, &["alpha_mask", "cap_mask", "last_index"], &mut ran.plan)?,
        None => {
            let entries = lists.tile_entry.len();
            ran.plan.put("alpha_mask", &[entries, 32], masks.alpha);
            ran.plan.put("cap_mask", &[entries, 32], masks.cap);
        }
    }
    if x.call.dump {
        ran.intermediates.put("counts", &[c, h, w], masks.counts);
    }
    if x.lend() {
        let bars = ImageBars::of(x, [c, h, w])?;
        let mut records = Vec::new();
        let background_bar = blend::adjoint(&blended, &saved, bars.view(), false, &mut records);
        let bar = |row: usize| {
            blend::gather_records(&lists, &saved.rows, &records, row)
                .map_or_else(SplatBar::default, |sums| SplatBar::new(&splats[row], sums))
        };
        let bars: Vec<SplatBar> = (0..c * n).map(bar).collect();
        put_bars(x, &bars, background_bar, &mut ran);
    }
    ran.outputs.put("image", &[c, h, w, 3], out.image);
    ran.outputs.put("alpha", &[c, h, w], out.alpha);
    ran.outputs.put("depth", &[c, h, w], out.depth);
    Ok(ran)
}

/// Cotangents of the three images.
pub(super) struct ImageBars {
    image: Option<Vec<f32>>,
    alpha: Option<Vec<f32>>,
    depth: Option<Vec<f32>>,
}

impl ImageBars {
    /// The cotangents of a call.
    pub(super) fn of(x: &CheckedCall<'_>, [c, h, w]: [usize; 3]) -> Result<Self> {
        Ok(Self {
            image: x.bar("image", &[c, h, w, 3])?,
            alpha: x.bar("alpha", &[c, h, w])?,
            depth: x.bar("depth", &[c, h, w])?,
        })
    }

    /// The cotangents as kernel arguments.
    pub(super) fn view(&self) -> OutBar<'_> {
        OutBar { image: self.image.as_deref(), alpha: self.alpha.as_deref(), depth: self.depth.as_deref() }
    }
}

fn put_bars(x: &CheckedCall<'_>, bars: &[SplatBar], background_bar: [f32; 3], ran: &mut RunResult) {
    let add = |name: &str, values: Vec<f32>| {
        let mut sum = x.start(name, values.len());
        for (s, v) in sum.iter_mut().zip(&values) {
            *s += *v;
        }
        sum
    };
    let flat = |f: &dyn Fn(&SplatBar) -> Vec<f32>| bars.iter().flat_map(f).collect::<Vec<f32>>();
    let mut put = |name: &str, values: Vec<f32>| ran.gradients.put(name, &x.shape(name), add(name, values));
    put("means_px", flat(&|b| b.mean_px.to_vec()));
    put("shape", flat(&|b| b.shape.to_vec()));
    put("colors", flat(&|b| b.color.to_vec()));
    put("depths_z", flat(&|b| vec![b.z]));
    put("background", flatten(&[background_bar]));
    let each = flat(&|b| vec![b.opacity]);
    let n = x.dim("N");
    // one opacity for all cameras: their gradients are added camera by camera
    let opacities = if x.shape("opacities").len() == 1 {
        (0..n).map(|i| (0..x.dim("C")).fold(0.0, |sum, c| sum + each[c * n + i])).collect()
    } else {
        each
    };
    put("opacities", opacities);
}

/// Gaussians that affect no pixel have no gradient; those that affect pixels only above the cap have
/// gradients of colour and depth only.
fn predict(x: &CheckedCall<'_>, ran: &RunResult) -> Result<Prediction> {
    let (c, n) = (x.dim("C"), x.dim("N"));
    let reach = plan::reach(&ran.plan, c, n, &grid(x, 16)?)?;
    let through = profile(x)?.inria_bwd;
    let moves = |row: usize| reach.below_cap[row] || (through && reach.anywhere[row]);
    let mut known = Prediction::default();
    let mut rows = |name: &str, width: usize, zero: &dyn Fn(usize) -> bool| {
        known.zeros.insert(name.to_owned(), (0..c * n * width).map(|e| zero(e / width)).collect());
    };
    rows("means_px", 2, &|row| !moves(row));
    rows("shape", 3, &|row| !moves(row));
    rows("colors", 3, &|row| !reach.anywhere[row]);
    rows("depths_z", 1, &|row| !reach.anywhere[row]);
    let opacities = if x.shape("opacities").len() == 1 {
        (0..n).map(|i| !(0..c).any(|v| moves(v * n + i))).collect()
    } else {
        (0..c * n).map(|row| !moves(row)).collect()
    };
    known.zeros.insert("opacities".to_owned(), opacities);
    Ok(known)
}

/// The outputs of `splat.project` and `splat.color` for a scene. Case 0: `exact`; case 1: `gsplat`, opaque
/// enough to reach the cap and the stop, with an opacity per camera.
fn case(case: usize) -> Case {
    let mut scene = Scene::new(44, case, 12);
    if case == 1 {
        scene.opacity = [0.8, 1.0];
        scene.scale = [0.2, 0.5];
    }
    let mut call = Call::default();
    scene.put(
        &mut call.inputs,
        &["means", "quats", "scales", "opacities", "view_from_world", "intrinsics", "width", "height"],
    );
    let ran =
        crate::ops::checked::run(&super::project::OP, &call).expect("a generated scene is a valid input");
    let mut made = Case::default();
    for name in ["means_px", "shape", "axis", "depths_z"] {
        made.inputs.0.insert(
            name.to_owned(),
            ran.outputs.need(name).expect("splat.project has these outputs").clone(),
        );
    }
    scene.put(&mut made.inputs, &["width", "height", "background"]);
    let (c, n) = (scene.cameras, scene.n);
    let rgb = crate::ops::case::Draw::new(44, case, 7).uniforms(c * n * 3, 0.05, 0.95);
    made.inputs.put("colors", &[c, n, 3], rgb);
    if case == 1 {
        let opacities = crate::ops::case::Draw::new(44, case, 8).uniforms(c * n, 0.8, 1.0);
        made.inputs.put("opacities", &[c, n], opacities);
        made.settings.insert("profile".to_owned(), Setting::Text("gsplat".to_owned()));
    } else {
        scene.put(&mut made.inputs, &["opacities"]);
    }
    made
}
