//! Every format: what is written is read back bit for bit, by us and by independent readers, and real files
//! load.

use crate::{common, samples};
use lastlight::io::image_file::{self, Encoding, Samples};
use lastlight::io::{gaussian_ply, npz, ply, safetensors, splat_file};
use lastlight::num::array::{Array, Arrays};
use std::collections::BTreeMap;

/// Equality of bits, which `==` on floats is not.
fn same_bits(a: &Arrays, b: &Arrays) {
    assert_eq!(a.0.keys().collect::<Vec<_>>(), b.0.keys().collect::<Vec<_>>(), "names");
    for (name, x) in &a.0 {
        let y = &b.0[name];
        assert_eq!((x.dtype(), x.shape()), (y.dtype(), y.shape()), "type and shape of {name}");
        let bits = |v: &Array| v.to_f64().iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(x), bits(y), "values of {name}");
        assert_eq!(x.to_i64(), y.to_i64(), "integers of {name}");
    }
}

#[test]
fn npz_round_trip_is_exact_and_deterministic() {
    let a = samples::arrays();
    for packing in [npz::Packing::Stored, npz::Packing::Deflated] {
        let bytes = npz::to_bytes(&a, packing).expect("arrays fit");
        assert_eq!(bytes, npz::to_bytes(&a, packing).expect("again"), "same bytes");
        same_bits(&a, &npz::parse(&bytes, "a.npz").expect("our own file"));
    }
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("a.npz");
    npz::write(&path, &a).expect("writable");
    same_bits(&a, &npz::read(&path).expect("our own file"));
}

#[test]
fn npz_agrees_with_an_independent_implementation() {
    // `samples/numpy/make.py` wrote the same arrays with NumPy: what we write has the same bytes, array by
    // array.
    let numpy = include_bytes!("../samples/numpy/same.npz");
    let ours = npz::to_bytes(&samples::arrays(), npz::Packing::Deflated).expect("arrays fit");
    assert_eq!(members(&ours), members(numpy), "the bytes of every array");
    same_bits(&samples::arrays(), &npz::parse(numpy, "same.npz").expect("NumPy's file"));
    // We read theirs, whatever the element type, the byte order and the order of axes.
    let expected = Arrays::new()
        .with("u16_big", &[2, 2], vec![1i32, 2, 3, 65535])
        .with("i16", &[2, 2], vec![1i32, -2, 3, -32768])
        .with("u32", &[2, 2], vec![0i64, 1, 2, i64::from(u32::MAX)])
        .with("u64", &[2, 2], vec![0i64, 1, 2, i64::MAX])
        .with("f8", &[2, 2], vec![1.0f64, 2.0, 3.0, 4.0])
        .with("flag", &[2, 2], vec![1u8, 0, 0, 1]);
    let other = include_bytes!("../samples/numpy/other.npz");
    same_bits(&expected, &npz::parse(other, "other.npz").expect("NumPy's file"));
}

/// The files of an archive by name.
fn members(archive: &[u8]) -> BTreeMap<String, Vec<u8>> {
    let mut zip = zip::ZipArchive::new(std::io::Cursor::new(archive)).expect("a zip archive");
    let mut out = BTreeMap::new();
    for i in 0..zip.len() {
        let mut member = zip.by_index(i).expect("a member");
        let name = member.name().expect("a name").to_string();
        let mut bytes = Vec::new();
        std::io::Read::read_to_end(&mut member, &mut bytes).expect("unpacked");
        out.insert(name, bytes);
    }
    out
}

#[test]
fn errors_of_the_system_are_stated_in_words() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let missing = folder.path().join("none.npz");
    let e = npz::read(&missing).expect_err("no such file").to_string();
    assert_eq!(
        e,
        format!("{}: no such file or folder", missing.display()),
        "without the system's error number"
    );
    let blocked = folder.path().join("file/none.npz");
    std::fs::write(folder.path().join("file"), b"x").expect("written");
    let e = npz::read(&blocked).expect_err("below a file").to_string();
    assert!(!e.contains("os error"), "{e}");
}

#[test]
fn a_plain_npy_is_named_after_its_file() {
    let bytes =
        npz::to_bytes(&Arrays::new().with("a", &[2], vec![1.0f32, 2.0]), npz::Packing::Stored).expect("fits");
    let at = bytes.windows(6).position(|w| w == b"\x93NUMPY").expect("stored as it is");
    let npy = &bytes[at..at + 128 + 8];
    let back = npz::parse(npy, "folder/depth.npy").expect("one array");
    assert_eq!(back.need("depth").expect("named").to_f32(), [1.0, 2.0], "values");
}

