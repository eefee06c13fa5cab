//! The images of one object in memory: of `lirm gen` by index, or of a capture.
//!
//! ```text
//! (seed, index, version) ──► gen: rendered ──► as its files are read ─┐
//! a capture ───────────────────────────────────────────────────────► Views ──► turned ──► lit ──► small
//! ```
//!
//! An object that is rendered in memory has the pixels of the same object on disk: 8 bits for images,
//! foreground, albedo and materials, single precision for the other passes (`tests/systems/lirm_views.rs`
//! compares both). All images get a common exposure ([`crate::fit::exposure`]), the photos with what is
//! behind the object too.

use super::r#gen::in_memory;
use super::settings::{Settings, Version};
use super::subject::Subject;
use crate::fit::exposure::{Common, Photograph, expose as expose_photographs};
use crate::fit::field::place::{Pose, posed};
use crate::fit::field::targets::{self, Photo, Picture, Pictures, Target};
use crate::fit::passes::as_read;
use crate::num::elem::f64 as elem;
use crate::num::{order, par};
use crate::scene::camera::Camera;
use crate::scene::field::Placement;
use crate::scene::passes::PassImages;
use crate::{Error, Result};

/// One image of an object.
#[derive(Clone, Debug)]
pub struct View {
    /// Colours over white, foreground and passes.
    pub picture: Picture,
    /// (H, W, 3) the image with what is behind the object, sRGB-encoded, in the common exposure.
    pub photo: Vec<f32>,
}

/// The images of one object under one light.
#[derive(Clone, Debug)]
pub struct Views {
    /// The images.
    pub all: Vec<View>,
    /// The object's place: the ball of radius ½ around the origin of the field.
    pub placement: Placement,
}

/// The photos in the exposure that their images over white have been given; as they are, if those were given
/// none.
fn photos(rgb: &[&[u8]], pictures: &[Picture], common: Option<Common>) -> Result<Vec<Vec<f32>>> {
    let one = |(rgb, p): (&&[u8], &Picture)| {
        let values: Vec<f32> = rgb.iter().map(|b| f32::from(*b) / 255.0).collect();
        let color = values.as_chunks::<3>().0.to_vec();
        let foreground = p.foreground.clone();
        Photograph { color, foreground, exposure: p.passes.exposure.unwrap_or(1.0) }
    };
    let mut all: Vec<Photograph> = rgb.iter().zip(pictures).map(one).collect();
    if let Some(common) = common {
        expose_photographs(&mut all, &Common::of(common.factor))?;
    }
    Ok(all.into_iter().map(|p| p.color.into_flattened()).collect())
}

impl Views {
    /// Renders object `k` in memory, with the settings of a set.
    ///
    /// # Errors
    /// If a model or a map is invalid.
    pub fn rendered(settings: &Settings, k: u64, version: Version) -> Result<Self> {
        Self::of_subject(settings, k, version, &Subject::new(settings, k)?)
    }

    /// Renders another object with the cameras and light of object `k`.
    ///
    /// # Errors
    /// Those of [`Self::rendered`].
    pub fn of_subject(settings: &Settings, k: u64, version: Version, subject: &Subject) -> Result<Self> {
        let made = in_memory(settings, k, version, subject)?;
        let (mut rgb, mut pictures) = (Vec::with_capacity(made.len()), Vec::with_capacity(made.len()));
        for (shot, image) in &made {
            let (photo, passes) = as_read(&image.passes, image.style.exposure, image.sensed.as_deref())?;
            let photo_of = Photo { name: &shot.name, camera: &shot.middle(), rgb: &photo };
            pictures.push(photo_of.rendered(passes));
            rgb.push(photo);
        }
        Self::of(&rgb.iter().map(Vec::as_slice).collect::<Vec<_>>(), pictures)
    }

    /// Some images of a capture, in a common exposure already ([`Pictures::load`]).
    ///
    /// # Errors
    /// If a value is out of its range.
    pub fn of_capture(from: &Pictures, which: &[usize], placement: Placement) -> Result<Self> {
        let pictures: Vec<Picture> = which.iter().map(|i| from.pictures[*i].clone()).collect();
        let rgb: Vec<&[u8]> = which.iter().map(|i| &*from.views.views[*i].rgb).collect();
        let photos = photos(&rgb, &pictures, from.common)?;
        let all = pictures.into_iter().zip(photos);
        Ok(Self { all: all.map(|(picture, photo)| View { picture, photo }).collect(), placement })
    }

