//! Outdoor environments: a graded sky, a sun, clouds, and ground to the horizon.

use crate::draws::Draws;
use crate::noise::Noise;
use crate::space::{V3, add, clamp, dot, larger, mix, scaled, smoothstep, unit};
use reference::num::elem::{cos, exp, sin};
use std::f64::consts::{PI, TAU};

/// Radius of the sun in the map, radians: larger than the real one (0.0047), with proportionally lower
/// radiance.
const SUN_RADIUS: f64 = 0.02;

#[derive(Clone, Debug)]
pub(super) struct Sky {
    noise: Noise,
    zenith: V3,
    horizon: V3,
    sun: V3,
    sun_color: V3,
    /// Radiance of the disc; 0 if the sun is hidden.
    sun_level: f64,
    glow: f64,
    cloud: [f64; 2],
    ground: [V3; 2],
    light_on_ground: V3,
    hills: [f64; 2],
    hill_color: V3,
    trees: f64,
}

impl Sky {
    fn new(draws: &mut Draws, noise: &mut Draws, elevation: f64) -> Self {
        let azimuth = draws.range(0.0, TAU);
        let sun = [cos(elevation) * sin(azimuth), cos(elevation) * cos(azimuth), sin(elevation)];
        let grounds: [[V3; 2]; 5] = [
            [[0.12, 0.17, 0.05], [0.2, 0.22, 0.08]],
            [[0.25, 0.23, 0.21], [0.32, 0.3, 0.28]],
            [[0.38, 0.3, 0.2], [0.5, 0.4, 0.27]],
            [[0.09, 0.09, 0.1], [0.13, 0.13, 0.14]],
            [[0.6, 0.62, 0.66], [0.75, 0.76, 0.8]],
        ];
        Self {
            noise: Noise::new(noise),
            zenith: [0.22, 0.42, 0.95],
            horizon: [0.85, 0.95, 1.1],
            sun,
            sun_color: [1.0, 0.93, 0.82],
            sun_level: 0.0,
            glow: 1.0,
            cloud: [draws.range(-0.15, 0.5), draws.range(1.2, 3.0)],
            ground: draws.pick(&grounds),
            light_on_ground: [1.0; 3],
            hills: [draws.range(0.0, 0.16), draws.range(1.5, 5.0)],
            hill_color: mix([0.06, 0.1, 0.06], [0.25, 0.3, 0.38], draws.unit()),
            trees: if draws.chance(0.5) { draws.range(0.05, 0.25) } else { 0.0 },
        }
    }

    /// A high sun in a blue sky, with some clouds. The irradiance of the sun is 3 to 6 times that of the sky.
    pub(super) fn clear(draws: &mut Draws, noise: &mut Draws) -> Self {
        let elevation = draws.range(25.0, 65.0) * PI / 180.0;
        let mut sky = Self::new(draws, noise, elevation);
        let ratio = draws.range(3.0, 6.0);
        sky.set_sun(ratio, [1.0, 0.93, 0.82]);
        sky
    }

    /// A yellow or red sun near the horizon.
    pub(super) fn low_sun(draws: &mut Draws, noise: &mut Draws) -> Self {
        let elevation = draws.range(4.0, 16.0) * PI / 180.0;
        let mut sky = Self::new(draws, noise, elevation);
        let red = draws.unit();
        sky.zenith = mix([0.22, 0.36, 0.75], [0.16, 0.17, 0.4], red);
        sky.horizon = mix([1.0, 0.78, 0.5], [1.2, 0.5, 0.25], red);
        sky.glow = draws.range(1.5, 3.0);
        let ratio = draws.range(1.5, 3.0);
        sky.set_sun(ratio, mix([1.0, 0.78, 0.45], [1.0, 0.5, 0.2], red));
        sky
    }

    /// Grey clouds everywhere, three times brighter above than at the horizon.
    pub(super) fn overcast(draws: &mut Draws, noise: &mut Draws) -> Self {
        let elevation = draws.range(20.0, 60.0) * PI / 180.0;
        let mut sky = Self::new(draws, noise, elevation);
        let tint = mix([0.95, 0.98, 1.05], [1.05, 1.0, 0.93], draws.unit());
        sky.zenith = scaled(tint, 1.3);
        sky.horizon = scaled(tint, 0.5);
        sky.cloud[0] = -2.0;
        sky.glow = draws.range(0.2, 1.5);
        sky.light_on_ground = scaled(tint, 0.9);
        sky
    }

