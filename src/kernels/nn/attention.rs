//! `nn.attention`: multi-head self-attention with its projections.
//!
//! [Q K V] = x·W_qkvᵀ + b_qkv;   per head   O = softmax(Q·Kᵀ/√d)·V;   y = [O₁ … O_H]·W_outᵀ + b_out        (Vaswani et al. 2017)
//!
//! The bias of the keys adds the same number to all logits of a query, so y does not depend on it: it is not read, and its gradient is exactly 0. (Where it
//! is read, its gradient is rounding noise, which Adam scales up to a full step.) W_qkv stacks the rows of q, k and v; heads split the D columns of each in order, d = D/H of them per head.
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | x | `x` | (T, D), tokens | finite |
//! | W_qkv, b_qkv | `w_qkv`, `b_qkv` | (3D, D), (3D) | finite |
//! | W_out, b_out | `w_out`, `b_out` | (D, D), (D) | finite |
//! | | `attended` | (T), optional | 0 or not: whether a token is attended to |
//! | H | `heads` | () | divides D |
//! | y | `y` | (T, D) | |
//!
//! # Rounding
//! The projections round as [`mod@super::linear`]. A logit is one chain over the d columns, then one product with 1/√d. The softmax is online: over
//! blocks of [`KEYS`] keys, which are part of the definition, in order. Per block, with running maximum m, sum l and output o:
//!
//! m' = max(m, logits of the block),   c = e^(m − m'),   p = e^(logit − m')        ([`mod@online`])
//! l = l·c + Σp over 16 lanes,   o = o·c, then each entry goes on as one chain of p·v over the keys, ascending
//!
//! and O = o/l at the end. Memory is linear in T: no matrix of logits is kept. Blocks of queries and threads change no bit.
//!
//! # Kinks and domain
//! m is not differentiated: the softmax does not depend on it. Differences of logits below −87.3 count as −87.3, a weight of 10⁻³⁸. If `attended` is 0
//! everywhere, O = 0 and y = b_out, and b_out alone has a gradient.
//!
//! # Adjoint
//! With O saved, P = e^(logit − m)/l is computed again, block by block:
//!
//! V̄ += Pᵀ·Ō,   S̄ = P∘(Ō·Vᵀ − ⟨Ō, O⟩)/√d,   Q̄ = S̄·K,   K̄ += S̄ᵀ·Q        (⟨,⟩ per query and head, over 16 lanes)
//!
//! Q̄ is one chain over the keys, K̄ and V̄ are one over the queries in index order. The projections follow as in [`mod@super::linear`]. Q, K, V, O, m and l are saved.
//!
//! Twin: `reference::nn::attention`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::nn::attention::{In, forward};
//! // One column: q = 0 attends to both tokens alike, v = x, y = their mean.
//! let x = In {
//!     x: &[1.0, 3.0], w_qkv: &[0.0, 1.0, 1.0], b_qkv: &[0.0; 3], w_out: &[1.0], b_out: &[0.0],
//!     attended: &[], tokens: 2, heads: 1,
//! };
//! let mut y = [0.0; 2];
//! forward(&x, &mut y);
//! assert_eq!(y, [2.0, 2.0]);
//! ```

use super::linear;
use crate::num::gemm::{CHUNK, Finish, Packed, View, gemm_packed_here};
use crate::num::online::{self, Rows};
use crate::num::{par, sum};
use std::ops::Range;

/// Keys per block; part of the definition.
pub const KEYS: usize = 64;
/// Queries per task: eight register tiles of rows, whose products with a block of keys stay in the first-level cache. The number changes no bit.
const QUERIES: usize = 96;
/// The same for the adjoint, whose sums over queries are resumed once for so many. The number changes no bit.
const TOGETHER: usize = 192;

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (T, D).
    pub x: &'a [f32],
    /// Shape (3D, D).
    pub w_qkv: &'a [f32],
    /// Shape (3D).
    pub b_qkv: &'a [f32],
    /// Shape (D, D).
    pub w_out: &'a [f32],
    /// Shape (D).
    pub b_out: &'a [f32],
    /// Shape (T): 0 where a token is not attended to; empty: all are.
    pub attended: &'a [f32],
    /// Number of tokens T, at least 1.
    pub tokens: usize,
    /// Number of heads H.
    pub heads: usize,
}

/// What the adjoint needs.
#[derive(Clone, Debug, Default)]
pub struct Saved {
    /// Shape (T, 3D): Q, K and V.
    qkv: Vec<f32>,
    /// Shape (T, D): O of all heads.
    o: Vec<f32>,
    /// Shape (T, H, 2): m and l.
    rows: Vec<f32>,
}

