//! The intersection test of one ray and one triangle, which all queries of the hierarchy use.
//!
//! The ray is sheared so that it runs along an axis; the triangle is hit if its projection contains the
//! origin (Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection", JCGT 2013). With A, B, C the
//! sheared corners in the plane,
//!
//! ```text
//! U = Cx·By − Cy·Bx    V = Ax·Cy − Ay·Cx    W = Bx·Ay − By·Ax
//! t = (U·Az + V·Bz + W·Cz)/(U + V + W)      hit if U, V, W have the same sign (0 counts as both) and their
//! sum is not 0
//! ```
//!
//! Both sides of a triangle are hit.
//!
//! # Watertightness
//! Two triangles with a common edge use the same two sheared corners, and U of one equals −U of the other in
//! bits, because no operation is fused. The sign of U in single precision is correct, or U is 0, because
//! rounding is monotonic: p ≥ q gives fl(p) ≥ fl(q). If one of U, V, W is 0, all three are recomputed in
//! double precision, in which the products are exact and the sign is therefore always correct. The test is
//! thus exact for the sheared corners, which all triangles around a vertex share.
//!
//! # Independence of the tree
//! [`Line::slab`] returns the interval in which the ray is inside a box, computed from the box's planes by
//! operations that are monotonic in them. The test includes that the ray intersects the triangle's own box,
//! and the reported t is at least the start of that interval. The interval of an enclosing box contains that
//! interval in floating point, not only in exact arithmetic. A traversal that skips boxes whose interval is
//! empty or starts beyond the best t therefore skips no triangle that would win.
//!
//! # Conservativeness of the box test
//! The planes of a box are moved outwards by 2⁻²⁰·M, where M bounds |corner − origin| over all corners and
//! axes. With u = 2⁻²⁴, the error of a sheared coordinate is at most 6u·M (difference u, slope and product
//! 3u, last difference 2u), that of a slab's end 3u·M measured in space, and limiting directions to |d| ≥
//! 2⁻⁶⁰ (relative to the largest component) moves a point by 2⁻⁶⁰·M: together less than 10u·M < 2⁻²⁰·M.

use super::ray::Ray;
use crate::num::lanes::f32x8;

/// Meshes whose largest coordinate is outside 1/LARGE..=LARGE are scaled by a power of two.
const LARGE: f32 = 1_048_576.0;
/// Rays that start further away than this (after scaling) hit nothing; directions outside 1/FAR..=FAR are
/// scaled.
const FAR: f32 = 1_099_511_627_776.0;
/// Boxes are enlarged by this fraction of the largest distance, 2⁻²⁰, and by [`PAD_START`] of the origin's
/// coordinate, 2⁻²³.
const PAD: f32 = 1.0 / 1_048_576.0;
const PAD_START: f32 = 1.0 / 8_388_608.0;
/// Smallest component of a direction in the box test relative to the largest component, 2⁻⁶⁰.
const FLAT: f32 = 1.0 / 1_152_921_504_606_846_976.0;

/// The scaled coordinates in which a mesh is tested; the scale is a power of two, chosen such that no product
/// leaves the range of f32.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Frame {
    /// Power of two by which coordinates are multiplied; 1 for meshes of ordinary size.
    pub(super) scale: f32,
    /// Smallest and largest scaled coordinates of all triangles that can be hit.
    pub(super) bounds: [[f32; 3]; 2],
}

impl Frame {
    /// Returns the scale for a mesh whose largest coordinate has the magnitude `largest`.
    pub(super) fn scale_for(largest: f32) -> f32 {
        if largest == 0.0 || (1.0 / LARGE..=LARGE).contains(&largest) {
            return 1.0;
        }
        power_of_two(-exponent(f64::from(largest)).clamp(-126, 126))
    }
}

/// Returns e with 2^e ≤ |x| < 2^(e+1); x is a non-zero number converted from f32.
fn exponent(x: f64) -> i32 {
    ((x.to_bits() >> 52) & 0x7ff) as i32 - 1023
}

/// Returns 2^e for −126 ≤ e ≤ 127.
fn power_of_two(e: i32) -> f32 {
    f32::from_bits(((e + 127) as u32) << 23)
}

