//! Density control by gradients: thresholds, order of the rows, optimiser states, schedules.

use lastlight::num::array::Arrays;
use lastlight::num::par::with_threads;
use lastlight::num::rng::Rng;
use lastlight::optim::adam::Rule;
use lastlight::optim::density::{self, Event, Stats, Threshold};
use lastlight::optim::groups::{Groups, Rates, means_schedule};
use lastlight::optim::mcmc;
use lastlight::scene::columns::Column;
use lastlight::scene::gaussians::Gaussians;

/// Normal numbers by position.
fn normals(seed: u64, n: usize) -> Vec<f32> {
    let rng = Rng::new(seed);
    (0..n as u64).map(|i| rng.normal_f32(i, 0, 1, 0)).collect()
}

pub(super) fn cloud(n: usize, sh_degree: usize) -> Gaussians {
    let k = (sh_degree + 1) * (sh_degree + 1);
    let (a, b, c) = (normals(10, 3 * n), normals(11, 4 * n), normals(12, 3 * n));
    Gaussians {
        means: a.chunks(3).map(|v| [v[0], v[1], v[2]]).collect(),
        quats: b.chunks(4).map(|v| [v[0], v[1], v[2], v[3]]).collect(),
        scales_log: c.chunks(3).map(|v| [v[0] - 5.0, v[1] - 5.0, v[2] - 5.0]).collect(),
        opacity_logits: normals(13, n).iter().map(|v| 3.0 * v).collect(),
        sh: normals(14, 3 * k * n),
        sh_degree,
    }
}

/// Groups with moments that tell the rows apart.
pub(super) fn warmed(g: &Gaussians) -> Groups {
    let mut groups = Groups::new(Rule::SPLAT, g).expect("the rule is valid");
    let mut copy = g.clone();
    groups.step(&mut copy, g, &Rates::splat(1e-3), None).expect("numbers are finite");
    groups
}

fn stats(n: usize, seed: u64) -> Stats {
    let mut stats = Stats::new(n);
    for view in 0..4 {
        let grads: Vec<[f32; 2]> =
            normals(seed + view, 2 * n).chunks(2).map(|v| [v[0] * 2e-6, v[1] * 2e-6]).collect();
        let radii: Vec<[i32; 2]> =
            (0..n).map(|i| if (i as u64 + view).is_multiple_of(3) { [0, 0] } else { [5, 4] }).collect();
        stats.add_view(&grads, &radii, 200, 100);
    }
    stats
}

#[test]
fn the_threshold_counts_as_its_rule_says() {
    // One view of 2×2 pixels: NDC units are pixel units. τ from below, at, from above; never seen; seen
    // without gradient.
    let tau = 2e-4f32;
    let grads = [[tau.next_down(), 0.0], [0.0, tau], [-tau.next_up(), 0.0], [1.0, 1.0], [0.0, 0.0]];
    let radii = [[1, 1], [1, 1], [1, 1], [0, 0], [1, 1]];
    for (threshold, cloned) in [(Threshold::AtLeast, 2), (Threshold::Above, 1)] {
        let mut g = cloud(5, 0);
        g.opacity_logits = vec![2.0; 5];
        g.scales_log = vec![[-9.0; 3]; 5];
        let mut groups = warmed(&g);
        let mut s = Stats::new(5);
        s.add_view(&grads, &radii, 2, 2);
        assert_eq!(
            [s.mean(0), s.mean(1), s.mean(2), s.mean(3), s.mean(4)],
            [tau.next_down(), tau, tau.next_up(), 0.0, 0.0]
        );
        let settings = density::Settings { threshold, ..density::Settings::INRIA };
        let report = density::refine(&settings, 600, 1.0, 1, &mut g, &mut groups, &mut s).unwrap();
        assert_eq!((report.cloned, report.split, report.after), (cloned, 0, 5 + cloned), "{threshold:?}");
        let parents = if cloned == 2 { vec![0, 1, 2, 3, 4, 1, 2] } else { vec![0, 1, 2, 3, 4, 2] };
        assert_eq!(report.parents, parents);
        assert_eq!(s, Stats::new(5 + cloned));
    }
}

