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
//! * Views of one object need seeds of their own, or all have the same noise: [`rng::derive`] makes them.
//! * Every random number is a function of (seed, pixel y·2³² + x, sample, vertex), so the value of a pixel depends neither on tiles, threads,
//!   nor on which other pixels are rendered.
//! * A draw is one Philox block, all four words of which are used: (x₁, x₀) choose light and texel, x₂ and x₃ place within it; x₀ the lobe,
//!   x₁ and x₂ the direction.
//!
//! # Rounding
//! f32. Radiance of a sample: emission and map in the order of the vertices, within a vertex light sample, then BRDF sample. A pixel is a left
//! fold over its samples, divided once.

use super::environment::Sky;
use super::ggx::{Facet, Point};
use super::sample;
use super::surface::{self, Surface};
use super::vector::{dot, mul, scale, select, sub, unit};
use crate::geometry::bvh::{Bvh, Hit, MISS, Ray};
use crate::num::lanes::{Real, f32x8};
use crate::num::rng::{self, Rng};
use crate::num::{order, par};
use crate::scene::camera::Camera;
use crate::scene::light::{Lamp, Lights, MAX_RADIANCE};
use crate::scene::material::Alpha;
use crate::scene::mesh::MAX_COORDINATE;
use crate::scene::mesh::Object;
use crate::{Error, Result};

/// Purposes of the draws made here (see `num::rng`).
const CAMERA: u16 = 0x0505;
const LIGHT: u16 = 0x0502;
const SCATTER: u16 = 0x0503;
const OPACITY: u16 = 0x0504;

/// Most transparent surfaces one ray passes; what lies behind them is not seen, and sheds no light.
const LAYERS: u16 = 256;
/// Most surfaces after the first: draws are told apart by 16 bits of (surface, transparent layer before it).
pub const MAX_BOUNCES: u32 = 254;
/// Pixels along the side of a tile. Changes no bit.
const TILE: usize = 16;
/// Paths traced together. Changes no bit.
const BATCH: usize = 4096;

/// How surfaces reflect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Brdf {
    /// the material's ([`super::ggx`])
    #[default]
    MetallicRoughness,
    /// albedo/π, whatever roughness and metallic say
    Lambert,
}

/// How a picture is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// per pixel
    pub samples: u32,
    /// surfaces after the first that light may come by, at most [`MAX_BOUNCES`]; 0 = direct light only
    pub bounces: u32,
    /// of the draws; each of several views takes its own
    pub seed: u64,
    /// how surfaces reflect
    pub brdf: Brdf,
    /// whether the environment is seen behind the object; else the background is black, and colour is that of the object
    /// times its coverage
    pub environment_visible: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self { samples: 64, bounces: 1, seed: 0, brdf: Brdf::default(), environment_visible: true }
    }
}

/// A picture and what is known about its pixels; (H, W) row-major.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Passes {
    /// pixels across
    pub width: usize,
    /// pixels down
    pub height: usize,
    /// linear radiance; the background is the environment, if that is visible
    pub color: Vec<[f32; 3]>,
    /// share of the samples that meet a surface
    pub alpha: Vec<f32>,
    /// depth along the optical axis of what the ray through the pixel's centre meets, 0 = nothing; of a moving camera half-way through the exposure,
    /// as everything below
    pub depth_z: Vec<f32>,
    /// unit shading normal in the world with its normal map, before it is bent into view; mean over the samples that meet a surface; 0 = none
    pub normal: Vec<[f32; 3]>,
    /// linear, mean over the samples that meet a surface
    pub albedo: Vec<[f32; 3]>,
    /// mean over the samples that meet a surface
    pub roughness: Vec<f32>,
    /// mean over the samples that meet a surface
    pub metallic: Vec<f32>,
}

/// An object, its tree, and light, checked and ready.
#[derive(Debug)]
pub struct Scene<'a> {
    object: &'a Object,
    bvh: &'a Bvh,
    lamps: &'a [Lamp],
    /// the map with its tables, if there is one
    sky: Option<Sky>,
    /// some material lets light through
    transparent: bool,
    /// some material emits
    emissive: bool,
}

