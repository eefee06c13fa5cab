//! Skins, animations, poses, factors and templates against closed forms.

use super::{apart, object, parse};
use crate::samples::gltf::{Builder, arm, triangle};
use data_gen::figure::factors::Drive;
use lastlight::scene::character::{Character, Factors, Pose};
use lastlight::scene::mesh::Object;
use serde_json::json;

fn character(b: &Builder) -> Character {
    Character::from_gltf(parse(b), "a.glb").unwrap_or_else(|e| panic!("{e}"))
}

fn posed(c: &Character, pose: &Pose) -> Object {
    c.posed(pose, &Drive::new(&[])).unwrap_or_else(|e| panic!("{e}"))
}

/// (x, y) of the file as z-up coordinates.
fn at(x: f64, y: f64) -> [f64; 3] {
    [x, 0.0, y]
}

/// The arm with its second joint turned by an angle about z of the file.
fn bent(angle: f64) -> [[f64; 3]; 4] {
    let (s, c) = (libm::sin(angle), libm::cos(angle));
    // about (1, 0)
    let turn = |x: f64, y: f64| at(1.0 + c * (x - 1.0) - s * y, s * (x - 1.0) + c * y);
    let still = at(1.0, 0.1);
    let moved = turn(1.0, 0.1);
    let half = std::array::from_fn(|k| 0.25 * still[k] + 0.75 * moved[k]);
    [at(0.0, 0.1), half, turn(2.0, 0.1), turn(2.0, -0.1)]
}

#[test]
fn a_linear_animation_bends_the_arm() {
    let c = character(&arm());
    assert_eq!(c.animations(), ["bend"], "names");
    let names: Vec<&str> = c.joints().iter().map(|j| j.name.as_str()).collect();
    assert_eq!(names, ["upper", "lowerarm"], "joints of the skin");
    assert_eq!(c.joints()[1].parent, Some(0), "hierarchy");
    assert_eq!(c.joints()[1].position(), [1.0, 0.0, 0.0], "bound at x = 1");
    let k = c.animation("bend").unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(c.duration(k), 2.0, "seconds");
    // Before, within, after: rotations on the sphere, ends held.
    for (time, angle) in
        [(-1.0, 0.0), (0.0, 0.0), (0.5, 22.5), (1.0, 45.0), (1.9, 85.5), (2.0, 90.0), (9.0, 90.0)]
    {
        let o = posed(&c, &c.pose(k, time));
        let e = apart(&o.mesh.positions, &bent(f64::to_radians(angle)));
        assert!(e < 2e-7, "{time} s: off by {e}");
        assert!(
            o.mesh.normals.iter().all(|n| (n[1] + 1.0).abs() < 1e-6),
            "the plane stays: {:?}",
            o.mesh.normals
        );
    }
}

#[test]
fn steps_and_cubic_splines() {
    let mut b = arm();
    b.root["animations"][0]["samplers"][0]["interpolation"] = json!("STEP");
    let c = character(&b);
    for (time, angle) in [(1.99, 0.0), (2.0, 90.0)] {
        let e = apart(&posed(&c, &c.pose(0, time)).mesh.positions, &bent(f64::to_radians(angle)));
        assert!(e < 2e-7, "step at {time}: off by {e}");
    }
    // A translation of the second joint: keys at 1 and 3 s, x from 1 to 2, slope 3 out of the first key, −1
    // into the second.
    let mut b = arm();
    let times = b.floats(&[[1.0], [3.0]]);
    let values = b.floats(&[
        [9.0, 9.0, 9.0],
        [1.0, 0.0, 0.0],
        [3.0, 0.0, 0.0],
        [-1.0, 0.0, 0.0],
        [2.0, 0.0, 0.0],
        [9.0; 3],
    ]);
    b.root["animations"] = json!([{
        "samplers": [{ "input": times, "output": values, "interpolation": "CUBICSPLINE" }],
        "channels": [{ "sampler": 0, "target": { "node": 2, "path": "translation" } }]
    }]);
    let c = character(&b);
    for time in [0.0, 1.0, 1.3, 2.0, 2.9, 3.0, 4.0] {
        let s = lastlight::num::order::clamp((time - 1.0) / 2.0, 0.0, 1.0);
        let (s2, s3) = (s * s, s * s * s);
        let x = (2.0 * s3 - 3.0 * s2 + 1.0) + 2.0 * (s3 - 2.0 * s2 + s) * 3.0 + (3.0 * s2 - 2.0 * s3) * 2.0
            - 2.0 * (s3 - s2);
        let got = posed(&c, &c.pose(0, time)).mesh.positions[2][0];
        assert!((f64::from(got) - (x + 1.0)).abs() < 1e-6, "{time} s: {got} and {}", x + 1.0);
    }
    // In the middle of two equal slopes' key the spline is Hermite's, which is checked above against the
    // formula; at the keys it is exact.
    assert_eq!(posed(&c, &c.pose(0, 3.0)).mesh.positions[2][0], 3.0, "the key");
}

