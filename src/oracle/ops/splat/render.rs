//! `splat.render`

use super::blend::ImageBars;
use super::color::{mask_rows, sh_zeros};
use super::scene::Scene;
use super::{cameras, check_common, check_shape, check_sizes, flatten, plan, profile, project, sh_degree};
use crate::num::array::Arrays;
use crate::ops::call::RunResult;
use crate::ops::op::{Case, CheckedCall, Op, Width};
use crate::scene::camera::Camera;
use crate::splat::color::Sh;
use crate::splat::plan::Grid;
use crate::splat::render::{self, Color, Frozen, In, InBar, Saved, Scratch, Settings, Shape};
use crate::tape::check::Prediction;
use crate::{Error, Result};
use reference::settings::Setting;

/// `splat.render`
pub(in crate::ops) static OP: Op = Op {
    signature: &reference::splat::render::SIGNATURE,
    adjoint: true,
    width: Width::F32,
    work_unit: "pairs",
    work_ns: [60.0, 1200.0],
    check,
    run,
    predict,
    cases: 5,
    case,
};

fn check(x: &CheckedCall<'_>) -> Result<()> {
    check_sizes(x)?;
    check_shape(x)?;
    check_common(x)?;
    cameras(x)?;
    match (x.has("sh"), x.has("sh_degree"), x.has("rgb")) {
        (true, true, false) => sh_degree(x).map(|_| ()),
        (false, false, true) => Ok(()),
        _ => Err(Error::input("colour of the Gaussians")
            .expected("either sh and sh_degree, or rgb")
            .got("another combination")),
    }
}

/// The owned arrays of [`In`].
struct OwnedInputs {
    means: Vec<[f32; 3]>,
    quats: Vec<[f32; 4]>,
    scales: Vec<[f32; 3]>,
    factors: Vec<[f32; 9]>,
    opacities: Vec<f32>,
    sh: Vec<f32>,
    rgb: Vec<[f32; 3]>,
    coefficients: usize,
    degree: Option<usize>,
    cameras: Vec<Camera>,
    background: [f32; 3],
}

impl OwnedInputs {
    fn new(x: &CheckedCall<'_>) -> Result<Self> {
        Ok(Self {
            means: x.rows("means"),
            quats: x.rows("quats"),
            scales: x.rows("scales"),
            factors: x.rows("factors"),
            opacities: x.f32s("opacities"),
            sh: x.f32s("sh"),
            rgb: x.rows("rgb"),
            coefficients: x.dim("K"),
            degree: if x.has("sh") { Some(sh_degree(x)?) } else { None },
            cameras: cameras(x)?,
            background: x.rows::<3>("background")[0],
        })
    }

    fn view(&self, has_factors: bool) -> In<'_> {
        In {
            means: &self.means,
            shape: if has_factors {
                Shape::Factors(&self.factors)
            } else {
                Shape::QuatScale { quats: &self.quats, scales: &self.scales }
            },
            opacities: &self.opacities,
            color: match self.degree {
                Some(degree) => Color::Sh(Sh { values: &self.sh, coefficients: self.coefficients, degree }),
                None => Color::Rgb(&self.rgb),
            },
            cameras: &self.cameras,
            background: self.background,
        }
    }
}

fn frozen(plan: &Arrays, x: &In<'_>, grid: &Grid) -> Result<Frozen> {
    let (c, n) = (x.cameras.len(), x.means.len());
    let given = plan::given(plan, c, n, grid)?;
    Ok(Frozen {
        plan: given.plan,
        decisions: plan::decisions(plan, c, n)?,
        color_mask: if matches!(x.color, Color::Sh(_)) { mask_rows(plan, c, n)? } else { Vec::new() },
        last_index: given.last_index,
        alpha_mask: given.alpha_mask,
        cap_mask: given.cap_mask,
    })
}

