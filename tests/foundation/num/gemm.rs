//! Matrix products bit for bit against three loops.

use super::{assert_same_bits, values};
use lastlight::nn::linear;
use lastlight::num::gemm::{Finish, Packed, View, gemm, gemm_packed};
use lastlight::num::{par, sum};

/// The definition: one chain per chunk of 4096, the tree over the chunks.
fn three_loops(
    m: usize,
    n: usize,
    k: usize,
    a: impl Fn(usize, usize) -> f32,
    b: impl Fn(usize, usize) -> f32,
) -> Vec<f32> {
    let mut c = Vec::with_capacity(m * n);
    for i in 0..m {
        for j in 0..n {
            let chain =
                |start: usize| (start..k.min(start + 4096)).fold(0.0_f32, |acc, k| acc + a(i, k) * b(k, j));
            let partials: Vec<f32> = (0..k).step_by(4096).map(chain).collect();
            c.push(sum::tree_f32(&partials));
        }
    }
    c
}

const SHAPES: [(usize, usize, usize); 20] = [
    (1, 1, 1),
    (1, 1, 0),
    (6, 16, 4),
    (5, 15, 3),
    (7, 17, 5),
    (1, 64, 64),
    (64, 1, 64),
    (13, 513, 9),
    (61, 77, 517),
    (12, 40, 256),
    (12, 40, 257),
    (50, 33, 512),
    (97, 1030, 31),
    (400, 24, 40),
    (3, 5, 4096),
    (3, 5, 4097),
    (5, 18, 5000),
    (7, 9, 8192),
    (2, 3, 20_481),
    (2, 20, 28_700),
];

#[test]
fn products_are_those_of_three_loops_in_every_orientation() {
    for (m, n, k) in SHAPES {
        let (a, b, old) = (values(m * k, 1), values(k * n, 2), values(m * n, 3));
        let (bias, what) = (values(n, 4), format!("{m}x{n}x{k}"));
        let mut c = vec![f32::NAN; m * n];
        let nn = three_loops(m, n, k, |i, p| a[i * k + p], |p, j| b[p * n + j]);
        gemm(View::new(&a, m, k), View::new(&b, k, n), Finish::Store, &mut c);
        assert_same_bits(&c, &nn, &format!("{what}, a·b"));
        let nt = three_loops(m, n, k, |i, p| a[i * k + p], |p, j| b[j * k + p]);
        gemm(View::new(&a, m, k), View::new(&b, n, k).t(), Finish::Store, &mut c);
        assert_same_bits(&c, &nt, &format!("{what}, a·bᵀ"));
        let tn = three_loops(m, n, k, |i, p| a[p * m + i], |p, j| b[p * n + j]);
        gemm(View::new(&a, k, m).t(), View::new(&b, k, n), Finish::Store, &mut c);
        assert_same_bits(&c, &tn, &format!("{what}, aᵀ·b"));
        let tt = three_loops(m, n, k, |i, p| a[p * m + i], |p, j| b[j * k + p]);
        gemm(View::new(&a, k, m).t(), View::new(&b, n, k).t(), Finish::Store, &mut c);
        assert_same_bits(&c, &tt, &format!("{what}, aᵀ·bᵀ"));

        gemm(View::new(&a, m, k), View::new(&b, k, n), Finish::Bias(&bias), &mut c);
        let expected: Vec<f32> = nn.iter().enumerate().map(|(i, p)| p + bias[i % n]).collect();
        assert_same_bits(&c, &expected, &format!("{what}, bias"));
        c.copy_from_slice(&old);
        gemm_packed(View::new(&a, m, k), &Packed::new(View::new(&b, k, n)), Finish::Add, &mut c);
        let expected: Vec<f32> = nn.iter().zip(&old).map(|(p, c)| c + p).collect();
        assert_same_bits(&c, &expected, &format!("{what}, added"));
    }
}

#[test]
fn products_of_strided_views() {
    // Two heads of four columns each in rows of eight; and every second column.
    let (x, m, k) = (values(9 * 8, 5), 9, 4);
    for (start, step) in [(0, 1), (4, 1), (0, 2), (1, 2)] {
        let view = View::strided(&x[start..], (m, k), (8, step));
        let at = |i: usize, p: usize| x[start + i * 8 + p * step];
        let mut c = vec![0.0; m * m];
        gemm(view, view.t(), Finish::Store, &mut c);
        assert_same_bits(
            &c,
            &three_loops(m, m, k, at, |p, j| at(j, p)),
            &format!("start {start}, step {step}"),
        );
    }
}

#[test]
fn products_do_not_depend_on_the_number_of_threads() {
    let (m, n, k) = (203, 1100, 301);
    let (a, b) = (values(m * k, 6), values(n * k, 7));
    let product = |threads: usize| {
        par::with_threads(threads, || {
            let mut c = vec![0.0; m * n];
            gemm(View::new(&a, m, k), View::new(&b, n, k).t(), Finish::Store, &mut c);
            c
        })
        .expect("the environment of a fresh pool is the default one")
    };
    let one = product(1);
    assert_same_bits(&one, &three_loops(m, n, k, |i, p| a[i * k + p], |p, j| b[j * k + p]), "one thread");
    for threads in [2, 7] {
        assert_same_bits(&product(threads), &one, &format!("{threads} threads"));
    }
}

#[test]
fn infinities_stay_where_they_are() {
    // Seventeen columns and seven rows: padding next to an infinite element must not reach the result.
    let (m, n, k) = (7, 17, 3);
    let mut a = vec![1.0; m * k];
    a[0] = f32::INFINITY;
    let b = vec![1.0; k * n];
    let mut c = vec![0.0; m * n];
    gemm(View::new(&a, m, k), View::new(&b, k, n), Finish::Store, &mut c);
    assert!(c[..n].iter().all(|&x| x == f32::INFINITY), "the first row");
    assert!(c[n..].iter().all(|&x| x == 3.0), "the others");
}

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