/// Gradients; the adjoint adds to them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InBar {
    /// Shape (T, D).
    pub x: Vec<f32>,
    /// Shape (3D, D).
    pub w_qkv: Vec<f32>,
    /// Shape (3D).
    pub b_qkv: Vec<f32>,
    /// Shape (D, D).
    pub w_out: Vec<f32>,
    /// Shape (D).
    pub b_out: Vec<f32>,
}

impl InBar {
    /// Returns zeros in the shapes of the inputs.
    pub fn zeros_like(x: &In<'_>) -> Self {
        let zeros = |like: &[f32]| vec![0.0; like.len()];
        Self {
            x: zeros(x.x),
            w_qkv: zeros(x.w_qkv),
            b_qkv: zeros(x.b_qkv),
            w_out: zeros(x.w_out),
            b_out: zeros(x.b_out),
        }
    }
}

/// Sizes of a layer.
#[derive(Clone, Copy)]
struct Sizes {
    tokens: usize,
    /// D.
    width: usize,
    /// d.
    head: usize,
    heads: usize,
}

impl Sizes {
    /// 1/√d.
    fn scale(self) -> f32 {
        (1.0 / (self.head as f64).sqrt()) as f32
    }

    /// Keys and values of a head, of the given tokens.
    fn keys_and_values(self, qkv: &[f32], head: usize, of: &[usize]) -> [Vec<f32>; 2] {
        [1, 2].map(|part| {
            let mut rows = Vec::with_capacity(of.len() * self.head);
            let place = [part * self.width + head * self.head, self.head, 3 * self.width];
            gathered(qkv, of.iter().copied(), place, &mut rows);
            rows
        })
    }
}

impl<'a> In<'a> {
    fn sizes(&self) -> Sizes {
        let (tokens, heads) = (self.tokens, self.heads);
        assert!(tokens > 0 && self.x.len().is_multiple_of(tokens), "x is (T, D)");
        let width = self.x.len() / tokens;
        assert!(heads > 0 && width > 0 && width.is_multiple_of(heads), "heads divide D");
        assert!(self.attended.is_empty() || self.attended.len() == tokens, "attended is (T)");
        Sizes { tokens, width, head: width / heads, heads }
    }

    /// The projection to Q, K and V with the given bias.
    fn projection<'b>(&self, bias: &'b [f32], width: usize) -> linear::In<'b>
    where
        'a: 'b,
    {
        linear::In { x: self.x, weight: self.w_qkv, bias, m: self.tokens, n: 3 * width, k: width }
    }

    /// The bias with 0 for the keys.
    fn bias(&self, width: usize) -> Vec<f32> {
        let mut bias = self.b_qkv.to_vec();
        bias[width..2 * width].fill(0.0);
        bias
    }

    fn output<'b>(&self, o: &'b [f32], width: usize) -> linear::In<'b>
    where
        'a: 'b,
    {
        linear::In { x: o, weight: self.w_out, bias: self.b_out, m: self.tokens, n: width, k: width }
    }

    /// Indices of the tokens that are attended to.
    fn keys(&self) -> Vec<usize> {
        (0..self.tokens).filter(|i| self.attended.get(*i).is_none_or(|a| *a != 0.0)).collect()
    }
}

/// Rows of a part of an array (T, 3D) or (T, D) that follow each other: `row` numbers of each from index `first` on, `stride` apart.
fn gathered(
    x: &[f32],
    of: impl Iterator<Item = usize>,
    [first, row, stride]: [usize; 3],
    into: &mut Vec<f32>,
) {
    into.clear();
    of.for_each(|i| into.extend_from_slice(&x[i * stride + first..][..row]));
}

/// Keys or values of one head, by blocks, as right factors: X (keys, d) or Xᵀ (d, keys).
fn blocks(x: &[f32], d: usize, is_transposed: bool) -> Vec<Packed> {
    let block = |x: &[f32]| {
        let view = View::new(x, x.len() / d, d);
        Packed::new(if is_transposed { view.t() } else { view })
    };
    x.chunks(KEYS * d).map(block).collect()
}

/// One head: its place in the arrays, and the factors that all of its queries share.
struct Head {
    /// Kᵀ, (d, keys).
    keys_t: Vec<Packed>,
    /// V, (keys, d).
    values: Vec<Packed>,
}

impl Head {
    fn new(s: Sizes, qkv: &[f32], head: usize, keys: &[usize]) -> Self {
        let [k, v] = s.keys_and_values(qkv, head, keys);
        Self { keys_t: blocks(&k, s.head, true), values: blocks(&v, s.head, false) }
    }
}

