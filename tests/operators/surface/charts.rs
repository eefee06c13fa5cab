//! Texture coordinates and their texels: overlap, use, density, gutters, sources of gutters, threads.

use super::shapes::{
    area_and_volume, bumpy, cross, cube, draws, euler, length, marched, minus, sphere, torus,
};
use lastlight::geometry::atlas::{Atlas, Settings, unwrap};
use lastlight::geometry::marching::{Volume, surface};
use lastlight::geometry::smooth::{Smoothing, normals, smooth};
use lastlight::geometry::texels::{NONE, Texel, cover, fill};
use lastlight::num::par;
use lastlight::scene::mesh::Mesh;
use std::collections::BTreeSet;

/// The shapes of the tests.
fn shapes() -> Vec<(&'static str, Mesh)> {
    let rough = marched(96, bumpy);
    let positions = smooth(&rough.positions, &rough.triangles, &Smoothing::default()).expect("factors");
    vec![
        ("sphere", marched(64, sphere(0.7))),
        ("torus", marched(64, torus(0.6, 0.25))),
        ("cube", cube(10, false)),
        ("turned cube", cube(10, true)),
        ("bumpy, smoothed", Mesh { positions, ..rough.clone() }),
        ("bumpy", rough),
    ]
}

fn corners(mesh: &Mesh, t: usize, size: usize) -> [[f64; 2]; 3] {
    mesh.triangles[t].map(|v| mesh.uvs[v as usize].map(|x| f64::from(x) * size as f64))
}

fn area([a, b, c]: [[f64; 2]; 3]) -> f64 {
    0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
}

/// Whether a triangle and a texel have a common point: separating axes of both.
fn touches(p: [[f64; 2]; 3], x: usize, y: usize) -> bool {
    let square = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[i, j]| [(x + i) as f64, (y + j) as f64]);
    let apart = |n: [f64; 2]| {
        let ends = |q: &[[f64; 2]]| {
            q.iter()
                .map(|q| n[0] * q[0] + n[1] * q[1])
                .fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], d| {
                    [if d < a { d } else { a }, if d > b { d } else { b }]
                })
        };
        let ([a, b], [c, d]) = (ends(&p), ends(&square));
        b < c || d < a
    };
    let sides = [0, 1, 2].map(|k| [p[k][1] - p[(k + 1) % 3][1], p[(k + 1) % 3][0] - p[k][0]]);
    ![[1.0, 0.0], [0.0, 1.0]].into_iter().chain(sides).any(apart)
}

/// For each texel the chart that touches it; several charts are a failure.
fn owners(atlas: &Atlas, size: usize) -> Vec<u32> {
    let mut owner = vec![NONE; size * size];
    for t in 0..atlas.mesh.triangles.len() {
        let p = corners(&atlas.mesh, t, size);
        let range = |k: usize| {
            let ends = p.iter().fold([f64::INFINITY, 0.0], |[a, b], q| {
                [if q[k] < a { q[k] } else { a }, if q[k] > b { q[k] } else { b }]
            });
            ends[0].floor() as usize..(ends[1].floor() as usize + 1).min(size)
        };
        for y in range(1) {
            for x in range(0).filter(|&x| touches(p, x, y)) {
                let before = std::mem::replace(&mut owner[y * size + x], atlas.chart_of[t]);
                assert!(before == NONE || before == atlas.chart_of[t], "texel {x}, {y} has two charts");
            }
        }
    }
    owner
}

/// Sample points per texel of a finer grid that lie in the interior of two triangles.
fn doubly_covered(mesh: &Mesh, n: usize) -> usize {
    let mut count = vec![0_u8; n * n];
    for t in 0..mesh.triangles.len() {
        let p = corners(mesh, t, n);
        // an irrational offset: no sample lies on an edge
        let sample = |i: usize| i as f64 + 0.414_213_562;
        let range = |k: usize| {
            let ends = p.iter().fold([f64::INFINITY, 0.0], |[a, b], q| {
                [if q[k] < a { q[k] } else { a }, if q[k] > b { q[k] } else { b }]
            });
            ends[0] as usize..(ends[1] as usize + 1).min(n)
        };
        for y in range(1) {
            for x in range(0) {
                let q = [sample(x), sample(y)];
                let e = [0, 1, 2].map(|k| area([p[k], p[(k + 1) % 3], q]));
                if e.iter().all(|e| *e > 1e-6) || e.iter().all(|e| *e < -1e-6) {
                    count[y * n + x] += 1;
                }
            }
        }
    }
    count.iter().filter(|c| **c > 1).count()
}

