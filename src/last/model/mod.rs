//! The image-to-point model: a variational autoencoder with a graph between its factors (`last.md` §4 – §8).
//!
//! ```text
//! data ──► encoder ──► latent ──► decoder        pictures in, μ and ℓ; structure, groups, KL; points out, L_rec
//!                        ▲                        settings   what can be chosen
//!                     structure                   structure  U, Ω, node networks; Ã
//! step     one batch: forward, losses, gradients
//! train    the schedule: batches, Adam, augmented Lagrangian, the final graph, refit
//! data     what is learned from: pictures (a folder of `last gen`), vectors
//! vectors  data without pictures, for tests of the structure
//! ```
//!
//! The encoder runs on the tape; the decoder is one pass per item, forward and back; `latent` between them is in double precision.

pub mod data;
pub mod decoder;
pub mod encoder;
pub mod file;
pub mod latent;
pub mod pictures;
pub mod settings;
pub mod step;
pub mod structure;
pub mod train;
pub mod vectors;

/// Purposes of random numbers.
pub(crate) mod purpose {
    /// mask of a step
    pub const MASK: u16 = 0x0801;
    /// noise of the posterior
    pub const ETA: u16 = 0x0802;
    /// items of a batch
    pub const BATCH: u16 = 0x0803;
    /// coordinates decoded
    pub const POINTS: u16 = 0x0804;
    /// first values of parameters
    pub const INITIAL: u16 = 0x0805;
    /// the map of the vectors of [`super::vectors`]
    pub const VECTORS: u16 = 0x0806;
}
