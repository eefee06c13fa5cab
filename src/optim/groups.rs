//! One optimiser per parameter array of a set of Gaussians, and their learning rates.
//!
//! SH coefficients are one array (N, K, 3) with one state; the rate of its first three columns (the constant band) differs
//! from the rest.

use super::adam::{Adam, Rule, retain_rows};
use super::schedule::{LogLinear, scaled};
use crate::num::array::Arrays;
use crate::scene::gaussians::Gaussians;
use crate::{Error, Result};

/// Learning rates of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// Scene units: the published rate times the extent of the scene.
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
}

/// Rate of the means in 3DGS: 1.6e-4·extent → 1.6e-6·extent over the whole run.
///
/// # Errors
/// An extent that is not positive: with a single camera it would be 0; take 1 there.
pub fn means_schedule(extent: f64, iterations: u32) -> Result<LogLinear> {
    if !(extent > 0.0 && extent.is_finite()) {
        return Err(Error::input("scene extent")
            .expected("a positive length")
            .got(extent.to_string())
            .hint("a single camera spans nothing: use 1"));
    }
    LogLinear::new(1.6e-4 * extent, 1.6e-6 * extent, scaled(30_000, iterations))
}

/// Optimiser states of all arrays of a set of Gaussians.
#[derive(Clone, Debug)]
pub struct Groups {
    /// (N, 3)
    pub means: Adam,
    /// (N, 4)
    pub quats: Adam,
    /// (N, 3)
    pub scales_log: Adam,
    /// (N, 1)
    pub opacity_logits: Adam,
    /// (N, 3 K)
    pub sh: Adam,
}

impl Groups {
    /// Zero states for `g`.
    ///
    /// # Errors
    /// A setting outside its range.
    pub fn new(rule: Rule, g: &Gaussians) -> Result<Self> {
        let n = g.len();
        Ok(Self {
            means: Adam::new(rule, n, 3)?,
            quats: Adam::new(rule, n, 4)?,
            scales_log: Adam::new(rule, n, 3)?,
            opacity_logits: Adam::new(rule, n, 1)?,
            sh: Adam::new(rule, n, 3 * g.sh_coefficients())?,
        })
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
        let named = |name: &'static str| move |e: Error| e.within(format!("optimiser of {name}"));
        let (means, quats) = (g.means.as_flattened_mut(), g.quats.as_flattened_mut());
        self.means.step(means, grad.means.as_flattened(), &[rates.means], active).map_err(named("means"))?;
        self.quats.step(quats, grad.quats.as_flattened(), &[rates.quats], active).map_err(named("quats"))?;
        let scales = g.scales_log.as_flattened_mut();
        self.scales_log
            .step(scales, grad.scales_log.as_flattened(), &[rates.scales_log], active)
            .map_err(named("scales_log"))?;
        self.opacity_logits
            .step(&mut g.opacity_logits, &grad.opacity_logits, &[rates.opacity_logits], active)
            .map_err(named("opacity_logits"))?;
        let mut sh = vec![rates.sh_rest; self.sh.width()];
        sh[..3].fill(rates.sh_dc);
        self.sh.step(&mut g.sh, &grad.sh, &sh, active).map_err(named("sh"))
    }

    /// The five states.
    pub fn all(&self) -> [(&'static str, &Adam); 5] {
        [
            ("means", &self.means),
            ("quats", &self.quats),
            ("scales_log", &self.scales_log),
            ("opacity_logits", &self.opacity_logits),
            ("sh", &self.sh),
        ]
    }

    fn all_mut(&mut self) -> [&mut Adam; 5] {
        [&mut self.means, &mut self.quats, &mut self.scales_log, &mut self.opacity_logits, &mut self.sh]
    }

    /// Zeroes the states of the rows where `which` holds.
    pub fn reset_rows(&mut self, which: impl Fn(usize) -> bool) {
        for adam in self.all_mut() {
            adam.reset_rows(&which);
        }
    }

    /// Keeps the rows where `keep` is true, in their order.
    pub fn keep_rows(&mut self, keep: &[bool]) {
        for adam in self.all_mut() {
            adam.keep_rows(keep);
        }
    }

    /// Appends rows with zero states.
    pub fn append(&mut self, rows: usize) {
        for adam in self.all_mut() {
            adam.append(rows);
        }
    }

    /// Writes all states as `NAME.ARRAY.m`, `.v`, `.steps`.
    pub fn save(&self, name: &str, to: &mut Arrays) {
        for (array, adam) in self.all() {
            adam.save(&format!("{name}.{array}"), to);
        }
    }

    /// Reads what [`Self::save`] wrote, for the Gaussians `g`.
    ///
    /// # Errors
    /// Missing arrays, shapes that do not fit `g`, numbers outside their range.
    pub fn load(rule: Rule, name: &str, from: &Arrays, g: &Gaussians) -> Result<Self> {
        let load = |array: &str, width: usize| -> Result<Adam> {
            let name = format!("{name}.{array}");
            let adam = Adam::load(rule, &name, from)?;
            if (adam.rows(), adam.width()) != (g.len(), width) {
                return Err(Error::input(format!("array '{name}.m'"))
                    .expected(format!("shape [{}, {width}]", g.len()))
                    .got(format!("[{}, {}]", adam.rows(), adam.width())));
            }
            Ok(adam)
        };
        Ok(Self {
            means: load("means", 3)?,
            quats: load("quats", 4)?,
            scales_log: load("scales_log", 3)?,
            opacity_logits: load("opacity_logits", 1)?,
            sh: load("sh", 3 * g.sh_coefficients())?,
        })
    }
}

/// Keeps the Gaussians where `keep` is true, in their order.
pub fn keep_gaussians(g: &mut Gaussians, keep: &[bool]) {
    let width = 3 * g.sh_coefficients();
    retain_rows(&mut g.means, 1, keep);
    retain_rows(&mut g.quats, 1, keep);
    retain_rows(&mut g.scales_log, 1, keep);
    retain_rows(&mut g.opacity_logits, 1, keep);
    retain_rows(&mut g.sh, width, keep);
}

/// Appends exact copies of the given rows.
pub fn copy_gaussians(g: &mut Gaussians, rows: &[u32]) {
    let width = 3 * g.sh_coefficients();
    for r in rows.iter().map(|r| *r as usize) {
        g.means.push(g.means[r]);
        g.quats.push(g.quats[r]);
        g.scales_log.push(g.scales_log[r]);
        g.opacity_logits.push(g.opacity_logits[r]);
        g.sh.extend_from_within(r * width..(r + 1) * width);
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

/// Purposes of the draws of this folder (`num::rng`): every use has its own.
pub mod purpose {
    /// Positions of the halves of a split; item = row before the refinement, step = iteration, draw = 3·half + axis.
    pub const SPLIT: u16 = 0x0801;
    /// Source of a relocated Gaussian; item = row of the dead one, step = iteration, draw 0.
    pub const RELOCATE: u16 = 0x0802;
    /// Source of an added Gaussian; item = its row, step = iteration, draw 0.
    pub const GROW: u16 = 0x0803;
    /// Noise on the means; item = row, step = iteration, draw = axis.
    pub const NOISE: u16 = 0x0804;
}
