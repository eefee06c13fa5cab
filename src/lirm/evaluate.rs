//! Scores of a model on objects that it was not trained on, after every set of images.
//!
//! The protocol is that of the test views ([`data_gen::cameras::test`]): sixteen inputs in four sets of four,
//! in a random order or around the object, and twelve outputs from other directions. Inputs are read at 64²,
//! outputs are rendered and compared at 128². Beside the model stand the baselines of [`super::baselines`]
//! with the inputs so far and, for materials, means and medians of training objects.
//!
//! | name | of an output, then mean over outputs | |
//! |---|---|---|
//! | `psnr_db`, `nearest_db`, `hull_db` | PSNR over white: model, nearest input, visual hull | dB |
//! | `small_hull_db` | the same of the visual hull of the images of 64² that the model reads; the other baselines have those of 128² | dB |
//! | `blurred_hull_db` | the same of the image of the hull, blurred by a pixel ([`super::baselines::blurred`]) | dB |
//! | `ssim` | structural similarity | |
//! | `rfd` | distance of responses to random filters; not LPIPS | |
//! | `foreground_iou`, `hull_iou` | pixels that are covered in both / in one, by half or more | |
//! | `color`, `gray` | of the mean colours of the object in image and truth, absolute difference, mean over channels; of a grey with the true brightness and the truth | 0 to 1, encoded |
//! | `numerical_normals_deg` | angle of numerical normals | degrees |
//! | `depth` | absolute difference of depth | units of the object: the ball has the radius ½ |
//! | `albedo_db`, `mean_albedo_db` | PSNR of albedo after the least-squares scale of each channel, of outputs where at least 20 pixels count; of the mean of training objects | dB |
//! | `albedo_error`, `mean_albedo_error` | root mean square error of linear albedo after one least-squares factor for all channels, of the same outputs; of the mean of training objects | 0 to 1, linear |
//! | `input_albedo_error` | the same of a constant with the mean linear colour of the inputs so far, where the object covers a pixel completely; it has the right hue without any model | 0 to 1, linear |
//! | `roughness`, `metallic` | absolute error | |
//! | `mean_roughness`, `median_roughness`, `mean_metallic`, `median_metallic` | the same of a constant, the mean or the median of training objects; of constants, the median has the smallest error on their pixels | |
//! | `distance_radii` | mean distance between the surfaces, samples to triangles | radii of the object |
//! | `psnr_h_db`, `psnr_l_db`, `orb_ssim` | PSNR and SSIM-3 of Stanford-ORB, of linear values after a scale per channel ([`orb`]) | dB, dB, |
//! | `orb_normals`, `orb_depth` | 1 − cos of normals in the eroded mask; squared error of depth after one scale per object, over the whole images | , squares of units of the world |
//! | `orb_shape` | squared distances between the surface and the vertices of the truth, mean of both directions ([`Shape`]) | squares of units of the world |
//!
//! # Noise
//! Inputs and outputs are traced with some samples per pixel ([`settings`]), and their noise limits every
//! score: the first six objects of seed 1 have 21.0 dB with two samples, where the same model has 23.4 dB
//! with 64. Only scores with equal samples compare.
//!
//! # Colours
//! Built-in objects are nearly grey: a model that ignores hue loses little. With a tint ([`score_object`]) every
//! object has a random colour, `gray` becomes large, and `color` shows whether the model has read it.
//! (`albedo_db` does not: its channels are scaled one by one. A constant then has the object's own mean colour,
//! and shows an object of one colour with 40 dB and more, so its mean over objects is that of a few of them;
//! `albedo_error` is the score that compares a model with the mean of training objects.)
//!
//! # Controls
//! [`Control`] breaks one input of the model; if the score does not fall, the model does not use that input.

use super::baselines::{Hull, blurred, nearest};
use super::model::transformer::Input;
use super::model::weights::Ready;
use super::protocol::SIDE;
pub use super::protocol::{Control, Order, Protocol, Typical, settings, typical_materials};
use super::reading::INPUT_SIDE;
use super::subject::Subject;
use super::views::{View, Views, tint};
use crate::fit::evaluate::compare;
use crate::fit::field::benchmark::{self, Shape, ViewScores};
use crate::fit::field::targets::target;
use crate::fit::field::{Target, mesh, scores, view};
use crate::loss;
use crate::loss::metric::{orb, rfd};
use crate::num::rng::Rng;
use crate::num::sum;
use crate::scene::field::Placement;
use crate::{Error, Result};
use data_gen::cameras;
pub use data_gen::cameras::SET;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};