/// Checks that texels between charts number at least `gutter`.
fn check_gutter(owner: &[u32], size: usize, gutter: usize) {
    for (i, &own) in owner.iter().enumerate().filter(|(_, own)| **own != NONE) {
        let (x, y) = (i % size, i / size);
        for j in y..(y + gutter + 1).min(size) {
            for k in x.saturating_sub(gutter)..(x + gutter + 1).min(size) {
                let other = owner[j * size + k];
                assert!(other == own || other == NONE, "charts {own} at {x}, {y} and {other} at {k}, {j}");
            }
        }
    }
}

/// The ratio of texel densities between which 95 % of the area lies, the smallest and largest being cut alike.
fn density_ratio(atlas: &Atlas, size: usize) -> f64 {
    let mut rows: Vec<[f64; 2]> = (0..atlas.mesh.triangles.len())
        .map(|t| {
            let [a, b, c] = atlas.mesh.corners(t).map(|p| p.map(f64::from));
            let surface = 0.5 * length(cross(minus(b, a), minus(c, a)));
            [area(corners(&atlas.mesh, t, size)).abs() / surface, surface]
        })
        .filter(|[density, surface]| density.is_finite() && *surface > 0.0)
        .collect();
    rows.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let total = rows.iter().fold(0.0, |s, r| s + r[1]);
    let at = |fraction: f64| {
        let mut sum = 0.0;
        rows.iter()
            .find(|r| {
                sum += r[1];
                sum >= fraction * total
            })
            .expect("a row")[0]
    };
    at(0.975) / at(0.025)
}

#[test]
fn charts_do_not_overlap_and_use_half_of_the_texels() {
    let settings = Settings::default();
    let size = settings.size;
    for (name, mesh) in shapes() {
        let atlas = unwrap(&mesh, &settings).unwrap_or_else(|e| panic!("{name}: {e}"));
        let owner = owners(&atlas, size);
        check_gutter(&owner, size, settings.gutter);
        let twice = doubly_covered(&atlas.mesh, 4 * size);
        assert_eq!(twice, 0, "{name}: samples in two triangles");
        let texels = cover(&atlas.mesh, &atlas.chart_of, [size; 2]).expect("coordinates");
        let (used, ratio) = (texels.len() as f64 / (size * size) as f64, density_ratio(&atlas, size));
        println!(
            "{name}: {} triangles, {} charts, {used:.3} of the texels, densities within {ratio:.2}",
            mesh.triangles.len(),
            atlas.charts
        );
        assert!(used >= 0.5, "{name}: {used} of the texels");
        assert!(ratio <= 2.0, "{name}: densities within a factor of {ratio}");
        // the same surface: triangles in order, vertices with their positions
        for (t, (new, old)) in atlas.mesh.triangles.iter().zip(&mesh.triangles).enumerate() {
            assert_eq!(new.map(|v| atlas.source[v as usize]), *old, "{name}: triangle {t}");
            assert_eq!(atlas.mesh.corners(t), mesh.corners(t), "{name}: triangle {t}");
            let is_mirrored = area(corners(&atlas.mesh, t, size)) > 1e-6;
            assert!(!is_mirrored, "{name}: triangle {t} is mirrored (v is down)");
        }
        let first_use: Vec<u32> = atlas.mesh.triangles.iter().flatten().copied().collect();
        let mut most = 0;
        assert!(
            first_use.iter().all(|&v| {
                let ok = v <= most;
                most = most.max(v + 1);
                ok
            }),
            "{name}: order of first use"
        );
        assert!(atlas.mesh.uvs.iter().flatten().all(|x| 1.0 - (1.0 - x) == *x), "{name}: 1 − v is exact");
    }
}

