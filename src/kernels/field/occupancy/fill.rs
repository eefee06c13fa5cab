//! Fills the grid, coarse to fine.
//!
//! Blocks of cells begin as the octants of the box and are split into halves along each axis. A block is
//! decided if its bounds prove that all of its cells are removed, or that all are occupied; the bounds are
//! those of the box around the middles of its cells (published rule) or around the cells themselves
//! (conservative rule). Published: the cells of undecided blocks of up to [`FEW`] cells are decided by s at
//! their middles. Conservative: a cell is removed if the bounds of a block that contains it, or its own, prove
//! that it is.
//!
//! # The same cells as without leaving anything out
//! * Published: α computed in f32 has a relative error below 2⁻¹⁷ (|s|/β ≤ 88 is rounded once before the
//!   exponential; further roundings are some units in the last place), and the exact α falls with s. A block is
//!   removed if α of its lower bound is below τ(1 − 2⁻¹⁶), occupied if α of its upper bound is at least τ(1 +
//!   2⁻¹⁶): then α computed at every middle is on the same side of τ.
//! * Conservative: a block is occupied if its upper bound is not above the limit. No lower bound of a box that
//!   meets the block exceeds that, so none of its cells would be removed further down.

use super::bounded::{Bounded, Box3};
use super::cells::{Cost, Occupancy};
use super::rule::{Rule, Settings, THRESHOLD, Verdict};
use crate::Result;
use crate::geometry::bit_grid::BitGrid;
use crate::num::par;

/// Number of cells up to which an undecided block is decided cell by cell.
const FEW: usize = 8;
/// Blocks per task.
const BLOCKS: usize = 128;
/// Points per task.
const POINTS: usize = 1024;

/// Cells `from` to `to`, the latter excluded.
#[derive(Clone, Copy, Debug)]
struct Block {
    from: [usize; 3],
    to: [usize; 3],
    /// Whether a block that contains it is removed.
    is_removed: bool,
}

impl Block {
    fn cells(&self) -> impl Iterator<Item = [usize; 3]> + use<> {
        let Self { from, to, .. } = *self;
        let rows = (from[0]..to[0]).flat_map(move |x| (from[1]..to[1]).map(move |y| [x, y]));
        rows.flat_map(move |[x, y]| (from[2]..to[2]).map(move |z| [x, y, z]))
    }

    fn count(&self) -> usize {
        (0..3).fold(1, |n, k| n * (self.to[k] - self.from[k]))
    }

    /// Returns the halves of the block along each axis that has more than one cell.
    fn split(&self) -> impl Iterator<Item = Self> + use<> {
        let Self { from, to, .. } = *self;
        let is_removed = self.is_removed;
        let cut: [usize; 3] = std::array::from_fn(|k| usize::midpoint(from[k], to[k] + 1));
        (0..8_usize).filter_map(move |part| {
            let is_upper = |k: usize| part >> (2 - k) & 1 == 1;
            let low = std::array::from_fn(|k| if is_upper(k) { cut[k] } else { from[k] });
            let high = std::array::from_fn(|k| if is_upper(k) { to[k] } else { cut[k] });
            (0..3).all(|k| low[k] < high[k]).then_some(Self { from: low, to: high, is_removed })
        })
    }

    /// Returns the box that the rule bounds.
    fn extent(&self, grid: &BitGrid, rule: Rule) -> Box3 {
        match rule {
            Rule::Published => [grid.centre(self.from), grid.centre(self.to.map(|i| i - 1))],
            Rule::Conservative => grid.edges(self.from, self.to),
        }
    }
}

/// Fills a grid.
///
/// # Errors
/// Returns an error if a setting is out of its range.
pub fn fill(sdf: &impl Bounded, settings: &Settings) -> Result<Occupancy> {
    filled(sdf, settings, true)
}

/// Fills a grid without leaving anything out: s at the middle of every cell, or the bounds of every block
/// of the subdivision. The same cells as [`fill`].
///
/// # Errors
/// Returns an error if a setting is out of its range.
pub fn fill_all(sdf: &impl Bounded, settings: &Settings) -> Result<Occupancy> {
    filled(sdf, settings, false)
}

fn filled(sdf: &impl Bounded, settings: &Settings, is_short: bool) -> Result<Occupancy> {
    settings.validate()?;
    let mut grid = BitGrid::new(settings.side, settings.half_size)?;
    let mut cost = Cost::default();
    let whole = Block { from: [0; 3], to: [settings.side; 3], is_removed: false };
    let mut single = Vec::new();
    let mut open: Vec<Block> = whole.split().collect();
    if settings.rule == Rule::Published && !is_short {
        single.append(&mut open);
    }
    while !open.is_empty() {
        cost.bounds += open.len();
        let verdicts = bounded(sdf, settings, &grid, &open);
        let mut next = Vec::new();
        for (block, verdict) in open.iter().zip(verdicts) {
            let is_cell = block.count() == 1;
            match (settings.rule, verdict) {
                (_, Verdict::Removed) if is_short => {}
                (_, Verdict::Occupied) if is_short => grid.set(block.from, block.to),
                (Rule::Published, _) if block.count() <= FEW => single.push(*block),
                (Rule::Conservative, _) if is_cell => {
                    if !block.is_removed && verdict != Verdict::Removed {
                        grid.set(block.from, block.to);
                    }
                }
                _ => {
                    let is_removed = block.is_removed || verdict == Verdict::Removed;
                    next.extend(Block { is_removed, ..*block }.split());
                }
            }
        }
        open = next;
    }
    let cells: Vec<[usize; 3]> = single.iter().flat_map(Block::cells).collect();
    cost.values += cells.len();
    one_by_one(sdf, settings, &cells, &mut grid);
    Ok(Occupancy { cost, ..Occupancy::new(grid, settings.rule) })
}

/// Returns what the bounds of blocks prove.
fn bounded(sdf: &impl Bounded, settings: &Settings, grid: &BitGrid, blocks: &[Block]) -> Vec<Verdict> {
    let limit = settings.limit();
    let verdicts = par::map(blocks.len().div_ceil(BLOCKS), |c| {
        let here = &blocks[c * BLOCKS..Ord::min((c + 1) * BLOCKS, blocks.len())];
        let boxes: Vec<Box3> = here.iter().map(|b| b.extent(grid, settings.rule)).collect();
        let mut bounds = Vec::new();
        sdf.bounds(&boxes, &mut bounds);
        bounds.into_iter().map(|b| settings.verdict(b, limit)).collect::<Vec<_>>()
    });
    verdicts.into_iter().flatten().collect()
}

/// Decides cells by s at their middles.
fn one_by_one(sdf: &impl Bounded, settings: &Settings, cells: &[[usize; 3]], grid: &mut BitGrid) {
    let fixed = &*grid;
    let kept = par::map(cells.len().div_ceil(POINTS), |c| {
        let cells = &cells[c * POINTS..Ord::min((c + 1) * POINTS, cells.len())];
        let middles: Vec<[f32; 3]> = cells.iter().map(|cell| fixed.centre(*cell)).collect();
        let mut s = Vec::new();
        sdf.values(&middles, &mut s);
        // α that is not a number keeps the cell.
        s.into_iter().map(|s| !(settings.alpha(s) < THRESHOLD)).collect::<Vec<_>>()
    });
    for (cell, is_kept) in cells.iter().zip(kept.into_iter().flatten()) {
        if is_kept {
            grid.set(*cell, cell.map(|i| i + 1));
        }
    }
}
