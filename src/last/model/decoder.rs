//! The decoder D_θ: from factors to what they show, at any coordinate of the template.
//!
//! h₁ = λ(W_t γ(t) + W_z z + b₀),  h₂ = λ(W₁h₁ + b₁),  h₃ = λ(W₂h₂ + b₂),  y = W₃h₃ + b₃,  R(t) = base(t) + scale∘y
//!
//! | symbol | shape | |
//! |--------|-------|-|
//! | z | (B, d) | factors; W_z z is added once per item |
//! | γ(t) | (P, F) | code of a coordinate ([`code`], F = 27); none (F = 0, P = 1) for vectors |
//! | λ | | leaky ReLU 0.2 |
//! | base, scale | (P, O), (O) | points: (t, ½) and (½, ½, ½, 1, 1, 1) (`last.md` §4.4) |
//!
//! The loss of §4.5 is part of the pass: L_b = (1/Q) Σ over q, c of w_c (R − target)² with w = 1/σ², a weight per item, and Q of the P coordinates.
//!
//! # How it is fast
//! An item's activations stay in the cache from the forward pass through its adjoint; nothing is kept. Weights are packed once per batch. Vectors,
//! items of one coordinate, are the rows of one product, with the same bits.
//!
//! # Rounding
//! Layers as `nn.linear`. L_b is a left fold over (q, c) in f64. Gradients of the weights are one chain over q per item, finished before
//! items are added in index order, so a batch may be split into consecutive parts.

use super::encoder::{LAST, he_uniform, size};
use crate::nn::act::leaky_relu_back;
use crate::num::gemm::{CHUNK, Finish, Packed, View, gemm, gemm_packed};
use crate::num::{elem, par};
use crate::tape::Params;
use ndarray::{ArrayD, IxDyn};

/// Slope of the leaky ReLU at 0 and below.
const SLOPE: f32 = 0.2;
/// Widths of the hidden layers.
pub const HIDDEN: [usize; 3] = [128, 128, 64];
/// Name of the weights that meet the factors, (128, d).
pub(super) const LATENT: &str = "decoder.latent.weight";
/// Octaves of the code.
const OCTAVES: usize = 4;
/// Numbers of the code of a coordinate.
pub const CODE: usize = 3 + 6 * OCTAVES;
/// First number of the arrays drawn for the decoder; those of the encoder come before.
const FIRST_ARRAY: u32 = 64;
/// Items whose gradients are held at a time.
const HELD: usize = 32;

/// γ(t) = (t, sin 2ᵐπt, cos 2ᵐπt for m = 0 … 3), t in −1 … 1; (N, 3) to (N, 27).
pub fn code(points: &[[f32; 3]]) -> Vec<f32> {
    let mut codes = Vec::with_capacity(points.len() * CODE);
    for t in points {
        codes.extend_from_slice(t);
        for m in 0..OCTAVES {
            let angles = t.map(|t| std::f64::consts::PI * f64::from(1u32 << m) * f64::from(t));
            codes.extend(angles.map(|a| elem::f64::sin(a) as f32));
            codes.extend(angles.map(|a| elem::f64::cos(a) as f32));
        }
    }
    codes
}

/// Sizes of a decoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Decoder {
    /// F
    pub features: usize,
    /// d
    pub latent: usize,
    /// O
    pub outputs: usize,
}

/// Where an item is decoded, and what is to come out.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// (Q, F)
    pub codes: &'a [f32],
    /// (Q, O)
    pub base: &'a [f32],
    /// (Q, O)
    pub wanted: &'a [f32],
    /// factor of this item's loss
    pub weight: f32,
}

