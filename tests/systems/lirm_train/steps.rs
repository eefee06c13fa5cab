//! What a step does: rates, clipped gradients, the shape alone; what is refused; it learns.

use super::{Kept, TINY, settings};
use lastlight::fit::training::Fit;
use lastlight::lirm::r#gen::{self as set, Version};
use lastlight::lirm::model::config::Config;
use lastlight::lirm::model::params::{extended, first};
use lastlight::lirm::train::optimizer::{Kind, LATER};
use lastlight::lirm::train::source::{BuiltInObjects, Source};
use lastlight::lirm::train::stage::Stage;
use lastlight::lirm::train::stored::StoredSet;
use lastlight::lirm::train::{Settings, Training};
use lastlight::lirm::views::Views;
use lastlight::num::array::Arrays;
use lastlight::num::order;
use std::collections::BTreeMap;
use std::sync::atomic::AtomicBool;

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
    assert_eq!(stored.seed(), Some(0), "built-in objects");
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
