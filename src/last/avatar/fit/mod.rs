//! The fit: each iteration renders one training image, updates the parameters (all at once or level by level)
//! and runs density control.
//!
//! Iteration i (from 1) uses the shot at position (i−1) mod n of the permutation of epoch ⌊(i−1)/n⌋, drawn
//! with Philox. Everything that an iteration uses is a function of the state and i alone; a checkpoint
//! contains the state.

mod pass;
mod request;
mod update;

use super::density::{self, Event, Latent};
use super::evaluate::Evaluation;
use super::guide::Guide;
use super::person::Avatar;
use super::prior::{NEAR, Near};
use super::progressive::Plan;
use super::settings::Settings;
use super::store;
use super::view::Target;
use crate::fit::drawing::Workspace;
use crate::fit::training::{Fit, Preview, Step, Watch};
use crate::num::array::Arrays;
use crate::num::bits::Digest;
use crate::num::rng::Rng;
use crate::optim::adam::Rule;
use crate::optim::density::Stats;
use crate::optim::groups::{Groups, Rates};
use crate::optim::schedule::{LogLinear, sh_degree};
use crate::scene::person::{PersonCapture, Pose};
use crate::{Error, Result};
use request::Request;
use serde_json::Value;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Purpose number of the draws that determine the order of the images.
const PURPOSE_ORDER: u16 = 0x0904;
/// Purpose number of the draws of background colours.
const PURPOSE_BACKGROUND: u16 = 0x0907;
/// Images are cached as long as they fit into this many bytes; other images are read when they are used.
const CACHE_BYTES: usize = 1 << 30;
/// Number of local steps of λ mode `stop`.
const LOCAL_STEPS: usize = 5;

/// Counts of the work done by a fit, for reports and for comparisons with equal budgets.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tally {
    /// Number of rendered images.
    pub renders: u64,
    /// Number of encoder passes with their adjoints (for L_lat) and of image pairs evaluated for key
    /// Gaussians.
    pub encodings: u64,
    /// Number of steps after level 0, counted per factor and attribute in λ mode `rel` and per factor in mode
    /// `abs`.
    pub capped: u64,
    /// Number of those steps that λ limited.
    pub bound: u64,
    /// Sum over the gradients of L_lat of the fraction of the image with |g| < 1e-8.
    pub blind: f64,
    /// Number of those gradients.
    pub gradients: u64,
}

/// A fit in progress.
pub struct PersonFit<'a> {
    settings: Settings,
    capture: &'a PersonCapture,
    guide: Option<&'a dyn Guide>,
    plan: Option<Plan>,
    input: u64,
    // The state.
    avatar: Avatar,
    groups: Groups,
    stats: Stats,
    latent: Latent,
    /// The nearest Gaussians of each Gaussian, found when the number of Gaussians last changed, shape (G).
    near: Near,
    /// Bit mask of the factors to which each Gaussian is key, shape (G); empty before key Gaussians were
    /// determined.
    members: Vec<u32>,
    events: Vec<Event>,
    tally: Tally,
    // Caches; each is a function of the other fields.
    targets: Vec<Option<Arc<Target>>>,
    cached: usize,
    order: (usize, Vec<usize>),
    work: Workspace,
}

impl<'a> PersonFit<'a> {
    /// Creates a fit before its first iteration.
    ///
    /// # Errors
    /// If settings are out of range or require a guide that is not given, or if the capture has no training
    /// images.
    pub fn new(settings: Settings, capture: &'a PersonCapture, guide: Option<&'a dyn Guide>) -> Result<Self> {
        settings.validate()?;
        if capture.train.is_empty() {
            return Err(Error::input(capture.folder.display().to_string())
                .expected("at least one training image")
                .got("none"));
        }
        if settings.needs_guide() && guide.is_none() {
            return Err(Error::input("settings")
                .expected("a trained image-to-point model")
                .got("none")
                .hint(
                    "--model MODEL.safetensors, or --no-density-adapter --no-progressive to fit without a model",
                ));
        }
        let plan = match &settings.progressive {
            None => None,
            Some(p) => {
                let graph = match (&p.graph, guide) {
                    (Some(graph), _) => graph.clone(),
                    (None, Some(guide)) => guide.graph(),
                    (None, None) => unreachable!("the guide is checked above"),
                };
                if let Some(guide) = guide
                    && guide.factors() != graph.n()
                {
                    return Err(Error::input("causal graph")
                        .expected(format!("{} factors, the number of factors of the model", guide.factors()))
                        .got(graph.n().to_string()));
                }
                Some(Plan::new(&graph, p.order, settings.seed)?)
            }
        };
        let mut avatar = Avatar::new(&capture.template, capture.moments(), &settings)?;
        if let Some(light) = &mut avatar.light {
            light.set_toward(first_light(capture, settings.first_light)?);
            light.seen = vec![false; capture.moments()];
            capture.train.iter().for_each(|&shot| light.seen[capture.shots[shot].time] = true);
        }
        let n = avatar.gaussians.len();
        if n > settings.max_gaussians {
            return Err(Error::input("--max-gaussians")
                .expected(format!("at least {n}, the number of template points"))
                .got(settings.max_gaussians.to_string()));
        }
        Ok(Self {
            input: input_digest(capture)?,
            groups: Groups::new(Rule::SPLAT, &avatar.gaussians)?,
            stats: Stats::new(n),
            latent: Latent::new(if settings.density.mode.is_latent() { n } else { 0 }),
            near: Near::new(&avatar.gaussians)?,
            members: Vec::new(),
            events: Vec::new(),
            tally: Tally::default(),
            targets: vec![None; capture.shots.len()],
            cached: 0,
            order: (usize::MAX, Vec::new()),
            work: Workspace::default(),
            avatar,
            plan,
            settings,
            capture,
            guide,
        })
    }

