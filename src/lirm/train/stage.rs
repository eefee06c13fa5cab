//! What a stage of a training is.
//!
//! | stage | light | tint | room | sets | samples | 1/β | target, crop | steps | rate |
//! |---|---|---|---|---|---|---|---|---|---|
//! | 1a | white dome | 0–0.85 | 0.5 | 1–2 | 64 | 10 → 40 | 64², 32² | 2 200 | 5·10⁻⁴ → 3.5·10⁻⁴ |
//! | 1b | white dome | 0–0.85 | 0 | 1–2 | 64 | 40 → 60 | 64², 32² | 2 200 | 3.5·10⁻⁴ → 1.2·10⁻⁴ |
//! | 1c | white dome | 0–0.85 | 0 | 1–2 | 64 | 60 | 64², 32² | 1 800 | 1.2·10⁻⁴ → 2·10⁻⁵ |
//! | 2a | ⅜ map, ⅜ shiny, ¼ dome | 0–0.6 | 0 | 1–3 | 96 | 60 → 80 | 128², 32² | 800 | 2·10⁻⁴ → 6·10⁻⁵ |
//! | 2b | the same | 0–0.6 | 0 | 1–3 | 96 | 80 → 100 | 128², 32² | 800 | 6·10⁻⁵ → 10⁻⁶ |
//! | 3 | the same | 0–0.6 | 0 | 1–3 | 128 | 100 → 125 | 128², 48² | 400 | 2·10⁻⁵ → 0 |
//!
//! In stage 1a an object is scaled in every step by a random factor from 1 − `room` to 1 and moved to a
//! random place in the box, so that its place can be found only by using the cameras (`--room`; ½ in stage
//! 1a, 0 in the others). Otherwise all objects are in the middle of the box, and models learn how tall and
//! wide an object is before they learn to use cameras (chapter `small_model` of the book).
//!
//! `--updates` draws for the second set ([`Stage::with_updates`]): at least two sets of two to five images
//! (otherwise three to six), and targets that are not in the first set. Without it, targets are images near
//! the first set, those of it included, and in stage 1 a second set has a quarter of the weight of the
//! losses, half with `--last-set-only`.
//!
//! In a part of the scenes the object is at half its size on one side, and another one is on the other side
//! in all sets but the first, in targets too (`--added`, 0 by default). LIRM trains on objects that do not
//! change; a model that has seen nothing else keeps a scene as it was.
//!
//! By default every set of an object is compared, and the state before it is a constant. `--last-set-only` compares the last
//! set alone; `--state-gradient` lets gradients flow through the state. The paper states neither.
//!
//! In its first `--shape-steps` a stage compares signed distances and renders nothing; such a step takes
//! two thirds to three quarters of the time. A training that began so used its cameras, those with Muon before it hardly did; they
//! differ in more than this (chapter `small_model`).
//!
//! The rate rises linearly over the first hundred steps (twenty in stage 3) to the first number, and falls
//! along a cosine to the second. 1/β is linear; in stage 1a it doubles while the rate rises, and is linear
//! from there. With signed distances it goes from 30 to 60 during this warm-up, to 120 until the end of stage
//! 1a, and stays there until stage 3 ([`Stage::with_distances`]). Stages 2 and 3 train all heads and read
//! photos; albedo is compared up to one factor per object, or as it is (`--absolute-albedo`). From stage 2b
//! on a ray ends where it is opaque. Stage 3 compares numerical normals too, and takes samples in occupied
//! cells only. Objects of a stage follow those of the one before; with fewer than twelve batches per object
//! (`--uses`) a stage needs more of them, and reaches into those of the next.
//!
//! In every step the encoded colours of an object are multiplied by a random colour: channel c by (1 −
//! tint·u_c) over the largest of the three, u uniform in 0..1, times a brightness (0.75 to 1, under a map to
//! 1.25). The built-in objects are nearly grey (the mean colour of one differs from a grey by 0.05), and a
//! model that is trained on them as they are learns brightness and no hue (chapter `small_model` of the
//! book). The tint is uniform in 0..0.85 (stages 2 and 3: 0..0.6), so that a quarter to two fifths of the
//! objects keep all channels within a tenth of each other: a model that has seen strongly tinted objects
//! alone probably finds bright grey ones badly before a white background.

use crate::lirm::model::decode::{EARLY_STOP, LEAST_WEIGHT, Rendering};
use crate::lirm::model::origin::Part;
use crate::num::elem::f64 as elem;
use crate::num::order;
use crate::{Error, Result};
use serde_json::{Value, json};

