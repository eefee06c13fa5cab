//! Surfaces of volumes: closed for every combination of signs, values and ties; areas; threads; bounds.

use super::shapes::{area_and_volume, bumpy, cross, draws, euler, marched, minus, samples, sphere, torus};
use lastlight::geometry::marching::{Volume, surface};
use lastlight::num::par;
use lastlight::scene::mesh::Mesh;
use std::f64::consts::PI;

fn volume(values: &[f32], size: [usize; 3]) -> Volume<'_> {
    Volume { values, size, origin: [0.0; 3], spacing: [1.0; 3] }
}

/// Checks one volume and returns its Euler characteristic.
fn check(values: &[f32], size: [usize; 3]) -> i64 {
    let mesh = surface(&volume(values, size)).expect("a volume");
    let inside = values.iter().any(|v| *v < 0.0);
    assert_eq!(mesh.triangles.is_empty(), !inside, "{size:?}: a surface where something is inside");
    let [low, high] = mesh.bounds();
    for k in 0..3 {
        let in_box = low[k] >= 0.0 && high[k] <= (size[k] - 1) as f32;
        assert!(in_box, "{size:?}: bounds {low:?} {high:?}");
    }
    let chi = euler(&mesh).unwrap_or_else(|e| panic!("{size:?} {values:?}: {e}"));
    assert!(
        chi % 2 == 0,
        "{size:?} {values:?}: a closed oriented surface has an even characteristic, not {chi}"
    );
    chi
}

#[test]
fn two_cells_are_closed_for_all_signs() {
    for size in [[3, 2, 2], [2, 3, 2], [2, 2, 3]] {
        for signs in 0..1 << 12 {
            let random = draws(12, signs);
            // ties in every ambiguous face; decisions of both kinds; zeros beside negative values
            for kind in 0..3 {
                let value = |i: usize| {
                    let r = random[i].abs() + 0.01;
                    match (signs >> i & 1 == 1, kind) {
                        (true, 0) => -1.0,
                        (false, 0) => 1.0,
                        (true, _) => -r,
                        (false, 1) => r,
                        (false, _) => 0.0,
                    }
                };
                let values: Vec<f32> = (0..12).map(|i| value(i) as f32).collect();
                check(&values, size);
            }
        }
    }
}

#[test]
fn cells_are_closed_for_all_signs_and_many_values() {
    let mut characteristics = std::collections::BTreeSet::new();
    for signs in 0..256_u64 {
        for seed in 0..60 {
            let random = draws(8, 1000 + 256 * seed + signs);
            // a cell inside a volume that is outside elsewhere
            let mut values = vec![0.5_f32; 64];
            for (i, r) in random.iter().enumerate() {
                let at = (1 + (i >> 2)) * 16 + (1 + (i >> 1 & 1)) * 4 + 1 + (i & 1);
                let size = (r.abs() + 1e-3) as f32;
                values[at] = if signs >> i & 1 == 1 { -size } else { size };
            }
            characteristics.insert(check(&values, [4; 3]));
        }
    }
    assert!(characteristics.contains(&2) && characteristics.contains(&4), "{characteristics:?}");
}

/// Edges that pass through the interior of a triangle with which they share no vertex.
fn self_intersections(mesh: &Mesh) -> usize {
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let volume = |[a, b, c, d]: [[f64; 3]; 4]| dot(cross(minus(b, a), minus(c, a)), minus(d, a));
    let at = |i: u32| mesh.positions[i as usize].map(f64::from);
    let passes = |p: u32, q: u32, t: &[u32; 3]| {
        let ([p, q], [a, b, c]) = ([p, q].map(at), t.map(at));
        let (above, below) = (volume([a, b, c, p]), volume([a, b, c, q]));
        let around = [volume([p, q, a, b]), volume([p, q, b, c]), volume([p, q, c, a])];
        above > 1e-9
            && below < -1e-9
            && (around.iter().all(|x| *x > 1e-9) || around.iter().all(|x| *x < -1e-9))
    };
    let edges = mesh.triangles.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
    let pairs = edges.flat_map(|(p, q)| mesh.triangles.iter().map(move |t| (p, q, t)));
    pairs.filter(|(p, q, t)| !t.contains(p) && !t.contains(q) && passes(*p, *q, t)).count()
}

