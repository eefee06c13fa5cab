//! One view: activate → draw → 0.8·L1 + 0.2·(1 − SSIM), and the adjoints of these from the last to the first.

use crate::fit::drawing::Workspace;
use crate::fit::training::Watch;
use crate::loss;
use crate::scene::camera::Camera;
use crate::scene::gaussians::Gaussians;
use crate::splat::activate;
use crate::splat::color::Sh;
use crate::splat::render::{Color, In, OutBar, Settings, Shape};
use crate::{Error, Result};
use std::sync::Arc;

/// Weight of 1 − SSIM; that of L1 is 1 minus this (3DGS, § 5.1).
pub(super) const SSIM_WEIGHT: f32 = 0.2;

/// Screen statistics of one view, for density control.
pub(super) struct Screen {
    /// (N, 2) in pixels, 0 where not visible
    pub(super) radii: Vec<[i32; 2]>,
    /// (N, 2) ∂L/∂means_px, or the sum over pixels of its absolute value
    pub(super) means_px_bar: Vec<[f32; 2]>,
}

/// The image to compare with the render.
#[derive(Clone)]
pub(super) struct Target {
    pub(super) camera: Camera,
    /// (H, W, 3)
    pub(super) photo: Arc<Vec<f32>>,
    /// (H, W)
    pub(super) mask: Option<Arc<Vec<f32>>>,
}

/// Render settings of a view.
pub(super) struct Drawing<'a> {
    pub(super) settings: &'a Settings,
    pub(super) background: [f32; 3],
    /// SH bands in use
    pub(super) degree: usize,
}

/// Loss of one view, gradients of all stored parameters, screen statistics.
pub(super) struct Outcome {
    pub(super) loss: f32,
    pub(super) grad: Gaussians,
    pub(super) screen: Screen,
}

impl Target {
    /// Loss of a render (H, W, 3) and its gradient by the render.
    fn compare(&self, image: &[f32]) -> Result<(f32, Vec<f32>)> {
        let pair = loss::In {
            x: image,
            y: &self.photo,
            mask: self.mask.as_ref().map(|m| &m[..]),
            height: self.camera.height,
            width: self.camera.width,
        };
        let (l1, l1_saved) = loss::l1::forward(&pair)?;
        let (ssim, ssim_saved) = loss::ssim::forward(&pair)?;
        let loss = (l1 * (1.0 - SSIM_WEIGHT) + ssim * -SSIM_WEIGHT) + SSIM_WEIGHT;
        if !loss.is_finite() {
            return Err(Error::check("splat fit")
                .at("loss")
                .expected("a finite number")
                .got(loss.to_string()));
        }
        let mut image_bar = vec![0.0; image.len()];
        loss::ssim::adjoint(&pair, &ssim_saved, -SSIM_WEIGHT, &mut image_bar, None);
        loss::l1::adjoint(&pair, &l1_saved, 1.0 - SSIM_WEIGHT, &mut image_bar, None);
        Ok((loss, image_bar))
    }
}

/// Renders the Gaussians, computes the loss, and propagates gradients back to all stored parameters.
///
/// # Errors
/// When the view cannot be compared or the loss is not finite.
pub(super) fn pass(
    g: &Gaussians,
    target: &Target,
    drawing: &Drawing<'_>,
    work: &mut Workspace,
    watch: &mut dyn Watch,
) -> Result<Outcome> {
    let n = g.len();
    let (mut scales, mut opacities) = (vec![[0.0; 3]; n], vec![0.0; n]);
    activate::forward(&g.scales_log, &g.opacity_logits, &mut scales, &mut opacities);
    let x = In {
        means: &g.means,
        shape: Shape::QuatScale { quats: &g.quats, scales: &scales },
        opacities: &opacities,
        color: Color::Sh(Sh { values: &g.sh, coefficients: g.sh_coefficients(), degree: drawing.degree }),
        cameras: std::slice::from_ref(&target.camera),
        background: drawing.background,
    };
    work.draw(&x, drawing.settings);
    watch.lap("render");
    let (loss, image_bar) = target.compare(&work.out.image)?;
    watch.lap("loss");
    let out_bar = OutBar { image: Some(&image_bar), ..OutBar::default() };
    let bar = work.adjoint(&x, drawing.settings, out_bar);
    let (mut scales_log, mut opacity_logits) = (vec![[0.0; 3]; n], vec![0.0; n]);
    activate::adjoint(&scales, &opacities, &bar.scales, &bar.opacities, &mut scales_log, &mut opacity_logits);
    watch.lap("adjoint");
    let means_px_bar = if drawing.settings.absgrad { bar.means_px_abs } else { bar.means_px };
    Ok(Outcome {
        loss,
        grad: Gaussians {
            means: bar.means,
            quats: bar.quats,
            scales_log,
            opacity_logits,
            sh: bar.sh,
            sh_degree: g.sh_degree,
        },
        screen: Screen { radii: work.radii(), means_px_bar },
    })
}
