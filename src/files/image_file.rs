//! Images: PNG, JPEG, WebP, TIFF, BMP, Radiance HDR and OpenEXR in; PNG (8 bit) and OpenEXR (f32) out.
//!
//! The format is recognised by the first bytes of the file, not by its extension. The reader checks the declared size against the length
//! of the file before decoding. HDR, EXR and TIFF of floats hold linear values, the others sRGB-encoded ones; nothing is converted, and
//! colour profiles are ignored. Of a TIFF the first page is read; an animated WebP is refused.
//!
//! Pixels are returned as they are stored. The EXIF orientation is part of the result ([`Picture::orientation`]), and the caller
//! decides whether it applies ([`Picture::upright`]): textures and masks ignore it, photos of a capture follow the declared size.

use super::gaussian_ply::to_byte;
use super::image_data::check_size;
pub use super::image_data::{Encoding, MAX_SIDE, Orientation, Picture, Samples};
use super::image_format::ImageFormat;
use super::read::reported;
use super::{MAX_SMALL_FILE_BYTES, atomic, guard, image_exr, memory, name_of, read_bytes};
use crate::num::order;
use crate::{Error, Result};
use image::codecs::bmp::BmpDecoder;
use image::codecs::hdr::HdrDecoder;
use image::codecs::jpeg::JpegDecoder;
use image::codecs::png::{CompressionType, FilterType, PngDecoder, PngEncoder};
use image::codecs::tiff::TiffDecoder;
use image::codecs::webp::WebPDecoder;
use image::{ExtendedColorType, ImageDecoder, ImageEncoder};
use std::io::Cursor;
use std::path::Path;

/// Maximum number of bytes a decoder may allocate besides the image.
const MAX_SIDE_DATA: u64 = 64 << 20;

/// Largest number of pixels of a file that may be arbitrarily small: 4096². A flat WebP packs any number into a few bytes.
const MAX_FLAT: usize = 1 << 24;

/// Reads an image.
///
/// # Errors
/// When it is not readable, of another format, too large, truncated, or holds a number that is not finite.
pub fn read(path: &Path) -> Result<Picture> {
    parse(&read_bytes(path, MAX_SMALL_FILE_BYTES)?, &name_of(path))
}

/// Like [`read`] for bytes in memory; `name` is the file name in errors.
///
/// # Errors
/// See [`read`].
pub fn parse(bytes: &[u8], name: &str) -> Result<Picture> {
    let broken = |e| undecodable("image data", name, &e);
    let n = bytes.len();
    guard(name, || match ImageFormat::of(bytes, name)? {
        ImageFormat::Png => {
            png_complete(bytes, name)?;
            let d = png(bytes).map_err(broken)?;
            // Deflate compresses by a factor of at most 1032.
            let bits = u64::from(d.original_color_type().bits_per_pixel());
            decode(d, n, 1040 * 8 / order::max(bits, 1), name)
        }
        ImageFormat::Jpeg => {
            jpeg_complete(bytes, name)?;
            // A block of 64 luminance values takes at least one bit.
            decode(JpegDecoder::new(Cursor::new(bytes)).map_err(broken)?, n, 512, name)
        }
        ImageFormat::WebP => {
            webp_complete(bytes, name)?;
            let d = WebPDecoder::new(Cursor::new(bytes)).map_err(broken)?;
            if d.has_animation() {
                let e = Error::input(name).at("WebP header").expected("a still image");
                return Err(e.got("an animation").hint("extract its frames, for example with `anim_dump`"));
            }
            decode(d, order::max(n, MAX_FLAT / 512), 512, name)
        }
        ImageFormat::Tiff => {
            let mut d = TiffDecoder::new(Cursor::new(bytes)).map_err(broken)?;
            let (w, h) = d.dimensions();
            // Deflate compresses by a factor of at most 1032, LZW by less than 2048.
            let per_byte = 2048 * 8 / u64::from(order::max(d.original_color_type().bits_per_pixel(), 1));
            check_size(u64::from(w), u64::from(h), n, per_byte, name)?;
            let mut limits = image::Limits::default();
            limits.max_alloc = Some(d.total_bytes().saturating_mul(2) + MAX_SIDE_DATA);
            d.set_limits(limits).map_err(broken)?;
            decode(d, n, per_byte, name)
        }
        // A run of 255 takes two bytes.
        ImageFormat::Bmp => decode(BmpDecoder::new(Cursor::new(bytes)).map_err(broken)?, n, 128, name),
        ImageFormat::Hdr => {
            // The strict reader refuses header lines that other programs write. A run of 127 takes two bytes.
            decode(HdrDecoder::new_nonstrict(Cursor::new(bytes)).map_err(broken)?, n, 64, name)
        }
        ImageFormat::Exr => image_exr::parse(bytes, name),
    })
}

