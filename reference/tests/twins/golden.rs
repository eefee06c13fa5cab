//! Values and gradients against arrays made by other programs.

use std::collections::BTreeMap;

use reference::array::{Arr, Named};
use reference::twins::{self, Request, Setting};

use crate::npz::{golden, relative};

fn settings(of: &[(&str, &str)]) -> BTreeMap<String, Setting> {
    of.iter().map(|(name, text)| ((*name).to_owned(), Setting::Text((*text).to_owned()))).collect()
}

/// Runs a golden file; returns the answer.
fn check(
    file: &str,
    op: &str,
    inputs: &[&str],
    mut chosen: BTreeMap<String, Setting>,
    [values, gradients]: [f64; 2],
) -> Option<(Named<f64>, twins::Results)> {
    let arrays = golden(file)?;
    for (name, x) in &arrays {
        if let Some(setting) = name.strip_prefix("setting_") {
            chosen.insert(setting.to_owned(), Setting::Number(x.data[0]));
        }
    }
    let chosen_inputs: Named<f64> =
        inputs.iter().map(|&name| (name.to_owned(), arrays[name].clone())).collect();
    let request = Request { op, inputs: &chosen_inputs, settings: &chosen, plan: None };
    let answer = twins::value(&request).expect("a golden file is a good request");
    for (name, ours) in &answer.outputs {
        let error = relative(&ours.data, &arrays[name].data);
        eprintln!("{file} {name}: {error:.1e}");
        assert!(error <= values, "{file} {name}: relative L2 {error:e}");
    }
    let bars: Named<f64> = answer
        .outputs
        .keys()
        .filter_map(|name| Some((name.clone(), arrays.get(&format!("{name}_bar"))?.clone())))
        .collect();
    if !bars.is_empty() {
        let (again, gradient) = twins::vjp(&request, &bars).expect("a gradient");
        assert_eq!(again, answer, "the gradient's forward is the forward");
        let mut compared = 0;
        for (name, theirs) in arrays.iter().filter_map(|(name, x)| Some((name.strip_suffix("_bar")?, x))) {
            let Some(ours) = gradient.get(name) else { continue };
            let error = relative(&ours.data, &theirs.data);
            eprintln!("{file} {name}_bar: {error:.1e}");
            assert!(error <= gradients, "{file} {name}_bar: relative L2 {error:e}");
            compared += 1;
        }
        assert!(compared > 0, "{file}: no gradient was compared");
    }
    Some((arrays, answer))
}

fn splat(file: &str) {
    let inputs = [
        "means",
        "quats",
        "scales",
        "opacities",
        "sh",
        "sh_degree",
        "view_from_world",
        "intrinsics",
        "width",
        "height",
        "near",
        "background",
    ];
    let gsplat = settings(&[("profile", "gsplat")]);
    let Some((arrays, answer)) = check(file, "splat.render", &inputs, gsplat, [1e-10, 1e-8]) else { return };
    let seen = |row: usize| arrays["radii_px"].data[2 * row] > 0.0;
    for name in ["means_px", "conics", "depths_z", "colors"] {
        let theirs = &arrays[name];
        let width = theirs.shape.get(2).copied().unwrap_or(1);
        let rows = |x: &Arr<f64>| -> Vec<f64> {
            (0..x.data.len()).filter(|i| seen(i / width)).map(|i| x.data[i]).collect()
        };
        let error = relative(&rows(&answer.intermediates[name]), &rows(theirs));
        eprintln!("{file} {name}: {error:.1e}");
        assert!(error <= 1e-10, "{file} {name}: relative L2 {error:e}");
    }
    assert_eq!(answer.intermediates["counts"], arrays["counts"], "{file} counts");
    let zero = |x: &Arr<f64>| x.map(|&r| r == 0.0);
    assert!(
        zero(&answer.intermediates["radii_px"]) == zero(&arrays["radii_px"]),
        "{file}: zero pattern of radii_px"
    );
}

#[test]
fn splat_random_is_reproduced() {
    splat("splat_random");
}

#[test]
fn splat_hard_is_reproduced() {
    splat("splat_hard");
}

#[test]
fn splat_garden_is_reproduced() {
    splat("splat_garden");
}

#[test]
fn nn_linear_is_reproduced() {
    check("nn_linear", "nn.linear", &["x", "weight", "bias"], BTreeMap::new(), [1e-12, 1e-10]);
}

