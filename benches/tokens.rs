//! From images to tokens and back, in the sizes of LIRM's small model and at twice its width; beside each a bare product of the same size.
//!
//! `cargo bench --workspace --bench tokens`. An element is one operation (a product or a sum), so Gelem/s are GFLOP/s. The gradients are
//! those of training: all weights, and the tokens of `unpatch` and learned tokens of `fuse`; none of pixels or of the state.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lastlight::nn::{fuse, linear, tokens, unpatch};
use lastlight::num::rng::Rng;
use std::hint::black_box;

fn normals(n: usize, purpose: u16) -> Vec<f32> {
    let rng = Rng::new(1);
    (0..n).map(|i| rng.normal_f32(i as u64, 0, purpose, 0)).collect()
}

/// Times forward, forward with gradients, and a product (m, k)·(k, n), under one name.
fn timed(
    c: &mut Criterion,
    name: &str,
    [m, n, k]: [usize; 3],
    mut forward: impl FnMut(),
    mut both: impl FnMut(),
) {
    let (x, weight) = (normals(m * k, 1), normals(n * k, 2));
    let product = linear::In { x: &x, weight: &weight, bias: &[], m, n, k };
    let mut y = vec![0.0; m * n];
    let mut group = c.benchmark_group(name);
    group.sample_size(10).throughput(Throughput::Elements(2 * (m * n * k) as u64));
    group.bench_function("product", |b| b.iter(|| linear::forward(black_box(product), &mut y)));
    group.bench_function("forward", |b| b.iter(&mut forward));
    group.bench_function("forward with gradients", |b| b.iter(&mut both));
    group.finish();
}

fn tokens_of(c: &mut Criterion, side: usize, d: usize) {
    let shape = tokens::Shape { views: 4, height: side, width: side, patch: 8 };
    let pixels = 4 * side * side;
    let [image, rays, photo] = [(3, 3), (6, 4), (3, 5)].map(|(channels, p)| normals(channels * pixels, p));
    let [w_image, w_rays, w_photo] =
        [(3, 6), (6, 7), (3, 8)].map(|(channels, p)| normals(64 * channels * d, p));
    let row = normals(d, 9);
    let x = tokens::In {
        image: &image,
        rays: &rays,
        photo: &photo,
        w_image: &w_image,
        w_rays: &w_rays,
        w_photo: &w_photo,
        bias: &row,
        norm_gain: &row,
        norm_bias: &row,
        eps: 1e-6,
        shape,
    };
    let m = pixels / 64;
    let (mut y, y_bar) = (vec![0.0; m * d], normals(m * d, 10));
    let mut bar = tokens::InBar::zeros_like(&x);
    (bar.image, bar.rays, bar.photo) = (Vec::new(), Vec::new(), Vec::new());
    let mut other = y.clone();
    let forward = || drop(tokens::forward(&x, &mut y));
    let both = || {
        let saved = tokens::forward(&x, &mut other);
        tokens::adjoint(&x, &saved, &y_bar, &mut bar);
    };
    timed(c, &format!("tokens of 4 views of {side}x{side}, width {d}"), [m, d, 12 * 64], forward, both);
}

fn fuse_of(c: &mut Criterion, t: usize, d: usize) {
    let [state, position, w1, w2] = [t * d, t * d, 2 * d * d, d * d].map(|n| normals(n, 11));
    let row = normals(d, 12);
    let rule = fuse::Rule::Residual;
    let x = fuse::In { state: &state, position: &position, w1: &w1, b1: &row, w2: &w2, b2: &row, rule };
    let (mut y, y_bar) = (vec![0.0; t * d], normals(t * d, 13));
    let mut bar = fuse::InBar { state: Vec::new(), ..fuse::InBar::zeros_like(&x) };
    let mut other = y.clone();
    let forward = || drop(fuse::forward(&x, &mut y));
    let both = || {
        let saved = fuse::forward(&x, &mut other);
        fuse::adjoint(&x, &saved, &y_bar, &mut bar);
    };
    timed(c, &format!("fuse of {t} tokens, width {d}"), [t, d, 3 * d], forward, both);
}

fn unpatch_of(c: &mut Criterion, side: usize, d: usize, channels: usize) {
    let shape = unpatch::Shape { grids: 6, height: side, width: side, patch: 8, channels };
    let m = 6 * side * side;
    let (cells, weight, bias) = (normals(m * d, 14), normals(d * 64 * channels, 15), normals(channels, 16));
    let x = unpatch::In { tokens: &cells, weight: &weight, bias: &bias, shape };
    let (mut y, y_bar) = (vec![0.0; m * 64 * channels], normals(m * 64 * channels, 17));
    let mut bar = unpatch::InBar::zeros_like(&x);
    let mut other = y.clone();
    let forward = || unpatch::forward(&x, &mut y);
    let both = || {
        unpatch::forward(&x, &mut other);
        unpatch::adjoint(&x, &y_bar, &mut bar);
    };
    timed(
        c,
        &format!("unpatch of 6 grids of {side}x{side}, width {d}"),
        [m, 64 * channels, d],
        forward,
        both,
    );
}

fn all(c: &mut Criterion) {
    tokens_of(c, 64, 256);
    tokens_of(c, 256, 512);
    fuse_of(c, 400, 256);
    fuse_of(c, 1536, 512);
    unpatch_of(c, 8, 256, 16);
    unpatch_of(c, 16, 512, 32);
}

criterion_group!(benches, all);
criterion_main!(benches);
