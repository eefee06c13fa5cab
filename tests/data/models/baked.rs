//! Meshes of fields: closed, with charts that do not overlap, with the values of the heads, in bits behind GLB.

use super::textured::validated;
use lastlight::field::{fetch, network, value_head};
use lastlight::fit::field::mesh::{Base, Normals, Settings, bake, shape};
use lastlight::geometry::facts;
use lastlight::geometry::texels::cover;
use lastlight::num::rng::Rng;
use lastlight::scene::field::{Combine, Field, Heads, Network, Placement, Planes, Settings as Rendering};
use lastlight::scene::mesh::Mesh;
use lastlight::scene::model;
use std::collections::BTreeMap;

/// Half size of the box.
const HALF: f32 = 0.525;
/// Texels per side of planes.
const SIDE: usize = 8;

/// A sphere of about `radius` with bumps from six random planes. The first channel is 1, the second is drawn, so
/// the surface jumps at the three centre planes as that of every fitted field does.
fn bumpy(radius: f64) -> Field {
    let draw = |i: usize| Rng::new(7).normal_f32(i as u64, 0, 0x7f31, 0);
    let n = 6 * SIDE * SIDE;
    let values: Vec<f32> = (0..n).flat_map(|i| [1.0, 0.1 * draw(i)]).collect();
    // z = −3a − 0.1·(0.5 + noise), and s = 2.598 R tanh z + ‖x‖ − 0.1 R
    let half = f64::from(HALF);
    let z = libm::atanh((radius - 0.1 * half) / (2.598 * half));
    let a = ((z - 0.05) / 3.0) as f32;
    let sdf = Network {
        widths: vec![6, 2, 2, 1],
        weights: vec![
            vec![1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.5, 1.0, 0.0, 1.0, 0.0, 1.0],
            vec![1.0, 0.0, 0.0, 1.0],
            vec![-a, -0.1],
        ],
    };
    let linear = |outputs: usize, first: usize| Network {
        widths: vec![6, outputs],
        weights: vec![(0..6 * outputs).map(|i| draw(9_000 + first + i)).collect()],
    };
    Field {
        planes: Planes { values, count: 6, side: SIDE, channels: 2 },
        panoramas: None,
        heads: Heads {
            sdf,
            color: Some(linear(3, 0)),
            albedo: Some(linear(3, 100)),
            material: Some(linear(2, 200)),
            normal: None,
            rho: None,
        },
        settings: Rendering { half_size: HALF, combine: Combine::Concat, ..Rendering::default() },
        placement: Placement::new([0.0; 3], 1.0),
    }
}

fn settings() -> Settings {
    Settings { side: 64, texture: 1024, ..Settings::default() }
}

/// The number of edges, each of which is in exactly two triangles, in opposite directions.
fn closed(mesh: &Mesh) -> usize {
    let mut seen: BTreeMap<(u32, u32), [usize; 2]> = BTreeMap::new();
    for &[a, b, c] in &mesh.triangles {
        for (i, j) in [(a, b), (b, c), (c, a)] {
            let key = if i < j { (i, j) } else { (j, i) };
            seen.entry(key).or_default()[usize::from(i < j)] += 1;
        }
    }
    let wrong: Vec<_> = seen.iter().filter(|(_, n)| **n != [1, 1]).take(3).collect();
    assert!(wrong.is_empty(), "edges: {wrong:?}");
    seen.len()
}

#[test]
fn every_edge_of_a_field_is_in_two_triangles_also_where_it_leaves_the_box() {
    for (radius, leaves) in [(0.35, false), (0.6, true)] {
        let field = bumpy(radius);
        field.validate().expect("a field");
        for smoothing in [0, 10] {
            let (mesh, ..) =
                shape(&field, &Settings { smoothing, ..settings() }).expect("finite").expect("a surface");
            let edges = closed(&mesh);
            assert_eq!(2 * edges, 3 * mesh.triangles.len(), "three half edges per triangle");
            assert!(mesh.triangles.len() > 5_000, "{radius}: {} triangles", mesh.triangles.len());
            let found = facts::facts(&mesh);
            assert!(found.volume > 0.0 && found.turned < 1e-3, "{radius}: outwards, {found:?}");
            assert_eq!(mesh.normals.len(), mesh.positions.len(), "a normal per vertex");
            if smoothing == 0 {
                let at_border = mesh.positions.iter().flatten().filter(|x| x.abs() == HALF).count();
                assert_eq!(at_border > 0, leaves, "{radius}: {at_border} coordinates at the border");
                assert!(mesh.positions.iter().flatten().all(|x| x.abs() <= HALF), "inside of the box");
            }
        }
    }
}

