//! Checks a capture of a person for missing or inconsistent data, and draws skeleton and mask over its
//! images.
//!
//! | drawn | colour |
//! |---|---|
//! | outline of the mask: pixels with coverage ≥ ½ beside one below | green |
//! | bones, from a joint that moves points, or has such joints below it, to its parent | yellow |
//! | joints | red |
//! | outline of the box used by the metrics | blue |
//!
//! For every checked image, the fraction of the template points that project onto the mask is measured; it is
//! low if poses belong to other images or cameras use other units. Small images are enlarged by an integer
//! factor before anything is drawn.

use crate::io::image_file;
use crate::num::order;
use crate::scene::bound::project;
use crate::scene::person::{PersonCapture, Photo, Shot, Template};
use crate::{Error, Result};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::Path;

/// Images are enlarged until the longer side has at least this number of pixels.
const SIDE: usize = 384;

/// Number of test cameras that are checked.
const TEST_CAMERAS: usize = 4;

/// Fraction of points on the mask below which a note is reported.
const AGREES: f64 = 0.8;

/// Fraction of the mask in the box below which a note is reported.
const CONTAINS: f64 = 0.9;

/// Distance in pixels of the capture within which a point counts as on the mask.
const SLACK: isize = 2;

/// The result of a check.
#[derive(Clone, Debug)]
pub struct Report {
    /// Errors that must be corrected before the capture can be used.
    pub problems: Vec<Error>,
    /// Notes about properties that do not prevent its use.
    pub notes: Vec<String>,
    /// One entry per checked image.
    pub images: Vec<CheckedImage>,
    /// The capture, as far as it could be read.
    pub capture: Option<PersonCapture>,
}

/// One checked image.
#[derive(Clone, Debug, PartialEq)]
pub struct CheckedImage {
    /// Name of the image in the capture.
    pub name: String,
    /// Number of the camera.
    pub camera: usize,
    /// Index of the moment.
    pub time: usize,
    /// Whether the image is held out for testing.
    pub is_test: bool,
    /// Fraction of the template points that project onto the mask.
    pub on_mask: f64,
    /// Fraction of the mask that lies in the box.
    pub in_box: f64,
    /// Enlarged image with overlay: width, height, bytes (H, W, 3).
    pub overlay: (usize, usize, Vec<u8>),
}

/// Checks a capture on `count` training images and on one image of each of a few test cameras.
///
/// # Errors
/// If there is nothing to check.
pub fn inspect(path: &Path, count: usize) -> Result<Report> {
    let (capture, mut problems) = PersonCapture::examine(path)?;
    let mut notes = capture.as_ref().map_or_else(Vec::new, |c| c.notes.clone());
    let mut images = Vec::new();
    if let Some(c) = &capture {
        for i in chosen(c, count) {
            let shot = &c.shots[i];
            match shot.photo() {
                Ok(photo) => images.push(check_image(c, shot, &photo)),
                Err(e) => problems.push(e),
            }
        }
        for l in images.iter().filter(|l| l.in_box < CONTAINS) {
            notes.push(format!(
                "{}: only {:.0} % of the mask lies in the box around the posed points, in which the metrics are computed",
                l.name,
                100.0 * l.in_box
            ));
        }
        for l in images.iter().filter(|l| l.on_mask < AGREES) {
            notes.push(format!(
                "{}: only {:.0} % of the posed points land on the mask: check that pose, camera and image belong together",
                l.name,
                100.0 * l.on_mask
            ));
        }
    }
    Ok(Report { problems, notes, images, capture })
}

/// Training images spread over time, then one image of each of the first test cameras.
fn chosen(c: &PersonCapture, count: usize) -> Vec<usize> {
    let n = order::min(count, c.train.len());
    let mut out: Vec<usize> =
        (0..n).map(|i| c.train[i * (c.train.len() - 1) / order::max(n - 1, 1)]).collect();
    let mut seen = BTreeSet::new();
    // Each camera at another moment, as far as possible.
    for camera in c.test.iter().map(|&i| c.shots[i].camera_id).filter(|&k| seen.insert(k)).take(TEST_CAMERAS)
    {
        let of: Vec<usize> = c.test.iter().copied().filter(|&i| c.shots[i].camera_id == camera).collect();
        out.push(of[(seen_before(&out, c)) % of.len()]);
    }
    out
}

/// Number of chosen images that are held out.
fn seen_before(out: &[usize], c: &PersonCapture) -> usize {
    out.iter().filter(|i| c.test.contains(i)).count()
}

