//! The causal operators at the size of a training step: 192 samples, 4 factors of 4 numbers, networks of 32
//! hidden units.

use criterion::{Criterion, criterion_group, criterion_main};
use lastlight::causal::structure::{self, In, InBar, Mechanism, Networks};
use lastlight::causal::{independence, intervene};
use lastlight::num::rng::Rng;

const BATCH: usize = 192;
const N: usize = 4;
const K: usize = 4;
const HIDDEN: usize = 32;
const D: usize = N * K;

fn normals(draw: u16, len: usize, scale: f64) -> Vec<f64> {
    (0..len).map(|i| scale * f64::from(Rng::new(1).normal_f32(i as u64, 0, 0x62, draw))).collect()
}

fn operators(c: &mut Criterion) {
    let lengths = [N * HIDDEN * D, N * HIDDEN, N * HIDDEN * HIDDEN, N * HIDDEN, N * K * HIDDEN];
    let [w0, b0, w1, b1, w2]: [Vec<f64>; 5] = std::array::from_fn(|i| normals(i as u16, lengths[i], 0.2));
    let (eps, mask, z_bar) = (normals(5, BATCH * D, 1.0), normals(6, N * N, 0.5), normals(7, BATCH * D, 1.0));
    let networks = Networks { w0: &w0, b0: &b0, w1: &w1, b1: &b1, w2: &w2, hidden: HIDDEN, slope: 0.05 };
    let mechanism = Mechanism::Networks(networks);
    let x = In { eps: &eps, mask: &mask, mechanism, batch: BATCH, n: N, k: K, sweeps: N };
    c.bench_function("causal.structure forward and adjoint", |b| {
        b.iter(|| {
            let mut bar = InBar::zeros_like(&x);
            structure::adjoint(&x, &structure::forward(&x).1, &z_bar, &mut bar);
            bar
        });
    });
    c.bench_function("causal.structure abduct and adjoint", |b| {
        b.iter(|| {
            let mut bar = InBar::zeros_like(&x);
            structure::abduct_adjoint(&x, &structure::abduct(&x), &mut bar);
            bar
        });
    });
    let target: Vec<Option<usize>> = (0..BATCH).map(|b| Some(b % N)).collect();
    let value = normals(8, BATCH * K, 1.0);
    let held = intervene::In { given: x, target: &target, value: &value };
    c.bench_function("causal.intervene forward and adjoint", |b| {
        b.iter(|| {
            let mut bar = intervene::InBar::zeros_like(&held);
            intervene::adjoint(&held, &intervene::forward(&held).1, &z_bar, &mut bar);
            bar
        });
    });
    let logvar = vec![-1.0; BATCH * D];
    let spread = independence::In::new(&eps, &logvar, BATCH, N, K);
    c.bench_function("causal.independence forward and adjoint", |b| {
        b.iter(|| {
            let (_, saved) = independence::forward(&spread).expect("positive definite");
            let mut bar = independence::InBar::zeros_like(&spread);
            independence::adjoint(&spread, &saved, 1.0, &mut bar);
            bar
        });
    });
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20);
    targets = operators
}
criterion_main!(benches);
