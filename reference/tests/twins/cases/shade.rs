//! Cases of shading, of skinning and of poses.

use reference::array::{Arr, Named};

use super::case::{Case, case, picked};
use crate::scenes::{named, normal, uniform};

pub(super) fn cases() -> Vec<Case> {
    vec![
        case(
            "ggx",
            "shade.ggx",
            lit(&["normal", "view", "light", "albedo", "roughness", "metallic"]),
            &[],
            &["normal", "albedo", "roughness", "metallic"],
            &["brdf"],
        ),
        case(
            "envmap",
            "shade.envmap",
            lit(&["normal", "view", "albedo", "roughness", "metallic", "env"]),
            &[],
            &["normal", "albedo", "roughness", "metallic", "env"],
            &["radiance"],
        ),
        case("encode", "shade.encode", curve("linear", 37), &[], &["linear"], &["encoded"]),
        case("decode", "shade.decode", curve("encoded", 38), &[], &["encoded"], &["linear"]),
        case(
            "skin",
            "body.skin",
            named([
                ("points", normal(&[7, 3], 54)),
                ("weights", uniform(&[7, 3], [0.0, 1.0], 55)),
                ("transforms", normal(&[3, 4, 4], 56)),
                ("factors", normal(&[7, 3, 3], 57)),
            ]),
            &[],
            &["points", "weights", "transforms", "factors"],
            &["skinned", "skinned_factors"],
        ),
        case("pose", "body.pose", skeleton(), &[], &["pose", "correction", "joints"], &["transforms"]),
    ]
}

/// Values on both parts of the sRGB curve, away from its knee and from 0 and 1.
fn curve(name: &str, purpose: u16) -> Named<f64> {
    let mut values = uniform(&[7, 3], [0.06, 0.95], purpose);
    values.data.iter_mut().step_by(4).for_each(|x| *x *= 0.02);
    named([(name, values)])
}

/// Five joints with large, small and tiny angles.
fn skeleton() -> Named<f64> {
    let mut pose = normal(&[5, 3], 40);
    pose.data[3..6].iter_mut().for_each(|x| *x *= 1e-3);
    pose.data[6..9].iter_mut().for_each(|x| *x *= 2e-5);
    named([
        ("pose", pose),
        ("correction", normal(&[5, 3], 41)),
        ("joints", normal(&[5, 3], 42)),
        ("parents", Arr::new(&[5], vec![-1.0, 0.0, 1.0, 1.0, 0.0])),
    ])
}

/// Points under light, eye and light within 60° of +z and the normal near it; a map of 4 × 6.
fn lit(names: &[&str]) -> Named<f64> {
    const POINTS: usize = 9;
    let upper = |purpose: u16| {
        let mut d = uniform(&[POINTS, 3], [-0.6, 0.6], purpose);
        for p in d.data.chunks_exact_mut(3) {
            p[2] = (1.0 - p[0] * p[0] - p[1] * p[1]).sqrt();
        }
        d
    };
    let mut normal = uniform(&[POINTS, 3], [-0.2, 0.2], 30);
    normal.data.chunks_exact_mut(3).for_each(|p| p[2] += 1.3);
    let all = named([
        ("normal", normal),
        ("view", upper(31)),
        ("light", upper(32)),
        ("albedo", uniform(&[POINTS, 3], [0.1, 0.9], 33)),
        ("roughness", uniform(&[POINTS], [0.3, 0.9], 34)),
        ("metallic", uniform(&[POINTS], [0.1, 0.9], 35)),
        ("env", uniform(&[4, 6, 3], [0.2, 2.0], 36)),
    ]);
    picked(&all, names)
}
