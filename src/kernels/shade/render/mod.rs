//! Path-traced images of an object under light.
//!
//! ```text
//! per sample   pixel → ray → hit ─┬─ one light, drawn: the map by brightness or a lamp (next-event estimation)
//!                                 ├─ one point of an emissive triangle, drawn by power
//!                                 └─ one direction, drawn for the BRDF → next hit, or the map
//! ```
//!
//! * Both ways of reaching the map are combined with the balance heuristic (Veach 1997): with densities p_l
//!   (times the probability c of choosing the map among the lights) and p_b, a direction found either way
//!   contributes f·cos·L/(c·p_l + p_b) of the throughput. Emission is found in two ways as well, with the
//!   density p_e of `emitters` and c = 1. Lamps have no extent, so only their own samples find them.
//! * `bounces` is the number of surfaces after the first that light may be reflected by: 0 is direct light.
//!   There is no Russian roulette.
//! * Light is reflected only on the visible side of the face: directions that only the shading normal allows
//!   contribute nothing, whichever way they are found.
//! * Nothing is clamped: a rare bright sample stays in the mean, which is unbiased. Its error falls with n^−½
//!   if the variance is finite; the remaining bright spots come from smooth metals that reflect a small
//!   bright source after a diffuse bounce.
//! * Pixels outside the circle of a fisheye camera are black with alpha 0.
//! * The pixel filter is a box: a sample is uniform in its pixel. With motion, time is stratified over the
//!   samples of a pixel; colour and alpha are means over the exposure. Depth, normal and material are those
//!   of the pose at half time ([`Camera::between`] at ½), so that they belong to one camera.
//! * Views of one object need different seeds, or all have the same noise:
//!   [`rng::derive`](crate::num::rng::derive) creates them.
//! * Every random number is a function of (seed, pixel y·2³² + x, sample, vertex), so the value of a pixel
//!   depends neither on tiles, nor on threads, nor on which other pixels are rendered.
//! * A draw is one Philox block, all four words of which are used: for a light sample (x₁, x₀) select light
//!   and texel, x₂ and x₃ the position in it, and for a sample of an emitter the triangle and the position in
//!   it; for a BRDF sample x₀ selects the lobe, x₁ and x₂ the direction.
//!
//! # Files
//! | file | contents |
//! |------|-------|
//! | `settings`, `scene`, `passes` | inputs and outputs of the renderer |
//! | `work`, `points`, `tracer` | state: the paths of a batch, eight points that are shaded together, data shared by all paths |
//! | `lobes` | evaluation and sampling of the BRDF for eight points |
//! | `visibility` | rays through transparent surfaces, and shadow rays |
//! | `emitters` | emissive triangles: points drawn by power, and their density |
//! | `light`, `scatter` | the light samples and the BRDF sample of a vertex |
//! | `trace` | traversal of a batch of paths |
//! | `tile` | camera rays, and means over the samples of a pixel |
//!
//! # Rounding
//! All values are f32. Radiance of a sample: emission and map in the order of the vertices; within a vertex
//! the light sample, the sample of an emitter, then the BRDF sample. A pixel is a left fold over its samples, divided once.

mod emitters;
mod light;
mod lobes;
mod passes;
mod points;
mod scatter;
mod scene;
mod settings;
mod tile;
mod trace;
mod tracer;
mod visibility;
mod work;

pub use passes::{Passes, Window};
pub use scene::Scene;
pub use settings::{Brdf, MAX_BOUNCES, Settings};

use crate::num::par;
use crate::num::rng::Rng;
use crate::scene::camera::Camera;
use crate::{Error, Result};
use tile::{Job, Shutter};
use tracer::Tracer;

/// Side of a tile in pixels; it changes no bit.
const TILE: usize = 16;

/// Renders a view. `end` is the pose at shutter close; without it the camera does not move.
///
/// # Errors
/// Returns an error if a camera is not valid, or if the number of samples is 0.
pub fn render(
    scene: &Scene<'_>,
    camera: &Camera,
    end: Option<&Camera>,
    settings: &Settings,
) -> Result<Passes> {
    let all = Window { origin: [0, 0], size: [camera.width, camera.height] };
    render_window(scene, camera, end, settings, all)
}

/// Like [`render`], for a part of the image; the pixels are the same, bit for bit.
///
/// # Errors
/// Returns an error under the conditions of [`render`], or if the window is empty or extends beyond the
/// image.
pub fn render_window(
    scene: &Scene<'_>,
    camera: &Camera,
    end: Option<&Camera>,
    settings: &Settings,
    window: Window,
) -> Result<Passes> {
    validate(camera, end, settings, window)?;
    let ([x0, y0], [w, h]) = (window.origin, window.size);
    let across = w.div_ceil(TILE);
    let middle = end.map_or_else(|| camera.clone(), |end| camera.between(end, 0.5));
    let job = Job {
        tracer: Tracer { scene, settings, rng: Rng::new(settings.seed) },
        shutter: Shutter { camera, end, middle: &middle },
    };
    let tiles = par::map(across * h.div_ceil(TILE), |t| {
        let (x, y) = (t % across * TILE, t / across * TILE);
        let size = [Ord::min(TILE, w - x), Ord::min(TILE, h - y)];
        job.tile(Window { origin: [x0 + x, y0 + y], size })
    });
    let mut out = Passes::zeros(window.size);
    for (t, tile) in tiles.into_iter().enumerate() {
        let (x, y) = (t % across * TILE, t / across * TILE);
        let wide = Ord::min(TILE, w - x);
        for (k, p) in tile.iter().enumerate() {
            out.put((y + k / wide) * w + x + k % wide, p);
        }
    }
    Ok(out)
}

/// Checks the arguments of [`render_window`].
fn validate(camera: &Camera, end: Option<&Camera>, settings: &Settings, window: Window) -> Result<()> {
    camera.validate()?;
    if settings.samples == 0 {
        return Err(Error::input("setting samples").expected("at least 1").got("0"));
    }
    if settings.bounces > MAX_BOUNCES {
        let e = Error::input("setting bounces").expected(format!("at most {MAX_BOUNCES}"));
        return Err(e.got(settings.bounces.to_string()));
    }
    camera.validate_rays()?;
    if let Some(end) = end {
        end.validate().and_then(|()| end.validate_rays()).map_err(|e| e.within("shutter close"))?;
        if !camera.differs_in_pose_alone(end) {
            let e = Error::input("shutter close").expected("another pose of the same camera");
            return Err(e.got("another size, model, focal length or principal point"));
        }
    }
    let ([x0, y0], [w, h]) = (window.origin, window.size);
    let inside = |from: usize, n: usize, all: usize| n > 0 && from <= all && n <= all - from;
    if !(inside(x0, w, camera.width) && inside(y0, h, camera.height)) {
        let picture = format!("at least one pixel inside {}×{}", camera.width, camera.height);
        return Err(Error::input("window").expected(picture).got(format!("{w}×{h} from ({x0}, {y0})")));
    }
    Ok(())
}
