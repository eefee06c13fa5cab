//! T8: scores of structures against hand-computed graphs and brute force.

use lastlight::loss::metric::structure::{Blocks, Factors, blocks, edges, intervention, matching, sid};
use lastlight::math::dense;
use lastlight::math::digraph::{Digraph, all_acyclic, nodes};
use lastlight::num::rng::Rng;
use lastlight::{Error, Result};

#[test]
fn edges_of_hand_made_graphs_are_counted_as_by_hand() {
    let truth = Digraph::new(4, &[(0, 1), (0, 2), (1, 3), (2, 3)]); // DIAMOND
    let close = |a: f64, b: f64| (a - b).abs() < 1e-15;
    type Case<'a> = (&'a [(usize, usize)], usize, [f64; 3]);
    let cases: [Case<'_>; 7] = [
        // estimate, SHD, TPR, FDR, FPR
        (&[(0, 1), (0, 2), (1, 3), (2, 3)], 0, [1.0, 0.0, 0.0]),
        (&[], 4, [0.0, 0.0, 0.0]),
        (&[(1, 0), (0, 2), (1, 3), (2, 3)], 1, [0.75, 0.25, 0.5]), // one turned
        (&[(0, 1), (0, 2), (1, 3)], 1, [0.75, 0.0, 0.0]),          // one missing
        (&[(0, 1), (0, 2), (1, 3), (2, 3), (0, 3)], 1, [1.0, 0.2, 0.5]), // one too many
        (&[(1, 0), (2, 0), (3, 1), (3, 2)], 4, [0.0, 1.0, 2.0]),   // all turned
        (&[(0, 3), (1, 2)], 6, [0.0, 1.0, 1.0]),                   // nothing right
    ];
    for (found, shd, [tpr, fdr, fpr]) in cases {
        let e = edges::compare(&truth, &Digraph::new(4, found));
        let rates = e.rates.expect("the truth has edges");
        assert_eq!((e.shd, e.nnz), (shd, found.len()), "{found:?}");
        assert!(close(rates.tpr, tpr) && close(rates.fdr, fdr) && close(rates.fpr, fpr), "{found:?}: {e:?}");
    }
    let empty = Digraph::empty(4);
    let against_empty = edges::compare(&empty, &truth);
    assert_eq!((against_empty.shd, against_empty.nnz, against_empty.rates), (4, 4, None), "EMPTY truth");
    // both directions of one true edge: one is right, the other reversed
    let both = edges::compare(&Digraph::new(2, &[(0, 1)]), &Digraph::new(2, &[(0, 1), (1, 0)]));
    assert_eq!((both.shd, both.nnz), (1, 2), "an edge in both directions");
    // a full truth leaves no pair to be wrong about
    let full = Digraph::from_fn(3, |i, j| i < j);
    let turned = edges::compare(&full, &Digraph::from_fn(3, |i, j| i > j));
    assert_eq!(turned.rates.expect("edges").fpr, 3.0, "the denominator 0 counts as 1");
}

#[test]
fn shd_is_a_distance_on_acyclic_graphs() {
    let all = all_acyclic(3);
    let d = |a: &Digraph, b: &Digraph| edges::compare(a, b).shd;
    for a in &all {
        for b in &all {
            assert_eq!(d(a, b), d(b, a), "{a} | {b}: symmetric");
            assert_eq!(d(a, b) == 0, a == b, "{a} | {b}: zero for equal graphs alone");
            for c in &all {
                assert!(d(a, c) <= d(a, b) + d(b, c), "{a} | {b} | {c}");
            }
        }
    }
}

/// Effects in a linear Gaussian population: (I − W)⁻¹ and its covariance, W_ij the weight of i → j.
struct Population {
    total: Vec<f64>,
    covariance: Vec<f64>,
    n: usize,
}

