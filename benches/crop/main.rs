//! The field renderer against PyTorch on the CPU, in one run.
//!
//! ```text
//! cargo bench --workspace --bench crop [-- NAME]    PyTorch from python3, or from $LASTLIGHT_PYTHON
//! ```
//!
//! `peer.py` renders the same scenes with the same number of samples, and compares values and gradients with
//! ours; if PyTorch cannot be imported, the comparison is skipped with a message. CROP_RUNS sets the
//! repetitions, CROP_THREADS the threads. Times are medians.

#![expect(clippy::disallowed_types, reason = "a bench measures time")]

mod scene;

use lastlight::field::render::{self, InBar, OutBar, Plan};
use lastlight::io::npz;
use lastlight::num::par;
use scene::Setup;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

fn number(name: &str, default: usize) -> usize {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// PyTorch's line for the arrays of a file: samples, seconds, relative differences.
fn peer(file: &Path, threads: usize, runs: usize) -> Option<Vec<f64>> {
    let python = std::env::var("LASTLIGHT_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/crop/peer.py");
    let out = Command::new(python)
        .arg(script)
        .arg(file)
        .args([threads.to_string(), runs.to_string()])
        .output()
        .ok()?;
    if !out.status.success() {
        eprintln!("{}", String::from_utf8_lossy(&out.stderr).lines().last().unwrap_or_default());
        return None;
    }
    String::from_utf8_lossy(&out.stdout).split_whitespace().map(|word| word.parse().ok()).collect()
}

fn median(times: &mut [f64]) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// One render with all gradients of mean((value − 0.5)²); returns the seconds of both parts.
fn run(setup: &Setup, arrays: &mut lastlight::num::array::Arrays) -> [f64; 2] {
    let (scene, mut plan) = (setup.scene(), Plan::new(setup.intervals()));
    let start = Instant::now();
    let out = render::forward(&scene, &mut plan);
    let forward = start.elapsed().as_secs_f64();
    let scale = 2.0 / out.values.len() as f32;
    let values: Vec<f32> = out.values.iter().map(|v| scale * (v - 0.5)).collect();
    let mut bar = InBar::zeros_like(&scene);
    let out_bar = OutBar { values: &values, ..OutBar::default() };
    render::adjoint(&scene, &plan, &out, &out_bar, usize::MAX / 2, &mut bar);
    let both = start.elapsed().as_secs_f64();
    let heads = [&bar.heads.sdf, &bar.heads.color, &bar.heads.albedo, &bar.heads.material, &bar.heads.normal];
    let last: Vec<f32> = heads.into_iter().filter_map(|head| head.last()).flatten().copied().collect();
    let n = out.opacity.len();
    arrays.put("values", &[n, out.values.len() / n], out.values);
    arrays.put("planes_bar", &[bar.planes.len()], bar.planes);
    arrays.put("last_bar", &[last.len()], last);
    arrays.put("beta_bar", &[], vec![bar.beta]);
    [forward, both]
}

fn main() {
    let smoke = std::env::var_os("LASTLIGHT_BENCH_SMOKE").is_some();
    let (threads, runs) = (number("CROP_THREADS", 2), if smoke { 1 } else { number("CROP_RUNS", 11) });
    println!("{threads} threads, medians of {runs} runs: forward, forward and gradients; ms");
    let file = std::env::temp_dir().join(format!("crop-{}.npz", std::process::id()));
    let wanted = std::env::args().skip(1).find(|word| !word.starts_with('-')).unwrap_or_default();
    let setups = [Setup::trunk(3), Setup::trunk(6), Setup::heads()];
    for setup in setups.into_iter().filter(|setup| setup.name.contains(&wanted)) {
        let mut arrays = setup.arrays();
        let mut times = [Vec::new(), Vec::new()];
        par::with_threads(threads, || {
            for _ in 0..=runs {
                let [forward, both] = run(&setup, &mut arrays);
                times[0].push(forward);
                times[1].push(both);
            }
        })
        .expect("the threads have the default floating-point environment");
        let ours = times.map(|mut t| median(&mut t[1..]));
        let samples = setup.intervals().samples();
        print!("{}: {samples} samples; ours {:.1} {:.1}", setup.name, 1e3 * ours[0], 1e3 * ours[1]);
        let theirs = if smoke {
            None
        } else {
            npz::write(&file, &arrays).expect("the temporary folder can be written to");
            peer(&file, threads, runs)
        };
        match theirs.as_deref() {
            Some(&[taken, forward, both, values, planes, last, beta]) => {
                assert_eq!(taken, samples as f64, "both process the same samples");
                assert!(
                    [values, planes, last, beta].iter().all(|e| *e < 1e-3),
                    "both compute the same: {values:.1e} {planes:.1e} {last:.1e} {beta:.1e}"
                );
                print!("; PyTorch {:.1} {:.1}", 1e3 * forward, 1e3 * both);
                print!("; times as fast {:.2} {:.2}", forward / ours[0], both / ours[1]);
                println!(
                    "; relative differences: values {values:.1e}, planes {planes:.1e}, weights {last:.1e}, β {beta:.1e}"
                );
            }
            _ => println!("; not run: PyTorch, which the Python at hand does not have"),
        }
    }
    let _ = std::fs::remove_file(file);
}
