//! Bit-exact comparison of results: digests, and distances in units of the last place.
//!
//! A digest is the FNV-1a 64 hash of the element width in bytes, the rank and the dimensions (each as u64,
//! little endian), followed by the bits of every element (little endian, −0 kept, row-major). The digest of
//! an array with a NaN is an error, because the payload of a NaN is not specified.
//!
//! ```
//! # use lastlight_num as lastlight;
//! use lastlight::num::bits;
//! let a = bits::digest_f32(&[2], &[1.0, 0.0])?;
//! assert_ne!(a, bits::digest_f32(&[2], &[1.0, -0.0])?);
//! assert_ne!(a, bits::digest_f32(&[1, 2], &[1.0, 0.0])?);
//! assert_eq!(bits::ulp_f32(1.0, 1.0 + f32::EPSILON), 1);
//! # Ok::<(), lastlight::Error>(())
//! ```

use super::array::Array;
use crate::{Error, Result};

/// Incremental FNV-1a 64 hash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Digest(u64);

impl Default for Digest {
    fn default() -> Self {
        Self::new()
    }
}

impl Digest {
    /// Returns the digest of no data, which is the offset basis.
    pub fn new() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }

    /// Adds bytes to the hash.
    #[inline]
    pub fn bytes(&mut self, bytes: &[u8]) {
        for &b in bytes {
            self.0 = (self.0 ^ u64::from(b)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }

    /// Adds a u64, little endian.
    pub fn u64(&mut self, x: u64) {
        self.bytes(&x.to_le_bytes());
    }

    /// Adds the header of an array: element width in bytes, rank, dimensions.
    pub fn head(&mut self, width: usize, shape: &[usize]) {
        self.u64(width as u64);
        self.u64(shape.len() as u64);
        for &d in shape {
            self.u64(d as u64);
        }
    }

    /// Adds a single-precision array: the header, then the elements.
    ///
    /// # Errors
    /// Returns an error if the number of elements is not the product of the shape, or an element is NaN.
    pub fn f32(&mut self, shape: &[usize], x: &[f32]) -> Result<()> {
        check_len(shape, x.len())?;
        self.head(4, shape);
        for (i, v) in x.iter().enumerate() {
            if v.is_nan() {
                return Err(nan(i));
            }
            self.bytes(&v.to_bits().to_le_bytes());
        }
        Ok(())
    }

    /// Adds a double-precision array: the header, then the elements.
    ///
    /// # Errors
    /// Returns an error if the number of elements is not the product of the shape, or an element is NaN.
    pub fn f64(&mut self, shape: &[usize], x: &[f64]) -> Result<()> {
        check_len(shape, x.len())?;
        self.head(8, shape);
        for (i, v) in x.iter().enumerate() {
            if v.is_nan() {
                return Err(nan(i));
            }
            self.bytes(&v.to_bits().to_le_bytes());
        }
        Ok(())
    }

    /// Adds an array of any element type.
    ///
    /// # Errors
    /// Returns an error if an element is NaN.
    pub fn array(&mut self, a: &Array) -> Result<()> {
        macro_rules! integers {
            ($a:expr, $width:expr) => {{
                self.head($width, $a.shape());
                for v in $a {
                    self.bytes(&v.to_le_bytes());
                }
                Ok(())
            }};
        }
        match a {
            Array::F32(a) => self.f32(a.shape(), &a.iter().copied().collect::<Vec<_>>()),
            Array::F64(a) => self.f64(a.shape(), &a.iter().copied().collect::<Vec<_>>()),
            Array::U8(a) => integers!(a, 1),
            Array::I8(a) => integers!(a, 1),
            Array::I32(a) => integers!(a, 4),
            Array::I64(a) => integers!(a, 8),
        }
    }

    /// Returns the digest of the data added so far.
    pub fn value(self) -> u64 {
        self.0
    }
}

fn check_len(shape: &[usize], len: usize) -> Result<()> {
    let product = shape.iter().fold(1_usize, |a, &d| a.saturating_mul(d));
    if product == len {
        return Ok(());
    }
    Err(Error::input("digest")
        .expected(format!("{product} elements for shape {shape:?}"))
        .got(len.to_string()))
}

fn nan(i: usize) -> Error {
    Error::check("digest").at(format!("element {i}")).expected("a number").got("NaN")
}

/// Returns the digest of one single-precision array.
///
/// # Errors
/// Returns an error if the number of elements is not the product of the shape, or an element is NaN.
pub fn digest_f32(shape: &[usize], x: &[f32]) -> Result<u64> {
    let mut d = Digest::new();
    d.f32(shape, x)?;
    Ok(d.value())
}

/// Returns the digest of one double-precision array.
///
/// # Errors
/// Returns an error if the number of elements is not the product of the shape, or an element is NaN.
pub fn digest_f64(shape: &[usize], x: &[f64]) -> Result<u64> {
    let mut d = Digest::new();
    d.f64(shape, x)?;
    Ok(d.value())
}

/// Returns the digest of one array of any element type.
///
/// # Errors
/// Returns an error if an element is NaN.
pub fn digest(a: &Array) -> Result<u64> {
    let mut d = Digest::new();
    d.array(a)?;
    Ok(d.value())
}

/// Returns the number of representable steps from `a` to `b`; both zeros count as one value. The distance
/// between a NaN and any number is `u64::MAX`; between two NaNs it is 0.
pub fn ulp_f32(a: f32, b: f32) -> u64 {
    if a.is_nan() || b.is_nan() {
        return if a.is_nan() && b.is_nan() { 0 } else { u64::MAX };
    }
    let line = |x: f32| {
        let magnitude = i64::from(x.to_bits() & 0x7fff_ffff);
        if x.is_sign_negative() { -magnitude } else { magnitude }
    };
    line(a).abs_diff(line(b))
}

/// Returns the number of representable steps from `a` to `b`; both zeros count as one value. The distance
/// between a NaN and any number is `u64::MAX`; between two NaNs it is 0.
pub fn ulp_f64(a: f64, b: f64) -> u64 {
    if a.is_nan() || b.is_nan() {
        return if a.is_nan() && b.is_nan() { 0 } else { u64::MAX };
    }
    let line = |x: f64| {
        let magnitude = (x.to_bits() & (u64::MAX >> 1)) as i64; // below 2⁶³
        if x.is_sign_negative() { -magnitude } else { magnitude }
    };
    line(a).abs_diff(line(b))
}
