//! Density control as sampling: dead Gaussians are relocated onto live ones, their number grows up to a cap,
//! and noise on the means explores the scene.
//!
//! (Kheradmand et al. 2024, "3D Gaussian Splatting as Markov Chain Monte Carlo", with gsplat's constants.) No
//! opacity resets, no gradient statistics. Every `every` iterations between `start` and `stop`:
//!
//! 1. every Gaussian with opacity ≤ `min_opacity` is dead and moves onto a live one drawn with probability ∝
//!    opacity;
//! 2. the set grows by `growth` towards `cap`, sources drawn with probability ∝ opacity.
//!
//! A source that ends up as N equal copies gets, like all its copies, the opacity and scale computed by
//! [`relocation`], so that their composite looks the same as before. Every iteration adds noise to the means
//! ([`add_noise`]) and two regularisers to the gradients ([`regularise`]).
//!
//! # Order of the rows
//! Dead rows are overwritten in place, added rows follow in the order of their draws.
//!
//! # Rounding
//! All in f64, rounded once when stored. Probabilities: left fold of the opacities (`num::elem`, f32) in row
//! order; a draw u takes the first row whose running sum exceeds u·total. Sources and rows written by step 1
//! or 2 have zero moments and counters afterwards (the published programs zero only those of the sources; a
//! relocated row keeps the moments of the dead one).

use super::groups::{Groups, purpose, rotation};
use super::schedule::scaled;
use crate::loss::presence;
use crate::num::rng::Rng;
use crate::num::{elem, order, par};
use crate::scene::columns::Column;
use crate::scene::gaussians::Gaussians;
use crate::{Error, Result};

/// Constants of the strategy; iterations are those of this run.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Maximum number of Gaussians.
    pub cap: usize,
    /// Growth factor per refinement.
    pub growth: f64,
    /// A Gaussian with this opacity or less is dead; relocated opacities are at least this.
    pub min_opacity: f32,
    /// Refinement happens in iterations after this one,
    pub start: u32,
    /// before this one,
    pub stop: u32,
    /// at multiples of this.
    pub every: u32,
    /// Scale of the noise, in units of the learning rate of the means.
    pub noise: f64,
    /// Weight of the mean opacity in the loss.
    pub opacity_weight: f64,
    /// Weight of the mean standard deviation in the loss.
    pub scale_weight: f64,
}

impl Settings {
    /// gsplat's constants, 30 000 iterations.
    pub const GSPLAT: Self = Self {
        cap: 1_000_000,
        growth: 1.05,
        min_opacity: 0.005,
        start: 500,
        stop: 25_000,
        every: 100,
        noise: 5e5,
        opacity_weight: 0.01,
        scale_weight: 0.01,
    };

    /// Scales the schedule to a run of another length: every iteration constant times `iterations`/30 000.
    #[must_use]
    pub fn scaled(mut self, iterations: u32) -> Self {
        for n in [&mut self.start, &mut self.stop, &mut self.every] {
            *n = scaled(*n, iterations);
        }
        self
    }
}

/// Maximum number of copies of one source that [`relocation`] supports.
pub const MAX_COPIES: u32 = 51;

/// Opacity and scale factor of each of `copies` equal Gaussians that together look like one of opacity `o`.
///
/// o' = 1 − (1−o)^{1/N},   factor = o / Σ_{i=1..N} Σ_{k<i} C(i−1,k)(−1)ᵏ o'^{k+1}/√(k+1)
/// (Kheradmand et al. 2024)
///
/// # Rounding
/// f64. Columns of the double sum are added first, Σᵢ C(i−1,k) = C(N,k+1), which leaves the single
/// alternating sum Σ_{k=1..N} C(N,k)(−1)^{k−1} o'ᵏ/√k, a left fold with running products. o' by `log1p` and
/// `expm1`.
///
/// # Kinks and domain
/// 0 < o < 1; N is limited to [`MAX_COPIES`], beyond which cancellation dominates the sum; callers report
/// when the limit applies.
///
/// # Example
/// ```
/// # use lastlight_train as lastlight;
/// use lastlight::optim::mcmc::relocation;
/// assert_eq!(relocation(0.5, 1), (0.5, 1.0));
/// let (o, factor) = relocation(0.75, 2);
/// assert!((o - 0.5).abs() < 1e-15 && (factor - 0.75 / (1.0 - 0.25 / 2f64.sqrt())).abs() < 1e-15);
/// ```
pub fn relocation(o: f64, copies: u32) -> (f64, f64) {
    let n = copies.clamp(1, MAX_COPIES);
    if n == 1 {
        return (o, 1.0);
    }
    let each = -libm::expm1(libm::log1p(-o) / f64::from(n));
    let (mut sum, mut binomial, mut power, mut sign) = (0.0, 1.0, 1.0, 1.0);
    for k in 1..=n {
        binomial = binomial * f64::from(n - k + 1) / f64::from(k); // exact: below 2⁵³ with its numerator
        power *= each;
        sum += sign * binomial * power / f64::from(k).sqrt();
        sign = -sign;
    }
    (each, o / sum)
}