/// Declared width and height of an image as it is stored, checked as in [`parse`], without decoding.
///
/// # Errors
/// When it is of another format, or its header is malformed or declares an absurd size.
pub fn size(bytes: &[u8], name: &str) -> Result<[usize; 2]> {
    let broken = |e| undecodable("image header", name, &e);
    let data = Cursor::new(bytes);
    guard(name, || {
        let (w, h) = match ImageFormat::of(bytes, name)? {
            ImageFormat::Png => png(bytes).map_err(broken)?.dimensions(),
            ImageFormat::Jpeg => JpegDecoder::new(data).map_err(broken)?.dimensions(),
            ImageFormat::WebP => WebPDecoder::new(data).map_err(broken)?.dimensions(),
            ImageFormat::Tiff => TiffDecoder::new(data).map_err(broken)?.dimensions(),
            ImageFormat::Bmp => BmpDecoder::new(data).map_err(broken)?.dimensions(),
            ImageFormat::Hdr | ImageFormat::Exr => {
                let p = parse(bytes, name)?;
                (p.width as u32, p.height as u32)
            }
        };
        check_size(u64::from(w), u64::from(h), usize::MAX >> 1, 1, name)?;
        Ok([w as usize, h as usize])
    })
}

fn undecodable(place: &str, name: &str, e: &image::ImageError) -> Error {
    Error::input(name).at(place).expected("a complete image").got(reported(e))
}

fn png(bytes: &[u8]) -> image::ImageResult<PngDecoder<Cursor<&[u8]>>> {
    // Colour profiles and texts may be compressed too.
    let mut limits = image::Limits::default();
    limits.max_alloc = Some(MAX_SIDE_DATA);
    PngDecoder::with_limits(Cursor::new(bytes), limits)
}

fn decode(mut d: impl ImageDecoder, bytes: usize, pixels_per_byte: u64, name: &str) -> Result<Picture> {
    use image::ColorType as C;
    let (w, h) = d.dimensions();
    check_size(u64::from(w), u64::from(h), bytes, pixels_per_byte, name)?;
    let color = d.color_type();
    // Metadata that cannot be read says nothing about the pixels.
    let orientation = d.orientation().map_or(Orientation::STORED, |o| Orientation::of_exif(o.to_exif()));
    let mut raw =
        memory::filled(name, (w as usize) * (h as usize) * usize::from(color.bytes_per_pixel()), 0)?;
    d.read_image(&mut raw).map_err(|e| undecodable("image data", name, &e))?;
    // `image` returns native-endian words.
    let words = || raw.chunks_exact(2).map(|c| u16::from_ne_bytes([c[0], c[1]])).collect();
    let (channels, samples): (&[&str], Samples) = match color {
        C::L8 => (&["Y"], Samples::U8(raw)),
        C::La8 => (&["Y", "A"], Samples::U8(raw)),
        C::Rgb8 => (&["R", "G", "B"], Samples::U8(raw)),
        C::Rgba8 => (&["R", "G", "B", "A"], Samples::U8(raw)),
        C::L16 => (&["Y"], Samples::U16(words())),
        C::La16 => (&["Y", "A"], Samples::U16(words())),
        C::Rgb16 => (&["R", "G", "B"], Samples::U16(words())),
        C::Rgba16 => (&["R", "G", "B", "A"], Samples::U16(words())),
        C::Rgb32F => (&["R", "G", "B"], Samples::F32(floats(&raw, name)?)),
        C::Rgba32F => (&["R", "G", "B", "A"], Samples::F32(floats(&raw, name)?)),
        other => {
            let expected = "grey or RGB, with or without alpha";
            return Err(Error::input(name).at("colour type").expected(expected).got(format!("{other:?}")));
        }
    };
    let encoding = if matches!(samples, Samples::F32(_)) { Encoding::Linear } else { Encoding::Srgb };
    let channels = channels.iter().map(|&c| c.to_owned()).collect();
    Ok(Picture { width: w as usize, height: h as usize, channels, encoding, samples, orientation })
}

/// Native-endian words as finite numbers.
fn floats(raw: &[u8], name: &str) -> Result<Vec<f32>> {
    let values: Vec<f32> =
        raw.chunks_exact(4).map(|c| f32::from_ne_bytes([c[0], c[1], c[2], c[3]])).collect();
    match values.iter().position(|x| !x.is_finite()) {
        None => Ok(values),
        Some(i) => Err(Error::input(name)
            .at(format!("value {i}"))
            .expected("a finite number")
            .got(values[i].to_string())),
    }
}

/// A WebP is a RIFF file that declares its length.
fn webp_complete(bytes: &[u8], name: &str) -> Result<()> {
    let declared = bytes.get(4..8).map_or(0, |n| u32::from_le_bytes([n[0], n[1], n[2], n[3]])) as usize + 8;
    if declared <= bytes.len() {
        return Ok(());
    }
    Err(Error::input(name)
        .at("WebP header")
        .expected(format!("{declared} bytes, as declared"))
        .got(format!("{} before the end of the file", bytes.len())))
}

