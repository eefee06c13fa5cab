//! Ports and settings shared by several splatting operators.

use crate::ports::{Compare, Dtype, Port, SettingSpec, Space};

pub(super) const MEANS: Port = Port::var("N,3", "centres, scene units");
pub(super) const QUATS: Port = Port::var("N,4", "w, x, y, z; any length but zero");
pub(super) const SCALES: Port = Port::var("N,3", "standard deviations, scene units").moved(Space::Log);
pub(super) const FACTORS: Port = Port::var("N,3,3", "F with Σ = F·Fᵀ, instead of quats and scales");
pub(super) const OPACITIES: Port = Port::var("N", "0..1").moved(Space::Logit);
pub(super) const SH: Port = Port::var("N,K,3", "spherical-harmonics coefficients, K ≥ (degree+1)²");
pub(super) const SH_DEGREE: Port = Port::int("", Dtype::I64, "bands in use, 0 to 3");
pub(super) const VIEWS: Port = Port::fixed("C,4,4", "camera axes x right, y down, z forward");
pub(super) const INTRINSICS: Port = Port::fixed("C,3,3", "pixels");
pub(super) const WIDTH: Port = Port::int("", Dtype::I64, "pixels");
pub(super) const HEIGHT: Port = Port::int("", Dtype::I64, "pixels");
pub(super) const NEAR: Port = Port::fixed("", "smallest visible depth; absent: that of the profile");
pub(super) const BACKGROUND: Port = Port::var("3", "colour behind everything");

/// Rows of Gaussians that touch no pixel are not compared.
pub(super) const VISIBLE: Compare = Compare::RowsOf("radii_px");

pub(super) const MEANS_PX: Port =
    Port::var("C,N,2", "pixels; the first pixel's centre is at 0.5").compared(VISIBLE);
pub(super) const DEPTHS_Z: Port = Port::var("C,N", "camera depth, scene units").compared(VISIBLE);
pub(super) const CONICS: Port =
    Port::fixed("C,N,3", "xx, xy, yy of Σ'⁻¹, 1/px²; for comparison only").compared(VISIBLE);
pub(super) const RADII: Port =
    Port::int("C,N,2", Dtype::I32, "half-widths of the footprint, 0: touches no pixel")
        .compared(Compare::ZeroPattern);
pub(super) const SHAPE: Port =
    Port::var("C,N,3", "s, k1, k2 of the ellipse; k1 = 0: not drawn").compared(VISIBLE);
pub(super) const AXIS: Port = Port::int("C,N", Dtype::U8, "pivot axis, 0 = x, 1 = y").compared(VISIBLE);
pub(super) const COMPENSATION: Port =
    Port::var("C,N", "opacity factor, antialiased mode only").or_absent().compared(VISIBLE);
pub(super) const COLORS: Port = Port::var("C,N,3", "sRGB-encoded, ≥ 0").compared(VISIBLE);

pub(super) const IMAGE: Port = Port::var("C,H,W,3", "sRGB-encoded, not clamped");
pub(super) const ALPHA: Port = Port::var("C,H,W", "1 − final transmittance");
pub(super) const DEPTH: Port = Port::var("C,H,W", "alpha-weighted depth, not normalised");
pub(super) const COUNTS: Port = Port::int("C,H,W", Dtype::I64, "contributing Gaussians");

pub(super) const ORDER: Port = Port::int("V", Dtype::I32, "visible Gaussians of each camera by (z, index)");
pub(super) const CAMERA_START: Port = Port::int("C+1", Dtype::I64, "bounds of each camera in order");
pub(super) const TILE_START: Port = Port::int("C·TY·TX+1", Dtype::I64, "bounds of each tile's list");
pub(super) const TILE_ENTRY: Port = Port::int("E", Dtype::I32, "Gaussian of each entry");
pub(super) const ENTRY_SLOT: Port = Port::int("E", Dtype::I64, "emission slot of each entry");
pub(super) const LAST_INDEX: Port =
    Port::int("C,H,W", Dtype::I32, "index in the list of the last one included, −1 none");
pub(super) const ALPHA_MASK: Port = Port::int("E,32", Dtype::U8, "bit 16·row + column: contributes");
pub(super) const CAP_MASK: Port = Port::int("E,32", Dtype::U8, "bit 16·row + column: α is capped");
pub(super) const T_CLAMP: Port = Port::int("C,N,2", Dtype::I8, "side on which the tangents are limited");
pub(super) const COLOR_MASK: Port = Port::int("C,N,3", Dtype::U8, "1: the channel is not floored at 0");
pub(super) const PIVOT: Port = Port::int("C,N", Dtype::U8, "pivot axis");

const fn constant(key: &'static str, doc: &'static str) -> SettingSpec {
    SettingSpec::number(key, "of the profile", doc)
}

/// `tile` and `cull` configure the f32 fast path; they change no value, and the twin ignores them.
pub(super) const SETTINGS: &[SettingSpec] = &[
    SettingSpec::choice(
        "profile",
        &["exact", "gsplat", "inria", "unlimited"],
        "exact",
        "constants and cut-offs",
    ),
    SettingSpec::choice(
        "camera",
        &["pinhole", "orthographic", "fisheye"],
        "pinhole",
        "projection model; fisheye is equidistant",
    ),
    constant("blur_px2", "added to both diagonal entries of Σ', px²"),
    constant("alpha_max", "cap of α"),
    constant("alpha_min", "α below it is skipped"),
    constant("t_stop", "transmittance at which the loop ends"),
    SettingSpec::choice(
        "stop",
        &["after", "before", "before_strict", "never"],
        "of the profile",
        "how the loop over a pixel's list ends",
    ),
    constant("near", "smallest visible depth; the input near takes precedence"),
    constant("far", "largest visible depth"),
    SettingSpec::choice("clamp", &["gsplat", "inria"], "of the profile", "limits of the Jacobian's tangents"),
    SettingSpec::choice(
        "footprint",
        &["alpha", "inria"],
        "of the profile",
        "which tiles a Gaussian is listed in",
    ),
    SettingSpec::flag("antialiased", "0", "opacity times √(det Σ'₀/det Σ')"),
    SettingSpec::flag(
        "inria_bwd",
        "0",
        "reproduce Inria's three deviations of the gradient from the derivative",
    ),
    SettingSpec::number("tile", "16", "tile side of the f32 forward: 8, 16 or 32; changes no bit"),
    SettingSpec::flag("cull", "1", "skip by exact ellipses in f32; changes no bit"),
];
