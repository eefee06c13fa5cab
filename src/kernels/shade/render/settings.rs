//! Settings of the renderer.

/// Largest number of surfaces after the first: 16 bits of (surface, transparent layer before it) identify a
/// draw.
pub const MAX_BOUNCES: u32 = 254;

/// Reflection model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Brdf {
    /// The BRDF of the material ([`crate::shade::ggx`]).
    #[default]
    MetallicRoughness,
    /// Lambertian reflection, albedo/π, regardless of roughness and metallic.
    Lambert,
}

/// Settings of the renderer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Number of samples per pixel.
    pub samples: u32,
    /// Number of surfaces after the first that light may be reflected by, at most [`MAX_BOUNCES`]; 0 = direct
    /// light only.
    pub bounces: u32,
    /// Seed of the random numbers; each of several views needs its own.
    pub seed: u64,
    /// Reflection model.
    pub brdf: Brdf,
    /// Whether the environment is visible behind the object; otherwise the background is black, and the
    /// colour is that of the object times its coverage.
    pub environment_visible: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self { samples: 64, bounces: 1, seed: 0, brdf: Brdf::default(), environment_visible: true }
    }
}
