//! Images of a field beside held-out images: colours, normals, depth.

use super::targets::Target;
use super::view::{self, Images};
use crate::Result;
use crate::field::occupancy::Occupancy;
use crate::field::render::VALID;
use crate::fit::evaluate::{self, Scored};
use crate::loss::metric::orb;
use crate::loss::metric::psnr::Decibel;
use crate::num::elem::f64 as elem;
use crate::num::{order, sum};
use crate::scene::field::Field;
use serde_json::{Value, json};

/// Fewest pixels of an image that are scored by themselves.
pub const FEWEST: usize = 20;

/// Scores of one view.
#[derive(Clone, Debug)]
pub struct Scores {
    /// Colours.
    pub image: Scored,
    /// The images of the field.
    pub images: Images,
    /// Mean angle between numerical normals and those of the pass, in degrees.
    pub numerical_deg: Option<f64>,
    /// Mean angle between the normal head and the pass, in degrees.
    pub head_deg: Option<f64>,
    /// Mean absolute difference of depth z, in units of the world.
    pub depth: Option<f64>,
    /// Errors of materials.
    pub materials: MaterialErrors,
}

/// Errors of materials on the pixels that the object covers completely and where the field is opaque (opacity above [`VALID`], as for normals and depth: elsewhere the composited values are
/// partly those of the background), except for [`Self::albedo_orb_db`].
#[derive(Clone, Copy, Debug, Default)]
pub struct MaterialErrors {
    /// PSNR of the sRGB-encoded albedo as it is, in decibels.
    pub albedo_db: Option<f64>,
    /// The same after the least-squares scale of each channel of the linear values (`PSNR-mask` of
    /// [`crate::loss::metric::orb`]): light and albedo share a scale, which images alone do not determine.
    /// `None` with fewer than [`FEWEST`] pixels: the scales fit a single one exactly.
    pub albedo_aligned_db: Option<f64>,
    /// Root mean square error of the linear albedo, after one least-squares factor for all channels: it tells a
    /// hue from another, and is bounded, where [`Self::albedo_aligned_db`] of an object of one colour is not.
    /// `None` with fewer than [`FEWEST`] pixels.
    pub albedo_error: Option<f64>,
    /// `PSNR-A` of [`crate::loss::metric::orb`]: linear values over the whole image, after the same scale.
    pub albedo_orb_db: Option<f64>,
    /// Mean absolute error of roughness.
    pub roughness: Option<f64>,
    /// Mean absolute error of metallic.
    pub metallic: Option<f64>,
}

/// Mean over the entries that there are.
fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| sum::tree_f64(values) / values.len() as f64)
}

fn angle_deg(a: [f32; 3], b: [f32; 3]) -> f64 {
    let dot = (0..3).fold(0.0, |sum, k| sum + f64::from(a[k]) * f64::from(b[k]));
    let length = |v: [f32; 3]| (0..3).fold(0.0, |sum, k| sum + f64::from(v[k]) * f64::from(v[k])).sqrt();
    let cosine = dot / order::max(length(a) * length(b), f64::MIN_POSITIVE);
    elem::acos(order::clamp(cosine, -1.0, 1.0)).to_degrees()
}

/// Number of decibels; +∞ if no value differs.
pub(super) fn decibels(x: Decibel) -> f64 {
    x.finite().unwrap_or(f64::INFINITY)
}

/// The root mean square of s·x − y over some pixels of linear colours (H, W, 3), with the s ≥ 0 that makes it
/// least; 0 without pixels.
fn after_one_factor(x: &[f32], y: &[f32], pixels: &[usize]) -> f64 {
    let pairs = || {
        let values = pixels.iter().flat_map(|i| 3 * i..3 * i + 3);
        values.map(|i| (f64::from(x[i]), f64::from(y[i])))
    };
    let [xx, xy] = pairs().fold([0.0; 2], |[xx, xy], (x, y)| [xx + x * x, xy + x * y]);
    let s = if xx > 0.0 { xy / xx } else { 0.0 };
    let squares: Vec<f64> = pairs().map(|(x, y)| (s * x - y) * (s * x - y)).collect();
    mean(&squares).unwrap_or_default().sqrt()
}

