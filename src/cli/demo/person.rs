//! The person of the demo: LAST end to end, by the functions of the commands `last gen`, `tune`, `fit`, `render` and `intervene`.

use super::args::Args;
use crate::console as cli;
use crate::fit::orbit::Orbit;
use crate::fit::training::Watch;
use crate::last::fit::{Guided, Job};
use crate::last::intervene::Grid;
use crate::last::pretrain;
use crate::meter::Meter;
use crate::num::order;
use crate::report::graph::{self, Graph};
use crate::report::images::{Label, Sheet};
use crate::report::{Section, table, text};
use crate::scene::person::PersonCapture;
use crate::shared::Outcome;
use crate::training::Frame;
use crate::units::counted;
use crate::{Error, Result};
use lastlight_last::avatar::settings::Settings as Fitting;
use lastlight_last::avatar::store;
use lastlight_last::generate::{self, Settings as Making};
use lastlight_last::model::shipped;
use lastlight_last::model::tune::{self, Subject, Tuned};
use maud::{Markup, html};
use serde_json::json;
use std::path::Path;

/// Default number of iterations of the fit.
pub(super) const ITERATIONS: usize = 400;
/// Which of all persons: none of those the model has learned from. This one's clothes have no pattern finer than the video's pixels.
const SUBJECT: u64 = 1005;
/// Samples per pixel of the video.
const SAMPLES: u32 = 8;
/// Frames of the video in the report.
const FRAMES: usize = 10;
/// Points of the person's template: three times those of the smoke sizes, or enlarged images show single Gaussians.
const POINTS: usize = 3072;
/// Directions of the turntable in degrees, seen from the front. The video shows the person from the front alone.
const TURNTABLE: [isize; 8] = [-28, -20, -12, -4, 4, 12, 20, 28];
/// Width and height of its images in pixels.
const UPRIGHT: [usize; 2] = [144, 256];
/// The moment it shows.
const MOMENT: usize = 0;
/// Names of the factors; in training, the factor set by each intervention was a label.
const NAMES: [&str; 4] = ["posture", "self-occlusion", "wrinkles", "light"];

