//! The operator list: the only file that names every operator. Level 9.
//!
//! One line of [`LIST`] drives `oracle list | run | mint`, twin tests, gradient checks, golden files, digests and the
//! table of the book. The entry itself stands beside the adapter that turns named arrays into the operator's
//! arguments, one file per group:
//!
//! ```text
//! op       what the list knows of an operator        call     from somebody's arrays to checked inputs
//! twin     runs in f64, and array conversion         subject  the operator as the gradient checks see it
//! case     drawing of generated cases                splat, geometry, nn, loss, lpips, points,
//!                                                    groups, shade, pose, body, optim: the entries
//! ```

mod body;
mod call;
mod case;
mod geometry;
mod groups;
mod loss;
mod lpips;
mod nn;
mod op;
mod optim;
mod points;
mod pose;
mod shade;
mod splat;
mod subject;
mod twin;

pub use call::{Call, Checked, Dims, Ran, Settings};
pub use op::{Case, Compare, Dtype, Kind, Op, Port, SettingSpec, Stage, Width};
pub use reference::settings::Setting;
pub use subject::{OpSubject, draw_cotangents};
pub use twin::{run as run_f64, work};

use crate::{Error, Result};

/// All operators.
pub static LIST: &[&Op] = &[
    &splat::activate::OP,
    &splat::covariance::OP,
    &splat::project::OP,
    &splat::color::OP,
    &splat::blend::OP,
    &splat::render::OP,
    &geometry::TRACE,
    &nn::LINEAR,
    &nn::LEAKY_RELU,
    &nn::CONV,
    &loss::L1,
    &loss::MSE,
    &loss::SSIM,
    &lpips::LPIPS,
    &points::POINTS,
    &groups::GROUPS,
    &shade::GGX,
    &shade::ENVMAP,
    &pose::POSE,
    &body::SKIN,
    &optim::ADAM,
    &optim::ADAMW,
];

/// The operator of that name.
///
/// # Errors
/// When there is none; the error lists the names.
pub fn find(name: &str) -> Result<&'static Op> {
    LIST.iter().copied().find(|op| op.name == name).ok_or_else(|| {
        let names: Vec<_> = LIST.iter().map(|op| op.name).collect();
        Error::input("operator").expected(format!("one of {}", names.join(", "))).got(format!("'{name}'"))
    })
}

/// The operators of those names, all if there are none, in the order of the list.
///
/// # Errors
/// When a name is unknown.
pub fn choose(names: &[String]) -> Result<Vec<&'static Op>> {
    for name in names {
        find(name)?;
    }
    Ok(LIST.iter().copied().filter(|op| names.is_empty() || names.iter().any(|n| n == op.name)).collect())
}

/// Runs the shipped operator.
///
/// # Errors
/// Bad input.
pub fn run(op: &'static Op, call: &Call) -> Result<Ran> {
    let checked = Checked::new(op, call, true)?;
    (op.run)(&checked)
}
