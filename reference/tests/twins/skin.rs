//! `body.skin`: closed forms, invariances, derivatives three ways.

use std::cell::Cell;

use reference::array::{Arr, Named, Out};
use reference::body::skin::{self, Affine};
use reference::dual::Dual;
use reference::rev::{self, Rev};
use reference::splat::covariance::rotation;

use crate::scenes::{dot, named, normal, uniform};

/// Rows of the identity.
const REST: Affine<f64> = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

/// (K, 4, 4) from upper rows.
fn stacked(transforms: &[Affine<f64>]) -> Arr<f64> {
    let rows = |t: &Affine<f64>| t.iter().flatten().copied().chain([0.0, 0.0, 0.0, 1.0]).collect::<Vec<_>>();
    Arr::new(&[transforms.len(), 4, 4], transforms.iter().flat_map(rows).collect())
}

/// A turn and a shift.
fn rigid(item: usize) -> Affine<f64> {
    let r = rotation(normal(&[12, 4], 70).row(item));
    let t: [f64; 3] = normal(&[12, 3], 71).row(item);
    std::array::from_fn(|i| [r[i][0], r[i][1], r[i][2], t[i]])
}

/// P points with factors; weights of K bones that sum to 1.
fn template(p: usize, k: usize) -> Named<f64> {
    let mut weights = uniform(&[p, k], [0.0, 1.0], 72);
    for row in weights.data.chunks_exact_mut(k) {
        let sum = row.iter().fold(0.0, |sum, w| sum + w);
        row.iter_mut().for_each(|w| *w /= sum);
    }
    named([
        ("points", normal(&[p, 3], 73)),
        ("weights", weights),
        ("transforms", stacked(&(0..k).map(rigid).collect::<Vec<_>>())),
        ("factors", normal(&[p, 3, 3], 74)),
    ])
}

fn run(inputs: &Named<f64>) -> Named<f64> {
    let mut out = Out::new(None);
    let inputs = skin::In::of(inputs).expect("shapes fit");
    skin::forward(&inputs, &mut out).expect("there are bones");
    out.finish().0
}

fn with(mut inputs: Named<f64>, name: &str, x: Arr<f64>) -> Named<f64> {
    inputs.insert(name.to_owned(), x);
    inputs
}

fn worst(got: &[f64], want: &[f64]) -> f64 {
    assert_eq!(got.len(), want.len(), "as many numbers");
    got.iter().zip(want).fold(0.0, |m: f64, (g, w)| if (g - w).abs() > m { (g - w).abs() } else { m })
}

/// F Fᵀ of row i of (P, 3, 3).
fn covariance(factors: &Arr<f64>, i: usize) -> [[f64; 3]; 3] {
    let f: [[f64; 3]; 3] = std::array::from_fn(|k| factors.row(3 * i + k));
    std::array::from_fn(|a| {
        std::array::from_fn(|b| f[a][0] * f[b][0] + f[a][1] * f[b][1] + f[a][2] * f[b][2])
    })
}

#[test]
fn the_identity_pose_gives_the_template_back() {
    for k in [1, 4, 12] {
        // One bone holds each point: 1·I + 0·I + … is I to the bit.
        let x = template(50, k);
        let mut weights = Arr::filled(&[50, k], 0.0);
        (0..50).for_each(|i| weights.data[i * k + i % k] = 1.0);
        let held = with(with(x.clone(), "transforms", stacked(&vec![REST; k])), "weights", weights);
        let y = run(&held);
        assert_eq!(y["skinned"].data, x["points"].data, "{k} bones: points");
        assert_eq!(y["skinned_factors"].data, x["factors"].data, "{k} bones: factors");
        // Quarters and halves sum to 1 exactly.
        if k == 4 {
            let row = [0.25, 0.5, 0.125, 0.125].repeat(50);
            let shared = with(held, "weights", Arr::new(&[50, 4], row));
            assert_eq!(run(&shared)["skinned"].data, x["points"].data, "shared among four bones");
        }
        // Weights that sum to 1 up to rounding give it back up to rounding.
        let y = run(&with(x.clone(), "transforms", stacked(&vec![REST; k])));
        let off = worst(&y["skinned"].data, &x["points"].data);
        assert!(off <= 2e-15, "{k} bones: off by {off:.1e}");
    }
}

