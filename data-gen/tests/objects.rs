//! Generated objects are closed, oriented outwards, inside their ball, and reproducible.

use data_gen::objects::{self, Made, build, build_by, generators};
use data_gen::surface::Surface;
use reference::num::bits::{digest_f64, fnv1a};
use std::collections::BTreeMap;

type V3 = [f64; 3];

fn sub(a: V3, b: V3) -> V3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

fn cross(a: V3, b: V3) -> V3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn dot(a: V3, b: V3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Assigns one number to all vertices at the same position.
fn weld(s: &Surface) -> Vec<u32> {
    let mut known: BTreeMap<[u64; 3], u32> = BTreeMap::new();
    s.positions
        .iter()
        .map(|p| {
            // −0 and +0 are the same position.
            let next = known.len() as u32;
            *known.entry(p.map(|x| (x + 0.0).to_bits())).or_insert(next)
        })
        .collect()
}

/// Checks all documented properties of a surface; returns its volume.
fn check_surface(name: &str, s: &Surface) -> f64 {
    let n = s.positions.len();
    assert_eq!(s.normals.len(), n, "{name}: a normal per vertex");
    assert_eq!(s.uvs.len(), n, "{name}: texture coordinates per vertex");
    let place = weld(s);
    let mut edges: BTreeMap<(u32, u32), u32> = BTreeMap::new();
    let mut volume = 0.0;
    for (i, t) in s.triangles.iter().enumerate() {
        let w = t.map(|v| place[v as usize]);
        for (a, b) in [(0, 1), (1, 2), (2, 0)] {
            *edges.entry((w[a], w[b])).or_insert(0) += 1;
        }
        let [a, b, c] = t.map(|v| s.positions[v as usize]);
        let face = cross(sub(b, a), sub(c, a));
        assert!(dot(face, face).sqrt() > 1e-11, "{name}: triangle {i} is flat: {a:?} {b:?} {c:?}");
        volume += dot(a, cross(b, c)) / 6.0;
        for &v in t {
            let along = dot(s.normals[v as usize], face) / dot(face, face).sqrt();
            assert!(
                along > 0.0,
                "{name}: triangle {i} and its vertex normals have the same orientation ({along})"
            );
        }
        let [p, q, r] = t.map(|v| s.uvs[v as usize]);
        let uv = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
        assert!(uv <= 1e-12, "{name}: triangle {i} is mirrored on its chart");
    }
    for (&(a, b), &count) in &edges {
        let back = edges.get(&(b, a)).copied().unwrap_or(0);
        assert!(count == 1 && back == 1, "{name}: edge {a}–{b} has {count} triangles and {back} across");
    }
    for (i, ((p, m), uv)) in s.positions.iter().zip(&s.normals).zip(&s.uvs).enumerate() {
        assert!(dot(*p, *p).sqrt() <= 0.5, "{name}: vertex {i} lies in the ball");
        assert!((dot(*m, *m) - 1.0).abs() < 1e-12, "{name}: normal {i} has length 1");
        assert!(
            uv.iter().all(|x| (0.0..=1.0).contains(x)),
            "{name}: texture coordinate {i} is inside the texture"
        );
    }
    assert!(volume > 0.0, "{name}: encloses {volume}");
    volume
}

fn check(made: &Made, name: &str) {
    let mut count = 0;
    let mut reach: f64 = 0.0;
    for (i, s) in made.surfaces.iter().enumerate() {
        check_surface(&format!("{name} ({}) surface {i}", made.generator), s);
        count += s.triangles.len();
        for p in &s.positions {
            let d = dot(*p, *p).sqrt();
            reach = if d > reach { d } else { reach };
        }
        let m = &s.material;
        for map in [&m.base_color_map, &m.metallic_roughness_map] {
            let map = map.as_ref().expect("objects are painted");
            assert_eq!(map.texels.len(), map.width * map.height, "{name}: texels");
        }
    }
    assert!((2_000..=40_000).contains(&count), "{name} ({}): {count} triangles", made.generator);
    assert!(reach > 0.4999, "{name}: fills the ball to {reach}");
}

#[test]
fn every_generator_makes_closed_outward_meshes() {
    for which in 0..generators().len() {
        for k in 0..6 {
            let made = build_by(which, 7, k, 32);
            assert_eq!(made.generator, generators()[which], "the requested generator");
            check(&made, &format!("object {k}"));
        }
    }
}

#[test]
fn drawn_objects_are_closed_too_and_vary() {
    let mut seen: BTreeMap<&str, usize> = BTreeMap::new();
    let mut looks: BTreeMap<String, usize> = BTreeMap::new();
    for k in 1000..1120 {
        let made = build(2, k, 32);
        check(&made, &format!("object {k}"));
        *seen.entry(made.generator).or_insert(0) += 1;
        for m in &made.materials {
            *looks.entry(m.clone()).or_insert(0) += 1;
        }
    }
    assert!(seen.len() >= 16, "generators drawn: {seen:?}");
    assert!(looks.len() >= 11, "materials drawn: {looks:?}");
}

/// Digest of all data of an object that affect an image.
fn digest(made: &Made) -> u64 {
    let mut bytes: Vec<u8> = made.generator.bytes().collect();
    for s in &made.surfaces {
        let numbers: Vec<f64> = s
            .positions
            .iter()
            .chain(&s.normals)
            .flatten()
            .chain(s.uvs.iter().flatten())
            .copied()
            .chain(s.triangles.iter().flatten().map(|&i| f64::from(i)))
            .collect();
        bytes.extend(digest_f64(&[numbers.len()], &numbers).expect("no NaN").to_le_bytes());
        for map in [&s.material.base_color_map, &s.material.metallic_roughness_map].into_iter().flatten() {
            bytes.extend(fnv1a(map.texels.as_flattened()).to_le_bytes());
        }
    }
    fnv1a(&bytes)
}

#[test]
fn objects_have_the_bits_they_had() {
    let all: Vec<u8> = (0..16).flat_map(|k| digest(&build(0, k, 128)).to_le_bytes()).collect();
    assert_eq!(format!("{:016x}", fnv1a(&all)), "f44759fdd327f016", "objects 0 to 15 of seed 0");
}

#[test]
fn an_object_depends_on_its_seed_and_number_alone() {
    let first = build(5, 40, 64);
    for k in 30..40 {
        build(5, k, 64);
    }
    assert_eq!(first, build(5, 40, 64), "made before or after others");
    assert_eq!(
        objects::make(5, 40).len(),
        first.surfaces.len(),
        "the size of textures does not affect shapes"
    );
    assert_eq!(
        objects::make(5, 40)[0].positions,
        first.surfaces[0].positions,
        "the size of textures does not affect shapes"
    );
    let others: Vec<u64> =
        [(5, 41), (6, 40), (5, 42), (7, 40)].iter().map(|&(s, k)| digest(&build(s, k, 64))).collect();
    for (i, d) in others.iter().enumerate() {
        assert!(*d != digest(&first) && !others[..i].contains(d), "seeds and numbers give different objects");
    }
}

#[test]
fn materials_cover_mirrors_metals_and_rough_paint() {
    let (mut mirrors, mut mixed, mut rough) = (0, 0, 0);
    for k in 0..120 {
        for s in build(3, k, 48).surfaces {
            let map = s.material.metallic_roughness_map.expect("painted");
            let n = map.texels.len() as f64;
            let share = |f: &dyn Fn(&[u8; 4]) -> bool| map.texels.iter().filter(|t| f(t)).count() as f64 / n;
            mirrors += u32::from(share(&|t| t[2] == 255 && t[1] <= 13) > 0.3);
            let metal = share(&|t| t[2] > 127);
            mixed += u32::from(metal > 0.1 && metal < 0.9);
            rough += u32::from(share(&|t| t[2] == 0 && t[1] > 140) > 0.5);
            assert!(map.texels.iter().all(|t| t[1] >= 4), "object {k}: no roughness below 0.016");
        }
    }
    assert!(mirrors >= 3 && mixed >= 8 && rough >= 20, "{mirrors} mirrors, {mixed} mixed, {rough} rough");
}
