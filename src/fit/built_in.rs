//! Photographs of the built-in scene: known Gaussians rendered from known cameras, for the demo and for tests.

use super::render::{Orbit, Scene, Shot};
use crate::num::par;
use crate::scene::gaussians::Gaussians;
use crate::scene::views::{SceneBox, TEST_EVERY, View, Views};
use crate::splat::render::Settings;
use crate::{Result, io::image_file};

/// Colour behind the built-in scene.
pub const BACKGROUND: [f32; 3] = [0.0; 3];
/// Side of a photograph in pixels.
pub const SIDE: usize = 144;
/// Circles of cameras: how many, and how far above the horizon in radians.
const CIRCLES: [(usize, f64); 3] = [(14, 0.15), (12, 0.55), (6, 1.05)];
/// Distance of the cameras from the middle.
const RADIUS: f32 = 3.6;
/// Horizontal field of view in radians.
const FOV_X_RAD: f64 = 0.75;

/// The Gaussians of the built-in scene.
pub fn gaussians() -> Gaussians {
    stored(&data_gen::splats::demo())
}

/// Photographs of the built-in scene as 8-bit pictures; every eighth is held out.
///
/// # Errors
/// When the scene or a camera is not valid.
pub fn views(settings: &Settings) -> Result<Views> {
    photographs(&gaussians(), &cameras(SIDE)?, settings)
}

/// The cameras of the built-in scene with square pictures of `side` pixels.
///
/// # Errors
/// When the side is not that of a picture.
pub fn cameras(side: usize) -> Result<Vec<Shot>> {
    let mut shots = Vec::new();
    for (circle, (count, elevation_rad)) in CIRCLES.into_iter().enumerate() {
        let orbit = Orbit {
            count,
            center: Some([0.0; 3]),
            radius: Some(RADIUS),
            elevation_rad,
            fov_x_rad: FOV_X_RAD,
            size: [side, side],
        };
        for shot in orbit.shots(&Gaussians::default())? {
            shots.push(Shot { name: format!("circle{circle}/{}.png", shot.name), ..shot });
        }
    }
    Ok(shots)
}

/// Renders 8-bit photographs of a scene and puts them together as a capture.
///
/// # Errors
/// When the scene or a camera is not valid.
pub fn photographs(scene: &Gaussians, shots: &[Shot], settings: &Settings) -> Result<Views> {
    scene.validate("built-in scene")?;
    let scene = Scene::new(scene, settings.clone(), BACKGROUND);
    let photograph = |i: usize| -> Result<View> {
        let shot = &shots[i];
        let rgb = image_file::to_u8(&scene.render(&shot.camera)?.image)?;
        Ok(View { name: shot.name.clone(), camera: shot.camera.clone(), rgb, mask: None })
    };
    let views = par::map(shots.len(), photograph).into_iter().collect::<Result<Vec<_>>>()?;
    let (test, train) = (0..views.len()).partition(|i| i % TEST_EVERY == 0);
    let scene_box = SceneBox { center: [0.0; 3], half_size: 1.3 };
    Ok(Views { views, train, test, extent: f64::from(RADIUS) * 1.1, scene_box, points: None })
}

fn stored(_x: &()) -> Gaussians {
    // temporary
    let rng = crate::num::rng::Rng::new(42);
    let n = 900;
    let u = |i: usize, d: u16| f64::from(rng.uniform_f32(i as u64, 0, 1, d));
    let mut g = Gaussians { sh_degree: 0, ..Gaussians::default() };
    for i in 0..n {
        let t = u(i, 0) * core::f64::consts::TAU;
        let kind = i % 3;
        let p = match kind {
            0 => { let z = u(i, 1) * 2.0 - 1.0; let r = (1.0 - z * z).sqrt() * 0.55; [r * libm::cos(t), r * libm::sin(t), z * 0.55 + 0.1] }
            1 => { let r = 0.95; [r * libm::cos(t), r * libm::sin(t), -0.2 + 0.15 * libm::sin(3.0 * t)] }
            _ => [u(i, 1) * 2.0 - 1.0, u(i, 2) * 2.0 - 1.0, -0.6],
        };
        g.means.push(p.map(|x| x as f32));
        g.quats.push([1.0, 0.3 * u(i, 3) as f32, 0.2, 0.1]);
        let s = if kind == 2 { [-2.4f32, -2.4, -4.5] } else { [-2.8f32, -3.0, -3.2] };
        g.scales_log.push(s);
        g.opacity_logits.push(2.0);
        let c = match kind { 0 => [0.9, 0.3 + 0.5 * u(i, 4), 0.1], 1 => [0.1, 0.4, 0.6 + 0.4 * libm::sin(5.0 * t)], _ => { let k = (((p[0] * 3.0 + 9.0) as i32 + (p[1] * 3.0 + 9.0) as i32) % 2) as f64; [0.2 + 0.6 * k, 0.25 + 0.6 * k, 0.2 + 0.5 * k] } };
        for k in c { g.sh.push(((k - 0.5) / 0.28209479177387814) as f32); }
    }
    g
}
