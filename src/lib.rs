//! lastlight: a bit-reproducible CPU reference of two differentiable-rendering systems.
//!
//! Every result is a pure function of the input bits and the seed: the same bits for any number of threads, in debug and release, at any
//! vector width. Every operator has a hand-derived adjoint, an independent twin in f64 (`reference`), gradient checks, and a
//! digest. At this stage: Gaussian splatting of static scenes, the operator oracle, gradient checks, scenes with known truth.
//!
//! # Doors
//! * Checking a kernel or a renderer against this one: [`ops`] (the operator list), [`oracle`], `lastlight oracle`.
//! * Checking a gradient: [`check`], `lastlight gradcheck`.
//! * Learning what is computed and why: [`book`].
//!
//! # Levels
//! A module may use itself and any level of a smaller number (`tests/levels.rs` reads the source and says so).
//!
//! ```text
//! 0  error, num     where bits are decided         6  loss       between pictures
//! 1  math           small geometry                 7  tape       strings operators; gradient checks
//! 2  io             bytes <-> plain records        8  optim      Adam, schedules, density control
//! 3  scene          validated, typed               9  ops        the operator list      fit   training
//! 4  nn             layers                        10  last, lirm the two systems
//!    geometry       rays and triangles            11  oracle     somebody's arrays
//! 5  splat          Gaussians to pictures         13  cli        commands and reports
//!    causal         factors and their graph
//!    shade          materials and light
//!    body           joints to transforms, skinning
//! ```
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

pub mod error;
pub mod num;

pub use error::{Error, Result};
pub use tape::check;
pub mod body;
pub mod book;
pub mod causal;
#[doc(hidden)]
pub mod cli;
pub mod fit;
pub mod geometry;
pub mod io;
pub mod last;
pub mod lirm;
pub mod loss;
pub mod math;
pub mod nn;
pub mod ops;
pub mod optim;
pub mod oracle;
pub mod scene;
pub mod shade;
pub mod splat;
pub mod tape;
