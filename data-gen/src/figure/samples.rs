//! Frames of a data set: appearance and factors, observational or interventional.

use super::mechanism::Scm;
use super::purpose;
use reference::num::rng::{Key, uniform_f64};

/// Number of base frames of an intervention group.
pub const BASES: usize = 8;

/// Smallest change of the factor that is set by an intervention.
pub const LEAST_CHANGE: f64 = 0.5;

/// One frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Seed of its appearance.
    pub appearance: u64,
    /// Independent noise, shape (n).
    pub e: Vec<f64>,
    /// Factors, shape (n).
    pub u: Vec<f64>,
}

/// Frames before and after the same intervention do(i, v).
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// The factor that was set.
    pub target: usize,
    /// The value to which it was set.
    pub value: f64,
    /// Frames before the intervention, shape (M).
    pub bases: Vec<Frame>,
    /// Frames after the intervention, with the same e for every other factor and recomputed descendants,
    /// shape (M).
    pub after: Vec<Frame>,
}

/// The noise of one frame.
fn noise(scm: &Scm, seed: u64, item: u64, step: u32, purpose: u16) -> Vec<f64> {
    (0..scm.graph.n())
        .map(|j| scm.mechanism.noise(Key { seed, item, step, purpose, draw: j as u16 }))
        .collect()
}

/// Frame `index` of `count` observational ones; each of the `appearances` covers a contiguous range of equal
/// length.
pub fn observed(scm: &Scm, seed: u64, index: usize, count: usize, appearances: usize) -> Frame {
    let e = noise(scm, seed, index as u64, 0, purpose::OBSERVED);
    let u = scm.factors(&e, None);
    Frame { appearance: (index * appearances / count) as u64, e, u }
}

/// Group `index`: targets cycle through the factors, v ~ U(−2, 2), bases are drawn until |v − u_i| ≥ ½; all
/// frames of the group have the same appearance.
///
/// # Panics
/// If no frame is far enough from v in 65 536 draws, which does not happen for any model of this module.
pub fn group(scm: &Scm, seed: u64, index: usize, appearances: usize) -> Group {
    let target = index % scm.graph.n();
    let draw = |purpose: u16| uniform_f64(Key { seed, item: index as u64, step: 0, purpose, draw: 0 });
    let value = 4.0 * draw(purpose::VALUE) - 2.0;
    let appearance = (draw(purpose::GROUP_APPEARANCE) * appearances as f64) as u64;
    let mut group = Group { target, value, bases: Vec::new(), after: Vec::new() };
    for m in 0..BASES {
        let item = (index * BASES + m) as u64;
        let (e, u) = (0..1 << 16)
            .map(|trial| {
                let e = noise(scm, seed, item, trial, purpose::BASE);
                let u = scm.factors(&e, None);
                (e, u)
            })
            .find(|(_, u)| (value - u[target]).abs() >= LEAST_CHANGE)
            .expect("frames far from any value are common");
        let after = scm.factors(&e, Some((target, value)));
        group.after.push(Frame { appearance, e: e.clone(), u: after });
        group.bases.push(Frame { appearance, e, u });
    }
    group
}
