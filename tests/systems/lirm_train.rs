//! Training of LIRM on a miniature: one digest whatever the threads, parts and recomputation; resumed is uninterrupted; it learns.

use lastlight::fit::training::{Fit, History, Schedule, resume, run, save};
use lastlight::lirm::r#gen::{self as set, Version};
use lastlight::lirm::model::config::Config;
use lastlight::lirm::model::file::digest;
use lastlight::lirm::model::params::{extended, first};
use lastlight::lirm::train::distances::Distances;
use lastlight::lirm::train::optimizer::{Kind, LATER};
use lastlight::lirm::train::source::{BuiltInObjects, Scene, Source};
use lastlight::lirm::train::stage::{Stage, USES};
use lastlight::lirm::train::stored::StoredSet;
use lastlight::lirm::train::{Settings, Training};
use lastlight::lirm::views::Views;
use lastlight::num::array::Arrays;
use lastlight::num::order;
use lastlight::num::par::with_threads;
use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

/// Objects that are rendered once for all trainings of a test.
#[derive(Debug)]
struct Kept {
    of: BuiltInObjects,
    made: Mutex<BTreeMap<(u64, Version), Views>>,
    added: Mutex<BTreeMap<(u64, Version, bool), [Scene; 2]>>,
}

impl Kept {
    fn new() -> Self {
        Self { of: BuiltInObjects::new(0), made: Mutex::default(), added: Mutex::default() }
    }
}

impl Source for Kept {
    fn object(&self, k: u64, version: Version) -> lastlight::Result<Views> {
        let mut made = self.made.lock().expect("no panic");
        if let Some(views) = made.get(&(k, version)) {
            return Ok(views.clone());
        }
        let views = self.of.object(k, version)?;
        made.insert((k, version), views.clone());
        Ok(views)
    }

    fn distances(&self, k: u64) -> lastlight::Result<Distances> {
        self.of.distances(k)
    }

    fn record(&self) -> String {
        self.of.record()
    }

    fn added(&self, k: u64, version: Version, is_compared: bool) -> lastlight::Result<[Scene; 2]> {
        let mut made = self.added.lock().expect("no panic");
        if let Some(scenes) = made.get(&(k, version, is_compared)) {
            return Ok(scenes.clone());
        }
        let scenes = self.of.added(k, version, is_compared)?;
        made.insert((k, version, is_compared), scenes.clone());
        Ok(scenes)
    }
}

const TINY: Config =
    Config { blocks: 2, width: 16, heads: 2, plane_tokens: 2, embed_tokens: 2, channels: 4, ..Config::SMALL };

fn settings(stage: &str, steps: usize) -> Settings {
    let stage = Stage::named(stage).expect("a name");
    let stage = Stage { steps, samples: 24, rise: 2, target: [64, 16], ..stage };
    Settings {
        stage,
        optimizer: Kind::AdamW,
        head_rate: 1.0,
        seed: 0,
        batch: 2,
        block: 2,
        uses: USES,
        at_once: 2,
        recompute: false,
        average_last: 0,
    }
}

fn whole(training: &mut Training<'_>) -> String {
    let (mut history, stop) = (History::default(), AtomicBool::new(false));
    let schedule = Schedule { checkpoint: None, every: 1000, stop: &stop };
    run(training, &mut history, schedule, &mut ()).expect("finite");
    digest(training.params())
}

