//! What groups of interventions identify, and what they do not: on known factors by construction, and by
//! training on vectors.

use crate::common;
use data_gen::figure::graph::Graph;
use data_gen::figure::mechanism::{Mechanism, Scm};
use data_gen::figure::samples;
use lastlight::last::model::data::{Data, Frame, Group, Item};
use lastlight::last::model::encoder::Input;
use lastlight::last::model::evaluation;
use lastlight::last::model::latent::{self, Layout, Out};
use lastlight::last::model::settings::{Placement, Reading, Settings, Supervision, Weights};
use lastlight::last::model::step::Batch;
use lastlight::last::model::structure::{Kind, Sizes, Structure};
use lastlight::last::model::train::Training;
use lastlight::last::model::vectors::Vectors;
use lastlight::loss::metric::structure::edges;
use lastlight::math::digraph::Digraph;
use lastlight::tape::Params;
use ndarray::{ArrayD, IxDyn};

const N: usize = 4;
const GROUPS: usize = 12;

/// Factors and noise of groups, before and after: what a coding may take for its latent numbers.
struct Pairs {
    layout: Layout,
    /// (items, n) factors
    factors: Vec<f64>,
    /// (items, n) own causes in units of the factors: u_j − Σ a_ij u_i; of a set factor what is left of it
    noise: Vec<f64>,
}

fn pairs(scm: &Scm, seed: u64) -> Pairs {
    let groups: Vec<samples::Group> = (0..GROUPS).map(|g| samples::group(scm, seed, g, 1)).collect();
    let frames = || {
        let all = |after: bool| {
            groups.iter().flat_map(move |g| if after { g.after.iter() } else { g.bases.iter() })
        };
        all(false).chain(all(true))
    };
    let factors: Vec<f64> = frames().flat_map(|f| f.u.clone()).collect();
    let own = |u: &[f64]| -> Vec<f64> {
        (0..N).map(|j| (0..N).fold(u[j], |s, i| s - scm.a[i][j] * u[i])).collect()
    };
    let noise = frames().flat_map(|f| own(&f.u)).collect();
    let targets = groups.iter().map(|g| g.target).collect();
    Pairs { layout: Layout { observed: 0, targets, members: samples::BASES }, factors, noise }
}

/// Losses of a coding (items, n) under a linear structure of weights (n, n).
fn losses(pairs: &Pairs, coding: &[f64], weight: &[f64], supervision: Supervision) -> Out {
    losses_with(pairs, coding, weight, supervision, &[])
}

/// The same with given values of the groups.
fn losses_with(
    pairs: &Pairs,
    coding: &[f64],
    weight: &[f64],
    supervision: Supervision,
    labels: &[f64],
) -> Out {
    let sizes = Sizes { factors: N, width: 1, kind: Kind::Linear };
    let mut params = Params::new();
    sizes.draw(0, &mut params);
    let single: Vec<f32> = weight.iter().map(|&w| w as f32).collect();
    // Weights of eighths are exact in single precision.
    assert!(single.iter().zip(weight).all(|(s, w)| f64::from(*s) == *w), "weights are exact");
    params.set("structure.weight", ArrayD::from_shape_vec(IxDyn(&[N, N]), single).expect("(n, n)"));
    let structure = Structure::new(sizes, &params);
    let mask: Vec<f64> = weight.iter().map(|w| if *w == 0.0 { 0.0 } else { 1.0 }).collect();
    let zeros = vec![0.0; coding.len()];
    let x = latent::In {
        structure: &structure,
        mask: &mask,
        layout: &pairs.layout,
        mu: coding,
        ell: &zeros,
        eta: &zeros,
        spread: &[1.0; N],
        labels,
        reading: Reading::Reference,
        supervision,
        weights: Weights::default(),
        placement: Placement::Off,
        carried: None,
    };
    latent::forward(&x).expect("no covariance is requested")
}

/// A linear model whose coefficients are eighths.
fn eighths(name: &str, seed: u64) -> Scm {
    let mut scm = Scm::new(Graph::named(name, N, seed).expect("a name"), Mechanism::Lin, true, seed);
    scm.a.iter_mut().flatten().for_each(|a| *a = (8.0 * *a).round() / 8.0);
    scm
}

