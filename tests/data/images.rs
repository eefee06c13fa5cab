//! Image formats beside PNG and JPEG, EXIF orientation, and files that only other programs read.

use crate::captures::folder;
use crate::samples;
use image::{DynamicImage, ExtendedColorType, ImageEncoder, ImageFormat, RgbImage};
use lastlight::io::gaussian_ply;
use lastlight::io::image_file::{self, Encoding, Orientation, Picture, Samples};
use lastlight::scene::convert::read_scene;
use lastlight::scene::model;
use lastlight::scene::views::{Options, Views};
use std::io::Cursor;
use std::path::Path;

/// An image in a format of the image crate.
fn encoded(w: usize, h: usize, format: ImageFormat) -> Vec<u8> {
    let image = RgbImage::from_raw(w as u32, h as u32, samples::pixels(w, h, 3)).expect("sizes agree");
    let mut out = Cursor::new(Vec::new());
    image.write_to(&mut out, format).expect("encoded");
    out.into_inner()
}

#[test]
fn webp_tiff_and_bmp_are_read() {
    for (format, name) in
        [(ImageFormat::WebP, "a.webp"), (ImageFormat::Tiff, "a.tif"), (ImageFormat::Bmp, "a.bmp")]
    {
        let bytes = encoded(16, 12, format);
        let p = image_file::parse(&bytes, name).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((p.width, p.height, p.encoding), (16, 12, Encoding::Srgb), "{name}");
        assert_eq!(p.samples, Samples::U8(samples::pixels(16, 12, 3)), "{name}: lossless");
        assert_eq!(image_file::size(&bytes, name).expect("a size"), [16, 12], "{name}");
        let cut = image_file::parse(&bytes[..bytes.len() / 2], name).expect_err("truncated").to_string();
        assert!(cut.starts_with(name), "{cut}");
    }
    // 16 bits, and floats, which are linear.
    let words: Vec<u8> = [0_u16, 1, 32_768, 65_535].iter().flat_map(|x| x.to_ne_bytes()).collect();
    let tiff = |raw: &[u8], size: [u32; 2], kind: ExtendedColorType| {
        let mut out = Cursor::new(Vec::new());
        let encoder = image::codecs::tiff::TiffEncoder::new(&mut out);
        encoder.write_image(raw, size[0], size[1], kind).expect("encoded");
        out.into_inner()
    };
    let p = image_file::parse(&tiff(&words, [2, 2], ExtendedColorType::L16), "a.tif").expect("16 bits");
    assert_eq!(p.samples, Samples::U16(vec![0, 1, 32_768, 65_535]), "16 bits");
    let floats = |x: f32| [0.5_f32, x, -2.0].iter().flat_map(|x| x.to_ne_bytes()).collect::<Vec<u8>>();
    let p =
        image_file::parse(&tiff(&floats(7.0), [1, 1], ExtendedColorType::Rgb32F), "a.tif").expect("floats");
    assert_eq!((p.encoding, p.values()), (Encoding::Linear, vec![0.5, 7.0, -2.0]), "linear");
    let nan = tiff(&floats(f32::NAN), [1, 1], ExtendedColorType::Rgb32F);
    let e = image_file::parse(&nan, "a.tif").expect_err("not a number").to_string();
    assert!(e.contains("value 1") && e.contains("finite"), "{e}");
}

#[test]
fn unread_image_formats_are_named_with_what_converts_them() {
    for (bytes, format, tool) in [
        (&b"\0\0\0\x18ftypheic\0\0\0\0"[..], "HEIC", "heif-convert"),
        (b"\0\0\0\x1cftypavif\0\0\0\0", "AVIF", "avifdec"),
        (b"GIF89a\x01\0\x01\0", "GIF", "ImageMagick"),
        (b"\xff\x0a\xfa\x1f", "JPEG XL", "djxl"),
        (b"RIFF\x10\0\0\0WAVEfmt ", "bytes [52", ""),
        (b"RIFF\x10\0\0\0WEBP", "WebP", ""),
        (b"", "an empty file", ""),
    ] {
        let e = image_file::parse(bytes, "photo").expect_err("refused").to_string();
        assert!(e.starts_with("photo: ") && e.contains(format) && e.contains(tool), "{format}: {e}");
    }
    // A few bytes that declare 16 384² pixels.
    let mut bmp = encoded(4, 4, ImageFormat::Bmp);
    bmp[18..22].copy_from_slice(&16_384_u32.to_le_bytes());
    bmp[22..26].copy_from_slice(&16_384_u32.to_le_bytes());
    let e = image_file::parse(&bmp, "a.bmp").expect_err("a bomb").to_string();
    assert!(e.contains("16384x16384"), "{e}");
}

/// A JPEG with an EXIF orientation.
fn turned_jpeg(w: usize, h: usize, orientation: u8) -> Vec<u8> {
    let mut jpeg = samples::jpeg(w, h);
    let mut exif = b"\xff\xe1\0\x22Exif\0\0MM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0".to_vec();
    exif.extend([orientation, 0, 0, 0, 0, 0, 0]);
    assert_eq!(exif.len(), 2 + 0x22, "the segment has its length");
    jpeg.splice(2..2, exif);
    jpeg
}

