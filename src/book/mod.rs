//! The book: derivations of what the program computes, checked by executable listings.
//!
//! ```text
//! conventions ──► bit_contract ──► one_gaussian ──► adjoint_of_blending ──► profiles
//!                                                                            │
//!                          fitting ◄── oracle_and_gradcheck ◄── formats ◄────┘
//!                             │
//!                             ├──► light_and_rays ──► known_truth ──► learned_causes
//!                             ├──► field ──► field_adjoint ──► meshes
//!                             └──► tokens ──► attention ──► updates ──► small_model
//! notation       paper symbol, name in the code, shape, unit        bibliography    cited works
//! ```
//!
//! Chapters on operators have the same structure: the problem, the equation, the *twin* (an independent double-precision
//! implementation), numbers to check by hand, the shipped operator and how it differs. Listings are doctests:
//! `cargo test --release --doc` runs them, so an incorrect chapter is a failing test. Where an equation is too large for a
//! listing, the chapter names the test that evaluates it.
//!
//! Runnable programs are in `src/book/examples/`:
//!
//! ```text
//! cargo run --release --example render_one_gaussian    an image of one Gaussian in the terminal, and its gradient
//! cargo run --release --example check_my_gradient      check of a user-supplied gradient, correct and wrong
//! cargo run --release --example oracle_roundtrip       an operator run in f32 and f64, with the results compared
//! ```

#[doc = include_str!("conventions.md")]
pub mod conventions {}

#[doc = include_str!("bit_contract.md")]
pub mod bit_contract {}

#[doc = include_str!("one_gaussian.md")]
pub mod one_gaussian {}

#[doc = include_str!("adjoint_of_blending.md")]
pub mod adjoint_of_blending {}

#[doc = include_str!("profiles.md")]
pub mod profiles {}

#[doc = include_str!("formats.md")]
pub mod formats {}

#[doc = include_str!("oracle_and_gradcheck.md")]
pub mod oracle_and_gradcheck {}

#[doc = include_str!("fitting.md")]
pub mod fitting {}

#[doc = include_str!("light_and_rays.md")]
pub mod light_and_rays {}

#[doc = include_str!("known_truth.md")]
pub mod known_truth {}

#[doc = include_str!("learned_causes.md")]
pub mod learned_causes {}

#[doc = include_str!("field.md")]
#[doc = "## Chart of the quadrature\n\nThe largest error of the depth against the step, measured with the shipped operators."]
#[doc = ""]
#[doc = include_str!("figures/quadrature.svg")]
pub mod field {}

#[doc = include_str!("field_adjoint.md")]
pub mod field_adjoint {}
#[doc = include_str!("meshes.md")]
pub mod meshes {}

#[doc = include_str!("tokens.md")]
pub mod tokens {}

#[doc = include_str!("attention.md")]
pub mod attention {}

#[doc = include_str!("updates.md")]
pub mod updates {}

#[doc = include_str!("small_model.md")]
pub mod small_model {}

#[doc = include_str!("notation.md")]
pub mod notation {}

#[doc = include_str!("bibliography.md")]
pub mod bibliography {}

// The listings of the README are tested too; its text is not part of the book.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
mod front_page {}
