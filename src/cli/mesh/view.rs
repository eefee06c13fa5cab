//! `mesh view`: a page about one mesh.

use super::page::{self, Input, Turn};
use super::sheets;
use crate::fit::orbit::Orbit;
use crate::fit::relight;
use crate::fit::training::Watch;
use crate::geometry::bvh::Bvh;
use crate::geometry::facts;
use crate::light;
use crate::meter::Meter;
use crate::report::run::Run;
use crate::scene::camera::Camera;
use crate::scene::light::{Environment, Lights};
use crate::scene::material::{Alpha, Material};
use crate::scene::mesh::Object;
use crate::scene::model;
use crate::shade::render::{Passes, Scene, Settings, render};
use crate::shade::{exposure, tonemap};
use crate::shared::ForceArgs;
use crate::{Result, choices, claim, console as cli};
use serde_json::{Value, json};
use std::path::PathBuf;

/// Write a page about a mesh.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight mesh view object.glb --out page
  lastlight mesh view scan.ply --size 128 --samples 16 --out page --json

--out gets report/index.html, a page of its own, and result.json. The page shows the mesh from ten sides in a built-in studio, normals and ambient occlusion, every map with the borders of its charts, and what can be counted: edges and whether they close the surface, parts, area and volume, charts, overlap, texels in use, texel density. Vertices with equal positions count as one. mesh render renders it under other light.")]
pub(crate) struct Args {
    /// Model: .gltf, .glb, .obj or .ply
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Size of the images of the turntable
    #[arg(long, value_name = "S|WxH", default_value = "320", value_parser = choices::size)]
    size: [usize; 2],
    /// Samples per pixel
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    samples: u32,
    /// Folder for the page; new or empty unless --force
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    filling: ForceArgs,
}

/// Views of the turntable.
const TURNS: usize = 8;
/// Of these, every second one has maps.
const EVERY: usize = 2;
/// Largest side in which use and overlap of texels are counted.
const COUNTED: usize = 2048;

pub(super) fn run(args: &Args) -> Result<()> {
    let mut meter = Meter::new();
    claim::check(&args.out, false, args.filling.force)?;
    let (object, notes) = model::read_with_notes(&args.file)?;
    notes.iter().for_each(|n| meter.note(&format!("note: {n}")));
    meter.lap("reading");
    let found = facts::facts(&object.mesh);
    let size = sheets::size(&object);
    let counted = size.unwrap_or([1024; 2]).map(|n| Ord::min(n, COUNTED));
    let layout = facts::layout(&object.mesh, counted).map(|mut layout| {
        let [real, counted] = [size.unwrap_or(counted), counted].map(|[w, h]| (w * h) as f64);
        layout.density = layout.density.map(|d| d * (real / counted));
        layout
    });
    meter.lap("counting");
    let turns = turns(args, &object, &mut meter)?;
    meter.done();
    meter.lap("rendering");
    let (sheets, left_out) = sheets::figures(&object)?;
    let facts = page::record(&object, &found, layout.as_ref());
    let record = json!({ "kind": "mesh view", "file": args.file, "notes": notes, "facts": facts });
    let path = args.out.join("result.json");
    let mut text = serde_json::to_string_pretty(&record).unwrap_or_default();
    text.push('\n');
    crate::io::atomic::write_bytes(&path, text.as_bytes())?;
    let settings = json!({ "size": args.size, "samples": args.samples });
    let run = Run::new(&settings, None, &meter, &args.out, &["result.json"]);
    let made = page::page(&Input {
        title: format!("The mesh {}", args.file.file_name().unwrap_or_default().to_string_lossy()),
        object: &object,
        facts: &found,
        layout: layout.as_ref(),
        size,
        turns: &turns,
        sheets: &sheets,
        left_out,
        run,
    })?;
    let report = made.write(&args.out)?;
    if cli::is_json() {
        return cli::say_json(&with_report(record, &report));
    }
    page::lines(&object, &found, layout.as_ref()).iter().try_for_each(|line| cli::say(line))?;
    cli::say(&format!("report      {}", report.display()))
}

