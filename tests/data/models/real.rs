//! The models of `$LASTLIGHT_DATA/data`.

use crate::common::real_data;
use data_gen::figure::factors::Drive;
use lastlight::scene::character::{Character, Factors};
use lastlight::scene::environment_file::{self, Options, Orientation};
use lastlight::scene::mesh::{Mesh, Object};
use lastlight::scene::model;
use std::collections::BTreeMap;

fn read(path: &str) -> Option<Object> {
    real_data(path).map(|p| model::read(&p).unwrap_or_else(|e| panic!("{e}")))
}

fn character(path: &str) -> Option<Character> {
    real_data(path).map(|p| Character::read(&p).unwrap_or_else(|e| panic!("{e}")))
}

/// Directed edges between places that have no partner in the other direction.
fn open_edges(mesh: &Mesh) -> usize {
    let mut places: BTreeMap<[u32; 3], usize> = BTreeMap::new();
    let mut weld = |i: u32| {
        let next = places.len();
        *places.entry(mesh.positions[i as usize].map(|x| (x + 0.0).to_bits())).or_insert(next)
    };
    let mut edges: BTreeMap<(usize, usize), i32> = BTreeMap::new();
    for t in &mesh.triangles {
        let t = t.map(&mut weld);
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            *edges.entry((a.min(b), a.max(b))).or_insert(0) += if a < b { 1 } else { -1 };
        }
    }
    edges.values().filter(|n| **n != 0).count()
}

/// Six times the enclosed volume.
fn volume(mesh: &Mesh) -> f64 {
    (0..mesh.triangles.len()).fold(0.0, |sum, t| {
        let [a, b, c] = mesh.corners(t).map(|x| x.map(f64::from));
        sum + a[0] * (b[1] * c[2] - b[2] * c[1])
            + a[1] * (b[2] * c[0] - b[0] * c[2])
            + a[2] * (b[0] * c[1] - b[1] * c[0])
    })
}

fn near(a: [f32; 3], b: [f32; 3], tolerance: f32) -> bool {
    (0..3).all(|k| (a[k] - b[k]).abs() <= tolerance)
}

