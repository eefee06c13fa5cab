//! Fits: from photographs to scenes. Level 9.
//!
//! ```text
//! cli ──► splat ──► training                      the loop: iterations, checkpoints, resumption
//!           ├────► seeds                          first Gaussians: points, a scene file, or random in the box
//!           ├────► splat::pass                    one view: activate ──► draw ──► losses, and their adjoints in reverse
//!           └────► optim                          Adam rows, learning rates, density control
//! splat, last ──► drawing                         the renderer and its adjoint, with memory kept between renders
//! cli ──► survey                                   where cameras point, what they see, before the first iteration
//! cli ──► evaluate                                held-out views: PSNR, SSIM, error maps
//! cli ──► render                                  a scene along cameras: pictures, depth, alpha, on disk
//! cli ──► orbit                                   circles of cameras around a scene
//! cli ──► relight ──► passes                      a model under light along cameras
//!           └────► earlier                        what a run before it left in the folder
//! last, lirm, cli ──► passes                      ray-traced pictures with their passes, on disk as a capture
//! ```
//!
//! Fits return records and tell a [`training::Watch`] how far they are; printing and reports are the business of `cli`.
//! Nothing here reads a clock.

pub mod built_in;
pub mod drawing;
mod earlier;
pub mod evaluate;
pub mod frames;
pub mod orbit;
pub mod passes;
pub mod relight;
pub mod render;
pub mod seeds;
pub mod splat;
pub mod survey;
pub mod training;
