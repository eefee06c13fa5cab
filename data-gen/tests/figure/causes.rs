//! Tests of graphs, mechanisms, observational frames and interventions.

use crate::{L, O, P, W, column, correlation, samples, scm};
use data_gen::figure::factors::LETTERS;
use data_gen::figure::graph::Graph;
use data_gen::figure::mechanism::{Mechanism, variance};
use data_gen::figure::samples::{BASES, LEAST_CHANGE, group, observed};
use reference::num::rng::Key;

#[test]
fn graphs_have_the_published_edges() {
    let edges = |name: &str| {
        let g = Graph::named(name, 4, 0).expect("a known graph");
        let mut list = String::new();
        for i in 0..4 {
            for j in (0..4).filter(|&j| g.adjacency[i][j]) {
                list.extend([LETTERS[i], LETTERS[j], ' ']);
            }
        }
        list
    };
    assert_eq!(edges("FORK"), "PO PW ", "FORK");
    assert_eq!(edges("CHAIN"), "PW OL WO ", "CHAIN");
    assert_eq!(edges("COLLIDER"), "PW OW ", "COLLIDER");
    assert_eq!(edges("DIAMOND"), "PO PW OL WL ", "DIAMOND");
    assert_eq!(edges("FULL"), "PO PW PL OL WO WL ", "FULL");
    assert_eq!(edges("EMPTY"), "", "EMPTY");
    for bad in ["fork", "ER-", "ER-99", "RING"] {
        assert!(Graph::named(bad, 4, 0).is_err(), "{bad} is rejected");
    }
    assert!(Graph::named("FORK", 3, 0).is_err() && Graph::named("FORK", 9, 0).is_err(), "sizes are checked");
    assert!(Graph::new(3, &[(0, 1), (1, 2), (2, 0)]).is_err(), "a cycle is rejected");
}

#[test]
fn random_graphs_are_acyclic_and_have_as_many_edges_as_asked() {
    let mut different = std::collections::BTreeSet::new();
    for n in 5..=8 {
        for m in [0, 3, n * (n - 1) / 2] {
            for seed in 0..20 {
                let g = Graph::named(&format!("ER-{m}"), n, seed).expect("fits");
                let edges = g.adjacency.iter().flatten().filter(|&&e| e).count();
                assert_eq!(edges, m, "n {n}, seed {seed}");
                assert_eq!(g.order.len(), n, "every node has a place in the order");
                different.insert(format!("{:?}", g.adjacency));
            }
        }
    }
    assert!(different.len() > 100, "seeds give different graphs: {}", different.len());
}

#[test]
fn form_and_noise_are_two_choices() {
    for (name, mechanism, bends, is_uniform) in [
        ("LIN", Mechanism::Lin, false, false),
        ("NL", Mechanism::Nl, true, false),
        ("NG", Mechanism::Ng, false, true),
        ("NL-NG", Mechanism::NlNg, true, true),
    ] {
        assert_eq!(Mechanism::parse(name), Ok(mechanism), "{name}");
        assert_eq!(mechanism.name(), name, "{name}");
        assert_eq!(mechanism.f(3.0) < 1.0, bends, "{name}: f");
        let largest = (0..4000).fold(0.0f64, |m, item| {
            let e = mechanism.noise(Key { seed: 1, item, step: 0, purpose: 1, draw: 0 }).abs();
            if e > m { e } else { m }
        });
        assert_eq!(largest <= 3.0_f64.sqrt(), is_uniform, "{name}: noise up to {largest}");
    }
    assert!(Mechanism::parse("nl").is_err(), "names are exact");
}

#[test]
fn raw_coefficients_lie_in_their_range_with_both_signs() {
    let (mut positive, mut count) = (0, 0);
    for seed in 0..50 {
        for a in scm("FULL", 4, Mechanism::Lin, false, seed).a.iter().flatten().filter(|a| **a != 0.0) {
            assert!((0.5..=0.9).contains(&a.abs()), "|a| = {}", a.abs());
            positive += usize::from(*a > 0.0);
            count += 1;
        }
    }
    assert_eq!(count, 300, "six edges each");
    assert!((110..=190).contains(&positive), "signs are fair: {positive} of 300");
}

#[test]
fn coefficients_shrink_only_where_parents_leave_no_room() {
    let (mut shrunk, mut count) = (0, 0);
    for seed in 0..100 {
        let (raw, standard) =
            (scm("COLLIDER", 4, Mechanism::Lin, false, seed), scm("COLLIDER", 4, Mechanism::Lin, true, seed));
        let explained = raw.a[P][W] * raw.a[P][W] + raw.a[O][W] * raw.a[O][W];
        let is_kept = standard.a == raw.a;
        assert_eq!(is_kept, explained <= 1.0 - 0.05 * 0.05, "seed {seed}: parents explain {explained}");
        shrunk += usize::from(!is_kept);
        count += 1;
    }
    assert!(shrunk > 0 && shrunk < count, "both occur: {shrunk} of {count}");
}

