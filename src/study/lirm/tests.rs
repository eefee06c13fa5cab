//! Reports from made-up values: what is compared with what, and when a criterion is met.

use super::setup::{NamedModel, Setup, Size};
use super::{curve, limits, occupancy, samples, scenes, scoring, variants};
use crate::experiment::{Cell, Chart, Experiment, Outcome, Report, Results, Summary, Values};
use lastlight_lirm::model::config::Config;
use lastlight_lirm::model::file::Model;
use lastlight_lirm::model::origin::Part;
use lastlight_lirm::model::params::first;
use std::path::Path;

const OBJECTS: u64 = 2;

/// A model after some steps of stage 1b.
fn model(parts: &[usize]) -> NamedModel {
    let config = Config { blocks: 1, width: 16, heads: 2, plane_tokens: 1, embed_tokens: 1, ..Config::SMALL };
    let part = |&steps: &usize| Part {
        stage: "1b".into(),
        optimizer: "muon".into(),
        range: [0, steps],
        steps,
        seed: 0,
        batch: 8,
        block: 8,
        uses: None,
        source: "built-in".into(),
        object_seed: None,
        other_objects: false,
        rate: None,
        head_rate: None,
        room: None,
        tint: None,
        points: 0.0,
        distances: 0.0,
        shape_steps: 0,
        updates: false,
        added: None,
        absolute_albedo: false,
        material: None,
        normal_weight: None,
        state_gradient: false,
        last_set_only: false,
        average_last: 0,
        start_share: None,
        inverse_beta: 60.0,
        start: String::new(),
    };
    NamedModel::new(Model { config, params: first(&config, 0), training: parts.iter().map(part).collect() })
}

fn setup(models: Vec<NamedModel>) -> Setup {
    Setup::new(Size { objects: OBJECTS, ..Size::smoke() }, models).expect("models")
}

/// All cells with values that depend on row and object.
fn filled(x: &dyn Experiment, value: impl Fn(&str, u64) -> Vec<(String, f64)>) -> Results {
    let cells = x.cells().into_iter();
    cells
        .map(|cell| {
            let values: Values = value(&cell.row, cell.seed).into_iter().collect();
            (cell, values)
        })
        .collect()
}

/// `NAME_1` to `NAME_4` of the object, which differs from the others by its number.
fn by_set(name: &str, k: u64, sets: [f64; 4]) -> Vec<(String, f64)> {
    sets.iter().enumerate().map(|(n, x)| (format!("{name}_{}", n + 1), x + k as f64)).collect()
}

fn outcome(report: &Report) -> Outcome {
    report.outcome
}

#[test]
fn rounds_hold_when_all_five_floors_are_met() {
    let setup = setup(vec![model(&[10])]);
    let x = scoring::rounds(&setup);
    // Of the sequential order, after set 2 and after the later ones.
    let results = |own: [f64; 4], [second, later]: [f64; 2], hull: [f64; 2], nearest: f64| {
        filled(&x, |row, k| {
            let of_row = if row.starts_with("random") { own } else { [own[0], second, later, later] };
            let mut all = by_set("psnr_db", k, of_row);
            all.extend(by_set("hull_db", k, [hull[0]; 4]));
            all.extend(by_set("small_hull_db", k, [hull[1]; 4]));
            all.extend(by_set("nearest_db", k, [nearest; 4]));
            all
        })
    };
    let good = ([24.0, 24.5, 24.5, 24.4], [24.3, 24.2], [23.0, 20.0], 20.0);
    let report = x.report(&results(good.0, good.1, good.2, good.3));
    assert_eq!(outcome(&report), Outcome::Holds, "{}", report.verdict);
    for (what, (own, sequential, hull, nearest)) in [
        ("nearest input", (good.0, good.1, good.2, 20.1)),
        ("hull of large images", (good.0, good.1, [23.1, 20.0], good.3)),
        ("hull of small images", (good.0, good.1, [20.0, 23.1], good.3)),
        ("second set", ([24.0, 24.4, 24.4, 24.4], good.1, good.2, good.3)),
        ("orders", (good.0, [24.0, 24.0], good.2, good.3)),
        ("later sets, sequential", (good.0, [24.5, 24.2], good.2, good.3)),
        ("third set", ([24.0, 24.5, 24.2, 24.4], good.1, good.2, good.3)),
        ("fourth set", ([24.0, 24.5, 24.5, 24.2], [24.2, 24.2], good.2, good.3)),
    ] {
        let report = x.report(&results(own, sequential, hull, nearest));
        assert_eq!(outcome(&report), Outcome::Fails, "{what}: {}", report.verdict);
    }
    let part = &results(good.0, good.1, good.2, good.3)[..3];
    assert_eq!(outcome(&x.report(part)), Outcome::Reported, "a part of the cells decides nothing");
}