/// Largest difference between what is decoded for the after-images and their coding.
fn off(pairs: &Pairs, coding: &[f64], out: &Out) -> f64 {
    let after = &coding[pairs.layout.after(0) * N..];
    let counterfactual = &out.decoded[pairs.layout.items() * N..];
    after.iter().zip(counterfactual).fold(0.0, |m, (a, b)| if (a - b).abs() > m { (a - b).abs() } else { m })
}

#[test]
fn values_per_sample_are_explained_without_a_graph_and_shared_values_are_not() {
    for name in ["FORK", "CHAIN", "COLLIDER", "DIAMOND", "FULL"] {
        for seed in 0..5 {
            let scm = eighths(name, seed);
            let p = pairs(&scm, seed);
            let (truth, none) = (scm.a.concat(), vec![0.0; N * N]);
            for supervision in [Supervision::PerSample, Supervision::Groups] {
                let out = losses(&p, &p.factors, &truth, supervision);
                let what = format!("{name} {seed} {supervision:?}: truth");
                assert!(out.terms.invariant < 1e-24, "{what}: L_inv {:e}", out.terms.invariant);
                assert!(out.terms.equal < 1e-24, "{what}: L_eq {:e}", out.terms.equal);
                assert!(off(&p, &p.factors, &out) < 1e-12, "{what}: counterfactuals are the generator's");
            }
            let out = losses(&p, &p.noise, &none, Supervision::PerSample);
            assert!(out.terms.invariant < 1e-24, "{name} {seed}: noise without a graph, L_inv");
            assert!(off(&p, &p.noise, &out) < 1e-12, "{name} {seed}: noise reproduces every after-image");
            let out = losses(&p, &p.noise, &none, Supervision::Groups);
            assert!(
                out.terms.equal > 0.02,
                "{name} {seed}: a shared value has many codes, {}",
                out.terms.equal
            );
            assert!(off(&p, &p.noise, &out) > 0.3, "{name} {seed}: and misses the after-images");
        }
    }
}

#[test]
fn a_factor_that_is_never_set_leaves_its_edges_open() {
    // DIAMOND P→W, P→O, W→L, O→L without groups that set W: W may be coded by its noise if L listens to P
    // instead.
    let [posture, occlusion, cloth, light] = [0, 1, 2, 3];
    for seed in 0..5 {
        let scm = eighths("DIAMOND", seed);
        let mut p = pairs(&scm, seed);
        let kept: Vec<usize> = (0..GROUPS).filter(|&g| p.layout.targets[g] != cloth).collect();
        let m = samples::BASES;
        let (pairs_before, width) = (p.layout.pairs(), N);
        let rows = |x: &[f64]| -> Vec<f64> {
            let all = |from: usize| {
                let kept = kept.clone();
                kept.into_iter().flat_map(move |g| g * m..(g + 1) * m).map(move |r| from + r)
            };
            all(0).chain(all(pairs_before)).flat_map(|r| x[r * width..(r + 1) * width].to_vec()).collect()
        };
        (p.factors, p.noise) = (rows(&p.factors), rows(&p.noise));
        p.layout.targets = kept.iter().map(|&g| p.layout.targets[g]).collect();
        let truth = scm.a.concat();
        let out = losses(&p, &p.factors, &truth, Supervision::Groups);
        assert!(out.terms.equal + out.terms.invariant < 1e-24, "{seed}: the truth has no loss");
        // Another graph: no edge into W, and P→L takes over what came through it. Sixty-fourths are exact
        // too.
        let mut other = truth.clone();
        other[posture * N + cloth] = 0.0;
        other[posture * N + light] = truth[posture * N + cloth] * truth[cloth * N + light];
        let mut coding = p.factors.clone();
        coding.chunks_exact_mut(N).for_each(|u| u[cloth] -= truth[posture * N + cloth] * u[posture]);
        let out = losses(&p, &coding, &other, Supervision::Groups);
        assert!(out.terms.equal + out.terms.invariant < 1e-24, "{seed}: neither has the other graph");
        assert!(off(&p, &coding, &out) < 1e-12, "{seed}: and its counterfactuals are right");
        assert_ne!(other, truth, "{seed}: another graph over P, O ({occlusion}), W, L");
    }
}