impl Target<'_> {
    /// L_b; ȳ of weight·L_b into `bar`.
    fn loss(&self, y: &[f32], scale: &[f32], precision: &[f32], bar: &mut [f32]) -> f64 {
        let o = scale.len();
        let q = y.len() / o;
        let share = 1.0 / q as f32;
        let mut loss = 0.0;
        for (at, bar) in bar.iter_mut().enumerate() {
            let column = at % o;
            let error = (self.base[at] + scale[column] * y[at]) - self.wanted[at];
            let weighted = precision[column] * error;
            loss += f64::from(weighted) * f64::from(error);
            *bar = ((2.0 * share) * self.weight) * (scale[column] * weighted);
        }
        loss / q as f64
    }
}

/// The loss of a batch and its gradients.
#[derive(Clone, Debug)]
pub struct Passed {
    /// (B) L_b, without weights
    pub losses: Vec<f64>,
    /// (B, d) gradient of Σ weight·L_b
    pub z_bar: Vec<f32>,
    /// the same by the parameters, in the order of [`Decoder::shapes`]
    pub grads: Vec<Vec<f32>>,
}

/// Weights, packed for products.
struct Weights<'a> {
    point: Packed,
    latent: &'a [f32],
    layers: [Packed; 3],
    biases: [&'a [f32]; 4],
    /// W₁, W₂, W₃ for the way back
    back: [Packed; 3],
}

/// Activations of an item: h₁, h₂, h₃, y.
struct Activations([Vec<f32>; 4]);

/// Gradients by W_t and by (W₁, b₁) … (W₃, b₃).
struct Back {
    point: Vec<f32>,
    dense: [[Vec<f32>; 2]; 3],
}

/// All gradients in the order of [`Decoder::shapes`].
fn in_order(back: Back, latent: Vec<f32>, first_bias: Vec<f32>) -> Vec<Vec<f32>> {
    [back.point, latent, first_bias].into_iter().chain(back.dense.into_iter().flatten()).collect()
}

fn slice<'a>(params: &'a Params, name: &str) -> &'a [f32] {
    let array = params.get(name).unwrap_or_else(|| panic!("the decoder has '{name}'"));
    array.as_slice().expect("parameters are contiguous and row-major")
}

/// Column sums, a left fold over the rows.
fn column_sums(rows: &[f32], n: usize) -> Vec<f32> {
    let mut sums = vec![0.0_f32; n];
    for row in rows.chunks_exact(n) {
        sums.iter_mut().zip(row).for_each(|(s, g)| *s += *g);
    }
    sums
}

impl Decoder {
    /// Names and shapes of all parameters.
    pub fn shapes(&self) -> Vec<(String, Vec<usize>)> {
        let [a, b, c] = HIDDEN;
        [
            ("point.weight", vec![a, self.features]),
            ("latent.weight", vec![a, self.latent]),
            ("dense0.bias", vec![a]),
            ("dense1.weight", vec![b, a]),
            ("dense1.bias", vec![b]),
            ("dense2.weight", vec![c, b]),
            ("dense2.bias", vec![c]),
            ("dense3.weight", vec![self.outputs, c]),
            ("dense3.bias", vec![self.outputs]),
        ]
        .map(|(name, shape)| (format!("decoder.{name}"), shape))
        .to_vec()
    }

    /// First values of all parameters, as the encoder's: the last layer's weights are scaled by 0.1 here too, so that the first loss is that of the
    /// template at rest. Without it the first gradients are a hundred times those that follow, and Adam's second moments (0.999) remember them for
    /// thousands of steps.
    pub fn draw(&self, seed: u64, params: &mut Params) {
        for (at, (name, shape)) in self.shapes().into_iter().enumerate() {
            let mut array = if shape.contains(&0) {
                ArrayD::zeros(IxDyn(&shape))
            } else {
                he_uniform(seed, FIRST_ARRAY + at as u32, &shape, SLOPE)
            };
            if name == "decoder.dense3.weight" {
                array.mapv_inplace(|w| LAST * w);
            }
            params.set(&name, array);
        }
    }

