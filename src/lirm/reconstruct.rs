//! Sets of images of a capture, read after a state or after none: reconstruction and update.
//!
//! ```text
//! capture ──► pictures ──► which images, set by set ──► inputs ──► transformer ──► state ──► field ──► scores of held-out images
//!                               │                         ▲
//!                               └─► place of the object ──┘  (that of the state, if there is one)
//! ```

use super::model::config::{Config, PATCH};
use super::model::decode::Rendering;
use super::model::file::{Model, digest};
use super::model::params::count;
use super::model::state::State;
use super::model::transformer::Input;
use super::model::weights::Ready;
use super::reading::{INPUT_SIDE, check_tokens, inputs};
use super::views::Views;
use crate::fit::field::place::{Pose, around, placement, posed, unit_ball, upright_beside_z};
use crate::fit::field::targets::{Picture, Pictures, Target, placed, sees};
use crate::fit::field::{Scores, score, view};
use crate::fit::training::Watch;
use crate::num::{order, par};
use crate::scene::camera::Camera;
use crate::scene::field::{Field, Placement};
use crate::scene::views::SceneBox;
use crate::{Error, Result};

/// Numbers per pixel of an [`Input`]: image, rays and photo.
const INPUT_FLOATS: usize = 12;
/// Numbers per pixel of a copy of an image while its input is made: colours, coverage and photo, as they are and
/// resized; passes, which few captures have, are not counted.
const COPY_FLOATS: usize = 14;

/// Size of the images that are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Size {
    /// Square images of a multiple of [`INPUT_SIDE`] pixels are shrunk to it, others are cut to it around the
    /// object.
    Usual,
    /// A square around the object, brought to this many pixels.
    Cropped(usize),
    /// As they are.
    Own,
}

/// What the first set is read after.
#[derive(Clone, Debug)]
pub enum Start {
    /// Nothing: with these axes, or those of the model; in this cube, or one around what the images show.
    Nothing(Option<Pose>, Option<SceneBox>),
    /// A state, in its box.
    State(Box<State>),
}

/// Sets of images to read.
#[derive(Debug)]
pub struct Reconstruction<'a> {
    /// The model.
    pub model: &'a Model,
    /// The capture.
    pub pictures: &'a Pictures,
    /// Indices of the images, set by set.
    pub sets: Vec<Vec<usize>>,
    /// Size of the images that are read.
    pub size: Size,
    /// How the field is rendered.
    pub rendering: Rendering,
}

/// What a reconstruction takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Work {
    /// Weights of the model.
    pub parameters: usize,
    /// Tokens of the state and of the largest set.
    pub tokens: usize,
    /// Floating-point operations.
    pub operations: f64,
    /// Bytes of weights, tokens, texels and inputs; not of the photos.
    pub bytes: u64,
}

/// An image as the model read it.
#[derive(Clone, Debug)]
pub struct ReadImage {
    /// Its name in the capture.
    pub name: String,
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// (H, W, 3) encoded colours over white.
    pub rgb: Vec<f32>,
}

/// What was made.
#[derive(Clone, Debug)]
pub struct Products {
    /// The state after all sets.
    pub state: State,
    /// Its field.
    pub field: Field,
    /// Relative changes of the state by the sets that were read now.
    pub changes: Vec<f64>,
    /// The images that were read, in order.
    pub read: Vec<ReadImage>,
    /// Scores of the held-out images.
    pub scored: Vec<Scores>,
    /// Scores of the state before, on the same images; empty if there was none.
    pub before: Vec<Scores>,
    /// Images whose names are those of images that the state before had read.
    pub again: usize,
    /// Held-out images that have the name of an image that was read, and are not scored.
    pub unscored: usize,
}

/// The state must come from this model.
fn belongs(state: &State, model: &Model) -> Result<()> {
    let own = digest(&model.params);
    let [of_state, of_model] = [state.config.json(), model.config.json()];
    let settings = of_state.as_object().into_iter().flatten();
    let other = settings.into_iter().find(|(name, x)| of_model[name.as_str()] != **x);
    if other.is_none() && state.model == own {
        return Ok(());
    }
    let [expected, got] = [(&state.model, &of_state), (&own, &of_model)].map(|(digest, settings)| {
        let setting = other.map(|(name, _)| format!(" (setting {name}: {})", settings[name.as_str()]));
        format!("{digest}{}", setting.unwrap_or_default())
    });
    Err(Error::input("state")
        .at("model")
        .expected(format!("the model that made it, with the digest {expected}"))
        .got(got)
        .hint("--model FILE names that model"))
}

