//! Conversion of a published layout to lastlight's: bodies posed, images undistorted, masked and reduced.
//!
//! ```text
//! Source (io::captures) ─┬─ body model, shape, poses ──► template at rest, canonical pose, transforms ──► body.npz
//!                        └─ image, mask ──► undistort ──► person on black ──► reduce ──► images/, foreground/
//! ```
//!
//! * The model's axes (y up) are turned at rest: (x, y, z) → (x, −z, y). The world is turned by
//!   [`Source::world`].
//! * A pixel of the mask is the person where the resampled mask is at least ½; outside, the image is black.
//!   Pixels without a position in the distorted photo are black too.
//! * Reduced by an integer factor s, a colour is the mean of s×s pixels, the mask the upper left of them;
//!   focal lengths and principal point are divided by s. Rows and columns that do not fill a block are cut.

use super::smpl::{big_pose, chain, joints, placement, shaped};
use super::{rotation_matrix, rotation_vector};
use crate::error::Kind;
use crate::io::captures::{Layout, Source, SourceShot};
use crate::io::image_file;
use crate::io::person::{NewShot, Writer};
use crate::io::smpl::BodyModel;
use crate::math::affine::{compose, inverse};
use crate::num::array::Arrays;
use crate::num::{order, par};
use crate::scene::lens;
use crate::{Error, Result};
use reference::body::skin::{self, Affine};
use serde_json::json;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Number of images processed between two checks of the stop flag.
const BATCH: usize = 16;

/// Mean distance to reference points beyond which something is wrong, metres.
const SUSPICIOUS_M: f64 = 0.02;

/// z up from y up, at rest.
const UP: Affine<f64> = [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0]];

/// What was written.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Numbers of training and held-out images.
    pub shots: [usize; 2],
    /// Moments.
    pub moments: usize,
    /// Points of the template.
    pub points: usize,
    /// Joints.
    pub joints: usize,
    /// Size of the first image.
    pub size: [usize; 2],
    /// Notes for the user, one sentence each.
    pub notes: Vec<String>,
}

/// Counts finished images: done, total.
pub type Progress<'a> = dyn FnMut(usize, usize) + 'a;

/// Writes a source as a capture in `dir`. `model` is the body model if the data set has none; `downscale`
/// overrides the layout's reduction.
///
/// # Errors
/// When there is no body model or it does not fit, an image or a mask is bad, a file cannot be written, or
/// `stop` is set.
pub fn write(
    source: &Source,
    model: Option<&BodyModel>,
    downscale: Option<usize>,
    dir: &Path,
    stop: &AtomicBool,
    progress: &mut Progress<'_>,
) -> Result<Report> {
    let mut notes = source.notes.clone();
    let body = Body::new(source, model)?;
    if let Some((path, time, points)) = &source.reference {
        notes.push(body.compared(source, path, *time, points));
    }
    if source.on_mean_hands && body.model.mean_hands.is_none() {
        notes.push(
            "the body model has no hands_meanl and hands_meanr: hands are taken as if flat were their mean"
                .to_owned(),
        );
    }
    let arrays = body.arrays(source);
    // The body first, so that a mismatch is reported before hours of image processing.
    let mut writer = Writer::create(dir)?;
    let (size, empty) = match pictures(source, downscale, &mut writer, stop, progress) {
        Ok(done) => done,
        Err(e) if e.kind() == Kind::Interrupted => return Err(e),
        Err(e) => {
            writer.discard()?;
            return Err(e);
        }
    };
    let total = source.shots.len();
    if empty > 0 {
        notes.push(format!("{empty} of {total} masks are empty"));
    }
    let subject = json!({
        "kind": source.kind, "metres_per_unit": 1.0, "box_margin_m": source.margin_m, "layout": source.layout.name(),
    });
    writer.finish(&subject, &arrays)?;
    progress(total, total);
    let of = |split| source.shots.iter().filter(|s| s.split == split).count();
    Ok(Report {
        shots: [of(crate::io::capture::Split::Train), of(crate::io::capture::Split::Test)],
        moments: source.moments.len(),
        points: body.rest.len(),
        joints: body.joints.len(),
        size,
        notes,
    })
}

/// Writes all images of a source; gives the size of the first and the number of empty masks.
fn pictures(
    source: &Source,
    downscale: Option<usize>,
    writer: &mut Writer,
    stop: &AtomicBool,
    progress: &mut Progress<'_>,
) -> Result<([usize; 2], usize)> {
    let (mut size, mut empty, total) = ([0; 2], 0usize, source.shots.len());
    for start in (0..total).step_by(BATCH) {
        if stop.load(Ordering::Relaxed) {
            return Err(Error::interrupted("last import").hint("start over with --force"));
        }
        progress(start, total);
        let end = order::min(start + BATCH, total);
        let made = par::map_batched(end - start, 1, |i| {
            let shot = &source.shots[start + i];
            let (new, rgb, mask) = picture(source, shot, downscale)?;
            writer.pictures(&new, &rgb, &mask)?;
            Ok::<_, Error>((new, mask.iter().all(|&m| m == 0)))
        });
        for result in made {
            let (new, is_empty) = result?;
            if size == [0; 2] {
                size = [new.width, new.height];
            }
            empty += usize::from(is_empty);
            writer.add(&new);
        }
    }
    Ok((size, empty))
}

