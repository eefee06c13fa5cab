//! The losses of one training iteration at 480×270, beside a plain version of SSIM, and one optimiser step.
//!
//! `cargo bench --workspace --bench loss`. Compare ratios of one run, never absolute times of two machines.

use criterion::{Criterion, criterion_group, criterion_main};
use lastlight::loss::{In, l1, metric, ssim};
use lastlight::math::knn;
use lastlight::num::par;
use lastlight::optim::adam::Rule;
use lastlight::optim::groups::{Groups, Rates};
use lastlight::optim::mcmc;
use lastlight::scene::gaussians::Gaussians;
use std::hint::black_box;

const HEIGHT: usize = 270;
const WIDTH: usize = 480;

fn picture(seed: u32) -> Vec<f32> {
    let mut s = seed;
    (0..HEIGHT * WIDTH * 3)
        .map(|i| {
            s = s.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            0.5 * ((i / 3 % WIDTH) as f32 / WIDTH as f32) + 0.5 * ((s >> 8) as f32 / 16_777_216.0)
        })
        .collect()
}

/// SSIM value with 121 taps per value and moment, no separation, no lanes, one thread.
fn plain(x: &[f32], y: &[f32]) -> f32 {
    let window: Vec<f32> = (0..121)
        .map(|k| {
            (ssim::WINDOW[5 - (k / 11i32 - 5).unsigned_abs() as usize]
                * ssim::WINDOW[5 - (k % 11 - 5).unsigned_abs() as usize]) as f32
        })
        .collect();
    let mut total = 0.0f64;
    for r in 0..HEIGHT as i32 {
        for c in 0..WIDTH as i32 {
            for ch in 0..3 {
                let mut e = [0.0f32; 5];
                for i in 0..11 {
                    for j in 0..11 {
                        let (rr, cc) = (r + i - 5, c + j - 5);
                        if rr >= 0 && cc >= 0 && rr < HEIGHT as i32 && cc < WIDTH as i32 {
                            let at = (rr as usize * WIDTH + cc as usize) * 3 + ch;
                            let (w, a, b) = (window[(i * 11 + j) as usize], x[at], y[at]);
                            e[0] += w * a;
                            e[1] += w * b;
                            e[2] += w * a * a;
                            e[3] += w * b * b;
                            e[4] += w * a * b;
                        }
                    }
                }
                let [a, b, aa, bb, ab] = e;
                let l = (2.0 * a * b + 1e-4) / (a * a + b * b + 1e-4);
                let s = (2.0 * (ab - a * b) + 9e-4) / (aa - a * a + bb - b * b + 9e-4);
                total += f64::from(l * s);
            }
        }
    }
    (total / (HEIGHT * WIDTH * 3) as f64) as f32
}

fn losses(c: &mut Criterion) {
    let (x, y) = (picture(1), picture(2));
    let input = In { x: &x, y: &y, mask: None, height: HEIGHT, width: WIDTH };
    let mask: Vec<f32> = (0..HEIGHT * WIDTH).map(|i| f32::from(u8::from(i % 7 != 0))).collect();
    let mut group = c.benchmark_group("480x270x3");
    group.sample_size(10);
    let mut x_bar = vec![0.0f32; x.len()];
    let mut y_bar = vec![0.0f32; x.len()];
    group.bench_function("ssim forward+adjoint(x)", |b| {
        b.iter(|| {
            let (value, saved) = ssim::forward(&input).expect("sizes fit");
            ssim::adjoint(&input, &saved, -0.2, &mut x_bar, None);
            black_box(value)
        });
    });
    group.bench_function("ssim forward+adjoint(x), masked", |b| {
        let input = In { mask: Some(&mask), ..input };
        b.iter(|| {
            let (value, saved) = ssim::forward(&input).expect("sizes fit");
            ssim::adjoint(&input, &saved, -0.2, &mut x_bar, None);
            black_box(value)
        });
    });
    group.bench_function("ssim forward+adjoint(x, y)", |b| {
        b.iter(|| {
            let (value, saved) = ssim::forward(&input).expect("sizes fit");
            ssim::adjoint(&input, &saved, -0.2, &mut x_bar, Some(&mut y_bar));
            black_box(value)
        });
    });
    group.bench_function("ssim forward", |b| {
        b.iter(|| black_box(ssim::forward(&input).expect("sizes fit").0))
    });
    group.bench_function("ssim forward, plain", |b| b.iter(|| black_box(plain(&x, &y))));
    group.bench_function("ssim metric (f64)", |b| {
        b.iter(|| black_box(metric::ssim::forward(&input).expect("sizes fit")))
    });
    group.bench_function("l1 forward+adjoint(x)", |b| {
        b.iter(|| {
            let (value, saved) = l1::forward(&input).expect("sizes fit");
            l1::adjoint(&input, &saved, 0.8, &mut x_bar, None);
            black_box(value)
        });
    });
    group.finish();
}

fn optimiser(c: &mut Criterion) {
    let n = 100_000;
    let zeros = |k: usize| Gaussians {
        means: vec![[0.5; 3]; n],
        quats: vec![[0.5; 4]; n],
        scales_log: vec![[-5.0; 3]; n],
        opacity_logits: vec![0.0; n],
        sh: vec![0.1; 3 * k * n],
        sh_degree: 3,
    };
    let (mut g, grad) = (zeros(16), zeros(16));
    let rates = Rates::splat(1e-4);
    let mut group = c.benchmark_group("100000 Gaussians x 59");
    group.sample_size(20);
    let mut all = Groups::new(Rule::SPLAT, &g).expect("the rule is valid");
    group.bench_function("adam step", |b| b.iter(|| all.step(&mut g, &grad, &rates, None).expect("finite")));
    let active: Vec<u8> = (0..n).map(|i| u8::from(i * 7 % 10 < 6)).collect();
    group.bench_function("adam step, 6 rows of 10, counters apart", |b| {
        b.iter(|| all.step(&mut g, &grad, &rates, Some(&active)).expect("finite"));
    });
    // The floor: the same bytes (read four arrays, write three) with nothing else done.
    let len = 59 * n;
    let (mut p, mut m, mut v, d) =
        (vec![0.0f32; len], vec![0.0f32; len], vec![0.0f32; len], vec![1.0f32; len]);
    group.bench_function("the same memory traffic alone", |b| {
        b.iter(|| {
            let tasks: Vec<_> = p
                .chunks_mut(16_384)
                .zip(m.chunks_mut(16_384))
                .zip(v.chunks_mut(16_384))
                .zip(d.chunks(16_384))
                .collect();
            par::each(tasks, |_, (((p, m), v), d)| {
                for (((p, m), v), d) in p.iter_mut().zip(m).zip(v).zip(d) {
                    *p += *d;
                    *m += *d;
                    *v += *d;
                }
            });
        });
    });
    let mut s = 1u32;
    let mut next = || {
        s = s.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (s >> 8) as f32 / 16_777_216.0
    };
    let points: Vec<[f32; 3]> = (0..n).map(|_| [next(), next() * next(), next() * next() * next()]).collect();
    group.bench_function("three nearest neighbours of every mean", |b| {
        b.iter(|| black_box(knn::mean_squared_distance(&points).expect("finite")));
    });
    g.means = points;
    group.bench_function("mcmc noise", |b| {
        b.iter(|| mcmc::add_noise(&mcmc::Settings::GSPLAT, 1, 1, 1e-4, &mut g))
    });
    group.finish();
}

criterion_group!(benches, losses, optimiser);
criterion_main!(benches);