/// Counts of a refinement.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Report {
    /// Gaussians before.
    pub before: usize,
    /// Dead Gaussians relocated onto live ones.
    pub relocated: usize,
    /// Gaussians added by growth.
    pub added: usize,
    /// Sources with more than [`MAX_COPIES`] copies, whose appearance is preserved for that many only.
    pub crowded: usize,
    /// Gaussians after.
    pub after: usize,
    /// For every row afterwards, the index of the previous row that it is or originates from.
    pub parents: Vec<u32>,
}

/// Runs a refinement if the schedule has one in `iteration` (counted from 1).
///
/// # Errors
/// The same as [`refine`].
pub fn step(
    settings: &Settings,
    iteration: u32,
    seed: u64,
    g: &mut Gaussians,
    groups: &mut Groups,
) -> Result<Option<Report>> {
    let due = settings.every > 0 && iteration.is_multiple_of(settings.every);
    if iteration > settings.start && iteration < settings.stop && due {
        refine(settings, iteration, seed, g, groups).map(Some)
    } else {
        Ok(None)
    }
}

/// Draws rows with probability ∝ weight.
struct Wheel {
    rows: Vec<u32>,
    /// Running sums of the weights.
    sums: Vec<f64>,
}

impl Wheel {
    fn new(rows: Vec<u32>, weight: impl Fn(usize) -> f32) -> Self {
        let mut total = 0.0;
        let sums = rows.iter().map(|r| {
            total += f64::from(weight(*r as usize));
            total
        });
        let sums = sums.collect();
        Self { rows, sums }
    }

    fn draw(&self, u: f64) -> u32 {
        let total = *self.sums.last().expect("at least one row");
        let i = self.sums.partition_point(|s| *s <= u * total);
        self.rows[i.min(self.rows.len() - 1)]
    }
}

/// Assigns every drawn source the opacity and scale of its copies. Returns the number of sources with too
/// many copies.
fn thin(settings: &Settings, sources: &[u32], opacities: &[f32], g: &mut Gaussians) -> usize {
    let mut copies = vec![1u32; g.len()];
    for &s in sources {
        copies[s as usize] += 1;
    }
    let mut crowded = 0;
    for (i, &n) in copies.iter().enumerate().filter(|(_, n)| **n > 1) {
        crowded += usize::from(n > MAX_COPIES);
        // ln(1 − o) is not finite for an opacity rounded to 1; use the largest f32 below 1 instead.
        let below_one = f64::from(1.0 - f32::EPSILON);
        let (o, factor) = relocation(order::min(f64::from(opacities[i]), below_one), n);
        let o = order::clamp(o, f64::from(settings.min_opacity), below_one);
        g.opacity_logits[i] = libm::log(o / (1.0 - o)) as f32;
        for s in &mut g.scales_log[i] {
            *s = (f64::from(*s) + libm::log(factor)) as f32;
        }
    }
    crowded
}

