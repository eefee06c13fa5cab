//! Initial Gaussians of a fit: from points of the capture, from a file, or random in the scene box.
//!
//! Scales are √(mean of the squared distances to the three nearest neighbours), the same in all directions;
//! rotations are the identity; opacities 0.1; colours those of the points, in the band of degree 0 (3DGS
//! (Kerbl et al. 2023) code).

use super::splat::{Settings, Strategy};
use crate::io::gaussian_ply::{self, Points};
use crate::io::ply;
use crate::math::knn;
use crate::num::rng::Rng;
use crate::num::{elem, par};
use crate::scene::convert::{SceneFormat, read_scene};
use crate::scene::gaussians::Gaussians;
use crate::scene::views::{FEW_POINTS, SceneBox, Views};
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// Source of the initial Gaussians.
#[derive(Clone, Debug, PartialEq)]
pub enum Start {
    /// The points of the capture if it has at least [`FEW_POINTS`], else random.
    Auto {
        /// number if random
        count: usize,
        /// box if random
        bounds: Option<[[f32; 3]; 2]>,
    },
    /// Uniform in a box.
    Random {
        /// number of Gaussians
        count: usize,
        /// lower and upper corner; `None`: the box of the capture
        bounds: Option<[[f32; 3]; 2]>,
    },
    /// A PLY of Gaussians or of coloured points, or any other scene file.
    File(PathBuf),
}

/// Purpose of these random draws.
const PURPOSE: u16 = 0x5eed;
/// Lower limit of squared distances (3DGS).
const LEAST_SQUARED_DISTANCE: f32 = 1e-7;
/// Initial opacity.
const OPACITY: f64 = 0.1;
/// Initial opacity and factor of the scales with `mcmc`.
const MCMC: (f64, f64) = (0.5, 0.1);

/// Makes the initial Gaussians.
///
/// # Errors
/// When a file cannot be read, has too few points, or a count is out of range.
pub fn gaussians(start: &Start, views: &Views, settings: &Settings) -> Result<Gaussians> {
    let cap = |n: usize| {
        if n > settings.max_gaussians {
            return Err(Error::input("--max-gaussians")
                .expected(format!("at least the {n} initial Gaussians"))
                .got(settings.max_gaussians.to_string()));
        }
        Ok(())
    };
    let made = match start {
        Start::Auto { .. } if views.starting_points().is_some() => {
            let points = views.starting_points().expect("checked by the guard");
            cap(points.xyz.len())?;
            from_cloud(points, settings)?
        }
        Start::Auto { count, bounds } | Start::Random { count, bounds } => {
            if *count < 4 {
                return Err(Error::input("--initial")
                    .expected("at least 4 Gaussians")
                    .got(count.to_string()));
            }
            cap(*count)?;
            random(*count, bounds.unwrap_or_else(|| corners(&views.scene_box)), settings)?
        }
        Start::File(path) => from_file(path, settings)?,
    };
    cap(made.len())?;
    Ok(made)
}

fn from_file(path: &Path, settings: &Settings) -> Result<Gaussians> {
    let name = path.display().to_string();
    if SceneFormat::of(path)? == SceneFormat::Ply {
        let file = ply::read(path)?;
        let is_scene = file.element("vertex").is_some_and(|v| v.column("opacity").is_some());
        if !is_scene {
            let points = gaussian_ply::points(&file, &name)?;
            if points.xyz.len() < FEW_POINTS {
                return Err(Error::input(name)
                    .expected(format!("at least {FEW_POINTS} points"))
                    .got(points.xyz.len().to_string()));
            }
            return from_cloud(&points, settings);
        }
    }
    let mut scene = read_scene(path)?;
    if scene.is_empty() {
        return Err(Error::input(name).expected("at least one Gaussian").got("none"));
    }
    set_degree(&mut scene, settings.sh_degree);
    Ok(scene)
}

fn from_cloud(points: &Points, settings: &Settings) -> Result<Gaussians> {
    let means = points.xyz.iter().map(|p| p.map(|x| x as f32)).collect();
    let colors = points.rgb.iter().map(|c| c.map(|b| f32::from(b) / 255.0)).collect();
    from_points(means, colors, settings)
}

/// Cuts or zero-fills the SH bands.
fn set_degree(scene: &mut Gaussians, degree: usize) {
    let (have, want) = (3 * scene.sh_coefficients(), 3 * (degree + 1) * (degree + 1));
    let mut sh = vec![0.0; scene.len() * want];
    let both = have.min(want);
    for i in 0..scene.len() {
        sh[i * want..i * want + both].copy_from_slice(&scene.sh[i * have..i * have + both]);
    }
    scene.sh = sh;
    scene.sh_degree = degree;
}

/// Lower and upper corner of the cube.
fn corners(cube: &SceneBox) -> [[f32; 3]; 2] {
    let at = |sign: f64| cube.center.map(|c| (c + sign * cube.half_size) as f32);
    [at(-1.0), at(1.0)]
}

/// Uniform positions and uniform colours: three draws each.
fn random(count: usize, [lo, hi]: [[f32; 3]; 2], settings: &Settings) -> Result<Gaussians> {
    let rng = Rng::new(settings.seed);
    let draw = |i: usize, d: usize| rng.uniform_f32(i as u64, 0, PURPOSE, d as u16);
    let means = (0..count).map(|i| std::array::from_fn(|k| lo[k] + (hi[k] - lo[k]) * draw(i, k))).collect();
    let colors = (0..count).map(|i| std::array::from_fn(|k| draw(i, 3 + k))).collect();
    from_points(means, colors, settings)
}

fn from_points(means: Vec<[f32; 3]>, colors: Vec<[f32; 3]>, settings: &Settings) -> Result<Gaussians> {
    let n = means.len();
    let (opacity, factor) = if settings.strategy == Strategy::Mcmc { MCMC } else { (OPACITY, 1.0) };
    let distances = knn::mean_squared_distance(&means)?;
    let scales_log = par::map_batched(n, 1024, |i| {
        let squared =
            if distances[i] > LEAST_SQUARED_DISTANCE { distances[i] } else { LEAST_SQUARED_DISTANCE };
        [elem::ln(squared.sqrt() * factor as f32); 3]
    });
    let coefficients = (settings.sh_degree + 1) * (settings.sh_degree + 1);
    let mut sh = vec![0.0; n * coefficients * 3];
    for (i, color) in colors.iter().enumerate() {
        for k in 0..3 {
            sh[i * coefficients * 3 + k] = ((f64::from(color[k]) - 0.5) / gaussian_ply::SH_C0) as f32;
        }
    }
    let logit = (libm::log(opacity) - libm::log1p(-opacity)) as f32;
    Ok(Gaussians {
        means,
        quats: vec![[1.0, 0.0, 0.0, 0.0]; n],
        scales_log,
        opacity_logits: vec![logit; n],
        sh,
        sh_degree: settings.sh_degree,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_are_cut_or_filled() {
        let mut g = Gaussians {
            means: vec![[0.0; 3]; 2],
            sh: (0..24).map(|i| i as f32).collect(),
            sh_degree: 1,
            ..Gaussians::default()
        };
        set_degree(&mut g, 2);
        assert_eq!(
            (g.sh.len(), g.sh[11], g.sh[12], g.sh[27]),
            (54, 11.0, 0.0, 12.0),
            "rows keep their bands"
        );
        set_degree(&mut g, 0);
        assert_eq!(g.sh, vec![0.0, 1.0, 2.0, 12.0, 13.0, 14.0], "the first band is left");
    }
}
