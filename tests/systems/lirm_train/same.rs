//! One digest whatever the threads, the parts and the recomputation; resumed or continued is uninterrupted.

use super::{Kept, TINY, settings, whole};
use lastlight::fit::training::{Fit, History, Schedule, resume, run, save};
use lastlight::lirm::model::file::digest;
use lastlight::lirm::model::params::first;
use lastlight::lirm::train::optimizer::Kind;
use lastlight::lirm::train::stage::Stage;
use lastlight::lirm::train::{Settings, Training};
use lastlight::num::order;
use lastlight::num::par::with_threads;
use lastlight::tape::Params;
use std::path::Path;
use std::sync::atomic::AtomicBool;

#[test]
fn every_kind_of_stage_has_one_digest() {
    let source = Kept::new();
    // Few samples: there are ninety-six trainings.
    let settings = |name: &str, steps: usize| {
        let own = settings(name, steps);
        Settings { stage: Stage { samples: 8, ..own.stage }, ..own }
    };
    let plain = first(&TINY, 0);
    let of = |s: Settings| whole(&mut Training::new(s, TINY, Some(&plain), &source).expect("valid"));
    let compared = |points, distances| {
        let own = settings("1a", 5);
        let stage = Stage { points, ..own.stage }.with_distances(distances);
        Settings { stage, ..own }
    };
    let muon = Settings { optimizer: Kind::Muon, ..settings("1a", 5) };
    let distances = compared(0.0, 10.0);
    let shape = Settings { stage: Stage { shape_steps: 3, ..distances.stage.clone() }, ..distances.clone() };
    let own = settings("1b", 5);
    let updates = Settings { stage: own.stage.clone().with_updates(), ..own };
    let changed = Stage { added: 0.5, ..updates.stage.clone() }.with_distances(10.0);
    let changed = Settings { stage: changed, ..updates.clone() };
    // Objects of one to three sets.
    let own = settings("2a", 5);
    let through = Settings { stage: Stage { state_gradient: true, ..own.stage.clone() }, ..own.clone() };
    let last = Settings { stage: Stage { last_set_only: true, ..own.stage.clone() }, ..own.clone() };
    let included = Stage { absolute_albedo: true, ..own.stage.clone().with_updates().with_distances(10.0) };
    let included = Settings { stage: included, optimizer: Kind::Muon, head_rate: 8.0, uses: 3, ..own };
    let kinds = [
        ("1a", settings("1a", 5)),
        ("1a with surface points", compared(10.0, 0.0)),
        ("1a with signed distances", distances),
        ("1a with signed distances alone in three steps", shape),
        ("1a with Muon", muon),
        ("1b with draws for the second set", updates),
        ("1b with objects that are added", changed),
        ("2a with gradients through the state", through),
        ("2a with the last set alone", last),
        ("2a with the options of the included weights", included),
        ("1a, averaged over three steps", Settings { average_last: 3, ..settings("1a", 5) }),
        ("2a", settings("2a", 5)),
        ("3", settings("3", 5)),
    ];
    let mut all = Vec::new();
    for (name, own) in kinds {
        let usual = of(own.clone());
        assert_eq!(of(Settings { recompute: true, ..own.clone() }), usual, "{name}: blocks run again");
        assert_eq!(of(Settings { at_once: 1, ..own.clone() }), usual, "{name}: one object after the other");
        for threads in [1, 2, 3, 7] {
            let found = with_threads(threads, || of(own.clone())).expect("threads start");
            assert_eq!(found, usual, "{name}: {threads} threads");
        }
        let both = Settings { recompute: true, at_once: 1, ..own };
        assert_eq!(with_threads(3, || of(both)).expect("threads start"), usual, "{name}: all of it");
        all.push(usual);
    }
    all.push(of(Settings { seed: 1, ..settings("1a", 5) }));
    all.sort();
    all.dedup();
    assert_eq!(all.len(), 14, "each kind has other weights, and so have other draws");
}

#[test]
fn a_resumed_training_is_the_uninterrupted_one() {
    let source = Kept::new();
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("checkpoint");
    let kinds = [("1a", Kind::AdamW), ("1a", Kind::Muon), ("2a", Kind::AdamW), ("3", Kind::AdamW)];
    for (stage, optimizer) in kinds {
        let own = Settings { optimizer, ..settings(stage, 4) };
        let made = || Training::new(own.clone(), TINY, None, &source).expect("valid");
        let usual = whole(&mut made());
        let stop = AtomicBool::new(true);
        let (mut training, mut history) = (made(), History::default());
        let schedule = Schedule { checkpoint: Some(&path), every: 1000, stop: &stop };
        run(&mut training, &mut history, schedule, &mut ()).expect_err("it is stopped after a step");
        let mut training = made();
        let mut history = resume(&mut training, &path).expect("its checkpoint");
        assert_eq!(history.len(), 1);
        let stop = AtomicBool::new(false);
        let schedule = Schedule { checkpoint: None, every: 1000, stop: &stop };
        run(&mut training, &mut history, schedule, &mut ()).expect("finite");
        assert_eq!(digest(training.params()), usual, "stage {stage} with {}", optimizer.name());
        let changed = |change: &dyn Fn(&mut Stage)| {
            let mut other = own.clone();
            change(&mut other.stage);
            other
        };
        let others = [
            ("batch", Settings { batch: 1, ..own.clone() }),
            ("added", changed(&|stage| stage.added = 0.5)),
            ("state_gradient", changed(&|stage| stage.state_gradient = true)),
            ("last_set_only", changed(&|stage| stage.last_set_only = true)),
            ("normal_weight", changed(&|stage| stage.normal_weight = 2.0)),
            (
                "optimizer",
                Settings {
                    optimizer: if optimizer == Kind::Muon { Kind::AdamW } else { Kind::Muon },
                    ..own.clone()
                },
            ),
        ];
        for (name, other) in others {
            let mut other = Training::new(other, TINY, None, &source).expect("valid");
            let e = resume(&mut other, &path).expect_err("another setting").to_string();
            assert!(e.contains(name), "{e}");
        }
    }
}

