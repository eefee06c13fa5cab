//! One view on the tape: activate → render → 0.8·L1 + 0.2·(1 − SSIM).

use crate::fit::training::Watch;
use crate::loss;
use crate::scene::camera::Camera;
use crate::scene::gaussians::Gaussians;
use crate::splat::blend::Out;
use crate::splat::color::Sh;
use crate::splat::render::{Color, In, InBar, OutBar, Saved, Scratch, Settings, Shape};
use crate::splat::{activate, render};
use crate::tape::{Tape, Var};
use crate::{Error, Result};
use ndarray::{ArrayD, IxDyn};
use std::sync::{Arc, Mutex};

/// Weight of 1 − SSIM; L1 has the rest (3DGS, § 5.1).
pub(super) const SSIM_WEIGHT: f32 = 0.2;

/// Screen statistics of one view, for density control.
#[derive(Default)]
pub(super) struct Screen {
    /// (N, 2) in pixels, 0 where not visible
    pub(super) radii: Vec<[i32; 2]>,
    /// (N, 2) ∂L/∂means_px, or the sum over pixels of its absolute value
    pub(super) means_px_bar: Vec<[f32; 2]>,
}

/// What is compared with the render.
#[derive(Clone)]
pub(super) struct Target {
    pub(super) camera: Camera,
    /// (H, W, 3)
    pub(super) photo: Arc<ArrayD<f32>>,
    /// (H, W)
    pub(super) mask: Option<Arc<Vec<f32>>>,
}

/// How the view is drawn.
pub(super) struct Drawing<'a> {
    pub(super) settings: &'a Settings,
    pub(super) background: [f32; 3],
    /// SH bands in use
    pub(super) degree: usize,
}

/// Memory kept between iterations, so that none of it is asked for again.
#[derive(Default)]
pub(super) struct Workspace {
    saved: Saved,
    scratch: Scratch,
    /// Buffer of the largest gradient, (N, K, 3); whoever has used it puts it back.
    sh_bar: Vec<f32>,
    screen: Screen,
}

/// A workspace that a record on the tape can reach.
pub(super) type SharedWorkspace = Arc<Mutex<Workspace>>;

/// What a lock on a workspace may assume.
const LOCK: &str = "one thread runs the tape, and it has not panicked";

/// Puts the buffer of a used gradient of `sh` back.
pub(super) fn give_back(workspace: &SharedWorkspace, sh_bar: Vec<f32>) {
    workspace.lock().expect(LOCK).sh_bar = sh_bar;
}

/// Loss of one view, gradients of all stored parameters, screen statistics.
pub(super) struct Outcome {
    pub(super) loss: f32,
    pub(super) grad: Gaussians,
    pub(super) screen: Screen,
}

/// Rows of K values of an array in memory order.
pub(super) fn rows<const K: usize>(a: &ArrayD<f32>) -> &[[f32; K]] {
    let flat = a.as_slice().expect("parameters are kept in row-major order");
    flat.as_chunks().0
}

/// scales_log → scales, opacity_logits → opacities.
fn record_activate(tape: &mut Tape, scales_log: Var, opacity_logits: Var) -> [Var; 2] {
    let (x, o) = (tape.value(scales_log), tape.value(opacity_logits));
    let n = o.len();
    let (mut scales, mut opacities) = (vec![[0.0; 3]; n], vec![0.0; n]);
    activate::forward(rows(&x), o.as_slice().expect("row-major"), &mut scales, &mut opacities);
    let outputs = vec![array(&[n, 3], scales.clone().into_flattened()), array(&[n], opacities.clone())];
    let vars =
        tape.record("splat.activate", &[scales_log, opacity_logits], outputs, move |mut y_bar, x_bar| {
            let mut taken = |i: usize, len: usize| y_bar[i].take().map_or_else(|| vec![0.0; len], flat);
            let (scales_bar, opacities_bar) = (taken(0, 3 * n), taken(1, n));
            let (mut a, mut b) = (vec![[0.0; 3]; n], vec![0.0; n]);
            activate::adjoint(&scales, &opacities, scales_bar.as_chunks().0, &opacities_bar, &mut a, &mut b);
            x_bar[0].add(array(&[n, 3], a.into_flattened()));
            x_bar[1].add(array(&[n], b));
        });
    [vars[0], vars[1]]
}

