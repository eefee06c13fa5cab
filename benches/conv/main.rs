//! `nn.conv` at the four layers of the image-to-point encoder (64 pictures of 64²), beside PyTorch on the same threads.
//!
//! `cargo bench --bench conv` prints milliseconds and ratios. PyTorch runs as a subprocess of the Python named by LASTLIGHT_PYTHON (else
//! `python3`); where it cannot be imported the comparison is skipped and says so. CONV_RUNS sets the repetitions, CONV_THREADS the threads.

#![expect(clippy::disallowed_types, reason = "a bench measures time")]

use lastlight::nn::conv::{In, InBar, Shape, adjoint, forward};
use lastlight::num::par;
use lastlight::num::rng::Rng;
use std::process::Command;
use std::time::Instant;

const BATCH: usize = 64;
/// Name as in `peer.py`, side, channels, outputs.
const LAYERS: [(&str, usize, usize, usize); 4] =
    [("64x3", 64, 3, 32), ("32x32", 32, 32, 32), ("16x32", 16, 32, 64), ("8x64", 8, 64, 64)];

fn number(name: &str, default: usize) -> usize {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

fn normals(n: usize, purpose: u16) -> Vec<f32> {
    let rng = Rng::new(1);
    (0..n).map(|i| rng.normal_f32(i as u64, 0, purpose, 0)).collect()
}

/// Median seconds of `f`, after one run that is not counted.
fn median(runs: usize, mut f: impl FnMut()) -> f64 {
    f();
    let mut times: Vec<f64> = (0..runs)
        .map(|_| {
            let start = Instant::now();
            f();
            start.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// Seconds forward, and forward with adjoint.
fn layer(side: usize, channels: usize, outputs: usize, runs: usize) -> [f64; 2] {
    let shape = Shape {
        batch: BATCH,
        height: side,
        width: side,
        channels,
        outputs,
        kernel: [4, 4],
        stride: 2,
        pad: 1,
    };
    let x = normals(BATCH * side * side * channels, 1);
    let (weight, bias) = (normals(outputs * shape.taps(), 2), normals(outputs, 3));
    let input = In { x: &x, weight: &weight, bias: &bias, shape };
    let size = BATCH * side * side / 4 * outputs;
    let (mut y, y_bar, mut bar) = (vec![0.0; size], normals(size, 4), InBar::zeros_like(&input));
    if channels == 3 {
        bar.x = Vec::new(); // photographs need no gradient
    }
    let one = median(runs, || forward(input, &mut y));
    let both = median(runs, || {
        forward(input, &mut y);
        adjoint(input, &y_bar, &mut bar);
    });
    [one, both]
}

/// PyTorch's lines, if there is one.
fn peer(threads: usize, runs: usize) -> Option<String> {
    let python = std::env::var("LASTLIGHT_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/conv/peer.py");
    let out = Command::new(python).args([script, &threads.to_string(), &runs.to_string()]).output().ok()?;
    out.status.success().then(|| String::from_utf8_lossy(&out.stdout).into_owned())
}

fn main() {
    let smoke = std::env::var_os("LASTLIGHT_BENCH_SMOKE").is_some();
    let (threads, runs) = (number("CONV_THREADS", 2), if smoke { 1 } else { number("CONV_RUNS", 21) });
    let theirs = if smoke { None } else { peer(threads, runs) };
    if theirs.is_none() {
        println!("not run: PyTorch, which the Python at hand does not have");
    }
    println!("{BATCH} pictures, {threads} threads, medians of {runs} runs: forward, forward and adjoint, ms");
    for (name, side, channels, outputs) in LAYERS {
        let ours = par::with_threads(threads, || layer(side, channels, outputs, runs))
            .expect("the threads have the default floating-point environment");
        print!("{name:>6}  ours {:7.3} {:7.3}", 1e3 * ours[0], 1e3 * ours[1]);
        let line = theirs.as_deref().unwrap_or_default().lines().find(|l| l.split(' ').next() == Some(name));
        let theirs: Vec<f64> =
            line.map(|l| l.split(' ').skip(1).filter_map(|t| t.parse().ok()).collect()).unwrap_or_default();
        if let [one, both] = theirs[..] {
            print!("  PyTorch {:7.3} {:7.3}", 1e3 * one, 1e3 * both);
            print!("  times as fast {:.2} {:.2}", one / ours[0], both / ours[1]);
        }
        println!();
    }
}
