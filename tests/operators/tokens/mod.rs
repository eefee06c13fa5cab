//! From images to tokens and back: closed forms, transposes, first values, batches, refused sizes.

mod rays;
mod torch;

use crate::chains::{assert_same_bits, three_loops, values};
use lastlight::nn::{conv, fuse, gelu, layernorm, linear, tokens, unpatch};
use lastlight::num::array::entries;
use lastlight::num::par;
use lastlight::ops::{self, Call, Case};

/// Arrays of `nn.tokens`.
struct Pixels {
    image: Vec<f32>,
    rays: Vec<f32>,
    photo: Vec<f32>,
    weights: [Vec<f32>; 3],
    rows: [Vec<f32>; 3],
    shape: tokens::Shape,
}

impl Pixels {
    fn new(shape: tokens::Shape, d: usize) -> Self {
        let pixels = shape.views * shape.height * shape.width;
        let taps = d * shape.patch * shape.patch;
        Self {
            image: values(3 * pixels, 1),
            rays: values(6 * pixels, 2),
            photo: values(3 * pixels, 3),
            weights: [values(3 * taps, 4), values(6 * taps, 5), values(3 * taps, 6)],
            rows: [values(d, 7), values(d, 8), values(d, 9)],
            shape,
        }
    }

    fn input(&self) -> tokens::In<'_> {
        let ([w_image, w_rays, w_photo], [bias, norm_gain, norm_bias]) = (&self.weights, &self.rows);
        tokens::In {
            image: &self.image,
            rays: &self.rays,
            photo: &self.photo,
            w_image,
            w_rays,
            w_photo,
            bias,
            norm_gain,
            norm_bias,
            eps: 1e-6,
            shape: self.shape,
        }
    }
}

/// Tokens, and the gradients for a cotangent.
fn both(x: &tokens::In<'_>, y_bar: &[f32]) -> (Vec<f32>, tokens::InBar) {
    let mut y = vec![0.0; y_bar.len()];
    let saved = tokens::forward(x, &mut y);
    let mut bar = tokens::InBar::zeros_like(x);
    tokens::adjoint(x, &saved, y_bar, &mut bar);
    (y, bar)
}

const ONE: tokens::Shape = tokens::Shape { views: 1, height: 16, width: 24, patch: 8 };

#[test]
fn tokens_are_one_linear_layer_over_rows_of_pixels() {
    let (d, k) = (21, 12 * 64);
    let pixels = Pixels::new(ONE, d);
    let x = pixels.input();
    // The row of a token, and of a weight: all numbers of the image's square, then of the rays', then of the photo's.
    let arrays = [(x.image, 3), (x.rays, 6), (x.photo, 3)];
    let mut rows = Vec::new();
    for token in 0..6 {
        for (array, channels) in arrays {
            for at in 0..64 {
                let pixel = (token / 3 * 8 + at / 8) * 24 + token % 3 * 8 + at % 8;
                rows.extend_from_slice(&array[pixel * channels..][..channels]);
            }
        }
    }
    let mut weight = Vec::new();
    for o in 0..d {
        for (part, w) in pixels.weights.iter().enumerate() {
            weight.extend_from_slice(&w[o * 64 * arrays[part].1..][..64 * arrays[part].1]);
        }
    }
    let layer = linear::In { x: &rows, weight: &weight, bias: x.bias, m: 6, n: d, k };
    let mut z = vec![0.0; 6 * d];
    linear::forward(layer, &mut z);
    let norm = layernorm::In { x: &z, gain: x.norm_gain, bias: x.norm_bias, eps: 1e-6 };
    let mut expected = vec![0.0; 6 * d];
    let saved = layernorm::forward(&norm, &mut expected);

    let y_bar = values(6 * d, 10);
    let (y, bar) = both(&x, &y_bar);
    assert_same_bits(&y, &expected, "tokens");
    let mut norm_bar = layernorm::InBar::zeros_like(&norm);
    layernorm::adjoint(&norm, &saved, &y_bar, &mut norm_bar);
    let mut layer_bar = linear::InBar::zeros_like(&layer);
    linear::adjoint(layer, &norm_bar.x, &mut layer_bar);
    assert_same_bits(&bar.norm_gain, &norm_bar.gain, "gain");
    assert_same_bits(&bar.norm_bias, &norm_bar.bias, "bias of the norm");
    assert_same_bits(&bar.bias, &layer_bar.bias, "bias");
    let of_weights: Vec<f32> = (0..d)
        .flat_map(|o| {
            [(&bar.w_image, 192), (&bar.w_rays, 384), (&bar.w_photo, 192)]
                .into_iter()
                .flat_map(move |(w, taps)| w[o * taps..(o + 1) * taps].to_vec())
        })
        .collect();
    assert_same_bits(&of_weights, &layer_bar.weight, "weights");
    let of_rays: Vec<f32> = (0..6).flat_map(|t| layer_bar.x[t * k + 192..t * k + 576].to_vec()).collect();
    for (at, expected) in of_rays.iter().enumerate() {
        let (token, tap) = (at / 384, at % 384);
        let pixel = (token / 3 * 8 + tap / 48) * 24 + token % 3 * 8 + tap / 6 % 8;
        assert_eq!(bar.rays[pixel * 6 + tap % 6].to_bits(), expected.to_bits(), "rays, {at}");
    }
}

