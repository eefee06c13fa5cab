//! What the fields of an object of a step are compared with: crops of target images, points with signed
//! distances, and their losses.

use super::distances::Distances;
use super::stage::Stage;
use crate::Result;
use crate::field::render::{self, InBar, OutBar, Plan};
use crate::fit::field::Target;
use crate::fit::field::crops::{self, Crop};
use crate::fit::field::losses::{Rendered, Terms, albedo_scale};
use crate::fit::field::normals::AtSurface;
use crate::fit::field::occupied::filled;
use crate::fit::field::scene::Weights;
use crate::fit::field::surface::Stencils;
use crate::fit::field::view::RayList;
use crate::loss::{self, mse};
use crate::scene::field::Field;

/// Crops of an object.
pub(super) const CROPS: usize = 4;
/// Weight of numerical normals.
const NORMALS: f32 = 1.0;
/// Cells per axis of the grid that samples are skipped by.
const CELLS: usize = 64;
/// Rays whose gradients are in memory at once.
const CHUNK: usize = 1024;

/// What fields are compared with.
#[derive(Debug)]
pub(super) struct Truth {
    /// Whether signed distances are all that is compared; then there are no crops.
    shape_only: bool,
    pub(super) targets: Vec<Target>,
    crops: Vec<Crop>,
    rays: RayList,
    /// Empty without the recipe that compares it.
    surface: Surface,
    /// Points with signed distances; empty without that recipe.
    pub(super) distances: Distances,
}

/// The loss of a field, and the cotangents of what it compares.
#[derive(Debug)]
pub(super) struct ObjectLoss {
    pub(super) loss: f32,
    /// The crops; none if only the shape is compared.
    render: Option<Render>,
    distances_bar: Vec<f32>,
}

/// Rendered crops with the cotangents of their values.
#[derive(Debug)]
struct Render {
    plan: Plan,
    out: render::Out,
    values_bar: Vec<f32>,
    opacity_bar: Vec<f32>,
    points_bar: Vec<[f32; 3]>,
    /// Rays whose numerical normals are compared, and the cotangents of these.
    surface: AtSurface,
    normals_bar: Vec<[f32; 3]>,
}

/// True points of the surface at rays, and 1 where there is one.
type Surface = Vec<([f32; 3], f32)>;

/// The rays of all crops and, if they are compared, the points where they meet the true surface.
fn rays_of(targets: &[Target], crops: &[Crop], is_compared: bool) -> (RayList, Surface) {
    let (mut rays, mut points) = (RayList::default(), Vec::new());
    for crop in crops {
        let (target, first) = (&targets[crop.view], rays.origins.len());
        crop.pixels(target.camera.width).for_each(|i| rays.push(&target.camera, i));
        if is_compared {
            let own = rays.origins[first..].iter().copied().zip(rays.directions[first..].iter().copied());
            points.extend(surface(target, crop, &own.collect::<Vec<_>>()));
        }
    }
    (rays, points)
}

