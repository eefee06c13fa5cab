//! Digests: FNV-1a 64 over type and shape of an array, then over its bits.
//!
//! The bytes hashed are: element width in bytes, rank, each length (all u64, little endian), then the bits of
//! every element, little endian. −0 and +0 have different digests. An array with a NaN has no digest.

const OFFSET: u64 = 0xcbf2_9ce4_8422_2325;
const PRIME: u64 = 0x0000_0100_0000_01b3;

fn fold(hash: u64, bytes: impl IntoIterator<Item = u8>) -> u64 {
    bytes.into_iter().fold(hash, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(PRIME))
}

/// FNV-1a 64 of plain bytes.
pub fn fnv1a(bytes: &[u8]) -> u64 {
    fold(OFFSET, bytes.iter().copied())
}

fn header(width: u64, shape: &[usize]) -> u64 {
    let head = fold(OFFSET, width.to_le_bytes());
    let head = fold(head, (shape.len() as u64).to_le_bytes());
    shape.iter().fold(head, |hash, &d| fold(hash, (d as u64).to_le_bytes()))
}

/// Digest of a double-precision array.
///
/// # Errors
/// Names the index of the first NaN.
pub fn digest_f64(shape: &[usize], x: &[f64]) -> Result<u64, String> {
    if let Some(i) = x.iter().position(|x| x.is_nan()) {
        return Err(format!("entry {i} is NaN: no digest"));
    }
    Ok(x.iter().fold(header(8, shape), |hash, x| fold(hash, x.to_bits().to_le_bytes())))
}

/// Digest of a single-precision array.
///
/// # Errors
/// Names the index of the first NaN.
pub fn digest_f32(shape: &[usize], x: &[f32]) -> Result<u64, String> {
    if let Some(i) = x.iter().position(|x| x.is_nan()) {
        return Err(format!("entry {i} is NaN: no digest"));
    }
    Ok(x.iter().fold(header(4, shape), |hash, x| fold(hash, x.to_bits().to_le_bytes())))
}