#[test]
fn the_rest_pose_of_a_model_is_that_of_its_character() {
    let mut b = arm();
    // The second joint rests turned by 90°.
    let h = 0.5f64.sqrt();
    b.root["nodes"][2]["rotation"] = json!([0.0, 0.0, h, h]);
    let c = character(&b);
    let want = bent(std::f64::consts::FRAC_PI_2);
    assert!(apart(&object(&b).mesh.positions, &want) < 2e-7, "model");
    assert!(apart(&posed(&c, &c.rest()).mesh.positions, &want) < 2e-7, "character");
    assert!(apart(&c.object().mesh.positions, &bent(0.0)) < 2e-7, "the canonical surface is the bound one");
    // The transform of a skinned node is ignored, that of the joints' ancestors is not.
    b.root["nodes"][0]["translation"] = json!([5.0, 0.0, 0.0]);
    assert!(apart(&object(&b).mesh.positions, &want) < 2e-7, "the node of a skinned mesh does not move it");
    b.root["nodes"][1]["translation"] = json!([0.0, 2.0, 0.0]);
    let moved = want.map(|[x, y, z]| [x, y, z + 2.0]);
    assert!(apart(&object(&b).mesh.positions, &moved) < 4e-7, "the root joint does");
}

#[test]
fn rigid_meshes_hang_on_their_joint() {
    // A triangle under a node that is below the second joint, moved by (0, 1, 0) and doubled.
    let mut b = arm();
    let p = b.floats(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let mesh = b.mesh(json!({ "POSITION": p }), None);
    let node = b.push(
        "nodes",
        json!({ "name": "helmet", "mesh": mesh, "translation": [0.0, 1.0, 0.0], "scale": [2.0, 2.0, 2.0] }),
    );
    b.root["nodes"][3]["children"] = json!([node]);
    let c = character(&b);
    let (joints, weights) = c.influences()[4];
    assert_eq!((joints[0], weights), (1, [1.0, 0.0, 0.0, 0.0]), "weight 1 on the nearest joint above");
    let o = posed(&c, &c.pose(0, 2.0));
    // At rest its corners are (2, 1), (4, 1), (2, 3); the second joint turns them by 90° about (1, 0).
    let want = [at(0.0, 1.0), at(0.0, 3.0), at(-2.0, 1.0)];
    assert!(apart(&o.mesh.positions[4..], &want) < 4e-7, "{:?}", &o.mesh.positions[4..]);
    // Hiding it leaves the arm; names of nodes and meshes are accepted; for other names the error lists them.
    let mut hidden = c.clone();
    hidden.hide(&["helmet"]).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(hidden.object().mesh.positions, c.object().mesh.positions[..4], "the rest stays");
    let e = c.clone().hide(&["hat"]).expect_err("unknown");
    assert!(e.to_string().contains("helmet"), "{e}");
    assert!(c.clone().hide(&["helmet", "arm"]).is_err(), "nothing left");
    // Without a skin or an animated ancestor, it is static.
    let still = character(&triangle());
    assert_eq!(posed(&still, &still.rest()), *still.object(), "nothing moves");
}

#[test]
fn mixtures_and_bends() {
    let c = character(&arm());
    let (a, b) = (c.pose(0, 0.0), c.pose(0, 2.0));
    // Half-way between 0 and 90° is 45° for nlerp too; a quarter is atan of the ratio of the mixed sines.
    let quarter = 2.0
        * libm::atan2(
            0.25 * libm::sin(f64::to_radians(45.0)),
            0.75 + 0.25 * libm::cos(f64::to_radians(45.0)),
        );
    for (w, angle) in
        [(0.0, 0.0), (0.25, quarter), (0.5, f64::to_radians(45.0)), (1.0, f64::to_radians(90.0))]
    {
        let e = apart(&posed(&c, &a.mix(&b, w)).mesh.positions, &bent(angle));
        assert!(e < 2e-7, "w = {w}: off by {e}");
    }
    // The elbow: the forearm points to +x, forward is −y, so it swings to (cos, −sin, 0).
    let joint = c.elbow().expect("named like one");
    assert_eq!(c.joints()[joint].name, "lowerarm", "found by name");
    let mut pose = c.rest();
    c.bend(&mut pose, joint, 0.5).unwrap_or_else(|e| panic!("{e}"));
    let tip = posed(&c, &pose).mesh.positions[2];
    let want = [1.0 + libm::cos(0.5), -libm::sin(0.5), 0.1];
    assert!(apart(&[tip], &[want]) < 2e-7, "{tip:?} and {want:?}");
    // Factors: posture mixes, self-occlusion bends by 1.4 σ(1.5 u).
    let mut two = arm();
    let copy = two.root["animations"][0].clone();
    two.push("animations", copy);
    two.root["animations"][1]["name"] = json!("other");
    let c = character(&two);
    let f = Factors::of(&c, "bend", Some("other"), None).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(f, Factors { first: (0, 1.0), second: (1, 1.0), elbow: Some(1) }, "names are looked up");
    let sigmoid = 1.0 / (1.0 + libm::exp(-1.5 * 0.7));
    let tip = posed(&c, &c.pose_of(&f, 1.0, &[0.3, 0.7]).unwrap_or_else(|e| panic!("{e}"))).mesh.positions[2];
    let want = [1.0 + libm::cos(1.4 * sigmoid), -libm::sin(1.4 * sigmoid), 0.1];
    assert!(apart(&[tip], &[want]) < 2e-7, "{tip:?} and {want:?}");
    assert!(
        Factors::of(&c, "bend", None, Some("knee")).expect_err("unknown").to_string().contains("lowerarm"),
        "listed"
    );
}

#[test]
fn folds_move_points_along_their_normals() {
    let mut c = character(&arm());
    c.fit(2.0).unwrap_or_else(|e| panic!("{e}"));
    let [low, high] = c.object().mesh.bounds();
    assert!((high[2] - low[2] - 2.0).abs() < 1e-6 && (high[2] + low[2]).abs() < 1e-6, "2 high, centred");
    let drive = Drive::new(&[0.0, 0.0, 1.3, 0.0]);
    let flat = posed(&c, &c.rest());
    let folded = c.posed(&c.rest(), &drive).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(
        folded.mesh.positions[0], flat.mesh.positions[0],
        "a vertex on no face with area has no direction to move in"
    );
    for (i, p) in flat.mesh.positions.iter().enumerate().skip(1) {
        let x = p.map(f64::from);
        let height = 0.03 * 1.3 * libm::sin(12.0 * x[2] + 3.0 * libm::atan2(x[1], x[0]));
        // the normal is −y
        let want = [x[0], x[1] - height, x[2]];
        assert!(apart(&[folded.mesh.positions[i]], &[want]) < 1e-6, "vertex {i}");
        let slope = 0.03 * 1.3 * libm::cos(12.0 * x[2] + 3.0 * libm::atan2(x[1], x[0]));
        let near = x[0] * x[0] + x[1] * x[1];
        let square = if near > 0.0025 { near } else { 0.0025 };
        let g = [slope * 3.0 * -x[1] / square, 0.0, slope * 12.0];
        let n = (1.0 + g[0] * g[0] + g[2] * g[2]).sqrt();
        let want = [-g[0] / n, -1.0 / n, -g[2] / n];
        assert!(
            apart(&[folded.mesh.normals[i]], &[want]) < 1e-5,
            "normal {i}: {:?} and {want:?}",
            folded.mesh.normals[i]
        );
    }
    // Scaling applies to the animation too.
    let e = {
        let raw = character(&arm());
        let (a, b) = (posed(&raw, &raw.pose(0, 1.0)), posed(&c, &c.pose(0, 1.0)));
        let k = 2.0 / 0.2;
        let want: Vec<[f64; 3]> = a
            .mesh
            .positions
            .iter()
            .map(|p| [k * (f64::from(p[0]) - 1.0), k * f64::from(p[1]), k * f64::from(p[2])])
            .collect();
        apart(&b.mesh.positions, &want)
    };
    assert!(e < 2e-5, "off by {e}");
}

/// The degrees between two directions.
fn degrees(a: [f64; 3], b: [f64; 3]) -> f64 {
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let cos = dot(a, b) / (dot(a, a) * dot(b, b)).sqrt();
    libm::acos(lastlight::num::order::clamp(cos, -1.0, 1.0)).to_degrees()
}

/// The folded normals of a tube of radius 0.2 with that many vertices around: how far they are from those of
/// the displaced surface at worst, and how far slope alone would be, in degrees.
fn tube(around: u16) -> [f64; 2] {
    let (rows, r) = (200u16, 0.2);
    let (mut positions, mut normals, mut corners) = (Vec::new(), Vec::new(), Vec::new());
    for i in 0..=rows {
        for j in 0..around {
            let phi = f64::from(j) / f64::from(around) * std::f64::consts::TAU;
            let (s, c, z) = (libm::sin(phi), libm::cos(phi), 2.0 * f64::from(i) / f64::from(rows) - 1.0);
            // y up
            positions.push([(r * c) as f32, z as f32, (-r * s) as f32]);
            normals.push([c as f32, 0.0, -s as f32]);
            if i < rows {
                let at = |i: u16, j: u16| i * around + j % around;
                corners.extend([at(i, j), at(i, j + 1), at(i + 1, j)]);
                corners.extend([at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)]);
            }
        }
    }
    let mut b = Builder::new();
    let (p, n, i) = (b.floats(&positions), b.floats(&normals), b.indices(&corners));
    let mesh = b.mesh(json!({ "POSITION": p, "NORMAL": n }), Some(i));
    b.push("nodes", json!({ "mesh": mesh }));
    let c = character(&b);
    let u = 1.3;
    let folded = c.posed(&c.rest(), &Drive::new(&[0.0, 0.0, u])).unwrap_or_else(|e| panic!("{e}"));
    // The surface is where the distance from the axis is r + h; its normal is the gradient of that.
    let height = |phi: f64, z: f64| 0.03 * u * libm::sin(12.0 * z + 3.0 * phi);
    let slope = |phi: f64, z: f64| 0.03 * u * libm::cos(12.0 * z + 3.0 * phi);
    let (mut worst, mut slope_alone) = (0.0f64, 0.0f64);
    let rest = c.object().mesh.positions.iter();
    for (i, (x, n)) in rest.zip(&folded.mesh.normals).enumerate() {
        // Vertices on the two rims have faces on one side only.
        if i < usize::from(around) || i >= usize::from(rows * around) {
            continue;
        }
        let (phi, z) = (libm::atan2(f64::from(x[1]), f64::from(x[0])), f64::from(x[2]));
        let (s, c) = (libm::sin(phi), libm::cos(phi));
        let normal = |radius: f64| {
            let (turn, rise) = (3.0 * slope(phi, z) / radius, 12.0 * slope(phi, z));
            [c + s * turn, s - c * turn, -rise]
        };
        let want = normal(r + height(phi, z));
        let got = n.map(f64::from);
        worst = lastlight::num::order::max(worst, degrees(got, want));
        slope_alone = lastlight::num::order::max(slope_alone, degrees(normal(r), want));
    }
    [worst, slope_alone]
}

