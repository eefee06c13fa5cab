//! A causal graph as inline SVG: factors by level, edges as wide as they are probable, true edges outlined.

mod course;
mod labels;

use course::{Course, Edge, LEVEL, NODE, W};
use maud::{Markup, html};

/// Below this probability an edge is drawn only if it is in the graph or true.
const DRAWN_FROM: f64 = 0.05;
/// Most factors of a level that fit beside each other.
const MOST_OF_LEVEL: usize = 3;
/// Half axes of the ellipse of factors that are not drawn by level.
const RING: [f64; 2] = [160.0, 124.0];
/// Free space above the first and below the last level.
const MARGIN: f64 = 26.0;

/// A graph with the probabilities of its edges.
pub(crate) struct Graph<'a> {
    /// what it is, e.g. `before tuning`
    pub(crate) title: &'a str,
    /// of the factors, (n)
    pub(crate) names: &'a [String],
    /// probability of each edge, row to column, (n, n)
    pub(crate) p: &'a [f64],
    /// the edges that are in the graph
    pub(crate) kept: &'a [(usize, usize)],
    /// the true edges, where they are known, (n, n)
    pub(crate) truth: Option<&'a [Vec<bool>]>,
    /// level of each factor, (n); see [`levels`]
    pub(crate) levels: &'a [usize],
}

/// Level of each factor: one more than its highest parent; all 0 if there is a cycle.
pub(crate) fn levels(n: usize, edges: &[(usize, usize)]) -> Vec<usize> {
    let mut level = vec![0; n];
    for _ in 0..n {
        let mut is_done = true;
        for &(i, j) in edges {
            if level[j] <= level[i] {
                level[j] = level[i] + 1;
                is_done = false;
            }
        }
        if is_done {
            return level;
        }
    }
    vec![0; n]
}

impl Graph<'_> {
    fn edges(&self) -> Vec<Edge> {
        let n = self.names.len();
        let edge = |at: usize| {
            let (i, j) = (at / n, at % n);
            let is_true = self.truth.is_some_and(|t| t[i][j]);
            Edge { ends: [i, j], p: self.p[at], is_kept: self.kept.contains(&(i, j)), is_true }
        };
        let all = (0..n * n).filter(|at| at / n != at % n).map(edge);
        all.filter(|e| e.is_kept || e.is_true || e.p >= DRAWN_FROM).collect()
    }

    /// Whether the factors are drawn on an ellipse: if there are no levels, or if one has too many factors.
    fn is_ring(&self) -> bool {
        let count = |level: usize| self.levels.iter().filter(|&&l| l == level).count();
        let widest = self.levels.iter().fold(0, |m, &l| Ord::max(m, count(l)));
        widest > MOST_OF_LEVEL || (widest > 2 && widest == self.names.len())
    }

    /// Middle of each factor.
    fn places(&self) -> Vec<[f64; 2]> {
        if self.is_ring() {
            let n = self.names.len() as f64;
            let place = |i: usize| {
                let angle = std::f64::consts::TAU * (i as f64 / n - 0.25);
                let middle = MARGIN + NODE[1] * 0.5 + RING[1];
                [W * 0.5 + RING[0] * libm::cos(angle), middle + RING[1] * libm::sin(angle)]
            };
            return (0..self.names.len()).map(place).collect();
        }
        let place = |(i, &level): (usize, &usize)| {
            let count = self.levels.iter().filter(|&&l| l == level).count();
            let at = self.levels[..i].iter().filter(|&&l| l == level).count();
            let x = W * (at as f64 + 0.5) / count as f64;
            [x, MARGIN + NODE[1] * 0.5 + level as f64 * LEVEL]
        };
        self.levels.iter().enumerate().map(place).collect()
    }

    fn in_words(&self, edges: &[Edge]) -> String {
        let one = |e: &Edge| {
            let [i, j] = e.ends;
            let state = if e.is_kept { "" } else { ", not in the graph" };
            let truth = if e.is_true { ", true" } else { "" };
            format!("{} to {} with p {:.2}{state}{truth}", self.names[i], self.names[j], e.p)
        };
        let all: Vec<String> = edges.iter().map(one).collect();
        let none = "no edge".to_owned();
        format!("causal graph {}: {}", self.title, if all.is_empty() { none } else { all.join("; ") })
    }

    /// The drawing in a panel.
    pub(crate) fn html(&self) -> Markup {
        let (edges, places) = (self.edges(), self.places());
        let depth = self.levels.iter().fold(0, |m, &l| Ord::max(m, l));
        let is_ring = self.is_ring();
        let course =
            |e: &Edge| Course::new(places[e.ends[0]], places[e.ends[1]], (!is_ring).then_some(&*places));
        let courses: Vec<Course> = edges.iter().map(course).collect();
        let extent = if is_ring { 2.0 * RING[1] } else { depth as f64 * LEVEL };
        let height = 2.0 * MARGIN + NODE[1] + extent;
        html! {
            div.panel {
                h3 { (self.title) }
                svg viewBox={ "0 0 " (W) " " (height) } role="img" aria-label=(self.in_words(&edges)) {
                    @for (e, course) in edges.iter().zip(&courses) { (edge(e, course)) }
                    @for (name, [x, y]) in self.names.iter().zip(&places) {
                        rect x=(x - NODE[0] * 0.5) y=(y - NODE[1] * 0.5) width=(NODE[0]) height=(NODE[1]) rx="9" fill="var(--panel)" stroke="var(--soft)" stroke-width="1.4" {}
                        text.ink x=(x) y=(y + 4.5) text-anchor="middle" { (name) }
                    }
                    @for (e, [x, y]) in edges.iter().zip(labels::places(&edges, &courses, &places, [W, height])) {
                        text x=(format!("{x:.1}")) y=(format!("{:.1}", y + 4.0)) text-anchor="middle" stroke="var(--panel)" stroke-width="3" paint-order="stroke" { (format!("{:.2}", e.p)) }
                    }
                }
            }
        }
    }
}

