//! Tests of the surfaces: closed, oriented, folded only by the wrinkle factor.

use crate::looks;
use data_gen::figure::appearance::Appearance;
use data_gen::figure::factors::Drive;
use data_gen::figure::skeleton::{BONES, SKIRT_RING, bones, pose};
use data_gen::figure::surface::Figure;
use data_gen::figure::template::Template;
use reference::body::skin;

#[test]
fn looks_differ_and_every_kind_occurs() {
    let looks: Vec<Appearance> = (0..64).map(|i| Appearance::new(0, i)).collect();
    for (i, a) in looks.iter().enumerate() {
        assert!(looks[..i].iter().all(|b| a != b), "look {i} is its own");
    }
    let kinds: std::collections::BTreeSet<String> =
        looks.iter().map(|a| format!("{:?} {:?}", a.pattern, a.bottom)).collect();
    assert_eq!(kinds.len(), 8, "patterns with skirts and trousers: {kinds:?}");
}

#[test]
fn surfaces_are_closed_and_oriented_and_have_no_degenerate_triangles() {
    for (index, look) in looks().iter().enumerate() {
        let figure = Figure::new(look);
        for u in [
            [0.0; 6],
            [1.5, 1.0, 1.5, 0.0, 0.0, 1.0],
            [-1.5, -1.0, -1.2, 0.5, -2.0, -2.0],
            [0.5, 0.0, 0.0, 0.0, 2.0, 2.0],
            [0.0, 0.0, 0.0, 0.0, -2.0, 0.0],
        ] {
            let posed = figure.posed(&Drive::new(&u));
            for (part, posed) in figure.parts.iter().zip(&posed) {
                let mut edges = std::collections::BTreeMap::new();
                let mut volume = 0.0;
                for t in &part.triangles {
                    let w = t.map(|i| part.weld[i as usize]);
                    assert!(w[0] != w[1] && w[1] != w[2] && w[2] != w[0], "{}: three corners", part.name);
                    for k in 0..3 {
                        *edges.entry((w[k], w[(k + 1) % 3])).or_insert(0) += 1;
                    }
                    let [a, b, c] = t.map(|i| posed.positions[i as usize]);
                    let cross = |a: [f64; 3], b: [f64; 3]| {
                        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
                    };
                    let side = |x: [f64; 3]| -> [f64; 3] { std::array::from_fn(|k| x[k] - a[k]) };
                    let face = cross(side(b), side(c));
                    let area = face.iter().fold(0.0, |s, x| s + x * x).sqrt();
                    assert!(area > 1e-9, "look {index}, {}: a triangle of area {area}", part.name);
                    let out = cross(b, c);
                    volume += a[0] * out[0] + a[1] * out[1] + a[2] * out[2];
                }
                for (&(a, b), &n) in &edges {
                    let back = edges.get(&(b, a)).copied().unwrap_or(0);
                    assert!(
                        n == 1 && back == 1,
                        "look {index}, {}: edge {a}-{b} {n} and {back} times",
                        part.name
                    );
                }
                assert!(volume > 0.0, "look {index}, {}: triangles face outwards", part.name);
                for (v, &first) in part.weld.iter().enumerate() {
                    let same = posed.positions[v] == posed.positions[first as usize];
                    assert!(same, "{}: seams stay closed", part.name);
                }
                let units =
                    posed.normals.iter().all(|n| (n.iter().fold(0.0, |s, x| s + x * x) - 1.0).abs() < 1e-9);
                assert!(units, "{}: unit normals", part.name);
            }
        }
    }
}

