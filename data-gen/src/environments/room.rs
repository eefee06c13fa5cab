//! A room: six walls around the object, windows, ceiling lamps, doors, pictures, tiles or boards on the
//! floor.

use crate::draws::Draws;
use crate::noise::Noise;
use crate::space::{V3, add, clamp, dot, larger, mix, scaled, smaller, smoothstep, sub};
use std::f64::consts::PI;

/// A rectangle on a wall: axis 0..3 and side −1 or 1 of the wall, middle and half sizes along the other two
/// axes.
#[derive(Clone, Debug)]
struct Rect {
    axis: usize,
    side: f64,
    middle: [f64; 2],
    half: [f64; 2],
    color: V3,
    /// Radiance; 0 for an object that is only lit.
    level: f64,
    bars: bool,
}

#[derive(Clone, Debug)]
pub(super) struct Room {
    noise: Noise,
    /// Positions of the six walls: low, high.
    walls: [V3; 2],
    /// Colours of the walls by axis and side.
    paint: [[V3; 2]; 3],
    rects: Vec<Rect>,
    ambient: V3,
    tiles: f64,
    boards: bool,
}

impl Rect {
    fn others(&self) -> [usize; 2] {
        match self.axis {
            0 => [1, 2],
            1 => [0, 2],
            _ => [0, 1],
        }
    }
}

impl Room {
    pub(super) fn new(draws: &mut Draws, noise: &mut Draws) -> Self {
        let extent = |draws: &mut Draws| [-draws.range(1.2, 3.5), draws.range(1.2, 3.5)];
        let (x, y) = (extent(draws), extent(draws));
        let (floor, ceiling) = (-draws.range(0.7, 1.2), draws.range(1.3, 2.0));
        let walls = [[x[0], y[0], floor], [x[1], y[1], ceiling]];
        let shade = |draws: &mut Draws| {
            let tint = draws.direction().map(|x| 0.75 + 0.2 * x);
            let lightness = draws.range(0.4, 0.85);
            scaled(tint, lightness)
        };
        let base = shade(draws);
        let accent = shade(draws);
        let wall = |draws: &mut Draws| if draws.chance(0.25) { accent } else { base };
        let floors: [V3; 5] =
            [[0.32, 0.2, 0.11], [0.45, 0.33, 0.2], [0.4, 0.39, 0.37], [0.2, 0.2, 0.21], [0.55, 0.5, 0.42]];
        let paint = [
            [wall(draws), wall(draws)],
            [wall(draws), wall(draws)],
            [draws.pick(&floors), [0.82, 0.82, 0.8]],
        ];
        let mut rects = Vec::new();
        let day = draws.chance(0.7);
        let windows = draws.whole(1, 4);
        let outside = mix([1.0, 0.95, 0.85], [0.8, 0.95, 1.15], draws.unit());
        let lit_axis = draws.whole(0, 2);
        for k in 0..windows {
            let axis = if draws.chance(0.7) { lit_axis } else { 1 - lit_axis };
            let side = if k % 2 == 0 || draws.chance(0.7) { 1.0 } else { -1.0 };
            let (low, high) = (walls[0][1 - axis], walls[1][1 - axis]);
            let half = [smaller(draws.range(0.3, 0.8), 0.4 * (high - low)), draws.range(0.35, 0.6)];
            let middle = [draws.range(low + half[0], high - half[0]), floor + draws.range(1.2, 1.5)];
            let level = if day { draws.range(5.0, 14.0) } else { draws.range(0.02, 0.1) };
            rects.push(Rect { axis, side, middle, half, color: outside, level, bars: draws.chance(0.7) });
        }
        let lamps = if day { draws.whole(0, 4) } else { draws.whole(2, 6) };
        let warm = mix([1.0, 0.75, 0.45], [0.95, 0.98, 1.0], draws.unit());
        for _ in 0..lamps {
            let half = if draws.chance(0.5) {
                [draws.range(0.06, 0.14); 2]
            } else {
                [draws.range(0.08, 0.15), draws.range(0.3, 0.6)]
            };
            let middle = [draws.range(0.7 * x[0], 0.7 * x[1]), draws.range(0.7 * y[0], 0.7 * y[1])];
            let level = draws.range(1.5, 4.0) / (4.0 * half[0] * half[1]);
            rects.push(Rect { axis: 2, side: 1.0, middle, half, color: warm, level, bars: false });
        }
        for _ in 0..draws.whole(2, 7) {
            let axis = draws.whole(0, 2);
            let side = if draws.chance(0.5) { 1.0 } else { -1.0 };
            let (low, high) = (walls[0][1 - axis], walls[1][1 - axis]);
            let color = draws.direction().map(|x| clamp(0.45 + 0.4 * x, 0.04, 0.9));
            // A door, a board, or a picture.
            let (half, z) = match draws.whole(0, 3) {
                0 => ([0.4, 0.95], floor + 0.95),
                1 => ([draws.range(0.3, 0.7), draws.range(0.3, 0.8)], floor + 0.5),
                _ => ([draws.range(0.15, 0.5), draws.range(0.15, 0.4)], floor + draws.range(1.2, 1.6)),
            };
            let middle = [draws.range(low + 0.2, high - 0.2), z];
            rects.push(Rect { axis, side, middle, half, color, level: 0.0, bars: false });
        }
        let mut room = Self {
            noise: Noise::new(noise),
            walls,
            paint,
            rects,
            ambient: [0.0; 3],
            tiles: draws.range(0.2, 0.6),
            boards: draws.chance(0.5),
        };
        // Light reflected by the walls at least once: the power of the sources divided by the area of the
        // walls, times ρ/(1 − ρ).
        let [a, b, c]: V3 = std::array::from_fn(|k| walls[1][k] - walls[0][k]);
        let area = 2.0 * (a * b + b * c + c * a);
        let mut power = [0.0; 3];
        for r in &room.rects {
            power = add(power, scaled(r.color, r.level * 4.0 * r.half[0] * r.half[1]));
        }
        let rho = scaled(base, 0.8);
        room.ambient = std::array::from_fn(|k| power[k] / area * rho[k] / (1.0 - rho[k]));
        room
    }

