//! Bodies that move: joints to transforms, transforms to points. Level 5.
//!
//! ```text
//! pose (J, 3) ────────┐
//! correction (J, 3) ──┼─ pose ──► transforms (J, 3, 4), posed from rest ─┐
//! joints, parents ────┘                                                  │
//!      ▲                  rest points, rest factors, weights ────────────┴─ skin ──► posed points, posed factors ──► splat::project
//! correction: a small network of the pose, trained with the pictures
//! ```

pub mod correction;
pub mod pose;
pub mod skin;
