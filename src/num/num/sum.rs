//! Sums with a written association.
//!
//! * **Lanes**: lane l of 16 starts at +0 and adds the elements i ≡ l (mod 16) in increasing i; then the lanes fold
//!   16 → 8 → 4 → 2 → 1 (lane l += lane l + w). The register width does not enter.
//! * **Chunks**: an input of more than [`CHUNK`] elements is cut into chunks of that length (the last may be
//!   shorter), each summed by lanes; the partial sums are added by the pairwise tree.
//! * **Pairwise tree**: level by level entries 2i and 2i+1 are added, an odd last one moves up; the empty sum is +0.
//!
//! Statistics that decide something (losses, PSNR, information criteria) take the `f64` forms: same order, terms
//! converted exactly, one rounding at the end by the caller.
//!
//! ```
//! # use lastlight_num as lastlight;
//! use lastlight::num::sum;
//! assert_eq!(sum::sum16(&[0.5; 5000]), 2500.0);
//! assert_eq!(sum::tree_f32(&[1.0, 2.0, 3.0]), (1.0 + 2.0) + 3.0);
//! ```

use super::par;
use std::ops::Add;

/// Elements per chunk; part of the definition.
pub const CHUNK: usize = 4096;

/// Logical lanes; part of the definition.
pub const LANES: usize = 16;

/// Chunks from which on they are summed in parallel. Not part of the definition: it changes no bit.
const PARALLEL: usize = 16;

/// Sum of terms `f(0), …, f(n−1)` in lanes, within one chunk.
#[inline(always)]
fn lanes<T: Copy + Default + Add<Output = T>>(start: usize, n: usize, f: impl Fn(usize) -> T) -> T {
    let mut acc = [T::default(); LANES];
    let whole = n - n % LANES;
    let mut i = 0;
    while i < whole {
        for (l, a) in acc.iter_mut().enumerate() {
            *a = *a + f(start + i + l);
        }
        i += LANES;
    }
    for (l, a) in acc.iter_mut().enumerate().take(n - whole) {
        *a = *a + f(start + whole + l);
    }
    let mut w = LANES / 2;
    while w > 0 {
        for l in 0..w {
            acc[l] = acc[l] + acc[l + w];
        }
        w /= 2;
    }
    acc[0]
}

#[inline(always)]
fn by<T>(n: usize, f: impl Fn(usize) -> T + Sync + Send) -> T
where
    T: Copy + Default + Add<Output = T> + Send,
{
    if n <= CHUNK {
        return lanes(0, n, f);
    }
    let chunks = n.div_ceil(CHUNK);
    let one = |c: usize| lanes(c * CHUNK, (n - c * CHUNK).min(CHUNK), &f);
    let partials = if chunks < PARALLEL { (0..chunks).map(one).collect() } else { par::map(chunks, one) };
    tree(partials)
}

/// Sum of single-precision numbers.
pub fn sum16(x: &[f32]) -> f32 {
    by(x.len(), |i| x[i])
}

/// Sum of single-precision terms given by their index; `f` may be called from several threads.
#[inline]
pub fn sum16_by(n: usize, f: impl Fn(usize) -> f32 + Sync + Send) -> f32 {
    by(n, f)
}

/// Σ aᵢ·bᵢ in single precision, each product rounded.
///
/// # Panics
/// When the lengths differ.
pub fn dot16(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len(), "both factors have one length");
    by(a.len(), |i| a[i] * b[i])
}

/// Sum of single-precision numbers accumulated in double precision.
pub fn sum16_wide(x: &[f32]) -> f64 {
    by(x.len(), |i| f64::from(x[i]))
}

/// Sum of double-precision numbers.
pub fn sum16_f64(x: &[f64]) -> f64 {
    by(x.len(), |i| x[i])
}

/// Sum of double-precision terms given by their index; `f` may be called from several threads.
#[inline]
pub fn sum16_f64_by(n: usize, f: impl Fn(usize) -> f64 + Sync + Send) -> f64 {
    by(n, f)
}

/// The pairwise tree over any values with an addition; the empty sum is the default value.
pub fn tree<T: Copy + Default + Add<Output = T>>(mut level: Vec<T>) -> T {
    while level.len() > 1 {
        let pairs = level.len() / 2;
        for i in 0..pairs {
            level[i] = level[2 * i] + level[2 * i + 1];
        }
        if level.len() % 2 == 1 {
            level[pairs] = level[2 * pairs];
        }
        level.truncate(level.len().div_ceil(2));
    }
    level.first().copied().unwrap_or_default()
}

/// The pairwise tree over single-precision partial sums.
pub fn tree_f32(partials: &[f32]) -> f32 {
    tree(partials.to_vec())
}

/// The pairwise tree over double-precision partial sums.
pub fn tree_f64(partials: &[f64]) -> f64 {
    tree(partials.to_vec())
}

/// The pairwise tree over whole buffers, element by element. No buffers give an empty one.
///
/// # Panics
/// When the lengths differ.
pub fn tree_arrays<T>(mut level: Vec<Vec<T>>) -> Vec<T>
where
    T: Copy + Default + Add<Output = T> + Send + Sync,
{
    let n = level.first().map_or(0, Vec::len);
    assert!(level.iter().all(|x| x.len() == n), "all partial buffers have one length");
    while level.len() > 1 {
        let mut next = Vec::with_capacity(level.len().div_ceil(2));
        let mut entries = level.into_iter();
        while let Some(mut a) = entries.next() {
            if let Some(b) = entries.next() {
                par::chunks_mut(&mut a, 4 * CHUNK, |c, part| {
                    for (x, y) in part.iter_mut().zip(&b[c * 4 * CHUNK..]) {
                        *x = *x + *y;
                    }
                });
            }
            next.push(a);
        }
        level = next;
    }
    level.pop().unwrap_or_default()
}