    /// Gives images a common exposure, and their photos with them; the object is in the ball of radius ½.
    fn of(rgb: &[&[u8]], mut pictures: Vec<Picture>) -> Result<Self> {
        let common = targets::expose(&mut pictures, None)?;
        let photos = photos(rgb, &pictures, common)?;
        let all = pictures.into_iter().zip(photos);
        Ok(Self {
            all: all.map(|(picture, photo)| View { picture, photo }).collect(),
            placement: Placement::new([0.0; 3], 1.0),
        })
    }

    /// Some of the images.
    ///
    /// # Panics
    /// If there is no such image.
    #[must_use]
    pub fn chosen(&self, which: &[usize]) -> Self {
        Self { all: which.iter().map(|i| self.all[*i].clone()).collect(), placement: self.placement }
    }

    /// Turns the object about the vertical, counter-clockwise seen from above, with its cameras and light:
    /// the images stay as they are.
    #[must_use]
    pub fn turned(mut self, radians: f64) -> Self {
        let (sin, cos) = (elem::sin(radians), elem::cos(radians));
        for view in &mut self.all {
            let p = &mut view.picture;
            // A direction of the camera is R·x, and x = Zᵀ·(Z·x).
            for row in &mut p.camera.rotation {
                let [x, y, z] = row.map(f64::from);
                *row = [cos * x - sin * y, sin * x + cos * y, z].map(|v| v as f32);
            }
            for n in p.passes.normal.iter_mut().flatten() {
                let [x, y, z] = n.map(f64::from);
                *n = [cos * x - sin * y, sin * x + cos * y, z].map(|v| v as f32);
            }
        }
        self
    }

    /// Multiplies the encoded colours of the object in all images by a factor per channel, at most to 1; what
    /// is behind it stays. Of a pixel that is covered in part, the photo does not show which share is the
    /// object's, so the factor is mixed with 1 by coverage. The pass of encoded albedo is multiplied by the
    /// factors over their largest: a colour of diffuse reflection is proportional to its albedo, and a power
    /// of it encodes both. (Exact without the linear part of sRGB, and without gloss.) A pass of radiance is left out.
    #[must_use]
    pub fn lit(mut self, factors: [f32; 3]) -> Self {
        if factors == [1.0; 3] {
            return self;
        }
        let most = order::max(order::max(factors[0], factors[1]), factors[2]);
        for View { picture, photo } in &mut self.all {
            picture.passes.radiance = None;
            for (x, m) in picture.color.as_chunks_mut::<3>().0.iter_mut().zip(&picture.foreground) {
                *x = std::array::from_fn(|c| order::min(factors[c] * (x[c] - (1.0 - m)), *m) + (1.0 - m));
            }
            for (x, m) in photo.as_chunks_mut::<3>().0.iter_mut().zip(&picture.foreground) {
                *x = std::array::from_fn(|c| order::min((1.0 + m * (factors[c] - 1.0)) * x[c], 1.0));
            }
            for x in picture.passes.albedo.iter_mut().flatten() {
                *x = std::array::from_fn(|c| factors[c] / most * x[c]);
            }
        }
        self
    }

    /// Turns the axes of the field, for the cameras of some images, the first of which may decide.
    ///
    /// # Errors
    /// When the images do not show which direction is up.
    ///
    /// # Panics
    /// If there is no such image.
    pub fn posed(&self, pose: Pose, read: &[usize]) -> Result<Placement> {
        let cameras: Vec<&Camera> = read.iter().map(|i| &self.all[*i].picture.camera).collect();
        posed(self.placement, pose, &cameras)
    }

    /// Shrinks all images by a whole factor: means over blocks of pixels.
    ///
    /// # Errors
    /// If the factor does not divide the sides of an image.
    pub fn small(&self, factor: usize) -> Result<Self> {
        let one = |i: usize| self.all[i].small(factor);
        let all = par::map(self.all.len(), one).into_iter().collect::<Result<_>>()?;
        Ok(Self { all, placement: self.placement })
    }

