//! The arrays of a model: names, shapes and first values.
//!
//! | name | shape | first values |
//! |---|---|---|
//! | `tokens/image`, `tokens/rays`, `tokens/photo` | (D, 8, 8, 3 or 6) | U(±1/√inputs); U(±2/√inputs) for directions, U(±5/√inputs) for points or moments; 0 |
//! | `tokens/bias` | (D) | 0 |
//! | `places/planes`, `places/panoramas` | (T, D) | N(0, 1); those of planes from positions ([`super::places`]) |
//! | `fuse/w1`, `fuse/w2` | (D, 2D), (D, D) | with [`Fuse::Residual`] 0 and ±1 such that half of the channels of the last state are added as they are |
//! | `block/NN/qkv`, `out` | (3D, D), (D, D) | Xavier-uniform, N(0, σ²/(2·blocks)) |
//! | `block/NN/fc1/v`, `fc2/v` | (4D, D), (D, 4D) | N(0, σ²), N(0, σ²/(2·blocks)) |
//! | `unpatch/planes/v`, `unpatch/panoramas/v` | (D, 8, 8, C) | smooth patterns, rows of length 1/√3 |
//! | `…/g` | the rows of `v` | the length of each row of `v`, so that the weights are those of `v` |
//! | `…/gain`, `…/bias` of a LayerNorm | (D) | 1, 0 |
//! | other biases | | 0 |
//! | `heads/NAME/L` | (outputs, inputs) | Xavier-uniform with a gain of ½ (`sdf`, `normal`) or 2 |
//!
//! The table has the values of [`FirstValues::Scaled`], where σ is 0.02·√(1024/D) and inputs are 64 times the
//! channels. [`FirstValues::Published`] has U(±1/√inputs) for all rays, random place tokens of deviation
//! 1/√(tokens of a grid), N(0, 0.02²) in all layers of blocks but `qkv` and in those of `fuse` (`w2` of
//! [`Fuse::Residual`] is 0), U(±1/√(64 C)) for texels, and a gain of ¼.
//!
//! A moment m, like the nearest point d × m, has at most the length ½ and varies little within an image: with
//! the bound of the colours, a token would hardly show where its rays are. Branches of blocks add to their
//! tokens, so their last layers are divided by the root of their number, and a token remains the one of its
//! place. A row of texels is a sum of cos(πk(i+½)/8)·cos(πl(j+½)/8) with normal coefficients times (1 + k +
//! l)^−1.5: white noise would give the first signed distance a rough gradient. In `fuse`, GELU(x) − GELU(−x)
//! = x, so that half of the hidden units keep every second channel of the state.
//!
//! A plain model has heads for distance, colour and normal; a whole one also reads photos, and has heads for
//! albedo, material and ρ, and a colour head that reads the embedding. [`extended`] makes a whole model of a
//! plain one. Its texels are those of a trained model, 3.6 times as large as first ones, and a head with
//! first weights of gain 2 would begin at the ends of its range (metallic at 4·10⁻⁵, with a slope of
//! 3·10⁻⁴). So the new heads begin with values of the trained ones: albedo as the colour head, material with
//! its hidden layers and a last layer of 0 (½ everywhere), ρ with a last layer of 0. Where albedo and material
//! have another number of hidden layers than the colour head, both begin with its first ones and a last layer
//! of 0. The colour head's
//! columns for the embedding begin at half of their first values: with 0, panoramas would get no gradient
//! until the columns have grown.
//!
//! In the attention's first matrix the first D rows give the queries. Xavier's bound is that of the whole
//! matrix, as in PyTorch.

use super::config::{Config, FirstValues, Fuse, HIDDEN, PATCH};
use super::places;
use crate::num::array::entries;
use crate::num::elem::f64 as elem;
use crate::optim::initial::Initial;
use crate::scene::rays::PLUCKER;
use crate::tape::Params;
use crate::{Error, Result};
use core::f64::consts::PI;
use ndarray::{ArrayD, Axis, IxDyn, Slice};

/// Purpose of the first values; the step is the number of the array's name.
const PURPOSE: u16 = 0x0550;
/// Channels per pixel of image, rays and photo.
const INPUTS: [(&str, usize); 3] = [("image", 3), ("rays", 6), ("photo", 3)];

/// Hidden layers of the colour head.
const COLOR_LAYERS: usize = 3;
/// Factors of the first weights of directions, and of points or moments.
const RAYS: [f32; 2] = [2.0, 5.0];