fn array(shape: &[usize], values: Vec<f32>) -> ArrayD<f32> {
    ArrayD::from_shape_vec(IxDyn(shape), values).expect("the number of values is the product of the shape")
}

/// Row-major values, moved out.
fn flat(a: ArrayD<f32>) -> Vec<f32> {
    a.into_raw_vec_and_offset().0
}

/// Renders, differentiates, and gathers. `g` is the same afterwards: its largest array is lent to the tape meanwhile.
///
/// # Errors
/// When the view cannot be compared or the loss is not finite.
pub(super) fn evaluate(
    g: &mut Gaussians,
    target: &Target,
    drawing: &Drawing<'_>,
    workspace: &SharedWorkspace,
    watch: &mut dyn Watch,
) -> Result<Outcome> {
    let sh = Arc::new(array(&[g.len(), g.sh_coefficients(), 3], std::mem::take(&mut g.sh)));
    let outcome = on_tape(g, Arc::clone(&sh), target, drawing, workspace, watch);
    g.sh = flat(Arc::try_unwrap(sh).expect("the tape that shared it is gone"));
    outcome
}

fn on_tape(
    g: &Gaussians,
    sh: Arc<ArrayD<f32>>,
    target: &Target,
    drawing: &Drawing<'_>,
    workspace: &SharedWorkspace,
    watch: &mut dyn Watch,
) -> Result<Outcome> {
    let n = g.len();
    let mut tape = Tape::new();
    let means = tape.leaf("means", array(&[n, 3], g.means.as_flattened().to_vec()));
    let quats = tape.leaf("quats", array(&[n, 4], g.quats.as_flattened().to_vec()));
    let scales_log = tape.leaf("scales_log", array(&[n, 3], g.scales_log.as_flattened().to_vec()));
    let opacity_logits = tape.leaf("opacity_logits", array(&[n], g.opacity_logits.clone()));
    let sh = tape.leaf("sh", sh);
    let [scales, opacities] = record_activate(&mut tape, scales_log, opacity_logits);
    let inputs = [means, quats, scales, opacities, sh];
    let image = record_render(&mut tape, inputs, &target.camera, drawing, workspace);
    watch.lap("render");
    let photo = tape.constant(Arc::clone(&target.photo));
    let l1 = record_loss(&mut tape, "loss.l1", image, photo, target, loss::l1::forward, loss::l1::adjoint)?;
    let ssim =
        record_loss(&mut tape, "loss.ssim", image, photo, target, loss::ssim::forward, loss::ssim::adjoint)?;
    watch.lap("loss");
    // 0.8 L1 + 0.2 (1 − SSIM); the constant has no gradient and joins the value alone.
    let total = tape.weighted_sum(&[(l1, 1.0 - SSIM_WEIGHT), (ssim, -SSIM_WEIGHT)]);
    let loss = tape.scalar(total) + SSIM_WEIGHT;
    if !loss.is_finite() {
        return Err(Error::check("splat fit").at("loss").expected("a finite number").got(loss.to_string()));
    }
    let mut grads = tape.backward_scalar(total);
    let mut take = |name: &str| flat(grads.take(name).expect("every leaf has a gradient"));
    let grad = Gaussians::from_columns(g.sh_degree, |column| Ok(take(column.name())))?;
    watch.lap("adjoint");
    let screen = std::mem::take(&mut workspace.lock().expect(LOCK).screen);
    Ok(Outcome { loss, grad, screen })
}

