//! The items of a step.

use super::super::data::{Data, Item};
use super::super::latent::Layout;
use super::super::purpose;
use super::super::settings::{Settings, Supervision};
use crate::num::rng::Rng;

/// The items of a step and their layout.
#[derive(Clone, Debug, PartialEq)]
pub struct Batch {
    /// All items.
    pub items: Vec<Item>,
    /// Composition of the batch.
    pub layout: Layout,
    /// Values that were set, per group.
    pub labels: Vec<f64>,
}

impl Batch {
    /// Draws the items with counter-based random numbers: observed items at random, groups with the target
    /// factors in turn.
    pub fn draw(settings: &Settings, data: &dyn Data, step: u32) -> Self {
        let rng = Rng::new(settings.seed);
        let mut items: Vec<Item> = (0..settings.observed)
            .map(|b| Item::Observed(rng.index(data.observed(), b as u64, step, purpose::BATCH, 0)))
            .collect();
        let observed = items.len();
        let count = if settings.supervision == Supervision::None { 0 } else { settings.groups };
        let mut chosen = Vec::new();
        // Factors that are the target of some group; groups of other factors are never requested.
        let is_set = |target: &usize| data.groups().iter().any(|g| g.target == *target);
        let targets: Vec<usize> = (0..settings.factors).filter(is_set).collect();
        for slot in 0..if targets.is_empty() { 0 } else { count } {
            let target = targets[(slot + step as usize * count) % targets.len()];
            // If targets are not given, groups are not selected by target either.
            let is_told = settings.supervision != Supervision::Unknown;
            let of: Vec<usize> =
                (0..data.groups().len()).filter(|&g| !is_told || data.groups()[g].target == target).collect();
            chosen.push(of[rng.index(of.len(), slot as u64, step, purpose::BATCH, 1)]);
        }
        let members = data.members();
        items.extend(chosen.iter().flat_map(|&g| (0..members).map(move |m| Item::Base(g, m))));
        items.extend(chosen.iter().flat_map(|&g| (0..members).map(move |m| Item::After(g, m))));
        Self {
            items,
            layout: Layout {
                observed,
                targets: chosen.iter().map(|&g| data.groups()[g].target).collect(),
                members,
            },
            labels: chosen.iter().map(|&g| data.groups()[g].value).collect(),
        }
    }
}
