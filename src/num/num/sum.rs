//! Sums with a defined association.
//!
//! * **Lanes**: lane l of 16 starts at +0 and adds the elements i ≡ l (mod 16) in increasing i; then the
//!   lanes fold 16 → 8 → 4 → 2 → 1 (lane l += lane l + w). The register width has no influence.
//! * **Chunks**: an input of more than [`CHUNK`] elements is split into chunks of that length (the last may
//!   be shorter), each summed by lanes; the partial sums are added by the pairwise tree.
//! * **Pairwise tree**: at each level, entries 2i and 2i+1 are added, and an unpaired last entry moves up;
//!   the empty sum is +0.
//!
//! Statistics that lead to decisions (losses, PSNR, information criteria) use the `f64` forms: they have the
//! same order, convert terms exactly, and the caller rounds once at the end.
//!
//! ```
//! # use lastlight_num as lastlight;
//! use lastlight::num::sum;
//! assert_eq!(sum::sum16(&[0.5; 5000]), 2500.0);
//! assert_eq!(sum::tree_f32(&[1.0, 2.0, 3.0]), (1.0 + 2.0) + 3.0);
//! ```

use super::par;
use std::ops::Add;

/// Elements per chunk; the value is part of the definition.
pub const CHUNK: usize = 4096;

/// Number of logical lanes; the value is part of the definition.
pub const LANES: usize = 16;

/// Number of chunks from which on chunks are summed in parallel. It is not part of the definition and changes
/// no bit.
const PARALLEL: usize = 16;

/// Returns the sum of the terms `f(0), …, f(n−1)` by lanes, within one chunk.
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

/// Returns the sum of single-precision numbers.
pub fn sum16(x: &[f32]) -> f32 {
    by(x.len(), |i| x[i])
}

/// Returns the sum of single-precision terms given by their index; `f` may be called from several threads.
#[inline]
pub fn sum16_by(n: usize, f: impl Fn(usize) -> f32 + Sync + Send) -> f32 {
    by(n, f)
}

/// Returns Σ aᵢ·bᵢ in single precision, with each product rounded.
///
/// # Panics
/// Panics if the lengths differ.
pub fn dot16(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len(), "a and b have the same length");
    by(a.len(), |i| a[i] * b[i])
}

/// Returns the sum of single-precision numbers, accumulated in double precision.
pub fn sum16_wide(x: &[f32]) -> f64 {
    by(x.len(), |i| f64::from(x[i]))
}

/// Returns the sum of double-precision numbers.
pub fn sum16_f64(x: &[f64]) -> f64 {
    by(x.len(), |i| x[i])
}

/// Returns the sum of double-precision terms given by their index; `f` may be called from several threads.
#[inline]
pub fn sum16_f64_by(n: usize, f: impl Fn(usize) -> f64 + Sync + Send) -> f64 {
    by(n, f)
}

/// Adds any values with the pairwise tree; the empty sum is the default value.
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

/// Adds single-precision partial sums with the pairwise tree.
pub fn tree_f32(partials: &[f32]) -> f32 {
    tree(partials.to_vec())
}

/// Adds double-precision partial sums with the pairwise tree.
pub fn tree_f64(partials: &[f64]) -> f64 {
    tree(partials.to_vec())
}

/// Adds complete buffers element by element with the pairwise tree. The sum of no buffers is an empty buffer.
///
/// # Panics
/// Panics if the lengths differ.
pub fn tree_arrays<T>(mut level: Vec<Vec<T>>) -> Vec<T>
where
    T: Copy + Default + Add<Output = T> + Send + Sync,
{
    let n = level.first().map_or(0, Vec::len);
    assert!(level.iter().all(|x| x.len() == n), "all partial buffers have the same length");
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
