//! A fit that is interrupted and resumed ends with the bytes of an uninterrupted one; a killed one leaves a
//! checkpoint.

use lastlight::fit::built_in;
use lastlight::fit::seeds::{self, Start};
use lastlight::fit::splat::{Settings, SplatFit, Strategy};
use lastlight::fit::training::{self, Fit, History, Schedule, Step, Watch};
use lastlight::num::par;
use lastlight::scene::convert::write_scene;
use lastlight::scene::views::Views;
use lastlight::splat::render;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Long enough for refinements and a reset.
const ITERATIONS: usize = 310;

fn settings(strategy: Strategy) -> Settings {
    Settings {
        iterations: ITERATIONS,
        seed: 11,
        sh_degree: 2,
        strategy,
        max_gaussians: 1500,
        render: render::Settings::default(),
        background: built_in::BACKGROUND,
    }
}

fn views() -> Views {
    built_in::miniature(2, 4, &render::Settings::default()).expect("the built-in scene renders")
}

fn new<'a>(strategy: Strategy, views: &'a Views) -> SplatFit<'a> {
    let settings = settings(strategy);
    let first = seeds::gaussians(&Start::Random { count: 400, bounds: None }, views, &settings)
        .expect("a valid start");
    SplatFit::new(settings, views, first).expect("valid settings")
}

/// Stops when `at` iterations are complete.
struct StopAt<'a>(usize, &'a AtomicBool);

impl Watch for StopAt<'_> {
    fn progress(&mut self, done: usize, _total: usize, _step: Step) {
        self.1.store(done == self.0, Ordering::Relaxed);
    }
}

fn bytes(path: &Path) -> Vec<u8> {
    std::fs::read(path).expect("the file was written")
}

/// Runs to the end without a stop and returns the fit.
fn uninterrupted<'a>(strategy: Strategy, views: &'a Views, path: &Path, every: usize) -> SplatFit<'a> {
    let stop = AtomicBool::new(false);
    let mut fit = new(strategy, views);
    let schedule = Schedule { checkpoint: Some(path), every, stop: &stop };
    training::run(&mut fit, &mut History::default(), schedule, &mut ()).expect("runs");
    fit
}

#[test]
fn a_fit_interrupted_anywhere_ends_with_the_same_bytes() {
    let views = views();
    let dir = tempfile::tempdir().expect("a temporary folder");
    for strategy in [Strategy::Inria, Strategy::GsplatAbs, Strategy::Mcmc] {
        let whole = dir.path().join("whole.safetensors");
        let fit = uninterrupted(strategy, &views, &whole, 1000);
        assert!(!fit.events().is_empty(), "{strategy:?}: density control has acted, or this proves little");
        write_scene(&dir.path().join("whole.ply"), fit.gaussians(), &[]).expect("writes");

        // Before, at and after refinements and a reset; one stop right after another; other thread counts in
        // between.
        let parts = dir.path().join("parts.safetensors");
        let mut history = History::default();
        let mut fit = new(strategy, &views);
        for (i, at) in [1, 2, 29, 30, 31, 149, 150, 151, 309].into_iter().enumerate() {
            let stop = AtomicBool::new(false);
            let schedule = Schedule { checkpoint: Some(&parts), every: 1000, stop: &stop };
            let e = par::with_threads(1 + i % 3, || {
                training::run(&mut fit, &mut history, schedule, &mut StopAt(at, &stop))
            })
            .expect("threads start")
            .expect_err("it was stopped");
            assert_eq!(e.exit_code(), 130, "{strategy:?}: {e}");
            fit = new(strategy, &views);
            history = training::resume(&mut fit, &parts).expect("the checkpoint is complete");
            assert_eq!(history.len(), at, "{strategy:?}: it continues where it stopped");
        }
        let stop = AtomicBool::new(false);
        let schedule = Schedule { checkpoint: Some(&parts), every: 7, stop: &stop };
        training::run(&mut fit, &mut history, schedule, &mut ()).expect("runs");
        write_scene(&dir.path().join("parts.ply"), fit.gaussians(), &[]).expect("writes");
        assert_eq!(bytes(&whole), bytes(&parts), "{strategy:?}: checkpoints");
        assert_eq!(
            bytes(&dir.path().join("whole.ply")),
            bytes(&dir.path().join("parts.ply")),
            "{strategy:?}: scenes"
        );
    }
}

#[test]
fn the_digest_does_not_depend_on_thread_count() {
    let views = views();
    let dir = tempfile::tempdir().expect("a temporary folder");
    let digests: Vec<String> = [1, 2, 3, 7]
        .into_iter()
        .map(|n| {
            let path = dir.path().join(format!("{n}.safetensors"));
            let run = || uninterrupted(Strategy::Inria, &views, &path, 1000).digest().expect("finite");
            par::with_threads(n, run).expect("threads start")
        })
        .collect();
    assert!(digests.iter().all(|d| *d == digests[0]), "{digests:?}");
}

