//! Generated scenes: a cloud of Gaussians in front of rotated cameras with different focal lengths; one
//! Gaussian is behind all cameras.

use crate::num::array::Arrays;
use crate::ops::case::Draw;

/// Parameters of a generated scene.
#[derive(Clone, Copy)]
pub(super) struct Scene {
    /// seed of the operator
    pub(super) seed: u64,
    /// index of the case of the operator
    pub(super) case: usize,
    /// number of Gaussians
    pub(super) n: usize,
    /// number of cameras
    pub(super) cameras: usize,
    /// image width in pixels
    pub(super) width: usize,
    /// image height in pixels
    pub(super) height: usize,
    /// focal lengths in pixels
    pub(super) focal: [f32; 2],
    /// largest and smallest opacity
    pub(super) opacity: [f32; 2],
    /// smallest and largest standard deviation
    pub(super) scale: [f32; 2],
}

impl Scene {
    /// Two images of 36×22 pixels, with partial tiles at both borders.
    pub(super) const fn new(seed: u64, case: usize, n: usize) -> Self {
        Self {
            seed,
            case,
            n,
            cameras: 2,
            width: 36,
            height: 22,
            focal: [41.0, 37.0],
            opacity: [0.15, 0.9],
            scale: [0.06, 0.35],
        }
    }

    fn draw(&self, array: u16) -> Draw {
        Draw::new(self.seed, self.case, array)
    }

    /// Centres in a box around the origin; the last one far behind every camera.
    fn means(&self) -> Vec<f32> {
        let mut means = self.draw(0).uniforms(3 * self.n, -0.9, 0.9);
        if self.n > 4 {
            means[3 * (self.n - 1)..].copy_from_slice(&[0.25, -0.5, -6.0]);
        }
        means
    }

    /// Camera `c`: rotated by a small angle, the origin 3 + c/4 in front of it.
    fn view(&self, c: usize) -> [f32; 16] {
        let spin = self.draw(100 + c as u16).normals(3);
        let q = [1.0, 0.15 * spin[0], 0.15 * spin[1], 0.15 * spin[2]];
        let r = crate::math::quat::rotation(q);
        let t = [0.11 - 0.2 * c as f32, -0.07, 3.0 + 0.25 * c as f32];
        [r[0], r[1], r[2], t[0], r[3], r[4], r[5], t[1], r[6], r[7], r[8], t[2], 0.0, 0.0, 0.0, 1.0]
    }

    /// Adds the arrays of those names.
    pub(super) fn put(&self, into: &mut Arrays, names: &[&str]) {
        let n = self.n;
        for &name in names {
            match name {
                "means" => into.put(name, &[n, 3], self.means()),
                "quats" => into.put(name, &[n, 4], self.draw(1).normals(4 * n)),
                "scales" => {
                    into.put(name, &[n, 3], self.draw(2).uniforms(3 * n, self.scale[0], self.scale[1]))
                }
                "factors" => {
                    let f =
                        self.draw(3).normals(9 * n).into_iter().map(|x| 0.5 * self.scale[1] * x).collect();
                    into.put(name, &[n, 3, 3], f);
                }
                "opacities" => {
                    into.put(name, &[n], self.draw(4).uniforms(n, self.opacity[0], self.opacity[1]))
                }
                "rgb" => into.put(name, &[n, 3], self.draw(5).uniforms(3 * n, 0.05, 0.95)),
                "background" => into.put(name, &[3], vec![0.25_f32, 0.5, 0.0625]),
                "view_from_world" => {
                    into.put(
                        name,
                        &[self.cameras, 4, 4],
                        (0..self.cameras).flat_map(|c| self.view(c)).collect(),
                    );
                }
                "intrinsics" => {
                    let center = [0.52 * self.width as f32, 0.47 * self.height as f32];
                    let k = [self.focal[0], 0.0, center[0], 0.0, self.focal[1], center[1], 0.0, 0.0, 1.0];
                    into.put(name, &[self.cameras, 3, 3], k.repeat(self.cameras));
                }
                "width" => into.put(name, &[], vec![self.width as i64]),
                "height" => into.put(name, &[], vec![self.height as i64]),
                "near" => into.put(name, &[], vec![0.125_f32]),
                other => unreachable!("the generators name arrays of this list, not {other}"),
            }
        }
    }

    /// Adds `sh` (N, K, 3) and `sh_degree`: positive on average, so that few channels are clamped at 0.
    pub(super) fn put_sh(&self, into: &mut Arrays, coefficients: usize, degree: i64) {
        let n = self.n;
        let sh = self.draw(6).normals(n * coefficients * 3);
        let lifted = |(e, x): (usize, f32)| if e / 3 % coefficients == 0 { 0.6 + 0.8 * x } else { 0.25 * x };
        into.put("sh", &[n, coefficients, 3], sh.into_iter().enumerate().map(lifted).collect());
        into.put("sh_degree", &[], vec![degree]);
    }
}
