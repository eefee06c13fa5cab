//! The images of a fit: colours over white, foreground, passes, and cameras in the units of the field.
//!
//! Foreground is the pass of that name, else the alpha channel of the image, else its mask. Where the background of the
//! image is not white, the image is multiplied by the foreground and composited over white. A pixel that is partly covered
//! then still contains some of the old background, so its colour is not used: neither by the losses nor by the scores of
//! colours (`colored`); its foreground and passes are. Images of a renderer that were exposed one by one get a common exposure
//! ([`crate::fit::exposure`]).

use crate::fit::exposure::{Common, Photograph, equalise, expose as expose_photographs};
use crate::io::capture::{Capture, Frame, Reading, read_capture_with};
use crate::io::{image_file, memory};
use crate::num::{order, par};
use crate::scene::camera::Camera;
use crate::scene::field::Placement;
use crate::scene::passes::PassImages;
use crate::scene::views::{Masks, Options, View, Views, pixels};
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// sRGB byte from which a background is white.
const WHITE: u8 = 253;

/// An image before it has a place in a field.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Name in the capture.
    pub name: String,
    /// Camera in the world.
    pub camera: Camera,
    /// (H, W, 3) sRGB-encoded, over white.
    pub color: Vec<f32>,
    /// (H, W) coverage of the object.
    pub foreground: Vec<f32>,
    /// (H, W) 1 where the pixel counts; `None`: all do.
    pub kept: Option<Vec<f32>>,
    /// (H, W) 1 where the colour counts; `None`: all do.
    pub colored: Option<Vec<f32>>,
    /// Passes, where there are any.
    pub passes: PassImages,
    /// Map of the light of this image, where the capture names one.
    pub environment: Option<PathBuf>,
}

/// An image of a fit; all arrays are row-major.
#[derive(Clone, Debug)]
pub struct Target {
    /// Name in the capture.
    pub name: String,
    /// Camera in the units of the field.
    pub camera: Camera,
    /// (H, W, 3) sRGB-encoded, over white.
    pub color: Vec<f32>,
    /// (H, W) coverage of the object.
    pub foreground: Vec<f32>,
    /// (H, W) 1 where the pixel counts; `None`: all do.
    pub kept: Option<Vec<f32>>,
    /// (H, W) 1 where the colour counts; `None`: all do.
    pub colored: Option<Vec<f32>>,
    /// (H, W, 3) sRGB-encoded, over white.
    pub albedo: Option<Vec<f32>>,
    /// (H, W, 2) roughness and metallic, over 1.
    pub material: Option<Vec<f32>>,
    /// (H, W, 3) world normals.
    pub normal: Option<Vec<f32>>,
    /// (H, W) 1 where a normal is compared: it faces the camera, and all pixels around are covered.
    pub solid: Vec<f32>,
    /// (H, W) depth z in the units of the field, 0 where nothing is hit.
    pub depth: Option<Vec<f32>>,
}

/// All images of a capture.
#[derive(Clone, Debug)]
pub struct Targets {
    /// Images to fit.
    pub train: Vec<Target>,
    /// Held-out images.
    pub test: Vec<Target>,
    /// The field's place in the world.
    pub placement: Placement,
    /// Factor from radiance to the linear value of an image, after exposures were made equal.
    pub exposure: f64,
}

/// Passes of a frame in the size of its view, the foreground from the alpha channel where there is no such pass; none where
/// the view is not the image itself (undistorted, or turned).
fn passes(frame: &Frame, view: &View, downscale: usize) -> Result<PassImages> {
    if !frame.lens.is_ideal() {
        return Ok(PassImages::default());
    }
    let mut read = PassImages::read(frame)?;
    if read.foreground.is_none() {
        let image = image_file::read(&frame.image)?;
        let (width, height) = (image.width, image.height);
        if (read.width, read.height) != (width, height) {
            read = PassImages { width, height, exposure: read.exposure, ..PassImages::default() };
        }
        let c = image.channels.len();
        let alpha = || (0..width * height).map(|i| image.value(i * c + c - 1)).collect();
        read.foreground = c.is_multiple_of(2).then(alpha);
    }
    let fits = (read.width / downscale, read.height / downscale) == (view.camera.width, view.camera.height);
    Ok(match (fits, downscale) {
        (false, _) => PassImages::default(),
        (true, 1) => read,
        (true, s) => read.reduced(s),
    })
}

