//! An avatar as named arrays, and as a self-contained file with body, Gaussians, networks, poses and cameras.

use super::body::Body;
use super::light::{self, Light};
use super::mlp::Mlp;
use super::person::Avatar;
use super::settings::Settings;
use crate::io::safetensors;
use crate::num::array::{Array, Arrays};
use crate::scene::camera::{Camera, Model};
use crate::scene::gaussians::Gaussians;
use crate::scene::person::{Affine, INFLUENCES, Kind, PersonCapture, Pose, Template};
use crate::{Error, Result};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

/// The kind recorded in the metadata of an avatar file.
const KIND: &str = "avatar";

/// An avatar with the moments and cameras of its fit.
#[derive(Clone, Debug)]
pub struct Stored {
    /// The avatar.
    pub avatar: Avatar,
    /// Poses of the capture, shape (T).
    pub poses: Vec<Pose>,
    /// The cameras with their numbers, training cameras first.
    pub cameras: Vec<(usize, Camera)>,
    /// Settings of the fit.
    pub settings: Value,
}

/// Stores the Gaussians as `param/…`, and the indices of the template points to which they are attached.
pub(super) fn put(avatar: &Avatar, state: bool, out: &mut Arrays) {
    avatar.gaussians.save("param/", out);
    out.put("param/nearest", &[avatar.nearest.len()], avatar.nearest.iter().map(|&p| i64::from(p)).collect());
    for net in [&avatar.weights_net, &avatar.pose_net].into_iter().flatten() {
        net.save(state, out);
    }
    if let Some(light) = &avatar.light {
        light.save(state, out);
    }
}

/// Reads an integer array of numbers below 2³².
pub(super) fn counts(a: &Array, name: &str) -> Result<Vec<u32>> {
    let all = if a.is_float() { None } else { a.to_i64() };
    all.and_then(|v| v.into_iter().map(|n| u32::try_from(n).ok()).collect())
        .ok_or_else(|| Error::input(format!("array '{name}'")).expected("counts below 2³²"))
}

/// Restores what [`put`] stored: the Gaussians of this SH degree and the indices of their points.
pub(super) fn get(degree: usize, from: &Arrays) -> Result<(Gaussians, Vec<u32>)> {
    let gaussians = Gaussians::load("param/", degree, from)?;
    let rows = gaussians.len().to_string();
    let nearest = counts(from.shape("param/nearest", &rows, &mut BTreeMap::new())?, "param/nearest")?;
    Ok((gaussians, nearest))
}

fn flat(a: &[Affine]) -> Vec<f32> {
    a.iter().flatten().flatten().copied().collect()
}

fn affines(a: &[f32]) -> Vec<Affine> {
    a.as_chunks::<12>()
        .0
        .iter()
        .map(|m| std::array::from_fn(|i| std::array::from_fn(|j| m[4 * i + j])))
        .collect()
}