#[test]
fn standardised_factors_have_variance_one() {
    for graph in ["FORK", "CHAIN", "COLLIDER", "DIAMOND", "FULL", "EMPTY"] {
        for mechanism in [Mechanism::Lin, Mechanism::Nl, Mechanism::Ng] {
            // Nonlinear mechanisms use a million draws each.
            let seeds = match (mechanism, graph) {
                (Mechanism::Nl, "DIAMOND" | "FULL") => 0..1,
                (Mechanism::Nl, _) => 0..0,
                _ => 0..5,
            };
            for seed in seeds {
                let scm = scm(graph, 4, mechanism, true, seed);
                let u = samples(&scm, seed, 20_000);
                for j in 0..4 {
                    let v = variance(&column(&u, j));
                    // Standard error √(2/N) = 0.01 for normal factors.
                    assert!(
                        (v - 1.0).abs() < 0.05,
                        "{graph} {} seed {seed}: Var(u_{j}) = {v}",
                        mechanism.name()
                    );
                    assert!(scm.s[j] >= 0.05 - 1e-12, "noise of its own remains: s_{j} = {}", scm.s[j]);
                }
                let kept = scm.a.iter().flatten().all(|a| a.abs() <= 0.9);
                assert!(kept, "coefficients only shrink");
            }
        }
    }
}

#[test]
fn a_fork_correlates_its_children_and_leaves_light_alone() {
    let scm = scm("FORK", 4, Mechanism::Lin, true, 3);
    let u = samples(&scm, 3, 20_000);
    let r = correlation(&column(&u, W), &column(&u, O));
    let expected = scm.a[P][W] * scm.a[P][O];
    // Standard error (1 − r²)/√N is below 0.0071.
    assert!((r - expected).abs() < 0.03, "corr(W, O) = a_PW·a_PO: {r} against {expected}");
    for j in [P, O, W] {
        let r = correlation(&column(&u, L), &column(&u, j));
        assert!(r.abs() < 0.03, "light is independent of factor {j}: {r}");
    }
}

#[test]
fn observational_frames_share_looks_in_equal_runs() {
    let scm = scm("FORK", 4, Mechanism::Lin, true, 0);
    let looks: Vec<u64> = (0..2048).map(|i| observed(&scm, 0, i, 2048, 64).appearance).collect();
    for look in 0..64 {
        assert_eq!(looks.iter().filter(|&&a| a == look).count(), 32, "look {look}");
    }
}

#[test]
fn interventions_leave_everything_but_descendants_bit_for_bit() {
    for (graph, n) in [("FORK", 4), ("FULL", 4), ("DIAMOND", 4), ("ER-9", 7)] {
        for mechanism in [Mechanism::Lin, Mechanism::Nl, Mechanism::Ng] {
            // Nonlinear mechanisms stay raw: standardising uses a million draws and does not affect this
            // test.
            let scm = scm(graph, n, mechanism, mechanism != Mechanism::Nl, 11);
            for index in 0..16 {
                let g = group(&scm, 11, index, 64);
                assert_eq!((g.target, g.bases.len()), (index % n, BASES), "targets take turns");
                assert!((-2.0..2.0).contains(&g.value), "v = {}", g.value);
                let below = scm.graph.descendants(g.target);
                for (base, after) in g.bases.iter().zip(&g.after) {
                    assert!((g.value - base.u[g.target]).abs() >= LEAST_CHANGE, "the change is large enough");
                    assert_eq!(after.u[g.target].to_bits(), g.value.to_bits(), "the value is shared");
                    assert_eq!(base.e, after.e, "noise is kept");
                    assert_eq!(base.appearance, g.bases[0].appearance, "one appearance per group");
                    assert_eq!(after.appearance, base.appearance, "one appearance per group");
                    for j in (0..n).filter(|&j| j != g.target) {
                        let same = base.u[j].to_bits() == after.u[j].to_bits();
                        assert!(below[j] || same, "{graph}: do({}) moved {j}", g.target);
                    }
                    // A descendant follows its equation, with its own noise kept.
                    let again = scm.factors(&after.e, Some((g.target, g.value)));
                    assert_eq!(again, after.u, "descendants follow");
                }
            }
        }
    }
}
