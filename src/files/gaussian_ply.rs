//! 3DGS scenes and coloured points in PLY files.
//!
//! Properties are found by name: `x y z`, `f_dc_0..2`, `f_rest_0..44` (or 0, 9, 24 of them),
//! `opacity`, `scale_0..2`, `rot_0..3`; normals and anything else are ignored. Values are stored
//! as trained: opacity is a logit, scales are natural logarithms, rotations are w, x, y, z of any
//! length, colour = ½ + 0.28209479 · `f_dc` sRGB-encoded. `f_rest` is channel-major in the file
//! (all of red, then green, then blue) and (N, K, 3) in memory.

use super::ply::{Column, Element, Ply};
use super::{atomic, name_of, ply};
use crate::num::order;
use crate::{Error, Result};
use std::path::Path;

/// The constant of spherical-harmonics band 0, ½√(1/π).
pub const SH_C0: f64 = 0.282_094_791_773_878_14;

/// N Gaussians as a file stores them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GaussianRecord {
    /// (N, 3) centres
    pub means: Vec<[f32; 3]>,
    /// (N, 4) w, x, y, z, not normalised
    pub quats: Vec<[f32; 4]>,
    /// (N, 3) natural logarithms of the standard deviations
    pub scales_log: Vec<[f32; 3]>,
    /// (N) logits
    pub opacity_logits: Vec<f32>,
    /// (N, K, 3) row-major, K = (degree+1)²
    pub sh: Vec<f32>,
    /// 0 to 3
    pub sh_degree: usize,
    /// Text of the comment lines.
    pub comments: Vec<String>,
}

/// Coloured points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Points {
    /// (N, 3) positions
    pub xyz: Vec<[f64; 3]>,
    /// (N, 3) sRGB-encoded colours
    pub rgb: Vec<[u8; 3]>,
}

/// Reads a 3DGS scene.
///
/// # Errors
/// When the file is not readable, malformed, lacks a property, or a value is not finite.
pub fn read(path: &Path) -> Result<GaussianRecord> {
    gaussians(&ply::read(path)?, &name_of(path))
}

/// Like [`read`], but values may be any numbers, also NaN: rows are to be checked, and bad ones dropped, afterwards.
///
/// # Errors
/// When the file is not readable, malformed, or lacks a property.
pub fn read_unchecked(path: &Path) -> Result<GaussianRecord> {
    gaussians_of(&ply::read(path)?, &name_of(path), Values::Any)
}

/// Like [`read`] for bytes in memory; `name` is the file name in errors.
///
/// # Errors
/// See [`read`].
pub fn parse(bytes: &[u8], name: &str) -> Result<GaussianRecord> {
    gaussians(&ply::parse(bytes, name)?, name)
}

/// Reads a point cloud. Colours are `red green blue` (bytes, or floats in 0..1), else those of `f_dc`, else
/// mid grey.
///
/// # Errors
/// As for [`read`].
pub fn read_points(path: &Path) -> Result<Points> {
    points(&ply::read(path)?, &name_of(path))
}

/// Like [`read_points`] for bytes in memory; `name` is the file name in errors.
///
/// # Errors
/// See [`read_points`].
pub fn parse_points(bytes: &[u8], name: &str) -> Result<Points> {
    points(&ply::parse(bytes, name)?, name)
}

fn vertices<'a>(ply: &'a Ply, name: &str) -> Result<&'a Element> {
    ply.element("vertex").ok_or_else(|| {
        let have: Vec<_> = ply.elements.iter().map(|e| e.name.as_str()).collect();
        Error::input(name).expected("an element 'vertex'").got(format!("[{}]", have.join(", ")))
    })
}

fn need<'a>(e: &'a Element, property: &str, name: &str) -> Result<&'a Column> {
    e.column(property).ok_or_else(|| {
        let error = Error::input(name)
            .at("element vertex")
            .expected(format!("a property '{property}'"))
            .got(format!("{} others", e.columns.len()));
        if e.column("packed_position").is_some() {
            error.hint(
                "this is a compressed PLY; convert it with `splat-transform SCENE.compressed.ply SCENE.ply`, or in SuperSplat: export PLY",
            )
        } else if property == "scale_2" {
            error.hint("this may be a file of flat (2-D) Gaussians")
        } else {
            error
        }
    })
}

