//! Points on the canonical surface, in a fixed order: the template of a character.
//!
//! Point p lies on the triangle t with C_(t−1) ≤ r_p · C_T < C_t, C the running sum of areas and r_p a
//! uniform number, at barycentric weights (1 − √a, √a (1 − b), √a b) with two more: uniform by area. Draws
//! are a function of (seed, p): the first points of a larger template are those of a smaller one.

use super::motion::Pose;
use super::posed::{Face, blended, posed_normal, share, swung};
use super::rig::largest;
use super::skinned::{Character, INFLUENCES};
use crate::math::vector::unit;
use crate::num::order;
use crate::num::rng::Rng;
use crate::{Error, Result};
use data_gen::figure::factors::{Drive, shaded, srgb_of_linear};
use data_gen::figure::template::Cloud;
use reference::body::skin;

/// Stream of the draws; item: point; draw 0: triangle, draws 1 and 2: position on it.
pub const PURPOSE: u16 = 0x0610;

/// A point of the template.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// On which triangle.
    pub triangle: u32,
    /// Weights of its corners.
    pub corners: [f64; 3],
    /// Canonical.
    pub position: [f64; 3],
    /// Canonical, unit.
    pub normal: [f64; 3],
    /// sRGB-encoded base colour, 0..1.
    pub rgb: [f64; 3],
    /// Joints that move it.
    pub joints: [u16; INFLUENCES],
    /// Their weights, summing to 1.
    pub weights: [f64; INFLUENCES],
    /// Share of the folds.
    share: f64,
}

/// A template.
#[derive(Clone, Debug, PartialEq)]
pub struct Template {
    /// In order.
    pub points: Vec<Point>,
}

impl Character {
    /// `count` points.
    ///
    /// # Errors
    /// When the surface has no area.
    pub fn template(&self, count: usize, seed: u64) -> Result<Template> {
        let mesh = &self.object.mesh;
        let wide = |i: u32| mesh.positions[i as usize].map(f64::from);
        let mut running = Vec::with_capacity(mesh.triangles.len());
        let mut total = 0.0f64;
        for t in &mesh.triangles {
            let [a, b, c] = t.map(wide);
            let n = cross(sub(b, a), sub(c, a));
            total = total + 0.5 * ((n[0] * n[0] + n[1] * n[1]) + n[2] * n[2]).sqrt();
            running.push(total);
        }
        if !(total > 0.0 && total.is_finite()) {
            let e = Error::input(self.name.clone()).at("surface");
            return Err(e.expected("a positive area").got(total.to_string()));
        }
        let (rng, trunk) = (Rng::new(seed), self.trunk());
        let points = (0..count).map(|p| {
            let u = |draw| rng.uniform_f64(p as u64, 0, PURPOSE, draw);
            let r = u(0) * total;
            let triangle = order::min(running.partition_point(|&c| c <= r), running.len() - 1);
            let (root, b) = (u(1).sqrt(), u(2));
            self.point(triangle, [1.0 - root, root * (1.0 - b), root * b], &trunk)
        });
        Ok(Template { points: points.collect() })
    }

    fn point(&self, triangle: usize, corners: [f64; 3], trunk: &[bool]) -> Point {
        let mesh = &self.object.mesh;
        let t = mesh.triangles[triangle].map(|i| i as usize);
        let mixed = |rows: [[f64; 3]; 3]| -> [f64; 3] {
            std::array::from_fn(|k| {
                (corners[0] * rows[0][k] + corners[1] * rows[1][k]) + corners[2] * rows[2][k]
            })
        };
        let at = t.map(|i| mesh.positions[i].map(f64::from));
        let mut normal = unit(mixed(t.map(|i| self.folds[i].map(f64::from))));
        if normal == [0.0; 3] {
            normal = unit(cross(sub(at[1], at[0]), sub(at[2], at[0])));
        }
        let mut pairs = Vec::new();
        for (c, &i) in corners.iter().zip(&t) {
            let (joints, weights) = self.influences[i];
            pairs.extend(joints.iter().zip(weights).filter(|(_, w)| *w > 0.0).map(|(&j, w)| (j, c * w)));
        }
        let (joints, weights) = largest(pairs);
        let m = &self.object.materials[usize::from(self.object.material_of[triangle])];
        let linear: [f64; 3] = match (&m.base_color_map, mesh.uvs.is_empty()) {
            (Some(map), false) => {
                let uv: [f32; 2] = std::array::from_fn(|k| {
                    let row = t.map(|i| f64::from(mesh.uvs[i][k]));
                    ((corners[0] * row[0] + corners[1] * row[1]) + corners[2] * row[2]) as f32
                });
                let s = map.sample(uv);
                std::array::from_fn(|k| f64::from(s[k]) * f64::from(m.base_color[k]))
            }
            _ => std::array::from_fn(|k| f64::from(m.base_color[k])),
        };
        Point {
            triangle: triangle as u32,
            corners,
            position: mixed(at),
            normal,
            rgb: linear.map(srgb_of_linear),
            joints,
            weights,
            share: share(&joints, &weights, trunk),
        }
    }

    /// Canonical position and normal of a point under the folds of `drive`; see [`super::Factors`].
    fn folded_point(&self, p: &Point, drive: &Drive, trunk: &[bool]) -> ([f64; 3], [f64; 3]) {
        let corners = self.object.mesh.triangles[p.triangle as usize].map(|i| i as usize);
        let shares = corners.map(|i| share(&self.influences[i].0, &self.influences[i].1, trunk));
        if drive.wrinkle == 0.0 || shares == [0.0; 3] {
            return (p.position, p.normal);
        }
        let field = drive.wrinkles(p.position);
        let wide = |rows: &[[f32; 3]], i: usize| rows[i].map(f64::from);
        let face = Face::at_rest(corners.map(|i| wide(&self.object.mesh.positions, i)));
        let folded = face.folded(field, p.normal, p.share, corners.map(|i| wide(&self.folds, i)), shares);
        let moved = std::array::from_fn(|k| p.position[k] + p.share * field.0 * p.normal[k]);
        (moved, swung(p.normal, face.normal(), folded.normal()))
    }

    /// The template in a pose, shaded as the figure's points are: folds and light of `drive`.
    pub fn cloud(&self, template: &Template, pose: &Pose, drive: &Drive) -> Cloud {
        let transforms = self.transforms(pose);
        let light = drive.towards_light();
        let trunk = self.trunk();
        let mut out = Cloud { points: Vec::new(), normals: Vec::new(), rgb: Vec::new() };
        for p in &template.points {
            let t = blended(&p.joints, &p.weights, &transforms);
            let (x, n) = self.folded_point(p, drive, &trunk);
            let n = posed_normal(&t, n);
            out.points.push(skin::point(&t, x));
            out.rgb.push(shaded(p.rgb, n, light));
            out.normals.push(n);
        }
        out
    }
}

fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] - b[k])
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
