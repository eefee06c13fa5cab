//! A block of a transformer against PyTorch on the CPU, in turn in one run.
//!
//! ```text
//! cargo bench --workspace --bench block    PyTorch from python3, or from $LASTLIGHT_PYTHON
//! ```
//!
//! Width 512, 8 heads, 2 048 tokens, hidden width 2 048, biases, f32: forward, and forward with the gradients of the tokens
//! and of all weights. `peer.py` does the same work with `F.scaled_dot_product_attention`; if PyTorch cannot be imported, the
//! comparison is skipped with a message. BLOCK_RUNS sets the repetitions, BLOCK_THREADS the threads, BLOCK_TOKENS the tokens. Times are
//! medians; the rates count a product and a sum as two operations.

#![expect(clippy::disallowed_types, reason = "a bench measures time")]

mod peer;
mod split;

use lastlight::nn::block::{self, In, InBar};
use lastlight::num::array::{Arrays, entries};
use lastlight::num::{gemm, par, rng::Rng};
use peer::Peer;
use std::time::Instant;

const WIDTH: usize = 512;
const HEADS: usize = 8;
const HIDDEN: usize = 4 * WIDTH;

fn number(name: &str, default: usize) -> usize {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

fn normals(n: usize, purpose: u16, scale: f32) -> Vec<f32> {
    let rng = Rng::new(1);
    (0..n).map(|i| scale * rng.normal_f32(i as u64, 0, purpose, 0)).collect()
}

fn seconds<T>(f: impl FnOnce() -> T) -> f64 {
    let start = Instant::now();
    std::hint::black_box(f());
    start.elapsed().as_secs_f64()
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// MiB of a line of the process's status.
fn resident(key: &str) -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix(key));
    let kib = line.and_then(|line| line.split_whitespace().find_map(|word| word.parse::<f64>().ok()));
    kib.unwrap_or(f64::NAN) / 1024.0
}

/// Peak of the resident memory while `f` runs, above that before, in MiB.
fn memory(f: impl FnOnce()) -> f64 {
    let _ = std::fs::write("/proc/self/clear_refs", "5"); // resets the peak
    let before = resident("VmRSS:");
    f();
    resident("VmHWM:") - before
}

/// Shapes of all inputs.
fn shapes(tokens: usize) -> Vec<(&'static str, Vec<usize>)> {
    let (d, f) = (WIDTH, HIDDEN);
    vec![
        ("x", vec![tokens, d]),
        ("ln1_gain", vec![d]),
        ("ln1_bias", vec![d]),
        ("w_qkv", vec![3 * d, d]),
        ("b_qkv", vec![3 * d]),
        ("w_out", vec![d, d]),
        ("b_out", vec![d]),
        ("ln2_gain", vec![d]),
        ("ln2_bias", vec![d]),
        ("w_fc1", vec![f, d]),
        ("b_fc1", vec![f]),
        ("w_fc2", vec![d, f]),
        ("b_fc2", vec![d]),
    ]
}

/// Tokens, and weights whose products have the size of their inputs.
struct Setup {
    arrays: Vec<Vec<f32>>,
    y_bar: Vec<f32>,
    tokens: usize,
}

impl Setup {
    fn new(tokens: usize) -> Self {
        let make = |(i, (name, shape)): (usize, (&str, Vec<usize>))| {
            let scale = if shape.len() == 2 && name != "x" { 1.0 / (shape[1] as f32).sqrt() } else { 1.0 };
            normals(entries(&shape), i as u16, scale)
        };
        let arrays = shapes(tokens).into_iter().enumerate().map(make).collect();
        Self { arrays, y_bar: normals(tokens * WIDTH, 40, 1.0), tokens }
    }

