//! One projected Gaussian in the form that `blend` reads, and the bounds of its footprint.

use crate::num::order;
use crate::scene::profile::{Footprint, Profile};

/// The data of one Gaussian in one image that `blend` needs: 64 bytes, one cache line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[repr(align(64))]
pub struct Splat {
    /// Centre, pixels.
    pub mean_px: [f32; 2],
    /// Shape (s, k1, k2); k1 = 0 marks a Gaussian that is not visible.
    pub shape: [f32; 3],
    /// Opacity, including the antialiasing factor.
    pub opacity: f32,
    /// Colour.
    pub color: [f32; 3],
    /// Depth.
    pub z: f32,
    /// Pivot axis, 0 = x, 1 = y.
    pub axis: u32,
    /// Bounds of the footprint's rows.
    pub bounds: Bounds,
}

/// Bounds on the pixels of a row that can belong to a splat: those with |x − u_x − slope·dy| ≤ √((r2 −
/// dy²·inv_yy)·half2) + margin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bounds {
    /// Squared Mahalanobis radius, enlarged; negative if the splat has no pixel.
    pub r2: f32,
    /// Reciprocal 1/Σ'yy.
    pub inv_yy: f32,
    /// Ratio Σ'xy/Σ'yy.
    pub slope: f32,
    /// Ratio det/Σ'yy.
    pub half2: f32,
    /// Margin for rounding, pixels.
    pub margin: f32,
}

impl Splat {
    /// Builds the splat from projected values; `cut` is the Mahalanobis radius of the footprint, negative =
    /// none.
    pub fn new(
        mean_px: [f32; 2],
        shape: [f32; 3],
        axis: u8,
        z: f32,
        opacity: f32,
        color: [f32; 3],
        cut: f32,
    ) -> Self {
        let e = Ellipse::new(shape, axis);
        let bounds = if cut < 0.0 {
            Bounds { r2: -1.0, ..Bounds::default() }
        } else {
            let r = (cut + 1e-3) + 1e-6 * (cut * e.narrow);
            Bounds {
                r2: r * r,
                inv_yy: 1.0 / e.yy,
                slope: e.xy / e.yy,
                half2: e.det / e.yy,
                margin: 0.01 + 2e-6 * (r * e.xx.sqrt()),
            }
        };
        Self { mean_px, shape, opacity, color, z, axis: u32::from(axis), bounds }
    }

    /// Whether near ≤ z ≤ far.
    pub fn is_visible(&self) -> bool {
        self.shape[1] > 0.0
    }
}

/// Entries of Σ' recovered from the shape without cancellation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ellipse {
    /// Entry Σ'xx.
    pub(super) xx: f32,
    /// Entry Σ'yy.
    pub(super) yy: f32,
    /// Entry Σ'xy.
    pub(super) xy: f32,
    /// Determinant det Σ'.
    det: f32,
    /// √Σ'qq in units of the conditional deviation √(det/Σ'pp), which bounds the effect of rounding on the
    /// exponent.
    narrow: f32,
}

/// √(2 ln 255) rounded up: the extent at full opacity, in standard deviations.
const FULL_EXTENT: f32 = 3.33;

impl Ellipse {
    pub(crate) fn new([s, k1, k2]: [f32; 3], axis: u8) -> Self {
        let pp = 1.0 / (k1 * k1);
        let rest = 1.0 / (k2 * k2); // det/Σ'pp
        let qq = rest + (s * s) * pp;
        let (xx, yy) = if axis == 0 { (pp, qq) } else { (qq, pp) };
        Self { xx, yy, xy: s * pp, det: pp * rest, narrow: qq.sqrt() * k2 }
    }

    /// Returns the half-widths of the footprint in whole pixels. They are 0 if o < α_min (profile `inria`
    /// does not test this), or if the box of the splat at full opacity (3.33 deviations) is outside the
    /// image, as in the original programs.
    pub(crate) fn radii(&self, profile: &Profile, mean_px: [f32; 2], cut: f32, size: [f32; 2]) -> [i32; 2] {
        if cut < 0.0 && profile.footprint == Footprint::Alpha {
            return [0, 0];
        }
        let ceil = |x: f32| order::min(x, 1e9).ceil() as i32;
        let r = match profile.footprint {
            Footprint::Alpha => {
                let e = order::min(cut, FULL_EXTENT);
                [ceil(e * self.xx.sqrt()), ceil(e * self.yy.sqrt())]
            }
            Footprint::Inria3Sigma => [self.inria_radius(); 2],
        };
        let full = match profile.footprint {
            Footprint::Alpha => [ceil(FULL_EXTENT * self.xx.sqrt()), ceil(FULL_EXTENT * self.yy.sqrt())],
            Footprint::Inria3Sigma => r,
        };
        let hits =
            (0..2).all(|i| mean_px[i] + full[i] as f32 > 0.0 && mean_px[i] - (full[i] as f32) < size[i]);
        if hits { r } else { [0, 0] }
    }

    /// Returns ceil(3 √λ_max) with the lower bound that the original program applies under the root.
    pub(super) fn inria_radius(&self) -> i32 {
        let mid = 0.5 * (self.xx + self.yy);
        let largest = mid + order::max(mid * mid - self.det, 0.1).sqrt();
        order::min(3.0 * largest.sqrt(), 1e9).ceil() as i32
    }
}

impl Bounds {
    /// Returns the rightmost extent over rows dy ∈ [lo, hi] (`sign` = 1), or the leftmost, mirrored (`sign` =
    /// −1); `tip` is the row of the rightmost point.
    pub(super) fn reach(&self, tip: f32, lo: f32, hi: f32, sign: f32) -> f32 {
        let dy = order::clamp(sign * tip, lo, hi);
        let inside = order::max(self.r2 - (dy * dy) * self.inv_yy, 0.0);
        sign * (self.slope * dy) + (inside * self.half2).sqrt() + self.margin
    }
}
