//! The page of `oracle compare`: where two files of arrays part, and how each array differs.

use super::compare_table::{capital, overview, stats, verdict};
use super::images::{self, Label};
use super::{Page, Section, bars, table, text, thousands};
use crate::Result;
use crate::num::array::Arrays;
use crate::num::order;
use lastlight_oracle::oracle::compare::{ArrayReport, Report, plural, ulp};
use maud::{Markup, html};
use std::path::Path;

/// Decades of a heat map below its largest error.
const DECADES: f64 = 4.0;
/// Most views of an array that are drawn.
const MAX_VIEWS: usize = 4;
/// Least side of an array that is drawn as an image.
const LEAST_SIDE: usize = 8;
/// Least number of rows that are drawn as a map of rows.
const LEAST_ROWS: usize = 4;
/// Most rows that are drawn, the first ones.
const MAX_ROWS: usize = 65_536;
/// Factor of the smallest bin of a histogram to the next one: 10 to the power of this.
const BIN: f64 = 0.5;

/// What is compared.
pub(crate) struct Input<'a> {
    /// the result
    pub(crate) report: &'a Report,
    /// the user's file
    pub(crate) your_file: &'a Path,
    /// the reference file
    pub(crate) reference_file: &'a Path,
    /// the user's arrays
    pub(crate) yours: &'a Arrays,
    /// the reference arrays
    pub(crate) reference: &'a Arrays,
    /// stages of the operator: name, inputs, outputs
    pub(crate) stages: Vec<Stage>,
    /// the command line
    pub(crate) command: String,
}

/// A stage of an operator.
pub(crate) struct Stage {
    /// its name; backward passes end in ` adjoint`
    pub(crate) name: &'static str,
    /// names of the arrays that it writes
    pub(crate) outputs: Vec<&'static str>,
}

/// The page.
///
/// # Errors
/// When an image cannot be encoded.
pub(crate) fn page(x: &Input<'_>) -> Result<Page> {
    let r = x.report;
    let name = r.operator.unwrap_or("Arrays");
    let differing: Vec<&ArrayReport> = r.differing().collect();
    let is_incomplete = !r.missing.is_empty() || !r.unknown.is_empty();
    let title = match &r.divergence {
        _ if r.passed && is_incomplete => format!("{name}: the arrays of both files match"),
        _ if r.passed => format!("{name}: all arrays match"),
        _ if differing.is_empty() => format!("{name}: {}", r.summary()),
        Some(d) => format!("{name}: first difference in {}", readable(&d.stage)),
        None => format!("{name}: arrays differ"),
    };
    let mut sections = Vec::new();
    if !x.stages.is_empty() {
        sections.push(Section {
            id: "stages",
            title: "Stages",
            lead: "Stages of the operator in the order of evaluation, with the arrays that each one writes. Start at the first divergence: later \
                   differences can follow from it."
                .into(),
            body: html! {
                (stages(x))
                @if let Some(d) = &r.divergence { p.lead { (d) } }
                @if let Some(note) = r.inputs_note() { p.lead { (note) } }
            },
        });
    }
    sections.push(Section {
        id: "arrays",
        title: "Arrays",
        lead: "Every array of both files. Errors are yours − reference.".into(),
        body: overview(r, x.stages.is_empty()),
    });
    // The differing arrays first.
    let rest = r.arrays.iter().filter(|a| a.matches() && !a.worst.is_empty());
    let shown: Vec<&ArrayReport> = differing.into_iter().chain(rest).collect();
    if !shown.is_empty() {
        let parts = shown.iter().map(|a| array(x, a)).collect::<Result<Vec<_>>>()?;
        sections.push(Section {
            id: "errors",
            title: "Errors by array",
            lead: format!(
                "The histogram counts entries by the size of their error relative to the root mean square of the reference. Heat maps are logarithmic, \
                 from black for equal entries to light yellow for the largest error; dark purple is a factor of 10^{DECADES:.0} below it."
            ),
            body: html! { div.stack { @for part in &parts { (part) } } },
        });
    }
    let mut facts = vec![("yours", x.your_file.display().to_string())];
    facts.push(("reference", x.reference_file.display().to_string()));
    facts.push(("tolerance", format!("relative L2 {:e}", r.tol)));
    if !r.also_fits.is_empty() {
        facts.push(("the names also fit", format!("{} (--op selects)", r.also_fits.join(", "))));
    }
    Ok(Page {
        kind: "oracle compare".into(),
        title,
        notice: "",
        command: x.command.clone(),
        facts,
        stats: stats(r),
        sections,
    })
}

