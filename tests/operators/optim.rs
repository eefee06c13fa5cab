//! Optimisers, schedules and nearest neighbours.

use crate::common::golden;
use lastlight::math::knn;
use lastlight::num::array::Arrays;
use lastlight::num::bits::digest_f32;
use lastlight::num::order;
use lastlight::num::par::with_threads;
use lastlight::num::rng::Rng;
use lastlight::optim::adam::{self, Adam, Counters, Decay, In, Rule, Settings};
use lastlight::optim::adamw;
use lastlight::optim::groups::{Groups, Rates};
use lastlight::optim::muon::{self, Muon};
use lastlight::optim::schedule::LogLinear;
use lastlight::scene::columns::Column;
use lastlight::scene::gaussians::Gaussians;

fn array(a: &Arrays, name: &str) -> Vec<f64> {
    a.need(name).expect("the golden file holds it").to_f64()
}

/// Normal numbers by position.
fn normals(seed: u64, n: usize) -> Vec<f32> {
    let rng = Rng::new(seed);
    (0..n as u64).map(|i| rng.normal_f32(i, 0, 1, 0)).collect()
}

fn relative_l2(got: &[f32], want: &[f64]) -> f64 {
    let (mut error, mut norm) = (0.0, 0.0);
    for (g, w) in got.iter().zip(want) {
        error += (f64::from(*g) - w) * (f64::from(*g) - w);
        norm += w * w;
    }
    (error / norm).sqrt()
}

// ---------------------------------------------------------------------------------------------- Adam

#[test]
fn adamw_agrees_with_golden_arrays() {
    let Some(file) = golden("optim_adamw") else { return };
    let f = |name: &str| array(&file, name);
    let narrow = |name: &str| f(name).into_iter().map(|v| v as f32).collect::<Vec<_>>();
    let one = |name: &str| f(&format!("setting_{name}"))[0];
    let (param, grads, want) = (narrow("param"), narrow("grads"), f("trajectory"));
    let rule = Rule {
        beta1: one("beta1"),
        beta2: one("beta2"),
        eps: one("eps"),
        weight_decay: one("weight_decay"),
        ..Rule::default()
    };
    let input = In { param: &param, grads: &grads, active: None, rows: 50, width: 1 };
    let out = adamw::forward(&input, &Settings { lr: one("lr"), rule }).unwrap();
    let worst =
        out.trajectory.chunks(50).zip(want.chunks(50)).map(|(g, w)| relative_l2(g, w)).fold(0.0, order::max);
    println!("adamw golden: worst relative L2 of a step {worst:.2e}");
    assert!(worst <= 2e-6, "{worst:e}");
    assert_eq!(out.steps, vec![20; 50]);
}

/// The textbook in f64, powers by repeated multiplication.
fn plain(x: &In<'_>, lr: f64, rule: Rule) -> Vec<f64> {
    let len = x.rows * x.width;
    let mut p: Vec<f64> = x.param.iter().map(|v| f64::from(*v)).collect();
    let (mut m, mut v, mut t) = (vec![0.0; len], vec![0.0; len], vec![[1.0, 1.0]; x.rows]);
    let mut out = Vec::new();
    for (s, grads) in x.grads.chunks(len).enumerate() {
        for i in 0..len {
            let row = i / x.width;
            if x.active.is_some_and(|a| a[s * x.rows + row] == 0) {
                continue;
            }
            if i % x.width == 0 {
                t[row] = [t[row][0] * rule.beta1, t[row][1] * rule.beta2];
            }
            let mut g = f64::from(grads[i]);
            match rule.decay {
                Decay::Coupled => g += rule.weight_decay * p[i],
                Decay::Decoupled => p[i] *= 1.0 - lr * rule.weight_decay,
            }
            m[i] = rule.beta1 * m[i] + (1.0 - rule.beta1) * g;
            v[i] = rule.beta2 * v[i] + (1.0 - rule.beta2) * g * g;
            p[i] -= lr * (m[i] / (1.0 - t[row][0])) / ((v[i] / (1.0 - t[row][1])).sqrt() + rule.eps);
        }
        out.extend_from_slice(&p);
    }
    out
}

