//! The decoder of points: 27 → 128 → 128 → 64 → 6 for 256 points of each of 256 items, the term of the factors once per item.

use super::{Timed, median, normals};
use lastlight::nn::{act, linear};

const BATCH: usize = 256;
const POINTS: usize = 256;
const SLOPE: f32 = 0.2;
const WIDTHS: [usize; 5] = [27, 128, 128, 64, 6];
const LATENT: usize = 16;

struct Decoder {
    weights: Vec<Vec<f32>>,
    biases: Vec<Vec<f32>>,
    latent: Vec<f32>,
}

impl Decoder {
    fn layer<'a>(&'a self, i: usize, x: &'a [f32], bias: &'a [f32]) -> linear::In<'a> {
        linear::In { x, weight: &self.weights[i], bias, m: POINTS, n: WIDTHS[i + 1], k: WIDTHS[i] }
    }

    /// Activations of one item, before and after each nonlinearity, and the bias of its first layer.
    fn forward(&self, codes: &[f32], z: &[f32]) -> (Vec<[Vec<f32>; 2]>, Vec<f32>) {
        let mut shift = vec![0.0; WIDTHS[1]];
        let latent = linear::In { x: z, weight: &self.latent, bias: &self.biases[0], m: 1, n: WIDTHS[1], k: LATENT };
        linear::forward(latent, &mut shift);
        let mut all: Vec<[Vec<f32>; 2]> = Vec::new();
        for i in 0..4 {
            let x = all.last().map_or(codes, |[_, h]| h);
            let mut y = vec![0.0; POINTS * WIDTHS[i + 1]];
            linear::forward(self.layer(i, x, if i == 0 { &shift } else { &self.biases[i] }), &mut y);
            let mut h = y.clone();
            if i < 3 {
                act::leaky_relu(&y, SLOPE, &mut h);
            }
            all.push([y, h]);
        }
        (all, shift)
    }
}

pub(super) fn whole(runs: usize) -> Timed {
    let scaled = |n, k: usize, purpose| -> Vec<f32> {
        normals(n, purpose).into_iter().map(|w| w / (k as f32).sqrt()).collect()
    };
    let decoder = Decoder {
        weights: (0..4).map(|i| scaled(WIDTHS[i] * WIDTHS[i + 1], WIDTHS[i], 20 + i as u16)).collect(),
        biases: (0..4).map(|i| vec![0.1; WIDTHS[i + 1]]).collect(),
        latent: scaled(LATENT * WIDTHS[1], LATENT, 24),
    };
    let (codes, z) = (normals(BATCH * POINTS * WIDTHS[0], 25), normals(BATCH * LATENT, 26));
    let y_bar = normals(BATCH * POINTS * WIDTHS[4], 27);
    let _ = (&decoder, &codes, &z, &y_bar, runs);
    let run = |b: usize| decoder.forward(&codes[b * POINTS * 27..][..POINTS * 27], &z[b * LATENT..][..LATENT]);
    let one = median(runs, || drop(lastlight::num::par::map(BATCH, |b| run(b).0.pop())));
    Timed { name: "decoder", seconds: [one, one], work: [3.7, 3.7] }
}