#[test]
fn gradients_are_measured_in_ndc_and_averaged_over_the_views_that_saw_the_row() {
    let mut s = Stats::new(2);
    s.add_view(&[[3e-3, 0.0], [7.0, 7.0]], &[[4, 4], [0, 0]], 200, 50);
    s.add_view(&[[0.0, 4e-3], [0.0, 2e-3]], &[[4, 4], [1, 1]], 200, 50);
    s.add_view(&[[9.0, 9.0], [9.0, 9.0]], &[[4, 0], [0, 4]], 200, 50);
    assert_eq!([s.mean(0), s.mean(1)], [0.2, 0.05]);
    let (sums, views) = s.parts();
    assert_eq!(Stats::from_parts(sums.to_vec(), views.to_vec()).unwrap(), s);
    assert!(
        Stats::from_parts(vec![f64::NAN], vec![1]).is_err() && Stats::from_parts(vec![1.0], vec![]).is_err()
    );
}

#[test]
fn rows_are_survivors_then_clones_then_halves() {
    let mut g = cloud(6, 1);
    g.opacity_logits = vec![2.0, 2.0, -9.0, 2.0, 2.0, 2.0]; // row 2 is faint
    g.scales_log = vec![[-9.0; 3], [-3.0; 3], [-9.0; 3], [-9.0; 3], [-3.0; 3], [-1.0; 3]]; // 1, 4 split; 5 is huge
    g.quats[1] = [2.0, 0.0, 0.0, 0.0];
    let old = g.clone();
    let mut groups = warmed(&g);
    let old_groups = groups.clone();
    let mut s = Stats::new(6);
    s.add_view(&[[1.0, 0.0], [1.0, 0.0], [0.0; 2], [1.0, 0.0], [1.0, 0.0], [0.0; 2]], &[[1, 1]; 6], 2, 2);
    let settings = density::Settings::INRIA;
    let report = density::refine(&settings, 3100, 1.0, 5, &mut g, &mut groups, &mut s).unwrap();
    assert_eq!(report.parents, [0, 3, 0, 3, 1, 4, 1, 4]);
    assert_eq!((report.before, report.after, report.cloned, report.split), (6, 8, 2, 2));
    assert_eq!((report.pruned_opacity, report.pruned_scale), (1, 1));
    for (row, &parent) in report.parents.iter().enumerate() {
        let p = parent as usize;
        assert_eq!(g.sh[row * 12..][..12], old.sh[p * 12..][..12]);
        assert_eq!((g.quats[row], g.opacity_logits[row]), (old.quats[p], old.opacity_logits[p]));
        let new = row >= 2;
        for ((_, now), (_, before)) in groups.all().zip(old_groups.all()) {
            let w = now.width();
            assert_eq!(now.rows(), 8);
            if new {
                assert!(
                    now.moments().0[row * w..][..w].iter().all(|m| *m == 0.0) && now.steps()[row] == 0,
                    "new rows start at 0"
                );
            } else {
                assert_eq!(now.moments().1[row * w..][..w], before.moments().1[p * w..][..w]);
                assert_eq!(now.steps()[row], 1);
            }
        }
        let shrink = if row >= 4 { libm::log(1.6) as f32 } else { 0.0 };
        assert_eq!(g.scales_log[row], old.scales_log[p].map(|s| s - shrink));
        if row < 4 {
            assert_eq!(g.means[row], old.means[p]);
        }
    }
    // An unrotated parent: the draw itself, written out.
    for (row, half) in [(4, 0u16), (6, 1)] {
        for axis in 0..3 {
            let normal = Rng::new(5).normal_f64(1, 3100, 0x0801, 3 * half + axis);
            let want = f64::from(old.means[1][axis as usize]) + libm::exp(-3.0) * normal;
            assert_eq!(g.means[row][axis as usize], want as f32);
        }
    }
    assert_ne!(g.means[5], g.means[7], "two halves are two draws");
}