impl<'a> Scene<'a> {
    /// Checks object and light and makes the tables of the map. `bvh` was built from the object's mesh.
    ///
    /// # Errors
    /// Names what is wrong.
    pub fn new(object: &'a Object, bvh: &'a Bvh, lights: &'a Lights) -> Result<Self> {
        object.validate("object")?;
        if bvh.triangles() != object.mesh.triangles.len() {
            return Err(Error::input("scene")
                .at("tree")
                .expected(format!("one over the {} triangles of the object", object.mesh.triangles.len()))
                .got(format!("one over {}", bvh.triangles())));
        }
        if let Some(map) = &lights.environment {
            map.validate("environment")?;
        }
        for (i, lamp) in lights.lamps.iter().enumerate() {
            validate(lamp).map_err(|e| e.within(format!("lamp {i}")))?;
        }
        Ok(Self {
            object,
            bvh,
            lamps: &lights.lamps,
            sky: lights.environment.as_ref().map(Sky::new),
            transparent: object.materials.iter().any(|m| m.alpha != Alpha::Opaque),
            emissive: object.materials.iter().any(|m| m.emission != [0.0; 3]),
        })
    }

    /// Number of lights one of which is drawn per vertex: the map unless black, and the lamps.
    fn lights(&self) -> usize {
        self.lamps.len() + usize::from(self.lit_by_sky())
    }

    fn lit_by_sky(&self) -> bool {
        self.sky.as_ref().is_some_and(|s| !s.is_black())
    }
}

fn validate(lamp: &Lamp) -> Result<()> {
    let (place, power) = match lamp {
        Lamp::Point { position, intensity } => (position, intensity),
        Lamp::Distant { towards, irradiance } => (towards, irradiance),
    };
    if !power.iter().all(|x| (0.0..=MAX_RADIANCE).contains(x)) {
        let e = Error::input("light").expected(format!("0 to {MAX_RADIANCE:e}"));
        return Err(e.got(format!("{power:?}")));
    }
    let fine = match lamp {
        Lamp::Point { .. } => place.iter().all(|x| x.abs() <= MAX_COORDINATE),
        Lamp::Distant { .. } => (dot(*place, *place) - 1.0).abs() <= 1e-4,
    };
    if fine {
        return Ok(());
    }
    Err(Error::input("place")
        .expected("a position within the scene's range, or a unit vector")
        .got(format!("{place:?}")))
}

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

/// A part of a picture, in pixels (x, y).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// First pixel.
    pub origin: [usize; 2],
    /// Width and height.
    pub size: [usize; 2],
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
    let across = w.div_ceil(TILE);
    let middle = end.map_or_else(|| camera.clone(), |end| camera.between(end, 0.5));
    let job = Job { scene, camera, end, middle: &middle, settings, rng: Rng::new(settings.seed) };
    let tiles = par::map(across * h.div_ceil(TILE), |t| {
        let (x, y) = (t % across * TILE, t / across * TILE);
        job.tile([x0 + x, y0 + y], [Ord::min(TILE, w - x), Ord::min(TILE, h - y)])
    });
    let mut out = Passes {
        width: w,
        height: h,
        color: vec![[0.0; 3]; w * h],
        alpha: vec![0.0; w * h],
        depth_z: vec![0.0; w * h],
        normal: vec![[0.0; 3]; w * h],
        albedo: vec![[0.0; 3]; w * h],
        roughness: vec![0.0; w * h],
        metallic: vec![0.0; w * h],
    };
    for (t, tile) in tiles.into_iter().enumerate() {
        let (x, y) = (t % across * TILE, t / across * TILE);
        let wide = Ord::min(TILE, w - x);
        for (k, p) in tile.iter().enumerate() {
            let at = (y + k / wide) * w + x + k % wide;
            out.color[at] = p.color;
            out.alpha[at] = p.alpha;
            out.depth_z[at] = p.depth_z;
            out.normal[at] = p.normal;
            out.albedo[at] = p.albedo;
            out.roughness[at] = p.roughness;
            out.metallic[at] = p.metallic;
        }
    }
    Ok(out)
}