#[test]
fn adam_agrees_with_the_textbook_for_any_width_and_any_active_rows() {
    for (rows, width, steps) in [(19, 1, 40), (19, 3, 40), (21, 4, 30), (11, 48, 30), (1, 5, 300)] {
        let (param, grads) = (normals(1, rows * width), normals(2, steps * rows * width));
        let active: Vec<u8> =
            (0..steps * rows).map(|i| u8::from(Rng::new(3).uniform_f32(i as u64, 0, 0, 0) < 0.6)).collect();
        for active in [None, Some(&active[..])] {
            for decay in [Decay::Coupled, Decay::Decoupled] {
                for weight_decay in [0.0, 0.03] {
                    let rule = Rule { weight_decay, decay, ..Rule::default() };
                    let input = In { param: &param, grads: &grads, active, rows, width };
                    let settings = Settings { lr: 0.01, rule };
                    let run = if decay == Decay::Coupled { adam::forward } else { adamw::forward };
                    let out = run(&input, &settings).unwrap();
                    let error = relative_l2(&out.trajectory, &plain(&input, 0.01, rule));
                    assert!(error <= 1e-6, "({rows}, {width}) {decay:?} {weight_decay}: {error:e}");
                }
            }
        }
    }
}

#[test]
fn a_row_does_not_depend_on_its_neighbours() {
    let (rows, width, steps) = (37, 3, 12);
    let (param, grads) = (normals(4, rows * width), normals(5, steps * rows * width));
    let active: Vec<u8> = (0..steps * rows).map(|i| u8::from(i * 7 % 5 != 0)).collect();
    let settings = Settings { lr: 0.1, rule: Rule::default() };
    let whole =
        adam::forward(&In { param: &param, grads: &grads, active: Some(&active), rows, width }, &settings)
            .unwrap();
    for r in [0, 1, 7, 8, 31, 36] {
        let pick = |a: &[f32]| a.chunks(width).skip(r).step_by(rows).flatten().copied().collect::<Vec<_>>();
        let alone: Vec<u8> = active.iter().skip(r).step_by(rows).copied().collect();
        let input = In {
            param: &param[r * width..][..width],
            grads: &pick(&grads),
            active: Some(&alone),
            rows: 1,
            width,
        };
        let one = adam::forward(&input, &settings).unwrap();
        assert_eq!(one.trajectory, pick(&whole.trajectory), "row {r}");
        assert_eq!(one.steps[0], whole.steps[r]);
    }
}

#[test]
fn the_first_step_of_a_new_row_has_length_lr_only_with_row_counters() {
    for (counters, want) in [(Counters::Row, 1.0), (Counters::Global, 3.1623)] {
        let rule = Rule { counters, ..Rule::SPLAT };
        let mut adam = Adam::new(rule, 2, 1).unwrap();
        let mut param = vec![0.0f32, 0.0];
        for _ in 0..10_000 {
            adam.step(&mut param, &[0.5, -0.5], &[1e-3], None).unwrap();
        }
        adam.append(1);
        param.push(0.0);
        adam.step(&mut param, &[0.5, -0.5, 0.5], &[1e-3], None).unwrap();
        let ratio = -param[2] / 1e-3;
        assert!((ratio - want).abs() < 2e-4, "{counters:?}: {ratio} instead of {want}");
        adam.reset_rows(|r| r == 0);
        let before = param[0];
        adam.step(&mut param, &[0.5, -0.5, 0.5], &[1e-3], None).unwrap();
        let ratio = (before - param[0]) / 1e-3;
        assert!((ratio - want).abs() < 5e-3, "{counters:?}, reset row: {ratio} instead of {want}");
    }
}

