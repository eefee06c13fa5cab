//! The images of a fit: colours over white, foreground, passes, and cameras in the units of the field.
//!
//! Foreground is the pass of that name, else the alpha channel of the image, else its mask. Where the background of the
//! image is not white, the image is multiplied by the foreground and composited over white. Images of a renderer that were
//! exposed one by one get a common exposure ([`crate::fit::exposure`]).

use crate::fit::exposure::{Photograph, equalise};
use crate::io::capture::{Capture, Frame, Reading, read_capture_with};
use crate::io::image_file;
use crate::num::par;
use crate::scene::camera::Camera;
use crate::scene::field::Placement;
use crate::scene::passes::PassImages;
use crate::scene::views::{Masks, Options, View, Views};
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

/// Returns the foreground of a frame as the capture has it: a pass, or the alpha channel.
fn foreground(frame: &Frame, view: &View, passes: &PassImages) -> Result<Option<Vec<f32>>> {
    if let Some(pass) = &passes.foreground {
        return Ok(Some(pass.clone()));
    }
    let image = image_file::read(&frame.image)?;
    let c = image.channels.len();
    if c.is_multiple_of(2) && (image.width, image.height) == (view.camera.width, view.camera.height) {
        let alpha = (0..image.width * image.height).map(|i| image.value(i * c + c - 1)).collect();
        return Ok(Some(alpha));
    }
    Ok(None)
}

/// Reads what a frame has besides its photo.
fn picture(frame: &Frame, view: &View, masks: Masks) -> Result<Picture> {
    let pixels = view.camera.width * view.camera.height;
    let is_same = frame.lens.is_ideal();
    let read = if is_same { PassImages::read(frame)? } else { PassImages::default() };
    let fits =
        read.width * read.height == 0 || (read.width, read.height) == (view.camera.width, view.camera.height);
    let passes = if fits { read } else { PassImages::default() };
    let given = if is_same && fits { foreground(frame, view, &passes)? } else { None };
    let mask = || view.mask.as_ref().map(|m| m.iter().map(|m| f32::from(*m)).collect::<Vec<f32>>());
    let (foreground, kept) = match (given, masks) {
        (Some(given), Masks::Off) => (given, None),
        (Some(given), _) => (given, mask()),
        // A mask alone is the foreground.
        (None, _) => {
            let mask = mask().ok_or_else(|| {
                Error::input(view.name.clone())
                    .at("foreground")
                    .expected("an alpha channel, a mask, or a pass 'foreground'")
                    .got("an image of the whole scene")
                    .hint("`field fit` fits one object: give every image a mask of it")
            })?;
            (mask, None)
        }
    };
    let plain = (0..pixels).filter(|i| foreground[*i] == 0.0);
    let is_white = plain.clone().all(|i| view.rgb[3 * i..3 * i + 3].iter().all(|x| *x >= WHITE));
    let mut color = view.image();
    if !is_white {
        for (x, m) in color.as_chunks_mut::<3>().0.iter_mut().zip(&foreground) {
            *x = x.map(|x| x * m + (1.0 - m));
        }
    }
    let environment = frame.passes.environment.clone();
    Ok(Picture {
        name: view.name.clone(),
        camera: view.camera.clone(),
        color,
        foreground,
        kept,
        passes,
        environment,
    })
}

/// A camera whose world is that of the field.
fn placed(camera: &Camera, at: &Placement) -> Camera {
    let (r, t) = (&camera.rotation, &camera.translation);
    let moved = |i: usize| {
        let turned = (0..3).fold(f64::from(t[i]), |sum, k| sum + f64::from(r[i][k]) * at.center[k]);
        (at.scale * turned) as f32
    };
    Camera { translation: std::array::from_fn(moved), ..camera.clone() }
}

/// 1 where all of the 3×3 pixels around are covered and the normal faces the camera.
fn solid(p: &Picture, camera: &Camera) -> Vec<f32> {
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

fn target(p: &Picture, at: &Placement) -> Target {
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
        solid: solid(p, &camera),
        camera,
        color: p.color.clone(),
        foreground: p.foreground.clone(),
        kept: p.kept.clone(),
        albedo,
        material,
        normal: p.passes.normal.as_ref().map(|n| n.as_flattened().to_vec()),
        depth: p.passes.depth.as_ref().map(|z| z.iter().map(|z| z * at.scale as f32).collect()),
    }
}