    /// The avatar in its current state.
    pub fn avatar(&self) -> &Avatar {
        &self.avatar
    }

    /// The density-control events so far.
    pub fn events(&self) -> &[Event] {
        &self.events
    }

    /// The work done so far.
    pub fn tally(&self) -> Tally {
        self.tally
    }

    /// Bit mask of the factors to which each Gaussian is key, shape (G); empty before key Gaussians were
    /// determined.
    pub fn members(&self) -> &[u32] {
        &self.members
    }

    /// Levels of the factors; `None` without the progressive update.
    pub fn plan(&self) -> Option<&Plan> {
        self.plan.as_ref()
    }

    /// The shot of an iteration (counted from 0), as an index into the shots of the capture.
    fn shot_of(&mut self, i: usize) -> usize {
        let n = self.capture.train.len();
        let epoch = i / n;
        if self.order.0 != epoch {
            let step = u32::try_from(epoch).expect("fewer epochs than iterations");
            self.order = (epoch, Rng::new(self.settings.seed).permutation(n, step, PURPOSE_ORDER));
        }
        self.capture.train[self.order.1[i % n]]
    }

    fn target(&mut self, shot: usize) -> Result<Arc<Target>> {
        if let Some(target) = &self.targets[shot] {
            return Ok(Arc::clone(target));
        }
        let target = Arc::new(Target::read(self.capture, &self.capture.shots[shot])?);
        let bytes = target.photo.len() * 4 * 3;
        if self.cached + bytes <= CACHE_BYTES {
            self.cached += bytes;
            self.targets[shot] = Some(Arc::clone(&target));
        }
        Ok(target)
    }

    fn rates(&self, iteration: u32) -> Result<Rates> {
        let l = &self.settings.learning;
        let total = u32::try_from(self.settings.iterations).expect("validated");
        let means = LogLinear::new(l.means, l.means_end, total)?.at(iteration);
        let fade = LogLinear::new(1.0, l.decay, total)?.at(iteration);
        Ok(Rates {
            means,
            quats: l.quats * fade,
            scales_log: l.scales_log * fade,
            opacity_logits: l.opacity_logits * fade,
            sh_dc: l.sh_dc * fade,
            sh_rest: l.sh_dc / 20.0 * fade,
        })
    }

    fn control(&mut self, iteration: usize) -> Result<()> {
        let (s, d) = (&self.settings, &self.settings.density);
        let [start, stop, every] = [s.scaled(d.start), s.scaled(d.stop), s.scaled(d.every)];
        if iteration <= start || iteration >= stop || !iteration.is_multiple_of(every) {
            return Ok(());
        }
        let (avatar, groups) = (&mut self.avatar, &mut self.groups);
        let (event, parents) =
            density::refine(s, iteration, avatar, groups, &mut self.stats, &mut self.latent)?;
        self.events.push(event);
        self.near = Near::new(&self.avatar.gaussians)?;
        if !self.members.is_empty() {
            self.members = parents.iter().map(|&p| self.members[p as usize]).collect();
        }
        Ok(())
    }

    /// The pose of a moment of the capture.
    pub fn pose(&self, time: usize) -> &Pose {
        &self.capture.poses[time]
    }
}

