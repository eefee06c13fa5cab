//! Fine-tuning on a subject: what it keeps, and what follows when the graph changes.

use lastlight::last::model::evaluation::{deviations, linked};
use lastlight::last::model::file::Trained;
use lastlight::last::model::shipped;
use lastlight::last::model::structure::Structure;
use lastlight::last::model::tune::{self, Settings, Subject};
use lastlight::math::digraph::Digraph;
use lastlight::num::rng::Rng;

/// Sixty images' posteriors, drawn with the spread of the training set.
fn subject(trained: &Trained) -> Subject {
    let d = trained.model.sizes.latent();
    let rng = Rng::new(2);
    let draw = |at: usize| trained.factor_spread[at % d] * rng.normal_f64(at as u64, 0, 0x7e5b, 20);
    Subject { mu: (0..60 * d).map(draw).collect(), ell: vec![-4.0; 60 * d], ..Subject::default() }
}

fn probabilities(trained: &Trained) -> Vec<f64> {
    Structure::new(trained.model.sizes, &trained.model.params).probabilities(trained.settings.tau)
}

#[test]
fn probabilities_agree_with_a_searched_graph() {
    let mut trained = shipped::figure().expect("it is built in");
    let n = trained.model.sizes.factors;
    let all = trained.graph.edges();
    assert!(!all.is_empty(), "the shipped graph has edges");
    // A search may take an edge that the probabilities have, and add one that they have not.
    let added = (0..n * n)
        .map(|at| (at / n, at % n))
        .find(|&(i, j)| i != j && !all.contains(&(i, j)) && !all.contains(&(j, i)));
    let mut edges = all[1..].to_vec();
    edges.extend(added);
    let searched = Digraph::new(n, &edges);
    assert!(searched.is_acyclic(), "a graph as the search leaves it");
    trained.graph = searched.clone();
    let spreads = (trained.factor_spread.clone(), trained.noise_spread.clone());
    let subject = subject(&trained);
    let tuned = tune::run(&mut trained, &subject, &Settings { steps: 0, ..Settings::default() });
    let tuned = tuned.expect("a subject");
    assert_eq!(trained.graph, searched, "no step, no change");
    let p = probabilities(&trained);
    for (i, j) in (0..n * n).map(|at| (at / n, at % n)).filter(|(i, j)| i != j) {
        assert_eq!(p[i * n + j] > 0.5, searched.has(i, j), "{i} → {j}: p = {}", p[i * n + j]);
    }
    assert_eq!(tuned.before, p, "as in the record");
    assert_eq!(spreads, (trained.factor_spread, trained.noise_spread), "deviations of the same graph");
}

#[test]
fn deviations_follow_a_graph_that_changed() {
    let mut trained = shipped::figure().expect("it is built in");
    let (subject, d) = (subject(&trained), trained.model.sizes.latent());
    let of = |t: &Trained| linked(t, subject.mu.clone()).map(|rows| deviations(&rows, d));
    let (before, noise) = (of(&trained), trained.noise_spread.clone());
    // Edges that cost a thousand times as much as usual do not stay.
    trained.settings.weights.sparsity = 2.0;
    let settings = Settings { steps: 400, lr: 3e-2, anchor: 0.0, ..Settings::default() };
    let frozen = |t: &Trained| -> Vec<(String, Vec<u32>)> {
        let bits = |name: &str, array: &ndarray::ArrayD<f32>| {
            (name.to_owned(), array.iter().map(|x| x.to_bits()).collect())
        };
        t.model
            .params
            .iter()
            .filter(|(name, _)| *name != "structure.logits")
            .map(|(n, a)| bits(n, a))
            .collect()
    };
    let kept = frozen(&trained);
    let tuned = tune::run(&mut trained, &subject, &settings).expect("a subject");
    assert_ne!(tuned.edges[0], tuned.edges[1], "the graph changed");
    assert_eq!(frozen(&trained), kept, "encoder, decoder and mechanisms are frozen to the bit");
    let after = of(&trained);
    for c in 0..d {
        let want = noise[c] * (after[1][c] / before[1][c]);
        assert!((trained.noise_spread[c] / want - 1.0).abs() < 1e-12, "number {c}");
    }
    assert_ne!(trained.noise_spread, noise, "noise of a child without its parent is the complete factor");
}
