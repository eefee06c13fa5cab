//! Skinned bodies: joint rotations to transforms, and points from rest to pose. Level 5.
//!
//! ```text
//! pose (J, 3) or captured (J, 3, 4) ─┐
//! correction (J, 3) ─────────────────┼─ pose ──► transforms (J, 3, 4), posed from rest ───┐
//! joints, parents ───────────────────┘                                                    │
//!                                                                                         │
//! canonical points, factors ─┬─ rest ──► points, factors at rest ─────────────────────────┤
//! weights ───────────────────┴────────────────────────────────────────────────────────────┴─ skin ──► posed points, factors
//!                                                                                                           │
//! correction: output of a network of the pose                                                               ▼ splat::project
//! ```

pub mod pose;
pub mod rest;
pub mod skin;
