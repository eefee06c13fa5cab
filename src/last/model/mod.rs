//! The image-to-point model: a variational autoencoder with a graph between its factors (`last.md` §4 – §8).
//!
//! ```text
//! data ──► encoder ──► latent ──► decoder        pictures in, μ and ℓ; structure, groups, KL; points out, L_rec
//!                        ▲                        settings   what can be chosen
//!                     structure                   structure  U, Ω, node networks; Ã
//! step     one batch: forward, losses, gradients
//! train    the schedule: batches, Adam, augmented Lagrangian, the final graph, refit
//! units    how large codes are, when groups come in
//! targets  which factor was set, where it is not told
//! data     what is learned from: pictures (a folder of `last gen`), vectors
//! file     a trained model on disk            evaluation  what it is worth, against the truth (likeness: blocks against factors)
//! guide    what the model says about a render
//! tune     the structure of one subject       intervene  pictures of counterfactuals
//! shipped  the model that comes with the program
//! vectors  data without pictures, for tests of the structure
//! ```
//!
//! The encoder runs on the tape; the decoder is one pass per item, forward and back; `latent` between them is in double precision.

pub mod data;
pub mod decoder;
pub mod encoder;
pub mod evaluation;
pub mod file;
pub mod guide;
pub mod intervene;
pub mod latent;
pub mod likeness;
pub mod pictures;
pub mod settings;
pub mod shipped;
pub mod step;
pub mod structure;
pub mod targets;
pub mod train;
pub mod tune;
pub mod units;
pub mod vectors;

/// Purposes of random numbers.
mod purpose {
    /// mask of a step
    pub(super) const MASK: u16 = 0x0821;
    /// order of the factors in a mask
    pub(super) const ORDER: u16 = 0x0827;
    /// noise of the posterior
    pub(super) const ETA: u16 = 0x0822;
    /// items of a batch
    pub(super) const BATCH: u16 = 0x0823;
    /// coordinates decoded
    pub(super) const POINTS: u16 = 0x0824;
    /// first values of parameters
    pub(super) const INITIAL: u16 = 0x0825;
    /// the map of the vectors of [`super::vectors`]
    pub(super) const VECTORS: u16 = 0x0826;
}
