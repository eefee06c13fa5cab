//! Layers of transformers where they fail elsewhere: constant rows, large logits, tokens that nothing attends to, chains beyond one chunk.

use lastlight::nn::attention::{self, In, InBar};
use lastlight::nn::{block, gelu, layernorm, linear, softmax};
use lastlight::num::array::{Arrays, entries};
use lastlight::num::rng::Rng;
use lastlight::num::{order, par};
use lastlight::ops::{self, Call};
use reference::settings::Setting;

fn normals(n: usize, purpose: u16) -> Vec<f32> {
    (0..n).map(|i| Rng::new(11).normal_f32(i as u64, 0, purpose, 0)).collect()
}

#[test]
fn rows_that_are_constant_or_far_from_0_are_normalised() {
    let (gain, bias) = ([2.0, 3.0, 4.0, 5.0], [0.5, -0.5, 0.25, 1.0]);
    let rows = [7.25, 7.25, 7.25, 7.25, 1e4 - 1e-3, 1e4, 1e4 + 1e-3, 1e4];
    let x = layernorm::In { x: &rows, gain: &gain, bias: &bias, eps: 1e-6 };
    let mut y = [0.0; 8];
    let saved = layernorm::forward(&x, &mut y);
    assert_eq!(y[..4], bias, "a constant row is the bias");
    // In one pass, mean x² − μ² of the second row has no correct digit: x² is 10⁸, the variance below 10⁻⁶.
    let row: Vec<f64> = rows[4..].iter().map(|x| f64::from(*x)).collect();
    let mean = row.iter().fold(0.0, |s, x| s + x) / 4.0;
    let variance = row.iter().fold(0.0, |s, x| s + (x - mean) * (x - mean)) / 4.0;
    for j in 0..4 {
        let n = (row[j] - mean) / (variance + 1e-6).sqrt();
        let expected = n * f64::from(gain[j]) + f64::from(bias[j]);
        assert!((f64::from(y[4 + j]) - expected).abs() < 1e-6, "{j}: {} and {expected}", y[4 + j]);
    }
    let mut bar = layernorm::InBar::zeros_like(&x);
    layernorm::adjoint(&x, &saved, &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], &mut bar);
    // 1/√ε · (g − mean g): 1 000·(2 − ½)
    assert!((bar.x[0] - 1500.0).abs() < 1e-3 && (bar.x[1] + 500.0).abs() < 1e-3, "{:?}", bar.x);
}

#[test]
fn gelu_keeps_the_digits_of_its_left_tail() {
    let mut y = [0.0; 4];
    gelu::forward(&[-6.0, -10.0, -13.0, -20.0], &mut y);
    // x·Φ(x); ½(1 + erf) gives 0 for the first in single precision, and for the second in double.
    for (y, expected) in y.into_iter().zip([-5.919_526e-9, -7.619_853e-23, -7.952_314e-38]) {
        assert!((y / expected - 1.0_f32).abs() < 1e-4, "{y} and {expected}");
    }
    assert_eq!(y[3].to_bits(), (-0.0_f32).to_bits(), "underflow");
}

#[test]
fn a_softmax_of_any_size_of_logits_sums_to_1() {
    for k in [3, 64, 1000] {
        // A row of equal logits, of very large and of very small ones, of both together, and of random ones up to ±10⁴.
        let both = (0..k).map(|j| if j % 2 == 0 { 1e4 } else { -1e4 });
        let random = normals(k, 3).into_iter().map(|n| order::clamp(3e3 * n, -1e4, 1e4));
        let x: Vec<f32> =
            [7.5, 1e4, -1e4].into_iter().flat_map(|v| vec![v; k]).chain(both).chain(random).collect();
        let y = softmax::forward(&softmax::In { x: &x, base: &[], floor: 0.0, k });
        let y_bar = normals(x.len(), 4);
        let mut x_bar = vec![0.0; x.len()];
        softmax::adjoint(&y, k, &y_bar, &mut x_bar);
        let bound = f64::from(u16::try_from(k).expect("small")) / (1_u32 << 24) as f64;
        for (r, row) in y.chunks_exact(k).enumerate() {
            let sum = row.iter().fold(0.0, |s, y| s + f64::from(*y));
            assert!((sum - 1.0).abs() <= bound, "row {r} of {k}: {sum}");
            // The gradient of a sum that is always 1 is 0.
            let slope = x_bar[r * k..][..k].iter().fold(0.0, |s, g| s + f64::from(*g));
            assert!(slope.abs() <= 4.0 * bound, "row {r} of {k}: {slope}");
        }
        let ones = k.div_ceil(2) as f32;
        assert!(y[..3 * k].iter().all(|y| *y == 1.0 / k as f32), "equal logits have equal parts");
        assert!((0..k).all(|j| y[3 * k + j] == if j % 2 == 0 { 1.0 / ones } else { 0.0 }), "10⁴ and −10⁴");
    }
}