#[test]
fn equal_rows_of_experiments_are_computed_once() {
    let other = {
        let mut other = model(&[20]);
        other.model.params = first(&other.model.config, 1);
        NamedModel::new(other.model)
    };
    let setup = setup(vec![other, model(&[10])]);
    let cells = |x: &scoring::Scoring<'_>, row: &str| -> Vec<_> {
        let all = x.cells().into_iter().enumerate().filter(|(_, cell)| cell.row == row);
        all.map(|(i, cell)| (x.folder(), cell.key, x.settings(i))).collect()
    };
    let shared = cells(&scoring::rounds(&setup), "random order");
    assert_eq!(shared.len(), 2, "two objects");
    assert_eq!(shared, cells(&scoring::controls(&setup), "unbroken"));
    assert_eq!(shared, cells(&scoring::stages(&setup), &setup.models[1].name), "of the model that is scored");
    let all = [scoring::rounds(&setup), scoring::controls(&setup), scoring::stages(&setup)];
    let mut files = std::collections::BTreeMap::new();
    for x in &all {
        for (i, cell) in x.cells().into_iter().enumerate() {
            let settings = files.entry((x.folder(), cell.key)).or_insert_with(|| x.settings(i));
            assert_eq!(*settings, x.settings(i), "one file, one result");
        }
    }
    assert_eq!(files.len(), 2 * (2 + 4 + 1), "orders, breaks, the other model");
}

#[test]
fn controls_hold_when_each_break_costs_what_it_should() {
    let setup = setup(vec![model(&[10])]);
    let x = scoring::controls(&setup);
    let results = |zeroed: f64, permuted: f64, other: f64| {
        filled(&x, |row, k| {
            let second = match row {
                "state zeroed before set 2" => 25.0 - zeroed,
                "cameras permuted within a set" => 25.0 - permuted,
                "set 2 of another object" => 25.0 - other,
                _ => 25.0,
            };
            by_set("psnr_db", k, [24.0, second, 0.0, 0.0])
        })
    };
    // The second set gains 1 dB.
    for (what, values, expected) in [
        ("as expected", (1.0, 3.5, 4.0), Outcome::Holds),
        ("zeroed, nearly", (0.85, 3.5, 4.0), Outcome::Holds),
        ("zeroed costs nothing", (0.0, 3.5, 4.0), Outcome::Fails),
        ("zeroed costs too much", (1.3, 3.5, 4.0), Outcome::Fails),
        ("cameras are not used", (1.0, 2.9, 4.0), Outcome::Fails),
        ("another object is ignored", (1.0, 3.5, 2.9), Outcome::Fails),
    ] {
        let report = x.report(&results(values.0, values.1, values.2));
        assert_eq!(outcome(&report), expected, "{what}: {}", report.verdict);
    }
}

#[test]
fn materials_hold_when_all_three_beat_the_means_under_both_lights() {
    let setup = setup(vec![model(&[10])]);
    let x = scoring::materials(&setup);
    let results = |shiny_metallic: f64| {
        filled(&x, |row, k| {
            let metallic = if row == "shiny" { shiny_metallic } else { 0.1 };
            let second = |name: &str, x: f64| (format!("{name}_2"), x + 1e-3 * k as f64);
            vec![
                second("albedo_error", 0.05),
                second("mean_albedo_error", 0.08),
                second("input_albedo_error", 0.04),
                // One object of one colour, which a constant shows exactly, has no part in the verdict.
                second("albedo_db", 20.0),
                second("mean_albedo_db", if k == 0 { 120.0 } else { 18.0 }),
                second("roughness", 0.1),
                second("mean_roughness", 0.2),
                second("median_roughness", 0.15),
                second("metallic", metallic),
                second("mean_metallic", 0.3),
                second("median_metallic", 0.15),
            ]
        })
    };
    let report = x.report(&results(0.2));
    assert_eq!(outcome(&report), Outcome::Holds);
    assert!(report.verdict.contains("colour of the inputs, 0.010"), "{}", report.verdict);
    let report = x.report(&results(0.4));
    assert_eq!(outcome(&report), Outcome::Fails);
    assert!(
        report.verdict.contains("under 1 of 2 lights") && report.verdict.contains("medians under 1. Errors"),
        "{}",
        report.verdict
    );
    let none = filled(&x, |_, k| by_set("psnr_db", k, [20.0; 4]));
    assert_eq!(outcome(&x.report(&none)), Outcome::Reported, "the model has no materials");
}