/// Cells per axis of the grid from which the surface is extracted.
const CELLS: usize = 96;
/// Tint of an object; the item is the object.
const TINT: u16 = 0x0557;

/// Numbers by name.
pub type Numbers = BTreeMap<&'static str, f64>;

/// The scores of one object.
#[derive(Clone, Debug)]
pub struct Scores {
    /// Index of the object.
    pub object: u64,
    /// After every set.
    pub rounds: Vec<Numbers>,
    /// Of every set, the first output: the model's image and the truth, (H, W, 3).
    pub images: Vec<[Vec<f32>; 2]>,
}

/// The intersection of two foregrounds over their union; 1 if both are empty.
fn overlap(a: &[f32], b: &[f32]) -> f64 {
    let pairs = || a.iter().zip(b).map(|(a, b)| (*a >= 0.5, *b >= 0.5));
    let both = pairs().filter(|(a, b)| *a && *b).count();
    let one = pairs().filter(|(a, b)| *a || *b).count();
    if one == 0 { 1.0 } else { both as f64 / one as f64 }
}

/// The mean colour of an image (H, W, 3) where the object covers a pixel completely; `None` if it does
/// nowhere.
fn mean_color(image: &[f32], foreground: &[f32]) -> Option<[f64; 3]> {
    let pixels = image.as_chunks::<3>().0.iter().zip(foreground);
    let (mut sum, mut n) = ([0.0; 3], 0.0);
    for (x, _) in pixels.filter(|(_, m)| **m == 1.0) {
        (0..3).for_each(|c| sum[c] += f64::from(x[c]));
        n += 1.0;
    }
    (n > 0.0).then(|| sum.map(|s| s / n))
}

/// The mean of linear colours over the pixels of some images that the object covers completely, encoded; `None`
/// if it covers none.
fn mean_albedo(views: &[View]) -> Option<[f32; 3]> {
    let linear: Vec<[f64; 3]> = views
        .iter()
        .flat_map(|view| {
            let picture = &view.picture;
            let pixels = picture.color.as_chunks::<3>().0.iter().zip(&picture.foreground);
            pixels.filter(|(_, m)| **m == 1.0).map(|(x, _)| x.map(|x| orb::decode(f64::from(x))))
        })
        .collect();
    let mean = |c: usize| {
        let values: Vec<f64> = linear.iter().map(|x| x[c]).collect();
        orb::encode(sum::tree_f64(&values) / values.len() as f64) as f32
    };
    (!linear.is_empty()).then(|| std::array::from_fn(mean))
}

/// The mean absolute difference of two colours.
fn difference(a: [f64; 3], b: [f64; 3]) -> f64 {
    let of = |c: usize| (a[c] - b[c]).abs();
    ((of(0) + of(1)) + of(2)) / 3.0
}

/// A constant image where the object is.
fn constant<const N: usize>(target: &Target, value: [f32; N]) -> Vec<f32> {
    target.foreground.iter().flat_map(|m| value.map(|v| v * m + (1.0 - m))).collect()
}

/// Inputs of every set, some of them broken. From the second set on, they are those of `other` if it is
/// there.
fn inputs(
    ready: &Ready<'_>,
    p: &Protocol,
    k: u64,
    (views, small): (&Views, &Views),
    other: Option<&Views>,
) -> Result<Vec<Vec<Input>>> {
    let other = other.map(|other| other.small(SIDE / INPUT_SIDE)).transpose()?;
    let input = |of: &Views, at: &Placement, i: usize, camera: usize| {
        let mut view = of.all[i].clone();
        view.picture.camera = of.all[camera].picture.camera.clone();
        let mut input = Input::of(&view, at, &ready.config);
        if p.control == Control::SwappedColors {
            let pixels = [&mut input.image, &mut input.photo].map(|x| x.as_chunks_mut::<3>().0);
            pixels.into_iter().flatten().for_each(|pixel| pixel.swap(0, 1));
        }
        input
    };
    let one = |(set, which): (usize, &[usize])| {
        let of = other.as_ref().filter(|_| set > 0).unwrap_or(small);
        let camera = |n: usize| match p.control {
            Control::PermutedCameras => which[(n + 1) % which.len()],
            _ => which[n],
        };
        let at = axes(ready, p, k, views, set)?;
        Ok(which.iter().enumerate().map(|(n, i)| input(of, &at, *i, camera(n))).collect())
    };
    let order = order_of(p, k);
    order.chunks(SET).take(p.sets).enumerate().map(one).collect()
}

