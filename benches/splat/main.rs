//! Forward plus all gradients of the splat renderer on the scene of the record, beside a yardstick in the
//! same run.
//!
//! `cargo bench --workspace --bench splat` prints milliseconds, ratios and the roofline counts; `-- --quick`
//! does the small case.

#![expect(clippy::disallowed_types, reason = "a bench measures time")]

mod yardstick;

use criterion::Criterion;
use lastlight::num::{elem, par, rng::Rng};
use lastlight::scene::camera::{Camera, Model};
use lastlight::scene::profile::Profile;
use lastlight::splat::color::Sh;
use lastlight::splat::plan::{self, Grid};
use lastlight::splat::render::{self, Color, In, InBar, Out, OutBar, Saved, Scratch, Settings, Shape};
use std::hint::black_box;
use std::time::Instant;

struct Scene {
    means: Vec<[f32; 3]>,
    quats: Vec<[f32; 4]>,
    scales: Vec<[f32; 3]>,
    opacities: Vec<f32>,
    sh: Vec<f32>,
    cameras: Vec<Camera>,
}

impl Scene {
    fn new(n: usize, side: usize) -> Self {
        let r = Rng::new(0);
        let each = |f: &dyn Fn(u64) -> f32, i: usize| f(i as u64);
        let normal = |i: usize, d: u16| each(&|i| r.normal_f32(i, 0, 1, d), i);
        let uniform = |i: usize, d: u16| each(&|i| 2.0 * r.uniform_f32(i, 0, 0, d) - 1.0, i);
        let f = 1.1 * side as f32;
        Self {
            means: (0..n).map(|i| std::array::from_fn(|k| uniform(i, k as u16))).collect(),
            scales: (0..n)
                .map(|i| std::array::from_fn(|k| elem::exp(-3.912_023 + 0.4 * normal(i, k as u16))))
                .collect(),
            quats: (0..n).map(|i| std::array::from_fn(|k| normal(i, 3 + k as u16))).collect(),
            opacities: (0..n).map(|i| elem::sigmoid(1.5 * normal(i, 7))).collect(),
            sh: (0..n * 48).map(|i| 0.1 * normal(i / 48, 8 + (i % 48) as u16)).collect(),
            cameras: vec![Camera {
                rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
                translation: [0.0, 0.0, 4.0],
                focal_px: [f, f],
                center_px: [side as f32 / 2.0; 2],
                width: side,
                height: side,
                model: Model::Pinhole,
            }],
        }
    }

    fn input(&self) -> In<'_> {
        In {
            means: &self.means,
            shape: Shape::QuatScale { quats: &self.quats, scales: &self.scales },
            opacities: &self.opacities,
            color: Color::Sh(Sh { values: &self.sh, coefficients: 16, degree: 3 }),
            cameras: &self.cameras,
            background: [0.0; 3],
        }
    }
}

#[derive(Default)]
struct Buffers {
    out: Out,
    saved: Saved,
    bar: InBar,
    scratch: Scratch,
}

/// Arrays in, all gradients out. Returns seconds of (forward, adjoint).
fn once(x: &In<'_>, settings: &Settings, image_bar: &[f32], b: &mut Buffers) -> (f64, f64) {
    let start = Instant::now();
    render::forward_into(x, settings, None, &mut b.out, &mut b.saved);
    let middle = Instant::now();
    b.bar.reset(x);
    let bar = OutBar { image: Some(image_bar), ..OutBar::default() };
    render::adjoint_into(x, settings, None, &b.saved, bar, &mut b.bar, &mut b.scratch);
    ((middle - start).as_secs_f64(), middle.elapsed().as_secs_f64())
}

fn median(mut v: Vec<f64>) -> f64 {
    v.sort_by(f64::total_cmp);
    v[v.len() / 2]
}

