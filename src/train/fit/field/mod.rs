//! One object as a field, fitted to posed images (`field fit`).
//!
//! ```text
//! settings    settings that decide the result        schedule    resolution, samples, 1/β, rates of an iteration
//! targets     images with cameras in the units of the field, foreground, passes
//! place       the box of the object: its centre, and a half size from the foreground
//! state       planes, panoramas, heads, light: first values, growth between stages, Adam
//! scene       a stored field as the inputs of the operators
//!
//! one iteration
//!   crops     which pixels                            occupied    cells that rays step in, refilled every few iterations
//!   scene ──► field.render ──► losses ──► cotangents of values and opacity      (on whole crops)
//!                 │            shaded ──► those of materials, and the light's gradient
//!                 │            surface ─► gradients of the signed distance's network and planes, from points at the surface
//!                 │            normals    the comparison of numerical normals with a pass
//!                 └──────────► adjoint of field.render, some rays at a time     (deferred back-propagation)
//!   state     one step of Adam
//!
//! afterwards
//!   view      whole images of a field                 scores      their comparison with held-out images
//!   mesh      the surface with baked textures         benchmark scores as Stanford-ORB defines them, relighting
//!             (none of them needs a fit, only a field)
//! ```
//!
//! # What is optimised
//! Planes, panoramas and heads, from the losses of LIRM (`losses`) and three terms in place of the prior which a fit of one
//! object does not have: the eikonal term on numerical gradients near the surface (without weight by default), the squared variation of the planes, and the squared
//! jump of the signed distance across the centre planes. They have weights in [`Settings`], and 0 removes them.
//!
//! # Three stages
//! Planes grow from a quarter of their side to a half and to the whole (bilinear, at the same places), the samples of a
//! ray with them; 1/β grows linearly. The moments of Adam start again at each growth. The state between iterations is
//! that of a checkpoint, and every draw is a function of seed and iteration: a resumed fit has the same bits.

mod adding;
pub mod benchmark;
pub mod crops;
pub mod losses;
pub mod mesh;
pub mod normals;
pub mod occupied;
pub mod place;
pub mod scene;
mod schedule;
pub mod scores;
mod settings;
pub mod shaded;
mod state;
pub mod surface;
pub mod targets;
pub mod view;

pub use scores::{Scores, score};
pub use settings::{Beta, HeadForm, Materials, Settings};
pub use state::HALF_SIZE;
pub use targets::{Target, Targets};

use self::crops::Crop;
use self::state::State;
use super::training::{Fit, Preview, Step, Watch};
use crate::field::render::{self, InBar, OutBar, Plan};
use crate::loss::{self, lpips::Metric};
use crate::num::array::Arrays;
use crate::num::bits::Digest;
use crate::scene::field::Field;
use crate::{Error, Result};
use serde_json::Value;

/// A fit in progress.
#[derive(Debug)]
pub struct FieldFit<'a> {
    settings: Settings,
    targets: &'a Targets,
    lpips: Option<&'a Metric>,
    /// The known light, 16×32, in the units of the images; `None` where it is learned or not used.
    light: Option<Vec<[f32; 3]>>,
    /// Digest of the images and cameras.
    input: u64,
    /// Digests of the network of LPIPS and of the known light, as settings.
    others: [Value; 2],
    state: State,
    occupied: occupied::Occupied,
}

/// Weight of the numerical normals against a pass, in the last stage.
const NORMALS: f32 = 1.0;
/// The stage in which they are compared.
const LAST: usize = 2;

/// The rays of an iteration.
#[derive(Debug)]
struct Batch {
    crops: Vec<Crop>,
    rays: view::RayList,
    /// (N, 3) colours of the images.
    colors: Vec<f32>,
}

impl<'a> FieldFit<'a> {
    /// Makes a fit before its first iteration. `light` is a known map for shaded materials ([`shaded::reduced`]).
    ///
    /// # Errors
    /// When the settings are not valid, the images do not suffice, or the passes that materials are learned from are missing.
    pub fn new(
        settings: Settings,
        targets: &'a Targets,
        lpips: Option<&'a Metric>,
        light: Option<Vec<[f32; 3]>>,
    ) -> Result<Self> {
        settings.validate()?;
        targets.validate(settings.crop)?;
        if settings.materials == Materials::Passes && !targets.have_passes() {
            return Err(Error::input("--materials")
                .expected("images with passes albedo, material and normal, or --materials shaded or off")
                .got("passes"));
        }
        let state = State::new(&settings, targets.placement)?;
        let state = if light.is_some() { state.with_known_light()? } else { state };
        let input = digest(targets)?;
        let network = lpips.map(|m| Ok(format!("{:016x}", m.digest()?))).transpose()?;
        let map = match (&light, settings.materials) {
            (Some(map), _) => {
                let mut d = Digest::new();
                d.f32(&[map.len(), 3], map.as_flattened())?;
                format!("known {:016x}", d.value())
            }
            (None, Materials::Shaded) => "learned".to_owned(),
            (None, _) => "none".to_owned(),
        };
        let others = [Value::from(network), Value::from(map)];
        let occupied = occupied::Occupied::default();
        Ok(Self { settings, targets, lpips, light, input, others, state, occupied })
    }

