//! One object of a step: its sets of input images, its crops, and their losses.

use super::draws::Draws;
use super::source::Pool;
use super::stage::SIDE;
use crate::Result;
use crate::field::render::{self, InBar, OutBar, Plan};
use crate::fit::field::Target;
use crate::fit::field::crops::{self, Crop};
use crate::fit::field::losses::{Rendered, Terms};
use crate::fit::field::scene::Weights;
use crate::fit::field::view::RayList;
use crate::lirm::model::config::Config;
use crate::lirm::model::transformer::Input;
use crate::num::rng::Rng;
use crate::scene::field::{Field, Placement};

/// Crops of an object.
const CROPS: usize = 4;
/// Pixels per side of an input image.
const INPUT: usize = 64;
/// Purpose of the seed of the places of crops; the item is the place in the batch.
const PURPOSE: u16 = 0x0555;
/// Rays whose gradients are in memory at once.
const CHUNK: usize = 1024;

/// One object of a step.
#[derive(Debug)]
pub(super) struct Object {
    /// Input images of every set.
    pub(super) sets: Vec<Vec<Input>>,
    targets: Vec<Target>,
    crops: Vec<Crop>,
    rays: RayList,
    pub(super) placement: Placement,
}

/// A render with the cotangents of its values.
#[derive(Debug)]
pub(super) struct Drawn {
    pub(super) loss: f32,
    plan: Plan,
    out: render::Out,
    values_bar: Vec<f32>,
    opacity_bar: Vec<f32>,
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
        let all = pool.get(choice.object);
        let chosen = |which: &[usize]| all.chosen(which).turned(choice.turn).lit(choice.brightness);
        let set = |which: &Vec<usize>| {
            let small = chosen(which).small(SIDE / INPUT)?;
            Ok(small.all.iter().map(|view| Input::of(view, &small.placement, config.is_whole)).collect())
        };
        let sets = choice.sets.iter().map(set).collect::<Result<Vec<Vec<Input>>>>()?;
        let centers: Vec<[f32; 3]> = all.all.iter().map(|v| v.picture.camera.center()).collect();
        let [side, crop] = draws.stage.target;
        let seen = chosen(&choice.targets(&centers, CROPS)).small(SIDE / side)?;
        let targets: Vec<Target> = (0..seen.all.len()).map(|i| seen.target(i)).collect();
        let step = u32::try_from(step).expect("a training has fewer steps");
        let seed = Rng::new(draws.seed).derive(j as u64, step, PURPOSE);
        let crops = crops::draw(&targets, seed, 0, CROPS, crop);
        let mut rays = RayList::default();
        for crop in &crops {
            let target = &targets[crop.view];
            crop.pixels(target.camera.width).for_each(|i| rays.push(&target.camera, i));
        }
        Ok(Self { sets, targets, crops, rays, placement: all.placement })
    }

    /// Renders the crops of a field and compares them.
    pub(super) fn losses(&self, field: &Field, weight: f32) -> Result<Drawn> {
        let weights = Weights::of(field);
        let scene = weights.scene(self.rays.borrowed());
        let mut plan = Plan::new(scene.all_intervals());
        let out = render::forward(&scene, &mut plan);
        let mut rendered = Rendered::new(&out.values, &out.opacity, scene.channels());
        let terms = Terms { weight: weight / self.crops.len() as f32, passes: true, lpips: None };
        let (mut loss, mut first) = (0.0, 0);
        for crop in &self.crops {
            loss += terms.add(&self.targets[crop.view], crop, first, None, &mut rendered)?;
            first += crop.size[0] * crop.size[1];
        }
        let (values_bar, opacity_bar) = (rendered.values_bar, rendered.opacity_bar);
        Ok(Drawn { loss, plan, out, values_bar, opacity_bar })
    }

    /// The gradients of a field.
    pub(super) fn pull(&self, field: &Field, drawn: &Drawn) -> InBar {
        let weights = Weights::of(field);
        let scene = weights.scene(self.rays.borrowed());
        let mut bar = InBar::zeros_like(&scene);
        let out_bar = OutBar { values: &drawn.values_bar, opacity: &drawn.opacity_bar, ..OutBar::default() };
        render::adjoint(&scene, &drawn.plan, &drawn.out, &out_bar, CHUNK, &mut bar);
        bar
    }
}
