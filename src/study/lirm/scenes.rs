//! Scenes beyond one object on a turntable: an object that is added between two sets (Fig. 16), and images of
//! a head-mounted camera through a fisheye and a pinhole (Fig. 17).

use super::scoring::between;
use super::setup::{SEED, Setup, decibels, is_complete, shown, square_error, values};
use crate::Result;
use crate::experiment::{Cell, Chart, Experiment, Outcome, Report, Summary, Values, of, paired, rows};
use crate::fit::field::scores::FEWEST;
use crate::fit::field::targets::target;
use crate::fit::field::view;
use crate::fit::training::Watch;
use crate::scene::camera::Model;
use data_gen::cameras;
use lastlight_lirm::evaluate::{self, SET, settings};
use lastlight_lirm::r#gen::{Set, Settings, Version};
use lastlight_lirm::model::weights::Ready;
use lastlight_lirm::reading::INPUT_SIDE;
use lastlight_lirm::views::Views;
use serde_json::{Value, json};
use std::sync::atomic::AtomicBool;

/// Largest difference of a colour between two images of the same thing: noise, but neither shadows nor
/// reflections of the added object. A choice.
const SAME: f32 = 0.02;
/// Images of the head-mounted camera that are read, four at a time.
const HEAD: usize = 16;
/// Of its frames, one in this many, so that they show all sides: it walks around the object in 9 to 18
/// seconds, and has ten frames per second.
const ONE_IN: usize = 11;

/// States whose fields are compared: name in values, and title. After the two sets: set 2 once more; set 2
/// from half of the state; and set 2 without a state, what it shows by itself.
const STATES: [(&str, &str); 5] = [
    ("1", ">set 1, dB"),
    ("2", ">set 2, dB"),
    ("twice", ">set 2 twice, dB"),
    ("half", ">from half of the state, dB"),
    ("alone", ">set 2 alone, dB"),
];

/// An object that is added between two sets.
#[derive(Debug)]
pub struct Added<'a> {
    setup: &'a Setup,
}

/// Makes the experiment.
pub fn added(setup: &Setup) -> Added<'_> {
    Added { setup }
}

impl Experiment for Added<'_> {
    fn id(&self) -> &'static str {
        "added"
    }

    fn cells(&self) -> Vec<Cell> {
        let cell = |k: u64| Cell { key: format!("{k:03}"), row: "two objects".into(), seed: k };
        (0..self.setup.size.objects).map(cell).collect()
    }

    fn settings(&self, _: usize) -> Value {
        let mut record = self.setup.record(self.setup.model());
        record["states"] = json!(STATES);
        record
    }

    fn run(&self, cell: usize, watch: &mut dyn Watch, _: &AtomicBool) -> Result<Values> {
        let (k, model) = (cell as u64, self.setup.model());
        let set = settings(SEED, self.setup.size.samples);
        // The second object is another one of the test set, beyond those that are scored.
        let first = self.setup.subject(k)?.on_side(-1.0);
        let both = first.clone().with(&self.setup.subject(k + self.setup.size.objects)?.on_side(1.0))?;
        let [before, after] =
            [&first, &both].map(|subject| Views::of_subject(&set, k, Version::Uniform, subject));
        let (before, after) = (before?, after?);
        watch.lap("images");
        let p = self.setup.protocol(model, Version::Uniform);
        let protocol = cameras::test(SEED, k, set.size);
        let ready = Ready::new(model.config, &model.params);
        let at = before.posed(model.config.pose, &protocol.inputs[..SET])?;
        let [first, second] = [&protocol.inputs[..SET], &protocol.inputs[SET..2 * SET]];
        let one = ready.read_chosen(&ready.no_state(), &before, first, &at)?;
        let two = ready.read_chosen(&one, &after, second, &at)?;
        let twice = ready.read_chosen(&two, &after, second, &at)?;
        let half: Vec<f32> = one.iter().map(|x| 0.5 * x).collect();
        let half = ready.read_chosen(&half, &after, second, &at)?;
        let alone = ready.read_chosen(&ready.no_state(), &after, second, &at)?;
        let states = [one, two, twice, half, alone];
        let [mut new, mut old] = [(); 2].map(|()| STATES.map(|_| Vec::new()));
        for (n, state) in states.iter().enumerate() {
            let field = ready.decode(state, p.rendering, at);
            let cells = view::occupancy(&field)?;
            for i in protocol.outputs.into_iter().take(self.setup.size.outputs) {
                let (a, b) = (target(&before.all[i].picture, &at), target(&after.all[i].picture, &at));
                let image = view::render(&field, Some(&cells), &b.camera, false).color().unwrap_or_default();
                let pixels = || 0..b.foreground.len();
                let is_same =
                    |i: usize| (0..3).all(|c| (a.color[3 * i + c] - b.color[3 * i + c]).abs() <= SAME);
                let added: Vec<usize> =
                    pixels().filter(|i| a.foreground[*i] == 0.0 && b.foreground[*i] == 1.0).collect();
                let kept: Vec<usize> = pixels().filter(|i| a.foreground[*i] == 1.0 && is_same(*i)).collect();
                // Few images show much of what is hidden behind the other object.
                let error = |pixels: &[usize]| {
                    square_error(&image, &b.color, pixels).filter(|_| pixels.len() >= FEWEST)
                };
                new[n].extend(error(&added));
                old[n].extend(error(&kept));
            }
        }
        watch.lap("scores");
        let named = |half: &'static str| STATES.iter().map(move |(state, _)| format!("{half}_{state}"));
        // An object that covers the other one in all images has no such pixels, and no value.
        let all = named("new").chain(named("old")).zip(new.iter().chain(&old)).filter(|(_, x)| !x.is_empty());
        Ok(all.map(|(name, x)| (name, decibels(Summary::of(x).mean))).collect())
    }

    fn report(&self, results: &[(Cell, Values)]) -> Report {
        let change = |name: &str| {
            let [a, b] = [1, 2].map(|n| of(results, "two objects", &format!("{name}_{n}")));
            Summary::of_pairs(&b, &a)
        };
        let (new, old) = (change("new"), change("old"));
        let beside_alone =
            |name: &str| between(results, "two objects", [&format!("{name}_2"), &format!("{name}_alone")]);
        let line = |half: &str, name: &str, s: &Summary| {
            let of = |state: &str| Summary::of(&of(results, "two objects", &format!("{name}_{state}")));
            let [one, two, others @ ..] = STATES.map(|(state, _)| shown(&of(state), 2));
            [half.to_owned(), one, two, shown(s, 2)].into_iter().chain(others).collect()
        };
        Report {
            id: "added",
            claim: "An object that is added between two sets: the pixels that it covers gain at least 3 dB over the first state, those of the untouched object lose at most 1 dB (Fig. 16).",
            head: vec!["pixels", STATES[0].1, STATES[1].1, ">change", STATES[2].1, STATES[3].1, STATES[4].1],
            rows: vec![
                line("of the added object", "new", &new),
                line("of the untouched object", "old", &old),
            ],
            chart_labels: ["change in dB", ""],
            chart: Chart::Intervals(vec![("added".into(), new), ("untouched".into(), old)]),
            outcome: Outcome::of(
                (is_complete(self, results) && new.count > 0 && old.count > 0)
                    .then_some(new.mean >= 3.0 && old.mean >= -1.0),
            ),
            verdict: format!(
                "Added {} dB, untouched {} dB; beside set 2 alone, which also shows both, {} and {} dB.",
                shown(&new, 2),
                shown(&old, 2),
                shown(&beside_alone("new"), 2),
                shown(&beside_alone("old"), 2)
            ),
        }
    }
}

