//! lastlight: a bit-reproducible CPU reference of two differentiable-rendering systems.
//!
//! Every result is a pure function of the input bits and the seed: the same bits for any number of threads, in debug and release, at any
//! vector width. Every operator has a hand-derived adjoint, an independent twin in f64 (`reference`), gradient checks, and a
//! digest. Available: Gaussian splatting of static scenes, LAST, the operator oracle, gradient checks,
//! scenes with known truth; of LIRM, its training data.
//!
//! # Doors
//! * Checking a kernel or a renderer against this one: [`ops`] (the operator list), [`oracle`], `lastlight oracle`.
//! * Checking a gradient: [`check`], `lastlight gradcheck`.
//! * Learning what is computed and why: [`book`].
//!
//! # Levels
//! The library is made of member crates under `src/`, re-exported here under one set of paths. A module may use itself and any level of a
//! smaller number; the compiler enforces it between members, `tests/house` inside them (`ARCHITECTURE.md`).
//!
//! ```text
//! 0  error, num     where bits are decided         6  loss       between images
//! 1  math           small geometry                 7  tape       records operators; gradient checks
//! 2  io             bytes <-> plain records        8  optim      Adam, schedules, density control
//! 3  scene          validated, typed               9  ops        the operator list      fit   training
//! 4  nn             layers                        10  last, lirm the two systems    experiment   the study engine
//!    geometry       rays and triangles            11  oracle     operators on user-supplied arrays
//! 5  splat          Gaussians to images           12  last::study  experiments
//!    causal         factors and their graph       13  cli        commands and reports
//!    shade          materials and light
//!    field          fields of objects
//!    body           joints to transforms, skinning
//! ```
//!
//! The feature `cli` (on by default) adds the commands and the binary; a program that uses the library alone does without it.
//!
//! # Example
//! One Gaussian, one pixel; [`book::one_gaussian`] does it by hand.
//!
//! ```
//! use lastlight::scene::camera::{Camera, Model};
//! use lastlight::splat::render::{Color, In, Settings, Shape, forward};
//!
//! let eye = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.];
//! let camera = Camera::from_matrices(&eye, &[40., 0., 0.5, 0., 40., 0.5, 0., 0., 1.], 1, 1, Model::Pinhole);
//! let x = In {
//!     means: &[[0.0, 0.0, 4.0]],
//!     shape: Shape::QuatScale { quats: &[[1.0, 0.0, 0.0, 0.0]], scales: &[[0.1; 3]] },
//!     opacities: &[0.25],
//!     color: Color::Rgb(&[[1.0, 0.0, 0.0]]),
//!     cameras: &[camera],
//!     background: [0.0, 0.0, 1.0],
//! };
//! x.validate(&Settings::default())?;
//! let (out, _) = forward(&x, &Settings::default());
//! assert_eq!(out.image, [0.25, 0.0, 0.75]);
//! # Ok::<(), lastlight::Error>(())
//! ```
#![forbid(unsafe_code)]

pub mod book;

#[cfg(feature = "cli")]
#[doc(hidden)]
pub use lastlight_cli as cli;
pub use lastlight_import::{io, scene};
pub use lastlight_kernels::{body, causal, field, geometry, loss, nn, shade, splat};
pub use lastlight_lirm as lirm;
pub use lastlight_num::{Error, Result, error, math, num, with_array};
pub use lastlight_oracle::{ops, oracle};
pub use lastlight_train::{check, experiment, fit, optim, tape};

/// The LAST system. Level 10; its experiments are of level 12.
pub mod last {
    #[doc(no_inline)]
    pub use lastlight_last::*;
    #[doc(inline)]
    pub use lastlight_study::last as study;
}
