//! The penalty is 0 on graphs without cycles and nowhere else.

use lastlight::causal::acyclic;
use lastlight::math::digraph::Digraph;

#[test]
fn all_graphs_of_four_nodes_are_told_apart_in_bits() {
    let places: Vec<usize> = (0..16).filter(|at| at / 4 != at % 4).collect();
    for alpha in [1.0, 0.25] {
        let (mut without, mut least) = (0, f64::INFINITY);
        for number in 0..1 << places.len() {
            let mut a = vec![0.0; 16];
            for (bit, at) in places.iter().enumerate() {
                a[*at] = f64::from(number >> bit & 1);
            }
            let (h, saved) = acyclic::forward(&a, 4, alpha);
            if Digraph::from_weights(&a, 4, 0.5).is_acyclic() {
                without += 1;
                assert_eq!(h.to_bits(), 0, "graph {number:012b} has no cycle");
                let mut bar = vec![0.0; 16];
                acyclic::adjoint(&a, 4, alpha, &saved, 1.0, &mut bar);
                assert!(bar.iter().all(|g| *g == 0.0), "graph {number:012b}: the gradient vanishes");
            } else {
                assert!(h > 0.0, "graph {number:012b} has a cycle, h = {h:e}");
                least = if h < least { h } else { least };
            }
        }
        assert_eq!(without, 543, "labelled graphs of four nodes without cycles");
        println!("α = {alpha}: least h of a graph with a cycle {least}");
    }
}

#[test]
fn weak_long_cycles_are_not_lost() {
    // a cycle of four edges of weight a: 4·a⁸ at α = 1, far below the rounding of tr((I + H)⁴) ≈ 4
    for a in [1.0, 0.5, 0.1, 1e-3, 1e-6] {
        let mut ring = vec![0.0; 16];
        for at in [1, 6, 11, 12] {
            ring[at] = a;
        }
        let a2 = a * a;
        let expected = 4.0 * (a2 * a2) * (a2 * a2);
        let h = acyclic::forward(&ring, 4, 1.0).0;
        assert!((h / expected - 1.0).abs() < 1e-14, "a = {a}: {h:e} for {expected:e}");
    }
}
