//! Gaussian splatting: what the six entries share.
//!
//! ```text
//! named arrays ── scene ──► slices, cameras, profile ── activate … render ──► `splat`'s functions ──► named arrays
//!                           plan ◄──► plan arrays of `--plan` and the zeros they predict
//! ```
//!
//! The ports, settings and checks that several entries have in common stand here; every entry is one line of [`super::LIST`].

pub(super) mod activate;
pub(super) mod blend;
pub(super) mod color;
pub(super) mod covariance;
pub(super) mod project;
pub(super) mod render;

mod plan;
mod scene;

use super::call::Checked;
use super::op::{Compare, Dtype, Kind, Port, SettingSpec};
use crate::scene::camera::{Camera, Model};
use crate::scene::profile::{Footprint, Profile, Stop, TangentClamp};
use crate::splat::project::Row;
use crate::tape::check::Step;
use crate::{Error, Result};

const MEANS: Port = Port::var("means", "N,3", "centres, scene units");
const QUATS: Port = Port::var("quats", "N,4", "w, x, y, z; any length but zero");
const SCALES: Port = Port::var("scales", "N,3", "standard deviations, scene units").moved(Step::Log);
const FACTORS: Port = Port::var("factors", "N,3,3", "F with Σ = F·Fᵀ, instead of quats and scales");
const OPACITIES: Port = Port::var("opacities", "N", "0..1").moved(Step::Logit);
const SH: Port = Port::var("sh", "N,K,3", "spherical-harmonics coefficients, K ≥ (degree+1)²");
const SH_DEGREE: Port = Port::int("sh_degree", "", Dtype::I64, "bands in use, 0 to 3");
const VIEWS: Port = Port::fixed("view_from_world", "C,4,4", "camera axes x right, y down, z forward");
const INTRINSICS: Port = Port::fixed("intrinsics", "C,3,3", "pixels");
const WIDTH: Port = Port::int("width", "", Dtype::I64, "pixels");
const HEIGHT: Port = Port::int("height", "", Dtype::I64, "pixels");
const NEAR: Port = Port::fixed("near", "", "smallest visible depth; absent: the profile's").or_absent();
const BACKGROUND: Port = Port::var("background", "3", "colour behind everything");

const MEANS_PX: Port =
    Port::var("means_px", "C,N,2", "pixels; the first pixel's centre is at 0.5").compared(VISIBLE);
const DEPTHS_Z: Port = Port::var("depths_z", "C,N", "camera depth, scene units").compared(VISIBLE);
const CONICS: Port =
    Port::fixed("conics", "C,N,3", "xx, xy, yy of Σ'⁻¹, 1/px²; for comparison only").compared(VISIBLE);
const RADII: Port =
    Port::int("radii_px", "C,N,2", Dtype::I32, "half-widths of the footprint, 0: touches no pixel")
        .compared(Compare::ZeroPattern);
const SHAPE: Port =
    Port::var("shape", "C,N,3", "s, k1, k2 of the ellipse; k1 = 0: not drawn").compared(VISIBLE);
const AXIS: Port = Port::int("axis", "C,N", Dtype::U8, "pivot axis, 0 = x, 1 = y").compared(VISIBLE);
const COLORS: Port = Port::var("colors", "C,N,3", "sRGB-encoded, ≥ 0").compared(VISIBLE);

const IMAGE: Port = Port::var("image", "C,H,W,3", "sRGB-encoded, not clamped");
const ALPHA: Port = Port::var("alpha", "C,H,W", "1 − final transmittance");
const DEPTH: Port = Port::var("depth", "C,H,W", "alpha-weighted depth, not normalised");
const COUNTS: Port = Port::int("counts", "C,H,W", Dtype::I64, "contributing Gaussians");

/// Rows of Gaussians that touch no pixel are nobody's business.
const VISIBLE: Compare = Compare::RowsOf("radii_px");

const ORDER: Port = Port::int("order", "V", Dtype::I32, "visible Gaussians of each camera by (z, index)");
const CAMERA_START: Port = Port::int("camera_start", "C+1", Dtype::I64, "bounds of each camera in order");
const TILE_START: Port = Port::int("tile_start", "C·TY·TX+1", Dtype::I64, "bounds of each tile's list");
const TILE_ENTRY: Port = Port::int("tile_entry", "E", Dtype::I32, "Gaussian of each entry");
const ENTRY_SLOT: Port = Port::int("entry_slot", "E", Dtype::I64, "emission slot of each entry");
const LAST_INDEX: Port =
    Port::int("last_index", "C,H,W", Dtype::I32, "place in the list of the last one included, −1 none");
