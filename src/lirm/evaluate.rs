//! Scores of a model on objects that it was not trained on, after every set of images.
//!
//! The protocol is that of the test views ([`data_gen::cameras::test`]): sixteen inputs in four sets of four, in a random order or around the
//! object, and twelve outputs from other directions. Inputs are read at 64², outputs are rendered and compared at 128². Beside the
//! model stand the baselines of [`super::baselines`] with the inputs so far.

use super::baselines::{Hull, nearest};
use super::r#gen::{Lighting, Set, Settings};
use super::model::decode::Look;
use super::model::transformer::Input;
use super::model::weights::Ready;
use super::views::{View, Views};
use crate::Result;
use crate::fit::evaluate::compare;
use crate::fit::field::view;
use crate::num::sum;
use data_gen::cameras;
use serde_json::{Value, json};

/// Images of a set.
pub const SET: usize = 4;
/// Pixels per side of an image that is rendered, and of one that is read.
const SIDES: [usize; 2] = [128, 64];

/// Order of the inputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Random.
    Random,
    /// By azimuth: every set shows one side.
    Sequential,
}

/// PSNR in dB of one object after one set of images, means over its outputs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Round {
    /// Of the model.
    pub model: f64,
    /// Of the nearest input.
    pub nearest: f64,
    /// Of the visual hull.
    pub hull: f64,
}

/// The scores of one object.
#[derive(Clone, Debug)]
pub struct Scores {
    /// Index of the object.
    pub object: u64,
    /// After every set.
    pub rounds: Vec<Round>,
    /// Of every set, the first output: the model's image and the truth, (H, W, 3).
    pub images: Vec<[Vec<f32>; 2]>,
}

/// The settings of the test set of a seed.
pub fn settings(seed: u64, samples: u32) -> Settings {
    Settings {
        lighting: Lighting::Both,
        shiny: true,
        set: Set::Test,
        size: SIDES[0],
        samples,
        seed,
        ..Settings::default()
    }
}

/// Scores a model on an object of a test set.
///
/// # Errors
/// If the object cannot be made, or a render is not finite.
pub fn object(
    ready: &Ready<'_>,
    of: &Settings,
    k: u64,
    version: &str,
    order: Order,
    look: Look,
) -> Result<Scores> {
    let views = Views::rendered(of, k, version)?;
    let small = views.small(SIDES[0] / SIDES[1])?;
    let protocol = cameras::test(of.seed, k, of.size);
    let inputs = match order {
        Order::Random => protocol.inputs,
        Order::Sequential => protocol.sequential,
    };
    let (mut state, mut scores) =
        (ready.no_state(), Scores { object: k, rounds: Vec::new(), images: Vec::new() });
    for (round, set) in inputs.chunks(SET).enumerate() {
        let read: Vec<Input> =
            set.iter().map(|i| Input::of(&small.all[*i], &small.placement, ready.config.is_whole)).collect();
        state = ready.read(&state, &read, None).0;
        let field = ready.decode(&state, look, views.placement);
        let so_far: Vec<&View> = inputs[..SET * (round + 1)].iter().map(|i| &views.all[*i]).collect();
        let hull = Hull::new(&so_far);
        let mut all: [Vec<f64>; 3] = Default::default();
        for (n, i) in protocol.outputs.iter().enumerate() {
            let truth = views.target(*i);
            let camera = &truth.camera;
            let image = view::render(&field, None, camera, false).color().expect("fields have a colour");
            let size = [camera.height, camera.width];
            let colored = truth.colored.as_deref();
            let db = |x: &[f32]| -> Result<f64> {
                Ok(compare(&truth.name, x, &truth.color, colored, size)?.score.psnr_db)
            };
            all[0].push(db(&image)?);
            all[1].push(db(&nearest(&so_far, camera).picture.color)?);
            all[2].push(db(&hull.image(camera))?);
            if n == 0 {
                scores.images.push([image, truth.color.clone()]);
            }
        }
        let [model, nearest, hull] = all.map(|x| sum::tree_f64(&x) / x.len() as f64);
        scores.rounds.push(Round { model, nearest, hull });
    }
    Ok(scores)
}

/// Means over objects as a JSON record.
pub fn means(all: &[Scores]) -> Value {
    let rounds = all.first().map_or(0, |s| s.rounds.len());
    let mean = |r: usize, of: fn(&Round) -> f64| {
        let x: Vec<f64> = all.iter().map(|s| of(&s.rounds[r])).collect();
        sum::tree_f64(&x) / x.len() as f64
    };
    let one = |r: usize| {
        json!({
            "images": SET * (r + 1), "psnr_db": mean(r, |x| x.model), "nearest_db": mean(r, |x| x.nearest),
            "hull_db": mean(r, |x| x.hull),
        })
    };
    Value::Array((0..rounds).map(one).collect())
}
