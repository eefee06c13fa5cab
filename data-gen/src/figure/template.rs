//! The template: P points on the capsules, in a fixed order, with colours, normals and skinning weights.
//!
//! The points are distributed over the capsules in proportion to area (largest remainder, ties to the lower
//! bone). On a capsule they form a Fibonacci spiral, whose k-th point of n has area fraction (k + ½)/n along
//! the axis and azimuth k·π(3 − √5). Along the axis of a capsule, including the caps, area is proportional to
//! height; the skirt ring is a band of a cone. Point p is the same place on the body in every frame and in
//! every data set with the same P.

use super::appearance::Appearance;
use super::factors::{Drive, LIMB_WIDTH, TRUNK_WIDTH, shaded, turn_hue, unit_interval};
use super::skeleton::{
    BONES, Bone, HEAD, SKIRT, SKIRT_RING, TORSO, V3, add, bones, cross, dot, framed, pose, scale, sub, unit,
    weights,
};
use reference::body::skin::{self, Affine};
use reference::num::elem::{cos, sin};
use std::f64::consts::PI;

/// The points at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Template {
    /// The bones to which the points are skinned.
    pub bones: [Bone; BONES],
    /// Positions in the figure frame, shape (P).
    pub points: Vec<V3>,
    /// Unit normals, shape (P).
    pub normals: Vec<V3>,
    /// The capsule on which a point lies, shape (P).
    pub bone_of: Vec<usize>,
    /// Skinning weights, shape (P, K).
    pub weights: Vec<[f64; BONES]>,
}

/// Points of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Cloud {
    /// Posed positions in the figure frame, shape (P).
    pub points: Vec<V3>,
    /// Unit normals of the displaced and posed surface, shape (P).
    pub normals: Vec<V3>,
    /// Shaded colours, sRGB-encoded, shape (P).
    pub rgb: Vec<[f64; 3]>,
}

/// Area of a capsule, or of the band of the skirt, over 2π.
fn area(b: usize, bone: &Bone) -> f64 {
    let along = sub(bone.to, bone.from);
    if b == SKIRT_RING {
        let [[z0, r0], [z1, r1]] =
            SKIRT.map(|[z, r]| [framed([0.0, 0.0, z])[2], r / super::skeleton::METRES]);
        let slant = ((z1 - z0) * (z1 - z0) + (r1 - r0) * (r1 - r0)).sqrt();
        return 0.5 * (r0 + r1) * slant;
    }
    bone.radius * (dot(along, along).sqrt() + 2.0 * bone.radius)
}

/// Largest-remainder shares of `total` in proportion to `sizes`.
fn shares(sizes: &[f64], total: usize) -> Vec<usize> {
    let whole = sizes.iter().fold(0.0, |sum, s| sum + s);
    let exact: Vec<f64> = sizes.iter().map(|s| s / whole * total as f64).collect();
    let mut counts: Vec<usize> = exact.iter().map(|&x| x as usize).collect();
    let mut given = 0;
    for count in &counts {
        given += count;
    }
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    let rest = |b: usize| exact[b] - (exact[b] as usize) as f64;
    order.sort_by(|&a, &b| rest(b).total_cmp(&rest(a)).then(a.cmp(&b)));
    order.iter().take(total - given).for_each(|&b| counts[b] += 1);
    counts
}

