//! Evaluates whether the claim of an experiment holds. Where the study requires it, a claim holds only if the
//! interval of its paired differences is above 0; a difference that is positive only in the mean is reported
//! as such.

use super::comparison::{Comparison, FAIR, Rows, VALUE, curve, delta, mean, threshold};
use crate::experiment::{Cell, Summary, Values, differences_by_seed, paired, rows};
use crate::num::order;
use std::collections::BTreeMap;

/// λ for which the claim expects an increasing error.
const LARGE: f64 = 0.5;

/// Whether the claim holds, and the finding in words.
pub(super) fn evaluate(comparison: &Comparison, results: Rows<'_>) -> (Option<bool>, String) {
    match comparison {
        Comparison::Better { graphs } => better(graphs, results),
        Comparison::Ablation => ablation(results),
        Comparison::Structures => structures(results),
        Comparison::Thresholds(taus) => thresholds(taus, results),
        Comparison::Pair(rows) => pair(*rows, results),
        Comparison::Bounds(bounds) => bounded(bounds, results),
        Comparison::Tuning => {
            let (helps, text) = pair(["tuned", "not tuned"], results);
            let changed = mean(results, "tuned", "changed");
            let moved = mean(results, "tuned", "moved");
            let text = format!(
                "{text} On average, tuning changed {changed:.1} edges; the changes of the edge probabilities add up to {moved:.3}."
            );
            (helps.map(|h| h && changed > 0.0), text)
        }
        Comparison::Factors { children, begin } => interference(children, *begin, results),
        Comparison::Cost => {
            let times = |row: &str, name: &str| mean(results, row, name) / mean(results, "host", name);
            let text = format!(
                "Per iteration, the full system renders {:.2} times as many images as the host and encodes {:.2} images.",
                times("full", "renders"),
                mean(results, "full", "encodings") / mean(results, "full", "iterations"),
            );
            (None, text)
        }
        Comparison::Weights(weights) => {
            let all: Vec<(&String, Summary)> =
                weights.iter().map(|w| (w, paired(results, [w, "w_lat 0"], VALUE))).collect();
            let text: Vec<String> = all.iter().map(|(w, s)| format!("{w}: {}", delta(s))).collect();
            let text = format!("ΔPSNR-box, dB: {}. One render per iteration in all rows.", text.join("; "));
            (Some(all.iter().any(|(_, s)| s.is_positive())), text)
        }
    }
}

fn better(graphs: &[String], results: Rows<'_>) -> (Option<bool>, String) {
    // A subject has the same appearance and motion under all graphs, so it counts once.
    let pooled = |name: &str| -> Summary {
        let mut of_subject = BTreeMap::<u64, Vec<f64>>::new();
        for g in graphs {
            let rows = [&*format!("{g} LAST"), &*format!("{g} host")];
            for (seed, difference) in differences_by_seed(results, rows, name) {
                of_subject.entry(seed).or_default().push(difference);
            }
        }
        Summary::of(&of_subject.values().map(|all| Summary::of(all).mean).collect::<Vec<_>>())
    };
    let (equal, fair) = (pooled(VALUE), pooled(FAIR));
    let list = |suffix: &str| -> String {
        let of = |name: &str, digits: usize| {
            let s = pooled(&format!("{name}{suffix}"));
            format!("{name} {:+.digits$} ± {:.digits$}", s.mean, s.half_width)
        };
        [of("PSNR-box", 2), of("PSNR-full", 2), of("SSIM-g", 4), of("RFD (not LPIPS)", 2)].join(", ")
    };
    let missing: Vec<&str> =
        ["FORK", "FULL"].into_iter().filter(|g| !graphs.iter().any(|have| have == g)).collect();
    let mut text = format!(
        "LAST minus host over {} subjects, one trained model per graph. Equal iterations: {}. Equal renders: {}.",
        equal.count,
        list(""),
        list("@renders")
    );
    if !missing.is_empty() {
        text += &format!(" Not run for {}: no model for this graph.", missing.join(", "));
    }
    (Some(equal.is_positive() && fair.is_positive()), text)
}

