//! Stage 2 of LAST: fits an avatar, an animatable person represented by Gaussians, to a monocular capture,
//! optionally guided by an image-to-point model (eq. 8–12 of the paper).
//!
//! ```text
//!                 capture (scene::person)                  guide (last::model, or none)
//!                         │                                        │
//! settings ──► fit ───────┴── one shot per iteration ──────────────┤
//!               │  ┌───────────────────────────────────────────┐   │
//!               ├─►│ person: rig (pose, mlp) → place (skin)     │   │   body: template, weights, nearest points
//!               │  │         → splat::render → view: loss       │   │   view: input image, box, loss
//!               │  └────────────── gradients back ─────────────┘   │
//!               ├─ light: gain and direction per moment
//!               ├─ prior: regularises unseen surfaces
//!               ├─ update: all at once, or progressive (levels, caps) ◄── graph, key Gaussians
//!               └─ density: pixel criterion, latent criterion        ◄── ∂L_lat/∂image
//! store: avatar files              evaluate: scores of rendered images
//! show: renders from any camera    calibrate: the scale of the latent criterion
//! ```
//!
//! [`fit::PersonFit`] implements [`Fit`](crate::fit::training::Fit) and determines the order of the steps;
//! every other file implements one of them independently of the others. The trait [`guide::Guide`] is the
//! interface of the learned model. With density mode `pixel`, no progressive update and latent weight 0, the
//! guide is not used and the result is bit-identical to that of a fit without a guide.
//!
//! Random draws have purposes 0x0901 … 0x0907.

pub mod body;
pub mod calibrate;
pub mod density;
pub mod density_settings;
pub mod evaluate;
pub mod fit;
pub mod guide;
pub mod light;
mod mlp;
pub mod person;
pub mod pose;
pub mod prior;
mod prior_settings;
pub mod progressive;
mod ranking;
pub mod settings;
mod show;
pub mod skin;
pub mod store;
pub mod view;

#[cfg(test)]
mod trials;
