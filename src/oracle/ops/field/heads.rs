//! Heads: networks from features to values.

use super::reach::{Layers, hidden};
use super::{check_sizes, half_size};
use crate::Result;
use crate::field::network::{Network, NetworkBar};
use crate::field::{normal_head, sdf_head, value_head};
use crate::num::array::Arrays;
use crate::ops::call::{RunResult, rows};
use crate::ops::case::Draw;
use crate::ops::op::{Case, CheckedCall, Op};
use crate::tape::check::Prediction;
use reference::settings::Setting;

/// `field.sdf_head`
pub(in crate::ops) static SDF_HEAD: Op = Op {
    work_unit: "products",
    work_ns: [1.0, 60.0],
    check: check_sdf,
    predict: |x, _| Ok(predict(x, &["w0", "w1", "w2"])),
    ..Op::new(&reference::field::sdf_head::SIGNATURE, run_sdf, case_sdf)
};

/// `field.value_head`
pub(in crate::ops) static VALUE_HEAD: Op = Op {
    work_unit: "products",
    work_ns: [1.0, 60.0],
    check: check_value,
    predict: |x, _| Ok(predict(x, names(x))),
    ..Op::new(&reference::field::value_head::SIGNATURE, run_value, case_value)
};

/// `field.normal_head`
pub(in crate::ops) static NORMAL_HEAD: Op = Op {
    work_unit: "products",
    work_ns: [1.0, 60.0],
    check: |x| check_sizes(x, "features", &["N", "K", "A", "B", "D"]),
    predict: |x, _| Ok(predict(x, &NAMES)),
    ..Op::new(&reference::field::normal_head::SIGNATURE, run_normal, case_normal)
};

/// Names of the layers.
const NAMES: [&str; 4] = ["w0", "w1", "w2", "w3"];