#[test]
fn told_values_hold_codes_to_one_scale() {
    // v·w_i with w_i = 1 for one number: the factors themselves cost nothing, twice the factors do.
    let scm = eighths("FORK", 1);
    let p = pairs(&scm, 1);
    let m = samples::BASES;
    let value = |g: usize| p.factors[p.layout.after(g * m) * N + p.layout.targets[g]];
    let labels: Vec<f64> = (0..GROUPS).map(value).collect();
    let truth = scm.a.concat();
    let equal = |coding: &[f64]| losses_with(&p, coding, &truth, Supervision::Labels, &labels).terms.equal;
    assert!(equal(&p.factors) < 1e-24, "codes are the values: {:e}", equal(&p.factors));
    let twice: Vec<f64> = p.factors.iter().map(|u| 2.0 * u).collect();
    let mean_square = labels.iter().fold(0.0, |s, v| s + v * v) / labels.len() as f64;
    assert!((equal(&twice) - mean_square).abs() < 1e-12, "{} and {mean_square}", equal(&twice));
    let groups = losses(&p, &twice, &truth, Supervision::Groups).terms.equal;
    assert!(groups < 1e-24, "without labels any scale does: {groups:e}");
}

/// Data of which some factor is never set.
#[derive(Debug)]
struct Unset<'a>(&'a Vectors, Vec<Group>);

impl Data for Unset<'_> {
    fn input(&self) -> Input {
        self.0.input()
    }
    fn observed(&self) -> usize {
        self.0.observed()
    }
    fn groups(&self) -> &[Group] {
        &self.1
    }
    fn members(&self) -> usize {
        self.0.members()
    }
    fn frame(&self) -> &Frame {
        self.0.frame()
    }
    fn template(&self) -> &[[f32; 3]] {
        self.0.template()
    }
    fn write_input(&self, item: Item, into: &mut [f32]) {
        self.0.write_input(item, into);
    }
    fn true_factors(&self) -> usize {
        self.0.true_factors()
    }
    fn truth(&self, item: Item) -> &[f64] {
        self.0.truth(item)
    }
    fn shown(&self, item: Item) -> &[f32] {
        self.0.shown(item)
    }
}

#[test]
fn batches_ask_only_for_what_was_set() {
    let scm = Scm::new(Graph::named("FORK", N, 3).expect("a name"), Mechanism::Lin, true, 3);
    let all = Vectors::new(&scm, 3, 64, 32);
    // A prefix without factor 1 is not enough, because the groups cycle through the factors. The reference
    // values are their targets.
    let groups =
        all.groups().iter().map(|g| Group { target: if g.target == 1 { 3 } else { g.target }, ..*g });
    let data = Unset(&all, groups.collect());
    let s = Settings { points: 1, width: 1, groups: 5, ..Settings::default() };
    let mut counts = [0; N];
    for step in 0..60 {
        let batch = Batch::draw(&s, &data, step);
        assert_eq!(batch.layout.targets.len(), 5, "all places are taken");
        batch.layout.targets.iter().for_each(|t| counts[*t] += 1);
        let chosen = batch.items.iter().filter_map(|i| match i {
            Item::After(g, 0) => Some(data.groups()[*g].target),
            _ => None,
        });
        assert!(chosen.eq(batch.layout.targets.iter().copied()), "groups of the requested factor");
    }
    assert_eq!(counts, [100, 0, 100, 100], "in turn, the factor that is never set left out");
}

/// The graph that a training on vectors ends with, against the truth.
fn trained(
    name: &str,
    mechanism: Mechanism,
    supervision: Supervision,
    steps: u32,
    seed: u64,
) -> (usize, Digraph) {
    let graph = Graph::named(name, N, seed).expect("a name");
    let scm = Scm::new(graph.clone(), mechanism, true, seed);
    let data = Vectors::new(&scm, seed, 1024, 128);
    let mut s = Settings { supervision, points: 1, seed, width: 1, ..Settings::default() }.scaled(steps);
    s.refit = steps / 5;
    if supervision == Supervision::None {
        s.weights.groups = 0.0;
    }
    let mut training = Training::new(s, &data).expect("vectors have an encoder");
    for _ in 0..s.steps + s.refit {
        training.advance().expect("finite");
    }
    let found = Digraph::from_weights(&training.graph.expect("the end"), N, 0.5);
    let truth = Digraph::from_fn(N, |i, j| graph.adjacency[i][j]);
    (edges::compare(&truth, &found).shd, found)
}