    /// Point on the wall in a direction from the origin, with the axis and the side of that wall.
    fn hit(&self, d: V3) -> (V3, usize, f64) {
        let mut best = (f64::INFINITY, 0, 1.0);
        for axis in 0..3 {
            if d[axis] != 0.0 {
                let side = if d[axis] > 0.0 { 1.0 } else { -1.0 };
                let t = self.walls[usize::from(side > 0.0)][axis] / d[axis];
                if t < best.0 {
                    best = (t, axis, side);
                }
            }
        }
        (scaled(d, best.0), best.1, best.2)
    }

    pub(super) fn radiance(&self, d: V3) -> V3 {
        let (p, axis, side) = self.hit(d);
        let mut albedo = self.paint[axis][usize::from(side > 0.0)];
        if axis == 2 && side < 0.0 {
            albedo = scaled(albedo, self.floor_pattern(p));
        } else {
            albedo = scaled(albedo, 0.95 + 0.1 * self.noise.octaves(scaled(p, 3.0), 3));
        }
        let mut glow = [0.0; 3];
        for r in &self.rects {
            if r.axis != axis || r.side * side < 0.0 {
                continue;
            }
            let [u, v] = r.others();
            let (x, y) = (p[u] - r.middle[0], p[v] - r.middle[1]);
            let inside = smaller(r.half[0] - x.abs(), r.half[1] - y.abs());
            let share = smoothstep(-0.012, 0.012, inside);
            if share <= 0.0 {
                continue;
            }
            let is_bar = r.bars && (x.abs() < 0.025 || (y - 0.1).abs() < 0.02) || inside < 0.03;
            if r.level > 0.0 && !is_bar {
                // Outside the window, the sky is brighter than the ground.
                let height = clamp(0.5 + 0.5 * y / r.half[1], 0.0, 1.0);
                let view = if axis == 2 { 1.0 } else { 0.45 + 0.55 * smoothstep(0.2, 0.45, height) };
                glow = add(scaled(glow, 1.0 - share), scaled(r.color, share * r.level * view));
                albedo = scaled(albedo, 1.0 - share);
            } else {
                let frame = if r.level > 0.0 { [0.8; 3] } else { r.color };
                albedo = mix(albedo, frame, share);
            }
        }
        let inward: V3 = std::array::from_fn(|k| if k == axis { -side } else { 0.0 });
        let light = add(self.arriving(p, inward), self.ambient);
        add(glow, std::array::from_fn(|k| albedo[k] * light[k]))
    }

    fn floor_pattern(&self, p: V3) -> f64 {
        let fraction = |x: f64| x - x.floor();
        if self.boards {
            let board = (p[0] / 0.15).floor();
            let tone = 0.75 + 0.45 * self.noise.at([board * 0.73 + 0.4, 0.3 * p[1], 0.5]);
            let joint = fraction(p[0] / 0.15);
            tone * if joint < 0.04 { 0.5 } else { 1.0 }
        } else {
            let (x, y) = (fraction(p[0] / self.tiles), fraction(p[1] / self.tiles));
            let odd = ((p[0] / self.tiles).floor() + (p[1] / self.tiles).floor()) as i64 & 1;
            let joint = x < 0.03 || y < 0.03;
            if joint { 0.5 } else { 0.85 + 0.3 * odd as f64 }
        }
    }

    /// Irradiance over π at a position from every source; distant sources are treated as points.
    fn arriving(&self, p: V3, normal: V3) -> V3 {
        let mut sum = [0.0; 3];
        for r in self.rects.iter().filter(|r| r.level > 0.0) {
            let [u, v] = r.others();
            let mut center = [0.0; 3];
            center[r.axis] = self.walls[usize::from(r.side > 0.0)][r.axis];
            center[u] = r.middle[0];
            center[v] = r.middle[1];
            let away = sub(center, p);
            let d2 = dot(away, away);
            let d = larger(d2.sqrt(), 1e-6);
            let leaving = larger(r.side * away[r.axis] / d, 0.0);
            let landing = larger(dot(normal, away) / d, 0.0);
            let area = 4.0 * r.half[0] * r.half[1];
            sum = add(sum, scaled(r.color, r.level * area * leaving * landing / (PI * (d2 + area))));
        }
        sum
    }
}