#[test]
fn tiny_gradients_keep_their_trajectories() {
    // ε = 1e-15 in f32: damped below about 1e-15, ±lr above, never NaN, and the same bits forever.
    let grads = [0.0f32, 1e-30, 1e-20, 1e-15, 1.0];
    let all: Vec<f32> = (0..50).flat_map(|s| grads.map(|g| if s % 7 == 3 { -g } else { g })).collect();
    let input = In { param: &[1.0, 0.0, 0.0, 0.0, 0.0], grads: &all, active: None, rows: 5, width: 1 };
    let out = adam::forward(&input, &Settings { lr: 0.01, rule: Rule::SPLAT }).unwrap();
    let first = &out.trajectory[..5];
    assert_eq!(first[0], 1.0, "no gradient, no move");
    assert!((first[1] / -1e-17 - 1.0).abs() < 1e-5, "lr·g/ε: {:e}", first[1]);
    assert!((first[2] / -1e-7 - 1.0).abs() < 1e-4, "lr·g/ε: {:e}", first[2]);
    assert!((first[3] / -5e-3 - 1.0).abs() < 1e-2, "half of lr: {:e}", first[3]);
    assert!((first[4] / -1e-2 - 1.0).abs() < 1e-6, "lr: {:e}", first[4]);
    let digest = digest_f32(&[50, 5], &out.trajectory).unwrap();
    assert_eq!(digest, TRAJECTORY_DIGEST, "{digest:#018x}");
}

const TRAJECTORY_DIGEST: u64 = 0x7400_c340_9a65_6025;

#[test]
fn states_survive_a_checkpoint_in_bits() {
    for counters in [Counters::Row, Counters::Global] {
        let rule = Rule { counters, ..Rule::SPLAT };
        let mut a = Adam::new(rule, 9, 4).unwrap();
        let mut p = normals(6, 36);
        let grads = normals(7, 36 * 20);
        let active = [1, 1, 0, 1, 1, 1, 1, 0, 1];
        for g in grads.chunks(36).take(10) {
            a.step(&mut p, g, &[0.1, 0.2, 0.3, 0.4], Some(&active)).unwrap();
        }
        let mut file = Arrays::new();
        a.save("opt.quats", &mut file);
        let mut b = Adam::load(rule, "opt.quats", &file).unwrap();
        let mut q = p.clone();
        for g in grads.chunks(36).skip(10) {
            a.step(&mut p, g, &[0.1, 0.2, 0.3, 0.4], None).unwrap();
            b.step(&mut q, g, &[0.1, 0.2, 0.3, 0.4], None).unwrap();
        }
        assert_eq!((p, a.moments(), a.steps()), (q, b.moments(), b.steps()));
        let broken = Arrays(file.0.clone()).with("opt.quats.v", &[9, 4], vec![-1.0f32; 36]);
        assert!(Adam::load(rule, "opt.quats", &broken).is_err(), "negative second moment");
        let broken =
            Arrays(file.0.clone()).with("opt.quats.steps", &[a.steps().len()], vec![-1i64; a.steps().len()]);
        assert!(Adam::load(rule, "opt.quats", &broken).is_err(), "negative count");
        assert!(Adam::load(rule, "opt.means", &file).is_err(), "missing arrays");
    }
}

#[test]
fn rows_come_and_go_with_their_states() {
    let mut a = Adam::new(Rule::default(), 5, 2).unwrap();
    let mut p = vec![0.0f32; 10];
    a.step(&mut p, &[1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 5.0, 5.0], &[0.1], Some(&[1, 0, 1, 1, 1]))
        .unwrap();
    a.keep_rows(&[true, true, false, false, true]);
    a.append(2);
    let m: Vec<f32> = a.moments().0.iter().step_by(2).map(|m| (m * 10.0).round()).collect();
    assert_eq!((m, a.steps()), (vec![1.0, 0.0, 5.0, 0.0, 0.0], &[1, 0, 1, 0, 0][..]));
    a.reset_rows(|r| r == 2);
    assert_eq!((a.moments().0[4], a.steps()[2], a.rows()), (0.0, 0, 5));
}

