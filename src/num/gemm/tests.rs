//! Eight lanes and sixteen have the same bits, for every way in which a left factor lies.

use super::block::{Block, Left, Task};
use super::runs::{AddGrids, Grid, Runs};
use super::tile::{Job, Pairs, widest};
use super::{Finish, Packed, View, lanes};
use crate::num::rng::Rng;

fn values(n: usize, purpose: u16) -> Vec<f32> {
    let rng = Rng::new(1);
    (0..n).map(|i| rng.normal_f32(i as u64, 0, purpose, 0)).collect()
}

fn bits(x: &[f32]) -> Vec<u32> {
    x.iter().map(|x| x.to_bits()).collect()
}

fn task(c: &mut [f32], n: usize) -> Task<'_> {
    Task { top: 0, left: 0, rows: c.chunks_exact_mut(n).collect() }
}

/// The product in both ways, after every kind of end.
fn same(a: impl Left, b: &Packed, m: usize, what: &str) {
    let (old, bias) = (values(m * b.n, 0x7e5c), values(b.n, 0x7e5d));
    for how in [Finish::Store, Finish::Add, Finish::AddToZero, Finish::Bias(&bias), Finish::Leaky(&bias, 0.2)]
    {
        let (mut eight, mut wide) = (old.clone(), old.clone());
        Block { a, b, task: task(&mut eight, b.n), how }.by(Pairs);
        widest(Block { a, b, task: task(&mut wide, b.n), how });
        assert_eq!(bits(&eight), bits(&wide), "{what}, {how:?}");
    }
}

#[test]
fn eight_lanes_and_the_widest_have_the_same_bits() {
    if lanes() == 8 {
        println!("no AVX-512 here: eight lanes are compared with themselves");
    }
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
        (3, 70, 0),
    ] {
        let (a, b) = (values(m * k, 0x7e5e), values(k * n, 0x7e5f));
        let packed = Packed::new(View::new(&b, k, n));
        same(View::new(&a, m, k), &packed, m, &format!("{m}x{n}x{k} in place"));
        let turned: Vec<f32> = (0..m * k).map(|i| a[i % m * k + i / m]).collect();
        same(View::new(&turned, k, m).t(), &packed, m, &format!("{m}x{n}x{k} packed"));
    }
}

#[test]
fn patches_have_the_same_bits() {
    // patches of 3×3 pixels of 5 channels in a picture of 9×11, every second one
    let (channels, width, height) = (5, 11, 9);
    let (line, along) = (width * channels, 2 * channels);
    let picture = values(height * line + along, 0x7e5e);
    let offsets = [0, line, 2 * line];
    let (rows, columns) = (4, 5);
    let starts: Vec<usize> =
        (0..rows * columns).map(|i| i / columns * 2 * line + i % columns * along).collect();
    let runs = Runs { values: &picture, starts: &starts, offsets: &offsets, len: 3 * channels };
    let grid = Grid { values: &picture, rows, columns, down: 2 * line, along, offsets: &offsets, len: 15 };
    for n in [1, 16, 32, 37, 48] {
        let b = values(runs.k() * n, 0x7e5f);
        same(runs, &Packed::new(View::new(&b, runs.k(), n)), starts.len(), &format!("runs, {n} columns"));
        let b = values(grid.k() * n, 0x7e5f);
        let packed = Packed::new(View::new(&b, grid.k(), n));
        same(grid, &packed, grid.m(), &format!("grid, {n} columns"));
        // one item after the other, and both with their sums in registers
        let other = values(picture.len(), 0x7e5d);
        let items = [(grid, &packed), (Grid { values: &other, ..grid }, &packed)];
        let old = values(grid.m() * n, 0x7e5c);
        let [mut eight, mut wide, mut turns] = [old.clone(), old.clone(), old];
        AddGrids { items: &items, task: task(&mut eight, n) }.by(Pairs);
        widest(AddGrids { items: &items, task: task(&mut wide, n) });
        for (a, b) in items {
            Block { a, b, task: task(&mut turns, n), how: Finish::Add }.by(Pairs);
        }
        assert_eq!(bits(&eight), bits(&wide), "items, {n} columns");
        assert_eq!(bits(&eight), bits(&turns), "items in turn, {n} columns");
    }
}

#[test]
fn a_factor_that_is_read_is_packed_like_one_that_is_there() {
    for (k, n) in [(1, 1), (3, 16), (7, 37), (0, 5), (4, 64)] {
        let b = values(k * n, 0x7e5f);
        let there = Packed::new(View::new(&b, k, n));
        let read =
            there.clone().renewed_from((k, n), |first, into| into.copy_from_slice(&b[first..][..into.len()]));
        let numbers =
            |packed: &Packed| -> Vec<u32> { packed.panels.iter().flat_map(|c| bits(&c.0)).collect() };
        assert_eq!(numbers(&read), numbers(&there), "{k}x{n}");
        let sums: Vec<f32> = there.column_sums().collect();
        let folds: Vec<f32> = (0..n).map(|j| (0..k).fold(0.0_f32, |sum, i| sum + b[i * n + j])).collect();
        assert_eq!(bits(&sums), bits(&folds), "sums of {k}x{n}");
    }
}
