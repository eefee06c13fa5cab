//! Density control by Markov chain Monte Carlo: relocation, growth, noise, regularisers.

use crate::density::{cloud, warmed};
use lastlight::num::order;
use lastlight::num::rng::Rng;
use lastlight::optim::mcmc;
use lastlight::scene::columns::Column;
use lastlight::scene::gaussians::Gaussians;

#[test]
fn relocation_preserves_the_look() {
    // The double sum as it is published, against the single one.
    let double = |o: f64, each: f64, n: u32| {
        let mut sum = 0.0;
        for i in 1..=n {
            let mut binomial = 1.0;
            for k in 0..i {
                let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
                sum += sign * binomial * libm::pow(each, f64::from(k + 1)) / f64::from(k + 1).sqrt();
                binomial = binomial * f64::from(i - 1 - k) / f64::from(k + 1);
            }
        }
        o / sum
    };
    let mut worst = 0.0f64;
    for o in [1e-6, 0.005, 0.1, 0.5, 0.9, 0.99, 0.999_999] {
        for n in [1, 2, 3, 7, 20, 51] {
            let got = mcmc::relocation(o, n);
            assert!(
                (got.0 - (1.0 - libm::pow(1.0 - o, 1.0 / f64::from(n)))).abs() < 4e-16,
                "the published opacity"
            );
            worst = order::max(worst, (got.1 / double(o, got.0, n) - 1.0).abs());
            let together = -libm::expm1(f64::from(n) * libm::log1p(-got.0));
            assert!((together / o - 1.0).abs() < 1e-9, "{n} copies of {} make {together}, not {o}", got.0);
        }
    }
    println!("relocation: single against double sum {worst:.1e}");
    assert!(worst < 1e-12, "{worst:e}");
    assert_eq!(mcmc::relocation(0.7, 60), mcmc::relocation(0.7, 51), "the documented limit");
}

#[test]
fn dead_gaussians_move_onto_live_ones_and_the_set_grows() {
    let n = 100;
    let mut g = cloud(n, 1);
    for (i, o) in g.opacity_logits.iter_mut().enumerate() {
        *o = if i % 4 == 0 { -7.0 } else { 0.5 };
    }
    let old = g.clone();
    let mut groups = warmed(&g);
    let report = mcmc::step(&mcmc::Settings::GSPLAT, 600, 11, &mut g, &mut groups).unwrap().unwrap();
    assert_eq!((report.before, report.relocated, report.added, report.after), (n, 25, 5, 105));
    assert_eq!(
        (g.len(), groups.of(Column::Sh).rows(), report.parents.len(), report.crowded),
        (105, 105, 105, 0)
    );
    let mut family = vec![0u32; n];
    for &p in &report.parents {
        family[p as usize] += 1;
    }
    for (row, &p) in report.parents.iter().enumerate() {
        let p = p as usize;
        assert!(!p.is_multiple_of(4), "sources are alive");
        assert_eq!((g.means[row], g.quats[row]), (old.means[p], old.quats[p]));
        let fresh = family[p] > 1;
        assert_eq!(groups.of(Column::Means).steps()[row], u32::from(!fresh), "row {row}");
        let o = 1.0 / (1.0 + libm::exp(-f64::from(g.opacity_logits[row])));
        let whole = 1.0 / (1.0 + libm::exp(-0.5));
        assert!(if fresh { o < whole - 0.01 } else { g.opacity_logits[row] == 0.5 }, "shared opacity");
    }
    let none = mcmc::step(&mcmc::Settings::GSPLAT, 500, 11, &mut g, &mut groups).unwrap();
    assert!(none.is_none(), "not before the start");
    let capped = mcmc::Settings { cap: 106, ..mcmc::Settings::GSPLAT };
    assert_eq!(mcmc::refine(&capped, 700, 11, &mut g, &mut groups).unwrap().after, 106);
}

#[test]
fn noise_moves_the_faint_and_leaves_the_opaque() {
    let n = 600;
    let mut g = cloud(n, 0);
    g.means[5] = [0.0; 3];
    let old = g.clone();
    let settings = mcmc::Settings::GSPLAT;
    mcmc::add_noise(&settings, 42, 13, 1e-4, &mut g);
    let (mut moved, mut still) = (0, 0);
    for i in 0..n {
        // The same without the shortcut.
        let o = 1.0 / (1.0 + libm::exp(-f64::from(old.opacity_logits[i])));
        let gate = 50.0 / (1.0 + libm::exp(100.0 * (o - 0.005)));
        let q = old.quats[i].map(f64::from);
        let norm = q.iter().fold(0.0, |a, x| a + x * x).sqrt();
        let [w, x, y, z] = q.map(|v| v / norm);
        let r = [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ];
        let eta: Vec<f64> = (0..3).map(|c| Rng::new(13).normal_f64(i as u64, 42, 0x0804, c)).collect();
        for c in 0..3 {
            let mut shift = 0.0;
            for a in 0..3 {
                let s = libm::exp(f64::from(old.scales_log[i][a]));
                shift += r[c][a] * s * s * (r[0][a] * eta[0] + r[1][a] * eta[1] + r[2][a] * eta[2]);
            }
            let want = f64::from(old.means[i][c]) + gate * shift;
            let got = f64::from(g.means[i][c]);
            assert!(
                (got - want).abs() <= 1e-6 * (gate * shift).abs() + 6.1e-8 * want.abs() + 1e-44,
                "row {i}: {got} {want}"
            );
        }
        moved += u32::from(g.means[i] != old.means[i]);
        still += u32::from(g.means[i] == old.means[i]);
    }
    assert!(moved > 50 && still > 50, "{moved} moved, {still} still");
}

#[test]
fn regularisers_are_means_with_their_gradients() {
    let g = cloud(50, 0);
    let settings = mcmc::Settings::GSPLAT;
    let value = |g: &Gaussians| {
        let o = g.opacity_logits.iter().fold(0.0, |a, x| a + 1.0 / (1.0 + libm::exp(-f64::from(*x)))) / 50.0;
        let s = g.scales_log.as_flattened().iter().fold(0.0, |a, x| a + libm::exp(f64::from(*x))) / 150.0;
        0.01 * o + 0.01 * s
    };
    let mut grad =
        Gaussians { scales_log: vec![[1.0; 3]; 50], opacity_logits: vec![1.0; 50], ..Gaussians::default() };
    assert!((mcmc::regularise(&settings, &g, &mut grad) / value(&g) - 1.0).abs() < 1e-7);
    for i in [0, 17, 49] {
        let o = 1.0 / (1.0 + libm::exp(-f64::from(g.opacity_logits[i])));
        assert!((f64::from(grad.opacity_logits[i]) - 1.0 - 0.01 / 50.0 * o * (1.0 - o)).abs() < 1e-7);
        let s = libm::exp(f64::from(g.scales_log[i][1]));
        assert!((f64::from(grad.scales_log[i][1]) - 1.0 - 0.01 / 150.0 * s).abs() < 1e-7);
    }
}