/// How an array begins.
#[derive(Clone, Copy, Debug, PartialEq)]
enum First {
    /// All entries are this number.
    Constant(f32),
    /// Normal with this deviation.
    Normal(f64),
    /// Uniform in plus or minus this number.
    Uniform(f64),
    /// Xavier-uniform with this gain.
    Xavier(f32),
    /// From the positions of the planes' tokens.
    Positions,
    /// Uniform in plus or minus this number, times [`RAYS`].
    Rays(f64),
    /// Smooth patterns of texels, whose rows have this length.
    Patterns(f64),
    /// The first or last layer of `fuse` that keeps half of the channels of the state.
    Kept,
}

/// An array of a model.
#[derive(Clone, Debug)]
struct ArraySpec {
    name: String,
    shape: Vec<usize>,
    first: First,
}

/// Collects declarations.
#[derive(Default)]
struct List(Vec<ArraySpec>);

impl List {
    fn put(&mut self, name: impl Into<String>, shape: &[usize], first: First) {
        self.0.push(ArraySpec { name: name.into(), shape: shape.to_vec(), first });
    }

    fn norm(&mut self, name: &str, width: usize) {
        self.put(format!("{name}/gain"), &[width], First::Constant(1.0));
        self.put(format!("{name}/bias"), &[width], First::Constant(0.0));
    }

    /// A matrix without weight norm, and its bias.
    fn linear(&mut self, name: &str, shape: [usize; 2], first: First) {
        self.put(name, &shape, first);
        self.put(format!("{name}/bias"), &shape[..1], First::Constant(0.0));
    }
}

/// The widths of the heads that a model has: number of inputs, of hidden layers and of outputs.
pub(super) fn heads(c: &Config) -> Vec<(&'static str, [usize; 3])> {
    let features = 3 * c.channels;
    let is_directed = c.is_directed();
    let mut all = vec![
        ("sdf", [features, 2, 1]),
        ("color", [features + if is_directed { c.channels } else { 0 }, COLOR_LAYERS, 3]),
        ("normal", [features, 3, 3]),
    ];
    if c.is_whole {
        all.extend([
            ("albedo", [features, c.material_layers, 3]),
            ("material", [features, c.material_layers, 2]),
        ]);
    }
    if is_directed {
        all.push(("rho", [features, 2, 1]));
    }
    all
}

/// The numbers of units of a head, from its inputs to its outputs.
pub(super) fn widths([inputs, hidden, outputs]: [usize; 3]) -> Vec<usize> {
    let mut all = vec![inputs];
    all.extend(std::iter::repeat_n(HIDDEN, hidden));
    all.push(outputs);
    all
}

fn array_specs(c: &Config) -> Vec<ArraySpec> {
    let (d, deviation) = (c.width, c.first_values.deviation(c.width));
    let is_scaled = c.first_values == FirstValues::Scaled;
    // Branches add up: the tokens keep what they begin with.
    let closing = if is_scaled { deviation / (2.0 * c.blocks as f64).sqrt() } else { deviation };
    let mut list = List::default();
    for (name, channels) in INPUTS {
        let bound = 1.0 / ((PATCH * PATCH * channels) as f64).sqrt();
        match name {
            "photo" if !c.is_whole => continue,
            "photo" => list.put("tokens/photo", &[d, PATCH, PATCH, channels], First::Constant(0.0)),
            "rays" if is_scaled => list.put("tokens/rays", &[d, PATCH, PATCH, channels], First::Rays(bound)),
            _ => list.put(format!("tokens/{name}"), &[d, PATCH, PATCH, channels], First::Uniform(bound)),
        }
    }
    list.put("tokens/bias", &[d], First::Constant(0.0));
    list.norm("tokens/norm", d);
    let grids = [("planes", c.tokens()[0], c.plane_tokens), ("panoramas", c.tokens()[1], c.embed_tokens)];
    for (name, tokens, side) in grids.into_iter().filter(|g| g.1 > 0) {
        let place = match c.first_values {
            FirstValues::Scaled if name == "planes" => First::Positions,
            FirstValues::Scaled => First::Normal(1.0),
            FirstValues::Published => First::Normal(1.0 / side as f64),
        };
        list.put(format!("places/{name}"), &[tokens, d], place);
        let bound = 1.0 / ((PATCH * PATCH * c.channels) as f64).sqrt();
        let texels = if is_scaled { First::Patterns(1.0 / 3_f64.sqrt()) } else { First::Uniform(bound) };
        list.put(format!("unpatch/{name}/v"), &[d, PATCH, PATCH, c.channels], texels);
        list.put(format!("unpatch/{name}/bias"), &[c.channels], First::Constant(0.0));
    }
    let [opening, last] = match (c.fuse, is_scaled) {
        (Fuse::Published, _) => [First::Normal(deviation); 2],
        (Fuse::Residual, false) => [First::Normal(deviation), First::Constant(0.0)],
        (Fuse::Residual, true) => [First::Kept; 2],
    };
    list.linear("fuse/w1", [d, 2 * d], opening);
    list.linear("fuse/w2", [d, d], last);
    for b in 0..c.blocks {
        let name = |part: &str| format!("block/{b:02}/{part}");
        list.norm(&name("norm1"), d);
        list.linear(&name("qkv"), [3 * d, d], First::Xavier(1.0));
        list.linear(&name("out"), [d, d], First::Normal(closing));
        list.norm(&name("norm2"), d);
        for (part, shape, deviation) in [("fc1", [4 * d, d], deviation), ("fc2", [d, 4 * d], closing)] {
            list.put(name(&format!("{part}/v")), &shape[..], First::Normal(deviation));
            list.put(name(&format!("{part}/bias")), &shape[..1], First::Constant(0.0));
        }
    }
    list.norm("norm", d);
    for (name, sizes) in heads(c) {
        for (l, n) in widths(sizes).windows(2).enumerate() {
            list.put(format!("heads/{name}/{l}"), &[n[1], n[0]], First::Xavier(c.first_values.gain(name)));
        }
    }
    list.0
}

