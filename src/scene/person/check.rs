//! Validates records into a capture: every inconsistency is a separate error, and all of them are reported.

use super::records::{Affine, INFLUENCES, Kind, PersonCapture, Pose, Shot, Template};
use crate::io::capture::{Lens, Split};
use crate::io::person::{self, Person};
use crate::io::{MAX_SMALL_FILE_BYTES, image_file, read_bytes};
use crate::math::affine::{determinant, is_invertible, linear, single, wide};
use crate::num::array::Arrays;
use crate::num::{order, par};
use crate::scene::camera::{Camera, Model};
use crate::{Error, Result};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// How far the weights of a point may be from a sum of 1, and how negative they may be.
const WEIGHT_SUM: f64 = 1e-3;

/// Share of a point's weight that may be lost beyond the four largest before a note is written.
const LOST: f64 = 1e-3;

/// Metres per unit of the built-in figure, 1.7 m and 2 units high.
const FIGURE_UNIT_M: f64 = 0.85;

/// Margin of the box of `spec` protocols, metres.
const BOX_MARGIN_M: f64 = 0.05;

/// The error of an image that is not of its camera's size.
pub(super) fn size_error(path: &Path, at: &str, got: [usize; 2], want: [usize; 2]) -> Error {
    Error::input(path.display().to_string())
        .at(at)
        .expected(format!("{}x{}, as its camera declares", want[0], want[1]))
        .got(format!("{}x{}", got[0], got[1]))
}

/// The valid parts of the records, and all problems.
pub(super) fn check(mut record: Person) -> (Option<PersonCapture>, Vec<Error>) {
    let mut problems = std::mem::take(&mut record.problems);
    let mut notes = Vec::new();
    let body_name = record.folder.join(person::BODY).display().to_string();
    let body = if record.body.0.is_empty() {
        None
    } else {
        let parts = template(&record, &mut notes).and_then(|t| {
            let poses = poses(&record.body, &t)?;
            Ok((t, poses))
        });
        parts.map_err(|e| problems.push(e.within(body_name.clone()))).ok()
    };
    let shots = shots(&record, &mut problems);
    if let Some((_, poses)) = &body {
        moments(&record, poses.len(), &body_name, &mut problems);
    }
    let has = |s: Split| shots.iter().any(|x| x.split == s);
    if !has(Split::Train) {
        problems.push(
            Error::input(record.folder.join(person::SPLITS[0].0).display().to_string())
                .at("frames")
                .expected("at least one training image")
                .got("none that can be used"),
        );
    }
    if !has(Split::Test) {
        notes.push("no images are held out, so `last eval` cannot score this capture".to_owned());
    }
    let Some((template, poses)) = body else { return (None, problems) };
    let count = poses.len();
    let rest = (|| {
        let numbers = numbers(&record.body, count)?;
        let factors = factors(&record.body, count)?;
        Ok((numbers, factors))
    })();
    let (numbers, factors) = rest.unwrap_or_else(|e: Error| {
        problems.push(e.within(body_name));
        ((0..count as i64).collect(), Vec::new())
    });
    let shots: Vec<Shot> = shots.into_iter().filter(|s| s.time < count).collect();
    let of = |split: Split| -> Vec<usize> {
        let mut list: Vec<usize> = (0..shots.len()).filter(|&i| shots[i].split == split).collect();
        list.sort_by_key(|&i| (shots[i].time, shots[i].camera_id));
        list
    };
    let margin = number(&record, "box_margin_m").unwrap_or(BOX_MARGIN_M) / template.unit_m;
    if template.faces.is_empty() {
        notes.push("the template has no faces: it is a cloud of points".to_owned());
    }
    let capture = PersonCapture {
        train: of(Split::Train),
        test: of(Split::Test),
        folder: record.folder,
        template,
        poses,
        numbers,
        factors,
        shots,
        box_margin: margin as f32,
        notes,
    };
    (Some(capture), problems)
}

