//! At a kink the side is the documented one, in the shipped operator and in its twin: numbers that lie on the
//! kink exactly.

use lastlight::num::array::Arrays;
use lastlight::ops::{self, Call, RunResult};

/// Gradients at a cotangent of ones by the shipped operator and by the twin.
fn gradients(name: &str, inputs: &Arrays, settings: &[(&str, f64)]) -> [RunResult; 2] {
    let op = ops::find(name).expect("on the list");
    let mut call = Call { inputs: inputs.clone(), ..Call::default() };
    for (key, value) in settings {
        call.settings.insert((*key).to_owned(), ops::Setting::Number(*value));
    }
    let first = ops::run(op, &call).unwrap_or_else(|e| panic!("{e}"));
    for (output, y) in &first.outputs.0 {
        call.cotangents.put(output, y.shape(), vec![1.0_f32; y.len()]);
    }
    [ops::run(op, &call), ops::run_f64(op, &call)].map(|ran| ran.unwrap_or_else(|e| panic!("{e}")))
}

fn of(ran: &RunResult, name: &str) -> Vec<f64> {
    ran.gradients.need(name).expect("a gradient").to_f64()
}

#[test]
fn limits_of_log_variances_belong_to_the_inside() {
    let next = |x: f32, up: bool| if up { x.next_up() } else { x.next_down() };
    let logvar = vec![-8.0, next(-8.0, false), next(-8.0, true), 4.0, next(4.0, true), next(4.0, false)];
    let inputs = Arrays::new().with("logvar", &[6], logvar);
    for ran in gradients("causal.limit", &inputs, &[]) {
        assert_eq!(of(&ran, "logvar"), [1.0, 0.0, 1.0, 1.0, 0.0, 1.0], "on a limit the slope is 1");
    }
}

#[test]
fn the_least_shade_has_no_gradient() {
    // 1 + n·d is ¼, and the same a little above: exact in f32 and in f64
    let inputs = |z: f32| {
        Arrays::new()
            .with("sh", &[1, 3], vec![0.0_f32; 3])
            .with("normals", &[1, 3], vec![0.0_f32, 0.0, -1.0])
            .with("toward", &[3], vec![0.0_f32, 0.0, z])
    };
    for (z, slope) in [(0.75, 0.0), (0.875, 0.0), (0.625, -1.5)] {
        for ran in gradients("shade.diffuse", &inputs(z), &[]) {
            assert_eq!(of(&ran, "toward"), [0.0, 0.0, slope], "1 + n·d = {}", 1.0 - z);
        }
    }
}

#[test]
fn the_least_colour_has_the_gradient_of_the_line() {
    // ½ + Y₀ c is 0 in each arithmetic at a number of its own: Y₀ is not the same in f32 and in f64
    let y0 = 0.5 * (1.0 / std::f64::consts::PI).sqrt();
    let (single, double) = (-1.772_453_9_f32, -1.772_453_850_905_516_f64);
    assert_eq!(0.5 + 0.282_094_79_f32 * single, 0.0, "on the kink in f32");
    assert_eq!(0.5 + y0 * double, 0.0, "on the kink in f64");
    let below = [single.next_down().next_down(), single.next_up()].map(f64::from);
    for (colour, lit) in [([f64::from(single), double], true), ([below[0]; 2], false), ([below[1]; 2], true)]
    {
        for (which, c) in colour.into_iter().enumerate() {
            let inputs = Arrays::new()
                .with("sh", &[1, 3], vec![c; 3])
                .with("normals", &[1, 3], vec![0.0, 0.0, 1.0])
                .with("toward", &[3], vec![0.0, 0.0, 0.5]);
            let got = of(&gradients("shade.diffuse", &inputs, &[])[which], "sh");
            let slope = if lit { 1.5 * y0 } else { 0.0 };
            assert!(got.iter().all(|g| (g - slope).abs() < 1e-7), "c = {c:e}: {got:?} for {slope}");
        }
    }
}

#[test]
fn a_unit_at_zero_is_inactive() {
    // 1·2 + b is 0, then a step to either side; behind it a layer that takes the input again
    let up = 1.0_f32 / 1024.0;
    for (skip, weights) in [(0.0, vec![1.0_f32, 3.0]), (1.0, vec![1.0_f32, 3.0, 5.0])] {
        for (bias, active) in [(-2.0, false), (-2.0 - up, false), (-2.0 + up, true)] {
            let n = weights.len();
            let inputs = Arrays::new()
                .with("x", &[1, 1], vec![2.0_f32])
                .with("widths", &[3], vec![1_i32, 1, 1])
                .with("weights", &[n], weights.clone())
                .with("biases", &[2], vec![bias, 0.5_f32]);
            for ran in gradients("nn.mlp", &inputs, &[("skip", skip)]) {
                let (z_bar, value) = if active { (3.0, f64::from(up)) } else { (0.0, 0.0) };
                let again = if skip > 0.0 { 5.0 } else { 0.0 };
                assert_eq!(of(&ran, "biases"), [z_bar, 1.0], "bias {bias}, skip {skip}");
                assert_eq!(of(&ran, "x"), [z_bar + again], "bias {bias}, skip {skip}");
                assert_eq!(of(&ran, "weights")[..2], [2.0 * z_bar, value], "bias {bias}, skip {skip}");
            }
        }
    }
}

