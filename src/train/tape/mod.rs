//! The small autograd tape and the gradient checks. Level 7.
//!
//! ```text
//! record   records operators with the closures of their adjoints, replays them in reverse
//! params   named parameters
//! nn       recorders for layers of networks
//! check    gradient checks, rungs R0 to R4, for operators and for user-supplied closures
//! probe    directions, finite differences with Richardson, error measures
//! report   results of a check: rungs, numbers, the ten worst entries
//! ```
//!
//! The tape records operators; it does not define any. The caller runs an operator and records its inputs,
//! its outputs and a closure that maps cotangents of the outputs to cotangents of the inputs.

pub mod check;
pub mod nn;
pub mod params;
pub mod probe;
mod record;
pub mod report;

pub use params::Params;
pub use record::{Bar, Grads, Tape, Var};
