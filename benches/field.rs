//! The operators of fields at the size of one training crop: 1024 rays of 96 samples, six planes of 64² texels with
//! 16 channels, heads of 32 units.
//!
//! `cargo bench --workspace --bench field`. Compare ratios of one run, never absolute times of two machines.

use criterion::{Criterion, criterion_group, criterion_main};
use lastlight::field::composite::{self, In, InBar};
use lastlight::field::embed::{self, Panoramas};
use lastlight::field::fetch::{self, Combine, Planes};
use lastlight::field::network::NetworkBar;
use lastlight::field::{density, interval, sdf_head};
use std::hint::black_box;

const RAYS: usize = 1024;
const SAMPLES: usize = 96;
const POINTS: usize = RAYS * SAMPLES;
const SIDE: usize = 64;
const CHANNELS: usize = 16;
const FEATURES: usize = 3 * CHANNELS;

/// Numbers in −1..1.
fn numbers(seed: u32, n: usize) -> Vec<f32> {
    let mut s = seed;
    let next = |_| {
        s = s.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (s >> 8) as f32 / 8_388_608.0 - 1.0
    };
    (0..n).map(next).collect()
}

/// Samples along rays through the box.
fn points() -> Vec<[f32; 3]> {
    let ends = numbers(1, 6 * RAYS);
    let at = |i: usize| {
        let (ray, t) = (&ends[i / SAMPLES * 6..][..6], (i % SAMPLES) as f32 / SAMPLES as f32);
        std::array::from_fn(|k| 0.5 * ((1.0 - t) * ray[k] + t * ray[k + 3]))
    };
    (0..POINTS).map(at).collect()
}

fn planes(c: &mut Criterion) {
    let (points, texels) = (points(), numbers(2, 6 * SIDE * SIDE * CHANNELS));
    let planes = Planes { values: &texels, count: 6, side: SIDE, channels: CHANNELS, half_size: 0.5 };
    let mut features = vec![0.0; POINTS * FEATURES];
    let bar = numbers(3, POINTS * FEATURES);
    let mut planes_bar = vec![0.0; texels.len()];
    let mut points_bar = vec![[0.0; 3]; POINTS];
    let mut group = c.benchmark_group("field");
    group.sample_size(10);
    group.bench_function("fetch forward", |b| {
        b.iter(|| fetch::forward(&planes, Combine::Concat, &points, black_box(&mut features)));
    });
    group.bench_function("fetch gradient of the points", |b| {
        b.iter(|| {
            fetch::adjoint(&planes, Combine::Concat, &points, &bar, black_box(&mut points_bar), &mut [])
        });
    });
    group.bench_function("fetch gradient of the planes", |b| {
        b.iter(|| planes.scatter(Combine::Concat, &points, &bar, black_box(&mut planes_bar)));
    });
    let weights = [numbers(4, 32 * FEATURES), numbers(5, 32 * 32), numbers(6, 32)];
    let weights: Vec<&[f32]> = weights.iter().map(Vec::as_slice).collect();
    let x = sdf_head::In { features: &features, points: &points, weights: &weights, half_size: 0.5 };
    group.bench_function("sdf_head forward", |b| b.iter(|| black_box(sdf_head::forward(&x).0)));
    let (_, saved) = sdf_head::forward(&x);
    let sdf_bar = numbers(7, POINTS);
    let mut network = NetworkBar {
        x: vec![0.0; features.len()],
        weights: weights.iter().map(|w| vec![0.0; w.len()]).collect(),
    };
    group.bench_function("sdf_head adjoint", |b| {
        b.iter(|| sdf_head::adjoint(&x, &saved, &sdf_bar, &mut points_bar, black_box(&mut network)));
    });
    group.finish();
}

fn volume(c: &mut Criterion) {
    let [s0, s1, g] = [8, 9, 10].map(|seed| numbers(seed, POINTS));
    let (mut sigma, mut bar0, mut bar1) = (vec![0.0; POINTS], vec![0.0; POINTS], vec![0.0; POINTS]);
    let mut group = c.benchmark_group("field");
    group.sample_size(10);
    group
        .bench_function("density forward", |b| b.iter(|| density::forward(&s0, 0.05, black_box(&mut sigma))));
    group.bench_function("density adjoint", |b| {
        b.iter(|| density::adjoint(&s0, 0.05, &g, black_box(&mut bar0)));
    });
    group.bench_function("interval forward", |b| {
        b.iter(|| interval::forward(&s0, &s1, 0.05, black_box(&mut sigma)));
    });
    group.bench_function("interval adjoint", |b| {
        b.iter(|| interval::adjoint([&s0, &s1], 0.05, &g, [black_box(&mut bar0), &mut bar1]));
    });
    let sigma: Vec<f32> = sigma.iter().map(|s| s.abs()).collect();
    let (delta, values, background) = (vec![0.01; POINTS], numbers(11, POINTS * 7), [1.0; 7]);
    let x = In { sigma: &sigma, delta: &delta, values: &values, background: &background, samples: SAMPLES };
    group.bench_function("composite forward", |b| b.iter(|| black_box(composite::forward(&x))));
    let (out, value_bar, opacity_bar) = (composite::forward(&x), numbers(12, RAYS * 7), numbers(13, RAYS));
    let mut bar = InBar {
        sigma: vec![0.0; POINTS],
        delta: vec![0.0; POINTS],
        values: vec![0.0; POINTS * 7],
        background: vec![0.0; 7],
    };
    group.bench_function("composite adjoint", |b| {
        b.iter(|| composite::adjoint(&x, &out, &value_bar, &opacity_bar, black_box(&mut bar)));
    });
    let texels = numbers(14, 4 * 64 * 64 * CHANNELS);
    let panoramas = Panoramas { values: &texels, levels: 4, height: 64, width: 64, channels: CHANNELS };
    let normals: Vec<[f32; 3]> = numbers(15, 3 * POINTS).as_chunks::<3>().0.to_vec();
    let rho: Vec<f32> = numbers(16, POINTS).iter().map(|x| x.abs()).collect();
    group.bench_function("embed forward", |b| {
        b.iter(|| black_box(embed::forward(&panoramas, &normals, None, &rho, None)));
    });
    let (_, places) = embed::forward(&panoramas, &normals, None, &rho, None);
    let (h_bar, mut rho_bar) = (numbers(17, POINTS * CHANNELS), vec![0.0; POINTS]);
    let mut panoramas_bar = vec![0.0; texels.len()];
    group.bench_function("embed adjoint", |b| {
        b.iter(|| embed::adjoint(&panoramas, &places, &h_bar, &mut rho_bar, black_box(&mut panoramas_bar)));
    });
    group.finish();
}

criterion_group!(benches, planes, volume);
criterion_main!(benches);
