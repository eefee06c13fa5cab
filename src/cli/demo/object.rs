//! The object of the demo: LIRM end to end, by the functions of the commands `lirm gen`, `reconstruct`, `update`, `field mesh` and
//! `lirm relight`.
//!
//! ```text
//! objects/ ──► four images ──► first/ ──► four more ──► second/ ──► mesh.glb ──► relit.png, beside the true object
//! ```

use super::args::Args;
use crate::console as cli;
use crate::fit::field::Scores;
use crate::fit::field::mesh::{Settings as Form, bake};
use crate::fit::field::scores::means;
use crate::fit::field::targets::{Photo, Pictures};
use crate::fit::orbit::Orbit;
use crate::fit::passes::{PassSet, Shot, as_read};
use crate::fit::relight::around;
use crate::fit::training::Watch;
use crate::geometry::bvh::Bvh;
use crate::lirm::job::Job;
use crate::meter::Meter;
use crate::report::images::{Label, Sheet};
use crate::report::run::decibel;
use crate::report::{Page, Section, Stat, table, text};
use crate::scene::light::Lights;
use crate::scene::mesh::Object;
use crate::scene::model;
use crate::shade::exposure::auto;
use crate::shade::render::{Passes, Scene, Settings as Tracing, render};
use crate::shared::Outcome;
use crate::{Error, Result, light};
use data_gen::cameras;
use lastlight_lirm::r#gen::{self as set, Lighting, Set, Settings as Making};
use lastlight_lirm::model::decode::Rendering;
use lastlight_lirm::model::file::Model;
use lastlight_lirm::reconstruct::{Products, Reconstruction, Size, Start};
use maud::html;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

/// The object, of the test set: no model has been trained with it.
const SEED: u64 = 2;
const OBJECT: u64 = 24;
/// Pixels per side, and samples per pixel.
const SIDE: usize = 128;
const SAMPLES: u32 = 32;
/// Images of a set.
const SET: usize = 4;
/// Steps of a ray.
const STEPS: usize = 128;
/// Held-out images in the report.
const SHOWN: usize = 6;
/// Points of the grid of the mesh, and texels per side of its maps.
const FORM: [usize; 2] = [128, 512];
/// Directions of the turntable.
const DIRECTIONS: usize = 8;

/// Renders, reconstructs, improves, relights, in a folder.
pub(super) fn run(args: &Args, dir: &Path, meter: &mut Meter) -> Result<Outcome> {
    let (model, model_name) = crate::lirm::weights::model(args.model.as_deref(), meter)?;
    let (capture, truth) = images(&model, &dir.join("objects"), meter)?;
    let pictures = Pictures::load(&capture, &crate::field::read::options(1, false), None)?;
    let sets = cameras::test(SEED, OBJECT, SIDE).inputs;
    let sets: Vec<Vec<usize>> =
        sets.chunks(SET).take(2).map(|set| indices(&pictures, set)).collect::<Result<_>>()?;

    let read =
        |kind, set: &[usize], start: Start, name: &str, meter: &mut Meter| -> Result<(Products, Outcome)> {
            let reading = Reconstruction {
                model: &model,
                pictures: &pictures,
                sets: vec![set.to_vec()],
                size: Size::Usual,
                rendering: Rendering::of_field(STEPS, model.inverse_beta()),
            };
            let settings = json!({ "capture": capture, "model": model_name });
            let job = Job { kind, capture: &capture, reading, settings };
            let place = job.place(&start, meter)?;
            let dir = folder(dir.join(name))?;
            job.run(start, place, &dir, meter)
        };
    let (first, _) = read("lirm reconstruct", &sets[0], Start::Nothing(None, None), "first", meter)?;
    let before = Start::State(Box::new(first.state.clone()));
    let (second, outcome) = read("lirm update", &sets[1], before, "second", meter)?;

    let [side, texture] = FORM;
    let baked = bake(&second.field, &Form { side, texture, ..Form::default() })?;
    model::write(&dir.join("mesh.glb"), &baked.object)?;
    meter.lap("mesh and maps");
    let relit = relit(&[&truth, &baked.object], meter)?;
    relit.write(&dir.join("relit.png"))?;
    meter.lap("relighting");

    let rounds = [&first, &second].map(|made| means(&made.scored));
    let sections = vec![
        inputs(&pictures, &sets)?,
        improvement(&[&first.scored, &second.scored], &rounds)?,
        turntable(&relit)?,
    ];
    let db = |i: usize| rounds[i]["psnr_db"].as_f64().unwrap_or(f64::NAN);
    let stat = Stat {
        label: "PSNR, object, held out",
        value: decibel(db(1)),
        note: format!("after {} images; {} after {SET}", 2 * SET, decibel(db(0))),
    };
    let record = json!({
        "digest": outcome.record["digest"], "rounds": rounds, "stages": model.stages(), "seconds": meter.seconds(),
        "triangles": baked.object.mesh.triangles.len(),
    });
    let page = Page {
        kind: "demo".into(),
        title: String::new(),
        notice: "",
        command: String::new(),
        facts: Vec::new(),
        stats: vec![stat],
        sections,
    };
    let lines = vec![
        format!("PSNR        {} after {SET} images, {} after {}", decibel(db(0)), decibel(db(1)), 2 * SET),
        format!("digest      {}", record["digest"].as_str().unwrap_or_default()),
        format!("mesh        {}", dir.join("mesh.glb").display()),
    ];
    Ok(Outcome { record, page: Some(page), lines, held_out_db: db(1) })
}

