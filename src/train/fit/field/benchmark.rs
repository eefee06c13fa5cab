//! Scores of a field as Stanford-ORB defines them ([`crate::loss::metric::orb`]): held-out views, relighting, normals, depth, shape.
//!
//! ```text
//! view::render ──► colours ─► linear ──┐                       normals, depth of surface points
//!                                      ├─► scale per channel ─► PSNR-H, PSNR-L, SSIM-3, LPIPS or its surrogate
//! capture: radiance × exposure, or the photo decoded ──┘
//!
//! mesh::bake ──► path tracer under another map, from the capture's cameras ──► the same scores, and PSNR in the mask
//!            └─► scan::compare with the vertices of the true surface, geometry::compare with its triangles
//! ```
//!
//! The truth of an image is its radiance times its own exposure where the capture has a radiance pass; otherwise it is the photo
//! without the white behind it, decoded. Where the truth shows the light behind the object, so does the relit render.

use super::scores::{Scores, decibels};
use super::targets::{Picture, Target};
use super::view::Images;
use crate::field::render::VALID;
use crate::fit::relight::sphere;
use crate::geometry::bvh::Bvh;
use crate::geometry::compare::{self, Comparison};
use crate::geometry::scan::{self, Scan};
use crate::loss;
use crate::loss::lpips::Metric;
use crate::loss::metric::{orb, rfd};
use crate::num::{order, rng, sum};
use crate::scene::light::{Environment, Lights};
use crate::scene::mesh::{Mesh, Object};
use crate::shade::render::{Scene, Settings, render};
use crate::{Error, Result};
use serde_json::{Value, json};

/// Purpose of the samples of a relit image; the item is the image.
const PURPOSE: u16 = 0x0521;

/// The definition of the scores, in one sentence.
pub const PROTOCOL: &str = "linear values; truth = radiance times the exposure of the image, or the decoded photo; eroded mask: foreground \
    above 1/2, eroded 5x5; least-squares scale per channel inside it; PSNR-H and PSNR-L are means over the whole image and bounded below by a \
    constant foreground of 0.5; PSNR-mask is sRGB-encoded, a mean over the mask before its erosion with the scale fitted there, unbounded; \
    SSIM-3 and RFD on the encoded images, LPIPS on the images encoded twice; normals: mean of 1 - cos in the eroded mask; depth: one scale per \
    scene, squares inside the eroded mask over all pixels";

/// Scores of an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageScores {
    /// `PSNR-H` in decibels.
    pub psnr_h_db: f64,
    /// `PSNR-L` in decibels.
    pub psnr_l_db: f64,
    /// `PSNR-mask` in decibels; absent if the mask is empty.
    pub psnr_mask_db: Option<f64>,
    /// `PSNR-eroded` in decibels; absent if the eroded mask is empty.
    pub psnr_eroded_db: Option<f64>,
    /// `SSIM-3`.
    pub ssim: f64,
    /// LPIPS with the user's weights, or its surrogate RFD without them.
    pub perceptual: f64,
}

/// Name of the perceptual score.
pub fn perceptual_name(weights: Option<&Metric>) -> &'static str {
    weights.map_or(rfd::NAME, |metric| metric.names()[0])
}

/// Scores a render of linear values.
///
/// # Errors
/// When sizes differ or a value is not finite.
pub fn image(pair: &orb::In<'_>, weights: Option<&Metric>) -> Result<ImageScores> {
    let aligned = orb::aligned(pair)?;
    let [height, width] = [pair.height, pair.width];
    let perceptual = match weights {
        Some(weights) => {
            let [x, y] = aligned.encoded_twice();
            weights.score(&loss::In { x: &x, y: &y, mask: None, height, width })?
        }
        None => {
            let [x, y] = [&aligned.x, &aligned.y].map(|v| v.iter().map(|v| *v as f32).collect::<Vec<f32>>());
            rfd::forward(&loss::In { x: &x, y: &y, mask: None, height, width })?
        }
    };
    Ok(ImageScores {
        psnr_h_db: decibels(orb::psnr_h(pair)?),
        psnr_l_db: decibels(orb::psnr_l(&aligned)),
        psnr_mask_db: orb::psnr_inside(pair, false)?.map(decibels),
        psnr_eroded_db: orb::psnr_inside(pair, true)?.map(decibels),
        ssim: orb::ssim3(&aligned)?,
        perceptual,
    })
}

impl ImageScores {
    /// As a JSON record; infinite values are `null`.
    pub fn json(&self) -> Value {
        json!({
            "psnr_h_db": self.psnr_h_db, "psnr_l_db": self.psnr_l_db, "psnr_mask_db": self.psnr_mask_db,
            "psnr_eroded_db": self.psnr_eroded_db, "ssim": self.ssim, "perceptual": self.perceptual,
        })
    }

