//! `nn.decoder`: a network that is evaluated at every coordinate of a template and conditioned on the factors
//! of its item.
//!
//! h₁ = λ(W_t γ + W_z z + b₀),   h₂ = λ(W₁h₁ + b₁),   h₃ = λ(W₂h₂ + b₂),   R = base + scale∘(W₃h₃ + b₃)
//!
//! It is the decoder of LAST (chapter *Learned causes*, "The model").
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | γ | `codes` | (B, Q, F) | finite; the code of a coordinate, a constant. F = 0 for outputs without coordinates |
//! | z | `z` | (B, d) | finite |
//! | W_t, W_z | `point`, `latent` | (a, F), (a, d) | finite |
//! | W₁, W₂, W₃ | `weight1`, `weight2`, `weight3` | (b, a), (c, b), (O, c) | finite |
//! | b₀ … b₃ | `bias0` … `bias3` | (a), (b), (c), (O) | finite |
//! | | `base` | (B, Q, O) | constant |
//! | | `scale` | (O) | constant |
//! | λ | | | leaky ReLU of slope 0.2 |
//! | R | `points` | (B, Q, O) | |
//!
//! # Implementation
//! [`adjoint`] obtains the cotangents of an item from a function of its points, so that the activations stay
//! in the cache from the forward pass through the adjoint; none are stored. Weights are packed once per
//! batch. Items with a single coordinate become the rows of one product, with the same bits.
//!
//! # Rounding
//! Layers round as in [`mod@super::linear`]. W_z z is a left fold plus the bias, added once per item to W_t
//! γ. R is the product with the scale, followed by the sum. Gradients of the weights are one chain over q per
//! item, completed before items are added in index order, so a batch may be split into consecutive parts.
//!
//! # Kinks and domain
//! As in [`mod@super::act`], the slope at 0 is 0.2.
//!
//! # Adjoint
//! ȳ = scale∘R̄; then the layers are traversed in reverse with h̄ · W and the slope of λ. W̄_l = h̄ᵀ h,
//! b̄_l = Σ_q h̄; with s = Σ_q h̄₁ before its bias: b̄₀ = s, W̄_z = s zᵀ, z̄ = W_zᵀ s, W̄_t = h̄₁ᵀ γ. Nothing is
//! saved: [`adjoint`] performs both passes.
//!
//! Twin: `reference::nn::decoder`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::nn::decoder::{Params, Sizes, values};
//! let sizes = Sizes { features: 0, latent: 1, hidden: [1; 3], outputs: 1 };
//! let one = [1.0];
//! let params = Params { sizes, point: &[], latent: &[2.0], weights: [&one; 3], biases: [&one, &[0.0], &[0.0], &[0.5]] };
//! assert_eq!(values(&params, &[], &[3.0]), [7.5]); // 2·3 + 1, then the identity three times, then + 0.5
//! ```

use super::act::leaky_relu_back;
use super::linear::column_sums;
use crate::num::gemm::{CHUNK, Finish, Packed, View, gemm, gemm_packed};
use crate::num::par;

/// Slope of the leaky ReLU at 0 and below.
pub const SLOPE: f32 = 0.2;
/// Number of items whose gradients are stored at a time.
const HELD: usize = 32;

/// Sizes of a decoder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    /// Length F of the code of a coordinate.
    pub features: usize,
    /// Length d of z.
    pub latent: usize,
    /// Hidden widths a, b, c.
    pub hidden: [usize; 3],
    /// Number of outputs, O.
    pub outputs: usize,
}

/// Weights and biases.
#[derive(Clone, Copy, Debug)]
pub struct Params<'a> {
    /// Sizes of the network.
    pub sizes: Sizes,
    /// W_t (a, F).
    pub point: &'a [f32],
    /// W_z (a, d).
    pub latent: &'a [f32],
    /// W₁ (b, a), W₂ (c, b), W₃ (O, c).
    pub weights: [&'a [f32]; 3],
    /// b₀ (a), b₁ (b), b₂ (c), b₃ (O).
    pub biases: [&'a [f32]; 4],
}

/// The coordinates at which an item is decoded.
#[derive(Clone, Copy, Debug)]
pub struct Item<'a> {
    /// Shape (Q, F).
    pub codes: &'a [f32],
    /// Shape (Q, O).
    pub base: &'a [f32],
}

/// Fills the cotangent of the points of an item. The arguments are the item's index, R, and R̄, which is zero
/// on entry.
pub type Cotangent<'a> = dyn Fn(usize, &[f32], &mut [f32]) -> f64 + Sync + 'a;

/// Result of a forward and backward pass.
#[derive(Clone, Debug)]
pub struct PassResult {
    /// Values returned by the function of the points, shape (B).
    pub values: Vec<f64>,
    /// Shape (B, d).
    pub z_bar: Vec<f32>,
    /// Gradients of W_t, W_z, b₀, W₁, b₁, W₂, b₂, W₃, b₃.
    pub grads: [Vec<f32>; 9],
}

