//! Cases of the operators that the fit of a person and the image-to-point model run.

use reference::array::{Arr, Named};

use super::case::{Case, case};
use crate::scenes::{named, normal, uniform};

/// Two items at four coordinates.
fn decoder() -> Named<f64> {
    named([
        ("codes", normal(&[2, 4, 3], 200)),
        ("z", normal(&[2, 2], 201)),
        ("point", normal(&[5, 3], 202)),
        ("latent", normal(&[5, 2], 203)),
        ("bias0", normal(&[5], 204)),
        ("weight1", normal(&[4, 5], 205)),
        ("bias1", normal(&[4], 206)),
        ("weight2", normal(&[3, 4], 207)),
        ("bias2", normal(&[3], 208)),
        ("weight3", normal(&[2, 3], 209)),
        ("bias3", normal(&[2], 210)),
        ("base", normal(&[2, 4, 2], 211)),
        ("scale", uniform(&[2], [0.5, 2.0], 212)),
    ])
}

/// A unit matrix with noise, three rows of four per transform.
fn near_unit(count: usize, purpose: u16) -> Arr<f64> {
    let mut all = normal(&[count, 3, 4], purpose);
    for (i, x) in all.data.iter_mut().enumerate() {
        *x = 0.2 * *x + if [0, 5, 10].contains(&(i % 12)) { 1.0 } else { 0.0 };
    }
    all
}

fn image(with_gain: bool) -> Named<f64> {
    let mut all = named([
        ("image", uniform(&[3, 4, 3], [0.0, 1.0], 220)),
        ("alpha", uniform(&[3, 4], [0.0, 1.0], 221)),
        ("background", uniform(&[3], [0.1, 0.9], 222)),
    ]);
    if with_gain {
        all.extend(named([("gain", normal(&[3], 223))]));
    }
    all
}

fn gaussians() -> Named<f64> {
    let near = (0..30).map(|at| if at % 11 == 5 { -1.0 } else { ((at / 6 + 1 + at % 4) % 5) as f64 });
    named([
        ("means", normal(&[5, 3], 230)),
        ("scales_log", normal(&[5, 3], 231)),
        ("opacity_logits", normal(&[5], 232)),
        ("sh", normal(&[5, 1, 3], 233)),
        ("near", Arr::new(&[5, 6], near.collect())),
        ("gap", normal(&[5], 234)),
        ("anchors", normal(&[5, 3], 235)),
    ])
}

fn targets(of: &[f64]) -> Arr<f64> {
    Arr::new(&[of.len()], of.to_vec())
}

