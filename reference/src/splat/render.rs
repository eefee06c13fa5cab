//! `splat.render`: renders Gaussians: [`super::project`] and [`super::color`], then [`super::blend`].
//!
//! The inputs are those of the parts; `rgb` (N, 3) may replace `sh` and `sh_degree`, and `factors` (N, 3, 3)
//! may replace `quats` and `scales`. In antialiased mode the opacity of a Gaussian in a view is
//! o·compensation (`opacities_px`, (C, N)).

use crate::array::{Arr, Named, Out};
use crate::inputs::{inputs, required};
use crate::ports::{Port, Signature, Stage, ports};
use crate::scalar::Scalar;
use crate::scene::profile::Profile;
use crate::splat::ports::{
    ALPHA, ALPHA_MASK, AXIS, BACKGROUND, CAMERA_START, CAP_MASK, COLOR_MASK, COLORS, COMPENSATION, CONICS,
    COUNTS, DEPTH, DEPTHS_Z, ENTRY_SLOT, FACTORS, HEIGHT, IMAGE, INTRINSICS, LAST_INDEX, MEANS, MEANS_PX,
    NEAR, OPACITIES, ORDER, PIVOT, QUATS, RADII, SCALES, SETTINGS, SH, SH_DEGREE, SHAPE, T_CLAMP, TILE_ENTRY,
    TILE_START, VIEWS, VISIBLE, WIDTH,
};
use crate::splat::{blend, color, project};
use crate::twins::Call;

inputs! {
    /// Inputs of `splat.render`.
    pub struct In<'a, S> {
        means: &'a Arr<S> = MEANS,
        quats: Option<&'a Arr<S>> = QUATS,
        scales: Option<&'a Arr<S>> = SCALES,
        factors: Option<&'a Arr<S>> = FACTORS,
        opacities: &'a Arr<S> = OPACITIES,
        sh: Option<&'a Arr<S>> = SH,
        sh_degree: Option<&'a Arr<S>> = SH_DEGREE,
        rgb: Option<&'a Arr<S>> = Port::var("N,3", "colours, instead of sh and sh_degree"),
        view_from_world: &'a Arr<S> = VIEWS,
        intrinsics: &'a Arr<S> = INTRINSICS,
        width: &'a Arr<S> = WIDTH,
        height: &'a Arr<S> = HEIGHT,
        near: Option<&'a Arr<S>> = NEAR,
        background: &'a Arr<S> = BACKGROUND,
    }
}

/// `splat.render`
pub static SIGNATURE: Signature = Signature {
    name: "splat.render",
    summary: "renders Gaussians: covariance, project, color, blend",
    inputs: In::<f64>::PORTS,
    outputs: ports![image: IMAGE, alpha: ALPHA, depth: DEPTH],
    intermediates: ports![
        means_px: MEANS_PX,
        conics: CONICS,
        depths_z: DEPTHS_Z,
        radii_px: RADII,
        colors: COLORS,
        counts: COUNTS,
        shape: SHAPE,
        axis: AXIS,
        compensation: COMPENSATION.without_gradient(),
        opacities_px: Port::fixed("C,N", "opacity times compensation, antialiased mode only")
            .or_absent()
            .compared(VISIBLE),
    ],
    plan: ports![
        order: ORDER,
        camera_start: CAMERA_START,
        tile_start: TILE_START,
        tile_entry: TILE_ENTRY,
        entry_slot: ENTRY_SLOT,
        last_index: LAST_INDEX,
        alpha_mask: ALPHA_MASK,
        cap_mask: CAP_MASK,
        t_clamp: T_CLAMP,
        color_mask: COLOR_MASK,
        pivot: PIVOT,
    ],
    settings: SETTINGS,
    stages: &[
        Stage {
            operator: "splat.project",
            inputs: &[
                "means",
                "quats",
                "scales",
                "factors",
                "view_from_world",
                "intrinsics",
                "width",
                "height",
                "near",
            ],
            outputs: &["means_px", "depths_z", "conics", "shape", "axis", "compensation", "radii_px"],
        },
        Stage {
            operator: "splat.color",
            inputs: &["means", "sh", "sh_degree", "rgb", "view_from_world"],
            outputs: &["colors"],
        },
        Stage {
            operator: "splat.blend",
            inputs: &[
                "means_px",
                "depths_z",
                "conics",
                "shape",
                "axis",
                "opacities",
                "opacities_px",
                "colors",
                "background",
            ],
            outputs: &["counts", "image", "alpha", "depth"],
        },
        Stage {
            operator: "splat.blend adjoint",
            inputs: &["image", "alpha", "depth", "image_bar", "alpha_bar", "depth_bar"],
            outputs: &["background_bar", "opacities_bar"],
        },
        Stage {
            operator: "splat.color adjoint",
            inputs: &["colors", "opacities_bar"],
            outputs: &["sh_bar", "rgb_bar"],
        },
        Stage {
            operator: "splat.project adjoint",
            inputs: &["means_px", "depths_z", "conics", "opacities_bar", "sh_bar", "rgb_bar"],
            outputs: &["means_bar", "factors_bar", "scales_bar", "quats_bar"],
        },
    ],
    ..Signature::EMPTY
};

