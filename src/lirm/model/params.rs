//! The arrays of a model: names, shapes and first values.
//!
//! | name | shape | first values |
//! |---|---|---|
//! | `tokens/image`, `tokens/rays`, `tokens/photo` | (D, 8, 8, 3 or 6) | U(±1/√inputs), U(±1/√inputs), 0 |
//! | `tokens/bias` | (D) | 0 |
//! | `places/planes`, `places/panoramas` | (T, D) | N(0, 1)/√(tokens of a grid); those of planes from positions ([`super::places`]) |
//! | `fuse/w1`, `fuse/w2` | (D, 2D), (D, D) | N(0, σ²); `w2` of [`Fuse::Residual`] 0 |
//! | `block/NN/qkv`, `out` | (3D, D), (D, D) | Xavier-uniform, N(0, σ²) |
//! | `block/NN/fc1/v`, `fc2/v` | (4D, D), (D, 4D) | N(0, σ²) |
//! | `unpatch/planes/v`, `unpatch/panoramas/v` | (D, 8, 8, C) | U(±1/√(64 C)) |
//! | `…/g` | the rows of `v` | the length of each row of `v`, so that the weights are those of `v` |
//! | `…/gain`, `…/bias` of a LayerNorm | (D) | 1, 0 |
//! | other biases | | 0 |
//! | `heads/NAME/L` | (outputs, inputs) | Xavier-uniform with a gain of ½ (`sdf`) or 2 |
//!
//! The table has the values of [`FirstValues::Scaled`], where σ is 0.02·√(1024/D). [`FirstValues::Published`] has σ = 0.02, random place tokens, and a gain of ¼.
//!
//! A plain model has heads for distance, colour and normal; a whole one also reads photos, and has heads for albedo, material
//! and ρ, and a colour head that reads the embedding. [`extended`] makes a whole model of a plain one, which computes the same colours.
//!
//! In the attention's first matrix the first D rows give the queries. Xavier's bound is that of the whole matrix, as in PyTorch.

use super::config::{Config, FirstValues, Fuse, HIDDEN, PATCH};
use super::places;
use crate::num::array::entries;
use crate::optim::initial::Initial;
use crate::tape::Params;
use crate::{Error, Result};
use ndarray::{ArrayD, Axis, IxDyn, Slice};

/// Purpose of the first values; the step is the number of the array's name.
const PURPOSE: u16 = 0x0550;
/// Channels per pixel of image, rays and photo.
const INPUTS: [(&str, usize); 3] = [("image", 3), ("rays", 6), ("photo", 3)];

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
}

/// An array of a model.
#[derive(Clone, Debug)]
struct Declared {
    name: String,
    shape: Vec<usize>,
    first: First,
}

/// Collects declarations.
#[derive(Default)]
struct List(Vec<Declared>);