    /// Means over images, as a JSON record; `null` where an image has no finite value.
    pub fn means(all: &[Self]) -> Value {
        let of = |f: &dyn Fn(&Self) -> Option<f64>| {
            let values = all.iter().map(f).collect::<Option<Vec<f64>>>();
            values.filter(|v| !v.is_empty()).map(|v| sum::tree_f64(&v) / v.len() as f64)
        };
        json!({
            "images": all.len(),
            "psnr_h_db": of(&|s| Some(s.psnr_h_db)), "psnr_l_db": of(&|s| Some(s.psnr_l_db)),
            "psnr_mask_db": of(&|s| s.psnr_mask_db), "psnr_eroded_db": of(&|s| s.psnr_eroded_db),
            "ssim": of(&|s| Some(s.ssim)), "perceptual": of(&|s| Some(s.perceptual)),
        })
    }
}

/// The linear value of an sRGB-encoded one over white, without the white.
fn over_black(encoded: f32, coverage: f32) -> f32 {
    let behind = 1.0 - f64::from(coverage);
    orb::decode(order::clamp(f64::from(encoded) - behind, 0.0, 1.0)) as f32
}

/// The linear values that an image is scored against; `exposure` is the factor from radiance to the images of the capture.
pub fn truth(picture: &Picture, exposure: f64) -> Vec<f32> {
    match &picture.passes.radiance {
        Some(radiance) => {
            let factor = picture.passes.exposure.unwrap_or(exposure);
            radiance.as_flattened().iter().map(|x| (factor * f64::from(*x)) as f32).collect()
        }
        None => {
            let coverage = |i: usize| picture.foreground[i / 3];
            picture.color.iter().enumerate().map(|(i, x)| over_black(*x, coverage(i))).collect()
        }
    }
}

/// Scores of one view of a field.
#[derive(Clone, Debug)]
pub struct ViewScores {
    /// Colours; absent if the field has none.
    pub image: Option<ImageScores>,
    /// Error of the numerical normals.
    pub normals: Option<f64>,
    /// (H, W) depth z of the surface in units of the world, 0 where there is none.
    pub depth: Vec<f32>,
}

/// Depth z of the surface points of a view.
fn depth(images: &Images, target: &Target, scale: f64) -> Vec<f32> {
    let (forward, eye) = (target.camera.rotation[2], target.camera.center());
    let z = |i: usize| {
        let x = images.points[i];
        (0..3).fold(0.0, |s, k| s + f64::from(x[k] - eye[k]) * f64::from(forward[k]))
    };
    let seen = |i: usize| images.opacity[i] > VALID;
    (0..images.opacity.len()).map(|i| if seen(i) { (z(i) / scale) as f32 } else { 0.0 }).collect()
}

/// Scores a rendered view; `scale` is that of the field's placement.
///
/// # Errors
/// When sizes differ or a value is not finite.
pub fn view(
    scores: &Scores,
    target: &Target,
    truth: &[f32],
    scale: f64,
    weights: Option<&Metric>,
) -> Result<ViewScores> {
    let images = &scores.images;
    let (height, width) = (target.camera.height, target.camera.width);
    let image = images.color().map(|color| {
        let x: Vec<f32> =
            color.iter().enumerate().map(|(i, x)| over_black(*x, images.opacity[i / 3])).collect();
        image(&orb::In { x: &x, y: truth, foreground: &target.foreground, height, width }, weights)
    });
    let normals = match &target.normal {
        Some(n) => orb::normals(&images.normals, n.as_chunks().0, &target.foreground, [height, width])?,
        None => None,
    };
    Ok(ViewScores { image: image.transpose()?, normals, depth: depth(images, target, scale) })
}

/// Scores of the geometry that a set of views shows: mean error of normals, error of depth and its scale.
///
/// # Errors
/// When sizes differ.
pub fn geometry(views: &[(&ViewScores, &Target)], scale: f64) -> Result<Value> {
    let normals: Vec<f64> = views.iter().filter_map(|(v, _)| v.normals).collect();
    let truths: Option<Vec<Vec<f32>>> = views
        .iter()
        .map(|(_, t)| t.depth.as_ref().map(|z| z.iter().map(|z| (f64::from(*z) / scale) as f32).collect()))
        .collect();
    let depth = match &truths {
        Some(truths) => {
            let all: Vec<orb::Depth<'_>> = views
                .iter()
                .zip(truths)
                .map(|((v, t), y)| orb::Depth {
                    x: &v.depth,
                    y,
                    foreground: &t.foreground,
                    size: [t.camera.height, t.camera.width],
                })
                .collect();
            orb::depth(&all)?
        }
        None => None,
    };
    let mean = |x: &[f64]| (!x.is_empty()).then(|| sum::tree_f64(x) / x.len() as f64);
    Ok(json!({ "normals": mean(&normals), "depth": depth.map(|d| d[1]), "depth_scale": depth.map(|d| d[0]) }))
}

