//! The occupancy grid of a fitted field: filling 250³ cells coarse to fine and one by one, and the steps of
//! rays by the tree and one by one.
//!
//! `cargo bench --workspace --bench occupancy`. Compare ratios of one run, never absolute times of two machines.
//!
//! The field has six planes of 128² texels with 32 channels and a head 96-32-32-1. It is fitted to the signed
//! distance of a ball with a torus around it, at random points, before anything is measured: once from planes of
//! small random numbers, and once from larger ones, whose noise remains (mean errors of 0.005 and 0.011 R). With
//! `OCCUPANCY_FITS` set, fitted fields are measured instead ([`fits`]).

#![expect(clippy::disallowed_types, reason = "a bench reads the clock")]

mod fits;

use criterion::{Criterion, criterion_group, criterion_main};
use lastlight::field::fetch::{self, Combine, Planes};
use lastlight::field::network::{Network, NetworkBar};
use lastlight::field::occupancy::{Learned, Occupancy, Rule, Settings, fill, fill_all};
use lastlight::field::render::{Intervals, Rays};
use lastlight::field::sdf_head;
use lastlight::geometry::bricks::Bricks;
use std::hint::black_box;

const SIDE: usize = 128;
const CHANNELS: usize = 32;
const FEATURES: usize = 3 * CHANNELS;
const HIDDEN: usize = 32;
const R: f32 = 0.525;
/// Iterations of the fit, and points of each.
const STEPS: usize = 600;
const BATCH: usize = 8192;
/// Steps along the diagonal of the box.
const SAMPLES: usize = 1024;
/// Pixels per side of the image.
const WIDTH: usize = 96;

/// Numbers in −1..1.
struct Numbers(u32);

impl Numbers {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) as f32 / 8_388_608.0 - 1.0
    }
    fn many(&mut self, n: usize, scale: f32) -> Vec<f32> {
        (0..n).map(|_| scale * self.next()).collect()
    }
}

/// A ball and a torus around it.
fn target([x, y, z]: [f32; 3]) -> f32 {
    let ball = (x * x + y * y + z * z).sqrt() - 0.4 * R;
    let around = (x * x + y * y).sqrt() - 0.7 * R;
    let torus = (around * around + z * z).sqrt() - 0.1 * R;
    if ball < torus { ball } else { torus }
}

/// Planes and weights.
struct Field {
    planes: Vec<f32>,
    weights: [Vec<f32>; 3],
}

/// Adam on one array.
struct Adam {
    m: Vec<f32>,
    v: Vec<f32>,
    rate: f32,
}

impl Adam {
    fn new(n: usize, rate: f32) -> Self {
        Self { m: vec![0.0; n], v: vec![0.0; n], rate }
    }
    fn step(&mut self, scale: f32, x: &mut [f32], g: &[f32]) {
        for (i, (x, g)) in x.iter_mut().zip(g).enumerate() {
            self.m[i] = 0.9 * self.m[i] + 0.1 * g;
            self.v[i] = 0.99 * self.v[i] + 0.01 * (g * g);
            *x -= scale * self.rate * self.m[i] / (self.v[i].sqrt() + 1e-8);
        }
    }
}

impl Field {
    /// Fits planes that begin with random numbers up to `start`.
    fn fitted(start: f32) -> Self {
        let mut numbers = Numbers(7);
        let planes = numbers.many(6 * SIDE * SIDE * CHANNELS, start);
        let weights = [(HIDDEN, FEATURES), (HIDDEN, HIDDEN), (1, HIDDEN)]
            .map(|(n, k)| numbers.many(n * k, 0.5 * (6.0 / (n + k) as f32).sqrt()));
        let mut field = Self { planes, weights };
        let mut adams = [Adam::new(field.planes.len(), 2e-3)]
            .into_iter()
            .chain(field.weights.iter().map(|w| Adam::new(w.len(), 2e-3)))
            .collect::<Vec<_>>();
        let mut features = vec![0.0; BATCH * FEATURES];
        for step in 0..STEPS {
            let points: Vec<[f32; 3]> = (0..BATCH).map(|_| [0; 3].map(|_| R * numbers.next())).collect();
            fetch::forward(&field.fetched(), Combine::Concat, &points, &mut features);
            let weights: Vec<&[f32]> = field.weights.iter().map(Vec::as_slice).collect();
            let x = sdf_head::In { features: &features, points: &points, weights: &weights, half_size: R };
            let (sdf, saved) = sdf_head::forward(&x);
            let bar: Vec<f32> = sdf
                .iter()
                .zip(&points)
                .map(|(s, p)| {
                    let t = target(*p);
                    (s - t) * (1.0 + 10.0 * f32::from(u8::from(t.abs() < 0.05 * R))) / BATCH as f32
                })
                .collect();
            if step % 100 == 0 || step + 1 == STEPS {
                let error = sdf.iter().zip(&points).fold(0.0, |e, (s, p)| e + (s - target(*p)).abs());
                println!("step {step}: mean error {} R", error / BATCH as f32 / R);
            }
            let mut network_bar = NetworkBar {
                x: vec![0.0; features.len()],
                weights: weights.iter().map(|w| vec![0.0; w.len()]).collect(),
            };
            sdf_head::adjoint(&x, &saved, &bar, &mut [], &mut network_bar);
            let mut planes_bar = vec![0.0; field.planes.len()];
            fetch::adjoint(
                &field.fetched(),
                Combine::Concat,
                &points,
                &network_bar.x,
                &mut [],
                &mut planes_bar,
            );
            let scale = 1.0 - 0.9 * step as f32 / STEPS as f32;
            adams[0].step(scale, &mut field.planes, &planes_bar);
            for ((w, g), adam) in field.weights.iter_mut().zip(&network_bar.weights).zip(&mut adams[1..]) {
                adam.step(scale, w, g);
            }
        }
        field
    }