#[test]
fn every_kind_of_stage_has_one_digest() {
    let source = Kept::new();
    // Few samples: there are eighty-nine trainings.
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
    let last = Settings { stage: Stage { last_set_only: true, ..own.stage.clone() }, ..own };
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
    assert_eq!(all.len(), 13, "each kind has other weights, and so have other draws");
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
        let mut history = History::default();
        for i in 0..last {
            let step = one.step(i, &mut ()).expect("finite");
            history.loss.push(step.loss);
            history.size.push(2);
        }
        save(&one, &history, &path).expect("written");
        let mut two = made(&own);
        let mut history = resume(&mut two, &path).expect("its checkpoint");
        let stop = AtomicBool::new(false);
        run(&mut two, &mut history, Schedule { checkpoint: None, every: 1000, stop: &stop }, &mut ())
            .expect("finite");
        assert_eq!(digest(two.params()), digest(averaged.params()), "resumed after {last}");
    }
    // The mean of another number of steps has begun already, or not yet.
    let mut one = made(&own);
    one.stop_after(4).expect("a step");
    whole(&mut one);
    let mut state = Arrays::new();
    one.save(&mut state);
    let mut two = made(&own);
    two.load(&state).expect("its weights");
    let e = two.step(4, &mut ()).expect_err("step 4 is missing").to_string();
    assert!(e.contains("--until"), "{e}");
    let e = Training::new(Settings { average_last: 7, ..own.clone() }, TINY, None, &source)
        .expect_err("too many");
    assert!(e.to_string().contains("--average-last"), "{e}");
}

#[test]
fn heads_of_stage_2_have_a_rate_of_their_own() {
    let source = Kept::new();
    let plain = first(&TINY, 0);
    let (begun, _) = extended(&plain, &TINY, 0).expect("a plain model");
    let after = |head_rate: f64| {
        let own = Settings { head_rate, ..settings("2a", 1) };
        let mut training = Training::new(own, TINY, Some(&plain), &source).expect("valid");
        training.step(0, &mut ()).expect("finite");
        training.params().clone()
    };
    let [one, eight] = [1.0, 8.0].map(after);
    let mut moved = 0;
    for (name, array) in one.iter() {
        let [one, eight, begun] =
            [array, eight.get(name).expect("an array"), begun.get(name).expect("an array")];
        if !LATER.iter().any(|head| name.starts_with(head)) {
            assert_eq!(one, eight, "{name}: all others have the rate of the stage");
            continue;
        }
        for ((a, b), w) in one.iter().zip(eight).zip(begun) {
            let [a, b] = [a, b].map(|x| f64::from(*x) - f64::from(*w));
            assert!((b - 8.0 * a).abs() <= 1e-6 * (1.0 + f64::from(w.abs())), "{name}: {a} {b}");
            moved += usize::from(a != 0.0);
        }
    }
    assert!(moved > 100, "the heads move: {moved}");
    for head_rate in [0.0, -1.0, f64::NAN, 1e4] {
        let own = Settings { head_rate, ..settings("2a", 1) };
        let e = Training::new(own, TINY, Some(&plain), &source).expect_err("no rate").to_string();
        assert!(e.contains("--head-rate"), "{e}");
    }
}

#[test]
fn it_learns() {
    let source = Kept::new();
    for optimizer in [Kind::AdamW, Kind::Muon] {
        let mut s = Settings { optimizer, ..settings("1a", 60) };
        s.stage.rates = [5e-3, 5e-3];
        // Objects in the middle of the box: where others are, so small a model does not find out.
        s.stage.room = 0.0;
        let mut training = Training::new(s, TINY, None, &source).expect("valid");
        let losses: Vec<f32> = (0..60).map(|i| training.step(i, &mut ()).expect("finite").loss).collect();
        let mean = |x: &[f32]| x.iter().fold(0.0, |s, x| s + x) / x.len() as f32;
        let [before, after] = [mean(&losses[..10]), mean(&losses[50..])];
        assert!(after < 0.7 * before, "{}: {before} {after}", optimizer.name());
    }
}

