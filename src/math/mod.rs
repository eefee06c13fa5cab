//! Small geometry, each function beside its adjoint, one body for `f32` and `f32x8`. Level 1.

pub mod quat;
pub mod sh;
