//! The figure is what its documentation says: causes, effects, shapes.

use data_gen::figure::appearance::Appearance;
use data_gen::figure::factors::{Drive, LETTERS, linear_of_srgb, shaded, srgb_of_linear, turn_hue};
use data_gen::figure::graph::Graph;
use data_gen::figure::mechanism::{Mechanism, Scm, variance};
use data_gen::figure::samples::{BASES, LEAST_CHANGE, group, observed};
use data_gen::figure::skeleton::{BONES, SKIRT_RING, bones, pose, weights};
use data_gen::figure::sortability::{r2_sortability, varsortability};
use data_gen::figure::surface::Figure;
use data_gen::figure::template::Template;
use data_gen::figure::video;
use reference::array::{Arr, Named, Out};
use reference::body::skin;
use reference::dual::Dual;
use reference::num::rng::{Key, normal_f64};

const P: usize = 0;
const O: usize = 1;
const W: usize = 2;
const L: usize = 3;

fn scm(graph: &str, n: usize, mechanism: Mechanism, standardised: bool, seed: u64) -> Scm {
    Scm::new(Graph::named(graph, n, seed).expect("a known graph"), mechanism, standardised, seed)
}

fn samples(scm: &Scm, seed: u64, n: usize) -> Vec<Vec<f64>> {
    (0..n).map(|i| observed(scm, seed, i, n, 1).u).collect()
}

fn column(samples: &[Vec<f64>], j: usize) -> Vec<f64> {
    samples.iter().map(|u| u[j]).collect()
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len() as f64;
    let mean = |x: &[f64]| x.iter().fold(0.0, |s, x| s + x) / n;
    let (ma, mb) = (mean(a), mean(b));
    let cross = a.iter().zip(b).fold(0.0, |s, (a, b)| s + (a - ma) * (b - mb)) / n;
    cross / (variance(a) * variance(b)).sqrt()
}

#[test]
fn graphs_have_the_published_edges() {
    let edges = |name: &str| {
        let g = Graph::named(name, 4, 0).expect("a known graph");
        let mut list = String::new();
        for i in 0..4 {
            for j in (0..4).filter(|&j| g.adjacency[i][j]) {
                list.extend([LETTERS[i], LETTERS[j], ' ']);
            }
        }
        list
    };
    assert_eq!(edges("FORK"), "PO PW ", "FORK");
    assert_eq!(edges("CHAIN"), "PW OL WO ", "CHAIN");
    assert_eq!(edges("COLLIDER"), "PW OW ", "COLLIDER");
    assert_eq!(edges("DIAMOND"), "PO PW OL WL ", "DIAMOND");
    assert_eq!(edges("FULL"), "PO PW PL OL WO WL ", "FULL");
    assert_eq!(edges("EMPTY"), "", "EMPTY");
    for bad in ["fork", "ER-", "ER-99", "RING"] {
        assert!(Graph::named(bad, 4, 0).is_err(), "{bad} is refused");
    }
    assert!(Graph::named("FORK", 3, 0).is_err() && Graph::named("FORK", 9, 0).is_err(), "sizes are checked");
    assert!(Graph::new(3, &[(0, 1), (1, 2), (2, 0)]).is_err(), "a cycle is refused");
}

#[test]
fn random_graphs_are_acyclic_and_have_as_many_edges_as_asked() {
    let mut different = std::collections::BTreeSet::new();
    for n in 5..=8 {
        for m in [0, 3, n * (n - 1) / 2] {
            for seed in 0..20 {
                let g = Graph::named(&format!("ER-{m}"), n, seed).expect("fits");
                let edges = g.adjacency.iter().flatten().filter(|&&e| e).count();
                assert_eq!(edges, m, "n {n}, seed {seed}");
                assert_eq!(g.order.len(), n, "every node has a place in the order");
                different.insert(format!("{:?}", g.adjacency));
            }
        }
    }
    assert!(different.len() > 100, "seeds give different graphs: {}", different.len());
}

#[test]
fn a_fork_correlates_its_children_and_leaves_light_alone() {
    let scm = scm("FORK", 4, Mechanism::Lin, true, 3);
    let u = samples(&scm, 3, 20_000);
    let r = correlation(&column(&u, W), &column(&u, O));
    let expected = scm.a[P][W] * scm.a[P][O];
    // Standard error (1 − r²)/√N is below 0.0071.
    assert!((r - expected).abs() < 0.03, "corr(W, O) = a_PW·a_PO: {r} against {expected}");
    for j in [P, O, W] {
        let r = correlation(&column(&u, L), &column(&u, j));
        assert!(r.abs() < 0.03, "light is independent of factor {j}: {r}");
    }
}

