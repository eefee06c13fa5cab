//! Bounds of the signed distance of feature planes.
//!
//! s = 2.598 R·tanh(z) + (‖x‖ − 0.1 R),   z = W² max(0, W¹ max(0, W⁰ f))       ([`super::super::sdf_head`])
//!
//! 1. **First layer.** W⁰f is linear in the texels, so W⁰ is multiplied with the texels in advance: planes with
//!    one channel per hidden unit. Their values at the places between which they are linear
//!    ([`super::extremes`]) bound every unit, and every linear combination of units.
//! 2. **Intervals.** For bounds lo ≤ y ≤ hi of the inputs of a layer, Σ (w⁺lo + w⁻hi) ≤ Σ wy ≤ Σ (w⁺hi + w⁻lo),
//!    with w⁺ and w⁻ the positive and negative parts; max(0, ·) is monotone.
//! 3. **Lines.** Intervals of all layers take every unit at its worst place. Instead z is bounded by one linear
//!    function of the first layer, from the last layer back ([`super::lines`]): on a fitted field a fifth to a
//!    tenth of the width.
//! 4. **Distance.** tanh and ‖x‖ are monotone; ‖x‖ lies between those of the nearest and the farthest point.
//!
//! A box reads the planes that its points read; one with points on both sides of a centre plane reads both
//! signs.
//!
//! # Rounding
//! The bounds hold for the rounded s that [`super::super::fetch`] and [`super::super::sdf_head`] give, with
//! u = 2⁻²⁴:
//!
//! * Places: (p + 1)/2·(S − 1) is monotone also when rounded, and its fraction is exact, so places of points lie
//!   between those of the corners.
//! * First layer: with m the largest |T| of each channel, the computed value differs from the exact
//!   interpolation by at most (7 + K)u·Σ|W⁰|m (weights of texels with two or three roundings each, their
//!   products and three sums; the chain of K products); an interpolated row of projected texels by (7 + C)u,
//!   their sum over planes by 2u, to first order. [`Learned::new`] takes (2K + 32)u·Σ|W⁰|m + 2⁻¹²⁶, which is
//!   more, as margin of each unit.
//! * Intervals: the chains of bounds have the order of those of the values, with a product of 0 between any
//!   two; rounding is monotone, so they bound the rounded values without a margin.
//! * Lines: see [`super::lines`].
//! * tanh is within one unit in the last place: 2⁻²² of it, and 2⁻¹²⁶, are added on both sides.
//! * ‖x‖ and the sums after it are monotone also when rounded.

use super::super::fetch::{Combine, Planes};
use super::super::network::Network;
use super::super::sdf_head::distance;
use super::bounded::{Bounded, Box3, extent};
use super::extremes::{Extremes, Places, widest};
use super::lines::{Batch, Lines};
use crate::num::elem;
use crate::num::gemm::{CHUNK, Finish, Packed, View, gemm, gemm_packed_here};
use crate::{Error, Result};

/// Boxes per batch.
const BOXES: usize = 64;

/// A layer, packed: for values, and for intervals.
#[derive(Debug)]
struct Layer {
    /// Wᵀ, (K, N).
    weights: Packed,
    /// Rows w⁺ and w⁻ of each input in turn, (2K, N); empty for the first layer.
    parts: Packed,
    outputs: usize,
    inputs: usize,
}

/// The signed distance of feature planes.
#[derive(Debug)]
pub struct Learned<'a> {
    planes: Planes<'a>,
    combine: Combine,
    layers: Vec<Layer>,
    /// Planes after the first layer.
    projected: Extremes,
    /// Margin of each unit of the first layer.
    margins: Vec<f32>,
    lines: Lines,
}

fn refuse(what: &str, x: &[f32]) -> Result<()> {
    match x.iter().position(|v| !v.is_finite()) {
        Some(i) => {
            let e = Error::input(what).at(format!("value {i}")).expected("a finite number");
            Err(e.got(x[i].to_string()))
        }
        None => Ok(()),
    }
}

/// Checks shapes and numbers; returns the widths of the network.
fn validate(planes: &Planes<'_>, combine: Combine, network: &Network<'_>) -> Result<Vec<usize>> {
    let texels = planes.count * planes.side * planes.side;
    let is_right = (planes.count == 3 || planes.count == 6)
        && planes.side >= 2
        && planes.channels > 0
        && planes.values.len() == texels * planes.channels;
    if !is_right {
        let e = Error::input("planes").expected("three or six square planes of at least 2×2 texels");
        return Err(e.got(format!("{} values", planes.values.len())));
    }
    if network.inputs != combine.width(planes.channels) {
        let e = Error::input("network").expected(format!("{} inputs", combine.width(planes.channels)));
        return Err(e.got(network.inputs.to_string()));
    }
    refuse("planes", planes.values)?;
    network.weights.iter().try_for_each(|w| refuse("network", w))?;
    let widths = network.widths();
    match widths.iter().find(|k| 2 * **k > CHUNK) {
        Some(k) => Err(Error::input("network").expected("at most 2048 units per layer").got(k.to_string())),
        None => Ok(widths),
    }
}

