//! The scene of a call.

use crate::Result;
use crate::field::embed::Panoramas;
use crate::field::fetch::{Combine, Planes};
use crate::field::network::Network;
use crate::field::normal::Stencil;
use crate::field::render::{Heads, Intervals, Plan, Rays, Rule, Scene, Settings};
use crate::num::array::Arrays;
use crate::ops::field::half_size;
use crate::ops::op::CheckedCall;

/// Heads with the names of their layers.
pub(super) const HEADS: [(&str, &[&str]); 6] = [
    ("sdf", &["sdf_w0", "sdf_w1", "sdf_w2"]),
    ("color", &["color_w0", "color_w1", "color_w2", "color_w3"]),
    ("albedo", &["albedo_w0", "albedo_w1", "albedo_w2", "albedo_w3"]),
    ("material", &["material_w0", "material_w1", "material_w2", "material_w3"]),
    ("normal", &["normal_w0", "normal_w1", "normal_w2", "normal_w3"]),
    ("rho", &["rho_w0", "rho_w1", "rho_w2"]),
];

/// The layers of a head that are present.
pub(super) fn layers<'a>(x: &CheckedCall<'_>, names: &'a [&'a str]) -> Vec<&'a str> {
    names.iter().copied().filter(|name| x.has(name)).collect()
}

pub(super) fn combine(x: &CheckedCall<'_>) -> Combine {
    if x.word("combine") == Some("sum") { Combine::Sum } else { Combine::Concat }
}

pub(super) fn settings(x: &CheckedCall<'_>) -> Result<Settings> {
    let samples = x.single(
        "samples",
        128.0,
        |n| n >= 1.0 && n == n.trunc() && n <= 1e6,
        "a whole number from 1 to 1e6",
    )? as usize;
    let half = half_size(x)?;
    let stop = x.single("early_stop", 0.0, |t| (0.0..1.0).contains(&t), "0 to 1")?;
    let least = x.single("least_weight", 0.0, |w| (0.0..=1.0).contains(&w), "0 to 1")?;
    let epsilon = x.single("epsilon", 8.0 * f64::from(half) / samples as f64, |e| e > 0.0, "above 0")?;
    Ok(Settings {
        samples,
        rule: match x.word("rule") {
            Some("left") => Rule::Left,
            Some("analytic") => Rule::Analytic,
            _ => Rule::Midpoint,
        },
        combine: combine(x),
        early_stop: (stop > 0.0).then_some(stop),
        least_weight: (least > 0.0).then_some(least),
        numerical_normals: match x.word("normals") {
            Some("forward") => Some((Stencil::Forward, epsilon)),
            Some("central") => Some((Stencil::Central, epsilon)),
            _ => None,
        },
        background: x.f32s("background")[0],
    })
}

/// The numbers of an array of a plan.
pub(super) fn whole(plan: &Arrays, name: &str) -> Result<Vec<i64>> {
    Ok(plan.need(name).map_err(|e| e.within("plan"))?.to_i64().unwrap_or_default())
}

/// The steps, numbers of samples and decoded samples of a plan that was checked.
pub(super) fn given(plan: &Arrays, scene: &Scene<'_>) -> Result<Plan> {
    let intervals = Intervals {
        start: whole(plan, "start")?.into_iter().map(|s| s as usize).collect(),
        index: whole(plan, "index")?.into_iter().map(|i| i as u32).collect(),
        ..scene.all_intervals()
    };
    let shaded = if plan.get("shaded").is_some() { whole(plan, "shaded")? } else { Vec::new() };
    Ok(Plan {
        intervals,
        last: whole(plan, "taken")?.into_iter().map(|t| t as u32).collect(),
        shaded: shaded.into_iter().map(|s| u8::from(s != 0)).collect(),
    })
}

/// Owned arrays of the networks, head by head.
struct Weights(Vec<Vec<Vec<f32>>>);

impl Weights {
    fn of(x: &CheckedCall<'_>) -> Self {
        Self(HEADS.iter().map(|(_, names)| layers(x, names).iter().map(|n| x.f32s(n)).collect()).collect())
    }

    fn views(&self) -> Vec<Vec<&[f32]>> {
        self.0.iter().map(|head| head.iter().map(Vec::as_slice).collect()).collect()
    }
}

/// Calls `work` with the scene of a call.
pub(super) fn with_scene<T>(x: &CheckedCall<'_>, work: impl FnOnce(&Scene<'_>) -> Result<T>) -> Result<T> {
    let (origins, directions) = (x.rows::<3>("origins"), x.rows::<3>("directions"));
    let (texels, maps) = (x.f32s("planes"), x.f32s("panoramas"));
    let (weights, settings) = (Weights::of(x), settings(x)?);
    let views = weights.views();
    let features = settings.combine.width(x.dim("C"));
    let net = |head: usize| {
        let is_embedded = head == 1 && x.has("panoramas");
        let inputs = if is_embedded { x.shape(HEADS[1].1[0])[1] } else { features };
        (!views[head].is_empty()).then_some(Network { weights: &views[head], inputs })
    };
    let [levels, height, width, channels] =
        ["L", "H", "W", "D"].map(|letter| if x.has("panoramas") { x.dim(letter) } else { 0 });
    work(&Scene {
        rays: Rays { origins: &origins, directions: &directions },
        planes: Planes {
            values: &texels,
            count: x.dim("P"),
            side: x.dim("S"),
            channels: x.dim("C"),
            half_size: half_size(x)?,
        },
        panoramas: x.has("panoramas").then_some(Panoramas { values: &maps, levels, height, width, channels }),
        heads: Heads {
            sdf: Network { weights: &views[0], inputs: features },
            color: net(1),
            albedo: net(2),
            material: net(3),
            normal: net(4),
            rho: net(5),
        },
        beta: x.f32s("beta")[0],
        settings,
    })
}