#[test]
fn the_flight_helmet() {
    let Some(o) = read("pbr/FlightHelmet/FlightHelmet.gltf") else { return };
    assert_eq!(
        (o.mesh.positions.len(), o.mesh.triangles.len(), o.materials.len()),
        (55_392, 94_722, 6),
        "counts"
    );
    let [low, high] = o.mesh.bounds();
    // Of the accessors' bounds, moved by their nodes.
    assert!(near(low, [-0.203_643, -0.200_029, -2.1e-5], 1e-5), "{low:?}");
    assert!(near(high, [0.162_941, 0.171_546, 0.716], 1e-5), "{high:?}");
    assert!(o.materials.iter().all(|m| m.base_color_map.is_some() && m.normal_map.is_some()), "maps");
    let all =
        o.mesh.normals.iter().all(|n| ((n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt() - 1.0).abs() < 1e-5);
    assert!(all && o.mesh.normals.len() == 55_392, "unit normals");
}

#[test]
fn the_cow_is_closed() {
    let Some(o) = read("mesh/spot/spot.obj") else { return };
    // 2930 places; seams of the texture double 295 of them.
    assert_eq!((o.mesh.positions.len(), o.mesh.triangles.len()), (3225, 5856), "counts");
    assert_eq!(open_edges(&o.mesh), 0, "closed");
    assert!(volume(&o.mesh) > 0.0, "its outside is outside: {}", volume(&o.mesh));
    let t = o.materials[0].base_color_map.as_ref().expect("its spots");
    assert_eq!((t.width, t.height), (1024, 1024), "texture");
    let dir = tempfile::tempdir().expect("a temporary folder");
    for name in ["cow.glb", "cow.obj"] {
        let path = dir.path().join(name);
        model::write(&path, &o).unwrap_or_else(|e| panic!("{e}"));
        let back = model::read(&path).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((back.mesh.positions.len(), back.mesh.triangles.len()), (3225, 5856), "{name}");
        assert!((volume(&back.mesh) - volume(&o.mesh)).abs() < 1e-9, "{name}: the same body");
        assert_eq!(back.materials[0].base_color_map, o.materials[0].base_color_map, "{name}: texture");
    }
}

#[test]
fn the_knight_walks() {
    let Some(mut c) = character("characters/Knight.glb") else { return };
    assert_eq!(
        (c.joints().len(), c.animations().len(), c.parts().len()),
        (41, 76, 15),
        "joints, animations, parts"
    );
    assert_eq!(
        (c.object().mesh.positions.len(), c.object().mesh.triangles.len()),
        (7024, 6952),
        "with weapons"
    );
    let weapons = [
        "1H_Sword_Offhand",
        "Badge_Shield",
        "Rectangle_Shield",
        "Round_Shield",
        "Spike_Shield",
        "1H_Sword",
        "2H_Sword",
    ];
    c.hide(&weapons).unwrap_or_else(|e| panic!("{e}"));
    let rigid: Vec<&str> = c.parts().iter().filter(|p| !p.skinned).map(|p| p.name.as_str()).collect();
    assert_eq!(rigid, ["Knight_Helmet", "Knight_Cape"], "attached to a joint");
    for (part, joint) in [("Knight_Helmet", "head"), ("Knight_Cape", "chest")] {
        let k = c.joint(joint).unwrap_or_else(|e| panic!("{e}")) as u16;
        let n = c.influences().iter().filter(|(j, w)| j[0] == k && w[0] == 1.0).count();
        assert!(n > 50, "{part}: {n} vertices with weight 1 on {joint}");
    }
    // The rest pose is the bind pose (to 1.2e-5 in its matrices).
    let rest = c.posed(&c.rest(), &Drive::new(&[])).unwrap_or_else(|e| panic!("{e}"));
    let off = rest.mesh.positions.iter().zip(&c.object().mesh.positions);
    assert!(off.clone().all(|(a, b)| near(*a, *b, 5e-5)), "canonical");
    c.fit(2.0).unwrap_or_else(|e| panic!("{e}"));
    let f = Factors::of(&c, "Walking_A", Some("Idle"), None).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(c.joints()[f.elbow.expect("found")].name, "lowerarm.r", "the elbow");
    assert!((c.duration(f.first.0) - 1.066_666_7).abs() < 1e-6, "seconds");
    let leg = c.parts().iter().position(|p| p.name == "Knight_LegLeft").expect("a leg");
    let before = c.parts()[..leg].iter().fold(0, |n, p| n + p.vertices().len());
    let mut steps = Vec::new();
    for k in 0..8 {
        let pose = c.pose(f.first.0, c.duration(f.first.0) * f64::from(k) / 8.0);
        let o = c.posed(&pose, &Drive::new(&[])).unwrap_or_else(|e| panic!("{e}"));
        let [low, high] = o.mesh.bounds();
        assert!(
            low[2] > -1.1 && high[2] < 1.1 && low[0] > -0.8 && high[0] < 0.8,
            "upright: {low:?} {high:?}"
        );
        steps.push(o.mesh.positions[before][1]);
    }
    let ends = steps.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[a, b], y| {
        [if *y < a { *y } else { a }, if *y > b { *y } else { b }]
    });
    assert!(ends[1] - ends[0] > 0.1, "the leg swings: {steps:?}");
    // A loop ends where it began.
    let ends = [0.0, c.duration(f.first.0)]
        .map(|t| c.posed(&c.pose(f.first.0, t), &Drive::new(&[])).unwrap_or_else(|e| panic!("{e}")));
    let gap = ends[0].mesh.positions.iter().zip(&ends[1].mesh.positions).all(|(a, b)| near(*a, *b, 2e-3));
    assert!(gap, "the walk is a loop");
}

#[test]
fn the_green_man() {
    let Some(c) = character("characters/greenman.glb") else { return };
    assert_eq!(
        (c.joints().len(), c.object().mesh.positions.len(), c.object().mesh.triangles.len()),
        (12, 196, 356),
        "counts"
    );
    assert_eq!(c.animations(), ["0_pose", "1_idle", "2_move", "3_attack"], "animations");
    assert_eq!(c.elbow(), None, "no joint is named like an elbow");
    let e = Factors::of(&c, "2_move", Some("3_attack"), None)
        .expect_err("self-occlusion would do nothing")
        .to_string();
    assert!(e.contains("elbow") && e.contains("hand_L"), "the joints are listed: {e}");
    let f = Factors::of(&c, "2_move", Some("3_attack"), Some("hand_L")).unwrap_or_else(|e| panic!("{e}"));
    let extremes = [-40.0, 40.0].map(|u| {
        c.posed(&c.pose_of(&f, 0.0, &[u]).unwrap_or_else(|e| panic!("{e}")), &Drive::new(&[]))
            .unwrap_or_else(|e| panic!("{e}"))
    });
    let mut elbow = [f.first, f.second].map(|(k, t)| c.pose(k, t));
    for (pose, o) in elbow.iter_mut().zip(&extremes) {
        c.bend(pose, f.elbow.expect("named"), 0.7).unwrap_or_else(|e| panic!("{e}"));
        let want = c.posed(pose, &Drive::new(&[])).unwrap_or_else(|e| panic!("{e}"));
        assert!(
            want.mesh.positions.iter().zip(&o.mesh.positions).all(|(a, b)| near(*a, *b, 1e-6)),
            "ends of the mixture"
        );
    }
}