/// Images of a head-mounted camera through two projections.
#[derive(Debug)]
pub struct Head<'a> {
    setup: &'a Setup,
}

/// Makes the experiment.
pub fn head(setup: &Setup) -> Head<'_> {
    Head { setup }
}

/// The projections.
const PROJECTIONS: [(&str, Model); 2] = [("fisheye", Model::Fisheye), ("pinhole", Model::Pinhole)];

impl Experiment for Head<'_> {
    fn id(&self) -> &'static str {
        "head"
    }

    fn cells(&self) -> Vec<Cell> {
        let of = |k: u64| {
            PROJECTIONS.map(|(name, _)| Cell { key: format!("{name}_{k:03}"), row: name.into(), seed: k })
        };
        (0..self.setup.size.objects).flat_map(of).collect()
    }

    fn settings(&self, cell: usize) -> Value {
        let mut record = self.setup.record(self.setup.model());
        record["projection"] = json!(PROJECTIONS[cell % 2].0);
        record
    }

    fn run(&self, cell: usize, watch: &mut dyn Watch, _: &AtomicBool) -> Result<Values> {
        let (k, camera, model) = ((cell / 2) as u64, PROJECTIONS[cell % 2].1, self.setup.model());
        let truth = self.setup.object(k, Version::Uniform)?;
        let test = settings(SEED, self.setup.size.samples);
        let head = Settings {
            set: Set::Egocentric,
            camera,
            views: HEAD,
            every: ONE_IN,
            size: 2 * test.size,
            ..test.clone()
        };
        let seen = Views::rendered(&head, k, Version::Uniform)?.cropped(INPUT_SIDE);
        watch.lap("images");
        let p = self.setup.protocol(model, Version::Uniform);
        let ready = Ready::new(model.config, &model.params);
        let at = seen.posed(model.config.pose, &[0])?;
        let mut state = ready.no_state();
        let mut rounds = Vec::new();
        for set in seen.all.chunks(SET) {
            state = ready.read_views(&state, set, &at);
            rounds.push(evaluate::score_state(&ready, &p, (&state, at), k, &truth)?);
        }
        watch.lap("scores");
        Ok(values(&rounds))
    }

    fn report(&self, results: &[(Cell, Values)]) -> Report {
        let line = |row: &String| {
            let of = |n: usize| shown(&Summary::of(&of(results, row, &format!("psnr_db_{n}"))), 2);
            std::iter::once(row.clone()).chain((1..=4).map(of)).collect()
        };
        let d = paired(results, ["fisheye", "pinhole"], "psnr_db_4");
        Report {
            id: "head",
            claim: "Images of a head-mounted camera, with motion blur and noise: a fisheye of 130°, whose rays are read as they are, beside a pinhole of 70°, which does not show all of a near object (Fig. 17).",
            head: vec!["projection", ">4 images, dB", ">8", ">12", ">16"],
            rows: rows(results).iter().map(line).collect(),
            chart_labels: ["fisheye − pinhole, dB", ""],
            chart: Chart::Intervals(vec![("16 images".into(), d)]),
            outcome: Outcome::Reported,
            verdict: format!("Fisheye − pinhole: {} dB.", shown(&d, 2)),
        }
    }
}
