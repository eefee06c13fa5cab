//! Adaptive density control: Gaussians with large screen-space gradients are cloned or split; those with low
//! opacity or large scale are removed.
//!
//! (Kerbl et al. 2023, § 5.2, as implemented in the published programs.) Every `every` iterations between
//! `start` and `stop`:
//!
//! 1. candidates: the mean over the views in which it is visible of ‖(W/2·∂L/∂u, H/2·∂L/∂v)‖ reaches the
//!    threshold ([`Threshold`] sets whether equality counts);
//! 2. a candidate with largest standard deviation ≤ `split_scale`·extent is **cloned**: an exact copy, not
//!    moved;
//! 3. any other candidate is **split**: two Gaussians drawn from it, standard deviations divided by 1.6, the
//!    parent removed;
//! 4. then opacity < `prune_opacity` is **pruned**, and after `prune_scale_after` also standard deviations >
//!    `prune_scale`·extent.
//!
//! Every `reset_every` iterations the opacity is clamped to at most `reset_opacity` and its moments are
//! zeroed. During the next `grace` iterations nothing is pruned for its opacity. Pruning leaves at least
//! `keep_at_least` Gaussians: those with the highest opacity.
//!
//! # The two published programs
//! [`Settings::INRIA`] and [`Settings::GSPLAT`] have the same constants and differ in three rules. Equality
//! counts as reaching the threshold in the first only. gsplat counts iterations from 0, so every refinement and
//! reset comes one update later. Only the original program resets opacities at `start` for white backgrounds.
//! (gsplat 1.5.3 never resets opacities, because of an operator precedence that a later version corrects; the
//! documented behaviour is implemented here.)
//!
//! # Short runs
//! [`Settings::scaled`] shortens the schedule with the run, but not below that of [`SHORTEST`] iterations; only
//! `stop` always scales. The learning rates of opacities and scales are not scaled: an opacity needs about 100
//! iterations to recover from a reset, and a scale 140 iterations to halve, in a run of any length.
//!
//! # Order of the rows
//! Remaining rows in their order, then clones in the order of their parents, then the first halves of the
//! split ones in the order of their parents, then the second halves; pruning keeps that order. New rows have
//! zero moments and counters.
//!
//! # Rounding
//! Norms and their sums in f64 (a left fold over the views in the order of the calls), the mean rounded once
//! to f32 and compared with the f32 threshold. Opacity and deviations for comparisons by `num::elem` in f32.
//! Positions in f64, rounded once; a split adds −ln 1.6, rounded to f32, to the stored logarithms. The code
//! is serial.
//!
//! # Deviations and pitfalls
//! * The gradient is in NDC units, so it depends on the resolution: the threshold is tied to the image size.
//! * A Gaussian that is visible in no view has mean 0, not 0/0.
//! * The original program has a pruning rule by screen size (20 px) that never takes effect, because the
//!   radii are zeroed just before; its results depend on that. The rule is omitted here.
//! * Clones stay where their parents are, although the paper describes a displacement.
//! * Signed gradients of many pixels cancel. `absgrad` takes the sum of absolute values over pixels instead;
//!   its threshold is about four times as high.
//! * Two halves with the parent's opacity o cover more than the parent did; `revised_opacity` gives them 1 −
//!   √(1−o).

use super::groups::{Groups, purpose, rotation};
use super::schedule::scaled;
use crate::num::rng::Rng;
use crate::num::{elem, order};
use crate::scene::columns::Column;
use crate::scene::gaussians::Gaussians;
use crate::{Error, Result};

/// Whether a gradient equal to the threshold counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Threshold {
    /// ≥, the original program.
    AtLeast,
    /// >, gsplat.
    Above,
}