/// The points at which the rays of a crop meet the surface, from the pass of depth; only pixels that are
/// covered completely count.
fn surface(target: &Target, crop: &Crop, rays: &[([f32; 3], [f32; 3])]) -> Surface {
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

impl Truth {
    /// Takes crops of the target images, whose places are drawn from `seed`; none if there are no targets.
    pub(super) fn new(targets: Vec<Target>, distances: Distances, stage: &Stage, seed: u64) -> Self {
        let [_, side] = stage.target;
        let shape_only = targets.is_empty();
        let crops = crops::draw(&targets, seed, 0, if shape_only { 0 } else { CROPS }, side);
        let (rays, surface) = rays_of(&targets, &crops, stage.points > 0.0);
        Self { shape_only, targets, crops, rays, surface, distances }
    }

    /// Compares a field with the truth: its signed distances, and its crops unless only the shape counts.
    pub(super) fn losses(&self, field: &Field, weight: f32, stage: &Stage) -> Result<ObjectLoss> {
        let own = weight * stage.distances;
        let (sdf, distances_bar) = self.distances.compare(field, own)?;
        if self.shape_only {
            return Ok(ObjectLoss { loss: sdf, render: None, distances_bar });
        }
        let (mut loss, mut render) = self.render(field, weight, stage)?;
        loss += sdf;
        if stage.is_last {
            loss += self.compare_normals(field, weight, &mut render)?;
        }
        Ok(ObjectLoss { loss, render: Some(render), distances_bar })
    }

    /// Renders the crops of a field and compares them.
    fn render(&self, field: &Field, weight: f32, stage: &Stage) -> Result<(f32, Render)> {
        let weights = Weights::of(field);
        let scene = weights.scene(self.rays.borrowed());
        let intervals = match stage.is_last {
            true => filled(field, CELLS)?.intervals(scene.rays, scene.step()),
            false => scene.all_intervals(),
        };
        let mut plan = Plan::new(intervals);
        let out = render::forward(&scene, &mut plan);
        let mut rendered = Rendered::new(&out.values, &out.opacity, scene.channels());
        let of_object = || albedo_scale(&self.targets, &self.crops, &rendered);
        let scale = if stage.absolute_albedo { None } else { of_object() };
        let terms = Terms {
            weight: weight / self.crops.len() as f32,
            passes: true,
            material: stage.material,
            normal: stage.normal_weight,
            lpips: None,
            scale,
        };
        let (mut loss, mut first) = (0.0, 0);
        for crop in &self.crops {
            loss += terms.add(&self.targets[crop.view], crop, first, None, &mut rendered)?;
            first += crop.size[0] * crop.size[1];
        }
        let (values_bar, opacity_bar) = (rendered.values_bar, rendered.opacity_bar);
        let (distance, points_bar) = self.compare_points(&out, [weight, stage.points])?;
        loss += distance;
        let (surface, normals_bar) = (AtSurface::default(), Vec::new());
        Ok((loss, Render { plan, out, values_bar, opacity_bar, points_bar, surface, normals_bar }))
    }

    /// The loss of numerical normals at the surface.
    fn compare_normals(&self, field: &Field, weight: f32, render: &mut Render) -> Result<f32> {
        let surface = AtSurface::of(&self.targets, &self.crops, &render.out);
        if surface.rays.is_empty() {
            return Ok(0.0);
        }
        let normals = Stencils::at(field, &surface.points).normals;
        render.normals_bar = vec![[0.0; 3]; normals.len()];
        let bar = &mut render.normals_bar;
        let loss = surface.compare(&self.targets, &self.crops, &normals, weight * NORMALS, bar)?;
        render.surface = surface;
        Ok(loss)
    }

    /// The mean squared distance between the surface points of the rays and the true ones, plus that along
    /// the optical axes, where a ray is opaque; over all rays.
    fn compare_points(&self, out: &render::Out, [whole, own]: [f32; 2]) -> Result<(f32, Vec<[f32; 3]>)> {
        if self.surface.is_empty() {
            return Ok((0.0, Vec::new()));
        }
        let n = out.points.len();
        let axes = self.crops.iter().flat_map(|crop| {
            let axis = self.targets[crop.view].camera.rotation[2];
            std::iter::repeat_n(axis, crop.size[0] * crop.size[1])
        });
        // Rows of x, y, z, and the part along the axis.
        let row = |x: [f32; 3], a: [f32; 3]| [x[0], x[1], x[2], (x[0] * a[0] + x[1] * a[1]) + x[2] * a[2]];
        let (mut x, mut y, mut mask, mut directions) =
            (Vec::new(), Vec::new(), Vec::new(), Vec::with_capacity(n));
        let rays = out.points.iter().zip(&out.opacity).zip(&self.surface).zip(axes);
        for (((point, opacity), (truth, is_there)), axis) in rays {
            x.extend(row(*point, axis));
            y.extend(row(*truth, axis));
            // The surface point of a ray that is not opaque is not on the surface.
            mask.extend([if *opacity > render::VALID { *is_there } else { 0.0 }; 4]);
            directions.push(axis);
        }
        let pair = loss::In { x: &x, y: &y, mask: Some(&mask), height: 4 * n, width: 1 };
        let (value, saved) = mse::forward_over(&pair, mse::Over::All)?;
        // The mean over all rows instead of all numbers.
        let weight = 4.0 * whole * own;
        let mut x_bar = vec![0.0; x.len()];
        mse::adjoint(&pair, &saved, weight, &mut x_bar, None);
        let back = |(row, axis): (&[f32; 4], &[f32; 3])| std::array::from_fn(|k| row[k] + row[3] * axis[k]);
        let points = x_bar.as_chunks::<4>().0.iter().zip(&directions).map(back).collect();
        Ok((weight * value, points))
    }

    /// The gradients of a field.
    pub(super) fn pull(&self, field: &Field, compared: &ObjectLoss) -> InBar {
        let weights = Weights::of(field);
        let scene = weights.scene(self.rays.borrowed());
        let mut bar = InBar::zeros_like(&scene);
        if let Some(Render { plan, out, values_bar, opacity_bar, points_bar, .. }) = &compared.render {
            let out_bar =
                OutBar { values: values_bar, opacity: opacity_bar, points: points_bar, ..OutBar::default() };
            render::adjoint(&scene, plan, out, &out_bar, CHUNK, &mut bar);
        }
        self.distances.pull(field, &compared.distances_bar, &mut bar);
        if let Some(Render { surface, normals_bar, .. }) = &compared.render
            && !normals_bar.is_empty()
        {
            let stencils = Stencils::at(field, &surface.points);
            let zeros = vec![[0.0; 3]; normals_bar.len()];
            stencils.pull(&zeros, normals_bar, &mut bar.planes, &mut bar.heads.sdf);
        }
        bar
    }
}

#[cfg(test)]
mod tests {
    use super::super::draws::Draws;
    use super::super::object::Object;
    use super::super::source::{BuiltInObjects, Pool};
    use super::*;
    use crate::lirm::model::config::Config;
    use crate::lirm::model::params::first;
    use crate::lirm::model::weights::Ready;
    use crate::num::rng::Rng;

    const TINY: Config = Config {
        blocks: 1,
        width: 16,
        heads: 2,
        plane_tokens: 2,
        embed_tokens: 1,
        channels: 4,
        ..Config::SMALL
    };

    /// The truth of an object of a stage, and the field that a model with first values makes of its first set.
    fn made(stage: &Stage) -> (Truth, Field) {
        let source = BuiltInObjects::new(0);
        let mut pool = Pool::new(&source);
        let draws = Draws { seed: 0, stage, batch: 1, block: 1, uses: 1 };
        pool.fill(&draws, 0).expect("an object");
        let config = Config { is_whole: stage.is_whole, ..TINY };
        let mut object = Object::new(&draws, &config, 0, 0, &pool).expect("valid");
        let params = first(&config, 0);
        let ready = Ready::new(config, &params);
        let (state, _) = ready.read(&ready.no_state(), &object.sets[0], None);
        let mut field = ready.decode(&state, stage.rendering(0), object.placement);
        // Larger texels, so that the signed distance is not the sphere alone.
        let rng = Rng::new(3);
        let texels = field.planes.values.iter_mut().enumerate();
        texels.for_each(|(i, x)| *x += 2.0 * rng.uniform_f32(i as u64, 0, 1, 0) - 1.0);
        (object.truths.remove(0), field)
    }

    fn stage() -> Stage {
        Stage { samples: 24, target: [64, 24], ..Stage::named("1a").expect("a name") }
    }

    #[test]
    fn gradients_of_the_terms_of_all_recipes_are_difference_quotients() {
        let [plain, points, distances] = [[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]].map(|[points, distances]| {
            Stage { points, distances, inverse_beta: [200.0; 2], samples: 64, ..stage() }
        });
        let mut losses = Vec::new();
        for stage in [&plain, &points, &distances] {
            let (truth, field) = made(stage);
            let compared = truth.losses(&field, 1.0, stage).expect("finite");
            assert!(truth.rays.origins.len() > 2 * CHUNK, "gradients are made part by part");
            let g = truth.pull(&field, &compared).planes;
            let square = g.iter().fold(0.0, |s, g| s + f64::from(*g) * f64::from(*g));
            let moved = |h: f64| {
                let mut field = field.clone();
                let texels = field.planes.values.iter_mut().zip(&g);
                texels.for_each(|(x, g)| *x += (h * f64::from(*g) / square.sqrt()) as f32);
                f64::from(truth.losses(&field, 1.0, stage).expect("finite").loss)
            };
            // After a longer step other rays are opaque, and their points count.
            let slope = (moved(0.0005) - moved(-0.0005)) / 0.001;
            assert!((slope - square.sqrt()).abs() < 0.03 * square.sqrt(), "{slope} {}", square.sqrt());
            losses.push(compared.loss);
        }
        assert!(losses[1..].iter().all(|x| *x > losses[0]), "both terms count: {losses:?}");
    }

    #[test]
    fn materials_and_normals_have_a_factor_and_albedo_is_compared_as_it_is_or_not() {
        let whole = Stage {
            inverse_beta: [200.0; 2],
            samples: 64,
            target: [64, 16],
            ..Stage::named("2a").expect("a name")
        };
        let (truth, field) = made(&whole);
        let of = |stage: &Stage| truth.losses(&field, 1.0, stage).expect("finite");
        let [none, one, three] =
            [0.0, 1.0, 3.0].map(|material| of(&Stage { material, ..whole.clone() }).loss);
        let own = one - none;
        assert!(own > 1e-3 && (three - none - 3.0 * own).abs() < 1e-3 * own, "{none} {one} {three}");
        let [none, one, three] =
            [0.0, 1.0, 3.0].map(|normal_weight| of(&Stage { normal_weight, ..whole.clone() }).loss);
        let own = one - none;
        assert!(own > 1e-3 && (three - none - 3.0 * own).abs() < 1e-3 * own, "{none} {one} {three}");
        let three = of(&Stage { material: 3.0, ..whole.clone() }).loss;
        let absolute = Stage { absolute_albedo: true, material: 3.0, ..whole.clone() };
        let compared = of(&absolute);
        assert!((compared.loss - three).abs() > 1e-3, "{} {three}", compared.loss);
        // The gradient of both settings.
        let g = truth.pull(&field, &compared).planes;
        let length = g.iter().fold(0.0, |s, g| s + f64::from(*g) * f64::from(*g)).sqrt();
        let moved = |h: f64| {
            let mut field = field.clone();
            let texels = field.planes.values.iter_mut().zip(&g);
            texels.for_each(|(x, g)| *x += (h * f64::from(*g) / length) as f32);
            f64::from(truth.losses(&field, 1.0, &absolute).expect("finite").loss)
        };
        let slope = (moved(0.0005) - moved(-0.0005)) / 0.001;
        assert!((slope - length).abs() < 0.03 * length, "{slope} {length}");
    }

    #[test]
    fn the_last_stage_compares_numerical_normals() {
        let sharp = Stage { inverse_beta: [200.0; 2], samples: 64, ..stage() };
        let last = Stage { is_last: true, ..sharp.clone() };
        let (truth, field) = made(&last);
        let [with, without] = [&last, &sharp].map(|s| truth.losses(&field, 1.0, s).expect("finite"));
        let opaque = with.render.as_ref().map_or(0, |render| render.surface.rays.len());
        assert!(opaque > 0, "some rays are opaque");
        assert!(with.loss > without.loss + 1e-4, "{} {}", with.loss, without.loss);
        // Their gradient, at points that do not move with the texels.
        let mut others = truth.losses(&field, 1.0, &last).expect("finite");
        others.render.as_mut().expect("a render").normals_bar.clear();
        let [all, others] = [&with, &others].map(|compared| truth.pull(&field, compared).planes);
        let g: Vec<f64> = all.iter().zip(&others).map(|(a, b)| f64::from(*a) - f64::from(*b)).collect();
        let length = g.iter().fold(0.0, |s, g| s + g * g).sqrt();
        let surface = &with.render.as_ref().expect("a render").surface;
        let moved = |h: f64| {
            let mut field = field.clone();
            let texels = field.planes.values.iter_mut().zip(&g);
            texels.for_each(|(x, g)| *x += (h * g / length) as f32);
            let normals = Stencils::at(&field, &surface.points).normals;
            let mut bar = vec![[0.0; 3]; normals.len()];
            let loss = surface.compare(&truth.targets, &truth.crops, &normals, NORMALS, &mut bar);
            f64::from(loss.expect("finite"))
        };
        let slope = (moved(0.01) - moved(-0.01)) / 0.02;
        assert!((slope - length).abs() < 0.03 * length, "{slope} {length}");
    }
}
