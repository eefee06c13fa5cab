//! Skinning: the identity pose returns the template, a rigid motion of all bones moves points rigidly and
//! takes Σ to M Σ Mᵀ.

use lastlight::body::skin::{In, InBar, Out, adjoint, forward};
use lastlight::num::par::with_threads;
use lastlight::num::rng::Rng;
use reference::splat::covariance::rotation;

const REST: [f32; 16] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];

fn normals<const K: usize>(n: usize, step: u32) -> Vec<[f32; K]> {
    let rng = Rng::new(13);
    (0..n).map(|i| std::array::from_fn(|k| rng.normal_f32((i * K + k) as u64, step, 13, 0))).collect()
}

/// A turn and a shift, in f64 and as the operator takes it.
fn rigid() -> ([[f64; 3]; 3], [f64; 3], [f32; 16]) {
    let r = rotation([0.4, -0.3, 0.8, 0.1]);
    let t = [0.7, -1.2, 0.25];
    let entry = |e: usize| match (e / 4, e % 4) {
        (3, _) => REST[e],
        (i, 3) => t[i] as f32,
        (i, j) => r[i][j] as f32,
    };
    (r, t, std::array::from_fn(entry))
}

/// Weights of `k` bones that sum to 1 exactly.
fn quarters(points: usize, k: usize) -> Vec<f32> {
    let share = |p: usize, b: usize| match (b + k - p % k) % k {
        0 => 0.5,
        1 | 2 => 0.25,
        _ => 0.0,
    };
    (0..points * k).map(|i| share(i / k, i % k)).collect()
}

/// F·Fᵀ.
fn covariance(f: &[f32; 9]) -> [[f64; 3]; 3] {
    let f = f.map(f64::from);
    let entry = |i: usize, j: usize| (0..3).fold(0.0, |sum, c| sum + f[3 * i + c] * f[3 * j + c]);
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| entry(i, j)))
}

#[test]
fn the_identity_pose_gives_the_template_back_in_bits() {
    let (points, factors) = (normals::<3>(700, 0), normals::<9>(700, 1));
    for k in [3, 4, 12] {
        let x =
            In { points: &points, weights: &quarters(700, k), transforms: &vec![REST; k], factors: &factors };
        let y = forward(x);
        assert_eq!(y.skinned, points, "{k} bones: points");
        assert_eq!(y.skinned_factors, factors, "{k} bones: factors");
    }
}

#[test]
fn a_rigid_motion_of_all_bones_turns_points_and_covariances() {
    let (points, factors) = (normals::<3>(500, 2), normals::<9>(500, 3));
    let (r, t, g) = rigid();
    let y =
        forward(In { points: &points, weights: &quarters(500, 5), transforms: &[g; 5], factors: &factors });
    let (mut off, mut off_covariance) = (0.0_f64, 0.0_f64);
    for p in 0..points.len() {
        let x = points[p].map(f64::from);
        for i in 0..3 {
            let want = (0..3).fold(t[i], |sum, j| sum + r[i][j] * x[j]);
            let apart = (f64::from(y.skinned[p][i]) - want).abs();
            off = if apart > off { apart } else { off };
        }
        let (before, after) = (covariance(&factors[p]), covariance(&y.skinned_factors[p]));
        for i in 0..3 {
            for j in 0..3 {
                let pairs = (0..9).map(|e| (e / 3, e % 3));
                let want = pairs.fold(0.0, |sum, (a, b)| sum + r[i][a] * before[a][b] * r[j][b]);
                let apart = (after[i][j] - want).abs();
                off_covariance = if apart > off_covariance { apart } else { off_covariance };
            }
        }
    }
    println!("points off by {off:.1e}, covariances by {off_covariance:.1e}");
    assert!(off <= 1e-6, "points are off by {off}");
    assert!(off_covariance <= 6e-6, "covariances are off by {off_covariance}");
}

#[test]
fn weights_of_zero_change_no_bit_and_nor_do_threads() {
    let (points, factors) = (normals::<3>(900, 4), normals::<9>(900, 5));
    let transforms = normals::<16>(6, 6);
    let few: Vec<f32> = (0..900 * 3).map(|i| [0.5, 0.2, 0.3][i % 3]).collect();
    // three bones more, which hold nothing, between the others
    let many: Vec<f32> = few.iter().flat_map(|w| [*w, 0.0]).collect();
    let some: Vec<[f32; 16]> = transforms.iter().step_by(2).copied().collect();
    let x = In { points: &points, weights: &few, transforms: &some, factors: &factors };
    let with_idle = In { weights: &many, transforms: &transforms, ..x };
    let y = forward(x);
    assert_eq!(y, forward(with_idle), "bones that hold nothing");
    let bar = Out { skinned: normals(900, 7), skinned_factors: normals(900, 8) };
    let gradients = |threads: usize| {
        with_threads(threads, || {
            let mut x_bar = InBar::zeros_like(&x);
            adjoint(x, &bar, &mut x_bar);
            x_bar
        })
        .expect("a default floating-point environment")
    };
    let one = gradients(1);
    for threads in [2, 7] {
        assert_eq!(one, gradients(threads), "{threads} threads");
    }
    let mut points_only = InBar { points: vec![[0.0; 3]; 900], ..InBar::default() };
    adjoint(x, &bar, &mut points_only);
    assert_eq!(points_only.points, one.points, "what is not wanted changes nothing else");
    assert!(
        points_only.weights.is_empty() && points_only.transforms.is_empty(),
        "what is not wanted is left out"
    );
}
