//! Bounds of a network by lines: a linear function of its first layer below it, and one above it.
//!
//! From the last layer back, z ≥ Σ aⱼ·max(0, zⱼ) + c with the weights a of the last layer. A unit with bounds
//! l ≤ zⱼ ≤ h is replaced by a line,
//!
//! | | for a > 0, from below | for a < 0, from above |
//! |---|---|---|
//! | l ≥ 0 | zⱼ | zⱼ |
//! | h ≤ 0 | 0 | 0 |
//! | else | zⱼ if h > −l, else 0 | h(zⱼ − l)/(h − l) |
//!
//! which leaves a linear function of the layer before, and so on to the first (DeepPoly, Singh et al. 2019;
//! CROWN, Zhang et al. 2018). Its units are sums of three planes, each linear between known rows: the smallest
//! value in the box is at least the sum of the smallest values at the rows. The same for −z.
//!
//! # Rounding
//! The factor h/(h − l) and the constant of a line from above are rounded upward by 2⁻²², so the rounded line
//! is one from above. Everything else is f32 with one margin, computed once in f64. With u = 2⁻²⁴ and M =
//! |Wᴸ|⋯|W¹|·m, m the sum over the three pairs of axes of the largest |value| of each unit, every term of the
//! forward and backward chains and of the products with rows is at most M. To first order, each hidden layer of
//! n units adds (n + 1)u·M for the values' own chain, (n + 1)u·M for the coefficients, 2(n + 1)u·M for
//! constants, and the rows once (n + 4)u·M; (8 Σn + 64)u·M is taken. The margins of the first layer are added
//! with the factors |Wᴸ|⋯|W¹|, times 1 + 2⁻⁷.

use super::super::network::Network;
use super::extremes::Part;
use crate::num::gemm::{Finish, Packed, View, gemm_packed_here};
use crate::num::lanes::{Real, f32x8};

/// 1 + 2⁻²².
const UPWARD: f32 = 1.0 + 1.0 / 4_194_304.0;

/// Values of a batch of boxes.
#[derive(Debug, Default)]
pub(super) struct Batch {
    /// Rows of units of the first layer, as [`Part`] describes.
    pub(super) rows: Vec<f32>,
    /// Per box: the rows of each pair of axes.
    pub(super) parts: Vec<[Part; 3]>,
    /// Bounds of every hidden layer before max(0, ·), (boxes, units).
    pub(super) intervals: Vec<[Vec<f32>; 2]>,
}

/// The layers after the first, from the last back.
#[derive(Debug)]
pub(super) struct Lines {
    /// First row of the last layer; empty if it is the first layer.
    last: Vec<f32>,
    /// W of each layer between the first and the last, (N, K).
    between: Vec<Packed>,
    /// Units of every hidden layer.
    widths: Vec<usize>,
    /// Units of the first layer.
    units: usize,
    pub(super) margin: f32,
}

impl Lines {
    /// Packs a network with the given widths; `largest` has the largest |value| of the first layer for each
    /// pair of axes, `margins` its errors.
    pub(super) fn new(
        network: &Network<'_>,
        widths: &[usize],
        largest: &[Vec<f32>],
        margins: &[f32],
    ) -> Self {
        let layers = network.weights.len();
        let hidden = widths[1..layers].to_vec();
        // Factors |Wᴸ|⋯|W¹| of the first layer, from the last back.
        let mut factors = vec![1.0_f64];
        for l in (1..layers).rev() {
            let k = widths[l];
            let mut before = vec![0.0; k];
            for (row, factor) in network.weights[l].chunks_exact(k).zip(&factors) {
                before.iter_mut().zip(row).for_each(|(sum, w)| *sum += factor * f64::from(w.abs()));
            }
            factors = before;
        }
        let (mut size, mut errors) = (0.0, 0.0);
        for (i, factor) in factors.iter().enumerate() {
            size += factor * largest.iter().fold(0.0, |sum, pair| sum + f64::from(pair[i]));
            errors += factor * f64::from(margins[i]);
        }
        let terms = hidden.iter().fold(64, |sum, n| sum + 8 * n);
        let margin = size * terms as f64 / 16_777_216.0 + errors * (1.0 + 1.0 / 128.0);
        let between = (1..Ord::max(layers, 2) - 1)
            .map(|l| Packed::new(View::new(network.weights[l], widths[l + 1], widths[l])))
            .collect();
        let last =
            if layers > 1 { network.weights[layers - 1][..widths[layers - 1]].to_vec() } else { Vec::new() };
        Self {
            last,
            between,
            widths: hidden,
            units: widths[1],
            margin: (margin as f32).next_up() + f32::MIN_POSITIVE,
        }
    }