/// Films, tunes, fits, shows, intervenes, in a folder; the record of the fit gets one of the structure.
pub(super) fn run(args: &Args, dir: &Path, meter: &mut Meter) -> Result<Outcome> {
    let film = dir.join("subject");
    render_video(args, &film, meter)?;
    let capture = PersonCapture::open(&film.join("video"))?;
    meter.note(&format!(
        "a person: {}, {} held out; rendered in {:.1} s",
        counted(capture.train.len(), "training image"),
        capture.test.len(),
        meter.seconds()
    ));
    meter.lap("rendering the video");

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
    let defaults = Fitting { iterations: ITERATIONS, seed: 0, ..settings.clone() }.json();
    let job = Job {
        kind: "demo",
        title: "Person from a built-in video".to_owned(),
        settings,
        capture: &capture,
        guide: Some(&trained),
        perception: None,
        defaults: Some(defaults),
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
    if let Some(page) = &mut outcome.page {
        let sections = &mut page.sections;
        sections.splice(0..0, before);
        let after = 1 + sections.iter().position(|s| s.id == "views").unwrap_or(0);
        let seen = around(&turntable)?;
        sections.splice(after..after, std::iter::once(seen).chain(grid.sections(&|i| NAMES[i].to_owned())?));
    }
    outcome.lines.push(format!("graph       {}", change(&tuned.edges)));
    outcome.record["structure"] = json!({
        "model": shipped::NAME, "before": tuned.before, "after": tuned.after,
        "edges_before": tuned.edges[0], "edges_after": tuned.edges[1], "truth": truth,
    });
    Ok(outcome)
}

/// Renders the video of the person into a folder.
fn render_video(args: &Args, film: &Path, meter: &mut Meter) -> Result<()> {
    let making = Making {
        set: "video".into(),
        subject: SUBJECT,
        seed: args.seed,
        video_size: args.size,
        points: POINTS,
        samples: SAMPLES,
        ..Making::smoke()
    };
    cli::stoppable(|stop| {
        generate::run(&making, film, false, stop, &mut |done, total, what| meter.count(done, total, what))
    })?;
    meter.done();
    Ok(())
}

/// The graph before and after tuning, in words.
fn change([before, after]: &[Vec<(usize, usize)>; 2]) -> String {
    let words = |edges: &[(usize, usize)]| {
        let all: Vec<String> = edges.iter().map(|&(i, j)| format!("{}→{}", NAMES[i], NAMES[j])).collect();
        if all.is_empty() { "no edges".to_owned() } else { all.join(", ") }
    };
    if before == after {
        return format!("{} (unchanged by tuning)", words(after));
    }
    format!("before tuning: {}; after: {}", words(before), words(after))
}

/// The turntable as a section.
fn around(turntable: &Sheet) -> Result<Section> {
    Ok(Section {
        id: "turntable",
        title: "From the front half",
        lead: "One moment from eight directions, rendered larger than the input images. The fit has seen the person from the front only; sides and \
               back would be an extrapolation and are not shown."
            .into(),
        body: html! { div.large { (turntable.strip(TURNTABLE.len(), &|[c, _]| {
            let degrees = TURNTABLE[c];
            Label { alt: format!("person rendered from {degrees} degrees"), caption: format!("{degrees}°") }
        })?) } },
    })
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
            "{count} of the {} input frames. The fit sees only this camera and the skeleton pose of each frame. Posture causes wrinkles and \
             self-occlusion; light has no cause among the factors.",
            capture.train.len()
        ),
        body: sheet.strip(count, &|[k, _]| {
            let name = &capture.shots[capture.train[k * capture.train.len() / count]].name;
            Label {
                alt: format!("input frame {name}"),
                caption: format!("frame {}", k * capture.train.len() / count),
            }
        })?,
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
        format!(" After tuning, {hits} of the {all} true edges are among its {}.", tuned.edges[1].len())
    });
    let names = NAMES.map(str::to_owned);
    let levels = graph::levels(n, &tuned.edges[1]);
    let draw = |title, p, which: usize| {
        Graph { title, names: &names, p, kept: &tuned.edges[which], truth, levels: &levels }.html()
    };
    Section {
        id: "structure",
        title: "Causal graph",
        lead: format!(
            "The graph of the built-in model, before and after tuning to the video; edges are as wide as they are probable. Encoder and decoder are \
             not changed; the graph decides in which order the Gaussians of a factor are updated.{right}"
        ),
        body: html! {
            div.two { (draw("before tuning", &tuned.before, 0)) (draw("after tuning", &tuned.after, 1)) }
            (graph::legend(truth.is_some()))
            details { summary { "Probabilities of all " (rows.len()) " edges" }
                (table(&["cause", "effect", ">before", ">after", "in the graph", "true"], &rows)) }
        },
    }
}

/// The fitted person from the front half, read back from its file.
fn turntable(run: &Path, meter: &mut Meter) -> Result<Sheet> {
    let stored = store::read(&run.join("avatar.safetensors"))?;
    let [width, side] = UPRIGHT;
    // One camera per degree, of which a few are rendered.
    let orbit = Orbit {
        arc_rad: None,
        count: 360,
        center: None,
        radius: None,
        elevation_rad: 10f64.to_radians(),
        fov_x_rad: 40f64.to_radians(),
        size: [side; 2],
    };
    let pose = &stored.poses[MOMENT];
    let mut sheet = Sheet::new([TURNTABLE.len(), 1], UPRIGHT, 2);
    let cameras = stored.around(orbit, std::slice::from_ref(pose))?;
    for (k, degrees) in TURNTABLE.into_iter().enumerate() {
        meter.count(k, TURNTABLE.len(), "turntable");
        let out = stored.picture(pose, Some(MOMENT), &cameras[degrees.rem_euclid(360) as usize])?;
        // A person is narrow: the middle of a square image.
        let left = (side - width) / 2;
        let middle = out.image.chunks_exact(3 * side).flat_map(|row| &row[3 * left..3 * (left + width)]);
        let image: Vec<f32> = middle.map(|&x| order::clamp(x, 0.0, 1.0)).collect();
        sheet.put([k, 0], &image);
    }
    meter.done();
    Ok(sheet)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn graphs_are_told_by_the_names_of_the_factors() {
        let (fork, less) = (vec![(0, 1), (0, 2)], vec![(0, 1)]);
        let same = change(&[fork.clone(), fork.clone()]);
        assert_eq!(same, "posture→self-occlusion, posture→wrinkles (unchanged by tuning)", "one graph");
        let other = change(&[fork, less]);
        assert!(
            other.ends_with("; after: posture→self-occlusion") && other.starts_with("before tuning: "),
            "{other}"
        );
        assert!(change(&[vec![], vec![]]).starts_with("no edges"), "nothing");
    }
}