/// Constants of density control; iterations are those of this run.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Whether equality counts.
    pub threshold: Threshold,
    /// Mean screen-space gradient in NDC units.
    pub grad_threshold: f32,
    /// The gradients given to [`Stats::add_view`] are sums of absolute values over pixels.
    pub absgrad: bool,
    /// Largest standard deviation of a clone, in extents.
    pub split_scale: f64,
    /// Gaussians with a lower opacity are pruned.
    pub prune_opacity: f32,
    /// Gaussians with a larger standard deviation, in extents, are pruned,
    pub prune_scale: f64,
    /// in iterations after this one.
    pub prune_scale_after: u32,
    /// Refinement happens in iterations after this one,
    pub start: u32,
    /// before this one,
    pub stop: u32,
    /// at multiples of this.
    pub every: u32,
    /// Opacity resets happen at multiples of this, before `stop`.
    pub reset_every: u32,
    /// Opacity after a reset, at most.
    pub reset_opacity: f32,
    /// Also reset once at `start` (white backgrounds).
    pub reset_at_start: bool,
    /// Halves of a split get 1 − √(1−o) instead of o.
    pub revised_opacity: bool,
    /// Iterations after a reset in which nothing is pruned for its opacity.
    pub grace: u32,
    /// Pruning leaves at least this many Gaussians, those with the highest opacity; ties by row.
    pub keep_at_least: usize,
    /// Whether the constants count iterations from 0 instead of 1.
    pub counts_from_zero: bool,
    /// Maximum number of Gaussians; candidates with the largest gradients take precedence, ties by row.
    pub max_gaussians: usize,
}

/// The constants of shorter runs are those of a run of this length.
pub const SHORTEST: u32 = 1500;
/// [`Settings::grace`] of runs shorter than [`SHORTEST`].
const GRACE: u32 = 50;

impl Settings {
    /// Constants of the original program, 30 000 iterations.
    pub const INRIA: Self = Self {
        threshold: Threshold::AtLeast,
        grad_threshold: 2e-4,
        absgrad: false,
        split_scale: 0.01,
        prune_opacity: 0.005,
        prune_scale: 0.1,
        prune_scale_after: 3000,
        start: 500,
        stop: 15_000,
        every: 100,
        reset_every: 3000,
        reset_opacity: 0.01,
        reset_at_start: false,
        revised_opacity: false,
        grace: 0,
        keep_at_least: 0,
        counts_from_zero: false,
        max_gaussians: usize::MAX,
    };
    /// Constants of gsplat's default strategy.
    pub const GSPLAT: Self = Self { threshold: Threshold::Above, counts_from_zero: true, ..Self::INRIA };
    /// Constants of gsplat's strategy on absolute gradients.
    pub const GSPLAT_ABS: Self = Self { grad_threshold: 8e-4, absgrad: true, ..Self::GSPLAT };

    /// Scales the schedule to a run of another length: `stop` times `iterations`/30 000, every other iteration
    /// constant times max(`iterations`, [`SHORTEST`])/30 000.
    #[must_use]
    pub fn scaled(mut self, iterations: u32) -> Self {
        self.stop = scaled(self.stop, iterations);
        let length = iterations.max(SHORTEST);
        for n in [&mut self.prune_scale_after, &mut self.start, &mut self.every, &mut self.reset_every] {
            *n = scaled(*n, length);
        }
        if iterations < SHORTEST {
            self.grace = self.grace.max(GRACE);
        }
        self
    }

    /// The iteration as the constants count it.
    fn counted(&self, iteration: u32) -> u32 {
        iteration.saturating_sub(u32::from(self.counts_from_zero))
    }

    /// Whether `iteration`, counted from 1, comes before the end of density control: its gradients belong to the statistics.
    pub fn is_open(&self, iteration: u32) -> bool {
        self.counted(iteration) < self.stop
    }

    /// Whether opacities have just been reset.
    fn is_grace(&self, count: u32) -> bool {
        let since = |reset: u32| count > reset && count - reset <= self.grace;
        let last = count.saturating_sub(1).checked_div(self.reset_every).unwrap_or(0) * self.reset_every;
        (last > 0 && since(last)) || (self.reset_at_start && since(self.start))
    }

