//! Rays, distances and samples of meshes: arrays of another program, closed forms, numbers of threads.

use crate::common::golden;
use lastlight::geometry::bvh::{Bvh, Hit, MISS, Ray};
use lastlight::geometry::{compare, nearest};
use lastlight::num::par;
use lastlight::num::rng::Rng;
use lastlight::ops::{self, Call};
use lastlight::oracle::run::{self, Precision};
use lastlight::scene::mesh;

type Mesh = (Vec<[f32; 3]>, Vec<[u32; 3]>);

fn threes(flat: &[f64]) -> Vec<[f32; 3]> {
    flat.as_chunks().0.iter().map(|p: &[f64; 3]| p.map(|x| x as f32)).collect()
}

/// Whether the triangle is hit at that t by the golden file's own arithmetic, up to rounding in f64.
fn is_tie(p: &[[f32; 3]], triangle: [u32; 3], o: [f32; 3], d: [f32; 3], t: f64) -> bool {
    let [a, b, c] = triangle.map(|i| p[i as usize].map(f64::from));
    let sub = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    };
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let (o, d) = (o.map(f64::from), d.map(f64::from));
    let n = cross(sub(b, a), sub(c, a));
    let other = dot(n, sub(a, o)) / dot(n, d);
    (other - t).abs() <= 1e-12 * (1.0 + t)
}

#[test]
fn golden_trace_mesh() {
    let Some(theirs) = golden("trace_mesh") else { return };
    let op = ops::find("geometry.trace").expect("on the list");
    let f64s = |name: &str| theirs.need(name).expect("in the file").to_f64();
    let (t, triangle) = (f64s("t"), f64s("triangle"));
    let (p, o, d) = (threes(&f64s("vertices")), threes(&f64s("origin")), threes(&f64s("direction")));
    let corners: Vec<[u32; 3]> =
        f64s("triangles").as_chunks().0.iter().map(|c: &[f64; 3]| c.map(|i| i as u32)).collect();
    let bounds = lastlight::scene::mesh::Mesh { positions: p.clone(), ..Default::default() }.bounds();
    let diameter = (0..3).map(|k| f64::from(bounds[1][k] - bounds[0][k])).fold(0.0, |s, x| s + x * x).sqrt();
    for (precision, relative) in [(Precision::F64, 1e-12), (Precision::F32, 2e-6)] {
        let sorted = run::sort(op, theirs.clone()).unwrap_or_else(|e| panic!("{e}"));
        assert!(
            sorted.notes.iter().any(|n| n.contains("crossings")),
            "the companion is noted: {:?}",
            sorted.notes
        );
        let ran = run::call(op, &sorted.call, precision).unwrap_or_else(|e| panic!("{e}"));
        let ours_t = ran.outputs.need("t").expect("an output").to_f64();
        let ours = ran.outputs.need("triangle").expect("an output").to_f64();
        let (mut worst, mut ties) = (0.0_f64, 0);
        for i in 0..t.len() {
            if ours[i] != triangle[i] {
                assert!(
                    ours[i] >= 0.0
                        && triangle[i] >= 0.0
                        && is_tie(&p, corners[ours[i] as usize], o[i], d[i], t[i]),
                    "{precision:?} ray {i}: triangle {}, theirs {}",
                    ours[i],
                    triangle[i]
                );
                ties += 1;
            }
            if t[i].is_infinite() {
                assert!(ours_t[i] == f64::INFINITY, "{precision:?} ray {i}: a miss");
                continue;
            }
            let error = (ours_t[i] - t[i]).abs() / if t[i] > diameter { t[i] } else { diameter };
            worst = if error > worst { error } else { worst };
        }
        println!("trace_mesh {precision:?}: worst relative error of t {worst:.1e}, {ties} ties");
        assert!(worst <= relative, "{precision:?}: worst relative error of t {worst:e}");
    }
}

