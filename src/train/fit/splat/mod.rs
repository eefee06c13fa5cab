//! Static Gaussian splatting: one set of Gaussians for the images of one capture.
//!
//! ```text
//! settings   settings that decide the result  pass   one view: activate → draw → losses, and their adjoints in reverse
//! ```
//!
//! Iteration i (counted from 1) uses one image: position (i−1) mod n of the permutation of epoch ⌊(i−1)/n⌋,
//! drawn with Philox. It renders, computes 0.8·L1 + 0.2·(1 − SSIM), takes a step of Adam, and applies density
//! control on its schedule. The state between iterations is that of a checkpoint: parameters, moments,
//! counters, screen statistics, events. There is no other state, so a resumed fit is bit-identical to an
//! uninterrupted one.

mod pass;
mod settings;

pub use settings::{MAX_GAUSSIANS, Settings, Strategy};

use super::drawing::Workspace;
use super::evaluate;
use super::render::Scene;
use super::training::{Fit, Preview, Step, Watch};
use crate::num::array::{Array, Arrays};
use crate::num::bits::Digest;
use crate::num::order;
use crate::num::rng::Rng;
use crate::optim::adam::Rule;
use crate::optim::density::{self, Stats};
use crate::optim::groups::{Groups, Rates, means_schedule};
use crate::optim::mcmc;
use crate::optim::schedule::{LogLinear, scaled, sh_degree};
use crate::scene::gaussians::Gaussians;
use crate::scene::views::{View, Views};
use crate::{Error, Result};
use pass::{Drawing, Target};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Purpose of the random order of the images.
const PURPOSE_ORDER: u16 = 0x0501;
/// Images are kept as floats up to this many bytes; others are converted when they are used.
const PHOTO_CACHE_BYTES: usize = 2 << 30;

/// Pruning leaves at least this many Gaussians.
const KEPT: usize = 100;

/// Counts of density control in one iteration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Event {
    /// iteration, counted from 1
    pub iteration: usize,
    /// copies made of small Gaussians
    pub cloned: usize,
    /// large Gaussians replaced by two
    pub split: usize,
    /// dead Gaussians relocated onto live ones
    pub moved: usize,
    /// Gaussians added by growth
    pub added: usize,
    /// Gaussians removed for low opacity or large scale
    pub pruned: usize,
    /// opacities lowered by a reset
    pub reset: usize,
    /// Gaussians afterwards
    pub size: usize,
}

impl Event {
    fn row(&self) -> [i64; 8] {
        [self.iteration, self.cloned, self.split, self.moved, self.added, self.pruned, self.reset, self.size]
            .map(|n| n as i64)
    }

    fn from_row(r: &[i64; 8]) -> Option<Self> {
        let n = |i: usize| usize::try_from(r[i]).ok();
        Some(Self {
            iteration: n(0)?,
            cloned: n(1)?,
            split: n(2)?,
            moved: n(3)?,
            added: n(4)?,
            pruned: n(5)?,
            reset: n(6)?,
            size: n(7)?,
        })
    }
}

/// Density control of a strategy, with the constants of this run.
enum Control {
    Gradient(density::Settings),
    Sampling(mcmc::Settings),
}

/// A fit in progress.
pub struct SplatFit<'a> {
    settings: Settings,
    views: &'a Views,
    /// digest of the images, masks and cameras
    input: u64,
    control: Control,
    means_rate: LogLinear,
    // The state.
    gaussians: Gaussians,
    groups: Groups,
    stats: Stats,
    events: Vec<Event>,
    // Cached for speed; a function of the other fields.
    photos: Vec<Option<Target>>,
    order: (usize, Vec<usize>),
    workspace: Workspace,
}

