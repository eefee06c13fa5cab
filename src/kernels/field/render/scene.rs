//! Inputs, settings, plan and outputs of a render.

use super::intervals::{Intervals, Rays};
use crate::field::embed::Panoramas;
use crate::field::fetch::{Combine, Planes};
use crate::field::network::Network;
use crate::field::normal::Stencil;

/// Where the density of a step is taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rule {
    /// At its start.
    Left,
    /// At its middle.
    #[default]
    Midpoint,
    /// The mean density of a signed distance that is linear between its ends.
    Analytic,
}

/// Settings.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Steps along the diagonal of the box.
    pub samples: usize,
    /// Where densities are taken.
    pub rule: Rule,
    /// Whether the features of planes are concatenated or added.
    pub combine: Combine,
    /// Transmittance at which rays stop.
    pub early_stop: Option<f32>,
    /// Samples with a smaller weight have the background's values, which needs no decoding; a trunk decodes all.
    pub least_weight: Option<f32>,
    /// Stencil and distance ε of numerical normals, if there are any.
    pub numerical_normals: Option<(Stencil, f32)>,
    /// Background of all values.
    pub background: f32,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            samples: 128,
            rule: Rule::Midpoint,
            combine: Combine::Concat,
            early_stop: None,
            least_weight: None,
            numerical_normals: None,
            background: 1.0,
        }
    }
}

/// Networks of a field. A network of the signed distance with four outputs is a trunk, which also gives the
/// colour.
#[derive(Clone, Debug)]
pub struct Heads<'a> {
    /// Signed distance before its bound: 1 output, or 4 for a trunk.
    pub sdf: Network<'a>,
    /// Colour: features, or features ‖ h, to 3.
    pub color: Option<Network<'a>>,
    /// Albedo: 3.
    pub albedo: Option<Network<'a>>,
    /// Roughness and metallic: 2.
    pub material: Option<Network<'a>>,
    /// Normal: 3.
    pub normal: Option<Network<'a>>,
    /// Roughness of the embedding: 1.
    pub rho: Option<Network<'a>>,
}

/// First channel of every kind of value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Channels {
    /// Three channels.
    pub color: Option<usize>,
    /// Three channels.
    pub albedo: Option<usize>,
    /// Roughness, metallic.
    pub material: Option<usize>,
    /// Three channels.
    pub normal: Option<usize>,
}

impl Channels {
    /// Number of channels.
    pub(super) fn count(&self) -> usize {
        self.color.map_or(0, |_| 3)
            + self.albedo.map_or(0, |_| 3)
            + self.material.map_or(0, |_| 2)
            + self.normal.map_or(0, |_| 3)
    }
}

impl Heads<'_> {
    /// Whether the first network also gives the colour.
    pub fn is_trunk(&self) -> bool {
        self.sdf.widths().last() == Some(&4)
    }

    /// Whether there is any value besides the signed distance.
    pub fn has_values(&self) -> bool {
        self.channels() != Channels::default()
    }

    /// Returns the channels of the values.
    pub fn channels(&self) -> Channels {
        let mut next = 0;
        let mut place = |is_there: bool, n: usize| {
            let at = next;
            next += if is_there { n } else { 0 };
            is_there.then_some(at)
        };
        Channels {
            color: place(self.is_trunk() || self.color.is_some(), 3),
            albedo: place(self.albedo.is_some(), 3),
            material: place(self.material.is_some(), 2),
            normal: place(self.normal.is_some(), 3),
        }
    }
}

/// Inputs.
#[derive(Clone, Debug)]
pub struct Scene<'a> {
    /// The rays of the crop.
    pub rays: Rays<'a>,
    /// Feature planes, with the half size of the box.
    pub planes: Planes<'a>,
    /// Panoramas of the directional embedding.
    pub panoramas: Option<Panoramas<'a>>,
    /// Networks.
    pub heads: Heads<'a>,
    /// Scale of the density.
    pub beta: f32,
    /// Settings.
    pub settings: Settings,
}

impl Scene<'_> {
    /// Returns the channels of the values.
    pub fn channels(&self) -> Channels {
        self.heads.channels()
    }

    /// Length of a step.
    pub fn step(&self) -> f32 {
        (2.0 * 3.0_f64.sqrt() * f64::from(self.planes.half_size) / self.settings.samples as f64) as f32
    }

    /// Returns the weight below which values are not decoded.
    pub(super) fn least_weight(&self) -> Option<f32> {
        self.settings.least_weight.filter(|_| self.heads.has_values() && !self.heads.is_trunk())
    }

    /// Whether values are decoded at the points of the signed distances.
    pub(super) fn is_shared(&self) -> bool {
        let Settings { rule, numerical_normals, .. } = self.settings;
        rule == Rule::Midpoint && numerical_normals.is_none() && self.least_weight().is_none()
    }

    /// Returns all steps of all rays.
    pub fn all_intervals(&self) -> Intervals {
        Intervals::all(self.rays, self.planes.half_size, self.step())
    }
}

/// The discrete decisions: intervals, the last sample of every ray, and the samples whose values are decoded.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    /// Steps that take a sample.
    pub intervals: Intervals,
    /// Number of samples taken per ray, (N); empty before the forward pass.
    pub last: Vec<u32>,
    /// 1 for every entry of `intervals.index` whose values are decoded, 0 for the others; empty before the forward
    /// pass, and where all are.
    pub shaded: Vec<u8>,
}

impl Plan {
    /// Returns a plan without last samples.
    pub fn new(intervals: Intervals) -> Self {
        Self { intervals, ..Self::default() }
    }

    /// Returns the end of the samples that a ray takes.
    pub(super) fn taken_end(&self, ray: usize) -> usize {
        match self.last.get(ray) {
            Some(n) => self.intervals.start[ray] + *n as usize,
            None => self.intervals.start[ray + 1],
        }
    }

    /// Number of samples taken.
    pub fn taken(&self) -> usize {
        self.last.iter().fold(0, |sum, n| sum + *n as usize)
    }
}

/// Outputs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Out {
    /// Shape (N, Q).
    pub values: Vec<f32>,
    /// Shape (N).
    pub opacity: Vec<f32>,
    /// Shape (N, 3).
    pub points: Vec<[f32; 3]>,
    /// Shape (N, 3); empty without numerical normals.
    pub normals: Vec<[f32; 3]>,
    /// ‖N‖ of the numerical normals, 0 where they are 0; shape (N).
    pub lengths: Vec<f32>,
    /// What remains of the background: transmittance behind the last sample and the weights of samples whose values are not
    /// decoded, shape (N).
    pub rest: Vec<f32>,
}

/// Cotangents of the outputs.
#[derive(Clone, Copy, Debug, Default)]
pub struct OutBar<'a> {
    /// Shape (N, Q).
    pub values: &'a [f32],
    /// Shape (N), or empty for zeros.
    pub opacity: &'a [f32],
    /// Shape (N, 3), or empty for zeros.
    pub points: &'a [[f32; 3]],
    /// Shape (N, 3), or empty for zeros.
    pub normals: &'a [[f32; 3]],
}
