//! The occupied cells of a box.

use super::rule::Rule;
use crate::geometry::bit_grid::BitGrid;
use crate::geometry::bricks::Bricks;

/// What filling took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cost {
    /// Points at which s was computed.
    pub values: usize,
    /// Boxes whose bounds were computed.
    pub bounds: usize,
}

/// The cells of a box that can have density.
#[derive(Clone, Debug)]
pub struct Occupancy {
    /// A bit per cell.
    pub grid: BitGrid,
    /// The bricks of the grid that have a bit.
    pub bricks: Bricks,
    /// The rule that filled the grid.
    pub rule: Rule,
    /// What filling took.
    pub cost: Cost,
}

impl Occupancy {
    /// Returns the occupancy that a grid of bits describes.
    pub fn new(grid: BitGrid, rule: Rule) -> Self {
        let bricks = Bricks::new(&grid);
        Self { grid, bricks, rule, cost: Cost::default() }
    }

    /// Returns the occupied fraction of the cells.
    pub fn fraction(&self) -> f64 {
        let n = self.grid.side() as f64;
        self.grid.count() as f64 / (n * n * n)
    }
}