/// Buffers of a task.
#[derive(Default)]
struct Buffers {
    q: Vec<f32>,
    o: Vec<f32>,
    p: Vec<f32>,
}

/// Writes O of some queries of a head to column `head·d` of rows of D numbers, and their m and l.
fn attend(
    s: Sizes,
    qkv: &[f32],
    (h, head): (usize, &Head),
    of: Range<usize>,
    own: &mut Buffers,
    into: [&mut [f32]; 2],
) {
    let (n, d, [all, stats]) = (of.len(), s.head, into);
    gathered(qkv, of, [h * d, d, 3 * s.width], &mut own.q);
    own.o.clear();
    own.o.resize(n * d, 0.0);
    own.p.resize(n * KEYS, 0.0);
    let q = View::new(&own.q, n, d);
    let mut rows = Rows::new(n);
    for (keys_t, values) in head.keys_t.iter().zip(&head.values) {
        let width = values.rows();
        let p = &mut own.p[..n * width];
        gemm_packed_here(q, keys_t, Finish::Store, p);
        rows.block(p, width, s.scale());
        for (o, c) in own.o.chunks_exact_mut(d).zip(&rows.factor) {
            if *c != 1.0 {
                o.iter_mut().for_each(|o| *o *= c);
            }
        }
        gemm_packed_here(View::new(p, n, width), values, Finish::Resume, &mut own.o);
    }
    let stats = stats.chunks_exact_mut(2 * s.heads).map(|row| &mut row[2 * h..2 * h + 2]);
    let all = all.chunks_exact_mut(s.width).map(|row| &mut row[h * d..(h + 1) * d]);
    let rows = rows.most.iter().zip(&rows.total);
    for ((((most, total), o), all), stats) in rows.zip(own.o.chunks_exact(d)).zip(all).zip(stats) {
        stats.copy_from_slice(&[*most, *total]);
        let total = if *total > 0.0 { *total } else { 1.0 };
        all.iter_mut().zip(o).for_each(|(all, o)| *all = o / total);
    }
}

/// Writes y (T, D) and returns what the adjoint needs.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn forward(x: &In<'_>, y: &mut [f32]) -> Saved {
    let s = x.sizes();
    let (t, width) = (s.tokens, s.width);
    let mut qkv = vec![0.0; t * 3 * width];
    linear::forward(x.projection(&x.bias(width), width), &mut qkv);
    let keys = x.keys();
    let heads = par::map(s.heads, |h| Head::new(s, &qkv, h, &keys));
    let (mut o, mut rows) = (vec![0.0; t * width], vec![0.0; t * s.heads * 2]);
    par::chunks_mut2(&mut o, QUERIES * width, &mut rows, QUERIES * s.heads * 2, |c, o, rows| {
        let (first, mut own) = (c * QUERIES, Buffers::default());
        for head in heads.iter().enumerate() {
            attend(s, &qkv, head, first..first + o.len() / width, &mut own, [o, rows]);
        }
    });
    linear::forward(x.output(&o, width), y);
    Saved { qkv, o, rows }
}

/// Copies rows of d numbers to column `at` of an array with rows of `stride`, from row `first` on.
fn put(s: Sizes, into: &mut [f32], at: usize, stride: usize, first: usize, rows: &[f32]) {
    for (r, row) in rows.chunks_exact(s.head).enumerate() {
        into[(first + r) * stride + at..][..s.head].copy_from_slice(row);
    }
}

/// Gradients of one head: of Q (T, d), and of K and V of the tokens that are attended to.
struct HeadBar {
    q: Vec<f32>,
    k: Vec<f32>,
    v: Vec<f32>,
}

/// Adds up chains over parts of k, as [`crate::num::gemm`] does beyond [`CHUNK`].
fn joined(parts: Vec<Vec<f32>>, len: usize) -> Vec<f32> {
    if parts.is_empty() { vec![0.0; len] } else { sum::tree_arrays(parts) }
}

