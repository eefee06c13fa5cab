//! The training that produced a model: parts of stages, one after the other.
//!
//! A stage is one part, or several if it was stopped and continued from a file. The weights that a part
//! begins with are the result of the part before it, or, in the first part, first values that depend on the
//! configuration and the seed. With the configuration and the version of the program, the list is all that
//! decides the weights.

use crate::scene::field::INVERSE_BETA;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// 1/β at which a model without training is rendered: that at the end of stage 1a, as published.
const UNTRAINED: f32 = 40.0;

/// Some steps of a stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Part {
    /// Name of the stage.
    pub stage: String,
    /// What updated the matrices of the blocks.
    #[serde(default = "adamw")]
    pub optimizer: String,
    /// Its first step, counted from 0, and the one after its last.
    pub range: [usize; 2],
    /// Steps of the whole stage.
    pub steps: usize,
    /// Seed of first values and draws.
    pub seed: u64,
    /// Objects per step.
    pub batch: usize,
    /// Objects that are in memory at once.
    pub block: usize,
    /// Batches that an object was in, where it is not twelve.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uses: Option<usize>,
    /// Where the objects come from.
    pub source: String,
    /// Seed of built-in objects, where it is not that of the draws.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub object_seed: Option<u64>,
    /// Whether the objects are other models than the built-in ones.
    #[serde(default, skip_serializing_if = "is_false")]
    pub other_objects: bool,
    /// Learning rate after the warm-up, where it is not that of the stage.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate: Option<f64>,
    /// Learning rate of the heads that stage 2 adds, in units of that of the others, where it is not the
    /// same.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub head_rate: Option<f64>,
    /// Largest part of its size that an object gives up for a random place, where it is not that of the
    /// stage.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub room: Option<f64>,
    /// Largest strength of the random colour of an object, where it is not that of the stage.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tint: Option<f64>,
    /// Weight of surface points.
    pub points: f32,
    /// Weight of signed distances.
    pub distances: f32,
    /// Steps at the beginning of the stage in which signed distances were all that was compared.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub shape_steps: usize,
    /// Whether draws were those for the second set.
    #[serde(default, skip_serializing_if = "is_false")]
    pub updates: bool,
    /// Part of the objects to which another one was added after the first set.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub added: Option<f64>,
    /// Whether gradients flowed through the state.
    #[serde(default, skip_serializing_if = "is_false")]
    pub state_gradient: bool,
    /// Whether the last set of an object was the only one that was compared.
    #[serde(default, skip_serializing_if = "is_false")]
    pub last_set_only: bool,
    /// Whether albedo was compared as it is.
    #[serde(default, skip_serializing_if = "is_false")]
    pub absolute_albedo: bool,
    /// Weight of roughness and metallic, where it is not 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub material: Option<f32>,
    /// Weight of the normal head, where it is not 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub normal_weight: Option<f32>,
    /// Steps at the end over which the weights were averaged, at most those of the part.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub average_last: usize,
    /// Share of the weights that it began with in its result, where it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start_share: Option<f64>,
    /// 1/β in the last step.
    pub inverse_beta: f32,
    /// Digest of the weights that it began with.
    pub start: String,
}

/// The optimiser of files that do not name it.
fn adamw() -> String {
    "adamw".to_owned()
}

/// Files do not have a number of steps that is 0.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde's form")]
fn is_zero(n: &usize) -> bool {
    *n == 0
}

/// Nor a choice that was not made.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde's form")]
fn is_false(x: &bool) -> bool {
    !*x
}

impl Part {
    /// The seed of its built-in objects, if it had such.
    pub fn objects(&self) -> Option<u64> {
        (!self.other_objects).then_some(self.object_seed.unwrap_or(self.seed))
    }

    /// Whether it ends with the last step of its stage.
    pub fn is_last(&self) -> bool {
        self.range[1] == self.steps
    }

    /// The name of the stage; with the number of steps, if some are missing.
    pub fn label(&self) -> String {
        if self.is_last() {
            return self.stage.clone();
        }
        format!("{} to step {} of {}", self.stage, self.range[1], self.steps)
    }
}

/// The stages in order, a stage in several parts once.
pub fn labels(parts: &[Part]) -> Vec<String> {
    let continued = |i: usize| {
        parts.get(i + 1).is_some_and(|next| {
            next.stage == parts[i].stage && next.range[0] == parts[i].range[1] && next.range[0] > 0
        })
    };
    (0..parts.len()).filter(|i| !continued(*i)).map(|i| parts[i].label()).collect()
}

