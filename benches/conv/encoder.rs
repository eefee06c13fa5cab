//! The encoder at 64²: four convolutions 4×4 of stride 2, two dense layers, leaky ReLU between.

use super::{Timed, median, normals};
use lastlight::nn::conv::{self, Shape};
use lastlight::nn::{act, linear};

const BATCH: usize = 192;
const SLOPE: f32 = 0.2;
/// Name, side, channels, outputs.
const LAYERS: [(&str, usize, usize, usize); 4] =
    [("64x3", 64, 3, 32), ("32x32", 32, 32, 32), ("16x32", 16, 32, 64), ("8x64", 8, 64, 64)];
/// Inputs and outputs of the dense layers.
const DENSE: [[usize; 2]; 2] = [[1024, 256], [256, 32]];

fn shape(side: usize, channels: usize, outputs: usize) -> Shape {
    Shape { batch: BATCH, height: side, width: side, channels, outputs, kernel: [4, 4], stride: 2, pad: 1 }
}

/// 10⁹ operations of one pass over a convolution.
fn work(shape: &Shape) -> f64 {
    2e-9 * (shape.batch * shape.height * shape.width / 4 * shape.outputs * shape.taps()) as f64
}

/// Each convolution alone.
pub(super) fn layers(runs: usize) -> Vec<Timed> {
    let layer = |&(name, side, channels, outputs): &(&'static str, usize, usize, usize)| {
        let shape = shape(side, channels, outputs);
        let x = normals(BATCH * side * side * channels, 1);
        let (weight, bias) = (normals(outputs * shape.taps(), 2), normals(outputs, 3));
        let input = conv::In { x: &x, weight: &weight, bias: &bias, shape };
        let size = BATCH * side * side / 4 * outputs;
        let (mut y, y_bar, mut bar) = (vec![0.0; size], normals(size, 4), conv::InBar::zeros_like(&input));
        if channels == 3 {
            bar.x = Vec::new(); // photos need no gradient
        }
        let one = median(runs, || conv::forward(input, &mut y));
        let both = median(runs, || {
            conv::forward(input, &mut y);
            conv::adjoint(input, &y_bar, &mut bar);
        });
        let passes = if channels == 3 { 2.0 } else { 3.0 };
        Timed { name, seconds: [one, both], work: [work(&shape), passes * work(&shape)] }
    };
    LAYERS.iter().map(layer).collect()
}

/// Weights, biases and outputs of all layers.
struct Encoder {
    weights: Vec<[Vec<f32>; 2]>,
    results: Vec<Vec<f32>>,
}

impl Encoder {
    fn new() -> Self {
        let scaled = |n, k: usize, purpose| -> Vec<f32> {
            normals(n, purpose).into_iter().map(|w| w / (k as f32).sqrt()).collect()
        };
        let (mut weights, mut results) = (Vec::new(), Vec::new());
        for (_, side, channels, outputs) in LAYERS {
            weights.push([scaled(outputs * 16 * channels, 16 * channels, 5), vec![0.1; outputs]]);
            results.push(vec![0.0; BATCH * side * side / 4 * outputs]);
        }
        for [k, n] in DENSE {
            weights.push([scaled(n * k, k, 6), vec![0.1; n]]);
            results.push(vec![0.0; BATCH * n]);
        }
        Self { weights, results }
    }

    fn conv<'a>(&'a self, i: usize, x: &'a [f32]) -> conv::In<'a> {
        let (_, side, channels, outputs) = LAYERS[i];
        let [weight, bias] = &self.weights[i];
        conv::In { x, weight, bias, shape: shape(side, channels, outputs) }
    }

    fn dense<'a>(&'a self, i: usize, x: &'a [f32]) -> linear::In<'a> {
        let [k, n] = DENSE[i - LAYERS.len()];
        let [weight, bias] = &self.weights[i];
        linear::In { x, weight, bias, m: BATCH, n, k }
    }

    fn forward(&mut self, pictures: &[f32]) {
        for i in 0..self.weights.len() {
            let mut y = std::mem::take(&mut self.results[i]);
            let x = if i == 0 { pictures } else { &self.results[i - 1] };
            if i < LAYERS.len() {
                conv::forward_leaky(self.conv(i, x), SLOPE, &mut y);
            } else if i + 1 < self.weights.len() {
                linear::forward_leaky(self.dense(i, x), SLOPE, &mut y);
            } else {
                linear::forward(self.dense(i, x), &mut y);
            }
            self.results[i] = y;
        }
    }

    /// Gradients of all weights.
    fn adjoint(&self, pictures: &[f32], y_bar: &[f32]) -> Vec<[Vec<f32>; 2]> {
        let mut grads = Vec::new();
        let mut bar = y_bar.to_vec();
        for i in (0..self.weights.len()).rev() {
            let x = if i == 0 { pictures } else { &self.results[i - 1] };
            if i < LAYERS.len() {
                let wanted = [i > 0, true, true]; // photos need no gradient
                let into = conv::gradients_leaky(self.conv(i, x), SLOPE, &self.results[i], &bar, wanted);
                bar = into.x;
                grads.push([into.weight, into.bias]);
            } else {
                if i + 1 < self.weights.len() {
                    act::leaky_relu_back(&self.results[i], SLOPE, &mut bar);
                }
                let mut into = linear::InBar::zeros_like(&self.dense(i, x));
                linear::adjoint(self.dense(i, x), &bar, &mut into);
                bar = into.x;
                grads.push([into.weight, into.bias]);
            }
        }
        grads
    }
}

/// The complete encoder, as in one training step.
pub(super) fn whole(runs: usize) -> Vec<Timed> {
    let (mut encoder, pictures, y_bar) =
        (Encoder::new(), normals(BATCH * 64 * 64 * 3, 7), normals(BATCH * 32, 8));
    let one = median(runs, || encoder.forward(&pictures));
    let both = median(runs, || {
        encoder.forward(&pictures);
        std::hint::black_box(encoder.adjoint(&pictures, &y_bar));
    });
    let first = work(&shape(64, 3, 32));
    let mut each = 2e-9 * (BATCH * (1024 * 256 + 256 * 32)) as f64;
    for (_, side, channels, outputs) in LAYERS {
        each += work(&shape(side, channels, outputs));
    }
    vec![Timed { name: "encoder", seconds: [one, both], work: [each, 3.0 * each - first] }]
}
