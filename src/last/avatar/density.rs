//! Density control, which adds and removes Gaussians: the pixel criterion (eq. 8 of the LAST paper), the
//! latent criterion (eq. 9), and combinations of them.
//!
//! The pixel criterion is the mean screen-space gradient of [`optim::density`](crate::optim::density) in NDC
//! units; a Gaussian becomes a candidate if it is at least 2e-4. The latent criterion is c_τ · mean
//! ‖∂L_lat/∂μ_world‖ over the iterations in which the Gaussian was visible; a Gaussian becomes a candidate if
//! it exceeds τ_rec. The following steps are the same for both criteria: small candidates are cloned, large
//! ones are split, Gaussians of low opacity are pruned, and Gaussians far from the template are removed.
//!
//! | mode | candidates |
//! |---|---|
//! | pixel | Gaussians that reach the pixel criterion |
//! | replace | Gaussians that exceed the latent criterion |
//! | or | Gaussians that meet either criterion |
//! | budget | as many Gaussians as reach the pixel criterion: those with the largest latent means, if above 0 |

pub use super::density_settings::{Density, Mode};
use super::person::Avatar;
use super::ranking::ranked;
use super::settings::Settings;
use crate::num::order;
use crate::optim::density::{self, Stats, Threshold};
use crate::optim::groups::Groups;
use crate::{Error, Result};

/// Latent gradients accumulated since the last refinement.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Latent {
    /// Sum of the gradient norms over the iterations in which the Gaussian was visible, shape (G).
    pub sums: Vec<f64>,
    /// Number of those iterations, shape (G).
    pub views: Vec<u32>,
}

impl Latent {
    /// Empty statistics for the given number of Gaussians.
    pub fn new(rows: usize) -> Self {
        Self { sums: vec![0.0; rows], views: vec![0; rows] }
    }

    /// Adds ‖∂L_lat/∂μ‖ of one iteration for every Gaussian with a radius above 0.
    pub fn add(&mut self, means_bar: &[[f32; 3]], radii: &[[i32; 2]]) {
        for (i, (g, r)) in means_bar.iter().zip(radii).enumerate() {
            if r[0] > 0 && r[1] > 0 {
                let [x, y, z] = g.map(f64::from);
                self.sums[i] += ((x * x + y * y) + z * z).sqrt();
                self.views[i] += 1;
            }
        }
    }

    /// Means over the iterations in which a Gaussian was visible; 0 if there were none.
    pub fn means(&self) -> Vec<f64> {
        let mean = |(&s, &n): (&f64, &u32)| if n == 0 { 0.0 } else { s / f64::from(n) };
        self.sums.iter().zip(&self.views).map(mean).collect()
    }
}

/// The result of density control in one iteration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Event {
    /// The iteration, counted from 1.
    pub iteration: usize,
    /// Number of clones made of small Gaussians.
    pub cloned: usize,
    /// Number of large Gaussians replaced by two.
    pub split: usize,
    /// Number of Gaussians removed because of low opacity.
    pub faint: usize,
    /// Number of Gaussians removed because they were too far from the template.
    pub strayed: usize,
    /// Number of candidates rejected because the maximum number of Gaussians was reached.
    pub turned_away: usize,
    /// Number of Gaussians after the refinement.
    pub size: usize,
    /// Number of Gaussians that reach the pixel criterion.
    pub pixel_candidates: usize,
    /// Number of Gaussians that exceed the latent criterion.
    pub latent_candidates: usize,
    /// The latent mean, without c_τ, that is reached by as many Gaussians as reach the pixel criterion; 0
    /// without a guide. With c_τ = τ_rec divided by this value, the two numbers are equal.
    pub latent_at_count: f64,
}

impl Event {
    /// Number of entries of [`Self::row`].
    pub const WIDTH: usize = 10;

    /// The event as a row of numbers, for a checkpoint.
    pub fn row(&self) -> [f64; Self::WIDTH] {
        let n = [
            self.iteration,
            self.cloned,
            self.split,
            self.faint,
            self.strayed,
            self.turned_away,
            self.size,
            self.pixel_candidates,
            self.latent_candidates,
        ];
        std::array::from_fn(|i| n.get(i).map_or(self.latent_at_count, |&n| n as f64))
    }

    /// The event with the given [`Self::row`].
    pub fn from_row(r: &[f64; Self::WIDTH]) -> Option<Self> {
        let n = |i: usize| (r[i] >= 0.0 && r[i] < 9e15 && r[i].fract() == 0.0).then_some(r[i] as usize);
        Some(Self {
            iteration: n(0)?,
            cloned: n(1)?,
            split: n(2)?,
            faint: n(3)?,
            strayed: n(4)?,
            turned_away: n(5)?,
            size: n(6)?,
            pixel_candidates: n(7)?,
            latent_candidates: n(8)?,
            latent_at_count: r[9],
        })
    }
}

/// Returns the candidates of a mode, given pixel means (G) and latent means (G), in ascending order, and an
/// event with the numbers of candidates.
pub fn candidates(d: &Density, pixel: &[f32], latent: &[f64]) -> (Vec<usize>, Event) {
    let by_pixel: Vec<bool> = pixel.iter().map(|&x| x >= d.pixel_threshold).collect();
    let by_latent: Vec<bool> = latent.iter().map(|&x| d.latent_scale * x > d.latent_threshold).collect();
    let count = |which: &[bool]| which.iter().filter(|b| **b).count();
    let n = count(&by_pixel);
    let rank = ranked(latent);
    let event = Event {
        pixel_candidates: n,
        latent_candidates: count(&by_latent),
        latent_at_count: if n > 0 { rank.get(n - 1).map_or(0.0, |&i| latent[i]) } else { 0.0 },
        ..Event::default()
    };
    let where_true = |f: &dyn Fn(usize) -> bool| (0..pixel.len()).filter(|&i| f(i)).collect::<Vec<usize>>();
    let chosen = match d.mode {
        Mode::Pixel => where_true(&|i| by_pixel[i]),
        Mode::Replace => where_true(&|i| by_latent[i]),
        Mode::Or => where_true(&|i| by_pixel[i] || by_latent[i]),
        Mode::Budget => {
            let mut top: Vec<usize> = rank.into_iter().take(n).filter(|&i| latent[i] > 0.0).collect();
            top.sort_unstable();
            top
        }
    };
    (chosen, event)
}