const ALPHA_MASK: Port = Port::int("alpha_mask", "E,32", Dtype::U8, "bit 16·row + column: contributes");
const CAP_MASK: Port = Port::int("cap_mask", "E,32", Dtype::U8, "bit 16·row + column: α is capped");
const T_CLAMP: Port = Port::int("t_clamp", "C,N,2", Dtype::I8, "side on which the tangents are limited");
const COLOR_MASK: Port = Port::int("color_mask", "C,N,3", Dtype::U8, "1: the channel is not floored at 0");
const PIVOT: Port = Port::int("pivot", "C,N", Dtype::U8, "pivot axis");

const fn constant(key: &'static str, doc: &'static str) -> SettingSpec {
    SettingSpec { key, kind: Kind::Number, default: "of the profile", doc }
}

const fn choice(
    key: &'static str,
    words: &'static [&'static str],
    default: &'static str,
    doc: &'static str,
) -> SettingSpec {
    SettingSpec { key, kind: Kind::Choice(words), default, doc }
}

const SETTINGS: &[SettingSpec] = &[
    choice("profile", &["exact", "gsplat", "inria", "unlimited"], "exact", "constants and cut-offs"),
    choice(
        "camera",
        &["pinhole", "orthographic", "fisheye"],
        "pinhole",
        "projection model; fisheye is equidistant",
    ),
    constant("blur_px2", "added to both diagonal entries of Σ', px²"),
    constant("alpha_max", "cap of α"),
    constant("alpha_min", "α below it is skipped"),
    constant("t_stop", "transmittance at which the walk ends"),
    choice("stop", &["after", "before", "before_strict", "never"], "of the profile", "how the walk ends"),
    constant("near", "smallest visible depth; the input of that name wins"),
    constant("far", "largest visible depth"),
    choice("clamp", &["gsplat", "inria"], "of the profile", "limits of the Jacobian's tangents"),
    choice("footprint", &["alpha", "inria"], "of the profile", "which tiles a Gaussian is listed in"),
    SettingSpec {
        key: "antialiased",
        kind: Kind::Flag,
        default: "0",
        doc: "opacity times √(det Σ'₀/det Σ')",
    },
    SettingSpec {
        key: "inria_bwd",
        kind: Kind::Flag,
        default: "0",
        doc: "reproduce the three places where Inria's gradient is not the derivative",
    },
    SettingSpec {
        key: "tile",
        kind: Kind::Number,
        default: "16",
        doc: "tile side of the f32 forward: 8, 16 or 32; changes no bit",
    },
    SettingSpec {
        key: "cull",
        kind: Kind::Flag,
        default: "1",
        doc: "skip by exact ellipses in f32; changes no bit",
    },
];

/// The profile a call asks for.
fn profile(x: &Checked<'_>) -> Result<Profile> {
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

/// Rules of the settings and inputs that several of the operators have.
fn check_common(x: &Checked<'_>) -> Result<()> {
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
        // ō is a sum over pixels divided by o, and every pixel counts here
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

/// Either `quats` and `scales`, or `factors`.
fn check_shape(x: &Checked<'_>) -> Result<()> {
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
fn sh_degree(x: &Checked<'_>) -> Result<usize> {
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
fn cameras(x: &Checked<'_>) -> Result<Vec<Camera>> {
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

/// Refuses no cameras and more Gaussians or pixels than indices hold.
fn check_sizes(x: &Checked<'_>) -> Result<()> {
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
            .expected(format!("at most {MAX_PIXELS} pixels in all pictures together"))
            .got(pixels.to_string()));
    }
    Ok(())
}

/// Pixels of all pictures of one call: 2²⁸.
const MAX_PIXELS: u128 = 1 << 28;

/// Refuses Gaussians whose projection leaves the range of single precision; `rows` is (C, N).
fn check_range(rows: &[Row], n: usize) -> Result<()> {
    match crate::splat::project::out_of_range(rows) {
        None => Ok(()),
        Some(row) => Err(Error::input("arrays 'means', 'scales' (or 'factors')")
            .at(format!("camera {}, Gaussian {}", row / n, row % n))
            .expected("an ellipse within the range of f32 (--precision f64 reaches further)")
            .got(format!("u = {:?}, (s, k1, k2) = {:?}", rows[row].mean_px, rows[row].shape))),
    }
}

/// Rows as consecutive values.
fn flatten<const K: usize>(rows: &[[f32; K]]) -> Vec<f32> {
    rows.iter().flatten().copied().collect()
}