fn check_image(c: &PersonCapture, shot: &Shot, photo: &Photo) -> CheckedImage {
    let (w, h) = (shot.camera.width, shot.camera.height);
    let is_on = |x: isize, y: isize| {
        (0..w as isize).contains(&x)
            && (0..h as isize).contains(&y)
            && photo.mask[y as usize * w + x as usize] >= 0.5
    };
    let near = |p: [f64; 2]| {
        let (x, y) = (p[0].floor() as isize, p[1].floor() as isize);
        (-SLACK..=SLACK).any(|dy| (-SLACK..=SLACK).any(|dx| is_on(x + dx, y + dy)))
    };
    let points = c.posed_points(shot.time);
    let landed = points.iter().filter(|x| project(&shot.camera, x.map(f64::from)).is_some_and(near)).count();
    let bound = c.box_mask(shot);
    let covered = (0..w * h).filter(|&i| photo.mask[i] >= 0.5);
    let (inside, all) = covered.fold((0usize, 0usize), |(i, n), k| (i + usize::from(bound[k] == 1.0), n + 1));
    let share = |part: usize, whole: usize| if whole > 0 { part as f64 / whole as f64 } else { 0.0 };
    CheckedImage {
        name: shot.name.clone(),
        camera: shot.camera_id,
        time: shot.time,
        is_test: shot.split != crate::io::capture::Split::Train,
        on_mask: share(landed, points.len()),
        in_box: share(inside, all),
        overlay: overlay(c, shot, photo, &bound),
    }
}

fn overlay(c: &PersonCapture, shot: &Shot, photo: &Photo, bound: &[f32]) -> (usize, usize, Vec<u8>) {
    let (w, h) = (shot.camera.width, shot.camera.height);
    let zoom = order::max(SIDE.div_ceil(order::max(w, h)), 1);
    let mut canvas = Canvas::enlarged(&photo.rgb, w, h, zoom);
    let mask: Vec<u8> = photo.mask.iter().map(|&m| u8::from(m >= 0.5)).collect();
    let bound: Vec<u8> = bound.iter().map(|&m| u8::from(m == 1.0)).collect();
    canvas.outline(&bound, w, h, zoom, [60, 120, 255]);
    canvas.outline(&mask, w, h, zoom, [60, 230, 90]);
    let used = used_joints(&c.template);
    let at: Vec<Option<[f64; 2]>> = c
        .posed_joints(shot.time)
        .into_iter()
        .zip(used)
        .map(|(x, is_used)| project(&shot.camera, x.map(f64::from)).filter(|_| is_used))
        .map(|p| p.map(|p| p.map(|v| v * zoom as f64)))
        .collect();
    for (k, parent) in c.template.parents.iter().enumerate() {
        if let (Some(a), Some(b)) = (at[k], parent.and_then(|p| at[p])) {
            canvas.line(a, b, [255, 214, 64]);
        }
    }
    for p in at.into_iter().flatten() {
        canvas.dot(p, [235, 64, 52]);
    }
    (canvas.width, canvas.height, canvas.rgb)
}

/// Whether each joint, or a joint below it, moves a point, shape (K); control handles of animators do not.
fn used_joints(t: &Template) -> Vec<bool> {
    let mut used = vec![false; t.joints.len()];
    for (joints, weights) in t.joint_of.iter().zip(&t.weight_of) {
        for (&j, &w) in joints.iter().zip(weights) {
            used[usize::from(j)] |= w > 0.0;
        }
    }
    for &k in t.order.iter().rev() {
        if let (true, Some(p)) = (used[k], t.parents[k]) {
            used[p] = true;
        }
    }
    used
}

/// An image to draw on.
struct Canvas {
    width: usize,
    height: usize,
    rgb: Vec<u8>,
}

impl Canvas {
    fn enlarged(rgb: &[u8], w: usize, h: usize, zoom: usize) -> Self {
        let (width, height) = (w * zoom, h * zoom);
        let pixel = |i: usize| {
            let at = 3 * ((i / width / zoom) * w + i % width / zoom);
            [rgb[at], rgb[at + 1], rgb[at + 2]]
        };
        Self { width, height, rgb: (0..width * height).flat_map(pixel).collect() }
    }

    fn set(&mut self, x: isize, y: isize, colour: [u8; 3]) {
        if (0..self.width as isize).contains(&x) && (0..self.height as isize).contains(&y) {
            let at = 3 * (y as usize * self.width + x as usize);
            self.rgb[at..at + 3].copy_from_slice(&colour);
        }
    }

    /// Draws the borders between 1 and 0 of a mask, on the inner side.
    fn outline(&mut self, mask: &[u8], w: usize, h: usize, zoom: usize, colour: [u8; 3]) {
        let is_on = |x: isize, y: isize| {
            (0..w as isize).contains(&x)
                && (0..h as isize).contains(&y)
                && mask[y as usize * w + x as usize] == 1
        };
        let z = zoom as isize;
        for y in 0..h as isize {
            for x in (0..w as isize).filter(|&x| is_on(x, y)) {
                for i in 0..z {
                    let sides = [
                        ((-1, 0), (x * z, y * z + i)),
                        ((1, 0), (x * z + z - 1, y * z + i)),
                        ((0, -1), (x * z + i, y * z)),
                        ((0, 1), (x * z + i, y * z + z - 1)),
                    ];
                    for ((dx, dy), (px, py)) in sides {
                        if !is_on(x + dx, y + dy) {
                            self.set(px, py, colour);
                        }
                    }
                }
            }
        }
    }

