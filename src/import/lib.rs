//! Levels 2 and 3 of lastlight: models of other programs and published captures of people and objects, as
//! records and as scenes.
//!
//! ```text
//! io      glTF, OBJ, pickle, HDF5, SMPL, published captures as plain records, beside the formats of `lastlight_files`    level 2
//! scene   models, characters and published captures as scenes, beside those of `lastlight_scene`                        level 3
//! ```
#![forbid(unsafe_code)]

pub mod io;
pub mod scene;

#[doc(hidden)]
pub use lastlight_num::{Error, Result, error, math, num, with_array};
