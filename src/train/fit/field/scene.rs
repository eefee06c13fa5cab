//! A stored field as the inputs of the operators.

use crate::field::embed;
use crate::field::fetch;
use crate::field::network;
use crate::field::normal::Stencil;
use crate::field::render::{Heads, Rays, Rule, Scene, Settings};
use crate::scene::field::{self as stored, Field};

/// The weights of a field as slices; [`Weights::scene`] borrows them.
#[derive(Debug)]
pub struct Weights<'a> {
    field: &'a Field,
    heads: [Vec<&'a [f32]>; 6],
}

/// Returns how features are combined.
pub(super) fn combine(field: &Field) -> fetch::Combine {
    match field.settings.combine {
        stored::Combine::Concat => fetch::Combine::Concat,
        stored::Combine::Sum => fetch::Combine::Sum,
    }
}

/// Returns the stencil of numerical normals.
pub(super) fn stencil(field: &Field) -> Stencil {
    match field.settings.stencil {
        stored::Stencil::Forward => Stencil::Forward,
        stored::Stencil::Central => Stencil::Central,
    }
}

/// Returns the planes of a field.
pub(super) fn planes(field: &Field) -> fetch::Planes<'_> {
    let stored::Planes { values, count, side, channels } = &field.planes;
    fetch::Planes {
        values,
        count: *count,
        side: *side,
        channels: *channels,
        half_size: field.settings.half_size,
    }
}

impl<'a> Weights<'a> {
    /// Collects the weights.
    pub fn of(field: &'a Field) -> Self {
        let of = |n: Option<&'a stored::Network>| {
            n.map_or(Vec::new(), |n| n.weights.iter().map(Vec::as_slice).collect())
        };
        Self { field, heads: field.heads.all().map(of) }
    }

    /// Returns the network of head `k` of [`stored::Heads::NAMES`].
    fn network(&self, k: usize) -> Option<network::Network<'_>> {
        let inputs = self.field.heads.all()[k]?.inputs();
        Some(network::Network { weights: &self.heads[k], inputs })
    }

    /// Returns the network of the signed distance; of a trunk, with all of its outputs.
    pub fn sdf(&self) -> network::Network<'_> {
        self.network(0).expect("every field has a signed distance")
    }

    /// Returns the layers of the network of the signed distance.
    pub(super) fn sdf_layers(&self) -> Vec<&'a [f32]> {
        self.heads[0].clone()
    }

    /// Whether the network of the signed distance also gives the colour.
    pub(super) fn is_trunk(&self) -> bool {
        self.field.heads.is_trunk()
    }

    /// Returns the inputs of `field.render` for rays in the units of the field.
    pub fn scene<'s>(&'s self, rays: Rays<'s>) -> Scene<'s> {
        let Field { panoramas, settings, .. } = self.field;
        Scene {
            rays,
            planes: planes(self.field),
            panoramas: panoramas.as_ref().map(|p| embed::Panoramas {
                values: &p.values,
                levels: p.levels,
                height: p.height,
                width: p.width,
                channels: p.channels,
            }),
            heads: Heads {
                sdf: self.sdf(),
                color: self.network(1),
                albedo: self.network(2),
                material: self.network(3),
                normal: self.network(4),
                rho: self.network(5),
            },
            beta: settings.beta(),
            settings: Settings {
                samples: settings.samples,
                rule: match settings.rule {
                    stored::Rule::Left => Rule::Left,
                    stored::Rule::Midpoint => Rule::Midpoint,
                    stored::Rule::Analytic => Rule::Analytic,
                },
                combine: combine(self.field),
                early_stop: settings.early_stop,
                least_weight: settings.least_weight,
                numerical_normals: None,
                background: settings.background,
            },
        }
    }
}
