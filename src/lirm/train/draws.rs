//! Random choices of a training: functions of seed, step and place in the batch.

use super::stage::{Stage, VIEWS};
use crate::lirm::r#gen::Version;
use crate::lirm::views::tint;
use crate::num::rng::Rng;

/// Order of the objects of a block; the step is the number of the order.
const ORDER: u16 = 0x0551;
/// Of an object, which is the item: draw 0 its light, 1 whether another one is added.
const OBJECT: u16 = 0x0552;
/// Of a place in a batch: draw 0 the turn, 1 the brightness, 2 the number of sets, from 3 on their sizes,
/// from [`TINT`] on the tint, from [`ROOM`] on size and place in the box.
const PLACE: u16 = 0x0553;
/// Draw of the first channel of the tint; after the channels follows its strength.
const TINT: u16 = 16;
/// Draw of the size; after it follow the three coordinates of the place.
const ROOM: u16 = 20;
/// Order of the images of a place; its item is the place.
const IMAGES: u16 = 0x0554;

/// Smallest and largest factor of the brightness.
const BRIGHTNESS: [f64; 2] = [0.75, 1.25];
/// A target is near an input if the cosine between the directions to their cameras is above this: 60°, as in DTC.
const NEAR: f32 = 0.5;

/// What the choices depend on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Draws<'a> {
    pub(super) seed: u64,
    pub(super) stage: &'a Stage,
    /// Objects per step.
    pub(super) batch: usize,
    /// Objects of a block.
    pub(super) block: usize,
    /// Batches that an object is in.
    pub(super) uses: usize,
}

/// The choices for one object of a step.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Choice {
    /// Index of the object.
    pub(super) object: u64,
    /// Number of its batch, from 0.
    pub(super) batch: usize,
    /// Angle about the vertical, in radians.
    pub(super) turn: f64,
    /// Factors of the encoded colours: brightness times tint, whose largest channel is 1.
    pub(super) factors: [f32; 3],
    /// Part of its size that the object has in the box.
    pub(super) size: f64,
    /// Where its middle is in the box: every coordinate in −1..1 of the room that its size leaves.
    pub(super) shift: [f64; 3],
    /// Images of every set.
    pub(super) sets: Vec<Vec<usize>>,
    /// All images, in a random order.
    pub(super) order: Vec<usize>,
    /// Whether images of the first set are no targets.
    is_update: bool,
}

fn number(x: usize) -> u32 {
    u32::try_from(x).expect("a training has fewer steps")
}

