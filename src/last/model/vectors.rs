//! Data without images: a fixed random invertible map of the factors replaces the image, and is also the
//! target of the decoder.
//!
//! x = Q₂ λ(Q₁ u),  Q₁ (16, n) with orthonormal columns, Q₂ (16, 16) orthogonal, λ a leaky ReLU of slope ½.
//!
//! Structure learning is tested on these data first: an item costs microseconds, and a method that fails on
//! them will also fail on images.

use super::data::{Data, Frame, Group, Item};
use super::encoder::Input;
use super::purpose;
use crate::num::rng::Rng;
use data_gen::figure::mechanism::Scm;
use data_gen::figure::samples;

/// Number of entries of a vector.
pub const SIZE: usize = 16;
/// Slope of the leaky ReLU of the map.
const SLOPE: f64 = 0.5;
/// σ of the loss.
const SIGMA: f32 = 0.1;

/// Vectors with known factors.
#[derive(Clone, Debug)]
pub struct Vectors {
    frame: Frame,
    groups: Vec<Group>,
    observed: Vec<f32>,
    base: Vec<f32>,
    after: Vec<f32>,
    n: usize,
    /// True factors of the observed items, of the items before and of those after interventions: (N, n),
    /// (G·M, n), (G·M, n).
    factors: [Vec<f64>; 3],
}

/// Columns of a random matrix (SIZE, n), orthonormalised in order.
fn orthonormal(seed: u64, n: usize, which: u32) -> Vec<[f64; SIZE]> {
    let rng = Rng::new(seed);
    let dot = |a: &[f64; SIZE], b: &[f64; SIZE]| a.iter().zip(b).fold(0.0, |s, (a, b)| s + a * b);
    let mut columns: Vec<[f64; SIZE]> = Vec::new();
    for j in 0..n {
        let mut column: [f64; SIZE] =
            std::array::from_fn(|i| rng.normal_f64((j * SIZE + i) as u64, which, purpose::VECTORS, 0));
        for before in &columns {
            let share = dot(&column, before);
            column.iter_mut().zip(before).for_each(|(c, b)| *c -= share * b);
        }
        let length = dot(&column, &column).sqrt();
        columns.push(column.map(|c| c / length));
    }
    columns
}

/// The map from factors to vectors.
struct Map([Vec<[f64; SIZE]>; 2]);

impl Map {
    fn apply(&self, u: &[f64]) -> [f32; SIZE] {
        let times = |columns: &[[f64; SIZE]], x: &[f64]| -> [f64; SIZE] {
            std::array::from_fn(|i| columns.iter().zip(x).fold(0.0, |s, (c, x)| s + c[i] * x))
        };
        let hidden = times(&self.0[0], u).map(|h| if h > 0.0 { h } else { SLOPE * h });
        times(&self.0[1], &hidden).map(|x| x as f32)
    }
}

impl Vectors {
    /// Draws `observed` items and `groups` groups from a causal model.
    pub fn new(scm: &Scm, seed: u64, observed: usize, groups: usize) -> Self {
        Self::drawn(scm, [seed, seed], observed, groups)
    }

    /// As [`Self::new`], with separate seeds for the map and for the draws, which gives other data from the
    /// same source.
    pub fn drawn(scm: &Scm, [map, seed]: [u64; 2], observed: usize, groups: usize) -> Self {
        let n = scm.graph.n();
        let map = Map([orthonormal(map, n, 0), orthonormal(map, SIZE, 1)]);
        let mut all = Self {
            frame: Frame {
                features: 0,
                outputs: SIZE,
                codes: Vec::new(),
                base: vec![0.0; SIZE],
                scale: vec![1.0; SIZE],
                precision: vec![1.0 / (SIGMA * SIGMA * SIZE as f32); SIZE],
            },
            groups: Vec::new(),
            observed: Vec::new(),
            base: Vec::new(),
            after: Vec::new(),
            n,
            factors: Default::default(),
        };
        for i in 0..observed {
            let u = samples::observed(scm, seed, i, observed, 1).u;
            all.observed.extend(map.apply(&u));
            all.factors[0].extend(u);
        }
        for i in 0..groups {
            let group = samples::group(scm, seed, i, 1);
            all.groups.push(Group { target: group.target, value: group.value });
            for (base, after) in group.bases.iter().zip(&group.after) {
                all.base.extend(map.apply(&base.u));
                all.after.extend(map.apply(&after.u));
                all.factors[1].extend(&base.u);
                all.factors[2].extend(&after.u);
            }
        }
        all
    }
}

/// The set that contains an item, and its index in that set.
fn place(item: Item) -> (usize, usize) {
    match item {
        Item::Observed(i) => (0, i),
        Item::Base(g, m) => (1, g * samples::BASES + m),
        Item::After(g, m) => (2, g * samples::BASES + m),
    }
}

impl Data for Vectors {
    fn input(&self) -> Input {
        Input::Vector { size: SIZE }
    }

    fn observed(&self) -> usize {
        self.observed.len() / SIZE
    }

    fn groups(&self) -> &[Group] {
        &self.groups
    }

    fn members(&self) -> usize {
        samples::BASES
    }

    fn frame(&self) -> &Frame {
        &self.frame
    }

    fn template(&self) -> &[[f32; 3]] {
        &[]
    }

    fn write_input(&self, item: Item, into: &mut [f32]) {
        into.copy_from_slice(self.shown(item));
    }

    fn true_factors(&self) -> usize {
        self.n
    }

    fn truth(&self, item: Item) -> &[f64] {
        let (set, at) = place(item);
        &self.factors[set][at * self.n..][..self.n]
    }

    fn shown(&self, item: Item) -> &[f32] {
        let (set, at) = place(item);
        &[&self.observed, &self.base, &self.after][set][at * SIZE..][..SIZE]
    }
}