    /// The images as a model that was trained on squares of `side` pixels reads them: square images of a
    /// multiple of it are shrunk as a whole, the others cut ([`Self::cropped`]).
    ///
    /// # Errors
    /// Those of [`Self::small`].
    pub fn sized(&self, side: usize) -> Result<Self> {
        let one = |i: usize| {
            let view = &self.all[i];
            let (width, height) = (view.picture.camera.width, view.picture.camera.height);
            match width == height && width > 0 && width.is_multiple_of(side) {
                true => view.small(width / side),
                false => Ok(view.cropped(side)),
            }
        };
        let all = par::map(self.all.len(), one).into_iter().collect::<Result<_>>()?;
        Ok(Self { all, placement: self.placement })
    }

    /// Cuts a square around the object out of every image and brings it to `side` pixels, averaging areas.
    /// Outside of an image is white background. Passes are left out.
    #[must_use]
    pub fn cropped(&self, side: usize) -> Self {
        let all = par::map(self.all.len(), |i| self.all[i].cropped(side));
        Self { all, placement: self.placement }
    }

    /// Returns an image in the units of the field, with all that is compared with it.
    ///
    /// # Panics
    /// If there is no such image.
    pub fn target(&self, i: usize) -> Target {
        targets::target(&self.all[i].picture, &self.placement)
    }
}

/// Factors of [`Views::lit`] for a random colour: channel c is (1 − strength·u_c) over the largest of the
/// three, times a brightness.
pub fn tint(brightness: f64, strength: f64, u: [f64; 3]) -> [f32; 3] {
    let channels = u.map(|u| 1.0 - strength * u);
    let most = order::max(order::max(channels[0], channels[1]), channels[2]);
    channels.map(|c| (brightness * c / most) as f32)
}

/// Part of a row of pixels that output pixel `i` of `n` covers, for a window of `side` pixels from `first`
/// on: indices and weights, which add up to 1.
fn covered(first: i64, side: usize, n: usize, i: usize) -> Vec<(i64, f32)> {
    let edge = |i: usize| i as f64 * side as f64 / n as f64;
    let [from, to] = [edge(i), edge(i + 1)];
    let last = Ord::max(to.ceil() as usize, from as usize + 1);
    let part = |px: usize| order::min(to, px as f64 + 1.0) - order::max(from, px as f64);
    (from as usize..last).map(|px| (first + px as i64, (part(px) / (to - from)) as f32)).collect()
}

/// The square window of an image from which its object is read: around the foreground, moved into the image
/// where it fits.
fn window(p: &Picture) -> ([i64; 2], usize) {
    let (width, height) = (p.camera.width, p.camera.height);
    let inside = (0..p.foreground.len()).filter(|i| p.foreground[*i] >= 0.5);
    let start = ([usize::MAX; 2], [0; 2]);
    let (low, high) = inside.fold(start, |(low, high), i| {
        let at = [i % width, i / width];
        let pick = |of: fn(usize, usize) -> usize, a: [usize; 2]| std::array::from_fn(|k| of(a[k], at[k]));
        (pick(Ord::min, low), pick(Ord::max, high))
    });
    if low[0] > high[0] {
        return ([0; 2], Ord::min(width, height));
    }
    let extent: [usize; 2] = std::array::from_fn(|k| high[k] - low[k] + 1);
    let side = Ord::max(extent[0], extent[1]);
    let place = |k: usize, size: usize| {
        let centred = low[k] as i64 - (side - extent[k]) as i64 / 2;
        // A window that is larger than the image stays centred: what lies outside is white.
        if side <= size { centred.clamp(0, (size - side) as i64) } else { centred }
    };
    ([place(0, width), place(1, height)], side)
}

/// Means over blocks of `s`×`s` pixels of an image with `n` values per pixel.
fn means(x: &[f32], [width, height]: [usize; 2], n: usize, s: usize) -> Vec<f32> {
    let (w, h) = (width / s, height / s);
    let area = (s * s) as f32;
    let mut out = vec![0.0; w * h * n];
    for (i, out) in out.chunks_exact_mut(n).enumerate() {
        let (row, column) = (i / w * s, i % w * s);
        for (k, out) in out.iter_mut().enumerate() {
            let block = (row..row + s).flat_map(|y| (column..column + s).map(move |c| y * width + c));
            *out = block.fold(0.0, |sum, i| sum + x[i * n + k]) / area;
        }
    }
    out
}

