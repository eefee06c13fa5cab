//! Dark rooms with lights: the soft boxes of a photographer, or many small lamps at night.

use crate::draws::Draws;
use crate::space::{V3, clamp, cross, dot, larger, mix, scaled, smaller, unit};

/// A rectangular or circular light at distance 1, facing the origin.
#[derive(Clone, Debug)]
struct Panel {
    center: V3,
    across: V3,
    up: V3,
    half: [f64; 2],
    is_disc: bool,
    color: V3,
    level: f64,
    /// Ratio of the brightness at the border to that in the middle.
    fall: f64,
}

#[derive(Clone, Debug)]
pub(super) struct StudioLight {
    panels: Vec<Panel>,
    wall: [V3; 2],
    floor: V3,
}

/// Colour of a lamp, from warm to cold.
fn white(draws: &mut Draws) -> V3 {
    mix([1.0, 0.8, 0.55], [0.85, 0.95, 1.1], draws.unit())
}

fn panel(draws: &mut Draws, low: f64, half: [f64; 2], level: f64, color: V3) -> Panel {
    let mut center = draws.direction();
    if center[2] < low {
        center = unit([center[0], center[1], low + 0.4 * (center[2] + 1.0)]);
    }
    let helper = if center[2].abs() < 0.95 { [0.0, 0.0, 1.0] } else { [1.0, 0.0, 0.0] };
    let across = unit(cross(center, helper));
    let up = cross(across, center);
    let is_disc = draws.chance(0.25);
    Panel { center, across, up, half, is_disc, color, level, fall: draws.range(0.4, 1.0) }
}

/// Fraction of a window of width `step` around x that overlaps −half..half.
fn seen(x: f64, half: f64, step: f64) -> f64 {
    let (low, high) = (larger(x - 0.5 * step, -half), smaller(x + 0.5 * step, half));
    larger(high - low, 0.0) / step
}

/// Area over π of a disc of radius r whose edge fades over `edge`.
pub(super) fn soft_disc(r: f64, edge: f64) -> f64 {
    let out = r + 0.5 * edge;
    if edge <= 2.0 * r { r * r + edge * edge / 12.0 } else { out * out * out / (3.0 * edge) }
}

impl StudioLight {
    /// Two to five soft boxes, strips and reflectors around a grey room.
    pub(super) fn daylight(draws: &mut Draws) -> Self {
        let count = draws.whole(2, 6);
        let mut panels = Vec::new();
        for k in 0..count {
            let half = match draws.whole(0, 3) {
                0 => [draws.range(0.06, 0.12), draws.range(0.4, 0.9)],
                _ => [draws.range(0.15, 0.5), draws.range(0.15, 0.5)],
            };
            let solid = 4.0 * half[0] * half[1];
            let key = if k == 0 { draws.range(2.0, 4.5) } else { draws.range(0.3, 1.8) };
            let color = if draws.chance(0.15) {
                mix(draws.direction().map(|x| 0.5 + 0.5 * x), [1.0; 3], 0.3)
            } else {
                white(draws)
            };
            panels.push(panel(draws, -0.1, half, key / solid, color));
        }
        let grey = draws.range(0.02, 0.4);
        let tint = mix([1.0; 3], white(draws), 0.4);
        Self {
            panels,
            wall: [scaled(tint, grey * draws.range(0.3, 1.0)), scaled(tint, grey)],
            floor: scaled(tint, grey * draws.range(0.5, 1.5)),
        }
    }

    /// Twenty to sixty small coloured lamps in the dark.
    pub(super) fn night(draws: &mut Draws) -> Self {
        let count = draws.whole(20, 60);
        let panels = (0..count)
            .map(|_| {
                let size = draws.range(0.012, 0.06);
                let half = [size, size * draws.range(1.0, 3.0)];
                let color = if draws.chance(0.5) {
                    white(draws)
                } else {
                    draws.direction().map(|x| clamp(0.5 + 0.6 * x, 0.02, 1.0))
                };
                let level = draws.range(0.04, 0.3) / (4.0 * half[0] * half[1]);
                let mut p = panel(draws, -0.35, half, level, color);
                // Most lights of a town are near the horizon.
                if draws.chance(0.6) {
                    let z = draws.range(-0.1, 0.3);
                    let low = unit([p.center[0], p.center[1], z]);
                    p.across = unit(cross(low, [0.0, 0.0, 1.0]));
                    p.up = cross(p.across, low);
                    p.center = low;
                }
                p
            })
            .collect();
        let dusk = draws.range(0.005, 0.06);
        Self {
            panels,
            wall: [[0.4 * dusk, 0.5 * dusk, dusk], [dusk, 0.8 * dusk, 0.7 * dusk]],
            floor: [dusk, 0.9 * dusk, 0.8 * dusk],
        }
    }

    /// The panel with the highest luminance; `None` for the many lamps of a night.
    pub(super) fn brightest(&self) -> Option<V3> {
        let bright = |p: &Panel| p.level * dot(p.color, [0.2126, 0.7152, 0.0722]);
        let first = self.panels.first().filter(|_| self.panels.len() < 10)?;
        let best = self.panels.iter().fold(first, |a, b| if bright(b) > bright(a) { b } else { a });
        Some(best.center)
    }

    /// Radiance from a direction; `step` is the height of a texel, radians.
    pub(super) fn radiance(&self, d: V3, step: f64) -> V3 {
        let mut c = if d[2] > -0.25 {
            mix(self.wall[1], self.wall[0], clamp(0.5 + 0.5 * d[2], 0.0, 1.0))
        } else {
            // Floor: brighter towards the nadir.
            scaled(self.floor, 0.6 + 0.8 * clamp(-d[2] - 0.25, 0.0, 1.0))
        };
        for p in &self.panels {
            let along = dot(d, p.center);
            if along <= 0.05 {
                continue;
            }
            let (x, y) = (dot(d, p.across) / along, dot(d, p.up) / along);
            // The fraction of a window one texel wide that the panel covers.
            let share = if p.is_disc {
                let r = smaller(p.half[0], p.half[1]);
                clamp(0.5 + (r - (x * x + y * y).sqrt()) / step, 0.0, 1.0) * r * r / soft_disc(r, step)
            } else {
                seen(x, p.half[0], step) * seen(y, p.half[1], step)
            };
            if share > 0.0 {
                let (u, v) = (x / p.half[0], y / p.half[1]);
                let off = larger(1.0 - 0.5 * (u * u + v * v), 0.0);
                let level = p.level * (p.fall + (1.0 - p.fall) * off);
                c = mix(c, scaled(p.color, level), share);
            }
        }
        c
    }
}