impl Fit for PersonFit<'_> {
    fn kind(&self) -> &'static str {
        "last"
    }

    fn settings(&self) -> Value {
        let mut settings = self.settings.json();
        settings["input"] = Value::from(format!("{:016x}", self.input));
        settings["train_pictures"] = Value::from(self.capture.train.len());
        let guide = if self.settings.needs_guide() { self.guide.map(Guide::identity) } else { None };
        settings["model"] = Value::from(guide.unwrap_or_else(|| "none".to_owned()));
        settings
    }

    fn iterations(&self) -> usize {
        self.settings.iterations
    }

    fn step(&mut self, i: usize, watch: &mut dyn Watch) -> Result<Step> {
        let iteration = i + 1;
        let shot = self.shot_of(i);
        let target = self.target(shot)?;
        watch.lap("input image");
        let place = |e: Error| e.at(format!("iteration {iteration}, {}", self.capture.shots[shot].name));
        let count = u32::try_from(iteration).expect("validated");
        let rates = self.rates(count)?;
        let bands = u32::try_from(self.settings.scaled(400)).expect("validated");
        let degree = sh_degree(count, bands, self.settings.sh_degree);
        let d = &self.settings.density;
        let counts = iteration < self.settings.scaled(d.stop);
        let latent = counts && d.mode.is_latent() && i.is_multiple_of(d.latent_every);
        let rig = self.avatar.rig(&self.capture.poses[target.time]);
        let draw =
            |c: usize| Rng::new(self.settings.seed).uniform_f32(c as u64, count, PURPOSE_BACKGROUND, 0);
        let background = if self.settings.random_background {
            std::array::from_fn(draw)
        } else {
            self.settings.background
        };
        let want = Request { degree, background, latent, networks: true };
        let first = self.pass(&target, &rig, want, watch).map_err(place)?;
        if counts {
            self.stats.add_view(&first.means_px, &first.radii, target.camera.width, target.camera.height);
        }
        if let Some(means_bar) = &first.latent {
            self.latent.add(means_bar, &first.radii);
        }
        let place = |e: Error| e.at(format!("iteration {iteration}"));
        self.update(&target, &rig, want, &rates, &first, watch).map_err(place)?;
        self.avatar.step_networks(&rig, &first.grad, self.settings.learning.networks).map_err(place)?;
        if let (Some(light), Some(bar)) = (&mut self.avatar.light, first.light) {
            light.step(target.time, bar, self.settings.learning.gains)?;
        }
        watch.lap("optimiser");
        self.control(iteration)?;
        watch.lap("density control");
        self.find_keys(iteration)?;
        watch.lap("key Gaussians");
        Ok(Step { loss: first.loss, size: self.avatar.gaussians.len() })
    }

    fn preview(&self, k: usize, count: usize) -> Option<Preview> {
        let c = self.capture;
        let shown = if c.test.is_empty() { &c.train } else { &c.test };
        let shot = *shown.get(k * shown.len() / Ord::max(count, 1))?;
        Evaluation::of(&self.avatar, c).preview(shot).ok()
    }

    fn save(&self, out: &mut Arrays) {
        store::put(&self.avatar, true, out);
        self.groups.save("adam", out);
        let (sums, views) = self.stats.parts();
        out.put("density/sums", &[sums.len()], sums.to_vec());
        out.put("density/views", &[views.len()], views.iter().map(|&v| i64::from(v)).collect());
        let l = &self.latent;
        out.put("latent/sums", &[l.sums.len()], l.sums.clone());
        out.put("latent/views", &[l.views.len()], l.views.iter().map(|&v| i64::from(v)).collect());
        let rows: Vec<f64> = self.events.iter().flat_map(Event::row).collect();
        out.put("density/events", &[self.events.len(), Event::WIDTH], rows);
        out.put("keys/members", &[self.members.len()], self.members.iter().map(|&m| i64::from(m)).collect());
        let near = self.near.of.as_flattened().iter().map(|&j| i64::from(j)).collect();
        out.put("prior/near", &[self.near.of.len(), NEAR], near);
        out.put("prior/gap", &[self.near.gap.len()], self.near.gap.clone());
        let t = &self.tally;
        let tally = [
            t.renders as f64,
            t.encodings as f64,
            t.capped as f64,
            t.bound as f64,
            t.blind,
            t.gradients as f64,
        ];
        out.put("tally", &[6], tally.to_vec());
    }

    fn load(&mut self, from: &Arrays) -> Result<()> {
        let (gaussians, nearest) = store::get(self.settings.sh_degree, from)?;
        let n = gaussians.len();
        let groups = Groups::load(Rule::SPLAT, "adam", from, &gaussians)?;
        let mut dims = BTreeMap::new();
        let counts = |name: &str, dims: &mut BTreeMap<char, usize>, shape: &str| {
            store::counts(from.shape(name, shape, dims)?, name)
        };
        let rows = n.to_string();
        let sums = from.shape("density/sums", &rows, &mut dims)?.to_f64();
        let stats = Stats::from_parts(sums, counts("density/views", &mut dims, &rows)?)?;
        let seen = if self.settings.density.mode.is_latent() { rows.clone() } else { "0".to_owned() };
        let latent = Latent {
            sums: from.shape("latent/sums", &seen, &mut dims)?.to_f64(),
            views: counts("latent/views", &mut dims, &seen)?,
        };
        let members = counts("keys/members", &mut dims, "M")?;
        if !(members.is_empty() || members.len() == n) {
            return Err(Error::input("array 'keys/members'")
                .expected(format!("{n} entries, or none"))
                .got(members.len().to_string()));
        }
        let near = counts("prior/near", &mut dims, &format!("{n},{NEAR}"))?;
        if near.iter().any(|&j| j != u32::MAX && j as usize >= n) {
            return Err(Error::input("array 'prior/near'").expected(format!("rows of {n} Gaussians")));
        }
        let gap = from.shape("prior/gap", &rows, &mut dims)?.to_f32();
        let events = from.shape("density/events", &format!("E,{}", Event::WIDTH), &mut dims)?.to_f64();
        let events: Option<Vec<Event>> = events.as_chunks().0.iter().map(Event::from_row).collect();
        let events =
            events.ok_or_else(|| Error::input("array 'density/events'").expected("rows of counts"))?;
        let t = from.shape("tally", "6", &mut dims)?.to_f64();
        from.finite(["tally", "latent/sums", "prior/gap"])?;
        for net in [&mut self.avatar.weights_net, &mut self.avatar.pose_net].into_iter().flatten() {
            net.load(true, from)?;
        }
        if let Some(light) = &mut self.avatar.light {
            light.load(true, from)?;
        }
        self.avatar.gaussians = gaussians;
        self.avatar.attach_to(nearest)?;
        self.tally = Tally {
            renders: t[0] as u64,
            encodings: t[1] as u64,
            capped: t[2] as u64,
            bound: t[3] as u64,
            blind: t[4],
            gradients: t[5] as u64,
        };
        self.near = Near { of: near.as_chunks().0.to_vec(), gap };
        (self.groups, self.stats, self.latent, self.members, self.events) =
            (groups, stats, latent, members, events);
        Ok(())
    }
}