fn ablation(results: Rows<'_>) -> (Option<bool>, String) {
    let names =
        ["full", "structure + progressive", "structure + density", "density + progressive", "all off"];
    let [full, no_density, no_progressive, no_structure, off] = names.map(|row| mean(results, row, VALUE));
    let among = order::min(no_density, no_progressive);
    let top = order::max(no_density, no_progressive);
    let holds = no_structure < among && top < full;
    let best = rows(results)
        .into_iter()
        .map(|row| (mean(results, &row, VALUE), row))
        .reduce(|a, b| if b.0 > a.0 { b } else { a })
        .map_or(String::new(), |b| b.1);
    let fair = paired(results, ["full", "all off"], FAIR);
    let text = format!(
        "Mean PSNR-box: full {full:.2}, without density {no_density:.2}, without progressive {no_progressive:.2}, without structure {no_structure:.2}, all off {off:.2}; best: {best}. Full minus all off: {} dB, at equal renders {} dB.",
        delta(&paired(results, ["full", "all off"], VALUE)),
        delta(&fair)
    );
    (Some(holds), text)
}

fn structures(results: Rows<'_>) -> (Option<bool>, String) {
    let near = paired(results, ["learned", "true"], VALUE);
    let below = |row: &str, than: &str| paired(results, [than, row], VALUE);
    let wrong = ["random", "reversed"];
    let worse = wrong.iter().all(|row| below(row, "learned").mean > 0.0);
    let under_host = wrong.iter().all(|row| below(row, "all off").is_positive());
    let clearly = wrong.iter().all(|row| below(row, "learned").is_positive());
    let text = format!(
        "Learned minus true {}, minus random {}, minus reversed {}, minus empty {} dB{}. All off minus random {}, minus reversed {} dB: a wrong structure is {}worse than the host.",
        delta(&near),
        delta(&below("random", "learned")),
        delta(&below("reversed", "learned")),
        delta(&below("empty", "learned")),
        if worse && !clearly { "; wrong graphs are worse in the mean, but within the interval" } else { "" },
        delta(&below("random", "all off")),
        delta(&below("reversed", "all off")),
        if under_host { "" } else { "not " },
    );
    (Some(near.mean >= -near.deviation && worse && under_host), text)
}

fn thresholds(taus: &[f64], results: Rows<'_>) -> (Option<bool>, String) {
    let count: Vec<f64> = taus.iter().map(|&t| mean(results, &threshold(t), "gaussians")).collect();
    // At the maximum number, pruning after the last refinement decides; a change of 1 % is not a rise.
    let falls = count.windows(2).all(|w| w[1] <= 1.01 * w[0])
        && count.first().zip(count.last()).is_some_and(|(first, last)| *last < 0.99 * first);
    let [Some(&low), Some(&high)] = [taus.first(), taus.last()] else { return (None, String::new()) };
    let inside: Vec<f64> = taus.iter().copied().filter(|t| (1e-3..=5e-3).contains(t)).collect();
    // The worst value inside the range against the better of its ends.
    let margins: Vec<Summary> = inside
        .iter()
        .flat_map(|&t| [low, high].map(|end| paired(results, [&threshold(t), &threshold(end)], VALUE)))
        .collect();
    let plateau = !margins.is_empty() && margins.iter().all(|m| m.count > 0 && m.mean > m.deviation);
    let best = taus
        .iter()
        .map(|&t| (mean(results, &threshold(t), VALUE), t))
        .reduce(|a, b| if b.0 > a.0 { b } else { a })
        .map_or(0.0, |b| b.1);
    let text = format!(
        "The number of Gaussians {} with τ_rec, from {:.0} to {:.0}. PSNR-box is largest at {best}; inside 0.001 … 0.005 it is {}larger than at both ends by more than the standard deviation over subjects.",
        if falls { "decreases" } else { "does not decrease" },
        count.first().copied().unwrap_or(0.0),
        count.last().copied().unwrap_or(0.0),
        if plateau { "" } else { "not " },
    );
    (Some(falls && plateau), text)
}