/// A positive number of `subject`.
fn number(record: &Person, key: &str) -> Option<f64> {
    record.subject.get(key).and_then(serde_json::Value::as_f64).filter(|x| *x > 0.0 && *x < 1e6)
}

fn template(record: &Person, notes: &mut Vec<String>) -> Result<Template> {
    let body = &record.body;
    if body.get("weights").is_none() {
        return Err(Error::input("array 'weights'")
            .expected("(P, K) skinning weights: which joints move a point")
            .got("none")
            .hint("a template without weights cannot be posed"));
    }
    let mut dims = BTreeMap::new();
    let points = rows3(&body.shape("points", "P,3", &mut dims)?.to_f32());
    let weights = body.shape("weights", "P,K", &mut dims)?.to_f64();
    let joints = rows3(&body.shape("joints", "K,3", &mut dims)?.to_f32());
    body.finite(body.0.keys().map(String::as_str))?;
    let (p, k) = (points.len(), joints.len());
    if p == 0 || k == 0 || k > usize::from(u16::MAX) {
        return Err(Error::input("array 'weights'")
            .expected("at least one point and one joint, at most 65535 joints")
            .got(format!("{p} points, {k} joints")));
    }
    let parents = parents(body.shape("parents", "K", &mut dims)?.to_i64(), k)?;
    let order = topological(&parents)?;
    let (joint_of, weight_of, lost) = influences(&weights, k)?;
    if lost > LOST {
        notes.push(format!(
            "up to {:.1} % of a point's weight belongs to a fifth joint and is not used",
            100.0 * lost
        ));
    }
    let normals = match body.get("normals") {
        Some(_) => rows3(&body.shape("normals", "P,3", &mut dims)?.to_f32()),
        None => Vec::new(),
    };
    let faces = faces(body, p)?;
    let canonical = match body.get("canonical") {
        Some(_) => affines("canonical", &body.shape("canonical", "K,4,4", &mut dims)?.to_f32(), k)?,
        None => vec![single(&IDENTITY); k],
    };
    let pose_shapes = match body.get("pose_shapes") {
        Some(a) if a.shape() != [p, 3, 9 * (k - 1)] => {
            return Err(Error::input("array 'pose_shapes'")
                .expected(format!("shape [{p}, 3, {}]: nine for every joint but the root", 9 * (k - 1)))
                .got(format!("{:?}", a.shape())));
        }
        other => other.map(|a| a.to_f32()),
    };
    let kind = record.subject.get("kind").and_then(serde_json::Value::as_str).unwrap_or("unknown");
    let kind = Kind::parse(kind);
    let usual = if matches!(kind, Kind::Figure | Kind::Character) { FIGURE_UNIT_M } else { 1.0 };
    Ok(Template {
        unit_m: number(record, "metres_per_unit").unwrap_or(usual),
        kind,
        points,
        normals,
        faces,
        joint_of,
        weight_of,
        joints,
        parents,
        order,
        canonical,
        pose_shapes,
    })
}

const IDENTITY: reference::body::skin::Affine<f64> =
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

fn rows3(flat: &[f32]) -> Vec<[f32; 3]> {
    flat.as_chunks::<3>().0.to_vec()
}

fn parents(values: Option<Vec<i64>>, k: usize) -> Result<Vec<Option<usize>>> {
    let wrong = |i: usize, got: String| {
        Error::input("array 'parents'")
            .at(format!("joint {i}"))
            .expected(format!("-1, or another joint below {k}"))
            .got(got)
    };
    let values = values.ok_or_else(|| wrong(0, "a fraction".into()))?;
    let of = |(i, &v): (usize, &i64)| match v {
        -1 => Ok(None),
        v if v >= 0 && (v as usize) < k && v as usize != i => Ok(Some(v as usize)),
        v => Err(wrong(i, v.to_string())),
    };
    values.iter().enumerate().map(of).collect()
}

