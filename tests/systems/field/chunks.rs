//! One result for any number of threads and any number of rays in memory.

use super::{digest, finish, new, settings, targets};
use lastlight::field::render::{self, InBar, OutBar, Plan};
use lastlight::fit::field::scene::Weights;
use lastlight::fit::field::{Settings, view};
use lastlight::fit::training::History;
use lastlight::loss::{In, mse, ssim};
use lastlight::num::par;

#[test]
fn threads_and_chunks_of_rays_change_no_bit() {
    let targets = targets();
    // 512 rays an iteration
    let run = |threads: usize, chunk: usize| {
        let run = || {
            let mut fit = new(Settings { chunk, embedding: true, ..settings() }, &targets);
            let mut history = History::default();
            finish(&mut fit, &mut history, None);
            let field = fit.field().digest().expect("finite");
            (digest(&fit), field, history.loss.iter().map(|x| x.to_bits()).collect::<Vec<u32>>())
        };
        par::with_threads(threads, run).expect("threads start")
    };
    let first = run(1, 4096);
    for (threads, chunk) in [(1, 64), (2, 256), (3, 64), (7, 4096)] {
        assert!(run(threads, chunk) == first, "{threads} threads, {chunk} rays");
    }
}

#[test]
fn gradients_of_a_complete_image_are_those_by_chunks() {
    let targets = targets();
    let mut fit = new(Settings { embedding: true, iterations: 4, ..settings() }, &targets);
    finish(&mut fit, &mut History::default(), None);
    let target = &targets.train[1];
    let weights = Weights::of(fit.field());
    let list = view::rays(&target.camera);
    let scene = weights.scene(list.borrowed());
    let mut plan = Plan::new(scene.all_intervals());
    let out = render::forward(&scene, &mut plan);
    // A loss in which every pixel depends on its neighbours.
    let (channels, n) = (scene.channels(), out.opacity.len());
    let q = out.values.len() / n;
    let at = channels.color.expect("a head of colours");
    let x: Vec<f32> = out.values.chunks_exact(q).flat_map(|v| v[at..at + 3].to_vec()).collect();
    let [height, width] = [target.camera.height, target.camera.width];
    let pair = In { x: &x, y: &target.color, mask: None, height, width };
    let mut colors = vec![0.0; x.len()];
    let (_, saved) = ssim::forward(&pair).expect("a score");
    ssim::adjoint(&pair, &saved, -1.0, &mut colors, None);
    let (_, saved) = mse::forward(&pair).expect("a loss");
    mse::adjoint(&pair, &saved, 1.0, &mut colors, None);
    let mut values = vec![0.0; out.values.len()];
    for (row, color) in values.chunks_exact_mut(q).zip(colors.chunks_exact(3)) {
        row[at..at + 3].copy_from_slice(color);
    }
    let opacity: Vec<f32> = out.opacity.iter().zip(&target.foreground).map(|(o, m)| o - m).collect();
    let gradients = |chunk: usize| {
        let mut bar = InBar::zeros_like(&scene);
        let out_bar = OutBar { values: &values, opacity: &opacity, ..OutBar::default() };
        render::adjoint(&scene, &plan, &out, &out_bar, chunk, &mut bar);
        bar
    };
    let whole = gradients(n);
    let moves = |x: &[f32]| x.iter().any(|g| *g != 0.0);
    assert!(moves(&whole.planes) && moves(&whole.panoramas) && whole.beta != 0.0, "there is a gradient");
    for chunk in [1, 64, 100, 192, 256] {
        assert!(gradients(chunk) == whole, "{chunk} rays at a time");
    }
}
