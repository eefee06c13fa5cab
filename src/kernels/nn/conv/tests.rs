//! Bit-exact tests of `nn.conv`: the documented chains, fused passes, and batches in parts.

use super::*;
use crate::nn::act::leaky_relu;
use crate::num::rng::Rng;

fn normals(n: usize, draw: u32) -> Vec<f32> {
    let rng = Rng::new(9);
    (0..n).map(|i| rng.normal_f32(i as u64, draw, 12, 0)).collect()
}

const SHAPES: [Shape; 6] = [
    Shape { batch: 5, height: 16, width: 12, channels: 3, outputs: 20, kernel: [4, 4], stride: 2, pad: 1 },
    Shape { batch: 2, height: 9, width: 7, channels: 33, outputs: 5, kernel: [3, 2], stride: 1, pad: 2 },
    Shape { batch: 3, height: 11, width: 13, channels: 2, outputs: 17, kernel: [2, 3], stride: 4, pad: 0 },
    // padding wider than the kernel, windows without pixels, and filters longer than one chunk of a chain
    Shape { batch: 1, height: 3, width: 2, channels: 700, outputs: 3, kernel: [3, 2], stride: 2, pad: 4 },
    // more items than are prepared together; more pixels than are summed in registers
    Shape { batch: 18, height: 6, width: 8, channels: 4, outputs: 33, kernel: [4, 4], stride: 2, pad: 1 },
    Shape { batch: 2, height: 40, width: 36, channels: 3, outputs: 32, kernel: [4, 4], stride: 2, pad: 1 },
];

/// Every entry by the chain that the page describes.
fn by_the_page(x: &In<'_>, [r, q, o]: [usize; 3]) -> f32 {
    let Shape { height, width, channels, kernel: [kh, kw], stride, pad, .. } = x.shape;
    let mut chunks = vec![0.0_f32];
    for (k, (i, j, c)) in
        (0..kh).flat_map(|i| (0..kw).flat_map(move |j| (0..channels).map(move |c| (i, j, c)))).enumerate()
    {
        if k > 0 && k % 4096 == 0 {
            chunks.push(0.0);
        }
        let at = [r * stride + i, q * stride + j].map(|at| at.checked_sub(pad));
        let seen = match at {
            [Some(h), Some(w)] if h < height && w < width => x.x[(h * width + w) * channels + c],
            _ => 0.0,
        };
        *chunks.last_mut().expect("one chunk at least") +=
            seen * x.weight[((o * kh + i) * kw + j) * channels + c];
    }
    crate::num::sum::tree_f32(&chunks) + x.bias[o]
}

#[test]
fn outputs_are_the_chains_of_the_page_in_bits() {
    for shape in SHAPES {
        let [rows, columns] = shape.out().expect("the kernel fits");
        let x = normals(shape.batch * shape.height * shape.width * shape.channels, 0);
        let (weight, bias) = (normals(shape.outputs * shape.taps(), 1), normals(shape.outputs, 2));
        let input = In { x: &x, weight: &weight, bias: &bias, shape };
        let mut y = vec![0.0; shape.batch * rows * columns * shape.outputs];
        forward(input, &mut y);
        for (at, y) in y.iter().enumerate().take(rows * columns * shape.outputs) {
            let o = at % shape.outputs;
            let pixel = at / shape.outputs;
            let want = by_the_page(&input, [pixel / columns, pixel % columns, o]);
            assert_eq!(y.to_bits(), want.to_bits(), "{shape:?} entry {at}");
        }
    }
}