/// The person's body in the model's axes.
struct Body<'a> {
    model: &'a BodyModel,
    rest: Vec<[f64; 3]>,
    joints: Vec<[f64; 3]>,
    /// (T, K) axis-angles, those of the mean hands included
    rotations: Vec<Vec<[f64; 3]>>,
}

impl<'a> Body<'a> {
    fn new(source: &'a Source, model: Option<&'a BodyModel>) -> Result<Self> {
        let model = model.or(source.model.as_ref()).ok_or_else(|| {
            Error::input("body model")
                .expected(format!(
                    "the {} model, which layout {} does not bring",
                    source.kind,
                    source.layout.name()
                ))
                .got("none")
                .hint("give it with --body: .pkl, .npz, or ARAH's folder body_models/misc")
        })?;
        let k = model.joints();
        for (t, m) in source.moments.iter().enumerate() {
            let transforms = m.transforms.as_ref().map_or(k, Vec::len);
            if m.rotations.len() != k || transforms != k {
                return Err(Error::input("body model")
                    .expected(format!(
                        "{} joints, as the poses have (frame {})",
                        m.rotations.len(),
                        source.numbers[t]
                    ))
                    .got(k.to_string())
                    .hint("SMPL has 24 joints, SMPL-X 55"));
            }
        }
        let is_shapeless = model.template.iter().all(|x| *x == [0.0; 3]);
        let needs_shape = source.rest.is_none() || source.layout == Layout::PeopleSnapshot;
        if is_shapeless && needs_shape {
            return Err(Error::input("body model")
                .expected(match source.rest {
                    None => "a template: the layout brings no points of its own",
                    Some(_) => "a template: the joints are those of the body under the clothes",
                })
                .got("none")
                .hint("add v_templates.npz to ARAH's folder, or give the model itself"));
        }
        let rest = match &source.rest {
            Some(points) if points.len() == model.template.len() => points.clone(),
            Some(points) => {
                return Err(Error::input("body model")
                    .expected(format!("{} points, as the person at rest has", points.len()))
                    .got(model.template.len().to_string()));
            }
            None => shaped(model, &source.betas).map_err(|e| e.within("body model"))?,
        };
        // PeopleSnapshot's person at rest wears clothes; its joints are those of the body underneath.
        let joints = match source.layout {
            Layout::PeopleSnapshot => {
                joints(model, &shaped(model, &source.betas).map_err(|e| e.within("body model"))?)
            }
            _ => joints(model, &rest),
        };
        let rotations = source.moments.iter().map(|m| {
            let mut all = m.rotations.clone();
            if let Some(hands) = model.mean_hands.as_ref().filter(|_| source.on_mean_hands) {
                let first = all.len() - hands.len();
                for (v, mean) in all[first..].iter_mut().zip(hands) {
                    *v = std::array::from_fn(|c| v[c] + mean[c]);
                }
            }
            all
        });
        Ok(Self { model, rest, joints, rotations: rotations.collect() })
    }

    /// (K) world from rest in the model's axes, source's world.
    fn transforms(&self, source: &Source, t: usize) -> Vec<Affine<f64>> {
        let m = &source.moments[t];
        let own = match &m.transforms {
            Some(given) => given.clone(),
            None => chain(&self.model.parents, &self.joints, &self.rotations[t]),
        };
        let place = placement(m.global_rotation, m.global_translation, m.scale);
        own.iter().map(|a| compose(&place, a)).collect()
    }

    /// Distance of the posed points from the points in the data set.
    fn compared(&self, source: &Source, path: &Path, t: usize, points: &[[f64; 3]]) -> String {
        let name = path.display();
        if points.len() != self.rest.len() {
            return format!("{name} has {} points, the body {}: not compared", points.len(), self.rest.len());
        }
        let transforms = self.transforms(source, t);
        let features = features(&self.rotations[t]);
        let mut sum = 0.0f64;
        for (p, want) in points.iter().enumerate() {
            let x = moved(self.model, p, self.rest[p], &features);
            let weights = &self.model.weights[p * self.joints.len()..][..self.joints.len()];
            let got = skin::point(&skin::blend(weights, &transforms), x);
            let d: [f64; 3] = std::array::from_fn(|c| got[c] - want[c]);
            sum = sum + ((d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]).sqrt();
        }
        let mean = sum / points.len() as f64;
        let verdict = if mean > SUSPICIOUS_M { ": is this the body model of this data set?" } else { "" };
        format!("the posed body is {:.1} mm from the points of {name} on average{verdict}", 1000.0 * mean)
    }

