//! Bodies that move: linear blend skinning.
//!
//! ```text
//! rest points, rest factors ─┐
//! weights, joint transforms ─┴─ skin ──► posed points, posed factors
//! ```
//!
//! Called by `data-gen`, which poses its figure with it.

pub mod skin;