#[test]
fn patches_of_a_constant_image_are_alike_and_places_are_independent() {
    let mut pixels = Pixels::new(ONE, 5);
    let first = values(12, 20);
    for (array, at, channels) in
        [(&mut pixels.image, 0, 3), (&mut pixels.rays, 3, 6), (&mut pixels.photo, 9, 3)]
    {
        array.chunks_exact_mut(channels).for_each(|pixel| pixel.copy_from_slice(&first[at..][..channels]));
    }
    let y_bar = values(30, 21);
    let (alike, _) = both(&pixels.input(), &y_bar);
    assert!(alike.chunks_exact(5).all(|token| token == &alike[..5]), "{alike:?}");
    // One pixel in the fifth square: row 9, column 10.
    pixels.rays[(9 * 24 + 10) * 6 + 5] += 1.0;
    let (other, _) = both(&pixels.input(), &y_bar);
    let changed: Vec<bool> = other.chunks_exact(5).map(|token| token != &alike[..5]).collect();
    assert_eq!(changed, [false, false, false, false, true, false]);
}

#[test]
fn photo_weights_of_0_change_nothing_until_they_learn() {
    let mut pixels = Pixels::new(ONE, 7);
    pixels.weights[2].fill(0.0);
    let (with, y_bar) = (pixels.input(), values(42, 30));
    let without = tokens::In { photo: &[], w_photo: &[], ..with };
    let [(y, bar), (same_y, same_bar)] = [both(&with, &y_bar), both(&without, &y_bar)];
    assert_same_bits(&y, &same_y, "tokens");
    assert_same_bits(&bar.w_image, &same_bar.w_image, "weights of the image");
    assert_same_bits(&bar.rays, &same_bar.rays, "rays");
    assert!(same_bar.photo.is_empty() && same_bar.w_photo.is_empty(), "no photo, no gradient");
    assert!(bar.photo.iter().all(|g| *g == 0.0), "nothing depends on the photo");
    assert!(bar.w_photo.iter().all(|g| *g != 0.0), "its weights have a gradient");
}

#[test]
fn a_batch_of_views_is_its_views_one_after_another() {
    let shape = tokens::Shape { views: 3, height: 32, width: 40, patch: 2 };
    let (d, of_view) = (19, 320 * 19);
    let pixels = Pixels::new(shape, d);
    let x = pixels.input();
    let y_bar = values(3 * of_view, 40);
    let at_once = || both(&x, &y_bar);
    let [(y, bar), threads] = [1, 3].map(|n| par::with_threads(n, at_once).expect("threads"));
    assert!((&y, &bar) == (&threads.0, &threads.1), "the same bits for any number of threads");

    let mut parts = tokens::InBar::zeros_like(&x);
    let mut of_pixels = [Vec::new(), Vec::new(), Vec::new()];
    for view in 0..3 {
        let pick = |array, channels| -> &[f32] {
            let array: &[f32] = array;
            &array[view * 1280 * channels..(view + 1) * 1280 * channels]
        };
        let one = tokens::In {
            image: pick(x.image, 3),
            rays: pick(x.rays, 6),
            photo: pick(x.photo, 3),
            shape: tokens::Shape { views: 1, ..shape },
            ..x
        };
        let mut own = vec![0.0; of_view];
        let saved = tokens::forward(&one, &mut own);
        assert_same_bits(&own, &y[view * of_view..][..of_view], "tokens");
        (parts.image, parts.rays) = (vec![0.0; 3840], vec![0.0; 7680]);
        parts.photo = vec![0.0; 3840];
        tokens::adjoint(&one, &saved, &y_bar[view * of_view..][..of_view], &mut parts);
        of_pixels[0].append(&mut parts.image);
        of_pixels[1].append(&mut parts.rays);
        of_pixels[2].append(&mut parts.photo);
    }
    [parts.image, parts.rays, parts.photo] = of_pixels;
    assert!(parts == bar, "the same bits");
}

/// Arrays of `nn.fuse` for 33 tokens of 6 numbers and 11 hidden ones.
fn fuse_arrays() -> [Vec<f32>; 6] {
    [33 * 6, 33 * 6, 11 * 12, 11, 6 * 11, 6].map(|n| values(n, 50 + n as u64))
}