#[test]
fn the_fewest_steps_that_are_as_good_as_the_most_are_found() {
    let setup = setup(vec![model(&[10])]);
    let x = samples::samples(&setup);
    let results = filled(&x, |row, k| {
        let db = match row {
            "16 steps" => 19.9,
            "32 steps" => 19.96,
            _ => 20.0,
        };
        let value = |name: &str, x: f64| (name.to_owned(), x);
        let normals = if row == "32 steps" { 27.0 } else { 26.0 };
        vec![
            value("psnr_db", db + k as f64),
            value("numerical_normals_deg", normals),
            value("samples", 9.0),
            value("images", 2.0),
        ]
    });
    let report = x.report(&results);
    assert_eq!(report.verdict, "64 steps lose at most 0.05 dB beside 256 steps, and 0.5° of normals.");
    assert_eq!(x.report(&results[..3]).verdict, "Not all renders are there.");
    assert!(samples::over_time(&results, &[]).is_none(), "no seconds are known");
    let seconds: Vec<(String, Summary)> =
        report.rows.iter().enumerate().map(|(i, row)| (row[0].clone(), Summary::of(&[i as f64]))).collect();
    let Some(Chart::Lines { curves, .. }) = samples::over_time(&results, &seconds) else {
        panic!("a curve over seconds")
    };
    let half: Vec<f64> = curves[0].points.iter().map(|(seconds, ..)| *seconds).collect();
    assert_eq!(half, [0.0, 0.5, 1.0, 1.5, 2.0], "of one image");
}

#[test]
fn a_curve_has_the_gain_per_doubling_between_neighbours() {
    // 100 steps of 8 objects with 1.5 sets each, then four times as many; given in the other order.
    let setup = setup(vec![model(&[100, 300]), model(&[100])]);
    let names: Vec<&str> = setup.models.iter().map(|m| m.name.as_str()).collect();
    assert_eq!(names, ["stage 1b", "stage 1b (2)"], "names of rows differ");
    let x = curve::curve(&setup);
    assert_eq!(x.folder(), scoring::stages(&setup).folder(), "results are shared");
    let results = filled(&x, |row, k| {
        let gain = if row == "stage 1b" { 1.0 } else { 0.0 };
        by_set("psnr_db", k, [20.0 + gain, 21.0 + 3.0 * gain, 21.0, 21.5])
    });
    let report = x.report(&results);
    let rows: Vec<[&str; 4]> =
        report.rows.iter().map(|row| [&*row[0], &*row[1], &*row[5], &*row[6]]).collect();
    assert_eq!(
        rows,
        [["stage 1b (2)", "1.2", "–", "–"], ["stage 1b", "4.8", "0.50 ± 0.00", "1.50 ± 0.00"]],
        "two doublings"
    );
    assert!(report.verdict.contains("would add 0.50 ± 0.00 dB after 4 images, 1.50"), "{}", report.verdict);
}

#[test]
fn an_added_object_may_cover_the_other_one() {
    let setup = setup(vec![model(&[10])]);
    let x = scenes::added(&setup);
    let results = |new: f64, old: f64| {
        filled(&x, |_, k| {
            let mut all = by_set("new", k, [10.0, 10.0 + new, 0.0, 0.0]);
            if k == 0 {
                all.extend(by_set("old", k, [22.0, 22.0 + old, 0.0, 0.0]));
            }
            all
        })
    };
    for (new, old, expected) in
        [(3.1, -0.9, Outcome::Holds), (2.9, -0.9, Outcome::Fails), (3.1, -1.1, Outcome::Fails)]
    {
        let report = x.report(&results(new, old));
        assert_eq!(outcome(&report), expected, "{}", report.verdict);
    }
}

