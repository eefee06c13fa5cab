//! The person of the demo: LAST end to end, by the functions of the commands `last gen`, `tune`, `fit`, `render` and `intervene`.

use super::args::Args;
use crate::console as cli;
use crate::fit::render::Orbit;
use crate::fit::training::Watch;
use crate::last::fit::{Guided, Job};
use crate::last::intervene::Grid;
use crate::last::{pretrain, tune as command};
use crate::loss::lpips;
use crate::meter::Meter;
use crate::num::order;
use crate::report::pictures::Sheet;
use crate::report::{Section, table, text};
use crate::scene::person::PersonCapture;
use crate::shared::Outcome;
use crate::training::Frame;
use crate::{Error, Result};
use lastlight_last::avatar::settings::Settings as Fitting;
use lastlight_last::avatar::store;
use lastlight_last::generate::{self, Settings as Making};
use lastlight_last::model::shipped;
use lastlight_last::model::tune::{self, Subject, Tuned};
use maud::Markup;
use serde_json::json;
use std::path::Path;

/// Default number of iterations of the fit.
pub(super) const ITERATIONS: usize = 400;
/// Which of all persons: none of those the model has learned from.
const SUBJECT: u64 = 1000;
/// Frames of the video in the report.
const FRAMES: usize = 10;
/// Images of the turntable, and their side in pixels.
const TURNTABLE: [usize; 2] = [8, 256];
/// The moment it shows.
const MOMENT: usize = 0;
/// Names of the factors; in training, the factor set by each intervention was a label.
const NAMES: [&str; 4] = ["posture", "self-occlusion", "wrinkles", "light"];

/// Films, tunes, fits, shows, intervenes, in a folder; the record of the fit gets one of the structure.
pub(super) fn run(args: &Args, dir: &Path, meter: &mut Meter) -> Result<Outcome> {
    let making = Making {
        set: "video".into(),
        subject: SUBJECT,
        seed: args.seed,
        video_size: usize::from(args.size),
        ..Making::smoke()
    };
    let film = dir.join("subject");
    cli::stoppable(|stop| {
        generate::run(&making, &film, false, stop, &mut |done, total, what| meter.count(done, total, what))
    })?;
    meter.done();
    let capture = PersonCapture::open(&film.join("video"))?;
    meter.note(&format!(
        "a person: {} pictures to learn from, {} held out; filmed in {:.1} s",
        capture.train.len(),
        capture.test.len(),
        meter.seconds()
    ));
    meter.lap("filming the person");

    let mut trained = shipped::figure()?;
    let subject = Subject::new(&trained, &capture)?;
    let tuned =
        tune::run(&mut trained, &subject, &tune::Settings { seed: args.seed, ..tune::Settings::default() })?;
    trained.write(&dir.join("tuned.safetensors"))?;
    meter.lap("tuning the structure");

    let mut settings =
        Fitting { iterations: args.iterations.unwrap_or(ITERATIONS), seed: args.seed, ..Fitting::baseline() };
    let guided = Guided::usual();
    guided.apply(&mut settings)?;
    settings.validate()?;
    guided.calibrate(&mut settings, &capture, &trained, meter)?;
    meter.note(lpips::NO_WEIGHTS);
    let job = Job {
        kind: "demo",
        title: "A built-in person".to_owned(),
        settings,
        capture: &capture,
        guide: Some(&trained),
        perception: None,
        frame: Frame::inside(dir.join("person"), 400)?,
    };
    let mut outcome = job.run(meter)?;

    let turntable = turntable(&job.frame.dir, meter)?;
    turntable.write(&dir.join("turntable.png"))?;
    meter.lap("turntable");
    let all: Vec<usize> = (0..trained.model.sizes.factors).collect();
    let grid = Grid::new(&trained, &capture, capture.train[0], &all)?;
    let folder = dir.join("interventions");
    std::fs::create_dir_all(&folder).map_err(|e| Error::os(&folder, &e))?;
    grid.write(&folder)?;
    meter.lap("interventions");

    let truth = pretrain::truth(&film)?;
    let before = [frames(&capture)?, structure(&tuned, truth.as_deref())];
    let sections = &mut outcome.page.sections;
    sections.splice(0..0, before);
    let after = 1 + sections.iter().position(|s| s.id == "views").unwrap_or(0);
    let seen = Section {
        id: "turntable",
        title: "From all sides",
        lead: "One moment, larger than it was ever photographed. The fit has seen the person from the front alone; what it makes of the back is an \
               assumption."
            .into(),
        body: turntable.html("the person from eight sides")?,
    };
    sections.splice(after..after, std::iter::once(seen).chain(grid.sections(&|i| NAMES[i].to_owned())?));
    let edges = |which: usize| command::edges(&tuned.edges[which]);
    outcome.lines.push(format!("structure   {} → {}", edges(0), edges(1)));
    outcome.record["structure"] = json!({
        "model": shipped::NAME, "before": tuned.before, "after": tuned.after,
        "edges_before": tuned.edges[0], "edges_after": tuned.edges[1], "truth": truth,
    });
    Ok(outcome)
}