    fn input(&self) -> In<'_> {
        let a = &self.arrays;
        In {
            x: &a[0],
            ln1_gain: &a[1],
            ln1_bias: &a[2],
            w_qkv: &a[3],
            b_qkv: &a[4],
            w_out: &a[5],
            b_out: &a[6],
            ln2_gain: &a[7],
            ln2_bias: &a[8],
            w_fc1: &a[9],
            b_fc1: &a[10],
            w_fc2: &a[11],
            b_fc2: &a[12],
            tokens: self.tokens,
            heads: HEADS,
            eps: 1e-6,
        }
    }

    fn forward(&self) -> Vec<f32> {
        let mut y = vec![0.0; self.tokens * WIDTH];
        block::values(&self.input(), &mut y);
        y
    }

    fn both(&self) -> (Vec<f32>, InBar) {
        let (x, mut y) = (self.input(), vec![0.0; self.tokens * WIDTH]);
        let saved = block::forward(&x, &mut y);
        let mut bar = InBar::zeros_like(&x);
        block::adjoint(&x, saved, &self.y_bar, &mut bar);
        (y, bar)
    }

    /// Inputs, cotangent, and our results.
    fn results(&self) -> Arrays {
        let (y, bar) = self.both();
        let mut arrays = Arrays::new();
        arrays.put("heads", &[], vec![HEADS as f64]);
        arrays.put("y", &[self.tokens, WIDTH], y);
        arrays.put("y_bar", &[self.tokens, WIDTH], self.y_bar.clone());
        let bars = [
            bar.x,
            bar.ln1_gain,
            bar.ln1_bias,
            bar.w_qkv,
            bar.b_qkv,
            bar.w_out,
            bar.b_out,
            bar.ln2_gain,
            bar.ln2_bias,
            bar.w_fc1,
            bar.b_fc1,
            bar.w_fc2,
            bar.b_fc2,
        ];
        for (((name, shape), values), bar) in shapes(self.tokens).into_iter().zip(&self.arrays).zip(bars) {
            arrays.put(name, &shape, values.clone());
            arrays.put(&format!("{name}_bar"), &shape, bar);
        }
        arrays
    }
}

/// 10⁹ operations forward, and forward with adjoint: five products in the adjoint of attention, where S is computed again.
fn work(tokens: usize) -> [f64; 2] {
    let (t, d) = (tokens as f64, WIDTH as f64);
    let (layers, between) = (2e-9 * t * d * (4.0 * d + 2.0 * HIDDEN as f64), 2e-9 * t * t * d);
    [layers + 2.0 * between, 3.0 * layers + 7.0 * between]
}

fn main() {
    let smoke = std::env::var_os("LASTLIGHT_BENCH_SMOKE").is_some();
    let (threads, runs) = (number("BLOCK_THREADS", 2), if smoke { 1 } else { number("BLOCK_RUNS", 11) });
    let tokens = if smoke { 256 } else { number("BLOCK_TOKENS", 2048) };
    par::with_threads(threads, || measure(threads, runs, tokens, smoke))
        .expect("the threads have the default floating-point environment");
}

fn measure(threads: usize, runs: usize, tokens: usize, smoke: bool) {
    println!(
        "{tokens} tokens, {threads} threads, products with {} lanes, medians of {runs} runs",
        gemm::product_lanes()
    );
    let setup = Setup::new(tokens);
    let own_memory = memory(|| drop(setup.both())); // first: memory that was returned once may stay with the process
    let mut peer = if smoke { None } else { Peer::start(&setup.results(), threads) };
    let other_memory = peer.as_mut().map(|peer| peer.number("memory"));
    let kinds: [(&str, &dyn Fn() -> f64); 2] =
        [("forward", &|| seconds(|| setup.forward())), ("both", &|| seconds(|| setup.both()))];
    let mut ours_forward = 0.0;
    for ((kind, ours), work) in kinds.into_iter().zip(work(tokens)) {
        let (mut own, mut theirs, mut ratios) = (vec![], vec![], vec![]);
        for run in 0..=runs {
            let mine = ours();
            let other = peer.as_mut().map(|peer| peer.number(kind));
            if run > 0 {
                own.push(mine);
                theirs.extend(other);
                ratios.extend(other.map(|other| mine / other));
            }
        }
        let own = median(own);
        if kind == "forward" {
            ours_forward = own;
        }
        print!("{kind:>8}: ours {:.1} ms ({:.1} GFLOP/s)", 1e3 * own, work / own);
        if theirs.is_empty() {
            println!("; not run: PyTorch, which the Python at hand does not have");
            continue;
        }
        let theirs = median(theirs);
        println!(
            "; PyTorch {:.1} ms ({:.1} GFLOP/s); ours by theirs {:.3}",
            1e3 * theirs,
            work / theirs,
            median(ratios)
        );
    }
    print!("  peak of memory of a run with gradients, MiB: ours {own_memory:.0}");
    println!("{}", other_memory.map(|other| format!("; PyTorch {other:.0}")).unwrap_or_default());
    if let Some(peer) = &mut peer {
        let line = peer.answer("compare");
        println!("  relative differences: {line}");
        let off = line.split_whitespace().filter_map(|word| word.parse::<f64>().ok());
        assert!(off.into_iter().all(|off| off < 2e-5), "both compute the same");
    }
    split::print(tokens, runs, ours_forward);
}