impl<'a> SplatFit<'a> {
    /// Makes a fit before its first iteration.
    ///
    /// # Errors
    /// When the settings or the initial Gaussians are not valid.
    pub fn new(settings: Settings, views: &'a Views, first: Gaussians) -> Result<Self> {
        settings.validate()?;
        first.validate("initial Gaussians")?;
        let iterations = u32::try_from(settings.iterations).expect("validated");
        let control = match settings.strategy {
            Strategy::Mcmc => {
                let s = mcmc::Settings::GSPLAT.scaled(iterations);
                Control::Sampling(mcmc::Settings { cap: settings.max_gaussians, ..s })
            }
            other => {
                let s = match other {
                    Strategy::Gsplat => density::Settings::GSPLAT,
                    Strategy::GsplatAbs => density::Settings::GSPLAT_ABS,
                    _ => density::Settings::INRIA,
                };
                let is_white = settings.background == [1.0; 3];
                let s = density::Settings {
                    max_gaussians: settings.max_gaussians,
                    reset_at_start: is_white && settings.strategy == Strategy::Inria,
                    prune_scale: s.prune_scale * size_factor(views),
                    keep_at_least: KEPT,
                    ..s
                };
                Control::Gradient(s.scaled(iterations))
            }
        };
        // Sampling needs no screen statistics.
        let watched = if matches!(control, Control::Gradient(_)) { first.len() } else { 0 };
        Ok(Self {
            input: input_digest(views)?,
            control,
            means_rate: means_schedule(views.extent, iterations)?,
            groups: Groups::new(Rule::SPLAT, &first)?,
            stats: Stats::new(watched),
            gaussians: first,
            events: Vec::new(),
            photos: vec![None; views.views.len()],
            order: (usize::MAX, Vec::new()),
            workspace: Workspace::default(),
            settings,
            views,
        })
    }

    /// The current Gaussians.
    pub fn gaussians(&self) -> &Gaussians {
        &self.gaussians
    }

    /// The events of density control so far.
    pub fn events(&self) -> &[Event] {
        &self.events
    }

    /// The first iteration after which there was no room for another Gaussian; 0 if there was none at the
    /// start.
    pub fn full_since(&self) -> Option<usize> {
        let most = self.settings.max_gaussians;
        let grown = |e: &&Event| e.cloned + e.split + e.added > 0 && e.size + e.pruned >= most;
        match self.events.iter().find(grown) {
            Some(e) => Some(e.iteration),
            None => (self.gaussians.len() >= most).then_some(0),
        }
    }

    /// Digest of all parameters, 16 hexadecimal digits.
    ///
    /// # Errors
    /// When a parameter is NaN.
    pub fn digest(&self) -> Result<String> {
        digest(&self.gaussians)
    }

    /// The image of an iteration (counted from 0), as index into the views.
    fn view_of(&mut self, i: usize) -> usize {
        let n = self.views.train.len();
        let epoch = i / n;
        if self.order.0 != epoch {
            let step = u32::try_from(epoch).expect("fewer epochs than iterations");
            self.order = (epoch, Rng::new(self.settings.seed).permutation(n, step, PURPOSE_ORDER));
        }
        self.views.train[self.order.1[i % n]]
    }

    /// The image as floats, cached if there is room.
    fn target(&mut self, index: usize) -> Target {
        if let Some(target) = &self.photos[index] {
            return target.clone();
        }
        let target = target_of(&self.views.views[index]);
        let bytes = |v: &View| v.rgb.len() * 4 + v.mask.as_ref().map_or(0, |m| m.len() * 4);
        // Decided from all images before this one, so that the cache does not depend on the order of use.
        let before = self.views.views[..=index].iter().fold(0, |s, v| s + bytes(v));
        if before <= PHOTO_CACHE_BYTES {
            self.photos[index] = Some(target.clone());
        }
        target
    }

    fn control(&mut self, iteration: u32) -> Result<()> {
        let (g, groups, seed) = (&mut self.gaussians, &mut self.groups, self.settings.seed);
        let mut event = Event { iteration: iteration as usize, ..Event::default() };
        match &self.control {
            Control::Gradient(s) => {
                for what in density::step(s, iteration, self.views.extent, seed, g, groups, &mut self.stats)?
                {
                    match what {
                        density::Event::Refined(r) => {
                            event.cloned = r.cloned;
                            event.split = r.split;
                            event.pruned = r.pruned_opacity + r.pruned_scale;
                        }
                        density::Event::Reset => event.reset = g.len(),
                    }
                }
            }
            Control::Sampling(s) => {
                if let Some(r) = mcmc::step(s, iteration, seed, g, groups)? {
                    event.moved = r.relocated;
                    event.added = r.added;
                }
                mcmc::add_noise(s, iteration, seed, self.means_rate.at(iteration), g);
            }
        }
        event.size = g.len();
        if event.cloned + event.split + event.moved + event.added + event.pruned + event.reset > 0 {
            self.events.push(event);
        }
        Ok(())
    }
}

