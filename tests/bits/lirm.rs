//! A small LIRM: five steps of each kind of stage, then a set of images and a second one, read with the weights of the last stage.

use super::ball;
use super::runs::Entry;
use lastlight::Result;
use lastlight::fit::field::targets::{Picture, Target, placed};
use lastlight::fit::field::view;
use lastlight::fit::training::Fit;
use lastlight::lirm::r#gen::Version;
use lastlight::lirm::model::config::Config;
use lastlight::lirm::model::decode::Rendering;
use lastlight::lirm::model::params::first;
use lastlight::lirm::model::transformer::Input;
use lastlight::lirm::model::weights::Ready;
use lastlight::lirm::train::distances::Distances;
use lastlight::lirm::train::optimizer::Kind;
use lastlight::lirm::train::source::Source;
use lastlight::lirm::train::stage::{SIDE, Stage, USES, VIEWS};
use lastlight::lirm::train::{Settings, Training};
use lastlight::lirm::views::{View, Views};
use lastlight::num::array::Arrays;
use lastlight::scene::field::{Field, Placement};
use lastlight::scene::mesh::Mesh;
use lastlight::scene::passes::PassImages;

/// Steps of a stage.
const STEPS: usize = 5;
/// Images of a set that is read.
const SET: usize = 4;
/// Steps of a ray in a training: few, so that all kinds together take about two seconds.
const TRAINED_SAMPLES: usize = 8;
/// Steps of a ray in the image of a field.
const SAMPLES: usize = 24;
/// Pixels per side of the image of a field.
const SHOWN: usize = 24;

const TINY: Config =
    Config { blocks: 2, width: 16, heads: 2, plane_tokens: 2, embed_tokens: 2, channels: 4, ..Config::SMALL };

/// Kinds of training: name, stage, weight of signed distances, optimiser of the matrices.
const KINDS: [(&str, &str, f32, Kind); 5] = [
    ("1a", "1a", 0.0, Kind::AdamW),
    (SHAPE_FIRST, "1a", 10.0, Kind::Muon),
    ("2a", "2a", 0.0, Kind::AdamW),
    (INCLUDED, "2b", 10.0, Kind::Muon),
    ("3", "3", 0.0, Kind::AdamW),
];
/// A stage that begins on distances alone, draws for the second set, lets gradients flow through the state, and
/// averages its last steps.
const SHAPE_FIRST: &str = "1a on distances first, with updates, gradients through the state and a mean";
/// The second part of stage 2 with the options of the included weights: its rays end where they are opaque.
const INCLUDED: &str = "2b with a rate for heads, fewer uses, albedo as it is and updates";
/// Names of the two sets of images.
const READ: [&str; 2] = ["lirm.reconstruct", "lirm.update"];

/// The ball as every object, with its eight cameras in turn.
#[derive(Debug)]
struct Balls(Views);

impl Balls {
    fn new() -> Self {
        let eight: Vec<View> = (0..8).map(seen).collect();
        let all = (0..VIEWS).map(|i| eight[i % eight.len()].clone()).collect();
        Self(Views { all, placement: Placement::new([0.0; 3], 1.0) })
    }
}

/// The ball from camera `k`, before a grey background in the photo.
fn seen(k: usize) -> View {
    let Target { name, camera, color, foreground, albedo, material, normal, depth, .. } =
        ball::target(k, SIDE);
    let threes = |x: Option<Vec<f32>>| x.map(|x| x.as_chunks::<3>().0.to_vec());
    let one = |c: usize| material.as_ref().map(|m| m.as_chunks::<2>().0.iter().map(|m| m[c]).collect());
    let passes = PassImages {
        width: SIDE,
        height: SIDE,
        foreground: Some(foreground.clone()),
        depth,
        normal: threes(normal),
        albedo: threes(albedo),
        roughness: one(0),
        metallic: one(1),
        ..PassImages::default()
    };
    let behind = color.iter().enumerate().map(|(i, x)| x - 0.5 * (1.0 - foreground[i / 3])).collect();
    let picture =
        Picture { name, camera, color, foreground, kept: None, colored: None, passes, environment: None };
    View { picture, photo: behind }
}

/// An octahedron with the corners on the ball.
fn octahedron() -> Mesh {
    let corner = |axis: usize, sign: f32| {
        let mut at = ball::CENTER;
        at[axis] += sign * ball::RADIUS;
        at
    };
    let positions = (0..3).flat_map(|axis| [corner(axis, 1.0), corner(axis, -1.0)]).collect();
    let face = |i: u32| {
        let [x, y, z] = [i & 1, 2 + (i >> 1 & 1), 4 + (i >> 2 & 1)];
        // Counter-clockwise from outside where an even number of the three is negative.
        if i.count_ones().is_multiple_of(2) { [x, y, z] } else { [x, z, y] }
    };
    Mesh { positions, triangles: (0..8).map(face).collect(), ..Mesh::default() }
}

