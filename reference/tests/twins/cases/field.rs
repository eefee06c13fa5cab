//! Cases of fields.

use reference::array::Arr;

use super::case::{Case, case};
use crate::scenes::{named, normal, uniform};

pub(super) fn cases() -> Vec<Case> {
    vec![
        fetch("fetch", 6, "concat"),
        fetch("fetch sum", 3, "sum"),
        head("sdf head", "field.sdf_head", &[5, 4, 4, 1]),
        head("value head", "field.value_head", &[5, 4, 4, 3, 2]),
        head("normal head", "field.normal_head", &[5, 4, 4, 3, 3]),
        embed(),
        density(),
        interval(),
        stencil("forward", 4),
        stencil("central", 6),
        composite(),
    ]
}

/// Normal numbers scaled, moved by `by` away from 0.
fn apart(shape: &[usize], scale: f64, by: f64, purpose: u16) -> Arr<f64> {
    normal(shape, purpose).map(|&x| scale * if x > 0.0 { x + by } else { x - by })
}

/// Points away from the borders of the cells of planes with five texels per side: a place from 0.2 to 0.8 in
/// cells 0 to 3.
fn fetch(name: &'static str, planes: usize, combine: &'static str) -> Case {
    let place = uniform(&[7, 3], [0.2, 0.8], 70);
    let mut cell = 0;
    let points = place.map(|f| {
        cell = (cell + 3) % 4;
        0.5 * ((f64::from(cell) + f) / 2.0 - 1.0)
    });
    let inputs = named([("points", points), ("planes", normal(&[planes, 5, 5, 2], 71))]);
    let settings: &[(&str, &str)] = match combine {
        "sum" => &[("half_size", "0.5"), ("combine", "sum")],
        _ => &[("half_size", "0.5")],
    };
    case(name, "field.fetch", inputs, settings, &["points", "planes"], &["features"])
}

/// Weights of one sign per unit, so that no unit is near its kink.
fn head(name: &'static str, op: &'static str, widths: &[usize]) -> Case {
    let mut inputs = named([("features", uniform(&[6, widths[0]], [0.1, 1.0], 72))]);
    for (l, size) in widths.windows(2).enumerate() {
        let mut at = 0;
        let weight = uniform(&[size[1], size[0]], [0.2, 0.6], 74 + l as u16).map(|&w| {
            at += 1;
            if (at - 1) / size[0] % 3 == 1 { -w } else { w }
        });
        inputs.insert(format!("w{l}"), weight);
    }
    let (smooth, output): (&'static [&'static str], &'static [&'static str]) = match op {
        "field.sdf_head" => (&["features", "points", "w0", "w1", "w2"], &["sdf"]),
        "field.normal_head" => (&["features", "points", "w0", "w1", "w2", "w3"], &["normal"]),
        _ => (&["features", "w0", "w1", "w2", "w3"], &["value"]),
    };
    if smooth.contains(&"points") {
        inputs.insert("points".to_owned(), normal(&[6, 3], 73));
    }
    case(name, op, inputs, &[], smooth, output)
}

/// Three panoramas; levels from 0.2 to 0.8 of an interval.
fn embed() -> Case {
    let mut at = 0.0;
    let inputs = named([
        ("normal", normal(&[6, 3], 84)),
        ("ray_direction", normal(&[6, 3], 85)),
        (
            "rho",
            uniform(&[6], [0.2, 0.8], 86).map(|f| {
                at = 1.0 - at;
                (f + at) / 2.0
            }),
        ),
        ("panoramas", normal(&[3, 4, 5, 2], 87)),
    ]);
    case("embed", "field.embed", inputs, &[], &["rho", "panoramas"], &["h"])
}

fn stencil(mode: &'static str, width: usize) -> Case {
    let inputs = named([("sdf", normal(&[5, width], 88))]);
    let settings = [("epsilon", "0.5"), ("mode", mode)];
    case(mode, "field.normal", inputs, &settings, &["sdf"], &["gradient", "normal"])
}

fn density() -> Case {
    let inputs = named([("sdf", apart(&[15], 0.2, 0.2, 77)), ("beta", Arr::scalar(0.25))]);
    case("density", "field.density", inputs, &[], &["sdf", "beta"], &["sigma"])
}

fn interval() -> Case {
    let inputs = named([
        ("sdf0", apart(&[31], 0.2, 0.2, 78)),
        ("sdf1", apart(&[31], 0.2, 0.2, 79)),
        ("beta", Arr::scalar(0.25)),
    ]);
    case("interval", "field.interval", inputs, &[], &["sdf0", "sdf1", "beta"], &["sigma"])
}

fn composite() -> Case {
    let inputs = named([
        ("sigma", uniform(&[4, 6], [0.1, 5.0], 80)),
        ("delta", uniform(&[4, 6], [0.05, 0.3], 81)),
        ("values", normal(&[4, 6, 3], 82)),
        ("background", normal(&[3], 83)),
    ]);
    let smooth = &["sigma", "delta", "values", "background"];
    case("composite", "field.composite", inputs, &[], smooth, &["value", "opacity", "weights"])
}
