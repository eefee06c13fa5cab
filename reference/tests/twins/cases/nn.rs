//! Cases of layers.

use reference::array::Arr;

use super::case::{Case, case};
use crate::scenes::{named, normal};

pub(super) fn cases() -> Vec<Case> {
    let layer =
        named([("x", normal(&[5, 7], 20)), ("weight", normal(&[4, 7], 21)), ("bias", normal(&[4], 22))]);
    vec![
        case("linear", "nn.linear", layer, &[], &["x", "weight", "bias"], &["y"]),
        case(
            "conv",
            "nn.conv",
            named([
                ("x", normal(&[2, 6, 7, 2], 24)),
                ("weight", normal(&[3, 4, 3, 2], 25)),
                ("bias", normal(&[3], 26)),
            ]),
            &[("stride", "2"), ("pad", "1")],
            &["x", "weight", "bias"],
            &["y"],
        ),
        case(
            "leaky relu",
            "nn.leaky_relu",
            named([("x", apart(&[6, 5], 23))]),
            &[("slope", "0.2")],
            &["x"],
            &["y"],
        ),
        case(
            "softplus",
            "nn.softplus",
            named([("x", normal(&[6, 5], 27).map(|&x| 4.0 * x))]),
            &[],
            &["x"],
            &["y"],
        ),
        case(
            "tokens",
            "nn.tokens",
            named([
                ("image", normal(&[2, 2, 4, 3], 39)),
                ("rays", normal(&[2, 2, 4, 6], 40)),
                ("photo", normal(&[2, 2, 4, 3], 41)),
                ("w_image", normal(&[5, 2, 2, 3], 42)),
                ("w_rays", normal(&[5, 2, 2, 6], 43)),
                ("w_photo", normal(&[5, 2, 2, 3], 44)),
                ("bias", normal(&[5], 45)),
                ("norm_gain", normal(&[5], 46)),
                ("norm_bias", normal(&[5], 47)),
            ]),
            &[("eps", "0.01")],
            &["image", "rays", "photo", "w_image", "w_rays", "w_photo", "bias", "norm_gain", "norm_bias"],
            &["tokens"],
        ),
        case(
            "fuse",
            "nn.fuse",
            named([
                ("state", normal(&[4, 3], 48)),
                ("position", normal(&[4, 3], 49)),
                ("w1", normal(&[5, 6], 50)),
                ("b1", normal(&[5], 51)),
                ("w2", normal(&[3, 5], 52)),
                ("b2", normal(&[3], 53)),
            ]),
            &[("fuse", "residual")],
            &["state", "position", "w1", "b1", "w2", "b2"],
            &["tokens"],
        ),
        case(
            "unpatch",
            "nn.unpatch",
            named([
                ("tokens", normal(&[2, 1, 2, 3], 54)),
                ("weight", normal(&[3, 2, 2, 4], 55)),
                ("bias", normal(&[4], 56)),
            ]),
            &[],
            &["tokens", "weight", "bias"],
            &["y"],
        ),
        case("gelu", "nn.gelu", named([("x", normal(&[6, 5], 28).map(|&x| 2.0 * x))]), &[], &["x"], &["y"]),
        case(
            "layernorm",
            "nn.layernorm",
            named([("x", normal(&[4, 7], 29)), ("gain", normal(&[7], 30)), ("bias", normal(&[7], 31))]),
            &[("eps", "0.01")],
            &["x", "gain", "bias"],
            &["y"],
        ),
        case(
            "weight norm",
            "nn.weight_norm",
            named([("v", normal(&[3, 5], 32)), ("g", normal(&[3], 33))]),
            &[],
            &["v", "g"],
            &["weight"],
        ),
        case(
            "attention",
            "nn.attention",
            named([
                ("x", normal(&[5, 6], 34)),
                ("w_qkv", normal(&[18, 6], 35)),
                ("b_qkv", normal(&[18], 36)),
                ("w_out", normal(&[6, 6], 37)),
                ("b_out", normal(&[6], 38)),
            ]),
            &[("heads", "2")],
            &["x", "w_qkv", "b_qkv", "w_out", "b_out"],
            &["y"],
        ),
        case(
            "block",
            "nn.block",
            named([
                ("x", normal(&[4, 6], 39)),
                ("ln1_gain", normal(&[6], 40)),
                ("ln1_bias", normal(&[6], 41)),
                ("w_qkv", normal(&[18, 6], 42)),
                ("b_qkv", normal(&[18], 43)),
                ("w_out", normal(&[6, 6], 44)),
                ("b_out", normal(&[6], 45)),
                ("ln2_gain", normal(&[6], 46)),
                ("ln2_bias", normal(&[6], 47)),
                ("w_fc1", normal(&[7, 6], 48)),
                ("b_fc1", normal(&[7], 49)),
                ("w_fc2", normal(&[6, 7], 50)),
                ("b_fc2", normal(&[6], 51)),
            ]),
            &[("heads", "2"), ("eps", "0.01")],
            &[
                "x", "ln1_gain", "ln1_bias", "w_qkv", "b_qkv", "w_out", "b_out", "ln2_gain", "ln2_bias",
                "w_fc1", "b_fc1", "w_fc2", "b_fc2",
            ],
            &["y"],
        ),
    ]
}

/// Normal numbers moved 0.05 away from 0.
fn apart(shape: &[usize], purpose: u16) -> Arr<f64> {
    normal(shape, purpose).map(|&x| if x > 0.0 { x + 0.05 } else { x - 0.05 })
}