/// Sums over the samples of a pixel, then their means.
#[derive(Clone, Copy, Debug, Default)]
struct Pixel {
    color: [f32; 3],
    alpha: f32,
    /// samples that meet a surface from the pose half-way
    met: f32,
    depth_z: f32,
    normal: [f32; 3],
    albedo: [f32; 3],
    roughness: f32,
    metallic: f32,
}

/// A path under way.
#[derive(Clone, Copy, Debug)]
struct Path {
    /// place in the batch
    slot: u32,
    /// (y·2³² + x, sample): the key of its draws
    pixel: u64,
    sample: u32,
    /// product of f·cos/p so far
    throughput: [f32; 3],
    /// density of the direction it travels in; 0 for the camera's, which no light sample rivals
    density: f32,
}

/// What a batch needs besides its paths; kept between batches.
#[derive(Debug, Default)]
struct Work {
    rays: Vec<Ray>,
    hits: Vec<Hit>,
    paths: Vec<Path>,
    next_rays: Vec<Ray>,
    next_paths: Vec<Path>,
    /// rays towards light, what arrives if they are free, and for which slot
    shadow_rays: Vec<Ray>,
    shadow_light: Vec<(u32, [f32; 3])>,
    occluded: Vec<bool>,
    /// what they meet first, where materials let light through
    shadow_hits: Vec<Hit>,
    /// (slots)
    radiance: Vec<[f32; 3]>,
    /// (slots) first surfaces
    first: Vec<First>,
    /// places in `paths` that hit
    met: Vec<u32>,
}

/// What a sample saw first.
#[derive(Clone, Copy, Debug, Default)]
struct First {
    hit: bool,
    normal: [f32; 3],
    albedo: [f32; 3],
    roughness: f32,
    metallic: f32,
}

/// Everything that stays the same for all tiles.
struct Job<'a> {
    scene: &'a Scene<'a>,
    camera: &'a Camera,
    end: Option<&'a Camera>,
    /// half-way between the two; the camera itself if it rests
    middle: &'a Camera,
    settings: &'a Settings,
    rng: Rng,
}

/// Uniform of one word: (m + ½)·2⁻²³.
#[inline(always)]
fn uniform(word: u32) -> f32 {
    rng::uniform_f32([word, 0, 0, 0])
}