#[test]
fn one_rigid_motion_of_all_joints_moves_points_rigidly_and_covariances_as_m_sigma_mt() {
    let (x, g) = (template(60, 5), rigid(3));
    let y = run(&with(x.clone(), "transforms", stacked(&[g; 5])));
    let mut off = 0.0;
    for i in 0..60 {
        let p = skin::point(&g, x["points"].row(i));
        let got: [f64; 3] = y["skinned"].row(i);
        let apart = worst(&got, &p);
        off = if apart > off { apart } else { off };
        let (s, moved) = (covariance(&x["factors"], i), covariance(&y["skinned_factors"], i));
        for a in 0..3 {
            for b in 0..3 {
                let want = (0..3).fold(0.0, |sum, c| {
                    sum + (0..3).fold(0.0, |inner, d| inner + g[a][c] * s[c][d] * g[b][d])
                });
                let apart = (moved[a][b] - want).abs();
                off = if apart > off { apart } else { off };
            }
        }
    }
    println!("rigid motion: off by {off:.1e}");
    assert!(off <= 4e-14, "off by {off}");
    // Distances are kept.
    let apart = |arr: &Arr<f64>, i: usize, j: usize| {
        let (a, b): ([f64; 3], [f64; 3]) = (arr.row(i), arr.row(j));
        (0..3).fold(0.0, |s, k| s + (a[k] - b[k]) * (a[k] - b[k])).sqrt()
    };
    for i in 1..60 {
        let d = apart(&y["skinned"], i - 1, i) - apart(&x["points"], i - 1, i);
        assert!(d.abs() <= 1e-14, "points {} and {i}: distance changed by {d:e}", i - 1);
    }
}

/// A bone that rests and one turned by a quarter about z through (1, 0, 0), half each: M = ½(I + R), known by hand.
#[test]
fn a_blend_of_two_turns_is_the_one_done_by_hand() {
    let quarter: Affine<f64> = [[0.0, -1.0, 0.0, 1.0], [1.0, 0.0, 0.0, -1.0], [0.0, 0.0, 1.0, 0.0]];
    let x = named([
        ("points", Arr::new(&[2, 3], vec![2.0, 0.0, 0.5, 1.0, 0.0, -3.0])),
        ("weights", Arr::filled(&[2, 2], 0.5)),
        ("transforms", stacked(&[REST, quarter])),
        ("factors", Arr::new(&[2, 3, 3], [[2.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 2.0]; 2].concat())),
    ]);
    let y = run(&x);
    // (2, 0) turns to (1, 1); half-way lies (1.5, 0.5). The hinge stays.
    assert_eq!(y["skinned"].data, [1.5, 0.5, 0.5, 1.0, 0.0, -3.0], "points");
    // Columns of ½(I + R) are √½ long across the hinge: the candy-wrapper shrinking of linear blending.
    let f = [1.0, -1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 2.0];
    assert_eq!(y["skinned_factors"].data, [f, f].concat(), "factors");
    assert_eq!(covariance(&y["skinned_factors"], 0), [[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 4.0]]);
}

/// The sum of the weights scales the blend: documented, not repaired, so that gradients of weights are those of the formula.
#[test]
fn weights_are_used_as_they_are() {
    let x = template(20, 3);
    let y = run(&x);
    for (factor, name) in [(2.0, "twice"), (0.0, "no")] {
        let z = run(&with(x.clone(), "weights", x["weights"].map(|w| factor * w)));
        for out in ["skinned", "skinned_factors"] {
            let want: Vec<f64> = y[out].data.iter().map(|v| factor * v).collect();
            assert_eq!(z[out].data, want, "{name} weight: {out}");
        }
    }
}

#[test]
fn inputs_of_other_shapes_are_refused() {
    let x = template(6, 3);
    let refused = |inputs: &Named<f64>| {
        let mut out = Out::new(None);
        skin::In::of(inputs).and_then(|inputs| skin::forward(&inputs, &mut out)).expect_err("refused")
    };
    for (name, shape) in [
        ("points", vec![6, 2]),
        ("weights", vec![5, 3]),
        ("weights", vec![6, 2]),
        ("weights", vec![6, 0]),
        ("transforms", vec![3, 3, 4]),
        ("factors", vec![6, 3]),
    ] {
        let e = refused(&with(x.clone(), name, Arr::filled(&shape, 0.5)));
        assert!(e.contains("expected"), "{name} {shape:?}: {e}");
    }
    for name in ["points", "weights", "transforms"] {
        let mut missing = x.clone();
        missing.remove(name);
        assert!(refused(&missing).contains(name), "{name} is missing");
    }
    let mut bare = x.clone();
    bare.remove("factors");
    let y = run(&bare);
    assert!(y.contains_key("skinned") && !y.contains_key("skinned_factors"), "factors are optional");
}

