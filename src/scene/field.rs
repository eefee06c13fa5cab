//! A field of one object: feature planes, panoramas, the networks of its heads, the settings it is rendered
//! with, and its place in the world.
//!
//! `lastlight::field` evaluates and renders fields; this file holds their values. A field lives in the box
//! [−R, R]³ with the half size R. A point X of the world is the point x = (X − centre)·scale of the field.
//!
//! | part | shape | |
//! |---|---|---|
//! | `planes` | (P, S, S, C) | P = 6: xy−, xy+, xz−, xz+, yz−, yz+; P = 3: xy, xz, yz |
//! | `panoramas` | (L, H, W, C') | directional embedding; optional |
//! | head `sdf` | F → 1 or 4 | signed distance; with 4 outputs a trunk, which also gives the colour |
//! | head `color` | F (with panoramas + C', or + C' + 1) → 3 | not beside a trunk |
//! | heads `albedo`, `normal` | F → 3 | optional |
//! | head `material` | F → 2 | roughness, metallic; optional |
//! | head `rho` | F → 1 | roughness of the embedding; exactly with panoramas |
//!
//! F is 3C if the features of planes are concatenated, C if they are added. Networks are linear maps without
//! bias, with max(0, ·) between them.

mod check;
mod file;

pub use self::check::{INVERSE_BETA, MAX_VALUE};
use crate::num::bits::Digest;
use crate::{Error, Result};
use serde_json::{Value, json};

/// Name of the file in the folder of a fit.
pub const FILE: &str = "field.safetensors";

/// Feature planes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Planes {
    /// Shape (P, S, S, C).
    pub values: Vec<f32>,
    /// Number of planes P: 6 or 3.
    pub count: usize,
    /// Texels per side S, at least 2.
    pub side: usize,
    /// Channels C.
    pub channels: usize,
}

/// Panoramas of increasing roughness.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Panoramas {
    /// Shape (L, H, W, C').
    pub values: Vec<f32>,
    /// Number of levels L.
    pub levels: usize,
    /// Rows H, at least 2.
    pub height: usize,
    /// Columns W, at least 2.
    pub width: usize,
    /// Channels C'.
    pub channels: usize,
}

/// A network of linear maps without bias.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Network {
    /// Number of inputs, then of outputs of every layer.
    pub widths: Vec<usize>,
    /// Weights of every layer, (outputs, inputs).
    pub weights: Vec<Vec<f32>>,
}

/// The networks of a field.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Heads {
    /// Signed distance, or trunk.
    pub sdf: Network,
    /// Colour, sRGB-encoded.
    pub color: Option<Network>,
    /// Albedo, sRGB-encoded.
    pub albedo: Option<Network>,
    /// Roughness and metallic.
    pub material: Option<Network>,
    /// Normal.
    pub normal: Option<Network>,
    /// Roughness of the embedding.
    pub rho: Option<Network>,
}

/// How the features of the three planes of a point are combined.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Combine {
    /// One after the other.
    #[default]
    Concat,
    /// Added.
    Sum,
}

/// Where the density of a step is taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rule {
    /// At its start.
    Left,
    /// At its middle.
    Midpoint,
    /// The mean density of a signed distance that is linear between its ends.
    #[default]
    Analytic,
}

/// The differences that numerical normals are made of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Stencil {
    /// s(x + εe) − s(x).
    #[default]
    Forward,
    /// s(x + εe) − s(x − εe).
    Central,
}

/// How a field is rendered.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Half size R of the box, in units of the field.
    pub half_size: f32,
    /// How features are combined.
    pub combine: Combine,
    /// Steps along the diagonal of the box.
    pub samples: usize,
    /// Where densities are taken.
    pub rule: Rule,
    /// 1/β, the largest density.
    pub inverse_beta: f32,
    /// Transmittance at which rays stop; `None`: they do not.
    pub early_stop: Option<f32>,
    /// Samples with a smaller weight have the background's values; `None`: none has.
    pub least_weight: Option<f32>,
    /// Differences of numerical normals.
    pub stencil: Stencil,
    /// Distance ε of these differences, in units of the field.
    pub epsilon: f32,
    /// Background of all values.
    pub background: f32,
}