/// A folder inside the demo's.
fn folder(path: PathBuf) -> Result<PathBuf> {
    std::fs::create_dir_all(&path).map_err(|e| Error::os(&path, &e))?;
    Ok(path)
}

/// Renders the object as `lirm gen` does: the folder of its capture, and its mesh.
fn images(model: &Model, dir: &Path, meter: &mut Meter) -> Result<(PathBuf, Object)> {
    // A model of the first stages has seen white light only.
    let is_lit = model.config.is_whole;
    let making = Making {
        objects: 1,
        first: OBJECT,
        lighting: if is_lit { Lighting::Environment } else { Lighting::Uniform },
        set: Set::Test,
        size: SIDE,
        samples: SAMPLES,
        seed: SEED,
        passes: PassSet::parse(&["depth", "normal", "albedo", "material"])?,
        ..Making::default()
    };
    cli::stoppable(|stop| {
        set::run(dir, &making, false, stop, &mut |done, total, what| meter.count(done, total, what))
    })?;
    meter.done();
    meter.lap("rendering the object");
    let object = dir.join(format!("object_{OBJECT:05}"));
    let truth = model::read(&object.join("object.glb"))?;
    Ok((object.join(if is_lit { "environment" } else { "uniform" }), truth))
}

/// The places of images of the test protocol among those of the capture.
fn indices(pictures: &Pictures, set: &[usize]) -> Result<Vec<usize>> {
    let find = |i: &usize| {
        let name = format!("{i:04}");
        let own = pictures.pictures.iter().position(|p| p.name.contains(&name));
        own.ok_or_else(|| Error::check("demo").expected(format!("image {name}")).got("none"))
    };
    set.iter().map(find).collect()
}

/// Objects in rows, seen from directions around the first, under the built-in studio; all have the exposure of the first.
fn relit(objects: &[&Object], meter: &mut Meter) -> Result<Sheet> {
    let orbit = Orbit {
        count: DIRECTIONS,
        center: None,
        arc_rad: None,
        radius: None,
        elevation_rad: 20f64.to_radians(),
        fov_x_rad: 35f64.to_radians(),
        size: [SIDE; 2],
    };
    let shots: Vec<Shot> = around(&objects[0].mesh, &orbit)?;
    let lights = Lights { environment: Some(light::studio()), lamps: Vec::new() };
    let settings = Tracing { samples: SAMPLES, ..Tracing::default() };
    let mut sheet = Sheet::new([DIRECTIONS, objects.len()], [SIDE; 2], 2);
    let mut exposures = Vec::new();
    for (row, object) in objects.iter().enumerate() {
        let bvh = Bvh::build(&object.mesh.positions, &object.mesh.triangles);
        let scene = Scene::new(object, &bvh, &lights)?;
        for (i, shot) in shots.iter().enumerate() {
            meter.count(row * shots.len() + i, objects.len() * shots.len(), "relighting");
            let passes = cli::stoppable(|stop| match stop.load(Ordering::Relaxed) {
                true => Err(Error::interrupted("demo")),
                false => render(&scene, &shot.camera, None, &settings),
            })?;
            if row == 0 {
                exposures.push(auto(&passes.color, &passes.alpha));
            }
            sheet.put([i, row], &over_white(shot, &passes, exposures[i])?);
        }
    }
    meter.done();
    Ok(sheet)
}