#[test]
fn triangles_of_a_cell_do_not_intersect() {
    for signs in 0..256_u64 {
        for seed in 0..20 {
            // magnitudes of one order, and of many
            let power = if seed % 2 == 0 { 1 } else { 9 };
            let random = draws(8, 40_000 + 256 * seed + signs);
            let mut values = vec![0.5_f32; 64];
            for (i, r) in random.iter().enumerate() {
                let at = (1 + (i >> 2)) * 16 + (1 + (i >> 1 & 1)) * 4 + 1 + (i & 1);
                let size = (0..power).fold(1.0, |x, _| x * (r.abs() + 1e-3)) as f32;
                values[at] = if signs >> i & 1 == 1 { -size } else { size };
            }
            let mesh = surface(&volume(&values, [4; 3])).expect("a volume");
            assert_eq!(self_intersections(&mesh), 0, "signs {signs:08b}, seed {seed}: {values:?}");
        }
    }
    // the check finds a triangle that cuts an octahedron in two
    let mut two = Mesh::default();
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    two.positions.extend(axes.iter().flat_map(|a| [a.map(|x| -x), *a]));
    two.triangles =
        vec![[1, 3, 5], [3, 0, 5], [0, 2, 5], [2, 1, 5], [3, 1, 4], [0, 3, 4], [2, 0, 4], [1, 2, 4]];
    assert_eq!((euler(&two), self_intersections(&two)), (Ok(2), 0), "an octahedron");
    two.positions.extend([[-9.0, -9.0, 0.3], [9.0, -9.0, 0.3], [0.0, 9.0, 0.3]]);
    two.triangles.push([6, 7, 8]);
    assert!(self_intersections(&two) > 0, "the negative control");
}

#[test]
fn integer_volumes_are_closed() {
    for seed in 0..400 {
        let size = [3 + seed as usize % 4, 2 + seed as usize % 5, 70 - seed as usize % 8];
        let most = 1.0 + (seed % 3) as f64;
        let values: Vec<f32> = draws(size[0] * size[1] * size[2], 5000 + seed)
            .iter()
            .map(|x| (x * (most + 0.49)).round() as f32)
            .collect();
        check(&values, size);
    }
}

#[test]
fn extreme_values_give_vertices_in_the_box() {
    let random = draws(9 * 9 * 9, 9000);
    for scale in [f32::MAX, f32::MIN_POSITIVE, f32::from_bits(3), 1.0] {
        let values: Vec<f32> = random.iter().map(|x| *x as f32 * scale).collect();
        check(&values, [9; 3]);
    }
    // both zeros are outside, and a volume may be inside everywhere or nowhere
    assert_eq!(check(&[-0.0; 8], [2; 3]), 0);
    assert_eq!(check(&[-3.0; 27], [3; 3]), 2);
    assert_eq!(check(&[-3.0], [1; 3]), 2);
    assert_eq!(check(&[], [0, 4, 4]), 0);
}

#[test]
fn the_decider_joins_by_the_saddle_and_separates_ties() {
    // two inside corners a, c of one face, b and d between them: joined if a·c > b·d
    for (inside, outside, parts) in [(-2.0, 1.0, 1), (-1.0, 2.0, 2), (-1.0, 1.0, 2), (-1.0, 0.0, 1)] {
        let mut values = vec![9.0_f32; 36];
        let at = |x: usize, y: usize| x * 12 + y * 3 + 1;
        // the other faces around the diagonal separate it
        for (x, y, v) in [(0, 1, inside), (1, 2, inside), (0, 2, outside), (1, 1, outside)] {
            values[at(x, y)] = v;
        }
        let chi = check(&values, [3, 4, 3]);
        assert_eq!(chi, 2 * parts, "inside {inside}, outside {outside}: {parts} parts");
    }
}