    fn arrays(&self, source: &Source) -> Arrays {
        let (p, k, t) = (self.rest.len(), self.joints.len(), source.moments.len());
        let back = inverse(&UP);
        let turn = |x: [f64; 3]| skin::point(&UP, x);
        let world: Affine<f64> = source.world.map(|r| [r[0], r[1], r[2], 0.0]);
        let squares = |all: &mut dyn Iterator<Item = Affine<f64>>| -> Vec<f32> {
            let mut out = Vec::new();
            for a in all {
                out.extend(a.iter().flatten().map(|&x| x as f32));
                out.extend([0.0, 0.0, 0.0, 1.0]);
            }
            out
        };
        let flat = |rows: &[[f64; 3]]| -> Vec<f32> {
            rows.iter().flat_map(|&x| turn(x)).map(|x| x as f32).collect()
        };
        let mut transforms = Vec::with_capacity(16 * t * k);
        let (mut angles, mut rh, mut th) = (Vec::new(), Vec::new(), Vec::new());
        for i in 0..t {
            let posed = self.transforms(source, i);
            transforms.extend(squares(&mut posed.iter().map(|a| compose(&world, &compose(a, &back)))));
            let m = &source.moments[i];
            angles.extend(flat(&self.rotations[i]));
            // x' = W (R Z⁻¹ (Z x) + Th)
            let whole =
                compose(&world, &compose(&placement(m.global_rotation, m.global_translation, 1.0), &back));
            let r = rotation_vector(&whole.map(|row| [row[0], row[1], row[2]]));
            rh.extend(r.map(|x| x as f32));
            th.extend(whole.map(|row| row[3] as f32));
        }
        let big = chain(&self.model.parents, &self.joints, &big_pose(k));
        let canonical = squares(&mut big.iter().map(|a| compose(&UP, &compose(a, &back))));
        let parents: Vec<i32> = self.model.parents.iter().map(|p| p.map_or(-1, |p| p as i32)).collect();
        let mut out = Arrays::new()
            .with("points", &[p, 3], flat(&self.rest))
            .with("weights", &[p, k], self.model.weights.iter().map(|&w| w as f32).collect::<Vec<f32>>())
            .with("joints", &[k, 3], flat(&self.joints))
            .with("parents", &[k], parents)
            .with("canonical", &[k, 4, 4], canonical)
            .with("transforms", &[t, k, 4, 4], transforms)
            .with("poses", &[t, k, 3], angles)
            .with("numbers", &[t], source.numbers.clone());
        if source.moments.iter().all(|m| m.scale == 1.0) {
            out.put("global_rotation", &[t, 3], rh);
            out.put("global_translation", &[t, 3], th);
        }
        if !source.betas.is_empty() {
            out.put("betas", &[source.betas.len()], source.betas.clone());
        }
        if !self.model.faces.is_empty() {
            let faces: Vec<i32> = self.model.faces.iter().flatten().map(|&i| i as i32).collect();
            out.put("faces", &[self.model.faces.len(), 3], faces);
            out.put("normals", &[p, 3], flat(&normals(&self.rest, &self.model.faces)));
        }
        if let Some(shapes) = turned_shapes(self.model) {
            out.put("pose_shapes", &[p, 3, 9 * (k - 1)], shapes);
        }
        out
    }
}

/// vec(R_1 − I, …) in the model's axes.
fn features(rotations: &[[f64; 3]]) -> Vec<f64> {
    let mut out = Vec::new();
    for v in rotations.iter().skip(1) {
        let r = rotation_matrix(*v);
        out.extend((0..9).map(|i| r[i / 3][i % 3] - if i % 4 == 0 { 1.0 } else { 0.0 }));
    }
    out
}

/// A point with its pose shapes.
fn moved(model: &BodyModel, p: usize, x: [f64; 3], features: &[f64]) -> [f64; 3] {
    let Some(shapes) = &model.pose_shapes else { return x };
    let n = features.len();
    std::array::from_fn(|c| {
        shapes[(3 * p + c) * n..][..n].iter().zip(features).fold(x[c], |s, (a, f)| s + a * f)
    })
}

