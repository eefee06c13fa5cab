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
use crate::loss::{self, mse};
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
    /// True points of the surface at the rays, and 1 where there is one; empty without the recipe that compares them.
    surface: Vec<([f32; 3], f32)>,
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
    points_bar: Vec<[f32; 3]>,
}

/// The points at which the rays of a crop meet the surface, from the pass of depth; only pixels that are covered completely count.
fn surface(target: &Target, crop: &Crop, rays: &[([f32; 3], [f32; 3])]) -> Vec<([f32; 3], f32)> {
    let Some(depth) = &target.depth else { return vec![([0.0; 3], 0.0); rays.len()] };
    let axis = target.camera.rotation[2];
    let one = |(i, (o, d)): (usize, &([f32; 3], [f32; 3]))| {
        let z = depth[i];
        if !(z > 0.0 && target.foreground[i] == 1.0) {
            return ([0.0; 3], 0.0);
        }
        // z is the distance along the optical axis.
        let along = z / ((d[0] * axis[0] + d[1] * axis[1]) + d[2] * axis[2]);
        (std::array::from_fn(|k| o[k] + along * d[k]), 1.0)
    };
    crop.pixels(target.camera.width).zip(rays).map(one).collect()
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
        let (mut rays, mut points) = (RayList::default(), Vec::new());
        for crop in &crops {
            let (target, first) = (&targets[crop.view], rays.origins.len());
            crop.pixels(target.camera.width).for_each(|i| rays.push(&target.camera, i));
            if draws.stage.points > 0.0 {
                let own = rays.origins[first..].iter().copied().zip(rays.directions[first..].iter().copied());
                points.extend(surface(target, crop, &own.collect::<Vec<_>>()));
            }
        }
        Ok(Self { sets, targets, crops, rays, surface: points, placement: all.placement })
    }

    /// Renders the crops of a field and compares them.
    pub(super) fn losses(&self, field: &Field, weight: f32, points: f32) -> Result<Drawn> {
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
        let (distance, points_bar) = self.compare_points(&out.points, [weight, points])?;
        Ok(Drawn { loss: loss + distance, plan, out, values_bar, opacity_bar, points_bar })
    }

    /// The mean squared distance between the surface points of the rays and the true ones, plus that along the optical axes; over all rays.
    fn compare_points(&self, found: &[[f32; 3]], [whole, own]: [f32; 2]) -> Result<(f32, Vec<[f32; 3]>)> {
        if self.surface.is_empty() {
            return Ok((0.0, Vec::new()));
        }
        let n = found.len();
        let axes = self.crops.iter().flat_map(|crop| {
            let axis = self.targets[crop.view].camera.rotation[2];
            std::iter::repeat_n(axis, crop.size[0] * crop.size[1])
        });
        // Rows of x, y, z, and the part along the axis.
        let row = |x: [f32; 3], a: [f32; 3]| [x[0], x[1], x[2], (x[0] * a[0] + x[1] * a[1]) + x[2] * a[2]];
        let (mut x, mut y, mut mask, mut directions) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::with_capacity(n));
        for ((point, (truth, is_there)), axis) in found.iter().zip(&self.surface).zip(axes) {
            x.extend(row(*point, axis));
            y.extend(row(*truth, axis));
            mask.extend([*is_there; 4]);
            directions.push(axis);
        }
        let pair = loss::In { x: &x, y: &y, mask: Some(&mask), height: 4 * n, width: 1 };
        let (value, saved) = mse::forward_over(&pair, mse::Over::All)?;
        // The mean over all rows instead of all numbers.
        let weight = 4.0 * whole * own;
        let mut pulled = vec![0.0; x.len()];
        mse::adjoint(&pair, &saved, weight, &mut pulled, None);
        let back = |(row, axis): (&[f32; 4], &[f32; 3])| std::array::from_fn(|k| row[k] + row[3] * axis[k]);
        let points = pulled.as_chunks::<4>().0.iter().zip(&directions).map(back).collect();
        Ok((weight * value, points))
    }

    /// The gradients of a field.
    pub(super) fn pull(&self, field: &Field, drawn: &Drawn) -> InBar {
        let weights = Weights::of(field);
        let scene = weights.scene(self.rays.borrowed());
        let mut bar = InBar::zeros_like(&scene);
        let out_bar = OutBar {
            values: &drawn.values_bar,
            opacity: &drawn.opacity_bar,
            points: &drawn.points_bar,
            ..OutBar::default()
        };
        render::adjoint(&scene, &drawn.plan, &drawn.out, &out_bar, CHUNK, &mut bar);
        bar
    }
}
