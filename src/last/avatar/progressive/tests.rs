//! Tests of levels, key Gaussians and limits against values computed by hand.

use super::{ATTRIBUTES, Level, Order, Plan, Step, block, cap, clipped, keys, random_keys, sizes};
use crate::math::digraph::Digraph;
use crate::optim::groups::Rates;
use crate::scene::gaussians::Gaussians;

#[test]
fn levels_follow_the_graph_and_its_controls() {
    let fork = Digraph::new(4, &[(0, 1), (0, 2), (1, 3)]);
    let of = |order| Plan::new(&fork, order, 5).expect("no cycle").levels;
    assert_eq!(of(Order::Topological), [vec![0], vec![1, 2], vec![3]], "parents first");
    assert_eq!(of(Order::Reverse), [vec![2, 3], vec![1], vec![0]], "children first");
    assert_eq!(of(Order::None), [vec![0, 1, 2, 3]], "at once");
    assert_eq!(of(Order::Random).len(), 3, "the same shape");
    assert!(Plan::new(&Digraph::new(2, &[(0, 1), (1, 0)]), Order::Topological, 0).is_err(), "a cycle");
}

#[test]
fn every_gaussian_is_key_to_something_or_to_nothing() {
    let scores = vec![vec![0.5, 0.5, 0.1, 0.0, 0.0], vec![0.0, 0.0, 0.0, 0.0, 1e-7]];
    let members = keys(&scores, 0.25);
    assert_eq!(members, [1, 1, 0, 0, 0], "⌈5/4⌉ = 2, ties to the lower row, nothing below 1e-6");
    assert_eq!(block(&members, &[0], 0), [1; 5], "level 0 contains all other Gaussians");
    assert_eq!(block(&members, &[0], 1), [1, 1, 0, 0, 0], "later levels contain only their key Gaussians");
    let drawn = random_keys(3, 40, 0.25, 1, 200);
    for i in 0..3 {
        assert_eq!(drawn.iter().filter(|m| *m >> i & 1 == 1).count(), 10, "as many");
    }
}

#[test]
fn caps_bound_the_rms() {
    let g = |d: f32| Gaussians {
        means: (0..4).map(|i| [i as f32 + d; 3]).collect(),
        quats: vec![[1.0 + d, d, d, d]; 4],
        scales_log: vec![[d; 3]; 4],
        opacity_logits: vec![d; 4],
        sh: vec![d; 12],
        sh_degree: 0,
    };
    let rates =
        Rates { means: 0.25, quats: 0.5, scales_log: 0.5, opacity_logits: 0.5, sh_dc: 0.5, sh_rest: 0.5 };
    let (before, after) = (g(0.0), g(0.5));
    let plan = Plan::new(&Digraph::new(2, &[(0, 1)]), Order::Topological, 0).expect("no cycle");
    let members = [1, 3, 2, 0];
    let mut r = vec![sizes(&before, &after, &rates, &members, 0), [0.0; ATTRIBUTES]];
    assert_eq!(r[0], [2.0, 1.0, 1.0, 1.0, 1.0], "step over rate");
    for (lambda, move_by) in [(0.0, 0.0), (0.125, 0.0625), (f64::INFINITY, 0.5)] {
        let mut moved = after.clone();
        let level = Level { plan: &plan, factors: &[1], members: &members };
        let step = Step { before: &before, rates: &rates };
        let bound = cap(step, &mut moved, level, lambda, &mut r);
        assert_eq!(bound, if lambda < 1.0 { 5 } else { 0 }, "bound steps at {lambda}");
        assert_eq!(moved.means[2], [2.0 + move_by; 3], "a key of the child at {lambda}");
        assert_eq!(moved.scales_log[1], [move_by; 3], "a key of both");
        assert_eq!(moved.means[0], after.means[0], "not a key of the child");
        assert_eq!(r[1][0], if lambda < 1.0 { lambda * 2.0 } else { 2.0 }, "the child's own size");
    }
    let mut direct = before.clone();
    assert_eq!(clipped(&mut direct, &after, &members, &[1], 1e9), 0, "nothing binds");
    assert_eq!(direct.means[2], [2.0 - 2.5; 3], "unit rate");
    assert_eq!(direct.means[0], before.means[0], "not in the block");
    let mut clip = before.clone();
    assert_eq!(clipped(&mut clip, &after, &members, &[1], 0.1), 1, "bound");
    let moved: f64 = clip
        .means
        .as_flattened()
        .iter()
        .zip(before.means.as_flattened())
        .map(|(a, b)| f64::from((a - b) * (a - b)))
        .fold(0.0, |sum, x| sum + x);
    assert!(moved.sqrt() < 0.1001, "no longer than λ");
}