    fn weights<'a>(&self, params: &'a Params) -> Weights<'a> {
        let get = |name: &str| slice(params, &format!("decoder.{name}"));
        let [a, b, c] = HIDDEN;
        let view = |name: &str, n: usize, k: usize| View::new(get(name), n, k);
        let dense = [("dense1.weight", b, a), ("dense2.weight", c, b), ("dense3.weight", self.outputs, c)];
        Weights {
            point: Packed::new(view("point.weight", a, self.features).t()),
            latent: get("latent.weight"),
            layers: dense.map(|(name, n, k)| Packed::new(view(name, n, k).t())),
            biases: ["dense0.bias", "dense1.bias", "dense2.bias", "dense3.bias"].map(get),
            back: dense.map(|(name, n, k)| Packed::new(view(name, n, k))),
        }
    }

    /// Of `rows` coordinates of one item, or of one coordinate of each of `rows` items.
    fn activations(&self, w: &Weights<'_>, codes: &[f32], z: &[f32], rows: usize) -> Activations {
        let shift = |z: &[f32]| -> Vec<f32> {
            let row = |(row, bias): (&[f32], &f32)| {
                row.iter().zip(z).fold(0.0_f32, |sum, (w, z)| sum + w * z) + bias
            };
            w.latent.chunks_exact(self.latent).zip(w.biases[0]).map(row).collect()
        };
        let [a, b, c] = HIDDEN;
        let outputs = self.outputs;
        let mut h =
            [vec![0.0; rows * a], vec![0.0; rows * b], vec![0.0; rows * c], vec![0.0; rows * outputs]];
        let first = View::new(codes, rows, self.features);
        if z.len() == self.latent {
            gemm_packed(first, &w.point, Finish::Leaky(&shift(z), SLOPE), &mut h[0]);
        } else {
            gemm_packed(first, &w.point, Finish::Store, &mut h[0]);
            for (h, z) in h[0].chunks_exact_mut(a).zip(z.chunks_exact(self.latent)) {
                for (h, shift) in h.iter_mut().zip(shift(z)) {
                    let x = *h + shift;
                    *h = if x > 0.0 { x } else { SLOPE * x };
                }
            }
        }
        for i in 0..3 {
            let (before, after) = h.split_at_mut(i + 1);
            let x = View::new(&before[i], rows, HIDDEN[i]);
            let bias = w.biases[i + 1];
            let how = if i < 2 { Finish::Leaky(bias, SLOPE) } else { Finish::Bias(bias) };
            gemm_packed(x, &w.layers[i], how, &mut after[0]);
        }
        Activations(h)
    }

    /// y (B, Q, O) at the same Q coordinates for every item: `codes` (Q, F), `z` (B, d).
    ///
    /// # Panics
    /// When a buffer does not have the size of its shape.
    pub fn forward(&self, params: &Params, codes: &[f32], z: &[f32]) -> Vec<f32> {
        let w = self.weights(params);
        let q = codes.len().checked_div(self.features).unwrap_or(1);
        let items: Vec<&[f32]> = z.chunks_exact(self.latent).collect();
        par::map(items.len(), |b| {
            let Activations([.., y]) = self.activations(&w, codes, items[b], q);
            y
        })
        .concat()
    }

    /// Loss and gradients of a batch; `scale` (O), `precision` w (O).
    ///
    /// # Panics
    /// When a buffer does not have the size of its shape.
    pub fn pass(
        &self,
        params: &Params,
        z: &[f32],
        targets: &[Target<'_>],
        scale: &[f32],
        precision: &[f32],
    ) -> Passed {
        assert_eq!(z.len(), targets.len() * self.latent, "factors are (B, d)");
        let w = self.weights(params);
        let is_row = |t: &Target<'_>| t.wanted.len() == self.outputs;
        if targets.len() <= CHUNK && targets.iter().all(is_row) {
            return self.rows(&w, z, targets, scale, precision);
        }
        let mut out = Passed {
            losses: Vec::with_capacity(targets.len()),
            z_bar: Vec::with_capacity(z.len()),
            grads: self.shapes().iter().map(|(_, shape)| vec![0.0; size(shape)]).collect(),
        };
        for first in (0..targets.len()).step_by(HELD) {
            let part = &targets[first..Ord::min(first + HELD, targets.len())];
            let items = par::map(part.len(), |i| {
                let z = &z[(first + i) * self.latent..][..self.latent];
                self.item(&w, z, &part[i], scale, precision)
            });
            for (loss, z_bar, grads) in items {
                out.losses.push(loss);
                out.z_bar.extend(z_bar);
                for (sum, grad) in out.grads.iter_mut().zip(grads) {
                    sum.iter_mut().zip(grad).for_each(|(s, g)| *s += g);
                }
            }
        }
        out
    }

    /// One item at its coordinates: loss, gradient by z, gradients by the parameters.
    fn item(
        &self,
        w: &Weights<'_>,
        z: &[f32],
        target: &Target<'_>,
        scale: &[f32],
        precision: &[f32],
    ) -> (f64, Vec<f32>, Vec<Vec<f32>>) {
        let q = target.wanted.len() / self.outputs;
        let Activations([h1, h2, h3, y]) = self.activations(w, target.codes, z, q);
        let mut bar = vec![0.0; y.len()];
        let loss = target.loss(&y, scale, precision, &mut bar);
        let (bar1, back) = self.back(w, target.codes, [&h1, &h2, &h3], &bar);
        let sums = column_sums(&bar1, HIDDEN[0]);
        let mut z_bar = vec![0.0_f32; self.latent];
        let mut latent = Vec::with_capacity(sums.len() * self.latent);
        for (row, g) in w.latent.chunks_exact(self.latent).zip(&sums) {
            z_bar.iter_mut().zip(row).for_each(|(bar, w)| *bar += g * w);
            latent.extend(z.iter().map(|z| g * z));
        }
        (loss, z_bar, in_order(back, latent, sums))
    }

    /// Items of one coordinate each as the rows of one product: a chain over the items is what [`Self::item`] and the sum over items come to.
    fn rows(
        &self,
        w: &Weights<'_>,
        z: &[f32],
        targets: &[Target<'_>],
        scale: &[f32],
        precision: &[f32],
    ) -> Passed {
        let (n, d, a) = (targets.len(), self.latent, HIDDEN[0]);
        let codes: Vec<f32> = targets.iter().flat_map(|t| t.codes).copied().collect();
        let Activations([h1, h2, h3, y]) = self.activations(w, &codes, z, n);
        let mut bar = vec![0.0; y.len()];
        let rows = y.chunks_exact(self.outputs).zip(bar.chunks_exact_mut(self.outputs));
        let losses = targets
            .iter()
            .zip(rows)
            .map(|(target, (y, bar))| target.loss(y, scale, precision, bar))
            .collect();
        let (bar1, back) = self.back(w, &codes, [&h1, &h2, &h3], &bar);
        let by_item = View::new(&bar1, n, a);
        let (mut z_bar, mut latent) = (vec![0.0; n * d], vec![0.0; a * d]);
        gemm(by_item, View::new(w.latent, a, d), Finish::Store, &mut z_bar);
        gemm(by_item.t(), View::new(z, n, d), Finish::Store, &mut latent);
        let sums = column_sums(&bar1, a);
        Passed { losses, z_bar, grads: in_order(back, latent, sums) }
    }

    /// From ȳ through the layers: h̄₁ before its bias, and the gradients by what lies behind it.
    fn back(&self, w: &Weights<'_>, codes: &[f32], h: [&[f32]; 3], bar: &[f32]) -> (Vec<f32>, Back) {
        let [a, b, c] = HIDDEN;
        let o = self.outputs;
        let rows = bar.len() / o;
        let product = |bar: &[f32], n: usize, x: &[f32], k: usize| -> Vec<f32> {
            let mut grad = vec![0.0; n * k];
            gemm(View::new(bar, rows, n).t(), View::new(x, rows, k), Finish::Store, &mut grad);
            grad
        };
        let through = |bar: &[f32], n: usize, layer: usize, h: &[f32], k: usize| -> Vec<f32> {
            let mut x_bar = vec![0.0; rows * k];
            gemm_packed(View::new(bar, rows, n), &w.back[layer], Finish::Store, &mut x_bar);
            leaky_relu_back(h, SLOPE, &mut x_bar);
            x_bar
        };
        let third = [product(bar, o, h[2], c), column_sums(bar, o)];
        let bar3 = through(bar, o, 2, h[2], c);
        let second = [product(&bar3, c, h[1], b), column_sums(&bar3, c)];
        let bar2 = through(&bar3, c, 1, h[1], b);
        let first = [product(&bar2, b, h[0], a), column_sums(&bar2, b)];
        let bar1 = through(&bar2, b, 0, h[0], a);
        let point = product(&bar1, a, codes, self.features);
        (bar1, Back { point, dense: [first, second, third] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::rng::Rng;

    #[test]
    fn an_empty_batch_has_no_loss_and_no_gradient() {
        let decoder = Decoder { features: 5, latent: 6, outputs: 3 };
        let mut params = Params::default();
        decoder.draw(1, &mut params);
        let passed = decoder.pass(&params, &[], &[], &[1.0; 3], &[1.0; 3]);
        assert!(passed.losses.is_empty() && passed.z_bar.is_empty(), "nothing went in");
        assert_eq!(passed.grads.len(), decoder.shapes().len(), "every parameter has a gradient");
        assert!(passed.grads.iter().flatten().all(|g| *g == 0.0), "which is 0");
    }

    #[test]
    fn items_of_one_coordinate_have_the_bits_of_items_one_by_one() {
        for features in [0, 5] {
            let decoder = Decoder { features, latent: 6, outputs: 3 };
            let mut params = Params::default();
            decoder.draw(1, &mut params);
            let n = 37;
            let draws = |k: u16, len: usize| -> Vec<f32> {
                (0..len).map(|i| Rng::new(5).normal_f32(i as u64, 0, 0x7e5a, k)).collect()
            };
            let (codes, base, wanted) = (draws(0, n * features), draws(1, n * 3), draws(2, n * 3));
            let (z, weights) = (draws(3, n * 6), draws(4, n));
            let targets: Vec<Target<'_>> = (0..n)
                .map(|i| Target {
                    codes: &codes[i * features..(i + 1) * features],
                    base: &base[i * 3..i * 3 + 3],
                    wanted: &wanted[i * 3..i * 3 + 3],
                    weight: weights[i],
                })
                .collect();
            let (scale, precision) = ([0.5, 1.0, 2.0], [3.0, 0.25, 1.0]);
            let together = decoder.pass(&params, &z, &targets, &scale, &precision);
            let w = decoder.weights(&params);
            let mut grads: Vec<Vec<f32>> = together.grads.iter().map(|g| vec![0.0; g.len()]).collect();
            for (i, target) in targets.iter().enumerate() {
                let (loss, z_bar, own) = decoder.item(&w, &z[i * 6..i * 6 + 6], target, &scale, &precision);
                assert_eq!(loss.to_bits(), together.losses[i].to_bits(), "loss of item {i}");
                let bits = |x: &[f32]| x.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
                assert_eq!(bits(&z_bar), bits(&together.z_bar[i * 6..i * 6 + 6]), "gradient of item {i}");
                for (sum, own) in grads.iter_mut().zip(own) {
                    sum.iter_mut().zip(own).for_each(|(s, g)| *s += g);
                }
            }
            for ((name, _), (one_by_one, together)) in
                decoder.shapes().iter().zip(grads.iter().zip(&together.grads))
            {
                let same = one_by_one.iter().zip(together).all(|(a, b)| a.to_bits() == b.to_bits());
                assert!(same, "{name} with {features} features");
            }
        }
    }
}
