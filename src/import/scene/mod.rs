//! Scenes out of other programs' models and captures. Level 3.
//!
//! ```text
//! model       glTF and OBJ as objects with materials        character   skinned characters, posed
//! person      published captures of people, converted to lastlight's layout
//! object      published captures of one object, converted to images with passes
//! ```
//!
//! The rest of `scene` is [`lastlight_scene`], re-exported here.

pub mod character;
pub mod model;
pub mod object;
pub mod person;

#[doc(no_inline)]
pub use lastlight_scene::*;
