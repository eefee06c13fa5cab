//! Joints to transforms in closed form, and the network that corrects a pose.

use lastlight::body::pose::{self, Affine, In, InBar};
use lastlight::body::skin;
use lastlight::num::rng::Rng;
use std::f32::consts::{FRAC_PI_2, PI};

fn at(t: &Affine, x: [f32; 3]) -> [f32; 3] {
    t.map(|r| r[0] * x[0] + r[1] * x[1] + r[2] * x[2] + r[3])
}

fn close(a: [f32; 3], b: [f32; 3]) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6)
}

#[test]
fn a_pose_of_zeros_moves_nothing() {
    let joints = [[0.3, 1.0, -2.0], [0.5, 0.25, 0.125], [7.0, 8.0, 9.0]];
    let zero = [[0.0; 3]; 3];
    for correction in [None, Some(&zero[..])] {
        let (t, _) = pose::forward(In {
            pose: &zero,
            captured: &[],
            correction,
            joints: &joints,
            parents: &[-1, 0, 1],
        })
        .unwrap();
        let identity = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        assert!(t.iter().all(|t| *t == identity), "the identity in bits: {t:?}");
    }
}

#[test]
fn an_arm_bends_at_its_joints() {
    // shoulder at 0, elbow at 1, hand at 2 on the x axis; quarter turns about z
    let (joints, parents) = ([[0.0; 3], [1.0, 0.0, 0.0]], [-1, 0]);
    let hand = [2.0, 0.0, 0.0];
    let posed = |pose: [[f32; 3]; 2]| {
        let (t, _) = pose::forward(In {
            pose: &pose,
            captured: &[],
            correction: None,
            joints: &joints,
            parents: &parents,
        })
        .unwrap();
        at(&t[1], hand)
    };
    let quarter = [0.0, 0.0, FRAC_PI_2];
    assert!(close(posed([[0.0; 3], quarter]), [1.0, 1.0, 0.0]), "at the elbow");
    assert!(close(posed([quarter, [0.0; 3]]), [0.0, 2.0, 0.0]), "at the shoulder");
    assert!(close(posed([quarter, quarter]), [-1.0, 1.0, 0.0]), "at both");
    assert!(close(posed([[0.0; 3], [0.0, 0.0, PI]]), [0.0; 3]), "folded back");
    assert!(close(posed([quarter, [FRAC_PI_2, 0.0, 0.0]]), [0.0, 2.0, 0.0]), "about the arm itself");
}

#[test]
fn a_posed_skeleton_carries_its_skin() {
    // two bones along x, the second bent by a quarter turn about z at 1; the middle point has weights on both
    let (joints, quarter) = ([[0.0; 3], [1.0, 0.0, 0.0]], [[0.0; 3], [0.0, 0.0, FRAC_PI_2]]);
    let x = In { pose: &quarter, captured: &[], correction: None, joints: &joints, parents: &[-1, 0] };
    let (t, saved) = pose::forward(x).unwrap();
    let transforms = pose::squared(&t);
    assert!(transforms.iter().all(|t| t[12..] == [0.0, 0.0, 0.0, 1.0]), "last rows");
    let points = [[0.5, 0.0, 0.0], [1.0, 0.2, 0.0], [2.0, 0.0, 0.0]];
    let weights = [1.0, 0.0, 0.5, 0.5, 0.0, 1.0];
    let input = skin::In { points: &points, weights: &weights, transforms: &transforms, factors: &[] };
    let out = skin::forward(input);
    let want = [[0.5, 0.0, 0.0], [0.9, 0.1, 0.0], [1.0, 1.0, 0.0]];
    assert!(out.skinned.iter().zip(want).all(|(a, b)| close(*a, b)), "{:?}", out.skinned);
    // pulling the last point along −x turns the elbow further
    let bar = skin::Out { skinned: vec![[0.0; 3], [0.0; 3], [1.0, 0.0, 0.0]], skinned_factors: Vec::new() };
    let mut through = skin::InBar::zeros_like(&input);
    skin::adjoint(input, &bar, &mut through);
    let mut x_bar = InBar::zeros_like(&x);
    pose::adjoint(x, &saved, &pose::squared_adjoint(&through.transforms), &mut x_bar);
    assert!(close(x_bar.pose[1], [0.0, 0.0, -1.0]), "{:?}", x_bar.pose);
}

#[test]
fn a_correction_turns_on_the_right() {
    // ℛ(θ)ℛ(δ): first δ, then θ
    let (theta, delta) = ([[0.0, 0.0, FRAC_PI_2]], [[FRAC_PI_2, 0.0, 0.0]]);
    let x = In { pose: &theta, captured: &[], correction: Some(&delta), joints: &[[0.0; 3]], parents: &[-1] };
    let (t, _) = pose::forward(x).unwrap();
    // y → z by δ → z by θ;  z → −y by δ → x by θ
    assert!(close(at(&t[0], [0.0, 1.0, 0.0]), [0.0, 0.0, 1.0]), "{t:?}");
    assert!(close(at(&t[0], [0.0, 0.0, 1.0]), [1.0, 0.0, 0.0]), "{t:?}");
}

