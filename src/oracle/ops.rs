//! The operator list: the only file that names every operator. Level 9.
//!
//! One line of [`LIST`] drives `oracle list | run | mint`, twin tests, gradient checks, golden files, digests
//! and the table of the book. The entries and the adapters between named arrays and the
//! arguments of operators are in one file per group:
//!
//! ```text
//! op       an entry of the list                      call     a call and its result; checked: from
//!                                                    user-supplied arrays to checked inputs
//! twin     runs in f64, and array conversion         subject  the operator as the gradient checks see it
//! case     drawing of generated cases                similar: suggestions for unknown names
//! splat, field, geometry, nn, networks, transformer, tokens, loss, points, groups, lpips, latent, prior, shade, moment, light, causal, surface, pose,
//! skin, rest, optim: the entries
//! ```

mod call;
mod case;
mod causal;
mod checked;
mod field;
mod geometry;
mod groups;
mod latent;
mod light;
mod loss;
mod lpips;
mod moment;
mod networks;
mod nn;
mod op;
mod optim;
mod points;
mod pose;
mod prior;
mod rest;
mod shade;
mod similar;
mod skin;
mod splat;
mod subject;
mod surface;
mod tokens;
mod transformer;
mod twin;

pub use call::{Call, RunResult, Settings};
pub use checked::run;
pub use op::{Case, CheckedCall, Op, Width};
pub use reference::inputs::Dims;
pub use reference::ports::{Compare, Dtype, Kind, Port, SettingSpec, Signature, Space, Stage};
pub use reference::settings::Setting;
pub use similar::similar;
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
    &networks::MLP,
    &networks::SOFTMAX,
    &light::SOFTPLUS,
    &networks::DECODER,
    &networks::WINDOW,
    &tokens::TOKENS,
    &tokens::FUSE,
    &tokens::UNPATCH,
    &transformer::GELU,
    &transformer::LAYERNORM,
    &transformer::WEIGHT_NORM,
    &transformer::ATTENTION,
    &transformer::BLOCK,
    &loss::L1,
    &loss::MSE,
    &loss::SSIM,
    &points::POINTS,
    &groups::GROUPS,
    &lpips::LPIPS,
    &latent::LATENT,
    &prior::PRIOR,
    &prior::PRESENCE,
    &surface::EIKONAL,
    &surface::ALBEDO,
    &light::VARIATION,
    &shade::GGX,
    &shade::ENVMAP,
    &moment::DIFFUSE,
    &moment::GAIN,
    &moment::OVER_BLACK,
    &light::ENCODE,
    &light::DECODE,
    &field::FETCH,
    &field::SDF_HEAD,
    &field::VALUE_HEAD,
    &field::NORMAL_HEAD,
    &field::EMBED,
    &field::DENSITY,
    &field::INTERVAL,
    &field::NORMAL,
    &field::COMPOSITE,
    &field::RENDER,
    &causal::ACYCLIC,
    &causal::MASK,
    &causal::PROBABILITY,
    &causal::EDGES,
    &causal::STRUCTURE,
    &causal::POSTERIOR_KL,
    &causal::POSTERIOR,
    &causal::SCM_KL,
    &causal::INTERVENE,
    &causal::INDEPENDENCE,
    &causal::LIMIT,
    &causal::CODE,
    &causal::HELD,
    &skin::SKIN,
    &rest::REST,
    &pose::POSE,
    &optim::ADAM,
    &optim::ADAMW,
    &optim::MUON,
];

/// The operator of that name.
///
/// # Errors
/// When there is no such operator; the error suggests similar names, or lists all.
pub fn find(name: &str) -> Result<&'static Op> {
    LIST.iter().copied().find(|op| op.name == name).ok_or_else(|| {
        let names = || LIST.iter().map(|op| op.name);
        let e = Error::input("operator").got(format!("'{name}'"));
        match similar(name, names()).as_slice() {
            [] => e.expected(format!("one of {}", names().collect::<Vec<_>>().join(", "))),
            close => {
                e.expected("the name of an operator").hint(format!("did you mean {}?", close.join(" or ")))
            }
        }
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