#[test]
fn folds_of_surfaces_depend_on_their_factor_alone() {
    // The skinning is inverted: the difference of canonical positions with and without folds is the same in
    // any posture.
    let figure = Figure::new(&looks()[0]);
    let bones = bones();
    let difference = |u: [f64; 2]| {
        let (flat, folded) = (Drive::new(&[u[0], u[1], 0.0]), Drive::new(&[u[0], u[1], 1.0]));
        let transforms = pose(&bones, &flat);
        let mut all = Vec::new();
        for (part, (a, b)) in figure.parts.iter().zip(figure.posed(&flat).iter().zip(figure.posed(&folded))) {
            for v in 0..part.positions.len() {
                let m = skin::blend(&part.weights[v], &transforms);
                let d: [f64; 3] = std::array::from_fn(|k| b.positions[v][k] - a.positions[v][k]);
                all.push(solve(&m, d));
            }
        }
        all
    };
    let (one, other) = (difference([0.0, 0.0]), difference([1.3, -0.8]));
    let worst = one.iter().zip(&other).fold(0.0, |worst: f64, (a, b)| {
        let d = (0..3).fold(0.0, |s: f64, k| s + (a[k] - b[k]).abs());
        if d > worst { d } else { worst }
    });
    assert!(worst < 1e-12, "displacements agree to rounding: {worst}");
    assert!(one.iter().any(|d| d.iter().any(|x| x.abs() > 0.01)), "there are folds");
}

/// M⁻¹ d for the linear part of an affine transform, by cofactors.
fn solve(m: &skin::Affine<f64>, d: [f64; 3]) -> [f64; 3] {
    let c = |i: usize, j: usize| {
        let (a, b, e, f) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
        m[a][e] * m[b][f] - m[a][f] * m[b][e]
    };
    let det = m[0][0] * c(0, 0) + m[0][1] * c(0, 1) + m[0][2] * c(0, 2);
    std::array::from_fn(|j| (c(0, j) * d[0] + c(1, j) * d[1] + c(2, j) * d[2]) / det)
}

#[test]
fn width_length_and_yaw_act_where_they_should_in_both_looks() {
    let drive = |j: usize, x: f64| {
        let mut u = [0.0; 8];
        u[j] = x;
        Drive::new(&u)
    };
    let differing = |a: &[[f64; 3]], b: &[[f64; 3]]| {
        a.iter().zip(b).map(|(a, b)| (0..3).any(|k| (a[k] - b[k]).abs() > 1e-12)).collect::<Vec<bool>>()
    };
    let t = Template::new(1024);
    for look in looks().iter().take(6) {
        let figure = Figure::new(look);
        let (rest, rest_points) = (figure.posed(&drive(0, 0.0)), t.posed(&drive(0, 0.0), look).points);
        let kind = format!("{:?}", look.bottom);
        for (j, x) in [(0, 1.0), (1, 1.0), (4, 1.0), (5, 1.0), (7, 1.0)] {
            let moved: Vec<&str> = (figure.parts.iter().zip(rest.iter().zip(figure.posed(&drive(j, x)))))
                .filter(|(_, (a, b))| differing(&a.positions, &b.positions).contains(&true))
                .map(|(part, _)| part.name)
                .collect();
            let points = differing(&rest_points, &t.posed(&drive(j, x), look).points);
            let bones_of: std::collections::BTreeSet<usize> =
                (0..1024).filter(|&p| points[p]).map(|p| t.bone_of[p]).collect();
            assert!(!moved.is_empty() && !bones_of.is_empty(), "{kind}: factor {j} is seen in both looks");
            let has = |name: &str| moved.contains(&name);
            match j {
                4 => {
                    assert!(has("shirt") && has("left arm") && !has("head") && !has("hair"), "{moved:?}");
                    assert!(bones_of.len() == BONES - 1 && !bones_of.contains(&2), "{bones_of:?}");
                }
                5 => {
                    let cloth =
                        if figure.parts.iter().any(|p| p.name == "skirt") { "skirt" } else { "shirt" };
                    assert_eq!(moved, [cloth], "{kind}: the length is that of one garment");
                    assert_eq!(bones_of.into_iter().collect::<Vec<_>>(), [SKIRT_RING], "its points");
                }
                7 => {
                    assert!(has("head") && has("hair") && !has("left shoe"), "{moved:?}");
                    assert!(bones_of.contains(&2) && !bones_of.contains(&9), "{bones_of:?}");
                }
                _ => {}
            }
        }
    }
}