fn run(x: &CheckedCall<'_>) -> Result<RunResult> {
    let owned = OwnedInputs::new(x)?;
    let input = owned.view(x.has("factors"));
    let profile = profile(x)?;
    let settings = Settings { profile, cull: x.number("cull") != Some(0.0), ..Settings::default() };
    input.validate(&settings)?;
    let (c, n) = (input.cameras.len(), input.means.len());
    let [h, w] = [input.cameras[0].height, input.cameras[0].width];
    let grid = Grid { width: w, height: h, tile: settings.tile };
    let frozen = x.call.plan.as_ref().map(|p| frozen(p, &input, &grid)).transpose()?;
    let (mut out, mut saved) = (render::Out::default(), Saved::default());
    render::forward_into(&input, &settings, frozen.as_ref(), &mut out, &mut saved);
    super::check_range(&saved.rows, n)?;
    let tile = x.number("tile").map_or(16, |tile| tile as usize);
    if tile != settings.tile && frozen.is_none() {
        // the tile size changes no bit; plan and gradients are those of tiles of 16
        let other = Settings { tile, ..settings.clone() };
        input.validate(&other)?;
        out = render::forward(&input, &other).0;
    }
    let mut ran = RunResult::default();
    let masks =
        plan::masks(&saved.splats, n, &saved.plan, &grid, &settings.profile, &saved.pixels.last_index);
    match &x.call.plan {
        Some(given) => {
            let names: Vec<&str> =
                OP.plan.iter().map(|p| p.name).filter(|name| given.get(name).is_some()).collect();
            plan::keep(given, &names, &mut ran.plan)?;
        }
        None => {
            let entries = saved.plan.tile_entry.len();
            plan::put_lists(&saved.plan, &saved.pixels.last_index, [c, h, w], &mut ran.plan);
            plan::put_rows(&saved.rows, c, n, &mut ran.plan);
            ran.plan.put("alpha_mask", &[entries, 32], masks.alpha);
            ran.plan.put("cap_mask", &[entries, 32], masks.cap);
            let mask = if saved.color_mask.is_empty() {
                saved.rows.iter().flat_map(|r| [u8::from(r.visible); 3]).collect()
            } else {
                saved.color_mask.iter().flatten().copied().collect()
            };
            ran.plan.put("color_mask", &[c, n, 3], mask);
        }
    }
    if x.call.dump {
        project::put_rows(&saved.rows, n, &settings.profile, input.cameras, &mut ran.intermediates);
        let colors = saved.splats.iter().flat_map(|s| s.color).collect();
        ran.intermediates.put("colors", &[c, n, 3], colors);
        ran.intermediates.put("counts", &[c, h, w], masks.counts);
        if settings.profile.antialiased {
            ran.intermediates.put("opacities_px", &[c, n], saved.splats.iter().map(|s| s.opacity).collect());
        }
    }
    if x.lend() {
        let bars = ImageBars::of(x, [c, h, w])?;
        let mut bar = started(x, &input);
        render::adjoint_into(
            &input,
            &settings,
            frozen.as_ref(),
            &saved,
            bars.view(),
            &mut bar,
            &mut Scratch::default(),
        );
        put_bars(x, &bar, &mut ran.gradients);
    }
    ran.outputs.put("image", &[c, h, w, 3], out.image);
    ran.outputs.put("alpha", &[c, h, w], out.alpha);
    ran.outputs.put("depth", &[c, h, w], out.depth);
    Ok(ran)
}

fn started(x: &CheckedCall<'_>, input: &In<'_>) -> InBar {
    let mut bar = InBar::zeros_like(input);
    let n = bar.means.len();
    bar.means = x.start_rows("means", n);
    bar.quats = x.start_rows("quats", bar.quats.len());
    bar.scales = x.start_rows("scales", bar.scales.len());
    bar.factors = x.start_rows("factors", bar.factors.len());
    bar.opacities = x.start("opacities", n);
    bar.sh = x.start("sh", bar.sh.len());
    bar.rgb = x.start_rows("rgb", bar.rgb.len());
    bar.background = x.start_rows::<3>("background", 1)[0];
    bar
}