impl<'a> Learned<'a> {
    /// Prepares bounds for planes and the network of the signed distance; of several outputs the first is z.
    ///
    /// # Errors
    /// Names a plane or weight that is not finite, or a shape that does not fit.
    pub fn new(planes: Planes<'a>, combine: Combine, network: &Network<'_>) -> Result<Self> {
        let widths = validate(&planes, combine, network)?;
        let layer = |l: usize| {
            let (outputs, inputs) = (widths[l + 1], widths[l]);
            let weights = Packed::new(View::new(network.weights[l], outputs, inputs).t());
            let parts = if l == 0 { Packed::default() } else { parts(network.weights[l], inputs) };
            Layer { weights, parts, outputs, inputs }
        };
        let projected = project(&planes, combine, network.weights[0], widths[1]);
        let margins = margins(&planes, combine, network.weights[0]);
        let per_pair = planes.count / 3;
        let largest: Vec<Vec<f32>> =
            (0..3).map(|pair| projected.largest(pair * per_pair..(pair + 1) * per_pair)).collect();
        let lines = Lines::new(network, &widths, &largest, &margins);
        let layers = (0..network.weights.len()).map(layer).collect();
        Ok(Self { planes, combine, layers, projected, margins, lines })
    }

    /// Fills the rows and the intervals of the first layer.
    fn first(&self, boxes: &[Box3], batch: &mut Batch) {
        let units = self.layers[0].outputs;
        batch.rows.clear();
        batch.parts.clear();
        let [lo, hi] = &mut batch.intervals[0];
        for all in [&mut *lo, &mut *hi] {
            all.clear();
            all.resize(boxes.len() * units, 0.0);
        }
        let (mut least, mut most) = (vec![0.0; units], vec![0.0; units]);
        for (b, (lo, hi)) in boxes.iter().zip(lo.chunks_exact_mut(units).zip(hi.chunks_exact_mut(units))) {
            let places = Places::new(&self.planes, *b);
            let parts =
                [0, 1, 2].map(|pair| self.projected.part(self.planes.count, pair, &places, &mut batch.rows));
            batch.parts.push(parts);
            for part in parts {
                let offsets = (part.first..part.first + part.rows).map(|row| row * units);
                widest([&batch.rows, &batch.rows], offsets, [&mut least, &mut most]);
                lo.iter_mut().zip(&least).for_each(|(sum, x)| *sum += *x);
                hi.iter_mut().zip(&most).for_each(|(sum, x)| *sum += *x);
            }
            for ((lo, hi), margin) in lo.iter_mut().zip(hi).zip(&self.margins) {
                *lo -= margin;
                *hi += margin;
            }
        }
    }

    /// Fills the intervals of the other hidden layers.
    fn others(&self, boxes: usize, batch: &mut Batch) {
        let relu = |v: f32| if v <= 0.0 { 0.0 } else { v };
        let (mut here, mut next) = (Vec::new(), Vec::new());
        for l in 1..self.layers.len() - 1 {
            let (before, after) = batch.intervals.split_at_mut(l);
            let ([lo, hi], [to_lo, to_hi]) = (&before[l - 1], &mut after[0]);
            let (k, n) = (self.layers[l].inputs, self.layers[l].outputs);
            // Two rows per box, for the lower and for the upper bounds: (lo, hi) and (hi, lo) of each unit.
            here.resize(4 * boxes * k, 0.0);
            for (rows, (lo, hi)) in
                here.chunks_exact_mut(4 * k).zip(lo.chunks_exact(k).zip(hi.chunks_exact(k)))
            {
                let (low, high) = rows.split_at_mut(2 * k);
                let pairs = low.as_chunks_mut::<2>().0.iter_mut().zip(high.as_chunks_mut::<2>().0);
                for ((low, high), (lo, hi)) in pairs.zip(lo.iter().zip(hi)) {
                    let [lo, hi] = [relu(*lo), relu(*hi)];
                    *low = [lo, hi];
                    *high = [hi, lo];
                }
            }
            next.resize(2 * boxes * n, 0.0);
            let x = View::new(&here, 2 * boxes, 2 * k);
            gemm_packed_here(x, &self.layers[l].parts, Finish::Store, &mut next);
            to_lo.clear();
            to_hi.clear();
            for pair in next.chunks_exact(2 * n) {
                to_lo.extend_from_slice(&pair[..n]);
                to_hi.extend_from_slice(&pair[n..]);
            }
        }
    }
}

