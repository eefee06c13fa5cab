//! What the model learns from.

use super::encoder::Input;

/// One picture, or what stands for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Item {
    /// an observed frame
    Observed(usize),
    /// a frame before an intervention: group, member
    Base(usize, usize),
    /// the frame after it
    After(usize, usize),
}

/// A set of intervention groups.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Group {
    /// which factor was set
    pub target: usize,
    /// to what
    pub value: f64,
}

/// Where things are decoded and how the loss weighs them.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// F
    pub features: usize,
    /// O
    pub outputs: usize,
    /// (P, F) codes of the coordinates
    pub codes: Vec<f32>,
    /// (P, O)
    pub base: Vec<f32>,
    /// (O)
    pub scale: Vec<f32>,
    /// (O) 1/σ²
    pub precision: Vec<f32>,
}

impl Frame {
    /// P
    pub fn points(&self) -> usize {
        self.base.len() / self.outputs
    }
}

/// Frames, groups, and what they show.
pub trait Data: Sync + std::fmt::Debug {
    /// What is encoded.
    fn input(&self) -> Input;
    /// Number of observed frames.
    fn observed(&self) -> usize;
    /// The groups.
    fn groups(&self) -> &[Group];
    /// Frames of a group.
    fn members(&self) -> usize;
    /// Where things are decoded.
    fn frame(&self) -> &Frame;
    /// (P, 3) the points at rest; none for vectors.
    fn template(&self) -> &[[f32; 3]];
    /// Writes what the encoder sees of an item.
    fn write_input(&self, item: Item, into: &mut [f32]);
    /// Number of true factors.
    fn true_factors(&self) -> usize;
    /// True factors of an item.
    fn truth(&self, item: Item) -> &[f64];
    /// What an item shows (P, O).
    fn shown(&self, item: Item) -> &[f32];
}