#[test]
fn a_stage_goes_on_after_its_first_part() {
    let source = Kept::new();
    let made = |from| Training::new(settings("1a", 40), TINY, from, &source).expect("valid");
    let mut usual = made(None);
    let losses: Vec<f32> = (0..4).map(|i| usual.step(i, &mut ()).expect("finite").loss).collect();

    let mut one = made(None);
    one.stop_after(3).expect("a step of the stage");
    assert_eq!(one.iterations(), 3);
    whole(&mut one);
    let part = one.part();
    assert_eq!((part.range, part.is_last(), part.label()), ([0, 3], false, "1a to step 3 of 40".to_owned()));

    let mut two = made(Some(one.params()));
    two.continue_from(&part).expect("the same settings");
    assert_eq!(two.iterations(), 37);
    let before = two.params().clone();
    let step = two.step(0, &mut ()).expect("finite");
    assert_eq!(step.loss, losses[3], "the draws and the 1/β of the step of the whole stage");
    let moved = two.params().get("norm/gain").expect("an array");
    let largest = before.get("norm/gain").expect("an array").iter().zip(moved).map(|(a, b)| (a - b).abs());
    let largest = largest.fold(0.0, order::max);
    assert!(
        (largest - 5e-4 / 20.0).abs() < 2e-6,
        "the first step of a rate that rises over twenty: {largest}"
    );

    for last in [0, 3, 41] {
        let e = two.stop_after(last).expect_err("made already, or not a step").to_string();
        assert!(e.contains("--until") && e.contains("4 to 40"), "{e}");
    }
    let shape = Stage { shape_steps: 40, ..settings("1a", 40).stage.with_distances(1.0) };
    let changed = |change: &dyn Fn(&mut Stage)| {
        let mut own = settings("1a", 40);
        change(&mut own.stage);
        own
    };
    for (name, other) in [
        ("--seed", Settings { seed: 1, ..settings("1a", 40) }),
        ("--iterations", settings("1a", 41)),
        ("--objects-at-once", Settings { block: 3, ..settings("1a", 40) }),
        ("--uses", Settings { uses: 4, ..settings("1a", 40) }),
        ("--optimizer", Settings { optimizer: Kind::Muon, ..settings("1a", 40) }),
        ("--rate", Settings { stage: settings("1a", 40).stage.with_rate(1e-3), ..settings("1a", 40) }),
        ("--room", changed(&|stage| stage.room = 0.0)),
        ("--tint", changed(&|stage| stage.tint = [0.0; 2])),
        ("--shape-steps", Settings { stage: shape, ..settings("1a", 40) }),
        ("--head-rate", Settings { head_rate: 2.0, ..settings("1a", 40) }),
        ("--updates", Settings { stage: settings("1a", 40).stage.with_updates(), ..settings("1a", 40) }),
        ("--added", changed(&|stage| stage.added = 0.5)),
        ("--state-gradient", changed(&|stage| stage.state_gradient = true)),
        ("--last-set-only", changed(&|stage| stage.last_set_only = true)),
        ("--normal-weight", changed(&|stage| stage.normal_weight = 2.0)),
    ] {
        let mut other = Training::new(other, TINY, Some(one.params()), &source).expect("valid");
        let e = other.continue_from(&part).expect_err("another setting").to_string();
        assert!(e.contains(name) && e.contains("part before of stage 1a"), "{e}");
    }
    let begun = |settings| Training::new(settings, TINY, Some(one.params()), &source);
    let part = begun(settings("2a", 40)).expect("valid").part();
    for (name, change) in [
        ("--material-weight", (|stage| Stage { material: 10.0, ..stage }) as fn(Stage) -> Stage),
        ("--absolute-albedo", |stage| Stage { absolute_albedo: true, ..stage }),
    ] {
        let changed = |name| {
            let own = settings(name, 40);
            Settings { stage: change(own.stage.clone()), ..own }
        };
        let e = begun(changed("2a")).expect("valid").continue_from(&part).expect_err("another setting");
        let e = e.to_string();
        assert!(e.contains(name) && e.contains("part before of stage 2a"), "{e}");
        let e = begun(changed("1a")).map(|_| ()).expect_err("no albedo, no materials").to_string();
        assert!(e.contains(name) && e.contains("stages 2a to 3"), "{e}");
    }
}

