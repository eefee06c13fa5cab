//! Mutual information: closed form, invariance, zero level, and agreement of three estimators that share
//! nothing.

use super::models::normals;
use lastlight::causal::independence::{self, In};
use lastlight::loss::metric::mutual::{self, Posteriors};

/// ln of a variance that adds nothing.
const NONE: f64 = -800.0;

fn ln(x: f64) -> f64 {
    libm::log(x)
}

/// N points (N, 2): standard normal numbers with correlation ρ.
fn correlated(points: usize, rho: f64, seed: u64) -> Vec<f64> {
    let z = normals(seed, 0, 0, 2 * points);
    let both = |z: &[f64]| [z[0], rho * z[0] + (1.0 - rho * rho).sqrt() * z[1]];
    z.chunks_exact(2).flat_map(both).collect()
}

#[test]
fn one_number_each_is_the_closed_form() {
    for (case, rho) in [0.0, 0.3, -0.7, 0.95].into_iter().enumerate() {
        let points = 64;
        let mu = correlated(points, rho, 20 + case as u64);
        let logvar = vec![NONE; mu.len()];
        let x = In { ridge: 0.0, ..In::new(&mu, &logvar, points, 2, 1) };
        let (value, saved) = independence::forward(&x).expect("positive definite");
        let c = &saved.covariance;
        let r2 = c[1] * c[1] / (c[0] * c[3]);
        let expected = -0.5 * ln(1.0 - r2);
        assert!((value - expected).abs() <= 1e-14, "ρ = {rho}: {value} for {expected}");
    }
}

#[test]
fn maps_of_single_blocks_change_nothing() {
    let (points, n, k) = (200, 3, 3);
    let d = n * k;
    let z = normals(30, 0, 0, points * d);
    // blocks that depend on each other
    let mu: Vec<f64> = (0..points * d).map(|at| z[at] + 0.6 * z[at / d * d + (at % d + k) % d]).collect();
    let logvar = vec![NONE; mu.len()];
    let value = |mu: &[f64]| {
        let x = In { ridge: 0.0, ..In::new(mu, &logvar, points, n, k) };
        independence::forward(&x).expect("positive definite").1.information
    };
    let before = value(&mu);
    for draw in 0..20 {
        let mut maps = normals(31, draw, 0, n * k * k);
        (0..n * k).for_each(|r| maps[r * k + r % k] += if r % 2 == 0 { 2.0 } else { -2.0 });
        let entry = |at: usize| {
            let (b, i, c) = (at / d, at % d / k, at % k);
            (0..k).fold(0.0, |sum, t| sum + maps[(i * k + c) * k + t] * mu[b * d + i * k + t])
        };
        let mapped: Vec<f64> = (0..points * d).map(entry).collect();
        for (a, b) in value(&mapped).iter().zip(&before) {
            assert!((a - b).abs() <= 1e-11, "draw {draw}: {a} for {b}");
        }
    }
    assert!(before[1] > 0.2, "there is something to change: {before:?}");
}

#[test]
fn independent_blocks_have_the_zero_level_of_chi_squared() {
    let (batch, k, draws) = (256, 4, 400);
    let (mut sum, mut squares) = (0.0, 0.0);
    for draw in 0..draws {
        let mu = normals(40, draw, 0, batch * 2 * k);
        let logvar = vec![NONE; mu.len()];
        let x = In { ridge: 0.0, ..In::new(&mu, &logvar, batch, 2, k) };
        let value = independence::forward(&x).expect("positive definite").0;
        sum += value;
        squares += value * value;
    }
    let mean = sum / f64::from(draws);
    let deviation = (squares / f64::from(draws) - mean * mean).sqrt();
    // 2B·I is about χ² with k² = 16 degrees: mean 16, deviation √32
    let (level, spread) = (16.0 / 512.0, 32.0_f64.sqrt() / 512.0);
    println!("mean {mean:.5} for {level:.5}, deviation {deviation:.5} for {spread:.5}");
    // the first order in 1/B, and three deviations of the mean over the draws
    let bound = level * 9.0 / 256.0 + 3.0 * spread / f64::from(draws).sqrt();
    assert!((mean - level).abs() <= bound, "mean {mean}, expected {level} within {bound}");
    assert!((deviation / spread - 1.0).abs() < 0.15, "deviation {deviation}, expected {spread}");
    // posterior variances dilute what is left
    let mu = normals(40, 0, 0, batch * 2 * k);
    let value = |logvar: f64| {
        let logvar = vec![logvar; mu.len()];
        independence::forward(&In::new(&mu, &logvar, batch, 2, k)).expect("positive definite").0
    };
    assert!(value(0.0) < 0.5 * value(NONE), "variance 1 on variance 1");
}

