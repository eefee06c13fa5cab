//! Cameras and images of a COLMAP model, in either form.

use super::frame::Lens;
use super::image_data;
use crate::{Error, Result};

/// Name, number of parameters and support of every model, by id.
pub(super) const MODELS: [(&str, usize, bool); 12] = [
    ("SIMPLE_PINHOLE", 3, true),
    ("PINHOLE", 4, true),
    ("SIMPLE_RADIAL", 4, true),
    ("RADIAL", 5, true),
    ("OPENCV", 8, true),
    ("OPENCV_FISHEYE", 8, true),
    ("FULL_OPENCV", 12, true),
    ("FOV", 5, false),
    ("SIMPLE_RADIAL_FISHEYE", 4, true),
    ("RADIAL_FISHEYE", 5, true),
    ("THIN_PRISM_FISHEYE", 12, false),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16, false),
];

/// A lens and an image size.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// f_x, f_y in pixels.
    pub focal: [f64; 2],
    /// Principal point; the first pixel's centre is at 0.5.
    pub center: [f64; 2],
    /// Distortion.
    pub lens: Lens,
}

/// A posed image.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Id in the file.
    pub id: u32,
    /// World to camera, w x y z.
    pub rotation: [f64; 4],
    /// World to camera.
    pub translation: [f64; 3],
    /// Id of its camera.
    pub camera: u32,
    /// Path below the folder of images.
    pub name: String,
}

/// A camera from its model and parameters; the caller adds the place to errors.
pub(super) fn camera(model: usize, size: [u64; 2], p: &[f64], at: &dyn Fn() -> Error) -> Result<Camera> {
    let (name, count, supported) = MODELS[model];
    if !supported {
        let have: Vec<_> = MODELS.iter().filter(|m| m.2).map(|m| m.0).collect();
        return Err(at().expected(format!("a camera model out of {}", have.join(", "))).got(name));
    }
    if p.len() != count {
        return Err(at().expected(format!("{count} parameters of {name}")).got(p.len().to_string()));
    }
    let side = image_data::MAX_SIDE as u64;
    if size.iter().any(|&s| s == 0 || s > side) {
        return Err(at()
            .expected(format!("1 to {side} pixels a side"))
            .got(format!("{}x{}", size[0], size[1])));
    }
    if let Some(x) = p.iter().find(|x| !(-1e9..=1e9).contains(*x)) {
        return Err(at().expected("finite parameters").got(x.to_string()));
    }
    let perspective = |k: &[f64], d: [f64; 3], t: [f64; 2]| {
        let mut numerator = [0.0; 4];
        numerator[..k.len()].copy_from_slice(k);
        Lens::Perspective { numerator, denominator: d, tangential: t }
    };
    let fisheye = |k: &[f64]| {
        let mut all = [0.0; 4];
        all[..k.len()].copy_from_slice(k);
        Lens::Fisheye { k: all }
    };
    let one = matches!(
        name,
        "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "SIMPLE_RADIAL_FISHEYE" | "RADIAL_FISHEYE"
    );
    let (focal, rest) = if one { ([p[0], p[0]], &p[1..]) } else { ([p[0], p[1]], &p[2..]) };
    if !(focal[0] > 0.0 && focal[1] > 0.0) {
        return Err(at().expected("positive focal lengths").got(format!("{focal:?}")));
    }
    let (center, k) = ([rest[0], rest[1]], &rest[2..]);
    let lens = match name {
        "SIMPLE_RADIAL" | "RADIAL" => perspective(k, [0.0; 3], [0.0; 2]),
        "OPENCV" => perspective(&k[..2], [0.0; 3], [k[2], k[3]]),
        // k1 k2 p1 p2 k3 k4 k5 k6, the last three in the denominator
        "FULL_OPENCV" => perspective(&[k[0], k[1], k[4]], [k[5], k[6], k[7]], [k[2], k[3]]),
        "OPENCV_FISHEYE" | "SIMPLE_RADIAL_FISHEYE" | "RADIAL_FISHEYE" => fisheye(k),
        _ => Lens::PINHOLE,
    };
    Ok(Camera { size: [size[0] as usize, size[1] as usize], focal, center, lens })
}

/// Checks a pose; the caller adds the place to errors.
pub(super) fn check_pose(q: &[f64], t: &[f64], at: &dyn Fn() -> Error) -> Result<()> {
    if let Some(x) = q.iter().chain(t).find(|x| !(-1e15..=1e15).contains(*x)) {
        return Err(at().expected("a finite pose").got(x.to_string()));
    }
    let n = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
    if !(1e-12..).contains(&n) {
        return Err(at().expected("a quaternion other than zero").got(format!("{q:?}")));
    }
    Ok(())
}