impl Population {
    fn new(graph: &Digraph, seed: u64) -> Self {
        let n = graph.n();
        let rng = Rng::new(seed);
        let draw = |i: usize| rng.uniform_f64(i as u64, 0, 1, 0);
        let weight = |i: usize, j: usize| {
            let w = 0.4 + draw(i * n + j);
            if draw(100 + i * n + j) < 0.5 { -w } else { w }
        };
        let identity_minus: Vec<f64> = (0..n * n)
            .map(|at| match (at / n, at % n) {
                (i, j) if i == j => 1.0,
                (i, j) if graph.has(i, j) => -weight(i, j),
                _ => 0.0,
            })
            .collect();
        // row i, column j: the total effect of i on j
        let (total, _) = dense::inverse(&identity_minus, n).expect("an acyclic graph");
        let covariance = (0..n * n)
            .map(|at| {
                (0..n).fold(0.0, |sum, k| {
                    sum + (0.5 + draw(200 + k)) * total[k * n + at / n] * total[k * n + at % n]
                })
            })
            .collect();
        Self { total, covariance, n }
    }

    /// Coefficient of i in the regression of j on i and `given`.
    fn adjusted(&self, i: usize, j: usize, given: u32) -> f64 {
        let regressors: Vec<usize> = [i].into_iter().chain(nodes(given)).collect();
        let p = regressors.len();
        let at = |a: usize, b: usize| self.covariance[a * self.n + b];
        let own: Vec<f64> = (0..p * p).map(|k| at(regressors[k / p], regressors[k % p])).collect();
        let with: Vec<f64> = regressors.iter().map(|&a| at(a, j)).collect();
        dense::solve(&dense::cholesky(&own, p).expect("own noise everywhere"), p, &with)[0]
    }

    /// Whether adjusting for the parents of i in the estimate yields the effect of i on j.
    fn agrees(&self, estimate: &Digraph, i: usize, j: usize) -> bool {
        let given = estimate.parents(i);
        let claimed = if given >> j & 1 == 1 { 0.0 } else { self.adjusted(i, j, given) };
        (claimed - self.total[i * self.n + j]).abs() < 1e-9
    }
}

#[test]
fn sid_counts_the_effects_that_adjustment_gets_wrong() {
    let all = all_acyclic(3);
    let (mut wrong, mut questions) = (0, 0);
    for (t, truth) in all.iter().enumerate() {
        // an effect that happens to agree in one population does not in three
        let populations: Vec<Population> =
            (0..3).map(|seed| Population::new(truth, 10 * t as u64 + seed)).collect();
        for estimate in &all {
            for (i, j) in (0..9).map(|at| (at / 3, at % 3)).filter(|(i, j)| i != j) {
                let agrees = populations.iter().all(|p| p.agrees(estimate, i, j));
                let right = sid::is_right(truth, estimate, i, j);
                assert_eq!(right, agrees, "truth {truth}, estimate {estimate}, do({i}) on {j}");
                wrong += usize::from(!right);
                questions += 1;
            }
        }
    }
    println!("{wrong} of {questions} effects are wrong");
    assert!(questions == 25 * 25 * 6 && wrong > 500, "{wrong} of {questions}: neither side is empty");
}

#[test]
fn sid_agrees_with_adjustment_on_four_nodes() {
    let all = all_acyclic(4);
    let rng = Rng::new(5);
    for trial in 0..600 {
        let [truth, estimate] = [0, 1].map(|draw| &all[rng.index(all.len(), trial, 0, 2, draw)]);
        let populations: Vec<Population> = (0..3).map(|s| Population::new(truth, 31 * trial + s)).collect();
        for (i, j) in (0..16).map(|at| (at / 4, at % 4)).filter(|(i, j)| i != j) {
            let agrees = populations.iter().all(|p| p.agrees(estimate, i, j));
            assert_eq!(sid::is_right(truth, estimate, i, j), agrees, "{truth} | {estimate}: {i} on {j}");
        }
    }
}

fn contains(big: &Digraph, small: &Digraph) -> bool {
    small.edges().iter().all(|&(i, j)| big.has(i, j))
}