/// Weights packed for products.
struct Weights<'a> {
    sizes: Sizes,
    point: Packed,
    latent: &'a [f32],
    layers: [Packed; 3],
    biases: [&'a [f32]; 4],
    /// W₁, W₂, W₃ packed for the backward pass.
    back: [Packed; 3],
}

/// Activations of an item: h₁, h₂, h₃, y.
type Activations = [Vec<f32>; 4];

/// Gradients of W_t and of (W₁, b₁) … (W₃, b₃).
struct Back {
    point: Vec<f32>,
    dense: [[Vec<f32>; 2]; 3],
}

/// Returns all gradients in the order of [`PassResult::grads`].
fn in_order(back: Back, latent: Vec<f32>, first_bias: Vec<f32>) -> [Vec<f32>; 9] {
    let [[w1, b1], [w2, b2], [w3, b3]] = back.dense;
    [back.point, latent, first_bias, w1, b1, w2, b2, w3, b3]
}

/// Converts values y (…, O), as returned by [`values`], to R with a `base` of the same shape.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn placed(y: &mut [f32], base: &[f32], scale: &[f32]) {
    assert!(
        base.len() == y.len() && y.len().is_multiple_of(scale.len()),
        "one base per value, one scale per output"
    );
    for (at, y) in y.iter_mut().enumerate() {
        *y = base[at] + scale[at % scale.len()] * *y;
    }
}

/// Converts the cotangent of R to that of y in place.
fn placed_adjoint(bar: &mut [f32], scale: &[f32]) {
    for (at, bar) in bar.iter_mut().enumerate() {
        *bar = scale[at % scale.len()] * *bar;
    }
}

impl<'a> Params<'a> {
    fn weights(&self) -> Weights<'a> {
        let Sizes { features, hidden: [a, b, c], outputs, .. } = self.sizes;
        let [w1, w2, w3] = self.weights;
        let dense = [(w1, b, a), (w2, c, b), (w3, outputs, c)];
        Weights {
            sizes: self.sizes,
            point: Packed::new(View::new(self.point, a, features).t()),
            latent: self.latent,
            layers: dense.map(|(w, n, k)| Packed::new(View::new(w, n, k).t())),
            biases: self.biases,
            back: dense.map(|(w, n, k)| Packed::new(View::new(w, n, k))),
        }
    }
}

/// Returns y = W₃h₃ + b₃ (B, Q, O) at the same Q coordinates for every item: `codes` (Q, F), `z` (B, d).
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn values(params: &Params<'_>, codes: &[f32], z: &[f32]) -> Vec<f32> {
    let w = params.weights();
    let q = codes.len().checked_div(params.sizes.features).unwrap_or(1);
    let items: Vec<&[f32]> = z.chunks_exact(params.sizes.latent).collect();
    par::map(items.len(), |b| {
        let [.., y] = w.activations(codes, items[b], q);
        y
    })
    .concat()
}

/// Returns the points of all items, in the order of the items.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn forward(params: &Params<'_>, z: &[f32], items: &[Item<'_>], scale: &[f32]) -> Vec<f32> {
    let w = params.weights();
    par::map(items.len(), |b| {
        let item = &items[b];
        let z = &z[b * params.sizes.latent..][..params.sizes.latent];
        let [.., mut y] = w.activations(item.codes, z, item.base.len() / params.sizes.outputs);
        placed(&mut y, item.base, scale);
        y
    })
    .concat()
}

/// Returns points and gradients of a batch: `cotangent(b, R, R̄)` fills R̄ (Q, O), which is zero on entry,
/// from the points R (Q, O) of item b; its return value is stored in the result.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn adjoint(
    params: &Params<'_>,
    z: &[f32],
    items: &[Item<'_>],
    scale: &[f32],
    cotangent: &Cotangent<'_>,
) -> PassResult {
    let d = params.sizes.latent;
    assert_eq!(z.len(), items.len() * d, "factors are (B, d)");
    let w = params.weights();
    if items.len() <= CHUNK && items.iter().all(|item| item.base.len() == params.sizes.outputs) {
        return w.rows(z, items, scale, cotangent);
    }
    let sizes = [params.point, params.latent, params.biases[0]].map(<[f32]>::len).into_iter();
    let dense = (0..3).flat_map(|l| [params.weights[l].len(), params.biases[l + 1].len()]);
    let mut lengths = sizes.chain(dense);
    let mut out = PassResult {
        values: Vec::with_capacity(items.len()),
        z_bar: Vec::with_capacity(z.len()),
        grads: std::array::from_fn(|_| vec![0.0; lengths.next().expect("there are nine parameters")]),
    };
    for first in (0..items.len()).step_by(HELD) {
        let part = &items[first..Ord::min(first + HELD, items.len())];
        let passed = par::map(part.len(), |i| {
            let b = first + i;
            w.item(&z[b * d..][..d], &part[i], scale, |points, bar| cotangent(b, points, bar))
        });
        for (value, z_bar, grads) in passed {
            out.values.push(value);
            out.z_bar.extend(z_bar);
            for (sum, grad) in out.grads.iter_mut().zip(grads) {
                sum.iter_mut().zip(grad).for_each(|(s, g)| *s += g);
            }
        }
    }
    out
}

