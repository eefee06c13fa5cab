//! Updates in the order of the causal graph: parents first, children bounded (last.md §12).
//!
//! Every factor i has key Gaussians K_i: those that move most when the rendered picture's factor is exchanged for the real one's. Factors without parents
//! are level 0, children one above their highest parent. An iteration goes through the levels; each renders anew, and steps its own keys alone. Gaussians
//! that are key to nothing, and the networks, belong to level 0. From level 1 on the step of factor i's keys in attribute a is c·lr·u with
//!
//! u = m̂/(√v̂ + ε),   c = min(1, λ r_ref / RMS_{K_i}(u)),   r_ref = max(1e-3, max over parents j of r_j(a)),   r_i(a) = c·RMS_{K_i}(u)
//!
//! and r_i(a) = RMS_{K_i}(u) at level 0. Attributes: centres, scales, rotations, opacities, colours. A Gaussian in two blocks of a level moves
//! once, with the smaller c.
//!
//! # Rounding
//! u is recovered from the step taken, (before − after)/lr in f64; RMS sums from the left over rows and columns. c = 1 keeps the bits of the
//! plain step, c = 0 those before it; else before + c·(after − before) in f32.

use crate::math::digraph::{Digraph, Nodes, nodes};
use crate::num::order;
use crate::num::rng::Rng;
use crate::optim::groups::Rates;
use crate::scene::columns::Column;
use crate::scene::gaussians::Gaussians;
use crate::{Error, Result};
use serde_json::{Value, json};

/// Purposes of the draws.
const PURPOSE_ORDER: u16 = 0x0905;
const PURPOSE_KEYS: u16 = 0x0906;
/// Least reference.
const FLOOR: f64 = 1e-3;
/// Least RMS that is divided by.
const LEAST: f64 = 1e-12;
/// A Gaussian that moves less is key to nothing.
const LEAST_SCORE: f64 = 1e-6;
/// Number of attributes.
pub const ATTRIBUTES: usize = 5;
/// Attributes: centres, scales, rotations, opacities, colours, in the order in which [`norm`] sums them.
const COLUMNS: [Column; ATTRIBUTES] =
    [Column::Means, Column::ScalesLog, Column::Quats, Column::OpacityLogits, Column::Sh];

/// What λ means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cap {
    /// The RMS of a child's step, relative to its parents'.
    Relative,
    /// The norm of the gradient, which is the step itself.
    Absolute,
    /// The norm of the gradient at which local steps end; at most five.
    Stop,
}

/// Which factor comes when.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Parents first.
    Topological,
    /// Every edge turned round.
    Reverse,
    /// Factors exchanged by a permutation drawn from the seed.
    Random,
    /// All at once.
    None,
}

/// How key Gaussians are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keys {
    /// By exchanging one factor.
    Swap,
    /// As many, drawn.
    Random,
    /// Every Gaussian is key to every factor.
    All,
}

macro_rules! named {
    ($kind:ident, $option:literal, $list:literal, $($variant:ident = $name:literal),*) => {
        impl $kind {
            /// The name used by settings.
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $name),* }
            }

            /// The one of that name.
            ///
            /// # Errors
            /// When there is none.
            pub fn parse(name: &str) -> Result<Self> {
                match name {
                    $($name => Ok(Self::$variant),)*
                    other => Err(Error::input($option).expected($list).got(other)),
                }
            }
        }
    };
}

named!(Cap, "--lambda-mode", "rel, abs or stop", Relative = "rel", Absolute = "abs", Stop = "stop");
named!(
    Order,
    "--order",
    "topo, reverse, random or none",
    Topological = "topo",
    Reverse = "reverse",
    Random = "random",
    None = "none"
);
named!(Keys, "--keys", "swap, random or all", Swap = "swap", Random = "random", All = "all");

/// Settings of the progressive update; iterations are those of the published 1 200.
#[derive(Clone, Debug, PartialEq)]
pub struct Progressive {
    /// λ ≥ 0; infinite binds nothing
    pub lambda: f64,
    /// What it means.
    pub cap: Cap,
    /// Which factor comes when.
    pub order: Order,
    /// How keys are found.
    pub keys: Keys,
    /// q: share of the Gaussians that are key to a factor
    pub share: f64,
    /// Keys are found anew at multiples of this,
    pub every: usize,
    /// from this iteration on.
    pub first: usize,
    /// Training pictures that are looked at for that.
    pub views: usize,
    /// A graph to use instead of the guide's.
    pub graph: Option<Digraph>,
}

impl Progressive {
    /// The defaults of last.md §12.6.
    pub fn published() -> Self {
        Self {
            lambda: 0.1,
            cap: Cap::Relative,
            order: Order::Topological,
            keys: Keys::Swap,
            share: 0.25,
            every: 100,
            first: 200,
            views: 8,
            graph: None,
        }
    }

