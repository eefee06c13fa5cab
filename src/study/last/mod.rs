//! The experiments of `last.md` §14: what the paper claims, what this program finds.
//!
//! ```text
//! learn    E4, E10, E11, E12: structure learned from vectors of known factors
//! pictures E10 and E11 on pictures of them
//! person   the others: persons fitted with and without the model
//! ```
//!
//! Cells, their files, runs and reports are those of [`crate::experiment`].

pub mod learn;
pub mod person;
pub mod pictures;