    fn reaches(&self, grad: f32) -> bool {
        match self.threshold {
            Threshold::AtLeast => grad >= self.grad_threshold,
            Threshold::Above => grad > self.grad_threshold,
        }
    }
}

/// Screen-space gradients since the last refinement.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Stats {
    /// (N): sum of norms over the views in which the Gaussian is visible.
    sums: Vec<f64>,
    /// (N): number of those views.
    views: Vec<u32>,
}

impl Stats {
    /// Makes empty statistics.
    pub fn new(rows: usize) -> Self {
        Self { sums: vec![0.0; rows], views: vec![0; rows] }
    }

    /// Adds one view: `means_px_bar` (N, 2) is ∂L/∂means_px in pixel units (or the sum of its absolute values
    /// over pixels), `radii` (N, 2) is 0 where the Gaussian is not visible.
    pub fn add_view(&mut self, means_px_bar: &[[f32; 2]], radii: &[[i32; 2]], width: usize, height: usize) {
        let n = self.sums.len();
        assert!(means_px_bar.len() == n && radii.len() == n, "one gradient and one radius per Gaussian");
        let (w, h) = (0.5 * width as f64, 0.5 * height as f64);
        for (i, (g, r)) in means_px_bar.iter().zip(radii).enumerate() {
            if r[0] > 0 && r[1] > 0 {
                let (u, v) = (f64::from(g[0]) * w, f64::from(g[1]) * h);
                self.sums[i] += (u * u + v * v).sqrt();
                self.views[i] += 1;
            }
        }
    }

    /// Mean over the views in which row `i` is visible; 0 if there are none.
    pub fn mean(&self, i: usize) -> f32 {
        if self.views[i] == 0 { 0.0 } else { (self.sums[i] / f64::from(self.views[i])) as f32 }
    }

    /// Sums and view counts, for a checkpoint.
    pub fn parts(&self) -> (&[f64], &[u32]) {
        (&self.sums, &self.views)
    }

    /// Restores statistics from [`Self::parts`].
    ///
    /// # Errors
    /// When the lengths differ or a sum is not a finite number ≥ 0.
    pub fn from_parts(sums: Vec<f64>, views: Vec<u32>) -> Result<Self> {
        let fine = sums.len() == views.len() && sums.iter().all(|s| *s >= 0.0 && s.is_finite());
        if fine {
            Ok(Self { sums, views })
        } else {
            Err(Error::input("density statistics").expected("finite sums, one per row"))
        }
    }
}

/// Counts of a refinement.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// Gaussians before.
    pub before: usize,
    /// Candidates cloned.
    pub cloned: usize,
    /// Candidates split.
    pub split: usize,
    /// Rows removed for their opacity (including new ones).
    pub pruned_opacity: usize,
    /// Rows removed only for their size (including new ones).
    pub pruned_scale: usize,
    /// Candidates rejected because of `max_gaussians`.
    pub turned_away: usize,
    /// Rows that would have been removed, and were kept as the best of `keep_at_least`.
    pub spared: usize,
    /// Gaussians after.
    pub after: usize,
    /// For every row afterwards, the index of the previous row that it is or originates from.
    pub parents: Vec<u32>,
}

/// Action of an iteration.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// Gaussians were cloned, split, pruned.
    Refined(Report),
    /// The opacities were reset.
    Reset,
}

