//! The training data of the model.

use super::encoder::Input;

/// One image, or the vector that replaces it in tests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Item {
    /// An observed frame.
    Observed(usize),
    /// A frame before an intervention: group, member.
    Base(usize, usize),
    /// The frame after the intervention: group, member.
    After(usize, usize),
}

/// A group of frames with the same intervention.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Group {
    /// The factor that was set.
    pub target: usize,
    /// The value to which it was set.
    pub value: f64,
}

/// The coordinates at which items are decoded, and the weights of the loss.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Number F of entries of the code of a coordinate.
    pub features: usize,
    /// Number O of outputs per coordinate.
    pub outputs: usize,
    /// Codes of the coordinates, shape (P, F).
    pub codes: Vec<f32>,
    /// Base of the outputs, shape (P, O).
    pub base: Vec<f32>,
    /// Scale of the outputs, shape (O).
    pub scale: Vec<f32>,
    /// Weights 1/σ² of the outputs in the loss, shape (O).
    pub precision: Vec<f32>,
}

impl Frame {
    /// Number P of coordinates.
    pub fn points(&self) -> usize {
        self.base.len() / self.outputs
    }
}

/// Frames, groups, and the decoded targets of both.
pub trait Data: Sync + std::fmt::Debug {
    /// Kind and size of the encoder input.
    fn input(&self) -> Input;
    /// Number of observed frames.
    fn observed(&self) -> usize;
    /// The intervention groups.
    fn groups(&self) -> &[Group];
    /// Number of frames in a group.
    fn members(&self) -> usize;
    /// The coordinates at which items are decoded.
    fn frame(&self) -> &Frame;
    /// The points at rest, shape (P, 3); empty for vectors.
    fn template(&self) -> &[[f32; 3]];
    /// The parent of each joint of the subject, −1 for none; empty if it has no skeleton or the data do not state it.
    fn skeleton(&self) -> &[i64] {
        &[]
    }
    /// Writes the encoder input of an item.
    fn write_input(&self, item: Item, into: &mut [f32]);
    /// Number of true factors.
    fn true_factors(&self) -> usize;
    /// True factors of an item.
    fn truth(&self, item: Item) -> &[f64];
    /// The decoder target of an item, shape (P, O).
    fn shown(&self, item: Item) -> &[f32];
}
