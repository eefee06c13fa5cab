//! The items of a step.

use super::super::data::{Data, Item};
use super::super::latent::Layout;
use super::super::purpose;
use super::super::settings::{Settings, Supervision};
use crate::num::rng::Rng;

/// The items of a step and how they are laid out.
#[derive(Clone, Debug, PartialEq)]
pub struct Batch {
    /// all items
    pub items: Vec<Item>,
    /// what they are
    pub layout: Layout,
    /// values that were set, per group
    pub labels: Vec<f64>,
}

impl Batch {
    /// Drawn by counter: observed items at random, groups whose targets go round the factors.
    pub fn draw(settings: &Settings, data: &dyn Data, step: u32) -> Self {
        let rng = Rng::new(settings.seed);
        let mut items: Vec<Item> = (0..settings.observed)
            .map(|b| Item::Observed(rng.index(data.observed(), b as u64, step, purpose::BATCH, 0)))
            .collect();
        let observed = items.len();
        let count = if settings.supervision == Supervision::None { 0 } else { settings.groups };
        let mut chosen = Vec::new();
        // Factors that some group sets: others are never asked for.
        let is_set = |target: &usize| data.groups().iter().any(|g| g.target == *target);
        let targets: Vec<usize> = (0..settings.factors).filter(is_set).collect();
        for slot in 0..if targets.is_empty() { 0 } else { count } {
            let target = targets[(slot + step as usize * count) % targets.len()];
            // Where targets are not told, they do not choose either.
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
