//! What a training is beside its stage, and the memory that it needs.

use super::object::INPUT_TOKENS;
use super::optimizer::Kind;
use super::stage::Stage;
use crate::lirm::model::config::Config;
use crate::lirm::model::params::count;

/// Settings of a training.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// The stage.
    pub stage: Stage,
    /// What updates the matrices of the blocks.
    pub optimizer: Kind,
    /// Learning rate of the heads that stage 2 adds (albedo, roughness and metallic, ρ), in units of that of
    /// all other arrays.
    pub head_rate: f64,
    /// Seed of first values and draws.
    pub seed: u64,
    /// Objects per step.
    pub batch: usize,
    /// Objects that are in memory at once.
    pub block: usize,
    /// Batches that an object is in, in random order, before the next ones follow.
    pub uses: usize,
    /// Objects whose gradients are in memory at once; changes no bit.
    pub at_once: usize,
    /// Whether blocks run again in the adjoint instead of keeping what they save; changes no bit.
    pub recompute: bool,
    /// Steps at the end over which the weights of the result are averaged; 0 takes the last ones.
    pub average_last: usize,
    /// Share of the weights that the stage, or this part of it, began with in the result; 0 takes the trained
    /// ones. Changes no step.
    pub start_share: f64,
}

/// Bytes of an object in memory: twenty images of 128² pixels with their passes, and the points with
/// distances.
const OBJECT_BYTES: usize = 23 << 20;

impl Settings {
    /// Returns the bytes that a training needs, about: the objects that are in memory; weights, their mean
    /// and those of the start, moments and gradients; what the blocks save for the largest sets of images,
    /// twelve arrays of all tokens per block, for all sets of an object where gradients flow through the state.
    pub fn memory(&self, config: &Config) -> u64 {
        let whole = Config { is_whole: self.stage.is_whole || config.is_whole, ..*config };
        let at_once = Ord::min(self.at_once, self.batch);
        let means = usize::from(self.average_last > 0) + usize::from(self.start_share > 0.0);
        // The gradients of a set, and the sums over those before it.
        let weights = count(&whole) * (5 + means + 2 * at_once);
        let tokens = whole.state_tokens() + self.stage.images[1] * INPUT_TOKENS;
        let sets = if self.stage.state_gradient { self.stage.sets[1] } else { 1 };
        let kept = if self.recompute { 12 + sets * whole.blocks } else { sets * 12 * whole.blocks };
        let saved = at_once * (kept * tokens * whole.width + (2 + sets) * whole.texels());
        // A scene that changes has the images of two.
        let scenes = (1.0 + self.stage.added) * (self.most_blocks() * self.block) as f64;
        (4 * (weights + saved)) as u64 + (scenes * OBJECT_BYTES as f64) as u64
    }

    /// The blocks of objects that a step is in, at most: the places of a batch are consecutive uses of
    /// objects, and the first of them is a multiple of the greatest common divisor of batch and uses of a
    /// block.
    fn most_blocks(&self) -> usize {
        let uses = self.uses * self.block;
        let (mut divisor, mut rest) = (uses, self.batch);
        while rest > 0 {
            (divisor, rest) = (rest, divisor % rest);
        }
        (uses - divisor + self.batch.saturating_sub(1)) / Ord::max(uses, 1) + 1
    }
}

#[cfg(test)]
mod tests {
    use super::super::draws::Draws;
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn a_step_is_in_as_many_blocks_as_its_draws_name() {
        let stage = Stage::named("1a").expect("a name");
        let pairs = [(8, 200), (8, 1), (7, 2), (7, 1), (12, 1), (24, 1), (64, 1), (1, 3), (5, 4)];
        for ((batch, block), uses) in pairs.into_iter().flat_map(|pair| [12, 5, 1].map(|uses| (pair, uses))) {
            let settings = Settings {
                stage: stage.clone(),
                optimizer: Kind::AdamW,
                head_rate: 1.0,
                seed: 0,
                batch,
                block,
                uses,
                at_once: 1,
                recompute: false,
                average_last: 0,
                start_share: 0.0,
            };
            let draws = Draws { seed: 0, stage: &stage, batch, block, uses };
            let of = |step: usize| draws.objects(step).into_iter().collect::<BTreeSet<u64>>().len() / block;
            let most = (0..uses * block).map(of).fold(0, Ord::max);
            assert_eq!(settings.most_blocks(), most, "batches of {batch}, blocks of {block}, {uses} uses");
        }
    }

    #[test]
    fn gradients_through_the_state_keep_what_the_blocks_of_all_sets_save() {
        let stage = Stage::named("2a").expect("a name");
        let of = |state_gradient: bool, recompute: bool| {
            let settings = Settings {
                stage: Stage { state_gradient, ..stage.clone() },
                optimizer: Kind::AdamW,
                head_rate: 1.0,
                seed: 0,
                batch: 8,
                block: 1,
                uses: 12,
                at_once: 1,
                recompute,
                average_last: 0,
                start_share: 0.0,
            };
            settings.memory(&Config::SMALL)
        };
        let config = Config { is_whole: true, ..Config::SMALL };
        let array = 4 * ((config.state_tokens() + 6 * INPUT_TOKENS) * config.width) as u64;
        let texels = 4 * config.texels() as u64;
        // Two more sets: twelve arrays of all tokens per block and set, with recomputation one.
        assert_eq!(of(true, false) - of(false, false), 2 * (12 * 6 * array + texels));
        assert_eq!(of(true, true) - of(false, true), 2 * (6 * array + texels));
    }

    #[test]
    fn a_scene_that_changes_has_the_images_of_two() {
        let of = |added: f64| {
            let settings = Settings {
                stage: Stage { added, ..Stage::named("1b").expect("a name") },
                optimizer: Kind::AdamW,
                head_rate: 1.0,
                seed: 0,
                batch: 8,
                block: 200,
                uses: 12,
                at_once: 8,
                recompute: false,
                average_last: 0,
                start_share: 0.0,
            };
            settings.memory(&Config::SMALL)
        };
        assert_eq!(of(0.5) - of(0.0), 100 * OBJECT_BYTES as u64);
    }
}