/// The outputs of an object that are compared.
fn outputs_of(p: &Protocol, k: u64) -> Vec<usize> {
    cameras::test(p.set.seed, k, p.set.size).outputs.into_iter().take(p.outputs).collect()
}

/// The inputs of an object in the order of the protocol.
fn order_of(p: &Protocol, k: u64) -> Vec<usize> {
    let protocol = cameras::test(p.set.seed, k, p.set.size);
    match p.order {
        Order::Random => protocol.inputs.to_vec(),
        Order::Sequential => protocol.sequential.to_vec(),
    }
}

/// The place of an object in the axes of the model, from the inputs of the first set; of every set, if the
/// state is zeroed before it.
///
/// # Errors
/// When the images do not show which direction is up.
fn axes(ready: &Ready<'_>, p: &Protocol, k: u64, views: &Views, set: usize) -> Result<Placement> {
    let set = if p.control == Control::ZeroedState { set } else { 0 };
    views.posed(ready.config.pose, &order_of(p, k)[SET * set..SET * (set + 1)])
}

/// The images of object k of a seed, multiplied by its random colour.
fn tinted(views: Views, strength: f64, seed: u64, k: u64) -> Views {
    let rng = Rng::new(seed);
    views.lit(tint(1.0, strength, std::array::from_fn(|c| rng.uniform_f64(k, 0, TINT, c as u16))))
}

/// Scores a model on an object of a test set, whose colours are multiplied by a random one of a strength
/// ([`super::views::tint`]; 0: they stay).
///
/// # Errors
/// If the object cannot be made, or a render is not finite.
pub fn score_object(ready: &Ready<'_>, p: &Protocol, k: u64, strength: f64) -> Result<Scores> {
    let rendered =
        |k: u64| Ok::<_, Error>(tinted(Views::rendered(&p.set, k, p.version)?, strength, p.set.seed, k));
    let other = (p.control == Control::OtherObject).then(|| rendered(k + 1)).transpose()?;
    score_views(ready, p, k, &rendered(k)?, other.as_ref())
}

/// [`score_object`] with images that are there, as they are: those of object k, and those that the sets after the
/// first show instead.
///
/// # Errors
/// If a render is not finite.
///
/// # Panics
/// If there are fewer images than those of a test set, 48.
pub fn score_views(
    ready: &Ready<'_>,
    p: &Protocol,
    k: u64,
    views: &Views,
    other: Option<&Views>,
) -> Result<Scores> {
    let order = order_of(p, k);
    let mut state = ready.no_state();
    let mut scored = Scores { object: k, rounds: Vec::new(), images: Vec::new() };
    let small = views.small(SIDE / INPUT_SIDE)?;
    let sets = inputs(ready, p, k, (views, &small), other)?;
    for (round, set) in sets.iter().enumerate() {
        if matches!(p.control, Control::ZeroedState | Control::AtOnce) {
            state = ready.no_state();
        }
        state = match p.control {
            Control::AtOnce => ready.read(&state, &sets[..=round].concat(), None).0,
            _ => ready.read(&state, set, None).0,
        };
        let at = axes(ready, p, k, views, round)?;
        let so_far = |of: &'_ Views| -> Vec<View> {
            order[..SET * (round + 1)].iter().map(|i| of.all[*i].clone()).collect()
        };
        let color = mean_albedo(&so_far(&small));
        let (mut numbers, image) = score_state_and_image(ready, p, (&state, at), k, views, color)?;
        if p.baselines {
            numbers.extend(score_baselines(p, k, views, [so_far(views), so_far(&small)])?);
        }
        scored.rounds.push(numbers);
        scored.images.push(image);
    }
    Ok(scored)
}

/// Means by name, each over the outputs that have it: an angle is missing where nothing is opaque.
fn averaged(all: BTreeMap<&'static str, Vec<f64>>) -> Numbers {
    all.into_iter().map(|(name, x)| (name, sum::tree_f64(&x) / x.len() as f64)).collect()
}