/// Applies the schedule after the optimiser step of `iteration` (counted from 1): a refinement, a reset, both
/// in this order, or nothing.
///
/// # Errors
/// The same as [`refine`].
pub fn step(
    settings: &Settings,
    iteration: u32,
    extent: f64,
    seed: u64,
    g: &mut Gaussians,
    groups: &mut Groups,
    stats: &mut Stats,
) -> Result<Vec<Event>> {
    let mut events = Vec::new();
    if !settings.is_open(iteration) {
        return Ok(events);
    }
    let count = settings.counted(iteration);
    let due = |every: u32| every > 0 && count > 0 && count.is_multiple_of(every);
    if count > settings.start && due(settings.every) {
        events.push(Event::Refined(refine(settings, iteration, extent, seed, g, groups, stats)?));
    }
    if due(settings.reset_every) || (settings.reset_at_start && count == settings.start) {
        reset_opacity(settings, g, groups);
        events.push(Event::Reset);
    }
    Ok(events)
}

/// Clamps every opacity to at most `reset_opacity` (in logits; lower ones keep their bits) and zeroes its
/// optimiser state.
pub fn reset_opacity(settings: &Settings, g: &mut Gaussians, groups: &mut Groups) {
    let most = elem::logit(settings.reset_opacity);
    for o in &mut g.opacity_logits {
        *o = order::min(*o, most);
    }
    groups.of_mut(Column::OpacityLogits).reset_rows(|_| true);
}

/// Largest standard deviation.
fn largest(scales_log: [f32; 3]) -> f32 {
    elem::exp(order::max(order::max(scales_log[0], scales_log[1]), scales_log[2]))
}

/// One refinement; clears `stats` and resizes it to the new rows.
///
/// # Errors
/// An extent that is not positive; a Gaussian to be split has a quaternion of length zero; no Gaussian
/// remains.
pub fn refine(
    settings: &Settings,
    iteration: u32,
    extent: f64,
    seed: u64,
    g: &mut Gaussians,
    groups: &mut Groups,
    stats: &mut Stats,
) -> Result<Report> {
    let n = g.len();
    assert!(
        stats.sums.len() == n && groups.of(Column::Means).rows() == n,
        "statistics and states belong to these Gaussians"
    );
    if !(extent > 0.0 && extent.is_finite()) {
        return Err(Error::input("density control")
            .at("extent")
            .expected("a positive length")
            .got(extent.to_string()));
    }
    let grads: Vec<f32> = (0..n).map(|i| stats.mean(i)).collect();
    let mut candidates: Vec<usize> = (0..n).filter(|i| settings.reaches(grads[*i])).collect();
    let room = settings.max_gaussians.saturating_sub(n);
    let turned_away = candidates.len().saturating_sub(room);
    if turned_away > 0 {
        candidates.sort_by_key(|i| (std::cmp::Reverse(order::key_f32(grads[*i])), *i));
        candidates.truncate(room);
        candidates.sort_unstable();
    }
    let most = (settings.split_scale * extent) as f32;
    let (clones, splits): (Vec<usize>, Vec<usize>) =
        candidates.into_iter().partition(|i| largest(g.scales_log[*i]) <= most);
    let as_rows = |rows: &[usize]| rows.iter().map(|r| *r as u32).collect::<Vec<u32>>();
    let (clones, splits) = (as_rows(&clones), as_rows(&splits));

    // Append new rows, then remove the parents that were split.
    g.copy_rows(&clones);
    for half in 0..2u16 {
        let first = g.len();
        g.copy_rows(&splits);
        for (j, &parent) in splits.iter().enumerate() {
            halve(settings, Rng::new(seed), iteration, half, u64::from(parent), g, first + j)?;
        }
    }
    let mut parents: Vec<u32> = (0..n as u32).chain(clones.iter().copied()).chain(splits.repeat(2)).collect();
    let mut keep = vec![true; parents.len()];
    for &i in &splits {
        keep[i as usize] = false;
    }
    let mut report =
        Report { before: n, cloned: clones.len(), split: splits.len(), turned_away, ..Report::default() };
    prune(settings, settings.counted(iteration), extent, g, &mut keep, &mut report);
    g.keep_rows(&keep);
    crate::num::array::retain_rows(&mut parents, 1, &keep);
    groups.append(clones.len() + 2 * splits.len());
    groups.keep_rows(&keep);
    *stats = Stats::new(g.len());
    report.after = g.len();
    report.parents = parents;
    if g.is_empty() {
        return Err(Error::input("density control")
            .at(format!("iteration {iteration}"))
            .expected("at least one Gaussian to remain")
            .got(format!(
                "{} pruned for an opacity below {}, {} for a standard deviation above {}",
                report.pruned_opacity,
                settings.prune_opacity,
                report.pruned_scale,
                settings.prune_scale * extent
            ))
            .hint("check the learning rates, the cameras and the size of the scene"));
    }
    Ok(report)
}