#[test]
fn halves_are_drawn_from_their_parent() {
    // 4 000 halves of one long, rotated Gaussian: mean 0, covariance R S² Rᵀ.
    let n = 2000;
    let mut g = Gaussians {
        means: vec![[0.0; 3]; n],
        quats: vec![[0.5, 0.5, -0.5, 0.5]; n], // x → −z, y → x … a rotation by axes: R = [[0,−1,0],[0,0,−1],[1,0,0]]
        scales_log: vec![[0.0, (0.5f32).ln_for_test(), (0.25f32).ln_for_test()]; n],
        opacity_logits: vec![0.0; n],
        sh: vec![0.0; 3 * n],
        sh_degree: 0,
    };
    let mut groups = Groups::new(Rule::SPLAT, &g).unwrap();
    let mut s = Stats::new(n);
    s.add_view(&vec![[1.0, 1.0]; n], &vec![[1, 1]; n], 2, 2);
    let settings = density::Settings { revised_opacity: true, ..density::Settings::GSPLAT };
    density::refine(&settings, 600, 1.0, 7, &mut g, &mut groups, &mut s).unwrap();
    assert_eq!(g.len(), 2 * n);
    let r = [[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]];
    let variances = [1.0, 0.25, 0.0625];
    for i in 0..3 {
        for j in 0..3 {
            let got = g.means.iter().map(|m| f64::from(m[i]) * f64::from(m[j])).fold(0.0, |a, b| a + b)
                / (2 * n) as f64;
            let want: f64 =
                (0..3).map(|k| r[i][k] * r[j][k] * variances[k]).fold(0.0, |a: f64, b: f64| a + b);
            assert!((got - want).abs() < 0.06, "covariance {i}{j}: {got} instead of {want}");
        }
    }
    let o = 1.0 - 0.5f64.sqrt();
    assert!((f64::from(g.opacity_logits[0]) - libm::log(o / (1.0 - o))).abs() < 1e-7, "1 − √(1−o)");
}

trait TestLn {
    fn ln_for_test(self) -> f32;
}
impl TestLn for f32 {
    fn ln_for_test(self) -> f32 {
        libm::logf(self)
    }
}

#[test]
fn refinement_does_not_depend_on_threads_or_on_what_must_not_matter() {
    let run = |threads: usize| {
        with_threads(threads, || {
            let mut g = cloud(500, 1);
            let mut groups = warmed(&g);
            let mut s = stats(500, 20);
            let report =
                density::refine(&density::Settings::INRIA, 3200, 1.0, 3, &mut g, &mut groups, &mut s)
                    .unwrap();
            let moved = mcmc::refine(&mcmc::Settings::GSPLAT, 600, 3, &mut g, &mut groups).unwrap();
            mcmc::add_noise(&mcmc::Settings::GSPLAT, 600, 3, 1e-4, &mut g);
            let mut saved = Arrays::new();
            groups.save("opt", &mut saved);
            let grad = g.clone();
            groups.step(&mut g, &grad, &Rates::splat(1e-3), None).unwrap();
            (g, saved, report, moved)
        })
        .unwrap()
    };
    let one = run(1);
    assert!(one.2.cloned > 10 && one.2.split > 10 && one.2.pruned_opacity > 10, "{:?}", one.2);
    assert!(one == run(2) && one == run(7));

    // Without splits, the order of the rows changes nothing but the order of the rows.
    let n = 300;
    let (g, s) = (cloud(n, 0), stats(n, 30));
    let order = Rng::new(9).permutation(n, 0, 1);
    let shuffled = Gaussians {
        means: order.iter().map(|i| g.means[*i]).collect(),
        quats: order.iter().map(|i| g.quats[*i]).collect(),
        scales_log: order.iter().map(|i| g.scales_log[*i]).collect(),
        opacity_logits: order.iter().map(|i| g.opacity_logits[*i]).collect(),
        sh: order.iter().flat_map(|i| g.sh[i * 3..i * 3 + 3].to_vec()).collect(),
        sh_degree: 0,
    };
    let (sums, views) = s.parts();
    let t = Stats::from_parts(
        order.iter().map(|i| sums[*i]).collect(),
        order.iter().map(|i| views[*i]).collect(),
    )
    .unwrap();
    let settings = density::Settings { split_scale: 1e9, ..density::Settings::INRIA };
    let sorted = |mut g: Gaussians, mut s: Stats| {
        let mut groups = warmed(&g);
        density::refine(&settings, 3200, 1.0, 3, &mut g, &mut groups, &mut s).unwrap();
        let mut bits: Vec<[u32; 3]> = g.means.iter().map(|m| m.map(f32::to_bits)).collect();
        bits.sort_unstable();
        bits
    };
    assert_eq!(sorted(g, s), sorted(shuffled, t));
}

