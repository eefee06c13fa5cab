//! Renders of the Digital Twin Catalog, the form in which LIRM's data are published: one rig, images by their number.

use super::record::{Axes, Layout, ObjectSet, ObjectShot, Part, required, there};
use crate::io::capture::{Split, nearest_rotation, rigid};
use crate::io::{image_data, json, name_of, read_bytes};
use crate::{Error, Result};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Longest list that is read, in bytes.
const MAX_BYTES: u64 = 64 << 20;

/// The folder with the rig: `dir/images`, or `dir` itself.
pub(super) fn images_of(dir: &Path) -> Option<PathBuf> {
    [dir.join("images"), dir.to_path_buf()].into_iter().find(|d| d.join("CameraRig.json").is_file())
}

pub(super) fn read(dir: &Path) -> Result<ObjectSet> {
    let images = images_of(dir).unwrap_or_else(|| dir.join("images"));
    let path = images.join("CameraRig.json");
    let rig = Rig::parse(&read_bytes(&path, MAX_BYTES)?, &name_of(&path))?;
    let folder = images.join("rgb");
    let count = rig.poses.len();
    let exposures = exposures(&images.join("image_process_info.json"), count)?;
    let shots = rig.poses.iter().enumerate().map(|(i, pose)| {
        let file = |kind: &str, ending: &str| folder.join(format!("{kind}{i:07}.{ending}"));
        let entry = format!("to_world[{i}]");
        let hint = |e: Error| match folder.join("rgb.tar").is_file() {
            true => e.hint("unpack the .tar files in that folder first"),
            false => e,
        };
        Ok(ObjectShot {
            name: format!("{i:07}"),
            part: Part::Own(Split::Unknown),
            photo: Some(required(file("rgb", "png"), &path, &entry).map_err(hint)?),
            radiance: None,
            mask: required(file("mask", "png"), &path, &entry)?,
            view_from_world: *pose,
            fov_x_rad: rig.fov_x_rad,
            size: Some(rig.size),
            exposure: exposures.as_ref().map(|e| e[i]),
            depth: there(file("depth", "exr")),
            normal: there(file("normal", "exr")),
            normal_axes: Axes::World,
            albedo: there(file("albedo", "png")),
            material: there(file("metallic_roughness", "png")),
            environment: None,
        })
    });
    let shots = shots.collect::<Result<Vec<_>>>()?;
    let next = folder.join(format!("rgb{count:07}.png"));
    if next.is_file() {
        return Err(Error::input(name_of(&path))
            .at("to_world")
            .expected(format!("a pose for every image in {}", folder.display()))
            .got(format!("{count} poses, and an image {}", name_of(&next))));
    }
    Ok(ObjectSet { layout: Layout::Dtc, shots, scan: None })
}

/// The cameras of a set.
struct Rig {
    size: [usize; 2],
    fov_x_rad: f64,
    poses: Vec<[[f64; 4]; 4]>,
}

impl Rig {
    fn parse(bytes: &[u8], name: &str) -> Result<Self> {
        let value = json::parse(bytes, name)?;
        let wrong = |at: &str, expected: &str, got: &Value| {
            let text: String = got.to_string().chars().take(60).collect();
            Error::input(name).at(at.to_owned()).expected(expected).got(text)
        };
        let intrinsic = &value["intrinsic"];
        let side = |key: &str| {
            let v = &intrinsic[key];
            let most = image_data::MAX_SIDE as u64;
            let side = v.as_u64().filter(|x| (1..=most).contains(x)).map(|x| x as usize);
            side.ok_or_else(|| wrong(&format!("intrinsic.{key}"), &format!("an integer from 1 to {most}"), v))
        };
        let size = [side("width")?, side("height")?];
        let fov = intrinsic["fov"].as_f64().filter(|x| *x > 0.0 && *x < 180.0);
        let fov =
            fov.ok_or_else(|| wrong("intrinsic.fov", "degrees above 0 and below 180", &intrinsic["fov"]))?;
        let list = value["to_world"].as_array();
        let list = list.ok_or_else(|| wrong("to_world", "a list of 4x4 matrices", &value["to_world"]))?;
        let poses = list.iter().enumerate().map(|(i, m)| pose(m, &format!("to_world[{i}]"), name));
        Ok(Self { size, fov_x_rad: fov.to_radians(), poses: poses.collect::<Result<_>>()? })
    }
}

/// A camera-to-world matrix with OpenGL axes as world-to-camera with z forward.
fn pose(value: &Value, at: &str, name: &str) -> Result<[[f64; 4]; 4]> {
    let wrong = |got: String| {
        Error::input(name).at(at.to_owned()).expected("a rigid 4x4 matrix of finite numbers").got(got)
    };
    let cell = |i: usize, j: usize| value.get(i)?.get(j)?.as_f64().filter(|x| x.abs() < 1e15);
    let is_square = |v: &Value| v.as_array().is_some_and(|r| r.len() == 4);
    let rows = value.as_array().filter(|_| is_square(value));
    if !rows.is_some_and(|rows| rows.iter().all(is_square)) {
        return Err(wrong("another form".into()));
    }
    let mut m = [[0.0f64; 4]; 4];
    for (i, row) in m.iter_mut().enumerate() {
        for (j, x) in row.iter_mut().enumerate() {
            *x = cell(i, j).ok_or_else(|| wrong(format!("no number in row {i}, column {j}")))?;
        }
    }
    if (0..4).any(|j| (m[3][j] - [0.0, 0.0, 0.0, 1.0][j]).abs() > 1e-6) {
        return Err(wrong(format!("a last row {:?}", m[3])));
    }
    let turned = std::array::from_fn(|i: usize| [m[i][0], -m[i][1], -m[i][2]]);
    let c2w = nearest_rotation(turned).map_err(wrong)?;
    let r: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| c2w[j][i]));
    let t = std::array::from_fn(|i| -((r[i][0] * m[0][3] + r[i][1] * m[1][3]) + r[i][2] * m[2][3]));
    Ok(rigid(r, t))
}

/// The exposures of the images, if the set has them.
fn exposures(path: &Path, count: usize) -> Result<Option<Vec<f64>>> {
    if !path.is_file() {
        return Ok(None);
    }
    let name = name_of(path);
    let value = json::parse(&read_bytes(path, MAX_BYTES)?, &name)?;
    let Some(list) = value["rgb"].get("autoexposure_scale") else { return Ok(None) };
    let wrong = |expected: String, got: String| {
        Error::input(name.clone()).at("rgb.autoexposure_scale").expected(expected).got(got)
    };
    let numbers: Option<Vec<f64>> = list
        .as_array()
        .and_then(|all| all.iter().map(|x| x.as_f64().filter(|x| *x > 0.0 && x.is_finite())).collect());
    let numbers = numbers.ok_or_else(|| {
        wrong("a list of positive numbers".into(), list.to_string().chars().take(60).collect())
    })?;
    if numbers.len() != count {
        return Err(wrong(format!("{count} numbers, one per camera"), numbers.len().to_string()));
    }
    Ok(Some(numbers))
}
