//! The renderer with the memory that a fit keeps between its renders.
//!
//! Every fit of Gaussians is a straight line and its reverse: activate → draw → compare, then the adjoints of these from
//! the last to the first ([`crate::fit::splat`]; a person's fit poses its Gaussians before it draws). This is the middle
//! of both.

use crate::splat::blend::Out;
use crate::splat::render::{self, In, InBar, OutBar, Saved, Scratch, Settings};

/// The last render of a fit and what its adjoint needs.
#[derive(Default)]
pub struct Workspace {
    /// Picture and coverage.
    pub out: Out,
    saved: Saved,
    scratch: Scratch,
    /// Memory of the largest gradient, (N, K, 3), while nobody reads it.
    sh_bar: Vec<f32>,
}

impl Workspace {
    /// Renders `x` into [`Self::out`].
    pub fn draw(&mut self, x: &In<'_>, settings: &Settings) {
        render::forward_into(x, settings, None, &mut self.out, &mut self.saved);
    }

    /// Gradients by `x`, which was drawn last with these settings.
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

    /// Takes the memory of a gradient by `sh` that has been used.
    pub fn give_back(&mut self, sh_bar: Vec<f32>) {
        self.sh_bar = sh_bar;
    }
}
