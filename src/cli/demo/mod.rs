//! `demo`: LAST end to end on a built-in person, LIRM on a built-in object, and a built-in scene, without any input.
//!
//! ```text
//! person   video ──► tuned structure ──► fitted person ──► held-out images, turntable, interventions
//! object   four images ──► field ──► four more ──► better field ──► mesh ──► relit turntable
//! scene    images ──► Gaussians ──► held-out images
//! ```

mod args;
mod object;
mod person;
mod scene;

use super::claim;
use super::meter::Meter;
use super::report::run::Run;
use super::report::{Page, Stat};
use super::shared::Outcome;
pub(super) use args::Args;

use super::console::{arguments, command_line, program, say};
use crate::io::atomic;
use crate::{Error, Result, like, version};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Held-out images must reach this on the built-in scene; below it, something is broken.
const LEAST_SCENE_DB: f64 = 28.0;
/// And this on the built-in person, in the box of its body.
const LEAST_PERSON_DB: f64 = 17.0;
/// And this on the built-in object after both sets, with the included model.
const LEAST_OBJECT_DB: f64 = 17.0;

/// The record in the folder, by which a demo recognises its own output.
const RECORD: &str = "result.json";

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new();
    let default = PathBuf::from("demo");
    let dir = args.out.as_deref().unwrap_or(&default);
    // The default folder belongs to the demo, so that it can be run twice.
    let is_ours = args.out.is_none() && dir.join(RECORD).is_file();
    let dir = claim::folder(dir, false, args.force || is_ours)?;
    let wants = |part: &str| args.only.as_ref().is_none_or(|only| only == part);
    let person = timed(&mut meter, wants("last"), |meter| person::run(args, &dir, meter))?;
    let object = timed(&mut meter, wants("lirm"), |meter| object::run(args, &dir.join("object"), meter))?;
    let scene = timed(&mut meter, wants("splat"), |meter| scene::run(args, &dir.join("scene"), meter))?;
    let held_out = |part: &Option<Outcome>| part.as_ref().map(|p| p.held_out_db);
    let checks = [
        ("the person", held_out(&person), LEAST_PERSON_DB, person::ITERATIONS),
        ("the object", held_out(&object).filter(|_| args.model.is_none()), LEAST_OBJECT_DB, 0),
        ("the scene", held_out(&scene), LEAST_SCENE_DB, scene::ITERATIONS),
    ];
    let record = json!({
        "kind": "demo", "lastlight": env!("CARGO_PKG_VERSION"), "seconds": meter.seconds(),
        like::ARGUMENTS: arguments(), "build": version::record(),
        "person": person.as_ref().map(|p| &p.record), "object": object.as_ref().map(|o| &o.record),
        "scene": scene.as_ref().map(|s| &s.record),
    });
    atomic::write_bytes(&dir.join(RECORD), format!("{record:#}\n").as_bytes())?;
    let page = page(person.as_ref(), object.as_ref(), scene.as_ref(), &meter, &dir);
    let mut lines = Vec::new();
    for (name, part) in [("person", &person), ("object", &object), ("scene", &scene)] {
        if let Some(part) = part {
            lines.push(format!("— {name}"));
            lines.extend(part.lines.iter().cloned());
        }
    }
    Outcome { record, page: Some(page), lines, held_out_db: f64::NAN }.publish(&dir)?;
    if !crate::console::is_json() && !crate::console::is_quiet() {
        next(&dir, [person.is_some(), object.is_some(), scene.is_some()])?;
    }
    for (name, reached, least, enough) in checks {
        let counts = args.iterations.is_none_or(|n| n >= enough);
        if let Some(db) = reached
            && counts
            && !(db >= least)
        {
            return Err(Error::check("demo")
                .at(format!("mean PSNR of the held-out images of {name}"))
                .expected(format!("at least {least} dB"))
                .got(format!("{db:.2} dB")));
        }
    }
    Ok(())
}

