//! Cases of fields.

use reference::array::{Arr, Named};

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
        render(),
        render_trunk(),
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

/// Weights of a head, named `HEAD_w0` and so on.
fn layers(head: &str, widths: &[usize], purpose: u16) -> Vec<(String, Arr<f64>)> {
    let layer = |(l, size): (usize, &[usize])| {
        let scale = 1.0 / (size[0] as f64).sqrt();
        (format!("{head}_w{l}"), normal(&[size[1], size[0]], purpose + l as u16).map(|w| scale * w))
    };
    widths.windows(2).enumerate().map(layer).collect()
}

/// Rays through a box of half size ½; the last starts inside it.
fn rays() -> Named<f64> {
    let mut directions = normal(&[4, 3], 101);
    for d in directions.data.chunks_exact_mut(3) {
        let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
        d.iter_mut().for_each(|x| *x /= length);
    }
    let mut origins = uniform(&[4, 3], [-0.15, 0.15], 102);
    for (i, (o, d)) in origins.data.iter_mut().zip(&directions.data).enumerate() {
        *o -= if i < 9 { 1.2 * d } else { 0.1 * d };
    }
    named([("origins", origins), ("directions", directions)])
}

/// All heads, panoramas and numerical normals.
fn render() -> Case {
    let mut inputs = rays();
    inputs.extend(named([
        ("planes", normal(&[6, 3, 3, 2], 103)),
        ("panoramas", normal(&[2, 3, 3, 2], 104)),
        ("beta", Arr::scalar(0.125)),
        ("background", Arr::scalar(0.25)),
    ]));
    inputs.extend(layers("sdf", &[6, 5, 4, 1], 105));
    // mostly inside, so that rays have numerical normals
    inputs.insert("sdf_w2".to_owned(), uniform(&[1, 4], [-0.8, -0.3], 107));
    inputs.extend(layers("color", &[8, 5, 4, 4, 3], 150));
    inputs.extend(layers("albedo", &[6, 5, 4, 4, 3], 115));
    inputs.extend(layers("material", &[6, 5, 4, 4, 2], 120));
    inputs.extend(layers("normal", &[6, 5, 4, 4, 3], 125));
    inputs.extend(layers("rho", &[6, 5, 4, 1], 130));
    let settings = [
        ("half_size", "0.5"),
        ("samples", "9"),
        ("rule", "analytic"),
        ("normals", "forward"),
        ("epsilon", "0.1"),
    ];
    let smooth: &[&str] = &[
        "planes",
        "panoramas",
        "beta",
        "background",
        "sdf_w0",
        "sdf_w1",
        "sdf_w2",
        "color_w0",
        "color_w1",
        "color_w2",
        "color_w3",
        "albedo_w0",
        "albedo_w1",
        "albedo_w2",
        "albedo_w3",
        "material_w0",
        "material_w1",
        "material_w2",
        "material_w3",
        "normal_w0",
        "normal_w1",
        "normal_w2",
        "normal_w3",
        "rho_w0",
        "rho_w1",
        "rho_w2",
    ];
    let outputs = &["color", "albedo", "material", "normal", "opacity", "point", "numerical_normal"];
    case("render", "field.render", inputs, &settings, smooth, outputs)
}

/// A trunk on three planes, with rays that stop early.
fn render_trunk() -> Case {
    let mut inputs = rays();
    inputs.extend(named([
        ("planes", normal(&[3, 4, 4, 3], 140)),
        ("beta", Arr::scalar(0.25)),
        ("background", Arr::scalar(0.75)),
    ]));
    inputs.extend(layers("sdf", &[3, 6, 5, 4], 141));
    let settings = [("half_size", "0.5"), ("samples", "10"), ("combine", "sum"), ("early_stop", "0.5")];
    let smooth = &["planes", "beta", "background", "sdf_w0", "sdf_w1", "sdf_w2"];
    case("render trunk", "field.render", inputs, &settings, smooth, &["color", "opacity", "point"])
}