fn compare(n: usize, side: usize, runs: usize) {
    let scene = Scene::new(n, side);
    let x = scene.input();
    let gsplat = Settings { profile: Profile::GSPLAT, ..Settings::default() };
    let exact = Settings::default();
    let inria = Settings { profile: Profile::INRIA, ..Settings::default() };
    let bar: Vec<f32> =
        (0..side * side * 3).map(|i| ((i % 7) as f32 - 3.0) / (side * side * 3) as f32).collect();
    let mut b = Buffers::default();
    let grid = Grid { width: side, height: side, tile: 16 };
    let (mut fwd, mut bwd, mut total, mut total_exact, mut yard) = (vec![], vec![], vec![], vec![], vec![]);
    for _ in 0..runs {
        once(&x, &gsplat, &bar, &mut b); // the yardstick has emptied the caches
        let (f, a) = once(&x, &gsplat, &bar, &mut b);
        fwd.push(f);
        bwd.push(a);
        total.push(f + a);
        let (f, a) = once(&x, &exact, &bar, &mut b);
        total_exact.push(f + a);
        let start = Instant::now();
        let mut saved = Saved::default();
        project_only(&x, &inria, &mut saved);
        let lists = plan::build(&saved.splats, 1, &grid, &inria.profile, true);
        let sums = yardstick::forward_backward(&saved.splats, &lists, side, side, |at, _| {
            [bar[3 * at], bar[3 * at + 1], bar[3 * at + 2]]
        });
        black_box(&sums);
        // its projection and colour adjoints: those of the library, on an empty tile list
        b.bar.reset(&x);
        render::adjoint_into(&x, &inria, None, &saved, OutBar::default(), &mut b.bar, &mut b.scratch);
        yard.push(start.elapsed().as_secs_f64());
    }
    once(&x, &gsplat, &bar, &mut b);
    let pairs = b.saved.plan.tile_entry.len();
    let best = |v: &[f64]| 1e3 * v.iter().copied().fold(f64::INFINITY, |a, b| if b < a { b } else { a });
    let (t, e, y) = (median(total.clone()), median(total_exact), median(yard.clone()));
    println!("{n} Gaussians, {side}x{side}, {} threads, SH 3, median of {runs}:", par::threads());
    println!(
        "  gsplat   {:8.2} ms (forward {:.2}, adjoint {:.2}); best {:.2}",
        1e3 * t,
        1e3 * median(fwd),
        1e3 * median(bwd),
        best(&total)
    );
    println!("  exact    {:8.2} ms, {:.3} of gsplat", 1e3 * e, e / t);
    println!(
        "  yardstick{:8.2} ms; best {:.2}: {:.2}x slower (best/best {:.2}x)",
        1e3 * y,
        best(&yard),
        y / t,
        best(&yard) / best(&total)
    );
    let steps = b.saved.pixels.rows.iter().flatten().fold(0_u64, |n, r| n + u64::from(r.count_ones()));
    println!(
        "  {pairs} (splat, tile) pairs, {:.2} M exponentials a pass ({steps} vectors of 8)",
        8e-6 * steps as f64
    );
}

/// Projection and colour without blending: an image of no size would be refused, so the plan is simply
/// dropped.
fn project_only(x: &In<'_>, settings: &Settings, saved: &mut Saved) {
    render::project_all(x, settings, None, saved);
    saved.plan = plan::build(&[], 0, &Grid { width: 16, height: 16, tile: 16 }, &settings.profile, true);
    saved.plan.slot_start = vec![0; x.means.len() + 1];
}

/// For profilers: SPLAT_PROFILE=N,SIDE,RUNS repeats forward and adjoint and nothing else.
fn profile(text: &str) {
    let v: Vec<usize> = text.split(',').filter_map(|t| t.parse().ok()).collect();
    let &[n, side, runs] = v.as_slice() else { panic!("SPLAT_PROFILE=N,SIDE,RUNS, got {text}") };
    let scene = Scene::new(n, side);
    let bar = vec![1e-5; side * side * 3];
    let settings = Settings { profile: Profile::GSPLAT, ..Settings::default() };
    let mut b = Buffers::default();
    let times: Vec<_> = (0..runs).map(|_| once(&scene.input(), &settings, &bar, &mut b)).collect();
    let of = |f: fn(&(f64, f64)) -> f64| 1e3 * median(times.iter().map(f).collect());
    println!("{n} at {side}: forward {:.2} ms, adjoint {:.2} ms", of(|t| t.0), of(|t| t.1));
}

fn main() {
    if let Ok(text) = std::env::var("SPLAT_PROFILE") {
        return profile(&text);
    }
    let mut criterion = Criterion::default().configure_from_args().sample_size(10);
    if !std::env::args().any(|a| a == "--test") {
        let runs = std::env::var("SPLAT_RUNS").ok().and_then(|r| r.parse().ok()).unwrap_or(11);
        compare(50_000, 400, runs);
        if !std::env::args().any(|a| a == "--quick") {
            compare(200_000, 800, runs);
        }
    }
    let scene = Scene::new(10_000, 256);
    let x = scene.input();
    let bar = vec![1e-5; 256 * 256 * 3];
    let mut b = Buffers::default();
    let settings = Settings::default();
    criterion.bench_function("splat.render 10k 256² forward+adjoint", |c| {
        c.iter(|| once(&x, &settings, &bar, &mut b))
    });
    criterion.final_summary();
}