#[test]
fn sid_is_zero_exactly_for_graphs_that_contain_the_truth() {
    for n in [2, 3] {
        let all = all_acyclic(n);
        for truth in &all {
            assert_eq!(sid::distance(truth, truth), 0, "{truth}: from itself");
            for estimate in &all {
                let d = sid::distance(truth, estimate);
                assert_eq!(d == 0, contains(estimate, truth), "{truth} | {estimate}: {d}");
                assert!(d <= n * (n - 1), "{truth} | {estimate}: {d}");
            }
        }
    }
    let all = all_acyclic(4);
    let (mut supers, mut others) = (0, 0);
    for (a, truth) in all.iter().enumerate() {
        for estimate in all.iter().skip(a % 7).step_by(7) {
            let inside = contains(estimate, truth);
            assert_eq!(sid::distance(truth, estimate) == 0, inside, "{truth} | {estimate}");
            supers += usize::from(inside);
            others += usize::from(!inside);
        }
    }
    assert!(supers > 1000 && others > 10_000, "{supers} and {others} pairs were compared");
}

#[test]
fn sid_of_textbook_pairs() {
    // X → Y reversed: both effects are wrong. Missing: only that of X on Y.
    let edge = Digraph::new(2, &[(0, 1)]);
    assert_eq!(sid::distance(&edge, &Digraph::new(2, &[(1, 0)])), 2, "reversed");
    assert_eq!(sid::distance(&edge, &Digraph::empty(2)), 1, "missing: 1 on 0 is judged confounded");
    assert_eq!(sid::distance(&Digraph::empty(2), &edge), 0, "an edge too many does no harm");
    // A fork whose edge to one child is missing: 0 on 1 stays right, 1 and 2 lose their adjustment.
    let fork = Digraph::new(3, &[(0, 1), (0, 2)]);
    let one = Digraph::new(3, &[(0, 1)]);
    assert!(sid::is_right(&fork, &one, 0, 1) && !sid::is_right(&fork, &one, 2, 1), "{fork} | {one}");
}

/// Latent blocks that are known mixtures of factors: block `of[j]` holds factor j, twice, once with the sign
/// turned.
fn mixed(u: &[f64], m: usize, of: &[usize], n: usize, noise: f64) -> Vec<f64> {
    let rng = Rng::new(3);
    let rows = u.chunks_exact(m).enumerate().flat_map(|(s, row)| {
        let mut out: Vec<f64> =
            (0..2 * n).map(|d| noise * rng.normal_f64((s * 2 * n + d) as u64, 0, 3, 0)).collect();
        for (j, &i) in of.iter().enumerate() {
            out[2 * i] += 3.0 * row[j] + 5.0;
            out[2 * i + 1] -= row[j];
        }
        out
    });
    rows.collect()
}

fn factors(count: usize, m: usize) -> Vec<f64> {
    let rng = Rng::new(4);
    (0..count * m).map(|at| rng.normal_f64(at as u64, 0, 4, 0)).collect()
}

#[test]
fn matching_finds_the_permutation_and_relabels_the_graph() {
    let (count, m) = (400, 4);
    let u = factors(count, m);
    let of = [2, 0, 3, 1];
    let z = mixed(&u, m, &of, 4, 0.1);
    let (z, u) = (Blocks { values: &z, n: 4, k: 2 }, Factors { values: &u, m });
    let found = matching::matching(&z, &u).unwrap();
    assert_eq!(found.block, of.map(Some), "the permutation");
    assert!(found.mcc > 0.99 && found.mcc <= 1.0, "MCC {}", found.mcc);
    let truth = Digraph::new(4, &[(0, 1), (0, 2), (1, 3)]);
    let over_blocks = Digraph::new(4, &[(2, 0), (2, 3), (0, 1)]);
    assert_eq!(found.relabel(&over_blocks), truth, "edges by factor");
    assert_eq!(
        intervention::target_accuracy(&[2, 0, 3, 3], &[0, 1, 2, 3], &found).unwrap(),
        0.75,
        "three of four targets"
    );
    assert!(intervention::target_accuracy(&[], &[], &found).is_err(), "nothing to count");
}

