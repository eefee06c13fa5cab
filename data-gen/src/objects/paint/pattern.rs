//! Patterns of layers over the charts and in space, as coverages from 0 to 1.

use super::lettering::Print;
use crate::noise::Noise;
use crate::space::{V3, add, clamp, dot, larger, length, scaled, smaller, smoothstep, sub};
use reference::num::elem::sin;
use std::f64::consts::TAU;

/// A point on the surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spot {
    /// Position in the object.
    pub(super) p: V3,
    /// Position on the chart, as lengths.
    pub(super) st: [f64; 2],
}

/// Patterns; lengths are those of the object, whose radius is ½.
#[derive(Clone, Debug)]
pub(super) enum Pattern {
    /// Squares on the chart.
    Checks { size: f64 },
    /// Cubes through space.
    Cubes { size: f64 },
    /// Bands across a direction in space.
    Stripes { along: V3, period: f64, share: f64 },
    /// Bands on the chart, of several widths and in both directions; the value 0..1 is the number of
    /// overlapping bands.
    Plaid { period: f64, shares: [f64; 4] },
    /// Discs on a staggered grid of the chart.
    Dots { period: f64, radius: f64 },
    /// The joints between bricks of the chart.
    Joints { width: f64, height: f64, joint: f64 },
    /// Regions where noise is above a level.
    Patches { frequency: f64, octaves: usize, level: f64, soft: f64 },
    /// Veins.
    Veins { along: V3, frequency: f64, sway: f64, sharp: f64 },
    /// Annual rings around an axis.
    Rings { axis: V3, off: V3, frequency: f64, sway: f64 },
    /// Chips of stone: a fraction of the cells of space around scattered seeds.
    Chips { size: f64, share: f64 },
    /// The gaps between these cells.
    Cracks { size: f64, width: f64 },
    /// Fine lines mostly along one direction of the chart.
    Scratches { frequency: f64, slope: f64, level: f64 },
    /// A print repeated over the chart: its ink or its second colour.
    Print { print: Print, dot: f64, is_accent: bool },
    /// The background of a printed sheet: rectangles with a margin around them.
    Sheet { width: f64, height: f64, margin: f64 },
    /// A ramp from 0 to 1 along a direction.
    Ramp { along: V3, from: f64, to: f64 },
}

/// Coverage at signed distance d from an edge (positive inside), softened over one texel.
fn edge(d: f64, texel: f64) -> f64 {
    clamp(0.5 + d / texel, 0.0, 1.0)
}

/// Distance of a repeated coordinate from the border of the interval (0, share·period); negative outside.
fn band(x: f64, period: f64, share: f64) -> f64 {
    let t = x - period * (x / period).floor();
    let w = share * period;
    // The band itself, and the next one, which is nearer in the second half of the gap.
    larger(smaller(t, w - t), smaller(t - period, w - (t - period)))
}

