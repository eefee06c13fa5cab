//! Acceptance tests of the LAST system, one module for each thing that must hold.

mod abduction;
mod acyclicity;
mod independence;
mod intervention;
mod models;
mod repair;
