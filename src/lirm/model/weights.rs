//! The arrays of a model as the operators read them, and gradients by name.
//!
//! Matrices with weight norm are multiplied out once for all objects of a step ([`Ready::new`]); their
//! gradients are those of the products until [`Ready::finish`] takes them back to directions and lengths.

use super::config::{Config, EPS, Fuse};
use crate::nn::{block, fuse, unpatch, weight_norm};
use crate::num::par;
use crate::tape::{Grads, Params};
use ndarray::{ArrayD, IxDyn};
use std::collections::BTreeMap;

/// Numbers per task of a sum of gradients.
const CHUNK: usize = 1 << 15;

/// Gradients by the names of arrays; that of a matrix with weight norm has the name of the product, without
/// `/v`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gradients(BTreeMap<String, Vec<f32>>);

impl Gradients {
    /// Takes an array out, for an adjoint that adds to it.
    pub(super) fn taken(&mut self, name: &str) -> Vec<f32> {
        self.0.remove(name).unwrap_or_else(|| panic!("array '{name}' has a gradient"))
    }

    /// Puts an array back.
    pub(super) fn put(&mut self, name: &str, array: Vec<f32>) {
        self.0.insert(name.to_owned(), array);
    }

    /// The gradient of that name.
    pub fn get_mut(&mut self, name: &str) -> Option<&mut Vec<f32>> {
        self.0.get_mut(name)
    }

    /// Adds other gradients of the same arrays, entry by entry.
    ///
    /// # Panics
    /// Panics if the arrays differ.
    pub fn add(&mut self, other: &Self) {
        assert_eq!(self.0.len(), other.0.len(), "the same arrays");
        for ((name, sum), (other_name, part)) in self.0.iter_mut().zip(&other.0) {
            assert!(name == other_name && sum.len() == part.len(), "the same arrays");
            par::chunks_mut(sum, CHUNK, |c, sum| {
                sum.iter_mut().zip(&part[c * CHUNK..]).for_each(|(s, p)| *s += p);
            });
        }
    }
}

/// A model ready to compute.
#[derive(Debug)]
pub struct Ready<'a> {
    /// Its sizes.
    pub config: Config,
    params: &'a Params,
    /// Matrices with weight norm, multiplied out.
    normed: BTreeMap<String, Vec<f32>>,
}

/// The prefix of the names of a block.
fn block_name(b: usize) -> String {
    format!("block/{b:02}")
}

impl<'a> Ready<'a> {
    /// Multiplies out the matrices with weight norm.
    ///
    /// # Panics
    /// Panics if an array is missing.
    pub fn new(config: Config, params: &'a Params) -> Self {
        let mut ready = Self { config, params, normed: BTreeMap::new() };
        let mut normed = BTreeMap::new();
        for name in params.iter().filter_map(|(name, _)| name.strip_suffix("/v")) {
            let x = ready.direction(name);
            let mut weight = vec![0.0; x.v.len()];
            weight_norm::forward(&x, &mut weight);
            normed.insert(name.to_owned(), weight);
        }
        ready.normed = normed;
        ready
    }