#[test]
fn sphere_and_torus_have_their_area_volume_and_characteristic() {
    for n in [32, 64, 96] {
        let h = 2.0 / (n - 1) as f64;
        let (r, (large, small)) = (0.7, (0.6, 0.25));
        let ball = marched(n, sphere(r));
        let ring = marched(n, torus(large, small));
        assert_eq!(euler(&ball), Ok(2), "sphere of {n}");
        assert_eq!(euler(&ring), Ok(0), "torus of {n}");
        let exact = [
            [4.0 * PI * r * r, 4.0 / 3.0 * PI * r * r * r],
            [4.0 * PI * PI * large * small, 2.0 * PI * PI * large * small * small],
        ];
        for (mesh, exact, curvature) in [(&ball, exact[0], 1.0 / r), (&ring, exact[1], 1.0 / small)] {
            let ours = area_and_volume(mesh);
            for (ours, exact) in ours.iter().zip(exact) {
                let error = 1.0 - ours / exact;
                println!(
                    "{n}: relative error {error:.2e}, (h × curvature)² = {:.2e}",
                    (h * curvature) * (h * curvature)
                );
                // chords lie inside: the error is positive and of second order
                assert!(error > 0.0 && error < (h * curvature) * (h * curvature), "{n}: {ours} for {exact}");
            }
        }
    }
}

#[test]
fn surfaces_do_not_depend_on_threads() {
    let values = samples(50, bumpy);
    let v = Volume { values: &values, size: [50; 3], origin: [-1.0, -2.0, 3.0], spacing: [0.1, 0.2, 0.3] };
    let one = par::with_threads(1, || surface(&v).expect("a volume")).expect("a pool");
    for n in [2, 3, 7] {
        assert!(
            one == par::with_threads(n, || surface(&v).expect("a volume")).expect("a pool"),
            "{n} threads"
        );
    }
}

#[test]
fn vertices_are_those_of_any_part_of_the_volume() {
    let random: Vec<f32> = draws(10 * 10 * 10, 77).iter().map(|x| *x as f32).collect();
    let all = surface(&volume(&random, [10; 3])).expect("a volume");
    let part: Vec<f32> =
        (0..6 * 6 * 6).map(|i| random[(2 + i / 36) * 100 + (2 + i / 6 % 6) * 10 + 2 + i % 6]).collect();
    let v = Volume { values: &part, size: [6; 3], origin: [2.0; 3], spacing: [1.0; 3] };
    let bits = |p: &[f32; 3]| p.map(f32::to_bits);
    let known: std::collections::BTreeSet<_> = all.positions.iter().map(bits).collect();
    let small = surface(&v).expect("a volume");
    let interior = small.positions.iter().filter(|p| p.iter().all(|x| *x > 2.0 && *x < 7.0));
    let (mut found, mut others) = (0, 0);
    for p in interior {
        if known.contains(&bits(p)) { found += 1 } else { others += 1 }
    }
    assert!(found > 100 && others == 0, "{found} vertices of both, {others} of the part only");
}

#[test]
fn volumes_that_are_not_valid_are_refused() {
    let ok = [0.0_f32; 8];
    let with = |values: &[f32], size, spacing| {
        surface(&Volume { values, size, origin: [0.0; 3], spacing }).expect_err("not a volume").to_string()
    };
    assert!(with(&ok, [2, 2, 3], [1.0; 3]).contains("2×2×3"), "a wrong size");
    assert!(with(&[f32::NAN; 8], [2; 3], [1.0; 3]).contains("value 0"), "NaN");
    assert!(with(&ok, [2; 3], [1.0, 0.0, 1.0]).contains("spacing"), "a spacing of 0");
    assert!(with(&ok, [usize::MAX, 2, 2], [1.0; 3]).contains("values"), "a product that overflows");
}