impl Fit for SplatFit<'_> {
    fn kind(&self) -> &'static str {
        "splat"
    }

    fn settings(&self) -> Value {
        // First what a different --downscale changes: other settings follow from it.
        let train = self.views.train.iter().map(|&i| &self.views.views[i].camera);
        let pixels = train.fold(0, |n, camera| n + camera.width * camera.height);
        let images = format!("{} images of {pixels} pixels in all", self.views.train.len());
        let mut settings = json!({ "images": images });
        for (key, value) in self.settings.json().as_object().into_iter().flatten() {
            settings[key] = value.clone();
        }
        settings["input"] = Value::from(format!("{:016x}", self.input));
        settings["train_views"] = Value::from(self.views.train.len());
        settings["extent"] = Value::from(self.views.extent);
        settings
    }

    fn iterations(&self) -> usize {
        self.settings.iterations
    }

    fn step(&mut self, i: usize, watch: &mut dyn Watch) -> Result<Step> {
        let iteration = u32::try_from(i + 1).expect("validated");
        let index = self.view_of(i);
        let target = self.target(index);
        let bands = scaled(1000, u32::try_from(self.settings.iterations).expect("validated"));
        let drawing = Drawing {
            settings: &self.settings.render,
            background: self.settings.background,
            degree: sh_degree(iteration, bands, self.settings.sh_degree),
        };
        watch.lap("input image");
        let outcome = pass::pass(&self.gaussians, &target, &drawing, &mut self.workspace, watch)
            .map_err(|e| e.at(format!("iteration {iteration}, {}", self.views.views[index].name)))?;
        let pass::Outcome { mut loss, mut grad, screen } = outcome;
        match &self.control {
            Control::Gradient(s) => {
                if s.is_open(iteration) {
                    let camera = &target.camera;
                    self.stats.add_view(&screen.means_px_bar, &screen.radii, camera.width, camera.height);
                }
            }
            Control::Sampling(s) => loss += mcmc::regularise(s, &self.gaussians, &mut grad) as f32,
        }
        let rates = Rates::splat(self.means_rate.at(iteration));
        self.groups
            .step(&mut self.gaussians, &grad, &rates, None)
            .map_err(|e| e.at(format!("iteration {iteration}")))?;
        self.workspace.give_back(grad.sh);
        watch.lap("optimiser");
        self.control(iteration)?;
        watch.lap("density control");
        Ok(Step { loss, size: self.gaussians.len() })
    }

    fn preview(&self, k: usize, count: usize) -> Option<Preview> {
        let shown = if self.views.test.is_empty() { &self.views.train } else { &self.views.test };
        let view = &self.views.views[*shown.get(k * shown.len() / Ord::max(count, 1))?];
        let scene = Scene::new(&self.gaussians, self.settings.render.clone(), self.settings.background);
        evaluate::preview(&scene, view).ok()
    }

    fn save(&self, out: &mut Arrays) {
        self.gaussians.save("param/", out);
        self.groups.save("adam", out);
        let (sums, views) = self.stats.parts();
        out.put("density/sums", &[sums.len()], sums.to_vec());
        out.put("density/views", &[views.len()], views.iter().map(|&v| i64::from(v)).collect());
        let rows: Vec<i64> = self.events.iter().flat_map(Event::row).collect();
        out.put("density/events", &[self.events.len(), 8], rows);
    }

    fn load(&mut self, from: &Arrays) -> Result<()> {
        let mut dims = BTreeMap::new();
        let gaussians = Gaussians::load("param/", self.settings.sh_degree, from)?;
        let groups = Groups::load(Rule::SPLAT, "adam", from, &gaussians)?;
        let rows = if matches!(self.control, Control::Gradient(_)) { gaussians.len() } else { 0 }.to_string();
        let sums = from.shape("density/sums", &rows, &mut dims)?.to_f64();
        let views: Option<Vec<u32>> = integers(from.shape("density/views", &rows, &mut dims)?)
            .and_then(|v| v.into_iter().map(|n| u32::try_from(n).ok()).collect());
        let views =
            views.ok_or_else(|| Error::input("array 'density/views'").expected("counts below 2³²"))?;
        let events: Option<Vec<Event>> = integers(from.shape("density/events", "E,8", &mut dims)?)
            .and_then(|v| v.as_chunks().0.iter().map(Event::from_row).collect());
        let events =
            events.ok_or_else(|| Error::input("array 'density/events'").expected("rows of counts"))?;
        self.stats = Stats::from_parts(sums, views)?;
        (self.gaussians, self.groups, self.events) = (gaussians, groups, events);
        Ok(())
    }
}

