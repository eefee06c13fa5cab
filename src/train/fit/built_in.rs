//! Synthetic captures with known ground truth: that of the demo, and small ones for tests.

use super::render::Scene;
use crate::io::image_file;
use crate::num::par;
use crate::scene::camera::{Camera, Model};
use crate::scene::gaussians::Gaussians;
use crate::scene::views::{SceneBox, TEST_EVERY, View, Views};
use crate::splat::render::Settings;
use crate::{Error, Result};
use data_gen::splats;

/// Colour behind the scenes.
pub const BACKGROUND: [f32; 3] = [0.0; 3];

/// The capture of the demo: 24 images of [`data_gen::splats::demo`], every eighth held out.
///
/// # Errors
/// When the scene cannot be rendered with these settings.
pub fn demo(settings: &Settings) -> Result<Views> {
    capture(&splats::demo(), settings)
}

/// A miniature of [`demo`]: every `step`-th view, with images smaller by the integer factor `shrink`.
///
/// # Errors
/// When the scene cannot be rendered with these settings.
pub fn miniature(step: usize, shrink: usize, settings: &Settings) -> Result<Views> {
    let mut scene = splats::demo();
    scene.views = scene.views.into_iter().step_by(step).collect();
    for v in &mut scene.views {
        (v.width, v.height) = (v.width / shrink, v.height / shrink);
        for k in v.intrinsics.iter_mut().take(6) {
            *k /= shrink as f64;
        }
    }
    capture(&scene, settings)
}

/// Renders 8-bit images of a scene and combines them to a capture without reconstructed points.
fn capture(scene: &splats::Scene, settings: &Settings) -> Result<Views> {
    let gaussians = stored(&scene.gaussians)?;
    let cameras: Vec<Camera> = scene.views.iter().map(camera).collect();
    let ready = Scene::new(&gaussians, settings.clone(), BACKGROUND);
    let view = |i: usize| -> Result<View> {
        let rgb = image_file::to_u8(&ready.render(&cameras[i])?.image)?;
        Ok(View { name: format!("view{i:02}.png"), camera: cameras[i].clone(), rgb, mask: None })
    };
    let views = par::map(cameras.len(), view).into_iter().collect::<Result<Vec<_>>>()?;
    let (test, train) = (0..views.len()).partition(|i| i % TEST_EVERY == 0);
    // Cameras and box of the demo scene: 4.2 from the axis, everything within 1.8 of it and below 2.
    let scene_box = SceneBox { center: [0.0, 0.0, 0.6], half_size: 1.7 };
    Ok(Views {
        views,
        train,
        test,
        extent: 4.2 * 1.1,
        scene_box,
        points: None,
        turned: Vec::new(),
        not_turned: Vec::new(),
        masked: 0,
        missing: Vec::new(),
        missing_files: Vec::new(),
    })
}

/// Rounds a record to stored parameters.
fn stored(g: &splats::Gaussians) -> Result<Gaussians> {
    let logit = |o: f64| (libm::log(o) - libm::log1p(-o)) as f32;
    let stored = Gaussians {
        means: g.means.iter().map(|m| m.map(|x| x as f32)).collect(),
        quats: g.quats.iter().map(|q| q.map(|x| x as f32)).collect(),
        scales_log: g.scales.iter().map(|s| s.map(|x| libm::log(x) as f32)).collect(),
        opacity_logits: g.opacities.iter().map(|&o| logit(o)).collect(),
        sh: g.sh.iter().map(|&c| c as f32).collect(),
        sh_degree: g.sh_degree,
    };
    stored.validate("built-in scene").map_err(|e: Error| e.hint("this is a bug in lastlight"))?;
    Ok(stored)
}

fn camera(v: &splats::View) -> Camera {
    let f = |x: &f64| *x as f32;
    let (pose, k): (Vec<f32>, Vec<f32>) =
        (v.view_from_world.iter().map(f).collect(), v.intrinsics.iter().map(f).collect());
    Camera::from_matrices(&pose, &k, v.width, v.height, Model::Pinhole)
}
