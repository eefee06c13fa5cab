//! Hand-made malformed files, by format: each row has the bytes and the text that the message must contain.

use super::{Case, find, formats, models, npy, ply_faces, samples};
use lastlight::io::npz;
use lastlight::scene::gaussians::Gaussians;

/// All of them.
pub(super) fn all() -> Vec<Case> {
    let groups = [
        npz_files,
        npy_files,
        safetensors,
        field,
        ply,
        splat,
        pictures,
        transforms,
        colmap_binary,
        colmap_text,
    ];
    groups.into_iter().flat_map(|group| group()).chain(models::spoiled::all()).collect()
}

/// Rows of one file name.
pub(super) fn rows<const N: usize>(name: &'static str, of: [(Vec<u8>, &'static str); N]) -> Vec<Case> {
    of.into_iter().map(|(bytes, place)| (name, bytes, place)).collect()
}

/// The valid sample of a format.
fn valid(name: &str) -> Vec<u8> {
    formats().into_iter().find(|f| f.name == name).expect("a known format").valid
}

/// Replaces bytes.
pub(super) fn splice(bytes: &[u8], at: usize, with: &[u8]) -> Vec<u8> {
    let mut out = bytes.to_vec();
    out[at..at + with.len()].copy_from_slice(with);
    out
}

