//! Heads: networks from features to values.

use super::{check_sizes, half_size};
use crate::Result;
use crate::field::network::NetworkBar;
use crate::field::sdf_head;
use crate::num::array::Arrays;
use crate::ops::call::RunResult;
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

/// Arguments of the hidden units of one row, layer by layer; `weights` are the layers with their widths.
fn hidden(weights: &[(usize, Vec<f64>)], row: &[f64]) -> Vec<Vec<f64>> {
    let mut value = row.to_vec();
    let mut out = Vec::new();
    for (_, weight) in &weights[..weights.len() - 1] {
        let dot = |w: &[f64]| w.iter().zip(&value).fold(0.0, |sum, (w, x)| sum + w * x);
        let z: Vec<f64> = weight.chunks_exact(value.len()).map(dot).collect();
        value = z.iter().map(|z| if *z > 0.0 { *z } else { 0.0 }).collect();
        out.push(z);
    }
    out
}

/// Zeros of the gradients of features and weights: no row has a path of active units from the entry to an
/// output.
fn predict(x: &CheckedCall<'_>, names: &[&str]) -> Prediction {
    let weights: Vec<(usize, Vec<f64>)> = names.iter().map(|w| (x.shape(w)[0], x.f64s(w))).collect();
    let (features, k) = (x.f64s("features"), x.dim("K"));
    let mut zeros: Vec<Vec<bool>> = weights.iter().map(|(_, w)| vec![true; w.len()]).collect();
    let mut features_zeros = vec![true; features.len()];
    for (r, row) in features.chunks_exact(k).enumerate() {
        let units = hidden(&weights, row);
        // Whether a unit of the layer reaches an output.
        let mut reaches = vec![true; weights[weights.len() - 1].0];
        for l in (0..weights.len()).rev() {
            let inputs = weights[l].1.len() / weights[l].0;
            let is_active = |i: usize| l == 0 || units[l - 1][i] > 0.0;
            for (e, zero) in zeros[l].iter_mut().enumerate() {
                *zero &= !(reaches[e / inputs] && is_active(e % inputs));
            }
            let any = reaches.contains(&true);
            reaches = (0..inputs).map(|i| any && is_active(i)).collect();
        }
        features_zeros[r * k..(r + 1) * k].iter_mut().zip(reaches).for_each(|(zero, is)| *zero = !is);
    }
    let mut known = Prediction::default();
    known.zeros.insert("features".to_owned(), features_zeros);
    known.zeros.extend(names.iter().map(|name| (*name).to_owned()).zip(zeros));
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
    let apart = |row: &&[f32]| {
        let row: Vec<f64> = row.iter().map(|x| f64::from(*x)).collect();
        hidden(&weights, &row).iter().flatten().all(|z| z.abs() >= MARGIN)
    };
    let rows: Vec<f32> = pool.chunks_exact(widths[0]).filter(apart).take(n).flatten().copied().collect();
    assert_eq!(rows.len(), n * widths[0], "enough candidates away from the kinks");
    arrays.put("features", &[n, widths[0]], rows);
    arrays
}

/// Case 0: small; case 1: more rows.
fn case_sdf(case: usize) -> Case {
    let (n, widths, half_size) = [(21, [6, 5, 4, 1], 0.5), (150, [9, 8, 7, 1], 0.75)][case];
    let mut made = Case { inputs: network(61, case, n, &widths), ..Case::default() };
    // away from x = 0, where ‖x‖ has a kink
    let apart = |x: f32| if x > 0.0 { x + 0.25 } else { x - 0.25 };
    let points = Draw::new(61, case, 11).uniforms(3 * n, -0.5, 0.5).into_iter().map(apart);
    made.inputs.put("points", &[n, 3], points.collect());
    made.settings.insert("half_size".to_owned(), Setting::Number(half_size));
    made
}