    fn direction(&self, name: &str) -> weight_norm::In<'_> {
        weight_norm::In { v: self.array(&format!("{name}/v")), g: self.array(&format!("{name}/g")) }
    }

    /// An array, or a matrix with weight norm.
    ///
    /// # Panics
    /// Panics if it is missing.
    pub fn array(&self, name: &str) -> &[f32] {
        if let Some(weight) = self.normed.get(name) {
            return weight;
        }
        let array = self.params.get(name).unwrap_or_else(|| panic!("a model has an array '{name}'"));
        array.as_slice().expect("parameters are contiguous")
    }

    /// Zeros for all arrays.
    pub fn zeros(&self) -> Gradients {
        let plain = self.params.iter().filter(|(name, _)| !name.ends_with("/v") && !name.ends_with("/g"));
        let plain = plain.map(|(name, a)| (name.to_owned(), vec![0.0; a.len()]));
        let normed = self.normed.iter().map(|(name, w)| (name.clone(), vec![0.0; w.len()]));
        Gradients(plain.chain(normed).collect())
    }

    /// Takes the gradients of products back to directions and lengths, under the names of the parameters.
    pub fn finish(&self, mut g: Gradients) -> Grads {
        for name in self.normed.keys() {
            let x = self.direction(name);
            let mut bar = weight_norm::InBar::zeros_like(&x);
            weight_norm::adjoint(&x, &g.taken(name), &mut bar);
            g.put(&format!("{name}/v"), bar.v);
            g.put(&format!("{name}/g"), bar.g);
        }
        let shaped = |(name, values): (String, Vec<f32>)| {
            let shape = self.params.get(&name).expect("a gradient belongs to a parameter").shape();
            let array = ArrayD::from_shape_vec(IxDyn(shape), values).expect("the size of its parameter");
            (name, array)
        };
        Grads(g.0.into_iter().map(shaped).collect())
    }

    /// Block `b` of the transformer at tokens (T, D).
    pub(super) fn block<'s>(&'s self, b: usize, x: &'s [f32]) -> block::In<'s> {
        let of = |part: &str| self.array(&format!("{}/{part}", block_name(b)));
        block::In {
            x,
            ln1_gain: of("norm1/gain"),
            ln1_bias: of("norm1/bias"),
            w_qkv: of("qkv"),
            b_qkv: of("qkv/bias"),
            w_out: of("out"),
            b_out: of("out/bias"),
            ln2_gain: of("norm2/gain"),
            ln2_bias: of("norm2/bias"),
            w_fc1: of("fc1"),
            b_fc1: of("fc1/bias"),
            w_fc2: of("fc2"),
            b_fc2: of("fc2/bias"),
            tokens: x.len() / self.config.width,
            heads: self.config.heads,
            eps: EPS,
        }
    }

    /// The two layers by which the last state enters.
    pub(super) fn fuse<'s>(&'s self, state: &'s [f32], position: &'s [f32]) -> fuse::In<'s> {
        fuse::In {
            state,
            position,
            w1: self.array("fuse/w1"),
            b1: self.array("fuse/w1/bias"),
            w2: self.array("fuse/w2"),
            b2: self.array("fuse/w2/bias"),
            rule: match self.config.fuse {
                Fuse::Published => fuse::Rule::Published,
                Fuse::Residual => fuse::Rule::Residual,
            },
        }
    }

    /// The place tokens, (T, D): those of the planes, then those of the panoramas.
    pub(super) fn places(&self) -> Vec<f32> {
        let mut all = self.array("places/planes").to_vec();
        if self.config.has_embedding() {
            all.extend_from_slice(self.array("places/panoramas"));
        }
        all
    }

    /// The layer from tokens to texels: of planes, or of panoramas.
    pub(super) fn unpatch<'s>(
        &'s self,
        name: &str,
        tokens: &'s [f32],
        shape: unpatch::Shape,
    ) -> unpatch::In<'s> {
        unpatch::In {
            tokens,
            weight: self.array(&format!("unpatch/{name}")),
            bias: self.array(&format!("unpatch/{name}/bias")),
            shape,
        }
    }
}

/// Moves the gradients of named arrays into those of an operator, calls its adjoint, and moves them back.
pub(super) fn lend<const N: usize>(
    g: &mut Gradients,
    names: [String; N],
    adjoint: impl FnOnce([Vec<f32>; N]) -> [Vec<f32>; N],
) {
    let given = std::array::from_fn(|i| g.taken(&names[i]));
    for (name, array) in names.iter().zip(adjoint(given)) {
        g.put(name, array);
    }
}

/// The part of a block's gradients that belongs to an array.
type OfBlock = fn(&mut block::InBar) -> &mut Vec<f32>;

/// The arrays of a block as [`Ready::block`] names them, and their gradients.
const BLOCK: [(&str, OfBlock); 12] = [
    ("norm1/gain", |bar| &mut bar.ln1_gain),
    ("norm1/bias", |bar| &mut bar.ln1_bias),
    ("qkv", |bar| &mut bar.w_qkv),
    ("qkv/bias", |bar| &mut bar.b_qkv),
    ("out", |bar| &mut bar.w_out),
    ("out/bias", |bar| &mut bar.b_out),
    ("norm2/gain", |bar| &mut bar.ln2_gain),
    ("norm2/bias", |bar| &mut bar.ln2_bias),
    ("fc1", |bar| &mut bar.w_fc1),
    ("fc1/bias", |bar| &mut bar.b_fc1),
    ("fc2", |bar| &mut bar.w_fc2),
    ("fc2/bias", |bar| &mut bar.b_fc2),
];

/// [`lend`] for the arrays of block `b`: the gradients of its tokens are `x` before and the result after.
pub(super) fn lend_block(
    g: &mut Gradients,
    b: usize,
    x: Vec<f32>,
    adjoint: impl FnOnce(&mut block::InBar),
) -> Vec<f32> {
    let name = |part: &str| format!("{}/{part}", block_name(b));
    let mut bar = block::InBar { x, ..block::InBar::default() };
    for (part, of) in BLOCK {
        *of(&mut bar) = g.taken(&name(part));
    }
    adjoint(&mut bar);
    for (part, of) in BLOCK {
        g.put(&name(part), std::mem::take(of(&mut bar)));
    }
    bar.x
}