/// A sphere of radius r of 2·u·v triangles.
fn sphere(r: f64, u: usize, v: usize) -> Mesh {
    let (mut p, mut t) = (vec![], vec![]);
    for j in 0..=v {
        for i in 0..u {
            let (a, b) =
                (std::f64::consts::TAU * i as f64 / u as f64, std::f64::consts::PI * j as f64 / v as f64);
            let (sb, cb) = (libm::sin(b), libm::cos(b));
            p.push([(r * sb * libm::cos(a)) as f32, (r * sb * libm::sin(a)) as f32, (r * cb) as f32]);
        }
    }
    let at = |i: usize, j: usize| (j * u + i % u) as u32;
    for j in 0..v {
        for i in 0..u {
            t.push([at(i, j), at(i, j + 1), at(i + 1, j + 1)]);
            t.push([at(i, j), at(i + 1, j + 1), at(i + 1, j)]);
        }
    }
    (p, t)
}

/// A cube of half-size 1: six faces of two triangles.
fn cube() -> Mesh {
    let p = (0..8).map(|i| [0, 1, 2].map(|k| if i >> k & 1 == 0 { -1.0 } else { 1.0 })).collect();
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    (p, faces.iter().flat_map(|f| [[f[0], f[1], f[2]], [f[0], f[2], f[3]]]).collect())
}

fn of(m: &Mesh) -> mesh::Mesh {
    mesh::Mesh { positions: m.0.clone(), triangles: m.1.clone(), ..Default::default() }
}

#[test]
fn hits_and_samples_do_not_depend_on_threads() {
    let (p, t) = sphere(1.0, 300, 150);
    let r = Rng::new(8);
    let u = |i: usize, d: u16| 2.0 * r.uniform_f32(i as u64, 0, 0x6703, d) - 1.0;
    let rays: Vec<Ray> = (0..50_000)
        .map(|i| Ray {
            origin: [1.2 * u(i, 0), 1.2 * u(i, 1), 1.2 * u(i, 2)],
            direction: [u(i, 3), u(i, 4), u(i, 5)],
            t_max: f32::INFINITY,
        })
        .collect();
    let all = |threads: usize, chunk: usize| {
        par::with_threads(threads, || {
            let bvh = Bvh::build(&p, &t);
            let mut hits = vec![Hit::NONE; rays.len()];
            par::chunks_mut(&mut hits, chunk, |i, h| {
                bvh.closest_batch(&rays[i * chunk..i * chunk + h.len()], h);
            });
            (
                hits,
                compare::sample(&of(&(p.clone(), t.clone())), 10_000, 3, 0, "sphere")
                    .expect("it has an area"),
            )
        })
        .expect("a pool starts")
    };
    let one = all(1, 4096);
    assert!(one.0.iter().filter(|h| h.triangle != MISS).count() > 10_000, "many rays hit");
    for (threads, chunk) in [(2, 4096), (3, 100), (7, 1), (1, 50_000)] {
        assert!(all(threads, chunk) == one, "{threads} threads, {chunk} rays a task");
    }
}

#[test]
fn distances_to_a_sphere_and_a_cube() {
    let (p, t) = sphere(2.0, 400, 200);
    let surface = nearest::Surface::new(&p, &t);
    let sag = 2.0 * (1.0 - libm::cos(std::f64::consts::PI / 200.0));
    for q in [[5.0, 0.0, 0.0], [0.0, -3.0, 4.0], [0.5, 0.5, 0.5], [0.0, 0.1, 0.0], [100.0, 50.0, -20.0_f64]] {
        let r = (q[0] * q[0] + q[1] * q[1] + q[2] * q[2]).sqrt();
        let (squared, triangle) = surface.nearest(q);
        let off = squared.sqrt() - (r - 2.0).abs();
        assert!(off.abs() <= sag + 1e-6 * r, "{q:?}: triangle {triangle}, off by {off:e}");
    }
    let (p, t) = cube();
    let backwards: Vec<[u32; 3]> = t.iter().rev().copied().collect();
    for (q, squared, lowest) in [
        ([0.0, 0.0, 3.0], 4.0, None),
        ([0.0, 0.0, 0.0], 1.0, Some(0)), // all six faces: the lowest triangle
        ([0.25, 0.5, 0.0], 0.25, None),
        ([4.0, 5.0, 0.5], 25.0, None),
        ([2.0, 2.0, 2.0], 3.0, None),
        ([1.0, 0.3, 0.2], 0.0, None),
    ] {
        for list in [&t, &backwards] {
            let (got, triangle) = nearest::Surface::new(&p, list).nearest(q);
            // a point on a face is projected onto it: an ulp of its coordinates remains
            assert!((got - squared).abs() <= 1e-30 + 1e-15 * squared, "{q:?}: triangle {triangle}, {got:e}");
            assert!(lowest.is_none_or(|i| triangle == i), "{q:?}: triangle {triangle}, not the lowest");
        }
    }
}

