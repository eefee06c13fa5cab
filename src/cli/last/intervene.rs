//! `last intervene`: one factor set, a grid of images of what changes.

use super::tune;
use crate::claim;
use crate::console as cli;
use crate::meter::Meter;
use crate::report::images::Sheet;
use crate::report::{self, Page, Section};
use crate::scene::person::PersonCapture;
use crate::shared::{ForceArgs, Outcome};
use crate::{Error, Result};
use lastlight_last::model::file::Trained;
use lastlight_last::model::guide;
use lastlight_last::model::intervene::{self, VALUES};
use maud::{Markup, html};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Intervene on one factor at a time and decode the counterfactual images.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight last intervene model/model.safetensors subject/video --out do
  lastlight last intervene model/model.safetensors subject/video --factor 0,2 --image 40 --out posture

Every row of grid.png sets one factor to nine values from the training set; the noise of the other factors is kept, and the descendants follow the graph. moved.csv holds how far each factor moved, in standard deviations: exactly 0 for factors that are not descendants.")]
pub(crate) struct Args {
    /// Model written by last pretrain (or its folder) or last tune
    #[arg(value_name = "FILE")]
    model: PathBuf,
    /// Capture of the person
    #[arg(value_name = "DIR")]
    capture: PathBuf,
    /// Folder for grid.png, moved.csv and report/index.html; new or empty unless --force
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The factors to set, counted from 0, comma-separated or repeated [default: all]
    #[arg(long, value_name = "N", value_delimiter = ',')]
    factor: Vec<usize>,
    /// Which training image to start from, counted from 0
    #[arg(long, value_name = "N", default_value_t = 0)]
    image: usize,
    #[command(flatten)]
    replace: ForceArgs,
}

/// Pixels between images.
const GAP: usize = 2;

/// Counterfactuals of one image: one row per factor that is set, one column per value.
pub(crate) struct Grid {
    sheet: Sheet,
    /// Values of each factor that is set, by column, in standard deviations from the one in the middle.
    values: Vec<[f64; VALUES]>,
    /// The factors that are set, each with the farthest that every factor moves, in standard deviations.
    pub(crate) moved: Vec<(usize, Vec<f64>)>,
    csv: String,
}

impl Grid {
    /// Sets the factors `which`, one after the other, in what the model makes of a shot of the capture.
    ///
    /// # Errors
    /// An image that cannot be read, or without the person; a camera that is not valid.
    pub(crate) fn new(
        trained: &Trained,
        capture: &PersonCapture,
        shot: usize,
        which: &[usize],
    ) -> Result<Self> {
        let n = trained.model.sizes.factors;
        let shot = &capture.shots[shot];
        let photo = shot.photo()?;
        let [mu, _] = trained.posterior(&guide::seen(trained, capture, shot, &photo)?);
        let camera = &shot.camera;
        let mut sheet = Sheet::new([VALUES, which.len()], [camera.width, camera.height], GAP);
        let mut moved = Vec::new();
        let mut values = Vec::new();
        let mut csv = String::from("factor,value");
        (0..n).for_each(|j| csv.push_str(&format!(",moved_{j}")));
        csv.push('\n');
        for (r, &i) in which.iter().enumerate() {
            let cells = intervene::row(trained, &mu, i)?;
            for (c, cell) in cells.iter().enumerate() {
                sheet.put([c, r], &intervene::picture(trained, &cell.points, camera)?);
                let far: Vec<String> = cell.moved.iter().map(|m| format!("{m:e}")).collect();
                csv.push_str(&format!("{i},{c},{}\n", far.join(",")));
            }
            let most = |j: usize| cells.iter().fold(0.0, |m, c| crate::num::order::max(m, c.moved[j]));
            moved.push((i, (0..n).map(most).collect()));
            values.push(in_deviations(trained, i));
        }
        Ok(Self { sheet, values, moved, csv })
    }

    /// Writes `grid.png` and `moved.csv`.
    ///
    /// # Errors
    /// When they cannot be written.
    pub(crate) fn write(&self, dir: &Path) -> Result<()> {
        self.sheet.write(&dir.join("grid.png"))?;
        crate::io::atomic::write_bytes(&dir.join("moved.csv"), self.csv.as_bytes())
    }

    /// The images as a table: a row for each factor, a column for each value.
    fn table(&self, name: &dyn Fn(usize) -> String) -> Result<Markup> {
        let middle = VALUES / 2;
        let head = |c: usize| {
            if c == middle { "median".to_owned() } else { format!("{:.0} %", 100.0 * intervene::quantile(c)) }
        };
        let mut rows = Vec::new();
        for (r, (i, _)) in self.moved.iter().enumerate() {
            let cells = (0..VALUES).map(|c| Ok((c, self.values[r][c], self.sheet.uri([c, r])?)));
            rows.push((name(*i), cells.collect::<Result<Vec<_>>>()?));
        }
        Ok(html! {
            div.scroll { table.grid-table {
                thead { tr { th scope="col" { "factor that is set" } @for c in 0..VALUES { th.mid[c == middle] scope="col" { (head(c)) } } } }
                tbody { @for (name, cells) in &rows { tr {
                    th scope="row" { (name) }
                    @for (c, value, uri) in cells { td.mid[*c == middle] {
                        img src=(uri) alt={ "decoded person with " (name) " set to " (sigmas(*value)) ", column " (c + 1) };
                        small { (sigmas(*value)) }
                    } }
                } } }
            } }
        })
    }

