//! The experiments of LAST: claims of the paper, and the results of this program.
//!
//! ```text
//! learn    E4, E10, E11, E12: structure learned from vectors of known factors
//! images   E10 and E11 on images rendered from such factors
//! person   the others: persons fitted with and without the model
//! ```
//!
//! [`crate::experiment`] runs the cells, stores their results and defines reports.

pub mod images;
pub mod learn;
pub mod person;