    /// Whether a guide has to say something.
    pub fn needs_guide(&self) -> bool {
        self.graph.is_none() || self.keys == Keys::Swap
    }

    pub(super) fn validate(&self) -> Result<()> {
        if !(self.lambda >= 0.0) {
            return Err(Error::input("--lambda")
                .expected("a number, not negative, or inf")
                .got(self.lambda.to_string()));
        }
        if !(self.share > 0.0 && self.share <= 1.0) {
            return Err(Error::input("--key-share")
                .expected("above 0, at most 1")
                .got(self.share.to_string()));
        }
        for (name, n) in [("--key-every", self.every), ("--key-views", self.views)] {
            if n == 0 {
                return Err(Error::input(name).expected("at least 1").got("0"));
            }
        }
        Ok(())
    }

    pub(super) fn describe(&self, record: &mut Value) {
        record["progressive"] = Value::from("on");
        for (key, value) in [
            ("lambda", json!(self.lambda.to_string())),
            ("lambda_mode", json!(self.cap.name())),
            ("order", json!(self.order.name())),
            ("keys", json!(self.keys.name())),
            ("key_share", json!(self.share)),
            ("key_every", json!(self.every)),
            ("key_first", json!(self.first)),
            ("key_views", json!(self.views)),
            ("graph_given", json!(self.graph.as_ref().map(|g| (g.n(), g.edges())))),
        ] {
            record[key] = value;
        }
    }
}

/// Factors by level, and their parents.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// factors of each level, ascending
    pub levels: Vec<Vec<usize>>,
    /// (n) parents of each factor, as bits
    pub parents: Vec<Nodes>,
}

impl Plan {
    /// Levels of a graph under an order.
    ///
    /// # Errors
    /// When the graph has a cycle.
    pub fn new(graph: &Digraph, order: Order, seed: u64) -> Result<Self> {
        let n = graph.n();
        let graph = match order {
            Order::Topological => graph.clone(),
            Order::Reverse => Digraph::from_fn(n, |i, j| graph.has(j, i)),
            Order::Random => {
                let to = Rng::new(seed).permutation(n, 0, PURPOSE_ORDER);
                Digraph::from_fn(n, |i, j| graph.has(to[i], to[j]))
            }
            Order::None => Digraph::empty(n),
        };
        let Some(sequence) = graph.order() else {
            return Err(Error::input("causal graph")
                .expected("no cycle")
                .got(format!("edges {:?}", graph.edges())));
        };
        let mut level = vec![0; n];
        for j in sequence {
            level[j] = nodes(graph.parents(j)).map(|i| level[i] + 1).fold(0, Ord::max);
        }
        let depth = level.iter().fold(0, |m, &l| Ord::max(m, l));
        Ok(Self {
            levels: (0..=depth).map(|l| (0..n).filter(|&j| level[j] == l).collect()).collect(),
            parents: (0..n).map(|j| graph.parents(j)).collect(),
        })
    }
}

/// Bits of the factors to which each Gaussian is key, from scores (n, G): the ⌈q G⌉ largest of each factor, ties to the lower row, without those below 1e-6.
pub fn keys(scores: &[Vec<f64>], share: f64) -> Vec<u32> {
    let rows = scores.first().map_or(0, Vec::len);
    let count = size(rows, share);
    let mut members = vec![0; rows];
    for (i, score) in scores.iter().enumerate() {
        for g in super::ranking::ranked(score).into_iter().take(count).filter(|&g| score[g] >= LEAST_SCORE) {
            members[g] |= 1 << i;
        }
    }
    members
}

/// ⌈q G⌉
fn size(rows: usize, share: f64) -> usize {
    Ord::min(rows, libm::ceil(share * rows as f64) as usize)
}

/// As many keys for each of n factors, drawn.
pub fn random_keys(n: usize, rows: usize, share: f64, seed: u64, iteration: usize) -> Vec<u32> {
    let (rng, step) = (Rng::new(seed), u32::try_from(iteration).expect("validated"));
    let mut members = vec![0; rows];
    for i in 0..n {
        let draw = |g: usize| rng.block(g as u64, step, PURPOSE_KEYS, i as u16);
        let mut order: Vec<([u32; 2], usize)> = (0..rows).map(|g| ([draw(g)[1], draw(g)[0]], g)).collect();
        order.sort_unstable();
        for (_, g) in order.into_iter().take(size(rows, share)) {
            members[g] |= 1 << i;
        }
    }
    members
}