impl Job<'_> {
    /// The pixels of one tile.
    fn tile(&self, origin: [usize; 2], size: [usize; 2]) -> Vec<Pixel> {
        let n = size[0] * size[1];
        let mut pixels = vec![Pixel::default(); n];
        let mut work = Work::default();
        let per_batch = Ord::max(1, BATCH / n) as u32;
        let mut from = 0;
        while from < self.settings.samples {
            let to = Ord::min(from + per_batch, self.settings.samples);
            let each = (to - from) as usize;
            self.aim(&mut work, origin, size, from..to, self.end);
            self.trace(&mut work);
            for (k, p) in pixels.iter_mut().enumerate() {
                for slot in k * each..(k + 1) * each {
                    for c in 0..3 {
                        p.color[c] += work.radiance[slot][c];
                    }
                    if work.first[slot].hit {
                        p.alpha += 1.0;
                    }
                }
            }
            if self.end.is_some() {
                self.aim(&mut work, origin, size, from..to, None);
                self.see(&mut work);
            }
            for (k, p) in pixels.iter_mut().enumerate() {
                for first in work.first[k * each..(k + 1) * each].iter().filter(|f| f.hit) {
                    p.met += 1.0;
                    for c in 0..3 {
                        p.normal[c] += first.normal[c];
                        p.albedo[c] += first.albedo[c];
                    }
                    p.roughness += first.roughness;
                    p.metallic += first.metallic;
                }
            }
            from = to;
        }
        for p in &mut pixels {
            let met = p.met;
            p.color = p.color.map(|c| c / self.settings.samples as f32);
            p.alpha /= self.settings.samples as f32;
            if met > 0.0 {
                p.normal = unit(p.normal).0;
                p.albedo = p.albedo.map(|c| c / met);
                p.roughness /= met;
                p.metallic /= met;
            }
        }
        self.depths(origin, size, &mut pixels);
        pixels
    }

    /// Depth of what the rays through the centres of a tile's pixels meet.
    fn depths(&self, origin: [usize; 2], size: [usize; 2], pixels: &mut [Pixel]) {
        let (mut rays, mut of) = (Vec::new(), Vec::new());
        for k in 0..pixels.len() {
            let at = [origin[0] + k % size[0], origin[1] + k / size[0]];
            if let Some((origin, direction)) = self.middle.ray(at.map(|x| x as f32 + 0.5)) {
                rays.push(Ray { origin, direction, t_max: f32::INFINITY });
                of.push(k);
            }
        }
        let mut hits = vec![Hit::NONE; rays.len()];
        self.scene.bvh.closest_batch(&rays, &mut hits);
        for ((ray, hit), k) in rays.iter_mut().zip(&mut hits).zip(of) {
            for _ in 0..LAYERS {
                let there = self.scene.transparent && hit.triangle != MISS;
                if !there || surface::transmittance(self.scene.object, hit) <= 0.5 {
                    break;
                }
                ray.origin = surface::beyond(self.scene.object, hit, ray.direction);
                *hit = self.scene.bvh.closest(ray);
            }
            if hit.triangle != MISS {
                let p = surface::position(self.scene.object, hit);
                pixels[k].depth_z = dot(self.middle.rotation[2], p) + self.middle.translation[2];
            }
        }
    }

    /// Starts the paths of some samples of a tile: pixel by pixel, samples ascending. Without `end` the camera rests half-way.
    fn aim(
        &self,
        work: &mut Work,
        origin: [usize; 2],
        size: [usize; 2],
        samples: std::ops::Range<u32>,
        end: Option<&Camera>,
    ) {
        let slots = size[0] * size[1] * samples.len();
        work.rays.clear();
        work.paths.clear();
        work.radiance.clear();
        work.radiance.resize(slots, [0.0; 3]);
        work.first.clear();
        work.first.resize(slots, First::default());
        let mut slot = 0;
        for y in origin[1]..origin[1] + size[1] {
            for x in origin[0]..origin[0] + size[0] {
                let pixel = (y as u64) << 32 | x as u64;
                for sample in samples.clone() {
                    let word = self.rng.block(pixel, sample, CAMERA, 0);
                    let px = [x as f32 + uniform(word[0]), y as f32 + uniform(word[1])];
                    let ray = match end {
                        None => self.middle.ray(px),
                        Some(end) => {
                            let time = (sample as f32 + uniform(word[2])) / self.settings.samples as f32;
                            self.camera.between(end, time).ray(px)
                        }
                    };
                    if let Some((origin, direction)) = ray {
                        work.rays.push(Ray { origin, direction, t_max: f32::INFINITY });
                        work.paths.push(Path { slot, pixel, sample, throughput: [1.0; 3], density: 0.0 });
                    }
                    slot += 1;
                }
            }
        }
    }

    /// What the paths of a batch meet first; no light.
    fn see(&self, work: &mut Work) {
        self.meet(work, 0);
        for eight in work.met.chunks(8) {
            let at: [usize; 8] = std::array::from_fn(|l| eight[Ord::min(l, eight.len() - 1)] as usize);
            let view = std::array::from_fn(|c| f32x8::from_fn(|l| -work.rays[at[l]].direction[c]));
            let s = surface::eight(self.scene.object, &at.map(|k| work.hits[k]), view);
            first(&s, eight.len(), &at.map(|k| work.paths[k]), &mut work.first);
        }
    }

    /// Follows the paths of a batch to their ends.
    fn trace(&self, work: &mut Work) {
        let scene = self.scene;
        for vertex in 0..=self.settings.bounces {
            if work.rays.is_empty() {
                return;
            }
            self.meet(work, vertex);
            work.shadow_rays.clear();
            work.shadow_light.clear();
            work.next_rays.clear();
            work.next_paths.clear();
            let met = std::mem::take(&mut work.met);
            for eight in met.chunks(8) {
                match self.settings.brdf {
                    Brdf::MetallicRoughness => self.shade::<false>(work, eight, vertex),
                    Brdf::Lambert => self.shade::<true>(work, eight, vertex),
                }
            }
            work.met = met;
            self.light(work);
            std::mem::swap(&mut work.rays, &mut work.next_rays);
            std::mem::swap(&mut work.paths, &mut work.next_paths);
        }
        // what the last directions see: emission, and the map behind it
        if scene.emissive && !work.rays.is_empty() {
            let vertex = self.settings.bounces + 1;
            self.meet(work, vertex);
            for &k in &work.met {
                let path = &work.paths[k as usize];
                let emission = surface::emission(scene.object, &work.hits[k as usize]);
                let out = &mut work.radiance[path.slot as usize];
                for c in 0..3 {
                    out[c] += path.throughput[c] * emission[c];
                }
            }
        }
    }

    /// Nearest hits of the paths; those that leave the scene collect the map. Places of the others go to `met`.
    fn meet(&self, work: &mut Work, vertex: u32) {
        let scene = self.scene;
        work.hits.clear();
        work.hits.resize(work.rays.len(), Hit::NONE);
        scene.bvh.closest_batch(&work.rays, &mut work.hits);
        if scene.transparent {
            for k in 0..work.rays.len() {
                self.pass_through(&mut work.rays[k], &mut work.hits[k], &work.paths[k], vertex);
            }
        }
        work.met.clear();
        let mut missed = [0_u32; 8];
        let mut waiting = 0;
        for (k, hit) in work.hits.iter().enumerate() {
            if hit.triangle != MISS {
                work.met.push(k as u32);
            } else if scene.sky.is_some() && (vertex > 0 || self.settings.environment_visible) {
                missed[waiting] = k as u32;
                waiting += 1;
                if waiting == 8 {
                    self.escape(&missed, &work.rays, &work.paths, &mut work.radiance);
                    waiting = 0;
                }
            }
        }
        if waiting > 0 {
            self.escape(&missed[..waiting], &work.rays, &work.paths, &mut work.radiance);
        }
    }

    /// Adds the map to paths that leave the scene.
    fn escape(&self, which: &[u32], rays: &[Ray], paths: &[Path], radiance: &mut [[f32; 3]]) {
        let Some(sky) = &self.scene.sky else { return };
        let at = |l: usize| which[Ord::min(l, which.len() - 1)] as usize;
        let towards = std::array::from_fn(|c| f32x8::from_fn(|l| rays[at(l)].direction[c]));
        let (color, density) = sky.look8(towards, (1 << which.len()) - 1);
        let share = f32x8::splat(1.0 / Ord::max(self.scene.lights(), 1) as f32);
        let own = f32x8::from_fn(|l| paths[at(l)].density);
        let zero = f32x8::splat(0.0);
        let found = Real::gt(own, zero);
        let rival = own + share * density;
        let weight =
            Real::select(found, own / Real::select(found, rival, f32x8::splat(1.0)), f32x8::splat(1.0));
        let (color, weight) = (color.map(f32x8::to_array), weight.to_array());
        for (l, &k) in which.iter().enumerate() {
            let path = &paths[k as usize];
            let out = &mut radiance[path.slot as usize];
            for c in 0..3 {
                out[c] += path.throughput[c] * (weight[l] * color[c][l]);
            }
        }
    }

    /// Moves a ray on through surfaces that are not there for it.
    fn pass_through(&self, ray: &mut Ray, hit: &mut Hit, path: &Path, vertex: u32) {
        for layer in 0..LAYERS {
            if hit.triangle == MISS {
                return;
            }
            let open = surface::transmittance(self.scene.object, hit);
            if open <= 0.0 {
                return;
            }
            if open < 1.0 {
                let draw = vertex as u16 * LAYERS + layer; // at most 255·256 + 255
                let word = self.rng.block(path.pixel, path.sample, OPACITY, draw);
                if uniform(word[0]) >= open {
                    return;
                }
            }
            ray.origin = surface::beyond(self.scene.object, hit, ray.direction);
            *hit = self.scene.bvh.closest(ray);
        }
    }

    /// Adds the light of shadow rays that are free.
    fn light(&self, work: &mut Work) {
        if self.scene.transparent {
            work.shadow_hits.clear();
            work.shadow_hits.resize(work.shadow_rays.len(), Hit::NONE);
            self.scene.bvh.closest_batch(&work.shadow_rays, &mut work.shadow_hits);
            let rays = work.shadow_rays.iter().zip(&work.shadow_hits);
            for ((ray, hit), (slot, light)) in rays.zip(&work.shadow_light) {
                let open = self.open(*ray, *hit);
                for c in 0..3 {
                    work.radiance[*slot as usize][c] += open * light[c];
                }
            }
            return;
        }
        work.occluded.clear();
        work.occluded.resize(work.shadow_rays.len(), false);
        self.scene.bvh.occluded_batch(&work.shadow_rays, &mut work.occluded);
        for ((slot, light), occluded) in work.shadow_light.iter().zip(&work.occluded) {
            if !occluded {
                for c in 0..3 {
                    work.radiance[*slot as usize][c] += light[c];
                }
            }
        }
    }

    /// Share of light that arrives through transparent surfaces: the product of their transmittances. `hit` is the first of them.
    fn open(&self, mut ray: Ray, mut hit: Hit) -> f32 {
        let mut open = 1.0;
        for _ in 0..LAYERS {
            if hit.triangle == MISS {
                return open;
            }
            open *= surface::transmittance(self.scene.object, &hit);
            if open <= 0.0 {
                return 0.0;
            }
            ray.origin = surface::beyond(self.scene.object, &hit, ray.direction);
            ray.t_max -= hit.t;
            hit = self.scene.bvh.closest(&ray);
        }
        if hit.triangle == MISS { open } else { 0.0 }
    }

    /// Shades up to eight hits: emission, a light sample, a BRDF sample.
    #[inline(never)]
    fn shade<const LAMBERT: bool>(&self, work: &mut Work, eight: &[u32], vertex: u32) {
        let scene = self.scene;
        let at: [usize; 8] = std::array::from_fn(|l| eight[Ord::min(l, eight.len() - 1)] as usize);
        let paths: [Path; 8] = at.map(|k| work.paths[k]);
        let hits: [Hit; 8] = at.map(|k| work.hits[k]);
        let view: [f32x8; 3] = std::array::from_fn(|c| f32x8::from_fn(|l| -work.rays[at[l]].direction[c]));
        let s = surface::eight(scene.object, &hits, view);
        let through: [f32x8; 3] = std::array::from_fn(|c| f32x8::from_fn(|l| paths[l].throughput[c]));
        if vertex == 0 {
            first(&s, eight.len(), &paths, &mut work.first);
        }
        if scene.emissive {
            let glow = mul(through, s.emission).map(f32x8::to_array);
            for l in 0..eight.len() {
                let out = &mut work.radiance[paths[l].slot as usize];
                for c in 0..3 {
                    out[c] += glow[c][l];
                }
            }
        }
        let lobes = Lobes::<LAMBERT>::new(&s, view);
        let lights = scene.lights();
        let sky_lit = scene.lit_by_sky();
        let choice = f32x8::splat(1.0 / Ord::max(lights, 1) as f32);
        if lights > 0 {
            let words: [[u32; 4]; 8] = std::array::from_fn(|l| {
                self.rng.block(paths[l].pixel, paths[l].sample, LIGHT, vertex as u16)
            });
            self.light_sample(work, eight.len(), &paths, &s, &lobes, through, &words);
        }
        // the BRDF's own direction
        let last = vertex == self.settings.bounces;
        if last && !sky_lit && !scene.emissive {
            return;
        }
        let words: [[u32; 4]; 8] =
            std::array::from_fn(|l| self.rng.block(paths[l].pixel, paths[l].sample, SCATTER, vertex as u16));
        let u: [f32x8; 3] = std::array::from_fn(|k| f32x8::from_fn(|l| uniform(words[l][k])));
        let towards = lobes.direction(u);
        let (f_cos, density) = lobes.eval(towards);
        let zero = f32x8::splat(0.0);
        let goes = f32x8::bits(f32x8::and(Real::gt(density, zero), s.before(towards)));
        let start = s.start().map(f32x8::to_array);
        let ways = towards.map(f32x8::to_array);
        if last && !scene.emissive {
            // only whether the map is seen
            let Some(sky) = &scene.sky else { return };
            let (color, rival) = sky.look8(towards, goes);
            let total = density + choice * rival;
            let safe = Real::select(Real::gt(total, zero), total, f32x8::splat(1.0));
            let light = mul(mul(through, f_cos), color).map(|x| (x / safe).to_array());
            for l in (0..eight.len()).filter(|l| goes >> l & 1 == 1) {
                let ray = Ray { origin: pick(&start, l), direction: pick(&ways, l), t_max: f32::INFINITY };
                push_shadow(work, ray, paths[l].slot, pick(&light, l));
            }
            return;
        }
        let safe = Real::select(Real::gt(density, zero), density, f32x8::splat(1.0));
        let next = mul(through, f_cos).map(|x| (x / safe).to_array());
        let density = density.to_array();
        for l in (0..eight.len()).filter(|l| goes >> l & 1 == 1) {
            let throughput = pick(&next, l);
            if throughput == [0.0; 3] {
                continue;
            }
            work.next_rays.push(Ray {
                origin: pick(&start, l),
                direction: pick(&ways, l),
                t_max: f32::INFINITY,
            });
            work.next_paths.push(Path { throughput, density: density[l], ..paths[l] });
        }
    }

    /// One light per point, drawn uniformly; the map counts as one.
    #[inline(always)]
    fn light_sample<const LAMBERT: bool>(
        &self,
        work: &mut Work,
        n: usize,
        paths: &[Path; 8],
        s: &Surface,
        lobes: &Lobes<LAMBERT>,
        through: [f32x8; 3],
        words: &[[u32; 4]; 8],
    ) {
        let scene = self.scene;
        let lights = scene.lights();
        let zero = f32x8::splat(0.0);
        // the upper part of word·lights is the light, the lower part is uniform again and chooses the texel
        let (mut chosen, mut rest) = ([0_usize; 8], [0_u64; 8]);
        for l in 0..8 {
            let word = u64::from(words[l][1]) << 32 | u64::from(words[l][0]);
            let wide = u128::from(word) * lights as u128;
            (chosen[l], rest[l]) = ((wide >> 64) as usize, wide as u64);
        }
        let lamp = |l: usize| scene.lamps.get(chosen[l]);
        let mut towards = [zero; 3];
        let mut light = [zero; 3]; // radiance over density, or irradiance
        let mut own = zero; // density of the map's direction times its share; 0 for lamps
        let mut rival = zero; // 1 where the BRDF's directions compete
        let mut reach = [f32::INFINITY; 8];
        if scene.lit_by_sky()
            && let Some(sky) = &scene.sky
        {
            let u2: [f32; 8] = std::array::from_fn(|l| uniform(words[l][2]));
            let u3: [f32; 8] = std::array::from_fn(|l| uniform(words[l][3]));
            if let Some((d, density)) = sky.draw8(&rest, [&u2, &u3]) {
                towards = d;
                own = density * f32x8::splat(1.0 / lights as f32);
                rival = f32x8::splat(1.0);
            }
        }
        if (0..n).any(|l| lamp(l).is_some()) {
            let mut t = towards.map(f32x8::to_array);
            let mut e = light.map(f32x8::to_array);
            let (mut o, mut r) = (own.to_array(), rival.to_array());
            let p = s.position.map(f32x8::to_array);
            for l in 0..n {
                let Some(lamp) = lamp(l) else { continue };
                let (way, irradiance, distance) = shine(lamp, pick(&p, l));
                for c in 0..3 {
                    t[c][l] = way[c];
                    e[c][l] = irradiance[c] * lights as f32;
                }
                (o[l], r[l], reach[l]) = (1.0, 0.0, distance);
            }
            (towards, light) = (t.map(f32x8::new), e.map(f32x8::new));
            (own, rival) = (f32x8::new(o), f32x8::new(r));
        }
        let (f_cos, density) = lobes.eval(towards);
        let total = own + rival * density;
        let on = f32x8::and(f32x8::and(Real::gt(total, zero), Real::gt(density, zero)), s.before(towards));
        if let Some(sky) = &scene.sky {
            // only where the surface faces the map's direction is its radiance worth a look
            let of_sky = Real::gt(rival, zero);
            let radiance = sky.look8(towards, f32x8::bits(f32x8::and(on, of_sky))).0;
            light = select(of_sky, radiance, light);
        }
        let safe = Real::select(on, total, f32x8::splat(1.0));
        let light = mul(mul(through, f_cos), light).map(|x| (x / safe).to_array());
        let start = s.start().map(f32x8::to_array);
        let ways = towards.map(f32x8::to_array);
        let goes = f32x8::bits(on);
        for l in (0..n).filter(|l| goes >> l & 1 == 1) {
            let light = pick(&light, l);
            if light != [0.0; 3] {
                let ray = Ray { origin: pick(&start, l), direction: pick(&ways, l), t_max: reach[l] };
                push_shadow(work, ray, paths[l].slot, light);
            }
        }
    }
}

