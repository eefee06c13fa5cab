//! The parts of `field eval` that Stanford-ORB defines, and the object's mesh under another light.

use crate::console as cli;
use crate::fit::field::Target;
use crate::fit::field::benchmark::{
    ImageScores, PROTOCOL, Relighting, Relit, Shape, ViewScores, geometry, perceptual_name,
};
use crate::fit::field::mesh::{self, Baked};
use crate::fit::field::targets::{Picture, Pictures};
use crate::io::image_file;
use crate::loss::lpips::Metric;
use crate::meter::Meter;
use crate::scene::environment_file::{self, Options};
use crate::scene::field::Field;
use crate::scene::light::Environment;
use crate::scene::model;
use crate::shade::render::Settings;
use crate::{Error, Result};
use lastlight_lirm::truth::ENVIRONMENT;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

/// Scores of a field as Stanford-ORB defines them.
pub(crate) struct Benchmark {
    /// Of the field's colours; absent if the images show another light.
    views: Option<Value>,
    /// Normals and depth.
    geometry: Value,
    /// Name of the perceptual score.
    perceptual: &'static str,
    /// Of the mesh under the light of the images.
    pub(super) relit: Vec<Relit>,
    /// Distances to the true surface.
    pub(super) shape: Option<Shape>,
}

/// The scores of images: key, name, unit, digits.
const IMAGES: [(&str, &str, &str, usize); 5] = [
    ("psnr_h_db", "PSNR-H", "dB", 3),
    ("psnr_l_db", "PSNR-L", "dB", 3),
    ("psnr_mask_db", "PSNR-mask", "dB", 3),
    ("psnr_eroded_db", "PSNR-eroded", "dB", 3),
    ("ssim", "SSIM-3", "", 4),
];

impl Benchmark {
    /// Gathers the scores of views.
    ///
    /// # Errors
    /// When sizes differ.
    pub(super) fn of(
        views: &[(&ViewScores, &Target)],
        scale: f64,
        relight: bool,
        weights: Option<&Metric>,
    ) -> Result<Self> {
        let images: Option<Vec<ImageScores>> = views.iter().map(|(v, _)| v.image).collect();
        Ok(Self {
            views: images.filter(|_| !relight).map(|all| ImageScores::means(&all)),
            geometry: geometry(views, scale)?,
            perceptual: perceptual_name(weights),
            relit: Vec::new(),
            shape: None,
        })
    }

    /// Means over the relit images.
    fn relit_means(&self) -> Option<Value> {
        let all: Vec<ImageScores> = self.relit.iter().map(|r| r.scores).collect();
        (!all.is_empty()).then(|| ImageScores::means(&all))
    }

    /// Mean PSNR in the mask of the relit images.
    pub(super) fn relit_mask_db(&self) -> Option<f64> {
        self.relit_means()?["psnr_mask_db"].as_f64()
    }

    /// As a JSON record.
    pub(super) fn json(&self) -> Value {
        json!({
            "protocol": PROTOCOL, "perceptual": self.perceptual, "views": self.views, "geometry": self.geometry,
            "relit": self.relit_means().map(|mean| json!({
                "mean": mean, "images": self.relit.iter().map(Relit::json).collect::<Vec<Value>>(),
            })),
            "shape": self.shape.as_ref().map(Shape::json),
        })
    }

    /// Rows for the terminal and the report: what, name, value.
    pub(super) fn rows(&self) -> Vec<(&'static str, String, String)> {
        let mut rows = Vec::new();
        for (what, means) in [("novel views", &self.views), ("relit", &self.relit_means())] {
            let Some(means) = means else { continue };
            for (key, name, unit, digits) in IMAGES {
                if let Some(x) = means[key].as_f64() {
                    rows.push((what, name.to_owned(), format!("{x:.digits$} {unit}").trim().to_owned()));
                }
            }
            if let Some(x) = means["perceptual"].as_f64() {
                rows.push((what, self.perceptual.to_owned(), format!("{x:.4}")));
            }
        }
        if let Some(x) = self.geometry["normals"].as_f64() {
            rows.push(("normals", "mean of 1 - cos".to_owned(), format!("{x:.5}")));
        }
        if let Some(x) = self.geometry["depth"].as_f64() {
            let scale = self.geometry["depth_scale"].as_f64().unwrap_or(f64::NAN);
            rows.push(("depth", format!("squared error, scale {scale:.5}"), format!("{x:.4e}")));
        }
        if let Some(shape) = &self.shape {
            let mut row = |name: &str, value: String| rows.push(("shape", name.to_owned(), value));
            row("to vertices, value of the code", format!("{:.4e}", shape.scan.value()));
            row("to vertices, value of the table", format!("{:.4}", shape.scan.table()));
            row("to triangles, bounding radii", format!("{:.5}", shape.distance()));
            row(
                "between samples, bounding radii",
                format!("{:.5}", shape.surfaces.chamfer_mean / shape.radius),
            );
        }
        rows
    }

