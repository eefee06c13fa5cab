//! One optimiser per parameter array of a set of Gaussians, and their learning rates.
//!
//! SH coefficients are one array (N, K, 3) with one state; the rate of its first three columns (the constant
//! band) differs from the rest.

use super::adam::{Adam, Rule};
use super::schedule::{LogLinear, scaled};
use crate::num::array::Arrays;
use crate::scene::columns::Column;
use crate::scene::gaussians::Gaussians;
use crate::{Error, Result};

/// Learning rates of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// Rate of the means in scene units: the published rate times the extent of the scene.
    pub means: f64,
    /// Quaternions.
    pub quats: f64,
    /// Logarithms of the standard deviations.
    pub scales_log: f64,
    /// Opacity logits.
    pub opacity_logits: f64,
    /// Constant SH band.
    pub sh_dc: f64,
    /// Higher SH bands.
    pub sh_rest: f64,
}

impl Rates {
    /// Rates of 3DGS with the mean's rate already multiplied by the extent; see [`means_schedule`].
    pub fn splat(means: f64) -> Self {
        Self {
            means,
            quats: 1e-3,
            scales_log: 5e-3,
            opacity_logits: 0.05,
            sh_dc: 2.5e-3,
            sh_rest: 2.5e-3 / 20.0,
        }
    }

    /// Rates of a column: of the first three entries of a row, and of the rest.
    pub fn of(&self, column: Column) -> [f64; 2] {
        match column {
            Column::Means => [self.means; 2],
            Column::Quats => [self.quats; 2],
            Column::ScalesLog => [self.scales_log; 2],
            Column::OpacityLogits => [self.opacity_logits; 2],
            Column::Sh => [self.sh_dc, self.sh_rest],
        }
    }
}

/// Rate of the means in 3DGS: 1.6e-4·extent → 1.6e-6·extent over the whole run.
///
/// # Errors
/// An extent that is not positive: with a single camera it would be 0; use 1 then.
pub fn means_schedule(extent: f64, iterations: u32) -> Result<LogLinear> {
    if !(extent > 0.0 && extent.is_finite()) {
        return Err(Error::input("scene extent")
            .expected("a positive length")
            .got(extent.to_string())
            .hint("the extent of a single camera is 0: use 1"));
    }
    LogLinear::new(1.6e-4 * extent, 1.6e-6 * extent, scaled(30_000, iterations))
}

/// Optimiser states of all columns of a set of Gaussians, in the order of [`Column::ALL`].
#[derive(Clone, Debug)]
pub struct Groups([Adam; 5]);

impl Groups {
    /// Zero states for `g`.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn new(rule: Rule, g: &Gaussians) -> Result<Self> {
        Self::of_columns(|column| Adam::new(rule, g.len(), g.width(column)))
    }

    fn of_columns(state: impl FnMut(Column) -> Result<Adam>) -> Result<Self> {
        let states: Vec<Adam> = Column::ALL.into_iter().map(state).collect::<Result<_>>()?;
        Ok(Self(states.try_into().expect("one state per column")))
    }

    /// The state of a column.
    pub fn of(&self, column: Column) -> &Adam {
        &self.0[column as usize]
    }

    /// The state of a column, mutable.
    pub fn of_mut(&mut self, column: Column) -> &mut Adam {
        &mut self.0[column as usize]
    }

    /// Columns and their states.
    pub fn all(&self) -> impl Iterator<Item = (Column, &Adam)> {
        Column::ALL.into_iter().zip(&self.0)
    }

    /// One step. `grad` holds the gradient by each stored parameter in the array of the same name.
    ///
    /// # Errors
    /// A result that is not finite; the error names the array.
    pub fn step(
        &mut self,
        g: &mut Gaussians,
        grad: &Gaussians,
        rates: &Rates,
        active: Option<&[u8]>,
    ) -> Result<()> {
        for (adam, (column, param)) in self.0.iter_mut().zip(g.columns_mut()) {
            let [first, rest] = rates.of(column);
            let mut columns = vec![rest; adam.width()];
            columns.iter_mut().take(3).for_each(|rate| *rate = first);
            adam.step(param, grad.column(column), &columns, active)
                .map_err(|e| e.within(format!("optimiser of {}", column.name())))?;
        }
        Ok(())
    }

    /// Zeroes the states of the rows where `which` holds.
    pub fn reset_rows(&mut self, which: impl Fn(usize) -> bool) {
        self.0.iter_mut().for_each(|adam| adam.reset_rows(&which));
    }

    /// Keeps the rows where `keep` is true, in their order.
    pub fn keep_rows(&mut self, keep: &[bool]) {
        self.0.iter_mut().for_each(|adam| adam.keep_rows(keep));
    }

    /// Appends rows with zero states.
    pub fn append(&mut self, rows: usize) {
        self.0.iter_mut().for_each(|adam| adam.append(rows));
    }

    /// Writes all states as `NAME.ARRAY.m`, `.v`, `.steps`.
    pub fn save(&self, name: &str, to: &mut Arrays) {
        self.all().for_each(|(column, adam)| adam.save(&format!("{name}.{}", column.name()), to));
    }

    /// Reads arrays written by [`Self::save`], for the Gaussians `g`.
    ///
    /// # Errors
    /// Missing arrays, shapes that do not match `g`, numbers out of range.
    pub fn load(rule: Rule, name: &str, from: &Arrays, g: &Gaussians) -> Result<Self> {
        Self::of_columns(|column| {
            let name = format!("{name}.{}", column.name());
            Adam::load_sized(rule, &name, from, [g.len(), g.width(column)])
        })
    }
}

/// Rotation matrix of a quaternion wxyz of any length but zero, in f64.
pub(super) fn rotation(q: [f32; 4]) -> [[f64; 3]; 3] {
    let q = q.map(f64::from);
    let length = (((q[0] * q[0] + q[1] * q[1]) + q[2] * q[2]) + q[3] * q[3]).sqrt();
    let [w, x, y, z] = q.map(|v| v / length);
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// Purposes of the random draws of this folder (`num::rng`), one for each use.
pub mod purpose {
    /// Positions of the halves of a split; item = row before the refinement, step = iteration, draw = 3·half
    /// + axis.
    pub const SPLIT: u16 = 0x0801;
    /// Source of a relocated Gaussian; item = row of the dead one, step = iteration, draw 0.
    pub const RELOCATE: u16 = 0x0802;
    /// Source of an added Gaussian; item = its row, step = iteration, draw 0.
    pub const GROW: u16 = 0x0803;
    /// Noise on the means; item = row, step = iteration, draw = axis.
    pub const NOISE: u16 = 0x0804;
}
