//! From 256³ samples to a textured mesh with 1024² texels, step by step; 64³ and 256² in a smoke run.

use criterion::{Criterion, criterion_group, criterion_main};
use lastlight::geometry::atlas::{Settings, unwrap};
use lastlight::geometry::components::{Keep, fill_cavities, keep};
use lastlight::geometry::marching::{Volume, surface};
use lastlight::geometry::smooth::{Smoothing, normals, smooth};
use lastlight::geometry::texels::{cover, fill};

/// A sphere with bumps in every direction.
fn bumpy(p: [f64; 3]) -> f64 {
    let s = |x: f64| libm::sin(9.0 * x);
    let r = (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt();
    r - 0.62 - 0.09 * s(p[0]) * s(p[1] + 0.3) * s(p[2] + 0.7)
}

fn steps(c: &mut Criterion) {
    let is_smoke = std::env::var_os("LASTLIGHT_BENCH_SMOKE").is_some();
    let (n, size) = if is_smoke { (64, 256) } else { (256, 1024) };
    let at = |i: usize| -1.0 + 2.0 * i as f64 / (n - 1) as f64;
    let values: Vec<f32> =
        (0..n * n * n).map(|i| bumpy([at(i / (n * n)), at(i / n % n), at(i % n)]) as f32).collect();
    let volume =
        Volume { values: &values, size: [n; 3], origin: [-1.0; 3], spacing: [2.0 / (n - 1) as f32; 3] };
    let mut group = c.benchmark_group("surface");
    group.sample_size(10);
    group.bench_function("cavities", |b| b.iter(|| fill_cavities(&volume).expect("a volume")));
    group.bench_function("marching", |b| b.iter(|| surface(&volume).expect("a volume")));
    let mut mesh = surface(&volume).expect("a volume");
    group.bench_function("largest part", |b| b.iter(|| keep(&mesh, Keep::Largest).expect("parts")));
    let ten = Smoothing::default();
    group.bench_function("smoothing", |b| {
        b.iter(|| smooth(&mesh.positions, &mesh.triangles, &ten).expect("factors"));
    });
    mesh.positions = smooth(&mesh.positions, &mesh.triangles, &ten).expect("factors");
    group.bench_function("normals", |b| b.iter(|| normals(&mesh)));
    mesh.normals = normals(&mesh);
    let settings = Settings { size, gutter: 4 };
    group.bench_function("atlas", |b| b.iter(|| unwrap(&mesh, &settings).expect("an atlas")));
    let atlas = unwrap(&mesh, &settings).expect("an atlas");
    group.bench_function("texels", |b| {
        b.iter(|| cover(&atlas.mesh, &atlas.chart_of, [size; 2]).expect("coordinates"));
    });
    let texels = cover(&atlas.mesh, &atlas.chart_of, [size; 2]).expect("coordinates");
    group.bench_function("gutters", |b| b.iter(|| fill(&texels, [size; 2], 2 * size)));
    group.finish();
}

criterion_group!(benches, steps);
criterion_main!(benches);
