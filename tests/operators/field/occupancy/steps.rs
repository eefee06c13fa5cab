//! The steps of rays: those that the tree over bricks finds are those of testing every step.

use super::closed::Shape;
use crate::chains::values;
use lastlight::field::occupancy::{Occupancy, Rule, Settings, fill};
use lastlight::field::render::{Intervals, Rays};
use lastlight::geometry::bit_grid::BitGrid;

const R: f32 = 0.75;

/// The definition: a step is kept if the cell of its middle is occupied, or under the conservative rule any of
/// the cells between those of its ends.
fn one_by_one(occupancy: &Occupancy, rays: Rays<'_>, step: f32) -> Vec<Vec<u32>> {
    let all = Intervals::all(rays, R, step);
    let grid = &occupancy.grid;
    let of = |ray: usize| {
        let samples = (all.start[ray]..all.start[ray + 1]).filter(|s| {
            let [begin, end] = all.ends(ray, *s);
            let cell = |t: f32| grid.cell(rays.at(ray, t));
            if occupancy.rule == Rule::Published {
                return grid.is_set(cell(begin + 0.5 * (end - begin)));
            }
            let (a, b) = (cell(begin), cell(end));
            let between = |k: usize| a[k].min(b[k])..=a[k].max(b[k]);
            between(0).any(|x| between(1).any(|y| between(2).any(|z| grid.is_set([x, y, z]))))
        });
        samples.map(|s| all.index[s]).collect()
    };
    (0..rays.len()).map(of).collect()
}

/// Rays from outside and inside, parallel to axes, along faces of cells and of the box, and past the box.
fn rays(side: usize) -> (Vec<[f32; 3]>, Vec<[f32; 3]>) {
    let (mut origins, mut directions) = (Vec::new(), Vec::new());
    let numbers = values(6 * 4000, 31);
    for (i, n) in numbers.as_chunks::<6>().0.iter().enumerate() {
        let [a, b, c, d, e, f] = *n;
        let face = |x: f32| R * (((x * side as f32) as i32) as f32 / side as f32 * 2.0);
        let mut axis = [0.0; 3];
        axis[i % 3] = if a < 0.0 { -1.0 } else { 1.0 };
        let (origin, direction) = match i % 8 {
            0 => ([a, b, c].map(|x| 3.0 * R * x), [d, e, f]),
            1 => ([a, b, c].map(|x| 0.99 * R * x), [d, e, f]),
            2 => ([a, b, c].map(|x| 0.5 * R * x), axis),
            3 => ([face(a), face(b), face(c)], axis),
            4 => ([face(a), face(b), -2.0 * R], [0.0, -0.0, 1.0]),
            5 => ([face(a), b, face(c)], [d, 0.0, f]),
            6 => ([R, R * b, -R], [0.0, e, f]),
            _ => ([a, b, c].map(|x| 40.0 * R * x), [-a + 0.01 * d, -b + 0.01 * e, -c + 0.01 * f]),
        };
        let length = ((direction[0] * direction[0] + direction[1] * direction[1])
            + direction[2] * direction[2])
            .sqrt();
        if length > 0.0 {
            origins.push(origin);
            directions.push(direction.map(|x| x / length));
        }
    }
    (origins, directions)
}

fn assert_same_steps(name: &str, occupancy: &Occupancy, step: f32) {
    let (origins, directions) = rays(occupancy.grid.side());
    let rays = Rays { origins: &origins, directions: &directions };
    let found = occupancy.intervals(rays, step);
    let expected = one_by_one(occupancy, rays, step);
    let mut kept = 0;
    for (ray, expected) in expected.iter().enumerate() {
        let found = &found.index[found.start[ray]..found.start[ray + 1]];
        assert_eq!(found, expected, "{name}, {:?}, step {step}, ray {ray}", occupancy.rule);
        assert!(found.is_sorted_by(|a, b| a < b), "ascending");
        kept += found.len();
    }
    let all = Intervals::all(rays, R, step).samples();
    println!("{name}, {:?}, step {step}: {:.4} of {all} steps", occupancy.rule, kept as f64 / all as f64);
    assert!(kept > 0 && kept < all, "some steps are kept, some are not");
}

/// A grid with some bits.
fn random(side: usize, share: f32, rule: Rule) -> Occupancy {
    let mut grid = BitGrid::new(side, R).expect("even");
    for (i, v) in values(side * side * side, 33).iter().enumerate() {
        if *v > 1.0 - 2.0 * share {
            let cell = [i / side / side, i / side % side, i % side];
            grid.set(cell, cell.map(|i| i + 1));
        }
    }
    Occupancy::new(grid, rule)
}

#[test]
fn the_tree_finds_the_steps_of_testing_every_one() {
    for rule in [Rule::Published, Rule::Conservative] {
        let ball = Shape::Ball { centre: [0.1, -0.2, 0.05], radius: 0.3 };
        let settings = Settings { rule, side: 50, ..Settings::new(R, 512, 0.004) };
        let occupancy = fill(&ball, &settings).expect("settings");
        // steps from an eighth of a cell to five cells
        for cells in [0.125, 0.7, 5.0] {
            assert_same_steps("ball", &occupancy, cells * 2.0 * R / 50.0);
            assert_same_steps("few bits", &random(50, 0.0005, rule), cells * 2.0 * R / 50.0);
            assert_same_steps("many bits", &random(30, 0.05, rule), cells * 2.0 * R / 30.0);
        }
        assert_same_steps("two cells", &random(2, 0.3, rule), 0.1 * R);
    }
}

#[test]
fn nothing_is_kept_of_an_empty_grid_and_everything_of_a_full_one() {
    let (origins, directions) = rays(10);
    let rays = Rays { origins: &origins, directions: &directions };
    for rule in [Rule::Published, Rule::Conservative] {
        let mut grid = BitGrid::new(20, R).expect("even");
        let empty = Occupancy::new(grid.clone(), rule);
        let intervals = empty.intervals(rays, 0.01);
        assert!(empty.bricks.is_empty() && intervals.samples() == 0);
        assert_eq!(intervals.rays(), rays.len(), "rays without steps");
        grid.set([0; 3], [20; 3]);
        let full = Occupancy::new(grid, rule);
        assert_eq!(full.fraction(), 1.0);
        assert_eq!(full.intervals(rays, 0.01), Intervals::all(rays, R, 0.01));
    }
}