#[test]
fn normals_are_those_of_the_head_unless_they_point_inwards() {
    let make = |radius: f64, head: Option<Network>, normals: Normals| {
        let mut field = bumpy(radius);
        field.heads.normal = head;
        shape(&field, &Settings { normals, ..settings() }).expect("finite").expect("a surface").0
    };
    // Without weights the head gives the radial direction.
    let radial = || Some(Network { widths: vec![6, 3], weights: vec![vec![0.0; 18]] });
    let [of_head, of_surface] = [Normals::Head, Normals::Surface].map(|n| make(0.6, radial(), n));
    assert_eq!(of_head.positions, of_surface.positions, "one surface");
    assert_eq!(make(0.6, None, Normals::Head).normals, of_surface.normals, "a field without the head");
    let (mut taken, mut kept) = (0, 0);
    let rows = of_head.positions.iter().zip(&of_head.normals).zip(&of_surface.normals);
    for ((x, n), surface) in rows {
        let length = ((x[0] * x[0] + x[1] * x[1]) + x[2] * x[2]).sqrt();
        let radial = x.map(|x| x / length);
        if (0..3).all(|k| (n[k] - radial[k]).abs() < 1e-6) {
            taken += 1;
        } else {
            assert_eq!(n, surface, "the mean of the triangles");
            assert!((0..3).fold(0.0, |s, k| s + radial[k] * surface[k]) <= 1e-6, "it points inwards");
            kept += 1;
        }
    }
    assert!(taken > 5_000, "{taken} of the head, {kept} kept");
}

/// Whether a triangle and a texel have a common point, by separating axes.
fn touches(p: [[f64; 2]; 3], x: usize, y: usize) -> bool {
    let square = [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[i, j]| [(x + i) as f64, (y + j) as f64]);
    let apart = |n: [f64; 2]| {
        let ends = |q: &[[f64; 2]]| {
            let along = q.iter().map(|q| n[0] * q[0] + n[1] * q[1]);
            along.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], d| {
                [if d < a { d } else { a }, if d > b { d } else { b }]
            })
        };
        let ([a, b], [c, d]) = (ends(&p), ends(&square));
        b < c || d < a
    };
    let sides = [0, 1, 2].map(|k| [p[k][1] - p[(k + 1) % 3][1], p[(k + 1) % 3][0] - p[k][0]]);
    ![[1.0, 0.0], [0.0, 1.0]].into_iter().chain(sides).any(apart)
}

#[test]
fn charts_of_a_field_have_gutters_one_density_and_half_of_the_texels() {
    const GUTTER: usize = 4;
    for radius in [0.35, 0.6] {
        let size = settings().texture;
        let baked = bake(&bumpy(radius), &settings()).expect("a mesh");
        let mesh = &baked.object.mesh;
        let layout = facts::layout(mesh, [size; 2]).expect("coordinates");
        assert_eq!(layout.overlapping, 0.0, "{radius}: no texel has its centre in two triangles");
        assert!(layout.used >= 0.5, "{radius}: {} of the texels", layout.used);
        let ratio = layout.density[2] / layout.density[0];
        assert!(ratio <= 2.0, "{radius}: densities within a factor of {ratio} for 95 % of the area");
        let (chart_of, count) = facts::charts(mesh);
        assert_eq!(count, baked.charts, "{radius}: charts by their coordinates");
        // No texel is touched by two charts, and four lie between any two.
        let mut owner = vec![u32::MAX; size * size];
        for (t, corners) in mesh.triangles.iter().enumerate() {
            let p = corners.map(|v| mesh.uvs[v as usize].map(|x| f64::from(x) * size as f64));
            let range = |k: usize| {
                let [low, high] = p.iter().fold([f64::INFINITY, 0.0], |[a, b], q| {
                    [if q[k] < a { q[k] } else { a }, if q[k] > b { q[k] } else { b }]
                });
                low.floor() as usize..Ord::min(high.floor() as usize + 1, size)
            };
            for y in range(1) {
                for x in range(0).filter(|&x| touches(p, x, y)) {
                    let before = std::mem::replace(&mut owner[y * size + x], chart_of[t]);
                    assert!(before == u32::MAX || before == chart_of[t], "{radius}: {x}, {y} has two charts");
                }
            }
        }
        for (i, &own) in owner.iter().enumerate().filter(|(_, own)| **own != u32::MAX) {
            let (x, y) = (i % size, i / size);
            for j in y..Ord::min(y + GUTTER + 1, size) {
                for k in x.saturating_sub(GUTTER)..Ord::min(x + GUTTER + 1, size) {
                    let other = owner[j * size + k];
                    assert!(
                        other == own || other == u32::MAX,
                        "{radius}: {own} at {x}, {y}; {other} at {k}, {j}"
                    );
                }
            }
        }
        // By position, the doubled vertices of charts do not open the surface.
        assert!(facts::facts(mesh).is_closed(), "{radius}: {:?}", facts::facts(mesh).edges);
    }
}