#[test]
fn orientations_are_those_of_exif() {
    for value in 0..=9_u8 {
        let p = image_file::parse(&turned_jpeg(6, 4, value), "a.jpg").expect("a JPEG");
        assert_eq!(p.orientation, Orientation::of_exif(value), "{value}");
        assert_eq!((p.width, p.height), (6, 4), "{value}: pixels as stored");
    }
    for value in 1..=8_u8 {
        let stored = image_file::parse(&samples::png(6, 4, 3), "a.png").expect("our own file");
        let upright = Picture { orientation: Orientation::of_exif(value), ..stored }.upright();
        let mut want =
            DynamicImage::ImageRgb8(RgbImage::from_raw(6, 4, samples::pixels(6, 4, 3)).expect("sizes"));
        want.apply_orientation(image::metadata::Orientation::from_exif(value).expect("one of eight"));
        assert_eq!(
            (upright.width, upright.height),
            (want.width() as usize, want.height() as usize),
            "{value}"
        );
        assert_eq!(upright.samples, Samples::U8(want.into_bytes()), "{value}: as the image crate turns it");
        assert_eq!(upright.orientation, Orientation::STORED, "{value}: upright now");
    }
}

/// A capture of one photo.
fn capture(size: [usize; 2], photo: Vec<u8>, mask: Option<Vec<u8>>) -> tempfile::TempDir {
    let list = serde_json::json!({
        "fl_x": 20.0, "fl_y": 20.0, "w": size[0], "h": size[1],
        "frames": [{
            "file_path": "images/a.jpg",
            "mask_path": mask.as_ref().map(|_| "masks/a.png"),
            "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
        }]
    });
    let mut text = list;
    if mask.is_none() {
        text["frames"][0].as_object_mut().expect("a frame").remove("mask_path");
    }
    let mut files = vec![("transforms.json", text.to_string().into_bytes()), ("images/a.jpg", photo)];
    files.extend(mask.map(|m| ("masks/a.png", m)));
    folder(&files)
}

#[test]
fn the_declared_size_decides_on_exif_orientation() {
    let load = |size: [usize; 2], orientation: u8, mask: Option<Vec<u8>>| {
        let dir = capture(size, turned_jpeg(24, 16, orientation), mask);
        Views::load(dir.path(), &Options::default())
    };
    // As COLMAP: the size of the stored pixels.
    let v = load([24, 16], 6, None).expect("as stored");
    assert_eq!((v.views[0].camera.width, v.views[0].camera.height), (24, 16), "not turned");
    assert_eq!(
        (v.turned.len(), v.not_turned.as_slice()),
        (0, &["images/a.jpg".to_owned()][..]),
        "and said so"
    );
    // As a program that turns photos: the size of the upright image, or half of it.
    for size in [[16, 24], [8, 12]] {
        let v = load(size, 6, None).expect("upright");
        assert_eq!((v.views[0].camera.width, v.views[0].camera.height), (16, 24), "turned");
        assert_eq!(
            (v.turned.as_slice(), v.not_turned.len()),
            (&["images/a.jpg".to_owned()][..], 0),
            "and said so"
        );
        let stored = image_file::parse(&turned_jpeg(24, 16, 1), "a.jpg").expect("a JPEG");
        let Samples::U8(stored) = stored.samples else { panic!("8 bits") };
        // The top left pixel of an image turned clockwise was at the bottom left.
        assert_eq!(v.views[0].rgb[..3], stored[3 * 24 * 15..][..3], "clockwise");
    }
    let v = load([24, 16], 1, None).expect("plain");
    assert!(v.turned.is_empty() && v.not_turned.is_empty(), "nothing to say");
    let e = load([24, 24], 6, None).expect_err("neither fits").to_string();
    assert!(e.contains("24x24") && e.contains("24x16"), "{e}");
    // A mask of the stored pixels turns with its photo, a mask of the upright ones is as it is.
    let half = |w: usize, h: usize, on: &dyn Fn(usize, usize) -> bool| {
        let data: Vec<u8> = (0..w * h).map(|i| if on(i % w, i / w) { 255 } else { 0 }).collect();
        image_file::png_bytes(w, h, 1, &data).expect("a mask")
    };
    let stored = half(24, 16, &|x, _| x < 12);
    let upright = half(16, 24, &|_, y| y < 12);
    let [a, b] = [stored, upright].map(|m| load([16, 24], 6, Some(m)).expect("a mask").views[0].mask.clone());
    assert!(a.is_some() && a == b, "the same half");
}

#[test]
fn scenes_and_models_of_other_programs_are_named_with_what_converts_them() {
    for (path, parts) in [
        ("a.spz", ["splat-transform", ".spz"]),
        ("a.SOG", ["splat-transform", "SuperSplat"]),
        ("a.ksplat", ["splat-transform", "PLY"]),
        ("a.usdz", ["3DGS PLY", ".usdz"]),
        ("a.glb", ["mesh render", ".glb"]),
    ] {
        let e = read_scene(Path::new(path)).expect_err("refused").to_string();
        assert!(e.starts_with(path) && parts.iter().all(|p| e.contains(p)), "{e}");
    }
    for (path, part) in [("a.usdz", "Blender"), ("a.fbx", ".glb"), ("a.spz", "splat render")] {
        let e = model::read(Path::new(path)).expect_err("refused").to_string();
        assert!(e.starts_with(path) && e.contains(part), "{e}");
    }
    let compressed = b"ply\nformat binary_little_endian 1.0\nelement chunk 0\nproperty float min_x\nelement vertex 1\nproperty uint packed_position\nproperty uint packed_rotation\nproperty uint packed_scale\nproperty uint packed_color\nend_header\n0123456789abcdef";
    let e = gaussian_ply::parse(compressed, "a.compressed.ply").expect_err("refused").to_string();
    assert!(e.contains("splat-transform") && e.contains("compressed PLY"), "{e}");
}