fn with_report(mut record: Value, report: &std::path::Path) -> Value {
    record["report"] = json!(report);
    record
}

/// Grey behind white plaster.
const BEHIND: f32 = 0.5;

/// The object of white plaster: what is left of its radiance under uniform light is ambient occlusion.
fn plaster(object: &Object) -> Object {
    let white = |m: &Material| Material { alpha: m.alpha, roughness: 1.0, ..Material::default() };
    let opaque = |m: &Material| Material { alpha: Alpha::Opaque, ..white(m) };
    Object { materials: object.materials.iter().map(opaque).collect(), ..object.clone() }
}

/// The cameras: a turn, and one from above and one from below.
fn cameras(args: &Args, object: &Object) -> Result<Vec<(String, Camera)>> {
    let around = |count: usize, elevation: f64| {
        relight::around(
            &object.mesh,
            &Orbit {
                count,
                arc_rad: None,
                center: None,
                radius: None,
                elevation_rad: elevation.to_radians(),
                fov_x_rad: 35_f64.to_radians(),
                size: args.size,
            },
        )
    };
    let turn = around(TURNS, 15.0)?.into_iter().enumerate();
    let turn = turn.map(|(i, shot)| (format!("{}°", i * 360 / TURNS), shot.camera));
    let mut out: Vec<(String, Camera)> = turn.collect();
    for (name, elevation) in [("above", 80.0), ("below", -80.0)] {
        out.extend(around(1, elevation)?.into_iter().map(|shot| (name.to_owned(), shot.camera)));
    }
    Ok(out)
}

fn turns(args: &Args, object: &Object, meter: &mut Meter) -> Result<Vec<Turn>> {
    let bvh = Bvh::build(&object.mesh.positions, &object.mesh.triangles);
    let plaster = plaster(object);
    let [studio, uniform] = [light::studio(), Environment::constant([1.0; 3])]
        .map(|map| Lights { environment: Some(map), lamps: Vec::new() });
    let lit = Scene::new(object, &bvh, &studio)?;
    let pale = Scene::new(&plaster, &bvh, &uniform)?;
    let cameras = cameras(args, object)?;
    let settings = Settings { samples: args.samples, ..Settings::default() };
    let direct = Settings { bounces: 0, ..settings };
    let (mut out, mut scale) = (Vec::new(), None);
    for (i, (name, camera)) in cameras.iter().enumerate() {
        meter.count(i, cameras.len(), "rendering");
        let image = render(&lit, camera, None, &settings)?;
        // One exposure for all sides.
        let scale = *scale.get_or_insert_with(|| exposure::auto(&image.color, &image.alpha));
        let maps = (i < TURNS && i % EVERY == 0).then(|| render(&pale, camera, None, &direct)).transpose()?;
        out.push(Turn {
            name: name.clone(),
            size: args.size,
            image: over(&image, &encoded(&image.color, scale), 1.0),
            normals: maps.is_some().then(|| {
                let rgb: Vec<f32> = image.normal.iter().flat_map(|n| n.map(|x| 0.5 + 0.5 * x)).collect();
                over(&image, &rgb, 1.0)
            }),
            occlusion: maps.map(|m| {
                let grey: Vec<f32> = m.color.iter().flat_map(|c| [c[1]; 3]).collect();
                over(&m, &grey, BEHIND)
            }),
        });
    }
    Ok(out)
}

/// sRGB-encoded values of radiance.
fn encoded(color: &[[f32; 3]], scale: f32) -> Vec<f32> {
    tonemap::srgb_u8(color, scale).iter().map(|x| f32::from(*x) / 255.0).collect()
}

/// Pixels that hit the surface, others grey.
fn over(passes: &Passes, rgb: &[f32], grey: f32) -> Vec<f32> {
    let pixels = rgb.chunks_exact(3).zip(&passes.alpha);
    pixels
        .flat_map(|(c, a)| {
            let c: [f32; 3] = if *a >= 0.5 { [c[0], c[1], c[2]] } else { [grey; 3] };
            c.map(|x| crate::num::order::clamp(x, 0.0, 1.0))
        })
        .collect()
}
