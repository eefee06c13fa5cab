//! Bodies that move. Level 5.
//!
//! ```text
//! rest points, rest factors ─┐
//! weights, joint transforms ─┴─ skin ──► posed points, posed factors ──► splat::project
//! ```

pub mod skin;
