//! Filling coarse to fine: the same cells as without leaving anything out, for any number of threads.

use super::closed::Shape;
use crate::chains::values;
use lastlight::field::fetch::{Combine, Planes};
use lastlight::field::network::Network;
use lastlight::field::occupancy::{Bounded, Learned, Rule, Settings, fill, fill_all};
use lastlight::num::par;

const RULES: [Rule; 2] = [Rule::Published, Rule::Conservative];
const R: f32 = 0.525;
const SIDE: usize = 16;
const CHANNELS: usize = 6;

/// Random planes that change slowly, and a random network: a surface of many parts.
struct Field {
    planes: Vec<f32>,
    weights: [Vec<f32>; 3],
}

impl Field {
    fn new() -> Self {
        let noise = values(6 * SIDE * SIDE * CHANNELS, 21);
        let at = |plane: usize, i: usize, j: usize, c: usize| {
            noise[((plane * SIDE + i.min(SIDE - 1)) * SIDE + j.min(SIDE - 1)) * CHANNELS + c]
        };
        let mut planes = Vec::with_capacity(noise.len());
        for plane in 0..6 {
            for (i, j) in (0..SIDE * SIDE).map(|t| (t / SIDE, t % SIDE)) {
                planes.extend((0..CHANNELS).map(|c| {
                    let sum = (0..16).fold(0.0, |sum, k| sum + at(plane, i + k / 4, j + k % 4, c));
                    0.1 * sum
                }));
            }
        }
        let weights = [(8 * 3 * CHANNELS, 22), (8 * 8, 23), (8, 24)].map(|(n, seed)| values(n, seed));
        Self { planes, weights }
    }