/// The scores of the nearest input and of the hull of some inputs, in full and as the model reads them.
fn score_baselines(p: &Protocol, k: u64, views: &Views, so_far: [Vec<View>; 2]) -> Result<Numbers> {
    let [so_far, small] = so_far.each_ref().map(|views| views.iter().collect::<Vec<&View>>());
    let [hull, small] = [&so_far, &small].map(|views| Hull::new(views));
    let mut all: BTreeMap<&'static str, Vec<f64>> = BTreeMap::new();
    for i in outputs_of(p, k) {
        let truth = views.target(i);
        let size = [truth.camera.height, truth.camera.width];
        let db = |x: &[f32]| -> Result<f64> {
            Ok(compare(&truth.name, x, &truth.color, truth.colored.as_deref(), size)?.score.psnr_db)
        };
        let (carved, covered) = hull.image(&truth.camera);
        let mut put = |name: &'static str, x: f64| all.entry(name).or_default().push(x);
        put("nearest_db", db(&nearest(&so_far, &truth.camera).picture.color)?);
        put("hull_db", db(&carved)?);
        put("blurred_hull_db", db(&blurred(&carved, size))?);
        put("small_hull_db", db(&small.image(&truth.camera).0)?);
        put("hull_iou", overlap(&covered, &truth.foreground));
    }
    Ok(averaged(all))
}

/// The scores of a state and its place, without baselines.
///
/// # Errors
/// If a render is not finite.
///
/// # Panics
/// If there are fewer images than those of a test set, 48, or the state is not one of the model.
pub fn score_state(
    ready: &Ready<'_>,
    p: &Protocol,
    state: (&[f32], Placement),
    k: u64,
    views: &Views,
) -> Result<Numbers> {
    Ok(score_state_and_image(ready, p, state, k, views, None)?.0)
}

/// The scores of a state, and its first output beside the truth; the colour is that of its inputs.
fn score_state_and_image(
    ready: &Ready<'_>,
    p: &Protocol,
    (state, at): (&[f32], Placement),
    k: u64,
    views: &Views,
    color: Option<[f32; 3]>,
) -> Result<(Numbers, [Vec<f32>; 2])> {
    let field = ready.decode(state, p.rendering, at);
    let cells = view::occupancy(&field)?;
    let mut all: BTreeMap<&'static str, Vec<f64>> = BTreeMap::new();
    let mut first = None;
    let mut shown: Vec<(ViewScores, Target)> = Vec::new();
    for i in outputs_of(p, k) {
        let picture = &views.all[i].picture;
        let truth = target(picture, &at);
        let (mut numbers, scores) = score_output(&field, &cells, &truth, p, color)?;
        // Built-in objects have exposures of their own, so the other one is not read.
        let view = benchmark::view(&scores, &truth, &benchmark::truth(picture, 1.0), at.scale, None)?;
        // The linear truth is the radiance; a photo has lost what was brighter than white.
        if let Some(s) = view.image.as_ref().filter(|_| picture.passes.radiance.is_some()) {
            numbers.extend([("psnr_h_db", s.psnr_h_db), ("psnr_l_db", s.psnr_l_db), ("orb_ssim", s.ssim)]);
        }
        numbers.into_iter().for_each(|(name, x)| all.entry(name).or_default().push(x));
        first.get_or_insert_with(|| [scores.image.image, truth.color.clone()]);
        shown.push((view, truth));
    }
    let mut numbers = averaged(all);
    let geometry = benchmark::geometry(&shown.iter().map(|(v, t)| (v, t)).collect::<Vec<_>>(), at.scale)?;
    let of_geometry = [("orb_normals", "normals"), ("orb_depth", "depth")];
    numbers.extend(of_geometry.iter().filter_map(|(name, key)| Some((*name, geometry[key].as_f64()?))));
    if p.shapes {
        let truth = Subject::new(&p.set, k)?.object.mesh;
        let settings = mesh::Settings { side: CELLS, ..mesh::Settings::default() };
        // A field without a surface has no distance; how many have one is a number of its own.
        let found = mesh::shape(&field, &settings)?;
        numbers.insert("has_surface", if found.is_some() { 1.0 } else { 0.0 });
        if let Some((mut surface, ..)) = found {
            for x in &mut surface.positions {
                *x = at.to_world(x.map(f64::from)).map(|x| x as f32);
            }
            let shape = Shape::of(&surface, &truth, p.set.seed)?;
            numbers.insert("distance_radii", shape.distance());
            numbers.insert("orb_shape", shape.scan.value());
        }
    }
    Ok((numbers, first.unwrap_or_default()))
}

