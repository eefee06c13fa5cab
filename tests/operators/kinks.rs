//! At a kink the side is the documented one, in the shipped operator and in its twin: numbers that lie on the kink exactly.

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
