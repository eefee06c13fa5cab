//! Cases of fields.

use reference::array::Arr;

use super::case::{Case, case};
use crate::scenes::{named, normal, uniform};

pub(super) fn cases() -> Vec<Case> {
    vec![
        fetch("fetch", 6, "concat"),
        fetch("fetch sum", 3, "sum"),
        sdf_head(),
        density(),
        interval(),
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
fn sdf_head() -> Case {
    let layer = |shape: &[usize; 2], purpose: u16| {
        let mut at = 0;
        let k = shape[1];
        uniform(shape, [0.2, 0.6], purpose).map(|&w| {
            at += 1;
            if (at - 1) / k % 3 == 1 { -w } else { w }
        })
    };
    let inputs = named([
        ("features", uniform(&[6, 5], [0.1, 1.0], 72)),
        ("points", normal(&[6, 3], 73)),
        ("w0", layer(&[4, 5], 74)),
        ("w1", layer(&[4, 4], 75)),
        ("w2", layer(&[1, 4], 76)),
    ]);
    case("sdf head", "field.sdf_head", inputs, &[], &["features", "points", "w0", "w1", "w2"], &["sdf"])
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