/// Two unit vectors that form a right-handed frame with a unit axis.
pub(super) fn across(axis: V3) -> [V3; 2] {
    let helper = if axis[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let first = unit(cross(helper, axis));
    [first, cross(axis, first)]
}

/// Position and normal of point k of n on a capsule.
fn on_capsule(bone: &Bone, k: usize, n: usize) -> [V3; 2] {
    let along = sub(bone.to, bone.from);
    let length = dot(along, along).sqrt();
    let axis = unit(along);
    let [u, v] = across(axis);
    let height = (k as f64 + 0.5) / n as f64 * (length + 2.0 * bone.radius) - bone.radius;
    let angle = PI * (3.0 - 5.0_f64.sqrt()) * k as f64;
    // The sphere centre for this height.
    let base = length * unit_interval(height / length);
    let up = (height - base) / bone.radius;
    let around = (1.0 - up * up).sqrt();
    let normal =
        unit(add(scale(axis, up), add(scale(u, around * cos(angle)), scale(v, around * sin(angle)))));
    [add(add(bone.from, scale(axis, base)), scale(normal, bone.radius)), normal]
}

/// Position and normal of point k of n on the band of the skirt.
fn on_skirt(k: usize, n: usize) -> [V3; 2] {
    let [[z0, r0], [z1, r1]] = SKIRT.map(|[z, r]| [framed([0.0, 0.0, z])[2], r / super::skeleton::METRES]);
    // Area from the upper rim grows as r₀ t + (r₁ − r₀) t²/2.
    let fraction = (k as f64 + 0.5) / n as f64 * 0.5 * (r0 + r1);
    let wider = r1 - r0;
    let t = ((r0 * r0 + 2.0 * wider * fraction).sqrt() - r0) / wider;
    let angle = PI * (3.0 - 5.0_f64.sqrt()) * k as f64;
    let (r, c, s) = (r0 + wider * t, cos(angle), sin(angle));
    let slant = (z0 - z1, wider);
    let normal = unit([slant.0 * c, slant.0 * s, slant.1]);
    [[r * c, r * s, z0 + (z1 - z0) * t], normal]
}

impl Template {
    /// Creates a template of P points; since every bone should have points, P ≥ 64.
    ///
    /// # Panics
    /// If P is below 64.
    pub fn new(p: usize) -> Self {
        assert!(p >= 64, "a template must have at least 64 points, got {p}");
        let bones = bones();
        let areas: Vec<f64> = bones.iter().enumerate().map(|(b, bone)| area(b, bone)).collect();
        let (mut points, mut normals, mut bone_of) = (Vec::new(), Vec::new(), Vec::new());
        for (b, n) in shares(&areas, p).into_iter().enumerate() {
            for k in 0..n {
                let [point, normal] =
                    if b == SKIRT_RING { on_skirt(k, n) } else { on_capsule(&bones[b], k, n) };
                points.push(point);
                normals.push(normal);
                bone_of.push(b);
            }
        }
        let weights = points.iter().map(|&x| weights(&bones, x)).collect();
        Self { bones, points, normals, bone_of, weights }
    }

    /// Whether a point lies on cloth with wrinkles: belly and waist (the capsule of the pelvis), chest (that
    /// of the torso), skirt.
    pub fn is_cloth(&self, p: usize) -> bool {
        matches!(self.bone_of[p], 0 | TORSO | SKIRT_RING)
    }

    /// Principal directions t₁, t₂ with t₁ × t₂ = n, and curvatures of the surface at a point at rest; convex
    /// is positive.
    fn principal(&self, p: usize) -> [(V3, f64); 2] {
        let (bone, x, n) = (&self.bones[self.bone_of[p]], self.points[p], self.normals[p]);
        if self.bone_of[p] == SKIRT_RING {
            let around = (x[0] * x[0] + x[1] * x[1]).sqrt();
            let flat = (n[0] * n[0] + n[1] * n[1]).sqrt();
            let t = [-x[1] / around, x[0] / around, 0.0];
            return [(t, flat / around), (cross(n, t), 0.0)];
        }
        let (along, curvature) = (sub(bone.to, bone.from), 1.0 / bone.radius);
        let place = dot(along, sub(x, bone.from)) / dot(along, along);
        if (0.0..=1.0).contains(&place) {
            let t = unit(cross(along, n));
            return [(t, curvature), (cross(n, t), 0.0)];
        }
        across(n).map(|t| (t, curvature))
    }

    /// Canonical position and normal under the factors, before skinning.
    ///
    /// A point x at rest with unit normal n is mapped to D x + δ n: D scales heights by the length of the
    /// skirt (elsewhere D = 1), and δ = girth + h(x) with the folds h. Its normal is t₁' × t₂' of the
    /// transformed principal directions t' = D t + δ κ t + (∇h·t) n, which is exactly the normal of the
    /// displaced surface.
    pub fn canonical(&self, p: usize, drive: &Drive) -> [V3; 2] {
        let (x, n, b) = (self.points[p], self.normals[p], self.bone_of[p]);
        let (mut at, mut stretch) = (x, 1.0);
        if b == SKIRT_RING {
            at[2] = drive.skirt_height(framed([0.0, 0.0, SKIRT[0][0]])[2], x[2]);
            stretch = drive.skirt;
        }
        let is_cloth = self.is_cloth(p);
        let width = match b {
            HEAD => 0.0,
            _ if is_cloth => TRUNK_WIDTH,
            _ => LIMB_WIDTH,
        };
        let (height, gradient) = if is_cloth { drive.wrinkles(x) } else { (0.0, [0.0; 3]) };
        let lift = drive.girth(width, self.bones[b].radius) + height;
        let at = add(at, scale(n, lift));
        if !is_cloth {
            return [at, n];
        }
        let [first, second] = self.principal(p).map(|(t, curvature)| {
            let stretched = [t[0], t[1], stretch * t[2]];
            add(add(stretched, scale(t, lift * curvature)), scale(n, dot(gradient, t)))
        });
        [at, unit(cross(first, second))]
    }

    /// The points of a frame.
    pub fn posed(&self, drive: &Drive, appearance: &Appearance) -> Cloud {
        let transforms = pose(&self.bones, drive);
        let light = drive.towards_light();
        let mut cloud = Cloud { points: Vec::new(), normals: Vec::new(), rgb: Vec::new() };
        for p in 0..self.points.len() {
            let [x, n] = self.canonical(p, drive);
            let t = skin::blend(&self.weights[p], &transforms);
            let normal = turned(&t, n);
            let (mut rgb, is_cloth) = appearance.point(self.bone_of[p], self.points[p]);
            if is_cloth {
                rgb = turn_hue(rgb, drive.hue);
            }
            cloud.points.push(skin::point(&t, x));
            cloud.normals.push(normal);
            cloud.rgb.push(shaded(rgb, normal, light));
        }
        cloud
    }

    /// Mean distance to the three nearest other points at rest, shape (P).
    pub fn spacing(&self) -> Vec<f64> {
        let near = |p: usize| {
            let mut nearest = [f64::INFINITY; 3];
            for (q, &y) in self.points.iter().enumerate() {
                let off = sub(y, self.points[p]);
                let d = dot(off, off);
                if q == p || !(d < nearest[2]) {
                    continue;
                }
                nearest[2] = d;
                nearest.sort_by(f64::total_cmp);
            }
            (nearest[0].sqrt() + nearest[1].sqrt() + nearest[2].sqrt()) / 3.0
        };
        (0..self.points.len()).map(near).collect()
    }
}

/// A unit normal under an affine transform, computed with the cofactors of its linear part, so that it
/// remains normal to the surface.
pub(super) fn turned(t: &Affine<f64>, n: V3) -> V3 {
    let column = |j: usize| [t[0][j], t[1][j], t[2][j]];
    let [a, b, c] = [cross(column(1), column(2)), cross(column(2), column(0)), cross(column(0), column(1))];
    unit(add(add(scale(a, n[0]), scale(b, n[1])), scale(c, n[2])))
}
