//! The kernel of [`super::adam`]: one step over the rows of one task, eight lanes at a time.
//!
//! Which path an element takes (a whole block of rows, one row, lanes of different rows, one element) affects
//! speed only: all of them evaluate the same expression.

use super::rule::Rule;
use crate::num::lanes::{Real, f32x8};

/// 1/(1−β₁ᵗ), 1/(1−β₂ᵗ) for t = 0, 1, …, as far as needed, until both are 1.
#[derive(Clone, Debug)]
pub(super) struct Corrections {
    powers: [f64; 2],
    table: Vec<[f32; 2]>,
}

impl Corrections {
    pub(super) fn new() -> Self {
        Self { powers: [1.0; 2], table: vec![[1.0; 2]] } // t = 0 is never looked up
    }

    /// Extends the table to cover step `t`.
    pub(super) fn cover(&mut self, rule: &Rule, t: u32) {
        while self.table.len() <= t as usize
            && (self.table.len() == 1 || self.table.last() != Some(&[1.0; 2]))
        {
            self.powers = [self.powers[0] * rule.beta1, self.powers[1] * rule.beta2];
            self.table.push(self.powers.map(|p| (1.0 / (1.0 - p)) as f32));
        }
    }

    #[inline(always)]
    pub(super) fn at(&self, t: u32) -> [f32; 2] {
        self.table[(t as usize).min(self.table.len() - 1)]
    }
}

/// Number of rows per pass: 8·W elements are an integer number of vectors for any W.
pub(super) const BLOCK: usize = 8;
/// Rows narrower than this share vectors.
const NARROW: usize = 12;

/// Constants of a step in lanes.
#[derive(Clone, Copy)]
pub(super) struct Constants<V> {
    c1: V,
    c2: V,
    eps: V,
    decay: V,
}

impl<V: Real> Constants<V> {
    pub(super) fn new(rule: &Rule) -> Self {
        Self {
            c1: V::splat((1.0 - rule.beta1) as f32),
            c2: V::splat((1.0 - rule.beta2) as f32),
            eps: V::splat(rule.eps as f32),
            decay: V::splat(rule.weight_decay as f32),
        }
    }
}

/// Which kind of decay is compiled into the kernel.
pub(super) const NONE: u8 = 0;
pub(super) const COUPLED: u8 = 1;
pub(super) const DECOUPLED: u8 = 2;

/// One step of one element per lane; `rate` is (lr, lr·w), `correction` is (a, b).
#[inline(always)]
fn update<V: Real, const DECAY: u8>(
    [p, m, v, g]: [V; 4],
    k: &Constants<V>,
    rate: [V; 2],
    correction: [V; 2],
) -> [V; 3] {
    let g = if DECAY == COUPLED { g + k.decay * p } else { g };
    let m = m + k.c1 * (g - m);
    let v = v + k.c2 * (g * g - v);
    let p = if DECAY == DECOUPLED { p - rate[1] * p } else { p };
    [p - rate[0] * ((m * correction[0]) / ((v * correction[1]).sqrt() + k.eps)), m, v]
}

/// The part of the state that one task updates; parts are disjoint.
pub(super) struct Task<'a> {
    pub(super) param: &'a mut [f32],
    pub(super) m: &'a mut [f32],
    pub(super) v: &'a mut [f32],
    pub(super) grad: &'a [f32],
    pub(super) active: Option<&'a [u8]>,
    /// Empty with a global counter.
    pub(super) steps: &'a mut [u32],
}

/// Data shared by all tasks; per column of a block: lr and lr·w.
pub(super) struct Shared<'a> {
    pub(super) scalar: Constants<f32>,
    pub(super) vector: Constants<f32x8>,
    pub(super) width: usize,
    pub(super) lr: Vec<f32>,
    pub(super) shrink: Vec<f32>,
    pub(super) global: [f32; 2],
    pub(super) corrections: &'a Corrections,
}

