//! What the results of an experiment with persons look like: a table and a chart. Differences are paired, Δ is followed by the half-width of its 95 %
//! interval.

use super::judge;
use super::question::{FAIR, Question, Rows, VALUE, curve, delta, mean, threshold};
use crate::experiment::{Chart, Curve, Outcome, Report, Summary, of as values_of, paired, rows};
use crate::loss::lpips;

/// The row against which a row is compared.
fn reference(question: &Question, row: &str) -> Option<String> {
    let reference = match question {
        Question::Better { .. } => row.strip_suffix(" LAST").map(|graph| format!("{graph} host"))?,
        Question::Ablation | Question::Structures => "all off".into(),
        Question::Thresholds(_) => "pixel".into(),
        Question::Pair([_, b]) => (*b).to_owned(),
        Question::Bounds(_) => "rel 0.1".into(),
        Question::Tuning => "not tuned".into(),
        Question::Factors { .. } | Question::Cost => "host".into(),
        Question::Weights(_) => "w_lat 0".into(),
    };
    (reference != row).then_some(reference)
}

/// Further columns: head, value, digits.
fn extra(question: &Question) -> &'static [(&'static str, &'static str, usize)] {
    match question {
        Question::Thresholds(_) => &[(">blind", "blind", 2), (">turned away", "turned away", 0)],
        Question::Bounds(_) => &[(">λ binds", "bound", 2)],
        Question::Structures => &[(">edges", "edges", 1)],
        Question::Tuning => {
            &[(">edges", "edges", 1), (">edges changed", "changed", 1), (">Σ|Δp|", "moved", 3)]
        }
        Question::Cost => &[(">blind", "blind", 2), (">λ binds", "bound", 2)],
        _ => &[],
    }
}

/// Columns of every table after PSNR-box at both budgets: head, value at equal iterations, digits.
const COLUMNS: [(&str, &str, usize); 7] = [
    (">PSNR-full", "PSNR-full", 2),
    (">SSIM-g", "SSIM-g", 4),
    (">D-SSIM×1000", "D-SSIM×1000", 1),
    (">RFD (not LPIPS)", "RFD (not LPIPS)", 1),
    (">Gaussians", "gaussians", 0),
    (">renders", "renders", 0),
    (">encodings", "encodings", 0),
];

/// Columns of LPIPS: head and value.
const PERCEIVED: [[&str; 2]; 4] = [
    [">LPIPS-vgg", lpips::NAME],
    [">LPIPS-vgg-box", lpips::NAME_BOX],
    [">LPIPS-vgg-raw", lpips::NAME_RAW],
    [">LPIPS-vgg-raw-box", lpips::NAME_RAW_BOX],
];

pub(super) fn of(id: &'static str, claim: &'static str, question: &Question, results: Rows<'_>) -> Report {
    let names = rows(results);
    let cell = |row: &str, value: &str, digits: usize| {
        let s = Summary::of(&values_of(results, row, value));
        if s.count == 0 { "–".into() } else { format!("{:.digits$}", s.mean) }
    };
    let against = |row: &str, value: &str| {
        reference(question, row).map_or_else(|| "–".into(), |b| delta(&paired(results, [row, &b], value)))
    };
    let mut head = vec!["", ">PSNR-box", ">Δ", ">at equal renders", ">Δ", ">iterations of that"];
    head.extend(COLUMNS.iter().map(|c| c.0));
    // Where there were weights for it.
    let is_there = |[_, name]: &[&str; 2]| results.iter().any(|(_, values)| values.contains_key(*name));
    let perceived: Vec<[&str; 2]> = PERCEIVED.into_iter().filter(is_there).collect();
    head.extend(perceived.iter().map(|[head, _]| *head));
    head.extend(extra(question).iter().map(|c| c.0));
    let line = |row: &String| -> Vec<String> {
        let mut line = vec![row.clone(), cell(row, VALUE, 2), against(row, VALUE), cell(row, FAIR, 2)];
        line.extend([against(row, FAIR), cell(row, "iterations@renders", 0)]);
        line.extend(COLUMNS.iter().map(|(_, value, digits)| cell(row, value, *digits)));
        line.extend(perceived.iter().map(|[_, name]| cell(row, name, 4)));
        line.extend(extra(question).iter().map(|(_, value, digits)| cell(row, value, *digits)));
        line
    };
    let (outcome, verdict) =
        if results.is_empty() { (None, String::new()) } else { judge::judge(question, results) };
    let (chart_labels, chart) = chart(question, results, &names);
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

fn chart(question: &Question, results: Rows<'_>, names: &[String]) -> ([&'static str; 2], Chart) {
    let lines = |curves: Vec<Curve>| Chart::Lines { curves, from_zero: false };
    match question {
        Question::Thresholds(taus) => {
            let point = |&t: &f64| {
                let s = Summary::of(&values_of(results, &threshold(t), VALUE));
                (s.count > 0).then_some((libm::log10(t), s.mean, s.deviation))
            };
            let level = Curve { name: "PSNR-box".into(), points: taus.iter().filter_map(point).collect() };
            (["PSNR-box, dB", "log₁₀ τ_rec"], lines(vec![level]))
        }
        Question::Bounds(bounds) => {
            let curves = bounds.iter().map(|l| {
                let row = format!("rel {l}");
                Curve { name: format!("λ = {l}"), points: curve(results, &row, "curve ") }
            });
            (["PSNR-box of held-out pictures, mode rel, dB", "iteration"], lines(curves.collect()))
        }
        Question::Factors { children, .. } => {
            let curves = ["host", "LAST"].iter().flat_map(|row| {
                children.iter().map(move |j| Curve {
                    name: format!("{row}, factor {j}"),
                    points: curve(results, row, &format!("factor {j} ")),
                })
            });
            (["error of child factors, deviations of a point", "iteration"], lines(curves.collect()))
        }
        Question::Cost => {
            let bars = names.iter().map(|row| (row.clone(), mean(results, row, "renders")));
            (["renders", ""], Chart::Bars(bars.collect()))
        }
        _ => {
            let compared = names.iter().filter_map(|row| {
                let b = reference(question, row)?;
                Some((row.clone(), paired(results, [row, &b], FAIR)))
            });
            (["ΔPSNR-box at equal renders, dB, 95 % interval", ""], Chart::Intervals(compared.collect()))
        }
    }
}