fn fuse_in(arrays: &[Vec<f32>; 6], rule: fuse::Rule) -> fuse::In<'_> {
    let [state, position, w1, b1, w2, b2] = arrays;
    fuse::In { state, position, w1, b1, w2, b2, rule }
}

#[test]
fn fuse_is_linear_gelu_linear_over_joined_rows() {
    let arrays = fuse_arrays();
    let published = fuse_in(&arrays, fuse::Rule::Published);
    let rows: Vec<f32> = (0..33)
        .flat_map(|t| [&published.state[t * 6..][..6], &published.position[t * 6..][..6]].concat())
        .collect();
    let [mut before, mut after] = [vec![0.0; 33 * 11], vec![0.0; 33 * 11]];
    let mut expected = vec![0.0; 33 * 6];
    linear::forward(
        linear::In { x: &rows, weight: published.w1, bias: published.b1, m: 33, n: 11, k: 12 },
        &mut before,
    );
    gelu::forward(&before, &mut after);
    linear::forward(
        linear::In { x: &after, weight: published.w2, bias: published.b2, m: 33, n: 6, k: 11 },
        &mut expected,
    );
    let mut y = vec![0.0; 33 * 6];
    fuse::forward(&published, &mut y);
    assert_same_bits(&y, &expected, "published");
    let residual = fuse_in(&arrays, fuse::Rule::Residual);
    fuse::forward(&residual, &mut y);
    expected.iter_mut().zip(residual.position).for_each(|(u, p)| *u += p);
    assert_same_bits(&y, &expected, "residual");
}

#[test]
fn fuse_at_the_published_first_values_leaves_the_learned_tokens() {
    let mut arrays = fuse_arrays();
    arrays[4].fill(0.0);
    arrays[5].fill(0.0);
    let x = fuse_in(&arrays, fuse::Rule::Residual);
    let y_bar = values(33 * 6, 60);
    let mut y = vec![0.0; 33 * 6];
    let saved = fuse::forward(&x, &mut y);
    assert_eq!(y, x.position, "whatever the state is");
    let mut bar = fuse::InBar::zeros_like(&x);
    fuse::adjoint(&x, &saved, &y_bar, &mut bar);
    assert_eq!(bar.position, y_bar);
    assert!(bar.state.iter().chain(&bar.w1).chain(&bar.b1).all(|g| *g == 0.0), "behind W₂ = 0");
    assert!(bar.w2.iter().all(|g| *g != 0.0), "the last layer has a gradient");
    // A gradient that is not requested changes no other.
    let mut wanted = fuse::InBar { state: Vec::new(), ..fuse::InBar::zeros_like(&x) };
    fuse::adjoint(&x, &saved, &y_bar, &mut wanted);
    assert!(wanted == fuse::InBar { state: Vec::new(), ..bar }, "the same bits");
}

#[test]
fn fuse_without_a_state_reads_the_columns_of_the_learned_tokens_alone() {
    let mut arrays = fuse_arrays();
    arrays[0].fill(0.0);
    let x = fuse_in(&arrays, fuse::Rule::Published);
    let [mut y, mut other] = [vec![0.0; 33 * 6], vec![0.0; 33 * 6]];
    fuse::forward(&x, &mut y);
    let mut w1 = x.w1.to_vec();
    w1.chunks_exact_mut(12).for_each(|row| row[..6].fill(5.0));
    fuse::forward(&fuse::In { w1: &w1, ..x }, &mut other);
    assert_same_bits(&y, &other, "tokens");
}

/// Integers from −3 to 3: sums of a few thousand of their products are exact in f32.
fn integers(n: usize, seed: u64) -> Vec<f32> {
    values(n, seed).into_iter().map(|x| (3.5 * x).trunc()).collect()
}

#[test]
fn unpatch_is_the_transpose_of_the_patch_convolution() {
    let (d, shape) = (9, unpatch::Shape { grids: 2, height: 3, width: 2, patch: 4, channels: 5 });
    let (weight, cells) = (integers(d * 80, 70), integers(2 * 6 * d, 71));
    let texels = integers(2 * 12 * 8 * 5, 72);
    let patches = conv::Shape {
        batch: 2,
        height: 12,
        width: 8,
        channels: 5,
        outputs: d,
        kernel: [4, 4],
        stride: 4,
        pad: 0,
    };
    let mut convolved = vec![0.0; cells.len()];
    conv::forward(conv::In { x: &texels, weight: &weight, bias: &[], shape: patches }, &mut convolved);
    let mut made = vec![0.0; texels.len()];
    unpatch::forward(&unpatch::In { tokens: &cells, weight: &weight, bias: &[0.0; 5], shape }, &mut made);
    let inner = |a: &[f32], b: &[f32]| a.iter().zip(b).fold(0.0, |sum, (a, b)| sum + f64::from(a * b));
    let (left, right) = (inner(&convolved, &cells), inner(&texels, &made));
    assert!(left == right && left != 0.0, "⟨Ax, y⟩ = {left}, ⟨x, Aᵀy⟩ = {right}");
}