fn pair([a, b]: [&str; 2], results: Rows<'_>) -> (Option<bool>, String) {
    let (equal, fair) = (paired(results, [a, b], VALUE), paired(results, [a, b], FAIR));
    let counts = [a, b].map(|row| mean(results, row, "gaussians"));
    let text = format!(
        "'{a}' minus '{b}' over {} subjects: {} dB PSNR-box, at equal renders {} dB; {:.0} and {:.0} Gaussians.",
        equal.count,
        delta(&equal),
        delta(&fair),
        counts[0],
        counts[1]
    );
    (Some(equal.is_positive()), text)
}

/// Whether values increase to a single maximum and decrease after it.
fn unimodal(values: &[f64]) -> bool {
    let top = (1..values.len()).fold(0, |t, i| if values[i] > values[t] { i } else { t });
    values[..=top].windows(2).all(|w| w[0] <= w[1]) && values[top..].windows(2).all(|w| w[0] >= w[1])
}

fn bounded(bounds: &[f64], results: Rows<'_>) -> (Option<bool>, String) {
    // Skip values of λ that have not run.
    let has_run = |l: &f64| results.iter().any(|(cell, _)| cell.row == format!("rel {l}"));
    let bounds: Vec<f64> = bounds.iter().copied().filter(has_run).collect();
    if bounds.is_empty() {
        return (None, "No λ of mode rel has run.".into());
    }
    let level: Vec<f64> = bounds.iter().map(|l| mean(results, &format!("rel {l}"), VALUE)).collect();
    let top = (1..level.len()).fold(0, |t, i| if level[i] > level[t] { i } else { t });
    let inside = bounds.get(top).is_some_and(|l| (0.05..=0.2).contains(l));
    let single = unimodal(&level);
    let levels = curve(results, &format!("rel {LARGE}"), "curve ");
    let best = levels.iter().fold(f64::NEG_INFINITY, |m, p| order::max(m, p.1));
    let grows = levels.last().is_some_and(|p| p.1 < best);
    let spread = level.iter().fold(f64::NEG_INFINITY, |m, &x| order::max(m, x))
        - level.iter().fold(f64::INFINITY, |m, &x| order::min(m, x));
    let text = format!(
        "Mode rel: best at λ = {}, {spread:.2} dB between the best and the worst λ; {} in λ; at λ = {LARGE} the error {} over the iterations.",
        bounds.get(top).copied().unwrap_or(f64::NAN),
        if single { "one maximum" } else { "more than one maximum" },
        match (levels.is_empty(), grows) {
            (true, _) => "is unknown",
            (false, true) => "increases at the end",
            (false, false) => "does not increase",
        }
    );
    (Some(inside && single && grows), text)
}

/// Sum of the increases of the errors of child factors after an iteration in one cell, divided by the number
/// of children.
fn rise(values: &Values, children: &[usize], begin: usize) -> Option<f64> {
    let mut total = 0.0;
    for j in children {
        let prefix = format!("factor {j} ");
        let mut at: Vec<(u64, f64)> = values
            .iter()
            .filter_map(|(name, x)| Some((name.strip_prefix(&prefix)?.parse().ok()?, *x)))
            .collect();
        at.sort_unstable_by_key(|a| a.0);
        at.retain(|a| a.0 as usize >= begin);
        if at.is_empty() {
            return None;
        }
        total += at.windows(2).fold(0.0, |s, w| s + order::max(0.0, w[1].1 - w[0].1));
    }
    Some(total / children.len() as f64)
}

fn interference(children: &[usize], begin: usize, results: Rows<'_>) -> (Option<bool>, String) {
    if children.is_empty() {
        return (None, "The graph of the model has no edge, so no factor is a child.".into());
    }
    let risen: Vec<(Cell, Values)> = results
        .iter()
        .filter_map(|(c, v)| Some((c.clone(), Values::from([("rise".into(), rise(v, children, begin)?)]))))
        .collect();
    let less = paired(&risen, ["host", "LAST"], "rise");
    let [host, last] = ["host", "LAST"].map(|row| mean(&risen, row, "rise"));
    let text = format!(
        "Summed increases of the errors of child factors from iteration {begin}, in standard deviations of a point: host {host:.3}, LAST {last:.3}; host minus LAST {:+.3} ± {:.3}.",
        less.mean, less.half_width
    );
    (Some(less.is_positive()), text)
}