#[test]
fn samples_are_spread_by_area() {
    // two rectangles of area 1 and 3 in the plane, and a triangle without area
    let p = vec![
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [1.0, 1.0, 0.0],
        [0.0, 1.0, 0.0],
        [4.0, 0.0, 0.0],
        [4.0, 1.0, 0.0],
    ];
    let flat: Mesh = (p, vec![[0, 1, 2], [0, 2, 3], [0, 1, 1], [1, 4, 5], [1, 5, 2]]);
    let n = 100_000;
    let s = compare::sample(&of(&flat), n, 11, 0, "flat").expect("it has an area");
    let mut counts = [0.0_f64; 5];
    let (mut x, mut xx, mut y) = (0.0, 0.0, 0.0);
    for (i, point) in s.points.iter().enumerate() {
        counts[s.triangles[i] as usize] += 1.0;
        assert_eq!(s.normals[i], [0.0, 0.0, 1.0], "normal");
        x += point[0] / n as f64;
        xx += point[0] * point[0] / n as f64;
        y += point[1] / n as f64;
    }
    let expected = [0.125, 0.125, 0.0, 0.375, 0.375].map(|s| s * n as f64);
    assert_eq!(counts[2], 0.0, "no area, no points");
    let miss = |i: usize| (counts[i] - expected[i]) * (counts[i] - expected[i]) / expected[i];
    let chi = miss(0) + miss(1) + miss(3) + miss(4);
    println!("chi squared {chi:.2} (3 degrees of freedom), means {x:.4} {xx:.4} {y:.4}");
    assert!(chi < 16.27, "shares of area: chi squared {chi}, p < 0.001");
    // uniform on 0..4 × 0..1: standard errors of the means 0.0037, 0.015, 0.0009
    assert!((x - 2.0).abs() < 0.015 && (xx - 16.0 / 3.0).abs() < 0.06 && (y - 0.5).abs() < 0.004, "moments");
    let none: Mesh = (flat.0.clone(), vec![[0, 1, 1]]);
    assert!(compare::sample(&of(&none), 1, 0, 0, "none").is_err(), "no area is refused");
}

#[test]
fn chamfer_closed_forms() {
    let (a, b) = (sphere(1.0, 200, 100), sphere(1.5, 200, 100));
    let c = compare::compare(&of(&a), &of(&b), 20_000, 2, None).expect("areas");
    println!("spheres of radius 1 and 1.5: {c:?}");
    for d in [c.a_to_b, c.b_to_a] {
        assert!((d.mean - 0.5).abs() < 1e-3 && (d.rms - 0.5).abs() < 1e-3, "{c:?}");
    }
    // the same surface, cut otherwise
    let (mut p, t) = cube();
    let fine: Vec<[u32; 3]> = t
        .iter()
        .flat_map(|t| {
            let c = t.map(|i| p[i as usize]);
            let m = p.len() as u32;
            p.push([0, 1, 2].map(|k| 0.5 * (c[0][k] + c[1][k])));
            [[t[0], m, t[2]], [m, t[1], t[2]]]
        })
        .collect();
    let same = compare::compare(&of(&cube()), &of(&(p, fine)), 5_000, 3, None).expect("areas");
    assert!(same.a_to_b.max <= 1e-12 && same.b_to_a.max <= 1e-12, "{same:?}");
    // a square before a larger one: there the distance is the gap, back it is longer
    let square = |z: f32, side: f32| -> Mesh {
        let (l, h) = (0.5 - 0.5 * side, 0.5 + 0.5 * side);
        (vec![[l, l, z], [h, l, z], [h, h, z], [l, h, z]], vec![[0, 1, 2], [0, 2, 3]])
    };
    let c = compare::compare(&of(&square(0.0, 1.0)), &of(&square(1.0, 3.0)), 5_000, 4, None).expect("areas");
    assert!((c.a_to_b.mean - 1.0).abs() < 1e-12 && c.b_to_a.mean > 1.05, "{c:?}");
}

