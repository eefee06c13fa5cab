//! Parts of meshes, cavities of volumes, smoothing and normals.

use super::shapes::{area_and_volume, bumpy, cube, euler, length, marched, minus, samples, sphere, torus};
use lastlight::geometry::components::{Keep, components, fill_cavities, keep};
use lastlight::geometry::marching::{Volume, surface};
use lastlight::geometry::smooth::{Smoothing, normals, smooth};
use lastlight::num::par;
use lastlight::scene::mesh::Mesh;

/// Balls of radius 0.4, 0.2 and 0.1; the first contains a cavity of radius 0.25.
fn balls(p: [f64; 3]) -> f64 {
    let ball = |c: [f64; 3], r: f64| length(minus(p, c)) - r;
    let hollow = ball([-0.4, 0.0, 0.0], 0.4);
    let hollow = if -ball([-0.4, 0.0, 0.0], 0.25) > hollow { -ball([-0.4, 0.0, 0.0], 0.25) } else { hollow };
    [hollow, ball([0.5, 0.0, 0.0], 0.2), ball([0.4, 0.6, 0.6], 0.1)]
        .into_iter()
        .fold(9.0, |a, b| if b < a { b } else { a })
}

fn volume(values: &[f32], n: usize) -> Volume<'_> {
    Volume { values, size: [n; 3], origin: [-1.0; 3], spacing: [2.0 / (n - 1) as f32; 3] }
}

#[test]
fn the_largest_parts_are_kept() {
    let mesh = marched(60, balls);
    let parts = components(&mesh.triangles, mesh.positions.len());
    assert_eq!(parts.count, 4, "two spheres, a shell with two surfaces");
    assert!(parts.of[0] == 0, "the first triangle is in the first part");
    let largest = keep(&mesh, Keep::Largest).expect("parts");
    assert_eq!(euler(&largest), Ok(2), "one sphere");
    let [_, enclosed] = area_and_volume(&largest);
    assert!((enclosed - 0.268).abs() < 0.004, "the ball of radius 0.4, not {enclosed}");
    // areas: 1, (5/8)² = 0.39, ¼, 1/16
    for (fraction, chi) in [(0.0, 8), (0.1, 6), (0.3, 4), (0.5, 2), (1.0, 2)] {
        let kept = keep(&mesh, Keep::Fraction(fraction)).expect("parts");
        assert_eq!(euler(&kept), Ok(chi), "fraction {fraction}");
    }
    assert!(keep(&mesh, Keep::Fraction(0.0)).expect("parts") == mesh, "everything, in the same order");
    assert_eq!(keep(&Mesh::default(), Keep::Largest).expect("parts"), Mesh::default(), "an empty mesh");
    assert!(keep(&mesh, Keep::Fraction(f64::NAN)).is_err(), "not a fraction");
}

#[test]
fn cavities_are_filled_and_pockets_are_not() {
    let n = 60;
    let values = samples(n, balls);
    let (filled, changed) = fill_cavities(&volume(&values, n)).expect("a volume");
    let mesh = surface(&volume(&filled, n)).expect("a volume");
    assert_eq!(euler(&mesh), Ok(6), "three spheres");
    let cavity = 4.0 / 3.0 * std::f64::consts::PI * 0.25 * 0.25 * 0.25 * (29.5 * 29.5 * 29.5);
    assert!((changed as f64 / cavity - 1.0).abs() < 0.02, "{changed} samples, expected {cavity}");
    let same = values.iter().zip(&filled).filter(|(a, b)| a.to_bits() == b.to_bits()).count();
    assert_eq!(same + changed, values.len(), "other samples keep their bits");
    // a channel from the cavity to the border of the box
    let open = samples(n, |p| {
        let channel = 0.1 - (p[1] * p[1] + p[2] * p[2]).sqrt();
        if p[0] < -0.4 && channel > balls(p) { channel } else { balls(p) }
    });
    let (same, changed) = fill_cavities(&volume(&open, n)).expect("a volume");
    assert!(changed == 0 && same == open, "a pocket is not a cavity");
    // zeros become inside too
    let mut block = vec![-1.0_f32; 27];
    block[13] = 0.0;
    let (filled, changed) = fill_cavities(&volume(&block, 3)).expect("a volume");
    assert!(changed == 1 && filled[13] < 0.0, "{}", filled[13]);
}

