//! Densities and compositing: kinks, limits, integrals.

use lastlight::field::composite::{self, In, InBar};
use lastlight::field::density;
use lastlight::field::interval::{self, moments};

/// Density in f64.
fn density_f64(s: f64, beta: f64) -> f64 {
    if s > 0.0 { 0.5 * libm::exp(-s / beta) / beta } else { (1.0 - 0.5 * libm::exp(s / beta)) / beta }
}

/// Mean of the density over an interval by Simpson's rule, both sides of 0 separately.
fn integral(s0: f64, s1: f64, beta: f64) -> f64 {
    let simpson = |a: f64, b: f64| {
        let n = 4000;
        let h = (b - a) / f64::from(n);
        let weight = |i: i32| {
            if i == 0 || i == n {
                1.0
            } else if i % 2 == 1 {
                4.0
            } else {
                2.0
            }
        };
        // stay on one side of 0
        let f = |i: i32| density_f64(a + h * f64::from(i), beta);
        (0..=n).fold(0.0, |sum, i| sum + weight(i) * f(i)) * h / 3.0
    };
    if s0 == s1 {
        return density_f64(s0, beta);
    }
    let total = if (s0 < 0.0) == (s1 < 0.0) { simpson(s0, s1) } else { simpson(s0, 0.0) + simpson(0.0, s1) };
    total / (s1 - s0)
}

#[test]
fn the_mean_density_is_the_integral() {
    let (beta, mut worst) = (0.03125_f32, 0.0_f64);
    let places = [-12.0, -3.0, -0.7, -1e-3, -1e-6, 0.0, 1e-6, 1e-3, 0.4, 2.0, 9.0];
    for a in places {
        for b in places {
            let (s0, s1) = (a as f32 * beta, b as f32 * beta);
            let ours = f64::from(interval::interval(s0, s1, beta)[0]);
            let exact = integral(f64::from(s0), f64::from(s1), f64::from(beta));
            let error = (ours - exact).abs() / exact;
            worst = if error > worst { error } else { worst };
            assert!(error < 1e-6, "from {a}β to {b}β: {ours} for {exact}");
        }
    }
    println!("largest relative error {worst:.1e}");
}

#[test]
fn slopes_of_the_mean_density_are_those_of_the_integral() {
    let beta = 0.03125_f32;
    let places = [-8.0, -0.7, -1e-3, -1e-5, 1e-5, 1e-3, 0.4, 6.0];
    for a in places {
        for b in places {
            let (s0, s1) = (a as f32 * beta, b as f32 * beta);
            let [_, by0, by1] = interval::interval(s0, s1, beta).map(f64::from);
            let (x, y, beta) = (f64::from(s0), f64::from(s1), f64::from(beta));
            let h = 1e-4 * beta;
            let numeric = [
                (integral(x + h, y, beta) - integral(x - h, y, beta)) / (2.0 * h),
                (integral(x, y + h, beta) - integral(x, y - h, beta)) / (2.0 * h),
            ];
            for (ours, numeric) in [by0, by1].into_iter().zip(numeric) {
                // the second derivative jumps at 0: differences are good to h
                assert!((ours - numeric).abs() < 1e-4 / (beta * beta), "{a}β, {b}β: {ours} {numeric}");
                assert!(ours < 0.0 || numeric.abs() * beta * beta < 1e-9, "denser inside: {a}β, {b}β");
            }
        }
    }
}

#[test]
fn an_interval_of_length_zero_has_the_density_of_its_point() {
    let beta = 0.0625_f32;
    for s in [-2.0, -0.01, -1e-30, -0.0, 0.0, 1e-30, 0.02, 3.0_f32] {
        let [sigma, by0, by1] = interval::interval(s, s, beta);
        let [expected, by_s] = density::density(s, beta);
        assert!((sigma - expected).abs() <= 1e-6 * expected, "{s}: {sigma} for {expected}");
        assert_eq!(by0, by1, "both ends have half of the slope");
        assert!((by0 + by1 - by_s).abs() <= 2e-6 * by_s.abs(), "{s}: {by0} + {by1} for {by_s}");
    }
    // across 0, from either side
    let near = [-1e-12_f32, -0.0, 0.0, 1e-12].map(|s| interval::interval(s, 0.1, beta));
    for other in &near[1..] {
        for k in 0..3 {
            assert!((near[0][k] - other[k]).abs() <= 1e-6 * near[0][k].abs(), "{near:?}");
        }
    }
    assert_eq!(interval::interval(0.3_f32, -0.2, beta)[0], interval::interval(-0.2_f32, 0.3, beta)[0]);
}