impl Shared<'_> {
    /// Whole rows with one correction, at most a block of them; returns whether all results are finite.
    #[inline(always)]
    fn stretch<const DECAY: u8>(
        &self,
        p: &mut [f32],
        m: &mut [f32],
        v: &mut [f32],
        g: &[f32],
        correction: [f32; 2],
    ) -> bool {
        let (whole, n) = (p.len() / 8 * 8, p.len());
        let k = &self.vector;
        let by = correction.map(f32x8::splat);
        let lanes = |s: &[f32]| f32x8::new(std::array::from_fn(|l| s[l]));
        let limit = f32x8::splat(f32::INFINITY);
        let mut ok = Real::eq(by[0], by[0]);
        let values = p[..whole]
            .chunks_exact_mut(8)
            .zip(m[..whole].chunks_exact_mut(8))
            .zip(v[..whole].chunks_exact_mut(8));
        let rates = self.lr[..whole].chunks_exact(8).zip(self.shrink[..whole].chunks_exact(8));
        for (((p, m), v), (g, (lr, shrink))) in values.zip(g[..whole].chunks_exact(8).zip(rates)) {
            let old = [lanes(p), lanes(m), lanes(v), lanes(g)];
            let [a, b, c] = update::<_, DECAY>(old, k, [lanes(lr), lanes(shrink)], by);
            let here = <f32x8 as Real>::and(Real::lt(Real::abs(a), limit), Real::lt(c, limit));
            ok = <f32x8 as Real>::and(ok, here);
            p.copy_from_slice(&a.to_array());
            m.copy_from_slice(&b.to_array());
            v.copy_from_slice(&c.to_array());
        }
        let mut fine = <f32x8 as Real>::bits(ok) == 0xff;
        let k = &self.scalar;
        for i in whole..n {
            let rate = [self.lr[i], self.shrink[i]];
            [p[i], m[i], v[i]] = update::<f32, DECAY>([p[i], m[i], v[i], g[i]], k, rate, correction);
            fine &= p[i].abs() < f32::INFINITY && v[i] < f32::INFINITY;
        }
        fine
    }

    /// A whole block of narrow rows whose corrections or activity differ: per lane what [`Self::stretch`]
    /// does per row.
    #[inline(always)]
    fn mixed<const DECAY: u8>(
        &self,
        p: &mut [f32],
        m: &mut [f32],
        v: &mut [f32],
        g: &[f32],
        corrections: &[[f32; 2]; BLOCK],
        active: &[u8; BLOCK],
    ) -> bool {
        let k = &self.vector;
        let limit = f32x8::splat(f32::INFINITY);
        let mut ok = Real::eq(k.eps, k.eps);
        for i in (0..p.len()).step_by(8) {
            let lanes = |s: &[f32]| <f32x8 as Real>::from_fn(|l| s[i + l]);
            let row = |l: usize| (i + l) / self.width;
            let by = [0, 1].map(|b| <f32x8 as Real>::from_fn(|l| corrections[row(l)][b]));
            let moves = Real::gt(<f32x8 as Real>::from_fn(|l| f32::from(active[row(l)])), f32x8::splat(0.0));
            let old = [lanes(p), lanes(m), lanes(v), lanes(g)];
            let new = update::<_, DECAY>(old, k, [lanes(&self.lr), lanes(&self.shrink)], by);
            let [a, b, c] = [0, 1, 2].map(|q| <f32x8 as Real>::select(moves, new[q], old[q]));
            let here = <f32x8 as Real>::and(Real::lt(Real::abs(a), limit), Real::lt(c, limit));
            ok = <f32x8 as Real>::and(ok, here);
            p[i..i + 8].copy_from_slice(&a.to_array());
            m[i..i + 8].copy_from_slice(&b.to_array());
            v[i..i + 8].copy_from_slice(&c.to_array());
        }
        <f32x8 as Real>::bits(ok) == 0xff
    }

    pub(super) fn run<const DECAY: u8>(&self, task: Task<'_>) -> bool {
        let width = self.width;
        let mut fine = true;
        let rows = task.param.len() / width;
        for first in (0..rows).step_by(BLOCK) {
            let here = BLOCK.min(rows - first);
            let active = task.active.map(|a| &a[first..first + here]);
            if active.is_some_and(|a| a.iter().all(|&a| a == 0)) {
                continue;
            }
            // Correction of every row of the block; its counter is incremented first.
            let mut corrections = [self.global; BLOCK];
            let mut uniform = active.is_none_or(|a| a.iter().all(|&a| a != 0));
            if !task.steps.is_empty() {
                let steps = &mut task.steps[first..first + here];
                for (r, t) in steps.iter_mut().enumerate() {
                    *t += u32::from(active.is_none_or(|a| a[r] != 0));
                    corrections[r] = self.corrections.at(*t);
                }
                uniform &= corrections[..here].iter().all(|c| *c == corrections[0]);
            }
            let span = first * width..(first + here) * width;
            let (p, g) = (&mut task.param[span.clone()], &task.grad[span.clone()]);
            let (m, v) = (&mut task.m[span.clone()], &mut task.v[span]);
            if uniform {
                fine &= self.stretch::<DECAY>(p, m, v, g, corrections[0]);
                continue;
            }
            if here == BLOCK && width < NARROW {
                let active = std::array::from_fn(|r| active.map_or(1, |a| a[r]));
                fine &= self.mixed::<DECAY>(p, m, v, g, &corrections, &active);
                continue;
            }
            let rows =
                p.chunks_exact_mut(width).zip(m.chunks_exact_mut(width)).zip(v.chunks_exact_mut(width));
            for (r, (((p, m), v), g)) in rows.zip(g.chunks_exact(width)).enumerate() {
                if active.is_none_or(|a| a[r] != 0) {
                    fine &= self.stretch::<DECAY>(p, m, v, g, corrections[r]);
                }
            }
        }
        fine
    }
}
