//! Small fully connected networks of the host: layers of [`nn::linear`], max(0, x) between them, and one optimiser state per array.
//!
//! A layer listed as `skip` takes the input beside what comes from the layer before it (input behind). The last layer has no activation and starts
//! close to 0, so that a fresh network changes nothing that can be seen.
//!
//! # Rounding
//! That of [`nn::linear`].
//!
//! # Kinks and domain
//! max(0, x) has gradient 0 at 0.

use crate::nn::linear;
use crate::num::array::Arrays;
use crate::num::par;
use crate::num::rng::Rng;
use crate::optim::adam::{Adam, Rule};
use crate::{Error, Result};

/// Largest entry of the last layer before the first step.
const LAST: f64 = 1e-5;
/// Values of one task of an elementwise loop.
const CHUNK: usize = 1 << 14;

/// One layer: weight (N, K), bias (N).
#[derive(Clone, Debug)]
struct Layer {
    n: usize,
    k: usize,
    weight: Vec<f32>,
    bias: Vec<f32>,
    adam: [Adam; 2],
}

/// A network and its optimiser.
#[derive(Clone, Debug)]
pub struct Mlp {
    layers: Vec<Layer>,
    /// the layer that takes the input again
    skip: Option<usize>,
    input: usize,
}

/// What the adjoint needs: the input of every layer.
#[derive(Clone, Debug, Default)]
pub struct Passed {
    inputs: Vec<Vec<f32>>,
    rows: usize,
}

impl Mlp {
    /// Widths from input to output; uniform in ±1/√K, the last layer in ±1e-5, no biases.
    ///
    /// # Errors
    /// Never for widths above 0.
    pub fn new(widths: &[usize], skip: Option<usize>, seed: u64, purpose: u16) -> Result<Self> {
        let (rng, last) = (Rng::new(seed), widths.len() - 2);
        let layers = (0..=last)
            .map(|l| {
                let (n, k) = (widths[l + 1], widths[l] + if skip == Some(l) { widths[0] } else { 0 });
                let most = if l == last { LAST } else { 1.0 / (k as f64).sqrt() };
                let draw = |i: usize| most * (2.0 * rng.uniform_f64(i as u64, l as u32, purpose, 0) - 1.0);
                Ok(Layer {
                    n,
                    k,
                    weight: (0..n * k).map(|i| draw(i) as f32).collect(),
                    bias: vec![0.0; n],
                    adam: [Adam::new(Rule::SPLAT, n, k)?, Adam::new(Rule::SPLAT, n, 1)?],
                })
            })
            .collect::<Result<Vec<Layer>>>()?;
        Ok(Self { layers, skip, input: widths[0] })
    }

    /// Values of `rows` rows of inputs.
    pub fn forward(&self, x: &[f32], rows: usize) -> (Vec<f32>, Passed) {
        let mut passed = Passed { inputs: Vec::with_capacity(self.layers.len()), rows };
        let mut value = x.to_vec();
        for (l, layer) in self.layers.iter().enumerate() {
            if self.skip == Some(l) {
                value = beside(&value, x, self.input, rows);
            }
            let mut y = vec![0.0; rows * layer.n];
            linear::forward(layer.input(&value, rows), &mut y);
            if l + 1 < self.layers.len() {
                par::chunks_mut(&mut y, CHUNK, |_, y| {
                    for v in y {
                        *v = if *v > 0.0 { *v } else { 0.0 };
                    }
                });
            }
            passed.inputs.push(std::mem::replace(&mut value, y));
        }
        (value, passed)
    }

    /// One step of the optimiser against the gradient that `y_bar` implies; nothing flows back to the input.
    ///
    /// # Errors
    /// A result that is not finite.
    pub fn step(&mut self, passed: &Passed, y_bar: Vec<f32>, rate: f64) -> Result<()> {
        let (rows, mut bar) = (passed.rows, y_bar);
        for l in (0..self.layers.len()).rev() {
            let layer = &mut self.layers[l];
            let x = &passed.inputs[l];
            let mut grad = linear::InBar {
                x: if l > 0 { vec![0.0; x.len()] } else { Vec::new() },
                weight: vec![0.0; layer.weight.len()],
                bias: vec![0.0; layer.n],
            };
            linear::adjoint(layer.input(x, rows), &bar, &mut grad);
            let named = |e: Error| e.within(format!("layer {l}"));
            layer.adam[0].step(&mut layer.weight, &grad.weight, &[rate], None).map_err(named)?;
            layer.adam[1].step(&mut layer.bias, &grad.bias, &[rate], None).map_err(named)?;
            if l > 0 {
                let (k, n) = (layer.k, layer.k - if self.skip == Some(l) { self.input } else { 0 });
                bar = if n == k {
                    grad.x
                } else {
                    grad.x.chunks_exact(k).flat_map(|r| &r[..n]).copied().collect()
                };
                // What left the layer before is what entered this one: above 0 where it passed.
                par::chunks_mut(&mut bar, n * 64, |c, bar| {
                    for (r, row) in bar.chunks_exact_mut(n).enumerate() {
                        let from = &x[(c * 64 + r) * k..][..n];
                        for (b, v) in row.iter_mut().zip(from) {
                            *b = if *v > 0.0 { *b } else { 0.0 };
                        }
                    }
                });
            }
        }
        Ok(())
    }