/// Some frames of the video.
fn frames(capture: &PersonCapture) -> Result<Section> {
    let count = Ord::min(FRAMES, capture.train.len());
    let camera = &capture.shots[capture.train[0]].camera;
    let mut sheet = Sheet::new([count, 1], [camera.width, camera.height], 2);
    for k in 0..count {
        let shot = &capture.shots[capture.train[k * capture.train.len() / count]];
        let photo: Vec<f32> = shot.photo()?.rgb.iter().map(|&b| f32::from(b) / 255.0).collect();
        sheet.put([k, 0], &photo);
    }
    Ok(Section {
        id: "subject",
        title: "The video",
        lead: format!(
            "{count} of {} frames of one camera: all that is known of this person, but for its skeleton's pose in every frame. \
             Posture causes wrinkles and self-occlusion; light is its own cause.",
            capture.train.len()
        ),
        body: sheet.html("frames of the video")?,
    })
}

/// The edges before and after the video was seen.
fn structure(tuned: &Tuned, truth: Option<&[Vec<bool>]>) -> Section {
    let n = NAMES.len();
    let mark = |is: bool| text(if is { "yes" } else { "" });
    let row = |(i, j): (usize, usize)| -> Vec<Markup> {
        let p = |all: &[f64]| text(format!("{:.3}", all[i * n + j]));
        let is_true = truth.is_some_and(|t| t[i][j]);
        vec![
            text(NAMES[i]),
            text(NAMES[j]),
            p(&tuned.before),
            p(&tuned.after),
            mark(tuned.edges[1].contains(&(i, j))),
            mark(is_true),
        ]
    };
    let pairs = (0..n * n).map(|at| (at / n, at % n)).filter(|(i, j)| i != j);
    let rows: Vec<_> = pairs.map(row).collect();
    let right = truth.map_or(String::new(), |t| {
        let all = (0..n * n).filter(|at| t[at / n][at % n]).count();
        let hits = tuned.edges[1].iter().filter(|(i, j)| t[*i][*j]).count();
        format!(" {hits} of the {all} true edges are among the {} it has.", tuned.edges[1].len())
    });
    Section {
        id: "structure",
        title: "What causes what",
        lead: format!(
            "Probability of each edge in the model that comes with the program, and after it has seen the video. Encoder and decoder stay; \
             the graph decides in which order the Gaussians of a factor are updated.{right}"
        ),
        body: table(&["cause", "effect", ">before", ">after", "in the graph", "true"], &rows),
    }
}

/// The fitted person from all sides, read back from its file.
fn turntable(run: &Path, meter: &mut Meter) -> Result<Sheet> {
    let stored = store::read(&run.join("avatar.safetensors"))?;
    let [count, side] = TURNTABLE;
    let orbit = Orbit {
        count,
        center: None,
        radius: None,
        elevation_rad: 10f64.to_radians(),
        fov_x_rad: 40f64.to_radians(),
        size: [side; 2],
    };
    let pose = &stored.poses[MOMENT];
    let mut sheet = Sheet::new([count / 2, 2], [side; 2], 2);
    for (k, camera) in stored.around(orbit, std::slice::from_ref(pose))?.iter().enumerate() {
        meter.count(k, count, "turntable");
        let out = stored.picture(pose, Some(MOMENT), camera)?;
        let image: Vec<f32> = out.image.iter().map(|&x| order::clamp(x, 0.0, 1.0)).collect();
        sheet.put([k % (count / 2), k / (count / 2)], &image);
    }
    meter.done();
    Ok(sheet)
}