impl Weights<'_> {
    /// Computes the activations of `rows` coordinates of one item, or of one coordinate of each of `rows`
    /// items.
    fn activations(&self, codes: &[f32], z: &[f32], rows: usize) -> Activations {
        let Sizes { features, latent, hidden, outputs } = self.sizes;
        let shift = |z: &[f32]| -> Vec<f32> {
            let row = |(row, bias): (&[f32], &f32)| {
                row.iter().zip(z).fold(0.0_f32, |sum, (w, z)| sum + w * z) + bias
            };
            self.latent.chunks_exact(latent).zip(self.biases[0]).map(row).collect()
        };
        let [a, b, c] = hidden;
        let mut h = [a, b, c, outputs].map(|n| vec![0.0; rows * n]);
        let first = View::new(codes, rows, features);
        if z.len() == latent {
            gemm_packed(first, &self.point, Finish::Leaky(&shift(z), SLOPE), &mut h[0]);
        } else {
            gemm_packed(first, &self.point, Finish::Store, &mut h[0]);
            for (h, z) in h[0].chunks_exact_mut(a).zip(z.chunks_exact(latent)) {
                for (h, shift) in h.iter_mut().zip(shift(z)) {
                    let x = *h + shift;
                    *h = if x > 0.0 { x } else { SLOPE * x };
                }
            }
        }
        for i in 0..3 {
            let (before, after) = h.split_at_mut(i + 1);
            let x = View::new(&before[i], rows, hidden[i]);
            let bias = self.biases[i + 1];
            let how = if i < 2 { Finish::Leaky(bias, SLOPE) } else { Finish::Bias(bias) };
            gemm_packed(x, &self.layers[i], how, &mut after[0]);
        }
        h
    }

    /// Processes one item at its coordinates: returns its value, the gradient of z and the gradients of the
    /// parameters.
    fn item(
        &self,
        z: &[f32],
        item: &Item<'_>,
        scale: &[f32],
        cotangent: impl Fn(&[f32], &mut [f32]) -> f64,
    ) -> (f64, Vec<f32>, [Vec<f32>; 9]) {
        let Sizes { latent: d, hidden: [a, ..], outputs, .. } = self.sizes;
        let [h1, h2, h3, mut y] = self.activations(item.codes, z, item.base.len() / outputs);
        placed(&mut y, item.base, scale);
        let mut bar = vec![0.0; y.len()];
        let value = cotangent(&y, &mut bar);
        placed_adjoint(&mut bar, scale);
        let (bar1, back) = self.back(item.codes, [&h1, &h2, &h3], &bar);
        let sums = column_sums(&bar1, a);
        let mut z_bar = vec![0.0_f32; d];
        let mut latent = Vec::with_capacity(sums.len() * d);
        for (row, g) in self.latent.chunks_exact(d).zip(&sums) {
            z_bar.iter_mut().zip(row).for_each(|(bar, w)| *bar += g * w);
            latent.extend(z.iter().map(|z| g * z));
        }
        (value, z_bar, in_order(back, latent, sums))
    }

    /// Processes items with one coordinate each as the rows of one product. A chain over the items has the
    /// same bits as [`Self::item`] followed by the sum over items.
    fn rows(&self, z: &[f32], items: &[Item<'_>], scale: &[f32], cotangent: &Cotangent<'_>) -> PassResult {
        let (n, d, [a, ..]) = (items.len(), self.sizes.latent, self.sizes.hidden);
        let outputs = self.sizes.outputs;
        let join = |of: fn(&Item<'_>) -> Vec<f32>| -> Vec<f32> { items.iter().flat_map(of).collect() };
        let (codes, base) = (join(|item| item.codes.to_vec()), join(|item| item.base.to_vec()));
        let [h1, h2, h3, mut y] = self.activations(&codes, z, n);
        placed(&mut y, &base, scale);
        let mut bar = vec![0.0; y.len()];
        let rows = y.chunks_exact(outputs).zip(bar.chunks_exact_mut(outputs));
        let values = rows.enumerate().map(|(b, (y, bar))| cotangent(b, y, bar)).collect();
        placed_adjoint(&mut bar, scale);
        let (bar1, back) = self.back(&codes, [&h1, &h2, &h3], &bar);
        let by_item = View::new(&bar1, n, a);
        let (mut z_bar, mut latent) = (vec![0.0; n * d], vec![0.0; a * d]);
        gemm(by_item, View::new(self.latent, a, d), Finish::Store, &mut z_bar);
        gemm(by_item.t(), View::new(z, n, d), Finish::Store, &mut latent);
        let sums = column_sums(&bar1, a);
        PassResult { values, z_bar, grads: in_order(back, latent, sums) }
    }

    /// Propagates ȳ through the layers: returns h̄₁ before its bias, and the gradients of the later
    /// parameters.
    fn back(&self, codes: &[f32], h: [&[f32]; 3], bar: &[f32]) -> (Vec<f32>, Back) {
        let Sizes { features, hidden: [a, b, c], outputs: o, .. } = self.sizes;
        let rows = bar.len() / o;
        let product = |bar: &[f32], n: usize, x: &[f32], k: usize| -> Vec<f32> {
            let mut grad = vec![0.0; n * k];
            gemm(View::new(bar, rows, n).t(), View::new(x, rows, k), Finish::Store, &mut grad);
            grad
        };
        let through = |bar: &[f32], n: usize, layer: usize, h: &[f32], k: usize| -> Vec<f32> {
            let mut x_bar = vec![0.0; rows * k];
            gemm_packed(View::new(bar, rows, n), &self.back[layer], Finish::Store, &mut x_bar);
            leaky_relu_back(h, SLOPE, &mut x_bar);
            x_bar
        };
        let third = [product(bar, o, h[2], c), column_sums(bar, o)];
        let bar3 = through(bar, o, 2, h[2], c);
        let second = [product(&bar3, c, h[1], b), column_sums(&bar3, c)];
        let bar2 = through(&bar3, c, 1, h[1], b);
        let first = [product(&bar2, b, h[0], a), column_sums(&bar2, b)];
        let bar1 = through(&bar2, b, 0, h[0], a);
        let point = product(&bar1, a, codes, features);
        (bar1, Back { point, dense: [first, second, third] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::rng::Rng;

    #[test]
    fn items_of_one_coordinate_have_the_bits_of_items_one_by_one() {
        for features in [0, 5] {
            let sizes = Sizes { features, latent: 6, hidden: [16, 12, 8], outputs: 3 };
            let n = 37;
            let draws = |k: u16, len: usize| -> Vec<f32> {
                (0..len).map(|i| Rng::new(5).normal_f32(i as u64, 0, 0x7e5a, k)).collect()
            };
            let (codes, base) = (draws(0, n * features), draws(1, n * 3));
            let (z, bars) = (draws(2, n * 6), draws(3, n * 3));
            let weights = [draws(4, 12 * 16), draws(5, 8 * 12), draws(6, 3 * 8)];
            let biases = [draws(7, 16), draws(8, 12), draws(9, 8), draws(10, 3)];
            let (point, latent) = (draws(11, 16 * features), draws(12, 16 * 6));
            let params = Params {
                sizes,
                point: &point,
                latent: &latent,
                weights: [0, 1, 2].map(|l| &weights[l][..]),
                biases: [0, 1, 2, 3].map(|l| &biases[l][..]),
            };
            let items: Vec<Item<'_>> = (0..n)
                .map(|i| Item { codes: &codes[i * features..][..features], base: &base[i * 3..][..3] })
                .collect();
            let scale = [0.5, 1.0, 2.0];
            let cotangent = |b: usize, points: &[f32], bar: &mut [f32]| {
                bar.copy_from_slice(&bars[b * 3..][..3]);
                f64::from(points[0])
            };
            let together = adjoint(&params, &z, &items, &scale, &cotangent);
            let w = params.weights();
            let mut grads: Vec<Vec<f32>> = together.grads.iter().map(|g| vec![0.0; g.len()]).collect();
            let bits = |x: &[f32]| x.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
            for (i, item) in items.iter().enumerate() {
                let (value, z_bar, own) =
                    w.item(&z[i * 6..][..6], item, &scale, |points, bar| cotangent(i, points, bar));
                assert_eq!(value.to_bits(), together.values[i].to_bits(), "value of item {i}");
                assert_eq!(bits(&z_bar), bits(&together.z_bar[i * 6..][..6]), "gradient of item {i}");
                for (sum, own) in grads.iter_mut().zip(own) {
                    sum.iter_mut().zip(own).for_each(|(s, g)| *s += g);
                }
            }
            for (at, (one_by_one, together)) in grads.iter().zip(&together.grads).enumerate() {
                assert_eq!(bits(one_by_one), bits(together), "parameter {at} with {features} features");
            }
        }
    }
}