#[test]
fn limits_need_an_object_with_mirrors() {
    let setup = setup(vec![model(&[10])]);
    let x = limits::limits(&setup);
    let results = |mirror: Option<f64>| {
        filled(&x, |_, _| {
            let mirrors = mirror.into_iter().flat_map(|db| {
                [
                    ("mirror_db", db),
                    ("other_db", 20.0),
                    ("nearest_mirror_db", 10.0),
                    ("nearest_other_db", 12.0),
                ]
            });
            let details = [("detail", 0.3), ("ceiling", 0.7)];
            mirrors.chain(details).map(|(name, x)| (name.to_owned(), x)).collect()
        })
    };
    assert_eq!(outcome(&x.report(&results(Some(15.0)))), Outcome::Holds, "mirrors are worse");
    assert_eq!(outcome(&x.report(&results(Some(25.0)))), Outcome::Fails, "mirrors are better");
    assert_eq!(outcome(&x.report(&results(None))), Outcome::Reported, "no mirror was seen");
    let verdict = x.report(&results(Some(15.0))).verdict;
    assert!(
        verdict.contains("cost 5.00") && verdict.contains("input 2.00") && verdict.contains("0.43"),
        "{verdict}"
    );
}

#[test]
fn a_grid_is_filled_in_a_row_of_its_own() {
    let setup = setup(vec![model(&[10])]);
    let x = occupancy::occupied(&setup);
    let results = filled(&x, |row, _| match row {
        "filling the grid" => vec![("occupied".into(), 0.02)],
        "all steps" => vec![("kept".into(), 0.5)],
        _ => vec![("kept".into(), 0.04)],
    });
    let report = x.report(&results);
    let rows: Vec<&str> = report.rows.iter().map(|row| &*row[2]).collect();
    assert_eq!(rows, ["50.0 ± 0.0", "2.0 ± 0.0", "4.0 ± 0.0"]);
    assert!(
        report.verdict.starts_with("4.0 ± 0.0 % are taken (the paper: 8.8 %)")
            && report.verdict.contains("leaves 8.0 ± 0.0 %"),
        "{}",
        report.verdict
    );
}

#[test]
fn saved_time_is_a_part_of_saved_samples() {
    let setup = setup(vec![model(&[200])]);
    let x = occupancy::occupied(&setup);
    let kept = |row: &str, _| vec![("kept".to_owned(), if row == "all steps" { 0.5 } else { 0.05 })];
    let seconds = |of: [f64; 2]| {
        let [all, with] = of.map(|s| Summary::of(&[s, s]));
        vec![("all steps".to_owned(), all), ("grid and early stop".to_owned(), with)]
    };
    let results = filled(&x, kept);
    let judged = |results: &[(Cell, Values)], seconds: &[(String, Summary)]| {
        let mut report = x.report(results);
        x.judge(&mut report, results, seconds);
        (outcome(&report), report.verdict)
    };
    let (fast, line) = judged(&results, &seconds([16.0, 2.0]));
    assert!(
        line.contains(" 10.0 times fewer") && line.contains(" 8.0 times as fast: 0.80 of that"),
        "{line}"
    );
    let (slow, _) = judged(&results, &seconds([16.0, 4.0]));
    assert_eq!([fast, slow], [Outcome::Holds, Outcome::Fails], "0.8 and 0.4 of what the samples give");
    let (untimed, line) = judged(&results, &[]);
    assert!(untimed == Outcome::Reported && !line.contains("times as fast"), "nothing was timed: {line}");
    for some in [0, results.len() - 1] {
        let (incomplete, _) = judged(&results[..some], &seconds([1.0, 1.0]));
        assert_eq!(incomplete, Outcome::Reported, "{some} cells of {}", results.len());
    }
}

#[test]
fn variants_are_paired_by_object() {
    let setup = setup(vec![model(&[10])]);
    let x = variants::variants(&setup, Path::new("out"));
    let results = filled(&x, |row, _| {
        let own = match row {
            "hexa NDE" => 1.0,
            "hexa diffuse" => 0.75,
            "tri NDE" => 0.5,
            "no update" => 0.25,
            _ => 1.125,
        };
        // Objects differ by much more than the kinds of models do.
        (0..OBJECTS)
            .flat_map(|k| (1..=3).map(move |set| (k, set)))
            .map(|(k, set)| (format!("psnr_db_{set}_{k:03}"), 10.0 * k as f64 + f64::from(set) * own))
            .collect()
    });
    let report = x.report(&results);
    for told in [
        "NDE − diffuse: 0.50 ± 0.00 dB",
        "hexa − tri: 1.00 ± 0.00 dB",
        "update − no update: 1.50 ± 0.00 dB",
        "second seed − first: 0.25 ± 0.00 dB",
    ] {
        assert!(report.verdict.contains(told), "{told}: {}", report.verdict);
    }
    let line = report.rows.iter().find(|row| row[0] == "update − no update").expect("a line");
    assert_eq!(line[1..], ["0.75 ± 0.00", "1.50 ± 0.00", "2.25 ± 0.00"], "after 4, 8 and 12 images");
}