#[test]
fn rotations_are_rotations_at_every_angle_and_smooth_where_series_begin() {
    let axis = [0.48f32, -0.6, 0.64];
    let mut last: Option<Affine> = None;
    for k in 0..400 {
        let angle = 1e-7 * libm::exp(f64::from(k) * 0.045) as f32; // 1e-7 to 6.3
        let pose = [axis.map(|a| a * angle)];
        let (t, _) = pose::forward(In {
            pose: &pose,
            captured: &[],
            correction: None,
            joints: &[[0.0; 3]],
            parents: &[-1],
        })
        .unwrap();
        for i in 0..3 {
            for j in 0..3 {
                let dot = (0..3).fold(0.0, |s, c| s + f64::from(t[0][i][c]) * f64::from(t[0][j][c]));
                let want = f64::from(u8::from(i == j));
                assert!((dot - want).abs() < 3e-7, "angle {angle}: rows {i}, {j}: {dot}");
            }
        }
        if let Some(before) = last.filter(|_| angle < 3e-4) {
            for (a, b) in before.iter().flatten().zip(t[0].iter().flatten()) {
                assert!((a - b).abs() < 0.06 * angle, "angle {angle}: no jump");
            }
        }
        last = Some(t[0]);
    }
}

#[test]
fn moving_all_joints_moves_what_they_carry() {
    let rng = Rng::new(6);
    let draw = |k: usize, d: u16| -> [f32; 3] {
        std::array::from_fn(|i| rng.normal_f32((3 * k + i) as u64, 0, 11, d))
    };
    let parents = [-1, 0, 1, 0];
    let (pose, joints): (Vec<_>, Vec<_>) = (0..4).map(|k| (draw(k, 0), draw(k, 1))).unzip();
    let shift = [0.5, -0.25, 2.0];
    let moved: Vec<[f32; 3]> = joints.iter().map(|j| std::array::from_fn(|i| j[i] + shift[i])).collect();
    let run = |joints: &[[f32; 3]]| {
        pose::forward(In { pose: &pose, captured: &[], correction: None, joints, parents: &parents })
            .unwrap()
            .0
    };
    let (a, b) = (run(&joints), run(&moved));
    for (k, (a, b)) in a.iter().zip(&b).enumerate() {
        let x = draw(k, 2);
        let there = at(a, x);
        let want: [f32; 3] = std::array::from_fn(|i| there[i] + shift[i]);
        let got: [f32; 3] = at(b, std::array::from_fn(|i| x[i] + shift[i]));
        assert!(got.iter().zip(want).all(|(g, w)| (g - w).abs() < 1e-5), "{got:?} {want:?}");
    }
}

#[test]
fn skeletons_that_are_none_are_refused() {
    let (two, one) = ([[0.0; 3]; 2], [[0.0; 3]; 1]);
    let good = In { pose: &two, captured: &[], correction: None, joints: &two, parents: &[-1, 0] };
    let cases = [
        ("a parent after its child", In { parents: &[1, -1], ..good }, "joint 0"),
        ("its own parent", In { parents: &[-1, 1], ..good }, "joint 1"),
        ("no such parent", In { parents: &[-2, 0], ..good }, "joint 0"),
        ("too few joints", In { joints: &one, ..good }, "'joints'"),
        ("too few corrections", In { correction: Some(&one), ..good }, "'correction'"),
        ("both", In { captured: &[[[0.0; 4]; 3]; 2], ..good }, "either"),
        (
            "nothing",
            In { pose: &[], captured: &[], joints: &[], parents: &[], correction: None },
            "at least one joint",
        ),
    ];
    for (name, x, text) in cases {
        let e = pose::forward(x).map(|_| ()).expect_err(name);
        assert!(e.to_string().contains(text), "{name}: {e}");
    }
}

#[test]
fn gradients_add_onto_what_is_there() {
    let x = In {
        pose: &[[0.1, 0.2, 0.3]],
        captured: &[],
        correction: None,
        joints: &[[1.0, 2.0, 3.0]],
        parents: &[-1],
    };
    let (t, saved) = pose::forward(x).unwrap();
    let (mut zero, mut some) = (InBar::zeros_like(&x), InBar::zeros_like(&x));
    some.pose[0] = [1.0, 2.0, 3.0];
    pose::adjoint(x, &saved, &t, &mut zero);
    pose::adjoint(x, &saved, &t, &mut some);
    for i in 0..3 {
        assert_eq!(some.pose[0][i], (i + 1) as f32 + zero.pose[0][i], "component {i}");
    }
    assert!(zero.correction.is_empty(), "no correction, no gradient of it");
}