/// (G) 1 for the rows of a level's blocks; level 0 also has what is key to nothing.
pub fn block(members: &[u32], factors: &[usize], level: usize) -> Vec<u8> {
    let bits = factors.iter().fold(0u32, |b, i| b | 1 << i);
    members.iter().map(|&m| u8::from(m & bits != 0 || (level == 0 && m == 0))).collect()
}

/// RMS of u per factor and attribute.
pub type Sizes = Vec<[f64; ATTRIBUTES]>;

/// RMS of u over the keys of factor i, per attribute; 0 without keys.
pub fn sizes(
    before: &Gaussians,
    after: &Gaussians,
    rates: &Rates,
    members: &[u32],
    i: usize,
) -> [f64; ATTRIBUTES] {
    std::array::from_fn(|a| {
        let column = COLUMNS[a];
        let (x, y) = (before.column(column), after.column(column));
        let (width, rate) = (before.width(column), rates.of(column));
        let (mut sum, mut count) = (0.0f64, 0usize);
        for (g, _) in members.iter().enumerate().filter(|(_, m)| *m >> i & 1 == 1) {
            for c in 0..width {
                let at = g * width + c;
                let u = (f64::from(x[at]) - f64::from(y[at])) / rate[usize::from(c >= 3)];
                sum += u * u;
            }
            count += width;
        }
        if count == 0 { 0.0 } else { (sum / count as f64).sqrt() }
    })
}

/// Shortens the steps of a level's blocks and enters their sizes into `r`. Gives how many of the steps of factors' attributes were bound.
pub fn cap(
    before: &Gaussians,
    after: &mut Gaussians,
    rates: &Rates,
    members: &[u32],
    plan: &Plan,
    factors: &[usize],
    lambda: f64,
    r: &mut Sizes,
) -> usize {
    let mut scale: Vec<[f64; ATTRIBUTES]> = vec![[1.0; ATTRIBUTES]; r.len()];
    let mut bound = 0;
    for &i in factors {
        let rms = sizes(before, after, rates, members, i);
        for a in 0..ATTRIBUTES {
            let reference = nodes(plan.parents[i]).map(|j| r[j][a]).fold(FLOOR, order::max);
            let c = order::min(1.0, lambda * reference / order::max(rms[a], LEAST));
            bound += usize::from(c < 1.0);
            scale[i][a] = c;
            r[i][a] = c * rms[a];
        }
    }
    let rows = scales_of_rows(members, factors, &scale);
    for (a, column) in COLUMNS.into_iter().enumerate() {
        let (x, width) = (before.column(column), before.width(column));
        let y = after.column_mut(column);
        for (g, c) in rows.iter().enumerate().filter(|(_, c)| c[a] < 1.0) {
            let c = c[a] as f32;
            for at in g * width..(g + 1) * width {
                y[at] = x[at] + c * (y[at] - x[at]);
            }
        }
    }
    bound
}

/// The smallest scale of the factors of a level that a row is key to; 1 for rows of no block.
fn scales_of_rows(members: &[u32], factors: &[usize], scale: &[[f64; ATTRIBUTES]]) -> Vec<[f64; ATTRIBUTES]> {
    members
        .iter()
        .map(|m| {
            let of = factors.iter().filter(|i| m >> **i & 1 == 1).map(|&i| scale[i]);
            of.fold([1.0; ATTRIBUTES], |c, s| std::array::from_fn(|a| order::min(c[a], s[a])))
        })
        .collect()
}

/// Norm of the gradient over the keys of one factor, all attributes.
pub fn norm(grad: &Gaussians, members: &[u32], i: usize) -> f64 {
    let mut sum = 0.0;
    for column in COLUMNS {
        let (x, width) = (grad.column(column), grad.width(column));
        for (g, _) in members.iter().enumerate().filter(|(_, m)| *m >> i & 1 == 1) {
            for v in &x[g * width..(g + 1) * width] {
                sum += f64::from(*v) * f64::from(*v);
            }
        }
    }
    sum.sqrt()
}

