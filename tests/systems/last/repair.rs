//! Any probabilities of edges become a graph without cycles, and one without cycles stays as it is.

use super::models::uniforms;
use lastlight::causal::acyclic;
use lastlight::causal::repair::repair;
use lastlight::math::digraph::Digraph;

#[test]
fn every_random_matrix_becomes_a_graph_without_cycles() {
    let (mut cyclic, mut most) = (0, 0);
    for draw in 0..5000 {
        let n = 2 + draw as usize % 9;
        let p = uniforms(9, draw, 0, n * n);
        let (graph, deleted) = repair(n, &p, 0.5);
        assert_eq!(acyclic::forward(&graph.adjacency(), n, 1.0).0.to_bits(), 0, "draw {draw}: h = 0");
        let order = graph.order().expect("no cycle");
        let place = |node: usize| order.iter().position(|other| *other == node);
        assert!(
            graph.edges().into_iter().all(|(i, j)| place(i) < place(j)),
            "draw {draw}: parents come first"
        );
        assert!(
            graph.edges().into_iter().all(|(i, j)| p[i * n + j] > 0.5),
            "draw {draw}: only probable edges"
        );
        assert!(deleted.iter().all(|d| d.strength > 0.5), "draw {draw}: only probable edges were there");
        // an edge was on a cycle when it went, so it closes one with what is left and what went after it
        for (turn, edge) in deleted.iter().enumerate() {
            let mut then = graph.clone();
            deleted[turn..].iter().for_each(|d| then.set(d.parent, d.child, true));
            assert!(then.reaches(edge.child, edge.parent), "draw {draw}: {edge:?} was on no cycle");
        }
        cyclic += usize::from(!deleted.is_empty());
        most = Ord::max(most, deleted.len());
    }
    println!("{cyclic} of 5000 had cycles; at most {most} edges deleted");
    assert!(cyclic > 2000, "most of the matrices have cycles: {cyclic}");
}

#[test]
fn graphs_without_cycles_are_unchanged() {
    let places: Vec<usize> = (0..16).filter(|at| at / 4 != at % 4).collect();
    for number in 0..1_u32 << places.len() {
        let mut p = vec![0.0; 16];
        for (bit, at) in places.iter().enumerate() {
            p[*at] = if number >> bit & 1 == 1 { 0.51 + 0.04 * bit as f64 } else { 0.5 - 0.04 * bit as f64 };
        }
        let probable = Digraph::from_weights(&p, 4, 0.5);
        let (graph, deleted) = repair(4, &p, 0.5);
        if probable.is_acyclic() {
            assert!(graph == probable && deleted.is_empty(), "graph {number:012b} had no cycle");
        } else {
            assert!(graph.is_acyclic() && !deleted.is_empty(), "graph {number:012b} had a cycle");
        }
    }
}