    fn set_sun(&mut self, ratio: f64, color: V3) {
        // A sky of radiance 1 has irradiance π; a disc of radius ρ at elevation e has L·πρ²·sin e.
        let seen = larger(self.sun[2], 0.25);
        self.sun_level = larger(ratio / (SUN_RADIUS * SUN_RADIUS * seen), 2000.0);
        self.sun_color = color;
        let direct = self.sun_level * SUN_RADIUS * SUN_RADIUS * self.sun[2];
        self.light_on_ground = add(scaled(color, direct), [0.6, 0.75, 1.0]);
    }

    pub(super) fn sun(&self) -> Option<V3> {
        (self.sun_level > 0.0).then_some(self.sun)
    }

    fn above(&self, d: V3) -> V3 {
        let up = larger(d[2], 0.0);
        let graded = mix(self.zenith, self.horizon, exp(-4.5 * up));
        let toward = dot(d, self.sun);
        let halo = self.glow * (0.9 * exp(-18.0 * (1.0 - toward)) + 0.25 * exp(-3.0 * (1.0 - toward)));
        let mut c = add(graded, scaled(self.sun_color, halo));
        // Clouds are in a horizontal plane above the camera.
        let flat = self.cloud[1] / (up + 0.12);
        let q = [d[0] * flat, d[1] * flat, 0.5];
        let x = self.noise.octaves(q, 5);
        let thick = smoothstep(self.cloud[0], self.cloud[0] + 0.35, x) * smoothstep(0.0, 0.1, up);
        if thick > 0.0 {
            let lit = 0.75 + 0.5 * self.noise.at(scaled(q, 2.3)) + 0.8 * exp(-6.0 * (1.0 - toward));
            let white = mix(self.horizon, [1.1, 1.1, 1.1], 0.6);
            let cloud =
                if self.sun_level > 0.0 { scaled(white, lit) } else { scaled(graded, 0.6 + 0.5 * lit) };
            c = mix(c, cloud, 0.85 * thick);
        }
        c
    }

    /// Radiance from a direction; `step` is the height of a texel, radians.
    pub(super) fn radiance(&self, d: V3, step: f64) -> V3 {
        let flat = larger((d[0] * d[0] + d[1] * d[1]).sqrt(), 1e-9);
        let around = [d[0] / flat, d[1] / flat];
        let q = [around[0] * self.hills[1], around[1] * self.hills[1], 7.3];
        let mut ridge = self.hills[0] * (0.5 + self.noise.octaves(q, 4));
        if self.trees > 0.0 {
            let crowns = self.noise.octaves([around[0] * 9.0, around[1] * 9.0, 2.2], 4);
            ridge = larger(ridge, self.trees * clamp(0.2 + 1.6 * crowns, 0.0, 1.0));
        }
        let skyline = smoothstep(-step, step, d[2] - larger(ridge, 0.0));
        let mut c = if skyline > 0.0 { self.above(d) } else { [0.0; 3] };
        if self.sun_level > 0.0 && skyline > 0.0 {
            let away = {
                let e = crate::space::sub(d, self.sun);
                dot(e, e).sqrt()
            };
            // The edge of the disc is one texel wide. The excess area of the soft disc over the sharp one (∫
            // share·2πr dr over πρ²) is compensated by its level, so the irradiance of the sun does not
            // depend on the size of the map.
            let (rho, edge) = (SUN_RADIUS, larger(step, 0.25 * SUN_RADIUS));
            let share = clamp(0.5 + (rho - away) / edge, 0.0, 1.0);
            let held = super::studio::soft_disc(rho, edge);
            c = add(c, scaled(self.sun_color, share * self.sun_level * rho * rho / held));
        }
        if skyline < 1.0 {
            let below = if d[2] > 0.0 {
                let grain = 0.7 + 0.6 * self.noise.octaves(scaled(d, 40.0), 3);
                let lit = 0.4 + 0.6 * clamp(0.5 - 0.5 * dot(unit([d[0], d[1], 0.2]), self.sun), 0.0, 1.0);
                let light = self.light_on_ground;
                std::array::from_fn(|k| self.hill_color[k] * light[k] * grain * lit * 0.5)
            } else {
                self.earth(d)
            };
            c = mix(below, c, skyline);
        }
        c
    }

    fn earth(&self, d: V3) -> V3 {
        let far = 1.0 / larger(-d[2], 0.01);
        let q = [d[0] * far, d[1] * far, 1.7];
        let rough = 0.5 + 0.8 * self.noise.octaves(scaled(q, 1.6), 4);
        let color = mix(self.ground[0], self.ground[1], clamp(rough, 0.0, 1.0));
        let haze = exp(-0.02 * far);
        let lit: V3 = std::array::from_fn(|k| color[k] * self.light_on_ground[k]);
        mix(scaled(self.horizon, 0.5), lit, haze)
    }
}
