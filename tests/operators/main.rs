//! Tests of levels 4 to 9: operators against golden arrays, closed forms, the twin and finite differences,
//! and what runs them.

#[path = "../common/chains.rs"]
mod chains;
#[path = "../common/mod.rs"]
mod common;
mod density;
mod domain;
mod field;
mod geometry;
mod gradients;
mod kinks;
mod linear;
mod loss;
mod mcmc;
mod memory;
mod optim;
mod oracle;
mod shade;
mod splat;
mod surface;
mod tokens;
mod transformer;