impl Draws<'_> {
    /// Block, order within it, and place in the order, of place `j` of a step.
    fn at(&self, step: usize, j: usize) -> [usize; 3] {
        let use_ = step * self.batch + j;
        let (block, rest) = (use_ / (self.uses * self.block), use_ % (self.uses * self.block));
        [block, rest / self.block, rest % self.block]
    }

    /// The objects of the blocks of a step.
    pub(super) fn objects(&self, step: usize) -> Vec<u64> {
        let mut blocks: Vec<usize> = (0..self.batch).map(|j| self.at(step, j)[0]).collect();
        blocks.dedup();
        let of =
            |b: usize| (b * self.block..(b + 1) * self.block).map(|k| self.stage.first_object + k as u64);
        blocks.into_iter().flat_map(of).collect()
    }

    /// The version of an object.
    pub(super) fn version(&self, object: u64) -> Version {
        let u = Rng::new(self.seed).uniform_f64(object, 0, OBJECT, 0);
        let [first, second, _] = self.stage.light;
        Version::ALL[if u < first { 0 } else { 1 + usize::from(u >= first + second) }]
    }

    /// Whether another object is added to one after its first set.
    pub(super) fn is_added(&self, object: u64) -> bool {
        Rng::new(self.seed).uniform_f64(object, 0, OBJECT, 1) < self.stage.added
    }

    /// The choices for place `j` of a step.
    pub(super) fn choice(&self, step: usize, j: usize) -> Choice {
        let rng = Rng::new(self.seed);
        let [block, order, at] = self.at(step, j);
        let objects = rng.permutation(self.block, number(block * self.uses + order), ORDER);
        let object = self.stage.first_object + (block * self.block + objects[at]) as u64;
        let u = |draw: u16| rng.uniform_f64(j as u64, number(step), PLACE, draw);
        let below = |draw: u16, n: usize| Ord::min((u(draw) * n as f64) as usize, n - 1);
        let [dark, bright] = BRIGHTNESS;
        // A white dome is 1 already: brighter colours would be cut off.
        let bright = if self.version(object).is_under_map() { bright } else { 1.0 };
        let brightness = dark + (bright - dark) * u(1);
        let colors = std::array::from_fn(|c| u(TINT + c as u16));
        let [least, most] = self.stage.tint;
        let strength = least + (most - least) * u(TINT + 3);
        let images = Rng::new(rng.derive(j as u64, number(step), IMAGES)).permutation(VIEWS, 0, IMAGES);
        let [few, many] = self.stage.images;
        let mut first = 0;
        let [fewest, most] = self.stage.sets;
        let sets = 0..fewest + below(2, most - fewest + 1);
        let sets = sets.map(|set| {
            let n = few + below(3 + set as u16, many - few + 1);
            first += n;
            images[first - n..first].to_vec()
        });
        Choice {
            object,
            batch: order,
            turn: std::f64::consts::TAU * u(0),
            size: 1.0 - self.stage.room * u(ROOM),
            shift: std::array::from_fn(|c| 2.0 * u(ROOM + 1 + c as u16) - 1.0),
            factors: tint(brightness, strength, colors),
            sets: sets.collect(),
            order: Rng::new(rng.derive(j as u64, number(step), PLACE)).permutation(VIEWS, 0, IMAGES),
            is_update: self.stage.updates,
        }
    }
}

