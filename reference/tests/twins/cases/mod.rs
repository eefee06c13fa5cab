//! Operators with inputs at which their gradients are tested.

mod case;
mod causal;
mod field;
mod loss;
mod nn;
mod people;
mod shade;
mod splat;

pub(crate) use case::{Case, picked};

/// All cases: every smooth input and output of every operator that has a gradient is in one.
pub(crate) fn cases() -> Vec<Case> {
    [splat::cases, nn::cases, shade::cases, causal::cases, field::cases, loss::cases, people::cases]
        .into_iter()
        .flat_map(|cases| cases())
        .collect()
}