/// means, quats, scales, opacities, sh → image (H, W, 3); the adjoint leaves the screen statistics in `workspace`.
fn record_render(
    tape: &mut Tape,
    vars: [Var; 5],
    camera: &Camera,
    drawing: &Drawing<'_>,
    workspace: &SharedWorkspace,
) -> Var {
    let values = vars.map(|v| tape.value(v));
    let (settings, degree, background) = (drawing.settings.clone(), drawing.degree, drawing.background);
    let camera = camera.clone();
    let shape = [camera.height, camera.width, 3];
    let (mut out, mut saved) = (Out::default(), std::mem::take(&mut workspace.lock().expect(LOCK).saved));
    render::forward_into(&input(&values, &camera, degree, background), &settings, None, &mut out, &mut saved);
    let workspace = Arc::clone(workspace);
    let image = array(&shape, out.image);
    tape.record("splat.render", &vars, vec![image], move |mut y_bar, x_bar| {
        let Some(image_bar) = y_bar[0].take() else { return };
        let x = input(&values, &camera, degree, background);
        let workspace = &mut *workspace.lock().expect(LOCK);
        let mut bar = InBar { sh: std::mem::take(&mut workspace.sh_bar), ..InBar::default() };
        bar.reset(&x);
        let out_bar = OutBar { image: image_bar.as_slice(), ..OutBar::default() };
        render::adjoint_into(&x, &settings, None, &saved, out_bar, &mut bar, &mut workspace.scratch);
        let n = x.means.len();
        x_bar[0].add(array(&[n, 3], bar.means.into_flattened()));
        x_bar[1].add(array(&[n, 4], bar.quats.into_flattened()));
        x_bar[2].add(array(&[n, 3], bar.scales.into_flattened()));
        x_bar[3].add(array(&[n], bar.opacities));
        x_bar[4].add(array(values[4].shape(), bar.sh));
        let means_px_bar = if settings.absgrad { bar.means_px_abs } else { bar.means_px };
        workspace.screen = Screen { radii: saved.radii(), means_px_bar };
        workspace.saved = saved;
    })[0]
}

fn input<'a>(
    values: &'a [Arc<ArrayD<f32>>; 5],
    camera: &'a Camera,
    degree: usize,
    background: [f32; 3],
) -> In<'a> {
    let [means, quats, scales, opacities, sh] = values;
    In {
        means: rows(means),
        shape: Shape::QuatScale { quats: rows(quats), scales: rows(scales) },
        opacities: opacities.as_slice().expect("row-major"),
        color: Color::Sh(Sh {
            values: sh.as_slice().expect("row-major"),
            coefficients: sh.shape()[1],
            degree,
        }),
        cameras: std::slice::from_ref(camera),
        background,
    }
}

/// A loss between the render and the photograph; both have the same signature.
fn record_loss<S: Send + 'static>(
    tape: &mut Tape,
    name: &'static str,
    image: Var,
    photo: Var,
    target: &Target,
    forward: impl Fn(&loss::In<'_>) -> Result<(f32, S)>,
    adjoint: impl Fn(&loss::In<'_>, &S, f32, &mut [f32], Option<&mut [f32]>) + Send + 'static,
) -> Result<Var> {
    let (x, y) = (tape.value(image), tape.value(photo));
    let mask = target.mask.clone();
    let (height, width) = (target.camera.height, target.camera.width);
    let (value, saved) = forward(&pair(&x, &y, mask.as_deref(), height, width))?;
    let out = ArrayD::from_elem(IxDyn(&[]), value);
    let var = tape.record(name, &[image, photo], vec![out], move |mut value_bar, x_bar| {
        let Some(value_bar) = value_bar[0].take() else { return };
        let g = value_bar.first().copied().expect("a loss is one number");
        let into = x_bar[0].accumulator();
        let into = into.as_slice_mut().expect("row-major");
        adjoint(&pair(&x, &y, mask.as_deref(), height, width), &saved, g, into, None);
    })[0];
    Ok(var)
}

fn pair<'a>(
    x: &'a ArrayD<f32>,
    y: &'a ArrayD<f32>,
    mask: Option<&'a Vec<f32>>,
    height: usize,
    width: usize,
) -> loss::In<'a> {
    loss::In {
        x: x.as_slice().expect("row-major"),
        y: y.as_slice().expect("row-major"),
        mask: mask.map(Vec::as_slice),
        height,
        width,
    }
}