impl Source for Balls {
    fn object(&self, _: u64, _: Version) -> Result<Views> {
        Ok(self.0.clone())
    }

    fn distances(&self, k: u64) -> Result<Distances> {
        Distances::of(&octahedron(), 0, k)
    }

    fn record(&self) -> String {
        "balls".to_owned()
    }

    fn seed(&self) -> Option<u64> {
        None
    }
}

fn settings(stage: &str, distances: f32, optimizer: Kind) -> Settings {
    let stage = Stage::named(stage).expect("a stage").with_distances(distances);
    let stage = Stage { steps: STEPS, samples: TRAINED_SAMPLES, rise: 2, target: [64, 16], ..stage };
    Settings {
        stage,
        optimizer,
        head_rate: 1.0,
        seed: 5,
        batch: 2,
        block: 2,
        uses: USES,
        at_once: 2,
        recompute: false,
        average_last: 0,
        start_share: 0.0,
    }
}

fn trained(kind: &str) -> String {
    format!("lirm.train/{kind} {STEPS} steps")
}

/// Names of [`entries`].
pub(crate) fn names() -> Vec<String> {
    KINDS.iter().map(|(kind, ..)| trained(kind)).chain(READ.map(str::to_owned)).collect()
}

/// What a set of images adds: the state, its field, and an image of that.
fn shown(state: &[f32], field: &Field) -> Arrays {
    let mut arrays = Arrays::new();
    arrays.put("state", &[state.len()], state.to_vec());
    arrays.put("planes", &[field.planes.values.len()], field.planes.values.clone());
    if let Some(panoramas) = &field.panoramas {
        arrays.put("panoramas", &[panoramas.values.len()], panoramas.values.clone());
    }
    let images = view::render(field, None, &placed(&ball::camera(7, SHOWN), &field.placement), false);
    let opaque = images.opacity.iter().filter(|a| **a > 0.5).count();
    assert!(opaque > 0 && opaque < SHOWN * SHOWN, "rays hit and miss, or the digest proves little: {opaque}");
    arrays.put("color", &[SHOWN * SHOWN, 3], images.color().expect("it has colours"));
    arrays.put("opacity", &[SHOWN * SHOWN], images.opacity);
    arrays
}

/// Weights, moments and losses after the steps of each kind; then what the sets of images give.
pub(crate) fn entries() -> Vec<Entry> {
    let balls = Balls::new();
    let plain = first(&TINY, 5);
    let (mut entries, mut last) = (Vec::new(), None);
    for (name, stage, distances, optimizer) in KINDS {
        let mut settings = settings(stage, distances, optimizer);
        if name == SHAPE_FIRST {
            settings.stage = Stage { shape_steps: 2, state_gradient: true, ..settings.stage.with_updates() };
            settings.average_last = 2;
        }
        if name == INCLUDED {
            settings.stage = Stage { absolute_albedo: true, ..settings.stage.with_updates() };
            (settings.head_rate, settings.uses) = (8.0, 3);
        }
        let mut training = Training::new(settings, TINY, Some(&plain), &balls).expect("valid settings");
        let losses = (0..STEPS).map(|i| training.step(i, &mut ()).expect("finite").loss).collect();
        let mut state = Arrays::new();
        training.save(&mut state);
        state.put("loss", &[STEPS], losses);
        entries.push(Entry::new(trained(name), state));
        last = Some((*training.config(), training.params().clone()));
    }
    let (config, params) = last.expect("a stage");
    let ready = Ready::new(config, &params);
    let mut state = ready.no_state();
    for (set, name) in READ.into_iter().enumerate() {
        let which: Vec<usize> = (0..SET).map(|i| SET * set + i).collect();
        let views = balls.0.chosen(&which).small(2).expect("even sides");
        let at = balls.0.posed(config.pose, &[0]).expect("an upright camera");
        let inputs: Vec<Input> = views.all.iter().map(|v| Input::of(v, &at, &config)).collect();
        state = ready.read(&state, &inputs, None).0;
        let field = ready.decode(&state, Rendering::of_field(SAMPLES, 60.0), at);
        entries.push(Entry::new(name, shown(&state, &field)));
    }
    entries
}