/// Parents before children, in rounds by index.
fn topological(parents: &[Option<usize>]) -> Result<Vec<usize>> {
    let mut placed = vec![false; parents.len()];
    let mut out = Vec::with_capacity(parents.len());
    loop {
        let before = out.len();
        for (k, parent) in parents.iter().enumerate() {
            if !placed[k] && parent.is_none_or(|p| placed[p]) {
                placed[k] = true;
                out.push(k);
            }
        }
        if out.len() == parents.len() {
            return Ok(out);
        }
        if out.len() == before {
            let stuck: Vec<String> =
                (0..parents.len()).filter(|&k| !placed[k]).take(8).map(|k| k.to_string()).collect();
            return Err(Error::input("array 'parents'")
                .expected("joints without a cycle of parents")
                .got(format!("a cycle above the joints {}", stuck.join(", "))));
        }
    }
}

type Influences = (Vec<[u16; INFLUENCES]>, Vec<[f32; INFLUENCES]>, f64);

/// The four largest weights of each point, and the largest share that was left out.
fn influences(weights: &[f64], k: usize) -> Result<Influences> {
    let (mut joints, mut kept, mut most_lost) = (Vec::new(), Vec::new(), 0.0f64);
    for (p, row) in weights.chunks_exact(k).enumerate() {
        let wrong = |expected: &str, got: f64| {
            Error::input("array 'weights'").at(format!("point {p}")).expected(expected).got(got.to_string())
        };
        if let Some(&w) = row.iter().find(|w| !(**w >= -WEIGHT_SUM)) {
            return Err(wrong("weights that are not negative", w));
        }
        let total = row.iter().fold(0.0, |s, &w| s + w);
        if !((total - 1.0).abs() <= WEIGHT_SUM) {
            return Err(wrong("weights that sum to 1", total));
        }
        let mut sorted: Vec<(usize, f64)> =
            row.iter().map(|&w| order::max(w, 0.0)).enumerate().filter(|(_, w)| *w > 0.0).collect();
        sorted.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let all = sorted.iter().fold(0.0, |s, (_, w)| s + w);
        sorted.truncate(INFLUENCES);
        let sum = sorted.iter().fold(0.0, |s, (_, w)| s + w);
        most_lost = order::max(most_lost, (all - sum) / all);
        let (mut j, mut w) = ([0u16; INFLUENCES], [0.0f32; INFLUENCES]);
        for (i, (joint, weight)) in sorted.into_iter().enumerate() {
            j[i] = joint as u16;
            w[i] = (weight / sum) as f32;
        }
        joints.push(j);
        kept.push(w);
    }
    Ok((joints, kept, most_lost))
}

fn faces(body: &Arrays, p: usize) -> Result<Vec<[u32; 3]>> {
    let Some(a) = body.get("faces") else { return Ok(Vec::new()) };
    let wrong = |got: String| {
        Error::input("array 'faces'").expected(format!("(F, 3) indices of points below {p}")).got(got)
    };
    if a.shape().len() != 2 || a.shape()[1] != 3 {
        return Err(wrong(format!("shape {:?}", a.shape())));
    }
    let values = a.to_i64().ok_or_else(|| wrong("fractions".into()))?;
    if let Some(i) = values.iter().position(|&v| v < 0 || v >= p as i64) {
        return Err(wrong(format!("{} in face {}", values[i], i / 3)));
    }
    Ok(values.as_chunks::<3>().0.iter().map(|f| f.map(|v| v as u32)).collect())
}