/// Replaces text of the same or another length.
pub(super) fn text(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    let at = find(bytes, from.as_bytes());
    [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
}

/// Declared shapes against bytes, types that are not numbers, values that a scene cannot have.
fn npz_files() -> Vec<Case> {
    let stored = valid("stored.npz");
    let archive = [
        (text(&stored, "'shape': (2, 3), ", "'shape': (2, 4), "), "array 'f32'"),
        (text(&stored, "'descr': '<f4'", "'descr': '|O '"), "array 'empty'"),
        (b"not a zip archive at all".to_vec(), "zip directory"),
    ];
    let scene = [
        (npz_with("scales", &[5, 3], -1.0), "array 'scales': row 0"),
        (npz_with("opacities", &[5], 2.0), "array 'opacities': row 0"),
        (npz_with("means", &[5, 3], f32::NAN), "array 'means': index [0, 0]"),
        (npz_with("quats", &[4, 4], 1.0), "array 'quats'"),
        (npz_with("quats", &[5, 4], 0.0), "Gaussian 0, quaternion"),
        (npz_with("sh", &[5, 5, 3], 0.0), "array 'sh'"),
    ];
    [rows("stored.npz", archive), rows("scene.npz", scene)].concat()
}

/// Headers of single arrays.
fn npy_files() -> Vec<Case> {
    rows(
        "one.npy",
        [
            (npy_shape("(9999999999,)"), "elements of shape [9999999999]"),
            (text(&npy(), "(2,)", "(3,)"), "elements of shape [3]"),
            (npy_shape("(0, 4611686018427387904, 8)"), "shape"),
            (npy_shape("(2, -1)"), "non-negative"),
            (npy_shape("((((2,))))"), "non-negative"),
            (splice(&npy(), 8, &[255, 255]), "npy header"),
            (text(&npy(), "False", "Maybe"), "True or False"),
        ],
    )
}

/// Header length, offsets, shapes.
fn safetensors() -> Vec<Case> {
    let file = valid("a.safetensors");
    let with = |from: &str, to: &str| text(&file, from, to);
    rows(
        "a.safetensors",
        [
            (splice(&file, 0, &u64::MAX.to_le_bytes()), "header length"),
            (with("\"shape\":[3]", "\"shape\":[4]"), "array 'f64', data_offsets: expected 32 bytes"),
            (with("\"F64\"", "\"F99\""), "header"),
            (with("\"data_offsets\":[0,", "\"data_offsets\":[8,"), "array 'f64', data_offsets"),
        ],
    )
}

/// Shapes, settings and the digest of a field.
fn field() -> Vec<Case> {
    let file = valid("field.safetensors");
    let with = |from: &str, to: &str| text(&file, from, to);
    rows(
        "field.safetensors",
        [
            (with("[6,2,2,2]", "[3,4,2,2]"), "array 'planes': expected square planes"),
            (with("[6,2,2,2]", "[3,2,2,4]"), "head 'sdf': expected 12 inputs, got 6"),
            (with("[6,2,2,2]", "[9,2,2,2]"), "array 'planes', data_offsets: expected 288 bytes"),
            (with("heads/rho/0", "heads/rho/7"), "panoramas: expected heads 'color', 'normal' and 'rho'"),
            (with("\\\"samples\\\":128", "\\\"samples\\\":1e9"), "setting 'samples'"),
            (with("\\\"samples\\\":128", "\\\"samples\\\":129"), "metadata: digest"),
            (splice(&file, file.len() - 4, &f32::NAN.to_le_bytes()), "a finite number"),
            (splice(&file, file.len() - 4, &0.26_f32.to_le_bytes()), "metadata: digest"),
        ],
    )
}

/// Counts, types, rows, values.
fn ply() -> Vec<Case> {
    let end = |file: &[u8]| find(file, b"end_header\n") + 11;
    let scene = valid("scene.ply");
    let with = |from: &str, to: &str| text(&scene, from, to);
    let binary = [
        (with("vertex 5", "vertex 6"), "element vertex"),
        (with("vertex 5", "vertex 99999999999999"), "element vertex"),
        (with("vertex 5", "vertex 99999999999999999999"), "header, line 4"),
        (with("float opacity", "float opaqueness"), "'opacity'"),
        (with("float f_rest_8", "float rest_8"), "f_rest_*"),
        (with("float rot_0", "half rot_0"), "header, line"),
        (with("float rot_0", "float x"), "once"),
        (splice(&scene, end(&scene) + 4, &f32::NAN.to_le_bytes()), "row 0, property y"),
    ];
    let ascii = valid("ascii.ply");
    let with = |from: &str, to: &str| text(&ascii, from, to);
    let lines = [
        (with("0 1 2 10", "0 1 inf 10"), "row 0, property z"),
        (with("0 1 2 10", "0 1 2 256"), "line 14: element vertex, row 0, property red"),
        (with("0 1 2 10 20 30", "0 1 2 10 20"), "line 14"),
        (with("0 1 2 10 20 30", "0 1 2 10 20 30 40"), "line 14"),
        (with("3 0 1 0", "1e9 0 1 0"), "line 16"),
        (with("3 0 1 0", "4 0 1 0"), "line 16"),
    ];
    let faces = [
        (splice(&ply_faces(), end(&ply_faces()), &[200]), "element face, row 0"),
        (b"ply\nformat ascii 1.0\nelement nothing 9999999999\nend_header\n".to_vec(), "element nothing"),
    ];
    [rows("scene.ply", binary), rows("ascii.ply", lines), rows("faces.ply", faces)].concat()
}

fn splat() -> Vec<Case> {
    let file = valid("a.splat");
    rows(
        "a.splat",
        [
            (splice(&file, 36, &f32::NAN.to_le_bytes()), "row 1 (byte 32), position"),
            (splice(&file, 12, &(-1.0f32).to_le_bytes()), "row 0 (byte 0), scale"),
            (splice(&file, 28, &[128; 4]), "rotation"),
        ],
    )
}

/// Sizes that the bytes cannot hold, damage.
fn pictures() -> Vec<Case> {
    let png = [
        (splice(&valid("a.png"), 16, &[0x7f, 0xff, 0xff, 0xff]), "a.png"),
        (png_size(16_000, 16_000), "image size"),
        (png_size(20_000, 1), "image size"),
    ];
    let jpg = [(jpeg_size(16_000, 16_000), "image size")];
    let hdr = [(text(&valid("a.hdr"), "-Y 12 +X 16", "-Y 9999 +X 9999"), "image size")];
    let exr = [(exr_nan(), "channel G, row 0, column 1"), (vec![], "empty")];
    [rows("a.png", png), rows("a.jpg", jpg), rows("a.hdr", hdr), rows("a.exr", exr)].concat()
}

fn transforms() -> Vec<Case> {
    let file = valid("transforms.json");
    let with = |from: &str, to: &str| text(&file, from, to);
    rows(
        "transforms.json",
        [
            (with("\"w\":16", "\"w\":1e9"), "w: expected"),
            (with("\"fl_x\":20.0", "\"fl_x\":\"20\""), "fl_x"),
            (with("images/0001.png", "../../0001.png"), "frames[1].file_path"),
            (with("[0,1,0,0]", "[0,0,0,0]"), "frames[0].transform_matrix"),
            (with("20.0", "NaN"), "line 1"),
        ],
    )
}

/// Counts far beyond the file, numbers that are none.
fn colmap_binary() -> Vec<Case> {
    let nan = f64::NAN.to_le_bytes();
    let huge = u64::MAX.to_le_bytes();
    let many = (1u64 << 40).to_le_bytes();
    let [cameras, images, points] = ["cameras.bin", "images.bin", "points3D.bin"].map(valid);
    let cameras = [
        (splice(&cameras, 0, &huge), "number of cameras"),
        (splice(&cameras, 0, &many), "number of cameras"),
        (splice(&cameras, 12, &99i32.to_le_bytes()), "camera 0 of 1 (id 7), model"),
        (splice(&cameras, 16, &huge), "pixels a side"),
        (splice(&cameras, 32, &nan), "camera 0 of 1, parameter 0"),
    ];
    let images = [
        (splice(&images, 0, &many), "number of images"),
        (splice(&images, 12, &nan), "image 0 of 3, pose value 0"),
        (splice(&images, 12, &[0; 8]), "quaternion"),
        (splice(&images, 81, &many), "number of observations"),
    ];
    let points = [
        (splice(&points, 0, &huge), "number of points"),
        (splice(&points, 16, &nan), "point 0 of 2, coordinate 0"),
        (splice(&points, 51, &huge), "track length"),
    ];
    [rows("cameras.bin", cameras), rows("images.bin", images), rows("points3D.bin", points)].concat()
}

fn colmap_text() -> Vec<Case> {
    let [cameras, images, points] = ["cameras.txt", "images.txt", "points3D.txt"].map(valid);
    let cameras = [
        (text(&cameras, "RADIAL", "RADICAL"), "line 3, model"),
        (text(&cameras, "RADIAL", "FOV"), "line 3, camera 7"),
        (text(&cameras, " .2", ""), "5 parameters of RADIAL"),
        (text(&cameras, "20 8", "nan 8"), "line 3, parameter"),
    ];
    let images = [
        (text(&images, "1 2 0 0 0", "1 0 0 0 0"), "line 3, image 1"),
        (text(&images, "2.5 -1", "2.5 x"), "line 4, observation point id"),
        (text(&images, " 0000.png", ""), "line 3, name"),
    ];
    let points = [
        (text(&points, "10 20 30", "10 20 300"), "line 2, blue"),
        (text(&points, "0 0 0.5", "0 0 1e999"), "line 2, y"),
    ];
    [rows("cameras.txt", cameras), rows("images.txt", images), rows("points3D.txt", points)].concat()
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
    Image::from_channels((16, 12), channels).write().non_parallel().to_buffered(&mut out).expect("an image");
    out.into_inner()
}