/// Removes what is too faint or too large from `keep`, but for the best rows that have to stay.
fn prune(
    settings: &Settings,
    count: u32,
    extent: f64,
    g: &Gaussians,
    keep: &mut [bool],
    report: &mut Report,
) {
    let huge = (settings.prune_scale * extent) as f32;
    let (judges_opacity, judges_size) = (!settings.is_grace(count), count > settings.prune_scale_after);
    let is_faint = |i: usize| judges_opacity && elem::sigmoid(g.opacity_logits[i]) < settings.prune_opacity;
    let is_huge = |i: usize| judges_size && largest(g.scales_log[i]) > huge;
    let rows = keep.iter().filter(|k| **k).count();
    let mut bad: Vec<usize> = (0..keep.len()).filter(|&i| keep[i] && (is_faint(i) || is_huge(i))).collect();
    report.spared = settings.keep_at_least.saturating_sub(rows - bad.len()).min(bad.len());
    if report.spared > 0 {
        bad.sort_by_key(|i| (std::cmp::Reverse(order::key_f32(g.opacity_logits[*i])), *i));
        bad.drain(..report.spared);
    }
    for i in bad {
        keep[i] = false;
        if is_faint(i) {
            report.pruned_opacity += 1;
        } else {
            report.pruned_scale += 1;
        }
    }
}

/// ln 1.6
const LN_SHRINK: f64 = 0.470_003_629_245_735_63;

/// Turns row `row`, a copy of its parent, into one of its halves.
fn halve(
    settings: &Settings,
    rng: Rng,
    iteration: u32,
    half: u16,
    parent: u64,
    g: &mut Gaussians,
    row: usize,
) -> Result<()> {
    if g.quats[row] == [0.0; 4] {
        return Err(Error::input("density control")
            .at(format!("quats, row {parent}"))
            .expected("a length above zero")
            .got("0"));
    }
    let r = rotation(g.quats[row]);
    let along: [f64; 3] = std::array::from_fn(|axis| {
        let normal = rng.normal_f64(parent, iteration, purpose::SPLIT, 3 * half + axis as u16);
        libm::exp(f64::from(g.scales_log[row][axis])) * normal
    });
    for (c, mean) in g.means[row].iter_mut().enumerate() {
        let offset = (r[c][0] * along[0] + r[c][1] * along[1]) + r[c][2] * along[2];
        *mean = (f64::from(*mean) + offset) as f32;
    }
    for s in &mut g.scales_log[row] {
        *s -= LN_SHRINK as f32;
    }
    if settings.revised_opacity {
        g.opacity_logits[row] = revised(f64::from(g.opacity_logits[row])) as f32;
    }
    Ok(())
}

/// ln(1 + eˣ) for any finite x.
fn softplus(x: f64) -> f64 {
    order::max(x, 0.0) + libm::log1p(libm::exp(-x.abs()))
}

/// Logit of 1 − √(1−o) from the logit x of o. With e = √(1−o) it is ln((1−e)/e) = ln(o/((1+e)e)), where
/// nothing cancels.
fn revised(x: f64) -> f64 {
    let ln_e = -0.5 * softplus(x);
    (-softplus(-x) - libm::log1p(libm::exp(ln_e))) - ln_e
}
