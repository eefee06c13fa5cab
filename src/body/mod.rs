//! Bodies that move: joints to transforms. Level 5.
//!
//! ```text
//! pose (J, 3) ────────┐
//! correction (J, 3) ──┼─ pose ──► transforms (J, 3, 4), posed from rest
//! joints, parents ────┘
//!      ▲
//! correction: a small network of the pose, trained with the pictures
//! ```
//!
//! Called by `last`, which skins points with the transforms.

pub mod correction;
pub mod pose;