#[test]
fn canonical_correlation_has_its_closed_form_and_ignores_invertible_maps() {
    // u = z₀ + z₁ with independent z: r² = 1; with one scalar z: r = |corr|/√(1 + λ).
    let count = 3000;
    let rng = Rng::new(9);
    let draws = |draw| (0..count).map(move |s| rng.normal_f64(s, 0, 5, draw)).collect::<Vec<f64>>();
    let (a, b) = (draws(0), draws(1));
    let u: Vec<f64> = a.iter().zip(&b).map(|(a, b)| 0.6 * a - 0.8 * b).collect();
    let moment = |x: &[f64], y: &[f64]| {
        let n = count as f64;
        let mean = |v: &[f64]| v.iter().fold(0.0, |s, v| s + v) / n;
        let (mx, my) = (mean(x), mean(y));
        x.iter().zip(y).fold(0.0, |s, (x, y)| s + (x - mx) * (y - my)) / n
    };
    let corr = moment(&a, &u) / (moment(&a, &a) * moment(&u, &u)).sqrt();
    let one = matching::canonical(&Blocks { values: &a, n: 1, k: 1 }, &Factors { values: &u, m: 1 }).unwrap();
    let want = corr.abs() / (1.0 + matching::RIDGE).sqrt();
    assert!((one[0] - want).abs() < 1e-13, "{} instead of {want}", one[0]);
    let block: Vec<f64> = a.iter().zip(&b).flat_map(|(a, b)| [*a, *b]).collect();
    let turned: Vec<f64> = a.iter().zip(&b).flat_map(|(a, b)| [2.0 * a + b, a - b + 7.0]).collect();
    for z in [&block, &turned] {
        let r =
            matching::canonical(&Blocks { values: z, n: 1, k: 2 }, &Factors { values: &u, m: 1 }).unwrap();
        assert!((r[0] - 1.0).abs() < 2e-3, "u is linear in the block: {}", r[0]);
    }
    let constant = vec![4.0; count as usize];
    let none = matching::canonical(&Blocks { values: &constant, n: 1, k: 1 }, &Factors { values: &u, m: 1 })
        .unwrap();
    assert_eq!(none, [0.0], "a constant block correlates with nothing");
}

#[test]
fn matching_takes_the_first_of_equals_and_leaves_factors_over() {
    let even = matching::best(vec![0.5; 9], 3, 3).unwrap();
    assert_eq!(even.block, [Some(0), Some(1), Some(2)], "lexicographic order");
    let few = matching::best(vec![0.1, 0.9, 0.4], 1, 3).unwrap();
    assert_eq!(few.block, [None, Some(0), None], "one block, three factors");
    assert!((few.mcc - 0.3).abs() < 1e-15, "factors without a block count 0: {}", few.mcc);
    let many = matching::best(vec![0.1, 0.7, 0.3], 3, 1).unwrap();
    assert_eq!(many.block, [Some(1)], "three blocks, one factor");
    assert!(matching::best(vec![0.0; 81], 9, 9).is_err(), "more than can be enumerated");
    // greedy would take 0.9 first and end at 0.9 + 0.1
    let far = matching::best(vec![0.9, 0.8, 0.8, 0.1], 2, 2).unwrap();
    assert_eq!(far.block, [Some(1), Some(0)], "the best total, not the best pair");
}

/// |correlation| as a surrogate of information.
fn stand_in(block: &[f64], k: usize, u: &[f64]) -> Result<f64> {
    let r = matching::canonical(&Blocks { values: block, n: 1, k }, &Factors { values: u, m: 1 })?[0];
    Ok(-0.5 * libm::log(1.0 - lastlight::num::order::min(r * r, 1.0 - 1e-9)))
}

