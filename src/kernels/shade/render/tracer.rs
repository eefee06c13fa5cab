//! Data shared by all paths of a render: the scene, the settings and the draws.

use super::scene::Scene;
use super::settings::Settings;
use crate::num::rng::{self, Rng};

/// Purposes of the draws made here (see `num::rng`).
pub(super) const CAMERA: u16 = 0x0505;
pub(super) const LIGHT: u16 = 0x0502;
pub(super) const SCATTER: u16 = 0x0503;
pub(super) const OPACITY: u16 = 0x0504;
pub(super) const EMITTER: u16 = 0x0506;

/// Traces paths through a scene. Its methods are in the files `visibility`, `light`, `scatter` and `trace`.
pub(super) struct Tracer<'a> {
    pub(super) scene: &'a Scene<'a>,
    pub(super) settings: &'a Settings,
    pub(super) rng: Rng,
}

/// Returns the uniform of one word: (m + ½)·2⁻²³.
#[inline(always)]
pub(super) fn uniform(word: u32) -> f32 {
    rng::uniform_f32([word, 0, 0, 0])
}