#[test]
fn bad_optimiser_input_is_refused() {
    for rule in [
        Rule { beta1: 1.0, ..Rule::default() },
        Rule { beta2: f64::NAN, ..Rule::default() },
        Rule { eps: 0.0, ..Rule::default() },
        Rule { eps: 1e-60, ..Rule::default() },
        Rule { weight_decay: -1.0, ..Rule::default() },
    ] {
        assert!(Adam::new(rule, 1, 1).is_err(), "{rule:?}");
    }
    for grad in [f32::NAN, f32::INFINITY, 1e30] {
        for n in [1, 8, 100] {
            let mut a = Adam::new(Rule::default(), n, 1).unwrap();
            let mut grads = vec![1.0; n];
            grads[n / 2] = grad;
            let e = a.step(&mut vec![0.0; n], &grads, &[0.1], None).unwrap_err();
            assert!(e.to_string().contains(&format!("row {}, column 0", n / 2)), "{e}");
        }
    }
    let mut a = Adam::new(Rule::default(), 1, 1).unwrap();
    assert!(
        a.step(&mut [0.0], &[1.0], &[-1.0], None).is_err()
            && a.step(&mut [0.0], &[1.0], &[f64::NAN], None).is_err()
    );
    let settings = Settings { lr: 0.1, rule: Rule::default() };
    let good = In { param: &[0.0; 2], grads: &[0.0; 4], active: None, rows: 2, width: 1 };
    assert!(adam::forward(&good, &settings).is_ok());
    assert!(adam::forward(&In { grads: &[0.0; 5], ..good }, &settings).is_err());
    assert!(adam::forward(&In { active: Some(&[1, 1, 2, 1]), ..good }, &settings).is_err());
    assert!(adam::forward(&In { active: Some(&[1, 1]), ..good }, &settings).is_err());
}

// ---------------------------------------------------------------------------------------------- schedules,
// groups, neighbours