/// How much larger than published a Gaussian may be before it is pruned for its size: the limit, a tenth of
/// the extent of the cameras, belongs to captures with points. Without points the first Gaussians fill the
/// scene box, which can be much larger than the extent of few cameras, and so can what is in it; then the
/// limit is a tenth of half the box, where that is more.
fn size_factor(views: &Views) -> f64 {
    if views.starting_points().is_some() {
        return 1.0;
    }
    order::max(views.scene_box.half_size / views.extent, 1.0)
}

fn integers(a: &Array) -> Option<Vec<i64>> {
    if a.is_float() { None } else { a.to_i64() }
}

fn target_of(view: &View) -> Target {
    let mask = view.mask.as_ref().map(|m| Arc::new(m.iter().map(|&b| f32::from(b)).collect()));
    Target { camera: view.camera.clone(), photo: Arc::new(view.image()), mask }
}

/// Digest of all parameters of a scene, 16 hexadecimal digits: means, quats, scales_log, opacity_logits, sh
/// in this order.
///
/// # Errors
/// When a parameter is NaN.
pub fn digest(g: &Gaussians) -> Result<String> {
    let mut d = Digest::new();
    g.add_to(&mut d)?;
    Ok(format!("{:016x}", d.value()))
}

/// Digest of the training images: cameras, pixels, masks.
fn input_digest(views: &Views) -> Result<u64> {
    let mut d = Digest::new();
    for v in views.train.iter().map(|&i| &views.views[i]) {
        let c = &v.camera;
        d.f32(&[3, 3], c.rotation.as_flattened())?;
        d.f32(&[3], &c.translation)?;
        d.f32(&[2], &c.focal_px)?;
        d.f32(&[2], &c.center_px)?;
        d.u64(c.model as u64);
        d.head(1, &[c.height, c.width, 3]);
        d.bytes(&v.rgb);
        if let Some(mask) = &v.mask {
            d.head(1, &[c.height, c.width]);
            d.bytes(mask);
        }
    }
    Ok(d.value())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::built_in;
    use crate::fit::evaluate::{Evaluation, score};
    use crate::fit::seeds::{self, Start};
    use crate::fit::training::{History, Schedule, run};
    use crate::splat::render;
    use std::sync::atomic::AtomicBool;

    fn psnr(g: &Gaussians, views: &Views) -> f64 {
        let scene = Scene::new(g, render::Settings::default(), built_in::BACKGROUND);
        let scores =
            views.test.iter().map(|&i| score(&scene, &views.views[i]).expect("renders").score).collect();
        Evaluation::of(scores).mean_psnr_db
    }

    #[test]
    fn held_out_views_get_better_and_the_cap_holds() {
        let views =
            built_in::miniature(1, 4, &render::Settings::default()).expect("the built-in scene renders");
        let stop = AtomicBool::new(false);
        for strategy in [Strategy::Inria, Strategy::Gsplat, Strategy::GsplatAbs, Strategy::Mcmc] {
            let settings = Settings {
                iterations: 300,
                seed: 5,
                sh_degree: 1,
                strategy,
                max_gaussians: 700,
                render: render::Settings::default(),
                background: built_in::BACKGROUND,
            };
            let first = seeds::gaussians(&Start::Random { count: 500, bounds: None }, &views, &settings)
                .expect("valid");
            let before = psnr(&first, &views);
            let mut fit = SplatFit::new(settings, &views, first).expect("valid");
            let schedule = Schedule { checkpoint: None, every: 1000, stop: &stop };
            let mut history = History::default();
            run(&mut fit, &mut history, schedule, &mut ()).expect("runs");
            let after = psnr(fit.gaussians(), &views);
            assert!(after > before + 5.0, "{strategy:?}: {before:.2} dB to {after:.2} dB");
            assert!(history.size.iter().all(|&n| n <= 700), "{strategy:?}: at most the cap");
            let sum = |f: fn(&Event) -> usize| fit.events().iter().fold(0, |s, e| s + f(e));
            let grown = 500 + sum(|e| e.cloned) + sum(|e| e.split) + sum(|e| e.added) - sum(|e| e.pruned);
            assert_eq!(grown, fit.gaussians().len(), "{strategy:?}: the events account for every Gaussian");
        }
    }

    /// Evaluates every view after every iteration.
    struct Viewer(Vec<f64>);
    impl Watch for Viewer {
        fn state(&mut self, _done: usize, _total: usize, fit: &dyn Fit) -> Result<()> {
            self.0.extend((0..2).filter_map(|k| fit.preview(k, 2)).map(|p| p.psnr_db));
            Ok(())
        }
    }

    #[test]
    fn previews_show_the_state_and_leave_it_alone() {
        let views =
            built_in::miniature(1, 4, &render::Settings::default()).expect("the built-in scene renders");
        let settings = Settings {
            iterations: 40,
            seed: 5,
            sh_degree: 1,
            strategy: Strategy::Inria,
            max_gaussians: 700,
            render: render::Settings::default(),
            background: built_in::BACKGROUND,
        };
        let first =
            seeds::gaussians(&Start::Random { count: 300, bounds: None }, &views, &settings).expect("valid");
        let stop = AtomicBool::new(false);
        let fitted = |watch: &mut dyn Watch| {
            let mut fit = SplatFit::new(settings.clone(), &views, first.clone()).expect("valid");
            let schedule = Schedule { checkpoint: None, every: 1000, stop: &stop };
            run(&mut fit, &mut History::default(), schedule, watch).expect("runs");
            fit
        };
        let mut viewer = Viewer(Vec::new());
        let (watched, alone) = (fitted(&mut viewer), fitted(&mut ()));
        assert_eq!(watched.digest().expect("finite"), alone.digest().expect("finite"), "the same bits");
        let shown = watched.preview(0, 1).expect("a view");
        let scene = Scene::new(alone.gaussians(), render::Settings::default(), built_in::BACKGROUND);
        let scored = score(&scene, &views.views[views.test[0]]).expect("renders");
        assert_eq!(
            (shown.psnr_db, &shown.name),
            (scored.score.psnr_db, &scored.score.name),
            "the score of the state"
        );
        assert_eq!(shown.image, scored.image, "and its render");
        assert_eq!(
            viewer.0.len() % 41,
            0,
            "a state before the first and after each iteration: {}",
            viewer.0.len()
        );
    }

    #[test]
    fn every_image_is_used_once_per_epoch() {
        let views =
            built_in::miniature(2, 8, &render::Settings::default()).expect("the built-in scene renders");
        let settings = Settings {
            iterations: 100,
            seed: 5,
            sh_degree: 0,
            strategy: Strategy::Inria,
            max_gaussians: 700,
            render: render::Settings::default(),
            background: built_in::BACKGROUND,
        };
        let first =
            seeds::gaussians(&Start::Random { count: 10, bounds: None }, &views, &settings).expect("valid");
        let mut fit = SplatFit::new(settings, &views, first).expect("valid");
        let n = views.train.len();
        let epoch = |fit: &mut SplatFit<'_>, e: usize| {
            (e * n..(e + 1) * n).map(|i| fit.view_of(i)).collect::<Vec<_>>()
        };
        let (a, b) = (epoch(&mut fit, 0), epoch(&mut fit, 1));
        assert_ne!(a, b, "another order");
        assert_eq!(epoch(&mut fit, 0), a, "the order is a function of the epoch");
        for mut order in [a, b] {
            order.sort_unstable();
            assert_eq!(order, views.train, "every training image once");
        }
    }
}