/// Reads what a frame has besides its photo.
fn picture(frame: &Frame, view: &View, options: &Options) -> Result<Picture> {
    let pixels = view.camera.width * view.camera.height;
    let passes = passes(frame, view, options.downscale)?;
    let mask = view.mask.as_ref().map(|m| m.iter().map(|m| f32::from(*m)).collect::<Vec<f32>>());
    let (foreground, kept) = match (&passes.foreground, &frame.mask) {
        (Some(given), _) => (given.clone(), mask),
        // A mask alone is the foreground; one without zeros is not in the view.
        (None, Some(_)) if options.masks != Masks::Off => (mask.unwrap_or_else(|| vec![1.0; pixels]), None),
        (None, _) => {
            return Err(Error::input(view.name.clone())
                .at("foreground")
                .expected("an alpha channel, a mask, or a pass 'foreground'")
                .got("an image of the whole scene")
                .hint("fields show one object: give every image a mask of it"));
        }
    };
    let photo = Photo { name: &view.name, camera: &view.camera, rgb: &view.rgb };
    let mut made = photo.over_white(foreground, kept, passes);
    made.environment = frame.passes.environment.clone();
    Ok(made)
}

/// A photo before its background is replaced.
#[derive(Clone, Copy, Debug)]
pub struct Photo<'a> {
    /// Name in the capture.
    pub name: &'a str,
    /// Camera in the world.
    pub camera: &'a Camera,
    /// (H, W, 3) sRGB-encoded.
    pub rgb: &'a [u8],
}

impl Photo<'_> {
    /// Composites over white what is not white behind the foreground already.
    fn over_white(&self, foreground: Vec<f32>, kept: Option<Vec<f32>>, passes: PassImages) -> Picture {
        let plain = (0..foreground.len()).filter(|i| foreground[*i] == 0.0);
        let is_white = plain.clone().all(|i| self.rgb[3 * i..3 * i + 3].iter().all(|x| *x >= WHITE));
        let mut color: Vec<f32> = self.rgb.iter().map(|b| f32::from(*b) / 255.0).collect();
        let mut colored = kept.clone();
        if !is_white {
            let known =
                |i: usize| kept.as_ref().map_or(1.0, |k| k[i]) * f32::from(u8::from(is_whole(foreground[i])));
            colored = Some((0..foreground.len()).map(known).collect());
            for (x, m) in color.as_chunks_mut::<3>().0.iter_mut().zip(&foreground) {
                *x = x.map(|x| x * m + (1.0 - m));
            }
        }
        Picture {
            name: self.name.to_owned(),
            camera: self.camera.clone(),
            color,
            foreground,
            kept,
            colored,
            passes,
            environment: None,
        }
    }

    /// Makes the image of a render, whose passes include the foreground.
    ///
    /// # Panics
    /// Panics if they do not.
    pub fn rendered(&self, passes: PassImages) -> Picture {
        let foreground = passes.foreground.clone().expect("renders have a foreground");
        self.over_white(foreground, None, passes)
    }
}

/// Whether a pixel is covered completely or not at all.
fn is_whole(coverage: f32) -> bool {
    !(coverage > 0.0 && coverage < 1.0)
}

/// Returns a camera whose world is that of the field.
pub fn placed(camera: &Camera, at: &Placement) -> Camera {
    let (r, t) = (&camera.rotation, &camera.translation);
    let moved = |i: usize| {
        let center = (0..3).fold(f64::from(t[i]), |sum, k| sum + f64::from(r[i][k]) * at.center[k]);
        (at.scale * center) as f32
    };
    let translation = std::array::from_fn(moved);
    // R·Qᵀ: a row of R is a direction of the world.
    let rotation = if at.is_turned() { r.map(|row| turned(row, at)) } else { *r };
    Camera { rotation, translation, ..camera.clone() }
}

/// A direction of the world in the axes of the field.
fn turned(d: [f32; 3], at: &Placement) -> [f32; 3] {
    at.direction_to_field(d.map(f64::from)).map(|x| x as f32)
}

/// Whether a camera is in the box and all of its pixels show the object.
fn is_inside(t: &Target) -> bool {
    let half = super::state::HALF_SIZE;
    t.camera.center().iter().all(|x| x.abs() < half) && t.foreground.iter().all(|m| *m >= 0.5)
}