#[test]
fn the_cap_takes_the_largest_gradients() {
    let mut g = cloud(5, 0);
    g.opacity_logits = vec![2.0; 5];
    g.scales_log = vec![[-9.0; 3]; 5];
    let mut groups = warmed(&g);
    let mut s = Stats::new(5);
    s.add_view(&[[3.0, 0.0], [5.0, 0.0], [5.0, 0.0], [9.0, 0.0], [5.0, 0.0]], &[[1, 1]; 5], 2, 2);
    let settings = density::Settings { max_gaussians: 8, ..density::Settings::INRIA };
    let report = density::refine(&settings, 600, 1.0, 1, &mut g, &mut groups, &mut s).unwrap();
    assert_eq!(
        (report.turned_away, report.parents),
        (2, vec![0, 1, 2, 3, 4, 1, 2, 3]),
        "9, then ties by row"
    );
}

#[test]
fn the_schedule_refines_and_resets() {
    let mut g = cloud(40, 0);
    g.opacity_logits = vec![2.0; 40];
    g.opacity_logits[3] = -5.0;
    let mut groups = warmed(&g);
    let mut events = Vec::new();
    let settings = density::Settings { reset_at_start: true, ..density::Settings::INRIA }.scaled(3000); // a tenth
    assert_eq!((settings.every, settings.start, settings.stop, settings.reset_every), (10, 50, 1500, 300));
    for iteration in 1..=1600 {
        let mut s = Stats::new(g.len());
        for event in density::step(&settings, iteration, 1.0, 1, &mut g, &mut groups, &mut s).unwrap() {
            events.push((iteration, matches!(event, Event::Reset)));
            if event == Event::Reset {
                assert!(g.opacity_logits.iter().all(|o| *o <= libm::logf(0.01 / 0.99) + 1e-6));
                assert_eq!(g.opacity_logits[3], -5.0, "lower opacities keep their bits");
                assert!(groups.of(Column::OpacityLogits).moments().1.iter().all(|v| *v == 0.0));
                assert!(groups.of(Column::Means).moments().1.iter().any(|v| *v != 0.0), "other states stay");
            }
        }
    }
    let resets: Vec<u32> = events.iter().filter(|e| e.1).map(|e| e.0).collect();
    let refined: Vec<u32> = events.iter().filter(|e| !e.1).map(|e| e.0).collect();
    assert_eq!(resets, [50, 300, 600, 900, 1200]);
    assert_eq!(refined, (60..1500).step_by(10).collect::<Vec<_>>());
}

#[test]
fn short_runs_keep_the_intervals_of_1500_iterations() {
    let scaled = |iterations| {
        let s = density::Settings::INRIA.scaled(iterations);
        ([s.every, s.start, s.prune_scale_after, s.reset_every], s.stop, s.grace)
    };
    assert_eq!(scaled(1500), ([5, 25, 150, 150], 750, 0), "scaled");
    assert_eq!(
        scaled(300),
        ([5, 25, 150, 150], 150, 50),
        "an opacity cannot recover from a reset in 30 iterations"
    );
    assert_eq!(scaled(30_000), ([100, 500, 3000, 3000], 15_000, 0), "as published");
    // Nothing is pruned for its opacity right after a reset; before and later it is.
    let settings = density::Settings { stop: 400, ..density::Settings::INRIA.scaled(300) };
    let pruned = |iteration: u32| {
        let mut g = cloud(9, 0);
        g.opacity_logits = vec![2.0; 9];
        g.opacity_logits[4] = -9.0;
        g.scales_log = vec![[-9.0; 3]; 9];
        let mut groups = warmed(&g);
        let report =
            density::refine(&settings, iteration, 1.0, 1, &mut g, &mut groups, &mut Stats::new(9)).unwrap();
        report.pruned_opacity
    };
    assert_eq!([145, 150, 155, 200, 205, 300, 305, 355].map(pruned), [1, 1, 0, 0, 1, 1, 0, 1], "grace");
}