/// A layer whose queries, keys and values are the tokens themselves, for one head.
struct Plain {
    x: Vec<f32>,
    w_qkv: Vec<f32>,
    w_out: Vec<f32>,
    zeros: Vec<f32>,
    tokens: usize,
}

impl Plain {
    fn new(x: Vec<f32>, width: usize) -> Self {
        let one = |i: usize| f32::from(u8::from(i / width % width == i % width));
        Self {
            tokens: x.len() / width,
            x,
            w_qkv: (0..3 * width * width).map(one).collect(),
            w_out: (0..width * width).map(one).collect(),
            zeros: vec![0.0; 3 * width],
        }
    }

    fn input<'a>(&'a self, attended: &'a [f32]) -> In<'a> {
        let width = self.zeros.len() / 3;
        In {
            x: &self.x,
            w_qkv: &self.w_qkv,
            b_qkv: &self.zeros,
            w_out: &self.w_out,
            b_out: &self.zeros[..width],
            attended,
            tokens: self.tokens,
            heads: 1,
        }
    }
}

#[test]
fn large_logits_choose_a_token_and_equal_ones_give_the_mean() {
    // q·k = x·x: logits of ±10⁴ and 0.
    let plain = Plain::new(vec![100.0, -100.0, 0.0], 1);
    let mut y = [0.0; 3];
    let input = plain.input(&[]);
    let saved = attention::forward(&input, &mut y);
    assert_eq!(y, [100.0, -100.0, 0.0], "each its own; the last the mean");
    let mut bar = InBar::zeros_like(&input);
    attention::adjoint(&input, &saved, &[1.0; 3], &mut bar);
    assert!(bar.x.iter().chain(&bar.w_qkv).all(|g| g.is_finite()), "{bar:?}");
}

#[test]
fn nothing_to_attend_to_gives_the_bias_and_no_gradient() {
    let mut plain = Plain::new(normals(10, 1), 2);
    plain.zeros[..2].copy_from_slice(&[0.5, -2.0]);
    let none = [0.0; 5];
    let input = In { b_qkv: &[0.0; 6], ..plain.input(&none) };
    let mut y = [0.0; 10];
    let saved = attention::forward(&input, &mut y);
    assert!(y.chunks_exact(2).all(|row| row == [0.5, -2.0]), "{y:?}");
    let mut bar = InBar::zeros_like(&input);
    attention::adjoint(&input, &saved, &[1.0; 10], &mut bar);
    assert!(bar.x.iter().chain(&bar.w_qkv).chain(&bar.b_qkv).chain(&bar.w_out).all(|g| *g == 0.0), "{bar:?}");
    assert_eq!(bar.b_out, [5.0, 5.0]);

    // One token that is not attended to does not affect the others, whatever it is.
    let mut without = [1.0; 5];
    without[3] = 0.0;
    let mut first = [0.0; 10];
    attention::forward(&plain.input(&without), &mut first);
    for value in [40.0, f32::NAN] {
        plain.x[6..8].copy_from_slice(&[value, -3.0]);
        let mut second = [0.0; 10];
        attention::forward(&plain.input(&without), &mut second);
        assert_eq!(first[..6], second[..6], "{value}");
        assert_eq!(first[8..], second[8..], "{value}");
    }
}