    /// Parameters in order, for a digest.
    pub fn values(&self) -> impl Iterator<Item = (&[f32], [usize; 2])> {
        self.layers.iter().flat_map(|l| [(&l.weight[..], [l.n, l.k]), (&l.bias[..], [l.n, 1])])
    }

    /// Puts parameters as `NAME.L.weight`, and with `state` the optimiser.
    pub fn save(&self, name: &str, state: bool, out: &mut Arrays) {
        for (l, layer) in self.layers.iter().enumerate() {
            out.put(&format!("{name}.{l}.weight"), &[layer.n, layer.k], layer.weight.clone());
            out.put(&format!("{name}.{l}.bias"), &[layer.n], layer.bias.clone());
            if state {
                for (part, adam) in ["weight", "bias"].iter().zip(&layer.adam) {
                    adam.save(&format!("{name}.{l}.{part}.adam"), out);
                }
            }
        }
    }

    /// Takes back what [`Self::save`] put.
    ///
    /// # Errors
    /// Missing arrays, other shapes, numbers that are not finite.
    pub fn load(&mut self, name: &str, state: bool, from: &Arrays) -> Result<()> {
        for (l, layer) in self.layers.iter_mut().enumerate() {
            let mut dims = std::collections::BTreeMap::new();
            let names = ["weight", "bias"].map(|part| format!("{name}.{l}.{part}"));
            let shape = format!("{},{}", layer.n, layer.k);
            layer.weight = from.shape(&names[0], &shape, &mut dims)?.to_f32();
            layer.bias = from.shape(&names[1], &layer.n.to_string(), &mut dims)?.to_f32();
            from.finite(names.iter().map(String::as_str))?;
            if state {
                for (part, adam) in names.iter().zip(&mut layer.adam) {
                    let loaded = Adam::load(Rule::SPLAT, &format!("{part}.adam"), from)?;
                    if (loaded.rows(), loaded.width()) != (adam.rows(), adam.width()) {
                        return Err(Error::input(format!("array '{part}.adam.m'"))
                            .expected(format!("shape [{}, {}]", adam.rows(), adam.width()))
                            .got(format!("[{}, {}]", loaded.rows(), loaded.width())));
                    }
                    *adam = loaded;
                }
            }
        }
        Ok(())
    }
}

impl Layer {
    fn input<'a>(&'a self, x: &'a [f32], rows: usize) -> linear::In<'a> {
        linear::In { x, weight: &self.weight, bias: &self.bias, m: rows, n: self.n, k: self.k }
    }
}

/// Rows of a, each followed by its row of b (width `width`).
fn beside(a: &[f32], b: &[f32], width: usize, rows: usize) -> Vec<f32> {
    let n = a.len() / rows;
    a.chunks_exact(n).zip(b.chunks_exact(width)).flat_map(|(a, b)| a.iter().chain(b)).copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_lower_what_they_should() {
        let mut net = Mlp::new(&[3, 16, 16, 16, 2], Some(2), 3, 0x0903).expect("widths above 0");
        let x: Vec<f32> = (0..30).map(|i| ((i * 7) % 13) as f32 / 13.0 - 0.5).collect();
        let want: Vec<f32> = x.chunks(3).flat_map(|r| [r[0] * r[1] - r[2], 0.5 * r[0]]).collect();
        let (first, _) = net.forward(&x, 10);
        assert!(first.iter().all(|v| v.abs() < 1e-4), "a fresh network is silent");
        let error = |y: &[f32]| y.iter().zip(&want).fold(0.0, |s, (a, b)| s + (a - b) * (a - b));
        for _ in 0..400 {
            let (y, passed) = net.forward(&x, 10);
            let bar = y.iter().zip(&want).map(|(a, b)| 2.0 * (a - b)).collect();
            net.step(&passed, bar, 5e-3).expect("finite");
        }
        let (y, _) = net.forward(&x, 10);
        assert!(error(&y) < 1e-2 * error(&first), "{} of {}", error(&y), error(&first));
    }
}