impl List {
    fn put(&mut self, name: impl Into<String>, shape: &[usize], first: First) {
        self.0.push(Declared { name: name.into(), shape: shape.to_vec(), first });
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
    let is_directed = c.is_whole && c.has_embedding();
    let mut all = vec![
        ("sdf", [features, 2, 1]),
        ("color", [features + if is_directed { c.channels } else { 0 }, 3, 3]),
        ("normal", [features, 3, 3]),
    ];
    if c.is_whole {
        all.extend([("albedo", [features, 3, 3]), ("material", [features, 3, 2])]);
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

fn declared(c: &Config) -> Vec<Declared> {
    let (d, deviation) = (c.width, c.first_values.deviation(c.width));
    let mut list = List::default();
    for (name, channels) in INPUTS {
        let bound = 1.0 / ((PATCH * PATCH * channels) as f64).sqrt();
        match name {
            "photo" if !c.is_whole => continue,
            "photo" => list.put("tokens/photo", &[d, PATCH, PATCH, channels], First::Constant(0.0)),
            _ => list.put(format!("tokens/{name}"), &[d, PATCH, PATCH, channels], First::Uniform(bound)),
        }
    }
    list.put("tokens/bias", &[d], First::Constant(0.0));
    list.norm("tokens/norm", d);
    let grids = [("planes", c.tokens()[0], c.plane_tokens), ("panoramas", c.tokens()[1], c.embed_tokens)];
    for (name, tokens, side) in grids.into_iter().filter(|g| g.1 > 0) {
        let place = match c.first_values {
            FirstValues::Scaled if name == "planes" => First::Positions,
            _ => First::Normal(1.0 / side as f64),
        };
        list.put(format!("places/{name}"), &[tokens, d], place);
        let bound = 1.0 / ((PATCH * PATCH * c.channels) as f64).sqrt();
        list.put(format!("unpatch/{name}/v"), &[d, PATCH, PATCH, c.channels], First::Uniform(bound));
        list.put(format!("unpatch/{name}/bias"), &[c.channels], First::Constant(0.0));
    }
    list.linear("fuse/w1", [d, 2 * d], First::Normal(deviation));
    let last = match c.fuse {
        Fuse::Published => First::Normal(deviation),
        Fuse::Residual => First::Constant(0.0),
    };
    list.linear("fuse/w2", [d, d], last);
    for b in 0..c.blocks {
        let name = |part: &str| format!("block/{b:02}/{part}");
        list.norm(&name("norm1"), d);
        list.linear(&name("qkv"), [3 * d, d], First::Xavier(1.0));
        list.linear(&name("out"), [d, d], First::Normal(deviation));
        list.norm(&name("norm2"), d);
        for (part, shape) in [("fc1", [4 * d, d]), ("fc2", [d, 4 * d])] as [(&str, [usize; 2]); 2] {
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
    for Declared { name, shape, first } in declared(c) {
        let draws = Initial::named(seed, PURPOSE, &name);
        let array = match first {
            First::Constant(x) => ArrayD::from_elem(IxDyn(&shape), x),
            First::Normal(deviation) => draws.normal(&shape, deviation),
            First::Uniform(bound) => draws.uniform_f64(&shape, bound),
            First::Xavier(gain) => draws.xavier_uniform(&shape, gain),
            First::Positions => {
                places::first(c, &Initial::named(seed, PURPOSE, &format!("{name}/directions")))
            }
        };
        if let Some(row) = name.strip_suffix("/v") {
            params.set(&format!("{row}/g"), lengths(&array));
        }
        params.set(&name, array);
    }
    params
}

/// Returns a whole model of a plain one: the arrays of both are kept, the colour head gets columns of 0 for the embedding, and the
/// others begin. A whole model stays as it is.
///
/// # Errors
/// When an array is missing or has another shape.
pub fn extended(params: &Params, c: &Config, seed: u64) -> Result<(Params, Config)> {
    let whole = Config { is_whole: true, ..*c };
    let mut all = first(&whole, seed);
    for Declared { name, shape, .. } in declared(c) {
        let old = params.get(&name).filter(|a| a.shape() == shape).ok_or_else(|| {
            let got = params.get(&name).map_or_else(|| "none".to_owned(), |a| format!("{:?}", a.shape()));
            Error::input(format!("array '{name}'")).expected(format!("shape {shape:?}")).got(got)
        })?;
        let new = all.get_mut(&name).expect("a whole model has all arrays of a plain one");
        if new.shape() == old.shape() {
            new.assign(old);
        } else {
            new.fill(0.0);
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
    Ok((all, whole))
}

/// Returns names and shapes of all arrays.
pub fn shapes(c: &Config) -> Vec<(String, Vec<usize>)> {
    let mut all = Vec::new();
    for Declared { name, shape, .. } in declared(c) {
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

/// How Muon takes an array apart, as matrices, rows and columns: those of the blocks and of the layer that fuses states. Queries, keys and values are
/// three matrices.
pub fn matrices(name: &str, array: &ArrayD<f32>) -> Option<[usize; 3]> {
    let &[rows, columns] = array.shape() else { return None };
    match name.split('/').collect::<Vec<_>>()[..] {
        ["block", _, "qkv"] => Some([3, rows / 3, columns]),
        ["block", _, "out"] | ["block", _, _, "v"] | ["fuse", _] => Some([1, rows, columns]),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_those_of_the_paper_and_of_the_arrays() {
        let paper = Config { is_whole: true, ..Config::PAPER };
        assert!((count(&paper) as f64 / 1e6 - 326.0).abs() < 1.0, "{}", count(&paper));
        let small = Config { is_whole: true, ..Config::SMALL };
        assert!((count(&small) as f64 / 1e6 - 5.8).abs() < 0.05, "{}", count(&small));
        for config in [Config::SMALL, small, Config { planes: 3, plane_tokens: 11, embed_tokens: 0, ..small }]
        {
            let arrays = first(&config, 0);
            assert_eq!(arrays.iter().fold(0, |sum, (_, a)| sum + a.len()), count(&config));
        }
    }

    #[test]
    fn first_weights_are_those_of_their_directions() {
        let params = first(&Config::SMALL, 3);
        let (v, g) =
            (params.get("block/01/fc1/v").expect("there"), params.get("block/01/fc1/g").expect("there"));
        let row = v.index_axis(Axis(0), 7);
        let length = row.iter().fold(0.0, |s, x| s + f64::from(*x) * f64::from(*x)).sqrt();
        assert!((f64::from(g[7]) - length).abs() < 1e-7 * length);
        assert!((length / (0.04 * 16.0) - 1.0).abs() < 0.3, "√256 times the deviation: {length}");
    }

    #[test]
    fn a_plain_model_becomes_a_whole_one_with_the_same_colours() {
        let plain = first(&Config::SMALL, 1);
        let (whole, config) = extended(&plain, &Config::SMALL, 2).expect("all arrays");
        assert!(config.is_whole);
        let (old, new) =
            (plain.get("heads/color/0").expect("there"), whole.get("heads/color/0").expect("there"));
        assert_eq!((old.shape(), new.shape()), (&[32, 48][..], &[32, 64][..]));
        assert!(new.index_axis(Axis(0), 5).iter().skip(48).all(|w| *w == 0.0), "columns of 0");
        assert_eq!(new[[5, 47]], old[[5, 47]]);
        assert!(whole.get("tokens/photo").is_some_and(|a| a.iter().all(|w| *w == 0.0)));
        assert_eq!(plain.get("block/00/fc2/g"), whole.get("block/00/fc2/g"));
        let mut missing = plain.clone();
        missing.set("norm/gain", ArrayD::from_elem(IxDyn(&[3]), 1.0));
        let e = extended(&missing, &Config::SMALL, 2).expect_err("another shape").to_string();
        assert!(e.contains("norm/gain"), "{e}");
    }
}