/// Performs one refinement: clones and splits candidates, prunes, removes Gaussians far from the template and
/// attaches the remaining ones to their nearest points. Returns the event and, for every row afterwards, the
/// previous row that it equals or originates from; resets the statistics.
///
/// # Errors
/// If no Gaussian remains.
pub(super) fn refine(
    settings: &Settings,
    iteration: usize,
    avatar: &mut Avatar,
    groups: &mut Groups,
    stats: &mut Stats,
    latent: &mut Latent,
) -> Result<(Event, Vec<u32>)> {
    let d = &settings.density;
    let g = &mut avatar.gaussians;
    let rows = g.len();
    let pixel: Vec<f32> = (0..rows).map(|i| stats.mean(i)).collect();
    let means = if latent.sums.len() == rows { latent.means() } else { vec![0.0; rows] };
    let (chosen, mut event) = candidates(d, &pixel, &means);
    let mut how = density::Settings {
        threshold: Threshold::AtLeast,
        grad_threshold: d.pixel_threshold,
        split_scale: d.split_scale,
        prune_opacity: d.prune_opacity,
        prune_scale_after: u32::MAX,
        max_gaussians: settings.max_gaussians,
        ..density::Settings::INRIA
    };
    if d.mode.is_latent() {
        // The criterion as a number that exceeds 1 for candidates and preserves their rank, so that the
        // candidates with the smallest values are rejected first when the maximum number is reached.
        let share = |i: usize| match d.mode {
            Mode::Or => order::max(
                f64::from(pixel[i]) / f64::from(d.pixel_threshold),
                d.latent_scale * means[i] / d.latent_threshold,
            ),
            _ => means[i],
        };
        let mut by_rank = chosen;
        by_rank.sort_by(|&a, &b| share(b).total_cmp(&share(a)).then(a.cmp(&b)));
        let mut sums = vec![0.0; rows];
        for (rank, &i) in by_rank.iter().enumerate() {
            sums[i] = (by_rank.len() - rank) as f64;
        }
        how.grad_threshold = 1.0;
        *stats = Stats::from_parts(sums, vec![1; rows])?;
    }
    let at = u32::try_from(iteration).expect("validated");
    let report = density::refine(&how, at, 1.0, settings.seed, g, groups, stats)?;
    let mut parents = report.parents;
    let most = d.prune_distance_m / avatar.body.template.unit_m;
    let keep: Vec<bool> = avatar.attach().into_iter().map(|x| x <= most).collect();
    event.strayed = keep.iter().filter(|k| !**k).count();
    if event.strayed > 0 {
        avatar.gaussians.keep_rows(&keep);
        groups.keep_rows(&keep);
        parents = parents.into_iter().zip(&keep).filter(|(_, k)| **k).map(|(p, _)| p).collect();
        let nearest = avatar.nearest.iter().zip(&keep).filter(|(_, k)| **k).map(|(p, _)| *p).collect();
        avatar.attach_to(nearest)?;
    }
    let n = avatar.gaussians.len();
    if n == 0 {
        return Err(Error::input("density control")
            .at(format!("iteration {iteration}"))
            .expected("Gaussians near the template")
            .got("none")
            .hint("check the unit of the template and the learning rate of the centres"));
    }
    *stats = Stats::new(n);
    *latent = Latent::new(if d.mode.is_latent() { n } else { 0 });
    event.iteration = iteration;
    event.cloned = report.cloned;
    event.split = report.split;
    event.faint = report.pruned_opacity;
    event.turned_away = report.turned_away;
    event.size = n;
    Ok((event, parents))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes_choose_what_they_say() {
        let pixel = [1e-4, 2e-4, 3e-4, 0.0, 5e-4];
        let latent = [0.004, 0.003, 0.0031, 0.0, 0.1];
        let of = |mode| candidates(&Density { mode, ..Density::pixel() }, &pixel, &latent);
        assert_eq!(of(Mode::Pixel).0, [1, 2, 4], "≥ 2e-4");
        assert_eq!(of(Mode::Replace).0, [0, 2, 4], "> 0.003: a value equal to the threshold is no candidate");
        assert_eq!(of(Mode::Or).0, [0, 1, 2, 4], "either");
        assert_eq!(of(Mode::Budget).0, [0, 2, 4], "the three largest");
        let event = of(Mode::Budget).1;
        assert_eq!((event.pixel_candidates, event.latent_candidates), (3, 3), "counts");
        assert_eq!(event.latent_at_count, 0.0031, "the third largest");
        for mode in [Mode::Replace, Mode::Budget] {
            let none = candidates(&Density { mode, ..Density::pixel() }, &pixel, &[0.0; 5]);
            assert!(none.0.is_empty(), "no discrepancy, no candidates");
        }
        let event = Event { iteration: 7, size: 9, latent_at_count: 0.25, ..event };
        assert_eq!(Event::from_row(&event.row()), Some(event), "conversion to a row and back");
    }
}
