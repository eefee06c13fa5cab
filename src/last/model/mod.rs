//! The image-to-point model: a variational autoencoder with a graph between its factors (eq. 1–7 of the LAST
//! paper; chapter *Learned causes*).
//!
//! ```text
//! data ──► encoder ──► latent ──► decoder        image → μ and ℓ; structure, groups, KL; → points, L_rec
//!                        ▲                        settings   settings of model and training
//!                     structure                   structure  U, Ω, node networks; Ã
//! step     one batch: forward pass, losses, gradients
//! train    the schedule: batches, Adam, augmented Lagrangian, the final graph, refit
//! units    rescales codes when the group losses start
//! targets  infers which factor was set, if it is not given
//! data     training data: images (a folder of `last gen`), vectors
//! file     model files                            evaluation  scores against the truth (likeness: blocks against factors)
//! guide    the interface used by the fit of an avatar
//! tune     fine-tunes the structure on one subject   intervene  images of counterfactuals
//! shipped  the model included in the program
//! vectors  data without images, for tests of the structure
//! ```
//!
//! The encoder runs on the tape; the decoder is one forward and backward pass per item; `latent` between them
//! uses double precision.

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

/// Purpose numbers of random draws.
mod purpose {
    /// Mask of a step.
    pub(super) const MASK: u16 = 0x0821;
    /// Order of the factors in a mask.
    pub(super) const ORDER: u16 = 0x0827;
    /// Noise of the posterior.
    pub(super) const ETA: u16 = 0x0822;
    /// Items of a batch.
    pub(super) const BATCH: u16 = 0x0823;
    /// Coordinates that are decoded.
    pub(super) const POINTS: u16 = 0x0824;
    /// Initial values of parameters.
    pub(super) const INITIAL: u16 = 0x0825;
    /// The map of [`super::vectors`].
    pub(super) const VECTORS: u16 = 0x0826;
}