/// Where a field is in the world: x = Q·(X − centre)·scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// The point of the world at the origin of the field.
    pub center: [f64; 3],
    /// Units of the field per unit of the world, > 0.
    pub scale: f64,
    /// The rotation Q from the axes of the world to those of the field.
    pub rotation: [[f64; 3]; 3],
}

/// The rotation that changes nothing.
const IDENTITY: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// A field.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// Feature planes.
    pub planes: Planes,
    /// Panoramas of the directional embedding.
    pub panoramas: Option<Panoramas>,
    /// Networks.
    pub heads: Heads,
    /// How it is rendered.
    pub settings: Settings,
    /// Its place in the world.
    pub placement: Placement,
}

/// Names of the values of a setting.
macro_rules! names {
    ($type:ident, $what:literal, $($variant:ident => $name:literal),+) => {
        impl $type {
            /// Returns the name in files.
            pub fn name(self) -> &'static str {
                match self { $(Self::$variant => $name),+ }
            }

            /// Returns the value of that name.
            ///
            /// # Errors
            /// Lists the names if there is none.
            pub fn parse(name: &str) -> Result<Self> {
                match name {
                    $($name => Ok(Self::$variant),)+
                    other => {
                        let all = [$($name),+].join(", ");
                        Err(Error::input($what).expected(format!("one of {all}")).got(other))
                    }
                }
            }
        }
    };
}
names!(Combine, "setting 'combine'", Concat => "concat", Sum => "sum");
names!(Rule, "setting 'rule'", Left => "left", Midpoint => "midpoint", Analytic => "analytic");
names!(Stencil, "setting 'stencil'", Forward => "forward", Central => "central");

impl Settings {
    /// Returns β.
    pub fn beta(&self) -> f32 {
        1.0 / self.inverse_beta
    }

    /// Returns the settings as a flat JSON object; numbers are those of f32. Without a least weight it has no entry for it, as
    /// files that were written before there was that setting: they keep their digests.
    pub fn json(&self) -> Value {
        let mut all = json!({
            "half_size": self.half_size,
            "combine": self.combine.name(),
            "samples": self.samples,
            "rule": self.rule.name(),
            "inverse_beta": self.inverse_beta,
            "early_stop": self.early_stop,
        });
        // In the order in which the digest reads them.
        let mut put = |name: &str, value: Value| all[name] = value;
        if let Some(least) = self.least_weight {
            put("least_weight", json!(least));
        }
        put("stencil", json!(self.stencil.name()));
        put("epsilon", json!(self.epsilon));
        put("background", json!(self.background));
        all
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            half_size: 0.525,
            combine: Combine::Concat,
            samples: 128,
            rule: Rule::Analytic,
            inverse_beta: 200.0,
            early_stop: Some(1e-4),
            least_weight: Some(1e-3),
            stencil: Stencil::Forward,
            epsilon: 8.0 * 0.525 / 128.0,
            background: 1.0,
        }
    }
}

impl Default for Placement {
    /// The world is that of the field.
    fn default() -> Self {
        Self { center: [0.0; 3], scale: 1.0, rotation: IDENTITY }
    }
}

impl Placement {
    /// A placement with the axes of the world.
    pub const fn new(center: [f64; 3], scale: f64) -> Self {
        Self { center, scale, rotation: IDENTITY }
    }

    /// Whether the axes of the field are not those of the world.
    pub fn is_turned(&self) -> bool {
        self.rotation != IDENTITY
    }

    /// Returns the point of the field at a point of the world.
    pub fn to_field(&self, x: [f64; 3]) -> [f64; 3] {
        let from = std::array::from_fn(|k| (x[k] - self.center[k]) * self.scale);
        if self.is_turned() { self.direction_to_field(from) } else { from }
    }

