//! Bodies that move: joints to transforms, rest to pose. Level 5.
//!
//! ```text
//! pose (J, 3) ────────┐
//! correction (J, 3) ──┼─ pose ──► transforms (J, 3, 4), posed from rest ─┐
//! joints, parents ────┘                                                 │
//!      ▲                                rest points, rest factors ──────┤
//!      │                                weights ────────────────────────┴─ skin ──► posed points, posed factors
//! correction: what a network of the pose asks for                                          │
//!                                                                                          ▼ splat::project
//! ```

pub mod pose;
pub mod skin;
