//! The cells in which rays take samples during a fit.
//!
//! The grid is filled by the conservative rule every sixteen iterations once 1/β is large enough for most of the
//! box to be empty; before that, rays take all steps. The bound of the rule holds at the iterations that fill it: until the
//! next fill the surface moves, and a learned β may grow, so that a step that counts may be missing for some
//! iterations.

use super::scene::{self, Weights};
use crate::Result;
use crate::field::occupancy::{Learned, Occupancy, Rule, Settings, fill};
use crate::field::render::{Intervals, Rays};
use crate::geometry::bit_grid::BitGrid;
use crate::num::array::Arrays;
use crate::scene::field::Field;
use crate::{Error, num::array::Array};

/// Iterations between fills.
const EVERY: usize = 16;
/// 1/β from which a grid is used.
const SHARP: f32 = 30.0;
/// Cells per axis during a fit.
const SIDE: usize = 64;

/// Fills a grid for a field.
///
/// # Errors
/// When a value of the field is not finite.
pub fn filled(field: &Field, side: usize) -> Result<Occupancy> {
    let weights = Weights::of(field);
    let learned = Learned::new(scene::planes(field), scene::combine(field), &weights.sdf())?;
    let s = &field.settings;
    let settings = Settings::new(s.half_size, s.samples, s.beta());
    fill(&learned, &Settings { side, rule: Rule::Conservative, ..settings })
}

/// The grid of a fit.
#[derive(Clone, Debug, Default)]
pub(super) struct Occupied(Option<Occupancy>);

impl Occupied {
    /// Fills the grid again where that is due.
    pub(super) fn refill(&mut self, field: &Field, iteration: usize, has_grown: bool) -> Result<()> {
        if field.settings.inverse_beta < SHARP {
            self.0 = None;
        } else if iteration.is_multiple_of(EVERY) || has_grown || self.0.is_none() {
            self.0 = Some(filled(field, SIDE)?);
        }
        Ok(())
    }

    /// Returns the steps of rays that take samples.
    pub(super) fn intervals(&self, rays: Rays<'_>, half_size: f32, step: f32) -> Intervals {
        match &self.0 {
            Some(cells) => cells.intervals(rays, step),
            None => Intervals::all(rays, half_size, step),
        }
    }

    /// Writes the bits: a byte per cell, no bytes without a grid.
    pub(super) fn save(&self, out: &mut Arrays) {
        let bytes = self.0.as_ref().map_or(Vec::new(), |cells| {
            each_cell().map(|cell| u8::from(cells.grid.is_set(cell))).collect::<Vec<u8>>()
        });
        out.put("occupied", &[bytes.len()], bytes);
    }

    /// Reads the bits.
    ///
    /// # Errors
    /// Another number of cells.
    pub(super) fn load(from: &Arrays, half_size: f32) -> Result<Self> {
        let stored = from.need("occupied")?;
        if stored.is_empty() {
            return Ok(Self(None));
        }
        let bits = stored.to_i64().filter(|bits| bits.len() == SIDE * SIDE * SIDE).ok_or_else(|| {
            let e = Error::input("array 'occupied'").expected(format!("{SIDE}³ bytes, or none"));
            e.got(format!("{} values", Array::len(stored)))
        })?;
        let mut grid = BitGrid::new(SIDE, half_size)?;
        for (cell, _) in each_cell().zip(bits).filter(|(_, bit)| *bit != 0) {
            grid.set(cell, cell.map(|i| i + 1));
        }
        Ok(Self(Some(Occupancy::new(grid, Rule::Conservative))))
    }
}

fn each_cell() -> impl Iterator<Item = [usize; 3]> {
    (0..SIDE * SIDE * SIDE).map(|i| [i / (SIDE * SIDE), i / SIDE % SIDE, i % SIDE])
}