/// One edge: the outline if it is true, the line, its head.
fn edge(e: &Edge, course: &Course) -> Markup {
    let Course { from, to, mid } = *course;
    let (y0, y1) = (from[1], to[1]);
    let (dx, dy) = (to[0] - mid[0], y1 - mid[1]);
    let length = crate::num::order::max((dx * dx + dy * dy).sqrt(), 1e-6);
    let (ux, uy) = (dx / length, dy / length);
    let width = e.width();
    let head = 12.0 + width;
    let neck = [to[0] - ux * head, y1 - uy * head];
    let wing = 0.52 * head;
    let path = format!("M{:.1} {y0:.1}Q{:.1} {:.1} {:.1} {:.1}", from[0], mid[0], mid[1], neck[0], neck[1]);
    let tip = format!(
        "{:.1},{y1:.1} {:.1},{:.1} {:.1},{:.1}",
        to[0],
        neck[0] - uy * wing,
        neck[1] + ux * wing,
        neck[0] + uy * wing,
        neck[1] - ux * wing
    );
    let color = if e.is_kept { "var(--a)" } else { "var(--faint)" };
    let dash = (!e.is_kept).then_some("5 5");
    html! {
        @if e.is_true { path.truth d=(path) fill="none" stroke="var(--b)" stroke-width=(format!("{:.1}", width + 7.0)) stroke-linecap="round" stroke-opacity="0.55" {} }
        path.edge d=(path) fill="none" stroke=(color) stroke-width=(format!("{width:.2}")) stroke-dasharray=[dash] {}
        polygon points=(tip) fill=(color) {}
    }
}

