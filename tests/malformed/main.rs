//! Bad files: every reader answers with one clear error, never a panic, within bounded memory.
//!
//! Three parts: every file cut at every length; a table of hand-made malformed files; and mutated bytes of
//! valid files.

#[path = "../common/mod.rs"]
mod common;
mod models;
#[path = "../common/mutate.rs"]
mod mutate;
mod mutations;
#[path = "../samples/mod.rs"]
mod samples;
mod spoiled;

use lastlight::io::{
    colmap, colmap_text, gaussian_ply, image_file, npz, ply, safetensors, splat_file, transforms,
};
use lastlight::scene::field::Field;
use lastlight::scene::gaussians::Gaussians;
use lastlight::{Error, Result};

/// A reader that forgets what it read.
type Reader = fn(&[u8], &str) -> Result<()>;

/// A file name, its bytes, and what the message about them must name.
type Case = (&'static str, Vec<u8>, &'static str);

/// Name, file name, reader, a valid file, and whether every shorter file is malformed.
struct Format {
    name: &'static str,
    read: Reader,
    valid: Vec<u8>,
    /// Cut anywhere, the file is no longer valid.
    sealed: bool,
}

fn formats() -> Vec<Format> {
    let f = |name, read: Reader, valid, sealed| Format { name, read, valid, sealed };
    let opencv = [20.0, 21.0, 8.0, 6.0, 0.01, 0.02, 0.003, 0.004];
    let scene: Reader = |b, n| Gaussians::from_record(gaussian_ply::parse(b, n)?, n).map(drop);
    let scene_arrays: Reader = |b, n| Gaussians::from_arrays(&npz::parse(b, n)?, n).map(drop);
    let g = lastlight::scene::gaussians::Gaussians::from_record(samples::gaussians(1), "sample")
        .expect("a good scene");
    let mut all = models::formats();
    all.extend([
        f("stored.npz", |b, n| npz::parse(b, n).map(drop), samples::npz_file(npz::Packing::Stored), true),
        f("deflated.npz", |b, n| npz::parse(b, n).map(drop), samples::npz_file(npz::Packing::Deflated), true),
        f(
            "scene.npz",
            scene_arrays,
            npz::to_bytes(&g.to_arrays(), npz::Packing::Stored).expect("arrays fit"),
            true,
        ),
        f("one.npy", |b, n| npz::parse(b, n).map(drop), npy(), true),
        f("a.safetensors", |b, n| safetensors::parse(b, n).map(drop), samples::safetensors_file(), true),
        f("field.safetensors", |b, n| Field::parse(b, n).map(drop), samples::field_file(), true),
        f("scene.ply", scene, gaussian_ply::to_bytes(&samples::gaussians(1)), true),
        // Without its last line break, or digit by digit, a text is still a text.
        f("ascii.ply", |b, n| gaussian_ply::parse_points(b, n).map(drop), samples::ply_ascii(), false),
        f("faces.ply", |b, n| ply::parse(b, n).map(drop), ply_faces(), true),
        f(
            "a.splat",
            |b, n| Gaussians::from_splats(&splat_file::parse(b, n)?, n).map(drop),
            samples::splat(),
            false,
        ),
        f("a.png", |b, n| image_file::parse(b, n).map(drop), samples::png(16, 12, 3), true),
        f("a.jpg", |b, n| image_file::parse(b, n).map(drop), samples::jpeg(16, 12), true),
        f("a.hdr", |b, n| image_file::parse(b, n).map(drop), samples::hdr(16, 12), true),
        f("a.exr", |b, n| image_file::parse(b, n).map(drop), samples::exr(16, 12), true),
        f("a.webp", |b, n| image_file::parse(b, n).map(drop), encoded(image::ImageFormat::WebP), true),
        f("a.tif", |b, n| image_file::parse(b, n).map(drop), encoded(image::ImageFormat::Tiff), true),
        f("a.bmp", |b, n| image_file::parse(b, n).map(drop), encoded(image::ImageFormat::Bmp), true),
        f("transforms.json", |b, n| transforms::parse(b, n).map(drop), samples::transforms(3), true),
        f(
            "cameras.bin",
            |b, n| colmap::parse_cameras(b, n).map(drop),
            samples::cameras_bin(4, &opencv),
            true,
        ),
        f("images.bin", |b, n| colmap::parse_images(b, n).map(drop), samples::images_bin(3), true),
        f("points3D.bin", |b, n| colmap::parse_points(b, n).map(drop), samples::points_bin(), true),
        f(
            "cameras.txt",
            |b, n| colmap_text::parse_cameras(b, n).map(drop),
            samples::cameras_txt("RADIAL", "20 8 6 .1 .2"),
            false,
        ),
        f("images.txt", |b, n| colmap_text::parse_images(b, n).map(drop), samples::images_txt(3), false),
        f("points3D.txt", |b, n| colmap_text::parse_points(b, n).map(drop), samples::points_txt(), false),
    ]);
    all
}

