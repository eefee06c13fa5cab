//! Fits: optimisation of scenes from images. Level 9.
//!
//! ```text
//! cli ──► splat ──► training                      the loop: iterations, checkpoints, resumption
//!           ├────► seeds                          first Gaussians: points, a scene file, or random in the box
//!           ├────► splat::pass                    one view: activate ──► draw ──► losses, and their adjoints in reverse
//!           └────► optim                          Adam rows, learning rates, density control
//! splat, last ──► drawing                         the renderer and its adjoint, with buffers kept between renders
//! cli ──► survey                                  directions of the cameras and points per image, before the first iteration
//! cli ──► evaluate                                held-out views: PSNR, SSIM, error maps
//! cli ──► render                                  a scene from given cameras: images, depth, alpha, on disk
//! cli ──► orbit ──► pivot                          circles of cameras around a scene
//! cli ──► relight ──► passes                      a model under given lighting from given cameras
//!           └────► earlier                        results of a previous run in the folder
//! last, lirm, cli ──► passes                      ray-traced images with their passes, on disk as a capture
//! ```
//!
//! Fits return records and report progress to a [`training::Watch`]; `cli` prints and writes reports. No code
//! here reads a clock.

pub mod built_in;
pub mod drawing;
mod earlier;
pub mod evaluate;
pub mod exposure;
pub mod field;
pub mod frames;
pub mod orbit;
pub mod passes;
mod pivot;
pub mod relight;
pub mod render;
pub mod seeds;
pub mod splat;
pub mod survey;
pub mod training;
