//! Rendering of a scene file: Gaussians, cameras, passes, on disk as a capture.
//!
//! A folder of renders is itself a capture: its `transforms.json` lists the images and their cameras, so it
//! can be fitted again, or opened by any program that reads the nerfstudio layout.

use super::frames;
use super::passes::read_json;
use crate::io::capture::{Frame, Lens, Reading, read_cameras};
use crate::io::{atomic, image_file};
use crate::num::{order, par};
use crate::scene::camera::{Camera, Model};
use crate::scene::gaussians::Gaussians;
use crate::splat::color::Sh;
use crate::splat::render::{Color, In, Out, Settings, Shape};
use crate::splat::{activate, render};
use crate::{Error, Result};
use serde_json::{Value, json};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Gaussians ready to be rendered: activated once, for any number of cameras.
pub struct Scene<'a> {
    stored: &'a Gaussians,
    scales: Vec<[f32; 3]>,
    opacities: Vec<f32>,
    settings: Settings,
    background: [f32; 3],
}

impl<'a> Scene<'a> {
    /// Applies exp and sigmoid.
    pub fn new(stored: &'a Gaussians, settings: Settings, background: [f32; 3]) -> Self {
        let (mut scales, mut opacities) = (vec![[0.0; 3]; stored.len()], vec![0.0; stored.len()]);
        activate::forward(&stored.scales_log, &stored.opacity_logits, &mut scales, &mut opacities);
        Self { stored, scales, opacities, settings, background }
    }

    /// Checks what a render takes: 28 bytes per pixel of results, their files, and the rows of the Gaussians.
    fn check_memory(&self, camera: &Camera) -> Result<()> {
        frames::check_memory(camera, 64, 200 * self.stored.len() as u64)
    }

    /// Renders the image of one camera.
    ///
    /// # Errors
    /// When the camera is not valid, or a pixel is not finite because a parameter is far out of range.
    pub fn render(&self, camera: &Camera) -> Result<Out> {
        self.check_memory(camera)?;
        let x = In {
            means: &self.stored.means,
            shape: Shape::QuatScale { quats: &self.stored.quats, scales: &self.scales },
            opacities: &self.opacities,
            color: Color::Sh(Sh {
                values: &self.stored.sh,
                coefficients: self.stored.sh_coefficients(),
                degree: self.stored.sh_degree,
            }),
            cameras: std::slice::from_ref(camera),
            background: self.background,
        };
        x.validate(&self.settings)?;
        let (out, _) = render::forward(&x, &self.settings);
        if out.image.iter().all(|x| x.is_finite()) {
            Ok(out)
        } else {
            Err(Error::input("render")
                .expected("finite pixels")
                .got("a pixel that is not: a parameter of the scene overflows"))
        }
    }
}

/// Which images are written for each camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Passes {
    /// `color/NAME.png`, sRGB-encoded, 8 bits
    pub color: bool,
    /// `linear/NAME.exr`, linear radiance R, G, B
    pub linear: bool,
    /// `depth/NAME.exr`, camera depth z weighted by α, not normalised: divide by alpha for the mean depth
    pub depth: bool,
    /// `alpha/NAME.exr`, coverage
    pub alpha: bool,
}

impl Passes {
    /// Parses comma-separated names: `color`, `linear`, `depth`, `alpha`.
    ///
    /// # Errors
    /// When a name is none of these.
    pub fn parse(text: &str) -> Result<Self> {
        let mut passes = Self { color: false, linear: false, depth: false, alpha: false };
        for name in text.split(',').map(str::trim) {
            match name {
                "color" => passes.color = true,
                "linear" => passes.linear = true,
                "depth" => passes.depth = true,
                "alpha" => passes.alpha = true,
                other => {
                    return Err(Error::input("--passes")
                        .expected("a comma-separated list of color, linear, depth, alpha")
                        .got(other));
                }
            }
        }
        Ok(passes)
    }
}