    /// Returns the point of the world at a point of the field.
    pub fn to_world(&self, x: [f64; 3]) -> [f64; 3] {
        let x = if self.is_turned() { self.direction_to_world(x) } else { x };
        std::array::from_fn(|k| x[k] / self.scale + self.center[k])
    }

    /// Q·d of a direction of the world.
    pub fn direction_to_field(&self, d: [f64; 3]) -> [f64; 3] {
        self.rotation.map(|row| (row[0] * d[0] + row[1] * d[1]) + row[2] * d[2])
    }

    /// Qᵀ·d of a direction of the field.
    pub fn direction_to_world(&self, d: [f64; 3]) -> [f64; 3] {
        let q = &self.rotation;
        std::array::from_fn(|k| (q[0][k] * d[0] + q[1][k] * d[1]) + q[2][k] * d[2])
    }
}

impl Planes {
    /// Returns the number of features of a point.
    pub fn features(&self, combine: Combine) -> usize {
        if combine == Combine::Concat { 3 * self.channels } else { self.channels }
    }

    /// Returns the shape (P, S, S, C).
    pub fn shape(&self) -> [usize; 4] {
        [self.count, self.side, self.side, self.channels]
    }
}

impl Panoramas {
    /// Returns the shape (L, H, W, C').
    pub fn shape(&self) -> [usize; 4] {
        [self.levels, self.height, self.width, self.channels]
    }
}

impl Network {
    /// Returns the number of inputs.
    pub fn inputs(&self) -> usize {
        self.widths.first().copied().unwrap_or(0)
    }

    /// Returns the number of outputs.
    pub fn outputs(&self) -> usize {
        self.widths.last().copied().unwrap_or(0)
    }

    /// Returns the shape (outputs, inputs) and the weights of every layer.
    pub fn layers(&self) -> impl Iterator<Item = ([usize; 2], &[f32])> {
        self.weights.iter().zip(self.widths.windows(2)).map(|(w, n)| ([n[1], n[0]], w.as_slice()))
    }
}

impl Heads {
    /// Names of the heads, in the order of the fields.
    pub const NAMES: [&str; 6] = ["sdf", "color", "albedo", "material", "normal", "rho"];

    /// Returns the networks in the order of [`Self::NAMES`].
    pub fn all(&self) -> [Option<&Network>; 6] {
        let Self { sdf, color, albedo, material, normal, rho } = self;
        let of = Option::as_ref;
        [Some(sdf), of(color), of(albedo), of(material), of(normal), of(rho)]
    }

    /// Returns the networks in the order of [`Self::NAMES`], mutable.
    pub fn all_mut(&mut self) -> [Option<&mut Network>; 6] {
        let Self { sdf, color, albedo, material, normal, rho } = self;
        let of = Option::as_mut;
        [Some(sdf), of(color), of(albedo), of(material), of(normal), of(rho)]
    }

    /// Whether the network of the signed distance also gives the colour.
    pub fn is_trunk(&self) -> bool {
        self.sdf.outputs() == 4
    }
}

impl Field {
    /// Returns the digest of all arrays, settings and the placement, 16 hexadecimal digits.
    ///
    /// # Errors
    /// Returns an error if a number is NaN.
    pub fn digest(&self) -> Result<String> {
        let mut d = Digest::new();
        d.f32(&self.planes.shape(), &self.planes.values)?;
        if let Some(panoramas) = &self.panoramas {
            d.f32(&panoramas.shape(), &panoramas.values)?;
        }
        for (name, network) in Heads::NAMES.into_iter().zip(self.heads.all()) {
            for (shape, weights) in network.into_iter().flat_map(Network::layers) {
                d.bytes(name.as_bytes());
                d.f32(&shape, weights)?;
            }
        }
        d.bytes(self.settings.json().to_string().as_bytes());
        d.f64(&[3], &self.placement.center)?;
        d.f64(&[1], &[self.placement.scale])?;
        if self.placement.is_turned() {
            d.f64(&[3, 3], self.placement.rotation.as_flattened())?;
        }
        Ok(format!("{:016x}", d.value()))
    }
}

#[cfg(test)]
mod tests;