/// (N) transforms from (N, 4, 4).
fn affines(name: &str, flat: &[f32], per_row: usize) -> Result<Vec<Affine>> {
    let wrong = |i: usize, expected: &str, got: String| {
        let place = match name {
            "transforms" => format!("moment {}, joint {}", i / per_row, i % per_row),
            _ => format!("joint {i}"),
        };
        Error::input(format!("array '{name}'")).at(place).expected(expected).got(got)
    };
    let of = |(i, m): (usize, &[f32; 16])| {
        if m[12..] != [0.0, 0.0, 0.0, 1.0] {
            return Err(wrong(i, "a last row of 0 0 0 1", format!("{:?}", &m[12..])));
        }
        let a: Affine = std::array::from_fn(|r| std::array::from_fn(|c| m[4 * r + c]));
        let d = determinant(&linear(&wide(&a)));
        if !(d > 0.0 && is_invertible(d)) {
            return Err(wrong(i, "a transform with positive determinant", format!("determinant {d}")));
        }
        Ok(a)
    };
    flat.as_chunks::<16>().0.iter().enumerate().map(of).collect()
}

/// Checked against the template: K joints a moment.
fn poses(body: &Arrays, template: &Template) -> Result<Vec<Pose>> {
    let k = template.joints.len();
    let mut dims = BTreeMap::from([('K', k)]);
    let flat = body.shape("transforms", "T,K,4,4", &mut dims)?.to_f32();
    let transforms = affines("transforms", &flat, k)?;
    let count = transforms.len() / k;
    let angles = match body.get("poses") {
        Some(_) => Some(rows3(&pose_rows(body, "poses", "T,K,3", &mut dims)?)),
        None => None,
    };
    let global = match (body.get("global_rotation"), body.get("global_translation")) {
        (Some(_), Some(_)) => Some((
            rows3(&pose_rows(body, "global_rotation", "T,3", &mut dims)?),
            rows3(&pose_rows(body, "global_translation", "T,3", &mut dims)?),
        )),
        (None, None) => None,
        _ => {
            return Err(Error::input("arrays 'global_rotation', 'global_translation'")
                .expected("both or neither")
                .got("one of them"));
        }
    };
    Ok(par::map(count, |t| {
        let transforms = transforms[t * k..(t + 1) * k].to_vec();
        let axis_angles = match &angles {
            Some(all) => all[t * k..(t + 1) * k].to_vec(),
            None => template.axis_angles(&transforms),
        };
        let global = global.as_ref().map(|(r, h)| [r[t], h[t]]);
        Pose { transforms, axis_angles, global }
    }))
}

/// An array of one row per moment; the error reports that the counts differ.
fn pose_rows(body: &Arrays, name: &str, pattern: &str, dims: &mut BTreeMap<char, usize>) -> Result<Vec<f32>> {
    let (moments, got) = (dims.get(&'T').copied(), body.need(name)?.shape().first().copied());
    if let (Some(t), Some(n)) = (moments, got)
        && t != n
    {
        return Err(Error::input(format!("array '{name}'"))
            .expected(format!("{t} poses, as many as transforms"))
            .got(n.to_string()));
    }
    Ok(body.shape(name, pattern, dims)?.to_f32())
}

fn numbers(body: &Arrays, count: usize) -> Result<Vec<i64>> {
    let Some(a) = body.get("numbers") else { return Ok((0..count as i64).collect()) };
    match a.to_i64() {
        Some(v) if a.shape() == [count] => Ok(v),
        _ => Err(Error::input("array 'numbers'")
            .expected(format!("{count} integers, one per moment"))
            .got(format!("shape {:?}", a.shape()))),
    }
}

fn factors(body: &Arrays, count: usize) -> Result<Vec<Vec<f64>>> {
    match body.get("factors") {
        None => Ok(Vec::new()),
        Some(a) if a.shape().len() == 2 && a.shape()[0] == count && a.shape()[1] > 0 => {
            Ok(a.to_f64().chunks_exact(a.shape()[1]).map(<[f64]>::to_vec).collect())
        }
        Some(a) => Err(Error::input("array 'factors'")
            .expected(format!("shape [{count}, n], one row per moment"))
            .got(format!("{:?}", a.shape()))),
    }
}

