//! Fitted fields: how many samples the grid and early stop leave, what that is worth in time, and what filling costs.
//!
//! `OCCUPANCY_FITS=FIT:CAPTURE,… cargo bench --workspace --bench occupancy` prints tables in Markdown. FIT is the folder
//! or the file of a field, CAPTURE the capture that it was fitted to. Each field is rendered at 1/β = 250 with 1024
//! steps along the diagonal of its box: four crops of 192² pixels of images of 512², drawn as for a fit (more often where
//! the object is). `OCCUPANCY_ROUNDS` rounds (3), in each of which all ways of rendering follow each other. Every sample that is taken is
//! decoded by all heads; with `OCCUPANCY_LEAST_WEIGHT` the least weight of the fit is used, so that few are, however many are taken.

use crate::SAMPLES;
use lastlight::field::fetch::{Combine, Planes};
use lastlight::field::occupancy::{Learned, Occupancy, Settings, fill, fill_all};
use lastlight::field::render::{self, Intervals, Plan, Rays, Scene};
use lastlight::fit::field::crops;
use lastlight::fit::field::scene::Weights;
use lastlight::fit::field::targets::{Pictures, Targets};
use lastlight::fit::field::view::RayList;
use lastlight::scene::field::Field;
use lastlight::scene::views::Options;
use std::fmt::Write as _;
use std::path::Path;
use std::time::Instant;

const INVERSE_BETA: f32 = 250.0;
/// Pixels per side of an image, and of a crop of it.
const IMAGE: usize = 512;
const CROP: usize = 192;
const CROPS: usize = 4;
/// Transmittance at which rays stop; that of nerfacc.
const EARLY_STOP: f32 = 1e-4;

/// Ways of rendering.
const WAYS: [&str; 4] = ["all steps", "early stop alone", "grid alone", "grid and early stop"];

/// The numbers of one field.
struct Row {
    name: String,
    rays: usize,
    /// Samples taken, per way.
    taken: [usize; 4],
    /// Median seconds, per way.
    seconds: [f64; 4],
    /// Largest difference of a value from that of all steps, per way.
    difference: [f32; 4],
    occupied: f64,
    cost: [usize; 2],
    /// Median seconds: coarse to fine, and cell by cell.
    filling: [f64; 2],
}

fn median(times: &mut [f64]) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

fn timed<T>(work: impl FnOnce() -> T) -> (f64, T) {
    let start = Instant::now();
    let made = work();
    (start.elapsed().as_secs_f64(), made)
}

/// Rays of the crops, in the units of the field.
fn rays(targets: &Targets) -> RayList {
    let mut list = RayList::default();
    let Some(first) = targets.train.first() else { return list };
    let small = CROP * first.camera.width / IMAGE;
    for crop in crops::draw(&targets.train, 0, 0, CROPS, small) {
        let mut camera = targets.train[crop.view].camera.clone();
        let factor = IMAGE as f32 / camera.width as f32;
        camera.focal_px = camera.focal_px.map(|x| x * factor);
        camera.center_px = camera.center_px.map(|x| x * factor);
        (camera.width, camera.height) = (IMAGE, (camera.height as f32 * factor) as usize);
        let corner = crop.corner.map(|x| (x as f32 * factor) as usize);
        for i in 0..CROP * CROP {
            list.push(&camera, (corner[0] + i / CROP) * camera.width + corner[1] + i % CROP);
        }
    }
    list
}

/// The steps that take samples: all, or those in the occupied cells.
fn intervals(scene: &Scene<'_>, cells: Option<&Occupancy>) -> Intervals {
    match cells {
        Some(cells) => cells.intervals(scene.rays, scene.step()),
        None => scene.all_intervals(),
    }
}