/// Direction to a lamp, irradiance on a surface that faces it, distance.
fn shine(lamp: &Lamp, from: [f32; 3]) -> ([f32; 3], [f32; 3], f32) {
    match lamp {
        Lamp::Distant { towards, irradiance } => (*towards, *irradiance, f32::INFINITY),
        Lamp::Point { position, intensity } => {
            let (way, distance) = unit(sub(*position, from));
            let square = distance * distance;
            // nearer than f32 can tell it would be infinite
            let each = |x: f32| order::min(x / square, MAX_RADIANCE);
            let irradiance = if square > 0.0 { intensity.map(each) } else { [0.0; 3] };
            (way, irradiance, distance)
        }
    }
}

/// Keeps what samples saw first.
fn first(s: &Surface, n: usize, paths: &[Path; 8], into: &mut [First]) {
    let (normal, albedo) = (s.mapped.map(f32x8::to_array), s.material.albedo.map(f32x8::to_array));
    let (roughness, metallic) = (s.material.roughness.to_array(), s.material.metallic.to_array());
    for l in 0..n {
        into[paths[l].slot as usize] = First {
            hit: true,
            normal: pick(&normal, l),
            albedo: pick(&albedo, l),
            roughness: roughness[l],
            metallic: metallic[l],
        };
    }
}

