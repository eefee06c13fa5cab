//! The table of the page of `oracle compare`: every array with its numbers, and what is missing or unknown.

use super::{Stat, code, table, text};
use crate::num::order;
use lastlight_oracle::oracle::compare::{Agreement, ArrayReport, Measures, Report, mean_ulp, plural, ulp};
use maud::{Markup, html};

/// The numbers at the top of the page.
pub(super) fn stats(r: &Report) -> Vec<Stat> {
    let measured: Vec<f64> = r.arrays.iter().filter_map(|a| Some(a.measures.as_ref()?.relative_l2)).collect();
    let worst = measured.iter().copied().fold(0.0, order::max);
    let unmeasured = r.arrays.len() - measured.len();
    let over = match unmeasured {
        0 => "over all arrays".to_owned(),
        n => format!("without {n} array{} with NaN or another shape", plural(n)),
    };
    let incomplete = match r.missing.len() + r.unknown.len() {
        0 => "no output or gradient is missing".to_owned(),
        _ => format!("{} missing, {} of unknown name", r.missing.len(), r.unknown.len()),
    };
    let is_zeros = |a: &ArrayReport| a.agreement == Agreement::ZerosDiffer;
    let zeros = if r.arrays.iter().any(is_zeros) { ", or other zeros in a mask" } else { "" };
    vec![
        Stat { label: "Arrays compared", value: r.arrays.len().to_string(), note: incomplete },
        Stat {
            label: "Arrays that differ",
            value: r.differing().count().to_string(),
            note: format!("relative L2 above {:e}, a NaN, or another shape{zeros}", r.tol),
        },
        Stat {
            label: "relative L2, largest",
            value: if measured.is_empty() { "not measured".into() } else { format!("{worst:.2e}") },
            note: over,
        },
    ]
}

/// All arrays, and those that are in one file only; `is_single`: the operator has no stages.
pub(super) fn overview(r: &Report, is_single: bool) -> Markup {
    let shape = |a: &ArrayReport| {
        let own = format!("{:?}", a.shape_reference);
        if a.shape_reference == a.shape_yours { own } else { format!("{own}, yours {:?}", a.shape_yours) }
    };
    let measure = |a: &ArrayReport, show: &dyn Fn(&Measures) -> String| {
        let nan = || if a.nans.is_some() { "NaN".to_owned() } else { "–".to_owned() };
        text(a.measures.as_ref().map_or_else(nan, show))
    };
    let zeros =
        |m: &Measures| format!("{} / {} / {}", m.zeros.both, m.zeros.only_yours, m.zeros.only_reference);
    let rows: Vec<Vec<Markup>> = (r.arrays.iter())
        .map(|a| {
            vec![
                code(&a.name),
                verdict(a),
                text(shape(a)),
                measure(a, &|m| format!("{:.3e}", m.relative_l2)),
                measure(a, &|m| ulp(m.worst_ulp)),
                measure(a, &|m| mean_ulp(m.mean_ulp)),
                measure(a, &|m| format!("{:.3e}", 1.0 - m.cosine)),
                measure(a, &|m| format!("{:.2e}", m.signed_bias)),
                measure(a, &zeros),
                text(remark(a)),
            ]
        })
        .collect();
    let head = [
        "array",
        "result",
        "shape",
        ">relative L2",
        ">worst ulp",
        ">mean ulp",
        ">1 − cosine",
        ">signed bias",
        ">zeros: both / yours / reference",
        "",
    ];
    let missing = [("yours", &r.missing.yours), ("the reference", &r.missing.reference)];
    let class = if r.present_only { "note" } else { "bad strong" };
    let only = [("yours", &r.only_yours), ("the reference", &r.only_reference)];
    let stated = |name: &&String| !r.missing.has(name) && !r.unknown.iter().any(|u| u.name == **name);
    let rest = |names: &[String]| names.iter().filter(stated).cloned().collect::<Vec<_>>().join(", ");
    html! {
        @for (whose, names) in missing {
            @if !names.is_empty() { p class=(class) { "Missing in " (whose) ": " (names.join(", ")) } }
        }
        @for unknown in &r.unknown { p class=(class) { (capital(&unknown.to_string())) } }
        (table(&head, &rows))
        @if is_single { @if let Some(d) = &r.divergence { p.note { (capital(&d.to_string())) } } }
        @if is_single { @if let Some(note) = r.inputs_note() { p.note { (capital(&note)) } } }
        @for (whose, names) in only {
            @if !rest(names).is_empty() { p.note { "Not compared, only in " (whose) ": " (rest(names)) } }
        }
    }
}

/// The result of an array, coloured.
pub(super) fn verdict(a: &ArrayReport) -> Markup {
    let words = a.agreement.text();
    if a.matches() {
        html! { span.good { (words) } }
    } else {
        html! { span.bad.strong { (words) } }
    }
}

/// What the numbers of an array do not state.
fn remark(a: &ArrayReport) -> String {
    // The shapes have their own column.
    let reason = a.reason.as_ref().filter(|_| a.shape_yours == a.shape_reference);
    let parts: Vec<&str> = reason.into_iter().chain(&a.note).map(String::as_str).collect();
    parts.join("; ")
}

/// A sentence with a capital.
pub(super) fn capital(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or_else(String::new, |first| first.to_uppercase().chain(chars).collect())
}