/// The step −clip_norm(∇, λ) of a level's blocks, with rate 1. Gives how many factors were bound.
pub fn clipped(
    g: &mut Gaussians,
    grad: &Gaussians,
    members: &[u32],
    factors: &[usize],
    lambda: f64,
) -> usize {
    let mut scale = vec![[1.0; ATTRIBUTES]; factors.iter().fold(0, |m, &i| Ord::max(m, i + 1))];
    let mut bound = 0;
    for &i in factors {
        let norm = norm(grad, members, i);
        let c = order::min(1.0, lambda / order::max(norm, LEAST));
        bound += usize::from(c < 1.0);
        scale[i] = [c; ATTRIBUTES];
    }
    let rows = scales_of_rows(members, factors, &scale);
    let active = block(members, factors, 1);
    for (a, column) in COLUMNS.into_iter().enumerate() {
        let (x, width) = (grad.column(column), grad.width(column));
        let y = g.column_mut(column);
        for (row, c) in rows.iter().enumerate().filter(|(row, _)| active[*row] == 1) {
            for at in row * width..(row + 1) * width {
                y[at] -= c[a] as f32 * x[at];
            }
        }
    }
    bound
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_follow_the_graph_and_its_controls() {
        let fork = Digraph::new(4, &[(0, 1), (0, 2), (1, 3)]);
        let of = |order| Plan::new(&fork, order, 5).expect("no cycle").levels;
        assert_eq!(of(Order::Topological), [vec![0], vec![1, 2], vec![3]], "parents first");
        assert_eq!(of(Order::Reverse), [vec![2, 3], vec![1], vec![0]], "children first");
        assert_eq!(of(Order::None), [vec![0, 1, 2, 3]], "at once");
        assert_eq!(of(Order::Random).len(), 3, "the same shape");
        assert!(Plan::new(&Digraph::new(2, &[(0, 1), (1, 0)]), Order::Topological, 0).is_err(), "a cycle");
    }

    #[test]
    fn every_gaussian_is_key_to_something_or_to_nothing() {
        let scores = vec![vec![0.5, 0.5, 0.1, 0.0, 0.0], vec![0.0, 0.0, 0.0, 0.0, 1e-7]];
        let members = keys(&scores, 0.25);
        assert_eq!(members, [1, 1, 0, 0, 0], "⌈5/4⌉ = 2, ties to the lower row, nothing below 1e-6");
        assert_eq!(block(&members, &[0], 0), [1; 5], "level 0 has the rest");
        assert_eq!(block(&members, &[0], 1), [1, 1, 0, 0, 0], "later levels have their keys alone");
        let drawn = random_keys(3, 40, 0.25, 1, 200);
        for i in 0..3 {
            assert_eq!(drawn.iter().filter(|m| *m >> i & 1 == 1).count(), 10, "as many");
        }
    }

    #[test]
    fn caps_bound_the_rms() {
        let g = |d: f32| Gaussians {
            means: (0..4).map(|i| [i as f32 + d; 3]).collect(),
            quats: vec![[1.0 + d, d, d, d]; 4],
            scales_log: vec![[d; 3]; 4],
            opacity_logits: vec![d; 4],
            sh: vec![d; 12],
            sh_degree: 0,
        };
        let rates =
            Rates { means: 0.25, quats: 0.5, scales_log: 0.5, opacity_logits: 0.5, sh_dc: 0.5, sh_rest: 0.5 };
        let (before, after) = (g(0.0), g(0.5));
        let plan = Plan::new(&Digraph::new(2, &[(0, 1)]), Order::Topological, 0).expect("no cycle");
        let members = [1, 3, 2, 0];
        let mut r = vec![sizes(&before, &after, &rates, &members, 0), [0.0; ATTRIBUTES]];
        assert_eq!(r[0], [2.0, 1.0, 1.0, 1.0, 1.0], "step over rate");
        for (lambda, move_by) in [(0.0, 0.0), (0.125, 0.0625), (f64::INFINITY, 0.5)] {
            let mut moved = after.clone();
            let bound = cap(&before, &mut moved, &rates, &members, &plan, &[1], lambda, &mut r);
            assert_eq!(bound, if lambda < 1.0 { 5 } else { 0 }, "bound steps at {lambda}");
            assert_eq!(moved.means[2], [2.0 + move_by; 3], "a key of the child at {lambda}");
            assert_eq!(moved.scales_log[1], [move_by; 3], "a key of both");
            assert_eq!(moved.means[0], after.means[0], "not a key of the child");
            assert_eq!(r[1][0], if lambda < 1.0 { lambda * 2.0 } else { 2.0 }, "the child's own size");
        }
        let mut direct = before.clone();
        assert_eq!(clipped(&mut direct, &after, &members, &[1], 1e9), 0, "nothing binds");
        assert_eq!(direct.means[2], [2.0 - 2.5; 3], "unit rate");
        assert_eq!(direct.means[0], before.means[0], "not in the block");
        let mut clip = before.clone();
        assert_eq!(clipped(&mut clip, &after, &members, &[1], 0.1), 1, "bound");
        let moved: f64 = clip
            .means
            .as_flattened()
            .iter()
            .zip(before.means.as_flattened())
            .map(|(a, b)| f64::from((a - b) * (a - b)))
            .fold(0.0, |sum, x| sum + x);
        assert!(moved.sqrt() < 0.1001, "no longer than λ");
    }
}