/// What colours and lines mean.
pub(crate) fn legend(has_truth: bool) -> Markup {
    html! {
        div.legend {
            span { i style="background:var(--a)" {} "in the graph" }
            span { i style="background:var(--faint)" {} "probable, but not in the graph (dashed)" }
            @if has_truth { span { i style="background:var(--b)" {} "outline: edge of the true graph" } }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_edge_is_one_line() {
        let names = ["a", "b", "c", "d"].map(str::to_owned);
        let mut p = vec![0.001; 16];
        let kept = [(0, 1), (1, 2)];
        (p[1], p[6], p[3]) = (1.0, 0.8, 0.2);
        let mut truth = vec![vec![false; 4]; 4];
        (truth[0][1], truth[0][2]) = (true, true);
        let levels = levels(4, &[(0, 1), (1, 2), (0, 2)]);
        assert_eq!(levels, [0, 1, 2, 0], "below all parents");
        let graph =
            Graph { title: "after", names: &names, p: &p, kept: &kept, truth: Some(&truth), levels: &levels };
        let svg = graph.html().into_string();
        assert_eq!(
            svg.matches("class=\"edge\"").count(),
            4,
            "two in the graph, a probable one, a true one: {svg}"
        );
        assert_eq!(svg.matches("class=\"truth\"").count(), 2, "the true edges are outlined");
        assert_eq!(svg.matches("stroke-dasharray").count(), 2, "those that are not in the graph");
        assert!(
            svg.contains("stroke-width=\"7.00\"") && svg.contains("stroke-width=\"5.84\""),
            "width by p: {svg}"
        );
        assert!(
            svg.contains("a to b with p 1.00, true; a to c with p 0.00, not in the graph, true"),
            "{svg}"
        );
        assert!(!svg.contains("NaN"), "finite: {svg}");
    }

    #[test]
    fn factors_without_levels_are_drawn_on_an_ellipse() {
        let names = ["a", "b", "c", "d"].map(str::to_owned);
        let graph =
            Graph { title: "after", names: &names, p: &[0.4; 16], kept: &[], truth: None, levels: &[0; 4] };
        let places = graph.places();
        for (i, p) in places.iter().enumerate() {
            let apart = |q: &[f64; 2]| (p[0] - q[0]).abs() >= NODE[0] || (p[1] - q[1]).abs() >= NODE[1];
            assert!(places[..i].iter().all(apart), "no two overlap: {places:?}");
            assert!(p[0] >= NODE[0] * 0.5 && p[0] <= W - NODE[0] * 0.5, "inside: {p:?}");
        }
        let svg = graph.html().into_string();
        assert_eq!(svg.matches("class=\"edge\"").count(), 12, "both directions of each pair");
    }

    /// Boxes of the texts of a drawing: middle and half size.
    fn texts(svg: &str) -> Vec<([f64; 2], [f64; 2])> {
        let number = |tag: &str, name: &str| -> f64 {
            let rest = tag.split(&format!(" {name}=\"")).nth(1).expect("an attribute");
            rest.split('"').next().expect("its value").parse().expect("a number")
        };
        let label = |tag: &str| ([number(tag, "x"), number(tag, "y") - 4.0], [14.0, 6.0]);
        let node = |tag: &str| {
            let half = NODE.map(|side| side * 0.5);
            ([number(tag, "x") + half[0], number(tag, "y") + half[1]], half)
        };
        let rects = svg.split("<rect").skip(1).map(node);
        rects.chain(svg.split("<text x").skip(1).map(|rest| label(&format!(" x{rest}")))).collect()
    }

    #[test]
    fn no_label_covers_another_or_a_factor() {
        let names = ["posture", "self-occlusion", "wrinkles", "light"].map(str::to_owned);
        let all = [0.6; 16];
        let mut some = [0.01; 16];
        // Down, back up, up over a level, and between factors of one level.
        for (at, p) in
            [(1, 0.99), (2, 0.97), (4, 0.31), (8, 0.2), (12, 0.4), (11, 0.9), (7, 0.5), (6, 0.1), (9, 0.12)]
        {
            some[at] = p;
        }
        let fork: &[(usize, usize)] = &[(0, 1), (0, 2)];
        let chain = [(0, 1), (1, 2), (2, 3)];
        let diamond = [(0, 1), (0, 2), (1, 3), (2, 3)];
        for (p, kept) in [
            (&some, fork),
            (&all, fork),
            (&some, &chain),
            (&all, &chain),
            (&some, &diamond),
            (&all, &diamond),
            (&all, &[]),
        ] {
            let graph =
                Graph { title: "after", names: &names, p, kept, truth: None, levels: &levels(4, kept) };
            let svg = graph.html().into_string();
            let boxes = texts(&svg);
            assert!(boxes.len() > 8, "four factors and their edges: {svg}");
            for (i, (a, half)) in boxes.iter().enumerate() {
                assert!(a[0] >= half[0] && a[0] <= W - half[0] && a[1] >= half[1], "inside: {a:?}");
                for (b, other) in &boxes[..i] {
                    let apart = (0..2).any(|k| (a[k] - b[k]).abs() >= half[k] + other[k]);
                    assert!(apart, "{kept:?}: {a:?} covers {b:?}");
                }
            }
        }
    }

    #[test]
    fn a_cycle_has_one_level() {
        assert_eq!(super::levels(3, &[(0, 1), (1, 0)]), [0, 0, 0], "no order");
        assert_eq!(super::levels(0, &[]), [0_usize; 0], "nothing");
    }
}
