//! Reports of experiments with persons: a table and a chart. Differences are paired; Δ is followed by the
//! half-width of its 95 % interval.

use super::comparison::{Comparison, FAIR, Rows, VALUE, curve, delta, mean, threshold};
use super::evaluation;
use crate::experiment::{Chart, Curve, Outcome, Report, Summary, of as values_of, paired, rows};
use crate::loss::lpips;

/// The row that a row is compared with.
fn reference(comparison: &Comparison, row: &str) -> Option<String> {
    let reference = match comparison {
        Comparison::Better { .. } => row.strip_suffix(" LAST").map(|graph| format!("{graph} host"))?,
        Comparison::Ablation | Comparison::Structures => "all off".into(),
        Comparison::Thresholds(_) => "pixel".into(),
        Comparison::Pair([_, b]) => (*b).to_owned(),
        Comparison::Bounds(_) => "rel 0.1".into(),
        Comparison::Tuning => "not tuned".into(),
        Comparison::Factors { .. } | Comparison::Cost => "host".into(),
        Comparison::Weights(_) => "w_lat 0".into(),
    };
    (reference != row).then_some(reference)
}

/// Further columns: head, value, digits.
fn extra(comparison: &Comparison) -> &'static [(&'static str, &'static str, usize)] {
    match comparison {
        Comparison::Thresholds(_) => {
            &[(">outside encoder crop", "blind", 2), (">rejected: over budget", "rejected", 0)]
        }
        Comparison::Bounds(_) => &[(">limited by λ", "bound", 2)],
        Comparison::Structures => &[(">edges", "edges", 1)],
        Comparison::Tuning => {
            &[(">edges", "edges", 1), (">edges changed", "changed", 1), (">Σ|Δp|", "moved", 3)]
        }
        Comparison::Cost => &[(">outside encoder crop", "blind", 2), (">limited by λ", "bound", 2)],
        _ => &[],
    }
}

/// Columns of every table after PSNR-box at both budgets: head, name of the value at equal iterations,
/// digits.
const COLUMNS: [(&str, &str, usize); 7] = [
    (">PSNR-full", "PSNR-full", 2),
    (">SSIM-g", "SSIM-g", 4),
    (">D-SSIM×1000", "D-SSIM×1000", 1),
    (">RFD (not LPIPS)", "RFD (not LPIPS)", 1),
    (">Gaussians", "gaussians", 0),
    (">renders", "renders", 0),
    (">encodings", "encodings", 0),
];

/// Columns of LPIPS: head and name of the value.
const LPIPS_COLUMNS: [[&str; 2]; 4] = [
    [">LPIPS-vgg", lpips::NAME],
    [">LPIPS-vgg-box", lpips::NAME_BOX],
    [">LPIPS-vgg-raw", lpips::NAME_RAW],
    [">LPIPS-vgg-raw-box", lpips::NAME_RAW_BOX],
];

pub(super) fn of(
    id: &'static str,
    claim: &'static str,
    comparison: &Comparison,
    results: Rows<'_>,
) -> Report {
    let names = rows(results);
    let cell = |row: &str, value: &str, digits: usize| {
        let s = Summary::of(&values_of(results, row, value));
        if s.count == 0 { "–".into() } else { format!("{:.digits$}", s.mean) }
    };
    let against = |row: &str, value: &str| {
        reference(comparison, row).map_or_else(|| "–".into(), |b| delta(&paired(results, [row, &b], value)))
    };
    let mut head = vec!["", ">PSNR-box", ">Δ", ">at equal renders", ">Δ", ">iterations at equal renders"];
    head.extend(COLUMNS.iter().map(|c| c.0));
    // Only if weights for it were available.
    let is_there = |[_, name]: &[&str; 2]| results.iter().any(|(_, values)| values.contains_key(*name));
    let lpips_columns: Vec<[&str; 2]> = LPIPS_COLUMNS.into_iter().filter(is_there).collect();
    head.extend(lpips_columns.iter().map(|[head, _]| *head));
    head.extend(extra(comparison).iter().map(|c| c.0));
    let line = |row: &String| -> Vec<String> {
        let mut line = vec![row.clone(), cell(row, VALUE, 2), against(row, VALUE), cell(row, FAIR, 2)];
        line.extend([against(row, FAIR), cell(row, "iterations@renders", 0)]);
        line.extend(COLUMNS.iter().map(|(_, value, digits)| cell(row, value, *digits)));
        line.extend(lpips_columns.iter().map(|[_, name]| cell(row, name, 4)));
        line.extend(extra(comparison).iter().map(|(_, value, digits)| cell(row, value, *digits)));
        line
    };
    let (outcome, verdict) =
        if results.is_empty() { (None, String::new()) } else { evaluation::evaluate(comparison, results) };
    let (chart_labels, chart) = chart(comparison, results, &names);
    Report {
        id,
        claim,
        head,
        rows: names.iter().map(line).collect(),
        chart_labels,
        chart,
        outcome: Outcome::of(outcome),
        verdict,
    }
}

fn chart(comparison: &Comparison, results: Rows<'_>, names: &[String]) -> ([&'static str; 2], Chart) {
    let lines = |curves: Vec<Curve>| Chart::Lines { curves, from_zero: false };
    match comparison {
        Comparison::Thresholds(taus) => {
            let point = |&t: &f64| {
                let s = Summary::of(&values_of(results, &threshold(t), VALUE));
                (s.count > 0).then_some((libm::log10(t), s.mean, s.deviation))
            };
            let level = Curve { name: "PSNR-box".into(), points: taus.iter().filter_map(point).collect() };
            (["PSNR-box, dB", "log₁₀ τ_rec"], lines(vec![level]))
        }
        Comparison::Bounds(bounds) => {
            let curves = bounds.iter().map(|l| {
                let row = format!("rel {l}");
                Curve { name: format!("λ = {l}"), points: curve(results, &row, "curve ") }
            });
            (["PSNR-box of held-out images, mode rel, dB", "iteration"], lines(curves.collect()))
        }
        Comparison::Factors { children, .. } => {
            let curves = ["host", "LAST"].iter().flat_map(|row| {
                children.iter().map(move |j| Curve {
                    name: format!("{row}, factor {j}"),
                    points: curve(results, row, &format!("factor {j} ")),
                })
            });
            (["error of child factors, standard deviations of a point", "iteration"], lines(curves.collect()))
        }
        Comparison::Cost => {
            let bars = names.iter().map(|row| (row.clone(), mean(results, row, "renders")));
            (["renders", ""], Chart::Bars(bars.collect()))
        }
        _ => {
            let compared = names.iter().filter_map(|row| {
                let b = reference(comparison, row)?;
                Some((row.clone(), paired(results, [row, &b], FAIR)))
            });
            (["ΔPSNR-box at equal renders, dB, 95 % interval", ""], Chart::Intervals(compared.collect()))
        }
    }
}