/// Whether the triangle has no area and is therefore never hit: the cross product of its edges, in double
/// precision, is 0.
pub(super) fn is_degenerate([a, b, c]: [[f32; 3]; 3]) -> bool {
    let edge = |p: [f32; 3]| [0, 1, 2].map(|k| f64::from(p[k]) - f64::from(a[k]));
    let (e, f) = (edge(b), edge(c));
    e[1] * f[2] == e[2] * f[1] && e[2] * f[0] == e[0] * f[2] && e[0] * f[1] == e[1] * f[0]
}

/// Returns the largest f32 that is not above x ≥ 0.
fn below(x: f64) -> f32 {
    let near = x as f32;
    if f64::from(near) > x { f32::from_bits(near.to_bits() - 1) } else { near }
}

/// A ray prepared for the test.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    /// Origin.
    pub(super) origin: [f32; 3],
    /// Axis along which the direction is largest; the other two follow cyclically.
    pub(super) axis: usize,
    /// Direction per unit along `axis` on the two following axes, and 1/(direction along `axis`).
    pub(super) shear: [f32; 3],
    /// Origin for the planes at which the ray enters boxes, moved forwards.
    pub(super) enter: [f32; 3],
    /// Origin for the planes at which the ray leaves boxes, moved backwards.
    pub(super) leave: [f32; 3],
    /// Reciprocal of the direction, finite.
    pub(super) inverse: [f32; 3],
    /// Signs: bit k is set if the direction along axis k is negative.
    pub(super) octant: usize,
    /// End of the interval.
    pub(super) t_max: f32,
    /// Power of two by which t is multiplied to be in units of the caller's direction.
    pub(super) unit: f64,
}

/// A triangle that was hit: ray parameter, and weights of corners 1 and 2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Intersection {
    pub(super) t: f32,
    pub(super) u: f32,
    pub(super) v: f32,
}

fn largest(d: [f32; 3]) -> usize {
    let [x, y, z] = d.map(f32::abs);
    let (m, axis) = if y > x { (y, 1) } else { (x, 0) };
    if z > m { 2 } else { axis }
}

/// Places three numbers in lanes 0 to 2 and 0 in the others.
#[inline(always)]
fn three([x, y, z]: [f32; 3]) -> f32x8 {
    f32x8::new([x, y, z, 0.0, 0.0, 0.0, 0.0, 0.0])
}

#[inline(always)]
fn first_three(x: f32x8) -> [f32; 3] {
    let [a, b, c, ..] = x.to_array();
    [a, b, c]
}

impl Line {
    /// Converts the ray to the coordinates of `frame`; returns `None` if it cannot hit anything: a zero
    /// direction, an empty interval, or an origin more than 2⁴⁰ away.
    #[inline(always)]
    pub(super) fn new(ray: &Ray, frame: &Frame) -> Option<Self> {
        let mut d = ray.direction;
        // An infinite t is not a hit.
        let (mut t_max, mut unit) = (if ray.t_max > f32::MAX { f32::MAX } else { ray.t_max + 0.0 }, 1.0);
        let mut axis = largest(d);
        let along = d[axis].abs();
        if frame.scale != 1.0 || !(1.0 / FAR..=FAR).contains(&along) {
            if !(along > 0.0 && along < f32::INFINITY) {
                return None;
            }
            // The direction is scaled to 1 ≤ |direction| < 2, so t is in units of 2^e of the caller's.
            let wide = d.map(|d| f64::from(d) * f64::from(frame.scale));
            let e = exponent(wide[axis]);
            let by = f64::from_bits(((1023 - e) as u64) << 52);
            d = wide.map(|d| (d * by) as f32);
            t_max = below(f64::from(t_max) / by);
            unit = by;
            axis = largest(d);
        }
        let s = f32x8::splat;
        let from = three(ray.origin) * s(frame.scale);
        let size_from = from.abs();
        if !(t_max >= 0.0) || !size_from.simd_le(s(FAR)).all() {
            return None;
        }
        let origin = first_three(from);
        let [lo, hi] = frame.bounds.map(three);
        let [x, y, z] = first_three((from - lo).fast_max(hi - from).fast_max(s(0.0)));
        let m = if y > x { y } else { x };
        let reach = if z > m { z } else { m };
        // Every lane keeps its own sign; −0 counts as negative.
        let along = d[axis];
        let d8 = three(d);
        let sign = d8 & s(-0.0);
        let size = d8.abs().fast_max(s(FLAT * along.abs())) | sign;
        let pad = ((s(PAD * reach) + s(PAD_START) * size_from) + s(f32::MIN_POSITIVE)) | sign;
        let [sx, sy, sz] = first_three(size);
        let (u, v) = ([d[1], d[2], d[0], d[0]][axis & 3], [d[2], d[0], d[1], d[1]][axis & 3]);
        let [ix, iy, iz, su, sv, sw, ..] = (f32x8::new([1.0, 1.0, 1.0, u, v, 1.0, 1.0, 1.0])
            / f32x8::new([sx, sy, sz, along, along, along, 1.0, 1.0]))
        .to_array();
        Some(Self {
            origin,
            axis,
            shear: [su, sv, sw],
            enter: first_three(from + pad),
            leave: first_three(from - pad),
            inverse: [ix, iy, iz],
            octant: sign.to_bitmask() as usize & 7,
            t_max,
            unit,
        })
    }