pub(super) fn cases() -> Vec<Case> {
    let widths = Arr::new(&[4], vec![3.0, 5.0, 4.0, 2.0]);
    let mlp = named([
        ("x", normal(&[6, 3], 240)),
        ("widths", widths),
        ("weights", normal(&[5 * 3 + 4 * 8 + 2 * 4], 241)),
        ("biases", normal(&[11], 242)),
    ]);
    let shares = named([("x", normal(&[4, 5], 243)), ("base", uniform(&[4, 5], [0.0, 1.0], 244))]);
    let window = named([
        ("image", normal(&[5, 6, 3], 245)),
        ("corner", Arr::new(&[2], vec![-0.7, 0.4])),
        ("length", Arr::scalar(5.3)),
    ]);
    let rest = named([
        ("points", normal(&[6, 3], 246)),
        ("factors", normal(&[6, 3, 3], 247)),
        ("weights", uniform(&[6, 2], [0.2, 0.8], 248)),
        ("canonical", near_unit(2, 249)),
        ("offsets", normal(&[6, 3], 250)),
    ]);
    let captured = named([
        ("captured", near_unit(4, 251)),
        ("correction", normal(&[4, 3], 252)),
        ("joints", normal(&[4, 3], 253)),
        ("parents", targets(&[-1.0, 0.0, 1.0, 0.0])),
    ]);
    let shaded = named([
        ("sh", uniform(&[5, 3], [-1.0, 1.0], 254)),
        ("normals", uniform(&[5, 3], [-0.5, 0.5], 255)),
        ("toward", uniform(&[3], [-0.4, 0.4], 256)),
    ]);
    let prior = [
        ("color", "1.5"),
        ("opacity", "0.3"),
        ("scale", "0.7"),
        ("round", "0.5"),
        ("fill", "2"),
        ("reach", "1.2"),
        ("anchor", "3"),
        ("solid", "0.6"),
        ("radius", "0.8"),
    ];
    let latent = named([
        ("factors", normal(&[6], 260)),
        ("factors_real", normal(&[6], 261)),
        ("factors_spread", uniform(&[6], [0.3, 1.5], 262)),
        ("noise", normal(&[6], 263)),
        ("noise_real", normal(&[6], 264)),
        ("noise_spread", uniform(&[6], [0.3, 1.5], 265)),
    ]);
    let edges = named([
        ("probabilities", uniform(&[4, 4], [0.1, 0.9], 266)),
        ("before", uniform(&[4, 4], [0.1, 0.9], 267)),
    ]);
    let code = named([
        ("labels", normal(&[4], 268)),
        ("target", targets(&[2.0, 0.0, 1.0, 2.0])),
        ("values", normal(&[3, 2], 269)),
    ]);
    let shared = named([
        ("shared", normal(&[3, 2], 270)),
        ("target", targets(&[0.0, 2.0, 1.0])),
        ("members", Arr::scalar(2.0)),
    ]);
    let own = named([
        ("factors", normal(&[6, 3, 2], 271)),
        ("target", targets(&[0.0, 2.0, 1.0])),
        ("members", Arr::scalar(2.0)),
    ]);
    vec![
        case("mlp", "nn.mlp", mlp, &[("skip", "1")], &["x", "weights", "biases"], &["y"]),
        case("softmax", "nn.softmax", shares, &[("floor", "0.01")], &["x"], &["y"]),
        case(
            "decoder",
            "nn.decoder",
            decoder(),
            &[],
            &["z", "point", "latent", "bias0", "weight1", "bias1", "weight2", "bias2", "weight3", "bias3"],
            &["points"],
        ),
        case("window", "nn.window", window, &[("side", "3")], &["image"], &["window"]),
        case(
            "rest",
            "body.rest",
            rest,
            &[],
            &["points", "factors", "weights"],
            &["rest_points", "rest_factors"],
        ),
        case("pose captured", "body.pose", captured, &[], &["correction", "joints"], &["transforms"]),
        case("diffuse", "shade.diffuse", shaded, &[], &["sh", "toward"], &["colors"]),
        case("gain", "shade.gain", image(true), &[], &["image", "alpha", "gain"], &["lit"]),
        case("over black", "shade.over_black", image(false), &[], &["image", "alpha"], &["over_black"]),
        case(
            "prior",
            "loss.prior",
            gaussians(),
            &prior,
            &["means", "scales_log", "opacity_logits", "sh"],
            &["value"],
        ),
        case(
            "presence",
            "loss.presence",
            named([("opacity_logits", normal(&[7], 272)), ("scales_log", normal(&[7, 3], 273))]),
            &[],
            &["opacity_logits", "scales_log"],
            &["value"],
        ),
        case("latent", "loss.latent", latent, &[], &["factors", "noise"], &["value"]),
        case(
            "probability",
            "causal.probability",
            named([("logits", uniform(&[4, 4], [-0.5, 0.5], 274))]),
            &[],
            &["logits"],
            &["probabilities"],
        ),
        case("edges", "causal.edges", edges, &[("anchor", "0.7")], &["probabilities"], &["value"]),
        case(
            "limit",
            "causal.limit",
            named([("logvar", uniform(&[5, 4], [-12.0, 8.0], 275))]),
            &[],
            &["logvar"],
            &["limited"],
        ),
        case("code", "causal.code", code, &[], &["values"], &["codes"]),
        case("held", "causal.held", shared, &[], &["shared"], &["held"]),
        case("held own", "causal.held", own, &[], &["factors"], &["held"]),
    ]
}