#[test]
fn safetensors_round_trip_is_exact_and_deterministic() {
    let a = samples::arrays();
    let meta: BTreeMap<String, String> =
        (0..40).map(|i| (format!("key {i}"), format!("value \"{i}\"\n ü"))).collect();
    let bytes = safetensors::to_bytes(&a, &meta);
    assert_eq!(bytes, safetensors::to_bytes(&a, &meta), "same bytes");
    let back = safetensors::parse(&bytes, "a.safetensors").expect("our own file");
    same_bits(&a, &back.arrays);
    assert_eq!(back.metadata, meta, "metadata");
    // The independent reader takes the file, and finds elements at multiples of their size.
    let theirs = ::safetensors::SafeTensors::deserialize(&bytes).expect("a valid file");
    assert_eq!(theirs.len(), a.0.len(), "all arrays");
    let none = safetensors::to_bytes(&Arrays::new(), &BTreeMap::new());
    assert_eq!(
        safetensors::parse(&none, "a").expect("empty"),
        safetensors::Tensors::default(),
        "nothing in, nothing out"
    );
}

#[test]
fn gaussian_ply_round_trip() {
    for degree in 0..=3 {
        let g = samples::gaussians(degree);
        let bytes = gaussian_ply::to_bytes(&g);
        let back = gaussian_ply::parse(&bytes, "g.ply").expect("our own file");
        assert_eq!(g, back, "degree {degree}");
        assert_eq!(bytes, gaussian_ply::to_bytes(&back), "bytes");
        let raw = ply::parse(&bytes, "g.ply").expect("a PLY");
        let v = raw.element("vertex").expect("vertices");
        if degree == 3 {
            // Channel-major in the file: f_rest_15 is the first green coefficient of band 1.
            let green = v.column("f_rest_15").expect("present").f32(2);
            assert_eq!(green, g.sh[2 * 48 + 3 + 1], "order of f_rest");
            assert_eq!(v.columns.len(), 62, "the usual 62 properties");
        }
    }
}

#[test]
fn ply_of_any_order_type_and_byte_order() {
    let header = |format: &str| {
        format!(
            "ply\r\nformat {format} 1.0\ncomment first\nobj_info second\nelement face 1\nproperty list uchar int vertex_indices\n\
             property float area\nelement vertex 2\nproperty uchar blue\nproperty double z\nproperty uchar red\nproperty short y\n\
             property uchar green\nproperty float x\nend_header\n"
        )
    };
    let mut ascii = header("ascii").into_bytes();
    ascii.extend_from_slice(b"3 0 1 2 0.5\n3 0.1 1 -300 2 0.25\r\n6 1e-3 4 7 5 -2\n");
    let (mut little, mut big) =
        (header("binary_little_endian").into_bytes(), header("binary_big_endian").into_bytes());
    macro_rules! both {
        ($($x:expr),*) => {$( little.extend_from_slice(&$x.to_le_bytes()); big.extend_from_slice(&$x.to_be_bytes()); )*};
    }
    both!(3u8, 0i32, 1i32, 2i32, 0.5f32);
    both!(3u8, 0.1f64, 1u8, -300i16, 2u8, 0.25f32);
    both!(6u8, 1e-3f64, 4u8, 7i16, 5u8, -2.0f32);
    let expected = gaussian_ply::Points {
        xyz: vec![[0.25, -300.0, 0.1], [-2.0, 7.0, 1e-3]],
        rgb: vec![[1, 2, 3], [4, 5, 6]],
    };
    for bytes in [&ascii, &little, &big] {
        let file = ply::parse(bytes, "p.ply").expect("valid");
        assert_eq!(file.comments, ["first", "second"], "comments are kept");
        assert_eq!(
            file.element("face").expect("kept").column("area").expect("kept").f64(0),
            0.5,
            "after a list"
        );
        assert_eq!(gaussian_ply::parse_points(bytes, "p.ply").expect("points"), expected, "points");
    }
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("p.ply");
    gaussian_ply::write_points(&path, &expected).expect("writable");
    assert_eq!(gaussian_ply::read_points(&path).expect("our own file"), expected, "round trip");
}