#[test]
fn standardised_factors_have_variance_one() {
    for graph in ["FORK", "CHAIN", "COLLIDER", "DIAMOND", "FULL", "EMPTY"] {
        for mechanism in [Mechanism::Lin, Mechanism::Nl, Mechanism::Ng] {
            // Nonlinear ones take a million draws each.
            let seeds = match (mechanism, graph) {
                (Mechanism::Nl, "DIAMOND" | "FULL") => 0..1,
                (Mechanism::Nl, _) => 0..0,
                _ => 0..5,
            };
            for seed in seeds {
                let scm = scm(graph, 4, mechanism, true, seed);
                let u = samples(&scm, seed, 20_000);
                for j in 0..4 {
                    let v = variance(&column(&u, j));
                    // Standard error √(2/N) = 0.01 for normal factors.
                    assert!(
                        (v - 1.0).abs() < 0.05,
                        "{graph} {} seed {seed}: Var(u_{j}) = {v}",
                        mechanism.name()
                    );
                    assert!(scm.s[j] >= 0.05 - 1e-12, "an own cause remains: s_{j} = {}", scm.s[j]);
                }
                let kept = scm.a.iter().flatten().all(|a| a.abs() <= 0.9);
                assert!(kept, "coefficients only shrink");
            }
        }
    }
}

#[test]
fn raw_coefficients_lie_in_their_range_with_both_signs() {
    let (mut positive, mut count) = (0, 0);
    for seed in 0..50 {
        for a in scm("FULL", 4, Mechanism::Lin, false, seed).a.iter().flatten().filter(|a| **a != 0.0) {
            assert!((0.5..=0.9).contains(&a.abs()), "|a| = {}", a.abs());
            positive += usize::from(*a > 0.0);
            count += 1;
        }
    }
    assert_eq!(count, 300, "six edges each");
    assert!((110..=190).contains(&positive), "signs are fair: {positive} of 300");
}

#[test]
fn interventions_leave_everything_but_descendants_bit_for_bit() {
    for (graph, n) in [("FORK", 4), ("FULL", 4), ("DIAMOND", 4), ("ER-9", 7)] {
        for mechanism in [Mechanism::Lin, Mechanism::Nl, Mechanism::Ng] {
            // Nonlinear ones stay raw: standardising takes a million draws and changes nothing here.
            let scm = scm(graph, n, mechanism, mechanism != Mechanism::Nl, 11);
            for index in 0..16 {
                let g = group(&scm, 11, index, 64);
                assert_eq!((g.target, g.bases.len()), (index % n, BASES), "targets take turns");
                assert!((-2.0..2.0).contains(&g.value), "v = {}", g.value);
                let below = scm.graph.descendants(g.target);
                for (base, after) in g.bases.iter().zip(&g.after) {
                    assert!((g.value - base.u[g.target]).abs() >= LEAST_CHANGE, "the change can be seen");
                    assert_eq!(after.u[g.target].to_bits(), g.value.to_bits(), "the value is shared");
                    assert_eq!(base.e, after.e, "own causes are kept");
                    assert_eq!(base.appearance, g.bases[0].appearance, "one look per group");
                    assert_eq!(after.appearance, base.appearance, "one look per group");
                    for j in (0..n).filter(|&j| j != g.target) {
                        let same = base.u[j].to_bits() == after.u[j].to_bits();
                        assert!(below[j] || same, "{graph}: do({}) moved {j}", g.target);
                    }
                    // A descendant is what its equation says, with its own cause kept.
                    let again = scm.factors(&after.e, Some((g.target, g.value)));
                    assert_eq!(again, after.u, "descendants follow");
                }
            }
        }
    }
}

#[test]
fn observational_frames_share_looks_in_equal_runs() {
    let scm = scm("FORK", 4, Mechanism::Lin, true, 0);
    let looks: Vec<u64> = (0..2048).map(|i| observed(&scm, 0, i, 2048, 64).appearance).collect();
    for look in 0..64 {
        assert_eq!(looks.iter().filter(|&&a| a == look).count(), 32, "look {look}");
    }
}