    /// The field of the current state.
    pub fn field(&self) -> &Field {
        &self.state.field
    }

    /// The learned light, (16, 32), if one is learned.
    pub fn learned_light(&self) -> Option<Vec<[f32; 3]>> {
        (!self.state.light.is_empty()).then(|| shaded::texels(&self.state.light))
    }

    fn batch(&self, iteration: usize) -> Batch {
        let s = &self.settings;
        let crops = crops::draw(&self.targets.train, s.seed, iteration, s.crops, s.crop);
        let (mut rays, mut colors) = (view::RayList::default(), Vec::new());
        for crop in &crops {
            let target = &self.targets.train[crop.view];
            let width = target.camera.width;
            crop.pixels(width).for_each(|i| rays.push(&target.camera, i));
            colors.extend(losses::cropped(&target.color, width, crop, 3));
        }
        Batch { crops, rays, colors }
    }

    /// Whether numerical normals are computed in a stage, and whether they are compared with a pass.
    fn normals_in(&self, stage: usize) -> (bool, bool) {
        let has_pass = self.targets.train.iter().all(|t| t.normal.is_some());
        let compares = has_pass && stage == LAST && self.settings.materials == Materials::Passes;
        let follows = self.settings.has_normal_head() && !has_pass;
        (compares || follows || self.settings.materials == Materials::Shaded, compares)
    }

    /// The losses of a render, with the cotangents of values and opacity; what does not pass through the renderer is added to
    /// the gradients.
    fn losses(
        &self,
        iteration: usize,
        batch: &Batch,
        out: &render::Out,
        g: &mut state::Gradients,
    ) -> Result<(f32, [Vec<f32>; 2])> {
        let (s, field) = (&self.settings, &self.state.field);
        let weights = scene::Weights::of(field);
        let channels = weights.scene(batch.rays.borrowed()).channels();
        let mut rendered = losses::Rendered::new(&out.values, &out.opacity, channels);
        let at_surface = normals::AtSurface::of(&self.targets.train, &batch.crops, out);
        let (has_normals, compares) = self.normals_in(s.stage(iteration).index);
        let stencils = (has_normals && !at_surface.rays.is_empty())
            .then(|| surface::Stencils::at(field, &at_surface.points));
        let followed = stencils.as_ref().map(|stencils| {
            let mut all = vec![[0.0; 3]; out.opacity.len()];
            at_surface.rays.iter().zip(&stencils.normals).for_each(|(r, n)| all[*r] = *n);
            all
        });
        let terms = losses::Terms {
            weight: 1.0 / batch.crops.len() as f32,
            passes: s.materials != Materials::Shaded,
            material: 1.0,
            normal: 1.0,
            lpips: self.lpips.map(|m| &m.weights),
            scale: None,
        };
        let (mut loss, mut first) = (0.0, 0);
        for crop in &batch.crops {
            let target = &self.targets.train[crop.view];
            loss += terms.add(target, crop, first, followed.as_deref(), &mut rendered)?;
            first += crop.size[0] * crop.size[1];
        }
        if let Some(stencils) = &stencils {
            let mut normals_bar = vec![[0.0; 3]; stencils.normals.len()];
            if compares {
                let (all, crops) = (&self.targets.train, &batch.crops);
                loss += at_surface.compare(all, crops, &stencils.normals, NORMALS, &mut normals_bar)?;
            }
            if s.materials == Materials::Shaded {
                let valid = shaded::Valid {
                    rays: &at_surface.rays,
                    normals: &stencils.normals,
                    directions: &batch.rays.directions,
                    colors: &batch.colors,
                };
                let light = match &self.light {
                    Some(map) => shaded::Light::Known(map),
                    None => shaded::Light::Learned(&self.state.light, &mut g.light),
                };
                loss += shaded::add(&valid, light, (s.seed, iteration), &mut rendered, &mut normals_bar)?;
            }
            let zeros = vec![[0.0; 3]; normals_bar.len()];
            stencils.pull(&zeros, &normals_bar, &mut g.field.planes, &mut g.field.heads.sdf);
        }
        if s.eikonal > 0.0 {
            let points = surface::scattered(field, &at_surface.points, s.seed, iteration);
            let stencils = surface::Stencils::at(field, &points);
            loss += surface::unit_length(&stencils, s.eikonal, &mut g.field.planes, &mut g.field.heads.sdf);
        }
        if s.seams > 0.0 {
            let (planes, network) = (&mut g.field.planes, &mut g.field.heads.sdf);
            loss += surface::closed(field, &at_surface.points, s.seams, planes, network)?;
        }
        Ok((loss, [rendered.values_bar, rendered.opacity_bar]))
    }