/// The first moments after one step are a tenth of the gradients, and no array's gradient is longer than 1.
#[test]
fn the_gradient_of_every_array_is_clipped_by_itself() {
    let source = Kept::new();
    let own = settings("1a", 1);
    let lengths = |distances: f32| -> BTreeMap<String, f64> {
        let stage = Stage { distances, inverse_beta: [30.0, 120.0], ..own.stage.clone() };
        let mut training =
            Training::new(Settings { stage, ..own.clone() }, TINY, None, &source).expect("valid");
        training.step(0, &mut ()).expect("finite");
        let mut state = Arrays::new();
        training.save(&mut state);
        let names = training.params().iter().map(|(name, _)| name.to_owned());
        let length = |name: &str| {
            let m = state.get(&format!("adam/{name}.m")).expect("a first moment");
            10.0 * m.to_f32().iter().fold(0.0, |s, x| s + f64::from(*x) * f64::from(*x)).sqrt()
        };
        names.map(|name| (name.clone(), length(&name))).collect()
    };
    let [weak, strong] = [1.0, 1e4].map(lengths);
    assert!(strong.values().all(|x| *x < 1.0 + 1e-5), "none is longer: {strong:?}");
    let cut = strong.values().filter(|x| **x > 1.0 - 1e-5).count();
    assert!(cut > 5 && cut < strong.len(), "many are cut, each by itself: {cut} of {}", strong.len());
    let whole = weak.values().filter(|x| **x > 0.0 && **x < 0.99).count();
    assert!(whole > 5, "shorter ones keep their length: {weak:?}");
}

#[test]
fn without_renders_it_learns_the_shape_alone() {
    let source = Kept::new();
    let mut s = settings("1a", 20);
    s.stage = Stage { rates: [5e-3, 5e-3], room: 0.0, shape_steps: 20, ..s.stage.with_distances(60.0) };
    let mut training = Training::new(s.clone(), TINY, None, &source).expect("valid");
    let before = training.params().clone();
    let losses: Vec<f32> = (0..20).map(|i| training.step(i, &mut ()).expect("finite").loss).collect();
    let mean = |x: &[f32]| x.iter().fold(0.0, |s, x| s + x) / x.len() as f32;
    assert!(mean(&losses[15..]) < 0.7 * mean(&losses[..5]), "{losses:?}");
    // An array without a gradient loses 0.05 of the rate in every step.
    let decay = 20.0 * 0.05 * 5e-3;
    let moved = |name: &str| {
        let [a, b] = [&before, training.params()].map(|p| p.get(name).expect("an array"));
        let pairs = a.iter().zip(b).map(|(a, b)| (f64::from(*a) - f64::from(*b)).abs() / f64::from(a.abs()));
        pairs.fold(0.0, order::max)
    };
    for name in ["heads/color/0", "heads/normal/0"] {
        // The rate rises in the first of the twenty steps.
        let share = moved(name) / decay;
        assert!((0.95..1.01).contains(&share), "{name} decays: {share} of it");
    }
    assert!(moved("heads/sdf/0") > 2.0 * decay, "{}", moved("heads/sdf/0"));
    for (distances, shape_steps) in [(0.0, 20), (60.0, 21)] {
        let stage = Stage { distances, shape_steps, ..s.stage.clone() };
        let e = stage.validate().expect_err("nothing to compare, or more than all steps").to_string();
        assert!(e.contains("--shape-steps"), "{e}");
    }
    let later = Stage { shape_steps: 1, ..s.stage.clone() };
    let mut training = Training::new(Settings { stage: later, ..s }, TINY, None, &source).expect("valid");
    let [first, second] = [0, 1].map(|i| training.step(i, &mut ()).expect("finite").loss);
    assert_eq!(first, losses[0]);
    assert!(second > losses[1] + 0.3, "with renders: {second} {}", losses[1]);
}

#[test]
fn a_later_stage_needs_the_arrays_of_the_one_before() {
    let source = Kept::new();
    let other = first(&Config { blocks: 1, ..TINY }, 0);
    let e = Training::new(settings("2a", 1), TINY, Some(&other), &source).expect_err("a block is missing");
    assert!(e.to_string().contains("block/01"), "{e}");
}

