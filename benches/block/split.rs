//! Where the time of the forward pass goes: its parts, each alone.

use super::{HEADS, HIDDEN, WIDTH, median, normals, seconds};
use lastlight::nn::{gelu, layernorm, linear};
use lastlight::num::gemm::{Finish, Packed, View, gemm_packed_here};
use lastlight::num::{elem, par};

/// Median seconds of `f`, after one run that is not counted.
fn timed(runs: usize, mut f: impl FnMut()) -> f64 {
    f();
    median((0..runs).map(|_| seconds(&mut f)).collect())
}

/// A linear layer (m, k) → (m, n).
fn layer(runs: usize, [m, n, k]: [usize; 3]) -> f64 {
    let (x, weight, bias) = (normals(m * k, 50, 1.0), normals(n * k, 51, 1.0), normals(n, 52, 1.0));
    let mut y = vec![0.0; m * n];
    timed(runs, || linear::forward(linear::In { x: &x, weight: &weight, bias: &bias, m, n, k }, &mut y))
}

/// Products of queries, keys and values, for blocks of 192 queries and 64 keys.
fn between(runs: usize, tokens: usize) -> f64 {
    let d = WIDTH / HEADS;
    let q = normals(192 * d, 53, 1.0);
    let block = |purpose| normals(64 * d, purpose, 1.0);
    let keys_t = Packed::new(View::new(&block(54), 64, d).t());
    let values = Packed::new(View::new(&block(55), 64, d));
    let blocks = tokens.div_ceil(64);
    timed(runs, || {
        par::map(HEADS * tokens.div_ceil(192), |_| {
            let (mut p, mut o) = (vec![0.0; 192 * 64], vec![0.0; 192 * d]);
            for _ in 0..blocks {
                gemm_packed_here(View::new(&q, 192, d), &keys_t, Finish::Store, &mut p);
                gemm_packed_here(View::new(&p, 192, 64), &values, Finish::Resume, &mut o);
            }
            o[0]
        });
    })
}

pub(super) fn print(tokens: usize, runs: usize, all: f64) {
    let layers = [[3 * WIDTH, WIDTH], [WIDTH, WIDTH], [HIDDEN, WIDTH], [WIDTH, HIDDEN]]
        .into_iter()
        .fold(0.0, |sum, [n, k]| sum + layer(runs, [tokens, n, k]));
    let products = between(runs, tokens);
    let x = normals(1 << 12, 56, 3.0);
    let exponentials = timed(runs, || {
        par::map(HEADS * tokens * tokens / x.len(), |_| {
            let mut y = [0.0; 1 << 12];
            elem::exp_lanes_slice(&x, &mut y);
            y[0]
        });
    });
    let (h, mut a) = (normals(tokens * HIDDEN, 57, 1.0), vec![0.0; tokens * HIDDEN]);
    let erf = timed(runs, || gelu::forward(&h, &mut a));
    let (rows, mut n) = (normals(tokens * WIDTH, 58, 1.0), vec![0.0; tokens * WIDTH]);
    let ones = vec![1.0; WIDTH];
    let norm = layernorm::In { x: &rows, gain: &ones, bias: &ones, eps: 1e-6 };
    let norms = timed(runs, || {
        layernorm::forward(&norm, &mut n);
        layernorm::forward(&norm, &mut n);
    });
    let parts = [
        ("linear layers", layers),
        ("products of attention", products),
        ("exponentials", exponentials),
        ("GELU", erf),
        ("two layernorms", norms),
    ];
    println!("  forward, its parts alone: ms, share of {:.1} ms", 1e3 * all);
    for (name, part) in parts {
        println!("    {name:<22} {:6.1}  {:4.1} %", 1e3 * part, 100.0 * part / all);
    }
    let rest = parts.iter().fold(all, |rest, (_, part)| rest - part);
    println!("    {:<22} {:6.1}  {:4.1} %", "the rest", 1e3 * rest, 100.0 * rest / all);
}
