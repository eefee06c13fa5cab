//! `last intervene`: one factor set, a grid of pictures of what changes.

use crate::cli::meter::Meter;
use crate::cli::{self, claim, report};
use crate::io::image_file;
use crate::last::model::file::Trained;
use crate::last::model::guide;
use crate::last::model::intervene::{self, VALUES};
use crate::scene::person::PersonCapture;
use crate::{Error, Result};
use maud::{Markup, html};
use serde_json::json;
use std::path::PathBuf;

/// Set one factor and see what changes and what does not.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight last intervene model/model.safetensors subject/video --out do
  lastlight last intervene model/model.safetensors subject/video --factor 0 --frame 40 --out posture

Every row of grid.png sets one factor to nine values it has in the training set; the noise of the others is
kept, their descendants follow the graph. moved.csv says how far each factor moved, in standard deviations:
0 exactly for what is no descendant.")]
pub(in crate::cli) struct Args {
    /// Model written by last pretrain or last tune
    #[arg(value_name = "MODEL")]
    model: PathBuf,
    /// Capture of the person
    #[arg(value_name = "CAPTURE")]
    capture: PathBuf,
    /// Folder for grid.png, moved.csv and report/index.html; new or empty unless --force
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The factors to set, counted from 0 [default: all]
    #[arg(long, value_name = "I", num_args = 1..)]
    factor: Vec<usize>,
    /// Which training picture to start from, counted from 0
    #[arg(long, value_name = "N", default_value_t = 0)]
    frame: usize,
    /// Replace files in --out that exist
    #[arg(long)]
    force: bool,
    /// Print the record as JSON
    #[arg(long)]
    json: bool,
    /// No progress, no remarks
    #[arg(long)]
    quiet: bool,
}

/// Pixels between pictures.
const GAP: usize = 2;

pub(super) fn run(args: &Args) -> Result<()> {
    let meter = Meter::new(args.quiet);
    claim::check(&args.out, false, args.force)?;
    let trained = Trained::read(&args.model)?;
    let capture = PersonCapture::open(&args.capture)?;
    let n = trained.model.sizes.factors;
    if let Some(bad) = args.factor.iter().find(|i| **i >= n) {
        return Err(Error::input("--factor").expected(format!("0 to {}", n - 1)).got(bad.to_string()));
    }
    let which: Vec<usize> = if args.factor.is_empty() { (0..n).collect() } else { args.factor.clone() };
    let index = *capture.train.get(args.frame).ok_or_else(|| {
        Error::input("--frame")
            .expected(format!("below {}, the number of training pictures", capture.train.len()))
            .got(args.frame.to_string())
    })?;
    let shot = &capture.shots[index];
    let photo = shot.photo()?;
    let [mu, _] = trained.posterior(&guide::seen(&trained, &capture, shot, &photo)?);
    let camera = &shot.camera;
    let (w, h) = (camera.width, camera.height);
    let (columns, rows) = (VALUES, which.len());
    let (width, height) = (columns * (w + GAP) - GAP, rows * (h + GAP) - GAP);
    let mut grid = vec![1.0_f32; width * height * 3];
    let mut table = Vec::new();
    let mut csv = String::from("factor,value");
    (0..n).for_each(|j| csv.push_str(&format!(",moved_{j}")));
    csv.push('\n');
    for (r, &i) in which.iter().enumerate() {
        let cells = intervene::row(&trained, &mu, i)?;
        for (c, cell) in cells.iter().enumerate() {
            let picture = intervene::picture(&trained, &cell.points, camera)?;
            for (y, line) in picture.chunks_exact(w * 3).enumerate() {
                let at = ((r * (h + GAP) + y) * width + c * (w + GAP)) * 3;
                grid[at..at + w * 3].copy_from_slice(line);
            }
            let moved: Vec<String> = cell.moved.iter().map(|m| format!("{m:e}")).collect();
            csv.push_str(&format!("{i},{c},{}\n", moved.join(",")));
        }
        let most = |j: usize| cells.iter().fold(0.0, |m, c| crate::num::order::max(m, c.moved[j]));
        table.push((i, (0..n).map(most).collect::<Vec<f64>>()));
    }
    let dir = claim::folder(&args.out, false, args.force)?;
    image_file::write_png(&dir.join("grid.png"), width, height, 3, &image_file::to_u8(&grid)?)?;
    crate::io::atomic::write_bytes(&dir.join("moved.csv"), csv.as_bytes())?;
    let page = page(args, &trained, &table, &grid, [width, height])?.write(&dir)?;
    if args.json {
        return cli::say_json(&json!({
            "kind": "last intervene", "lastlight": env!("CARGO_PKG_VERSION"), "edges": trained.graph.edges(),
            "picture": shot.name, "moved": table.iter().map(|(i, m)| json!({"factor": i, "most": m})).collect::<Vec<_>>(),
            "seconds": meter.seconds(),
        }));
    }
    let head: String = (0..n).map(|j| format!("{j:>9}")).collect();
    cli::say(&format!("do \\ moved{head}"))?;
    for (i, moved) in &table {
        let row: String = moved.iter().map(|m| format!("{m:9.3}")).collect();
        cli::say(&format!("{i:<10}{row}"))?;
    }
    cli::say(&format!("grid        {}", dir.join("grid.png").display()))?;
    cli::say(&format!("report      {}", page.display()))
}

fn page(
    args: &Args,
    trained: &Trained,
    table: &[(usize, Vec<f64>)],
    grid: &[f32],
    [width, height]: [usize; 2],
) -> Result<report::Page> {
    let n = trained.model.sizes.factors;
    let names: Vec<String> = (0..n).map(|j| format!(">factor {j}")).collect();
    let head: Vec<&str> = std::iter::once("set").chain(names.iter().map(String::as_str)).collect();
    let rows: Vec<Vec<Markup>> = table
        .iter()
        .map(|(i, moved)| {
            std::iter::once(report::text(format!("factor {i}")))
                .chain(moved.iter().map(|m| report::text(format!("{m:.3}"))))
                .collect()
        })
        .collect();
    let picture = report::pictures::data_uri(grid, width, height, 2400)?;
    Ok(report::Page {
        kind: "last intervene".into(),
        title: args.model.display().to_string(),
        command: cli::command_line(),
        facts: vec![("edges", trained.graph.edges().iter().map(|(i, j)| format!("{i}>{j}")).collect::<Vec<_>>().join(" "))],
        stats: Vec::new(),
        sections: vec![
            report::Section {
                id: "grid",
                title: "Counterfactuals",
                lead: "One row per factor that is set, its values from end to end of the training set. Everything else keeps its noise.".into(),
                body: html! { img src=(picture) alt="pictures of counterfactuals" style="width:100%;image-rendering:pixelated"; },
            },
            report::Section {
                id: "moved",
                title: "What moved",
                lead: "The farthest each factor moved, in standard deviations of the training set; 0 is exact.".into(),
                body: report::table(&head, &rows),
            },
        ],
    })
}