impl View {
    fn cropped(&self, n: usize) -> Self {
        let Self { picture: p, photo } = self;
        let (width, height) = (p.camera.width as i64, p.camera.height as i64);
        let (corner, side) = window(p);
        let spans =
            |k: usize| -> Vec<Vec<(i64, f32)>> { (0..n).map(|i| covered(corner[k], side, n, i)).collect() };
        let [columns, rows] = [spans(0), spans(1)];
        let mean = |x: &[f32], channels: usize, outside: f32| -> Vec<f32> {
            let mut out = vec![0.0; n * n * channels];
            for (i, out) in out.chunks_exact_mut(channels).enumerate() {
                for (y, wy) in &rows[i / n] {
                    for (x_at, wx) in &columns[i % n] {
                        let is_inside = (0..height).contains(y) && (0..width).contains(x_at);
                        let at = if is_inside { (y * width + x_at) as usize * channels } else { 0 };
                        for (k, out) in out.iter_mut().enumerate() {
                            *out += wy * wx * if is_inside { x[at + k] } else { outside };
                        }
                    }
                }
            }
            out
        };
        let factor = n as f32 / side as f32;
        let camera = Camera {
            width: n,
            height: n,
            focal_px: p.camera.focal_px.map(|f| f * factor),
            center_px: std::array::from_fn(|k| (p.camera.center_px[k] - corner[k] as f32) * factor),
            ..p.camera.clone()
        };
        let picture = Picture {
            name: p.name.clone(),
            camera,
            color: mean(&p.color, 3, 1.0),
            foreground: mean(&p.foreground, 1, 0.0),
            kept: None,
            colored: None,
            passes: PassImages::default(),
            environment: p.environment.clone(),
        };
        Self { picture, photo: mean(photo, 3, 1.0) }
    }

    fn small(&self, s: usize) -> Result<Self> {
        let Self { picture: p, photo } = self;
        let (width, height) = (p.camera.width, p.camera.height);
        if !width.is_multiple_of(s) || !height.is_multiple_of(s) {
            return Err(Error::input(p.name.clone())
                .at("image size")
                .expected(format!("a multiple of {s}"))
                .got(format!("{width}x{height}")));
        }
        let size = [width, height];
        let kept = |m: &Option<Vec<f32>>| {
            // A block counts if all of its pixels do.
            m.as_ref().map(|m| {
                means(m, size, 1, s).into_iter().map(|x| f32::from(u8::from(x == 1.0))).collect::<Vec<f32>>()
            })
        };
        let picture = Picture {
            name: p.name.clone(),
            camera: smaller(&p.camera, s),
            color: means(&p.color, size, 3, s),
            foreground: means(&p.foreground, size, 1, s),
            kept: kept(&p.kept),
            colored: kept(&p.colored),
            passes: if p.passes.width == 0 { PassImages::default() } else { p.passes.reduced(s) },
            environment: p.environment.clone(),
        };
        Ok(Self { picture, photo: means(photo, size, 3, s) })
    }
}

/// The camera of an image that is smaller by a whole factor.
fn smaller(camera: &Camera, s: usize) -> Camera {
    let part = |x: f32| x / s as f32;
    Camera {
        width: camera.width / s,
        height: camera.height / s,
        focal_px: camera.focal_px.map(part),
        center_px: camera.center_px.map(part),
        ..camera.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::camera::Model;

    #[test]
    fn photos_of_unknown_exposure_stay_as_they_are() {
        let size = 2;
        let camera = Camera {
            model: Model::Pinhole,
            width: size,
            height: size,
            ..crate::lirm::shots::shots(&Settings { size: 8, views: 1, ..Settings::default() }, 0).0[0]
                .middle()
        };
        let picture = |exposure: Option<f64>| Picture {
            name: "0000".into(),
            camera: camera.clone(),
            color: vec![1.0; 3 * size * size],
            foreground: vec![1.0; size * size],
            kept: None,
            colored: None,
            passes: PassImages { exposure, ..PassImages::default() },
            environment: None,
        };
        let rgb = vec![100_u8; 3 * size * size];
        let of = |second: Option<f64>| {
            let mut pictures = vec![picture(Some(2.0)), picture(second)];
            let factor = targets::expose(&mut pictures, None).expect("valid");
            let made = photos(&[&rgb, &rgb], &pictures, factor).expect("valid");
            (factor.is_some(), made[0][0] == 100.0 / 255.0, made[1][0] == made[0][0])
        };
        assert_eq!(of(None), (false, true, true), "one is unknown");
        assert_eq!(of(Some(1.0)), (true, false, false), "brought to one exposure");
    }
}
