//! The model of LIRM: a transformer that turns posed images of an object into a field, and improves it with
//! more of them.
//!
//! ```text
//! config       the sizes of a model: paper, small           params   its arrays: names, shapes, first values
//! choices      what a configuration chooses among
//! transformer  one set of images: from a state to the next  places   first values of the planes' tokens from their positions
//! weights      arrays as operators read them, gradients     decode   from a state to a field
//!
//! images, rays, photos ──► nn.tokens ────────────────┐
//!                                                    ▼
//! state of the last set ─► nn.fuse ◄─ places ──────► blocks ──► LayerNorm ──► state ──┬──► next set
//!   (0 before the first)                                                              │
//!                                                    nn.unpatch ◄─────────────────────┘
//!                                                    │
//!                           planes, panoramas, heads ▼
//!                                                    field ──► field.render, mesh, relighting
//!
//! file     a model as safetensors                           origin   the training that produced a model
//! state    tokens of an object, its place, the images read  shipped  the model that comes with the program
//! ```
//!
//! The state is the tokens of the planes and of the panoramas after the final LayerNorm. Its size does not
//! depend on how many images made it. The same weights serve every set of images. In training the state is a
//! constant input of the next set, unless `--state-gradient` lets gradients flow through it.
//!
//! What the paper leaves open is a named setting of [`Config`].

mod choices;
pub mod config;
pub mod decode;
pub mod file;
pub mod origin;
pub mod params;
pub mod places;
pub mod shipped;
pub mod state;
pub mod transformer;
pub mod weights;

#[cfg(test)]
mod tests;

pub use config::{Config, FirstValues, Fuse};