/// Tangents of the outputs along `tangents` of the inputs.
fn jvp(x: &Named<f64>, tangents: &Named<f64>) -> Named<f64> {
    let dual = |name: &str, arr: &Arr<f64>| {
        let at = Cell::new(0);
        arr.map(|&value| Dual { value, tangent: tangents[name].data[at.replace(at.get() + 1)] })
    };
    let x: Named<Dual> = x.iter().map(|(name, arr)| (name.clone(), dual(name, arr))).collect();
    let mut out = Out::new(None);
    skin::forward(&skin::In::of(&x).expect("shapes fit"), &mut out).expect("there are bones");
    out.finish().0.into_iter().map(|(name, arr)| (name, arr.map(|d| d.tangent))).collect()
}

/// Gradients of the inputs under cotangents of the outputs.
fn vjp(x: &Named<f64>, bars: &Named<f64>) -> Named<f64> {
    rev::clear();
    let leaves: Named<Rev> = x.iter().map(|(name, arr)| (name.clone(), rev::leaves(arr))).collect();
    let mut out = Out::new(Some(bars));
    skin::forward(&skin::In::of(&leaves).expect("shapes fit"), &mut out).expect("there are bones");
    out.finish();
    leaves.iter().map(|(name, arr)| (name.clone(), rev::adjoints(arr))).collect()
}

#[test]
fn forward_mode_reverse_mode_and_differences_agree() {
    let x = template(17, 4);
    let drawn = |like: &Named<f64>, purpose: u16| -> Named<f64> {
        like.iter().zip(purpose..).map(|((name, arr), p)| (name.clone(), normal(&arr.shape, p))).collect()
    };
    let bars = drawn(&run(&x), 80);
    let gradients = vjp(&x, &bars);
    let all = drawn(&x, 84);
    for name in ["points", "weights", "transforms", "factors", "all"] {
        let tangents: Named<f64> = all
            .iter()
            .map(|(n, t)| {
                let on = if name == "all" || name == n { 1.0 } else { 0.0 };
                (n.clone(), t.map(|v| on * v))
            })
            .collect();
        let moved = jvp(&x, &tangents);
        let (forward, reverse) = (dot(&moved, &bars), dot(&tangents, &gradients));
        let size = dot(&moved, &moved).sqrt() * dot(&bars, &bars).sqrt();
        let apart = (forward - reverse).abs() / size;
        assert!(apart <= 1e-13, "{name}: {forward} forward, {reverse} backward");
        // Along one input alone the operator is affine, together cubic: central differences carry h²/6 of a third derivative.
        let h = 1e-5;
        let at = |sign: f64| {
            let step = |(n, v): (&String, &Arr<f64>)| {
                let moved = v.data.iter().zip(&tangents[n].data).map(|(v, t)| v + sign * h * t).collect();
                (n.clone(), Arr::new(&v.shape, moved))
            };
            run(&x.iter().map(step).collect())
        };
        let (up, down) = (at(1.0), at(-1.0));
        let mut off = 0.0;
        for (n, y) in &moved {
            let slope: Vec<f64> =
                up[n].data.iter().zip(&down[n].data).map(|(a, b)| (a - b) / (2.0 * h)).collect();
            let apart = worst(&slope, &y.data);
            off = if apart > off { apart } else { off };
        }
        println!("{name}: dot product {apart:.1e}, differences {off:.1e}");
        assert!(off <= 2e-9, "{name}: differences are off by {off}");
    }
    // The last row of a transform is not read.
    for b in 0..4 {
        let row: [f64; 4] = gradients["transforms"].row(4 * b + 3);
        assert_eq!(row, [0.0; 4], "bone {b}: the last row has no gradient");
    }
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
        skin::forward(&skin::In::of(&x).expect("shapes fit"), &mut out).expect("there are bones");
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
