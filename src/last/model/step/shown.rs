//! Decoder targets of the items and counterfactuals of a batch.

use super::super::data::Data;
use super::super::decoder::Target;
use super::super::purpose;
use super::super::settings::Settings;
use super::batch::Batch;
use crate::num::rng::Rng;

/// Codes, bases and targets of each item and counterfactual, at the coordinates drawn for the step.
pub(super) struct Shown {
    /// Codes (Q, F), base (Q, O) and targets (Q, O).
    rows: Vec<[Vec<f32>; 3]>,
    /// Weights of the losses.
    weights: Vec<f32>,
}

impl Shown {
    /// Creates the targets of `count` items and counterfactuals; `groups` is w₄.
    pub(super) fn new(
        settings: &Settings,
        data: &dyn Data,
        batch: &Batch,
        count: usize,
        groups: f64,
        step: u32,
    ) -> Self {
        let frame = data.frame();
        let chosen = points(settings, frame.points(), count, step);
        let pick = |table: &[f32], width: usize, of: &[usize]| -> Vec<f32> {
            of.iter().flat_map(|&p| table[p * width..(p + 1) * width].iter().copied()).collect()
        };
        let items = batch.items.len();
        let pairs = batch.layout.pairs();
        let rows = chosen.iter().enumerate().map(|(b, of)| {
            let shown = if b < items { batch.items[b] } else { batch.items[batch.layout.after(b - items)] };
            [
                pick(&frame.codes, frame.features, of),
                pick(&frame.base, frame.outputs, of),
                pick(data.shown(shown), frame.outputs, of),
            ]
        });
        let weight = |b: usize| {
            let w = if b < items {
                settings.weights.reconstruction / items as f64
            } else {
                groups * settings.weights.intervention / pairs as f64
            };
            w as f32
        };
        Self { rows: rows.collect(), weights: (0..count).map(weight).collect() }
    }

    /// The targets in the form that the decoder requires.
    pub(super) fn targets(&self) -> Vec<Target<'_>> {
        let rows = self.rows.iter().zip(&self.weights);
        rows.map(|([codes, base, wanted], &weight)| Target { codes, base, wanted, weight }).collect()
    }
}

/// One coordinate from each of Q runs of the P coordinates, per item; all of them if P ≤ Q.
fn points(settings: &Settings, p: usize, items: usize, step: u32) -> Vec<Vec<usize>> {
    let rng = Rng::new(settings.seed);
    let q = Ord::min(settings.points, p);
    (0..items)
        .map(|b| {
            (0..q)
                .map(|i| {
                    let (from, to) = (i * p / q, (i + 1) * p / q);
                    from + rng.index(to - from, (b * q + i) as u64, step, purpose::POINTS, 0)
                })
                .collect()
        })
        .collect()
}
