//! The list of twins, one line per operator.

use super::{Call, Stage, Twin};
use crate::body::{pose, rest, skin};
use crate::causal::{
    acyclic, code, edges, held, independence, intervene, limit, mask, posterior, posterior_kl, probability,
    scm_kl, structure,
};
use crate::field::{
    composite, density, embed, fetch, interval, normal, normal_head, render as field_render, sdf_head,
    value_head,
};
use crate::geometry::trace;
use crate::loss::{
    albedo, eikonal, groups, l1, latent, lpips, mse, points, presence, prior, ssim, variation,
};
use crate::nn::{
    act, attention, block, conv, decoder, fuse, gelu, layernorm, linear, mlp, softmax, softplus, tokens,
    unpatch, weight_norm, window,
};
use crate::optim::{adam, adamw, muon};
use crate::shade::{decode, diffuse, encode, envmap, gain, ggx, over_black};
use crate::splat::{activate, blend, color, covariance, project, render};

/// Declares one stage for all scalar types: `stage!(module::run)`.
macro_rules! stage {
    ($($run:ident)::+) => {
        Stage { value: $($run)::+::<f64>, smooth: Some(($($run)::+, $($run)::+)) }
    };
}

/// Declares an operator of one stage, the function `run` of its module; the function `work`, if named, counts
/// its work.
macro_rules! twin {
    ($module:ident) => {
        twin!($module, entries)
    };
    ($module:ident, $work:expr) => {
        Twin { signature: &$module::SIGNATURE, stages: &[stage!($module::run)], work: $work }
    };
}

/// Declares an operator of one stage without a gradient.
macro_rules! twin_without_gradient {
    ($module:ident, $work:expr) => {
        Twin {
            signature: &$module::SIGNATURE,
            stages: &[Stage { value: $module::run, smooth: None }],
            work: $work,
        }
    };
}

/// Entries of the inputs.
fn entries(call: &Call<'_, f64>) -> Result<u64, String> {
    Ok(call.arrays.values().fold(0, |n, x| n + x.data.len() as u64))
}

/// All operators.
pub static LIST: &[Twin] = &[
    twin!(activate),
    twin!(covariance),
    twin!(project),
    twin!(color),
    twin!(blend, blend::work),
    Twin {
        signature: &render::SIGNATURE,
        stages: &[stage!(render::run_project_and_color), stage!(render::run_blend)],
        work: render::work,
    },
    twin_without_gradient!(trace, trace::work),
    twin!(linear, linear::work),
    twin!(act),
    twin!(conv, conv::work),
    twin!(mlp, mlp::work),
    twin!(softmax),
    twin!(softplus),
    twin!(decoder, decoder::work),
    twin!(window, window::work),
    twin!(tokens, tokens::work),
    twin!(fuse, fuse::work),
    twin!(unpatch, unpatch::work),
    twin!(gelu),
    twin!(layernorm),
    twin!(weight_norm),
    twin!(attention, attention::work),
    twin!(block, block::work),
    twin!(l1),
    twin!(mse),
    twin!(ssim, ssim::work),
    twin!(points, points::work),
    twin!(groups),
    twin!(latent),
    twin!(prior),
    twin!(presence),
    twin!(eikonal),
    twin!(albedo),
    twin!(variation),
    Twin { signature: &lpips::SIGNATURE, stages: &[stage!(lpips::run); lpips::STAGES], work: lpips::work },
    twin!(ggx),
    twin!(envmap, envmap::work),
    twin!(diffuse),
    twin!(gain),
    twin!(over_black),
    twin!(encode),
    twin!(decode),
    twin!(fetch, fetch::work),
    twin!(sdf_head, sdf_head::work),
    twin!(value_head, value_head::work),
    twin!(normal_head, normal_head::work),
    twin!(embed),
    twin!(density),
    twin!(interval),
    twin!(normal),
    twin!(composite),
    twin!(field_render, field_render::work),
    twin!(acyclic),
    twin!(mask),
    twin!(probability),
    twin!(edges),
    twin!(structure),
    twin!(posterior_kl),
    twin!(posterior),
    twin!(scm_kl),
    twin!(intervene),
    twin!(independence),
    twin!(limit),
    twin!(code),
    twin!(held),
    twin!(skin),
    twin!(rest),
    twin!(pose),
    twin_without_gradient!(adam, entries),
    twin_without_gradient!(adamw, entries),
    twin_without_gradient!(muon, entries),
];
