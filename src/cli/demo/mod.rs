//! `demo`: LAST end to end on a built-in person, and a built-in scene, without any input.
//!
//! ```text
//! person   video ──► tuned structure ──► fitted person ──► held-out images, turntable, interventions
//! scene    photographs ──► Gaussians ──► held-out images
//! ```

mod args;
mod person;
mod scene;

use super::claim;
use super::meter::Meter;
use super::report::run::Run;
use super::report::{Page, Stat};
use super::shared::Outcome;
pub(super) use args::Args;

use super::console::{command_line, say};
use crate::io::atomic;
use crate::{Error, Result};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Held-out images must reach this on the built-in scene; below it, something is broken.
const LEAST_SCENE_DB: f64 = 28.0;
/// And this on the built-in person, in the box of its body.
const LEAST_PERSON_DB: f64 = 17.0;

/// The record in the folder, by which a demo knows its own.
const RECORD: &str = "result.json";

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new();
    let default = PathBuf::from("demo");
    let dir = args.out.as_deref().unwrap_or(&default);
    // The default folder belongs to the demo, so that it can be run twice.
    let is_ours = args.out.is_none() && dir.join(RECORD).is_file();
    let dir = claim::folder(dir, false, args.force || is_ours)?;
    let wants = |part: &str| args.only.as_ref().is_none_or(|only| only == part);
    let person = if wants("last") { Some(person::run(args, &dir, &mut meter)?) } else { None };
    let scene = if wants("splat") { Some(scene::run(args, &dir.join("scene"), &mut meter)?) } else { None };
    let held_out = |part: &Option<Outcome>| part.as_ref().map(|p| p.held_out_db);
    let checks = [
        ("the person", held_out(&person), LEAST_PERSON_DB, person::ITERATIONS),
        ("the scene", held_out(&scene), LEAST_SCENE_DB, scene::ITERATIONS),
    ];
    let record = json!({
        "kind": "demo", "lastlight": env!("CARGO_PKG_VERSION"), "seconds": meter.seconds(),
        "person": person.as_ref().map(|p| &p.record), "scene": scene.as_ref().map(|s| &s.record),
    });
    atomic::write_bytes(&dir.join(RECORD), format!("{record:#}\n").as_bytes())?;
    let page = page(person.as_ref(), scene.as_ref(), &meter, &dir);
    let mut lines = Vec::new();
    for (name, part) in [("person", &person), ("scene", &scene)] {
        if let Some(part) = part {
            lines.push(format!("— {name}"));
            lines.extend(part.lines.iter().cloned());
        }
    }
    Outcome { record, page, lines, held_out_db: f64::NAN }.publish(&dir)?;
    if !crate::console::is_json() {
        next(&dir, person.is_some(), scene.is_some())?;
    }
    for (name, reached, least, enough) in checks {
        let counts = args.iterations.is_none_or(|n| n >= enough);
        if let Some(db) = reached
            && counts
            && !(db >= least)
        {
            return Err(Error::check("demo")
                .at(format!("mean PSNR of the held-out pictures of {name}"))
                .expected(format!("at least {least} dB"))
                .got(format!("{db:.2} dB")));
        }
    }
    Ok(())
}

/// What to try now.
fn next(dir: &Path, person: bool, scene: bool) -> Result<()> {
    let d = dir.display();
    say("")?;
    say("Next:")?;
    say(&format!("  open {d}/report/index.html in a browser"))?;
    if person {
        say(&format!("  lastlight last render {d}/person --cameras orbit:36 --pose 5 --out around"))?;
        say(&format!(
            "  lastlight last fit {d}/subject/video --out alone           the same person without the model"
        ))?;
    }
    if scene {
        say(&format!(
            "  lastlight splat render {d}/scene/scene.ply --cameras orbit:36 --size 320x320 --out turntable"
        ))?;
        say(
            "  lastlight splat fit PHOTOS --out DIR     your own posed photographs (transforms.json or COLMAP)",
        )?;
    }
    say("  lastlight oracle list                    operators to compare your own code with")
}

/// One page: the person with everything, the images of the scene, what it took.
fn page(person: Option<&Outcome>, scene: Option<&Outcome>, meter: &Meter, dir: &Path) -> Page {
    let ends = ["time", "files", "settings"];
    let (mut stats, mut sections, mut facts) = (Vec::new(), Vec::new(), Vec::new());
    if let Some(p) = person {
        facts.push(("digest of the person", text(&p.record["digest"])));
        stats.extend(p.page.stats.iter().filter(|s| s.label != "Time").cloned());
        sections.extend(p.page.sections.iter().filter(|s| !ends.contains(&s.id)).cloned());
    }
    if let Some(s) = scene {
        facts.push(("digest of the scene", text(&s.record["digest"])));
        let label = if person.is_some() { "PSNR, scene, held out" } else { "PSNR, held out" };
        let first = s.page.stats.iter().take(1).cloned();
        stats.extend(first.map(|stat| Stat { label, ..stat }));
        let mut views = s.page.sections.clone();
        views.retain(|section| section.id == "views" || person.is_none() && !ends.contains(&section.id));
        if person.is_some() {
            for section in &mut views {
                (section.id, section.title) = ("scene", "A scene from photographs");
            }
        }
        sections.extend(views);
    }
    facts.push(("lastlight", env!("CARGO_PKG_VERSION").to_owned()));
    let settings = person.or(scene).map_or(&Value::Null, |part| &part.record["settings"]);
    let names = [
        "subject/dataset.json",
        "tuned.safetensors",
        "person/avatar.safetensors",
        "turntable.png",
        "interventions/grid.png",
        "interventions/moved.csv",
        "scene/scene.ply",
        "scene/scene.splat",
        RECORD,
    ];
    let run = Run::new(settings, None, meter, dir, &names);
    stats.push(run.card());
    sections.extend(run.tail());
    let title = match (person, scene) {
        (Some(_), Some(_)) => "A person from a video, a scene from photographs",
        (Some(_), None) => "A person from a video",
        _ => "A scene from photographs",
    };
    Page { kind: "demo".into(), title: title.into(), command: command_line(), facts, stats, sections }
}

fn text(value: &Value) -> String {
    value.as_str().unwrap_or_default().to_owned()
}
