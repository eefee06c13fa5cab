//! Levels 4 to 6 of lastlight: layers, geometry, renderers, light, causal operators, bodies and losses, each
//! with its adjoint.
//!
//! ```text
//! nn, geometry                 layers; rays, triangles and distances          level 4
//! splat, field, shade          renderers, fields of objects, light             level 5
//! causal, body                 factors, skinned bodies                        level 5
//! loss                         losses of images, points and groups; metrics   level 6
//! ```
//!
//! # Terms
//! * A **cotangent** of an array x, written x̄ and named `x_bar`, is the derivative of the final loss by x. The
//!   cotangent of an output is `grad_output` in PyTorch, that of an input its gradient.
//! * `In`, `Saved` and `Out` are the inputs of an operator, the intermediate values that its adjoint needs, and
//!   its outputs; `InBar` and `OutBar` are the cotangents of inputs and outputs.
//! * The **plan** of an operator contains its discrete decisions, such as a sort order or a clamp. The adjoint
//!   reuses the decisions of the forward pass, and a stored plan can replace them.
//! * The **twin** of an operator is an independent implementation in double precision in the crate `reference`.
//! * A **kink** is a point where a function is not differentiable; the section *Kinks and domain* defines
//!   the gradient there.
//! * A **left fold** adds terms one after the other in the stated order; a **chain** is a left fold of products.
#![forbid(unsafe_code)]

pub mod body;
pub mod causal;
pub mod field;
pub mod geometry;
pub mod loss;
pub mod nn;
pub mod shade;
pub mod splat;

#[doc(hidden)]
pub use lastlight_files as io;
#[doc(hidden)]
pub use lastlight_num::{Error, Result, error, math, num, with_array};
#[doc(hidden)]
pub use lastlight_scene as scene;