fn cloud(n: usize, sh_degree: usize) -> Gaussians {
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

#[test]
fn the_delayed_start_multiplies_the_rate() {
    let lr = LogLinear { delay_iterations: 100, ..LogLinear::new(1.0, 1.0, 1000).unwrap() };
    assert_eq!(lr.at(0), 0.01);
    assert!((lr.at(50) - (0.01 + 0.99 * 0.5f64.sqrt())).abs() < 1e-15);
    assert_eq!((lr.at(100), lr.at(5000)), (1.0, 1.0));
    assert!(LogLinear::new(0.0, 1.0, 10).is_err() && LogLinear::new(1.0, f64::NAN, 10).is_err());
}

#[test]
fn each_band_has_its_rate_and_states_fit_their_scene() {
    let mut g = cloud(9, 2);
    let mut groups = Groups::new(Rule::SPLAT, &g).unwrap();
    let (old, grad) = (g.clone(), g.clone());
    let rates = Rates::splat(1.6e-4);
    groups.step(&mut g, &grad, &rates, None).unwrap();
    for (i, (new, old)) in g.sh.iter().zip(&old.sh).enumerate() {
        let want = if i % 27 < 3 { 2.5e-3 } else { 2.5e-3 / 20.0 };
        assert!(((old - new).abs() - want).abs() < 1e-6, "column {}", i % 27);
    }
    assert!(((g.opacity_logits[0] - old.opacity_logits[0]).abs() - 0.05).abs() < 1e-6);
    let mut file = Arrays::new();
    groups.save("state", &mut file);
    let loaded = Groups::load(Rule::SPLAT, "state", &file, &g).unwrap();
    assert_eq!(loaded.of(Column::Sh).moments(), groups.of(Column::Sh).moments());
    assert!(Groups::load(Rule::SPLAT, "state", &file, &cloud(8, 2)).is_err());
    assert!(Groups::load(Rule::SPLAT, "state", &file, &cloud(9, 1)).is_err());
    let mut bad = grad;
    bad.quats[4][2] = f32::NAN;
    let e = groups.step(&mut g, &bad, &rates, None).unwrap_err().to_string();
    assert!(e.contains("quats") && e.contains("row 4, column 2"), "{e}");
}

fn brute(points: &[[f32; 3]]) -> Vec<[(f64, u32); 3]> {
    points
        .iter()
        .enumerate()
        .map(|(i, p)| {
            let mut all: Vec<(f64, u32)> = (0..points.len())
                .filter(|j| *j != i)
                .map(|j| {
                    let d: Vec<f64> = (0..3).map(|c| f64::from(p[c]) - f64::from(points[j][c])).collect();
                    ((d[0] * d[0] + d[1] * d[1]) + d[2] * d[2], j as u32)
                })
                .collect();
            all.sort_by(|a, b| a.partial_cmp(b).expect("distances are numbers"));
            std::array::from_fn(|k| all.get(k).copied().unwrap_or(knn::NONE))
        })
        .collect()
}

#[test]
fn neighbours_are_those_of_all_pairs_in_bits() {
    let spread: Vec<[f32; 3]> =
        normals(40, 2400).chunks(3).map(|v| [v[0], v[1] * 0.01, v[2] * 100.0]).collect();
    let lattice: Vec<[f32; 3]> =
        (0..729).map(|i| [(i % 9) as f32, (i / 9 % 9) as f32, (i / 81) as f32]).collect();
    let same = vec![[1.0, -2.0, 0.5]; 500];
    let clusters: Vec<[f32; 3]> =
        spread.iter().enumerate().map(|(i, p)| p.map(|x| x * 1e-4 + (i % 7) as f32)).collect();
    let zeros: Vec<[f32; 3]> =
        (0..100).map(|i| [if i % 2 == 0 { 0.0 } else { -0.0 }, (i % 3) as f32, 0.0]).collect();
    let clouds =
        [spread, lattice, same, clusters, zeros, vec![[1.0; 3]], vec![[0.0; 3], [3.0, 4.0, 0.0]], vec![]];
    for points in &clouds {
        let want = brute(points);
        for threads in [1, 2, 7] {
            let got = with_threads(threads, || knn::neighbours::<3>(points).unwrap()).unwrap();
            assert!(got == want, "{} points, {threads} threads", points.len());
        }
    }
    assert_eq!(knn::mean_squared_distance(&clouds[5]).unwrap(), [0.0]);
    assert_eq!(knn::mean_squared_distance(&clouds[6]).unwrap(), [25.0, 25.0]);
    assert_eq!(knn::mean_squared_distance(&clouds[1]).unwrap(), vec![1.0; 729]);
    assert!(knn::neighbours::<1>(&[[0.0, f32::NAN, 0.0]]).is_err());
}

// ---------------------------------------------------------------------------------------------- Muon

/// Five times the polynomial of a singular value.
fn of_singular_value(mut s: f64) -> f64 {
    for _ in 0..5 {
        s *= 3.4445 - 4.7750 * s * s + 2.0315 * s * s * s * s;
    }
    s
}

fn one_step(rule: muon::Rule, shape: [usize; 3], grad: &[f32]) -> Vec<f32> {
    let mut muon = Muon::new(rule, shape).expect("a rule in its range");
    let mut param = vec![0.0; grad.len()];
    muon.step(&mut param, grad, 1.0).expect("finite");
    param
}

#[test]
fn singular_values_of_a_step_are_those_of_the_polynomial() {
    // u = Σ sᵢ·pᵢ·qᵢᵀ with pᵢ, qᵢ from two rotations: the step is −r·√C·Σ f(sᵢ/‖s‖)·pᵢ·qᵢᵀ.
    let (s, angles) = ([3.0f64, 0.4], [0.3f64, 1.1]);
    let rotation = |a: f64| [[libm::cos(a), libm::sin(a)], [-libm::sin(a), libm::cos(a)]];
    let [p, q] = angles.map(rotation);
    let matrix = |values: [f64; 2]| -> Vec<f64> {
        let entry = |r: usize, c: usize| values[0] * p[0][r] * q[0][c] + values[1] * p[1][r] * q[1][c];
        (0..4).map(|i| entry(i / 2, i % 2)).collect()
    };
    let norm = (s[0] * s[0] + s[1] * s[1]).sqrt();
    let want: Vec<f64> =
        matrix(s.map(|s| of_singular_value(s / norm))).into_iter().map(|x| -0.5 * 2f64.sqrt() * x).collect();
    let grad: Vec<f32> = matrix(s).into_iter().map(|x| x as f32).collect();
    let got = one_step(muon::Rule { rms: 0.5, ..muon::Rule::default() }, [1, 2, 2], &grad);
    assert!(relative_l2(&got, &want) < 2e-6, "{got:?} {want:?}");
    // Whatever the singular value between 0.003 and 1, the result is within 0.68 to 1.21: the docs' claim.
    for k in 0..=1000 {
        let s = 0.003 * libm::pow(1.0 / 0.003, f64::from(k) / 1000.0);
        let f = of_singular_value(s);
        assert!((0.67..1.22).contains(&f), "{s}: {f}");
    }
}

#[test]
fn a_step_of_muon_has_the_root_mean_square_of_its_rule_and_ignores_the_scale_of_the_gradient() {
    for shape in [[1, 24, 96], [1, 96, 24], [3, 40, 40]] {
        let [b, r, c] = shape;
        let n = b * r * c;
        let grad = normals(11, n);
        let step = one_step(muon::Rule { rms: 0.25, ..muon::Rule::default() }, shape, &grad);
        let square = step.iter().fold(0.0, |sum, x| sum + f64::from(*x) * f64::from(*x));
        let rms = (square / n as f64).sqrt() / 0.25;
        assert!((0.7..1.2).contains(&rms), "{shape:?}: {rms}");
        let large: Vec<f32> = grad.iter().map(|g| g * 1024.0).collect();
        let of_large = one_step(muon::Rule { rms: 0.25, ..muon::Rule::default() }, shape, &large);
        assert_eq!(of_large, step, "a power of two changes no bit");
    }
}

#[test]
fn matrices_of_muon_do_not_see_each_other_and_rest_without_gradient() {
    let grad = normals(12, 3 * 5 * 7);
    let rule = muon::Rule { weight_decay: 0.5, ..muon::Rule::default() };
    let all = one_step(rule, [3, 5, 7], &grad);
    for (i, own) in grad.chunks(35).enumerate() {
        assert_eq!(one_step(rule, [1, 5, 7], own), all[35 * i..][..35], "matrix {i}");
    }
    let mut muon = Muon::new(rule, [1, 1, 2]).expect("a rule in its range");
    let mut param = [1.0, -2.0];
    muon.step(&mut param, &[0.0; 2], 0.125).expect("finite");
    assert_eq!(param, [0.9375, -1.875], "the decay alone");
    assert!(muon.step(&mut param, &[f32::NAN, 0.0], 0.125).is_err(), "not finite");
    assert!(muon.step(&mut param, &[0.0; 2], -1.0).is_err(), "a negative rate");
    for bad in [muon::Rule { momentum: 1.0, ..rule }, muon::Rule { rms: 0.0, ..rule }] {
        assert!(Muon::new(bad, [1, 1, 2]).is_err(), "{bad:?}");
    }
}

#[test]
fn momentum_survives_a_checkpoint_in_bits() {
    let shape = [2, 4, 6];
    let mut a = Muon::new(muon::Rule::default(), shape).expect("a rule in its range");
    let mut p = normals(13, 48);
    let grads = normals(14, 48 * 8);
    grads.chunks(48).take(4).for_each(|g| a.step(&mut p, g, 0.1).expect("finite"));
    let mut file = Arrays::new();
    a.save("opt.w", &mut file);
    let mut b = Muon::new(muon::Rule::default(), shape).expect("a rule in its range");
    b.load("opt.w", &file).expect("its own file");
    let mut q = p.clone();
    for g in grads.chunks(48).skip(4) {
        a.step(&mut p, g, 0.1).expect("finite");
        b.step(&mut q, g, 0.1).expect("finite");
    }
    assert_eq!(p, q, "the same steps");
    let mut other = Muon::new(muon::Rule::default(), [2, 6, 4]).expect("a rule in its range");
    assert!(other.load("opt.w", &file).is_err(), "another shape");
}