    /// Value and gradients of the squared variation of the planes: per unit of length instead of per texel.
    fn variation(&self, planes_bar: &mut [f32]) -> f32 {
        let planes = &self.state.field.planes;
        let x = loss::variation::In {
            planes: &planes.values,
            shape: planes.shape(),
            columns: loss::variation::Columns::Open,
        };
        let weight = self.settings.variation * (planes.side * planes.side) as f32;
        if weight == 0.0 {
            return 0.0;
        }
        loss::variation::adjoint(&x, weight, planes_bar);
        weight * loss::variation::forward(&x)
    }
}

/// Digest of the images and cameras.
fn digest(targets: &Targets) -> Result<u64> {
    let mut d = Digest::new();
    for t in targets.train.iter() {
        d.bytes(t.name.as_bytes());
        let c = &t.camera;
        d.u64(c.width as u64);
        d.f32(&[3, 3], c.rotation.as_flattened())?;
        d.f32(&[7], &[c.translation.as_slice(), &c.focal_px, &c.center_px].concat())?;
        let arrays = [
            Some(&t.color),
            Some(&t.foreground),
            t.kept.as_ref(),
            t.colored.as_ref(),
            t.albedo.as_ref(),
            t.material.as_ref(),
            t.normal.as_ref(),
        ];
        arrays.into_iter().flatten().try_for_each(|a| d.f32(&[a.len()], a))?;
    }
    Ok(d.value())
}

impl Fit for FieldFit<'_> {
    fn kind(&self) -> &'static str {
        "field"
    }

    fn settings(&self) -> Value {
        let mut settings = self.settings.json();
        settings["input"] = Value::from(format!("{:016x}", self.input));
        settings["train_views"] = Value::from(self.targets.train.len());
        let [network, map] = &self.others;
        settings["lpips"] = network.clone();
        settings["light"] = map.clone();
        settings
    }

    fn iterations(&self) -> usize {
        self.settings.iterations
    }

    fn step(&mut self, i: usize, watch: &mut dyn Watch) -> Result<Step> {
        let named = |e: Error| e.at(format!("iteration {}", i + 1));
        let stage = self.settings.stage(i);
        let has_grown = self.state.field.planes.side != stage.side;
        if has_grown {
            self.state.grow(stage.side)?;
        }
        self.state.at(&self.settings, i);
        self.occupied.refill(&self.state.field, i, has_grown)?;
        watch.lap("occupancy");
        let batch = self.batch(i);
        let field = &self.state.field;
        let weights = scene::Weights::of(field);
        let scene = weights.scene(batch.rays.borrowed());
        let mut plan = Plan::new(self.occupied.intervals(scene.rays, field.settings.half_size, scene.step()));
        let out = render::forward(&scene, &mut plan);
        watch.lap("render");
        let mut g =
            state::Gradients { field: InBar::zeros_like(&scene), light: vec![0.0; self.state.light.len()] };
        let (mut loss, [values, opacity]) = self.losses(i, &batch, &out, &mut g).map_err(named)?;
        watch.lap("losses");
        let out_bar = OutBar { values: &values, opacity: &opacity, ..OutBar::default() };
        render::adjoint(&scene, &plan, &out, &out_bar, self.settings.chunk, &mut g.field);
        loss += self.variation(&mut g.field.planes);
        watch.lap("adjoint");
        if !loss.is_finite() {
            return Err(named(
                Error::check("field fit").at("loss").expected("a finite number").got(loss.to_string()),
            ));
        }
        let samples = plan.taken();
        let rates = self.settings.rates_at(i);
        self.state.step(g, rates).map_err(named)?;
        watch.lap("optimiser");
        // The history holds 31 bits.
        Ok(Step { loss, size: Ord::min(samples, i32::MAX as usize) })
    }

    fn preview(&self, k: usize, count: usize) -> Option<Preview> {
        let shown = if self.targets.test.is_empty() { &self.targets.train } else { &self.targets.test };
        let target = shown.get(k * shown.len() / Ord::max(count, 1))?;
        let cells = view::occupancy(self.field()).ok()?;
        let images = view::render(self.field(), Some(&cells), &target.camera, false);
        let image = images.color()?;
        let size = [target.camera.height, target.camera.width];
        let scored =
            super::evaluate::compare(&target.name, &image, &target.color, target.colored.as_deref(), size)
                .ok()?;
        Some(Preview {
            name: target.name.clone(),
            image,
            size: [size[1], size[0]],
            psnr_db: scored.score.psnr_db,
            metric: "PSNR",
        })
    }

    fn save(&self, out: &mut Arrays) {
        self.state.save(out);
        self.occupied.save(out);
    }

    fn load(&mut self, from: &Arrays) -> Result<()> {
        // Both are complete before one is replaced.
        let occupied = occupied::Occupied::load(from, self.state.field.settings.half_size)?;
        self.state.load(&self.settings, from)?;
        self.occupied = occupied;
        Ok(())
    }
}
