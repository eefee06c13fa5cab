//! Operators of either precision against golden arrays of other programs.

use super::{run_file, sorted};
use crate::common::golden;
use lastlight::num::array::Array;
use lastlight::ops::{self, Compare};
use lastlight::oracle::compare;
use lastlight::oracle::run::{self, Precision};

/// Bounds on the relative L2 of outputs (and intermediates) and of gradients, for f64 and for f32.
struct Bounds {
    f64: [f64; 2],
    f32: [f64; 2],
}

const SPLAT: Bounds = Bounds { f64: [1e-10, 1e-8], f32: [2e-6, 2e-5] };
const OTHER: Bounds = Bounds { f64: [1e-12, 1e-12], f32: [2e-6, 2e-6] };

/// Computed in f64 in runs of either precision; a run in f32 rounds what it reads and what it writes, each
/// once.
const CAUSAL: Bounds = Bounds { f64: [1e-12, 1e-10], f32: [6e-8, 6e-8] };
/// Thirteen convolutions in f32: an output near 0 may pass in one precision and not in the other.
const LPIPS: Bounds = Bounds { f64: [1e-12, 1e-10], f32: [2e-6, 2e-5] };
const SHADE: Bounds = Bounds { f64: [1e-12, 1e-10], f32: [2e-6, 2e-5] };
const FIELD: Bounds = Bounds { f64: [1e-12, 1e-10], f32: [2e-6, 2e-5] };

fn check_golden(name: &str, op: &str, profile: Option<&str>, bounds: &Bounds) {
    let Some(theirs) = golden(name) else { return };
    let op = ops::find(op).expect("on the list");
    let mut runs = vec![
        ("F64", run_file(op, &theirs, profile, Precision::F64), bounds.f64),
        ("F32", run_file(op, &theirs, profile, Precision::F32), bounds.f32),
    ];
    if op.width == ops::Width::F64 {
        // the shipped operator by itself, from inputs in f64
        let call = sorted(op, &theirs, profile);
        let checked = ops::CheckedCall::new(op, &call, false).unwrap_or_else(|e| panic!("{e}"));
        runs.push((
            "shipped",
            run::gather(&(op.run)(&checked).unwrap_or_else(|e| panic!("{e}"))),
            bounds.f64,
        ));
    }
    for (precision, ours, [values, gradients]) in runs {
        let single = |a: &Array| matches!(a, Array::F32(_));
        if precision == "F32" {
            let wide: Vec<_> = ours.0.iter().filter(|(_, a)| a.is_float() && !single(a)).collect();
            assert!(wide.is_empty(), "{name}: f32 runs give f32 arrays, not {wide:?}");
        }
        let report = compare::arrays(&theirs, &ours, Some(op.name), f64::INFINITY).expect("names in common");
        let mut compared = 0;
        for a in &report.arrays {
            let bound = if a.name.ends_with("_bar") { gradients } else { values };
            println!(
                "{name} {precision} {:<14} relative L2 {:.2e} (at most {bound:.0e}), worst {} ulp",
                a.name,
                a.relative_l2(),
                a.measures.as_ref().map_or(0, |m| m.worst_ulp)
            );
            assert_eq!(
                a.agreement,
                compare::Agreement::Matches,
                "{name} {precision} {}: {:?}",
                a.name,
                a.worst
            );
            // an array compared in its zeros only has no relative L2 to speak of
            let pattern = op.port(&a.name).is_some_and(|p| p.compare == Compare::ZeroPattern);
            assert!(
                pattern || a.relative_l2() <= bound,
                "{name} {precision} {}: {:.3e} > {bound:e}",
                a.name,
                a.relative_l2()
            );
            compared += 1;
        }
        // everything the file has that is not an input, a setting or a cotangent was compared
        let is_result = |n: &str| {
            let is = |ports: &[ops::Port], n: &str| ports.iter().any(|p| p.name == n);
            let bar = n.strip_suffix("_bar");
            if bar.is_some_and(|y| is(op.outputs, y)) {
                return false; // a cotangent
            }
            is(op.outputs, n)
                || is(op.intermediates, n)
                || bar.is_some_and(|x| op.inputs.iter().any(|p| p.name == x && p.differentiable))
        };
        assert_eq!(
            compared,
            theirs.0.keys().filter(|n| is_result(n)).count(),
            "{name}: arrays of {:?}",
            theirs.0.keys()
        );
    }
}

#[test]
fn golden_splat_random() {
    check_golden("splat_random", "splat.render", Some("gsplat"), &SPLAT);
}

#[test]
fn golden_splat_hard() {
    check_golden("splat_hard", "splat.render", Some("gsplat"), &SPLAT);
}

#[test]
fn golden_splat_garden() {
    check_golden("splat_garden", "splat.render", Some("gsplat"), &SPLAT);
}

#[test]
fn golden_nn_linear() {
    check_golden("nn_linear", "nn.linear", None, &OTHER);
}

#[test]
fn golden_nn_leaky_relu() {
    check_golden("nn_leaky_relu", "nn.leaky_relu", None, &OTHER);
}

#[test]
fn golden_nn_conv() {
    check_golden("nn_conv", "nn.conv", None, &OTHER);
}

#[test]
fn golden_loss_ssim() {
    check_golden("loss_ssim", "loss.ssim", None, &OTHER);
}

#[test]
fn golden_causal_acyclic() {
    check_golden("causal_acyclic", "causal.acyclic", None, &CAUSAL);
}

#[test]
fn golden_causal_structure() {
    check_golden("causal_structure", "causal.structure", None, &CAUSAL);
}

#[test]
fn golden_causal_posterior_kl() {
    check_golden("causal_posterior_kl", "causal.posterior_kl", None, &CAUSAL);
}

#[test]
fn golden_causal_independence() {
    check_golden("causal_independence", "causal.independence", None, &CAUSAL);
}

#[test]
fn golden_loss_lpips() {
    check_golden("loss_lpips", "loss.lpips", None, &LPIPS);
}

#[test]
fn golden_optim_adamw() {
    check_golden("optim_adamw", "optim.adamw", None, &OTHER);
}

#[test]
fn golden_shade_ggx() {
    check_golden("shade_ggx", "shade.ggx", None, &SHADE);
}

#[test]
fn golden_shade_envmap() {
    check_golden("shade_envmap", "shade.envmap", None, &SHADE);
}

#[test]
fn golden_field_fetch() {
    check_golden("field_fetch", "field.fetch", None, &FIELD);
}

#[test]
fn golden_field_sdf_head() {
    check_golden("field_sdf_head", "field.sdf_head", None, &FIELD);
}

#[test]
fn golden_field_density() {
    check_golden("field_density", "field.density", None, &FIELD);
}

#[test]
fn golden_field_composite() {
    check_golden("field_composite", "field.composite", None, &FIELD);
}

#[test]
fn golden_field_embed() {
    check_golden("field_embed", "field.embed", None, &FIELD);
}

#[test]
fn golden_layers_of_transformers() {
    let layers =
        ["gelu", "softmax", "layernorm", "weight_norm", "attention", "block", "tokens", "fuse", "unpatch"];
    for name in layers {
        check_golden(&format!("nn_{name}"), &format!("nn.{name}"), None, &FIELD);
    }
}