/// Images of an object.
pub const VIEWS: usize = 20;
/// Pixels per side of an image.
pub const SIDE: usize = 128;
/// Batches that an object is in by default.
pub const USES: usize = 12;
/// The warm-up is at most this part of a training.
const SHORTEST: usize = 4;
/// 1/β at the end of stage 1a, and from then on, where signed distances are compared: those have a gradient
/// without fog. The step of 64 samples along the diagonal is 3.4 β long, for which the rule `analytic` is
/// accurate to a fraction of β.
const SHARP: f32 = 120.0;

/// A stage.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// Its name.
    pub name: String,
    /// Steps.
    pub steps: usize,
    /// First and last learning rate.
    pub rates: [f64; 2],
    /// Steps over which the rate rises, at most a quarter of all.
    pub rise: usize,
    /// Parts of the objects in each of [`crate::lirm::gen::Version::ALL`]: under a white dome, under a map, and
    /// shiny under a map.
    pub light: [f64; 3],
    /// Smallest and largest number of sets of input images.
    pub sets: [usize; 2],
    /// Smallest and largest strength of the random colour that an object is multiplied by: the largest part
    /// that a channel loses.
    pub tint: [f64; 2],
    /// Largest part of its size that an object gives up for a random place in the box.
    pub room: f64,
    /// Smallest and largest number of images of a set.
    pub images: [usize; 2],
    /// Steps of a ray along the diagonal.
    pub samples: usize,
    /// First and last 1/β.
    pub inverse_beta: [f32; 2],
    /// Pixels per side of a target, and of a crop of it.
    pub target: [usize; 2],
    /// Whether all heads are trained, and photos are read.
    pub is_whole: bool,
    /// Whether 1/β doubles while the rate rises.
    pub is_first: bool,
    /// Whether rays end where they are opaque.
    pub stops: bool,
    /// Whether numerical normals are compared too, and samples are taken in occupied cells only.
    pub is_last: bool,
    /// Index of the first object.
    pub first_object: u64,
    /// Weight of the squared distance of surface points from the true ones, and of the part of it along the
    /// optical axis; 0 removes both.
    pub points: f32,
    /// Weight of the squared error of the signed distance at points around the surface; 0 removes it.
    pub distances: f32,
    /// Steps at the beginning in which signed distances are all that is compared: nothing is rendered, and
    /// the heads of colours and normals only decay.
    pub shape_steps: usize,
    /// Whether draws are those for the second set ([`Self::with_updates`]).
    pub updates: bool,
    /// Part of the objects to which another one is added after the first set.
    pub added: f64,
    /// Whether gradients flow through the state, from the losses of a set to the sets before it.
    pub state_gradient: bool,
    /// Whether the last set of an object is the only one that is compared.
    pub last_set_only: bool,
    /// Whether albedo is compared as it is, not up to one factor per object.
    pub absolute_albedo: bool,
    /// Factor on the weight of roughness and metallic.
    pub material: f32,
    /// Weight of the normal head; numerical normals have 1.
    pub normal_weight: f32,
}

/// Names of the stages, in order.
pub const NAMES: [&str; 6] = ["1a", "1b", "1c", "2a", "2b", "3"];

impl Stage {
    /// Returns the stage of that name.
    ///
    /// # Errors
    /// Lists the names if there is none.
    pub fn named(name: &str) -> Result<Self> {
        let plain = |steps, rates, inverse_beta, first_object| Self {
            name: name.to_owned(),
            steps,
            rates,
            rise: 100,
            light: [1.0, 0.0, 0.0],
            tint: [0.0, 0.85],
            room: if name == "1a" { 0.5 } else { 0.0 },
            sets: [1, 2],
            images: [3, 6],
            samples: 64,
            inverse_beta,
            target: [64, 32],
            is_whole: false,
            is_first: name == "1a",
            stops: false,
            is_last: false,
            first_object,
            points: 0.0,
            distances: 0.0,
            shape_steps: 0,
            updates: false,
            added: 0.0,
            state_gradient: false,
            last_set_only: false,
            absolute_albedo: false,
            material: 1.0,
            normal_weight: 1.0,
        };
        let whole = |steps, rates, inverse_beta, first_object| Self {
            light: [0.25, 0.375, 0.375],
            tint: [0.0, 0.6],
            sets: [1, 3],
            samples: 96,
            target: [128, 32],
            is_whole: true,
            ..plain(steps, rates, inverse_beta, first_object)
        };
        Ok(match name {
            "1a" => plain(2200, [5e-4, 3.5e-4], [10.0, 40.0], 0),
            "1b" => plain(2200, [3.5e-4, 1.2e-4], [40.0, 60.0], 1600),
            "1c" => plain(1800, [1.2e-4, 2e-5], [60.0, 60.0], 3200),
            "2a" => whole(800, [2e-4, 6e-5], [60.0, 80.0], 4500),
            "2b" => Self { stops: true, ..whole(800, [6e-5, 1e-6], [80.0, 100.0], 5200) },
            "3" => Self {
                rise: 20,
                samples: 128,
                target: [128, 48],
                stops: true,
                is_last: true,
                ..whole(400, [2e-5, 0.0], [100.0, 125.0], 5900)
            },
            other => return Err(Error::input("--stage").expected(NAMES.join(", ")).got(other)),
        })
    }

