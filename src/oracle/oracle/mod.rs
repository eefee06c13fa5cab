//! Operators on user-supplied arrays: run, compare, localise, mint, check gradients. Level 11.
//!
//! ```text
//! list      the operators with inputs, outputs, shapes, settings, and the page of their twin (text)
//! run       IN.npz ──► OUT.npz, OUT.plan.npz, OUT.digest.json, in f32 (shipped) or f64 (twin)
//! compare   two files, array by array, and the first operator at which they diverge; names holds what is
//!           missing or unknown, differences the results
//! mint      golden files from each operator's own generator and the f64 twin
//! gradcheck the gradient checks of `tape::check`, on the list or on a user-supplied program (program; roles: its
//!           arrays, entries: its R3); checks holds the results
//! ```
//!
//! Functions return records that implement `Display` and serialise to JSON; `cli` prints them.

mod checks;
pub mod compare;
mod differences;
mod entries;
pub mod gradcheck;
pub mod list;
pub mod mint;
mod names;
mod program;
mod roles;
pub mod run;
mod text;
