//! Decoder of LZF, the compression that h5py offers besides deflate (HDF5 filter 32000).
//!
//! A stream of control bytes c. c < 32: c + 1 bytes follow as they are. Else the three upper bits are a
//! length, 7 adding the next byte to it, and the five lower bits with the byte that follows an offset: two
//! bytes more than the length are repeated from offset + 1 bytes back; they may overlap what they make.
//!
//! # Why own code
//! The crate `lzf` is no longer maintained, and `hdf5-reader` accepts such filters as functions.

/// The bytes of a stream, at most `most`; `None` if the stream ends early, refers to bytes before its start,
/// or decodes to more.
pub(super) fn decoded(stream: &[u8], most: usize) -> Option<Vec<u8>> {
    let mut out: Vec<u8> = Vec::new();
    let mut rest = stream;
    while let Some((&control, after)) = rest.split_first() {
        rest = after;
        if control < 32 {
            let (literal, after) = rest.split_at_checked(usize::from(control) + 1)?;
            out.extend(literal);
            rest = after;
        } else {
            let mut byte = || {
                let (&first, after) = rest.split_first()?;
                rest = after;
                Some(usize::from(first))
            };
            let mut length = usize::from(control >> 5);
            if length == 7 {
                length += byte()?;
            }
            let back = (usize::from(control & 31) << 8 | byte()?) + 1;
            let from = out.len().checked_sub(back)?;
            for i in 0..length + 2 {
                out.push(out[from + i]);
            }
        }
        if out.len() > most {
            return None;
        }
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::decoded;

    #[test]
    fn runs_and_repetitions() {
        // "abc", then six bytes from three back: what they repeat they make themselves; then 7 + 3 + 2 more.
        let stream = [2, b'a', b'b', b'c', 4 << 5, 2, 7 << 5, 3, 0];
        let want = b"abcabcabccccccccccccc";
        assert_eq!(decoded(&stream, 21).as_deref(), Some(&want[..]), "three literals, 6 and 12 repeated");
        assert_eq!(decoded(&stream, 20), None, "more than was announced");
        assert_eq!(decoded(&[], 0), Some(Vec::new()), "nothing");
        for broken in
            [&[2, b'a'][..], &[1 << 5, 0], &[0, b'a', 1 << 5], &[0, b'a', 1 << 5, 1], &[0, b'a', 7 << 5, 3]]
        {
            assert_eq!(decoded(broken, 100), None, "{broken:?}");
        }
    }
}
