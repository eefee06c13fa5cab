//! One render of a moment and its adjoint.

use super::super::guide::{Guide, Window, nowhere};
use super::super::light::Moment;
use super::super::person::Rig;
use super::super::prior;
use super::super::view::Target;
use super::PersonFit;
use super::request::{BLIND, RenderResult, Request};
use crate::Result;
use crate::fit::training::Watch;
use crate::shade::{gain, over_black};
use crate::splat::render::{self, OutBar};

impl<'a> PersonFit<'a> {
    /// The guide and its window on an image.
    pub(super) fn window(&self, target: &Target) -> Result<Option<(&'a dyn Guide, Window)>> {
        let Some(guide) = self.guide else { return Ok(None) };
        let size = [target.camera.height, target.camera.width];
        let square = guide.framing().square(size, target.person);
        let square = square.ok_or_else(|| nowhere(&format!("an image of moment {}", target.time)))?;
        Ok(Some((guide, square.window(guide.side(), size))))
    }

    /// Renders the Gaussians at a moment, computes the loss and propagates its gradients back to the
    /// parameters.
    pub(super) fn pass(
        &mut self,
        target: &Target,
        rig: &Rig,
        want: Request,
        watch: &mut dyn Watch,
    ) -> Result<RenderResult> {
        let light = self.avatar.light.as_ref().map(|l| l.at(Some(target.time)));
        let placed = self.avatar.place(rig, light.unwrap_or_default());
        let background = want.background;
        let x = render::In { background, ..self.avatar.input(&placed, &target.camera, want.degree) };
        watch.lap("pose");
        let mut work = std::mem::take(&mut self.work);
        work.draw(&x, &self.avatar.render);
        self.tally.renders += 1;
        let gain = light.map(|l| l.gain);
        if let Some(gain) = gain {
            let x = gain::In { alpha: &work.out.alpha, background, gain };
            gain::forward(&x, &mut work.out.image);
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
            over_black::forward(&work.out.alpha, background, &mut seen);
            let (value, bar) = guide.discrepancy(&window.take(&seen), &window.take(&target.photo))?;
            let mut image_bar = vec![0.0; seen.len()];
            window.spread(&bar, &mut image_bar);
            let blind = image_bar.chunks_exact(3).filter(|g| g.iter().all(|x| x.abs() < BLIND)).count();
            self.tally.encodings += 1;
            self.tally.gradients += 1;
            self.tally.blind += blind as f64 / (image_bar.len() / 3) as f64;
            let mut alpha_bar = vec![0.0; work.out.alpha.len()];
            over_black::alpha_adjoint(background, &image_bar, &mut alpha_bar);
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
                    let x = gain::In { alpha: &work.out.alpha, background, gain };
                    gain::adjoint(&x, &work.out.image, width, &mut image_bar, &mut alpha_bar);
                }
                let out_bar =
                    OutBar { image: Some(&image_bar), alpha: Some(&alpha_bar), ..OutBar::default() };
                let bar = work.adjoint(&x, &self.avatar.render, out_bar);
                work.give_back(bar.sh);
                latent = Some(bar.means);
                watch.lap("latent adjoint");
            }
        }
        let gain = gain.map(|gain| {
            let bars = (&mut compared.image_bar, &mut compared.alpha_bar);
            let x = gain::In { alpha: &work.out.alpha, background, gain };
            gain::adjoint(&x, &work.out.image, width, bars.0, bars.1)
        });
        let out_bar = OutBar {
            image: Some(&compared.image_bar),
            alpha: Some(&compared.alpha_bar),
            ..OutBar::default()
        };
        let mut bar = work.adjoint(&x, &self.avatar.render, out_bar);
        watch.lap("adjoint");
        let (means_px, radii) = (std::mem::take(&mut bar.means_px), work.radii());
        let mut grad = self.avatar.adjoint(rig, &placed, bar, want.networks);
        self.work = work;
        let light = gain.map(|gain| Moment { gain, toward: grad.toward });
        let reach = self.settings.density.prune_distance_m / self.avatar.body.template.unit_m;
        let assumed = prior::add(&self.settings.prior, &self.avatar, &self.near, reach, &mut grad.gaussians);
        watch.lap("pose");
        let loss = compared.loss + assumed as f32;
        Ok(RenderResult { loss, grad, light, means_px, radii, latent })
    }
}
