//! Captures of people from published layouts.
//!
//! ```text
//! io::captures, io::smpl ──► import ──► the layout on disk ──► lastlight_scene::person
//! smpl     bodies of the SMPL family: shaped, posed
//! ```
//!
//! The rest of `scene::person` is [`lastlight_scene::person`], re-exported here.

pub mod import;
pub mod smpl;

#[doc(no_inline)]
pub use lastlight_scene::person::*;
