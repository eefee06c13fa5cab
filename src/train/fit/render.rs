//! Rendering of a scene file: Gaussians, cameras, passes, on disk as a capture.
//!
//! A folder of renders is itself a capture: its `transforms.json` lists the images and their cameras, so it
//! can be fitted again, or opened by any program that reads the nerfstudio layout.

use super::frames;
use crate::io::capture::{Frame, Lens, read_capture};
use crate::io::{atomic, image_file};
use crate::num::{order, par};
use crate::scene::camera::{Camera, Model};
use crate::scene::gaussians::Gaussians;
use crate::splat::color::Sh;
use crate::splat::render::{Color, In, Out, Settings, Shape};
use crate::splat::{activate, render};
use crate::{Error, Result};
use serde_json::{Value, json};
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
    assert!(downscale > 0, "downscale is at least 1");
    let capture = read_capture(path)?;
    let mut frames: Vec<&Frame> = capture.frames.iter().chain(&capture.missing).collect();
    frames.sort_by(|a, b| a.name.cmp(&b.name));
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
    frames.into_iter().map(shot).collect()
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

/// A circle of cameras around the scene, directed at its centre; world z is up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    /// number of cameras, evenly spaced, the first on the −y side
    pub count: usize,
    /// target point; `None`: the median centre of the opaque Gaussians
    pub center: Option<[f32; 3]>,
    /// distance; `None`: chosen so that four fifths of the opaque Gaussians are inside the image
    pub radius: Option<f32>,
    /// elevation above the horizon, radians
    pub elevation_rad: f64,
    /// horizontal field of view, radians
    pub fov_x_rad: f64,
    /// image width and height in pixels
    pub size: [usize; 2],
}

impl Orbit {
    /// Distance from which a ball of that radius, at least 1e-3, just fits into the image.
    pub fn distance(&self, reach: f32) -> f32 {
        let narrow = order::min(
            self.fov_x_rad,
            2.0 * libm::atan(libm::tan(self.fov_x_rad * 0.5) * self.size[1] as f64 / self.size[0] as f64),
        );
        order::max(reach, 1e-3) / libm::sin(narrow * 0.5) as f32
    }