/// Where folds change the curvature, normals are those of the displaced surface, not those of the slope
/// alone.
#[test]
fn normals_under_folds_are_those_of_the_displaced_surface() {
    let [coarse, middle, fine] = [48, 96, 192].map(tube);
    println!("normals: {coarse:.3?}, {middle:.3?}, {fine:.3?} degrees off at worst; slope alone second");
    assert!(fine[0] < 0.2, "{} degrees", fine[0]);
    assert!(middle[0] < 0.6 * coarse[0] && fine[0] < 0.6 * middle[0], "what is left is the mesh's");
    assert!(fine[1] > 3.0, "the test sees curvature: {} degrees", fine[1]);
}

/// On a plane whose share of the folds falls from one corner to the others, that fall is part of the slope.
#[test]
fn normals_know_where_the_folds_end() {
    let mut b = arm();
    for node in b.root["nodes"].as_array_mut().expect("nodes") {
        if node["name"] == "upper" {
            node["name"] = json!("spine");
        }
    }
    let c = character(&b);
    let t = c.template(200, 3).unwrap_or_else(|e| panic!("{e}"));
    let drive = Drive::new(&[0.0, 0.0, 1.3]);
    let cloud = c.cloud(&t, &c.rest(), &drive);
    // Weights on the first joint, the trunk, are ¼, 0, 0 at the corners of the second triangle; the normal is
    // −y.
    let [p0, p1, p2] = c.object().mesh.corners(1).map(|x| x.map(f64::from));
    let (e, f) = ([p1[0] - p0[0], p1[2] - p0[2]], [p2[0] - p0[0], p2[2] - p0[2]]);
    let area = e[0] * f[1] - e[1] * f[0];
    // The gradient of the share: −¼ along both edges.
    let fall = [-0.25 * (f[1] - e[1]) / area, -0.25 * (e[0] - f[0]) / area];
    let mut tilted = 0;
    for (i, p) in t.points.iter().enumerate() {
        assert_eq!(p.triangle, 1, "the other triangle has no area");
        let share = 0.25 * p.corners[0];
        let (height, g) = drive.wrinkles(p.position);
        let slope = [share * g[0] + height * fall[0], share * g[2] + height * fall[1]];
        let off = degrees(cloud.normals[i], [-slope[0], -1.0, -slope[1]]);
        assert!(off < 1e-4, "point {i}: {off} degrees");
        tilted += usize::from(degrees([-share * g[0], -1.0, -share * g[2]], cloud.normals[i]) > 0.1);
    }
    assert!(tilted > 20, "the fall is seen at {tilted} points");
}

