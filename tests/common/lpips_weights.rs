//! Weights of LPIPS as a file has them.
#![allow(dead_code, reason = "each test program uses its part")]

use lastlight::loss::lpips::{CONVOLUTIONS, Weights};
use lastlight::num::array::Arrays;

/// Under torchvision's names and in torch's order.
pub(crate) fn torchvision(weights: &Weights) -> Arrays {
    let mut arrays = Arrays::new();
    for (layer, (at, ..)) in weights.layers.iter().zip(CONVOLUTIONS) {
        let (o, i) = (layer.outputs, layer.inputs);
        let torch: Vec<f32> =
            (0..o * i * 9).map(|k| layer.weight[(k / (9 * i) * 9 + k % 9) * i + k / 9 % i]).collect();
        arrays.put(&format!("features.{at}.weight"), &[o, i, 3, 3], torch);
        arrays.put(&format!("features.{at}.bias"), &[o], layer.bias.clone());
    }
    for (j, head) in weights.heads.iter().enumerate() {
        arrays.put(&format!("lin{j}.model.1.weight"), &[1, head.len(), 1, 1], head.clone());
    }
    arrays
}