/// A relit image beside its truth.
#[derive(Clone, Debug)]
pub struct Relit {
    /// Name in the capture.
    pub name: String,
    /// Its scores.
    pub scores: ImageScores,
    /// Scales of the channels.
    pub scales: [f64; 3],
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// (H, W, 3) the render after the scale, sRGB-encoded.
    pub render: Vec<f32>,
    /// (H, W, 3) the truth, sRGB-encoded.
    pub truth: Vec<f32>,
}

impl Relit {
    /// As a JSON record.
    pub fn json(&self) -> Value {
        json!({ "name": self.name, "scales": self.scales, "scores": self.scores.json() })
    }
}

/// An object with its search tree, ready to be relit.
pub struct Relighting<'a> {
    object: &'a Object,
    bvh: Bvh,
    settings: Settings,
}

impl<'a> Relighting<'a> {
    /// Prepares an object; image i uses the seed that [`rng::derive`] makes of the settings' seed and i.
    pub fn new(object: &'a Object, settings: Settings) -> Self {
        Self { object, bvh: Bvh::build(&object.mesh.positions, &object.mesh.triangles), settings }
    }

    /// Renders the object under a map from the camera of an image, and scores it.
    ///
    /// # Errors
    /// When the map or the camera is not valid, or a value of the truth is not finite.
    pub fn score(
        &self,
        picture: &Picture,
        truth: &[f32],
        index: usize,
        map: &Environment,
        weights: Option<&Metric>,
    ) -> Result<Relit> {
        let lights = Lights { environment: Some(map.clone()), lamps: Vec::new() };
        let scene = Scene::new(self.object, &self.bvh, &lights)?;
        let is_behind =
            |i: usize| picture.foreground[i] == 0.0 && truth[3 * i..3 * i + 3].iter().any(|x| *x > 0.0);
        let settings = Settings {
            seed: rng::derive(self.settings.seed, index as u64, PURPOSE),
            environment_visible: (0..picture.foreground.len()).any(is_behind),
            ..self.settings
        };
        let made = render(&scene, &picture.camera, None, &settings)?;
        let [width, height] = [made.width, made.height];
        let x = made.color.as_flattened();
        let pair = orb::In { x, y: truth, foreground: &picture.foreground, height, width };
        let scores = image(&pair, weights).map_err(|e| e.within(picture.name.clone()))?;
        let scales = orb::scales(&pair, &orb::erode(&picture.foreground, [height, width]))?;
        let shown = |v: f64| orb::encode(order::clamp(v, 0.0, 1.0)) as f32;
        let scaled = |(i, x): (usize, &f32)| shown(scales[i % 3] * f64::from(*x));
        Ok(Relit {
            name: picture.name.clone(),
            scores,
            scales,
            size: [width, height],
            render: x.iter().enumerate().map(scaled).collect(),
            truth: truth.iter().map(|y| shown(f64::from(*y))).collect(),
        })
    }
}

/// Distances between the surface of a field and the true one.
#[derive(Clone, Debug)]
pub struct Shape {
    /// Squared distances to the vertices of the truth.
    pub scan: Scan,
    /// Distances between samples, and from samples to triangles.
    pub surfaces: Comparison,
    /// Bounding radius of the truth: the largest distance of a vertex from the centre of its bounds.
    pub radius: f64,
}

impl Shape {
    /// Compares a reconstruction with the true surface, both in the units of the world.
    ///
    /// # Errors
    /// When a surface has no area.
    pub fn of(reconstruction: &Mesh, truth: &Mesh, seed: u64) -> Result<Self> {
        let (_, radius) = sphere(truth);
        if !(radius > 0.0) {
            return Err(Error::input("true surface").expected("an extent").got("a single point"));
        }
        Ok(Self {
            scan: scan::compare(reconstruction, truth, scan::SAMPLES, seed)?,
            surfaces: compare::compare(reconstruction, truth, scan::SAMPLES, seed, None)?,
            radius,
        })
    }

    /// Mean distance between the surfaces, samples to triangles, in bounding radii of the truth.
    pub fn distance(&self) -> f64 {
        0.5 * (self.surfaces.a_to_b.mean + self.surfaces.b_to_a.mean) / self.radius
    }

    /// As a JSON record; lengths in units of the world, `…_radii` in bounding radii.
    pub fn json(&self) -> Value {
        let c = &self.surfaces;
        json!({
            "orb_value": self.scan.value(), "orb_table": self.scan.table(),
            "samples_to_vertices": self.scan.samples_to_vertices, "vertices_to_samples": self.scan.vertices_to_samples,
            "vertices": self.scan.vertices, "samples": scan::SAMPLES,
            "distance_radii": self.distance(), "chamfer_radii": c.chamfer_mean / self.radius,
            "field_to_truth_radii": c.a_to_b.mean / self.radius, "truth_to_field_radii": c.b_to_a.mean / self.radius,
            "largest_radii": order::max(c.a_to_b.max, c.b_to_a.max) / self.radius,
            "normal_consistency": c.normal_consistency, "radius": self.radius,
        })
    }
}
