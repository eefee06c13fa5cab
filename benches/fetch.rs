//! `field.fetch` against the bandwidth with which the caches are read, both measured in turn in one run.
//!
//! `cargo bench --workspace --bench fetch`. `LASTLIGHT_BENCH_SMOKE=1` makes it quick.
//!
//! Three planes, features written in batches of 768 points as in the renderer, so that they stay in a cache. Bytes are
//! those of the texels that are read: 4 corners of 3 planes, C channels of 4 bytes. Points come in the order of rays (a
//! crop of 32² rays with 96 samples) or at random. Beside it, one pass after another over an array of the size of the
//! planes, in lanes. Both on one thread.

#![expect(clippy::disallowed_types, reason = "a bench reads the clock")]

use lastlight::field::fetch::{self, Combine, Planes};
use lastlight::num::lanes::f32x8;
use lastlight::num::{order, par, rng::Rng};
use std::hint::black_box;
use std::time::Instant;

/// Points per call.
const BATCH: usize = 768;
const RAYS: usize = 1024;
const SAMPLES: usize = 96;
const HALF_SIZE: f32 = 2.0;

fn seconds(work: impl FnOnce()) -> f64 {
    let start = Instant::now();
    work();
    start.elapsed().as_secs_f64()
}

/// Middles of the samples of a crop seen along z.
fn in_order() -> Vec<[f32; 3]> {
    let side = 32;
    let at = |i: usize| (i as f32 + 0.5) / side as f32 * 2.0 - 1.0;
    let of_ray = |ray: usize| {
        let slope = [at(ray % side), at(ray / side)].map(|x| 0.45 * x);
        (0..SAMPLES).map(move |i| {
            let t = 1.0 + (i as f32 + 0.5) * (2.0 * HALF_SIZE - 0.1) / SAMPLES as f32;
            [slope[0] * t, slope[1] * t, t - 1.0 - HALF_SIZE]
        })
    };
    (0..RAYS).flat_map(of_ray).map(|x| x.map(|x| order::clamp(x, -HALF_SIZE, HALF_SIZE))).collect()
}

fn at_random() -> Vec<[f32; 3]> {
    let rng = Rng::new(5);
    let x = |i: usize, k: u16| (rng.uniform_f32(i as u64, 0, 1, k) * 2.0 - 1.0) * HALF_SIZE;
    (0..RAYS * SAMPLES).map(|i| [x(i, 0), x(i, 1), x(i, 2)]).collect()
}

/// One pass over an array.
#[inline(never)]
fn read(values: &[f32]) -> f32x8 {
    let mut sums = [f32x8::ZERO; 8];
    for block in values.as_chunks::<64>().0 {
        for (sum, eight) in sums.iter_mut().zip(block.as_chunks::<8>().0) {
            *sum = *sum + f32x8::new(*eight);
        }
    }
    sums.into_iter().fold(f32x8::ZERO, |s, x| s + x)
}

fn median(mut x: Vec<f64>) -> f64 {
    x.sort_by(f64::total_cmp);
    x[x.len() / 2]
}

fn measure(side: usize, channels: usize, runs: usize) {
    let rng = Rng::new(4);
    let texels: Vec<f32> =
        (0..3 * side * side * channels).map(|i| rng.uniform_f32(i as u64, 0, 1, 0) - 0.5).collect();
    let planes = Planes { values: &texels, count: 3, side, channels, half_size: HALF_SIZE };
    let bytes = 4.0 * texels.len() as f64;
    println!(
        "three planes of {side}² texels with {channels} channels, {:.2} MiB in total",
        bytes / f64::from(1 << 20)
    );
    for (name, points) in [("rays", in_order()), ("random", at_random())] {
        for combine in [Combine::Sum, Combine::Concat] {
            let width = combine.width(channels);
            let mut features = vec![0.0; BATCH * width];
            let (mut ours, mut theirs, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
            for _ in 0..runs {
                let passes = 4;
                let array = bytes * f64::from(passes)
                    / seconds(|| {
                        for _ in 0..passes {
                            black_box(read(&texels));
                        }
                    });
                let taken = seconds(|| {
                    for points in points.chunks(BATCH) {
                        fetch::forward(
                            &planes,
                            combine,
                            points,
                            black_box(&mut features[..points.len() * width]),
                        );
                    }
                });
                let fetched = (points.len() * 4 * 3 * channels * 4) as f64 / taken;
                ours.push(fetched);
                theirs.push(array);
                ratios.push(fetched / array);
            }
            let best = |x: &[f64]| x.iter().copied().fold(0.0, order::max);
            println!(
                "  {name:>6}, {combine:?}: {:.1} of {:.1} GB/s, ratio {:.2} (best of each {:.2})",
                1e-9 * median(ours.clone()),
                1e-9 * median(theirs.clone()),
                median(ratios),
                best(&ours) / best(&theirs)
            );
        }
    }
}

fn main() {
    let runs = if std::env::var_os("LASTLIGHT_BENCH_SMOKE").is_some() { 3 } else { 41 };
    println!(
        "GB/s of texels, and of a pass over an array of the size of the planes; medians of {runs} interleaved runs"
    );
    par::with_threads(1, || {
        measure(128, 16, runs);
        measure(157, 32, runs);
    })
    .expect("the floating-point environment is the default one");
}