impl Choice {
    /// The images to compare with: the first `n`, in the random order, whose camera is in a direction near
    /// that of an image of the first set, then the others; with draws for the second set, the first `n` that
    /// are not in the first set. `centers` are the positions of all cameras.
    pub(super) fn targets(&self, centers: &[[f32; 3]], n: usize) -> Vec<usize> {
        if self.is_update {
            return self.order.iter().copied().filter(|i| !self.sets[0].contains(i)).take(n).collect();
        }
        let unit = |x: [f32; 3]| {
            let length = ((x[0] * x[0] + x[1] * x[1]) + x[2] * x[2]).sqrt();
            if length > 0.0 { x.map(|v| v / length) } else { x }
        };
        let cosine = |a: usize, b: usize| {
            let (a, b) = (unit(centers[a]), unit(centers[b]));
            (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
        };
        let is_near = |i: &usize| self.sets[0].iter().any(|own| cosine(*i, *own) > NEAR);
        let (near, far): (Vec<usize>, Vec<usize>) = self.order.iter().partition(|i| is_near(i));
        near.into_iter().chain(far).take(n).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::stage::USES;
    use super::*;
    use crate::num::order;

    #[test]
    fn every_object_of_a_block_is_in_twelve_batches() {
        let stage = Stage::named("2a").expect("a name");
        let draws = Draws { seed: 5, stage: &stage, batch: 4, block: 6, uses: USES };
        let mut uses = [0; 6];
        for step in 0..18 {
            assert_eq!(draws.objects(step).len(), 6, "one block");
            for j in 0..4 {
                let choice = draws.choice(step, j);
                uses[(choice.object - stage.first_object) as usize] += 1;
                let mut all = choice.sets.concat();
                let n = all.len();
                all.sort_unstable();
                all.dedup();
                assert!(
                    all.len() == n && choice.sets.iter().all(|s| (3..=6).contains(&s.len())),
                    "disjoint sets"
                );
                assert_eq!(choice, draws.choice(step, j), "a function of its place");
            }
        }
        assert_eq!(uses, [USES; 6]);
        let factors: Vec<[f32; 3]> = (0..200).map(|step| draws.choice(step, 0).factors).collect();
        let ends = |f: &[f32; 3]| {
            let [a, b, c] = *f;
            [order::min(order::min(a, b), c), order::max(order::max(a, b), c)]
        };
        let all: Vec<[f32; 2]> = factors.iter().map(ends).collect();
        let [dark, bright] = BRIGHTNESS.map(|b| b as f32);
        assert!(all.iter().all(|[_, most]| (dark..=bright).contains(most)), "the largest is the brightness");
        let least = 1.0 - stage.tint[1] as f32;
        assert!(all.iter().all(|[low, most]| low / most >= least), "no channel loses more than the tint");
        let close = |x: f32| all.iter().filter(|[low, most]| (low / most - x).abs() < 0.1).count();
        assert!(close(least) > 0 && close(1.0) > 20, "some lose as much, many are nearly grey");
        assert_eq!(draws.objects(18)[0], stage.first_object + 6, "the next block");
        let share = |version| (0..4000).filter(|k| draws.version(*k) == version).count();
        let shares = Version::ALL.map(share);
        for (found, expected) in shares.into_iter().zip(stage.light) {
            assert!((found as f64 / 4000.0 - expected).abs() < 0.025, "{shares:?} of 4 000");
        }
        assert!((0..4000).all(|k| !draws.is_added(k)));
        let some = Stage { added: 0.3, ..stage.clone() };
        let added = (0..4000).filter(|k| Draws { stage: &some, ..draws }.is_added(*k)).count();
        assert!((added as f64 / 4000.0 - 0.3).abs() < 0.025, "{added} of 4 000");
        let mut turns: Vec<f64> = (0..200).map(|step| draws.choice(step, 0).turn).collect();
        turns.sort_by(f64::total_cmp);
        turns.dedup();
        let (least, most) = (turns[0], turns[turns.len() - 1]);
        assert!(turns.len() == 200 && least < 0.2 && most > 6.0, "another angle each time: {least} {most}");
    }

    #[test]
    fn targets_are_near_the_first_images() {
        let stage = Stage::named("1a").expect("a name");
        let choice = Draws { seed: 1, stage: &stage, batch: 1, block: 1, uses: USES }.choice(0, 0);
        let around = |i: usize| {
            let side = if choice.sets[0].contains(&i) || i.is_multiple_of(4) { 1.0 } else { -1.0 };
            [side, 0.001 * i as f32, 0.0]
        };
        let centers: Vec<[f32; 3]> = (0..VIEWS).map(around).collect();
        let targets = choice.targets(&centers, 4);
        assert!(targets.iter().all(|i| centers[*i][0] > 0.0), "{targets:?}");
    }

    #[test]
    fn draws_for_the_second_set_have_two_sets_and_targets_outside_of_the_first() {
        for name in ["1c", "2a"] {
            let stage = Stage::named(name).expect("a name").with_updates();
            stage.validate().expect("valid");
            let draws = Draws { seed: 5, stage: &stage, batch: 4, block: 6, uses: USES };
            let mut numbers = [0; 4];
            for step in 0..50 {
                let choice = draws.choice(step, 1);
                numbers[choice.sets.len()] += 1;
                assert!(choice.sets.iter().all(|s| (2..=5).contains(&s.len())), "{:?}", choice.sets);
                let targets = choice.targets(&[[0.0, 0.0, 1.0]; VIEWS], 4);
                assert_eq!(targets.len(), 4);
                assert!(targets.iter().all(|i| !choice.sets[0].contains(i)), "{targets:?}");
            }
            let [_, one, two, three] = numbers;
            assert!(one == 0 && two > 10 && (three > 10) == (name == "2a"), "{numbers:?}");
        }
    }
}