/// Names of the layers that are present.
fn names(x: &CheckedCall<'_>) -> &'static [&'static str] {
    if x.has("w3") { &NAMES } else { &NAMES[..3] }
}

fn check_value(x: &CheckedCall<'_>) -> Result<()> {
    let letters: &[&str] =
        if x.has("w3") { &["N", "K", "A", "B", "D", "E"] } else { &["N", "K", "A", "B", "D"] };
    check_sizes(x, "features", letters)
}

fn check_sdf(x: &CheckedCall<'_>) -> Result<()> {
    check_sizes(x, "features", &["N", "K", "A", "B"])?;
    half_size(x).map(drop)
}

/// Empty sums of the gradients to accumulate into.
fn start(x: &CheckedCall<'_>, names: &[&str]) -> NetworkBar {
    let of = |name: &str| x.start(name, x.f32s(name).len());
    NetworkBar { x: of("features"), weights: names.iter().map(|name| of(name)).collect() }
}

/// Stores the gradients of features and weights.
fn put(x: &CheckedCall<'_>, names: &[&str], bar: NetworkBar, ran: &mut RunResult) {
    ran.gradients.put("features", &x.shape("features"), bar.x);
    for (name, bar) in names.iter().zip(bar.weights) {
        ran.gradients.put(name, &x.shape(name), bar);
    }
}

fn run_sdf(x: &CheckedCall<'_>) -> Result<RunResult> {
    let names = ["w0", "w1", "w2"];
    let (features, points, weights) = (x.f32s("features"), x.rows::<3>("points"), names.map(|w| x.f32s(w)));
    let weights: Vec<&[f32]> = weights.iter().map(Vec::as_slice).collect();
    let input =
        sdf_head::In { features: &features, points: &points, weights: &weights, half_size: half_size(x)? };
    let (sdf, saved) = sdf_head::forward(&input);
    let n = sdf.len();
    let mut ran = RunResult::default();
    ran.outputs.put("sdf", &[n], sdf);
    if let Some(sdf_bar) = x.bar("sdf", &[n])? {
        let mut points_bar = x.start_rows::<3>("points", n);
        let mut bar = start(x, &names);
        sdf_head::adjoint(&input, &saved, &sdf_bar, &mut points_bar, &mut bar);
        ran.gradients.put("points", &[n, 3], points_bar.into_flattened());
        put(x, &names, bar, &mut ran);
    }
    Ok(ran)
}

fn run_value(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (features, names) = (x.f32s("features"), names(x));
    let weights: Vec<Vec<f32>> = names.iter().map(|w| x.f32s(w)).collect();
    let weights: Vec<&[f32]> = weights.iter().map(Vec::as_slice).collect();
    let network = Network { weights: &weights, inputs: x.dim("K") };
    let (value, saved) = value_head::forward(&network, &features);
    let shape = [x.dim("N"), value.len() / x.dim("N")];
    let mut ran = RunResult::default();
    if let Some(value_bar) = x.bar("value", &shape)? {
        let mut bar = start(x, names);
        value_head::adjoint(&network, &features, (&value, &saved), &value_bar, &mut bar);
        put(x, names, bar, &mut ran);
    }
    ran.outputs.put("value", &shape, value);
    Ok(ran)
}

fn run_normal(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (features, points, n) = (x.f32s("features"), x.rows::<3>("points"), x.dim("N"));
    let weights = NAMES.map(|w| x.f32s(w));
    let weights: Vec<&[f32]> = weights.iter().map(Vec::as_slice).collect();
    let network = Network { weights: &weights, inputs: x.dim("K") };
    let (normal, saved) = normal_head::forward(&network, &features, &points);
    let mut ran = RunResult::default();
    ran.outputs.put("normal", &[n, 3], normal.into_flattened());
    if let Some(normal_bar) = x.bar("normal", &[n, 3])? {
        let mut points_bar = x.start_rows::<3>("points", n);
        let mut bar = start(x, &NAMES);
        let normal_bar = rows::<3>(&normal_bar);
        normal_head::adjoint(&network, (&features, &points), &saved, &normal_bar, &mut points_bar, &mut bar);
        ran.gradients.put("points", &[n, 3], points_bar.into_flattened());
        put(x, &NAMES, bar, &mut ran);
    }
    Ok(ran)
}

/// Zeros of the gradients of features and weights: no row has a path of active units from the entry to an
/// output.
fn predict(x: &CheckedCall<'_>, names: &[&str]) -> Prediction {
    let mut layers = Layers::of(x, names);
    let mut features_zeros = Vec::new();
    for row in x.f64s("features").chunks_exact(x.dim("K")) {
        let units = layers.units(row);
        features_zeros.extend(layers.reach(&units).into_iter().map(|is| !is));
    }
    let mut known = Prediction::default();
    known.zeros.insert("features".to_owned(), features_zeros);
    known.zeros.extend(names.iter().map(|name| (*name).to_owned()).zip(layers.zeros));
    known
}

/// Minimum distance of generated hidden units from their kinks.
const MARGIN: f64 = 0.05;

/// Weights of the given widths (inputs first), and `n` rows of features with which no hidden unit is near its
/// kink.
fn network(seed: u64, case: usize, n: usize, widths: &[usize]) -> Arrays {
    let mut arrays = Arrays::new();
    let mut weights = Vec::new();
    for (l, size) in widths.windows(2).enumerate() {
        let scale = 1.25 / (size[0] as f32).sqrt();
        let drawn = Draw::new(seed, case, l as u16).normals(size[0] * size[1]);
        let weight: Vec<f32> = drawn.into_iter().map(|w| scale * w).collect();
        weights.push((size[1], weight.iter().map(|w| f64::from(*w)).collect::<Vec<f64>>()));
        arrays.put(&format!("w{l}"), &[size[1], size[0]], weight);
    }
    let pool = Draw::new(seed, case, 10).normals(40 * n * widths[0]);
    let layers = Layers::new(weights);
    let apart = |row: &&[f32]| {
        let row: Vec<f64> = row.iter().map(|x| f64::from(*x)).collect();
        hidden(&layers.units(&row)).all(|z| z.abs() >= MARGIN)
    };
    let rows: Vec<f32> = pool.chunks_exact(widths[0]).filter(apart).take(n).flatten().copied().collect();
    assert_eq!(rows.len(), n * widths[0], "enough candidates away from the kinks");
    arrays.put("features", &[n, widths[0]], rows);
    arrays
}

/// Points away from x = 0, where x/‖x‖ and ‖x‖ have a kink.
fn points(seed: u64, case: usize, n: usize) -> Vec<f32> {
    let apart = |x: f32| if x > 0.0 { x + 0.25 } else { x - 0.25 };
    Draw::new(seed, case, 11).uniforms(3 * n, -0.5, 0.5).into_iter().map(apart).collect()
}

/// Case 0: small; case 1: more rows.
fn case_sdf(case: usize) -> Case {
    let (n, widths, half_size) = [(21, [6, 5, 4, 1], 0.5), (150, [9, 8, 7, 1], 0.75)][case];
    let mut made = Case { inputs: network(61, case, n, &widths), ..Case::default() };
    made.inputs.put("points", &[n, 3], points(61, case, n));
    made.settings.insert("half_size".to_owned(), Setting::Number(half_size));
    made
}

/// Case 0: three layers with one output; case 1: four layers with three.
fn case_value(case: usize) -> Case {
    let (n, widths): (usize, &[usize]) = [(21, &[6, 5, 4, 1][..]), (150, &[9, 8, 7, 6, 3])][case];
    Case { inputs: network(65, case, n, widths), ..Case::default() }
}

/// Case 0: few rows; case 1: more.
fn case_normal(case: usize) -> Case {
    let (n, widths) = [(21, [6, 5, 4, 4, 3]), (150, [9, 8, 7, 6, 3])][case];
    let mut made = Case { inputs: network(66, case, n, &widths), ..Case::default() };
    made.inputs.put("points", &[n, 3], points(66, case, n));
    made
}
