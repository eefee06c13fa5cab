//! Sets of images read after a state, or after none: the run behind `lirm reconstruct`, `lirm update` and the object of `demo`.
//!
//! ```text
//! capture ──► pictures ──► which images, set by set ──► inputs ──► transformer ──► state ──► field ──► scores of held-out images
//!                                    place of the object, or that of the state ──┘
//! ```

use crate::field::page;
use crate::fit::field::place::{Pose, around, placement, posed, unit_ball, upright};
use crate::fit::field::scores::means;
use crate::fit::field::targets::{Picture, Pictures, Target, placed, sees};
use crate::fit::field::{Scores, score, view};
use crate::fit::render::flat_name;
use crate::fit::training::Watch;
use crate::io::{atomic, memory};
use crate::meter::Meter;
use crate::num::gemm::{Finish, View, gemm};
use crate::num::{order, par};
use crate::report::run::Run;
use crate::report::{self};
use crate::scene::camera::Camera;
use crate::scene::field::{FILE as FIELD, Field, Placement};
use crate::scene::views::SceneBox;
use crate::shared::{Outcome, name};
use crate::training::RESULT;
use crate::units::counted;
use crate::{Error, Result, console as cli, units, version};
use lastlight_lirm::model::config::{Config, PATCH};
use lastlight_lirm::model::decode::Look;
use lastlight_lirm::model::file::{Model, digest};
use lastlight_lirm::model::params::count;
use lastlight_lirm::model::state::{FILE as STATE, State};
use lastlight_lirm::model::transformer::Input;
use lastlight_lirm::model::weights::Ready;
use lastlight_lirm::reading::{check_tokens, inputs};
use lastlight_lirm::views::Views;
use serde_json::{Value, json};
use std::path::Path;

/// Pixels per side of the images that a model is trained with.
const TRAINED: usize = 64;
/// Rows, columns and inner numbers of the products by which the speed of the machine is measured.
const SAMPLE: usize = 512;
/// Floating-point operations from which the time is estimated before they start.
const LONG: f64 = 1e12;
/// Change of a state below which, twice in a row, a note states that further sets change little.
const SETTLED: f64 = 1e-2;
/// Gain in dB on held-out images below which the same is stated.
const LITTLE: f64 = 0.1;
/// Cosine of the largest angle between up in the images and z for which a capture is z up.
const LEVEL: f64 = 0.94;

/// Size of the images that are read.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Size {
    /// Square images are shrunk to that of the training, others are cut to it.
    Usual,
    /// A square around the object, brought to this many pixels.
    Cropped(usize),
    /// As they are.
    Own,
}

/// What the first set is read after.
pub(crate) enum Start {
    /// With these axes, or those of the model, in this cube, or one around what the images show.
    Nothing(Option<Pose>, Option<SceneBox>),
    /// A state and its box.
    State(Box<State>),
}

/// Sets of images to read.
pub(crate) struct Job<'a> {
    pub(crate) kind: &'static str,
    pub(crate) model: &'a Model,
    pub(crate) capture: &'a Path,
    pub(crate) pictures: &'a Pictures,
    /// Indices of the images, set by set.
    pub(crate) sets: Vec<Vec<usize>>,
    pub(crate) size: Size,
    pub(crate) look: Look,
    /// The settings in the record.
    pub(crate) settings: Value,
}

/// What was made.
pub(crate) struct Made {
    pub(crate) state: State,
    pub(crate) field: Field,
    /// Of the held-out images.
    pub(crate) scored: Vec<Scores>,
    pub(crate) outcome: Outcome,
}

/// Prints the size of the work before it starts; refuses what does not fit into the memory.
fn announce(kind: &str, config: &Config, tokens: &[usize], meter: &mut Meter) -> Result<()> {
    tokens.iter().try_for_each(|n| check_tokens(*n))?;
    let most = tokens.iter().copied().fold(0, Ord::max);
    let (parameters, operations) =
        (count(config), tokens.iter().fold(0.0, |sum, n| sum + config.flops(*n)[0]));
    let bytes = config.memory(parameters, most);
    memory::check(kind, bytes).map_err(|e| {
        e.hint("--images-per-set and --downscale lower the estimate, --max-memory raises the limit")
    })?;
    let mut line = format!(
        "{parameters} parameters, {} tokens in the largest set, about {}, {:.0} GFLOP",
        config.state_tokens() + most,
        units::bytes(bytes),
        1e-9 * operations
    );
    if operations > LONG {
        let factor = vec![0.5; SAMPLE * SAMPLE];
        let mut product = vec![0.0; SAMPLE * SAMPLE];
        let of = || View::new(&factor, SAMPLE, SAMPLE);
        gemm(of(), of(), Finish::Store, &mut product);
        let before = meter.seconds();
        (0..4).for_each(|_| gemm(of(), of(), Finish::Store, &mut product));
        let rate = 8.0 * (SAMPLE * SAMPLE * SAMPLE) as f64 / (meter.seconds() - before);
        line += &format!(", at least {} at {:.0} GFLOP/s", report::seconds(operations / rate), 1e-9 * rate);
    }
    meter.note(&line);
    Ok(())
}

