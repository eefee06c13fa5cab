//! Normals by differences, heads at their kinks, losses of surfaces.

use lastlight::field::network::{Network, NetworkBar};
use lastlight::field::normal::{self, Stencil};
use lastlight::field::normal_head;
use lastlight::loss::{self, albedo, mse};

/// A torus around z with the radii 0.3 and 0.1.
fn torus([x, y, z]: [f64; 3]) -> f64 {
    let ring = (x * x + y * y).sqrt() - 0.3;
    (ring * ring + z * z).sqrt() - 0.1
}

/// Largest error of the normal at points of a torus for a step.
fn worst(stencil: Stencil, epsilon: f32) -> f64 {
    let mut worst = 0.0;
    for i in 0..200 {
        let (u, v) = (0.1 + 0.031 * f64::from(i), 0.2 + 0.113 * f64::from(i));
        let out = [libm::cos(v) * libm::cos(u), libm::cos(v) * libm::sin(u), libm::sin(v)];
        // outside the surface, so that values have the rounding of numbers of their size
        let at = [0.3 * libm::cos(u) + 0.15 * out[0], 0.3 * libm::sin(u) + 0.15 * out[1], 0.15 * out[2]];
        let e = f64::from(epsilon);
        let moved =
            |k: usize, by: f64| torus(std::array::from_fn(|j| at[j] + if j == k { by } else { 0.0 })) as f32;
        let sdf: Vec<f32> = match stencil {
            Stencil::Forward => [torus(at) as f32].into_iter().chain((0..3).map(|k| moved(k, e))).collect(),
            Stencil::Central => (0..3).flat_map(|k| [moved(k, e), moved(k, -e)]).collect(),
        };
        let n = normal::forward(&sdf, stencil, epsilon).1[0];
        let error = (0..3).fold(0.0, |sum, k| {
            let d = f64::from(n[k]) - out[k];
            sum + d * d
        });
        worst = if error > worst { error } else { worst };
    }
    worst.sqrt()
}

#[test]
fn errors_of_normals_fall_with_the_step_until_rounding_takes_over() {
    for (stencil, order) in [(Stencil::Forward, 1.0), (Stencil::Central, 2.0)] {
        let (wide, narrow) = (worst(stencil, 0.02), worst(stencil, 0.01));
        let observed = libm::log2(wide / narrow);
        println!("{stencil:?}: {wide:.1e} at 0.02, {narrow:.1e} at 0.01, order {observed:.2}");
        assert!((observed - order).abs() < 0.2, "{stencil:?}: order {observed}");
        assert!(worst(stencil, 1e-8) > narrow, "{stencil:?}: rounding at a tiny step");
    }
}

#[test]
fn tiny_gradients_are_not_blown_up() {
    // ε = 1, gradients of the length of the bound, twice it, half of it, and 0
    for (s, expected) in [(1e-4_f32, 1.0), (2e-4, 1.0), (5e-5, 0.5), (0.0, 0.0)] {
        let (_, n) = normal::forward(&[0.0, 0.0, s, 0.0], Stencil::Forward, 1.0);
        assert_eq!(n[0], [0.0, expected, 0.0], "length {s}");
        let mut bar = [0.0; 4];
        let across = [[1.0, 0.0, 0.0]];
        normal::adjoint(&[0.0, 0.0, s, 0.0], Stencil::Forward, 1.0, &[[0.0; 3]], &across, &mut bar);
        let slope = 1.0 / if s > 1e-4 { s } else { 1e-4 };
        assert_eq!(bar, [-slope, slope, 0.0, 0.0], "length {s}");
        let mut along = [0.0; 4];
        normal::adjoint(
            &[0.0, 0.0, s, 0.0],
            Stencil::Forward,
            1.0,
            &[[0.0; 3]],
            &[[0.0, 1.0, 0.0]],
            &mut along,
        );
        let slope = if s >= 1e-4 { 0.0 } else { 1e4 };
        assert!((along[2] - slope).abs() < 1e-2 && along[1] == 0.0, "length {s}: {along:?}");
    }
}