/// A layer of `fuse`, (D, 2D) or (D, D), such that both give every second channel of the state: GELU(x) −
/// GELU(−x) = x.
fn kept(shape: &[usize]) -> ArrayD<f32> {
    let (d, mut array) = (shape[0], ArrayD::zeros(IxDyn(shape)));
    for i in 0..d / 2 {
        for (hidden, sign) in [(i, 1.0), (d / 2 + i, -1.0)] {
            array[if shape[1] > d { [hidden, 2 * i] } else { [2 * i, hidden] }] = sign;
        }
    }
    array
}

/// Smooth patterns (rows, t, t, C): texel (i, j) is Σ w(k, i)·w(l, j)·(1 + k + l)^−1.5·N(0, 1) over k and l
/// in 0..t, with w(k, i) = cos(πk(i+½)/t) and w(0, i) = √½; then every row is scaled to a length. In f64 with
/// left folds, rounded once.
fn patterns(draws: &Initial, shape: &[usize], length: f64) -> ArrayD<f32> {
    let coefficients = draws.normal(shape, 1.0);
    let [rows, side, channels] = [shape[0], shape[1], shape[3]];
    let wave = |k: usize, x: usize| match k {
        0 => 0.5_f64.sqrt(),
        _ => elem::cos(PI * (x as f64 + 0.5) * k as f64 / side as f64),
    };
    let grid = || (0..side * side).map(|i| (i / side, i % side));
    let waves: Vec<f64> = grid().map(|(k, x)| wave(k, x)).collect();
    let decay = |k: usize, l: usize| {
        let x = (1 + k + l) as f64;
        (1.0 / (x * x * x)).sqrt()
    };
    let mut all = Vec::with_capacity(coefficients.len());
    for row in 0..rows {
        let mut own = vec![0.0; side * side * channels];
        for (n, (i, j)) in grid().enumerate() {
            for (c, sum) in own[n * channels..(n + 1) * channels].iter_mut().enumerate() {
                for (k, l) in grid() {
                    let coefficient = decay(k, l) * f64::from(coefficients[[row, k, l, c]]);
                    *sum += coefficient * (waves[k * side + i] * waves[l * side + j]);
                }
            }
        }
        let scale = length / own.iter().fold(0.0, |sum, x| sum + x * x).sqrt();
        all.extend(own.iter().map(|x| (x * scale) as f32));
    }
    ArrayD::from_shape_vec(IxDyn(shape), all).expect("as many as the shape has")
}

/// The length of every row of a matrix.
fn lengths(v: &ArrayD<f32>) -> ArrayD<f32> {
    let rows = v.shape()[0];
    let of = |row: ndarray::ArrayViewD<'_, f32>| {
        row.iter().fold(0.0, |sum, x| sum + f64::from(*x) * f64::from(*x)).sqrt() as f32
    };
    let all: Vec<f32> = v.axis_iter(Axis(0)).map(of).collect();
    ArrayD::from_shape_vec(IxDyn(&[rows]), all).expect("one length per row")
}

