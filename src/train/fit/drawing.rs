//! The renderer with the buffers that a fit keeps between renders.
//!
//! Every fit of Gaussians activates, renders and compares, then runs the adjoints of these steps in reverse
//! order ([`crate::fit::splat`]; the fit of a person also poses its Gaussians before rendering). This file
//! contains the rendering step and its adjoint.

use crate::splat::blend::Out;
use crate::splat::render::{self, In, InBar, OutBar, Saved, Scratch, Settings};

/// The last render of a fit and the data that its adjoint needs.
#[derive(Default)]
pub struct Workspace {
    /// Image and coverage.
    pub out: Out,
    saved: Saved,
    scratch: Scratch,
    /// Buffer of the largest gradient, (N, K, 3), while it is not in use.
    sh_bar: Vec<f32>,
}

impl Workspace {
    /// Renders `x` into [`Self::out`].
    pub fn draw(&mut self, x: &In<'_>, settings: &Settings) {
        render::forward_into(x, settings, None, &mut self.out, &mut self.saved);
    }

    /// Gradients with respect to `x`, which must have been rendered last with these settings.
    pub fn adjoint(&mut self, x: &In<'_>, settings: &Settings, out_bar: OutBar<'_>) -> InBar {
        let mut bar = InBar { sh: std::mem::take(&mut self.sh_bar), ..InBar::default() };
        bar.reset(x);
        render::adjoint_into(x, settings, None, &self.saved, out_bar, &mut bar, &mut self.scratch);
        bar
    }

    /// (N, 2) radii of the last render in pixels, 0 where a Gaussian is not visible.
    pub fn radii(&self) -> Vec<[i32; 2]> {
        self.saved.radii()
    }

    /// Takes back the buffer of a gradient with respect to `sh` after use.
    pub fn give_back(&mut self, sh_bar: Vec<f32>) {
        self.sh_bar = sh_bar;
    }
}