/// The adjoint of one head, on this thread.
fn head_bar(s: Sizes, saved: &Saved, o_bar: &[f32], head: usize, keys: &[usize]) -> HeadBar {
    let (t, d) = (s.tokens, s.head);
    let [k, v] = s.keys_and_values(&saved.qkv, head, keys);
    let [factors_k, factors_v] = [&k, &v].map(|x| blocks(x, d, true)); // Kᵀ and Vᵀ
    let keys_of = blocks(&k, d, false);
    let (mut q_bar, mut sums) = (Vec::with_capacity(t * d), [Vec::new(), Vec::new()]);
    let (mut packed_q, mut packed_o) = (Packed::default(), Packed::default());
    let (mut p, mut p_bar) = (vec![0.0; TOGETHER * KEYS], vec![0.0; TOGETHER * KEYS]);
    let (mut q, mut g) = (Vec::new(), Vec::new());
    for chunk in (0..t).step_by(CHUNK) {
        // Chains over the queries of this chunk.
        let [mut k_bar, mut v_bar] = [vec![0.0; keys.len() * d], vec![0.0; keys.len() * d]];
        let end = t.min(chunk + CHUNK);
        for first in (chunk..end).step_by(TOGETHER) {
            let of = first..end.min(first + TOGETHER);
            let n = of.len();
            gathered(&saved.qkv, of.clone(), [head * d, d, 3 * s.width], &mut q);
            gathered(o_bar, of.clone(), [head * d, d, s.width], &mut g);
            let (q, g) = (View::new(&q, n, d), View::new(&g, n, d));
            (packed_q, packed_o) = (packed_q.repacked(q), packed_o.repacked(g));
            let place = |i: usize| i * s.width + head * d;
            let stats = of.clone().map(|i| {
                let row = &saved.rows[2 * (i * s.heads + head)..][..2];
                [row[0], row[1], sum::dot16(&o_bar[place(i)..][..d], &saved.o[place(i)..][..d])]
            });
            let stats: Vec<[f32; 3]> = stats.collect();
            let mut parts: Vec<Vec<f32>> = Vec::new();
            for b in 0..keys_of.len() {
                if (b * KEYS).is_multiple_of(CHUNK) {
                    parts.push(vec![0.0; n * d]);
                }
                let width = keys_of[b].rows();
                let (p, p_bar) = (&mut p[..n * width], &mut p_bar[..n * width]);
                gemm_packed_here(q, &factors_k[b], Finish::Store, p);
                gemm_packed_here(g, &factors_v[b], Finish::Store, p_bar);
                online::weights(p, p_bar, width, s.scale(), &stats);
                let own = b * KEYS * d..(b * KEYS + width) * d;
                let (p, p_bar) = (View::new(p, n, width), View::new(p_bar, n, width));
                gemm_packed_here(p.t(), &packed_o, Finish::Resume, &mut v_bar[own.clone()]);
                gemm_packed_here(p_bar.t(), &packed_q, Finish::Resume, &mut k_bar[own]);
                let part = parts.last_mut().expect("the first block begins a part");
                gemm_packed_here(p_bar, &keys_of[b], Finish::Resume, part);
            }
            q_bar.extend(joined(parts, n * d));
        }
        sums[0].push(k_bar);
        sums[1].push(v_bar);
    }
    let [k, v] = sums.map(|parts| joined(parts, keys.len() * d));
    HeadBar { q: q_bar, k, v }
}

/// Adds the gradients for the cotangent `y_bar` (T, D) to `x_bar`.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn adjoint(x: &In<'_>, saved: &Saved, y_bar: &[f32], x_bar: &mut InBar) {
    let s = x.sizes();
    let (t, width) = (s.tokens, s.width);
    let take = std::mem::take;
    let mut out = linear::InBar {
        x: vec![0.0; t * width],
        weight: take(&mut x_bar.w_out),
        bias: take(&mut x_bar.b_out),
    };
    linear::adjoint(x.output(&saved.o, width), y_bar, &mut out);
    (x_bar.w_out, x_bar.b_out) = (out.weight, out.bias);
    let (o_bar, keys) = (out.x, x.keys());
    let heads = par::map(s.heads, |h| head_bar(s, saved, &o_bar, h, &keys));
    let mut qkv_bar = vec![0.0; t * 3 * width];
    for (h, bar) in heads.into_iter().enumerate() {
        put(s, &mut qkv_bar, h * s.head, 3 * width, 0, &bar.q);
        for (part, rows) in [(1, bar.k), (2, bar.v)] {
            for (i, row) in keys.iter().zip(rows.chunks_exact(s.head)) {
                put(s, &mut qkv_bar, part * width + h * s.head, 3 * width, *i, row);
            }
        }
    }
    let bias = x.bias(width);
    let mut own =
        linear::InBar { x: take(&mut x_bar.x), weight: take(&mut x_bar.w_qkv), bias: vec![0.0; 3 * width] };
    linear::adjoint(x.projection(&bias, width), &qkv_bar, &mut own);
    own.bias[width..2 * width].fill(0.0);
    x_bar.b_qkv.iter_mut().zip(&own.bias).for_each(|(bar, own)| *bar += own);
    (x_bar.x, x_bar.w_qkv) = (own.x, own.weight);
}
