//! One render of a moment and everything that comes back from it.

use super::super::avatar::{Grad, Rig};
use super::super::guide::{Guide, Window, nowhere};
use super::super::light::{self, Moment};
use super::super::prior;
use super::super::view::Target;
use super::{BLIND, PersonFit};
use crate::Result;
use crate::fit::training::Watch;
use crate::splat::render::{self, InBar, Out, OutBar, Saved, Scratch};

/// Memory kept between renders.
#[derive(Default)]
pub(super) struct Workspace {
    pub(super) out: Out,
    pub(super) saved: Saved,
    pub(super) scratch: Scratch,
}

/// One render and what came back from it.
pub(super) struct Passed {
    pub(super) loss: f32,
    pub(super) grad: Grad,
    /// by the light of the moment
    pub(super) light: Option<Moment>,
    pub(super) means_px: Vec<[f32; 2]>,
    pub(super) radii: Vec<[i32; 2]>,
    /// (G, 3) ∂L_lat/∂μ_world, where asked for
    pub(super) latent: Option<Vec<[f32; 3]>>,
}

/// How to render, and what to make of it.
#[derive(Clone, Copy)]
pub(super) struct Want {
    /// SH bands in use
    pub(super) degree: usize,
    /// behind the person
    pub(super) background: [f32; 3],
    /// gradients of L_lat by the posed centres
    pub(super) latent: bool,
    /// gradients of the networks
    pub(super) networks: bool,
}

impl<'a> PersonFit<'a> {
    /// The guide and its window on a picture.
    pub(super) fn window(&self, target: &Target) -> Result<Option<(&'a dyn Guide, Window)>> {
        let Some(guide) = self.guide else { return Ok(None) };
        let size = [target.camera.height, target.camera.width];
        let square = guide.framing().square(size, target.person);
        let square = square.ok_or_else(|| nowhere(&format!("a picture of moment {}", target.time)))?;
        Ok(Some((guide, Window::new(guide.side(), size, square))))
    }

    /// Renders the Gaussians at a moment, compares, and goes all the way back.
    pub(super) fn pass(
        &mut self,
        target: &Target,
        rig: &Rig,
        want: Want,
        watch: &mut dyn Watch,
    ) -> Result<Passed> {
        let light = self.avatar.light.as_ref().map(|l| l.at(Some(target.time)));
        let placed = self.avatar.place(rig, light.unwrap_or_default());
        let background = want.background;
        let x = render::In { background, ..self.avatar.input(&placed, &target.camera, want.degree) };
        watch.lap("pose");
        let mut work = std::mem::take(&mut self.work);
        render::forward_into(&x, &self.avatar.render, None, &mut work.out, &mut work.saved);
        self.tally.renders += 1;
        let gain = light.map(|l| l.gain);
        if let Some(gain) = gain {
            light::apply(&mut work.out, background, gain);
        }
        watch.lap("render");
        let width = target.camera.width;
        let mut compared = target.compare(&work.out, background, &self.settings)?;
        watch.lap("loss");
        let mut latent = None;
        if (want.latent || self.settings.latent_weight > 0.0)
            && let Some((guide, window)) = self.window(target)?
        {
            let mut seen = work.out.image.clone();
            before_black(&mut seen, &work.out.alpha, background);
            let (value, bar) = guide.discrepancy(&window.take(&seen), &window.take(&target.photo))?;
            let image_bar = window.spread(&bar);
            let blind = image_bar.chunks_exact(3).filter(|g| g.iter().all(|x| x.abs() < BLIND)).count();
            self.tally.encodings += 1;
            self.tally.gradients += 1;
            self.tally.blind += blind as f64 / (image_bar.len() / 3) as f64;
            let mut alpha_bar: Vec<f32> = (image_bar.chunks_exact(3))
                .map(|g| (g[0] * background[0] + g[1] * background[1]) + g[2] * background[2])
                .collect();
            watch.lap("latent discrepancy");
            if self.settings.latent_weight > 0.0 {
                let w = self.settings.latent_weight;
                compared.loss += w * value as f32;
                for (to, from) in compared.image_bar.iter_mut().zip(&image_bar) {
                    *to += w * from;
                }
                for (to, from) in compared.alpha_bar.iter_mut().zip(&alpha_bar) {
                    *to += w * from;
                }
            }
            if want.latent {
                let mut image_bar = image_bar.clone();
                if let Some(gain) = gain {
                    light::adjoint(&work.out, width, background, gain, &mut image_bar, &mut alpha_bar);
                }
                let mut bar = InBar::zeros_like(&x);
                let out_bar =
                    OutBar { image: Some(&image_bar), alpha: Some(&alpha_bar), ..OutBar::default() };
                render::adjoint_into(
                    &x,
                    &self.avatar.render,
                    None,
                    &work.saved,
                    out_bar,
                    &mut bar,
                    &mut work.scratch,
                );
                latent = Some(bar.means);
                watch.lap("latent adjoint");
            }
        }
        let gain = gain.map(|gain| {
            let bars = (&mut compared.image_bar, &mut compared.alpha_bar);
            light::adjoint(&work.out, width, background, gain, bars.0, bars.1)
        });
        let mut bar = InBar::zeros_like(&x);
        let out_bar = OutBar {
            image: Some(&compared.image_bar),
            alpha: Some(&compared.alpha_bar),
            ..OutBar::default()
        };
        render::adjoint_into(
            &x,
            &self.avatar.render,
            None,
            &work.saved,
            out_bar,
            &mut bar,
            &mut work.scratch,
        );
        watch.lap("adjoint");
        let (means_px, radii) = (std::mem::take(&mut bar.means_px), work.saved.radii());
        let mut grad = self.avatar.adjoint(rig, &placed, bar, want.networks);
        self.work = work;
        let light = gain.map(|gain| Moment { gain, toward: grad.toward });
        let reach = self.settings.density.prune_distance_m / self.avatar.body.template.unit_m;
        let assumed = prior::add(&self.settings.prior, &self.avatar, &self.near, reach, &mut grad.gaussians);
        watch.lap("pose");
        let loss = compared.loss + assumed as f32;
        Ok(Passed { loss, grad, light, means_px, radii, latent })
    }
}

/// Takes the background out of a render, since the model knows people before black: x − (1 − α) b.
pub(super) fn before_black(image: &mut [f32], alpha: &[f32], background: [f32; 3]) {
    for (rgb, a) in image.chunks_exact_mut(3).zip(alpha) {
        for k in 0..3 {
            rgb[k] -= (1.0 - a) * background[k];
        }
    }
}