#[test]
fn template_points_lie_on_the_surface() {
    let c = character(&arm());
    let t = c.template(4000, 7).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(
        c.template(100, 7).unwrap_or_else(|e| panic!("{e}")).points,
        t.points[..100],
        "prefixes agree"
    );
    let mesh = &c.object().mesh;
    let mut on_first = 0;
    for p in &t.points {
        let corners = mesh.corners(p.triangle as usize).map(|x| x.map(f64::from));
        for k in 0..3 {
            let x =
                p.corners[0] * corners[0][k] + p.corners[1] * corners[1][k] + p.corners[2] * corners[2][k];
            assert!((x - p.position[k]).abs() < 1e-12, "barycentric");
        }
        assert!(p.corners.iter().all(|c| *c >= 0.0), "inside");
        assert!((p.weights.iter().fold(0.0, |s, w| s + w) - 1.0).abs() < 1e-12, "weights");
        // Weight on the second joint is that of x: 0, 0.75, 1, 1 at the corners.
        let second = p.joints.iter().zip(p.weights).filter(|(j, _)| **j == 1).fold(0.0, |s, (_, w)| s + w);
        let want = match p.triangle {
            0 => 0.75 * p.corners[1] + p.corners[2],
            _ => 0.75 * p.corners[0] + p.corners[1] + p.corners[2],
        };
        assert!((second - want).abs() < 1e-12, "interpolated weights: {second} and {want}");
        on_first += usize::from(p.triangle == 0);
        assert!(p.rgb.iter().all(|x| (x - 1.0).abs() < 1e-12), "base colour");
    }
    // Degenerate first triangle: (0, 0.1), (1, 0.1), (2, 0.1) is a line.
    assert_eq!(on_first, 0, "no point on a triangle without area");
    let cloud = c.cloud(&t, &c.pose(0, 2.0), &Drive::new(&[]));
    assert_eq!((cloud.points.len(), cloud.rgb.len()), (4000, 4000), "as many");
    for (p, x) in t.points.iter().zip(&cloud.points) {
        // Linear blend skinning of the canonical point.
        let second = p.joints.iter().zip(p.weights).filter(|(j, _)| **j == 1).fold(0.0, |s, (_, w)| s + w);
        let [px, _, pz] = p.position;
        let turned = [1.0 - pz, 0.0, px - 1.0];
        let want: [f64; 3] = std::array::from_fn(|k| (1.0 - second) * p.position[k] + second * turned[k]);
        assert!((0..3).all(|k| (x[k] - want[k]).abs() < 1e-6), "{x:?} and {want:?}");
    }
}

#[test]
fn points_are_spread_by_area() {
    // Areas 1 : 3, 20 000 points: the share on the first is ¼ within 4 standard errors.
    let mut b = Builder::new();
    let p = b.floats(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [3.0, 0.0, 0.0]]);
    let i = b.indices(&[0, 1, 2, 0, 3, 2]);
    let mesh = b.mesh(json!({ "POSITION": p }), Some(i));
    b.push("nodes", json!({ "mesh": mesh }));
    let c = character(&b);
    let n = 20_000;
    let t = c.template(n, 1).unwrap_or_else(|e| panic!("{e}"));
    let first = t.points.iter().filter(|p| p.triangle == 0).count();
    let error = (0.25 * 0.75 / n as f64).sqrt();
    assert!((first as f64 / n as f64 - 0.25).abs() < 4.0 * error, "{first} of {n}");
    // On the triangle, the mean is the centroid.
    let mean = |k: usize| {
        t.points.iter().filter(|p| p.triangle == 1).fold(0.0, |s, p| s + p.corners[k]) / (n - first) as f64
    };
    for k in 0..3 {
        assert!((mean(k) - 1.0 / 3.0).abs() < 0.01, "corner {k}: {}", mean(k));
    }
}
