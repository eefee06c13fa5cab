//! Operators on user-supplied arrays: run, compare, localise, mint, check gradients. Level 11.
//!
//! ```text
//! list      the operators with inputs, outputs, shapes, settings
//! run       IN.npz ──► OUT.npz, OUT.plan.npz, OUT.digest.json, in f32 (shipped) or f64 (twin)
//! compare   two files, array by array, and the first operator at which they diverge; names holds what is
//!           missing or unknown, differences the results
//! mint      golden files from each operator's own generator and the f64 twin
//! gradcheck the gradient checks of `tape::check`, on the list or on a user-supplied program (program); checks
//!           holds the results
//! ```
//!
//! Functions return records that implement `Display` and serialise to JSON; `cli` prints them.

mod checks;
pub mod compare;
mod differences;
pub mod gradcheck;
pub mod list;
pub mod mint;
mod names;
mod program;
pub mod run;
