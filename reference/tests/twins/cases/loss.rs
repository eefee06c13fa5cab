//! Cases of losses.

use reference::array::{Arr, Named};

use super::case::{Case, case};
use crate::scenes::{named, normal, uniform};

pub(super) fn cases() -> Vec<Case> {
    let xy: &[&str] = &["x", "y"];
    vec![
        case(
            "groups",
            "loss.groups",
            named([
                ("after", normal(&[5, 3, 3, 2], 50)),
                ("eps", normal(&[5, 3, 3, 2], 51)),
                ("eps_after", normal(&[5, 3, 3, 2], 52)),
                ("target", Arr::new(&[5], vec![0.0, 2.0, 0.0, 1.0, 2.0])),
                ("variance", uniform(&[3], [0.5, 1.5], 53)),
            ]),
            &[],
            &["after", "eps", "eps_after"],
            &["equal", "invariant", "spread", "shared"],
        ),
        case(
            "groups given",
            "loss.groups",
            named([
                ("after", normal(&[5, 3, 3, 2], 50)),
                ("eps", normal(&[5, 3, 3, 2], 51)),
                ("eps_after", normal(&[5, 3, 3, 2], 52)),
                ("target", Arr::new(&[5], vec![0.0, 2.0, 0.0, 1.0, 2.0])),
                ("variance", uniform(&[3], [0.5, 1.5], 53)),
                ("given", uniform(&[5, 2], [-0.4, 0.4], 58)),
            ]),
            &[],
            &["after", "eps", "eps_after", "given"],
            &["equal", "invariant", "spread", "shared"],
        ),
        case(
            "points",
            "loss.points",
            named([("x", normal(&[2, 7, 6], 27)), ("y", normal(&[2, 7, 6], 28))]),
            &[],
            xy,
            &["value"],
        ),
        case(
            "points chamfer",
            "loss.points",
            named([("x", normal(&[2, 7, 6], 27)), ("y", normal(&[2, 9, 6], 29))]),
            &[("mode", "chamfer")],
            xy,
            &["value"],
        ),
        case("lpips", "loss.lpips", slim(), &[], xy, &["value"]).within(1e-11),
        case("l1", "loss.l1", images(), &[], xy, &["value"]),
        case("mse", "loss.mse", images(), &[], xy, &["value"]),
        case("mse over all", "loss.mse", images(), &[("over", "all")], xy, &["value"]),
        case(
            "eikonal",
            "loss.eikonal",
            named([("gradient", normal(&[9, 3], 89))]),
            &[],
            &["gradient"],
            &["value"],
        ),
        case(
            "variation",
            "loss.variation",
            named([("planes", normal(&[2, 4, 5, 3], 93))]),
            &[],
            &["planes"],
            &["value"],
        ),
        case(
            "variation of a map",
            "loss.variation",
            named([("planes", normal(&[1, 3, 6, 3], 94))]),
            &[("columns", "periodic")],
            &["planes"],
            &["value"],
        ),
        case(
            "albedo",
            "loss.albedo",
            named([
                ("prediction", uniform(&[4, 2, 3], [0.2, 0.6], 90)),
                ("truth", uniform(&[4, 2, 3], [0.1, 0.9], 91)),
                ("opacity", uniform(&[4, 2], [0.7, 0.95], 92)),
                ("scale", Arr::scalar(1.25)),
            ]),
            &[],
            &["prediction", "opacity"],
            &["value", "adjusted"],
        ),
        case("ssim", "loss.ssim", images(), &[], xy, &["value"]),
    ]
}

fn images() -> Named<f64> {
    let mask = uniform(&[9, 13], [0.0, 1.0], 12).map(|&x| if x < 0.7 { 1.0 } else { 0.0 });
    named([
        ("x", uniform(&[9, 13, 3], [0.0, 1.0], 10)),
        ("y", uniform(&[9, 13, 3], [0.0, 1.0], 11)),
        ("mask", mask),
    ])
}

/// Two images under the network of `loss.lpips` with few channels.
fn slim() -> Named<f64> {
    let places = [0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28];
    let channels = [3, 4, 4, 5, 5, 4, 6, 5, 5, 6, 5, 5, 6];
    let mut all =
        named([("x", uniform(&[16, 17, 3], [0.0, 1.0], 50)), ("y", uniform(&[16, 17, 3], [0.0, 1.0], 51))]);
    let mut inputs = 3;
    for (k, (place, outputs)) in places.into_iter().zip(channels).enumerate() {
        let bound = (6.0 / (9.0 * inputs as f64)).sqrt();
        let purpose = 52 + 2 * k as u16;
        let weight = uniform(&[outputs, inputs, 3, 3], [-bound, bound], purpose);
        all.insert(format!("features.{place}.weight"), weight);
        all.insert(format!("features.{place}.bias"), uniform(&[outputs], [0.0, 0.3], purpose + 1));
        inputs = outputs;
    }
    for (j, tap) in [1, 3, 6, 9, 12].into_iter().enumerate() {
        let head = uniform(&[1, channels[tap], 1, 1], [0.1, 1.0], 80 + j as u16);
        all.insert(format!("lin{j}.model.1.weight"), head);
    }
    all
}