/// `splat.project adjoint` as `splat.project, backward pass`.
fn readable(stage: &str) -> String {
    stage.strip_suffix(" adjoint").map_or_else(|| stage.to_owned(), |s| format!("{s}, backward pass"))
}

/// The stages, coloured by their outputs.
fn stages(x: &Input<'_>) -> Markup {
    let r = x.report;
    let find = |name: &str| r.arrays.iter().find(|a| a.name == name);
    let first = r.divergence.as_ref().map(|d| d.stage.as_str());
    let state = |s: &Stage| {
        let seen: Vec<&ArrayReport> = s.outputs.iter().filter_map(|n| find(n)).collect();
        let differ = seen.iter().filter(|a| !a.matches()).count();
        match (seen.len(), differ) {
            _ if first == Some(s.name) => ("first", "first divergence".to_owned()),
            (0, _) => ("", "not checked: no output in both files".to_owned()),
            (n, 0) => {
                ("ok", format!("matches ({n} of {} output{})", s.outputs.len(), plural(s.outputs.len())))
            }
            (1, _) => ("after", "1 of 1 output differs".to_owned()),
            (n, d) => ("after", format!("{d} of {n} outputs differ")),
        }
    };
    html! {
        ol.stages { @for s in &x.stages {
            @let (class, words) = state(s);
            li class=(class) { b { (readable(s.name)) } (words) }
        } }
    }
}

/// One array: histogram, heat map, worst entries.
fn array(x: &Input<'_>, a: &ArrayReport) -> Result<Markup> {
    let errors = errors(x, a);
    let maps = if errors.is_empty() {
        html! {}
    } else {
        let has_gaussians = x.report.operator.is_some_and(|op| op.starts_with("splat."));
        heat(a, &errors, if has_gaussians { "row (such as a Gaussian)" } else { "row" })?
    };
    let rows: Vec<Vec<Markup>> = (a.worst.iter())
        .map(|w| {
            vec![
                text(format!("{:?}", w.index)),
                text(number(w.yours)),
                text(number(w.reference)),
                text(format!("{:.3e}", w.yours - w.reference)),
                text(ulp(w.ulp)),
            ]
        })
        .collect();
    let head = ["index", ">yours", ">reference", ">yours − reference", ">ulp"];
    let body = html! {
        div.stack {
            @for text in a.reason.iter().chain(&a.note) { p.note { (capital(text)) "." } }
            @if !errors.is_empty() { div.two { div { (histogram(a, &errors, rms(x, a))) } (maps) } }
            @if !rows.is_empty() { div { h3 { "Largest errors" } (table(&head, &rows)) } }
        }
    };
    let is_good = a.matches();
    Ok(html! {
        details open[!is_good] {
            summary { code { (a.name) } " " @if is_good { "matches within the tolerance" } @else { (verdict(a)) } }
            (body)
        }
    })
}

/// A value with the digits that an f32 needs, where it is one.
fn number(x: f64) -> String {
    let narrow = x as f32;
    if f64::from(narrow) == x { format!("{narrow:e}") } else { format!("{x:.10e}") }
}

/// |yours − reference| by entry; empty if the arrays cannot be subtracted.
fn errors(x: &Input<'_>, a: &ArrayReport) -> Vec<f64> {
    let (Some(y), Some(r)) = (x.yours.get(&a.name), x.reference.get(&a.name)) else { return Vec::new() };
    if y.shape() != r.shape() {
        return Vec::new();
    }
    y.to_f64().iter().zip(&r.to_f64()).map(|(y, r)| if y == r { 0.0 } else { (y - r).abs() }).collect()
}