/// The scores of one output, and what they are made of.
fn score_output(
    field: &crate::scene::field::Field,
    cells: &crate::field::occupancy::Occupancy,
    truth: &Target,
    p: &Protocol,
    color: Option<[f32; 3]>,
) -> Result<(Numbers, scores::Scores)> {
    let s = scores::score(field, cells, truth)?;
    let mut out = Numbers::new();
    let m = &s.materials;
    let of_model = [
        ("numerical_normals_deg", s.numerical_deg),
        ("depth", s.depth),
        ("albedo_db", m.albedo_aligned_db),
        ("albedo_error", m.albedo_error),
        ("roughness", m.roughness),
        ("metallic", m.metallic),
    ];
    out.extend(of_model.into_iter().filter_map(|(name, x)| Some((name, x?))));
    out.insert("psnr_db", s.image.score.psnr_db);
    out.insert("ssim", s.image.score.ssim);
    let (height, width) = (truth.camera.height, truth.camera.width);
    out.insert(
        "rfd",
        rfd::forward(&loss::In { x: &s.image.image, y: &truth.color, mask: None, height, width })?,
    );
    out.insert("foreground_iou", overlap(&s.images.opacity, &truth.foreground));
    let means = [&s.image.image, &truth.color].map(|x| mean_color(x, &truth.foreground));
    if let [Some(found), Some(wanted)] = means {
        let brightness = ((wanted[0] + wanted[1]) + wanted[2]) / 3.0;
        out.insert("color", difference(found, wanted));
        out.insert("gray", difference([brightness; 3], wanted));
    }
    if let Some(typical) = p.typical.filter(|_| m.albedo_db.is_some()) {
        // On the pixels that count for the model.
        let of = |albedo, material| {
            let (albedo, material) = (constant(truth, albedo), constant(truth, material));
            scores::materials(Some(&albedo), Some(&material), &s.images.opacity, truth)
        };
        let (mean, median) = (of(typical.albedo, typical.mean)?, of(typical.albedo, typical.median)?);
        let inputs = color.map(|color| of(color, typical.mean)).transpose()?;
        let of_constants = [
            ("mean_albedo_db", mean.albedo_aligned_db),
            ("mean_albedo_error", mean.albedo_error),
            ("input_albedo_error", inputs.and_then(|inputs| inputs.albedo_error)),
            ("mean_roughness", mean.roughness),
            ("mean_metallic", mean.metallic),
            ("median_roughness", median.roughness),
            ("median_metallic", median.metallic),
        ];
        out.extend(of_constants.into_iter().filter_map(|(name, x)| Some((name, x?))));
    }
    Ok((out, s))
}

/// Means over objects, each over those that have the number, as a JSON record. Distances of surfaces are over
/// the objects with a surface, whose part is `has_surface`.
pub fn means(all: &[Scores]) -> Value {
    let rounds = all.first().map_or(0, |s| s.rounds.len());
    let one = |r: usize| {
        let mut record = json!({ "images": SET * (r + 1) });
        let names: BTreeSet<&str> = all.iter().flat_map(|s| s.rounds[r].keys().copied()).collect();
        for name in names {
            let x: Vec<f64> = all.iter().filter_map(|s| s.rounds[r].get(name).copied()).collect();
            record[name] = json!(sum::tree_f64(&x) / x.len() as f64);
        }
        record
    };
    Value::Array((0..rounds).map(one).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::field::targets::Picture;
    use crate::r#gen::Settings;
    use crate::scene::passes::PassImages;

    #[test]
    fn the_colour_of_inputs_is_a_linear_mean_of_covered_pixels() {
        let settings = Settings { size: 8, views: 1, ..Settings::default() };
        let camera = crate::shots::shots(&settings, 0).0[0].middle();
        let view = |color: &[f32], foreground: &[f32]| View {
            picture: Picture {
                name: String::new(),
                camera: camera.clone(),
                color: color.to_vec(),
                foreground: foreground.to_vec(),
                kept: None,
                colored: None,
                passes: PassImages::default(),
                environment: None,
            },
            photo: Vec::new(),
        };
        // Black and white in one image, white in another; what is half covered has no part.
        let two = [
            view(&[0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.3, 0.4, 0.5], &[1.0, 1.0, 0.5]),
            view(&[1.0, 0.0, 1.0], &[1.0]),
        ];
        let mean = mean_albedo(&two).expect("covered pixels").map(|x| orb::decode(f64::from(x)));
        for (found, wanted) in mean.iter().zip([2.0 / 3.0, 1.0 / 3.0, 2.0 / 3.0]) {
            assert!((found - wanted).abs() < 1e-6, "{mean:?}");
        }
        assert_eq!(mean_albedo(&[view(&[0.3; 3], &[0.9])]), None);
    }
}