/// Means over 200 seeds: [varsortability standardised, raw, R² standardised].
fn sortability(graph: &str, mechanism: Mechanism) -> [f64; 3] {
    let mut sums = [0.0; 3];
    for seed in 0..200 {
        let standard = scm(graph, 4, mechanism, true, seed);
        let raw = scm(graph, 4, mechanism, false, seed);
        let (u, v) = (samples(&standard, seed, 500), samples(&raw, seed, 500));
        let values = [
            varsortability(&standard.graph, &u),
            varsortability(&raw.graph, &v),
            r2_sortability(&standard.graph, &u),
        ];
        for (sum, value) in sums.iter_mut().zip(values) {
            *sum += value.expect("the graph has edges") / 200.0;
        }
    }
    sums
}

#[test]
fn standardisation_hides_the_order_from_variances() {
    for (graph, mechanism) in ["FORK", "CHAIN", "COLLIDER", "DIAMOND", "FULL"]
        .into_iter()
        .flat_map(|graph| [(graph, Mechanism::Lin), (graph, Mechanism::Ng)])
    {
        let [standardised, raw, r2] = sortability(graph, mechanism);
        let name = mechanism.name();
        println!("{graph} {name}: varsortability {standardised:.3} standardised, {raw:.3} raw; R² {r2:.3}");
        assert!((standardised - 0.5).abs() <= 0.1, "{graph} {name} standardised: {standardised}");
        assert!(raw > 0.8, "{graph} {name} raw: {raw}");
        assert!((-1e-9..=1.0 + 1e-9).contains(&r2), "{graph} {name} R²: {r2}");
    }
}

#[test]
fn sortability_of_graphs_done_by_hand() {
    let g = Graph::new(3, &[(0, 1), (1, 2)]).expect("a chain");
    // Variances 1, 4, 2: of the paths 0→1, 1→2, 0→2 the first and the last go up.
    let u: Vec<Vec<f64>> = (0..4096)
        .map(|i| {
            let e = |draw| normal_f64(Key { seed: 5, item: i, step: 0, purpose: 1, draw });
            vec![e(0), 2.0 * e(1), 2.0_f64.sqrt() * e(2)]
        })
        .collect();
    let v = varsortability(&g, &u).expect("edges");
    assert!((v - 2.0 / 3.0).abs() < 1e-12, "two of three: {v}");
    let equal = vec![vec![-1.0, -1.0, 1.0], vec![1.0, 1.0, -1.0]];
    assert_eq!(varsortability(&g, &equal), Some(0.0), "only strictly larger ones count");
    assert_eq!(r2_sortability(&g, &equal), None, "collinear factors have no R²");
    assert_eq!(varsortability(&Graph::new(3, &[]).expect("empty"), &u), None, "no paths");
    // A collider: the middle is explained by both others, each of them by less.
    let g = Graph::new(3, &[(0, 2), (1, 2)]).expect("a collider");
    let u: Vec<Vec<f64>> = u.iter().map(|u| vec![u[0], u[1], u[0] + u[1] + 0.1 * u[2]]).collect();
    assert!(r2_sortability(&g, &u).expect("edges") >= 0.5, "explained most at the end");
}

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
        assert!(turned(5, &[u, u]) < 1e-7, "the left elbow rests");
    }
    // The bent forearm ends in front of the torso: nearer to the middle plane, and at smaller y.
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
    assert_eq!(rest.points, light.points, "light leaves no trace in positions");
    assert!(rest.rgb != light.rgb, "light is seen");
    let folds = posed(&[0.3, -0.2, -0.9, 0.1]);
    for p in 0..512 {
        let moved = rest.points[p] != folds.points[p];
        assert!(t.is_cloth(p) || !moved, "wrinkles move point {p} of bone {}", t.bone_of[p]);
    }
    let hue = posed(&[0.3, -0.2, 0.4, 0.1, 0.0, 0.0, 1.0]);
    assert_eq!(rest.points, hue.points, "hue leaves no trace in positions");
    assert!(rest.rgb != hue.rgb, "hue is seen");
}

#[test]
fn wrinkles_are_the_published_wave_and_do_not_know_the_posture() {
    let t = Template::new(1024);
    for (p, &rest) in t.points.iter().enumerate().filter(|&(p, _)| t.is_cloth(p)) {
        let u = 0.8;
        let one = t.canonical(p, &Drive::new(&[1.7, -1.0, u]));
        let other = t.canonical(p, &Drive::new(&[-1.2, 2.0, u, 0.3]));
        assert_eq!(one, other, "the canonical surface depends on u_W alone");
        let angle = 12.0 * rest[2] + 3.0 * reference::scalar::Scalar::atan2(rest[1], rest[0]);
        let height = 0.03 * u * reference::num::elem::sin(angle);
        let off: [f64; 3] = std::array::from_fn(|k| one[0][k] - rest[k] - height * t.normals[p][k]);
        assert!(off.iter().all(|x| x.abs() < 1e-15), "point {p} is displaced by 0.03 u sin(12 z + 3 φ)");
    }
}