fn rms(x: &Input<'_>, a: &ArrayReport) -> f64 {
    let values = x.reference.get(&a.name).map_or_else(Vec::new, lastlight_num::num::array::Array::to_f64);
    let finite: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
    let sum = finite.iter().fold(0.0, |s, v| s + v * v);
    let mean = sum / Ord::max(finite.len(), 1) as f64;
    if mean > 0.0 { mean.sqrt() } else { 1.0 }
}

/// Numbers of entries by the decimal logarithm of their error over the root mean square of the reference.
fn histogram(a: &ArrayReport, errors: &[f64], rms: f64) -> Markup {
    let equal = errors.iter().filter(|e| **e == 0.0).count();
    let odd = errors.iter().filter(|e| !e.is_finite()).count();
    let bin = |e: f64| libm::floor(libm::log10(e / rms) / BIN) as i64;
    let bins: Vec<i64> = errors.iter().filter(|e| **e > 0.0 && e.is_finite()).map(|&e| bin(e)).collect();
    let note = html! { p.note {
        (thousands(equal)) " of " (thousands(errors.len())) (if errors.len() == 1 { " entry is equal." } else { " entries are equal." })
        @if odd > 0 { " " (thousands(odd)) (if odd == 1 { " is NaN or infinite." } else { " are NaN or infinite." }) }
    } };
    let (Some(&low), Some(&high)) = (bins.iter().min(), bins.iter().max()) else { return note };
    let mut counts = vec![0_usize; (high - low + 1) as usize];
    bins.iter().for_each(|b| counts[(b - low) as usize] += 1);
    let title = format!("log₁₀ of the relative error of {}", a.name);
    html! { (bars::histogram(&title, low as f64 * BIN, BIN, &counts)) (note) }
}

/// Errors by pixel or by row as images; `row`: what a row is.
fn heat(a: &ArrayReport, errors: &[f64], row: &str) -> Result<Markup> {
    let largest = errors.iter().filter(|e| e.is_finite()).fold(0.0, |m, &e| order::max(m, e));
    if largest == 0.0 {
        return Ok(html! {});
    }
    let color = |e: f64| {
        // The lowest tenth of the colours is left to equal entries.
        let t = if e.is_finite() { 1.0 + libm::log10(e / largest) / DECADES } else { 1.0 };
        images::inferno(if e == 0.0 { 0.0 } else { (0.15 + 0.85 * order::clamp(t, 0.0, 1.0)) as f32 })
    };
    let mut figures = Vec::new();
    let mut draw = |cells: &[f64], [w, h]: [usize; 2], what: &str| -> Result<()> {
        let rgb: Vec<f32> = cells.iter().flat_map(|&e| color(e)).collect();
        let alt = format!("errors of {} by {what}, largest {largest:.3e}", a.name);
        figures.push((
            images::data_uri(&rgb, w, h, 512)?,
            Label { alt, caption: format!("{what}, light yellow = {largest:.3e}") },
        ));
        Ok(())
    };
    let largest_of =
        |part: &[f64]| part.iter().fold(0.0, |m, &e| if e.is_finite() { order::max(m, e) } else { e });
    if let Some([views, h, w, channels]) = as_images(&a.shape_reference) {
        for (v, view) in errors.chunks_exact(h * w * channels).take(Ord::min(views, MAX_VIEWS)).enumerate() {
            let cells: Vec<f64> = view.chunks_exact(channels).map(largest_of).collect();
            draw(&cells, [w, h], &format!("pixel, view {v}"))?;
        }
    } else if let Some(rows) = as_rows(&a.shape_reference).filter(|&r| r >= LEAST_ROWS && errors.len() >= r) {
        let mut cells: Vec<f64> =
            errors.chunks_exact(errors.len() / rows).take(MAX_ROWS).map(largest_of).collect();
        let w = libm::ceil((cells.len() as f64).sqrt() * 1.6) as usize;
        let h = cells.len().div_ceil(w);
        cells.resize(w * h, 0.0);
        draw(&cells, [w, h], &format!("{row}, {rows} rows from left to right and down"))?;
    }
    Ok(html! { div.cells { (images::strip(&figures)) } })
}

