//! Bodies that move: joints to transforms, rest to pose. Level 5.
//!
//! ```text
//! pose (J, 3) ────────┐
//! correction (J, 3) ──┼─ pose ──► transforms (J, 3, 4), posed from rest ─┐
//! joints, parents ────┘                                                 │
//!      ▲                                rest points, rest factors ──────┤
//!      │                                weights ────────────────────────┴─ skin ──► posed points, posed factors
//! correction: a small network of the pose, trained with the pictures                       │
//!                                                                                          ▼ splat::project
//! ```

pub mod correction;
pub mod pose;
pub mod skin;