#[test]
fn every_checkpoint_on_the_way_can_be_resumed() {
    let views = views();
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("c.safetensors");
    let end = uninterrupted(Strategy::Inria, &views, &path, 1000).digest().expect("finite");

    /// Copies each new checkpoint aside, as a crash at that moment would leave it.
    struct Copies<'a>(&'a Path, usize);
    impl Watch for Copies<'_> {
        fn lap(&mut self, part: &'static str) {
            if part == "checkpoint" {
                std::fs::copy(self.0, self.0.with_extension(self.1.to_string())).expect("copies");
                self.1 += 1;
            }
        }
    }
    let stop = AtomicBool::new(false);
    let mut fit = new(Strategy::Inria, &views);
    let mut copies = Copies(&path, 0);
    let schedule = Schedule { checkpoint: Some(&path), every: 80, stop: &stop };
    training::run(&mut fit, &mut History::default(), schedule, &mut copies).expect("runs");
    assert_eq!(copies.1, 4, "after 80, 160, 240 and 310 iterations");
    // Leftovers of a write that was cut off do not matter.
    std::fs::write(dir.path().join(".lastlight-x.part"), b"half").expect("writes");
    for i in 0..copies.1 {
        let mut fit = new(Strategy::Inria, &views);
        let mut history = training::resume(&mut fit, &path.with_extension(i.to_string())).expect("complete");
        assert_eq!(history.len(), [80, 160, 240, 310][i], "as many iterations as when it was written");
        let schedule = Schedule { checkpoint: None, every: 1000, stop: &stop };
        training::run(&mut fit, &mut history, schedule, &mut ()).expect("runs");
        assert_eq!(fit.digest().expect("finite"), end, "from checkpoint {i}");
    }
}

#[test]
fn other_settings_or_photographs_are_refused_by_name() {
    let views = views();
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("c.safetensors");
    uninterrupted(Strategy::Inria, &views, &path, 1000);
    let refused = |settings: Settings, views: &Views| {
        let first =
            seeds::gaussians(&Start::Random { count: 400, bounds: None }, views, &settings).expect("valid");
        let mut fit = SplatFit::new(settings, views, first).expect("valid");
        let before = fit.digest().expect("finite");
        let e = training::resume(&mut fit, &path).expect_err("it differs").to_string();
        assert_eq!(fit.digest().expect("finite"), before, "a refused checkpoint changes nothing");
        e
    };
    let base = settings(Strategy::Inria);
    let e = refused(Settings { seed: 12, ..base.clone() }, &views);
    assert!(e.contains("setting: seed: expected 11 as in the checkpoint, got 12"), "{e}");
    let e = refused(Settings { iterations: 311, ..base.clone() }, &views);
    assert!(e.contains("iterations: expected 310"), "{e}");
    let mut other = views.clone();
    other.views[1].rgb[0] ^= 1;
    let e = refused(base.clone(), &other);
    assert!(e.contains("input"), "one changed bit of one photo: {e}");
    let e = refused(Settings { strategy: Strategy::Mcmc, ..base }, &views);
    assert!(e.contains("strategy"), "{e}");
}

#[test]
fn damaged_checkpoints_are_errors() {
    let views = views();
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("c.safetensors");
    uninterrupted(Strategy::Inria, &views, &path, 1000);
    let good = bytes(&path);
    for keep in [0, 7, 8, 100, good.len() / 2, good.len() - 1] {
        std::fs::write(&path, &good[..keep]).expect("writes");
        let mut fit = new(Strategy::Inria, &views);
        let e = training::resume(&mut fit, &path).expect_err("it is cut off");
        assert_eq!(e.exit_code(), 2, "{keep} bytes: {e}");
        assert!(e.to_string().contains("c.safetensors"), "{e}");
    }
    // A parameter that is not a number.
    let file = lastlight::io::safetensors::parse(&good, "c").expect("the good one");
    let mut arrays = file.arrays;
    let mut means = arrays.need("param/means").expect("present").to_f32();
    let shape = [means.len() / 3, 3];
    means[4] = f32::NAN;
    arrays.put("param/means", &shape, means);
    lastlight::io::safetensors::write(&path, &arrays, &file.metadata).expect("writes");
    let mut fit = new(Strategy::Inria, &views);
    assert!(training::resume(&mut fit, &path).is_err(), "NaN is refused");
    assert!(Fit::settings(&fit).is_object(), "the fit is still usable");
}
