//! do(i, v): non-descendants keep their bits, descendants have the values of the generator that made the
//! data.

use super::models::{Model, bits, normals};
use data_gen::figure::graph::Graph as Truth;
use data_gen::figure::mechanism::{Mechanism as Form, Scm};
use lastlight::causal::intervene::{self, In};
use lastlight::causal::structure::{self, Mechanism};
use lastlight::math::digraph::Digraph;

#[test]
fn non_descendants_keep_their_bits_and_descendants_move() {
    let (mut moved, mut kept) = (0, 0);
    for number in 0..300 {
        let model = Model::new(number);
        let (n, k) = (model.n, model.k);
        let graph = Digraph::from_weights(&model.mask, n, 0.5);
        for linear in [true, false] {
            let before = structure::forward(&model.input(linear)).0;
            for node in 0..n {
                let value = normals(3, number, node as u16, k);
                let x = In { given: model.input(linear), target: &[Some(node)], value: &value };
                let after = intervene::forward(&x).0;
                let descends = graph.descendants(node);
                for j in 0..n {
                    let at = j * k..(j + 1) * k;
                    let what = format!("graph {number}, linear {linear}, do({node}), factor {j}");
                    if j == node {
                        assert_eq!(bits(&after[at]), bits(&value), "{what}: it is the value");
                    } else if descends >> j & 1 == 1 {
                        moved += usize::from(after[at.clone()] != before[at]);
                    } else {
                        assert_eq!(bits(&after[at.clone()]), bits(&before[at]), "{what}: no descendant");
                        kept += 1;
                    }
                }
                let none = In { target: &[None], ..x };
                assert_eq!(bits(&intervene::forward(&none).0), bits(&before), "no target, no change");
            }
        }
    }
    println!("{kept} factors kept, {moved} descendants moved");
    assert!(kept > 2000 && moved > 2000, "both were met: {kept} kept, {moved} moved");
}

#[test]
fn with_the_generators_own_mechanism_the_counterfactual_is_the_generators() {
    for name in ["FORK", "CHAIN", "COLLIDER", "DIAMOND", "FULL", "EMPTY"] {
        for seed in 0..20 {
            let truth = Truth::named(name, 4, seed).expect("a name of the list");
            let scm = Scm::new(truth, Form::Lin, true, seed);
            let weight = scm.a.concat();
            let mask: Vec<f64> = weight.iter().map(|a| if *a == 0.0 { 0.0 } else { 1.0 }).collect();
            let noise = normals(4, seed as u32, 0, 4);
            let eps: Vec<f64> = noise.iter().zip(&scm.s).map(|(e, s)| s * e).collect();
            let mechanism = Mechanism::Linear { weight: &weight };
            let given = structure::In { eps: &eps, mask: &mask, mechanism, batch: 1, n: 4, k: 1, sweeps: 3 };
            let factors = scm.factors(&noise, None);
            assert_eq!(structure::forward(&given).0, factors, "{name} {seed}: observed");
            // abduction from what was observed, action, prediction
            let causes = structure::abduct(&structure::In { eps: &factors, ..given });
            for node in 0..4 {
                let value = [1.75 - node as f64];
                let x = In {
                    given: structure::In { eps: &causes, ..given },
                    target: &[Some(node)],
                    value: &value,
                };
                let ours = intervene::forward(&x).0;
                let theirs = scm.factors(&noise, Some((node, value[0])));
                for (a, b) in ours.iter().zip(&theirs) {
                    assert!((a - b).abs() <= 1e-12, "{name} {seed}, do({node}): {a} for {b}");
                }
            }
        }
    }
}

#[test]
fn samples_of_a_batch_do_not_see_each_other() {
    let model = Model::new(11);
    let (n, k, d) = (model.n, model.k, model.n * model.k);
    let targets: Vec<Option<usize>> = [None].into_iter().chain((0..n).map(Some)).collect();
    let batch = targets.len();
    let (eps, value) = (normals(5, 0, 0, batch * d), normals(5, 0, 1, batch * k));
    let given = structure::In { eps: &eps, batch, ..model.input(false) };
    let together = intervene::forward(&In { given, target: &targets, value: &value }).0;
    for b in 0..batch {
        let given = structure::In { eps: &eps[b * d..(b + 1) * d], batch: 1, ..given };
        let x = In { given, target: &targets[b..=b], value: &value[b * k..(b + 1) * k] };
        assert_eq!(bits(&intervene::forward(&x).0), bits(&together[b * d..(b + 1) * d]), "sample {b}");
    }
}