/// W x + b of f32 rows, in f64.
fn affine(weight: &[f64], x: &[f64], bias: &[f64]) -> Vec<f64> {
    let row = |(row, bias): (&[f64], &f64)| row.iter().zip(x).fold(0.0, |sum, (w, x)| sum + w * x) + bias;
    weight.chunks_exact(x.len()).zip(bias).map(row).collect()
}

/// Arguments of hidden units, one row of them for every row of the network: each unit is active in some and
/// inactive in others.
fn hold_both_sides(what: &str, rows: &[Vec<f64>]) {
    for unit in 0..rows[0].len() {
        let side = |above: bool| rows.iter().filter(|row| (row[unit] > 0.0) == above).count();
        assert!(side(true) > 0 && side(false) > 0, "{what}: unit {unit} is on one side throughout");
    }
}

/// None is near its kink.
fn hold_apart(what: &str, rows: &[Vec<f64>]) {
    let nearest =
        rows.iter().flatten().fold(f64::INFINITY, |least, z| if z.abs() < least { z.abs() } else { least });
    assert!(nearest > 0.049, "{what}: {nearest} from a kink");
}

#[test]
fn generated_networks_have_units_on_both_sides_and_none_near_its_kink() {
    let of = |name: &str, case: usize| {
        let made = (ops::find(name).expect("on the list").case)(case);
        move |name: &str| made.inputs.need(name).expect("an input").to_f64()
    };
    let (mlp, skip) = (of("nn.mlp", 1), 2);
    let widths: Vec<usize> = mlp("widths").into_iter().map(|w| w as usize).collect();
    let (weights, biases, x) = (mlp("weights"), mlp("biases"), mlp("x"));
    assert!(x.len() / widths[0] > 64, "more rows than one task of the adjoint has");
    let arguments = |x: &[f64]| {
        let (mut w, mut b, mut value, mut all) = (&weights[..], &biases[..], x.to_vec(), Vec::new());
        for l in 0..widths.len() - 2 {
            if l == skip {
                value.extend(x);
            }
            let (n, k) = (widths[l + 1], value.len());
            value = affine(&w[..n * k], &value, &b[..n]);
            (w, b) = (&w[n * k..], &b[n..]);
            all.extend(&value);
            value.iter_mut().for_each(|z| *z = if *z > 0.0 { *z } else { 0.0 });
        }
        all
    };
    let rows: Vec<Vec<f64>> = x.chunks_exact(widths[0]).map(arguments).collect();
    hold_apart("nn.mlp/1", &rows);
    hold_both_sides("nn.mlp/1", &rows);
    for case in [2, 3, 4] {
        let x = of("nn.decoder", case);
        let [z, codes, point, latent, bias0] = ["z", "codes", "point", "latent", "bias0"].map(&x);
        let (d, f) = (latent.len() / bias0.len(), point.len() / bias0.len());
        let (items, coordinates) = (z.len() / d, x("base").len() / (z.len() / d) / x("scale").len());
        let leaky =
            |h: Vec<f64>| h.into_iter().map(|x| if x > 0.0 { x } else { 0.2 * x }).collect::<Vec<_>>();
        let rows = (0..items * coordinates).map(|at| {
            let both: Vec<f64> = (0..bias0.len())
                .flat_map(|n| [&latent[n * d..(n + 1) * d], &point[n * f..(n + 1) * f]].concat())
                .collect();
            let item = at / coordinates;
            let input = [&z[item * d..(item + 1) * d], &codes[at * f..(at + 1) * f]].concat();
            let first = affine(&both, &input, &bias0);
            let second = affine(&x("weight1"), &leaky(first.clone()), &x("bias1"));
            let third = affine(&x("weight2"), &leaky(second.clone()), &x("bias2"));
            [first, second, third].concat()
        });
        let rows: Vec<Vec<f64>> = rows.collect();
        hold_apart(&format!("nn.decoder/{case}"), &rows);
        if case == 2 {
            hold_both_sides(&format!("nn.decoder/{case}"), &rows);
        }
    }
}

#[test]
fn a_square_beside_the_image_is_black() {
    for corner in [[20.0_f32, 3.0], [-30.0, 3.0], [3.0, 9.0], [3.0, -12.0]] {
        let image: Vec<f32> = (0..9 * 12 * 3).map(|i| 0.5 + i as f32).collect();
        let inputs = Arrays::new()
            .with("image", &[9, 12, 3], image)
            .with("corner", &[2], corner.to_vec())
            .with("length", &[], vec![5.5_f32]);
        for ran in gradients("nn.window", &inputs, &[("side", 3.0)]) {
            let window = ran.outputs.need("window").expect("an output").to_f64();
            assert!(window.iter().all(|x| *x == 0.0), "{corner:?}: {window:?}");
            assert!(of(&ran, "image").iter().all(|x| *x == 0.0), "{corner:?}: no gradient");
        }
    }
}