/// The value of a linear head with a sigmoid at a point, as a byte.
fn bytes(field: &Field, head: &Network, point: [f32; 3]) -> Vec<u8> {
    let Planes { values, count, side, channels } = &field.planes;
    let planes = fetch::Planes { values, count: *count, side: *side, channels: *channels, half_size: HALF };
    let mut features = vec![0.0; 6];
    fetch::forward(&planes, fetch::Combine::Concat, &[point], &mut features);
    let weights: Vec<&[f32]> = head.weights.iter().map(Vec::as_slice).collect();
    let network = network::Network { weights: &weights, inputs: 6 };
    value_head::forward(&network, &features).0.iter().map(|x| (x * 255.0 + 0.5) as u8).collect()
}

#[test]
fn maps_hold_the_values_of_the_heads_at_their_texels() {
    let field = bumpy(0.35);
    let size = settings().texture;
    let (albedo, color) = (field.heads.albedo.as_ref(), field.heads.color.as_ref());
    let lit = bake(&field, &settings()).expect("a mesh").object;
    let seen = bake(&field, &Settings { base: Base::Color, ..settings() }).expect("a mesh").object;
    let bare =
        Field { heads: Heads { albedo: None, material: None, ..field.heads.clone() }, ..field.clone() };
    let bare = bake(&bare, &settings()).expect("a mesh").object;
    assert_eq!(lit.mesh, seen.mesh, "one surface");
    let texels = cover(&lit.mesh, &facts::charts(&lit.mesh).0, [size; 2]).expect("coordinates");
    let [lit, seen, bare] = [&lit, &seen, &bare].map(|o| &o.materials[0]);
    let map = |m: &Option<std::sync::Arc<lastlight::scene::material::Texture>>, i: u32| {
        m.as_ref().expect("a map").texels[i as usize]
    };
    for t in texels.iter().step_by(97) {
        let [r, g, b, a] = map(&lit.base_color_map, t.index);
        assert_eq!([r, g, b].to_vec(), bytes(&field, albedo.expect("a head"), t.position), "albedo");
        assert_eq!(a, 255, "opaque");
        let [_, rough, metal, _] = map(&lit.metallic_roughness_map, t.index);
        let material = field.heads.material.as_ref().expect("a head");
        assert_eq!([rough, metal].to_vec(), bytes(&field, material, t.position), "roughness and metallic");
        let expected = bytes(&field, color.expect("a head"), t.position);
        assert_eq!(map(&seen.emission_map, t.index)[..3], expected, "the colour as an emission");
        assert_eq!(map(&bare.base_color_map, t.index)[..3], expected, "no albedo: the colour");
        assert_eq!(map(&bare.metallic_roughness_map, t.index)[1..3], [255, 0], "rough, not metallic");
    }
    assert_eq!(
        (seen.base_color, seen.emission),
        ([0.0, 0.0, 0.0, 1.0], [1.0; 3]),
        "only the emission is seen"
    );
    assert!(seen.base_color_map.is_none() && lit.emission_map.is_none(), "one or the other");
    // Gutters have values of their charts: no texel is left at zero in all channels.
    let all = &lit.base_color_map.as_ref().expect("a map").texels;
    assert!(all.iter().all(|t| t[..3] != [0; 3]), "gutters are filled");
}

#[test]
fn a_baked_field_is_the_same_behind_glb_and_obj_and_the_khronos_validator_accepts_it() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    for (base, name) in [(Base::Albedo, "lit"), (Base::Color, "seen")] {
        let settings = Settings { side: 32, texture: 256, base, ..settings() };
        let object = bake(&bumpy(0.35), &settings).expect("a mesh").object;
        for ending in ["glb", "obj"] {
            let path = dir.path().join(format!("{name}.{ending}"));
            model::write(&path, &object).unwrap_or_else(|e| panic!("{e}"));
            let (back, notes) = model::read_with_notes(&path).unwrap_or_else(|e| panic!("{e}"));
            assert!(notes.is_empty(), "{name}.{ending}: {notes:?}");
            let bits = |m: &Mesh| {
                let rows = [m.positions.as_flattened(), m.normals.as_flattened(), m.uvs.as_flattened()];
                rows.map(|r| r.iter().map(|x| x.to_bits()).collect::<Vec<_>>())
            };
            assert!(bits(&back.mesh) == bits(&object.mesh), "{name}.{ending}: in bits");
            assert_eq!(back.mesh.triangles, object.mesh.triangles, "{name}.{ending}");
            let (ours, theirs) = (&object.materials[0], &back.materials[0]);
            assert_eq!(theirs.base_color_map, ours.base_color_map, "{name}.{ending}: base colour");
            assert_eq!(
                theirs.metallic_roughness_map, ours.metallic_roughness_map,
                "{name}.{ending}: material"
            );
            assert_eq!(theirs.emission_map, ours.emission_map, "{name}.{ending}: emission");
            assert_eq!((theirs.roughness, theirs.metallic), (ours.roughness, ours.metallic), "factors");
        }
        validated(&dir.path().join(format!("{name}.glb")));
    }
}