/// First stage: every Gaussian in every view, with its colour.
///
/// # Errors
/// When an input is missing or has the wrong shape, or the plan does not match.
pub fn project_and_color<S: Scalar>(
    input: &In<'_, S>,
    profile: Profile,
    plan: Option<&Named<f64>>,
    out: &mut Out<'_, S>,
) -> Result<(), String> {
    let In { means, quats, scales, factors, opacities, rgb, .. } = *input;
    let In { view_from_world, intrinsics, width, height, near, .. } = *input;
    let geometry = project::In {
        means,
        quats,
        scales,
        factors,
        opacities: Some(opacities),
        view_from_world,
        intrinsics,
        width,
        height,
        near,
    };
    let views = project::Views::of(&geometry, profile)?;
    let (n, c) = (means.shape[0], views.cameras.len());
    let sh = match rgb {
        Some(_) => None,
        None => Some(color::Sh::of(required("sh", input.sh)?, required("sh_degree", input.sh_degree)?)?),
    };
    let colors = out.array("colors", &[c, n, 3]);
    let opacities_px = views.profile.antialiased.then(|| out.array("opacities_px", &[c, n]));
    let mut color_mask = Arr::filled(&[c, n, 3], 0.0);
    project::write(&geometry, &views, plan, out, |out, c, i, row, projected| {
        let (color, mask) = match (rgb, &sh) {
            (Some(rgb), _) => (rgb.row(i), [true; 3]),
            (None, Some(sh)) => {
                let direction = color::direction(means.row(i), views.cameras[c].center());
                sh.color(i, direction, color::mask_of(plan, row))
            }
            (None, None) => unreachable!("either rgb or sh was read"),
        };
        out.put_row(colors, row, color);
        for (channel, bit) in mask.into_iter().enumerate() {
            color_mask.data[3 * row + channel] = f64::from(u8::from(bit));
        }
        if let Some(slot) = opacities_px {
            out.put(slot, row, opacities.data[i] * projected.compensation);
        }
    })?;
    out.plan.insert("color_mask".to_owned(), color_mask);
    Ok(())
}

/// The inputs of blending among the arrays of the operator and of its first stage.
fn blend_inputs<'a, S>(arrays: &'a Named<S>, profile: &Profile) -> Result<blend::In<'a, S>, String> {
    let opacities = if profile.antialiased { "opacities_px" } else { "opacities" };
    blend::In::bind(&|name| arrays.get(if name == "opacities" { opacities } else { name }))
}

/// [`project_and_color`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or the plan does not match it.
pub fn run_project_and_color<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    project_and_color(&In::of(call.arrays)?, Profile::of(&call.settings), call.plan, out)
}

/// [`blend::forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or the plan does not match it.
pub fn run_blend<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let profile = Profile::of(&call.settings);
    blend::forward(&blend_inputs(call.arrays, &profile)?, &profile, call.plan, out)
}

/// Number of (Gaussian, pixel) pairs that are tested.
///
/// # Errors
/// As [`run_project_and_color`].
pub fn work(call: &Call<'_, f64>) -> Result<u64, String> {
    let (profile, mut out) = (Profile::of(&call.settings), Out::new(None));
    run_project_and_color(call, &mut out)?;
    let mut arrays = call.arrays.clone();
    arrays.extend(out.finish().0);
    blend::pairs(&blend_inputs(&arrays, &profile)?, &profile)
}
