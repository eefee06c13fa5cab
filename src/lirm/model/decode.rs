//! From a state to a field: texels of planes and panoramas, and the heads.
//!
//! ```text
//! state ─┬─► planes' tokens (P·t², D) ──► nn.unpatch ──► planes (P, 8t, 8t, C)
//!        └─► panoramas' tokens (e², D) ─► nn.unpatch ──► (8e, 8e, C) ──► four panoramas (4, 4e, 4e, C): the quarters, row by row
//! ```
//!
//! The panoramas of a plain model are not made: nothing reads them.

use super::config::{Config, LEVELS, PATCH};
use super::params::{heads, widths};
use super::weights::{Gradients, Ready, lend};
use crate::field::render::InBar;
use crate::fit::field::HALF_SIZE;
use crate::nn::unpatch;
use crate::scene::field::{Field, Heads, Network, Panoramas, Placement, Planes, Rule, Settings, Stencil};

/// Samples with a smaller weight have the background's values.
pub const LEAST_WEIGHT: f32 = 1e-3;
/// A ray that ends early ends at this transmittance.
pub const EARLY_STOP: f32 = 1e-4;

/// How a decoded field is rendered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rendering {
    /// Steps along the diagonal of the box.
    pub samples: usize,
    /// 1/β.
    pub inverse_beta: f32,
    /// Samples with a smaller weight have the background's values.
    pub least_weight: Option<f32>,
    /// A ray ends after the sample that reaches this transmittance.
    pub early_stop: Option<f32>,
}

impl Rendering {
    /// How a finished field is rendered.
    pub fn of_field(samples: usize, inverse_beta: f32) -> Self {
        Self { samples, inverse_beta, least_weight: Some(LEAST_WEIGHT), early_stop: Some(EARLY_STOP) }
    }
}

/// The index, in the square of panoramas, of number i of the four panoramas with `side` rows of `side`
/// texels.
fn in_square(i: usize, side: usize, channels: usize) -> usize {
    let (texel, c) = (i / channels, i % channels);
    let (level, row, column) = (texel / (side * side), texel / side % side, texel % side);
    let (row, column) = (level / 2 * side + row, level % 2 * side + column);
    (row * 2 * side + column) * channels + c
}

impl Config {
    /// The shape of the layer from tokens to texels: of planes, or of the square of panoramas.
    fn grids(&self, is_planes: bool) -> unpatch::Shape {
        let (grids, side) = if is_planes { (self.planes, self.plane_tokens) } else { (1, self.embed_tokens) };
        unpatch::Shape { grids, height: side, width: side, patch: PATCH, channels: self.channels }
    }
}

/// The number of texels of a shape, times channels.
fn size(s: unpatch::Shape) -> usize {
    s.grids * s.height * s.width * s.patch * s.patch * s.channels
}

impl Ready<'_> {
    /// The heads of a field.
    fn networks(&self) -> Heads {
        let mut made = Heads::default();
        for (name, sizes) in heads(&self.config) {
            let widths = widths(sizes);
            let weights = (1..widths.len()).map(|l| self.array(&format!("heads/{name}/{}", l - 1)).to_vec());
            let network = Network { weights: weights.collect(), widths };
            match name {
                "sdf" => made.sdf = network,
                "color" => made.color = Some(network),
                "normal" => made.normal = Some(network),
                "albedo" => made.albedo = Some(network),
                "material" => made.material = Some(network),
                "rho" => made.rho = Some(network),
                other => unreachable!("a head '{other}'"),
            }
        }
        made
    }

    /// Decodes a state.
    ///
    /// # Panics
    /// Panics if the state has another size.
    pub fn decode(&self, state: &[f32], rendering: Rendering, placement: Placement) -> Field {
        let c = &self.config;
        let (of_planes, of_panoramas) = state.split_at(c.tokens()[0] * c.width);
        let shape = c.grids(true);
        let mut values = vec![0.0; size(shape)];
        unpatch::forward(&self.unpatch("planes", of_planes, shape), &mut values);
        let planes = Planes { values, count: c.planes, side: c.plane_side(), channels: c.channels };
        let panoramas = c.is_directed().then(|| {
            let (shape, side) = (c.grids(false), c.panorama_side());
            let mut square = vec![0.0; size(shape)];
            unpatch::forward(&self.unpatch("panoramas", of_panoramas, shape), &mut square);
            let values = (0..square.len()).map(|i| square[in_square(i, side, c.channels)]).collect();
            Panoramas { values, levels: LEVELS, height: side, width: side, channels: c.channels }
        });
        let settings = Settings {
            half_size: HALF_SIZE,
            samples: rendering.samples,
            rule: Rule::Analytic,
            inverse_beta: rendering.inverse_beta,
            least_weight: rendering.least_weight,
            early_stop: rendering.early_stop,
            stencil: Stencil::Central,
            epsilon: 2.0 * HALF_SIZE / (planes.side - 1) as f32,
            ..Settings::default()
        };
        Field { planes, panoramas, heads: self.networks(), settings, placement }
    }

    /// Adds the gradients of the layers and heads for the gradients of a decoded field to `g`, and those of the
    /// state to `state_bar`.
    ///
    /// # Panics
    /// Panics if the state has another size.
    pub fn pull_decoded(&self, state: &[f32], bar: &InBar, g: &mut Gradients, state_bar: &mut [f32]) {
        let c = &self.config;
        let at = c.tokens()[0] * c.width;
        let (of_planes, of_panoramas) = state.split_at(at);
        let mut pull = |name: &str, tokens: &[f32], texels_bar: &[f32], into: &mut [f32]| {
            let x = self.unpatch(name, tokens, c.grids(name == "planes"));
            let names = [format!("unpatch/{name}"), format!("unpatch/{name}/bias")];
            lend(g, names, |[weight, bias]| {
                let mut own = unpatch::InBar { tokens: into.to_vec(), weight, bias };
                unpatch::adjoint(&x, texels_bar, &mut own);
                into.copy_from_slice(&own.tokens);
                [own.weight, own.bias]
            });
        };
        let (planes_bar, panoramas_bar) = state_bar.split_at_mut(at);
        pull("planes", of_planes, &bar.planes, planes_bar);
        if c.is_directed() {
            let side = c.panorama_side();
            let mut square = vec![0.0; bar.panoramas.len()];
            bar.panoramas.iter().enumerate().for_each(|(i, x)| square[in_square(i, side, c.channels)] = *x);
            pull("panoramas", of_panoramas, &square, panoramas_bar);
        }
        let own = &bar.heads;
        let all = [
            ("sdf", &own.sdf),
            ("color", &own.color),
            ("albedo", &own.albedo),
            ("material", &own.material),
            ("normal", &own.normal),
            ("rho", &own.rho),
        ];
        for (name, layers) in all {
            for (l, part) in layers.iter().enumerate() {
                let sum = g.get_mut(&format!("heads/{name}/{l}")).expect("a head of this model");
                assert_eq!(sum.len(), part.len(), "the layer {l} of head {name}");
                sum.iter_mut().zip(part).for_each(|(s, p)| *s += p);
            }
        }
    }
}
