//! Bad files: every reader answers with one clear error, never a panic, within bounded memory.
//!
//! Three parts: every file cut at every length; a table of files spoiled by hand; and mutated bytes of valid files.

#[path = "../common/mod.rs"]
mod common;
mod models;
#[path = "../common/mutate.rs"]
mod mutate;
mod mutations;
#[path = "../samples/mod.rs"]
mod samples;

use lastlight::io::{
    colmap, colmap_text, gaussian_ply, image_file, npz, ply, safetensors, splat_file, transforms,
};
use lastlight::scene::gaussians::Gaussians;
use lastlight::{Error, Result};

/// A reader that forgets what it read.
type Reader = fn(&[u8], &str) -> Result<()>;

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

/// An error must name the file first and say something about the place.
fn check(e: &Error, name: &str) {
    let text = e.to_string();
    assert!(text.starts_with(&format!("{name}: ")), "names the file: {text}");
    assert!(text.len() < 2000, "one line for a person: {text}");
    assert!(text.contains("expected") || text.contains("got"), "says what was expected: {text}");
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
        // Archives, pictures and safetensors: the end is found by other means, or more is refused.
        let mut long = f.valid.clone();
        long.extend_from_slice(b"\x00\x01 tail \xff");
        let outcome = (f.read)(&long, f.name);
        match (f.name, outcome) {
            (_, Err(e)) => check(&e, f.name),
            (
                "stored.npz" | "deflated.npz" | "scene.npz" | "a.png" | "a.jpg" | "a.hdr" | "a.exr"
                | "map.exr",
                Ok(()),
            ) => {}
            (_, Ok(())) => panic!("{} with a tail was accepted", f.name),
        }
    }
}

/// Replaces bytes.
fn splice(bytes: &[u8], at: usize, with: &[u8]) -> Vec<u8> {
    let mut out = bytes.to_vec();
    out[at..at + with.len()].copy_from_slice(with);
    out
}

