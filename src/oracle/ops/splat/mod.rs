//! Gaussian splatting: common code of the six entries.
//!
//! ```text
//! named arrays ── scene ──► slices, cameras, profile ── activate … render ──► `splat`'s functions ──► named arrays
//!                           plan ◄──► plan arrays of `--plan` and the zeros they predict
//! ```
//!
//! This file has the checks shared by several entries; every entry is one line of [`super::LIST`].

pub(super) mod activate;
pub(super) mod blend;
pub(super) mod color;
pub(super) mod covariance;
pub(super) mod project;
pub(super) mod render;

mod plan;
mod scene;

use super::op::CheckedCall;
use crate::scene::camera::{Camera, Model};
use crate::scene::profile::{Footprint, Profile, Stop, TangentClamp};
use crate::splat::project::Row;
use crate::{Error, Result};

/// The profile of a call.
fn profile(x: &CheckedCall<'_>) -> Result<Profile> {
    let mut p = Profile::parse(x.word("profile").unwrap_or("exact"))?;
    let number = |key: &str, slot: &mut f32| {
        if let Some(value) = x.number(key) {
            *slot = value as f32;
        }
    };
    number("blur_px2", &mut p.blur_px2);
    number("alpha_max", &mut p.alpha_max);
    number("alpha_min", &mut p.alpha_min);
    number("t_stop", &mut p.t_stop);
    number("near", &mut p.near);
    number("far", &mut p.far);
    if x.has("near") {
        p.near = x.f32s("near")[0];
    }
    p.antialiased = x.number("antialiased").map_or(p.antialiased, |flag| flag == 1.0);
    p.inria_bwd = x.number("inria_bwd").map_or(p.inria_bwd, |flag| flag == 1.0);
    p.stop = match x.word("stop") {
        Some("after") => Stop::After,
        Some("before") => Stop::Before,
        Some("before_strict") => Stop::BeforeStrict,
        Some("never") => Stop::Never,
        _ => p.stop,
    };
    p.clamp = match x.word("clamp") {
        Some("gsplat") => TangentClamp::Gsplat,
        Some("inria") => TangentClamp::Inria,
        _ => p.clamp,
    };
    p.footprint = match x.word("footprint") {
        Some("alpha") => Footprint::Alpha,
        Some("inria") => Footprint::Inria3Sigma,
        _ => p.footprint,
    };
    Ok(p)
}

/// Checks the rules of settings and inputs common to several of the operators.
fn check_common(x: &CheckedCall<'_>) -> Result<()> {
    x.rule("opacities", "0 to 1", |o| (0.0..=1.0).contains(&o))?;
    x.rule("scales", "0 or more", |s| s >= 0.0)?;
    x.rule("near", "0 or more", |near| near >= 0.0)?;
    let setting = |key: &str, expected: &str, holds: fn(f64) -> bool| match x.number(key) {
        Some(value) if !holds(value) => {
            Err(Error::input(format!("setting {key}")).expected(expected).got(value.to_string()))
        }
        _ => Ok(()),
    };
    setting("blur_px2", "a positive number", |v| v > 0.0)?;
    setting("alpha_max", "more than 0 and less than 1", |v| v > 0.0 && v < 1.0)?;
    setting("alpha_min", "0 to 1", |v| (0.0..1.0).contains(&v))?;
    setting("t_stop", "0 to 1", |v| (0.0..1.0).contains(&v))?;
    setting("tile", "8, 16 or 32", |v| v == 8.0 || v == 16.0 || v == 32.0)?;
    let model = Model::parse(x.word("camera").unwrap_or("pinhole"))?;
    if model != Model::Orthographic
        && x.has("means")
        && x.op.inputs.iter().any(|p| p.name == "near")
        && !(profile(x)?.near > 0.0)
    {
        return Err(Error::input("array 'near'")
            .expected("a positive depth for a pinhole or fisheye camera")
            .got("0"));
    }
    if !(profile(x)?.alpha_min > 0.0) {
        // ō is a sum over pixels divided by o; here every pixel contributes
        x.rule("opacities", "more than 0 where alpha_min is 0", |o| o > 0.0)?;
    }
    let quats = x.f64s("quats");
    if let Some(row) = quats.chunks_exact(4).position(|q| q.iter().all(|c| *c == 0.0)) {
        return Err(Error::input("array 'quats'")
            .at(format!("row {row}"))
            .expected("a quaternion of any length but zero")
            .got("0"));
    }
    Ok(())
}