#[test]
fn normals_without_a_direction_are_zero_without_a_gradient() {
    let weights: [&[f32]; 2] = [&[1.0], &[-1.0, 0.0, 0.0]];
    let network = Network { weights: &weights, inputs: 1 };
    // no network and no point; a network that cancels the point's direction; a point at 0 with a network
    for (feature, point, normal) in [
        (0.0, [0.0, -0.0, 0.0], [0.0; 3]),
        (1.0, [0.25, 0.0, 0.0], [0.0; 3]),
        (2.0, [0.0; 3], [-1.0, 0.0, 0.0]),
        (0.0, [0.0, 1e-30, 0.0], [0.0, 1.0, 0.0]),
    ] {
        let (n, saved) = normal_head::forward(&network, &[feature], &[point]);
        assert_eq!(n, [normal], "feature {feature}, point {point:?}");
        let mut points_bar = [[0.0; 3]];
        let mut bar = NetworkBar { x: vec![0.0], weights: vec![vec![0.0; 1], vec![0.0; 3]] };
        normal_head::adjoint(
            &network,
            (&[feature], &[point]),
            &saved,
            &[[0.0, 0.0, 1.0]],
            &mut points_bar,
            &mut bar,
        );
        let all = points_bar.as_flattened().iter().chain(&bar.x).chain(bar.weights.iter().flatten());
        if normal == [0.0; 3] {
            assert!(all.clone().all(|g| *g == 0.0), "no direction, no gradient");
        }
        assert!(all.copied().all(f32::is_finite), "feature {feature}, point {point:?}");
        if point == [0.0; 3] {
            assert_eq!(points_bar, [[0.0; 3]], "x/‖x‖ has no slope at 0");
        }
    }
}

#[test]
fn the_divisor_of_the_mean_square_is_chosen() {
    let (x, y, mask) = ([1.0, 5.0, 3.0, 7.0], [0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 1.0, 0.0]);
    let images = loss::In { x: &x, y: &y, mask: Some(&mask), height: 2, width: 2 };
    assert_eq!(mse::forward(&images).expect("two kept pixels").0, 2.5, "(1 + 4)/2");
    let (value, saved) = mse::forward_over(&images, mse::Over::All).expect("four pixels");
    assert_eq!(value, 1.25, "(1 + 4)/4");
    let mut bar = [0.0; 4];
    mse::adjoint(&images, &saved, 1.0, &mut bar, None);
    assert_eq!(bar, [0.5, 0.0, 1.0, 0.0]);
    let none = loss::In { mask: Some(&[0.0; 4]), ..images };
    assert!(mse::forward(&none).is_err(), "a mean over no pixels");
    assert_eq!(mse::forward_over(&none, mse::Over::All).expect("four pixels").0, 0.0);
}

#[test]
fn the_scale_of_albedo_is_the_ratio_of_linear_means() {
    let kept = [1.0, 0.0];
    let truth = [0.5, 0.5, 0.5, 1.0, 1.0, 1.0];
    let half = 0.5_f32 * libm::pow(0.5, 1.0 / 2.2) as f32;
    let s = albedo::scale(&[half, half, half, 0.9, 0.0, 0.1], &truth, &kept);
    assert!((s - 2.0).abs() < 1e-5, "half of the linear value: {s}");
    assert_eq!(albedo::scale(&[0.0; 6], &truth, &kept), 5.0, "a black prediction");
    assert_eq!(albedo::scale(&[0.9; 6], &[0.01; 6], &kept), 0.1, "at least a tenth");
    assert_eq!(albedo::scale(&[0.9; 6], &truth, &[0.0; 2]), 1.0, "no pixel");
    // with its scale the prediction is the truth
    let x = albedo::In { prediction: &[half; 3], truth: &[0.5; 3], opacity: &[1.0], scale: s };
    assert!(albedo::forward(&x).0 < 1e-10);
}

#[test]
fn limited_albedo_has_no_gradient_and_the_bounds_have_one() {
    let slopes = |p: f32, opacity: f32| {
        let x = albedo::In { prediction: &[p; 3], truth: &[0.5; 3], opacity: &[opacity], scale: 1.0 };
        let (_, saved) = albedo::forward(&x);
        let (mut prediction_bar, mut opacity_bar) = ([0.0; 3], [0.0]);
        albedo::adjoint(&x, &saved, 1.0, &[], &mut prediction_bar, &mut opacity_bar);
        (saved.linear[0], prediction_bar[0], opacity_bar[0])
    };
    let (linear, by_p, by_o) = slopes(1.0, 1.0);
    assert!(linear == 1.0 && by_p > 0.0 && by_o < 0.0, "white is the bound");
    assert_eq!(slopes(1.0, 0.75), (1.25, 0.0, 0.0), "above it");
    assert_eq!(slopes(0.0, 1.0), (0.0, 0.0, 0.0), "black");
    assert!(slopes(0.3, 0.9).1 != 0.0 && slopes(0.3, 0.9).2 != 0.0, "between them");
}
