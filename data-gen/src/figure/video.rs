//! The video of a subject: motion of the factors, and positions of the cameras.
//!
//! The noise moves smoothly, e_j(t) = sin(2π h t/T + ψ) + sin(2π h' t/T + ψ') with two harmonics of the clip
//! that no other factor has, so over a whole clip of T > 4 n frames the noises have mean 0, variance 1 and
//! are uncorrelated; in shorter clips the highest harmonics, up to 2 n, alias ([`is_balanced`]). Every
//! subject has a motion of its own. The factors follow from the noise by the same mechanisms as in the sets.

use super::mechanism::Scm;
use super::samples::Frame;
use super::{MAX_FACTORS, purpose};
use crate::splats::{View, look_at};
use reference::num::elem::{cos, sin};
use reference::num::rng::{Key, uniform_f64};
use std::f64::consts::TAU;

/// Number of cameras on the ring; camera 0 is the training camera.
pub const CAMERAS: usize = 23;

/// Distance of the ring from the figure's axis: three body heights.
pub const RADIUS: f64 = 6.0;

/// Height of the ring above the figure's middle.
const HEIGHT: f64 = 0.35;

/// Half-width of the visible region at the distance of the figure.
const HALF_WIDTH: f64 = 1.2;

/// Interval between frames rendered by the test cameras.
pub const TEST_STEP: usize = 30;

/// Camera `index` of the ring, with square images of the given side: camera 0 is in front of the figure, and
/// the others follow towards its left.
pub fn camera(index: usize, side: usize) -> View {
    let angle = TAU * index as f64 / CAMERAS as f64;
    let eye = [RADIUS * sin(angle), -RADIUS * cos(angle), HEIGHT];
    let focal = 0.5 * side as f64 * RADIUS / HALF_WIDTH;
    look_at(eye, [0.0, 0.0, 0.0], [focal, focal], side, side)
}

/// `count` of the 22 test cameras, spread evenly: numbers 1 to 22 for all of them.
pub fn test_cameras(count: usize) -> Vec<usize> {
    let others = CAMERAS - 1;
    (0..count).map(|k| 1 + (2 * k + 1) * others / (2 * count)).collect()
}

/// Whether the noises of `n` factors have mean 0, variance 1 and no correlation over a clip of `count`
/// frames.
pub fn is_balanced(n: usize, count: usize) -> bool {
    count > 4 * n
}

/// Frame `t` of `count`.
pub fn frame(scm: &Scm, seed: u64, appearance: u64, t: usize, count: usize) -> Frame {
    let n = scm.graph.n();
    let draw = |j: usize, draw: u16| {
        uniform_f64(Key {
            seed,
            item: appearance.wrapping_mul(MAX_FACTORS as u64).wrapping_add(j as u64),
            step: 0,
            purpose: purpose::MOTION,
            draw,
        })
    };
    // Harmonics in a random order: the first n are used in the first sine of each factor, the others in the
    // second.
    let ranked = |from: usize, which: u16| {
        let mut places: Vec<usize> = (0..n).collect();
        places.sort_by(|&a, &b| draw(a, which).total_cmp(&draw(b, which)).then(a.cmp(&b)));
        move |j: usize| from + places[j]
    };
    let (slow, fast) = (ranked(1, 0), ranked(1 + n, 1));
    let phase = t as f64 / count as f64;
    let wave = |harmonic: usize, j: usize, which: u16| sin(TAU * (harmonic as f64 * phase + draw(j, which)));
    let e: Vec<f64> = (0..n).map(|j| wave(slow(j), j, 2) + wave(fast(j), j, 3)).collect();
    let u = scm.factors(&e, None);
    Frame { appearance, e, u }
}
