//! The LIRM system. Level 10.
//!
//! ```text
//! gen       data sets of rendered objects: training, test and egocentric pictures with their passes
//! subject   the object of a set, and its light
//! exposure  photographs of an object brought to one brightness, for training
//! ```

pub mod exposure;
pub mod r#gen;
pub mod subject;