    /// The cameras.
    ///
    /// # Errors
    /// When the scene is empty and `center` or `radius` is not set, or a number is out of range.
    pub fn shots(&self, scene: &Gaussians) -> Result<Vec<Shot>> {
        if !(self.count >= 1 && self.count <= 100_000) {
            return Err(Error::input("orbit").expected("1 to 100000 cameras").got(self.count.to_string()));
        }
        if !(self.fov_x_rad > 0.01 && self.fov_x_rad < 3.0) {
            return Err(Error::input("orbit")
                .at("field of view")
                .expected("more than 0.6 and less than 171 degrees")
                .got(format!("{:.3}", self.fov_x_rad.to_degrees())));
        }
        if !(-1.55..=1.55).contains(&self.elevation_rad) {
            return Err(Error::input("orbit")
                .at("elevation")
                .expected("less than 88 degrees")
                .got(format!("{:.3}", self.elevation_rad.to_degrees())));
        }
        let opaque: Vec<usize> = (0..scene.len()).filter(|&i| scene.opacity_logits[i] > 0.0).collect();
        let used: Vec<usize> = if opaque.is_empty() { (0..scene.len()).collect() } else { opaque };
        if used.is_empty() && (self.center.is_none() || self.radius.is_none()) {
            return Err(Error::input("orbit")
                .expected("at least one Gaussian, or a given center and radius")
                .got("an empty scene"));
        }
        let center = self.center.unwrap_or_else(|| {
            std::array::from_fn(|k| quantile(used.iter().map(|&i| scene.means[i][k]), 0.5))
        });
        let radius = self.radius.unwrap_or_else(|| {
            let reach = quantile(
                used.iter().map(|&i| {
                    let d: [f32; 3] = std::array::from_fn(|k| scene.means[i][k] - center[k]);
                    (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt()
                }),
                0.8,
            );
            self.distance(reach)
        });
        if !(radius > 0.0 && radius.is_finite()) {
            return Err(Error::input("orbit")
                .at("radius")
                .expected("a positive number")
                .got(radius.to_string()));
        }
        let digits = (self.count - 1).to_string().len().max(3);
        let focal = (0.5 * self.size[0] as f64 / libm::tan(self.fov_x_rad * 0.5)) as f32;
        (0..self.count)
            .map(|i| {
                let turn = core::f64::consts::TAU * i as f64 / self.count as f64;
                let (se, ce) = (libm::sin(self.elevation_rad), libm::cos(self.elevation_rad));
                let out = [ce * libm::sin(turn), -ce * libm::cos(turn), se]; // from the centre to the camera
                let eye: [f64; 3] =
                    std::array::from_fn(|k| f64::from(center[k]) + f64::from(radius) * out[k]);
                let camera = look_at(eye, out.map(|x| -x), [focal, focal], self.size);
                camera.validate()?;
                Ok(Shot { name: format!("{i:0digits$}"), camera })
            })
            .collect()
    }
}

/// A pinhole camera at `eye` looking along the unit vector `forward`, z up, principal point in the middle.
fn look_at(eye: [f64; 3], forward: [f64; 3], focal_px: [f32; 2], [width, height]: [usize; 2]) -> Camera {
    // right = forward × z, of length cos(elevation) > 0; down = forward × right
    let length = (forward[0] * forward[0] + forward[1] * forward[1]).sqrt();
    let right = [forward[1] / length, -forward[0] / length, 0.0];
    let down = [
        forward[1] * right[2] - forward[2] * right[1],
        forward[2] * right[0] - forward[0] * right[2],
        forward[0] * right[1] - forward[1] * right[0],
    ];
    let rows = [right, down, forward];
    Camera {
        rotation: rows.map(|r| r.map(|x| x as f32)),
        translation: rows.map(|r| -(r[0] * eye[0] + r[1] * eye[1] + r[2] * eye[2]) as f32),
        focal_px,
        center_px: [width as f32 * 0.5, height as f32 * 0.5],
        width,
        height,
        model: Model::Pinhole,
    }
}

/// Linear radiance of an sRGB-encoded value (IEC 61966-2-1), in f64, rounded once; negative values count as
/// 0.
fn linear_from_srgb(x: f32) -> f32 {
    let x = order::max(f64::from(x), 0.0);
    (if x <= 0.04045 { x / 12.92 } else { libm::pow((x + 0.055) / 1.055, 2.4) }) as f32
}

/// The entry at `q` of the sorted values.
fn quantile(values: impl Iterator<Item = f32>, q: f64) -> f32 {
    let mut v: Vec<f32> = values.collect();
    v.sort_unstable_by(f32::total_cmp);
    let at = ((v.len() - 1) as f64 * q) as usize;
    v[at]
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
    fn an_orbit_looks_at_the_middle() {
        let scene = Gaussians {
            means: vec![[1.0, 2.0, 3.0]; 5],
            quats: vec![[1.0, 0.0, 0.0, 0.0]; 5],
            scales_log: vec![[-3.0; 3]; 5],
            opacity_logits: vec![1.0; 5],
            sh: vec![0.0; 15],
            sh_degree: 0,
        };
        let orbit = Orbit {
            count: 8,
            center: None,
            radius: Some(2.0),
            elevation_rad: 0.3,
            fov_x_rad: 1.0,
            size: [40, 30],
        };
        let shots = orbit.shots(&scene).expect("a valid orbit");
        for shot in &shots {
            let c = &shot.camera;
            let p: [f32; 3] = std::array::from_fn(|i| {
                c.rotation[i][0] * 1.0 + c.rotation[i][1] * 2.0 + c.rotation[i][2] * 3.0 + c.translation[i]
            });
            assert!(
                p[0].abs() < 1e-5 && p[1].abs() < 1e-5 && (p[2] - 2.0).abs() < 1e-5,
                "the centre is straight ahead: {p:?}"
            );
            assert!(c.rotation[1][2] < -0.9, "z is up, the camera's y is down");
        }
        assert_eq!(shots[7].name, "007", "names sort");
        let t = transforms(&shots, Passes { color: true, linear: false, depth: true, alpha: false });
        assert_eq!(t["frames"][0]["file_path"], "color/000.png", "named after the image");
        assert!(Orbit { count: 0, ..orbit }.shots(&scene).is_err(), "no camera");
        assert!(Orbit { radius: None, ..orbit }.shots(&Gaussians::default()).is_err(), "an empty scene");
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