/// A camera with the name of its files.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// without extension and folders
    pub name: String,
    /// the camera
    pub camera: Camera,
}

/// Renders every shot into `dir` and writes `transforms.json`; returns the files written, relative to `dir`.
///
/// # Errors
/// When a file cannot be written, two shots share a name, or a render is not finite.
pub fn to_folder(
    scene: &Scene<'_>,
    shots: &[Shot],
    passes: Passes,
    dir: &Path,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Vec<PathBuf>> {
    let mut names: Vec<&str> = shots.iter().map(|s| s.name.as_str()).collect();
    names.sort_unstable();
    if let Some(twice) = names.windows(2).find(|w| w[0] == w[1]) {
        return Err(Error::input("cameras")
            .at(format!("name '{}'", twice[0]))
            .expected("different names")
            .got("two cameras with the same name"));
    }
    shots.iter().try_for_each(|shot| scene.check_memory(&shot.camera))?;
    let mut files = Vec::new();
    for (done, shot) in shots.iter().enumerate() {
        progress(done, shots.len());
        let out = scene.render(&shot.camera)?;
        let (w, h) = (shot.camera.width, shot.camera.height);
        let mut target = |folder: &str, extension: &str| -> Result<PathBuf> {
            let relative = PathBuf::from(folder).join(format!("{}.{extension}", shot.name));
            let full = dir.join(&relative);
            let parent = dir.join(folder);
            std::fs::create_dir_all(&parent).map_err(|e| Error::os(&parent, &e))?;
            files.push(relative);
            Ok(full)
        };
        if passes.color {
            image_file::write_png(&target("color", "png")?, w, h, 3, &image_file::to_u8(&out.image)?)?;
        }
        if passes.linear {
            let linear: Vec<f32> =
                par::map_batched(out.image.len(), 4096, |i| linear_from_srgb(out.image[i]));
            image_file::write_exr(&target("linear", "exr")?, w, h, &["R", "G", "B"], &linear)?;
        }
        if passes.depth {
            image_file::write_exr(&target("depth", "exr")?, w, h, &["Z"], &out.depth)?;
        }
        if passes.alpha {
            image_file::write_exr(&target("alpha", "exr")?, w, h, &["A"], &out.alpha)?;
        }
    }
    progress(shots.len(), shots.len());
    atomic::write_bytes(
        &dir.join("transforms.json"),
        format!("{:#}\n", transforms(shots, passes)).as_bytes(),
    )?;
    files.push(PathBuf::from("transforms.json"));
    Ok(files)
}

/// The cameras in the nerfstudio dialect: world-from-camera with OpenGL axes, intrinsics per frame.
fn transforms(shots: &[Shot], passes: Passes) -> Value {
    let (folder, extension) = match passes {
        Passes { color: true, .. } => ("color", "png"),
        Passes { linear: true, .. } => ("linear", "exr"),
        Passes { depth: true, .. } => ("depth", "exr"),
        _ => ("alpha", "exr"),
    };
    let list: Vec<Value> = shots
        .iter()
        .map(|shot| {
            let mut frame = frames::frame(&format!("{folder}/{}.{extension}", shot.name), &shot.camera);
            if passes.depth {
                frame["depth_file_path"] = json!(format!("depth/{}.exr", shot.name));
            }
            frame
        })
        .collect();
    let model = frames::model_name(shots.first().map_or(Model::Pinhole, |s| s.camera.model));
    json!({"camera_model": model, "frames": list})
}

/// The cameras of a capture, as ideal cameras with the sizes of its images divided by `downscale`. If sizes
/// are declared, the images need not exist.
///
/// # Errors
/// When the layout is invalid, or an image without a declared size cannot be read.
pub fn capture_shots(path: &Path, downscale: usize) -> Result<Vec<Shot>> {
    shots_of(path, downscale, &Reading::default())
}

/// [`capture_shots`] of a capture whose files are found according to `reading`, or of a `camera_path.json`.
///
/// # Errors
/// See [`capture_shots`].
pub fn shots_of(path: &Path, downscale: usize, reading: &Reading) -> Result<Vec<Shot>> {
    assert!(downscale > 0, "downscale is at least 1");
    let frames = read_cameras(path, reading)?;
    let shot = |frame: &Frame| {
        let [width, height] = match frame.size {
            Some(size) => size,
            None => {
                let image = image_file::read(&frame.image)?;
                [image.width, image.height]
            }
        };
        let k = frame.intrinsics(width, height)?.map(|x| (x / downscale as f64) as f32);
        let v = frame.view_from_world.map(|row| row.map(|x| x as f32));
        let camera = Camera {
            rotation: std::array::from_fn(|i| [v[i][0], v[i][1], v[i][2]]),
            translation: std::array::from_fn(|i| v[i][3]),
            focal_px: [k[0], k[1]],
            center_px: [k[2], k[3]],
            width: width / downscale,
            height: height / downscale,
            model: if matches!(frame.lens, Lens::Fisheye { .. }) { Model::Fisheye } else { Model::Pinhole },
        };
        camera.validate().map_err(|e| e.at(frame.name.as_str()))?;
        Ok(Shot { name: flat_name(&frame.name), camera })
    };
    frames.iter().map(shot).collect()
}

/// The cameras a scene file was fitted with: those of the `transforms.json` beside it, if that names it.
///
/// # Errors
/// When the file is there and cannot be read.
pub fn fitted_cameras(scene: &Path) -> Result<Vec<Camera>> {
    let list = scene.with_file_name("transforms.json");
    let names_it = |top: &Value| top[frames::SCENE].as_str().map(OsStr::new) == scene.file_name();
    if !list.is_file() || !names_it(&read_json(&list)?) {
        return Ok(Vec::new());
    }
    Ok(capture_shots(&list, 1)?.into_iter().map(|shot| shot.camera).collect())
}

/// `images/0001.png` as `images_0001`: one file per view in one folder.
pub fn flat_name(name: &str) -> String {
    let name = name.trim_start_matches("./");
    let flat: String = name.chars().map(|c| if matches!(c, '/' | '\\' | ':') { '_' } else { c }).collect();
    match flat.rsplit_once('.') {
        Some((stem, _)) if !stem.is_empty() => stem.to_owned(),
        _ => flat,
    }
}

/// Linear radiance of an sRGB-encoded value (IEC 61966-2-1), in f64, rounded once; negative values count as 0.
fn linear_from_srgb(x: f32) -> f32 {
    let x = order::max(f64::from(x), 0.0);
    (if x <= 0.04045 { x / 12.92 } else { libm::pow((x + 0.055) / 1.055, 2.4) }) as f32
}

/// Estimated number of bytes needed to render one image of this size.
pub fn image_bytes(width: usize, height: usize) -> u64 {
    // image, alpha, depth, final transmittance, last index, and as much again for their cotangents
    (width * height) as u64 * 4 * (3 + 1 + 1 + 2) * 2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn renders_are_described_by_their_pictures() {
        let camera = Camera {
            rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            translation: [0.0; 3],
            focal_px: [30.0; 2],
            center_px: [20.0, 15.0],
            width: 40,
            height: 30,
            model: Model::Pinhole,
        };
        let shots = [Shot { name: "000".into(), camera }];
        let t = transforms(&shots, Passes { color: true, linear: false, depth: true, alpha: false });
        assert_eq!(t["frames"][0]["file_path"], "color/000.png", "named after the picture");
    }

    #[test]
    fn names_are_flat() {
        assert_eq!(flat_name("images/0001.png"), "images_0001", "one file per view");
        assert_eq!(flat_name("./train/r_0"), "train_r_0", "no extension");
    }

    #[test]
    fn passes_are_named() {
        let p = Passes::parse("color, depth").expect("both exist");
        assert!(p.color && p.depth && !p.alpha && !p.linear, "as named");
        assert!(Passes::parse("colour").is_err(), "no such pass");
    }
}