/// One part of the demo, if it is wanted, with a clock of its own: its time is recorded as its own, not as that of all before it.
fn timed(
    meter: &mut Meter,
    is_wanted: bool,
    run: impl FnOnce(&mut Meter) -> Result<Outcome>,
) -> Result<Option<Outcome>> {
    if !is_wanted {
        return Ok(None);
    }
    let mut part = Meter::part();
    let outcome = run(&mut part)?;
    meter.add(&part);
    Ok(Some(outcome))
}

/// What to try now.
fn next(dir: &Path, [person, object, scene]: [bool; 3]) -> Result<()> {
    let d = dir.display();
    say("")?;
    say("Next:")?;
    let program = program();
    say(&format!("  open {d}/report/index.html in a browser"))?;
    if person {
        say(&format!("  {program} last render {d}/person --cameras orbit:36 --pose 5 --out around"))?;
        say(&format!(
            "  {program} last fit {d}/subject/video --out alone           the same person without the model"
        ))?;
    }
    if object {
        say(&format!(
            "  {program} lirm relight {d}/object/second --env sunset --cameras orbit:8 --out relit"
        ))?;
    }
    if scene {
        say(&format!(
            "  {program} splat render {d}/scene --cameras orbit:36 --size 320x240 --out turntable"
        ))?;
        say(&format!(
            "  {program} splat fit PHOTOS --out DIR     your own photos, see {program} help captures"
        ))?;
    }
    say(&format!("  {program} oracle list                    operators to compare your own code with"))
}

/// One page: the person with everything, the object, the images of the scene, what it took.
fn page(
    person: Option<&Outcome>,
    object: Option<&Outcome>,
    scene: Option<&Outcome>,
    meter: &Meter,
    dir: &Path,
) -> Page {
    let ends = ["time", "files", "settings"];
    let (mut stats, mut sections, mut facts) = (Vec::new(), Vec::new(), Vec::new());
    if let Some(p) = person {
        facts.push(("digest of the person", text(&p.record["digest"])));
        stats.extend(p.stats().iter().filter(|s| s.label != "Time").cloned());
        sections.extend(p.sections().iter().filter(|s| !ends.contains(&s.id)).cloned());
    }
    if let Some(o) = object {
        facts.push(("digest of the object", text(&o.record["digest"])));
        stats.extend(o.stats().iter().cloned());
        sections.extend(o.sections().iter().cloned());
    }
    let is_alone = person.is_none() && object.is_none();
    if let Some(s) = scene {
        facts.push(("digest of the scene", text(&s.record["digest"])));
        let label = if is_alone { "PSNR, held out" } else { "PSNR, scene, held out" };
        let first = s.stats().iter().take(1).cloned();
        stats.extend(first.map(|stat| Stat { label, ..stat }));
        let mut views = s.sections().to_vec();
        views.retain(|section| section.id == "views" || is_alone && !ends.contains(&section.id));
        if !is_alone {
            for section in &mut views {
                (section.id, section.title) = ("scene", "A scene from images");
            }
        }
        sections.extend(views);
    }
    let names = [
        "subject/dataset.json",
        "tuned.safetensors",
        "person/avatar.safetensors",
        "turntable.png",
        "interventions/grid.png",
        "interventions/moved.csv",
        "object/objects/dataset.json",
        "object/second/field.safetensors",
        "object/second/state.safetensors",
        "object/mesh.glb",
        "object/relit.png",
        "scene/scene.ply",
        "scene/scene.splat",
        RECORD,
    ];
    let run = Run::new(&Value::Null, None, meter, dir, &names);
    stats.push(run.card());
    sections.extend(run.tail().into_iter().filter(|s| s.id != "settings"));
    // Those of the fit itself, which knows its defaults.
    let own = person.or(scene).and_then(|part| part.sections().iter().find(|s| s.id == "settings"));
    sections.extend(own.cloned());
    let parts = [
        (person, "a person from a video"),
        (object, "an object from a few images"),
        (scene, "a scene from images"),
    ];
    let names: Vec<&str> = parts.iter().filter_map(|(part, name)| part.map(|_| *name)).collect();
    let title = names.join(", ").replacen('a', "A", 1);
    Page { kind: "demo".into(), title, notice: "", command: command_line(), facts, stats, sections }
}

fn text(value: &Value) -> String {
    value.as_str().unwrap_or_default().to_owned()
}
