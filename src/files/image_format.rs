//! Recognises image formats by the first bytes of a file.

use crate::{Error, Result};

/// A format that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ImageFormat {
    Png,
    Jpeg,
    WebP,
    Tiff,
    Bmp,
    Hdr,
    Exr,
}

/// Formats that are recognised and not read, and what converts them.
const OTHERS: [(&str, &str); 4] = [
    ("HEIC or HEIF", "convert it to JPEG first, for example with `heif-convert` or ImageMagick"),
    ("AVIF", "convert it to PNG or JPEG first, for example with `avifdec`"),
    ("GIF", "convert its frames to PNG first, for example with ImageMagick or ffmpeg"),
    ("JPEG XL", "convert it to PNG or JPEG first, for example with `djxl`"),
];

impl ImageFormat {
    /// Recognises the format of a file.
    ///
    /// # Errors
    /// When it is another one; the message names a known one, and what converts it.
    pub(super) fn of(bytes: &[u8], name: &str) -> Result<Self> {
        let is = |at: usize, magic: &[u8]| bytes.get(at..at + magic.len()) == Some(magic);
        if is(0, b"\x89PNG\r\n\x1a\n") {
            return Ok(Self::Png);
        }
        if is(0, b"\xff\xd8\xff") {
            return Ok(Self::Jpeg);
        }
        if is(0, b"RIFF") && is(8, b"WEBP") {
            return Ok(Self::WebP);
        }
        // The last two are BigTIFF, with offsets of 64 bits.
        if is(0, b"II\x2a\0") || is(0, b"MM\0\x2a") || is(0, b"II\x2b\0") || is(0, b"MM\0\x2b") {
            return Ok(Self::Tiff);
        }
        if is(0, b"BM") {
            return Ok(Self::Bmp);
        }
        if is(0, b"#?") {
            return Ok(Self::Hdr);
        }
        if is(0, b"\x76\x2f\x31\x01") {
            return Ok(Self::Exr);
        }
        let e = Error::input(name)
            .at("byte 0")
            .expected("the start of a PNG, JPEG, WebP, TIFF, BMP, Radiance HDR or OpenEXR file");
        let brands: [&[u8]; 6] = [b"heic", b"heix", b"hevc", b"heim", b"mif1", b"msf1"];
        let other = if is(4, b"ftyp") && brands.iter().any(|brand| is(8, brand)) {
            0
        } else if is(4, b"ftypavif") || is(4, b"ftypavis") {
            1
        } else if is(0, b"GIF8") {
            2
        } else if is(0, b"\xff\x0a") || is(0, b"\0\0\0\x0cJXL ") {
            3
        } else {
            let start = &bytes[..crate::num::order::min(bytes.len(), 8)];
            let got = if start.is_empty() { "an empty file".into() } else { format!("bytes {start:02x?}") };
            return Err(e.got(got));
        };
        let (format, hint) = OTHERS[other];
        Err(e.got(format!("{format}, which is not read")).hint(hint))
    }
}