#[test]
fn smoothing_removes_noise_and_taubin_keeps_the_volume() {
    let mesh = marched(64, |p| sphere(0.7)(p) + 0.02 * libm::sin(70.0 * p[0]) * libm::sin(70.0 * p[1]));
    let roughness = |p: &[[f32; 3]]| {
        let r: Vec<f64> = p.iter().map(|p| length(p.map(f64::from))).collect();
        let mean = r.iter().fold(0.0, |s, x| s + x) / r.len() as f64;
        (r.iter().fold(0.0, |s, x| s + (x - mean) * (x - mean)) / r.len() as f64).sqrt()
    };
    let volume = |p: Vec<[f32; 3]>| area_and_volume(&Mesh { positions: p, ..mesh.clone() })[1];
    let before = (roughness(&mesh.positions), volume(mesh.positions.clone()));
    let run = |how: Smoothing| smooth(&mesh.positions, &mesh.triangles, &how).expect("factors");
    let laplace = run(Smoothing::default());
    let taubin = run(Smoothing { factor: 0.5, inverse: -0.53, iterations: 30 });
    println!("roughness {:.1e}, {:.1e}, {:.1e}", before.0, roughness(&laplace), roughness(&taubin));
    assert!(roughness(&laplace) < 0.3 * before.0, "umbrella");
    assert!(roughness(&taubin) < 0.5 * before.0, "two factors");
    let shrunk = [laplace, taubin].map(|p| 1.0 - volume(p) / before.1);
    println!("volume lost: {shrunk:?}");
    assert!(shrunk[0] > 0.005 && shrunk[1].abs() < 0.002, "{shrunk:?}");
    assert!(
        run(Smoothing { iterations: 0, ..Smoothing::default() }) == mesh.positions,
        "no pass, the same bits"
    );
    for wrong in [(1.5, 0.0), (0.5, -0.4), (f64::NAN, 0.0), (0.5, f64::NAN), (0.5, 0.1)] {
        let how = Smoothing { factor: wrong.0, inverse: wrong.1, iterations: 1 };
        assert!(smooth(&mesh.positions, &mesh.triangles, &how).is_err(), "{wrong:?}");
    }
}

#[test]
fn normals_are_those_of_the_shape() {
    let ball = marched(64, sphere(0.7));
    let worst = ball.positions.iter().zip(normals(&ball)).fold(1.0_f64, |worst, (p, n)| {
        let p = p.map(f64::from);
        let cos = (0..3).fold(0.0, |s, k| s + p[k] * f64::from(n[k])) / length(p);
        if cos < worst { cos } else { worst }
    });
    assert!(worst > 0.995, "cosine {worst}");
    // at the corner of a cube all three faces count alike, however they are divided into triangles
    let block = cube(3, false);
    for (p, n) in block.positions.iter().zip(normals(&block)) {
        if p.iter().all(|x| x.abs() == 0.5) {
            assert!(
                (0..3).all(|k| (n[k] - p[k].signum() * (1.0_f32 / 3.0).sqrt()).abs() < 1e-6),
                "{p:?}: {n:?}"
            );
        }
    }
    // triangles without area have no weight, and a vertex without any area has a normal
    let flat = Mesh {
        positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [2.0, 0.0, 0.0]],
        triangles: vec![[0, 3, 1], [0, 1, 2]],
        ..Mesh::default()
    };
    assert_eq!(normals(&flat), [[0.0, 0.0, 1.0]; 4]);
}

#[test]
fn smoothing_and_normals_do_not_depend_on_threads() {
    let mesh = marched(40, |p| if p[2] < 0.0 { bumpy(p) } else { torus(0.6, 0.2)(p) });
    let run = |n: usize| {
        par::with_threads(n, || {
            let p = smooth(&mesh.positions, &mesh.triangles, &Smoothing::default()).expect("factors");
            let n = normals(&Mesh { positions: p.clone(), ..mesh.clone() });
            (p, n)
        })
        .expect("a pool")
    };
    let one = run(1);
    for n in [2, 3, 7] {
        assert!(one == run(n), "{n} threads");
    }
}