/// One refinement: relocation, then growth.
///
/// # Errors
/// When no Gaussian is alive.
pub fn refine(
    settings: &Settings,
    iteration: u32,
    seed: u64,
    g: &mut Gaussians,
    groups: &mut Groups,
) -> Result<Report> {
    let n = g.len();
    assert_eq!(groups.of(Column::Means).rows(), n, "states belong to these Gaussians");
    let rng = Rng::new(seed);
    let mut opacities = vec![0.0f32; n];
    elem::sigmoid_slice(&g.opacity_logits, &mut opacities);
    let (dead, alive): (Vec<u32>, Vec<u32>) =
        (0..n as u32).partition(|i| opacities[*i as usize] <= settings.min_opacity);
    if alive.is_empty() {
        return Err(Error::input("density control")
            .at(format!("iteration {iteration}"))
            .expected(format!("a Gaussian with opacity above {}", settings.min_opacity))
            .got("none"));
    }
    let mut report = Report { before: n, relocated: dead.len(), ..Report::default() };
    let mut parents: Vec<u32> = (0..n as u32).collect();
    let mut fresh = vec![false; n];
    if !dead.is_empty() {
        let wheel = Wheel::new(alive, |i| opacities[i]);
        let draw = |d: &u32| wheel.draw(rng.uniform_f64(u64::from(*d), iteration, purpose::RELOCATE, 0));
        let sources: Vec<u32> = dead.iter().map(draw).collect();
        report.crowded += thin(settings, &sources, &opacities, g);
        let width = 3 * g.sh_coefficients();
        for (&to, &from) in dead.iter().zip(&sources) {
            let (to, from) = (to as usize, from as usize);
            g.means[to] = g.means[from];
            g.quats[to] = g.quats[from];
            g.scales_log[to] = g.scales_log[from];
            g.opacity_logits[to] = g.opacity_logits[from];
            g.sh.copy_within(from * width..(from + 1) * width, to * width);
            parents[to] = from as u32;
            fresh[to] = true;
            fresh[from] = true;
        }
        elem::sigmoid_slice(&g.opacity_logits, &mut opacities);
    }
    let target = ((n as f64 * settings.growth) as usize).min(settings.cap);
    let added = target.saturating_sub(n);
    if added > 0 {
        let wheel = Wheel::new((0..n as u32).collect(), |i| opacities[i]);
        let draw = |j: usize| wheel.draw(rng.uniform_f64((n + j) as u64, iteration, purpose::GROW, 0));
        let sources: Vec<u32> = (0..added).map(draw).collect();
        report.crowded += thin(settings, &sources, &opacities, g);
        g.copy_rows(&sources);
        for &s in &sources {
            parents.push(parents[s as usize]);
            fresh[s as usize] = true;
        }
        groups.append(added);
        fresh.resize(n + added, true);
    }
    groups.reset_rows(|r| fresh[r]);
    Ok(Report { added, after: g.len(), parents, ..report })
}

/// Number of Gaussians per task of [`add_noise`].
const CHUNK: usize = 1024;

/// Moves every mean by Σ·η·σ(−100(o − 0.005))·noise·lr, η ~ N(0, I): Gaussians of low opacity move, opaque
/// ones stay.
///
/// # Rounding
/// f64, the new mean rounded once. Where a bound shows that the shift (|η| < 8.3 per axis) is too small to
/// change any coordinate, the draws are skipped; no bit depends on that.
pub fn add_noise(settings: &Settings, iteration: u32, seed: u64, lr_means: f64, g: &mut Gaussians) {
    let (rng, strength) = (Rng::new(seed), settings.noise * lr_means);
    let (quats, scales, logits) = (&g.quats, &g.scales_log, &g.opacity_logits);
    par::chunks_mut(&mut g.means, CHUNK, |chunk, means| {
        for (j, mean) in means.iter_mut().enumerate() {
            let i = chunk * CHUNK + j;
            let o = f64::from(elem::sigmoid(logits[i]));
            let gate = strength / (1.0 + libm::exp(100.0 * (o - 0.005)));
            let variance = scales[i].map(|s| libm::exp(2.0 * f64::from(s)));
            let widest = order::max(order::max(variance[0], variance[1]), variance[2]);
            let reach = 16.0 * gate * widest; // more than √3·8.3
            if mean.iter().all(|m| reach < f64::from(m.abs()) * 1.4e-8) {
                continue; // below a quarter of a unit in the last place
            }
            let r = rotation(quats[i]);
            let eta: [f64; 3] =
                std::array::from_fn(|c| rng.normal_f64(i as u64, iteration, purpose::NOISE, c as u16));
            let local: [f64; 3] = std::array::from_fn(|a| {
                ((r[0][a] * eta[0] + r[1][a] * eta[1]) + r[2][a] * eta[2]) * variance[a]
            });
            for (c, m) in mean.iter_mut().enumerate() {
                let shift = (r[c][0] * local[0] + r[c][1] * local[1]) + r[c][2] * local[2];
                *m = (f64::from(*m) + gate * shift) as f32;
            }
        }
    });
}

/// Adds the gradients of [`mod@crate::loss::presence`] with the weights of the settings to `grad` (by the
/// stored logits and logarithms) and returns the value.
pub fn regularise(settings: &Settings, g: &Gaussians, grad: &mut Gaussians) -> f64 {
    let w = presence::Weights { opacity: settings.opacity_weight, scale: settings.scale_weight };
    let (value, saved) = presence::forward(&w, &g.opacity_logits, &g.scales_log);
    presence::adjoint(&w, &saved, 1.0, &mut grad.opacity_logits, &mut grad.scales_log);
    value
}