    fn with<T>(&self, run: impl FnOnce(&Learned<'_>) -> T) -> T {
        let planes = Planes { values: &self.planes, count: 6, side: SIDE, channels: CHANNELS, half_size: R };
        let weights: Vec<&[f32]> = self.weights.iter().map(Vec::as_slice).collect();
        let network = Network { weights: &weights, inputs: 3 * CHANNELS };
        run(&Learned::new(planes, Combine::Concat, &network).expect("finite numbers"))
    }
}

fn assert_same_cells(name: &str, sdf: &impl Bounded, settings: &Settings) {
    let (short, all) = (fill(sdf, settings).expect("settings"), fill_all(sdf, settings).expect("settings"));
    let (kept, of) = (short.grid.count(), settings.side * settings.side * settings.side);
    println!(
        "{name}, {:?}, 1/β = {}: {:.4} of the cells, {:.4} of the values, {} bounds",
        settings.rule,
        1.0 / settings.beta,
        short.fraction(),
        short.cost.values as f64 / of as f64,
        short.cost.bounds
    );
    assert!(kept > 0 && kept < of, "{name}: some cells are removed, some are not: {kept}");
    assert!(short.grid == all.grid, "{name}, {:?}: the same cells", settings.rule);
    let half = (all.cost.values + all.cost.bounds) / 2;
    assert!(short.cost.values + short.cost.bounds < half, "{name}: parts are left out");
    for threads in [1, 2, 3, 7] {
        let again = par::with_threads(threads, || fill(sdf, settings)).expect("threads start");
        let again = again.expect("settings");
        assert!(again.grid == short.grid && again.cost == short.cost, "{threads} threads");
    }
}

#[test]
fn coarse_to_fine_fills_the_same_cells_as_one_by_one() {
    for rule in RULES {
        for beta in [0.02, 0.004] {
            let settings = Settings { rule, side: 62, ..Settings::new(R, 256, beta) };
            Field::new().with(|learned| assert_same_cells("learned", learned, &settings));
            let ball = Shape::Ball { centre: [0.1, -0.05, 0.02], radius: 0.2 };
            assert_same_cells("ball", &ball, &settings);
            let tilted = super::closed::unit([0.3, 0.5, 0.8]);
            let plate = Shape::Plate { normal: tilted, point: [0.0; 3], thickness: 0.001 };
            assert_same_cells("plate", &plate, &settings);
        }
    }
}

#[test]
fn the_published_rule_is_alpha_at_the_middle() {
    Field::new().with(|learned| {
        let settings = Settings { side: 24, ..Settings::new(R, 128, 0.02) };
        let occupancy = fill(learned, &settings).expect("settings");
        let mut s = Vec::new();
        for (x, y, z) in (0..24 * 24 * 24).map(|i| (i / 576, i / 24 % 24, i % 24)) {
            let middle = [x, y, z].map(|i| R * ((2 * i + 1) as f32 / 24.0 - 1.0));
            learned.values(&[middle], &mut s);
            let q = f64::from(s[0].abs() / 0.02);
            let sigma = if s[0] > 0.0 { 0.5 * libm::exp(-q) } else { 1.0 - 0.5 * libm::exp(-q) } / 0.02;
            let alpha = -libm::expm1(-sigma * f64::from(settings.step));
            // the step is 2√3R/N
            assert!((f64::from(settings.step) - 12.0_f64.sqrt() * 0.525 / 128.0).abs() < 1e-8);
            if (alpha - 1e-4).abs() > 1e-8 {
                assert_eq!(occupancy.grid.is_set([x, y, z]), alpha > 1e-4, "cell {x} {y} {z}, s = {}", s[0]);
            }
        }
    });
}

#[test]
fn the_limit_of_the_conservative_rule_is_that_of_the_paper_scale() {
    // N = 1024, τ = 1e-4, 1/β = 250, R = 0.525: 14.6 β
    let limit = Settings::new(R, 1024, 0.004).limit() / 0.004;
    assert!((limit - 14.64).abs() < 0.01, "{limit} β");
}

#[test]
fn cells_are_found_from_both_sides_of_the_centre() {
    use lastlight::geometry::bit_grid::BitGrid;
    let grid = BitGrid::new(250, R).expect("even");
    assert_eq!(grid.cell([0.0, -0.0, 1e-30]), [124, 124, 125], "zeros are of the lower side");
    assert_eq!(grid.cell([-R, R, 9.0]), [0, 249, 249], "points on and beyond the border");
    for i in (0..250).step_by(7) {
        assert_eq!(grid.cell(grid.centre([i, 249 - i, i])), [i, 249 - i, i], "the middle of a cell");
        let [low, high] = grid.edges([i; 3], [i + 1; 3]);
        for x in values(200, 40 + i as u64).iter().map(|x| 1.1 * R * x) {
            if grid.cell([x; 3])[0] == i && x.abs() <= R {
                assert!(low[0] <= x && x <= high[0], "cell {i}: {x} in {low:?} {high:?}");
            }
        }
    }
}

#[test]
fn bad_input_is_refused_or_keeps_cells() {
    let settings = Settings { side: 24, ..Settings::new(R, 128, 0.02) };
    let message = |settings: Settings| fill(&Shape::Nothing, &settings).expect_err("refused").to_string();
    assert!(message(Settings { side: 25, ..settings }).contains("even number of cells"));
    assert!(message(Settings { side: 0, ..settings }).contains("even number of cells"));
    assert!(message(Settings { beta: 0.0, ..settings }).contains("positive β"));
    assert!(message(Settings { step: f32::NAN, ..settings }).contains("positive step"));
    assert!(message(Settings { half_size: -1.0, ..settings }).contains("half size"));

    let mut field = Field::new();
    field.planes[77] = f32::NAN;
    let weights: Vec<&[f32]> = field.weights.iter().map(Vec::as_slice).collect();
    let network = Network { weights: &weights, inputs: 3 * CHANNELS };
    let planes = Planes { values: &field.planes, count: 6, side: SIDE, channels: CHANNELS, half_size: R };
    let refused = Learned::new(planes, Combine::Concat, &network).expect_err("NaN").to_string();
    assert!(refused.contains("planes") && refused.contains("77") && refused.contains("finite"), "{refused}");
    let refused = Learned::new(planes, Combine::Sum, &network).expect_err("another width").to_string();
    assert!(refused.contains("6 inputs"), "{refused}");
    let short = Planes { values: &field.planes[1..], ..planes };
    assert!(Learned::new(short, Combine::Concat, &network).is_err(), "planes of another size");

    for rule in RULES {
        let settings = Settings { rule, ..settings };
        for sdf in [Shape::Nothing, Shape::NotANumber] {
            let occupancy = fill(&sdf, &settings).expect("settings");
            let expected = if matches!(sdf, Shape::Nothing) { 0.0 } else { 1.0 };
            assert_eq!(occupancy.fraction(), expected, "{sdf:?} under {rule:?}");
        }
    }
}