/// Compares the materials of a view with its passes: albedo (H, W, 3), roughness and metallic (H, W, 2), where the opacity (H, W) is above [`VALID`].
///
/// # Errors
/// When a value is not finite.
pub fn materials(
    albedo: Option<&[f32]>,
    material: Option<&[f32]>,
    opacity: &[f32],
    target: &Target,
) -> Result<MaterialErrors> {
    let counts = |i: usize| target.foreground[i] == 1.0 && opacity[i] > VALID;
    let inside: Vec<usize> = (0..target.foreground.len()).filter(|i| counts(*i)).collect();
    let mut out = MaterialErrors::default();
    if let Some((ours, truth)) = albedo.zip(target.albedo.as_ref()) {
        let squares: Vec<f64> = inside
            .iter()
            .flat_map(|i| 3 * i..3 * i + 3)
            .map(|i| {
                let d = f64::from(ours[i]) - f64::from(truth[i]);
                d * d
            })
            .collect();
        out.albedo_db = mean(&squares).map(|m| -10.0 * elem::log10(order::max(m, 1e-12)));
        let linear = |image: &[f32]| -> Vec<f32> {
            image.iter().map(|x| orb::decode(order::clamp(f64::from(*x), 0.0, 1.0)) as f32).collect()
        };
        let covered: Vec<f32> =
            (0..target.foreground.len()).map(|i| f32::from(u8::from(counts(i)))).collect();
        let (x, y) = (linear(ours), linear(truth));
        out.albedo_error = Some(after_one_factor(&x, &y, &inside)).filter(|_| inside.len() >= FEWEST);
        let (height, width) = (target.camera.height, target.camera.width);
        let pair = orb::In { x: &x, y: &y, foreground: &covered, height, width };
        out.albedo_aligned_db =
            orb::psnr_inside(&pair, false)?.filter(|_| inside.len() >= FEWEST).map(decibels);
        let pair = orb::In { foreground: &target.foreground, ..pair };
        out.albedo_orb_db = Some(decibels(orb::psnr_albedo(&pair)?));
    }
    if let Some((ours, truth)) = material.zip(target.material.as_ref()) {
        let error = |k: usize| {
            let off = |i: &usize| (f64::from(ours[2 * i + k]) - f64::from(truth[2 * i + k])).abs();
            mean(&inside.iter().map(off).collect::<Vec<f64>>())
        };
        (out.roughness, out.metallic) = (error(0), error(1));
    }
    Ok(out)
}

/// Renders a view of a field and compares it.
///
/// # Errors
/// When no pixel counts, or a value is not finite.
pub fn score(field: &Field, cells: &Occupancy, target: &Target) -> Result<Scores> {
    let images = view::render(field, Some(cells), &target.camera, true);
    let size = [target.camera.height, target.camera.width];
    let color = images.color().unwrap_or_default();
    let image = evaluate::compare(&target.name, &color, &target.color, target.colored.as_deref(), size)?;
    let pixels = target.foreground.len();
    let solid: Vec<usize> =
        (0..pixels).filter(|i| target.solid[*i] == 1.0 && images.opacity[*i] > VALID).collect();
    let truth = |i: usize| -> Option<[f32; 3]> {
        target.normal.as_ref().map(|n| std::array::from_fn(|k| n[3 * i + k]))
    };
    let against = |n: &dyn Fn(usize) -> [f32; 3]| {
        mean(&solid.iter().filter_map(|i| Some(angle_deg(n(*i), truth(*i)?))).collect::<Vec<f64>>())
    };
    let head = images
        .channels
        .normal
        .and_then(|at| against(&|i| std::array::from_fn(|k| images.values[i * images.count + at + k])));
    let scale = field.placement.scale;
    let forward = target.camera.rotation[2];
    let eye = target.camera.center();
    let depth = target.depth.as_ref().and_then(|z| {
        let of = |i: usize| {
            let x = images.points[i];
            (0..3).fold(0.0, |s, k| s + f64::from(x[k] - eye[k]) * f64::from(forward[k]))
        };
        let there = (0..pixels).filter(|i| z[*i] > 0.0 && images.opacity[*i] > VALID);
        mean(&there.map(|i| (of(i) - f64::from(z[i])).abs() / scale).collect::<Vec<f64>>())
    });
    let albedo = images.channels.albedo.map(|at| images.values_from(at, 3));
    let material = images.channels.material.map(|at| images.values_from(at, 2));
    let materials = materials(albedo.as_deref(), material.as_deref(), &images.opacity, target)?;
    Ok(Scores {
        numerical_deg: against(&|i| images.normals[i]),
        head_deg: head,
        depth,
        materials,
        image,
        images,
    })
}

impl Scores {
    /// As a JSON record.
    pub fn json(&self) -> Value {
        let (s, m) = (&self.image.score, &self.materials);
        json!({
            "name": s.name, "psnr_db": s.psnr_db, "ssim": s.ssim, "mae": s.mae,
            "numerical_normals_deg": self.numerical_deg, "normal_head_deg": self.head_deg,
            "depth": self.depth, "albedo_db": m.albedo_db, "albedo_aligned_db": m.albedo_aligned_db, "albedo_error": m.albedo_error, "albedo_orb_db": m.albedo_orb_db,
            "roughness": m.roughness, "metallic": m.metallic,
        })
    }
}

/// Means over views of the numbers that all of them have.
pub fn means(all: &[Scores]) -> Value {
    let of = |f: &dyn Fn(&Scores) -> Option<f64>| {
        all.iter().map(f).collect::<Option<Vec<f64>>>().and_then(|values| mean(&values))
    };
    json!({
        "views": all.len(),
        "psnr_db": of(&|s| Some(s.image.score.psnr_db)),
        "ssim": of(&|s| Some(s.image.score.ssim)),
        "mae": of(&|s| Some(s.image.score.mae)),
        "numerical_normals_deg": of(&|s| s.numerical_deg),
        "normal_head_deg": of(&|s| s.head_deg),
        "depth": of(&|s| s.depth),
        "albedo_db": of(&|s| s.materials.albedo_db),
        "albedo_aligned_db": of(&|s| s.materials.albedo_aligned_db),
        "albedo_error": of(&|s| s.materials.albedo_error),
        "albedo_orb_db": of(&|s| s.materials.albedo_orb_db),
        "roughness": of(&|s| s.materials.roughness),
        "metallic": of(&|s| s.materials.metallic),
        "samples": all.iter().fold(0, |sum, s| sum + s.images.samples),
    })
}
