//! The shipped model on a render: the gradient of L_lat by the image, and scores of exchanged factors.

use lastlight::last::model::file::Trained;
use lastlight::last::model::guide::Factors;
use lastlight::last::model::settings::Reading;
use lastlight::last::model::shipped;
use lastlight::num::rng::Rng;

const SIDE: usize = 64;

fn model(reading: Reading) -> Trained {
    let mut trained = shipped::figure().expect("it is built in");
    trained.settings.reading = reading;
    trained
}

/// A soft figure on black, and noise.
fn picture(seed: u64) -> Vec<f32> {
    let rng = Rng::new(seed);
    let value = |i: usize| {
        let (r, c) = ((i / 3 / SIDE) as f32, (i / 3 % SIDE) as f32);
        let (dr, dc) = ((r - 34.0) / 22.0, (c - 30.0 - seed as f32) / 9.0);
        let q = dr * dr + dc * dc;
        let body = 1.0 / (1.0 + q * q * q);
        body * (0.35 + 0.4 * rng.uniform_f32(i as u64, 0, 0x7e5b, 0))
    };
    (0..SIDE * SIDE * 3).map(value).collect()
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    a.iter().zip(b).fold(0.0, |s, (a, b)| s + f64::from(*a) * f64::from(*b))
}

#[test]
fn the_latent_gradient_is_that_of_differences() {
    for reading in [Reading::Reference, Reading::Literal] {
        let trained = model(reading);
        let (seen, real) = (picture(0), trained.encode(&picture(3)));
        let (value, grad) = trained.latent_loss(&seen, &real);
        assert!(value > 1e-3, "images of different factors: {value}");
        let length = dot(&grad, &grad).sqrt();
        for k in 0..4 {
            // Along the gradient, and along mixtures of it with noise: there rounding is small against the
            // slope.
            let rng = Rng::new(17);
            let noise = |i: usize| rng.normal_f32(i as u64, 0, 0x7e5b, k);
            let mut way: Vec<f32> = (0..grad.len())
                .map(|i| grad[i] / length as f32 + if k == 0 { 0.0 } else { 0.02 * noise(i) })
                .collect();
            let norm = dot(&way, &way).sqrt() as f32;
            way.iter_mut().for_each(|w| *w /= norm);
            let at = |h: f32| {
                let moved: Vec<f32> = seen.iter().zip(&way).map(|(x, w)| x + h * w).collect();
                trained.latent_loss(&moved, &real).0
            };
            let h = 0.003f32;
            let slope = (at(h) - at(-h)) / (2.0 * f64::from(h));
            let along = dot(&grad, &way);
            let off = (slope - along).abs() / along.abs();
            assert!(off < 0.01, "{}, direction {k}: {along:e} and {slope:e} by differences", reading.name());
        }
    }
}

#[test]
fn a_render_like_the_photograph_has_no_discrepancy() {
    for reading in [Reading::Reference, Reading::Literal] {
        let trained = model(reading);
        let seen = picture(1);
        let (value, grad) = trained.latent_loss(&seen, &trained.encode(&seen));
        assert_eq!(value, 0.0, "{}", reading.name());
        assert!(grad.iter().all(|g| *g == 0.0), "{}: and no gradient", reading.name());
    }
}

#[test]
fn scores_of_exchanged_factors_are_those_of_the_jacobian() {
    // T12: ‖D(ẑ + δ_i) − D(ẑ)‖ ≈ ‖J_i δ_i‖ where the difference is small.
    let trained = model(Reading::Reference);
    let (n, k) = (trained.model.sizes.factors, trained.model.sizes.width);
    let points: Vec<[f32; 3]> = trained.template.iter().step_by(4).copied().collect();
    let rendered = trained.encode(&picture(0));
    let rng = Rng::new(5);
    let step: Vec<f64> = (0..n * k)
        .map(|c| 0.004 * trained.factor_spread[c] * rng.normal_f64(c as u64, 0, 0x7e5b, 9))
        .collect();
    let moved = |factor: usize, by: f64| -> Vec<f64> {
        let mut z = rendered.factors.clone();
        (factor * k..(factor + 1) * k).for_each(|c| z[c] += by * step[c]);
        z
    };
    let real = Factors {
        factors: rendered.factors.iter().zip(&step).map(|(z, d)| z + d).collect(),
        noise: rendered.noise.clone(),
    };
    let scores = trained.swapped(&rendered, &real, &points);
    let sigma = [0.05, 0.05, 0.05, 0.2, 0.2, 0.2];
    let (mut swapped, mut linear) = (Vec::new(), Vec::new());
    for (i, scores) in scores.iter().enumerate() {
        // Differences over four times the step: above the rounding of the decoder, and few of its kinks
        // between.
        let [up, down] = [4.0, -4.0].map(|by| trained.decoded(&moved(i, by), &points));
        for ((up, down), score) in up.iter().zip(&down).zip(scores) {
            let sum = (0..6).fold(0.0, |s, c| {
                let slope = f64::from(up[c] - down[c]) / 8.0 / sigma[c];
                s + slope * slope
            });
            swapped.push(*score);
            linear.push(sum.sqrt());
        }
    }
    let mean = |x: &[f64]| x.iter().fold(0.0, |s, x| s + x) / x.len() as f64;
    let (a, b) = (mean(&swapped), mean(&linear));
    let sums = swapped.iter().zip(&linear).fold([0.0; 3], |[ab, aa, bb], (x, y)| {
        let (x, y) = (x - a, y - b);
        [ab + x * y, aa + x * x, bb + y * y]
    });
    let correlation = sums[0] / (sums[1] * sums[2]).sqrt();
    assert!(correlation > 0.99, "correlation {correlation}");
    assert!((a / b - 1.0).abs() < 0.02, "and of one size: {a:e} and {b:e}");
}