/// An image in a format of the image crate.
fn encoded(format: image::ImageFormat) -> Vec<u8> {
    let image = image::RgbImage::from_raw(16, 12, samples::pixels(16, 12, 3)).expect("sizes agree");
    let mut out = std::io::Cursor::new(Vec::new());
    image.write_to(&mut out, format).expect("encoded");
    out.into_inner()
}

/// A stored array of two floats, as a plain `.npy`.
fn npy() -> Vec<u8> {
    let arrays = lastlight::num::array::Arrays::new().with("a", &[2], vec![1.0f32, 2.0]);
    let bytes = npz::to_bytes(&arrays, npz::Packing::Stored).expect("fits");
    let at = find(&bytes, b"\x93NUMPY");
    bytes[at..at + 128 + 8].to_vec()
}

fn ply_faces() -> Vec<u8> {
    let mut b = b"ply\nformat binary_big_endian 1.0\nelement face 2\nproperty list uchar int v\nproperty short s\nend_header\n".to_vec();
    b.extend([2, 0, 0, 0, 1, 0, 0, 0, 2, 0, 9, 0, 0, 8]);
    b
}

fn find(bytes: &[u8], needle: &[u8]) -> usize {
    bytes.windows(needle.len()).position(|w| w == needle).expect("the sample holds it")
}

/// An error must begin with the file name and state once what was expected; it must not quote messages of the
/// system or of a decoder that state it again.
fn check(e: &Error, name: &str) {
    let text = e.to_string();
    assert!(text.starts_with(&format!("{name}: ")), "begins with the file name: {text}");
    assert!(text.len() < 2000, "is one line of readable length: {text}");
    assert!(text.contains("expected") || text.contains("got"), "states what was expected: {text}");
    assert!(text.matches(" expected ").count() <= 1, "states once what was expected: {text}");
    assert!(!text.contains("os error"), "has no error number of the system: {text}");
    assert_eq!(e.exit_code(), 2, "bad input: {text}");
}

#[test]
fn valid_samples_are_valid() {
    for f in formats() {
        if let Err(e) = (f.read)(&f.valid, f.name) {
            panic!("{e}");
        }
    }
}

#[test]
fn every_file_cut_at_every_length() {
    for f in formats() {
        for len in 0..f.valid.len() {
            let outcome = (f.read)(&f.valid[..len], f.name);
            match outcome {
                Err(e) => check(&e, f.name),
                Ok(()) => {
                    assert!(!f.sealed, "{} cut to {len} of {} bytes was accepted", f.name, f.valid.len())
                }
            }
        }
    }
}

#[test]
fn every_file_with_a_tail() {
    for f in formats() {
        // Archives, images and safetensors: the end is found by other means, or more is refused.
        let mut long = f.valid.clone();
        long.extend_from_slice(b"\x00\x01 tail \xff");
        let outcome = (f.read)(&long, f.name);
        match (f.name, outcome) {
            (_, Err(e)) => check(&e, f.name),
            (
                "stored.npz" | "deflated.npz" | "scene.npz" | "a.png" | "a.jpg" | "a.webp" | "a.tif"
                | "a.bmp" | "a.hdr" | "a.exr" | "map.exr",
                Ok(()),
            ) => {}
            (_, Ok(())) => panic!("{} with a tail was accepted", f.name),
        }
    }
}

