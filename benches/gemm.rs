//! Matrix products against the multiply-add peak of this machine, both measured in turn in one run.
//!
//! `cargo bench --workspace --bench gemm` prints the ratio, then criterion's figures.
//! `LASTLIGHT_BENCH_SMOKE=1` makes it quick.
#![allow(missing_docs, reason = "criterion's macros make undocumented functions")]
#![expect(clippy::disallowed_types, reason = "a bench reads the clock")]

use criterion::{Criterion, criterion_group, criterion_main};
use lastlight::nn::linear;
use lastlight::num::{gemm, lanes::f32x8, order, par, rng::Rng};
use std::hint::black_box;
use std::time::{Duration, Instant};

fn smoke() -> bool {
    std::env::var_os("LASTLIGHT_BENCH_SMOKE").is_some_and(|v| v == "1")
}

fn values(n: usize, item: u64) -> Vec<f32> {
    let rng = Rng::new(1);
    (0..n).map(|i| rng.uniform_f32(i as u64, 0, 1, item as u16) - 0.5).collect()
}

/// Chains of unfused multiply-adds in registers, as many as hide their latency.
const CHAINS: usize = 14;

/// With eight lanes.
#[inline(never)]
fn eight(rounds: usize) -> f32x8 {
    let [x, y] = [0.999_9, 1e-4].map(|x| black_box(f32x8::splat(x)));
    let mut acc = [f32x8::ZERO; CHAINS];
    for _ in 0..rounds {
        for a in &mut acc {
            *a = *a * x + y;
        }
    }
    acc.into_iter().fold(f32x8::ZERO, |s, a| s + a)
}

/// With the widest registers.
struct Wide {
    rounds: usize,
}

impl pulp::WithSimd for Wide {
    /// Lanes that were busy.
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) -> usize {
        let [x, y] = [0.999_9, 1e-4].map(|x| simd.splat_f32s(black_box(x)));
        let mut acc = [simd.splat_f32s(0.0); CHAINS];
        for _ in 0..self.rounds {
            for a in &mut acc {
                *a = simd.add_f32s(simd.mul_f32s(*a, x), y);
            }
        }
        black_box(&acc);
        S::F32_LANES
    }
}

/// As wide as products are; the number of lanes.
fn chains(rounds: usize) -> usize {
    if gemm::product_lanes() == 8 {
        black_box(eight(rounds));
        return 8;
    }
    pulp::Arch::new().dispatch(Wide { rounds })
}

fn seconds(f: impl FnOnce()) -> f64 {
    let start = Instant::now();
    f();
    start.elapsed().as_secs_f64()
}

/// Multiply-add peak of `threads` threads together, in GFLOP/s.
fn peak(threads: usize) -> f64 {
    const ROUNDS: usize = 400_000;
    let mut lanes = Vec::new();
    let s = seconds(|| lanes = par::map(threads, |_| chains(ROUNDS)));
    (threads * ROUNDS * CHAINS * lanes[0] * 2) as f64 / s * 1e-9
}

fn median(mut x: Vec<f64>) -> f64 {
    x.sort_by(f64::total_cmp);
    x[x.len() / 2]
}

/// Forward pass of `nn.linear`, in GFLOP/s.
fn linear_rate(m: usize, n: usize, k: usize, buffers: &mut [Vec<f32>; 4]) -> f64 {
    let [x, weight, bias, y] = buffers;
    let s = seconds(|| linear::forward(linear::In { x, weight, bias, m, n, k }, y));
    black_box(&y);
    (2 * m * n * k) as f64 / s * 1e-9
}

fn ratios(threads: usize) {
    let runs = if smoke() { 3 } else { 21 };
    println!(
        "threads {threads}, {} lanes: unfused multiply-add peak and nn.linear forward, GFLOP/s, medians of {runs} interleaved runs",
        gemm::product_lanes()
    );
    for (m, n, k) in [
        (256, 256, 256),
        (512, 512, 512),
        (1024, 1024, 1024),
        (2048, 2048, 512),
        (6144, 32, 64),
        (6144, 64, 64),
    ] {
        let mut buffers = [values(m * k, 0), values(n * k, 1), values(n, 2), vec![0.0; m * n]];
        let (mut peaks, mut rates, mut shares) = (vec![], vec![], vec![]);
        linear_rate(m, n, k, &mut buffers);
        for _ in 0..runs {
            let before = peak(threads);
            let rate = linear_rate(m, n, k, &mut buffers);
            let after = peak(threads);
            peaks.push(before);
            rates.push(rate);
            shares.push(rate / (0.5 * (before + after)));
        }
        let largest = |x: &[f64]| x.iter().copied().fold(0.0, order::max);
        let best = largest(&rates) / largest(&peaks);
        println!(
            "  {m:>5} x {n:>5} x {k:>5}: {:>6.1} of {:>6.1}, ratio {:.3} (best against best {best:.3})",
            median(rates),
            median(peaks),
            median(shares)
        );
    }
}

fn bench(c: &mut Criterion) {
    for threads in [1, par::threads()] {
        par::with_threads(threads, || ratios(threads))
            .expect("the floating-point environment is the default one");
    }
    let mut group = c.benchmark_group("nn.linear forward");
    if smoke() {
        group
            .sample_size(10)
            .warm_up_time(Duration::from_millis(50))
            .measurement_time(Duration::from_millis(200));
    }
    for size in [256, 1024] {
        let (m, n, k) = (size, size, size);
        let mut buffers = [values(m * k, 0), values(n * k, 1), values(n, 2), vec![0.0; m * n]];
        group.throughput(criterion::Throughput::Elements((2 * m * n * k) as u64));
        group.bench_function(format!("{m}x{n}x{k}"), |b| b.iter(|| linear_rate(m, n, k, &mut buffers)));
    }
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