#[test]
fn long_and_hollow_shapes_use_half_of_the_texels() {
    let grid = |n: u32, m: u32, p: &dyn Fn(f64, f64) -> [f64; 3]| {
        let mut mesh = Mesh::default();
        for i in 0..=n {
            for j in 0..=m {
                let point = p(f64::from(i) / f64::from(n), f64::from(j) / f64::from(m));
                mesh.positions.push(point.map(|x| x as f32));
            }
        }
        for k in (0..n).flat_map(|i| (0..m).map(move |j| i * (m + 1) + j)) {
            mesh.triangles.extend([[k, k + 1, k + m + 2], [k, k + m + 2, k + m + 1]]);
        }
        mesh
    };
    let circle = |u: f64| [libm::cos(6.3 * u), libm::sin(6.3 * u)];
    let strip = grid(300, 4, &|u, v| [50.0 * u, 30.0 * u, 0.5 * v]);
    let ring = grid(200, 4, &|u, v| {
        [circle(0.99 * u)[0] * (1.0 + 0.1 * v), circle(0.99 * u)[1] * (1.0 + 0.1 * v), 0.0]
    });
    let rod = grid(300, 40, &|u, v| [40.0 * u, circle(0.99 * v)[0], circle(0.99 * v)[1]]);
    let size = 512;
    for (name, mesh) in [("strip", strip), ("ring", ring), ("rod", rod)] {
        let atlas = unwrap(&mesh, &Settings { size, gutter: 4 }).unwrap_or_else(|e| panic!("{name}: {e}"));
        check_gutter(&owners(&atlas, size), size, 4);
        let texels = cover(&atlas.mesh, &atlas.chart_of, [size; 2]).expect("coordinates");
        let used = texels.len() as f64 / (size * size) as f64;
        println!(
            "{name}: {} charts, {used:.3} of the texels, densities within {:.2}",
            atlas.charts,
            density_ratio(&atlas, size)
        );
        assert!(used >= 0.5 && density_ratio(&atlas, size) <= 2.0, "{name}: {used} of the texels");
    }
}

#[test]
fn texels_are_points_of_the_surface_and_gutters_take_the_nearest() {
    let mut mesh = marched(48, torus(0.6, 0.25));
    mesh.normals = normals(&mesh);
    let size = 256;
    let atlas = unwrap(&mesh, &Settings { size, gutter: 4 }).expect("an atlas");
    let texels = cover(&atlas.mesh, &atlas.chart_of, [size; 2]).expect("coordinates");
    assert!(texels.is_sorted_by(|a, b| a.index < b.index), "ascending");
    for t in &texels {
        let p = t.position.map(f64::from);
        assert!(torus(0.6, 0.25)(p).abs() < 4e-3, "a texel on the torus: {t:?}");
        let r = (p[0] * p[0] + p[1] * p[1]).sqrt();
        let out = [p[0] - 0.6 * p[0] / r, p[1] - 0.6 * p[1] / r, p[2]];
        let cos = (0..3).fold(0.0, |s, k| s + out[k] * f64::from(t.normal[k])) / length(out);
        assert!(cos > 0.99, "its normal: {t:?}, {cos}");
        let uv: [f64; 2] = std::array::from_fn(|k| {
            let corners = corners(&atlas.mesh, t.triangle as usize, size);
            (0..3).fold(0.0, |s, c| s + f64::from(t.barycentric[c]) * corners[c][k])
        });
        let centre = [t.index as usize % size, t.index as usize / size].map(|i| i as f64 + 0.5);
        assert!((0..2).all(|k| (uv[k] - centre[k]).abs() < 1e-3), "its centre {centre:?}, not {uv:?}");
    }
    let sources = fill(&texels, [size; 2], 8);
    let covered: Vec<(usize, usize)> =
        texels.iter().map(|t| (t.index as usize % size, t.index as usize / size)).collect();
    let is_covered: BTreeSet<u32> = texels.iter().map(|t| t.index).collect();
    for (i, &s) in sources.iter().enumerate().step_by(7) {
        let (x, y) = (i % size, i / size);
        let square = |&(a, b): &(usize, usize)| a.abs_diff(x).pow(2) + b.abs_diff(y).pow(2);
        let nearest = covered.iter().map(square).min().expect("covered");
        if is_covered.contains(&(i as u32)) {
            assert_eq!(texels[s as usize].index as usize, i, "a covered texel keeps its value");
        } else if nearest <= 64 {
            let first = covered.iter().position(|at| square(at) == nearest).expect("one");
            assert_eq!(s as usize, first, "texel {x}, {y}: the nearest, of equals the first");
        } else {
            assert_eq!(s, NONE, "texel {x}, {y}: {nearest} is too far");
        }
    }
    assert!(fill(&texels, [size; 2], 2 * size).iter().all(|s| *s != NONE), "a large radius fills everything");
}