    fn fetched(&self) -> Planes<'_> {
        Planes { values: &self.planes, count: 6, side: SIDE, channels: CHANNELS, half_size: R }
    }
}

/// Rays of a square image that contains the box.
fn rays() -> [Vec<[f32; 3]>; 2] {
    let [mut origins, mut directions] = [Vec::new(), Vec::new()];
    for (i, j) in (0..WIDTH * WIDTH).map(|i| (i / WIDTH, i % WIDTH)) {
        let at = |i: usize| 0.4 * ((i as f32 + 0.5) / WIDTH as f32 * 2.0 - 1.0);
        let (x, y) = (at(j), at(i));
        let length = (x * x + y * y + 1.0).sqrt();
        // seen from a corner: the axes of the image are turned by 45°
        let (u, v) = ((1.0 + x) / 2.0_f32.sqrt(), (1.0 - x) / 2.0_f32.sqrt());
        origins.push([-2.6 * R, 0.3 * R, -2.6 * R]);
        directions.push([u / length, y / length, v / length]);
    }
    [origins, directions]
}

/// The steps of rays, by testing each.
fn one_by_one(occupancy: &Occupancy, rays: Rays<'_>, step: f32) -> Intervals {
    let grid = &occupancy.grid;
    Intervals::kept(rays, R, step, |ray, [enter, leave], mut all| {
        let is_kept = |i: &u32| {
            let begin = enter + *i as f32 * step;
            let end = enter + (*i as f32 + 1.0) * step;
            let end = if end < leave { end } else { leave };
            let cell = |t: f32| grid.cell(rays.at(ray, t));
            if occupancy.rule == Rule::Published {
                return grid.is_set(cell(begin + 0.5 * (end - begin)));
            }
            let (a, b) = (cell(begin), cell(end));
            let low = [0, 1, 2].map(|k| a[k].min(b[k]));
            grid.is_any_set(low, [0, 1, 2].map(|k| a[k].max(b[k])))
        };
        all.by_ref().filter(is_kept).collect()
    })
}

fn occupancy(c: &mut Criterion) {
    if let Some(list) = std::env::var("OCCUPANCY_FITS").ok().filter(|list| !list.is_empty()) {
        return fits::run(&list);
    }
    for (name, start) in [("smooth", 0.01), ("rough", 0.1)] {
        of_field(c, name, &Field::fitted(start));
    }
}

fn of_field(c: &mut Criterion, name: &str, field: &Field) {
    let weights: Vec<&[f32]> = field.weights.iter().map(Vec::as_slice).collect();
    let network = Network { weights: &weights, inputs: FEATURES };
    let prepare = || Learned::new(field.fetched(), Combine::Concat, &network).expect("finite numbers");
    let learned = prepare();
    let published = Settings::new(R, SAMPLES, 1.0 / 250.0);
    let conservative = Settings { rule: Rule::Conservative, ..published };
    let run = |settings: &Settings| fill(&learned, settings).expect("settings");

    let mut group = c.benchmark_group(format!("occupancy, {name}"));
    group.sample_size(10);
    group.bench_function("prepare", |b| b.iter(|| black_box(prepare())));
    group.bench_function("fill, published", |b| b.iter(|| black_box(run(&published))));
    group.bench_function("fill, published, cell by cell", |b| {
        b.iter(|| black_box(fill_all(&learned, &published).expect("settings")));
    });
    group.bench_function("fill, conservative", |b| b.iter(|| black_box(run(&conservative))));

    let [origins, directions] = rays();
    let rays = Rays { origins: &origins, directions: &directions };
    for settings in [published, conservative] {
        let (grid, name) = (run(&settings), format!("{:?}", settings.rule).to_lowercase());
        let found = grid.intervals(rays, settings.step);
        assert!(found == one_by_one(&grid, rays, settings.step), "the same steps");
        println!(
            "{name}: {:.4} of the cells, {:.4} of N·rays, {:?}",
            grid.fraction(),
            found.samples() as f64 / (SAMPLES * rays.len()) as f64,
            grid.cost
        );
        group.bench_function(format!("tree, {name}"), |b| {
            b.iter(|| black_box(Bricks::new(&grid.grid)));
        });
        group.bench_function(format!("steps, {name}"), |b| {
            b.iter(|| black_box(grid.intervals(rays, settings.step)));
        });
        group.bench_function(format!("steps, {name}, one by one"), |b| {
            b.iter(|| black_box(one_by_one(&grid, rays, settings.step)));
        });
    }
    group.finish();
}

criterion_group!(benches, occupancy);
criterion_main!(benches);
