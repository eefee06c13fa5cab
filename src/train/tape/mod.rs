//! The small autograd tape and the gradient checks. Level 7.
//!
//! ```text
//! record   records operators with the closures of their adjoints, replays them in reverse
//! params   parameters with names
//! nn       recorders of the layers of networks
//! check    gradient checks, rungs R0 to R4, for our operators and for anyone's closure
//! probe    directions, finite differences with Richardson, error measures
//! report   what a check found: rungs, numbers, the ten worst entries
//! ```
//!
//! The tape strings operators, it defines none: whoever runs an operator records its inputs, its outputs and a
//! closure that turns cotangents of the outputs into cotangents of the inputs.

pub mod check;
pub mod nn;
pub mod params;
pub mod probe;
mod record;
pub mod report;

pub use params::Params;
pub use record::{Bar, Grads, Tape, Var};