#[test]
fn training_without_shared_values_does_not_find_the_graph() {
    // T7 (a) and (b): if it did, order, variance or labels would leak.
    for supervision in [Supervision::None, Supervision::PerSample] {
        let all = [0, 1, 2].map(|seed| trained("FORK", Mechanism::Nl, supervision, 600, seed));
        let shown =
            all.iter().map(|(shd, found)| format!("{found}, SHD {shd}")).collect::<Vec<_>>().join("; ");
        println!("FORK NL, {}: {shown}", supervision.name());
        assert!(all.iter().filter(|(shd, _)| *shd == 0).count() <= 1, "{}: {shown}", supervision.name());
    }
}

#[test]
fn training_with_shared_values_finds_the_graph() {
    let (shd, found) = trained("FORK", Mechanism::Nl, Supervision::Groups, 600, 0);
    println!("FORK NL: {found}, SHD {shd}");
    assert!(shd <= 1, "FORK NL: {found}");
    if !common::long("identification: all graphs, LIN and NL, five seeds") {
        return;
    }
    for name in ["FORK", "CHAIN", "COLLIDER", "DIAMOND", "FULL"] {
        for mechanism in [Mechanism::Lin, Mechanism::Nl] {
            let mut all: Vec<usize> =
                (0..5).map(|seed| trained(name, mechanism, Supervision::Groups, 3000, seed).0).collect();
            all.sort_unstable();
            println!("{name} {}: SHD {all:?}", mechanism.name());
            assert!(all[2] <= 1, "{name} {}: median SHD of {all:?}", mechanism.name());
        }
    }
}

#[test]
fn every_way_to_tell_and_every_place_of_dependence_trains() {
    let scm = Scm::new(Graph::named("FORK", N, 3).expect("a name"), Mechanism::Lin, true, 3);
    let data = Vectors::new(&scm, 3, 64, 16);
    let told = ["none", "pairs", "groups", "labels", "unknown"]
        .map(|name| Supervision::parse(name).expect("a name"));
    let places =
        ["noise", "factors", "conditional", "off"].map(|name| Placement::parse(name).expect("a name"));
    let kinds = [
        (Reading::Reference, Kind::Linear),
        (Reading::Reference, Kind::Networks),
        (Reading::Literal, Kind::Printed),
    ];
    for (reading, kind) in kinds {
        for supervision in told {
            for placement in places {
                let base = Settings {
                    supervision,
                    placement,
                    reading,
                    kind,
                    points: 1,
                    width: 2,
                    ..Settings::default()
                };
                let s = Settings { observed: 16, groups: 4, ..base }.scaled(12);
                let what =
                    format!("{} {} {} {}", reading.name(), kind.name(), supervision.name(), placement.name());
                let mut training = Training::new(s, &data).unwrap_or_else(|e| panic!("{what}: {e}"));
                let before = training.model.params.clone();
                for step in 0..s.steps + s.refit {
                    let losses = training.advance().unwrap_or_else(|e| panic!("{what}, step {step}: {e}"));
                    assert!(losses.reconstruction.is_finite() && losses.intervention.is_finite(), "{what}");
                }
                let trained = training.finish().unwrap_or_else(|e| panic!("{what}: {e}"));
                assert!(trained.graph.is_acyclic(), "{what}: a graph without cycles");
                let moved =
                    before.iter().filter(|(name, x)| trained.model.params.get(name) != Some(*x)).count();
                assert!(moved > 8, "{what}: {moved} arrays have moved");
                let verdict =
                    evaluation::of(&trained, &data, &Some(scm.graph.adjacency.clone())).expect("scored");
                assert!(verdict.mcc.is_finite() && verdict.distances.is_some(), "{what}");
                assert_eq!(verdict.variances.len(), N, "{what}: a variance for each block");
                assert!(verdict.active <= 2 * N && verdict.variances.iter().all(|v| *v > 0.0), "{what}");
            }
        }
    }
}
