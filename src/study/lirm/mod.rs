//! The experiments of LIRM: claims of the paper, and the results of this program.
//!
//! ```text
//! setup      models, sizes, and the images of the objects that experiments share
//! scoring    stages, rounds, controls, materials: a model on unseen objects, set by set
//! curve      scores over the sets of images in the training, and what twice of it would add
//! scenes     an object that is added between two sets; egocentric images through a fisheye and a pinhole
//! limits     mirrors and fine lettering
//! relit      the mesh of a reconstruction under another light
//! occupancy  samples that a grid saves
//! samples    scores and seconds of a render over the samples of a ray
//! variants   small models of several kinds, trained from first values with equal steps
//! ```
//!
//! [`crate::experiment`] runs the cells, stores their results and defines reports. A cell is a model and an
//! object, so that rows are compared object by object; a variant is one training, and its values name the
//! objects.

pub mod curve;
pub mod limits;
pub mod occupancy;
pub mod relit;
pub mod samples;
pub mod scenes;
pub mod scoring;
pub mod setup;
pub mod variants;

#[cfg(test)]
mod tests;