/// A PNG ends with its IEND chunk; decoders stop before it.
fn png_complete(bytes: &[u8], name: &str) -> Result<()> {
    let mut at = 8;
    loop {
        let Some(head) = bytes.get(at..at + 8) else {
            return Err(Error::input(name)
                .at(format!("byte {at}: PNG chunk"))
                .expected("an IEND chunk")
                .got("the end of the file"));
        };
        let len = u32::from_be_bytes([head[0], head[1], head[2], head[3]]) as usize;
        let left = bytes.len() - at;
        if len + 12 > left {
            return Err(Error::input(name)
                .at(format!("byte {at}: PNG chunk '{}'", head[4..8].escape_ascii()))
                .expected(format!("{} bytes", len + 12))
                .got(format!("{left} before the end of the file")));
        }
        if &head[4..8] == b"IEND" {
            return Ok(());
        }
        at += len + 12;
    }
}

/// A JPEG ends with an end-of-image marker; without this check the decoder fills a truncated image with grey
/// and reports no error.
fn jpeg_complete(bytes: &[u8], name: &str) -> Result<()> {
    let fail = |at: usize, expected: &str, got: String| {
        Err(Error::input(name).at(format!("byte {at}: JPEG marker")).expected(expected).got(got))
    };
    let mut at = 2;
    loop {
        let Some(&[mark, code]) = bytes.get(at..at + 2) else {
            return fail(at, "an end-of-image marker", "the end of the file".into());
        };
        match (mark, code) {
            (0xff, 0xff) => at += 1,
            (0xff, 0xd9) => return Ok(()),
            (0xff, 0x01 | 0xd0..=0xd7) => at += 2,
            (0xff, _) => {
                let Some(&[high, low]) = bytes.get(at + 2..at + 4) else {
                    return fail(at, "the length of a segment", "the end of the file".into());
                };
                at += 2 + usize::from(u16::from_be_bytes([high, low]));
                if code == 0xda {
                    // Compressed data: up to a marker that is neither a stuffed zero nor a restart.
                    let data = bytes.get(at..).unwrap_or_default();
                    let next = data.windows(2).position(|w| w[0] == 0xff && !matches!(w[1], 0 | 0xd0..=0xd7));
                    match next {
                        Some(n) => at += n,
                        None => {
                            return fail(bytes.len(), "an end-of-image marker", "the end of the file".into());
                        }
                    }
                }
            }
            _ => return fail(at, "0xff", format!("{mark:#04x}")),
        }
    }
}

/// Values in 0..1 to bytes: limited to 0..1, then ⌊255 x + ½⌋ (half up).
///
/// # Errors
/// When a value is not a number.
pub fn to_u8(values: &[f32]) -> Result<Vec<u8>> {
    if let Some(i) = values.iter().position(|x| x.is_nan()) {
        return Err(Error::input("image").at(format!("value {i}")).expected("a number").got("NaN"));
    }
    Ok(values.iter().map(|&x| to_byte(f64::from(x))).collect())
}

/// The bytes of an 8-bit PNG; 1 to 4 channels (Y, YA, RGB, RGBA), (H, W, C) row-major.
///
/// # Errors
/// When the sizes disagree.
pub fn png_bytes(width: usize, height: usize, channels: usize, data: &[u8]) -> Result<Vec<u8>> {
    let failed = |got: String| Error::input("PNG").expected("1 to 4 channels and H·W·C values").got(got);
    let color = match channels {
        1 => ExtendedColorType::L8,
        2 => ExtendedColorType::La8,
        3 => ExtendedColorType::Rgb8,
        4 => ExtendedColorType::Rgba8,
        n => return Err(failed(format!("{n} channels"))),
    };
    check_size(width as u64, height as u64, usize::MAX >> 1, 1, "PNG")?;
    if data.len() != width * height * channels {
        return Err(failed(format!("{} values for {height}x{width}x{channels}", data.len())));
    }
    let mut out = Vec::new();
    PngEncoder::new_with_quality(&mut out, CompressionType::Default, FilterType::Adaptive)
        .write_image(data, width as u32, height as u32, color)
        .map_err(|e| failed(e.to_string()))?;
    Ok(out)
}

/// Writes an 8-bit PNG atomically.
///
/// # Errors
/// When the sizes disagree or the file cannot be written.
pub fn write_png(path: &Path, width: usize, height: usize, channels: usize, data: &[u8]) -> Result<()> {
    let bytes = png_bytes(width, height, channels, data).map_err(|e| e.within(name_of(path)))?;
    atomic::write_bytes(path, &bytes)
}

/// Writes f32 channels as OpenEXR atomically; see [`exr_bytes`].
///
/// # Errors
/// When the sizes disagree, a value is not finite, or the file cannot be written.
pub fn write_exr(path: &Path, width: usize, height: usize, channels: &[&str], data: &[f32]) -> Result<()> {
    let bytes = exr_bytes(width, height, channels, data).map_err(|e| e.within(name_of(path)))?;
    atomic::write_bytes(path, &bytes)
}

/// The bytes of an OpenEXR file: f32, ZIP, scan lines; `data` is (H, W, C) row-major with C named `channels`,
/// such as `["R", "G", "B"]` or `["Z"]`. Values are stored as they are, −0 included.
///
/// # Errors
/// When the sizes disagree or a value is not finite.
pub fn exr_bytes(width: usize, height: usize, channels: &[&str], data: &[f32]) -> Result<Vec<u8>> {
    image_exr::to_bytes(width, height, channels, data)
}