    /// Returns t in the caller's units.
    #[inline(always)]
    pub(super) fn in_caller_units(&self, t: f32) -> f32 {
        (f64::from(t) * self.unit) as f32
    }

    /// Returns the start and end of the interval inside a box, which is empty if the end is smaller. The
    /// result is monotonic in the planes.
    #[inline]
    pub(super) fn slab(&self, lo: [f32; 3], hi: [f32; 3]) -> (f32, f32) {
        let (mut start, mut end) = (f32::NEG_INFINITY, f32::INFINITY);
        for k in 0..3 {
            let (first, last) = if self.octant >> k & 1 == 0 { (lo[k], hi[k]) } else { (hi[k], lo[k]) };
            let (s, e) =
                ((first - self.enter[k]) * self.inverse[k], (last - self.leave[k]) * self.inverse[k]);
            start = if s > start { s } else { start };
            end = if e < end { e } else { end };
        }
        (start, end)
    }

    /// The complete test for one triangle with non-zero area; the traversals perform it per lane.
    #[cfg(test)]
    pub(super) fn meet(&self, corners: [[f32; 3]; 3]) -> Option<Intersection> {
        let (x, y, z) = ((self.axis + 1) % 3, (self.axis + 2) % 3, self.axis);
        let [a, b, c] = corners.map(|p| {
            let along = p[z] - self.origin[z];
            [
                (p[x] - self.origin[x]) - self.shear[0] * along,
                (p[y] - self.origin[y]) - self.shear[1] * along,
                self.shear[2] * along,
            ]
        });
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        let met = if u == 0.0 || v == 0.0 || w == 0.0 {
            wide(a, b, c)?
        } else {
            if !((u > 0.0 && v > 0.0 && w > 0.0) || (u < 0.0 && v < 0.0 && w < 0.0)) {
                return None;
            }
            let sum = u + v + w;
            Intersection { t: (u * a[2] + v * b[2] + w * c[2]) / sum, u: v / sum, v: w / sum }
        };
        self.inside(corners, met)
    }

    /// The part of the test that involves the triangle's own box and the ray's interval.
    #[inline]
    pub(super) fn inside(&self, corners: [[f32; 3]; 3], met: Intersection) -> Option<Intersection> {
        let [lo, hi] = bounds(corners);
        let (start, end) = self.slab(lo, hi);
        // Adding 0 turns −0 into +0.
        let t = (if start > met.t { start } else { met.t }) + 0.0;
        (start <= end && end >= 0.0 && met.t >= 0.0 && t <= self.t_max).then_some(Intersection { t, ..met })
    }
}

/// Recomputes U, V, W if one of them is 0 in single precision, with exact products in double precision.
#[cold]
pub(super) fn wide(a: [f32; 3], b: [f32; 3], c: [f32; 3]) -> Option<Intersection> {
    let [a, b, c] = [a, b, c].map(|p| p.map(f64::from));
    let u = c[0] * b[1] - c[1] * b[0];
    let v = a[0] * c[1] - a[1] * c[0];
    let w = b[0] * a[1] - b[1] * a[0];
    let sum = u + v + w;
    let one_sign = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
    (one_sign && sum != 0.0).then(|| Intersection {
        t: ((u * a[2] + v * b[2] + w * c[2]) / sum) as f32,
        u: (v / sum) as f32,
        v: (w / sum) as f32,
    })
}

/// Returns the smallest and largest coordinates of a triangle.
#[inline]
pub(super) fn bounds([a, b, c]: [[f32; 3]; 3]) -> [[f32; 3]; 2] {
    use crate::num::order::{max, min};
    [[0, 1, 2].map(|k| min(min(a[k], b[k]), c[k])), [0, 1, 2].map(|k| max(max(a[k], b[k]), c[k]))]
}
