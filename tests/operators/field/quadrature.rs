//! Quadrature: the depth of a surface by the three rules of a step, against the integral.
//!
//! A ray meets a surface at t = 0. Steps of length h cover −60β … 60β, shifted by 200 offsets; the density of a step
//! is that at its start (left), at its middle (midpoint), or the mean density for a signed distance that is linear
//! between its ends (analytic). Depth is composited at the middles in all three. The error is the largest |depth −
//! ∫|/β over the offsets.

use lastlight::field::composite::{self, In};
use lastlight::field::{density, interval};
use reference::field::{density as twin_density, interval as twin_interval};

/// Offsets of the first step, of which the worst counts.
const OFFSETS: usize = 200;
/// Half the length of a ray, in units of β.
const REACH: f64 = 60.0;

/// Signed distance along a ray.
pub(super) type Sdf<'a> = &'a dyn Fn(f64) -> f64;

/// Where the density of a step is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Rule {
    Left,
    Midpoint,
    Analytic,
}

/// Starts of the steps of a ray.
fn starts(h: f64, offset: f64, beta: f64) -> impl Iterator<Item = f64> {
    let n = (2.0 * REACH * beta / h).ceil() as usize + 2;
    (0..n).map(move |i| -REACH * beta + (offset + i as f64) * h)
}

/// Depth in f64, by the twins.
pub(super) fn depth_f64(sdf: Sdf<'_>, beta: f64, h: f64, offset: f64, rule: Rule) -> f64 {
    let (mut through, mut opacity, mut sum) = (1.0, 0.0, 0.0);
    for t in starts(h, offset, beta) {
        let middle = t + 0.5 * h;
        let sigma = match rule {
            Rule::Left => twin_density::density(sdf(t), beta),
            Rule::Midpoint => twin_density::density(sdf(middle), beta),
            Rule::Analytic => twin_interval::interval(sdf(t), sdf(t + h), beta),
        };
        let w = through * -libm::expm1(-sigma * h);
        through *= libm::exp(-sigma * h);
        opacity += w;
        sum += w * middle;
    }
    sum / opacity
}

/// Depth by the shipped operators.
fn depth_f32(beta: f64, h: f64, offset: f64, rule: Rule) -> f64 {
    let t: Vec<f64> = starts(h, offset, beta).collect();
    let n = t.len();
    // the plane s = −t
    let sdf = |by: f64| t.iter().map(|t| -(t + by * h) as f32).collect::<Vec<f32>>();
    let (mut sigma, beta) = (vec![0.0; n], beta as f32);
    match rule {
        Rule::Left => density::forward(&sdf(0.0), beta, &mut sigma),
        Rule::Midpoint => density::forward(&sdf(0.5), beta, &mut sigma),
        Rule::Analytic => interval::forward(&sdf(0.0), &sdf(1.0), beta, &mut sigma),
    }
    let middles: Vec<f32> = t.iter().map(|t| (t + 0.5 * h) as f32).collect();
    let delta = vec![h as f32; n];
    let x = In { sigma: &sigma, delta: &delta, values: &middles, background: &[0.0], samples: n };
    let out = composite::forward(&x);
    f64::from(out.value[0]) / f64::from(out.opacity[0])
}

/// Largest error over the offsets, in units of β.
pub(super) fn worst(beta: f64, exact: f64, depth: impl Fn(f64) -> f64) -> f64 {
    let error = |o: usize| (depth(o as f64 / OFFSETS as f64) - exact).abs() / beta;
    (0..OFFSETS).map(error).fold(0.0, |a, b| if b > a { b } else { a })
}

/// The integral: the midpoint rule with steps of β/2000, whose error is about 1e-7 β.
pub(super) fn exact(sdf: Sdf<'_>, beta: f64) -> f64 {
    depth_f64(sdf, beta, beta / 2000.0, 0.25, Rule::Midpoint)
}

/// A plane.
pub(super) fn plane(t: f64) -> f64 {
    -t
}

/// A ray through a sphere of radius 1, 0.3 beside its centre.
pub(super) fn sphere(t: f64) -> f64 {
    let along = t - libm::sqrt(0.91);
    libm::sqrt(0.09 + along * along) - 1.0
}

/// A ray through the edge of a wedge, at which the slope of s changes.
pub(super) fn wedge(t: f64) -> f64 {
    if t < 0.0 { -0.9 * t } else { -0.6 * t }
}

#[test]
fn the_depth_of_a_plane_has_the_error_of_its_rule() {
    let beta = 0.005;
    let truth = exact(&|t| -t, beta);
    let table: [(f64, [f64; 3]); 6] = [
        (0.1, [0.0503, 0.00025, 0.0]),
        (0.25, [0.1266, 0.00159, 0.0]),
        (0.5, [0.2568, 0.00675, 0.00005]),
        (1.0, [0.5299, 0.02991, 0.00090]),
        (2.0, [1.1423, 0.1423, 0.01564]),
        (5.0, [3.764, 1.264, 0.4185]),
    ];
    println!("h/β      left  midpoint  analytic");
    for (ratio, expected) in table {
        let rules = [Rule::Left, Rule::Midpoint, Rule::Analytic];
        let found = rules.map(|rule| worst(beta, truth, |o| depth_f32(beta, ratio * beta, o, rule)));
        println!("{ratio:<5} {:8.5}  {:8.5}  {:8.5}", found[0], found[1], found[2]);
        for ((rule, found), expected) in rules.into_iter().zip(found).zip(expected) {
            let allowed = if 0.1 * expected > 2e-5 { 0.1 * expected } else { 2e-5 };
            assert!((found - expected).abs() <= allowed, "{rule:?} at {ratio} β: {found} for {expected}");
        }
    }
}

#[test]
fn errors_fall_with_the_order_of_the_rule() {
    // Least order of the analytic rule. On the sphere the term of fourth order is the larger one down to steps of
    // β/8; below, the order is that of the curvature, 2.
    let cases: [(&str, Sdf<'_>, f64); 3] =
        [("plane", &plane, 3.0), ("sphere", &sphere, 1.8), ("wedge", &wedge, 1.8)];
    for (name, sdf, least) in cases {
        for beta in [0.02, 0.005] {
            let truth = exact(sdf, beta);
            for rule in [Rule::Left, Rule::Midpoint, Rule::Analytic] {
                let error = |ratio: f64| worst(beta, truth, |o| depth_f64(sdf, beta, ratio * beta, o, rule));
                let errors = [1.0, 0.5, 0.25].map(error);
                for pair in errors.windows(2) {
                    let order = libm::log2(pair[0] / pair[1]);
                    println!(
                        "{name}, β = {beta}, {rule:?}: {:.2e} to {:.2e}, order {order:.2}",
                        pair[0], pair[1]
                    );
                    let is_right = match rule {
                        Rule::Left => (order - 1.0).abs() <= 0.2,
                        Rule::Midpoint => (order - 2.0).abs() <= 0.2,
                        Rule::Analytic => order >= least,
                    };
                    assert!(is_right, "{name}, β = {beta}, {rule:?}: order {order}");
                }
            }
        }
    }
}

#[test]
fn curvature_makes_the_analytic_rule_second_order() {
    let beta = 0.02;
    let truth = exact(&sphere, beta);
    let error =
        |ratio: f64| worst(beta, truth, |o| depth_f64(&sphere, beta, ratio * beta, o, Rule::Analytic));
    let order = libm::log2(error(0.0625) / error(0.03125));
    assert!((order - 2.0).abs() <= 0.2, "order {order}");
}
