//! The intervals of rays: where each ray crosses the box, and which steps of it take a sample.
//!
//! A ray enters the box [−R, R]³ at the distance t₀ (0 if it starts inside) and leaves it at t₁. Its steps are
//! [t₀ + i·h, t₀ + (i+1)·h] for i = 0, 1, …, the last of them cut at t₁. All steps take a sample, or those that
//! an occupancy grid keeps.

use crate::num::{order, par};

/// Rays per task.
const RAYS: usize = 1024;

/// Rays of a crop.
#[derive(Clone, Copy, Debug)]
pub struct Rays<'a> {
    /// Shape (N, 3).
    pub origins: &'a [[f32; 3]],
    /// Shape (N, 3), unit length.
    pub directions: &'a [[f32; 3]],
}

impl Rays<'_> {
    /// Number of rays.
    pub fn len(&self) -> usize {
        self.origins.len()
    }

    /// Whether there is no ray.
    pub fn is_empty(&self) -> bool {
        self.origins.is_empty()
    }

    /// Returns the point at the distance t along a ray.
    #[inline(always)]
    pub fn at(&self, ray: usize, t: f32) -> [f32; 3] {
        let (o, d) = (self.origins[ray], self.directions[ray]);
        [o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2]]
    }

    /// Returns the distances at which a ray enters and leaves the box [−R, R]³; the entry is not smaller than
    /// the exit if the ray misses the box.
    pub fn crossing(&self, ray: usize, half_size: f32) -> [f32; 2] {
        let mut span = [0.0, f32::MAX];
        for (o, d) in self.origins[ray].into_iter().zip(self.directions[ray]) {
            if d == 0.0 {
                if o.abs() > half_size {
                    return [f32::MAX, 0.0];
                }
                continue;
            }
            let [a, b] = [(-half_size - o) / d, (half_size - o) / d];
            span = [order::max(span[0], order::min(a, b)), order::min(span[1], order::max(a, b))];
        }
        span
    }
}

/// The steps that take a sample: the discrete decisions before rendering.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Intervals {
    /// Length h of a step.
    pub step: f32,
    /// Distances at which each ray enters and leaves the box, (N); (0, 0) for a ray that misses it.
    pub spans: Vec<[f32; 2]>,
    /// First entry of each ray in `index`, (N + 1).
    pub start: Vec<usize>,
    /// Steps that take a sample, ascending within a ray.
    pub index: Vec<u32>,
}

impl Intervals {
    /// Returns all steps of all rays.
    pub fn all(rays: Rays<'_>, half_size: f32, step: f32) -> Self {
        Self::kept(rays, half_size, step, |_, _, steps| steps.collect())
    }

    /// Returns the steps of the rays that `keep(ray, span, all steps)` returns, in ascending order.
    pub fn kept(
        rays: Rays<'_>,
        half_size: f32,
        step: f32,
        keep: impl Fn(usize, [f32; 2], std::ops::Range<u32>) -> Vec<u32> + Sync + Send,
    ) -> Self {
        let crossings = par::map_batched(rays.len(), RAYS, |ray| {
            let [enter, leave] = rays.crossing(ray, half_size);
            if !(enter < leave) {
                return ([0.0; 2], Vec::new());
            }
            let span = [enter, leave];
            (span, keep(ray, span, 0..steps(span, step)))
        });
        let mut made = Self { step, start: vec![0], ..Self::default() };
        for (span, steps) in crossings {
            made.spans.push(span);
            made.index.extend(steps);
            made.start.push(made.index.len());
        }
        made
    }

    /// Number of rays.
    pub fn rays(&self) -> usize {
        self.spans.len()
    }

    /// Number of samples.
    pub fn samples(&self) -> usize {
        self.index.len()
    }

    /// Returns the distances at which the step of sample `s` of a ray begins and ends.
    #[inline(always)]
    pub fn ends(&self, ray: usize, s: usize) -> [f32; 2] {
        let (i, [enter, leave]) = (self.index[s] as f32, self.spans[ray]);
        [enter + i * self.step, order::min(enter + (i + 1.0) * self.step, leave)]
    }

    /// Whether sample `s` of a ray begins where the one before ends.
    #[inline(always)]
    pub fn continues(&self, ray: usize, s: usize) -> bool {
        s > self.start[ray] && self.index[s] == self.index[s - 1] + 1
    }
}

/// Number of steps in a span: those that begin before its end.
fn steps([enter, leave]: [f32; 2], step: f32) -> u32 {
    let mut n = ((leave - enter) / step) as u32;
    while enter + n as f32 * step < leave {
        n += 1;
    }
    while n > 0 && enter + (n - 1) as f32 * step >= leave {
        n -= 1;
    }
    n
}