/// Returns the first values of a model.
pub fn first(c: &Config, seed: u64) -> Params {
    let mut params = Params::new();
    for ArraySpec { name, shape, first } in array_specs(c) {
        let draws = Initial::named(seed, PURPOSE, &name);
        let array = match first {
            First::Constant(x) => ArrayD::from_elem(IxDyn(&shape), x),
            First::Normal(deviation) => draws.normal(&shape, deviation),
            First::Uniform(bound) => draws.uniform_f64(&shape, bound),
            First::Xavier(gain) => draws.xavier_uniform(&shape, gain),
            First::Positions => {
                places::first(c, &Initial::named(seed, PURPOSE, &format!("{name}/directions")))
            }
            First::Rays(bound) => {
                let mut array = draws.uniform_f64(&shape, bound);
                // Directions, then moments or nearest points.
                let factor = |i: usize| if i % PLUCKER < 3 { RAYS[0] } else { RAYS[1] };
                array.iter_mut().enumerate().for_each(|(i, x)| *x *= factor(i));
                array
            }
            First::Patterns(length) => patterns(&draws, &shape, length),
            First::Kept => kept(&shape),
        };
        if let Some(row) = name.strip_suffix("/v") {
            params.set(&format!("{row}/g"), lengths(&array));
        }
        params.set(&name, array);
    }
    params
}

/// Part of their first values with which the colour head's columns for the embedding begin in a model that
/// was trained without.
const EMBEDDED: f32 = 0.5;

/// Returns a whole model of a plain one: the arrays of both are kept, the colour head gets columns for the
/// embedding, and the others begin (module text). A whole model stays as it is.
///
/// # Errors
/// When an array is missing or has another shape.
pub fn extended(params: &Params, c: &Config, seed: u64) -> Result<(Params, Config)> {
    let whole = Config { is_whole: true, ..*c };
    let mut all = first(&whole, seed);
    for ArraySpec { name, shape, .. } in array_specs(c) {
        let old = params.get(&name).filter(|a| a.shape() == shape).ok_or_else(|| {
            let got = params.get(&name).map_or_else(|| "none".to_owned(), |a| format!("{:?}", a.shape()));
            Error::input(format!("array '{name}'")).expected(format!("shape {shape:?}")).got(got)
        })?;
        let new = all.get_mut(&name).expect("a whole model has all arrays of a plain one");
        if new.shape() == old.shape() {
            new.assign(old);
        } else {
            new.mapv_inplace(|w| EMBEDDED * w);
            new.slice_axis_mut(Axis(1), Slice::from(..old.shape()[1])).assign(old);
        }
        if let Some(row) = name.strip_suffix("/v") {
            let g = format!("{row}/g");
            all.set(
                &g,
                params.get(&g).cloned().ok_or_else(|| {
                    Error::input(format!("array '{g}'")).expected("the lengths of rows").got("none")
                })?,
            );
        }
    }
    if !c.is_whole {
        let old = |l: usize| params.get(&format!("heads/color/{l}")).cloned().expect("it was kept above");
        for (name, [_, hidden, _]) in heads(&whole) {
            // As many layers as there are hidden ones, and the last.
            let (copied, is_zeroed) = match name {
                "albedo" if hidden == COLOR_LAYERS => (hidden + 1, false),
                "albedo" | "material" => (Ord::min(hidden, COLOR_LAYERS), true),
                "rho" => (0, true),
                _ => continue,
            };
            (0..copied).for_each(|l| all.set(&format!("heads/{name}/{l}"), old(l)));
            if is_zeroed {
                let last = all.get_mut(&format!("heads/{name}/{hidden}"));
                last.expect("a whole model has all layers").fill(0.0);
            }
        }
    }
    Ok((all, whole))
}

/// Returns names and shapes of all arrays.
pub fn shapes(c: &Config) -> Vec<(String, Vec<usize>)> {
    let mut all = Vec::new();
    for ArraySpec { name, shape, .. } in array_specs(c) {
        if let Some(row) = name.strip_suffix("/v") {
            all.push((format!("{row}/g"), shape[..1].to_vec()));
        }
        all.push((name, shape));
    }
    all
}

/// Returns the number of numbers in all arrays.
pub fn count(c: &Config) -> usize {
    shapes(c).iter().fold(0, |sum, (_, shape)| sum + entries(shape))
}

/// Whether weights decay: those of arrays with at least two axes.
pub fn decays(array: &ArrayD<f32>) -> bool {
    array.ndim() >= 2
}

/// How Muon takes an array apart, as matrices, rows and columns: those of the blocks and of the layer that
/// fuses states. Queries, keys and values are three matrices.
pub fn matrices(name: &str, array: &ArrayD<f32>) -> Option<[usize; 3]> {
    let &[rows, columns] = array.shape() else { return None };
    match name.split('/').collect::<Vec<_>>()[..] {
        ["block", _, "qkv"] => Some([3, rows / 3, columns]),
        ["block", _, "out"] | ["block", _, _, "v"] | ["fuse", _] => Some([1, rows, columns]),
        _ => None,
    }
}

#[cfg(test)]
mod tests;
