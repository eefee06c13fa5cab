//! The update of one iteration, all at once or level by level, and the selection of key Gaussians.

use super::super::person::Rig;
use super::super::progressive::{self, Cap, Keys};
use super::super::view::Target;
use super::request::{RenderResult, Request};
use super::{LOCAL_STEPS, PersonFit};
use crate::fit::training::Watch;
use crate::optim::groups::Rates;
use crate::shade::over_black;
use crate::{Error, Result};

impl PersonFit<'_> {
    /// Performs the update of one iteration, after the render of level 0.
    pub(super) fn update(
        &mut self,
        target: &Target,
        rig: &Rig,
        want: Request,
        rates: &Rates,
        first: &RenderResult,
        watch: &mut dyn Watch,
    ) -> Result<()> {
        let (Some(plan), false) = (self.plan.clone(), self.members.is_empty()) else {
            return self.groups.step(&mut self.avatar.gaussians, &first.grad.gaussians, rates, None);
        };
        let p = self.settings.progressive.clone().expect("the caller checked that there is a plan");
        let mut r = vec![[0.0; progressive::ATTRIBUTES]; plan.parents.len()];
        for (level, factors) in plan.levels.iter().enumerate() {
            let active = progressive::block(&self.members, factors, level);
            if level == 0 {
                let before = self.avatar.gaussians.clone();
                self.groups.step(&mut self.avatar.gaussians, &first.grad.gaussians, rates, Some(&active))?;
                for &i in factors {
                    r[i] = progressive::sizes(&before, &self.avatar.gaussians, rates, &self.members, i);
                }
                continue;
            }
            let want = Request { latent: false, networks: false, ..want };
            let passed = self.pass(target, rig, want, watch)?;
            let grad = &passed.grad.gaussians;
            match p.cap {
                Cap::Relative => {
                    let before = self.avatar.gaussians.clone();
                    let g = &mut self.avatar.gaussians;
                    self.groups.step(g, grad, rates, Some(&active))?;
                    let step = progressive::Step { before: &before, rates };
                    let blocks = progressive::Level { plan: &plan, factors, members: &self.members };
                    let bound = progressive::cap(step, g, blocks, p.lambda, &mut r);
                    self.tally.bound += bound as u64;
                    self.tally.capped += (factors.len() * progressive::ATTRIBUTES) as u64;
                }
                Cap::Absolute => {
                    let g = &mut self.avatar.gaussians;
                    let bound = progressive::clipped(g, grad, &self.members, factors, p.lambda);
                    self.tally.bound += bound as u64;
                    self.tally.capped += factors.len() as u64;
                }
                Cap::Stop => {
                    // A factor whose gradient is below λ stops, and does not move again in this iteration
                    // even if other factors increase its gradient.
                    let mut moving = factors.clone();
                    let mut last = passed;
                    for step in 0..LOCAL_STEPS {
                        moving.retain(|&i| {
                            progressive::norm(&last.grad.gaussians, &self.members, i) >= p.lambda
                        });
                        if moving.is_empty() {
                            break;
                        }
                        let active = progressive::block(&self.members, &moving, level);
                        let g = &mut self.avatar.gaussians;
                        self.groups.step(g, &last.grad.gaussians, rates, Some(&active))?;
                        if step + 1 < LOCAL_STEPS {
                            last = self.pass(target, rig, want, watch)?;
                        }
                    }
                    self.tally.bound += (factors.len() - moving.len()) as u64;
                    self.tally.capped += factors.len() as u64;
                }
            }
        }
        Ok(())
    }

    /// Selects the key Gaussians again if the schedule requires it.
    pub(super) fn find_keys(&mut self, iteration: usize) -> Result<()> {
        let (Some(p), Some(plan)) = (&self.settings.progressive, &self.plan) else { return Ok(()) };
        let (every, first) = (self.settings.scaled(p.every), self.settings.scaled(p.first));
        if !iteration.is_multiple_of(every) || iteration < first {
            return Ok(());
        }
        let (n, rows, share, keys, views) =
            (plan.parents.len(), self.avatar.gaussians.len(), p.share, p.keys, p.views);
        self.members = match keys {
            Keys::All => vec![((1u64 << n) - 1) as u32; rows],
            Keys::Random => progressive::random_keys(n, rows, share, self.settings.seed, iteration),
            Keys::Swap => progressive::keys(&self.scores(n, views)?, share),
        };
        Ok(())
    }

    /// Displacement of the decoded point of each Gaussian when a factor is exchanged, averaged over evenly
    /// spaced training images, shape (n, G).
    fn scores(&mut self, n: usize, views: usize) -> Result<Vec<Vec<f64>>> {
        let train = self.capture.train.len();
        let views = Ord::min(views, train);
        let mut sums = vec![vec![0.0; self.avatar.gaussians.len()]; n];
        for v in 0..views {
            let shot = self.capture.train[v * train / views];
            let target = self.target(shot)?;
            let out =
                self.avatar.picture(&self.capture.poses[target.time], Some(target.time), &target.camera)?;
            let Some((guide, window)) = self.window(&target)? else { continue };
            self.tally.renders += 1;
            self.tally.encodings += 1;
            let places = &self.avatar.gaussians.means;
            let mut seen = out.image;
            over_black::forward(&out.alpha, self.avatar.background, &mut seen);
            let scores = guide.swap_scores(&window.take(&seen), &window.take(&target.photo), places)?;
            if scores.len() != n || scores.iter().any(|s| s.len() != places.len()) {
                return Err(Error::input("model")
                    .expected(format!("{n} scores for each Gaussian"))
                    .got("a different number"));
            }
            for (sum, score) in sums.iter_mut().zip(&scores) {
                for (a, b) in sum.iter_mut().zip(score) {
                    *a += *b;
                }
            }
        }
        for x in sums.iter_mut().flatten() {
            *x /= views as f64;
        }
        Ok(sums)
    }
}