/// Checks that either `quats` and `scales`, or `factors` are present.
fn check_shape(x: &CheckedCall<'_>) -> Result<()> {
    match (x.has("quats"), x.has("scales"), x.has("factors")) {
        (true, true, false) | (false, false, true) => Ok(()),
        (q, s, f) => {
            let there: Vec<_> = [("quats", q), ("scales", s), ("factors", f)]
                .into_iter()
                .filter(|(_, there)| *there)
                .map(|(n, _)| n)
                .collect();
            Err(Error::input("shape of the Gaussians")
                .expected("either quats and scales, or factors")
                .got(format!("[{}]", there.join(", "))))
        }
    }
}

/// Degree of the spherical harmonics, at most 3 and covered by K.
fn sh_degree(x: &CheckedCall<'_>) -> Result<usize> {
    let degree = x.whole("sh_degree")?;
    let k = x.dim("K");
    if degree > 3 || (degree + 1) * (degree + 1) > k {
        return Err(Error::input("array 'sh_degree'")
            .expected(format!("at most 3, with (degree+1)² ≤ K = {k}"))
            .got(degree.to_string()));
    }
    Ok(degree)
}

/// The cameras of a call, checked.
fn cameras(x: &CheckedCall<'_>) -> Result<Vec<Camera>> {
    let model = Model::parse(x.word("camera").unwrap_or("pinhole"))?;
    let (width, height) = (x.whole("width")?, x.whole("height")?);
    let views = x.f32s("view_from_world");
    let intrinsics = x.f32s("intrinsics");
    views
        .chunks_exact(16)
        .zip(intrinsics.chunks_exact(9))
        .enumerate()
        .map(|(c, (view, k))| {
            let camera = Camera::from_matrices(view, k, width, height, model);
            camera.validate().map_err(|e| e.at(format!("camera {c}")))?;
            Ok(camera)
        })
        .collect()
}

/// Checks that there is a camera, and that the numbers of Gaussians and pixels fit into indices.
fn check_sizes(x: &CheckedCall<'_>) -> Result<()> {
    if x.dim("C") == 0 {
        return Err(Error::input("array 'view_from_world'").expected("at least one camera").got("none"));
    }
    if x.dim("N") >= 1 << 24 {
        return Err(Error::input("array 'means'")
            .expected("fewer than 2^24 Gaussians")
            .got(x.dim("N").to_string()));
    }
    let side = |name: &str| if x.has(name) { x.whole(name) } else { Ok(1) };
    let pixels = (side("width")? as u128) * (side("height")? as u128) * (x.dim("C") as u128);
    if pixels > MAX_PIXELS {
        return Err(Error::input("arrays 'width', 'height', 'view_from_world'")
            .expected(format!("at most {MAX_PIXELS} pixels in all images together"))
            .got(pixels.to_string()));
    }
    Ok(())
}

/// Maximum number of pixels of all images of one call, 2²⁸.
const MAX_PIXELS: u128 = 1 << 28;

/// Checks that the projection of every Gaussian is in the range of single precision; `rows` is (C, N).
fn check_range(rows: &[Row], n: usize) -> Result<()> {
    match crate::splat::project::out_of_range(rows) {
        None => Ok(()),
        Some(row) => Err(Error::input("arrays 'means', 'scales' (or 'factors')")
            .at(format!("camera {}, Gaussian {}", row / n, row % n))
            .expected("an ellipse within the range of f32 (--precision f64 has a larger range)")
            .got(format!("u = {:?}, (s, k1, k2) = {:?}", rows[row].mean_px, rows[row].shape))),
    }
}

/// Rows as consecutive values.
fn flatten<const K: usize>(rows: &[[f32; K]]) -> Vec<f32> {
    rows.iter().flatten().copied().collect()
}