/// Writes a checkpoint after some steps.
fn stopped(training: &mut Training<'_>, steps: usize, path: &Path) {
    let mut history = History::default();
    for i in 0..steps {
        let step = training.step(i, &mut ()).expect("finite");
        history.loss.push(step.loss);
        history.size.push(2);
    }
    save(training, &history, path).expect("written");
}

#[test]
fn the_result_can_be_the_mean_over_the_last_steps() {
    let source = Kept::new();
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("checkpoint");
    let own = Settings { average_last: 3, ..settings("1a", 6) };
    let made = |own: &Settings| Training::new(own.clone(), TINY, None, &source).expect("valid");
    let mut plain = made(&settings("1a", 6));
    let mut averaged = made(&own);
    let mut after = Vec::new();
    for i in 0..6 {
        let losses = [&mut plain, &mut averaged].map(|t| t.step(i, &mut ()).expect("finite").loss);
        assert_eq!(losses[0], losses[1], "the steps do not change");
        after.push(plain.params().clone());
        if i < 3 {
            assert_eq!(averaged.params(), plain.params(), "nothing is averaged yet");
        }
    }
    for (name, mean) in averaged.params().iter() {
        let of = |i: usize| after[i].get(name).expect("an array").iter();
        for (((m, a), b), c) in mean.iter().zip(of(3)).zip(of(4)).zip(of(5)) {
            let expected = (f64::from(*a) + f64::from(*b) + f64::from(*c)) / 3.0;
            assert!(
                (f64::from(*m) - expected).abs() <= 3e-7 * expected.abs() + 1e-9,
                "{name}: {m} {expected}"
            );
        }
    }
    // Stopped after every number of steps and resumed, it is the same mean.
    for last in 1..6 {
        let mut one = made(&own);
        stopped(&mut one, last, &path);
        let mut two = made(&own);
        let mut history = resume(&mut two, &path).expect("its checkpoint");
        let stop = AtomicBool::new(false);
        run(&mut two, &mut history, Schedule { checkpoint: None, every: 1000, stop: &stop }, &mut ())
            .expect("finite");
        assert_eq!(digest(two.params()), digest(averaged.params()), "resumed after {last}");
    }
    // A checkpoint whose mean is over other steps: of a longer part, which goes on, or of none yet.
    let own = Settings { average_last: 3, ..settings("1a", 9) };
    for (until, then, fits) in [
        (4, 9, Ok(())),
        (4, 6, Err("4, or 7 or more")),
        (7, 6, Err("7, or 9 or more")),
        (8, 9, Err("8:")),
        (9, 5, Err("8 or more")),
        (9, 8, Err("9:")),
    ] {
        let mut one = made(&own);
        if until < 9 {
            one.stop_after(until).expect("a step");
        }
        let done = Ord::min(until, then);
        stopped(&mut one, done, &path);
        let mut two = made(&own);
        if then < 9 {
            two.stop_after(then).expect("a step");
        }
        match (resume(&mut two, &path), fits) {
            (Ok(history), Ok(())) => assert_eq!(history.len(), done),
            (Err(e), Err(text)) => {
                let e = e.to_string();
                assert!(e.contains("--until") && e.contains(text), "{until} to {then}: {e}");
            }
            (found, _) => panic!("{until} to {then}: {found:?}"),
        }
    }
    let e = Training::new(Settings { average_last: 10, ..own.clone() }, TINY, None, &source)
        .expect_err("too many");
    assert!(e.to_string().contains("--average-last"), "{e}");
}

#[test]
fn the_result_can_keep_a_share_of_the_start() {
    let source = Kept::new();
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("checkpoint");
    let begun = first(&TINY, 0);
    let made = |share| {
        let own = Settings { start_share: share, average_last: 2, ..settings("1b", 3) };
        Training::new(own, TINY, Some(&begun), &source)
    };
    let (mut trained, mut mixed) = (made(0.0).expect("valid"), made(0.25).expect("valid"));
    stopped(&mut trained, 3, &path);
    whole(&mut mixed);
    assert_eq!(mixed.params(), trained.params(), "the steps do not change");
    assert_eq!(&trained.result(), trained.params());
    let result = mixed.result();
    for (name, found) in result.iter() {
        let of = |all: &Params| all.get(name).expect("an array").clone();
        for ((x, w0), w) in found.iter().zip(&of(&begun)).zip(&of(trained.params())) {
            assert_eq!(*x, (0.25 * f64::from(*w0) + 0.75 * f64::from(*w)) as f32, "{name}");
        }
    }
    assert_eq!((mixed.part().start_share, trained.part().start_share), (Some(0.25), None));
    // A training that has ended has another share without a further step.
    let mut again = made(0.25).expect("valid");
    resume(&mut again, &path).expect("the checkpoint of the one without a share");
    assert_eq!(again.result(), result);
    for share in [-0.1, 1.0, f64::NAN] {
        let e = made(share).map(|_| ()).expect_err("no share").to_string();
        assert!(e.contains("--start-share"), "{e}");
    }
}