/// The initial direction d of the light, shape (T): the direction to the first training camera, with the
/// given length.
fn first_light(capture: &PersonCapture, length: f32) -> Result<Vec<[f32; 3]>> {
    let eye = capture.shots[capture.train[0]].camera.center();
    let toward = |time: usize| {
        let [low, high] = capture.bounds(time)?;
        let v: [f32; 3] = std::array::from_fn(|k| eye[k] - 0.5 * (low[k] + high[k]));
        let norm = ((v[0] * v[0] + v[1] * v[1]) + v[2] * v[2]).sqrt();
        Ok(if norm > 0.0 { v.map(|x| length * (x / norm)) } else { [0.0; 3] })
    };
    (0..capture.moments()).map(toward).collect()
}

/// Digest of the training images, their names, masks, cameras and poses, and of the template.
fn input_digest(capture: &PersonCapture) -> Result<u64> {
    let mut d = Digest::new();
    let t = &capture.template;
    d.f32(&[t.len(), 3], t.points.as_flattened())?;
    d.f32(&[t.len(), 4], t.weight_of.as_flattened())?;
    for shot in capture.train.iter().map(|&i| &capture.shots[i]) {
        d.bytes(shot.name.as_bytes());
        let c = &shot.camera;
        d.f32(&[3, 3], c.rotation.as_flattened())?;
        d.f32(&[3], &c.translation)?;
        d.f32(&[2], &c.focal_px)?;
        d.f32(&[2], &c.center_px)?;
        d.u64(c.model as u64);
        d.head(1, &[c.height, c.width, 3]);
        let photo = shot.photo()?;
        d.bytes(&photo.rgb);
        d.f32(&[c.height, c.width], &photo.mask)?;
        if let Some(valid) = &photo.valid {
            d.bytes(valid);
        }
        for a in &capture.poses[shot.time].transforms {
            d.f32(&[3, 4], a.as_flattened())?;
        }
    }
    Ok(d.value())
}
