//! The rules of the profiles: visibility, order, cuts, caps, stops, clamps, footprints, plans.

mod blending;
mod color;
mod plan;
mod projection;

use reference::array::Named;
use reference::twins;

fn without(inputs: &Named<f64>, names: &[&str]) -> Named<f64> {
    inputs
        .iter()
        .filter(|(name, _)| !names.contains(&name.as_str()))
        .map(|(n, x)| (n.clone(), x.clone()))
        .collect()
}

/// The value of the middle pixel of a 33×33 image, whose centre is the principal point.
fn middle(answer: &twins::Results) -> f64 {
    answer.outputs["image"].data[3 * (16 * 33 + 16)]
}

/// A Gaussian on the optical axis of a 33×33 image.
fn on_axis(z: f64, opacity: f64, grey: f64) -> ([f64; 3], f64, f64, f64) {
    ([0.0, 0.0, z], 0.05, opacity, grey)
}
