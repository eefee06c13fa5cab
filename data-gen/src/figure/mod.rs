//! The figure: an articulated person with known causal factors.
//!
//! ```text
//! graph ─► mechanism ─► samples, video ─► u ─► factors ─► skeleton (pose)
//!              └► sortability                    │           │
//!                                                ▼           ▼
//!                appearance ──────────────► template     surface, texture
//!                                           points        meshes
//! ```
//!
//! The images depend on the factors only through [`factors::Drive`]: folds depend only on u_W, light only on
//! u_L. Posture affects them only through the causal graph, so the graph is the causal truth about the
//! images.

pub mod appearance;
pub mod factors;
mod garments;
pub mod graph;
mod loft;
pub mod mechanism;
pub mod samples;
pub mod skeleton;
pub mod sortability;
pub mod surface;
pub mod template;
mod texture;
pub mod video;

/// Maximum number of factors of a figure.
pub const MAX_FACTORS: usize = 8;

/// Purpose numbers of random draws.
pub mod purpose {
    /// Order of the nodes of a random graph; item: node.
    pub const GRAPH_ORDER: u16 = 0x0200;
    /// Order in which its edges are added; item: pair.
    pub const GRAPH_EDGE: u16 = 0x0201;
    /// Coefficients; item: edge; draw 0 magnitude, draw 1 sign.
    pub const COEFFICIENT: u16 = 0x0202;
    /// Noise for variances of nonlinear mechanisms; item: sample, draw: node.
    pub const DRAWS: u16 = 0x0203;
    /// Noise of observational frames; item: frame, draw: node.
    pub const OBSERVED: u16 = 0x0204;
    /// Noise of base frames; item: base, step: trial, draw: node.
    pub const BASE: u16 = 0x0205;
    /// Value of an intervention; item: group.
    pub const VALUE: u16 = 0x0206;
    /// Appearance of a group; item: group.
    pub const GROUP_APPEARANCE: u16 = 0x0207;
    /// Motion of a video; item: 8 × subject + factor; draws 0, 1 rank of the harmonics, 2, 3 phases.
    pub const MOTION: u16 = 0x0208;
    /// Appearance; item: its seed, draw: property.
    pub const APPEARANCE: u16 = 0x0209;
    /// Light samples of an image of a video; item: 64 × frame + camera.
    pub const PICTURE_VIDEO: u16 = 0x020b;
    /// Light samples of an observational image; item: frame.
    pub const PICTURE_OBSERVED: u16 = 0x020c;
    /// Light samples of an image before an intervention; item: base.
    pub const PICTURE_BASE: u16 = 0x020d;
    /// Light samples of an image after an intervention; item: base.
    pub const PICTURE_AFTER: u16 = 0x020e;
    /// Grain of the textures; item: cell.
    pub const GRAIN: u16 = 0x020a;
}