fn put_bars(x: &CheckedCall<'_>, bar: &InBar, into: &mut Arrays) {
    let mut put = |name: &str, values: Vec<f32>| {
        if x.has(name) {
            into.put(name, &x.shape(name), values);
        }
    };
    put("means", flatten(&bar.means));
    put("quats", flatten(&bar.quats));
    put("scales", flatten(&bar.scales));
    put("factors", flatten(&bar.factors));
    put("opacities", bar.opacities.clone());
    put("sh", bar.sh.clone());
    put("rgb", flatten(&bar.rgb));
    put("background", bar.background.to_vec());
}

/// Gaussians that affect no pixel, or only pixels above the cap; coefficients above the degree, and channels
/// clamped at 0 wherever the Gaussian is visible; ⟨q, q̄⟩ = 0.
fn predict(x: &CheckedCall<'_>, ran: &RunResult) -> Result<Prediction> {
    let (c, n) = (x.dim("C"), x.dim("N"));
    let grid = Grid { width: x.whole("width")?, height: x.whole("height")?, tile: 16 };
    let reach = plan::reach(&ran.plan, c, n, &grid)?;
    let through = profile(x)?.inria_bwd;
    let any = |rows: &[bool], i: usize| (0..c).any(|v| rows[v * n + i]);
    let still = |i: usize| !(any(&reach.below_cap, i) || (through && any(&reach.anywhere, i)));
    let mut known = plan::row_prediction(x, &["quats", "scales", "factors", "opacities"], still);
    let unseen = |i: usize| !any(&reach.anywhere, i);
    known.zeros.extend(plan::row_prediction(x, &["means", "rgb"], unseen).zeros);
    if x.has("sh") {
        let mask = mask_rows(&ran.plan, c, n)?;
        let seen = |i: usize, channel: usize| {
            (0..c).any(|v| reach.anywhere[v * n + i] && mask[v * n + i][channel] == 1)
        };
        known.zeros.insert("sh".to_owned(), sh_zeros(x, sh_degree(x)?, seen));
    }
    Ok(known)
}

/// 0: `exact`, quats and scales, degree 2; 1: factors and rgb, orthographic; 2: fisheye, antialiased, degree
/// 1 of 9; 3: `gsplat`, opaque enough to reach the cap and the stop; 4: `inria`, a narrow view with limited
/// tangents, degree 3.
fn case(case: usize) -> Case {
    let mut scene = Scene::new(45, case, 10);
    let mut made = Case::default();
    let mut set = |key: &str, value: Setting| made.settings.insert(key.to_owned(), value);
    let word = |text: &str| Setting::Text(text.to_owned());
    let (coefficients, degree) = [(9, 2), (0, 0), (9, 1), (4, 1), (16, 3)][case];
    match case {
        1 => {
            scene.focal = [15.0, 12.0];
            set("camera", word("orthographic"));
        }
        2 => {
            scene.scale = [0.01, 0.3];
            set("camera", word("fisheye"));
            set("antialiased", Setting::Number(1.0));
        }
        3 => {
            scene.opacity = [0.9, 1.0];
            scene.scale = [0.25, 0.6];
            set("profile", word("gsplat"));
        }
        4 => {
            scene.focal = [83.0, 61.0];
            set("profile", word("inria"));
        }
        _ => {}
    }
    scene.put(
        &mut made.inputs,
        &["means", "opacities", "view_from_world", "intrinsics", "width", "height", "background"],
    );
    if case == 1 {
        scene.put(&mut made.inputs, &["factors", "rgb"]);
    } else {
        scene.put(&mut made.inputs, &["quats", "scales"]);
        scene.put_sh(&mut made.inputs, coefficients, degree);
    }
    if case == 0 {
        scene.put(&mut made.inputs, &["near"]);
    }
    made
}