/// Gives all images a common exposure, where they were exposed one by one, and brightens dark objects; returns the factor
/// from radiance to the images.
fn expose(pictures: &mut [Picture], given: Option<f64>) -> Result<f64> {
    let Some(exposures) = pictures.iter().map(|p| p.passes.exposure).collect::<Option<Vec<f64>>>() else {
        return Ok(1.0);
    };
    if exposures.iter().all(|e| *e == 1.0) && given.is_none_or(|g| g == 1.0) {
        return Ok(1.0);
    }
    let mut photographs: Vec<Photograph> = pictures
        .iter()
        .zip(&exposures)
        .map(|(p, e)| Photograph {
            color: p.color.as_chunks::<3>().0.to_vec(),
            foreground: p.foreground.clone(),
            exposure: *e,
        })
        .collect();
    let factor = match given {
        Some(factor) => {
            super::super::exposure::expose(&mut photographs, factor)?;
            factor
        }
        None => {
            let gains = equalise(&mut photographs)?;
            gains.lift * (gains.views.first().copied().unwrap_or(1.0) * exposures[0])
        }
    };
    for (p, lit) in pictures.iter_mut().zip(photographs) {
        // The background stays white.
        let pixels = p.color.as_chunks_mut::<3>().0.iter_mut().zip(lit.color).zip(&p.foreground);
        pixels.filter(|(_, m)| **m > 0.0).for_each(|((x, lit), _)| *x = lit);
    }
    Ok(factor)
}

/// Reads a capture; no image has a place in a field yet.
#[derive(Clone, Debug)]
pub struct Pictures {
    /// The images with cameras.
    pub views: Views,
    /// The same images with what else the capture has.
    pub pictures: Vec<Picture>,
    /// Factor from radiance to the linear value of an image.
    pub exposure: f64,
}

impl Pictures {
    /// Reads a capture. `exposure` is the factor from radiance to the images that a fit was made with, for held-out images of
    /// another capture.
    ///
    /// # Errors
    /// When the capture or an image is bad, or an image has no foreground.
    pub fn load(path: &Path, options: &Options, exposure: Option<f64>) -> Result<Self> {
        let reading = Reading {
            images: options.images.clone(),
            outside: options.outside,
            without_masks: options.masks == Masks::Off,
        };
        let capture: Capture = read_capture_with(path, &reading)?;
        let views = Views::from_capture(&capture, options)?;
        let find = |view: &View| capture.frames.iter().find(|f| f.name == view.name);
        let read = par::map(views.views.len(), |i| {
            let view = &views.views[i];
            let frame = find(view).expect("every view is a frame of the capture");
            picture(frame, view, options.masks)
        });
        let mut pictures = read.into_iter().collect::<Result<Vec<_>>>()?;
        let exposure = expose(&mut pictures, exposure)?;
        Ok(Self { views, pictures, exposure })
    }

    /// Returns the images in the units of a field.
    ///
    /// # Errors
    /// When no foreground pixel of the training images sees the box.
    pub fn targets(&self, placement: Placement) -> Targets {
        let of = |which: &[usize]| which.iter().map(|i| target(&self.pictures[*i], &placement)).collect();
        Targets {
            train: of(&self.views.train),
            test: of(&self.views.test),
            placement,
            exposure: self.exposure,
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
    /// One view, no foreground ray that meets the box, or a crop larger than an image.
    pub fn validate(&self, crop: usize) -> Result<()> {
        if self.train.len() < 2 {
            return Err(Error::input("capture")
                .expected("at least two training images: one does not determine a shape")
                .got(self.train.len().to_string()));
        }
        for t in &self.train {
            let least = Ord::min(t.camera.width, t.camera.height);
            if least < crop {
                return Err(Error::input("--crop")
                    .at(t.name.clone())
                    .expected(format!("at most {least}, the smaller side of the image"))
                    .got(crop.to_string()));
            }
        }
        let sees = |t: &Target| {
            let rays = super::view::rays(&t.camera);
            let half = super::state::HALF_SIZE;
            (0..t.foreground.len()).any(|i| {
                let [enter, leave] = rays.borrowed().crossing(i, half);
                t.foreground[i] >= 0.5 && enter < leave
            })
        };
        if self.train.iter().any(sees) {
            return Ok(());
        }
        Err(Error::input("--box")
            .expected("a box that covers the object in the images")
            .got("one that no foreground pixel of any training image sees"))
    }
}
