//! Places of the probabilities beside their edges: where a label covers no factor, no other label and, if possible, no edge.

use super::course::{Course, Edge, NODE};

/// Half width and half height of a label of four characters, with a little space around it.
const HALF: [f64; 2] = [17.0, 9.0];
/// Shares of a curve at which its label may be, the best first.
const SHARES: [f64; 9] = [0.5, 0.42, 0.58, 0.34, 0.66, 0.27, 0.73, 0.2, 0.8];
/// Points of a curve that labels avoid.
const SAMPLES: usize = 24;

/// Whether two boxes with these middles overlap; `reach` is the sum of their half sizes.
fn overlap(a: [f64; 2], b: [f64; 2], reach: [f64; 2]) -> bool {
    (a[0] - b[0]).abs() < reach[0] && (a[1] - b[1]).abs() < reach[1]
}

/// How far the edge of a box is from its middle in a direction of length 1.
fn extent(direction: [f64; 2]) -> f64 {
    HALF[0] * direction[0].abs() + HALF[1] * direction[1].abs()
}

/// Middle of the label of each edge, in a drawing of this size. `nodes` are the middles of the factors.
pub(super) fn places(
    edges: &[Edge],
    courses: &[Course],
    nodes: &[[f64; 2]],
    size: [f64; 2],
) -> Vec<[f64; 2]> {
    let mut placed: Vec<[f64; 2]> = Vec::new();
    for (edge, course) in edges.iter().zip(courses) {
        // Its own edge counts like any other.
        let cost = |at: [f64; 2]| {
            let outside = (0..2).any(|k| at[k] < HALF[k] || at[k] > size[k] - HALF[k]);
            let on_node =
                nodes.iter().any(|&node| overlap(at, node, [0, 1].map(|k| HALF[k] + NODE[k] * 0.5)));
            let on_label = placed.iter().any(|&other| overlap(at, other, HALF.map(|h| 2.0 * h)));
            let crossed = |i: usize| {
                let reach = HALF.map(|h| h + edges[i].width() * 0.5 - 3.0);
                (0..=SAMPLES).any(|s| overlap(at, courses[i].at(s as f64 / SAMPLES as f64), reach))
            };
            let lines = (0..edges.len()).filter(|&i| crossed(i)).count();
            100 * (usize::from(outside) + usize::from(on_node) + usize::from(on_label)) + lines
        };
        let candidates = SHARES.into_iter().flat_map(|t| {
            let [ux, uy] = course.direction(t);
            // To the right of the drawing first, or above an edge that runs across it.
            let normal =
                if uy.abs() > 0.35 { [uy.abs(), -ux * uy.signum()] } else { [uy * ux.signum(), -ux.abs()] };
            let far = extent(normal) + edge.width() * 0.5;
            let middle = course.at(t);
            [far, -far, far + 9.0, -far - 9.0].map(|far| [0, 1].map(|k| middle[k] + far * normal[k]))
        });
        let best = candidates.enumerate().min_by_key(|&(rank, at)| (cost(at), rank));
        placed.push(best.expect("there are candidates").1);
    }
    placed
}