#[test]
fn chains_of_more_than_one_chunk_agree_with_f64_for_any_number_of_threads() {
    const T: usize = 4_500;
    let plain = Plain::new(normals(T, 2), 1);
    let input = plain.input(&[]);
    let y_bar = normals(T, 3);
    let run = || {
        let mut y = vec![0.0; T];
        let saved = attention::forward(&input, &mut y);
        let mut bar = InBar::zeros_like(&input);
        attention::adjoint(&input, &saved, &y_bar, &mut bar);
        (y, bar)
    };
    let [one, three] = [1, 3].map(|threads| par::with_threads(threads, run).expect("threads"));
    assert!(one == three, "the same bits");
    // y(i) = Σ p x; the gradient of W_v is Σᵢ ȳ(i) y(i), that of W_q and W_k Σᵢ ȳ(i)·x(i)·(Σ p x² − y²).
    let (y, bar) = one;
    let [mut off, mut norm, mut of_value, mut of_query] = [0.0_f64; 4];
    for i in 0..T {
        let q = f64::from(plain.x[i]);
        let sums = plain.x.iter().fold([0.0; 3], |s, x| {
            let x = f64::from(*x);
            let p = libm::exp(q * x);
            [s[0] + p, s[1] + p * x, s[2] + p * x * x]
        });
        let (mean, square, g) = (sums[1] / sums[0], sums[2] / sums[0], f64::from(y_bar[i]));
        off += (f64::from(y[i]) - mean) * (f64::from(y[i]) - mean);
        norm += mean * mean;
        of_value += g * mean;
        of_query += g * q * (square - mean * mean);
    }
    assert!((off / norm).sqrt() < 5e-6, "y: {:.1e}", (off / norm).sqrt());
    for (name, at, expected) in [("q", 0, of_query), ("k", 1, of_query), ("v", 2, of_value)] {
        let found = f64::from(bar.w_qkv[at]);
        assert!((found / expected - 1.0).abs() < 1e-4, "{name}: {found} and {expected}");
    }
}

/// Tokens and weights of a block of width 8 with two heads and a hidden width of 20.
struct Block {
    arrays: [Vec<f32>; 13],
    tokens: usize,
}

impl Block {
    fn new(tokens: usize) -> Self {
        let sizes = [8 * tokens, 8, 8, 192, 24, 64, 8, 8, 8, 160, 20, 160, 8];
        let scale = |i: usize| if i == 0 { 1.0 } else { 0.5 };
        let array = |i: usize| normals(sizes[i], 20 + i as u16).into_iter().map(|x| scale(i) * x).collect();
        Self { arrays: std::array::from_fn(array), tokens }
    }

    fn input(&self) -> block::In<'_> {
        let a = &self.arrays;
        block::In {
            x: &a[0],
            ln1_gain: &a[1],
            ln1_bias: &a[2],
            w_qkv: &a[3],
            b_qkv: &a[4],
            w_out: &a[5],
            b_out: &a[6],
            ln2_gain: &a[7],
            ln2_bias: &a[8],
            w_fc1: &a[9],
            b_fc1: &a[10],
            w_fc2: &a[11],
            b_fc2: &a[12],
            tokens: self.tokens,
            heads: 2,
            eps: 1e-6,
        }
    }

    fn run(&self, y_bar: &[f32]) -> (Vec<f32>, block::InBar) {
        let (x, mut y) = (self.input(), vec![0.0; 8 * self.tokens]);
        let saved = block::forward(&x, &mut y);
        let mut bar = block::InBar::zeros_like(&x);
        block::adjoint(&x, saved, y_bar, &mut bar);
        (y, bar)
    }
}

#[test]
fn a_block_has_the_same_bits_for_any_number_of_threads_and_with_nothing_saved() {
    for tokens in [1, 47, 48, 49, 300] {
        let (made, y_bar) = (Block::new(tokens), normals(8 * tokens, 40));
        let [one, three] =
            [1, 3].map(|threads| par::with_threads(threads, || made.run(&y_bar)).expect("threads"));
        assert!(one == three, "{tokens} tokens: the same bits");
        let mut y = vec![0.0; 8 * tokens];
        block::values(&made.input(), &mut y);
        assert!(y == one.0, "{tokens} tokens: the same bits with nothing saved");
    }
}

