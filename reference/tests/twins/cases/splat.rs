//! Cases of splatting.

use std::collections::BTreeMap;

use reference::array::Named;
use reference::twins::{self, Request};

use super::case::{Case, case};
use crate::scenes::{named, normal, scene, settings, uniform};

fn without(mut inputs: Named<f64>, names: &[&str]) -> Named<f64> {
    names.iter().for_each(|&name| drop(inputs.remove(name)));
    inputs
}

fn factors(inputs: &Named<f64>) -> Named<f64> {
    let both = named([("quats", inputs["quats"].clone()), ("scales", inputs["scales"].clone())]);
    let request = Request { op: "splat.covariance", inputs: &both, settings: &BTreeMap::new(), plan: None };
    twins::value(&request).expect("covariances").outputs
}

pub(super) fn cases() -> Vec<Case> {
    let n = 24;
    let full = scene(n, 40, 28);
    let projected = |with: &[(&str, &str)]| {
        let request = Request { op: "splat.render", inputs: &full, settings: &settings(with), plan: None };
        twins::value(&request).expect("a render").intermediates
    };
    let mut blend = full.clone();
    blend.extend(projected(&[]));
    let blend: Named<f64> = blend
        .into_iter()
        .filter(|(name, _)| {
            ["means_px", "shape", "axis", "opacities", "colors", "depths_z", "background", "width", "height"]
                .contains(&name.as_str())
        })
        .collect();
    let project = without(full.clone(), &["sh", "sh_degree", "background"]);
    let mut skinned = without(project.clone(), &["quats", "scales"]);
    skinned.extend(factors(&full));
    let mut render_skinned = without(full.clone(), &["quats", "scales", "sh", "sh_degree"]);
    render_skinned.extend(factors(&full));
    render_skinned.insert("rgb".to_owned(), uniform(&[n, 3], [0.0, 1.0], 13));
    let colored: Named<f64> = full
        .iter()
        .filter(|(k, _)| ["means", "sh", "sh_degree", "view_from_world"].contains(&k.as_str()))
        .map(|(k, x)| (k.clone(), x.clone()))
        .collect();
    let stored = named([("scales_log", normal(&[n, 3], 6)), ("opacity_logits", normal(&[n], 7))]);
    let factored = named([("quats", normal(&[n, 4], 2)), ("scales", uniform(&[n, 3], [0.05, 0.3], 3))]);
    let shape: &[&str] = &["means_px", "depths_z", "conics", "shape"];
    let shape_aa: &[&str] = &["means_px", "depths_z", "conics", "shape", "compensation"];
    let image: &[&str] = &["image", "alpha", "depth"];
    let gaussian: &[&str] = &["means", "quats", "scales"];
    let all: &[&str] = &["means", "quats", "scales", "opacities", "sh", "background"];
    vec![
        case(
            "activate",
            "splat.activate",
            stored,
            &[],
            &["scales_log", "opacity_logits"],
            &["scales", "opacities"],
        ),
        case("covariance", "splat.covariance", factored, &[], &["quats", "scales"], &["factors"]),
        case("project", "splat.project", project.clone(), &[], gaussian, shape),
        case("project inria", "splat.project", project.clone(), &[("profile", "inria")], gaussian, shape),
        case(
            "project antialiased",
            "splat.project",
            project.clone(),
            &[("antialiased", "1")],
            gaussian,
            shape_aa,
        ),
        case(
            "project orthographic",
            "splat.project",
            project.clone(),
            &[("camera", "orthographic")],
            gaussian,
            shape,
        ),
        case("project fisheye", "splat.project", project, &[("camera", "fisheye")], gaussian, shape),
        case("project factors", "splat.project", skinned, &[], &["means", "factors"], shape),
        case("color", "splat.color", colored, &[], &["means", "sh"], &["colors"]),
        case(
            "blend",
            "splat.blend",
            blend,
            &[],
            &["means_px", "shape", "opacities", "colors", "depths_z", "background"],
            image,
        ),
        case("render exact", "splat.render", full.clone(), &[], all, image).within(1e-11),
        case("render gsplat", "splat.render", full.clone(), &[("profile", "gsplat")], all, image)
            .within(1e-11),
        case("render inria", "splat.render", full.clone(), &[("profile", "inria")], all, image).within(1e-11),
        case("render unlimited", "splat.render", full.clone(), &[("profile", "unlimited")], all, image)
            .within(1e-11),
        case("render antialiased", "splat.render", full.clone(), &[("antialiased", "1")], all, image)
            .within(1e-11),
        case("render fisheye", "splat.render", full.clone(), &[("camera", "fisheye")], all, image)
            .within(1e-11),
        case(
            "render factors rgb",
            "splat.render",
            render_skinned,
            &[],
            &["means", "factors", "opacities", "rgb", "background"],
            image,
        )
        .within(1e-11),
    ]
}
