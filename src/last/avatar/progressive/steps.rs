//! Limits for the steps of the blocks of a level.

use super::plan::{Plan, block};
use crate::math::digraph::nodes;
use crate::num::order;
use crate::optim::groups::Rates;
use crate::scene::columns::Column;
use crate::scene::gaussians::Gaussians;

/// Smallest reference size.
const FLOOR: f64 = 1e-3;
/// Smallest RMS that is used as a divisor.
const LEAST: f64 = 1e-12;
/// Number of attributes.
pub const ATTRIBUTES: usize = 5;
/// Attributes: centres, scales, rotations, opacities, colours, in the order in which [`norm`] sums them.
const COLUMNS: [Column; ATTRIBUTES] =
    [Column::Means, Column::ScalesLog, Column::Quats, Column::OpacityLogits, Column::Sh];

/// RMS of u per factor and attribute.
pub type Sizes = Vec<[f64; ATTRIBUTES]>;

/// RMS of u over the key Gaussians of factor i, per attribute; 0 if there are none.
pub fn sizes(
    before: &Gaussians,
    after: &Gaussians,
    rates: &Rates,
    members: &[u32],
    i: usize,
) -> [f64; ATTRIBUTES] {
    std::array::from_fn(|a| {
        let column = COLUMNS[a];
        let (x, y) = (before.column(column), after.column(column));
        let (width, rate) = (before.width(column), rates.of(column));
        let (mut sum, mut count) = (0.0f64, 0usize);
        for (g, _) in members.iter().enumerate().filter(|(_, m)| *m >> i & 1 == 1) {
            for c in 0..width {
                let at = g * width + c;
                let u = (f64::from(x[at]) - f64::from(y[at])) / rate[usize::from(c >= 3)];
                sum += u * u;
            }
            count += width;
        }
        if count == 0 { 0.0 } else { (sum / count as f64).sqrt() }
    })
}

/// A plain optimiser step, before any limit is applied.
#[derive(Clone, Copy, Debug)]
pub struct Step<'a> {
    /// The Gaussians before the step.
    pub before: &'a Gaussians,
    /// The learning rates of the step.
    pub rates: &'a Rates,
}

/// A level whose blocks move.
#[derive(Clone, Copy, Debug)]
pub struct Level<'a> {
    /// Levels and parents of the factors.
    pub plan: &'a Plan,
    /// Factors of the level.
    pub factors: &'a [usize],
    /// Bit mask of the factors to which each Gaussian is key, shape (G).
    pub members: &'a [u32],
}

/// Limits the steps of the blocks of a level and stores their sizes in `r`. Returns the number of steps,
/// counted per factor and attribute, that were limited.
pub fn cap(step: Step<'_>, after: &mut Gaussians, level: Level<'_>, lambda: f64, r: &mut Sizes) -> usize {
    let Level { plan, factors, members } = level;
    let mut scale: Vec<[f64; ATTRIBUTES]> = vec![[1.0; ATTRIBUTES]; r.len()];
    let mut bound = 0;
    for &i in factors {
        let rms = sizes(step.before, after, step.rates, members, i);
        for a in 0..ATTRIBUTES {
            let reference = nodes(plan.parents[i]).map(|j| r[j][a]).fold(FLOOR, order::max);
            let c = order::min(1.0, lambda * reference / order::max(rms[a], LEAST));
            bound += usize::from(c < 1.0);
            scale[i][a] = c;
            r[i][a] = c * rms[a];
        }
    }
    let rows = scales_of_rows(members, factors, &scale);
    for (a, column) in COLUMNS.into_iter().enumerate() {
        let (x, width) = (step.before.column(column), step.before.width(column));
        let y = after.column_mut(column);
        for (g, c) in rows.iter().enumerate().filter(|(_, c)| c[a] < 1.0) {
            let c = c[a] as f32;
            for at in g * width..(g + 1) * width {
                y[at] = x[at] + c * (y[at] - x[at]);
            }
        }
    }
    bound
}

/// The smallest scale of the factors of a level to which a row is key; 1 for rows that are in no block.
fn scales_of_rows(members: &[u32], factors: &[usize], scale: &[[f64; ATTRIBUTES]]) -> Vec<[f64; ATTRIBUTES]> {
    members
        .iter()
        .map(|m| {
            let of = factors.iter().filter(|i| m >> **i & 1 == 1).map(|&i| scale[i]);
            of.fold([1.0; ATTRIBUTES], |c, s| std::array::from_fn(|a| order::min(c[a], s[a])))
        })
        .collect()
}

/// Norm of the gradient over the key Gaussians of one factor, all attributes.
pub fn norm(grad: &Gaussians, members: &[u32], i: usize) -> f64 {
    let mut sum = 0.0;
    for column in COLUMNS {
        let (x, width) = (grad.column(column), grad.width(column));
        for (g, _) in members.iter().enumerate().filter(|(_, m)| *m >> i & 1 == 1) {
            for v in &x[g * width..(g + 1) * width] {
                sum += f64::from(*v) * f64::from(*v);
            }
        }
    }
    sum.sqrt()
}

/// Applies the step −clip_norm(∇, λ) to the blocks of a level, with learning rate 1. Returns the number of
/// factors whose step was limited.
pub fn clipped(
    g: &mut Gaussians,
    grad: &Gaussians,
    members: &[u32],
    factors: &[usize],
    lambda: f64,
) -> usize {
    let mut scale = vec![[1.0; ATTRIBUTES]; factors.iter().fold(0, |m, &i| Ord::max(m, i + 1))];
    let mut bound = 0;
    for &i in factors {
        let norm = norm(grad, members, i);
        let c = order::min(1.0, lambda / order::max(norm, LEAST));
        bound += usize::from(c < 1.0);
        scale[i] = [c; ATTRIBUTES];
    }
    let rows = scales_of_rows(members, factors, &scale);
    let active = block(members, factors, 1);
    for (a, column) in COLUMNS.into_iter().enumerate() {
        let (x, width) = (grad.column(column), grad.width(column));
        let y = g.column_mut(column);
        for (row, c) in rows.iter().enumerate().filter(|(row, _)| active[*row] == 1) {
            for at in row * width..(row + 1) * width {
                y[at] -= c[a] as f32 * x[at];
            }
        }
    }
    bound
}
