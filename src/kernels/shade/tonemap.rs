//! Conversion of linear radiance to sRGB bytes.
//!
//! byte = ⌊255·e(clamp(x·exposure, 0, 1)) + ½⌋,
//! e(x) = 12.92 x for x ≤ 0.0031308, else 1.055 x^(1/2.4) − 0.055   (IEC 61966-2-1)
//!
//! Values above 1 are clipped without a roll-off, because the images serve as data.

use crate::num::elem;
use crate::num::lanes::{Real, f32x8};
use crate::num::{order, par};

/// Returns the sRGB-encoded value of a linear value in 0..1.
#[inline]
pub fn encode<L: Real>(x: L) -> L {
    let s = L::splat;
    let line = x * s(12.92);
    let curve = elem::pow(x, s(1.0 / 2.4)) * s(1.055) - s(0.055);
    L::select(x.le(s(0.003_130_8)), line, curve)
}

/// Returns three bytes per pixel in row-major order. The bytes of a pixel depend on that pixel alone.
///
/// # Panics
/// In debug builds, panics if a value is NaN.
pub fn srgb_u8(linear: &[[f32; 3]], exposure: f32) -> Vec<u8> {
    let flat = linear.as_flattened();
    let mut bytes = vec![0; flat.len()];
    par::chunks_mut(&mut bytes, 3 * 4096, |c, out| {
        let x = &flat[c * 3 * 4096..][..out.len()];
        debug_assert!(x.iter().all(|x| !x.is_nan()), "no value is NaN");
        for (x, out) in x.chunks(8).zip(out.chunks_mut(8)) {
            let lanes = f32x8::from_fn(|l| order::clamp(x[Ord::min(l, x.len() - 1)] * exposure, 0.0, 1.0));
            let e = encode(lanes).to_array();
            for (l, b) in out.iter_mut().enumerate() {
                *b = (e[l] * 255.0 + 0.5) as u8;
            }
        }
    });
    bytes
}
