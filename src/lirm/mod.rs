//! The LIRM system. Level 10.
//!
//! ```text
//! gen       data sets of rendered objects: training, test and egocentric pictures with their passes
//! folder    how a set is begun, continued, started over
//! subject   the object of a set, and its light
//! exposure  photographs of an object brought to one brightness, for training
//! truth     both as files
//! ```

pub mod exposure;
mod folder;
pub mod r#gen;
pub mod subject;
pub mod truth;