/// Distance from the exact value in units of the last place of the single-precision result.
fn ulps(ours: f32, exact: f64) -> f64 {
    let single = exact as f32;
    (f64::from(ours) - exact).abs() / f64::from(single.next_up() - single)
}

#[test]
fn the_moments_have_the_stated_errors() {
    // ∫₀¹ tᵏ e^(−dt) dt by series below 2, by the closed form above
    let exact = |d: f64, k: u32| {
        if d < 2.0 {
            let (mut term, mut sum) = (1.0, 0.0);
            for n in 0..60 {
                sum += term / f64::from(n + k + 1);
                term *= -d / f64::from(n + 1);
            }
            return sum;
        }
        let phi = -libm::expm1(-d) / d;
        if k == 0 { phi } else { (phi - libm::exp(-d)) / d }
    };
    let mut worst = [0.0_f64; 4];
    let mut take = |at: usize, error: f64| worst[at] = if error > worst[at] { error } else { worst[at] };
    for i in 0..400_000 {
        let u = f64::from(i) / 400_000.0;
        for d in [u as f32, (79.0 * u + 1.0) as f32, libm::exp(-60.0 * u) as f32] {
            let [phi, chi] = moments(d);
            let (exact0, exact1) = (exact(f64::from(d), 0), exact(f64::from(d), 1));
            take(0, ulps(phi, exact0));
            take(if d < 1.0 { 1 } else { 2 }, ulps(chi, exact1));
            take(3, ulps(phi - chi, exact0 - exact1));
        }
    }
    println!("φ {:.2}, χ below 1 {:.2}, χ {:.2}, φ − χ {:.2} units", worst[0], worst[1], worst[2], worst[3]);
    for (worst, stated) in worst.into_iter().zip([1.6, 2.0, 6.0, 6.0]) {
        assert!(worst <= stated && worst > stated / 4.0, "{worst} units, stated {stated}");
    }
    assert_eq!(moments(0.0_f32), [1.0, 0.5]);
}

#[test]
fn density_is_finite_far_from_the_surface_and_has_a_slope_on_it() {
    let beta = 0.004_f32;
    let sdf = [0.0, -0.0, 1e-30, -1e-30, 0.355, -0.355, 10.0, -10.0];
    let mut sigma = [0.0; 8];
    density::forward(&sdf, beta, &mut sigma);
    let (mut sdf_bar, ones) = ([0.0; 8], [1.0; 8]);
    let beta_bar = density::adjoint(&sdf, beta, &ones, &mut sdf_bar);
    assert!(beta_bar.is_finite() && sdf_bar.iter().chain(&sigma).all(|x| x.is_finite()));
    for k in 0..4 {
        assert_eq!((sigma[k], sdf_bar[k]), (0.5 / beta, -0.5 / (beta * beta)), "at {}", sdf[k]);
    }
    assert_eq!([sigma[6], sigma[7]], [0.0, 1.0 / beta], "nothing outside, 1/β inside");
    assert_eq!([sdf_bar[6], sdf_bar[7]], [0.0, 0.0]);
}

#[test]
fn a_homogeneous_medium_has_the_opacity_of_its_depth() {
    let s = 50;
    let (sigma, delta) = (vec![3.0; s], vec![0.01; s]);
    let values = vec![2.0; s];
    let out = composite::forward(&In {
        sigma: &sigma,
        delta: &delta,
        values: &values,
        background: &[6.0],
        samples: s,
    });
    let opacity = -libm::expm1(-1.5);
    assert!((f64::from(out.opacity[0]) - opacity).abs() < 1e-6);
    assert!((f64::from(out.value[0]) - (6.0 - 4.0 * opacity)).abs() < 5e-6);
    assert!((f64::from(out.transmittance[s - 1]) - (1.0 - opacity)).abs() < 1e-6);
}

#[test]
fn behind_an_opaque_sample_nothing_counts() {
    let x = In {
        sigma: &[1.0, 1e6, 2.0],
        delta: &[0.5, 1.0, 0.5],
        values: &[1.0, 2.0, 1e30],
        background: &[-1e30],
        samples: 3,
    };
    let out = composite::forward(&x);
    assert_eq!((out.weights[2], out.transmittance[1]), (0.0, 0.0));
    assert!(out.value[0] > 1.0 && out.value[0] < 2.0, "between the first two");
    let mut bar =
        InBar { sigma: vec![0.0; 3], delta: vec![0.0; 3], values: vec![0.0; 3], background: vec![0.0] };
    composite::adjoint(&x, &out, &[0.0], &[1.0], &mut bar);
    assert_eq!(bar.sigma[1..], [0.0, 0.0], "more of the same opacity");
    assert!(bar.sigma.iter().chain(&bar.delta).all(|x| x.is_finite()));
}