#[test]
fn files_spoiled_by_hand() {
    let formats = formats();
    for (name, bytes, place) in spoiled::all() {
        let format = formats.iter().find(|f| f.name == name).expect("a known format");
        match (format.read)(&bytes, name) {
            Ok(()) => panic!("{name}, spoiled at '{place}', was accepted"),
            Err(e) => {
                check(&e, name);
                println!("{e}");
                assert!(e.to_string().contains(place), "'{place}' is not in: {e}");
            }
        }
    }
}

#[test]
fn zip_bombs_are_refused() {
    // A member that unpacks to far more than its header declares.
    let zeros = lastlight::num::array::Arrays::new().with("a", &[1 << 22], vec![0.0f32; 1 << 22]);
    let bomb = npz::to_bytes(&zeros, npz::Packing::Deflated).expect("fits");
    assert!(bomb.len() < 20_000, "16 MiB in {} bytes", bomb.len());
    assert_eq!(npz::parse(&bomb, "zeros.npz").expect("honest").0.len(), 1, "an honest one is read");
    // Lying about the unpacked size, in both places where the archive states it.
    let honest = (128 + 4 * (1u32 << 22)).to_le_bytes();
    let mut lie = bomb.clone();
    let mut changed = 0;
    for at in 0..lie.len() - 4 {
        if lie[at..at + 4] == honest {
            lie[at..at + 4].copy_from_slice(&(128u32 + 8).to_le_bytes());
            changed += 1;
        }
    }
    assert!(changed >= 1, "the size is stated");
    check(&npz::parse(&lie, "lie.npz").expect_err("sizes disagree"), "lie.npz");
    // Two members at one place, as overlapping bombs have: the directory lists more than the file can hold.
    let one = npz::to_bytes(&zeros, npz::Packing::Deflated).expect("fits");
    let directory = find(&one, b"PK\x01\x02");
    let end = find(&one, b"PK\x05\x06");
    let mut overlapping = one[..directory].to_vec();
    let entry = &one[directory..end];
    for i in 0..100u8 {
        let mut copy = entry.to_vec();
        let name = find(&copy, b"a.npy");
        copy[name] = b'0' + i % 10;
        copy[name + 1] = b'a' + i / 10;
        overlapping.extend_from_slice(&copy);
    }
    let mut tail = one[end..].to_vec();
    tail[8..10].copy_from_slice(&100u16.to_le_bytes());
    tail[10..12].copy_from_slice(&100u16.to_le_bytes());
    tail[12..16].copy_from_slice(&((entry.len() * 100) as u32).to_le_bytes());
    overlapping.extend_from_slice(&tail);
    check(&npz::parse(&overlapping, "bomb.npz").expect_err("overlapping members"), "bomb.npz");
    within_memory();
}

/// Limit of the address space that this test program may reserve, in bytes: its threads, and files of a few
/// kilobytes.
const ALLOWANCE: u64 = 1 << 30;

/// Fails once the program has reserved more than [`ALLOWANCE`], used or not. Only Linux reports the amount.
fn within_memory() {
    let Ok(status) = std::fs::read_to_string("/proc/self/status") else { return };
    let line = status.lines().find(|l| l.starts_with("VmPeak:")).expect("Linux states the peak");
    let kib: u64 =
        line.split_ascii_whitespace().nth(1).and_then(|w| w.parse().ok()).expect("a number of KiB");
    assert!(kib * 1024 <= ALLOWANCE, "{kib} KiB reserved");
}

/// Mutations of every format that are tried; many more with `LASTLIGHT_LONG=1`.
fn cases() -> u64 {
    if std::env::var_os("LASTLIGHT_LONG").is_some_and(|v| v == "1") { 200_000 } else { 10_000 }
}

#[test]
fn mutated_bytes_never_panic() {
    let all = formats();
    let files: Vec<&[u8]> = all.iter().map(|f| &f.valid[..]).collect();
    mutate::every_case(2, cases(), &files, |file, bytes| {
        let f = &all[file];
        if let Err(e) = (f.read)(bytes, f.name) {
            check(&e, f.name);
        }
        // The peak is kept by the system: once per case is enough.
        if file == 0 {
            within_memory();
        }
    });
    within_memory();
}
