//! Levels 7 to 10 of lastlight: the tape with gradient checks, optimisers, fits, the study engine.
//!
//! ```text
//! tape        records operators and replays their adjoints; `check` holds the gradient checks    level 7
//! optim       Adam, schedules, density control                                                   level 8
//! fit         the training loop with checkpoints, fits of scenes, rendering to a capture         level 9
//! experiment  the study engine: cells, resumed and in parallel, statistics, tables               level 10
//! ```
#![forbid(unsafe_code)]

pub mod experiment;
pub mod fit;
pub mod optim;
pub mod tape;

#[doc(hidden)]
pub use lastlight_files as io;
#[doc(hidden)]
pub use lastlight_kernels::{body, causal, field, geometry, loss, nn, shade, splat};
#[doc(hidden)]
pub use lastlight_num::{Error, Result, error, math, num, with_array};
#[doc(hidden)]
pub use lastlight_scene as scene;
#[doc(hidden)]
pub use tape::check;