/// An image over white, (H, W, 3).
fn over_white(shot: &Shot, passes: &Passes, exposure: f32) -> Result<Vec<f32>> {
    let (rgb, passes) = as_read(passes, exposure, None)?;
    Ok(Photo { name: &shot.name, camera: &shot.camera, rgb: &rgb }.rendered(passes).color)
}

/// The images that were read.
fn inputs(pictures: &Pictures, sets: &[Vec<usize>]) -> Result<Section> {
    let mut sheet = Sheet::new([SET, sets.len()], [SIDE; 2], 2);
    for (row, set) in sets.iter().enumerate() {
        for (column, i) in set.iter().enumerate() {
            sheet.put([column, row], &pictures.pictures[*i].color);
        }
    }
    let body = sheet.strip(SET * sets.len(), &|[c, r]| Label {
        alt: format!("input image {} of set {}", c + 1, r + 1),
        caption: format!("set {}", r + 1),
    })?;
    Ok(Section {
        id: "object",
        title: "An object from images",
        lead: format!(
            "The images that the transformer reads, {SET} at a time, with their cameras and the foreground. No model has been trained with \
             this object."
        ),
        body,
    })
}

/// Held-out images beside both fields, and the scores.
fn improvement(rounds: &[&Vec<Scores>; 2], means: &[Value; 2]) -> Result<Section> {
    let count = Ord::min(SHOWN, rounds[0].len());
    let mut sheet = Sheet::new([count, 3], [SIDE; 2], 2);
    for c in 0..count {
        sheet.put([c, 0], &rounds[0][c].image.photo);
        (0..2).for_each(|r| sheet.put([c, r + 1], &rounds[r][c].image.image));
    }
    let db = |r: usize, c: usize| decibel(rounds[r][c].image.score.psnr_db);
    let images = sheet.columns(&|c| Label {
        alt: format!("held-out view {}: image, field of set 1, field of both sets", c + 1),
        caption: format!("{}, {}", db(0, c), db(1, c)),
    })?;
    let rows: Vec<Vec<_>> = SCORES
        .iter()
        .filter_map(|(key, name, digits)| {
            let [a, b] = [&means[0], &means[1]].map(|m| m[key].as_f64());
            let number = |x: f64| text(format!("{x:.digits$}"));
            Some(vec![text(name), number(a?), number(b?)])
        })
        .collect();
    Ok(Section {
        id: "rounds",
        title: "More images, a better field",
        lead: format!(
            "Top: held-out images. Middle: the field after {SET} images. Bottom: after {}. Nothing is optimised for the object: the transformer \
             turns the images into a field, and updates its state with the second set.",
            2 * SET
        ),
        body: html! { div.large { (images) } (table(&["mean of held-out views", ">after 4", ">after 8"], &rows)) },
    })
}

/// Names of means, how they are shown, and digits.
const SCORES: [(&str, &str, usize); 7] = [
    ("psnr_db", "PSNR, dB", 2),
    ("ssim", "SSIM", 3),
    ("numerical_normals_deg", "normals, degrees", 1),
    ("depth", "depth, units", 4),
    ("albedo_aligned_db", "albedo, aligned, dB", 2),
    ("roughness", "roughness, error", 3),
    ("metallic", "metallic, error", 3),
];

/// The relit turntable.
fn turntable(sheet: &Sheet) -> Result<Section> {
    let body = sheet.columns(&|c| Label {
        alt: format!("true object and mesh from {} degrees, relit", c * 360 / DIRECTIONS),
        caption: format!("{}°", c * 360 / DIRECTIONS),
    })?;
    Ok(Section {
        id: "relit",
        title: "Under another light",
        lead: "Path-traced under a studio light that is in none of the images. Top: the true object. Bottom: the mesh of the field after both \
               sets, with its maps of base colour, roughness and metallic."
            .into(),
        body: html! { div.large { (body) } },
    })
}
