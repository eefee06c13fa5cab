//! Tests of the template points: positions, bending, folds, shading.

use data_gen::figure::appearance::Appearance;
use data_gen::figure::factors::{Drive, linear_of_srgb, shaded, srgb_of_linear, turn_hue};
use data_gen::figure::skeleton::{BONES, SKIRT_RING, bones, pose, weights};
use data_gen::figure::template::Template;
use reference::body::skin;

#[test]
fn templates_have_their_points_in_proportion_to_area_and_on_the_capsules() {
    let bones = bones();
    for p in [64, 1024, 2048, 4096, 8192] {
        let t = Template::new(p);
        assert_eq!((t.points.len(), t.weights.len()), (p, p), "P points");
        for b in 0..BONES {
            assert!(t.bone_of.contains(&b), "bone {b} has points at P = {p}");
        }
        for (i, (&x, w)) in t.points.iter().zip(&t.weights).enumerate() {
            let sum = w.iter().fold(0.0, |s, w| s + w);
            assert!((sum - 1.0).abs() < 1e-15, "weights sum to 1: {sum}");
            assert!(w.iter().filter(|w| **w > 0.0).count() <= 4, "four bones at most");
            assert!(x.iter().all(|c| (-1.0 - 1e-9..=1.0 + 1e-9).contains(c)), "inside the frame: {x:?}");
            let b = t.bone_of[i];
            if b != SKIRT_RING {
                let d = data_gen::figure::skeleton::distance_squared(&bones[b], x).sqrt();
                assert!((d - bones[b].radius).abs() < 1e-12, "point {i} lies on capsule {b}");
            }
            let length = t.normals[i].iter().fold(0.0, |s, n| s + n * n);
            assert!((length - 1.0).abs() < 1e-12, "unit normals");
        }
    }
    let t = Template::new(4096);
    let share = |b: usize| t.bone_of.iter().filter(|&&x| x == b).count() as f64;
    let area = |b: usize| {
        let d: [f64; 3] = std::array::from_fn(|k| bones[b].to[k] - bones[b].from[k]);
        let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
        bones[b].radius * (length + 2.0 * bones[b].radius)
    };
    assert!((share(0) / share(7) - area(0) / area(7)).abs() < 0.02, "pelvis and thigh");
}

#[test]
fn the_body_stands_two_units_high_and_mirrored_bones_are_mirrored() {
    let t = Template::new(8192);
    let range = |k: usize| {
        t.points.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| {
            [if x[k] < low { x[k] } else { low }, if x[k] > high { x[k] } else { high }]
        })
    };
    let [low, high] = range(2);
    assert!((-1.0..-0.99).contains(&low) && (0.99..=1.0).contains(&high), "z from {low} to {high}");
    let bones = bones();
    for (left, right) in [(3, 4), (5, 6), (7, 8), (9, 10)] {
        assert_eq!(bones[left].to[0], -bones[right].to[0], "x");
        assert_eq!(bones[left].to[1..], bones[right].to[1..], "y and z");
    }
    let w = weights(&bones, bones[7].from);
    assert!(w[7] > 0.4, "a hip belongs to its thigh: {w:?}");
}

#[test]
fn poses_turn_by_the_published_angles() {
    let bones = bones();
    let turned = |b: usize, u: &[f64]| {
        let drive = Drive::new(u);
        let m = pose(&bones, &drive);
        let parent = bones[b].parent.expect("a limb");
        // Both are rotations, so the trace of one after the inverse of the other is 1 + 2 cos.
        let trace = (0..3).fold(0.0, |s, i| s + (0..3).fold(0.0, |s, k| s + m[b][i][k] * m[parent][i][k]));
        arc_cosine(0.5 * (trace - 1.0))
    };
    let sigmoid = |x: f64| 1.0 / (1.0 + reference::num::elem::exp(-x));
    for u in [-1.5, -0.2, 0.7, 2.0] {
        let posture = [u];
        assert!((turned(3, &posture) - (0.45 * u).abs()).abs() < 1e-7, "left arm at {u}");
        assert!((turned(4, &posture) - (0.45 * u).abs()).abs() < 1e-7, "right arm at {u}");
        assert!((turned(9, &posture) - 0.9 * sigmoid(1.5 * u)).abs() < 1e-7, "knee at {u}");
        assert!((turned(6, &[0.0, u]) - 1.4 * sigmoid(1.5 * u)).abs() < 1e-7, "elbow at {u}");
        assert!(turned(5, &[u, u]) < 1e-7, "the left elbow does not move");
    }
    // The bent forearm ends in front of the torso: nearer to the median plane, and at smaller y.
    let hand = |u: f64| skin::point(&pose(&bones, &Drive::new(&[0.0, u]))[6], bones[6].to);
    let (straight, bent) = (hand(-3.0), hand(3.0));
    assert!(bent[0].abs() < 0.1 && bent[1] < -0.2, "bent: {bent:?}");
    assert!(straight[0] < -0.4, "straight: {straight:?}");
}