/// Replaces text of the same or another length.
fn text(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    let at = find(bytes, from.as_bytes());
    [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
}

#[test]
fn files_spoiled_by_hand() {
    let nan64 = f64::NAN.to_le_bytes();
    let huge = u64::MAX.to_le_bytes();
    let many = (1u64 << 40).to_le_bytes();
    let by_name = |name: &str| formats().into_iter().find(|f| f.name == name).expect("a known format");
    let valid = |name: &str| by_name(name).valid;
    let end = |name: &str| find(&valid(name), b"end_header\n") + 11;
    // Format, bytes, and what the message must name.
    let cases: Vec<(&str, Vec<u8>, &str)> = vec![
        // npz: declared shapes against bytes, types that are not numbers, names.
        ("stored.npz", text(&valid("stored.npz"), "'shape': (2, 3), ", "'shape': (2, 4), "), "array 'f32'"),
        ("stored.npz", text(&valid("stored.npz"), "'descr': '<f4'", "'descr': '|O '"), "array 'empty'"),
        ("stored.npz", b"not a zip archive at all".to_vec(), "zip directory"),
        ("one.npy", npy_shape("(9999999999,)"), "elements of shape [9999999999]"),
        ("one.npy", text(&npy(), "(2,)", "(3,)"), "elements of shape [3]"),
        ("one.npy", npy_shape("(0, 4611686018427387904, 8)"), "shape"),
        ("one.npy", npy_shape("(2, -1)"), "non-negative"),
        ("one.npy", npy_shape("((((2,))))"), "non-negative"),
        ("one.npy", splice(&npy(), 8, &[255, 255]), "npy header"),
        ("one.npy", text(&npy(), "False", "Maybe"), "True or False"),
        ("scene.npz", npz_with("scales", &[5, 3], -1.0), "array 'scales': row 0"),
        ("scene.npz", npz_with("opacities", &[5], 2.0), "array 'opacities': row 0"),
        ("scene.npz", npz_with("means", &[5, 3], f32::NAN), "array 'means': index [0, 0]"),
        ("scene.npz", npz_with("quats", &[4, 4], 1.0), "array 'quats'"),
        ("scene.npz", npz_with("quats", &[5, 4], 0.0), "Gaussian 0, quaternion"),
        ("scene.npz", npz_with("sh", &[5, 5, 3], 0.0), "array 'sh'"),
        // safetensors: header length, offsets, shapes.
        ("a.safetensors", splice(&valid("a.safetensors"), 0, &huge), "header length"),
        (
            "a.safetensors",
            text(&valid("a.safetensors"), "\"shape\":[3]", "\"shape\":[4]"),
            "array 'f64', data_offsets: expected 32 bytes",
        ),
        ("a.safetensors", text(&valid("a.safetensors"), "\"F64\"", "\"F99\""), "header"),
        (
            "a.safetensors",
            text(&valid("a.safetensors"), "\"data_offsets\":[0,", "\"data_offsets\":[8,"),
            "array 'f64', data_offsets",
        ),
        // PLY: counts, types, rows, values.
        ("scene.ply", text(&valid("scene.ply"), "vertex 5", "vertex 6"), "element vertex"),
        ("scene.ply", text(&valid("scene.ply"), "vertex 5", "vertex 99999999999999"), "element vertex"),
        ("scene.ply", text(&valid("scene.ply"), "vertex 5", "vertex 99999999999999999999"), "header, line 4"),
        ("scene.ply", text(&valid("scene.ply"), "float opacity", "float opaqueness"), "'opacity'"),
        ("scene.ply", text(&valid("scene.ply"), "float f_rest_8", "float rest_8"), "f_rest_*"),
        ("scene.ply", text(&valid("scene.ply"), "float rot_0", "half rot_0"), "header, line"),
        ("scene.ply", text(&valid("scene.ply"), "float rot_0", "float x"), "once"),
        (
            "scene.ply",
            splice(&valid("scene.ply"), end("scene.ply") + 4, &f32::NAN.to_le_bytes()),
            "row 0, property y",
        ),
        ("ascii.ply", text(&valid("ascii.ply"), "0 1 2 10", "0 1 inf 10"), "row 0, property z"),
        (
            "ascii.ply",
            text(&valid("ascii.ply"), "0 1 2 10", "0 1 2 256"),
            "line 14: element vertex, row 0, property red",
        ),
        ("ascii.ply", text(&valid("ascii.ply"), "0 1 2 10 20 30", "0 1 2 10 20"), "line 14"),
        ("ascii.ply", text(&valid("ascii.ply"), "0 1 2 10 20 30", "0 1 2 10 20 30 40"), "line 14"),
        ("ascii.ply", text(&valid("ascii.ply"), "3 0 1 0", "1e9 0 1 0"), "line 16"),
        ("ascii.ply", text(&valid("ascii.ply"), "3 0 1 0", "4 0 1 0"), "line 16"),
        ("faces.ply", splice(&ply_faces(), end("faces.ply"), &[200]), "element face, row 0"),
        (
            "faces.ply",
            b"ply\nformat ascii 1.0\nelement nothing 9999999999\nend_header\n".to_vec(),
            "element nothing",
        ),
        // .splat
        ("a.splat", splice(&valid("a.splat"), 36, &f32::NAN.to_le_bytes()), "row 1 (byte 32), position"),
        ("a.splat", splice(&valid("a.splat"), 12, &(-1.0f32).to_le_bytes()), "row 0 (byte 0), scale"),
        ("a.splat", splice(&valid("a.splat"), 28, &[128; 4]), "rotation"),
        // Pictures: sizes that the bytes cannot hold, damage.
        ("a.png", splice(&valid("a.png"), 16, &[0x7f, 0xff, 0xff, 0xff]), "a.png"),
        ("a.png", png_size(16_000, 16_000), "picture size"),
        ("a.png", png_size(20_000, 1), "picture size"),
        ("a.jpg", jpeg_size(16_000, 16_000), "picture size"),
        ("a.hdr", text(&valid("a.hdr"), "-Y 12 +X 16", "-Y 9999 +X 9999"), "picture size"),
        ("a.exr", exr_nan(), "channel G, row 0, column 1"),
        ("a.exr", vec![], "empty"),
        // transforms.json
        ("transforms.json", text(&valid("transforms.json"), "\"w\":16", "\"w\":1e9"), "w: expected"),
        ("transforms.json", text(&valid("transforms.json"), "\"fl_x\":20.0", "\"fl_x\":\"20\""), "fl_x"),
        (
            "transforms.json",
            text(&valid("transforms.json"), "images/0001.png", "../../0001.png"),
            "frames[1].file_path",
        ),
        (
            "transforms.json",
            text(&valid("transforms.json"), "[0,1,0,0]", "[0,0,0,0]"),
            "frames[0].transform_matrix",
        ),
        ("transforms.json", text(&valid("transforms.json"), "20.0", "NaN"), "line 1"),
        // COLMAP
        ("cameras.bin", splice(&valid("cameras.bin"), 0, &huge), "number of cameras"),
        ("cameras.bin", splice(&valid("cameras.bin"), 0, &many), "number of cameras"),
        (
            "cameras.bin",
            splice(&valid("cameras.bin"), 12, &99i32.to_le_bytes()),
            "camera 0 of 1 (id 7), model",
        ),
        ("cameras.bin", splice(&valid("cameras.bin"), 16, &huge), "pixels a side"),
        ("cameras.bin", splice(&valid("cameras.bin"), 32, &nan64), "camera 0 of 1, parameter 0"),
        ("images.bin", splice(&valid("images.bin"), 0, &many), "number of images"),
        ("images.bin", splice(&valid("images.bin"), 12, &nan64), "image 0 of 3, pose value 0"),
        ("images.bin", splice(&valid("images.bin"), 12, &[0; 8]), "quaternion"),
        ("images.bin", splice(&valid("images.bin"), 81, &many), "number of observations"),
        ("points3D.bin", splice(&valid("points3D.bin"), 0, &huge), "number of points"),
        ("points3D.bin", splice(&valid("points3D.bin"), 16, &nan64), "point 0 of 2, coordinate 0"),
        ("points3D.bin", splice(&valid("points3D.bin"), 51, &huge), "track length"),
        ("cameras.txt", text(&valid("cameras.txt"), "RADIAL", "RADICAL"), "line 3, model"),
        ("cameras.txt", text(&valid("cameras.txt"), "RADIAL", "FOV"), "line 3, camera 7"),
        ("cameras.txt", text(&valid("cameras.txt"), " .2", ""), "5 parameters of RADIAL"),
        ("cameras.txt", text(&valid("cameras.txt"), "20 8", "nan 8"), "line 3, parameter"),
        ("images.txt", text(&valid("images.txt"), "1 2 0 0 0", "1 0 0 0 0"), "line 3, image 1"),
        ("images.txt", text(&valid("images.txt"), "2.5 -1", "2.5 x"), "line 4, observation point id"),
        ("images.txt", text(&valid("images.txt"), " 0000.png", ""), "line 3, name"),
        ("points3D.txt", text(&valid("points3D.txt"), "10 20 30", "10 20 300"), "line 2, blue"),
        ("points3D.txt", text(&valid("points3D.txt"), "0 0 0.5", "0 0 1e999"), "line 2, y"),
    ];
    for (name, bytes, place) in cases.into_iter().chain(models::spoiled()) {
        match (by_name(name).read)(&bytes, name) {
            Ok(()) => panic!("{name}, spoiled at '{place}', was accepted"),
            Err(e) => {
                check(&e, name);
                println!("{e}");
                assert!(e.to_string().contains(place), "'{place}' is not in: {e}");
            }
        }
    }
}

/// The sample `.npy` with another shape in a header of the same length.
fn npy_shape(shape: &str) -> Vec<u8> {
    let old = format!("(2,), }}{}", " ".repeat(shape.len() - 4));
    text(&npy(), &old, &format!("{shape}, }}"))
}

/// The sample scene with one array replaced.
fn npz_with(name: &str, shape: &[usize], value: f32) -> Vec<u8> {
    let g = Gaussians::from_record(samples::gaussians(1), "sample").expect("a good scene");
    let mut n = 1;
    shape.iter().for_each(|d| n *= d);
    npz::to_bytes(&g.to_arrays().with(name, shape, vec![value; n]), npz::Packing::Stored).expect("arrays fit")
}

/// A PNG whose header declares another size, with a correct checksum.
fn png_size(w: u32, h: u32) -> Vec<u8> {
    let mut b = samples::png(16, 12, 3);
    b[16..20].copy_from_slice(&w.to_be_bytes());
    b[20..24].copy_from_slice(&h.to_be_bytes());
    let mut crc = u32::MAX;
    for &byte in &b[12..29] {
        crc ^= u32::from(byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 };
        }
    }
    b[29..33].copy_from_slice(&(!crc).to_be_bytes());
    b
}