fn measure(name: &str, field: &Field, targets: &Targets, rounds: usize) -> Row {
    let weights = Weights::of(field);
    let list = rays(targets);
    let rays: Rays<'_> = list.borrowed();
    let scene = weights.scene(rays);
    let (planes, combine): (Planes<'_>, Combine) = (scene.planes, scene.settings.combine);
    let learned = Learned::new(planes, combine, &scene.heads.sdf).expect("finite numbers");
    let settings = Settings::new(planes.half_size, SAMPLES, scene.beta);
    let mut filling = [Vec::new(), Vec::new()];
    let mut cells = None;
    for _ in 0..rounds {
        let (short, quick) = timed(|| fill(&learned, &settings).expect("settings"));
        let (long, plain) = timed(|| fill_all(&learned, &settings).expect("settings"));
        assert!(quick.grid == plain.grid, "the same cells");
        filling[0].push(short);
        filling[1].push(long);
        cells = Some(quick);
    }
    let cells = cells.expect("at least one round");
    let mut times: [Vec<f64>; 4] = std::array::from_fn(|_| Vec::new());
    let (mut taken, mut difference, mut truth) = ([0; 4], [0.0; 4], Vec::new());
    for _ in 0..rounds {
        for way in 0..WAYS.len() {
            let mut scene = weights.scene(rays);
            scene.settings.early_stop = (way % 2 == 1).then_some(EARLY_STOP);
            let (seconds, (out, samples)) = timed(|| {
                let mut plan = Plan::new(intervals(&scene, (way >= 2).then_some(&cells)));
                let out = render::forward(&scene, &mut plan);
                (out, plan.taken())
            });
            times[way].push(seconds);
            taken[way] = samples;
            if way == 0 {
                truth = out.values;
            } else {
                difference[way] = out
                    .values
                    .iter()
                    .zip(&truth)
                    .map(|(a, b)| (a - b).abs())
                    .fold(0.0, |m, d| if d > m { d } else { m });
            }
        }
    }
    Row {
        name: name.to_owned(),
        rays: rays.len(),
        taken,
        seconds: times.map(|mut t| median(&mut t)),
        difference,
        occupied: cells.fraction(),
        cost: [cells.cost.values, cells.cost.bounds],
        filling: filling.map(|mut t| median(&mut t)),
    }
}

/// The tables, and what the largest and smallest numbers are.
fn tables(rows: &[Row]) -> String {
    let mut text = format!(
        "{CROPS} crops of {CROP}² pixels of each field, 1/β = {INVERSE_BETA}, {SAMPLES} steps along the diagonal. Samples in \
         percent of {SAMPLES} × rays.\n\n| field | {} | largest differences of a value from all steps |\n|---|---|---|---|---|---|\n",
        WAYS.join(" | ")
    );
    let percent = |row: &Row, way: usize| 100.0 * row.taken[way] as f64 / (SAMPLES * row.rays) as f64;
    for row in rows {
        let _ = writeln!(
            text,
            "| {} | {:.2} | {:.2} | {:.2} | {:.2} | {:.1e}, {:.1e}, {:.1e} |",
            row.name,
            percent(row, 0),
            percent(row, 1),
            percent(row, 2),
            percent(row, 3),
            row.difference[1],
            row.difference[2],
            row.difference[3]
        );
    }
    let mean =
        |way: usize| rows.iter().map(|row| percent(row, way)).fold(0.0, |s, x| s + x) / rows.len() as f64;
    let _ = writeln!(text, "| mean | {:.2} | {:.2} | {:.2} | {:.2} | |", mean(0), mean(1), mean(2), mean(3));
    text.push_str(
        "\nTime: the steps of the rays and the render; without the filling.\n\n| field | way | evaluated without ÷ with | \
         time without ÷ with | share of it |\n|---|---|---|---|---|\n",
    );
    for row in rows {
        for way in [2, 3] {
            let evaluated = row.taken[0] as f64 / Ord::max(row.taken[way], 1) as f64;
            let time = row.seconds[0] / row.seconds[way];
            let _ = writeln!(
                text,
                "| {} | {} | {evaluated:.2} | {time:.2} | {:.2} |",
                row.name,
                WAYS[way],
                time / evaluated
            );
        }
    }
    text.push_str(
        "\nFilling 250³ cells by the published rule, the same cells both ways.\n\n| field | occupied, % | values | boxes | \
         time ÷ that of the plain queries | time ÷ that of the render with grid and early stop |\n|---|---|---|---|---|---|\n",
    );
    for row in rows {
        let _ = writeln!(
            text,
            "| {} | {:.2} | {} | {} | {:.3} | {:.2} |",
            row.name,
            100.0 * row.occupied,
            row.cost[0],
            row.cost[1],
            row.filling[0] / row.filling[1],
            row.filling[0] / row.seconds[3]
        );
    }
    text
}

/// Measures the fits of a list `FIT:CAPTURE,…` and prints the tables.
pub(crate) fn run(list: &str) {
    let rounds = std::env::var("OCCUPANCY_ROUNDS").ok().and_then(|n| n.parse().ok()).unwrap_or(3);
    let mut rows = Vec::new();
    for item in list.split(',') {
        let (fit, capture) = item.split_once(':').expect("OCCUPANCY_FITS is FIT:CAPTURE,…");
        let mut field = Field::read(Path::new(fit)).unwrap_or_else(|e| panic!("{e}"));
        field.settings.inverse_beta = INVERSE_BETA;
        field.settings.samples = SAMPLES;
        if std::env::var_os("OCCUPANCY_LEAST_WEIGHT").is_none() {
            field.settings.least_weight = None;
        }
        let options = Options { background: [1.0; 3], ..Options::default() };
        let pictures = Pictures::load(Path::new(capture), &options, None).unwrap_or_else(|e| panic!("{e}"));
        let targets = pictures.targets(field.placement);
        let name = Path::new(fit).file_name().map_or(fit.into(), |name| name.to_string_lossy().into_owned());
        rows.push(measure(&name, &field, &targets, rounds));
        eprintln!("{name}: measured");
    }
    println!("{}", tables(&rows));
}
