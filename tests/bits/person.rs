//! A small LAST run: images of the figure, the model trained on them, its structure tuned on a video of the
//! figure, the figure fitted to the video with the model as guide, and its scores.

use super::runs::Entry;
use lastlight::fit::training::Fit;
use lastlight::last::avatar::density::{Density, Mode};
use lastlight::last::avatar::evaluate::Evaluation;
use lastlight::last::avatar::fit::PersonFit;
use lastlight::last::avatar::guide::Framing;
use lastlight::last::avatar::progressive::Progressive;
use lastlight::last::avatar::settings::Settings as Fitting;
use lastlight::last::figure::Rendering;
use lastlight::last::generate::{self, Settings as Making};
use lastlight::last::model::file::Trained;
use lastlight::last::model::guide;
use lastlight::last::model::pictures::Pictures;
use lastlight::last::model::settings::Settings;
use lastlight::last::model::train::Training;
use lastlight::last::model::tune::{self, Subject};
use lastlight::num::array::Arrays;
use lastlight::scene::person::PersonCapture;
use std::sync::atomic::AtomicBool;

/// Names of [`entries`].
pub(crate) const NAMES: [&str; 5] =
    ["last.pretrain 20 steps", "last.tune 10 steps", "last.fit 50 iterations", "last.eval", "last whole run"];

/// 10 steps and 10 of refit, so that the graph is fixed and searched on the way.
const STEPS: [u32; 2] = [10, 10];

fn parameters(trained: &Trained) -> Arrays {
    let mut arrays = Arrays::new();
    for (name, array) in trained.model.params.iter() {
        arrays.put(name, array.shape(), array.iter().copied().collect());
    }
    let n = trained.graph.n();
    arrays.put("graph", &[n, n], trained.graph.adjacency());
    arrays
}

/// The run.
pub(crate) fn entries() -> Vec<Entry> {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let making = Making {
        count: 48,
        groups: 8,
        appearances: 1,
        points: 256,
        frames: 4,
        test_cameras: 1,
        video_look: Rendering::Discs,
        video_size: 64,
        ..Making::smoke()
    };
    let made = generate::run(&making, dir.path(), false, &AtomicBool::new(false), &mut |_, _, _| {});
    let made = made.expect("images");
    let data = Pictures::read(dir.path(), true, Framing::default()).expect("what was just written");
    let settings = Settings {
        steps: STEPS[0],
        refit: STEPS[1],
        alone: 2,
        freeze: 5,
        warm_up: 5,
        round: 4,
        observed: 12,
        groups: 1,
        width: 2,
        seed: 7,
        ..Settings::of_pictures()
    };
    let mut training = Training::new(settings, &data).expect("images of 64 pixels");
    for i in 0..Fit::iterations(&training) {
        Fit::step(&mut training, i, &mut ()).expect("finite");
    }
    let mut state = Arrays::new();
    training.save(&mut state);
    let mut trained = training.finish().expect("all steps are done");
    let capture = PersonCapture::open(&dir.path().join("video")).expect("a capture");
    let mut subject = Subject::default();
    for &i in &capture.train {
        let shot = &capture.shots[i];
        let photo = shot.photo().expect("an image");
        let [mu, ell] = trained.posterior(&guide::seen(&trained, &capture, shot, &photo).expect("a person"));
        subject.mu.extend(mu);
        subject.ell.extend(ell);
    }
    let tuning = tune::Settings { steps: 10, ..tune::Settings::default() };
    tune::run(&mut trained, &subject, &tuning).expect("a subject");
    let mut entries = vec![Entry::new(NAMES[0], state), Entry::new(NAMES[1], parameters(&trained))];
    let mut fit = PersonFit::new(fitting(), &capture, Some(&trained)).expect("valid settings");
    let losses = (0..Fit::iterations(&fit)).map(|i| Fit::step(&mut fit, i, &mut ()).expect("finite").loss);
    let losses: Vec<f32> = losses.collect();
    assert!(
        fit.tally().encodings > 0 && !fit.events().is_empty(),
        "the guide is evaluated, Gaussians are added"
    );
    let mut state = Arrays::new();
    fit.save(&mut state);
    state.put("loss", &[losses.len()], losses);
    entries.push(Entry::new(NAMES[2], state));
    entries.push(Entry::new(NAMES[3], scores(&fit, &capture)));
    // One digest for all of it, the written files included.
    let digests: Vec<i64> = (made.files.iter().map(|(_, digest)| *digest))
        .chain(entries.iter().map(|e| u64::from_str_radix(&e.digest(), 16).expect("hexadecimal digits")))
        .map(u64::cast_signed)
        .collect();
    entries.push(Entry::new(NAMES[4], Arrays::new().with("digests", &[digests.len()], digests)));
    entries
}

/// A guided fit of 50 iterations.
fn fitting() -> Fitting {
    let host = Fitting::baseline();
    Fitting {
        iterations: 50,
        seed: 7,
        max_gaussians: 600,
        density: Density { mode: Mode::Replace, latent_threshold: 1e-5, ..host.density.clone() },
        progressive: Some(Progressive::published()),
        ..host
    }
}

/// Images and scores of a training and a held-out shot.
fn scores(fit: &PersonFit<'_>, capture: &PersonCapture) -> Arrays {
    let mut arrays = Arrays::new();
    for (name, shot) in [("train", capture.train[1]), ("test", capture.test[0])] {
        let scored = Evaluation::of(fit.avatar(), capture).score(shot).expect("a score");
        let values: Vec<f64> = scored.scores.named().iter().map(|(_, x)| *x).collect();
        arrays.put(&format!("{name}.image"), &[scored.image.len()], scored.image);
        arrays.put(&format!("{name}.scores"), &[values.len()], values);
    }
    arrays
}
