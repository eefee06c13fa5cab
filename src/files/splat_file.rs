//! `.splat`: 32 bytes for every Gaussian, no header, degree 0 only; the format of small web viewers.
//!
//! | bytes | content |
//! |---|---|
//! | 0..12 | f32 x, y, z |
//! | 12..24 | f32 standard deviations (linear) |
//! | 24..28 | u8 red, green, blue, alpha: 255 times colour ½ + C₀ `f_dc` and opacity, to nearest |
//! | 28..32 | u8 w, x, y, z of the unit quaternion: 128 q + 128, to nearest |
//!
//! Rows are sorted by −exp(sum of the logarithmic scales) · opacity, ties by index: large opaque ones first.

use super::gaussian_ply::{GaussianRecord, SH_C0, to_byte};
use super::{MAX_FILE_BYTES, atomic, memory, name_of, read_bytes};
use crate::num::order;
use crate::{Error, Result};
use std::path::Path;

/// Bytes of one row.
pub const ROW: usize = 32;

/// One Gaussian as the file stores it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Splat {
    /// centre
    pub mean: [f32; 3],
    /// standard deviations
    pub scale: [f32; 3],
    /// sRGB-encoded colour and opacity
    pub rgba: [u8; 4],
    /// w, x, y, z as 128 q + 128
    pub rotation: [u8; 4],
}

/// Reads a file.
///
/// # Errors
/// When it is not readable, not a multiple of 32 bytes long, or a value is not finite or a scale not
/// positive.
pub fn read(path: &Path) -> Result<Vec<Splat>> {
    parse(&read_bytes(path, MAX_FILE_BYTES)?, &name_of(path))
}

/// Like [`read`], but values may be any numbers: rows are to be checked, and bad ones dropped, afterwards.
///
/// # Errors
/// When the file is not readable or not a multiple of 32 bytes long.
pub fn read_unchecked(path: &Path) -> Result<Vec<Splat>> {
    rows(&read_bytes(path, MAX_FILE_BYTES)?, &name_of(path), |_, _| Ok(()))
}

/// Like [`read`] for bytes in memory; `name` is the file name in errors.
///
/// # Errors
/// See [`read`].
pub fn parse(bytes: &[u8], name: &str) -> Result<Vec<Splat>> {
    rows(bytes, name, |row, s| {
        let bad = |field: &str, expected: &str, got: String| {
            Err(Error::input(name)
                .at(format!("row {row} (byte {}), {field}", row * ROW))
                .expected(expected)
                .got(got))
        };
        if !s.mean.iter().all(|x| x.is_finite()) {
            return bad("position", "finite numbers", format!("{:?}", s.mean));
        }
        if !s.scale.iter().all(|x| *x > 0.0 && x.is_finite()) {
            return bad("scale", "positive finite numbers", format!("{:?}", s.scale));
        }
        if s.rotation == [128; 4] {
            return bad("rotation", "a quaternion other than zero", format!("{:?}", s.rotation));
        }
        Ok(())
    })
}

/// The rows of a file, each of which passes `check`.
fn rows(bytes: &[u8], name: &str, check: impl Fn(usize, &Splat) -> Result<()>) -> Result<Vec<Splat>> {
    if !bytes.len().is_multiple_of(ROW) {
        return Err(Error::input(name).at("file size").expected("a multiple of 32 bytes").got(format!(
            "{}, which leaves {}",
            bytes.len(),
            bytes.len() % ROW
        )));
    }
    let mut out = memory::room(name, bytes.len() / ROW)?;
    for (row, b) in bytes.chunks_exact(ROW).enumerate() {
        let f = |i: usize| f32::from_le_bytes([b[i], b[i + 1], b[i + 2], b[i + 3]]);
        let s = Splat {
            mean: [f(0), f(4), f(8)],
            scale: [f(12), f(16), f(20)],
            rgba: [b[24], b[25], b[26], b[27]],
            rotation: [b[28], b[29], b[30], b[31]],
        };
        check(row, &s)?;
        out.push(s);
    }
    Ok(out)
}