/// Pose shapes for turned axes: R = Zᵀ R' Z, so entry (a, b) of R is ± an entry of R', and the movement is
/// turned like a point.
fn turned_shapes(model: &BodyModel) -> Option<Vec<f32>> {
    let shapes = model.pose_shapes.as_ref()?;
    let n = 9 * (model.joints() - 1);
    // Z maps axis a to axis `to[a]` with a sign.
    let (to, sign) = ([0usize, 2, 1], [1.0f64, 1.0, -1.0]);
    let mut out = vec![0.0f32; shapes.len()];
    for p in 0..model.template.len() {
        for c in 0..3 {
            let (from, target) = (&shapes[(3 * p + c) * n..][..n], &mut out[(3 * p + to[c]) * n..][..n]);
            for j in 0..n / 9 {
                for a in 0..3 {
                    for b in 0..3 {
                        let value = sign[c] * sign[a] * sign[b] * from[9 * j + 3 * a + b];
                        target[9 * j + 3 * to[a] + to[b]] = value as f32;
                    }
                }
            }
        }
    }
    Some(out)
}

/// Unit normals: faces weighted by area.
fn normals(points: &[[f64; 3]], faces: &[[u32; 3]]) -> Vec<[f64; 3]> {
    let mut sums = vec![[0.0f64; 3]; points.len()];
    for f in faces {
        let [a, b, c] = f.map(|i| points[i as usize]);
        let (u, v): ([f64; 3], [f64; 3]) =
            (std::array::from_fn(|k| b[k] - a[k]), std::array::from_fn(|k| c[k] - a[k]));
        let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        for &i in f {
            let s = &mut sums[i as usize];
            *s = std::array::from_fn(|k| s[k] + n[k]);
        }
    }
    sums.into_iter().map(crate::math::vector::unit).collect()
}

/// The image as an ideal camera would have taken it: its camera, bytes (H, W, 3), mask (H, W) of 0 and 255.
fn picture(
    source: &Source,
    shot: &SourceShot,
    downscale: Option<usize>,
) -> Result<(NewShot, Vec<u8>, Vec<u8>)> {
    let (rgb, [w, h]) = shot.image.photograph()?;
    let (mask, size) = shot.mask.mask()?;
    if size != [w, h] {
        return Err(Error::input(shot.mask.name())
            .at("mask size")
            .expected(format!("{w}x{h}, as the photo {}", shot.image.name()))
            .got(format!("{}x{}", size[0], size[1])));
    }
    let mut rgb: Vec<f32> = rgb.iter().map(|&b| f32::from(b) / 255.0).collect();
    let mut mask = mask;
    if !shot.lens.is_ideal() {
        let spread: Vec<f32> = mask.iter().flat_map(|&m| [f32::from(m); 3]).collect();
        let straight = lens::undistort(&spread, None, w, h, shot.intrinsics, shot.lens);
        // Where the photo has nothing, the resampled mask is 0.
        mask = straight.rgb.as_chunks::<3>().0.iter().map(|m| u8::from(m[0] >= 0.5)).collect();
        rgb = lens::undistort(&rgb, None, w, h, shot.intrinsics, shot.lens).rgb;
    }
    for (pixel, &m) in rgb.as_chunks_mut::<3>().0.iter_mut().zip(&mask) {
        if m == 0 {
            *pixel = [0.0; 3];
        }
    }
    let s = downscale.unwrap_or_else(|| match source.target {
        0 => source.downscale,
        side => order::max(order::max(w, h) / side, 1),
    });
    let (nw, nh) = (w / order::max(s, 1), h / order::max(s, 1));
    if s == 0 || nw == 0 || nh == 0 {
        return Err(Error::input(shot.image.name())
            .at("image size")
            .expected(format!("at least {s} pixels a side, to be reduced by {s}"))
            .got(format!("{w}x{h}")));
    }
    let count = (s * s) as f32;
    let mut small = Vec::with_capacity(3 * nw * nh);
    let mut silhouette = Vec::with_capacity(nw * nh);
    for row in 0..nh {
        for column in 0..nw {
            for c in 0..3 {
                let mut sum = 0.0f32;
                for y in row * s..(row + 1) * s {
                    for x in column * s..(column + 1) * s {
                        sum += rgb[3 * (y * w + x) + c];
                    }
                }
                small.push(sum / count);
            }
            silhouette.push(255 * mask[row * s * w + column * s]);
        }
    }
    let world: Affine<f64> = source.world.map(|r| [r[0], r[1], r[2], 0.0]);
    let view: Affine<f64> = std::array::from_fn(|i| shot.view_from_world[i]);
    let view = compose(&view, &inverse(&world));
    let new = NewShot {
        name: format!("c{:02}_f{:06}", shot.camera, source.numbers[shot.time]),
        time: shot.time,
        camera: shot.camera,
        split: shot.split,
        view_from_world: [view[0], view[1], view[2], [0.0, 0.0, 0.0, 1.0]],
        intrinsics: shot.intrinsics.map(|x| x / s as f64),
        width: nw,
        height: nh,
    };
    Ok((new, image_file::to_u8(&small)?, silhouette))
}