    /// Appends a lower and an upper bound of z for every box of a batch.
    pub(super) fn bound(&self, batch: &Batch, z: &mut Vec<f32>) {
        let boxes = batch.parts.len();
        if self.last.is_empty() {
            let [lo, hi] = &batch.intervals[0];
            let firsts = lo.iter().step_by(self.units).zip(hi.iter().step_by(self.units));
            z.extend(firsts.flat_map(|(lo, hi)| [*lo, *hi]));
            return;
        }
        // Two rows per box: for z and for −z.
        let negative: Vec<f32> = self.last.iter().map(|w| -w).collect();
        let (mut here, mut next) = (Vec::with_capacity(2 * boxes * self.last.len()), Vec::new());
        for _ in 0..boxes {
            here.extend_from_slice(&self.last);
            here.extend_from_slice(&negative);
        }
        let mut constants = vec![0.0; 2 * boxes];
        for l in (0..self.widths.len()).rev() {
            let n = self.widths[l];
            let [lo, hi] = &batch.intervals[l];
            for (at, (row, constant)) in here.chunks_exact_mut(n).zip(&mut constants).enumerate() {
                let of = at / 2 * n;
                *constant += replace(row, &lo[of..of + n], &hi[of..of + n]);
            }
            if l > 0 {
                next.resize(2 * boxes * self.widths[l - 1], 0.0);
                gemm_packed_here(
                    View::new(&here, 2 * boxes, n),
                    &self.between[l - 1],
                    Finish::Store,
                    &mut next,
                );
                std::mem::swap(&mut here, &mut next);
            }
        }
        let units = self.units;
        for ((rows, constants), parts) in
            here.chunks_exact(2 * units).zip(constants.chunks_exact(2)).zip(&batch.parts)
        {
            let least = |row: &[f32], constant: f32| {
                let sum = parts.iter().fold(constant, |sum, part| sum + smallest(row, part, &batch.rows));
                sum - self.margin
            };
            z.push(least(&rows[..units], constants[0]));
            z.push(-least(&rows[units..], constants[1]));
        }
    }
}

/// Replaces coefficients of max(0, z) by those of lines; returns the sum of the constants.
#[inline(always)]
fn replace(row: &mut [f32], lo: &[f32], hi: &[f32]) -> f32 {
    let ((a8, a1), (l8, l1), (h8, h1)) = (row.as_chunks_mut::<8>(), lo.as_chunks::<8>(), hi.as_chunks::<8>());
    let mut constants = f32x8::ZERO;
    for ((a, l), h) in a8.iter_mut().zip(l8).zip(h8) {
        let [by, constant] = line(f32x8::new(*a), f32x8::new(*l), f32x8::new(*h));
        constants = constants + constant;
        *a = by.to_array();
    }
    let mut constant = constants.to_array().iter().fold(0.0, |sum, c| sum + c);
    for ((a, l), h) in a1.iter_mut().zip(l1).zip(h1) {
        let [by, own] = line(*a, *l, *h);
        constant += own;
        *a = by;
    }
    constant
}

/// Returns the factor of z and the constant of a line below a·max(0, z) for z in l..h.
#[inline(always)]
fn line<L: Real>(a: L, l: L, h: L) -> [L; 2] {
    let (zero, upward) = (L::splat(0.0), L::splat(UPWARD));
    let factor = (h / (h - l)) * upward;
    let below = L::select(h.gt(-l), a, zero);
    let is_above = a.lt(zero);
    let across = L::select(is_above, a * factor, below);
    let constant = L::select(is_above, a * ((-l * factor) * upward), zero);
    let (is_on, is_off) = (l.ge(zero), h.le(zero));
    let by = L::select(is_on, a, L::select(is_off, zero, across));
    [by, L::select(L::or(is_on, is_off), zero, constant)]
}

/// Returns the smallest value of a linear combination of the units of one pair of axes.
#[inline(always)]
fn smallest(row: &[f32], part: &Part, rows: &[f32]) -> f32 {
    let n = row.len();
    let rows = &rows[part.first * n..(part.first + part.rows) * n];
    if part.is_exact {
        return rows.chunks_exact(n).fold(f32::INFINITY, |least, values| {
            let value = product(row, values);
            // A number that is not one replaces the others.
            if value >= least { least } else { value }
        });
    }
    let (low, high) = rows.split_at(n);
    let terms = row.iter().zip(low).zip(high);
    terms.fold(0.0, |sum, ((a, low), high)| sum + a * if *a > 0.0 { low } else { high })
}

/// Returns Σ aᵢbᵢ: eight chains, added in order, then the rest.
#[inline(always)]
fn product(a: &[f32], b: &[f32]) -> f32 {
    let ((a8, a1), (b8, b1)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    let chains = a8.iter().zip(b8).fold(f32x8::ZERO, |sum, (a, b)| sum + f32x8::new(*a) * f32x8::new(*b));
    let sum = chains.to_array().iter().fold(0.0, |sum, chain| sum + chain);
    a1.iter().zip(b1).fold(sum, |sum, (a, b)| sum + a * b)
}