    /// Images and numbers for a report; `name` names a factor.
    ///
    /// # Errors
    /// When an image cannot be encoded.
    pub(crate) fn sections(&self, name: &dyn Fn(usize) -> String) -> Result<Vec<Section>> {
        let n = self.moved.first().map_or(0, |(_, moved)| moved.len());
        let names: Vec<String> = (0..n).map(|j| format!(">{}", name(j))).collect();
        let head: Vec<&str> = std::iter::once("set").chain(names.iter().map(String::as_str)).collect();
        let row = |(i, moved): &(usize, Vec<f64>)| -> Vec<Markup> {
            std::iter::once(report::text(name(*i)))
                .chain(moved.iter().map(|m| report::text(format!("{m:.3}"))))
                .collect()
        };
        Ok(vec![
            Section {
                id: "grid",
                title: "Counterfactuals",
                lead: "Each row sets one factor to nine values from the training set, from its 2 % quantile to its 98 % quantile; the middle column \
                       is the median, and values are in standard deviations σ from it. All other factors keep their noise, and effects follow the \
                       graph. The images show the decoder's person, coloured points that the model reconstructs from the input image: its clothes \
                       and face are not those of the video. Compare images within a row."
                    .into(),
                body: self.table(name)?,
            },
            Section {
                id: "moved",
                title: "Displacement of the factors",
                lead: "Largest displacement of each factor (column) when a factor (row) is set, in standard deviations of the training set. \
                       Factors that are not descendants have exactly 0."
                    .into(),
                body: report::table(&head, &self.moved.iter().map(row).collect::<Vec<_>>()),
            },
        ])
    }
}

/// A number of standard deviations.
fn sigmas(x: f64) -> String {
    match format!("{:.1}", x.abs()).as_str() {
        "0.0" => "0 σ".to_owned(),
        size => format!("{}{size} σ", if x < 0.0 { '−' } else { '+' }),
    }
}

/// Values of a factor by column: distance of its codes from the one in the middle, along the line from the first to the last, in
/// standard deviations of the training set: the root mean square over the dimensions, as in [`Grid::moved`].
fn in_deviations(trained: &Trained, factor: usize) -> [f64; VALUES] {
    let k = trained.model.sizes.width;
    let at = |q: usize, d: usize| {
        trained.codes[(factor * VALUES + q) * k + d] / trained.factor_spread[factor * k + d]
    };
    let axis: Vec<f64> = (0..k).map(|d| at(VALUES - 1, d) - at(0, d)).collect();
    let length = axis.iter().fold(0.0, |s, x| s + x * x).sqrt();
    std::array::from_fn(|q| {
        let along = (0..k).fold(0.0, |s, d| s + (at(q, d) - at(VALUES / 2, d)) * axis[d]);
        if length > 0.0 { along / (length * (k as f64).sqrt()) } else { 0.0 }
    })
}

pub(super) fn run(args: &Args) -> Result<()> {
    let meter = Meter::new();
    claim::check(&args.out, false, args.replace.force)?;
    let trained = Trained::of_pictures(&args.model)?;
    let capture = PersonCapture::open(&args.capture)?;
    let n = trained.model.sizes.factors;
    if let Some(bad) = args.factor.iter().find(|i| **i >= n) {
        return Err(Error::input("--factor").expected(format!("0 to {}", n - 1)).got(bad.to_string()));
    }
    let which: Vec<usize> = if args.factor.is_empty() { (0..n).collect() } else { args.factor.clone() };
    let shot = *capture.train.get(args.image).ok_or_else(|| {
        Error::input("--image")
            .expected(format!("below {}, the number of training images", capture.train.len()))
            .got(args.image.to_string())
    })?;
    super::graph_note::note_empty_graph(&trained, &meter);
    let grid = Grid::new(&trained, &capture, shot, &which)?;
    let dir = claim::folder(&args.out, false, args.replace.force)?;
    grid.write(&dir)?;
    let record = json!({
        "kind": "last intervene", "lastlight": env!("CARGO_PKG_VERSION"), "edges": trained.graph.edges(),
        "image": capture.shots[shot].name,
        "moved": grid.moved.iter().map(|(i, m)| json!({"factor": i, "most": m})).collect::<Vec<_>>(),
        "seconds": meter.seconds(),
    });
    let page = Page {
        kind: "last intervene".into(),
        title: format!("Interventions on {} by {}", crate::shared::name(&args.capture), args.model.display()),
        notice: "",
        command: cli::command_line(),
        facts: vec![("edges", tune::edges(&trained.graph.edges()))],
        stats: Vec::new(),
        sections: grid.sections(&|i| format!("factor {i}"))?,
    };
    let head: String = (0..n).map(|j| format!("{j:>9}")).collect();
    let mut lines = vec![format!("do \\ moved{head}")];
    for (i, moved) in &grid.moved {
        let row: String = moved.iter().map(|m| format!("{m:9.3}")).collect();
        lines.push(format!("{i:<10}{row}"));
    }
    lines.push(format!("grid        {}", dir.join("grid.png").display()));
    Outcome { record, page: Some(page), lines, held_out_db: f64::NAN }.publish(&dir)
}