impl Reconstruction<'_> {
    /// The place of the object: that of the state, or one around what the images show. With it, the direction
    /// that is up in the images, if it is not z and the axes of the model are turned to it for this reason.
    ///
    /// # Errors
    /// When the state comes from another model, the images do not show which direction is up, an image does
    /// not show the object, or no image of a set shows it in its box.
    pub fn place(&self, start: &Start) -> Result<(Placement, Option<[f64; 3]>)> {
        let (pose, given) = match start {
            Start::State(state) => {
                belongs(state, self.model)?;
                self.check(&state.placement, true)?;
                return Ok((state.placement, None));
            }
            Start::Nothing(pose, given) => (pose, given),
        };
        let of = self.pictures;
        let read: Vec<&Picture> = self.sets.iter().flatten().map(|i| &of.pictures[*i]).collect();
        let scene = match given {
            Some(given) => *given,
            None if of.is_unit_ball => unit_ball(),
            None => around(&read, of.views.scene_box.center)?,
        };
        let cameras: Vec<&Camera> = read.iter().map(|p| &p.camera).collect();
        let own = self.model.config.pose;
        let up = upright_beside_z(&cameras).filter(|_| pose.is_none() && own == Pose::Azimuth);
        let pose = pose.unwrap_or(if up.is_some() { Pose::Upright } else { own });
        let place = posed(placement(&scene), pose, &cameras)?;
        self.check(&place, false)?;
        Ok((place, up))
    }

    /// Checks that every image shows the object, and one of every set shows it in the box.
    fn check(&self, place: &Placement, is_update: bool) -> Result<()> {
        for set in &self.sets {
            let all = || set.iter().map(|i| &self.pictures.pictures[*i]);
            if let Some(p) = all().find(|p| p.foreground.iter().all(|m| *m < 0.5)) {
                return Err(Error::input(p.name.clone())
                    .at("foreground")
                    .expected("the object in at least one pixel")
                    .got("none")
                    .hint("--inputs names the images to read"));
            }
            if all().any(|p| sees(&placed(&p.camera, place), &p.foreground)) {
                continue;
            }
            return Err(match is_update {
                true => Error::input("capture")
                    .expected("images that show the object in the box of the state")
                    .got("a set without a foreground pixel that sees it"),
                false => Error::input("--box")
                    .expected("a box that covers the object in the images")
                    .got("one that no foreground pixel of a set sees"),
            });
        }
        Ok(())
    }

    /// Images of the size that is read.
    fn sized(&self, views: Views) -> Result<Views> {
        match self.size {
            Size::Cropped(side) => Ok(views.cropped(side)),
            Size::Own => Ok(views),
            Size::Usual => views.sized(INPUT_SIDE),
        }
    }

    /// The tokens of an image of the size that is read.
    fn tokens(&self, p: &Picture) -> usize {
        let [width, height] = match self.size {
            Size::Cropped(side) => [side; 2],
            Size::Own => [p.camera.width, p.camera.height],
            Size::Usual => [INPUT_SIDE; 2],
        };
        width.div_ceil(PATCH) * height.div_ceil(PATCH)
    }

    /// What it takes.
    ///
    /// # Errors
    /// If a set has too many tokens.
    pub fn work(&self) -> Result<Work> {
        let config: &Config = &self.model.config;
        let of_set =
            |set: &Vec<usize>| set.iter().fold(0, |n, i| n + self.tokens(&self.pictures.pictures[*i]));
        let tokens: Vec<usize> = self.sets.iter().map(of_set).collect();
        tokens.iter().try_for_each(|n| check_tokens(*n))?;
        let most = tokens.iter().copied().fold(0, Ord::max);
        let parameters = count(config);
        let inputs = tokens.iter().fold(0, |sum, n| sum + n * PATCH * PATCH) * INPUT_FLOATS;
        let pixels = |i: &usize| {
            let camera = &self.pictures.pictures[*i].camera;
            camera.width * camera.height
        };
        let largest = self.sets.iter().flatten().map(pixels).fold(0, Ord::max);
        let at_once = Ord::min(par::threads(), self.sets.iter().map(Vec::len).fold(0, Ord::max));
        Ok(Work {
            parameters,
            tokens: config.state_tokens() + most,
            operations: tokens.iter().fold(0.0, |sum, n| sum + config.flops(*n)[0]),
            bytes: config.memory(parameters, most) + 4 * (inputs + at_once * largest * COPY_FLOATS) as u64,
        })
    }

    /// Reads the sets, decodes the state, and scores the field on the held-out images; `place` is from
    /// [`Self::place`], which checks the images.
    ///
    /// # Errors
    /// When an image cannot be read, or a number is not finite.
    pub fn run(&self, start: Start, place: Placement, watch: &mut dyn Watch) -> Result<Products> {
        let (model, pictures) = (self.model, self.pictures);
        let before = match start {
            Start::Nothing(..) => None,
            Start::State(state) => Some(*state),
        };
        // One by one, so that copies of a few images are in memory.
        let input = |i: usize| -> Result<Input> {
            let views = self.sized(Views::of_capture(pictures, &[i], place)?)?;
            Ok(inputs(&views, &model.config)?.swap_remove(0))
        };
        let set = |some: &Vec<usize>| par::map(some.len(), |k| input(some[k])).into_iter().collect();
        let sets: Vec<Vec<Input>> = self.sets.iter().map(set).collect::<Result<_>>()?;
        watch.lap("inputs");
        let shown = |(i, input): (&usize, &Input)| ReadImage {
            name: pictures.pictures[*i].name.clone(),
            size: input.size,
            // The background may be beyond white.
            rgb: input.image.iter().map(|x| order::clamp(0.5 * (x + 1.0), 0.0, 1.0)).collect(),
        };
        let read = self.sets.iter().flatten().zip(sets.iter().flatten()).map(shown).collect();
        let ready = Ready::new(model.config, &model.params);
        let first = before.as_ref().map_or_else(|| ready.no_state(), |s| s.tokens.clone());
        let (tokens, changes) = ready.read_all(&first, &sets);
        if let Some(bad) = tokens.iter().find(|x| !x.is_finite()) {
            return Err(Error::check("LIRM state")
                .expected("finite numbers")
                .got(bad.to_string())
                .hint("the products of this model's weights overflow; try another --model"));
        }
        watch.lap("transformer");
        let field = ready.decode(&tokens, self.rendering, place);
        field.validate()?;
        watch.lap("decoding");
        let is_update = before.is_some();
        let exposure = before.as_ref().map_or(pictures.common, |s| s.exposure);
        let (mut all_sets, mut all_changes, mut images) =
            before.map_or_else(Default::default, |s| (s.sets, s.changes, s.images));
        let own = self.sets.iter().flatten().map(|i| pictures.pictures[*i].name.clone());
        let again = own.clone().filter(|name| images.contains(name)).count();
        // A state of an earlier version has no changes: the list is that of all sets, or empty.
        if all_changes.len() == all_sets.len() {
            all_changes.extend(&changes);
        }
        all_sets.extend(sets.iter().map(Vec::len));
        images.extend(own);
        let targets = pictures.held_out(&place);
        let (seen, held_out): (Vec<&Target>, Vec<&Target>) =
            targets.iter().partition(|t| images.contains(&t.name));
        let is_compared = is_update && !held_out.is_empty();
        let total = held_out.len() * if is_compared { 2 } else { 1 };
        let mut scores = |field: &Field, done: usize| -> Result<Vec<Scores>> {
            let cells = view::occupancy(field)?;
            let scored = held_out.iter().enumerate().map(|(i, t)| {
                watch.count(done + i, total, "scoring held-out images");
                score(field, &cells, t)
            });
            scored.collect()
        };
        let scored = scores(&field, 0)?;
        let before = match is_compared {
            true => scores(&ready.decode(&first, self.rendering, place), held_out.len())?,
            false => Vec::new(),
        };
        watch.lap("evaluation");
        let state = State {
            tokens,
            placement: place,
            config: model.config,
            model: digest(&model.params),
            sets: all_sets,
            changes: all_changes,
            images,
            exposure,
        };
        Ok(Products { state, field, changes, read, scored, before, again, unscored: seen.len() })
    }
}