#[test]
fn a_chart_smaller_than_a_texel_has_a_value() {
    // a large square and, elsewhere, one of 1/1000 of its side
    let mut mesh = Mesh::default();
    for (side, at) in [(1.0, 0.0), (1e-3, 9.0)] {
        let first = mesh.positions.len() as u32;
        mesh.positions
            .extend([[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]].map(|[x, y]| [x + at, y, 0.0]));
        mesh.triangles.extend([[0, 1, 2], [0, 2, 3]].map(|t| t.map(|i| i + first)));
    }
    let atlas = unwrap(&mesh, &Settings { size: 64, gutter: 4 }).expect("an atlas");
    let texels = cover(&atlas.mesh, &atlas.chart_of, [64; 2]).expect("coordinates");
    let charts: BTreeSet<u32> = texels.iter().map(|t| atlas.chart_of[t.triangle as usize]).collect();
    assert_eq!((atlas.charts, charts.len()), (2, 2), "both charts");
    assert!(texels.len() > 2048, "the large one is not smaller for it: {}", texels.len());
}

#[test]
fn atlases_do_not_depend_on_threads() {
    let mesh = marched(40, bumpy);
    let run = |n: usize| {
        par::with_threads(n, || {
            let atlas = unwrap(&mesh, &Settings { size: 256, gutter: 4 }).expect("an atlas");
            let texels: Vec<Texel> = cover(&atlas.mesh, &atlas.chart_of, [256; 2]).expect("coordinates");
            let sources = fill(&texels, [256; 2], 6);
            (atlas, texels, sources)
        })
        .expect("a pool")
    };
    let one = run(1);
    for n in [2, 3, 7] {
        assert!(one == run(n), "{n} threads");
    }
}

#[test]
fn degenerate_and_folded_meshes_have_an_atlas() {
    // integer samples: many triangles without area; a random volume: every direction, thin parts
    let integers: Vec<f32> = draws(12 * 12 * 12, 31).iter().map(|x| (x * 1.4).round() as f32).collect();
    let random: Vec<f32> = draws(9 * 9 * 9, 32).iter().map(|x| *x as f32).collect();
    // a spiral ramp: one turn and a half, whose projection overlaps although no triangle is steep
    let mut ramp = Mesh::default();
    for i in 0..=60_u32 {
        let a = 3.0 * std::f64::consts::PI * f64::from(i) / 60.0;
        for r in [0.5, 1.0] {
            ramp.positions.push([r * libm::cos(a), r * libm::sin(a), 0.1 * a].map(|x| x as f32));
        }
        if i > 0 {
            let k = 2 * (i - 1);
            ramp.triangles.extend([[k, k + 1, k + 3], [k, k + 3, k + 2]]);
        }
    }
    let volume = |values: &[f32], n: usize| {
        surface(&Volume { values, size: [n; 3], origin: [0.0; 3], spacing: [1.0; 3] }).expect("a volume")
    };
    for (name, mesh, size) in
        [("integers", volume(&integers, 12), 2048), ("random", volume(&random, 9), 1024), ("ramp", ramp, 512)]
    {
        let atlas = unwrap(&mesh, &Settings { size, gutter: 4 }).unwrap_or_else(|e| panic!("{name}: {e}"));
        check_gutter(&owners(&atlas, size), size, 4);
        let twice = doubly_covered(&atlas.mesh, 2 * size);
        println!("{name}: {} triangles, {} charts", mesh.triangles.len(), atlas.charts);
        assert_eq!(twice, 0, "{name}: samples in two triangles");
        let texels = cover(&atlas.mesh, &atlas.chart_of, [size; 2]).expect("coordinates");
        let charts: BTreeSet<u32> = texels.iter().map(|t| atlas.chart_of[t.triangle as usize]).collect();
        assert_eq!(charts.len(), atlas.charts, "{name}: every chart has a texel");
    }
}

#[test]
fn meshes_without_area_and_sizes_without_room_are_refused() {
    let point = Mesh { positions: vec![[1.0; 3]; 3], triangles: vec![[0, 1, 2]], ..Mesh::default() };
    let refused = |mesh: &Mesh, size, gutter| {
        unwrap(mesh, &Settings { size, gutter }).expect_err("refused").to_string()
    };
    assert!(refused(&point, 64, 4).contains("positive area"), "no area");
    assert!(refused(&Mesh::default(), 64, 4).contains("positive area"), "no triangle");
    let block = cube(2, false);
    assert!(refused(&block, 8, 1).contains("16 to"), "too small");
    assert!(refused(&block, 16, 16).contains("room for 6 charts"), "no room");
    assert!(cover(&block, &[0; 48], [64; 2]).is_err(), "no coordinates");
    let [surface, _] = area_and_volume(&block);
    assert!((surface - 6.0).abs() < 1e-6 && euler(&block) == Ok(2), "the cube of the tests");
}