#[test]
fn unpatch_is_its_definition_in_bits() {
    let (d, shape) = (23, unpatch::Shape { grids: 2, height: 20, width: 18, patch: 4, channels: 17 });
    let (cells, weight, bias) = (values(720 * d, 80), values(d * 16 * 17, 81), values(17, 82));
    let x = unpatch::In { tokens: &cells, weight: &weight, bias: &bias, shape };
    let mut y = vec![0.0; 2 * 80 * 72 * 17];
    par::with_threads(3, || unpatch::forward(&x, &mut y)).expect("threads");
    let taps = 16 * 17;
    let products = three_loops(720, taps, d, |t, k| cells[t * d + k], |k, tap| weight[k * taps + tap]);
    for (at, y) in y.iter().enumerate() {
        let (n, row, column, c) = (at / (80 * 72 * 17), at / (72 * 17) % 80, at / 17 % 72, at % 17);
        let token = (n * 20 + row / 4) * 18 + column / 4;
        let expected = products[token * taps + (row % 4 * 4 + column % 4) * 17 + c] + bias[c];
        assert_eq!(y.to_bits(), expected.to_bits(), "texel {at}");
    }
    // The grids of a batch, in consecutive calls and on three threads.
    let y_bar = values(y.len(), 83);
    let mut bar = unpatch::InBar::zeros_like(&x);
    par::with_threads(3, || unpatch::adjoint(&x, &y_bar, &mut bar)).expect("threads");
    let mut parts = unpatch::InBar::zeros_like(&x);
    let mut of_tokens = Vec::new();
    for n in 0..2 {
        let one = unpatch::In {
            tokens: &cells[n * 360 * d..][..360 * d],
            shape: unpatch::Shape { grids: 1, ..shape },
            ..x
        };
        parts.tokens = vec![0.0; 360 * d];
        unpatch::adjoint(&one, &y_bar[n * y.len() / 2..][..y.len() / 2], &mut parts);
        of_tokens.append(&mut parts.tokens);
    }
    parts.tokens = of_tokens;
    assert!(parts == bar, "the same bits");
    // Tokens of 0 give the bias.
    unpatch::forward(&unpatch::In { tokens: &vec![0.0; 720 * d], ..x }, &mut y);
    assert!(
        y.chunks_exact(17).all(|texel| texel.iter().zip(&bias).all(|(y, b)| y == b)),
        "the bias everywhere"
    );
}

/// A case of an operator with one array replaced or removed; returns the message.
fn refused(op: &str, case: usize, name: &str, shape: Option<&[usize]>) -> String {
    let op = ops::find(op).expect("on the list");
    let Case { mut inputs, settings } = (op.case)(case);
    match shape {
        Some(shape) => inputs.put(name, shape, vec![0.5_f32; entries(shape)]),
        None => drop(inputs.0.remove(name)),
    }
    let call = Call { inputs, settings, ..Call::default() };
    ops::run(op, &call).expect_err("refused").to_string()
}

#[test]
fn wrong_sizes_are_refused() {
    let tokens_with = |name: &str, shape: Option<&[usize]>| refused("nn.tokens", 1, name, shape);
    let message = tokens_with("image", Some(&[2, 5, 9, 3]));
    assert!(message.contains("array 'rays'") && message.contains("H = 5"), "{message}");
    for (missing, there) in [("photo", "w_photo"), ("w_photo", "photo")] {
        let message = tokens_with(missing, None);
        assert!(message.contains(&format!("array '{there}'")), "{message}");
    }
    let op = ops::find("nn.tokens").expect("on the list");
    let Case { mut inputs, settings } = (op.case)(0);
    for (name, channels) in [("image", 3), ("rays", 6)] {
        inputs.put(name, &[1, 5, 6, channels], vec![0.5_f32; 30 * channels]);
    }
    let error = ops::run(op, &Call { inputs, settings, ..Call::default() }).expect_err("refused").to_string();
    assert!(error.contains("multiples of the patch") && error.contains("5x6 pixels, patch 2"), "{error}");
    let error = refused("nn.fuse", 0, "w1", Some(&[4, 7]));
    assert!(error.contains("6 columns") && error.contains('7'), "{error}");
    let error = refused("nn.unpatch", 0, "weight", Some(&[5, 2, 3, 3]));
    assert!(error.contains("weight"), "{error}");
}
