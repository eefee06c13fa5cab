//! One object of a step: its sets of input images, and what the fields of each set are compared with.

use super::distances::Distances;
use super::draws::Draws;
use super::source::Pool;
use super::stage::SIDE;
use super::truth::{CROPS, Truth};
use crate::Result;
use crate::lirm::model::config::{Config, PATCH};
use crate::lirm::model::transformer::Input;
use crate::lirm::reading::INPUT_SIDE;
use crate::lirm::views::Views;
use crate::num::rng::Rng;
use crate::scene::field::Placement;

/// Tokens of an input image.
pub(super) const INPUT_TOKENS: usize = (INPUT_SIDE / PATCH) * (INPUT_SIDE / PATCH);
/// Purpose of the seed of the places of crops; the item is the place in the batch.
const PURPOSE: u16 = 0x0555;
/// Radius of the ball in which an object is.
const RADIUS: f64 = 0.5;

/// One object of a step.
#[derive(Debug)]
pub(super) struct Object {
    /// Input images of every set.
    pub(super) sets: Vec<Vec<Input>>,
    /// What the fields of all sets are compared with; of a scene that changes that of the first set, and that
    /// of those after it.
    pub(super) truths: Vec<Truth>,
    pub(super) placement: Placement,
}

/// The place of an object that is smaller by a factor and, in the room that this leaves, somewhere else in
/// the box.
fn placed(at: Placement, size: f64, shift: [f64; 3]) -> Placement {
    let scale = at.scale * size;
    let room = RADIUS * (1.0 - size);
    let q = at.rotation;
    // The point that is at the middle of the box, from the object's middle, in the axes of the world.
    let back = |k: usize| ((q[0][k] * shift[0] + q[1][k] * shift[1]) + q[2][k] * shift[2]) * room / scale;
    Placement { center: std::array::from_fn(|k| at.center[k] - back(k)), scale, ..at }
}

impl Object {
    /// Makes the inputs and targets of place `j` of a step.
    pub(super) fn new(
        draws: &Draws<'_>,
        config: &Config,
        step: usize,
        j: usize,
        pool: &Pool<'_>,
    ) -> Result<Self> {
        let choice = draws.choice(step, j);
        let scenes = pool.get(choice.object);
        // What the images of a set show.
        let of = |set: usize| &scenes[Ord::min(set, scenes.len() - 1)];
        // The axes are those of the first set.
        let (all, _) = of(0);
        let first = all.chosen(&choice.sets[0]).turned(choice.turn);
        let middle = first.posed(config.pose, &(0..first.all.len()).collect::<Vec<_>>())?;
        let placement = placed(middle, choice.size, choice.shift);
        let chosen = |all: &Views, which: &[usize]| {
            let own = all.chosen(which).turned(choice.turn).lit(choice.factors);
            Views { placement, ..own }
        };
        let inputs = |(set, which): (usize, &Vec<usize>)| {
            let small = chosen(&of(set).0, which).sized(INPUT_SIDE)?;
            Ok(small.all.iter().map(|view| Input::of(view, &small.placement, config)).collect())
        };
        let sets = choice.sets.iter().enumerate().map(inputs).collect::<Result<Vec<Vec<Input>>>>()?;
        let centers: Vec<[f32; 3]> = all.all.iter().map(|v| v.picture.camera.center()).collect();
        let count = if step < draws.stage.shape_steps { 0 } else { CROPS };
        let targets = choice.targets(&centers, count);
        let number = u32::try_from(step).expect("a training has fewer steps");
        let seed = Rng::new(draws.seed).derive(j as u64, number, PURPOSE);
        let truth = |(all, points): &(Views, Distances)| {
            let mut distances = points.turned(choice.batch, choice.turn, &placement);
            if choice.size < 1.0 {
                let center = placement.to_field(middle.center);
                distances = distances.with_room(points, choice.batch, center, RADIUS * choice.size);
            }
            let near = chosen(all, &targets).small(SIDE / draws.stage.target[0])?;
            let targets = (0..near.all.len()).map(|i| near.target(i)).collect();
            Ok(Truth::new(targets, distances, draws.stage, seed))
        };
        let truths = scenes.iter().map(truth).collect::<Result<Vec<Truth>>>()?;
        Ok(Self { sets, truths, placement })
    }

    /// What the field after a set is compared with.
    pub(super) fn truth(&self, set: usize) -> &Truth {
        &self.truths[Ord::min(set, self.truths.len() - 1)]
    }
}

#[cfg(test)]
mod tests {
    use super::super::source::BuiltInObjects;
    use super::super::stage::Stage;
    use super::*;
    use crate::fit::field::Target;
    use crate::fit::field::view::RayList;
    use crate::num::order;

    const TINY: Config = Config { blocks: 1, width: 16, heads: 2, ..Config::SMALL };

    /// The first object of a stage.
    fn made(stage: &Stage) -> Object {
        let source = BuiltInObjects::new(0);
        let mut pool = Pool::new(&source);
        let draws = Draws { seed: 0, stage, batch: 1, block: 1, uses: 1 };
        pool.fill(&draws, 0).expect("an object");
        Object::new(&draws, &TINY, 0, 0, &pool).expect("valid")
    }