#[test]
fn real_arrays_load() {
    let Some(tiny) = common::real_data("splats/tiny_case.safetensors") else { return };
    let tiny = safetensors::read(&tiny).expect("readable").arrays;
    assert_eq!(tiny.need("coeffs").expect("there").shape(), [4, 16, 3], "spherical harmonics");
    assert_eq!(tiny.need("out_img").expect("there").shape(), [82, 123, 4], "picture");
    let Some(garden) = common::real_data("splats/garden.npz") else { return };
    let garden = npz::read(&garden).expect("readable");
    assert_eq!(garden.need("means3d").expect("there").shape(), [138_766, 3], "points");
    assert_eq!(garden.need("colors").expect("there").dtype(), "uint8", "bytes stay bytes");
    let Some(golden) = common::golden("splat_garden") else { return };
    assert_eq!(golden.need("sh").expect("there").shape(), [900, 4, 3], "coefficients");
}

#[test]
fn splat_round_trip_and_layout() {
    let bytes = samples::splat();
    let rows = splat_file::parse(&bytes, "s.splat").expect("our own file");
    assert_eq!(bytes, splat_file::to_bytes(&rows), "bytes");
    let g = samples::gaussians(0);
    // Every row is a Gaussian of the scene, largest and most opaque first.
    let weight = |i: usize| {
        let s: f64 = g.scales_log[i].iter().fold(0.0, |s, &x| s + f64::from(x));
        libm::exp(s) / (1.0 + libm::exp(-f64::from(g.opacity_logits[i])))
    };
    let mut order: Vec<usize> = (0..5).collect();
    order.sort_by(|&a, &b| weight(b).total_cmp(&weight(a)).then(a.cmp(&b)));
    for (row, &i) in rows.iter().zip(&order) {
        assert_eq!(row.mean, g.means[i], "order");
        let color = 0.5 + 0.282_094_791_773_878_14 * f64::from(g.sh[3 * i]);
        assert!((f64::from(row.rgba[0]) - 255.0 * color).abs() <= 0.5 + 1e-9, "nearest level");
    }
    // A known row: unit quaternion, grey, opacity one half.
    let one = gaussian_ply::GaussianRecord {
        means: vec![[1.0, 2.0, 3.0]],
        quats: vec![[0.0, 0.0, 3.0, 0.0]],
        scales_log: vec![[0.0; 3]],
        opacity_logits: vec![0.0],
        sh: vec![0.0, 10.0, -10.0],
        ..Default::default()
    };
    let row = splat_file::from_gaussians(&one, "one").expect("in range")[0];
    assert_eq!(row.rgba, [128, 255, 0, 128], "colours and opacity are limited and rounded half up");
    assert_eq!(row.rotation, [128, 128, 255, 128], "128 q + 128, limited");
    assert_eq!(row.scale, [1.0; 3], "linear");
    // What is quantised once stays.
    let again = splat_file::from_gaussians(&splat_file::to_gaussians(&[row]), "again").expect("in range")[0];
    assert_eq!((again.rgba, again.mean), (row.rgba, row.mean), "colours survive");
}

#[test]
fn png_round_trip_of_every_channel_count() {
    for c in 1..=4 {
        let p = image_file::parse(&samples::png(7, 5, c), "a.png").expect("our own file");
        assert_eq!((p.width, p.height, p.channels.len(), p.encoding), (7, 5, c, Encoding::Srgb), "shape");
        assert_eq!(p.samples, Samples::U8(samples::pixels(7, 5, c)), "values");
        assert_eq!(p.value(1), f32::from(samples::pixels(7, 5, c)[1]) / 255.0, "0 to 1");
    }
    assert_eq!(samples::png(7, 5, 3), samples::png(7, 5, 3), "same bytes");
    // 16 bits, written by the independent encoder.
    let mut bytes = Vec::new();
    use image::ImageEncoder;
    let words: Vec<u8> = [0u16, 1, 32768, 65535].iter().flat_map(|x| x.to_ne_bytes()).collect();
    image::codecs::png::PngEncoder::new(&mut bytes)
        .write_image(&words, 2, 2, image::ExtendedColorType::L16)
        .expect("an image");
    let p = image_file::parse(&bytes, "a.png").expect("16 bits");
    assert_eq!(p.values(), [0.0, 1.0 / 65535.0, 32768.0 / 65535.0, 1.0], "over 65535");
}

#[test]
fn bytes_are_rounded_half_up_and_limited() {
    let x = [0.0f32, 1.0, -3.0, 7.0, 0.5, 0.5 / 255.0, 0.4999 / 255.0, f32::INFINITY, -0.0];
    assert_eq!(image_file::to_u8(&x).expect("numbers"), [0, 255, 0, 255, 128, 1, 0, 255, 0], "levels");
    let e = image_file::to_u8(&[0.0, f32::NAN]).expect_err("not a number").to_string();
    assert!(e.contains("value 1") && e.contains("NaN"), "{e}");
}