/// The bytes of a file.
pub fn to_bytes(splats: &[Splat]) -> Vec<u8> {
    let mut out = Vec::with_capacity(splats.len() * ROW);
    for s in splats {
        for x in s.mean.iter().chain(&s.scale) {
            out.extend_from_slice(&x.to_le_bytes());
        }
        out.extend_from_slice(&s.rgba);
        out.extend_from_slice(&s.rotation);
    }
    out
}

/// Writes a file atomically.
///
/// # Errors
/// When it cannot be written.
pub fn write(path: &Path, splats: &[Splat]) -> Result<()> {
    atomic::write_bytes(path, &to_bytes(splats))
}

fn sigmoid(x: f64) -> f64 {
    1.0 / (1.0 + libm::exp(-x))
}

/// Quantises and sorts. Spherical harmonics above degree 0 are dropped.
///
/// # Rounding
/// f64 throughout, with `libm`; one rounding to f32 or to a byte (nearest, half up) at the end.
///
/// # Errors
/// When a quaternion is zero or a scale leaves the range of f32.
pub fn from_gaussians(g: &GaussianRecord, name: &str) -> Result<Vec<Splat>> {
    let n = g.means.len();
    let k = (g.sh_degree + 1) * (g.sh_degree + 1);
    let weight: Vec<f64> = (0..n)
        .map(|i| {
            let [a, b, c] = g.scales_log[i].map(f64::from);
            libm::exp(a + b + c) * sigmoid(f64::from(g.opacity_logits[i]))
        })
        .collect();
    let mut sorted: Vec<usize> = (0..n).collect();
    // Weights are sums of finite numbers through exp: never NaN.
    sorted.sort_by(|&a, &b| weight[b].total_cmp(&weight[a]).then(a.cmp(&b)));
    let mut out = Vec::with_capacity(n);
    for i in sorted {
        let scale = g.scales_log[i].map(|x| libm::exp(f64::from(x)) as f32);
        if !scale.iter().all(|x| *x > 0.0 && x.is_finite()) {
            return Err(Error::input(name)
                .at(format!("Gaussian {i}, logarithmic scales"))
                .expected("values whose exponential single precision holds")
                .got(format!("{:?}", g.scales_log[i])));
        }
        let q = g.quats[i].map(f64::from);
        let norm = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]).sqrt();
        if !(norm > 0.0 && norm.is_finite()) {
            let e = Error::input(name).at(format!("Gaussian {i}, quaternion"));
            return Err(e.expected("a length above zero").got(format!("{:?}", g.quats[i])));
        }
        let dc = &g.sh[i * 3 * k..i * 3 * k + 3];
        let color = |c: usize| to_byte(0.5 + SH_C0 * f64::from(dc[c]));
        out.push(Splat {
            mean: g.means[i],
            scale,
            rgba: [color(0), color(1), color(2), to_byte(sigmoid(f64::from(g.opacity_logits[i])))],
            rotation: q.map(|x| order::clamp((x / norm * 128.0 + 128.5).floor(), 0.0, 255.0) as u8),
        });
    }
    Ok(out)
}

/// The Gaussians of the rows, degree 0. Opacity 0 and 255 have no logit and become ½/255 and 254½/255.
///
/// # Rounding
/// f64 with `libm`, one rounding to f32 at the end.
pub fn to_gaussians(splats: &[Splat]) -> GaussianRecord {
    let mut g = GaussianRecord::default();
    for s in splats {
        g.means.push(s.mean);
        g.scales_log.push(s.scale.map(|x| libm::log(f64::from(x)) as f32));
        g.quats.push(s.rotation.map(|b| (f32::from(b) - 128.0) / 128.0));
        let a = order::clamp(f64::from(s.rgba[3]), 0.5, 254.5) / 255.0;
        g.opacity_logits.push(libm::log(a / (1.0 - a)) as f32);
        g.sh.extend(s.rgba[..3].iter().map(|&c| ((f64::from(c) / 255.0 - 0.5) / SH_C0) as f32));
    }
    g
}