#[test]
fn bad_input_of_the_operator_is_refused() {
    let op = ops::find("geometry.trace").expect("on the list");
    let call = |index: i32, direction: Vec<f32>, origin: f32| {
        let mut call = Call::default();
        call.inputs.put("vertices", &[3, 3], vec![0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        call.inputs.put("triangles", &[1, 3], vec![0, 1, index]);
        call.inputs.put("origin", &[1, 3], vec![origin, 0.2, 1.0]);
        call.inputs.put("direction", &[1, 3], direction);
        call
    };
    for precision in [Precision::F32, Precision::F64] {
        let run = |c: &Call| run::call(op, c, precision);
        let good = run(&call(2, vec![0.0, 0.0, -1.0], 0.2)).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(good.outputs.need("t").expect("an output").to_f64(), [1.0], "it hits");
        let e = run(&call(3, vec![0.0, 0.0, -1.0], 0.2)).expect_err("an index out of range");
        assert!(e.to_string().contains("triangles"), "{e}");
        let e = run(&call(-1, vec![0.0, 0.0, -1.0], 0.2)).expect_err("a negative index");
        assert!(e.to_string().contains("triangles"), "{e}");
        let e = run(&call(2, vec![0.0; 3], 0.2)).expect_err("no direction");
        assert!(e.to_string().contains("direction"), "{e}");
        let e = run(&call(2, vec![0.0, 0.0, -1.0], f32::NAN)).expect_err("not a number");
        assert!(e.to_string().contains("origin"), "{e}");
    }
}

/// Seconds of the fastest of three runs.
#[expect(clippy::disallowed_types, reason = "the test compares times")]
fn fastest(mut run: impl FnMut()) -> f64 {
    let time = |_| {
        let start = std::time::Instant::now();
        run();
        start.elapsed().as_secs_f64()
    };
    (0..3).map(time).fold(f64::INFINITY, |best, s| if s < best { s } else { best })
}

/// Equal boxes once took quadratic time: 12 s for 16 000 triangles, against 10 ms for separate ones.
#[test]
fn coincident_triangles_cost_no_more_than_separate_ones() {
    const N: usize = 16_000;
    let r = Rng::new(11);
    let u = |i: usize, d: u16| 2.0 * r.uniform_f32(i as u64, 0, 0x6704, d) - 1.0;
    let corner =
        |i: usize, c: usize, wide: f32| [0, 1, 2].map(|k| wide * u(i, k) + 0.05 * u(i, 3 + 3 * c as u16 + k));
    let mesh = |f: &dyn Fn(usize, usize) -> [f32; 3]| -> Mesh {
        let positions = (0..3 * N).map(|v| f(v / 3, v % 3)).collect();
        (positions, (0..N as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
    };
    let rays: Vec<Ray> = (0..4_096)
        .map(|i| Ray {
            origin: [0.1 * u(i, 0), 0.1 * u(i, 1), 3.0],
            direction: [0.01 * u(i, 2), 0.01 * u(i, 3), -1.0],
            t_max: f32::INFINITY,
        })
        .collect();
    let queries = |(p, t): &Mesh| {
        let traced = fastest(|| {
            let mut hits = vec![Hit::NONE; rays.len()];
            Bvh::build(p, t).closest_batch(&rays, &mut hits);
        });
        let near = fastest(|| {
            let surface = nearest::Surface::new(p, t);
            for i in 0..4_096 {
                std::hint::black_box(surface.nearest([0, 1, 2].map(|k| f64::from(u(i, k)))));
            }
        });
        [traced, near]
    };
    let separate = queries(&mesh(&|i, c| corner(i, c, 1.0)));
    let unit = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.5]];
    let crowds = [
        ("copies", mesh(&|_, c| unit[c])),
        ("rotated copies", mesh(&|i, c| unit[(c + i) % 3])),
        ("a row", mesh(&|i, c| [unit[c][0] + i as f32, unit[c][1], unit[c][2]])),
    ];
    for (name, mesh) in crowds {
        let crowded = queries(&mesh);
        println!("{name}: {crowded:.3?} s, separate {separate:.3?} s");
        for k in 0..2 {
            assert!(
                crowded[k] < 3.0 * separate[k] + 0.01,
                "{name}, {}: {:.3} s, separate triangles {:.3} s",
                ["rays", "distances"][k],
                crowded[k],
                separate[k]
            );
        }
    }
}
