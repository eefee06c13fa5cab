//! Recorders of the operators of [`crate::nn`]: each runs one operator on values of a tape and records its
//! adjoint.

use super::{Bar, Tape, Var};
use crate::nn::{conv, linear};
use ndarray::{ArrayD, IxDyn};
use std::sync::Arc;

/// Input, weight and bias of a layer.
type Three = [Arc<ArrayD<f32>>; 3];

fn flat(array: &ArrayD<f32>) -> &[f32] {
    array.as_slice().expect("arrays on the tape are contiguous and row-major")
}

fn shaped(shape: &[usize], values: Vec<f32>) -> ArrayD<f32> {
    ArrayD::from_shape_vec(IxDyn(shape), values).expect("the size matches the shape")
}

/// Zeros of the size of the cotangent; empty if the cotangent is not needed.
fn room(into: &Bar<'_>, of: &ArrayD<f32>) -> Vec<f32> {
    if into.wanted() { vec![0.0; of.len()] } else { Vec::new() }
}

/// Adds gradients to the cotangents that are needed.
fn hand_over(into: &mut [Bar<'_>], arrays: &Three, bars: [Vec<f32>; 3]) {
    for ((into, array), bar) in into.iter_mut().zip(arrays).zip(bars) {
        if into.wanted() {
            into.add(shaped(array.shape(), bar));
        }
    }
}

fn linear_in(arrays: &Three) -> linear::In<'_> {
    let (&[m, k], &[n, _]) = (arrays[0].shape(), arrays[1].shape()) else {
        panic!("linear expects a matrix and a matrix of weights")
    };
    linear::In { x: flat(&arrays[0]), weight: flat(&arrays[1]), bias: flat(&arrays[2]), m, n, k }
}

/// y = x·Wᵀ + β, x (M, K), `weight` (N, K), `bias` (N), followed by a leaky ReLU if `slope` is given; see
/// [`crate::nn::linear`].
///
/// # Panics
/// When a shape is wrong.
pub fn linear(tape: &mut Tape, x: Var, weight: Var, bias: Var, slope: Option<f32>) -> Var {
    let arrays = [x, weight, bias].map(|v| tape.value(v));
    let input = linear_in(&arrays);
    let mut y = vec![0.0; input.m * input.n];
    match slope {
        Some(slope) => linear::forward_leaky(input, slope, &mut y),
        None => linear::forward(input, &mut y),
    }
    let y = Arc::new(shaped(&[input.m, input.n], y));
    let kept = slope.map(|slope| (slope, Arc::clone(&y)));
    tape.record("nn.linear", &[x, weight, bias], vec![y], move |mut bars, into| {
        let Some(mut y_bar) = bars[0].take() else { return };
        let [x, weight, bias] = [0, 1, 2].map(|i| room(&into[i], &arrays[i]));
        let mut bar = linear::InBar { x, weight, bias };
        match &kept {
            Some((slope, y)) => {
                let y_bar = y_bar.as_slice_mut().expect("contiguous and row-major");
                linear::adjoint_leaky(linear_in(&arrays), *slope, flat(y), y_bar, &mut bar);
            }
            None => linear::adjoint(linear_in(&arrays), flat(&y_bar), &mut bar),
        }
        hand_over(into, &arrays, [bar.x, bar.weight, bar.bias]);
    })[0]
}

fn conv_in(arrays: &Three, stride: usize, pad: usize) -> conv::In<'_> {
    let (&[batch, height, width, channels], &[outputs, kh, kw, _]) = (arrays[0].shape(), arrays[1].shape())
    else {
        panic!("conv expects images (B, H, W, C) and weights (O, KH, KW, C)")
    };
    let shape = conv::Shape { batch, height, width, channels, outputs, kernel: [kh, kw], stride, pad };
    conv::In { x: flat(&arrays[0]), weight: flat(&arrays[1]), bias: flat(&arrays[2]), shape }
}

/// A convolution, x (B, H, W, C), `weight` (O, KH, KW, C), `bias` (O), followed by a leaky ReLU of `slope`;
/// see [`crate::nn::conv`].
///
/// # Panics
/// When a shape is wrong.
pub fn conv(tape: &mut Tape, [x, weight, bias]: [Var; 3], [stride, pad]: [usize; 2], slope: f32) -> Var {
    let arrays = [x, weight, bias].map(|v| tape.value(v));
    let input = conv_in(&arrays, stride, pad);
    let [rows, columns] = input.shape.out().expect("the kernel fits into the padded image");
    let shape = [input.shape.batch, rows, columns, input.shape.outputs];
    let [batch, _, _, outputs] = shape;
    let mut y = vec![0.0; batch * rows * columns * outputs];
    conv::forward_leaky(input, slope, &mut y);
    let y = Arc::new(shaped(&shape, y));
    let result = Arc::clone(&y);
    tape.record("nn.conv", &[x, weight, bias], vec![y], move |bars, into| {
        let Some(y_bar) = &bars[0] else { return };
        let wanted = [0, 1, 2].map(|i| into[i].wanted());
        let input = conv_in(&arrays, stride, pad);
        let bar = conv::gradients_leaky(input, slope, flat(&result), flat(y_bar), wanted);
        hand_over(into, &arrays, [bar.x, bar.weight, bar.bias]);
    })[0]
}

/// Reshapes a value.
///
/// # Panics
/// When the sizes differ.
pub fn reshape(tape: &mut Tape, x: Var, shape: &[usize]) -> Var {
    let array = tape.value(x);
    let before = array.shape().to_vec();
    let y = shaped(shape, flat(&array).to_vec());
    tape.record("reshape", &[x], vec![y], move |mut bars, into| {
        if let Some(y_bar) = bars[0].take() {
            into[0].add(y_bar.into_shape_with_order(IxDyn(&before)).expect("the size is the same"));
        }
    })[0]
}