#[test]
fn the_open_body() {
    let Some(mut c) = character("body") else { return };
    // 13 378 quads of the group `body`; helpers are left out.
    assert_eq!((c.object().mesh.triangles.len(), c.joints().len()), (26_756, 52), "triangles and bones");
    let [low, high] = c.object().mesh.bounds();
    assert!((1.55..1.75).contains(&(high[2] - low[2])), "metres: {low:?} {high:?}");
    // Means of the joint cubes and vertices of base.obj, worked out apart: decimetres to metres, (x, y, z) to
    // (x, −z, y).
    let joint = |n: &str| c.joints()[c.joint(n).unwrap_or_else(|e| panic!("{e}"))].position();
    let foot = joint("mixamorig:LeftFoot");
    for (got, want) in [
        (joint("mixamorig:Hips"), [0.001_095, -0.026_105, 0.093_62]),
        (joint("mixamorig:LeftArm"), [0.167_712, -0.014_605, 0.524_58]),
        (foot, [0.219_62, 0.000_91, -0.744_785]),
    ] {
        assert!((0..3).all(|k| (got[k] - want[k]).abs() < 2e-6), "{got:?} and {want:?}");
    }
    // The toes are in front of the ankle: it faces −y.
    assert!(joint("mixamorig:LeftToeBase")[1] < foot[1] - 0.05, "forward is −y");
    let rest = c.posed(&c.rest(), &Drive::new(&[])).unwrap_or_else(|e| panic!("{e}"));
    assert!(
        rest.mesh.positions.iter().zip(&c.object().mesh.positions).all(|(a, b)| near(*a, *b, 1e-6)),
        "rest is canonical"
    );
    for (_, w) in c.influences() {
        assert!((w.iter().fold(0.0, |s, x| s + x) - 1.0).abs() < 1e-12, "weights sum to 1: {w:?}");
    }
    c.fit(2.0).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(c.animations(), ["Rest", "Stand", "Walk", "Reach"], "movements");
    let wide = |name: &str| {
        let pose = c.pose(c.animation(name).unwrap_or_else(|e| panic!("{e}")), 0.0);
        let [low, high] = c.posed(&pose, &Drive::new(&[])).unwrap_or_else(|e| panic!("{e}")).mesh.bounds();
        [high[0] - low[0], low[1]]
    };
    assert!(wide("Stand")[0] < 0.75 * wide("Rest")[0], "arms down");
    assert!(
        wide("Reach")[1] < wide("Rest")[1] - 0.2,
        "hands forward: {} and {}",
        wide("Reach")[1],
        wide("Rest")[1]
    );
    // Posture by the walk alone: one foot in front, then the other (forward is −y).
    let walk = Factors::of(&c, "Walk", None, None).unwrap_or_else(|e| panic!("{e}"));
    let foot = c.joint("mixamorig:LeftFoot").unwrap_or_else(|e| panic!("{e}"));
    let ahead = |posture: f64| {
        let pose = c.pose_of(&walk, 0.0, &[posture, 0.0]).unwrap_or_else(|e| panic!("{e}"));
        let rest = c.joints()[foot].position();
        let moved = reference::body::skin::point(&c.transforms(&pose)[foot], rest);
        rest[1] - moved[1]
    };
    let steps = [ahead(-4.0), ahead(0.0), ahead(4.0)];
    assert!(
        steps[0] > 0.2 && steps[0] - steps[1] > 0.3 && steps[1] - steps[2] > 0.3,
        "the left foot moves from the front to the back: {steps:?}"
    );
}

#[test]
fn the_square_in_dresden() {
    let Some(path) = real_data("env/dresden_square_1k.hdr") else { return };
    let ours = environment_file::read(&path, &Options::default()).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!((ours.width, ours.height), (1024, 512), "size");
    let blender = Options { orientation: Orientation::Blender, ..Options::default() };
    let blender = environment_file::read(&path, &blender).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(
        blender.radiance[1024 * 200 + 300],
        ours.radiance[1024 * 200 + 300 - 256],
        "a quarter to the left"
    );
    let bright = |rows: std::ops::Range<usize>| {
        ours.radiance[rows.start * 1024..rows.end * 1024].iter().fold(0.0, |s, t| s + f64::from(t[1]))
    };
    assert!(bright(0..256) > 2.0 * bright(256..512), "the sky is above");
}
