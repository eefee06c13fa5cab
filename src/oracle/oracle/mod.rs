//! Operators on somebody's arrays: run, compare, localise, mint, check gradients. Level 11.
//!
//! ```text
//! list      what can be run, with inputs, outputs, shapes, settings
//! run       IN.npz ──► OUT.npz, OUT.plan.npz, OUT.digest.json, in f32 (shipped) or f64 (twin)
//! compare   two files, array by array, and the first operator at which they part; differences is what it
//!           found, html renders it
//! mint      golden files from each operator's own generator and the f64 twin
//! gradcheck the gradient checks of `tape::check`, on the list or on somebody's program
//! ```
//!
//! Functions return records that print themselves (`Display`) and serialise to JSON; `cli` does the rest.

pub mod compare;
mod differences;
pub mod gradcheck;
mod html;
pub mod list;
pub mod mint;
pub mod run;