/// 1 where all of the 3×3 pixels around are covered and the normal faces the camera.
fn solid(p: &Picture) -> Vec<f32> {
    let camera = &p.camera;
    let (w, h) = (camera.width, camera.height);
    let Some(normals) = &p.passes.normal else { return vec![0.0; w * h] };
    let is_solid = |i: usize| {
        let (x, y) = (i % w, i / w);
        if x == 0 || y == 0 || x + 1 == w || y + 1 == h {
            return false;
        }
        let covered = (y - 1..y + 2).all(|r| (x - 1..x + 2).all(|c| p.foreground[r * w + c] > 0.999));
        let n = normals[i];
        let faces = |d: [f32; 3]| (d[0] * n[0] + d[1] * n[1]) + d[2] * n[2] < 0.0;
        covered && camera.ray([x as f32 + 0.5, y as f32 + 0.5]).is_some_and(|(_, d)| faces(d))
    };
    (0..w * h).map(|i| f32::from(u8::from(is_solid(i)))).collect()
}

/// Returns an image in the units of a field.
pub fn target(p: &Picture, at: &Placement) -> Target {
    let camera = placed(&p.camera, at);
    let over = |x: f32, m: f32| x * m + (1.0 - m);
    let albedo = p
        .passes
        .albedo
        .as_ref()
        .map(|a| a.iter().zip(&p.foreground).flat_map(|(a, m)| a.map(|x| over(x, *m))).collect());
    let material = p.passes.roughness.as_ref().zip(p.passes.metallic.as_ref()).map(|(r, k)| {
        let both = r.iter().zip(k).zip(&p.foreground);
        both.flat_map(|((r, k), m)| [over(*r, *m), over(*k, *m)]).collect()
    });
    Target {
        name: p.name.clone(),
        solid: solid(p),
        camera,
        color: p.color.clone(),
        foreground: p.foreground.clone(),
        kept: p.kept.clone(),
        colored: p.colored.clone(),
        albedo,
        material,
        normal: p.passes.normal.as_ref().map(|all| match at.is_turned() {
            true => all.iter().flat_map(|n| turned(*n, at)).collect(),
            false => all.as_flattened().to_vec(),
        }),
        depth: p.passes.depth.as_ref().map(|z| z.iter().map(|z| z * at.scale as f32).collect()),
    }
}

/// The object's share of a colour over white, (x − (1 − m)) / m within 0 to 1; 0 where the object covers nothing.
pub fn share(color: [f32; 3], coverage: f32) -> [f32; 3] {
    match coverage > 0.0 {
        true => color.map(|x| order::clamp((x - (1.0 - coverage)) / coverage, 0.0, 1.0)),
        false => [0.0; 3],
    }
}

/// Gives all images a common exposure, where they were exposed one by one, and brightens dark objects; returns it. Where
/// the exposure of an image is not known, all stay as they are: `None`.
///
/// # Errors
/// When a value is out of its range.
pub fn expose(pictures: &mut [Picture], given: Option<Common>) -> Result<Option<Common>> {
    let Some(exposures) = pictures.iter().map(|p| p.passes.exposure).collect::<Option<Vec<f64>>>() else {
        return Ok(None);
    };
    if exposures.iter().all(|e| *e == 1.0) && given.is_none_or(|g| g == Common::of(1.0)) {
        return Ok(Some(Common::of(1.0)));
    }
    let mut photographs: Vec<Photograph> = pictures
        .iter()
        .zip(&exposures)
        .map(|(p, e)| {
            // The white behind the object has no exposure.
            let pixels = p.color.as_chunks::<3>().0.iter().zip(&p.foreground);
            let color = pixels.map(|(x, m)| share(*x, *m)).collect();
            Photograph { color, foreground: p.foreground.clone(), exposure: *e }
        })
        .collect();
    let common = match given {
        Some(common) => {
            expose_photographs(&mut photographs, &common)?;
            common
        }
        None => equalise(&mut photographs)?.common,
    };
    for (p, lit) in pictures.iter_mut().zip(photographs) {
        // The background stays white.
        let pixels = p.color.as_chunks_mut::<3>().0.iter_mut().zip(lit.color).zip(&p.foreground);
        pixels.filter(|(_, m)| **m > 0.0).for_each(|((x, lit), m)| *x = lit.map(|x| x * m + (1.0 - m)));
    }
    Ok(Some(common))
}

