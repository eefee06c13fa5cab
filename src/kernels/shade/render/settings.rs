//! How an image is rendered.

/// Most surfaces after the first: draws are told apart by 16 bits of (surface, transparent layer before it).
pub const MAX_BOUNCES: u32 = 254;

/// How surfaces reflect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Brdf {
    /// the material's ([`crate::shade::ggx`])
    #[default]
    MetallicRoughness,
    /// albedo/π, whatever roughness and metallic say
    Lambert,
}

/// How a picture is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// per pixel
    pub samples: u32,
    /// surfaces after the first that light may come by, at most [`MAX_BOUNCES`]; 0 = direct light only
    pub bounces: u32,
    /// of the draws; each of several views takes its own
    pub seed: u64,
    /// how surfaces reflect
    pub brdf: Brdf,
    /// whether the environment is seen behind the object; else the background is black, and colour is that of the object
    /// times its coverage
    pub environment_visible: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self { samples: 64, bounces: 1, seed: 0, brdf: Brdf::default(), environment_visible: true }
    }
}
