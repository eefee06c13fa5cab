//! Pictures of an object under light, by paths from the eye.
//!
//! ```text
//! per sample   pixel → ray → hit ─┬─ one light, drawn: the map by brightness or a lamp       (next-event estimation)
//!                                 └─ one direction, drawn for the BRDF → next hit, or the map
//! ```
//!
//! * Both ways of reaching the map are weighted by the balance heuristic (Veach 1997): with densities p_l (times the probability c of
//!   choosing the map among the lights) and p_b, a direction found either way counts f·cos·L/(c·p_l + p_b) of the throughput. Lamps
//!   have no extent: only their own sample finds them. Emissive triangles are found by the BRDF's directions alone.
//! * `bounces` counts the surfaces after the first that light may come by: 0 is direct light. Paths are not ended at random.
//! * Light comes and goes on the side of the face that is seen: directions that only the shading normal allows carry nothing, found either way.
//! * Nothing is clamped: a rare bright sample stays in the mean, which is unbiased. Its error falls with n^−½ where the variance is finite; the
//!   spots that remain come from smooth metals that see a small bright source after a diffuse bounce.
//! * Pixels outside the circle of a fisheye are black with alpha 0.
//! * Box filter: a sample is uniform in its pixel. With motion, time is stratified over the samples of a pixel; colour and alpha are means over
//!   the exposure. Depth, normal and material are those of the pose half-way ([`Camera::between`] at ½), so that they fit one camera.
//! * Views of one object need seeds of their own, or all have the same noise: [`rng::derive`](crate::num::rng::derive) makes them.
//! * Every random number is a function of (seed, pixel y·2³² + x, sample, vertex), so the value of a pixel depends neither on tiles, threads,
//!   nor on which other pixels are rendered.
//! * A draw is one Philox block, all four words of which are used: (x₁, x₀) choose light and texel, x₂ and x₃ place within it; x₀ the lobe,
//!   x₁ and x₂ the direction.
//!
//! # Files
//! | file | holds |
//! |------|-------|
//! | `settings`, `scene`, `passes` | what a caller gives and gets |
//! | `work`, `points`, `tracer` | what travels together: the paths of a batch, eight points that are shaded together, what all paths share |
//! | `lobes` | evaluates and draws the BRDF for eight points |
//! | `visibility` | passes rays through transparent surfaces and resolves shadow rays |
//! | `light`, `scatter` | the light sample and the BRDF sample of a vertex |
//! | `trace` | follows a batch of paths to its end |
//! | `tile` | aims the camera's rays and takes means over the samples of a pixel |
//!
//! # Rounding
//! f32. Radiance of a sample: emission and map in the order of the vertices, within a vertex light sample, then BRDF sample. A pixel is a left
//! fold over its samples, divided once.

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

/// Pixels along the side of a tile. Changes no bit.
const TILE: usize = 16;

/// Renders a view. `end` is the pose at shutter close; without it nothing moves.
///
/// # Errors
/// When a camera is not valid, or no sample is asked for.
pub fn render(
    scene: &Scene<'_>,
    camera: &Camera,
    end: Option<&Camera>,
    settings: &Settings,
) -> Result<Passes> {
    let all = Window { origin: [0, 0], size: [camera.width, camera.height] };
    render_window(scene, camera, end, settings, all)
}

/// [`render`] for a part of the picture: the same pixels, bit for bit.
///
/// # Errors
/// As [`render`], or when the window is empty or leaves the picture.
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

/// Checks what [`render_window`] is called with.
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
        let picture = format!("at least a pixel within {}×{}", camera.width, camera.height);
        return Err(Error::input("window").expected(picture).got(format!("{w}×{h} from ({x0}, {y0})")));
    }
    Ok(())
}