#[test]
fn objects_of_a_set_are_those_in_memory() {
    let dir = tempfile::tempdir().expect("a folder");
    let of = BuiltInObjects::new(0);
    let settings = set::Settings { lighting: set::Lighting::Uniform, shiny: false, ..of.settings().clone() };
    let [stage, whole] = ["1a", "2a"].map(|name| Stage::named(name).expect("a stage"));
    let e = StoredSet::open(dir.path(), &stage).expect_err("an empty folder").to_string();
    assert!(e.contains("dataset.json"), "{e}");
    set::run(dir.path(), &settings, false, &AtomicBool::new(false), &mut |_, _, _| {}).expect("a set");
    let stored = StoredSet::open(dir.path(), &stage).expect("a set");
    let e = StoredSet::open(dir.path(), &whole).expect_err("no maps").to_string();
    assert!(e.contains("environment") && e.contains("--lighting both"), "{e}");
    let e = StoredSet::open(dir.path(), &Stage { added: 0.5, ..stage.clone() }).expect_err("one scene each");
    assert!(e.to_string().contains("--added"), "{e}");
    assert!(stored.added(0, Version::Uniform, false).is_err());
    let [a, b] = [stored.object(3, Version::Uniform), of.object(0, Version::Uniform)]
        .map(|x| x.expect("object 3 mod 1"));
    let colors = |views: &Views| views.all.iter().map(|v| v.picture.color.clone()).collect::<Vec<_>>();
    assert_eq!(colors(&a), colors(&b));
    assert_eq!(a.placement, b.placement);
    assert!(stored.object(0, Version::Shiny).is_err(), "the set has no such version");
    assert_eq!(stored.distances(0).expect("its mesh"), of.distances(0).expect("the same"));
    let drawn = of.settings();
    assert_eq!((drawn.views, drawn.size, drawn.samples, drawn.seed), (20, 128, 8, 0), "as `lirm gen`");
    // Its files are trained with as objects in memory are, but for the last places of cameras.
    let one = Settings { batch: 1, block: 1, ..self::settings("1a", 1) };
    let [a, b] = [&stored as &dyn Source, &of].map(|source| {
        let mut training = Training::new(one.clone(), TINY, None, source).expect("valid");
        training.step(0, &mut ()).expect("finite").loss
    });
    assert!((a - b).abs() < 1e-4 * b, "{a} and {b}");
    // Images that are missing, and passes that a stage compares.
    let image = dir.path().join("object_00000/uniform/images/0007.png");
    std::fs::rename(&image, dir.path().join("away.png")).expect("moved");
    let e = stored.object(0, Version::Uniform).expect_err("nineteen images").to_string();
    assert!(e.contains("0007.png"), "{e}");
    std::fs::rename(dir.path().join("away.png"), &image).expect("moved");
    let record = dir.path().join("dataset.json");
    let text = std::fs::read_to_string(&record).expect("its record");
    let parsed: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    for (key, value, stage) in [
        ("passes", serde_json::json!(false), stage.clone()),
        ("passes", serde_json::json!(["normal"]), Stage { points: 10.0, ..stage.clone() }),
        ("truth", serde_json::json!(false), stage.clone().with_distances(10.0)),
    ] {
        let mut changed = parsed.clone();
        changed["settings"][key] = value;
        std::fs::write(&record, changed.to_string()).expect("written");
        let e = StoredSet::open(dir.path(), &stage).expect_err("nothing to compare with").to_string();
        assert!(e.contains("which stage 1a compares") || e.contains("--distances"), "{e}");
    }
    std::fs::write(&record, text.replace("\"object_00000\"", "\"../object_00000\"")).expect("written");
    let e = StoredSet::open(dir.path(), &stage).expect_err("a folder outside").to_string();
    assert!(e.contains("leads out of the folder"), "{e}");
    std::fs::write(&record, text).expect("written");
    let small = dir.path().join("small");
    let settings = set::Settings { views: 2, size: 16, samples: 1, ..settings };
    set::run(&small, &settings, false, &AtomicBool::new(false), &mut |_, _, _| {}).expect("a set");
    let e = StoredSet::open(&small, &stage).expect_err("two images").to_string();
    assert!(e.contains("20 images of 128x128"), "{e}");
}
