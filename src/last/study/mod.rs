//! The experiments of `last.md` §14: what the paper claims, what this program finds.
//!
//! ```text
//! plan     an experiment: cells, each a function of its key; what its results mean
//! learn    E4, E10, E11, E12: structure learned from vectors of known factors
//! pictures E10 and E11 on pictures of them
//! stats    means, deviations, paired intervals
//! run      cells that are not there yet are run, one file each; all together make the reports
//! ```
//!
//! A cell is one training or fit with one seed. Its result is a file `cells/ID/KEY.json` in the folder of the study, written whole or not at all, so a
//! study that was interrupted goes on where it stopped, and two studies of one seed are the same files. Reports are made from these files alone.

pub mod learn;
pub mod person;
pub mod pictures;
pub mod plan;
pub mod run;
pub mod stats;
