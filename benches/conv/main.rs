//! The layers of the image-to-point model against PyTorch on the CPU, in one run.
//!
//! ```text
//! cargo bench --workspace --bench conv [-- layers | encoder | decoder]    PyTorch from python3, or from $LASTLIGHT_PYTHON
//! ```
//!
//! `peer.py` does the same work; if PyTorch cannot be imported, the comparison is skipped with a message.
//! CONV_RUNS sets the repetitions, CONV_THREADS the threads. Times are medians; the rates count a product and
//! a sum as two operations.

#![expect(clippy::disallowed_types, reason = "a bench measures time")]

mod decoder;
mod encoder;

use lastlight::num::par;
use lastlight::num::rng::Rng;
use std::process::Command;
use std::time::Instant;

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

/// What was timed: a name as in `peer.py`, seconds and 10⁹ operations forward, and forward with adjoint.
struct Timed {
    name: &'static str,
    seconds: [f64; 2],
    work: [f64; 2],
}

/// PyTorch's lines, if there is one.
fn peer(threads: usize, runs: usize) -> Option<String> {
    let python = std::env::var("LASTLIGHT_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/conv/peer.py");
    let out = Command::new(python).args([script, &threads.to_string(), &runs.to_string()]).output().ok()?;
    out.status.success().then(|| String::from_utf8_lossy(&out.stdout).into_owned())
}

fn main() {
    let smoke = std::env::var_os("LASTLIGHT_BENCH_SMOKE").is_some();
    let (threads, runs) = (number("CONV_THREADS", 2), if smoke { 1 } else { number("CONV_RUNS", 11) });
    let theirs = if smoke { None } else { peer(threads, runs) };
    if theirs.is_none() {
        println!("not run: PyTorch, which the Python at hand does not have");
    }
    let ours = par::with_threads(threads, || {
        let wanted = std::env::args().skip(1).find(|word| !word.starts_with('-')).unwrap_or_default();
        let parts: [fn(usize) -> Vec<Timed>; 3] = [encoder::layers, encoder::whole, decoder::whole];
        let parts = ["layers", "encoder", "decoder"].into_iter().zip(parts);
        parts.filter(|(name, _)| name.contains(&wanted)).flat_map(|(_, part)| part(runs)).collect::<Vec<_>>()
    })
    .expect("the threads have the default floating-point environment");
    println!(
        "{threads} threads, medians of {runs} runs: forward, forward and adjoint; ms, 10⁹ operations per second"
    );
    for Timed { name, seconds, work } in ours {
        print!("{name:>8}  ours");
        for (s, w) in seconds.iter().zip(work) {
            print!(" {:8.2} ({:5.1})", 1e3 * s, w / s);
        }
        for line in theirs.as_deref().unwrap_or_default().lines() {
            let words: Vec<&str> = line.split(' ').collect();
            let times: Vec<f64> = words.iter().filter_map(|t| t.parse().ok()).collect();
            if let ([first, layout, ..], [one, both]) = (&words[..], &times[..])
                && *first == name
            {
                print!("  PyTorch {layout} {:8.2} {:8.2}", 1e3 * one, 1e3 * both);
                print!("  times as fast {:.2} {:.2}", one / seconds[0], both / seconds[1]);
            }
        }
        println!();
    }
}