fn arc_cosine(x: f64) -> f64 {
    reference::scalar::Scalar::acos(if x > 1.0 { 1.0 } else { x })
}

#[test]
fn every_factor_touches_what_it_should_and_nothing_else() {
    let t = Template::new(512);
    let look = Appearance::new(1, 2);
    let posed = |u: &[f64]| t.posed(&Drive::new(u), &look);
    let rest = posed(&[0.3, -0.2, 0.4, 0.1]);
    let light = posed(&[0.3, -0.2, 0.4, 1.5]);
    assert_eq!(rest.points, light.points, "light does not affect positions");
    assert!(rest.rgb != light.rgb, "light affects colours");
    let folds = posed(&[0.3, -0.2, -0.9, 0.1]);
    for p in 0..512 {
        let moved = rest.points[p] != folds.points[p];
        assert!(t.is_cloth(p) || !moved, "wrinkles move point {p} of bone {}", t.bone_of[p]);
    }
    let hue = posed(&[0.3, -0.2, 0.4, 0.1, 0.0, 0.0, 1.0]);
    assert_eq!(rest.points, hue.points, "hue does not affect positions");
    assert!(rest.rgb != hue.rgb, "hue affects colours");
}

#[test]
fn wrinkles_are_the_published_wave_and_do_not_know_the_posture() {
    let t = Template::new(1024);
    for (p, &rest) in t.points.iter().enumerate().filter(|&(p, _)| t.is_cloth(p)) {
        let u = 0.8;
        let one = t.canonical(p, &Drive::new(&[1.7, -1.0, u]));
        let other = t.canonical(p, &Drive::new(&[-1.2, 2.0, u, 0.3]));
        assert_eq!(one, other, "the canonical surface depends only on u_W");
        let angle = 12.0 * rest[2] + 3.0 * reference::scalar::Scalar::atan2(rest[1], rest[0]);
        let height = 0.03 * u * reference::num::elem::sin(angle);
        let off: [f64; 3] = std::array::from_fn(|k| one[0][k] - rest[k] - height * t.normals[p][k]);
        assert!(off.iter().all(|x| x.abs() < 1e-15), "point {p} is displaced by 0.03 u sin(12 z + 3 φ)");
    }
}

#[test]
fn folds_depend_on_their_factor_alone_whatever_width_and_length_do() {
    let t = Template::new(1024);
    for p in (0..1024).filter(|&p| t.is_cloth(p)) {
        let lift = |b: f64, s: f64| {
            let [flat, folded] =
                [0.0, 1.3].map(|w| t.canonical(p, &Drive::new(&[0.0, 0.0, w, 0.0, b, s]))[0]);
            [0, 1, 2].map(|k| folded[k] - flat[k])
        };
        let (plain, other) = (lift(0.0, 0.0), lift(-1.2, 1.7));
        assert!((0..3).all(|k| (plain[k] - other[k]).abs() < 1e-15), "point {p}: {plain:?} and {other:?}");
    }
}

/// The surface of a bone on which a point lies: a position near x at rest, projected to the surface, and its
/// normal.
fn on_surface(t: &Template, p: usize, x: [f64; 3]) -> [[f64; 3]; 2] {
    let bone = &t.bones[t.bone_of[p]];
    let unit = |v: [f64; 3]| {
        let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
        v.map(|x| x / length)
    };
    if t.bone_of[p] == SKIRT_RING {
        // A cone about z through the point: its radius grows by −n_z/n_flat per unit of height.
        let (rest, n) = (t.points[p], t.normals[p]);
        let flat = (n[0] * n[0] + n[1] * n[1]).sqrt();
        let radius = (rest[0] * rest[0] + rest[1] * rest[1]).sqrt() - n[2] / flat * (x[2] - rest[2]);
        let out = unit([x[0], x[1], 0.0]);
        return [[radius * out[0], radius * out[1], x[2]], [flat * out[0], flat * out[1], n[2]]];
    }
    let along: [f64; 3] = std::array::from_fn(|k| bone.to[k] - bone.from[k]);
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let place = dot(along, std::array::from_fn(|k| x[k] - bone.from[k])) / dot(along, along);
    #[expect(clippy::manual_clamp, reason = "clamp does not specify signed zeros")]
    let place = match place {
        x if x < 0.0 => 0.0,
        x if x > 1.0 => 1.0,
        x => x,
    };
    let base: [f64; 3] = std::array::from_fn(|k| bone.from[k] + place * along[k]);
    let n = unit(std::array::from_fn(|k| x[k] - base[k]));
    [std::array::from_fn(|k| base[k] + bone.radius * n[k]), n]
}