/// Lane `l` of three.
#[inline(always)]
fn pick(x: &[[f32; 8]; 3], l: usize) -> [f32; 3] {
    [x[0][l], x[1][l], x[2][l]]
}

#[inline(always)]
fn push_shadow(work: &mut Work, ray: Ray, slot: u32, light: [f32; 3]) {
    work.shadow_rays.push(ray);
    work.shadow_light.push((slot, light));
}

/// How eight points reflect.
struct Lobes<const LAMBERT: bool> {
    point: Point<f32x8>,
    share: f32x8,
}

impl<const LAMBERT: bool> Lobes<LAMBERT> {
    #[inline(always)]
    fn new(s: &Surface, view: [f32x8; 3]) -> Self {
        let mut point = Point::new(s.normal, view, &s.material);
        if LAMBERT {
            point.diffuse = scale(s.material.albedo, f32x8::splat(std::f32::consts::FRAC_1_PI));
            return Self { point, share: f32x8::splat(0.0) };
        }
        let share = sample::specular_share(&point);
        Self { point, share }
    }

    #[inline(always)]
    fn direction(&self, [lobe, u, v]: [f32x8; 3]) -> [f32x8; 3] {
        if LAMBERT {
            return sample::diffuse(self.point.normal, [u, v]);
        }
        sample::direction(&self.point, self.share, lobe, [u, v])
    }

    /// f·cos and density; zeros where nothing is reflected.
    #[inline(always)]
    fn eval(&self, towards: [f32x8; 3]) -> ([f32x8; 3], f32x8) {
        let zero = f32x8::splat(0.0);
        if LAMBERT {
            let nl = Real::max(dot(self.point.normal, towards), zero);
            return (scale(self.point.diffuse, nl), nl * f32x8::splat(std::f32::consts::FRAC_1_PI));
        }
        let facet: Facet<f32x8> = self.point.facet(towards);
        let nl = Real::max(facet.nl, zero);
        (scale(self.point.brdf(&facet), nl), sample::density(&self.point, &facet, self.share))
    }
}