#[cfg(test)]
mod tests {
    use super::super::report::of;
    use super::*;
    use crate::experiment::Outcome;

    /// Cells of a row: one per value, seeds from 1.
    fn row(name: &str, levels: &[f64]) -> Vec<(Cell, Values)> {
        levels
            .iter()
            .enumerate()
            .map(|(i, x)| {
                let seed = i as u64 + 1;
                let cell = Cell { key: format!("{name}{seed}"), row: name.into(), seed };
                let values = [(VALUE, *x), (FAIR, *x - 0.5), ("gaussians", 100.0), ("changed", 1.0)];
                (cell, values.map(|(k, v)| (k.to_owned(), v)).into())
            })
            .collect()
    }

    fn evaluated(comparison: &Comparison, rows: &[(&str, &[f64])]) -> (Outcome, String) {
        let results: Vec<_> = rows.iter().flat_map(|(name, x)| row(name, x)).collect();
        let report = of("E0", "", comparison, &results);
        assert_eq!(report.rows.len(), rows.len(), "a line for each row");
        assert!(report.rows.iter().all(|r| r.len() == report.head.len()), "as many cells as heads");
        (report.outcome, report.verdict)
    }

    #[test]
    fn a_difference_holds_where_its_interval_does() {
        let q = Comparison::Pair(["budget", "pixel"]);
        let base: &[f64] = &[20.0, 22.0, 25.0];
        let clear = evaluated(&q, &[("pixel", base), ("budget", &[20.5, 22.6, 25.5])]);
        assert_eq!(clear.0, Outcome::Holds, "{}", clear.1);
        assert!(clear.1.contains("+0.53 ± "), "mean and interval: {}", clear.1);
        let noisy = evaluated(&q, &[("pixel", base), ("budget", &[21.5, 21.5, 25.2])]);
        assert_eq!(noisy.0, Outcome::Fails, "better only in the mean: {}", noisy.1);
        assert_eq!(
            evaluated(&q, &[("pixel", base), ("budget", &[25.0])]).0,
            Outcome::Fails,
            "one pair shows nothing"
        );
        let tuning = Comparison::Tuning;
        let tuned = evaluated(&tuning, &[("not tuned", base), ("tuned", &[20.5, 22.6, 25.5])]);
        assert_eq!(tuned.0, Outcome::Holds, "changed and better: {}", tuned.1);
    }

    #[test]
    fn the_full_system_must_be_better_at_both_budgets() {
        let q = Comparison::Better { graphs: vec!["FORK".into()] };
        let rows: &[(&str, &[f64])] =
            &[("FORK host", &[20.0, 21.0, 22.0]), ("FORK LAST", &[20.5, 21.6, 22.4])];
        let (outcome, text) = evaluated(&q, rows);
        assert_eq!(outcome, Outcome::Holds, "{text}");
        assert!(text.contains("Not run for FULL"), "lists what is missing: {text}");
        // A subject under two graphs counts once, with its mean; one under a single graph counts too.
        let both = Comparison::Better { graphs: vec!["FORK".into(), "FULL".into()] };
        let more: &[(&str, &[f64])] =
            &[rows[0], rows[1], ("FULL host", &[20.0, 21.0]), ("FULL LAST", &[20.7, 21.4])];
        let text = evaluated(&both, more).1;
        assert!(text.contains("over 3 subjects"), "not 5: {text}");
        assert!(text.contains("PSNR-box +0.50 ± "), "(0.6 + 0.5 + 0.4)/3: {text}");
        // With twice the iterations the host is better.
        let mut results: Vec<_> = rows.iter().flat_map(|(name, x)| row(name, x)).collect();
        for (cell, values) in &mut results {
            if cell.row == "FORK host" {
                values.insert(FAIR.into(), 23.0);
            }
        }
        assert_eq!(of("E1", "", &q, &results).outcome, Outcome::Fails, "not at equal renders");
    }