/// Which values are accepted.
#[derive(Clone, Copy, PartialEq)]
enum Values {
    Finite,
    Any,
}

fn finite(c: &Column, row: usize, name: &str) -> Result<f32> {
    number(c, row, name, Values::Finite)
}

fn number(c: &Column, row: usize, name: &str, accepted: Values) -> Result<f32> {
    let x = c.f32(row);
    if x.is_finite() || accepted == Values::Any {
        return Ok(x);
    }
    Err(Error::input(name)
        .at(format!("element vertex, row {row}, property {}", c.name))
        .expected("a finite number")
        .got(c.f64(row).to_string()))
}

fn rows<const K: usize>(
    e: &Element,
    properties: [&str; K],
    name: &str,
    accepted: Values,
) -> Result<Vec<[f32; K]>> {
    let mut columns = Vec::with_capacity(K);
    for p in properties {
        columns.push(need(e, p, name)?);
    }
    let mut out = Vec::with_capacity(e.rows);
    for row in 0..e.rows {
        let mut v = [0.0; K];
        for (x, c) in v.iter_mut().zip(&columns) {
            *x = number(c, row, name, accepted)?;
        }
        out.push(v);
    }
    Ok(out)
}

/// The Gaussians of a parsed file.
///
/// # Errors
/// When a property is missing or a value is not finite.
pub fn gaussians(ply: &Ply, name: &str) -> Result<GaussianRecord> {
    gaussians_of(ply, name, Values::Finite)
}

fn gaussians_of(ply: &Ply, name: &str, accepted: Values) -> Result<GaussianRecord> {
    let e = vertices(ply, name)?;
    let means = rows(e, ["x", "y", "z"], name, accepted)?;
    let dc = rows(e, ["f_dc_0", "f_dc_1", "f_dc_2"], name, accepted)?;
    let opacity_logits = rows(e, ["opacity"], name, accepted)?.into_iter().map(|[x]| x).collect();
    let scales_log = rows(e, ["scale_0", "scale_1", "scale_2"], name, accepted)?;
    let quats = rows(e, ["rot_0", "rot_1", "rot_2", "rot_3"], name, accepted)?;
    let count = e.columns.iter().filter(|c| c.name.starts_with("f_rest_")).count();
    let (sh_degree, per_channel) = match count {
        0 => (0, 0),
        9 => (1, 3),
        24 => (2, 8),
        45 => (3, 15),
        _ => {
            return Err(Error::input(name)
                .at("element vertex")
                .expected("0, 9, 24 or 45 properties f_rest_* (degree 0 to 3)")
                .got(count.to_string()));
        }
    };
    let mut rest = Vec::with_capacity(count);
    for i in 0..count {
        rest.push(need(e, &format!("f_rest_{i}"), name)?);
    }
    let mut sh = Vec::with_capacity(e.rows * 3 * (1 + per_channel));
    for row in 0..e.rows {
        sh.extend_from_slice(&dc[row]);
        for k in 0..per_channel {
            for channel in 0..3 {
                sh.push(number(rest[channel * per_channel + k], row, name, accepted)?);
            }
        }
    }
    Ok(GaussianRecord {
        means,
        quats,
        scales_log,
        opacity_logits,
        sh,
        sh_degree,
        comments: ply.comments.clone(),
    })
}