#[test]
fn three_estimators_agree_on_gaussian_points() {
    // posteriors of variance ½ around means of variance ½: samples of variance 1 whose correlation is that of
    // the means, halved
    let (images, var) = (2000, 0.5_f64);
    for (case, rho) in [0.0, 0.5, 0.9].into_iter().enumerate() {
        let seed = 50 + case as u64;
        let mu: Vec<f64> = correlated(images, rho, seed).into_iter().map(|x| var.sqrt() * x).collect();
        let logvar = vec![ln(var); mu.len()];
        let eta = normals(seed, 1, 1, mu.len());
        let sample: Vec<f64> = mu.iter().zip(&eta).map(|(m, e)| m + var.sqrt() * e).collect();
        let exact = -0.5 * ln(1.0 - 0.25 * rho * rho);
        let x = In { ridge: 0.0, ..In::new(&mu, &logvar, images, 2, 1) };
        let gauss = independence::forward(&x).expect("positive definite").0;
        let posteriors = Posteriors { mu: &mu, logvar: &logvar, sample: &sample, images, n: 2, k: 1 };
        let mixture = mutual::mixture(&posteriors).expect("finite")[1];
        let column = |c: usize| sample.iter().skip(c).step_by(2).copied().collect::<Vec<_>>();
        let ksg = mutual::ksg(&column(0), &column(1), images, mutual::NEIGHBOURS).expect("finite");
        println!("ρ = {rho}: exact {exact:.4}, Gaussian {gauss:.4}, mixture {mixture:.4}, KSG {ksg:.4}");
        for (name, value) in [("Gaussian", gauss), ("mixture", mixture), ("KSG", ksg)] {
            assert!((value - exact).abs() < 0.03, "ρ = {rho}: {name} {value}, exact {exact}");
        }
        assert!((mixture - gauss).abs() < 0.03 && (ksg - gauss).abs() < 0.03, "ρ = {rho}: of each other");
    }
}

#[test]
fn neighbours_see_strong_dependence_and_dependence_without_correlation() {
    let points = 4000;
    let both = correlated(points, 0.8, 60);
    let column = |c: usize| both.iter().skip(c).step_by(2).copied().collect::<Vec<_>>();
    let ksg = mutual::ksg(&column(0), &column(1), points, 3).expect("finite");
    let logvar = vec![NONE; both.len()];
    let gauss = independence::forward(&In::new(&both, &logvar, points, 2, 1)).expect("positive definite").0;
    println!("ρ = 0.8: Gaussian {gauss:.4}, KSG {ksg:.4}");
    assert!((ksg - gauss).abs() < 0.03, "ρ = 0.8: {ksg} for {gauss} of the same points");
    // y = x² + noise: no correlation, plenty of information
    let z = normals(61, 0, 0, 2 * points);
    let x: Vec<f64> = z.iter().step_by(2).copied().collect();
    let y: Vec<f64> = z.chunks_exact(2).map(|z| z[0] * z[0] + 0.3 * z[1]).collect();
    let mu: Vec<f64> = x.iter().zip(&y).flat_map(|(x, y)| [*x, *y]).collect();
    let gauss = independence::forward(&In::new(&mu, &vec![NONE; mu.len()], points, 2, 1));
    assert!(gauss.expect("positive definite").0 < 0.02, "second moments see nothing");
    assert!(mutual::ksg(&x, &y, points, 3).expect("finite") > 0.5, "neighbours do");
}