    /// Draws a line two pixels wide.
    fn line(&mut self, a: [f64; 2], b: [f64; 2], colour: [u8; 3]) {
        let length = order::max((b[0] - a[0]).abs(), (b[1] - a[1]).abs());
        // Lines that extend far beyond the image are cut off.
        let steps = order::min(length.ceil(), 4.0 * (self.width + self.height) as f64) as usize;
        for i in 0..=steps {
            let t = i as f64 / order::max(steps, 1) as f64;
            let (x, y) = (a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]));
            for (dx, dy) in [(0, 0), (1, 0), (0, 1)] {
                self.set(x.floor() as isize + dx, y.floor() as isize + dy, colour);
            }
        }
    }

    fn dot(&mut self, at: [f64; 2], colour: [u8; 3]) {
        let (x, y) = (at[0].floor() as isize, at[1].floor() as isize);
        for dy in -2..=2isize {
            for dx in -2..=2isize {
                if dx * dx + dy * dy <= 5 {
                    self.set(x + dx, y + dy, colour);
                }
            }
        }
    }
}

impl Report {
    /// Whether the capture can be used.
    pub fn is_usable(&self) -> bool {
        self.problems.is_empty() && self.capture.is_some()
    }

    /// Writes the overlays and returns their paths relative to the folder.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write(&self, dir: &Path) -> Result<Vec<String>> {
        let mut out = Vec::new();
        for l in &self.images {
            let name = format!("c{:02}_f{:04}.png", l.camera, l.time);
            let (w, h, rgb) = &l.overlay;
            image_file::write_png(&dir.join(&name), *w, *h, 3, rgb)?;
            out.push(name);
        }
        Ok(out)
    }

    /// The result as JSON.
    pub fn record(&self) -> Value {
        let mut record = json!({
            "usable": self.is_usable(),
            "problems": self.problems.iter().map(ToString::to_string).collect::<Vec<_>>(),
            "notes": self.notes,
            "checked_images": self.images.iter().map(|l| json!({
                "image": l.name, "camera": l.camera, "moment": l.time, "held_out": l.is_test,
                "points_on_mask": l.on_mask, "mask_in_box": l.in_box,
            })).collect::<Vec<_>>(),
        });
        if let Some(c) = &self.capture {
            let cameras: BTreeSet<usize> = c.shots.iter().map(|s| s.camera_id).collect();
            let sizes: BTreeSet<[usize; 2]> =
                c.shots.iter().map(|s| [s.camera.width, s.camera.height]).collect();
            let t = &c.template;
            record["folder"] = json!(c.folder);
            record["kind"] = json!(t.kind.name());
            record["metres_per_unit"] = json!(t.unit_m);
            record["points"] = json!(t.len());
            record["faces"] = json!(t.faces.len());
            record["joints"] = json!(t.joints.len());
            record["pose_shapes"] = json!(t.pose_shapes.is_some());
            record["moments"] = json!(c.moments());
            record["cameras"] = json!(cameras);
            record["sizes"] = json!(sizes);
            record["train"] = json!(c.train.len());
            record["test"] = json!(c.test.len());
            record["factors"] = json!(c.factors.first().map_or(0, Vec::len));
        }
        record
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_dots_and_borders_are_where_they_belong() {
        const ON: [u8; 3] = [255, 0, 0];
        let is_on = |canvas: &Canvas, x: usize, y: usize| canvas.rgb[3 * (y * canvas.width + x)..][..3] == ON;
        // 3×2 pixels, each enlarged to 4×4.
        let rgb: Vec<u8> = (0..6).flat_map(|i| [0, 10 * i, 0]).collect();
        let fresh = || Canvas::enlarged(&rgb, 3, 2, 4);
        let mut canvas = fresh();
        assert_eq!((canvas.width, canvas.height, canvas.rgb.len()), (12, 8, 288));
        assert_eq!(canvas.rgb[3 * (5 * 12 + 9) + 1], 50, "pixel (2, 1) is the sixth");
        // The mask is the pixel in the middle of the top row: its border is drawn inside it, including along
        // the edge of the image.
        canvas.outline(&[0, 1, 0, 0, 0, 0], 3, 2, 4, ON);
        for y in 0..8 {
            for x in 0..12 {
                let within = (4..8).contains(&x) && y < 4;
                let rim = x == 4 || x == 7 || y == 0 || y == 3;
                assert_eq!(is_on(&canvas, x, y), within && rim, "({x}, {y})");
            }
        }
        let mut canvas = fresh();
        canvas.line([1.5, 1.5], [9.5, 5.5], ON);
        for i in 0..=8 {
            assert!(is_on(&canvas, 1 + i, 1 + i / 2), "half a pixel down per pixel, at {i}");
        }
        assert!(!is_on(&canvas, 1, 5) && !is_on(&canvas, 9, 1), "and nowhere else");
        let mut canvas = fresh();
        canvas.dot([0.2, 0.9], ON);
        assert!(
            is_on(&canvas, 0, 0) && is_on(&canvas, 2, 1) && !is_on(&canvas, 3, 0) && !is_on(&canvas, 2, 2)
        );
        // A line far outside takes no time and draws nothing.
        canvas.line([-1e9, 4.0], [1e9, 4.0], ON);
    }
}
