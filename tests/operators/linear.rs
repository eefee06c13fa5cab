//! Layers against their definitions, bit for bit.

use crate::chains::{assert_same_bits, three_loops, values};
use lastlight::nn::linear;
use lastlight::num::sum;

#[test]
fn linear_is_its_definition_and_its_adjoint_accumulates() {
    let (m, n, k) = (61, 77, 517);
    let (x, weight, bias) = (values(m * k, 8), values(n * k, 9), values(n, 10));
    let input = linear::In { x: &x, weight: &weight, bias: &bias, m, n, k };
    let mut y = vec![0.0; m * n];
    linear::forward(input, &mut y);
    let mut expected = three_loops(m, n, k, |i, p| x[i * k + p], |p, j| weight[j * k + p]);
    expected.iter_mut().enumerate().for_each(|(i, y)| *y += bias[i % n]);
    assert_same_bits(&y, &expected, "y");

    let y_bar = values(m * n, 11);
    let mut bar = linear::InBar::zeros_like(&input);
    linear::adjoint(input, &y_bar, &mut bar);
    let x_bar = three_loops(m, k, n, |i, j| y_bar[i * n + j], |j, p| weight[j * k + p]);
    let weight_bar = three_loops(n, k, m, |j, i| y_bar[i * n + j], |i, p| x[i * k + p]);
    let bias_bar: Vec<f32> = (0..n).map(|j| (0..m).fold(0.0, |s, i| s + y_bar[i * n + j])).collect();
    let plus_zero = |x: &[f32]| x.iter().map(|x| 0.0 + x).collect::<Vec<_>>();
    assert_same_bits(&bar.x, &plus_zero(&x_bar), "x̄");
    assert_same_bits(&bar.weight, &plus_zero(&weight_bar), "W̄");
    assert_same_bits(&bar.bias, &plus_zero(&bias_bar), "b̄");

    let first = bar.clone();
    let mut wanted = linear::InBar { x: Vec::new(), ..bar };
    linear::adjoint(input, &y_bar, &mut wanted);
    let twice = |x: &[f32]| x.iter().map(|x| x + x).collect::<Vec<_>>();
    assert_same_bits(&wanted.weight, &twice(&first.weight), "W̄ accumulated");
    assert_same_bits(&wanted.bias, &twice(&first.bias), "b̄ accumulated");
    assert!(wanted.x.is_empty(), "what is not wanted is not made");
}

#[test]
fn linear_without_bias_is_the_product() {
    let (m, n, k) = (4, 3, 5);
    let (x, weight) = (values(m * k, 12), values(n * k, 13));
    let mut y = vec![0.0; m * n];
    linear::forward(linear::In { x: &x, weight: &weight, bias: &[], m, n, k }, &mut y);
    assert_same_bits(&y, &three_loops(m, n, k, |i, p| x[i * k + p], |p, j| weight[j * k + p]), "y");
}

/// Arrays of a golden file, if it is there.
fn golden(name: &str) -> Option<std::collections::BTreeMap<String, Vec<f64>>> {
    let file = crate::common::golden(name)?;
    Some(file.0.into_iter().map(|(name, a)| (name, a.to_f64())).collect())
}

#[test]
fn linear_agrees_with_arrays_of_another_program() {
    let Some(file) = golden("nn_linear") else { return };
    let single = |name: &str| file[name].iter().map(|&x| x as f32).collect::<Vec<f32>>();
    let (x, weight, bias, y_bar) = (single("x"), single("weight"), single("bias"), single("y_bar"));
    let n = bias.len();
    let (m, k) = (y_bar.len() / n, weight.len() / n);
    let input = linear::In { x: &x, weight: &weight, bias: &bias, m, n, k };
    let mut y = vec![0.0; m * n];
    linear::forward(input, &mut y);
    let mut bar = linear::InBar::zeros_like(&input);
    linear::adjoint(input, &y_bar, &mut bar);
    for (name, ours) in [("y", &y), ("x_bar", &bar.x), ("weight_bar", &bar.weight), ("bias_bar", &bar.bias)] {
        let theirs = &file[name];
        assert_eq!(ours.len(), theirs.len(), "{name}");
        let difference: Vec<f64> = ours.iter().zip(theirs).map(|(&a, b)| f64::from(a) - b).collect();
        let norm = |x: &[f64]| sum::sum16_f64_by(x.len(), |i| x[i] * x[i]).sqrt();
        let relative = norm(&difference) / norm(theirs);
        // Rounding the inputs to single precision alone costs about 4e-8; measured 1.3e-7 at most.
        println!("{name}: relative L2 {relative:.2e}");
        assert!(relative <= 3e-7, "{name}: relative L2 {relative:e}");
    }
}
