//! Tests that eight and sixteen lanes give the same bits, for every layout of the left factor.

use super::block::{Block, Left, Task};
use super::runs::{AddGrids, Grid, Runs, add_grids};
use super::tile::{Job, Pairs};
use super::{Finish, Packed, View};
use crate::num::rng::Rng;

fn values(n: usize, purpose: u16) -> Vec<f32> {
    let rng = Rng::new(1);
    (0..n).map(|i| rng.normal_f32(i as u64, 0, purpose, 0)).collect()
}

fn bits(x: &[f32]) -> Vec<u32> {
    x.iter().map(|x| x.to_bits()).collect()
}

fn task(c: &mut [f32], n: usize, top: usize) -> Task<'_> {
    Task { top, left: 0, rows: c.chunks_exact_mut(n).collect() }
}

/// Runs with sixteen lanes regardless of the environment variable; returns `false` if the processor has none.
fn by_sixteen(job: impl Job) -> bool {
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = pulp::x86::V4::try_new() {
        job.by(simd);
        return true;
    }
    let _ = job;
    println!("not compared: sixteen lanes, which this processor does not have");
    false
}

/// Computes the product in both ways, with every [`Finish`].
fn agree(a: impl Left, b: &Packed, m: usize, what: &str) {
    let (old, bias) = (values(m * b.n, 0x7e5c), values(b.n, 0x7e5d));
    let mut gates = values(m * b.n, 0x7e70);
    gates.iter_mut().step_by(3).for_each(|x| *x = -0.0);
    let mut stored = vec![0.0; m * b.n];
    Block { a, b, task: task(&mut stored, b.n, 0), how: Finish::Store }.by(Pairs);
    let leaky = |x: f32| if x > 0.0 { x } else { 0.2 * x };
    let relu = |x: f32| if x <= 0.0 { 0.0 } else { x };
    type End<'a> = &'a dyn Fn(usize) -> f32;
    let ends: [(Finish<'_>, End<'_>); 7] = [
        (Finish::Store, &|i| stored[i]),
        (Finish::Add, &|i| old[i] + stored[i]),
        (Finish::AddToZero, &|i| 0.0 + stored[i]),
        (Finish::Bias(&bias), &|i| stored[i] + bias[i % b.n]),
        (Finish::Leaky(&bias, 0.2), &|i| leaky(stored[i] + bias[i % b.n])),
        (Finish::Relu, &|i| relu(stored[i])),
        (Finish::Gated(&gates, b.n), &|i| if gates[i] <= 0.0 { 0.0 } else { stored[i] }),
    ];
    for (how, end) in ends {
        let (mut eight, mut sixteen) = (old.clone(), old.clone());
        Block { a, b, task: task(&mut eight, b.n, 0), how }.by(Pairs);
        let ended: Vec<f32> = (0..m * b.n).map(end).collect();
        assert_eq!(bits(&eight), bits(&ended), "{what}, {how:?}: the end");
        if by_sixteen(Block { a, b, task: task(&mut sixteen, b.n, 0), how }) {
            assert_eq!(bits(&eight), bits(&sixteen), "{what}, {how:?}: lanes");
        }
    }
}

#[test]
fn matrices_have_the_same_bits_with_eight_lanes_and_sixteen() {
    for (m, n, k) in [
        (1, 1, 1),
        (6, 16, 4),
        (7, 17, 5),
        (13, 31, 259),
        (12, 32, 256),
        (5, 33, 3),
        (20, 48, 600),
        (6, 50, 4096),
        (4, 40, 9000),
        (29, 24, 64),
        (30, 4, 64),
        (15, 9, 300),
        (18, 8, 5000),
        (3, 70, 0),
    ] {
        let (a, b) = (values(m * k, 0x7e5e), values(k * n, 0x7e5f));
        let packed = Packed::new(View::new(&b, k, n));
        agree(View::new(&a, m, k), &packed, m, &format!("{m}x{n}x{k} in place"));
        let turned: Vec<f32> = (0..m * k).map(|i| a[i % m * k + i / m]).collect();
        agree(View::new(&turned, k, m).t(), &packed, m, &format!("{m}x{n}x{k} packed"));
    }
}

/// Patches of 3×3 pixels of 5 channels, every second one in both directions.
const CHANNELS: usize = 5;
const ALONG: usize = 2 * CHANNELS;
const RUN: usize = 3 * CHANNELS;

/// Patches in rows and columns of an image.
struct Scene {
    rows: usize,
    columns: usize,
    line: usize,
    offsets: [usize; 3],
    picture: Vec<f32>,
}

impl Scene {
    fn new([rows, columns]: [usize; 2], purpose: u16) -> Self {
        let line = (2 * columns + 1) * CHANNELS;
        let picture = values((2 * rows + 1) * line + ALONG, purpose);
        Self { rows, columns, line, offsets: [0, line, 2 * line], picture }
    }

    fn grid(&self) -> Grid<'_> {
        let Self { rows, columns, line, offsets, picture } = self;
        Grid {
            values: picture,
            rows: *rows,
            columns: *columns,
            down: 2 * line,
            along: ALONG,
            offsets,
            len: RUN,
        }
    }

    fn starts(&self) -> Vec<usize> {
        let start = |i: usize| i / self.columns * 2 * self.line + i % self.columns * ALONG;
        (0..self.rows * self.columns).map(start).collect()
    }
}