/// Checks that there is a pose for every moment that the cameras name.
fn moments(record: &Person, count: usize, name: &str, problems: &mut Vec<Error>) {
    let seen: BTreeSet<usize> = record.shots.iter().map(|s| s.time).collect();
    // Missing images are reported already; their moments may be missing too.
    if record.shots.len() < record.entries {
        return;
    }
    let named = seen.last().map_or(0, |&t| t + 1);
    if named != count {
        problems.push(
            Error::input(name.to_owned())
                .at("array 'transforms'")
                .expected(format!("{named} poses, one for each moment that the cameras name"))
                .got(count.to_string()),
        );
    } else if let Some(t) = (0..count).find(|t| !seen.contains(t)) {
        problems.push(
            Error::input(record.folder.display().to_string())
                .at(format!("moment {t}"))
                .expected("at least one image of every moment")
                .got("none"),
        );
    }
}

/// Shots with checked cameras and images of their size.
fn shots(record: &Person, problems: &mut Vec<Error>) -> Vec<Shot> {
    let checked = par::map(record.shots.len(), |i| shot(&record.shots[i]));
    let mut out: Vec<Shot> = Vec::new();
    let mut seen: BTreeMap<(usize, usize), String> = BTreeMap::new();
    for result in checked {
        match result {
            Ok(s) => {
                if let Some(other) = seen.insert((s.camera_id, s.time), s.name.clone()) {
                    problems.push(
                        Error::input(record.folder.display().to_string())
                            .at(format!("camera {}, moment {}", s.camera_id, s.time))
                            .expected("one image")
                            .got(format!("'{other}' and '{}'", s.name)),
                    );
                }
                out.push(s);
            }
            Err(e) => problems.push(e),
        }
    }
    let rank = |s: Split| match s {
        Split::Train => 0,
        Split::Val => 1,
        _ => 2,
    };
    out.sort_by(|a, b| {
        let key = |s: &Shot| (rank(s.split), s.camera_id, s.time);
        key(a).cmp(&key(b)).then_with(|| a.name.cmp(&b.name))
    });
    out
}

fn shot(s: &person::Shot) -> Result<Shot> {
    let frame = &s.frame;
    let name = frame.image.display().to_string();
    let header =
        |path: &Path| image_file::size(&read_bytes(path, MAX_SMALL_FILE_BYTES)?, &path.display().to_string());
    let size = header(&frame.image)?;
    if let Some(declared) = frame.size
        && declared != size
    {
        return Err(size_error(&frame.image, "image size", size, declared));
    }
    let foreground = frame.passes.foreground.clone().ok_or_else(|| {
        Error::input(name.clone()).at("foreground_path").expected("the mask of the person").got("nothing")
    })?;
    for path in [Some(&foreground), frame.mask.as_ref()].into_iter().flatten() {
        let mask = header(path)?;
        if mask != size {
            return Err(Error::input(path.display().to_string())
                .at("mask size")
                .expected(format!("{}x{}, as the photo", size[0], size[1]))
                .got(format!("{}x{}", mask[0], mask[1])));
        }
    }
    if !frame.lens.is_ideal() || matches!(frame.lens, Lens::Fisheye { .. }) {
        return Err(Error::input(name)
            .at("lens")
            .expected("images without distortion")
            .got("distortion coefficients")
            .hint("last import undistorts"));
    }
    let k = frame.intrinsics(size[0], size[1])?;
    let v = frame.view_from_world.map(|row| row.map(|x| x as f32));
    let camera = Camera {
        rotation: std::array::from_fn(|i| [v[i][0], v[i][1], v[i][2]]),
        translation: std::array::from_fn(|i| v[i][3]),
        focal_px: [k[0] as f32, k[1] as f32],
        center_px: [k[2] as f32, k[3] as f32],
        width: size[0],
        height: size[1],
        model: Model::Pinhole,
    };
    camera.validate().map_err(|e| e.within(name))?;
    Ok(Shot {
        name: frame.name.clone(),
        time: s.time,
        camera_id: s.camera,
        camera,
        split: frame.split,
        image: frame.image.clone(),
        foreground,
        valid: frame.mask.clone(),
    })
}