#[test]
fn gradients_of_weight_and_bias_are_the_chains_of_the_page_in_bits() {
    for shape in SHAPES {
        let Shape { batch, height, width, channels, outputs, kernel: [_, kw], stride, pad } = shape;
        let [rows, columns] = shape.out().expect("the kernel fits");
        let x = normals(batch * height * width * channels, 13);
        let (weight, bias) = (normals(outputs * shape.taps(), 14), normals(outputs, 15));
        let y_bar = normals(batch * rows * columns * outputs, 16);
        let mut bar = InBar { x: Vec::new(), weight: normals(weight.len(), 17), bias: normals(outputs, 18) };
        let mut want = bar.clone();
        assert!(rows * columns <= 4096, "one chunk");
        for b in 0..batch {
            let g = |pixel: usize, o: usize| y_bar[(b * rows * columns + pixel) * outputs + o];
            for (at, want) in want.weight.iter_mut().enumerate() {
                let (o, tap) = (at / shape.taps(), at % shape.taps());
                let (i, j, c) = (tap / channels / kw, tap / channels % kw, tap % channels);
                *want += (0..rows * columns).fold(0.0_f32, |sum, pixel| {
                    let at = [pixel / columns * stride + i, pixel % columns * stride + j];
                    let seen = match at.map(|at| at.checked_sub(pad)) {
                        [Some(h), Some(w)] if h < height && w < width => {
                            x[((b * height + h) * width + w) * channels + c]
                        }
                        _ => 0.0,
                    };
                    sum + seen * g(pixel, o)
                });
            }
            for (o, want) in want.bias.iter_mut().enumerate() {
                *want += (0..rows * columns).fold(0.0_f32, |sum, pixel| sum + g(pixel, o));
            }
        }
        adjoint(In { x: &x, weight: &weight, bias: &bias, shape }, &y_bar, &mut bar);
        let bits = |x: &[f32]| -> Vec<u32> { x.iter().map(|x| x.to_bits()).collect() };
        assert_eq!(bits(&bar.weight), bits(&want.weight), "{shape:?}: weight");
        assert_eq!(bits(&bar.bias), bits(&want.bias), "{shape:?}: bias");
    }
}

#[test]
fn one_pass_with_the_leaky_relu_has_the_bits_of_two() {
    for shape in SHAPES {
        let [rows, columns] = shape.out().expect("the kernel fits");
        let x = normals(shape.batch * shape.height * shape.width * shape.channels, 3);
        let (weight, bias) = (normals(shape.outputs * shape.taps(), 4), normals(shape.outputs, 5));
        let input = In { x: &x, weight: &weight, bias: &bias, shape };
        let size = shape.batch * rows * columns * shape.outputs;
        let (mut before, mut after, mut once) = (vec![0.0; size], vec![0.0; size], vec![0.0; size]);
        forward(input, &mut before);
        leaky_relu(&before, 0.2, &mut after);
        forward_leaky(input, 0.2, &mut once);
        assert_eq!(once, after, "{shape:?}: results");
        let y_bar = normals(size, 6);
        let mut middle = vec![0.0; size];
        crate::nn::act::leaky_relu_adjoint(&before, 0.2, &y_bar, &mut middle);
        let mut two = InBar::zeros_like(&input);
        adjoint(input, &middle, &mut two);
        let one = gradients_leaky(input, 0.2, &once, &y_bar, [true; 3]);
        assert_eq!(one, two, "{shape:?}: gradients");
        let some = gradients_leaky(input, 0.2, &once, &y_bar, [false, true, false]);
        assert_eq!(some.weight, two.weight, "{shape:?}: the weight's gradient alone");
        assert!(
            some.x.is_empty() && some.bias.is_empty(),
            "{shape:?}: gradients that are not requested are empty"
        );
    }
}

#[test]
fn a_batch_may_be_split_into_consecutive_parts() {
    let shape = SHAPES[0];
    let [rows, columns] = shape.out().expect("the kernel fits");
    let item = [shape.height * shape.width * shape.channels, rows * columns * shape.outputs];
    let x = normals(shape.batch * item[0], 7);
    let (weight, bias) = (normals(shape.outputs * shape.taps(), 8), normals(shape.outputs, 9));
    let y_bar = normals(shape.batch * item[1], 10);
    let whole = In { x: &x, weight: &weight, bias: &bias, shape };
    let mut want = InBar::zeros_like(&whole);
    adjoint(whole, &y_bar, &mut want);
    let mut got = InBar { x: Vec::new(), ..InBar::zeros_like(&whole) };
    for part in [0..2, 2..3, 3..5] {
        let shape = Shape { batch: part.len(), ..shape };
        let x = &x[part.start * item[0]..part.end * item[0]];
        adjoint(In { x, shape, ..whole }, &y_bar[part.start * item[1]..part.end * item[1]], &mut got);
    }
    assert_eq!(got.weight, want.weight, "weights");
    assert_eq!(got.bias, want.bias, "biases");
}
