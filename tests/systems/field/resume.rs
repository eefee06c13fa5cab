//! Interrupted fits end with the bytes of uninterrupted ones; checkpoints of other fits and damaged ones are refused.

use super::{digest, finish, new, settings, targets};
use crate::ball;
use lastlight::fit::field::{Beta, FieldFit, Materials, Settings, Targets};
use lastlight::fit::training::{self, Fit, History, Schedule, Step, Watch};
use lastlight::io::safetensors;
use lastlight::num::array::Arrays;
use lastlight::num::par;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Stops when `at` iterations are complete.
struct StopAt<'a>(usize, &'a AtomicBool);

impl Watch for StopAt<'_> {
    fn progress(&mut self, done: usize, _total: usize, _step: Step) {
        self.1.store(done == self.0, Ordering::Relaxed);
    }
}

#[test]
fn a_fit_interrupted_anywhere_ends_with_the_same_bytes() {
    let with_passes = targets();
    let photos = ball::without_passes(targets());
    let kinds = [
        // Before and after planes grow, at and between fills of the grid.
        (&with_passes, Settings { embedding: true, ..settings() }, &[1, 15, 16, 17, 24, 25, 26, 33, 49][..]),
        // A light and 1/β are in the checkpoint too.
        (
            &photos,
            Settings {
                materials: Materials::Shaded,
                beta: Beta::Learned,
                crops: 1,
                iterations: 20,
                ..settings()
            },
            &[3, 10][..],
        ),
    ];
    let dir = tempfile::tempdir().expect("a temporary folder");
    for (targets, settings, stops) in kinds {
        let [whole, parts] = ["whole", "parts"].map(|n| dir.path().join(format!("{n}.safetensors")));
        let mut fit = new(settings.clone(), targets);
        finish(&mut fit, &mut History::default(), Some(&whole));
        let end = (digest(&fit), fit.field().digest().expect("finite"));

        let mut history = History::default();
        let mut fit = new(settings.clone(), targets);
        for (i, at) in stops.iter().copied().enumerate() {
            let stop = AtomicBool::new(false);
            let schedule = Schedule { checkpoint: Some(&parts), every: 1000, stop: &stop };
            let e = par::with_threads(1 + i % 3, || {
                training::run(&mut fit, &mut history, schedule, &mut StopAt(at, &stop))
            })
            .expect("threads start")
            .expect_err("it was stopped");
            assert_eq!(e.exit_code(), 130, "{e}");
            fit = new(settings.clone(), targets);
            history = training::resume(&mut fit, &parts).expect("the checkpoint is complete");
            assert_eq!(history.len(), at, "it continues where it stopped");
        }
        finish(&mut fit, &mut history, Some(&parts));
        let bytes = |path: &Path| std::fs::read(path).expect("written");
        assert!(bytes(&whole) == bytes(&parts), "checkpoints");
        assert_eq!((digest(&fit), fit.field().digest().expect("finite")), end, "fits");

        // The field of a fit that is resumed after its end is the field that was written.
        let mut fit = new(settings, targets);
        training::resume(&mut fit, &whole).expect("a checkpoint of the end");
        assert_eq!(fit.field().digest().expect("finite"), end.1, "the settings of the last iteration, too");
    }
}

/// A short fit with its checkpoint.
fn stored(path: &Path, targets: &Targets) -> Settings {
    let settings = Settings { iterations: 3, crops: 1, ..settings() };
    finish(&mut new(settings.clone(), targets), &mut History::default(), Some(path));
    settings
}

#[test]
fn other_settings_or_images_are_refused_by_name() {
    let targets = targets();
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("c.safetensors");
    let base = stored(&path, &targets);
    let refused = |mut fit: FieldFit<'_>| {
        let before = digest(&fit);
        let e = training::resume(&mut fit, &path).expect_err("it differs").to_string();
        assert_eq!(digest(&fit), before, "a refused checkpoint changes nothing");
        e
    };
    let with = |settings: Settings| refused(new(settings, &targets));
    for (settings, name) in [
        (Settings { seed: 5, ..base.clone() }, "seed: expected 4 as in the checkpoint, got 5"),
        (Settings { iterations: 4, ..base.clone() }, "iterations: expected 3"),
        (Settings { side: 24, ..base.clone() }, "side: expected 16"),
        (Settings { eikonal: 0.5, ..base.clone() }, "eikonal"),
        (Settings { variation: 0.5, ..base.clone() }, "variation"),
        (Settings { inverse_beta: [20.0, 90.0], ..base.clone() }, "inverse_beta"),
        (Settings { beta: Beta::Learned, ..base.clone() }, "beta: expected \"linear\""),
        (Settings { embedding: true, ..base.clone() }, "embedding"),
        (Settings { materials: Materials::Off, ..base.clone() }, "materials"),
    ] {
        let e = with(settings);
        assert!(e.contains(name) && e.contains("c.safetensors"), "'{name}' in '{e}'");
    }
    // The chunk changes no bit.
    let mut fit = new(Settings { chunk: 64, ..base.clone() }, &targets);
    assert_eq!(training::resume(&mut fit, &path).expect("the same fit").len(), 3, "with another chunk");
    let mut other = targets.clone();
    other.train[1].color[7] += 1e-3;
    let e = refused(new(base.clone(), &other));
    assert!(e.contains("input"), "another image: {e}");
    let mut other = targets.clone();
    other.train[1].normal.as_mut().expect("a pass")[0] = 0.5;
    let e = refused(new(base.clone(), &other));
    assert!(e.contains("input"), "another pass: {e}");
    let mut other = targets.clone();
    other.train[0].camera.translation[0] += 1e-4;
    let e = refused(new(base.clone(), &other));
    assert!(e.contains("input"), "another camera: {e}");

    // Another light, known or learned.
    let photos = ball::without_passes(targets.clone());
    let shaded = Settings { materials: Materials::Shaded, ..base };
    let lit = |radiance: f32| {
        let map = vec![[radiance; 3]; 512];
        FieldFit::new(shaded.clone(), &photos, None, Some(map)).expect("valid settings")
    };
    finish(&mut lit(1.0), &mut History::default(), Some(&path));
    let e = refused(lit(0.5));
    assert!(e.contains("light: expected \"known "), "another map: {e}");
    let e = refused(new(shaded.clone(), &photos));
    assert!(e.contains("light: expected \"known ") && e.contains("learned"), "a learned light: {e}");
}

