//! The edges of a drawing: where they begin, bend and end.

/// Width of the drawing.
pub(super) const W: f64 = 480.0;
/// Height of a level.
pub(super) const LEVEL: f64 = 118.0;
/// Width and height of a factor.
pub(super) const NODE: [f64; 2] = [136.0, 38.0];
/// An edge that is drawn.
pub(super) struct Edge {
    pub(super) ends: [usize; 2],
    pub(super) p: f64,
    pub(super) is_kept: bool,
    pub(super) is_true: bool,
}

impl Edge {
    /// Width of its line.
    pub(super) fn width(&self) -> f64 {
        1.2 + 5.8 * crate::num::order::clamp(self.p, 0.0, 1.0)
    }
}

/// Where an edge begins, where it ends, and the point that bends it.
pub(super) struct Course {
    pub(super) from: [f64; 2],
    pub(super) to: [f64; 2],
    pub(super) mid: [f64; 2],
}

impl Course {
    /// The point at a share t of the curve.
    pub(super) fn at(&self, t: f64) -> [f64; 2] {
        let weights = [(1.0 - t) * (1.0 - t), 2.0 * t * (1.0 - t), t * t];
        [0, 1].map(|k| weights[0] * self.from[k] + weights[1] * self.mid[k] + weights[2] * self.to[k])
    }

    /// The direction of the curve at t, of length 1.
    pub(super) fn direction(&self, t: f64) -> [f64; 2] {
        let [dx, dy] =
            [0, 1].map(|k| (1.0 - t) * (self.mid[k] - self.from[k]) + t * (self.to[k] - self.mid[k]));
        let length = crate::num::order::max((dx * dx + dy * dy).sqrt(), 1e-6);
        [dx / length, dy / length]
    }

    /// Between the middles of two factors; `levels` are the middles of all factors, if they are drawn by level.
    pub(super) fn new(from: [f64; 2], to: [f64; 2], levels: Option<&[[f64; 2]]>) -> Self {
        levels.map_or_else(|| Self::across(from, to), |nodes| Self::by_level(from, to, nodes))
    }

    /// From border to border, bent to its right, so that it does not cover the opposite edge.
    fn across(a: [f64; 2], b: [f64; 2]) -> Self {
        let [dx, dy] = [b[0] - a[0], b[1] - a[1]];
        let reach = |half: f64, d: f64| half / crate::num::order::max(d.abs(), 1e-6);
        let t = crate::num::order::min(reach(NODE[0] * 0.5, dx), reach(NODE[1] * 0.5, dy));
        let length = crate::num::order::max((dx * dx + dy * dy).sqrt(), 1e-6);
        let bend = 26.0 / length;
        let aside = [-dy * bend, dx * bend];
        let shift =
            |p: [f64; 2], s: f64| [p[0] + s * t * dx + 0.3 * aside[0], p[1] + s * t * dy + 0.3 * aside[1]];
        let (from, to) = (shift(a, 1.0), shift(b, -1.0));
        Self { from, to, mid: [0, 1].map(|k| (from[k] + to[k]) * 0.5 + aside[k]) }
    }

    /// From the lower side of a factor to the upper side of one below it; an edge of one level is an arc above or below it. One that would
    /// cover a factor passes beside it.
    fn by_level(from: [f64; 2], to: [f64; 2], nodes: &[[f64; 2]]) -> Self {
        let half = NODE[1] * 0.5;
        let (down, same) = (to[1] > from[1], to[1] == from[1]);
        // To the right above the level, to the left below it.
        let over = if from[0] < to[0] { 1.0 } else { -1.0 };
        let (y0, y1) = match (down, same) {
            (true, _) => (from[1] + half, to[1] - half),
            (_, true) => (from[1] - over * half, to[1] - over * half),
            _ => (from[1] - half, to[1] + half),
        };
        let steps = (to[1] - from[1]).abs() / LEVEL;
        let outside = if from[0] < W * 0.5 { -1.0 } else { 1.0 };
        let bend = match (down, same) {
            (true, _) if steps < 1.5 => [0.0, 0.0],
            (_, true) => [0.0, -44.0 * over],
            _ => [outside * 70.0, 0.0],
        };
        let mid = [(from[0] + to[0]) * 0.5 + bend[0], (y0 + y1) * 0.5 + bend[1]];
        let across = Self { from: [from[0], y0], to: [to[0], y1], mid };
        // Down on the right, up on the left, the farther out the longer.
        let beside = |side: f64| {
            let [x0, x1] = [from, to].map(|end| end[0] + side * NODE[0] * 0.5);
            let x = side * crate::num::order::max(side * x0, side * x1) + side * (12.0 + 40.0 * steps);
            Self { from: [x0, from[1]], to: [x1, to[1]], mid: [x, (from[1] + to[1]) * 0.5] }
        };
        let first = if down { 1.0 } else { -1.0 };
        let all = [across, beside(first), beside(-first)];
        let others = nodes.iter().filter(|&&node| node != from && node != to);
        let others: Vec<[f64; 2]> = others.copied().collect();
        all.into_iter().min_by_key(|course| course.covered(&others)).expect("three of them")
    }

    /// How many points of the curve are on factors.
    fn covered(&self, nodes: &[[f64; 2]]) -> usize {
        const POINTS: usize = 24;
        let is_on = |at: [f64; 2], node: &[f64; 2]| (0..2).all(|k| (at[k] - node[k]).abs() < NODE[k] * 0.5);
        let is_covered = |at: [f64; 2]| nodes.iter().any(|node| is_on(at, node));
        (0..=POINTS).filter(|&i| is_covered(self.at(i as f64 / POINTS as f64))).count()
    }
}