#[test]
fn patches_have_the_same_bits_with_eight_lanes_and_sixteen() {
    let scene = Scene::new([4, 5], 0x7e5e);
    let (grid, starts) = (scene.grid(), scene.starts());
    let runs = Runs { values: &scene.picture, starts: &starts, offsets: &scene.offsets, len: RUN };
    for n in [1, 16, 32, 37, 48] {
        let b = values(runs.k() * n, 0x7e5f);
        agree(runs, &Packed::new(View::new(&b, runs.k(), n)), starts.len(), &format!("runs, {n} columns"));
        let b = values(grid.k() * n, 0x7e5f);
        agree(grid, &Packed::new(View::new(&b, grid.k(), n)), grid.m(), &format!("grid, {n} columns"));
    }
}

/// c = (c + p₀) + p₁ …, each product one chain.
fn in_turn(scenes: &[Scene], factors: &[Vec<f32>], [top, n]: [usize; 2], c: &mut [f32]) {
    for (scene, b) in scenes.iter().zip(factors) {
        let starts = scene.starts();
        for (i, c) in c.iter_mut().enumerate() {
            let (row, column) = (top + i / n, i % n);
            let place = scene.offsets[row / RUN] + row % RUN;
            let products =
                starts.iter().enumerate().map(|(k, at)| scene.picture[at + place] * b[k * n + column]);
            *c += products.fold(0.0_f32, |sum, product| sum + product);
        }
    }
}

#[test]
fn sums_over_pictures_are_added_one_after_the_other() {
    // short enough for the sums to stay in registers, and too long
    for size in [[4, 5], [17, 16]] {
        for (n, count) in [(1, 3), (37, 20)] {
            let scenes: Vec<Scene> = (0..count).map(|i| Scene::new(size, 0x7e60 + i)).collect();
            let k = size[0] * size[1];
            let factors: Vec<Vec<f32>> = (0..count).map(|i| values(k * n, 0x7e80 + i)).collect();
            let packed: Vec<Packed> = factors.iter().map(|b| Packed::new(View::new(b, k, n))).collect();
            let items: Vec<(Grid<'_>, &Packed)> = scenes.iter().map(Scene::grid).zip(&packed).collect();
            let (top, m) = (6, items[0].0.m() - 10);
            let old = values(m * n, 0x7e5c);
            let [mut want, mut got, mut eight, mut sixteen] = [0; 4].map(|_| old.clone());
            in_turn(&scenes, &factors, [top, n], &mut want);
            let what = format!("{size:?} patches, {n} columns, {count} images");
            add_grids(&items, top, got.chunks_exact_mut(n).collect());
            assert_eq!(bits(&got), bits(&want), "{what}");
            AddGrids { items: &items, task: task(&mut eight, n, top) }.by(Pairs);
            assert_eq!(bits(&eight), bits(&want), "{what}: eight lanes");
            if by_sixteen(AddGrids { items: &items, task: task(&mut sixteen, n, top) }) {
                assert_eq!(bits(&sixteen), bits(&want), "{what}: sixteen lanes");
            }
        }
    }
}

#[test]
fn a_factor_that_is_read_into_used_memory_is_packed_like_one_that_is_there() {
    let used = Packed::new(View::new(&values(9 * 80, 0x7e5e), 9, 80));
    for (k, n) in [(1, 1), (3, 16), (7, 37), (0, 5), (4, 64), (90, 8)] {
        let b = values(k * n, 0x7e5f);
        let there = Packed::new(View::new(&b, k, n));
        let read =
            used.clone().renewed((k, n), |first, into| into.copy_from_slice(&b[first..][..into.len()]));
        let numbers =
            |packed: &Packed| -> Vec<u32> { packed.panels.iter().flat_map(|c| bits(&c.0)).collect() };
        assert_eq!(numbers(&read), numbers(&there), "{k}x{n}");
        let sums: Vec<f32> = there.column_sums().collect();
        let folds: Vec<f32> = (0..n).map(|j| (0..k).fold(0.0_f32, |sum, i| sum + b[i * n + j])).collect();
        assert_eq!(bits(&sums), bits(&folds), "sums of {k}x{n}");
    }
}

#[test]
fn a_resumed_chain_is_the_chain() {
    for (m, n, k, cut) in [(1, 1, 2, 1), (7, 17, 600, 255), (64, 33, 1500, 512), (13, 50, 4096, 4000)] {
        let (a, b) = (values(m * k, 0x7e60), values(k * n, 0x7e61));
        let mut whole = vec![0.0; m * n];
        super::gemm(View::new(&a, k, m).t(), View::new(&b, k, n), Finish::Store, &mut whole);
        let mut parts = vec![0.0; m * n];
        for ks in [0..cut, cut..k] {
            let (a, b) = (&a[ks.start * m..ks.end * m], &b[ks.start * n..ks.end * n]);
            let (a, b) = (View::new(a, ks.len(), m).t(), View::new(b, ks.len(), n));
            super::gemm(a, b, Finish::Resume, &mut parts);
            let packed = Packed::new(b);
            let (mut eight, mut sixteen) = (values(m * n, 0x7e62), values(m * n, 0x7e62));
            Block { a, b: &packed, task: task(&mut eight, n, 0), how: Finish::Resume }.by(Pairs);
            if by_sixteen(Block { a, b: &packed, task: task(&mut sixteen, n, 0), how: Finish::Resume }) {
                assert_eq!(bits(&eight), bits(&sixteen), "{m}x{n}x{k}: lanes");
            }
        }
        assert_eq!(bits(&parts), bits(&whole), "{m}x{n}x{k}");
    }
}