/// The seed of the built-in objects of the last part, if it had such; 0 without a part.
pub fn training_seed(parts: &[Part]) -> Option<u64> {
    parts.last().map_or(Some(0), Part::objects)
}

/// The 1/β of the last step, at which the model is rendered.
pub fn inverse_beta(parts: &[Part]) -> f32 {
    parts.last().map_or(UNTRAINED, |part| part.inverse_beta)
}

/// Text of a list of parts.
///
/// # Panics
/// Never: a part has no map with keys that are not text.
pub(super) fn text(parts: &[Part]) -> String {
    serde_json::to_string(parts).expect("plain values")
}

/// Reads such a text.
///
/// # Errors
/// If it is not one, or a part has steps that its stage does not have, or a 1/β that a field cannot have.
pub(super) fn parse(text: &str) -> Result<Vec<Part>> {
    let refused = |got: String| Error::input("metadata").at("training").expected("parts of stages").got(got);
    let parts: Vec<Part> = serde_json::from_str(text).map_err(|e| refused(e.to_string()))?;
    let is_bad = |part: &&Part| part.range[0] >= part.range[1] || part.range[1] > part.steps;
    let [least, most] = INVERSE_BETA;
    if let Some(bad) = parts.iter().find(|part| !(least..=most).contains(&part.inverse_beta)) {
        return Err(refused(format!("1/β {}", bad.inverse_beta)));
    }
    match parts.iter().find(is_bad) {
        Some(bad) => Err(refused(format!("steps {:?} of {}", bad.range, bad.steps))),
        None => Ok(parts),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn part(stage: &str, range: [usize; 2], inverse_beta: f32) -> Part {
        Part {
            stage: stage.to_owned(),
            optimizer: "muon".to_owned(),
            range,
            steps: 10,
            seed: u64::MAX,
            batch: 8,
            block: 200,
            uses: Some(4),
            source: "a set".to_owned(),
            object_seed: None,
            other_objects: false,
            rate: Some(2e-3),
            head_rate: Some(8.0),
            room: None,
            tint: Some(0.0),
            points: 0.0,
            distances: 0.1,
            shape_steps: 0,
            updates: false,
            added: Some(0.5),
            state_gradient: true,
            last_set_only: false,
            absolute_albedo: true,
            material: Some(10.0),
            normal_weight: Some(0.0),
            average_last: 0,
            start_share: None,
            inverse_beta,
            start: "0123".to_owned(),
        }
    }

    #[test]
    fn a_stage_in_parts_has_one_label_and_its_text_is_read_back() {
        let parts = [part("1a", [0, 4], 40.0), part("1a", [4, 10], 60.0), part("1b", [0, 3], 61.0)];
        assert_eq!(labels(&parts), ["1a", "1b to step 3 of 10"]);
        let again = [part("1a", [0, 10], 60.0), part("1a", [0, 3], 60.0)];
        assert_eq!(labels(&again), ["1a", "1a to step 3 of 10"], "begun anew");
        assert_eq!((inverse_beta(&parts), inverse_beta(&[])), (61.0, UNTRAINED));
        assert_eq!((training_seed(&parts), training_seed(&[])), (Some(u64::MAX), Some(0)));
        let stored = [Part { object_seed: Some(2), ..part("1a", [0, 4], 40.0) }];
        let others = [Part { other_objects: true, ..part("1a", [0, 4], 40.0) }];
        assert_eq!((training_seed(&stored), training_seed(&others)), (Some(2), None));
        assert_eq!(parse(&text(&stored)).expect("its own text"), stored);
        assert_eq!(parse(&text(&parts)).expect("its own text"), parts);
        for range in [[4, 4], [4, 11]] {
            let e = parse(&text(&[part("1a", range, 60.0)])).expect_err("no such steps").to_string();
            assert!(e.contains("of 10"), "{e}");
        }
        for bad in [-60.0, 0.0, 1e30] {
            let e = parse(&text(&[part("1a", [0, 3], bad)])).expect_err("no field has it").to_string();
            assert!(e.contains("1/β"), "{e}");
        }
        let e = parse("[{}]").expect_err("no part").to_string();
        assert!(e.contains("training") && e.contains("stage"), "{e}");
    }
}
