//! Optimisers. They have no gradient.

pub mod adam;
pub mod adamw;
