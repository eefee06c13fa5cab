//! Where Gaussians are added and removed: the pixel criterion of the host, the latent one (last.md §11), and their mixtures.
//!
//! The pixel criterion is the mean screen gradient of [`optim::density`](crate::optim::density) in NDC units, reached at 2e-4. The latent one is
//! c_τ · mean ‖∂L_lat/∂μ_world‖ over the iterations in which a Gaussian was visible, exceeded at τ_rec. What follows is the same for both: small ones
//! are cloned, large ones split, faint ones pruned; and whatever has strayed from the template goes.
//!
//! | mode | candidates |
//! |---|---|
//! | pixel | the pixel criterion |
//! | replace | the latent criterion |
//! | or | either |
//! | budget | as many as the pixel criterion has, those of largest latent mean above 0 |

pub use super::density_settings::{Density, Mode};
use super::person::Avatar;
use super::ranking::ranked;
use super::settings::Settings;
use crate::num::order;
use crate::optim::density::{self, Stats, Threshold};
use crate::optim::groups::Groups;
use crate::{Error, Result};

/// Latent gradients since the last refinement.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Latent {
    /// (G) sum of norms over the iterations that saw it
    pub sums: Vec<f64>,
    /// (G) number of those
    pub views: Vec<u32>,
}

impl Latent {
    /// Nothing seen.
    pub fn new(rows: usize) -> Self {
        Self { sums: vec![0.0; rows], views: vec![0; rows] }
    }

    /// Adds ‖∂L_lat/∂μ‖ of one iteration, of Gaussians with a radius above 0.
    pub fn add(&mut self, means_bar: &[[f32; 3]], radii: &[[i32; 2]]) {
        for (i, (g, r)) in means_bar.iter().zip(radii).enumerate() {
            if r[0] > 0 && r[1] > 0 {
                let [x, y, z] = g.map(f64::from);
                self.sums[i] += ((x * x + y * y) + z * z).sqrt();
                self.views[i] += 1;
            }
        }
    }

    /// Means over the iterations that saw a row; 0 if none did.
    pub fn means(&self) -> Vec<f64> {
        let mean = |(&s, &n): (&f64, &u32)| if n == 0 { 0.0 } else { s / f64::from(n) };
        self.sums.iter().zip(&self.views).map(mean).collect()
    }
}

/// What density control did in one iteration.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Event {
    /// counted from 1
    pub iteration: usize,
    /// copies made of small Gaussians
    pub cloned: usize,
    /// large Gaussians replaced by two
    pub split: usize,
    /// faint Gaussians removed
    pub faint: usize,
    /// Gaussians removed because they had left the template
    pub strayed: usize,
    /// candidates that the largest number turned away
    pub turned_away: usize,
    /// Gaussians afterwards
    pub size: usize,
    /// how many reach the pixel criterion
    pub pixel_candidates: usize,
    /// how many exceed the latent criterion
    pub latent_candidates: usize,
    /// The latent mean, without c_τ, that as many Gaussians reach as reach the pixel criterion; 0 without a guide. c_τ = τ_rec over this makes the
    /// two counts equal.
    pub latent_at_count: f64,
}

impl Event {
    /// Numbers of [`Self::row`].
    pub const WIDTH: usize = 10;

    /// As numbers, for a checkpoint.
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

    /// From [`Self::row`].
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

/// The candidates of a mode from pixel means (G) and latent means (G), in ascending order; and the event's numbers about them.
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

/// One refinement: adds, prunes, removes what has strayed, attaches the rest anew. Gives the event and, for every row after, the row before that it is
/// or comes from; empties the statistics.
///
/// # Errors
/// When nothing remains.
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
        // The criterion as a number that is above 1 for candidates and keeps their rank, so that a full house turns the weakest away.
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
            .hint("the template's unit or the rate of the centres is wrong"));
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
        assert_eq!(of(Mode::Replace).0, [0, 2, 4], "> 0.003: equality is not enough");
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
        assert_eq!(Event::from_row(&event.row()), Some(event), "rows go both ways");
    }
}