/// Writes an avatar with the poses and the cameras of its capture.
///
/// # Errors
/// If the file cannot be written.
pub fn write(path: &Path, avatar: &Avatar, capture: &PersonCapture, settings: &Value) -> Result<()> {
    let mut out = Arrays::new();
    put(avatar, false, &mut out);
    let t = &avatar.body.template;
    let (p, k, moments) = (t.len(), t.joints.len(), capture.poses.len());
    out.put("body/points", &[p, 3], t.points.as_flattened().to_vec());
    out.put("body/normals", &[t.normals.len(), 3], t.normals.as_flattened().to_vec());
    out.put(
        "body/joint_of",
        &[p, INFLUENCES],
        t.joint_of.as_flattened().iter().map(|&j| i64::from(j)).collect(),
    );
    out.put("body/weight_of", &[p, INFLUENCES], t.weight_of.as_flattened().to_vec());
    out.put("body/joints", &[k, 3], t.joints.as_flattened().to_vec());
    out.put("body/parents", &[k], t.parents.iter().map(|p| p.map_or(-1, |p| p as i64)).collect());
    out.put("body/canonical", &[k, 3, 4], flat(&t.canonical));
    if let Some(shapes) = &t.pose_shapes {
        out.put("body/pose_shapes", &[p, 3, shapes.len() / (3 * p)], shapes.clone());
    }
    let transforms: Vec<f32> = capture.poses.iter().flat_map(|x| flat(&x.transforms)).collect();
    out.put("poses/transforms", &[moments, k, 3, 4], transforms);
    let angles: Vec<f32> = capture.poses.iter().flat_map(|x| x.axis_angles.as_flattened()).copied().collect();
    out.put("poses/axis_angles", &[moments, k, 3], angles);
    let mut cameras: Vec<(usize, &Camera)> = Vec::new();
    for shot in capture.train.iter().chain(&capture.test).map(|&i| &capture.shots[i]) {
        if !cameras.iter().any(|(id, _)| *id == shot.camera_id) {
            cameras.push((shot.camera_id, &shot.camera));
        }
    }
    let rows = cameras.iter().flat_map(|(_, c)| {
        let view =
            c.rotation.as_flattened().iter().chain(&c.translation).chain(&c.focal_px).chain(&c.center_px);
        view.copied().collect::<Vec<f32>>()
    });
    out.put("cameras/numbers", &[cameras.len(), 16], rows.collect());
    let sizes =
        cameras.iter().flat_map(|(id, c)| [*id as i64, c.width as i64, c.height as i64, c.model as i64]);
    out.put("cameras/sizes", &[cameras.len(), 4], sizes.collect());
    let meta = BTreeMap::from([
        ("kind".to_owned(), KIND.to_owned()),
        ("version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ("body".to_owned(), t.kind.name().to_owned()),
        ("unit_m".to_owned(), t.unit_m.to_string()),
        ("settings".to_owned(), settings.to_string()),
    ]);
    safetensors::write(path, &out, &meta)
}

/// Reads an avatar.
///
/// # Errors
/// If the file was not written by [`write()`].
pub fn read(path: &Path) -> Result<Stored> {
    let file = safetensors::read(path)?;
    from_parts(&file.arrays, &file.metadata).map_err(|e| e.within(path.display().to_string()))
}

fn from_parts(a: &Arrays, meta: &BTreeMap<String, String>) -> Result<Stored> {
    let text = |key: &str| {
        meta.get(key).map(String::as_str).ok_or_else(|| {
            Error::input("metadata").at(key).expected("an avatar written by a fit").got("no such entry")
        })
    };
    if text("kind")? != KIND {
        return Err(Error::input("metadata").at("kind").expected(KIND).got(text("kind")?));
    }
    let settings =
        crate::io::json::parse(text("settings")?.as_bytes(), "metadata").map_err(|e| e.at("settings"))?;
    let wrong = |key: &str| Error::input("metadata").at(key.to_owned()).expected("a number");
    let unit_m: f64 = text("unit_m")?.parse().map_err(|_| wrong("unit_m"))?;
    let template = template(a, Kind::parse(text("body")?), unit_m)?;
    let k = template.joints.len();
    let mut dims = BTreeMap::new();
    let transforms = a.shape("poses/transforms", &format!("T,{k},3,4"), &mut dims)?.to_f32();
    let angles = a.shape("poses/axis_angles", &format!("T,{k},3"), &mut dims)?.to_f32();
    let poses: Vec<Pose> = affines(&transforms)
        .chunks(k)
        .zip(angles.as_chunks::<3>().0.chunks(k))
        .map(|(t, v)| Pose { transforms: t.to_vec(), axis_angles: v.to_vec(), global: None })
        .collect();
    let cameras = cameras(a)?;
    let degree =
        settings["sh_degree"].as_u64().filter(|d| *d <= 3).ok_or_else(|| wrong("sh_degree"))? as usize;
    let (gaussians, nearest) = get(degree, a)?;
    let body = Body::new(&template);
    let [weights, pose] = Avatar::networks(&body)?;
    let stored = |mut net: Mlp| -> Result<Option<Mlp>> {
        if !net.is_in(a) {
            return Ok(None);
        }
        net.load(false, a)?;
        Ok(Some(net))
    };
    let networks = [stored(weights)?, stored(pose)?];
    let light = match a.get(light::GAINS) {
        None => None,
        Some(_) => {
            let mut light = Light::new(poses.len())?;
            light.load(false, a)?;
            Some(light)
        }
    };
    let avatar =
        Avatar::from_parts(body, gaussians, nearest, networks, light, Settings::drawing(&settings)?)?;
    Ok(Stored { avatar, poses, cameras, settings })
}

fn template(a: &Arrays, kind: Kind, unit_m: f64) -> Result<Template> {
    let mut dims = BTreeMap::new();
    let mut floats = |name: &str, shape: &str| Ok::<_, Error>(a.shape(name, shape, &mut dims)?.to_f32());
    let points = floats("body/points", "P,3")?;
    let normals = floats("body/normals", "N,3")?;
    let weight_of = floats("body/weight_of", "P,4")?;
    let joints = floats("body/joints", "K,3")?;
    let canonical = floats("body/canonical", "K,3,4")?;
    let joint_of = counts(a.shape("body/joint_of", "P,4", &mut dims)?, "body/joint_of")?;
    let parents = a.shape("body/parents", "K", &mut dims)?.to_i64().unwrap_or_default();
    let (p, k) = (dims[&'P'], dims[&'K']);
    let bad =
        |name: &str, expected: &str| Error::input(format!("array '{name}'")).expected(expected.to_owned());
    if joint_of.iter().any(|&j| j as usize >= k) || p == 0 {
        return Err(bad("body/joint_of", "joints of the body"));
    }
    let parents: Vec<Option<usize>> = parents.iter().map(|&x| usize::try_from(x).ok()).collect();
    if parents.len() != k || parents.iter().flatten().any(|&x| x >= k) {
        return Err(bad("body/parents", "joints of the body, or -1"));
    }
    let Some(order) = parents_first(&parents) else { return Err(bad("body/parents", "no cycle")) };
    let pose_shapes = match a.get("body/pose_shapes") {
        Some(_) => {
            let shape = format!("P,3,{}", 9 * (k - 1));
            let shapes = a.shape("body/pose_shapes", &shape, &mut dims)?.to_f32();
            Some(shapes)
        }
        None => None,
    };
    a.finite(["body/points", "body/weight_of", "body/joints", "body/canonical"])?;
    Ok(Template {
        kind,
        unit_m,
        points: points.as_chunks().0.to_vec(),
        normals: normals.as_chunks().0.to_vec(),
        faces: Vec::new(),
        joint_of: joint_of.as_chunks::<INFLUENCES>().0.iter().map(|r| r.map(|j| j as u16)).collect(),
        weight_of: weight_of.as_chunks().0.to_vec(),
        joints: joints.as_chunks().0.to_vec(),
        parents,
        order,
        canonical: affines(&canonical),
        pose_shapes,
    })
}

/// Every joint once, parents before children; `None` if there is a cycle.
fn parents_first(parents: &[Option<usize>]) -> Option<Vec<usize>> {
    let (mut order, mut done) = (Vec::new(), vec![false; parents.len()]);
    while order.len() < parents.len() {
        let next = (0..parents.len()).find(|&k| !done[k] && parents[k].is_none_or(|p| done[p]))?;
        done[next] = true;
        order.push(next);
    }
    Some(order)
}

fn cameras(a: &Arrays) -> Result<Vec<(usize, Camera)>> {
    let mut dims = BTreeMap::new();
    let numbers = a.shape("cameras/numbers", "C,16", &mut dims)?.to_f32();
    let sizes = counts(a.shape("cameras/sizes", "C,4", &mut dims)?, "cameras/sizes")?;
    let model =
        |m: u32| [Model::Pinhole, Model::Orthographic, Model::Fisheye].into_iter().find(|x| *x as u32 == m);
    let of = |(v, s): (&[f32; 16], &[u32; 4])| {
        let camera = Camera {
            rotation: [[v[0], v[1], v[2]], [v[3], v[4], v[5]], [v[6], v[7], v[8]]],
            translation: [v[9], v[10], v[11]],
            focal_px: [v[12], v[13]],
            center_px: [v[14], v[15]],
            width: s[1] as usize,
            height: s[2] as usize,
            model: model(s[3])
                .ok_or_else(|| Error::input("array 'cameras/sizes'").expected("a model 0 to 2"))?,
        };
        camera.validate()?;
        Ok((s[0] as usize, camera))
    };
    numbers.as_chunks().0.iter().zip(sizes.as_chunks().0).map(of).collect()
}