/// Packs the positive and negative parts of a layer.
fn parts(weight: &[f32], inputs: usize) -> Packed {
    let outputs = weight.len() / inputs;
    let mut split = Vec::with_capacity(2 * weight.len());
    for w in weight {
        split.extend(if *w > 0.0 { [*w, 0.0] } else { [0.0, *w] });
    }
    Packed::new(View::new(&split, outputs, 2 * inputs).t())
}

/// Returns the planes multiplied with the first layer.
fn project(planes: &Planes<'_>, combine: Combine, weight: &[f32], units: usize) -> Extremes {
    let (c, inputs) = (planes.channels, combine.width(planes.channels));
    let texels = planes.side * planes.side;
    let mut projected = vec![0.0; planes.count * texels * units];
    for (plane, out) in projected.chunks_exact_mut(texels * units).enumerate() {
        let pair = plane / (planes.count / 3);
        let from = if combine == Combine::Concat { pair * c } else { 0 };
        let values = &planes.values[plane * texels * c..][..texels * c];
        let part = View::strided(&weight[from..], (units, c), (inputs, 1));
        gemm(View::new(values, texels, c), part.t(), Finish::Store, out);
    }
    Extremes::new(projected, planes.side, units)
}

/// Returns the margin of each unit of the first layer.
fn margins(planes: &Planes<'_>, combine: Combine, weight: &[f32]) -> Vec<f32> {
    let (c, inputs) = (planes.channels, combine.width(planes.channels));
    let per_pair = planes.values.len() / 3;
    let mut largest = vec![0.0_f32; 3 * c];
    for (values, largest) in planes.values.chunks_exact(per_pair).zip(largest.chunks_exact_mut(c)) {
        for texel in values.chunks_exact(c) {
            for (most, v) in largest.iter_mut().zip(texel) {
                *most = if v.abs() > *most { v.abs() } else { *most };
            }
        }
    }
    let scale = (2 * 3 * c + 32) as f64 / 16_777_216.0;
    let margin = |row: &[f32]| {
        let terms = largest.iter().enumerate();
        let sum = terms.fold(0.0, |sum, (k, m)| sum + f64::from(row[k % inputs].abs()) * f64::from(*m));
        ((sum * scale) as f32).next_up() + f32::MIN_POSITIVE
    };
    weight.chunks_exact(inputs).map(margin).collect()
}

impl Bounded for Learned<'_> {
    fn values(&self, points: &[[f32; 3]], sdf: &mut Vec<f32>) {
        let (mut here, mut next) = (Vec::new(), Vec::new());
        self.planes.features_of(self.combine, points, &mut here, &mut Vec::new());
        for (l, layer) in self.layers.iter().enumerate() {
            let how = if l + 1 < self.layers.len() { Finish::Relu } else { Finish::Store };
            next.resize(points.len() * layer.outputs, 0.0);
            gemm_packed_here(View::new(&here, points.len(), layer.inputs), &layer.weights, how, &mut next);
            std::mem::swap(&mut here, &mut next);
        }
        let stride = self.layers[self.layers.len() - 1].outputs;
        let z: Vec<f32> = here[..points.len() * stride].iter().step_by(stride).copied().collect();
        sdf.resize(points.len(), 0.0);
        elem::tanh_slice(&z, sdf);
        for (s, x) in sdf.iter_mut().zip(points) {
            *s = distance(*s, *x, self.planes.half_size);
        }
    }

    fn bounds(&self, boxes: &[Box3], bounds: &mut Vec<[f32; 2]>) {
        let mut batch = Batch::default();
        batch.intervals.resize_with(Ord::max(self.layers.len() - 1, 1), Default::default);
        let mut z = Vec::with_capacity(2 * boxes.len());
        for boxes in boxes.chunks(BOXES) {
            self.first(boxes, &mut batch);
            self.others(boxes.len(), &mut batch);
            self.lines.bound(&batch, &mut z);
        }
        let mut tanh = vec![0.0; z.len()];
        elem::tanh_slice(&z, &mut tanh);
        bounds.clear();
        for (t, b) in tanh.chunks_exact(2).zip(boxes) {
            let [near, far] = extent(*b);
            let margin = |t: f32| t.abs() * (1.0 / 4_194_304.0) + f32::MIN_POSITIVE;
            bounds.push([
                distance(t[0] - margin(t[0]), near, self.planes.half_size),
                distance(t[1] + margin(t[1]), far, self.planes.half_size),
            ]);
        }
    }
}

#[cfg(test)]
mod tests;