    /// The rows as lines for a terminal.
    pub(super) fn summary(&self) -> String {
        let lines: Vec<String> = self
            .rows()
            .into_iter()
            .map(|(what, name, value)| format!("{what:<12} {name:<33} {value}"))
            .collect();
        lines.join("\n")
    }
}

/// Removes the scores of colours from a record.
pub(super) fn without_colors(record: &mut Value) {
    for key in ["psnr_db", "ssim", "mae"] {
        record[key] = Value::Null;
    }
}

/// The maps of the images, each once, and which of them lights an image.
pub(super) struct Lighting {
    maps: Vec<Environment>,
    of: Vec<usize>,
}

/// Reads the light of the images: one map, or those that the capture names.
///
/// # Errors
/// When a map is bad, or an image has none.
pub(super) fn lights(
    pictures: &Pictures,
    which: &[(usize, &Target)],
    given: Option<Environment>,
    capture: &Path,
) -> Result<Lighting> {
    if let Some(map) = given {
        return Ok(Lighting { maps: vec![map], of: vec![0; which.len()] });
    }
    let mut paths: Vec<PathBuf> = Vec::new();
    let mut of = Vec::with_capacity(which.len());
    for (at, _) in which {
        let picture = &pictures.pictures[*at];
        let path = picture.environment.as_ref().ok_or_else(|| {
            let e = Error::input(picture.name.clone())
                .at("light")
                .expected("--env, or a map that the capture names for every image (environment_path)")
                .got("neither");
            // `lirm gen` writes an object's map beside its captures, where a capture may not point.
            let folder = if capture.is_dir() { capture } else { capture.parent().unwrap_or(capture) };
            let beside = match folder.file_name() {
                Some(_) => folder.with_file_name(ENVIRONMENT),
                None => folder.join("..").join(ENVIRONMENT),
            };
            if beside.is_file() { e.hint(format!("--env {}", beside.display())) } else { e }
        })?;
        let known = paths.iter().position(|p| p == path);
        of.push(known.unwrap_or(paths.len()));
        if known.is_none() {
            paths.push(path.clone());
        }
    }
    let maps = paths.iter().map(|p| environment_file::read(p, &Options::default())).collect::<Result<_>>()?;
    Ok(Lighting { maps, of })
}

/// Makes the mesh of a field as `field mesh` does by default.
///
/// # Errors
/// When the field has no surface.
pub(super) fn bake(field: &Field) -> Result<Baked> {
    mesh::bake(field, &mesh::Settings::default())
}

/// Compares a mesh with the true surface.
///
/// # Errors
/// When the file is bad, or a surface has no area.
pub(super) fn shape(baked: &Baked, path: &Path, seed: u64) -> Result<Shape> {
    let truth = model::read(path)?;
    Shape::of(&baked.object.mesh, &truth.mesh, seed).map_err(|e| e.within(path.display().to_string()))
}

/// Settings of the path tracer.
pub(super) fn settings(samples: u32, bounces: u32, seed: u64) -> Settings {
    Settings { samples, bounces, seed, ..Settings::default() }
}

/// Renders and scores the mesh under the light of every image.
///
/// # Errors
/// When a camera is not valid, or the run is interrupted.
pub(super) fn relit(
    baked: &Baked,
    images: &[(&Picture, &[f32])],
    lights: &Lighting,
    settings: Settings,
    weights: Option<&Metric>,
    meter: &mut Meter,
) -> Result<Vec<Relit>> {
    let job = Relighting::new(&baked.object, settings);
    cli::stoppable(|stop| {
        let mut out = Vec::with_capacity(images.len());
        for (i, ((picture, truth), map)) in images.iter().zip(&lights.of).enumerate() {
            if stop.load(Ordering::Relaxed) {
                return Err(Error::interrupted("relighting"));
            }
            meter.count(i, images.len(), "relighting");
            out.push(job.score(picture, truth, i, &lights.maps[*map], weights)?);
        }
        meter.done();
        Ok(out)
    })
}

/// Writes `relit/NAME.png`, the renders after their scales; gives the names.
///
/// # Errors
/// When a file cannot be written.
pub(super) fn write_relit(
    dir: &Path,
    relit: &[Relit],
    flat_name: &dyn Fn(&str) -> String,
) -> Result<Vec<String>> {
    let mut names = Vec::new();
    if !relit.is_empty() {
        let path = dir.join("relit");
        std::fs::create_dir_all(&path).map_err(|e| Error::os(&path, &e))?;
    }
    for r in relit {
        let name = format!("relit/{}.png", flat_name(&r.name));
        let bytes = image_file::to_u8(&r.render)?;
        image_file::write_png(&dir.join(&name), r.size[0], r.size[1], 3, &bytes)?;
        names.push(name);
    }
    Ok(names)
}