#[test]
fn disentangled_blocks_score_one_and_mixed_ones_do_not() {
    let (count, m) = (1500, 3);
    let u = factors(count, m);
    let clean = mixed(&u, m, &[1, 2, 0], 3, 0.01);
    // every block the same mixture of all factors
    let tangled: Vec<f64> = u
        .chunks_exact(3)
        .flat_map(|r| {
            [r[0] + r[1] + r[2], r[0] - r[1], r[0] + r[1] - 2.0 * r[2]].into_iter().flat_map(|x| [x, -x])
        })
        .collect();
    let u = Factors { values: &u, m };
    let score = |z: &[f64]| {
        let z = Blocks { values: z, n: 3, k: 2 };
        let d = blocks::dci(&z, &u).unwrap();
        let gap = blocks::information_gap(&z, &u, stand_in).unwrap().expect("factors vary");
        (d.disentanglement.expect("3 factors"), d.completeness.expect("3 blocks"), gap)
    };
    let (clean, tangled) = (score(&clean), score(&tangled));
    println!("D, C, gap: clean {clean:?}, tangled {tangled:?}");
    assert!(clean.0 > 0.9 && clean.1 > 0.9 && clean.2 > 0.5, "clean {clean:?}");
    assert!(tangled.0 < 0.5 && tangled.1 < 0.5 && tangled.2 < 0.2, "tangled {tangled:?}");
    let one = Blocks { values: &factors(50, 1), n: 1, k: 1 };
    let d = blocks::dci(&one, &Factors { values: &factors(50, 1), m: 1 }).unwrap();
    assert_eq!(
        (d.disentanglement, d.completeness),
        (None, None),
        "one block, one factor: nothing to tell apart"
    );
    let failing = |_: &[f64], _: usize, _: &[f64]| -> Result<f64> { Err(Error::input("estimator")) };
    assert!(blocks::information_gap(&one, &Factors { values: &factors(50, 1), m: 1 }, failing).is_err());
}

#[test]
fn entropy_of_bins_has_its_closed_form() {
    let even: Vec<f64> = (0..2000).map(|i| f64::from(i) / 2000.0).collect();
    assert!((blocks::binned_entropy(&even) - libm::log(20.0)).abs() < 1e-9, "uniform: ln 20");
    assert_eq!(blocks::binned_entropy(&[1.0; 7]), 0.0, "a constant");
    let halves: Vec<f64> = (0..10).map(|i| f64::from(i % 2)).collect();
    assert!((blocks::binned_entropy(&halves) - libm::log(2.0)).abs() < 1e-15, "two values: ln 2");
}

#[test]
fn locality_is_zero_where_only_descendants_move() {
    let truth = Digraph::new(3, &[(0, 1)]); // 2 is isolated
    let before: Vec<f64> = factors(60, 3);
    let targets = vec![0; 60];
    let moved = |what: &dyn Fn(usize) -> f64| -> Vec<f64> {
        before.iter().enumerate().map(|(at, x)| x + what(at % 3)).collect()
    };
    let score = |after: &[f64]| {
        let [b, a] = [&before[..], after].map(|values| Blocks { values, n: 3, k: 1 });
        intervention::locality(&b, &a, &targets, &truth).unwrap()
    };
    let local = moved(&|j| if j < 2 { 1.0 } else { 0.0 });
    assert_eq!(score(&local), Some(0.0), "only the target and its child");
    let deviation = |j: usize| {
        let column = || before.iter().skip(j).step_by(3);
        let mean = column().fold(0.0, |s, x| s + x) / 60.0;
        (column().fold(0.0, |s, x| s + (x - mean) * (x - mean)) / 60.0).sqrt()
    };
    let leaking = moved(&|j| deviation(j) * [0.0, 2.0, 1.0][j]);
    let got = score(&leaking).expect("both kinds");
    assert!((got - 0.5).abs() < 1e-12, "half as far: {got}");
    assert_eq!(score(&before), None, "nothing moves");
    assert_eq!(intervention::relative(1.0, 4.0), Some(0.25), "a quarter of the error");
    assert_eq!(intervention::relative(1.0, 0.0), None, "of nothing");
}