/// The axes that the model was trained with, in a capture whose z may not be up.
fn own_pose(of_model: Pose, cameras: &[&Camera], meter: &Meter) -> Pose {
    match upright(cameras) {
        Some(up) if of_model == Pose::Azimuth && up[2] < LEVEL => {
            meter.note(&format!(
                "up in the images is ({:.2}, {:.2}, {:.2}), not z: the object is read with --field-axes upright",
                up[0], up[1], up[2]
            ));
            Pose::Upright
        }
        _ => of_model,
    }
}

/// The state must come from this model.
fn belongs(state: &State, model: &Model) -> Result<()> {
    let own = digest(&model.params);
    let [of_state, of_model] = [state.config.json(), model.config.json()];
    let settings = of_state.as_object().into_iter().flatten();
    if let Some((name, x)) = settings.into_iter().find(|(name, x)| of_model[name.as_str()] != **x) {
        return Err(Error::input("--model")
            .at(format!("setting {name}"))
            .expected(format!("{x}, as in the model of the state"))
            .got(of_model[name.as_str()].to_string()));
    }
    if state.model == own {
        return Ok(());
    }
    Err(Error::input("--model")
        .expected(format!("the model of the state, with the digest {}", state.model))
        .got(own))
}

impl Job<'_> {
    /// The place of the object: that of the state, or one around what the images show.
    ///
    /// # Errors
    /// When the state comes from another model, the images do not show which direction is up, or they do not show the object in its
    /// box.
    pub(crate) fn place(&self, start: &Start, meter: &Meter) -> Result<Placement> {
        let (pose, given) = match start {
            Start::State(state) => {
                belongs(state, self.model)?;
                self.check(&state.placement, true)?;
                return Ok(state.placement);
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
        let pose = pose.unwrap_or_else(|| own_pose(self.model.config.pose, &cameras, meter));
        let place = posed(placement(&scene), pose, &cameras)?;
        self.check(&place, false)?;
        Ok(place)
    }

    /// Images of the size that is read.
    fn sized(&self, views: Views) -> Result<Views> {
        match self.size {
            Size::Cropped(side) => Ok(views.cropped(side)),
            Size::Own => Ok(views),
            Size::Usual => views.sized(TRAINED),
        }
    }

    /// The tokens of an image of the size that is read.
    fn tokens(&self, p: &Picture) -> usize {
        let [width, height] = match self.size {
            Size::Cropped(side) => [side; 2],
            Size::Own => [p.camera.width, p.camera.height],
            Size::Usual => [TRAINED; 2],
        };
        width.div_ceil(PATCH) * height.div_ceil(PATCH)
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

    /// Reads the sets, decodes the state, scores the field on the held-out images, then writes all of it into a folder
    /// that is there.
    ///
    /// # Errors
    /// When an image cannot be read, the work does not fit into the memory, a number is
    /// not finite, or a file cannot be written.
    pub(crate) fn run(&self, start: Start, place: Placement, dir: &Path, meter: &mut Meter) -> Result<Made> {
        let (model, pictures) = (self.model, self.pictures);
        let before = match start {
            Start::Nothing(..) => None,
            Start::State(state) => Some(*state),
        };
        meter.lap("reading");
        let of_set = |set: &Vec<usize>| set.iter().fold(0, |n, i| n + self.tokens(&pictures.pictures[*i]));
        let tokens: Vec<usize> = self.sets.iter().map(of_set).collect();
        announce(self.kind, &model.config, &tokens, meter)?;
        // One by one, so that copies of a few images are in memory.
        let input = |i: usize| -> Result<Input> {
            let views = self.sized(Views::of_capture(pictures, &[i], place)?)?;
            Ok(inputs(&views, &model.config)?.swap_remove(0))
        };
        let set = |some: &Vec<usize>| par::map(some.len(), |k| input(some[k])).into_iter().collect();
        let sets: Vec<Vec<Input>> = self.sets.iter().map(set).collect::<Result<_>>()?;
        meter.lap("inputs");
        let ready = Ready::new(model.config, &model.params);
        let start = before.as_ref().map_or_else(|| ready.no_state(), |s| s.tokens.clone());
        let is_update = before.is_some();
        let (tokens, changes) = ready.read_all(&start, &sets);
        if let Some(bad) = tokens.iter().find(|x| !x.is_finite()) {
            return Err(Error::check(self.kind).at("state").expected("finite numbers").got(bad.to_string()));
        }
        meter.lap("transformer");
        let field = ready.decode(&tokens, self.look, place);
        field.validate()?;
        meter.lap("decoding");
        let exposure = before.as_ref().map_or(pictures.exposure, |s| s.exposure);
        let (mut read_so_far, mut all_changes, mut images) =
            before.map_or_else(Default::default, |s| (s.sets, s.changes, s.images));
        let own = self.sets.iter().flatten().map(|i| pictures.pictures[*i].name.clone());
        let again = own.clone().filter(|name| images.contains(name)).count();
        if again > 0 {
            meter
                .note(&format!("{again} of the images have names of images that the state has read already"));
        }
        // A state of an earlier version has no changes: the list is that of all sets, or empty.
        if all_changes.len() == read_so_far.len() {
            all_changes.extend(&changes);
        }
        read_so_far.extend(sets.iter().map(Vec::len));
        images.extend(own);
        let state = State {
            tokens,
            placement: place,
            config: model.config,
            model: digest(&model.params),
            sets: read_so_far,
            changes: all_changes,
            images,
            exposure,
        };
        let targets = pictures.held_out(&place);
        let (seen, held_out): (Vec<&Target>, Vec<&Target>) =
            targets.iter().partition(|t| state.images.contains(&t.name));
        if !seen.is_empty() {
            meter.note(&format!(
                "{} of the capture's test images have names of images that were read, and are not scored",
                seen.len()
            ));
        }
        let scores = |field: &Field| -> Result<Vec<Scores>> {
            let cells = view::occupancy(field)?;
            held_out.iter().map(|t| score(field, &cells, t)).collect()
        };
        let scored = scores(&field)?;
        // The state before, on the same images.
        let earlier = if is_update && !held_out.is_empty() {
            Some(means(&scores(&ready.decode(&start, self.look, place))?))
        } else {
            None
        };
        meter.lap("evaluation");
        state.write(&dir.join(STATE))?;
        field.write(&dir.join(FIELD))?;
        if let [.., a, b] = state.changes[..]
            && order::max(a, b) < SETTLED
        {
            meter
                .note("the last two sets changed the state by less than 1 %: more images will change little");
        }
        let outcome = self.outcome((&state, &changes), &field, (&scored, earlier), dir, meter)?;
        Ok(Made { state, field, scored, outcome })
    }

    /// Writes the renders and the record; gives the record, the report and the lines for a terminal.
    fn outcome(
        &self,
        (state, changes): (&State, &[f64]),
        field: &Field,
        (scored, earlier): (&[Scores], Option<Value>),
        dir: &Path,
        meter: &Meter,
    ) -> Result<Outcome> {
        let mut names = vec![FIELD.to_owned(), STATE.to_owned(), RESULT.to_owned()];
        names.extend(page::write_renders(dir, scored, &flat_name)?);
        let means = means(scored);
        let views: Vec<Value> = scored.iter().map(|s| s.json()).collect();
        let digest = field.digest()?;
        let held_out_db = means["psnr_db"].as_f64().unwrap_or(f64::NAN);
        let mut record = json!({
            "kind": self.kind, "lastlight": env!("CARGO_PKG_VERSION"), "digest": digest, "model": state.model, "sets": state.sets, "changes": changes, "exposure": state.exposure,
            "arguments": cli::arguments(), "build": version::record(), "settings": self.settings, "seconds": meter.seconds(),
            "evaluation": {"mean": means, "views": views},
        });
        if let Some(earlier) = &earlier {
            record["evaluation"]["before"] = earlier.clone();
        }
        atomic::write_bytes(&dir.join(RESULT), format!("{record:#}\n").as_bytes())?;
        let images = self.sets.iter().flatten().count();
        let page = page::page(&page::Input {
            kind: self.kind,
            title: format!("Object from {} of {}", counted(images, "image"), name(self.capture)),
            digest: Some(digest.clone()),
            means: &means,
            scored,
            benchmark: None,
            run: Run::new(&record["settings"], None, meter, dir, &names),
        })?;
        let mut lines = vec![page::summary(&means)];
        if let Some(before) = earlier.as_ref().and_then(|means| means["psnr_db"].as_f64()) {
            let gain = held_out_db - before;
            let little = if gain < LITTLE { ": more images will change little" } else { "" };
            lines.push(format!("before      {before:.2} dB on the same images ({gain:+.2} dB{little})"));
        }
        lines.extend([
            format!("images      {images} in {}", counted(self.sets.len(), "set")),
            format!(
                "change      {} of the state, set by set",
                changes.iter().map(|c| format!("{c:.3}")).collect::<Vec<_>>().join(", ")
            ),
            format!("digest      {digest}"),
            format!("time        {}", report::seconds(meter.seconds())),
            format!("field       {}", dir.join(FIELD).display()),
            format!("next        lastlight field mesh {} --out mesh.glb", dir.display()),
        ]);
        Ok(Outcome { record, page: Some(page), lines, held_out_db })
    }
}