#[test]
fn shading_reads_no_pass() {
    let with_passes = targets();
    let photos = ball::without_passes(targets());
    let s = Settings { materials: Materials::Shaded, embedding: true, iterations: 12, ..settings() };
    let [one, other] = [&with_passes, &photos].map(|targets| {
        let mut fit = new(s.clone(), targets);
        finish(&mut fit, &mut History::default(), None);
        fit.field().digest().expect("finite")
    });
    assert_eq!(one, other, "materials come from the images alone, also where there are passes");
}

#[test]
fn damaged_checkpoints_are_errors() {
    let targets = targets();
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("c.safetensors");
    let settings = stored(&path, &targets);
    let good = std::fs::read(&path).expect("written");
    for keep in [0, 7, 8, 100, good.len() / 2, good.len() - 1] {
        std::fs::write(&path, &good[..keep]).expect("writes");
        let e = training::resume(&mut new(settings.clone(), &targets), &path).expect_err("it is cut off");
        assert_eq!(e.exit_code(), 2, "{keep} bytes: {e}");
        assert!(e.to_string().contains("c.safetensors"), "{e}");
    }
    let file = safetensors::parse(&good, "c").expect("the good one");
    let mut arrays = file.arrays.clone();
    let planes = arrays.need("param/planes").expect("stored");
    let (shape, mut values) = (planes.shape().to_vec(), planes.to_f32());
    values[3] += 1.0;
    arrays.put("param/planes", &shape, values);
    safetensors::write(&path, &arrays, &file.metadata).expect("writes");
    let e = training::resume(&mut new(settings.clone(), &targets), &path).expect_err("changed").to_string();
    assert!(e.contains("digest of the arrays"), "a changed number: {e}");

    // Below the digest: what `load` itself refuses.
    let refused = |change: &dyn Fn(&mut Arrays)| {
        let mut arrays = file.arrays.clone();
        change(&mut arrays);
        let mut fit = new(settings.clone(), &targets);
        let before = digest(&fit);
        let e = fit.load(&arrays).expect_err("damaged").to_string();
        assert_eq!(digest(&fit), before, "nothing changed: {e}");
        e
    };
    let entry = |name: &'static str, value: f32| {
        refused(&move |all: &mut Arrays| {
            let array = all.need(name).expect("stored");
            let (shape, mut values) = (array.shape().to_vec(), array.to_f32());
            values[0] = value;
            all.put(name, &shape, values);
        })
    };
    for name in ["param/planes", "param/heads/sdf/0", "adam/planes.m"] {
        let e = entry(name, f32::NAN);
        assert!(e.contains(name), "NaN in {name}: {e}");
    }
    assert!(
        entry("render/inverse_beta", -1.0).contains("render/inverse_beta"),
        "a number that is not positive"
    );
    assert!(entry("render/samples", 3.0).contains("render/samples"), "no stage has it");
    for name in ["param/planes", "param/heads/color/1", "adam/planes.v", "occupied", "render/samples"] {
        let e = refused(&|all: &mut Arrays| {
            all.0.remove(name);
        });
        assert!(e.contains(name), "without {name}: {e}");
    }
    for (name, shape) in [
        ("param/planes", &[6, 7, 7, 4][..]),
        ("param/planes", &[6, 100_000, 1, 1]),
        ("param/planes", &[3, 16, 16, 4]),
        ("param/heads/sdf/0", &[32, 11]),
        ("occupied", &[17]),
    ] {
        let e = refused(&|all: &mut Arrays| {
            let size = shape.iter().fold(1, |n: usize, k: &usize| usize::saturating_mul(n, *k));
            all.put(name, shape, vec![0.0_f32; size]);
        });
        assert!(e.contains(name), "{name} as {shape:?}: {e}");
    }
}