impl Pattern {
    /// Coverage at a point; `texel` is the length of a texel.
    pub(super) fn at(&self, spot: &Spot, noise: &Noise, texel: f64) -> f64 {
        let [s, t] = spot.st;
        match self {
            Self::Checks { size } => {
                let [a, b] = [s, t].map(|x| edge(band(x, 2.0 * size, 0.5), texel));
                a + b - 2.0 * a * b
            }
            Self::Cubes { size } => spot.p.iter().fold(0.0, |c, x| {
                let a = edge(band(x + 0.313, 2.0 * size, 0.5), texel);
                c + a - 2.0 * a * c
            }),
            Self::Stripes { along, period, share } => {
                edge(band(dot(*along, spot.p) + 1.0, *period, *share), texel)
            }
            Self::Plaid { period, shares } => {
                let lines = |x: f64| {
                    let wide = edge(band(x, *period, shares[0]), texel);
                    let thin = edge(band(x + shares[2] * period, *period, shares[1]), texel);
                    clamp(wide + shares[3] * thin, 0.0, 1.0)
                };
                0.5 * (lines(s) + lines(t))
            }
            Self::Dots { period, radius } => {
                let row = (t / (0.866 * period)).floor();
                let mut d: f64 = f64::INFINITY;
                for r in [row, row + 1.0] {
                    let odd = r - 2.0 * (0.5 * r).floor();
                    let x = s / period + 0.5 * odd;
                    let dx = (x - (x + 0.5).floor()) * period;
                    let dy = t - r * 0.866 * period;
                    d = smaller(d, (dx * dx + dy * dy).sqrt());
                }
                edge(radius - d, texel)
            }
            Self::Joints { width, height, joint } => {
                let row = (t / height).floor();
                let odd = row - 2.0 * (0.5 * row).floor();
                let x = band(s + 0.5 * odd * width, *width, joint / width);
                edge(larger(x, band(t, *height, joint / height)), texel)
            }
            Self::Patches { frequency, octaves, level, soft } => {
                let x = noise.octaves(scaled(spot.p, *frequency), *octaves);
                smoothstep(level - soft, level + soft, x)
            }
            Self::Veins { along, frequency, sway, sharp } => {
                let q = scaled(spot.p, *frequency);
                let x = dot(*along, q) + sway * noise.octaves(scaled(q, 0.7), 4);
                let v = 1.0 - sin(TAU * 0.5 * x).abs();
                clamp((v - (1.0 - sharp)) / sharp, 0.0, 1.0)
            }
            Self::Rings { axis, off, frequency, sway } => {
                let q = add(spot.p, *off);
                let q = sub(q, scaled(*axis, dot(*axis, q)));
                let stretched = sub(spot.p, scaled(*axis, 0.8 * dot(*axis, spot.p)));
                let r = length(q) * frequency + sway * noise.octaves(scaled(stretched, 4.0), 2);
                let t = r - r.floor();
                let grain = noise.at(scaled(stretched, 70.0));
                clamp(smoothstep(0.1, 0.85, t) * (1.0 - smoothstep(0.88, 1.0, t)) + 0.18 * grain, 0.0, 1.0)
            }
            Self::Chips { size, share } => {
                let (_, _, id) = cells(noise, scaled(spot.p, 1.0 / size));
                if f64::from(id) < 256.0 * share { 1.0 } else { 0.0 }
            }
            Self::Cracks { size, width } => {
                let (first, second, _) = cells(noise, scaled(spot.p, 1.0 / size));
                edge(width - (second - first) * size, texel)
            }
            Self::Scratches { frequency, slope, level } => {
                let line = |a: f64, b: f64, z: f64| noise.at([a * frequency, b * frequency * 0.02, z]);
                let a = line(s + slope * t, t - slope * s, 7.5);
                let b = line(s - 0.7 * t, t + 0.7 * s, 33.5);
                let fade = noise.at([9.0 * s, 9.0 * t, 3.5]);
                let x = larger(a, b) + 0.25 * fade;
                smoothstep(*level, level + 0.12, x)
            }
            Self::Print { print, dot, is_accent } => {
                let [ink, accent] = print.at(s / dot, -t / dot);
                if *is_accent { accent } else { ink }
            }
            Self::Sheet { width, height, margin } => {
                let inside = |x: f64, period: f64| {
                    let t = x - period * (x / period).floor();
                    smaller(t, period - t) - margin
                };
                edge(smaller(inside(s, *width), inside(-t, *height)), texel)
            }
            Self::Ramp { along, from, to } => smoothstep(*from, *to, dot(*along, spot.p)),
        }
    }
}

/// Distances to the nearest two scattered seeds, one per unit cube, and a random byte of the nearest.
fn cells(noise: &Noise, p: V3) -> (f64, f64, u8) {
    let low = p.map(|x| x.floor() as i64);
    let (mut first, mut second, mut id) = (f64::INFINITY, f64::INFINITY, 0);
    for dz in -1..=1 {
        for dy in -1..=1 {
            for dx in -1..=1 {
                let [x, y, z] = [low[0] + dx, low[1] + dy, low[2] + dz];
                let a = noise.cell(x, y, z);
                let (b, c) = (noise.cell(x + 77, y, z), noise.cell(x, y + 101, z));
                let at = |k: i64, r: u8| k as f64 + 0.1 + 0.8 * f64::from(r) / 255.0;
                let d = sub(p, [at(x, a), at(y, b), at(z, c)]);
                let d = dot(d, d);
                if d < first {
                    (second, first, id) = (first, d, b ^ c.rotate_left(3));
                } else if d < second {
                    second = d;
                }
            }
        }
    }
    (first.sqrt(), second.sqrt(), id)
}