#[test]
fn form_and_noise_are_two_choices() {
    for (name, mechanism, bends, is_uniform) in [
        ("LIN", Mechanism::Lin, false, false),
        ("NL", Mechanism::Nl, true, false),
        ("NG", Mechanism::Ng, false, true),
        ("NL-NG", Mechanism::NlNg, true, true),
    ] {
        assert_eq!(Mechanism::parse(name), Ok(mechanism), "{name}");
        assert_eq!(mechanism.name(), name, "{name}");
        assert_eq!(mechanism.f(3.0) < 1.0, bends, "{name}: f");
        let largest = (0..4000).fold(0.0f64, |m, item| {
            let e = mechanism.noise(Key { seed: 1, item, step: 0, purpose: 1, draw: 0 }).abs();
            if e > m { e } else { m }
        });
        assert_eq!(largest <= 3.0_f64.sqrt(), is_uniform, "{name}: noise up to {largest}");
    }
    assert!(Mechanism::parse("nl").is_err(), "names are exact");
}

#[test]
fn coefficients_shrink_only_where_parents_leave_no_room() {
    let (mut shrunk, mut count) = (0, 0);
    for seed in 0..100 {
        let (raw, standard) =
            (scm("COLLIDER", 4, Mechanism::Lin, false, seed), scm("COLLIDER", 4, Mechanism::Lin, true, seed));
        let explained = raw.a[P][W] * raw.a[P][W] + raw.a[O][W] * raw.a[O][W];
        let is_kept = standard.a == raw.a;
        assert_eq!(is_kept, explained <= 1.0 - 0.05 * 0.05, "seed {seed}: parents explain {explained}");
        shrunk += usize::from(!is_kept);
        count += 1;
    }
    assert!(shrunk > 0 && shrunk < count, "both occur: {shrunk} of {count}");
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

/// The surface of a bone that a point lies on: a place near x at rest, brought back to the surface, and its normal.
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
    #[expect(clippy::manual_clamp, reason = "clamp says nothing of signed zeros")]
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
    // Against central differences of chest, belly and skirt under folds, width and length.
    let t = Template::new(2048);
    for u in [[1.0, 0.0, 0.0], [-2.0, 0.0, 0.0], [1.5, 1.0, -1.0], [0.0, 0.0, 2.0]] {
        let drive = Drive::new(&[0.0, 0.0, u[0], 0.0, u[1], u[2]]);
        let (mut checked, mut worst) = (0, 0.0f64);
        for p in (0..2048).filter(|&p| t.is_cloth(p)) {
            let (x, n) = (t.points[p], t.normals[p]);
            let bone = &t.bones[t.bone_of[p]];
            // Where cap and tube meet the curvature jumps, and the azimuth has no gradient near the axis.
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

/// Height of the skirt's upper rim in the figure's frame.
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

/// Looks of every kind.
fn looks() -> Vec<Appearance> {
    (0..12).map(|i| Appearance::new(9, i)).collect()
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
    // Undo the skinning: without folds and with them, the difference of canonical positions is the same in any posture.
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
fn videos_move_smoothly_and_follow_the_model() {
    let scm = scm("FORK", 4, Mechanism::Nl, false, 2);
    let frames: Vec<_> = (0..100).map(|t| video::frame(&scm, 2, 0, t, 100)).collect();
    for j in 0..4 {
        let e: Vec<f64> = frames.iter().map(|f| f.e[j]).collect();
        assert!((variance(&e) - 1.0).abs() < 1e-12, "own cause {j} has variance 1");
        for k in 0..j {
            let other: Vec<f64> = frames.iter().map(|f| f.e[k]).collect();
            assert!(correlation(&e, &other).abs() < 1e-12, "own causes {j} and {k} are uncorrelated");
        }
        let jump = (0..100).fold(0.0, |worst: f64, t| {
            let d = (e[(t + 1) % 100] - e[t]).abs();
            if d > worst { d } else { worst }
        });
        // Harmonics up to 8 of the clip: 2π (4 + 8)/100.
        assert!(jump < 0.76, "own cause {j} jumps by {jump}");
    }
    for f in &frames {
        assert_eq!(f.u, scm.factors(&f.e, None), "factors follow");
    }
    // A cycle per frame and more is folded back on to slower ones.
    for (n, t, is_exact) in [(4, 20, true), (6, 20, false), (6, 25, true), (4, 16, false)] {
        assert_eq!(video::is_balanced(n, t), is_exact, "{n} factors in {t} frames");
        let scm = self::scm("EMPTY", n, Mechanism::Lin, true, 3);
        for j in (0..n).filter(|_| is_exact) {
            let e: Vec<f64> = (0..t).map(|k| video::frame(&scm, 3, 1, k, t).e[j]).collect();
            assert!((variance(&e) - 1.0).abs() < 1e-12, "{n} factors in {t} frames: own cause {j}");
        }
    }
    let other = video::frame(&scm, 2, 1, 7, 100);
    assert!(other.e != frames[7].e, "subjects move in ways of their own");
    assert_eq!(video::test_cameras(22), (1..=22).collect::<Vec<_>>(), "all of the others");
    assert_eq!(video::test_cameras(4), [3, 9, 14, 20], "spread");
    let camera = video::camera(0, 64);
    // The figure's front looks at the training camera: depth of (0, −1, 0) is smaller than that of (0, 1, 0).
    let m = camera.view_from_world;
    assert!(m[9] > 0.9, "the camera looks along +y");
}

#[test]
fn skinning_agrees_with_its_adjoint_formulas() {
    // A point and a factor under two bones; derivatives by dual numbers against M and the difference of the bones.
    let g0 = [1.0, 0.2, 0.0, 0.5, -0.2, 1.0, 0.1, 0.0, 0.0, -0.1, 1.0, 0.3, 0.0, 0.0, 0.0, 1.0];
    let g1 = [0.8, 0.0, 0.6, -0.5, 0.0, 1.0, 0.0, 1.0, -0.6, 0.0, 0.8, 0.0, 0.0, 0.0, 0.0, 1.0];
    let run = |point_dot: [f64; 3], weight_dot: [f64; 2]| {
        let dual = |value: f64, tangent: f64| Dual { value, tangent };
        let mut x: Named<Dual> = Named::new();
        let points = [0.4, -0.3, 0.9];
        x.insert("points".into(), Arr::new(&[1, 3], (0..3).map(|k| dual(points[k], point_dot[k])).collect()));
        x.insert(
            "weights".into(),
            Arr::new(&[1, 2], vec![dual(0.25, weight_dot[0]), dual(0.75, weight_dot[1])]),
        );
        let transforms = g0.iter().chain(&g1).map(|&v| dual(v, 0.0)).collect();
        x.insert("transforms".into(), Arr::new(&[2, 4, 4], transforms));
        let factors = [0.1, 0.0, 0.0, 0.02, 0.2, 0.0, 0.0, 0.0, 0.3];
        x.insert("factors".into(), Arr::new(&[1, 3, 3], factors.iter().map(|&v| dual(v, 0.0)).collect()));
        let mut out = Out::new(None);
        skin::forward(&x, &mut out).expect("shapes fit");
        out.finish().0
    };
    let m: Vec<f64> = g0.iter().zip(&g1).map(|(a, b)| 0.25 * a + 0.75 * b).collect();
    let y = run([0.0, 1.0, 0.0], [0.0; 2]);
    for i in 0..3 {
        let value = m[4 * i] * 0.4 - m[4 * i + 1] * 0.3 + m[4 * i + 2] * 0.9 + m[4 * i + 3];
        let got = y["skinned"].data[i];
        assert!((got.value - value).abs() < 1e-15, "M x + t");
        assert!((got.tangent - m[4 * i + 1]).abs() < 1e-15, "a column of M");
        let f = y["skinned_factors"].data[3 * i].value;
        assert!((f - (0.1 * m[4 * i] + 0.02 * m[4 * i + 1])).abs() < 1e-15, "M F");
    }
    let w = run([0.0; 3], [1.0, 0.0]);
    for i in 0..3 {
        let bone = g0[4 * i] * 0.4 - g0[4 * i + 1] * 0.3 + g0[4 * i + 2] * 0.9 + g0[4 * i + 3];
        assert!((w["skinned"].data[i].tangent - bone).abs() < 1e-15, "where the bone would put it");
    }
}

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