/// The points of a parsed file.
///
/// # Errors
/// When a position is missing or a value is not finite.
pub fn points(ply: &Ply, name: &str) -> Result<Points> {
    let e = vertices(ply, name)?;
    let xyz = [need(e, "x", name)?, need(e, "y", name)?, need(e, "z", name)?];
    let find = |names: [&str; 3]| -> Option<Vec<&Column>> { names.iter().map(|n| e.column(n)).collect() };
    let byte = find(["red", "green", "blue"]);
    let dc = find(["f_dc_0", "f_dc_1", "f_dc_2"]);
    let mut out = Points { xyz: Vec::with_capacity(e.rows), rgb: Vec::with_capacity(e.rows) };
    for row in 0..e.rows {
        let mut p = [0.0; 3];
        for (x, c) in p.iter_mut().zip(&xyz) {
            finite(c, row, name)?;
            *x = c.f64(row);
        }
        out.xyz.push(p);
        let mut rgb = [128; 3];
        for (i, channel) in rgb.iter_mut().enumerate() {
            if let Some(c) = byte.as_ref().map(|c| c[i]) {
                let x = f64::from(finite(c, row, name)?);
                *channel = match c.kind {
                    ply::Type::U8 => x as u8,
                    t if t.is_float() => to_byte(x),
                    t => {
                        return Err(Error::input(name)
                            .at(format!("element vertex, property {}", c.name))
                            .expected("type uchar or float")
                            .got(format!("{t:?}")));
                    }
                };
            } else if let Some(c) = dc.as_ref().map(|c| c[i]) {
                *channel = to_byte(0.5 + SH_C0 * f64::from(finite(c, row, name)?));
            }
        }
        out.rgb.push(rgb);
    }
    Ok(out)
}

/// 0..1 to a byte: clamped, rounded half up.
pub(super) fn to_byte(x: f64) -> u8 {
    order::clamp((x * 255.0 + 0.5).floor(), 0.0, 255.0) as u8
}

/// The bytes of a 3DGS scene: binary little endian, all `float`, in the usual order, normals zero.
pub fn to_bytes(g: &GaussianRecord) -> Vec<u8> {
    let n = g.means.len();
    let k = (g.sh_degree + 1) * (g.sh_degree + 1);
    let mut out = Vec::with_capacity(2048 + n * 4 * (14 + 3 * k));
    let mut text = String::from("ply\nformat binary_little_endian 1.0\n");
    for c in &g.comments {
        // A line break would end the comment and start something else.
        text.push_str(&format!("comment {}\n", c.replace(['\n', '\r'], " ")));
    }
    text.push_str(&format!("element vertex {n}\n"));
    let mut names: Vec<String> = ["x", "y", "z", "nx", "ny", "nz"].map(String::from).to_vec();
    names.extend((0..3).map(|i| format!("f_dc_{i}")));
    names.extend((0..3 * (k - 1)).map(|i| format!("f_rest_{i}")));
    names.push("opacity".into());
    names.extend((0..3).map(|i| format!("scale_{i}")));
    names.extend((0..4).map(|i| format!("rot_{i}")));
    for name in names {
        text.push_str(&format!("property float {name}\n"));
    }
    text.push_str("end_header\n");
    out.extend_from_slice(text.as_bytes());
    for i in 0..n {
        let mut put = |x: f32| out.extend_from_slice(&x.to_le_bytes());
        g.means[i].iter().for_each(|&x| put(x));
        [0.0; 3].iter().for_each(|&x| put(x));
        let sh = &g.sh[i * 3 * k..(i + 1) * 3 * k];
        sh[..3].iter().for_each(|&x| put(x));
        for channel in 0..3 {
            for j in 1..k {
                put(sh[3 * j + channel]);
            }
        }
        put(g.opacity_logits[i]);
        g.scales_log[i].iter().for_each(|&x| put(x));
        g.quats[i].iter().for_each(|&x| put(x));
    }
    out
}

/// Writes a 3DGS scene atomically.
///
/// # Errors
/// When the file cannot be written.
pub fn write(path: &Path, g: &GaussianRecord) -> Result<()> {
    atomic::write_bytes(path, &to_bytes(g))
}

/// Writes coloured points as binary little-endian `x y z` (double) and `red green blue` (uchar).
///
/// # Errors
/// When the file cannot be written.
pub fn write_points(path: &Path, p: &Points) -> Result<()> {
    atomic::write(path, |w| {
        write!(w, "ply\nformat binary_little_endian 1.0\nelement vertex {}\n", p.xyz.len())?;
        w.write_all(b"property double x\nproperty double y\nproperty double z\n")?;
        w.write_all(b"property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n")?;
        for (xyz, rgb) in p.xyz.iter().zip(&p.rgb) {
            for x in xyz {
                w.write_all(&x.to_le_bytes())?;
            }
            w.write_all(rgb)?;
        }
        Ok(())
    })
}
