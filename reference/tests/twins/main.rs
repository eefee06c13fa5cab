//! Tests of the twins, in the order of trust: closed forms, golden arrays made by other programs, derivatives.

mod cases;
mod closed_forms;
mod golden;
mod gradients;
mod npz;
mod numbers;
mod scenes;
mod semantics;
mod signatures;
mod skin;