#[test]
fn normals_are_those_of_the_displaced_surface() {
    // Comparison with central differences of chest, belly and skirt under folds, width and length.
    let t = Template::new(2048);
    for u in [[1.0, 0.0, 0.0], [-2.0, 0.0, 0.0], [1.5, 1.0, -1.0], [0.0, 0.0, 2.0]] {
        let drive = Drive::new(&[0.0, 0.0, u[0], 0.0, u[1], u[2]]);
        let (mut checked, mut worst) = (0, 0.0f64);
        for p in (0..2048).filter(|&p| t.is_cloth(p)) {
            let (x, n) = (t.points[p], t.normals[p]);
            let bone = &t.bones[t.bone_of[p]];
            // The curvature is discontinuous where cap and tube meet, and the azimuth has no gradient near
            // the axis.
            let along: [f64; 3] = std::array::from_fn(|k| bone.to[k] - bone.from[k]);
            let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
            let place = dot(along, std::array::from_fn(|k| x[k] - bone.from[k])) / dot(along, along);
            let is_joint = t.bone_of[p] != SKIRT_RING && (place.abs() < 1e-3 || (place - 1.0).abs() < 1e-3);
            if is_joint || x[0] * x[0] + x[1] * x[1] < 0.06 * 0.06 {
                continue;
            }
            let moved = |y: [f64; 3]| -> [f64; 3] {
                let [y, m] = on_surface(&t, p, y);
                let width = drive.width * 0.02;
                let lift = width + drive.wrinkles(y).0;
                let z = if t.bone_of[p] == SKIRT_RING { drive.skirt_height(rim(), y[2]) } else { y[2] };
                [y[0] + lift * m[0], y[1] + lift * m[1], z + lift * m[2]]
            };
            let [at, normal] = t.canonical(p, &drive);
            let here = moved(x);
            assert!((0..3).all(|k| (at[k] - here[k]).abs() < 1e-12), "point {p}: {at:?} and {here:?}");
            let helper = if n[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
            let cross = |a: [f64; 3], b: [f64; 3]| {
                [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
            };
            let first = cross(helper, n);
            for d in [first, cross(n, first)] {
                let h = 1e-5;
                let (a, b) = (
                    moved(std::array::from_fn(|k| x[k] + h * d[k])),
                    moved(std::array::from_fn(|k| x[k] - h * d[k])),
                );
                let slope: [f64; 3] = std::array::from_fn(|k| (a[k] - b[k]) / (2.0 * h));
                let cosine = (dot(slope, normal) / dot(slope, slope).sqrt()).abs();
                worst = if cosine > worst { cosine } else { worst };
            }
            assert!(dot(normal, n) > 0.0, "point {p}: outwards");
            checked += 1;
        }
        println!("u_W, u_B, u_S {u:?}: {checked} points, largest cosine {worst:.2e}");
        assert!(worst < 1e-6, "{u:?}: a normal is off by {worst}");
        assert!(checked > 500, "cloth has points: {checked}");
    }
}

/// Height of the skirt's upper rim in the figure frame.
fn rim() -> f64 {
    data_gen::figure::skeleton::framed([0.0, 0.0, data_gen::figure::skeleton::SKIRT[0][0]])[2]
}

#[test]
fn shading_is_lambert_with_an_ambient_share() {
    let white = |cosine: f64| linear_of_srgb(shaded([1.0; 3], [0.0, 0.0, 1.0], [0.0, 0.0, cosine])[0]);
    assert!((white(1.0) - 1.0).abs() < 1e-12, "facing the light");
    assert!((white(0.0) - 0.35).abs() < 1e-12 && (white(-1.0) - 0.35).abs() < 1e-12, "ambient share");
    assert!((white(0.5) - 0.675).abs() < 1e-12, "half-way");
    for u in [-1.0, 0.0, 2.0] {
        let l = Drive::new(&[0.0, 0.0, 0.0, u]).towards_light();
        assert!((l[2] - 0.5).abs() < 1e-15, "elevation 30°");
        let azimuth = reference::scalar::Scalar::atan2(l[0], -l[1]);
        assert!((azimuth - 0.8 * u).abs() < 1e-12, "azimuth 0.8 u_L from the front: {azimuth}");
    }
    for x in [0.0, 0.002, 0.0031308, 0.01, 0.5, 1.0] {
        assert!(
            (linear_of_srgb(srgb_of_linear(x)) - x).abs() < 1e-7,
            "transfer functions are inverses at {x}"
        );
    }
    let turned = turn_hue([0.8, 0.3, 0.2], std::f64::consts::TAU / 3.0);
    assert!(
        turned.iter().zip([0.2, 0.8, 0.3]).all(|(a, b)| (a - b).abs() < 1e-12),
        "a third of a turn: {turned:?}"
    );
}
