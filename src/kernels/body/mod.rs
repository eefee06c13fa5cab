//! Bodies that move: joints to transforms, rest to pose. Level 5.
//!
//! ```text
//! pose (J, 3) or captured (J, 3, 4) ─┐
//! correction (J, 3) ─────────────────┼─ pose ──► transforms (J, 3, 4), posed from rest ───┐
//! joints, parents ───────────────────┘                                                    │
//!                                                                                         │
//! canonical points, factors ─┬─ rest ──► points, factors at rest ─────────────────────────┤
//! weights ───────────────────┴────────────────────────────────────────────────────────────┴─ skin ──► posed points, factors
//!                                                                                                           │
//! correction: what a network of the pose asks for                                                           ▼ splat::project
//! ```

pub mod pose;
pub mod rest;
pub mod skin;