#[test]
fn a_block_is_the_sum_of_its_operators() {
    let (made, tokens) = (Block::new(70), 70);
    let x = made.input();
    let mut n = vec![0.0; 8 * tokens];
    layernorm::forward(&layernorm::In { x: x.x, gain: x.ln1_gain, bias: x.ln1_bias, eps: x.eps }, &mut n);
    let mut h = vec![0.0; 8 * tokens];
    let layer = In {
        x: &n,
        w_qkv: x.w_qkv,
        b_qkv: x.b_qkv,
        w_out: x.w_out,
        b_out: x.b_out,
        attended: &[],
        tokens,
        heads: 2,
    };
    attention::forward(&layer, &mut h);
    h.iter_mut().zip(x.x).for_each(|(h, x)| *h += x);
    layernorm::forward(&layernorm::In { x: &h, gain: x.ln2_gain, bias: x.ln2_bias, eps: x.eps }, &mut n);
    let (mut z, mut hidden) = (vec![0.0; 20 * tokens], vec![0.0; 20 * tokens]);
    let first = linear::In { x: &n, weight: x.w_fc1, bias: x.b_fc1, m: tokens, n: 20, k: 8 };
    linear::forward(first, &mut z);
    gelu::forward(&z, &mut hidden);
    let mut expected = vec![0.0; 8 * tokens];
    let second = linear::In { x: &hidden, weight: x.w_fc2, bias: x.b_fc2, m: tokens, n: 8, k: 20 };
    linear::forward(second, &mut expected);
    expected.iter_mut().zip(&h).for_each(|(y, h)| *y += h);
    let mut y = vec![0.0; 8 * tokens];
    block::values(&x, &mut y);
    assert!(y == expected, "the same bits");
}

#[test]
fn a_block_of_the_papers_width_agrees_with_its_twin() {
    // Width 1024, 16 heads, hidden width 4096, weights as large as at first; 3 tokens instead of 31 232.
    let (t, d, f) = (3, 1024, 4096);
    let shapes: [(&str, &[usize], f32); 13] = [
        ("x", &[t, d], 1.0),
        ("ln1_gain", &[d], 1.0),
        ("ln1_bias", &[d], 0.1),
        ("w_qkv", &[3 * d, d], 0.022),
        ("b_qkv", &[3 * d], 0.1),
        ("w_out", &[d, d], 0.02),
        ("b_out", &[d], 0.1),
        ("ln2_gain", &[d], 1.0),
        ("ln2_bias", &[d], 0.1),
        ("w_fc1", &[f, d], 0.02),
        ("b_fc1", &[f], 0.1),
        ("w_fc2", &[d, f], 0.02),
        ("b_fc2", &[d], 0.1),
    ];
    let mut call = Call::default();
    for (i, (name, shape, scale)) in shapes.into_iter().enumerate() {
        let values =
            normals(entries(shape), 60 + i as u16).into_iter().map(|x| scale * x).collect::<Vec<f32>>();
        call.inputs.put(name, shape, values);
    }
    call.settings.insert("heads".to_owned(), Setting::Number(16.0));
    call.cotangents = Arrays::new().with("y", &[t, d], normals(t * d, 80));
    let op = ops::LIST.iter().find(|op| op.name == "nn.block").expect("an operator");
    let (found, twin) = (ops::run(op, &call).expect("valid"), ops::run_f64(op, &call).expect("valid"));
    let error = |found: &Arrays, twin: &Arrays, name: &str| {
        let (a, b) =
            (found.get(name).expect("an array").to_f64(), twin.get(name).expect("an array").to_f64());
        let square = |x: f64| x * x;
        let off = a.iter().zip(&b).fold(0.0, |sum, (a, b)| sum + square(a - b));
        (off / b.iter().fold(0.0, |sum, b| sum + square(*b))).sqrt()
    };
    let y = error(&found.outputs, &twin.outputs, "y");
    assert!(y < 2e-6, "y: {y:.1e}");
    for (name, ..) in shapes {
        let e = error(&found.gradients, &twin.gradients, name);
        assert!(e < 2e-5, "gradient of {name}: {e:.1e}");
    }
}
