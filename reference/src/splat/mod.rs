//! 3-D Gaussian splatting.
//!
//! ```text
//! activate ──► covariance ──► project ─┬─► blend ──► image          render = project + color + blend
//!                             color ───┘     ▲
//!                                          plan
//! ```

pub mod activate;
pub mod blend;
pub mod color;
pub mod covariance;
pub mod footprint;
pub mod plan;
mod ports;
pub mod project;
pub mod render;