    /// The stage with a weight of signed distances.
    ///
    /// These have a gradient at every point, so that no stage needs fog for it: 1/β begins at 30, doubles
    /// during the warm-up, and is 120 at the end of stage 1a and in all later stages (125 at the end of stage
    /// 3).
    #[must_use]
    pub fn with_distances(mut self, weight: f32) -> Self {
        self.distances = weight;
        if weight > 0.0 {
            let [_, last] = self.inverse_beta;
            self.inverse_beta = [if self.is_first { 30.0 } else { SHARP }, order::max(SHARP, last)];
        }
        self
    }

    /// The stage with draws for the second set: at least two sets, of two to five images, and targets that
    /// are not in the first set.
    #[must_use]
    pub fn with_updates(mut self) -> Self {
        self.updates = true;
        self.sets = [2, Ord::max(self.sets[1], 2)];
        self.images = [2, 5];
        self
    }

    /// The stage with another first learning rate; the last one changes with it.
    #[must_use]
    pub fn with_rate(mut self, rate: f64) -> Self {
        let [first, last] = self.rates;
        self.rates = [rate, rate * (last / first)];
        self
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// Names the setting.
    pub fn validate(&self) -> Result<()> {
        let refuse =
            |name: &str, expected: &str, got: String| Err(Error::input(name).expected(expected).got(got));
        if self.steps == 0 {
            return refuse("--iterations", "at least one", self.steps.to_string());
        }
        if self.rates.iter().any(|r| !(0.0..=1.0).contains(r)) {
            return refuse("--rate", "0 to 1", self.rates[0].to_string());
        }
        if !(0.0..1.0).contains(&self.room) {
            return refuse("--room", "0 or more, below 1", self.room.to_string());
        }
        if !(0.0..=1.0).contains(&self.tint[1]) {
            return refuse("--tint", "0 to 1", self.tint[1].to_string());
        }
        if !(0.0..=1.0).contains(&self.added) {
            return refuse("--added", "0 to 1", self.added.to_string());
        }
        for (name, weight) in [
            ("--points", self.points),
            ("--distances", self.distances),
            ("--material-weight", self.material),
            ("--normal-weight", self.normal_weight),
        ] {
            if !(0.0..=1e4).contains(&weight) {
                return refuse(name, "0 to 10 000", weight.to_string());
            }
        }
        if self.shape_steps > self.steps {
            return refuse("--shape-steps", "at most the steps of the stage", self.shape_steps.to_string());
        }
        if self.shape_steps > 0 && self.distances == 0.0 {
            return refuse("--shape-steps", "a weight of --distances", "none".to_owned());
        }
        let ([few, many], [least, most]) = (self.images, self.sets);
        if least == 0 || least > most || few == 0 || few > many || most * many > VIEWS {
            let got = format!("{least} to {most} of {few} to {many}");
            return refuse("sets of images", "at least one of at least one image, of twenty in all", got);
        }
        let [side, crop] = self.target;
        if ![64, 128].contains(&side) || !(16..=side).contains(&crop) {
            return refuse(
                "crops of targets",
                "16 to the side of a target, which is 64 or 128",
                format!("{crop} of {side}"),
            );
        }
        Ok(())
    }

    /// The steps of the warm-up: a short training has a quarter of its steps for it.
    fn warm_up(&self) -> usize {
        Ord::min(self.rise, Ord::max(self.steps / SHORTEST, 1))
    }

    /// The learning rate of a step.
    pub fn rate(&self, step: usize) -> f64 {
        let [first, last] = self.rates;
        let rise = self.warm_up();
        if step < rise {
            return first * (step + 1) as f64 / rise as f64;
        }
        let part = (step - rise) as f64 / Ord::max(self.steps - rise, 1) as f64;
        last + (first - last) * 0.5 * (1.0 + elem::cos(std::f64::consts::PI * part))
    }

    /// How fields are rendered in a step.
    pub(super) fn rendering(&self, step: usize) -> Rendering {
        let [first, last] = self.inverse_beta.map(f64::from);
        let along = |from: usize, to: usize, [first, last]: [f64; 2]| {
            let part = (step - from) as f64 / Ord::max(to - from, 1) as f64;
            first + order::min(part, 1.0) * (last - first)
        };
        let rise = self.warm_up();
        let (end, middle) = (Ord::max(self.steps, 1) - 1, 2.0 * first);
        let inverse_beta = match self.is_first {
            true if step < rise => along(0, rise, [first, middle]),
            true => along(rise, end, [middle, last]),
            false => along(0, end, [first, last]),
        };
        Rendering {
            samples: self.samples,
            inverse_beta: inverse_beta as f32,
            least_weight: Some(LEAST_WEIGHT),
            early_stop: self.stops.then_some(EARLY_STOP),
        }
    }

    /// The mean number of sets that an object of a step has.
    fn mean_sets(&self) -> f64 {
        0.5 * (self.sets[0] + self.sets[1]) as f64
    }

    /// Returns the settings as a flat JSON object.
    pub fn json(&self) -> Value {
        let mut all = json!({
            "stage": self.name, "steps": self.steps, "rates": self.rates, "rise": self.rise, "light": self.light, "tint": self.tint, "room": self.room,
            "sets": self.sets[1], "images": self.images, "samples": self.samples, "inverse_beta": self.inverse_beta, "target": self.target,
            "first_object": self.first_object, "points": self.points, "distances": self.distances,
        });
        if self.sets[0] != if self.updates { 2 } else { 1 } {
            all["least_sets"] = json!(self.sets[0]);
        }
        // Runs that began before it existed go on.
        if self.shape_steps > 0 {
            all["shape_steps"] = json!(self.shape_steps);
        }
        if self.updates {
            all["updates"] = json!(true);
        }
        if self.added > 0.0 {
            all["added"] = json!(self.added);
        }
        if self.state_gradient {
            all["state_gradient"] = json!(true);
        }
        if self.last_set_only {
            all["last_set_only"] = json!(true);
        }
        if self.stops && !self.is_last {
            all["stops"] = json!(true);
        }
        if self.absolute_albedo {
            all["absolute_albedo"] = json!(true);
        }
        if self.material != 1.0 {
            all["material"] = json!(self.material);
        }
        if self.normal_weight != 1.0 {
            all["normal_weight"] = json!(self.normal_weight);
        }
        all
    }
}

/// The object-rounds of a training: one object of a step that reads one set of images is one. Expected from
/// the draws, not counted.
///
/// # Errors
/// If a part is of a stage that does not exist.
pub fn object_rounds(parts: &[Part]) -> Result<f64> {
    parts.iter().try_fold(0.0, |sum, part| {
        let stage = Stage::named(&part.stage)?;
        let stage = if part.updates { stage.with_updates() } else { stage };
        Ok(sum + ((part.range[1] - part.range[0]) * part.batch) as f64 * stage.mean_sets())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_are_those_of_the_table_and_do_not_share_objects() {
        let all: Vec<Stage> = NAMES.iter().map(|n| Stage::named(n).expect("a name")).collect();
        let ends = all.iter().map(|stage| stage.rendering(0).early_stop.is_some()).collect::<Vec<_>>();
        assert_eq!(ends, [false, false, false, false, true, true], "opaque rays end from stage 2b on");
        for pair in all.windows(2) {
            // Blocks of 200 objects, the last of which may not be used up.
            let objects = (8 * pair[0].steps).div_ceil(USES).next_multiple_of(200) as u64;
            assert!(pair[0].first_object + objects <= pair[1].first_object, "{}", pair[1].name);
            assert!(pair[0].inverse_beta[1] <= pair[1].inverse_beta[0]);
        }
        assert_eq!((all[0].rate(0), all[0].rate(99)), (5e-6, 5e-4), "it rises");
        assert!((all[0].rate(2199) - 3.5e-4).abs() < 1e-8, "and falls");
        assert!((all[5].rate(0) - 1e-6).abs() < 1e-12 && all[5].rate(19) == 2e-5, "twenty steps in stage 3");
        let sharp = [0, 50, 100, 2199].map(|step| all[0].rendering(step).inverse_beta);
        assert_eq!(sharp, [10.0, 15.0, 20.0, 40.0], "it doubles while the rate rises");
        let sharp = all[0].clone().with_distances(10.0);
        assert_eq!([0, 100, 2199].map(|step| sharp.rendering(step).inverse_beta), [30.0, 60.0, 120.0]);
        let ends = [1, 4, 5].map(|i| all[i].clone().with_distances(10.0).inverse_beta);
        assert_eq!(ends, [[120.0, 120.0], [120.0, 120.0], [120.0, 125.0]], "sharp from the first step");
        assert_eq!([0, 2199].map(|step| all[1].rendering(step).inverse_beta), [40.0, 60.0]);
        assert!(Stage::named("4").is_err());
        // Steps, rates, sets, samples, 1/β, sides of target and crop, and shares of the light.
        let first = [1.0, 0.0, 0.0];
        let maps = [0.25, 0.375, 0.375];
        let table = [
            (2200, [5e-4, 3.5e-4], [1, 2], 64, [10.0, 40.0], [64, 32], first),
            (2200, [3.5e-4, 1.2e-4], [1, 2], 64, [40.0, 60.0], [64, 32], first),
            (1800, [1.2e-4, 2e-5], [1, 2], 64, [60.0, 60.0], [64, 32], first),
            (800, [2e-4, 6e-5], [1, 3], 96, [60.0, 80.0], [128, 32], maps),
            (800, [6e-5, 1e-6], [1, 3], 96, [80.0, 100.0], [128, 32], maps),
            (400, [2e-5, 0.0], [1, 3], 128, [100.0, 125.0], [128, 48], maps),
        ];
        let of = |s: &Stage| (s.steps, s.rates, s.sets, s.samples, s.inverse_beta, s.target, s.light);
        assert_eq!(all.iter().map(of).collect::<Vec<_>>(), table);
        for strongest in [-0.1, 1.1, f64::NAN] {
            let e = Stage { tint: [0.0, strongest], ..all[0].clone() }.validate().expect_err("no part");
            assert!(e.to_string().contains("--tint"), "{e}");
            let e = Stage { added: strongest, ..all[0].clone() }.validate().expect_err("no part");
            assert!(e.to_string().contains("--added"), "{e}");
        }
        assert!(all.iter().all(|s| s.images == [3, 6] && s.is_whole == (s.light == maps)));
        let short = Stage { steps: 100, ..all[0].clone() };
        assert_eq!([0, 24].map(|step| short.rate(step)), [2e-5, 5e-4], "a quarter of a short one");
        assert!((short.rate(99) - 3.5e-4).abs() < 1e-6, "its end is the same");
        assert_eq!([0, 25, 99].map(|step| short.rendering(step).inverse_beta), [10.0, 20.0, 40.0]);
        let shortest = Stage { steps: 1, ..all[0].clone() };
        assert_eq!((shortest.rate(0), shortest.rendering(0).inverse_beta), (5e-4, 10.0), "one step");
    }

    #[test]
    fn object_rounds_are_the_mean_number_of_sets() {
        let stage = |name: &str, updates: bool| -> Part {
            let text = format!(
                r#"{{"stage": "{name}", "range": [100, 300], "steps": 300, "seed": 0, "batch": 8, "block": 8, "source": "built-in",
                "points": 0.0, "distances": 0.0, "updates": {updates}, "inverse_beta": 60.0, "start": ""}}"#
            );
            serde_json::from_str(&text).expect("a part")
        };
        let count = |parts: &[Part]| object_rounds(parts).expect("stages");
        assert_eq!(count(&[]), 0.0);
        assert_eq!(count(&[stage("1b", false)]), 200.0 * 8.0 * 1.5, "one or two sets");
        assert_eq!(count(&[stage("1b", true)]), 200.0 * 8.0 * 2.0, "two");
        assert_eq!(count(&[stage("1b", false), stage("2a", false)]), 200.0 * 8.0 * 3.5, "one to three");
        assert!(object_rounds(&[stage("9", false)]).is_err());
    }
}
