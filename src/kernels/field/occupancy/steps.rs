//! The steps of a ray that meet occupied cells.
//!
//! The tree over bricks proposes: each brick that the ray meets gives a range of steps, in the order of (enter,
//! brick), and each step of a range is tested once by the bits of its own cells. The result is that of testing
//! every step of the ray, because every step that passes the test is in a range:
//!
//! * The points of a step are computed as o + t·d and are off the exact line by at most 2u(‖o‖ + t), u = 2⁻²⁴,
//!   per coordinate. Boxes of bricks are moved outward by 2⁻²⁰(largest |o| + t₁), eight times as much.
//! * Under the conservative rule a step has all cells in the range between those of its ends, also such that it
//!   does not touch. Their points are within h·|d| of its beginning, axis by axis; boxes are moved outward by
//!   h·|d| more.
//! * Distances are off by a few units in the last place. Ranges are widened by 1 + 2⁻²⁰t₁/h steps at both ends.

use super::cells::Occupancy;
use super::rule::Rule;
use crate::field::render::{Intervals, Rays};
use crate::geometry::bricks::{Crossing, Path};
use crate::num::order;
use std::cell::Cell;
use std::ops::Range;

/// 2⁻²⁰.
const OUTWARD: f32 = 1.0 / 1_048_576.0;

thread_local! {
    static FOUND: Cell<Vec<Crossing>> = const { Cell::new(Vec::new()) };
}

/// The steps of a ray.
#[derive(Clone, Copy, Debug)]
struct Steps<'a> {
    rays: Rays<'a>,
    ray: usize,
    span: [f32; 2],
    step: f32,
}

impl Steps<'_> {
    /// Returns the distances at which a step begins and ends: those of [`Intervals::ends`].
    #[inline(always)]
    fn ends(&self, i: u32) -> [f32; 2] {
        let (i, [enter, leave]) = (i as f32, self.span);
        [enter + i * self.step, order::min(enter + (i + 1.0) * self.step, leave)]
    }
}

impl Occupancy {
    /// Returns the steps of all rays that meet occupied cells.
    pub fn intervals(&self, rays: Rays<'_>, step: f32) -> Intervals {
        let keep = |ray: usize, span: [f32; 2], all: Range<u32>| self.keep(rays, ray, span, step, all);
        Intervals::kept(rays, self.grid.half_size(), step, keep)
    }

    /// Returns the steps of one ray, ascending, that meet occupied cells, out of `all`.
    fn keep(&self, rays: Rays<'_>, ray: usize, span: [f32; 2], step: f32, all: Range<u32>) -> Vec<u32> {
        let steps = Steps { rays, ray, span, step };
        let (origin, direction) = (rays.origins[ray], rays.directions[ray]);
        let farthest = origin.iter().fold(span[1], |most, o| order::max(most, o.abs()));
        let reach = match self.rule {
            Rule::Published => 0.0,
            Rule::Conservative => step,
        };
        let margin = direction.map(|d| 2.0 * OUTWARD * farthest + reach * d.abs());
        let path = Path { origin, direction, span, margin };
        let mut found = FOUND.take();
        self.bricks.along(&path, &mut found);
        let slack = 1 + (OUTWARD * farthest / step) as u32;
        let (mut kept, mut next) = (Vec::new(), all.start);
        for crossing in &found {
            // Conversions limit: both numbers are not negative.
            let first = (((crossing.enter - span[0]) / step) as u32).saturating_sub(slack);
            let last = (((crossing.leave - span[0]) / step) as u32).saturating_add(slack);
            let from = Ord::max(next, first);
            let to = Ord::min(all.end, last.saturating_add(1));
            kept.extend((from..to).filter(|i| self.is_kept(&steps, *i)));
            next = Ord::max(next, to);
        }
        FOUND.set(found);
        kept
    }

    /// Whether a step meets occupied cells.
    #[inline(always)]
    fn is_kept(&self, steps: &Steps<'_>, i: u32) -> bool {
        let [begin, end] = steps.ends(i);
        let cell = |t: f32| self.grid.cell(steps.rays.at(steps.ray, t));
        match self.rule {
            Rule::Published => self.grid.is_set(cell(begin + 0.5 * (end - begin))),
            Rule::Conservative => {
                let (a, b) = (cell(begin), cell(end));
                let low = std::array::from_fn(|k| Ord::min(a[k], b[k]));
                let high = std::array::from_fn(|k| Ord::max(a[k], b[k]));
                self.grid.is_any_set(low, high)
            }
        }
    }
}