    /// Part of some points that the nearest ray of every image shows as the object.
    fn covered(points: &[[f32; 3]], images: &[(Vec<[f32; 6]>, Vec<bool>)]) -> f64 {
        let is_covered = |p: &[f32; 3], (rays, foreground): &(Vec<[f32; 6]>, Vec<bool>)| {
            // The squared distance of a point from a line with unit direction d and a point c: ‖p − c‖² − ((p − c)·d)².
            let square = |r: &[f32; 6]| {
                let off: [f32; 3] = std::array::from_fn(|k| p[k] - r[3 + k]);
                let along = (off[0] * r[0] + off[1] * r[1]) + off[2] * r[2];
                ((off[0] * off[0] + off[1] * off[1]) + off[2] * off[2]) - along * along
            };
            let nearest = (0..rays.len()).min_by(|i, j| square(&rays[*i]).total_cmp(&square(&rays[*j])));
            nearest.is_some_and(|i| foreground[i])
        };
        let all = points.iter().filter(|p| images.iter().all(|image| is_covered(p, image))).count();
        all as f64 / points.len() as f64
    }

    #[test]
    fn inputs_targets_and_distances_show_one_object_in_one_place() {
        let object = made(&Stage { distances: 1.0, ..Stage::named("1a").expect("a name") });
        let truth = object.truth(0);
        assert_eq!(truth.targets.len(), 4);
        let inside = truth.distances.inside(0.02);
        assert!(inside.len() > 20, "{}", inside.len());
        let read = |input: &Input| {
            let rays = input.rays.as_chunks::<6>().0.to_vec();
            (rays, input.image.as_chunks::<3>().0.iter().map(|x| x.iter().any(|v| *v < 2.9)).collect())
        };
        let mut inputs: Vec<(Vec<[f32; 6]>, Vec<bool>)> = object.sets.iter().flatten().map(read).collect();
        let targets: Vec<(Vec<[f32; 6]>, Vec<bool>)> = truth
            .targets
            .iter()
            .map(|t| {
                let mut list = RayList::default();
                (0..t.foreground.len()).for_each(|i| list.push(&t.camera, i));
                let row = |(o, d): (&[f32; 3], &[f32; 3])| [d[0], d[1], d[2], o[0], o[1], o[2]];
                let rays = list.origins.iter().zip(&list.directions).map(row).collect();
                (rays, t.foreground.iter().map(|m| *m > 0.0).collect())
            })
            .collect();
        let [of_inputs, of_targets] = [&inputs, &targets].map(|images| covered(&inside, images));
        assert!(of_inputs > 0.98 && of_targets > 0.98, "{of_inputs} {of_targets}");
        let mut rays: Vec<Vec<[f32; 6]>> = inputs.iter().map(|(rays, _)| rays.clone()).collect();
        rays.rotate_left(1);
        inputs.iter_mut().zip(rays).for_each(|(input, rays)| input.0 = rays);
        let of_others = covered(&inside, &inputs);
        assert!(of_others < 0.9, "with each other's cameras they do not: {of_others}");
    }

    #[test]
    fn an_object_that_is_added_is_in_inputs_targets_and_distances_of_later_sets_alone() {
        let stage =
            Stage { distances: 1.0, added: 1.0, ..Stage::named("1b").expect("a name").with_updates() };
        let object = made(&stage);
        let [before, after] = &object.truths[..] else { panic!("two") };
        assert!(std::ptr::eq(object.truth(0), before) && std::ptr::eq(object.truth(1), after));
        // Foreground of an image as a part of its pixels.
        let read = |input: &Input| {
            let is_object = |x: &&[f32; 3]| x.iter().any(|v| *v < 2.9);
            input.image.as_chunks::<3>().0.iter().filter(is_object).count() as f64 / 4096.0
        };
        let mean = |parts: &[f64]| parts.iter().fold(0.0, |sum, x| sum + x) / parts.len() as f64;
        let [first, second] = [0, 1].map(|set| mean(&object.sets[set].iter().map(read).collect::<Vec<_>>()));
        assert!(second > 1.3 * first, "{first} {second}");
        let of = |truth: &Truth| -> Vec<f64> {
            let part = |t: &Target| t.foreground.iter().fold(0.0, |sum, m| sum + f64::from(*m)) / 4096.0;
            truth.targets.iter().map(part).collect()
        };
        let (few, many) = (of(before), of(after));
        assert!(few.iter().zip(&many).all(|(few, many)| few <= many), "{few:?} {many:?}");
        assert!(mean(&many) > 1.3 * mean(&few), "{few:?} {many:?}");
        // The images show what the distances describe.
        let volume = |truth: &Truth| truth.distances.inside(0.02);
        let extent = |points: &[[f32; 3]]| {
            let of =
                |c: usize, f: fn(f32, f32) -> f32, start: f32| points.iter().fold(start, |x, p| f(x, p[c]));
            let [width, depth] = [0, 1].map(|c| of(c, order::max, -1.0) - of(c, order::min, 1.0));
            order::max(width, depth)
        };
        let (one, two) = (extent(&volume(before)), extent(&volume(after)));
        assert!(one < 0.5 && two > one, "the second object is beside the first: {one} {two}");
        assert_eq!(made(&Stage { added: 0.0, ..stage }).truths.len(), 1);
    }
}