#[test]
fn gsplat_counts_iterations_from_zero_and_the_original_from_one() {
    let acted = |settings: density::Settings| {
        let mut g = cloud(40, 0);
        g.opacity_logits = vec![2.0; 40];
        let mut groups = warmed(&g);
        let act = |iteration: &u32| {
            let mut s = Stats::new(g.len());
            !density::step(&settings, *iteration, 1.0, 1, &mut g, &mut groups, &mut s).unwrap().is_empty()
        };
        (1..=1600).filter(act).collect::<Vec<u32>>()
    };
    let (inria, gsplat) = (density::Settings::INRIA.scaled(3000), density::Settings::GSPLAT.scaled(3000));
    assert_eq!(
        (inria.is_open(1500), gsplat.is_open(1500), gsplat.is_open(1501)),
        (false, true, false),
        "the end"
    );
    let (inria, gsplat) = (acted(inria), acted(gsplat));
    assert_eq!((inria[0], gsplat[0]), (60, 61), "the first refinement");
    assert_eq!(gsplat, inria.iter().map(|i| i + 1).collect::<Vec<_>>(), "every other one");
}

#[test]
fn pruning_keeps_the_best_and_an_empty_scene_names_what_pruned_it() {
    let mut g = cloud(6, 0);
    g.opacity_logits = vec![-9.0, -7.0, 3.0, -8.0, -7.0, 2.0];
    g.scales_log = vec![[-9.0; 3]; 6];
    g.scales_log[2] = [1.0; 3];
    g.scales_log[5] = [1.0; 3];
    let settings = density::Settings { keep_at_least: 3, ..density::Settings::INRIA };
    let refine = |settings: &density::Settings, iteration, g: &mut Gaussians| {
        let mut groups = warmed(g);
        density::refine(settings, iteration, 1.0, 1, g, &mut groups, &mut Stats::new(6))
    };
    let report = refine(&settings, 6000, &mut g.clone()).unwrap();
    assert_eq!((report.parents, report.spared), (vec![1, 2, 5], 3), "by opacity, ties by row");
    assert_eq!((report.pruned_opacity, report.pruned_scale), (3, 0), "the reasons of what is gone");
    let e = refine(&density::Settings::INRIA, 6000, &mut g).unwrap_err().to_string();
    assert!(e.contains("4 pruned for an opacity below 0.005, 2 for a standard deviation above 0.1"), "{e}");
}

#[test]
fn impossible_refinements_are_refused() {
    let mut g = cloud(3, 0);
    g.opacity_logits = vec![-9.0; 3];
    let mut groups = warmed(&g);
    let none = density::refine(
        &density::Settings::INRIA,
        600,
        1.0,
        1,
        &mut g.clone(),
        &mut groups.clone(),
        &mut Stats::new(3),
    );
    assert!(none.unwrap_err().to_string().contains("at least one Gaussian"));
    for extent in [0.0, f64::NAN, f64::INFINITY] {
        let (mut g, mut s) = (g.clone(), Stats::new(3));
        assert!(
            density::refine(&density::Settings::INRIA, 600, extent, 1, &mut g, &mut groups.clone(), &mut s)
                .is_err()
        );
    }
    assert!(mcmc::refine(&mcmc::Settings::GSPLAT, 600, 1, &mut g, &mut groups).is_err(), "none is alive");
    assert!(means_schedule(0.0, 7000).is_err());
}