/// Views, height, width, channels of (C, H, W, 3), (H, W, 3) or (C, H, W).
fn as_images(shape: &[usize]) -> Option<[usize; 4]> {
    let [c, h, w, n] = match *shape {
        [c, h, w, 3] => [c, h, w, 3],
        [h, w, 3] if h >= LEAST_SIDE && w >= LEAST_SIDE => [1, h, w, 3],
        [c, h, w] => [c, h, w, 1],
        _ => return None,
    };
    (h >= LEAST_SIDE && w >= LEAST_SIDE && c > 0).then_some([c, h, w, n])
}

/// Rows of (N), (N, …), or (C, N, …) with few C.
fn as_rows(shape: &[usize]) -> Option<usize> {
    match *shape {
        [n] | [n, _] => Some(n),
        [c, n, ..] if c <= MAX_VIEWS => Some(c * n),
        [n, ..] => Some(n),
        [] => None,
    }
    .filter(|&n| n > 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use lastlight_oracle::oracle::compare;

    fn arrays(error: f32) -> Arrays {
        let image: Vec<f32> =
            (0..16 * 12 * 3).map(|i| i as f32 / 576.0 + if i == 300 { error } else { 0.0 }).collect();
        let rows: Vec<f32> = (0..60).map(|i| i as f32 * if i == 31 { 1.0 + error } else { 1.0 }).collect();
        Arrays::new().with("photo_like", &[1, 12, 16, 3], image).with("numbers", &[20, 3], rows).with(
            "same",
            &[3],
            vec![1.0_f32; 3],
        )
    }

    #[test]
    fn the_page_shows_where_the_errors_are() {
        let (yours, reference) = (arrays(0.5), arrays(0.0));
        let report = compare::arrays(&yours, &reference, None, 1e-5).expect("compares");
        let stage = |name, outputs: &[&'static str]| Stage { name, outputs: outputs.to_vec() };
        let input = Input {
            report: &report,
            your_file: Path::new("mine.npz"),
            reference_file: Path::new("ours.npz"),
            yours: &yours,
            reference: &reference,
            stages: vec![stage("a", &["same"]), stage("b adjoint", &["photo_like"]), stage("c", &["none"])],
            command: String::new(),
        };
        let html = page(&input).expect("made").html();
        assert!(html.contains("<h1>Arrays: arrays differ</h1>"), "a title");
        assert!(
            html.contains("<li class=\"ok\"><b>a</b>matches (1 of 1 output)</li>"),
            "what matches: {html}"
        );
        assert!(
            html.contains("<li class=\"after\"><b>b, backward pass</b>1 of 1 output differs</li>"),
            "what does not"
        );
        assert!(html.contains("not checked: no output in both files"), "what is not there");
        for alt in ["errors of photo_like by pixel, view 0", "errors of numbers by row"] {
            assert!(html.contains(&format!("alt=\"{alt}")), "{alt}");
        }
        assert!(
            html.contains("by row, 20 rows") && !html.contains("Gaussian"),
            "rows of an unknown operator"
        );
        assert!(html.contains("relative L2 above 1e-5, a NaN, or another shape<"), "what differs means");
        assert!(html.contains("575 of 576 entries are equal"), "counted");
        assert!(
            html.contains("log₁₀ of the relative error of photo_like: 1 entries from 1e"),
            "a histogram in words: {html}"
        );
        assert!(!html.contains("errors of same"), "equal arrays have no errors to show");
        assert_eq!(as_images(&[2, 9, 8]), Some([2, 9, 8, 1]), "maps");
        assert_eq!((as_images(&[20, 3]), as_rows(&[2, 7, 3])), (None, Some(14)), "rows");
    }
}
