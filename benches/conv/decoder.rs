//! The decoder of points: 27 → 128 → 128 → 64 → 6 for 256 points of each of 256 items, the term of the
//! factors once per item.

use super::{Timed, median, normals};
use lastlight::nn::{act, linear};
use lastlight::num::par;

const BATCH: usize = 256;
const POINTS: usize = 256;
const SLOPE: f32 = 0.2;
const WIDTHS: [usize; 5] = [27, 128, 128, 64, 6];
const LATENT: usize = 16;
/// Items whose gradients are held at a time.
const HELD: usize = 16;

struct Decoder {
    weights: Vec<Vec<f32>>,
    biases: Vec<Vec<f32>>,
    latent: Vec<f32>,
}

impl Decoder {
    fn new() -> Self {
        let scaled = |n, k: usize, purpose| -> Vec<f32> {
            normals(n, purpose).into_iter().map(|w| w / (k as f32).sqrt()).collect()
        };
        Self {
            weights: (0..4).map(|i| scaled(WIDTHS[i] * WIDTHS[i + 1], WIDTHS[i], 20 + i as u16)).collect(),
            biases: (0..4).map(|i| vec![0.1; WIDTHS[i + 1]]).collect(),
            latent: scaled(LATENT * WIDTHS[1], LATENT, 24),
        }
    }

    fn layer<'a>(&'a self, i: usize, x: &'a [f32], bias: &'a [f32]) -> linear::In<'a> {
        linear::In { x, weight: &self.weights[i], bias, m: POINTS, n: WIDTHS[i + 1], k: WIDTHS[i] }
    }

    fn factors<'a>(&'a self, z: &'a [f32]) -> linear::In<'a> {
        linear::In { x: z, weight: &self.latent, bias: &self.biases[0], m: 1, n: WIDTHS[1], k: LATENT }
    }

    /// Outputs of each layer for one item.
    fn forward(&self, codes: &[f32], z: &[f32]) -> [Vec<f32>; 4] {
        let mut shift = vec![0.0; WIDTHS[1]];
        linear::forward(self.factors(z), &mut shift);
        let mut results = [1, 2, 3, 4].map(|i| vec![0.0; POINTS * WIDTHS[i]]);
        for i in 0..4 {
            let (before, after) = results.split_at_mut(i);
            let x = self.layer(
                i,
                before.last().map_or(codes, |h| h),
                if i == 0 { &shift } else { &self.biases[i] },
            );
            if i < 3 {
                linear::forward_leaky(x, SLOPE, &mut after[0]);
            } else {
                linear::forward(x, &mut after[0]);
            }
        }
        results
    }

    /// Gradients of one item: weights and biases of the layers, the factors' weights and the factors.
    fn item(&self, codes: &[f32], z: &[f32], y_bar: &[f32]) -> Vec<Vec<f32>> {
        let results = self.forward(codes, z);
        let (mut grads, mut bar) = (Vec::new(), y_bar.to_vec());
        for i in (0..4).rev() {
            if i < 3 {
                act::leaky_relu_back(&results[i], SLOPE, &mut bar);
            }
            let x = self.layer(i, if i == 0 { codes } else { &results[i - 1] }, &self.biases[i]);
            let mut into = linear::InBar::zeros_like(&x);
            if i == 0 {
                into.x = Vec::new(); // codes of coordinates need no gradient
            }
            linear::adjoint(x, &bar, &mut into);
            bar = into.x;
            grads.extend([into.weight, into.bias]);
        }
        let x = linear::In { bias: &[], ..self.factors(z) };
        let mut into = linear::InBar::zeros_like(&x);
        linear::adjoint(x, grads.last().expect("the first bias"), &mut into);
        grads.extend([into.weight, into.x]);
        grads
    }

    /// Gradients of a batch, items added in index order.
    fn step(&self, codes: &[f32], z: &[f32], y_bar: &[f32]) -> Vec<Vec<f32>> {
        let mut sums: Vec<Vec<f32>> = Vec::new();
        for first in (0..BATCH).step_by(HELD) {
            let items = par::map(HELD, |i| {
                let b = first + i;
                let bar = &y_bar[b * POINTS * WIDTHS[4]..][..POINTS * WIDTHS[4]];
                self.item(of(b, codes, POINTS * WIDTHS[0]), of(b, z, LATENT), bar)
            });
            for grads in items {
                if sums.is_empty() {
                    sums = grads;
                    continue;
                }
                for (sum, grad) in sums.iter_mut().flatten().zip(grads.iter().flatten()) {
                    *sum += *grad;
                }
            }
        }
        sums
    }
}

/// Numbers of item `b`, `n` for each.
fn of(b: usize, values: &[f32], n: usize) -> &[f32] {
    &values[b * n..][..n]
}

/// The complete decoder, as in one training step.
pub(super) fn whole(runs: usize) -> Vec<Timed> {
    let decoder = Decoder::new();
    let (codes, z) = (normals(BATCH * POINTS * WIDTHS[0], 25), normals(BATCH * LATENT, 26));
    let y_bar = normals(BATCH * POINTS * WIDTHS[4], 27);
    let one = median(runs, || {
        let run = |b| decoder.forward(of(b, &codes, POINTS * WIDTHS[0]), of(b, &z, LATENT));
        std::hint::black_box(par::map(BATCH, |b| {
            let [.., y] = run(b);
            y
        }));
    });
    let both = median(runs, || {
        std::hint::black_box(decoder.step(&codes, &z, &y_bar));
    });
    let layers = WIDTHS.windows(2).fold(0, |sum, pair| sum + pair[0] * pair[1]);
    let work = |products: usize| 2e-9 * (BATCH * POINTS * products) as f64;
    let all = 3 * layers - WIDTHS[0] * WIDTHS[1];
    vec![Timed { name: "decoder", seconds: [one, both], work: [work(layers), work(all)] }]
}