/// Whether a ray of a foreground pixel meets the box of the field; the camera is in its units.
pub fn sees(camera: &Camera, foreground: &[f32]) -> bool {
    let rays = super::view::rays(camera);
    let half = super::state::HALF_SIZE;
    (0..foreground.len()).any(|i| {
        let [enter, leave] = rays.borrowed().crossing(i, half);
        foreground[i] >= 0.5 && enter < leave
    })
}

/// Bytes of a pixel of a capture in memory: the photo, colours over white, foreground and masks; passes are not
/// counted.
const PIXEL_BYTES: u64 = 3 + 12 + 4 + 4 + 4;

/// Reads a capture; no image has a place in a field yet.
#[derive(Clone, Debug)]
pub struct Pictures {
    /// The images with cameras.
    pub views: Views,
    /// The same images with what else the capture has.
    pub pictures: Vec<Picture>,
    /// The exposure that all images have now; `None` where that of one was not known, and all are as they were.
    pub common: Option<Common>,
    /// Whether the object is known to be in the ball of radius ½ around the origin.
    pub is_unit_ball: bool,
}

impl Pictures {
    /// Reads a capture. `exposure` is that of the images that a fit or a state was made with, for more images of the object.
    ///
    /// # Errors
    /// When the capture or an image is bad, or an image has no foreground.
    pub fn load(path: &Path, options: &Options, exposure: Option<Common>) -> Result<Self> {
        let reading = Reading {
            images: options.images.clone(),
            outside: options.outside,
            without_masks: options.masks == Masks::Off,
        };
        let capture: Capture = read_capture_with(path, &reading)?;
        memory::check("images", pixels(&capture.frames, options).saturating_mul(PIXEL_BYTES))
            .map_err(|e| e.hint("--downscale lowers the estimate, --max-memory raises the limit"))?;
        let views = Views::from_capture(&capture, options)?;
        let read = par::map(views.views.len(), |i| {
            let view = &views.views[i];
            let frame = capture.frames.iter().find(|f| f.name == view.name);
            picture(frame.expect("every view is a frame of the capture"), view, options)
        });
        let mut pictures = read.into_iter().collect::<Result<Vec<_>>>()?;
        let common = expose(&mut pictures, exposure)?;
        Ok(Self { views, pictures, common, is_unit_ball: capture.is_unit_ball })
    }

    /// The factor from radiance to the linear value of an image; 1 where it is not known.
    pub fn exposure(&self) -> f64 {
        self.common.map_or(1.0, |common| common.factor)
    }

    /// Returns the held-out images in the units of a field.
    pub fn held_out(&self, placement: &Placement) -> Vec<Target> {
        self.views.test.iter().map(|i| target(&self.pictures[*i], placement)).collect()
    }

    /// Returns the images in the units of a field.
    pub fn targets(&self, placement: Placement) -> Targets {
        let of = |which: &[usize]| which.iter().map(|i| target(&self.pictures[*i], &placement)).collect();
        Targets {
            train: of(&self.views.train),
            test: of(&self.views.test),
            placement,
            exposure: self.exposure(),
        }
    }
}

impl Targets {
    /// Whether every training image has all passes that materials are learned from.
    pub fn have_passes(&self) -> bool {
        self.train.iter().all(|t| t.albedo.is_some() && t.material.is_some() && t.normal.is_some())
    }

    /// Checks that a fit can be made.
    ///
    /// # Errors
    /// One view, no foreground ray that meets the box, a camera inside the object, or a crop larger than an image.
    pub fn validate(&self, crop: usize) -> Result<()> {
        if self.train.len() < 2 {
            return Err(Error::input("capture")
                .expected("at least two training images: one does not determine a shape")
                .got(self.train.len().to_string()));
        }
        for t in &self.train {
            let least = Ord::min(t.camera.width, t.camera.height);
            if least < crop {
                return Err(Error::input("--crop-side")
                    .at(t.name.clone())
                    .expected(format!("at most {least}, the smaller side of the image"))
                    .got(crop.to_string()));
            }
        }
        if let Some(t) = self.train.iter().find(|t| is_inside(t)) {
            return Err(Error::input(t.name.clone())
                .at("camera")
                .expected("a camera outside the object")
                .got("one in the box whose image shows nothing but the object")
                .hint("leave the image out, or set a smaller --box"));
        }
        if self.train.iter().any(|t| sees(&t.camera, &t.foreground)) {
            return Ok(());
        }
        Err(Error::input("--box")
            .expected("a box that covers the object in the images")
            .got("one that no foreground pixel of any training image sees"))
    }
}