/// A JPEG whose frame header declares another size.
fn jpeg_size(w: u16, h: u16) -> Vec<u8> {
    let mut b = samples::jpeg(16, 12);
    let at = find(&b, &[0xff, 0xc0]);
    b[at + 5..at + 7].copy_from_slice(&h.to_be_bytes());
    b[at + 7..at + 9].copy_from_slice(&w.to_be_bytes());
    b
}

/// An uncompressed-looking sample cannot be spoiled in place, so one is written with the exr crate.
fn exr_nan() -> Vec<u8> {
    use exr::prelude::*;
    let mut out = std::io::Cursor::new(Vec::new());
    let channels = SpecificChannels::rgb(|p: Vec2<usize>| {
        (1.0f32, if p == Vec2(1, 0) { f32::NAN } else { 0.0 }, 0.5f32)
    });
    Image::from_channels((16, 12), channels).write().non_parallel().to_buffered(&mut out).expect("a picture");
    out.into_inner()
}

#[test]
fn zip_bombs_are_refused() {
    // A member that unpacks to far more than its header says.
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

/// Address space this whole test program may ever reserve, in bytes: its threads, and files of a few kilobytes.
const ALLOWANCE: u64 = 1 << 30;

/// Fails once the program has reserved more than [`ALLOWANCE`], touched or not. Linux says how much; others do not.
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