#[test]
fn nn_leaky_relu_is_reproduced() {
    check("nn_leaky_relu", "nn.leaky_relu", &["x"], BTreeMap::new(), [1e-12, 1e-10]);
}

#[test]
fn nn_conv_is_reproduced() {
    check("nn_conv", "nn.conv", &["x", "weight", "bias"], BTreeMap::new(), [1e-12, 1e-10]);
}

#[test]
fn layers_of_transformers_are_reproduced() {
    let reproduced = |file: &str, op: &str, inputs: &[&str]| {
        check(file, op, inputs, BTreeMap::new(), [1e-12, 1e-10]);
    };
    reproduced("nn_gelu", "nn.gelu", &["x"]);
    reproduced("nn_layernorm", "nn.layernorm", &["x", "gain", "bias"]);
    reproduced("nn_weight_norm", "nn.weight_norm", &["v", "g"]);
    reproduced("nn_softmax", "nn.softmax", &["x", "base"]);
    let of_tokens =
        ["image", "rays", "photo", "w_image", "w_rays", "w_photo", "bias", "norm_gain", "norm_bias"];
    reproduced("nn_tokens", "nn.tokens", &of_tokens);
    reproduced("nn_fuse", "nn.fuse", &["state", "position", "w1", "b1", "w2", "b2"]);
    reproduced("nn_unpatch", "nn.unpatch", &["tokens", "weight", "bias"]);
    reproduced("nn_attention", "nn.attention", &["x", "w_qkv", "b_qkv", "w_out", "b_out"]);
    let of_block = [
        "x", "ln1_gain", "ln1_bias", "w_qkv", "b_qkv", "w_out", "b_out", "ln2_gain", "ln2_bias", "w_fc1",
        "b_fc1", "w_fc2", "b_fc2",
    ];
    reproduced("nn_block", "nn.block", &of_block);
}

#[test]
fn causal_acyclic_is_reproduced() {
    check("causal_acyclic", "causal.acyclic", &["a", "alpha"], BTreeMap::new(), [1e-12, 1e-10]);
}

#[test]
fn causal_structure_is_reproduced() {
    let inputs = ["eps", "mask", "w0", "b0", "w1", "b1", "w2", "b2"];
    check("causal_structure", "causal.structure", &inputs, BTreeMap::new(), [1e-12, 1e-10]);
}

#[test]
fn causal_posterior_kl_is_reproduced() {
    check("causal_posterior_kl", "causal.posterior_kl", &["mu", "logvar"], BTreeMap::new(), [1e-12, 1e-10]);
}

#[test]
fn causal_independence_is_reproduced() {
    check("causal_independence", "causal.independence", &["mu", "logvar"], BTreeMap::new(), [1e-12, 1e-10]);
}

#[test]
fn loss_ssim_is_reproduced() {
    check("loss_ssim", "loss.ssim", &["x", "y"], BTreeMap::new(), [1e-12, 1e-10]);
}

#[test]
fn optim_adamw_is_reproduced() {
    check("optim_adamw", "optim.adamw", &["param", "grads"], BTreeMap::new(), [1e-12, 0.0]);
}

#[test]
fn field_fetch_is_reproduced() {
    check("field_fetch", "field.fetch", &["points", "planes"], BTreeMap::new(), [1e-12, 1e-10]);
}

#[test]
fn field_sdf_head_is_reproduced() {
    check(
        "field_sdf_head",
        "field.sdf_head",
        &["features", "points", "w0", "w1", "w2"],
        BTreeMap::new(),
        [1e-12, 1e-10],
    );
}

#[test]
fn field_density_is_reproduced() {
    check("field_density", "field.density", &["sdf", "beta"], BTreeMap::new(), [1e-12, 1e-10]);
}

#[test]
fn field_composite_is_reproduced() {
    check(
        "field_composite",
        "field.composite",
        &["sigma", "delta", "values", "background"],
        BTreeMap::new(),
        [1e-12, 1e-10],
    );
}

#[test]
fn field_embed_is_reproduced() {
    let inputs = ["normal", "ray_direction", "rho", "panoramas"];
    check("field_embed", "field.embed", &inputs, BTreeMap::new(), [1e-12, 1e-10]);
}