    #[test]
    fn the_order_of_the_ablation_is_that_of_the_table() {
        let rows = |full, no_density, no_progressive, no_structure, off| {
            [
                ("full", [full; 2]),
                ("structure + progressive", [no_density; 2]),
                ("structure + density", [no_progressive; 2]),
                ("density + progressive", [no_structure; 2]),
                ("all off", [off; 2]),
            ]
        };
        let of = |r: [(&'static str, [f64; 2]); 5]| {
            let list: Vec<(&str, &[f64])> = r.iter().map(|(n, x)| (*n, &x[..])).collect();
            evaluated(&Comparison::Ablation, &list).0
        };
        assert_eq!(of(rows(32.45, 31.68, 31.44, 29.78, 31.0)), Outcome::Holds, "the paper's numbers");
        assert_eq!(of(rows(32.45, 31.68, 31.44, 31.5, 31.0)), Outcome::Fails, "structure between the others");
        assert_eq!(of(rows(31.0, 31.68, 30.44, 29.0, 31.0)), Outcome::Fails, "full is not best");
    }

    #[test]
    fn bounds_that_have_not_run_are_skipped() {
        let cells: Vec<_> = [("rel 0.05", [20.0, 21.0]), ("rel 0.1", [20.2, 21.3])]
            .iter()
            .flat_map(|(name, x)| row(name, x))
            .collect();
        let text = bounded(&[0.0, 0.05, 0.1, f64::INFINITY], &cells).1;
        assert!(text.contains("best at λ = 0.1") && text.contains("0.25 dB between"), "{text}");
        assert_eq!(bounded(&[0.5], &cells).0, None, "nothing to compare");
    }

    #[test]
    fn curves_and_grids_are_evaluated() {
        assert!(unimodal(&[1.0, 2.0, 3.0, 2.0]) && unimodal(&[3.0, 2.0]) && unimodal(&[1.0]), "one maximum");
        assert!(!unimodal(&[1.0, 3.0, 2.0, 2.5]), "two");
        let taus = vec![1e-5, 1e-3, 5e-2];
        let names: Vec<String> = taus.iter().map(|&t| threshold(t)).collect();
        let list = |mid: f64| {
            vec![
                ("pixel", vec![20.0, 20.0]),
                (names[0].as_str(), vec![20.0, 20.2]),
                (names[1].as_str(), vec![mid, mid + 0.3]),
                (names[2].as_str(), vec![20.1, 20.2]),
            ]
        };
        let outcome = |mid: f64, counts: [f64; 3]| {
            let mut results: Vec<_> = list(mid).iter().flat_map(|(name, x)| row(name, x)).collect();
            for (cell, values) in &mut results {
                if let Some(at) = names.iter().position(|name| *name == cell.row) {
                    values.insert("gaussians".into(), counts[at]);
                }
            }
            of("E0", "", &Comparison::Thresholds(taus.clone()), &results).outcome
        };
        let falling = [300.0, 200.0, 100.0];
        assert_eq!(outcome(21.0, falling), Outcome::Holds, "a plateau, and fewer and fewer Gaussians");
        assert_eq!(outcome(21.0, [300.0, 300.5, 100.0]), Outcome::Holds, "at the cap pruning decides");
        assert_eq!(outcome(20.0, falling), Outcome::Fails, "no plateau");
        assert_eq!(outcome(21.0, [100.0; 3]), Outcome::Fails, "a count that never falls");
        assert_eq!(outcome(21.0, [300.0, 310.0, 100.0]), Outcome::Fails, "one that rises");
        let values: Values = [
            ("factor 1 10", 9.0),
            ("factor 1 20", 1.0),
            ("factor 1 100", 3.0),
            ("factor 1 30", 2.0),
            ("factor 0 30", 50.0),
        ]
        .map(|(k, v)| (k.to_owned(), v))
        .into();
        assert_eq!(rise(&values, &[1], 20), Some(2.0), "1 → 2 → 3, in the order of iterations");
        assert_eq!(rise(&values, &[1], 0), Some(2.0), "9 → 1 is not an increase");
        assert_eq!(rise(&values, &[2], 0), None, "missing");
    }
}