#[test]
fn exr_round_trip_is_exact() {
    let values: Vec<f32> = vec![-0.0, 1e-40, 3.5, f32::MAX, -1e20, 0.1, 7.0, 8.0, 9.0, 1.0, 2.0, 3.0];
    let names = [vec!["R", "G", "B", "A"], vec!["Z"], vec!["B", "X"]];
    for channels in names {
        let n = channels.len();
        let data = &values[..12 / n * n];
        let (w, h) = (data.len() / n, 1);
        let bytes = image_file::exr_bytes(w, h, &channels, data).expect("finite");
        assert_eq!(bytes, image_file::exr_bytes(w, h, &channels, data).expect("finite"), "same bytes");
        let p = image_file::parse(&bytes, "a.exr").expect("our own file");
        assert_eq!((p.width, p.height, p.encoding), (w, h, Encoding::Linear), "shape");
        assert_eq!(p.channels, channels, "names in a usual order");
        let bits = |v: &[f32]| v.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&p.values()), bits(data), "values");
    }
    let e = image_file::exr_bytes(2, 1, &["Z"], &[1.0, f32::NAN]).expect_err("not a number").to_string();
    assert!(e.contains("channel Z, row 0, column 1"), "{e}");
}

#[test]
fn jpeg_and_hdr_load() {
    let p = image_file::parse(&samples::jpeg(16, 8), "a.jpg").expect("a JPEG");
    assert_eq!((p.width, p.height, p.channels.len(), p.encoding), (16, 8, 3, Encoding::Srgb), "shape");
    let Samples::U8(got) = &p.samples else { panic!("a JPEG has 8 bits") };
    let worst = got.iter().zip(samples::pixels(16, 8, 3)).fold(0, |m, (&a, b)| m.max(a.abs_diff(b)));
    assert!(worst < 40, "close to what was encoded: {worst}");
    let p = image_file::parse(&samples::hdr(16, 4), "a.hdr").expect("a header with extra lines");
    assert_eq!((p.width, p.height, p.encoding), (16, 4, Encoding::Linear), "shape");
    assert_eq!(p.values()[..3], [0.0, 0.5, 0.125], "values");
    assert_eq!(p.values()[3 * 33], 33.0, "values");
}

#[test]
fn real_pictures_load() {
    let Some(env) = common::real_data("env/dresden_square_1k.hdr") else { return };
    let env = image_file::read(&env).expect("readable");
    assert_eq!((env.width, env.height), (1024, 512), "size");
    let Some(spot) = common::real_data("mesh/spot/spot_texture.png") else { return };
    let spot = image_file::read(&spot).expect("readable");
    assert_eq!(spot.width, 1024, "size");
}

#[test]
fn scenes_convert_between_formats() {
    use lastlight::scene::convert::{convert, read_scene};
    let dir = tempfile::tempdir().expect("a temporary folder");
    let file = |n: &str| dir.path().join(n);
    let record =
        gaussian_ply::GaussianRecord { quats: vec![[1.0, 0.5, -0.25, 0.125]; 5], ..samples::gaussians(2) };
    gaussian_ply::write(&file("a.ply"), &record).expect("writable");
    convert(&file("a.ply"), &file("b.PLY")).expect("same format");
    assert_eq!(
        std::fs::read(file("a.ply")).unwrap(),
        std::fs::read(file("b.PLY")).unwrap(),
        "bytes and comments"
    );
    let g = convert(&file("a.ply"), &file("c.npz")).expect("to arrays");
    convert(&file("c.npz"), &file("d.ply")).expect("and back");
    let back = read_scene(&file("d.ply")).expect("readable");
    assert_eq!(
        (&back.means, &back.sh, back.sh_degree),
        (&g.means, &g.sh, 2),
        "exact where nothing is activated"
    );
    for (x, y) in back.scales_log.as_flattened().iter().zip(g.scales_log.as_flattened()) {
        assert!((x - y).abs() <= 5e-7, "scales to rounding: {x} {y}");
    }
    convert(&file("a.ply"), &file("e.splat")).expect("to .splat");
    let small = read_scene(&file("e.splat")).expect("readable");
    assert_eq!((small.len(), small.sh_degree), (5, 0), "all Gaussians, no view dependence");
    convert(&file("e.splat"), &file("f.ply")).expect("from .splat");
    let e = convert(&file("a.ply"), &file("a.obj")).expect_err("not a scene").to_string();
    assert!(e.contains("a.obj") && e.contains(".ply, .splat or .npz"), "{e}");
    assert!(!file("a.obj").exists(), "nothing written");
}
