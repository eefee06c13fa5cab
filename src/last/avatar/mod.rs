//! Stage 2: an animatable person of Gaussians from a monocular capture, guided by an image-to-point model or by nothing (last.md §10–§12).
//!
//! ```text
//!                 capture (scene::person)                  guide (last::model, or none)
//!                         │                                        │
//! settings ──► fit ───────┴── one shot per iteration ──────────────┤
//!               │  ┌───────────────────────────────────────────┐   │
//!               ├─►│ person: rig (pose, mlp) → place (skin)     │   │   body: template, weights, nearest points
//!               │  │         → splat::render → view: loss       │   │   view: photograph, box, loss in it
//!               │  └────────────── gradients back ─────────────┘   │
//!               ├─ light: a gain per moment
//!               ├─ prior: what one camera cannot see
//!               ├─ update: all at once, or progressive (levels, caps) ◄── graph, key Gaussians
//!               └─ density: pixel criterion, latent criterion        ◄── ∂L_lat/∂picture
//! store: an avatar as a file      evaluate: its pictures against the capture's
//! show: it from anywhere           calibrate: the scale of the latent criterion
//! ```
//!
//! [`fit::PersonFit`] is a [`Fit`](crate::fit::training::Fit) and knows the order of things; every other file does one of them and does
//! not depend on its neighbours' reasons. What the learned model must offer is the trait [`guide::Guide`]; with density mode `pixel`, no progressive update and
//! latent weight 0 the guide is never asked and the fit has the bits of the host alone.
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
