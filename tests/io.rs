//! Every format: what is written is read back bit for bit, by us and by independent readers, and real files load.

use lastlight::io::{gaussian_ply, npz, ply, safetensors};
use lastlight::num::array::{Array, Arrays};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Folder of the real data; its tests say so when it is unset.
fn data() -> Option<PathBuf> {
    let dir = std::env::var_os("LASTLIGHT_DATA").map(PathBuf::from);
    if dir.is_none() {
        println!("LASTLIGHT_DATA is unset: this test on real data did not run");
    }
    dir
}

fn sample() -> Arrays {
    let mut a = Arrays::new();
    a.put("f32", &[2, 3], vec![1.5f32, -0.0, f32::MIN_POSITIVE, f32::from_bits(1), f32::MAX, -3.25]);
    a.put("f64", &[3], vec![1e-310f64, -0.0, std::f64::consts::PI]);
    a.put("u8", &[2, 2], vec![0u8, 1, 128, 255]);
    a.put("i8", &[1, 3], vec![-128i8, 0, 127]);
    a.put("i32", &[2], vec![i32::MIN, i32::MAX]);
    a.put("i64", &[2], vec![i64::MIN, i64::MAX]);
    a.put("scalar", &[], vec![7i64]);
    a.put("empty", &[0, 3], Vec::<f32>::new());
    a
}

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
    let a = sample();
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
    // They read ours.
    let bytes = npz::to_bytes(&sample(), npz::Packing::Deflated).expect("arrays fit");
    let mut theirs = npyz::npz::NpzArchive::new(std::io::Cursor::new(bytes)).expect("a zip archive");
    let f = theirs.by_name("f32").expect("readable").expect("present");
    assert_eq!(f.shape(), [2, 3], "shape");
    let f: Vec<f32> = f.into_vec().expect("f32");
    assert_eq!(f[1].to_bits(), (-0.0f32).to_bits(), "values");
    // We read theirs, whatever the element type.
    use npyz::WriterBuilder;
    let mut buffer = Vec::new();
    {
        let mut npz = npyz::npz::NpzWriter::new(std::io::Cursor::new(&mut buffer));
        macro_rules! put {
            ($name:literal, $t:ty, $descr:literal, $order:ident, $v:expr) => {{
                let options = npyz::zip::write::FileOptions::default();
                let dtype = npyz::DType::new_scalar($descr.parse().expect("a type"));
                let w = npz.array::<$t>($name, options).expect("room").dtype(dtype).shape(&[2, 2]);
                let mut w = w.order(npyz::Order::$order).begin_nd().expect("header");
                w.extend($v).expect("values");
                w.finish().expect("all values");
            }};
        }
        put!("u16_big", u16, ">u2", C, [1u16, 2, 3, 65535]);
        put!("i16", i16, "<i2", Fortran, [1i16, 3, -2, -32768]);
        put!("u32", u32, "<u4", C, [0u32, 1, 2, u32::MAX]);
        put!("u64", u64, ">u8", C, [0u64, 1, 2, i64::MAX as u64]);
        put!("f8", f64, ">f8", Fortran, [1.0f64, 3.0, 2.0, 4.0]);
        put!("flag", bool, "|b1", C, [true, false, false, true]);
    }
    let expected = Arrays::new()
        .with("u16_big", &[2, 2], vec![1i32, 2, 3, 65535])
        .with("i16", &[2, 2], vec![1i32, -2, 3, -32768])
        .with("u32", &[2, 2], vec![0i64, 1, 2, i64::from(u32::MAX)])
        .with("u64", &[2, 2], vec![0i64, 1, 2, i64::MAX])
        .with("f8", &[2, 2], vec![1.0f64, 2.0, 3.0, 4.0])
        .with("flag", &[2, 2], vec![1u8, 0, 0, 1]);
    same_bits(&expected, &npz::parse(&buffer, "theirs.npz").expect("their file"));
}

#[test]
fn a_plain_npy_is_named_after_its_file() {
    let bytes = npz::to_bytes(&Arrays::new().with("a", &[2], vec![1.0f32, 2.0]), npz::Packing::Stored).expect("fits");
    let at = bytes.windows(6).position(|w| w == b"\x93NUMPY").expect("stored as it is");
    let npy = &bytes[at..at + 128 + 8];
    let back = npz::parse(npy, "folder/depth.npy").expect("one array");
    assert_eq!(back.need("depth").expect("named").to_f32(), [1.0, 2.0], "values");
}

#[test]
fn safetensors_round_trip_is_exact_and_deterministic() {
    let a = sample();
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
    assert_eq!(safetensors::parse(&none, "a").expect("empty"), safetensors::Tensors::default(), "nothing in, nothing out");
}

fn gaussians(degree: usize) -> gaussian_ply::GaussianRecord {
    let k = (degree + 1) * (degree + 1);
    let f = |i: usize| (i as f32 * 0.37 - 1.0) / 7.0;
    gaussian_ply::GaussianRecord {
        means: (0..5).map(|i| [f(i), f(i + 1), -0.0]).collect(),
        quats: (0..5).map(|i| [1.0, f(i), f(i + 3), 1e-30]).collect(),
        scales_log: (0..5).map(|i| [f(i) - 4.0, -3.0, f(i + 9)]).collect(),
        opacity_logits: (0..5).map(f).collect(),
        sh: (0..5 * k * 3).map(f).collect(),
        sh_degree: degree,
        comments: vec!["made by a test".into()],
    }
}

#[test]
fn gaussian_ply_round_trip() {
    for degree in 0..=3 {
        let g = gaussians(degree);
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
    let (mut little, mut big) = (header("binary_little_endian").into_bytes(), header("binary_big_endian").into_bytes());
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
        assert_eq!(file.element("face").expect("kept").column("area").expect("kept").f64(0), 0.5, "after a list");
        assert_eq!(gaussian_ply::parse_points(bytes, "p.ply").expect("points"), expected, "points");
    }
    let dir = tempfile::tempdir().expect("a temporary folder");
    let path = dir.path().join("p.ply");
    gaussian_ply::write_points(&path, &expected).expect("writable");
    assert_eq!(gaussian_ply::read_points(&path).expect("our own file"), expected, "round trip");
}

#[test]
fn real_arrays_load() {
    let Some(dir) = data() else { return };
    let tiny = safetensors::read(&dir.join("data/splats/tiny_case.safetensors")).expect("readable").arrays;
    assert_eq!(tiny.need("coeffs").expect("there").shape(), [4, 16, 3], "spherical harmonics");
    assert_eq!(tiny.need("out_img").expect("there").shape(), [82, 123, 4], "picture");
    let garden = npz::read(&dir.join("data/splats/garden.npz")).expect("readable");
    assert_eq!(garden.need("means3d").expect("there").shape(), [138_766, 3], "points");
    assert_eq!(garden.need("colors").expect("there").dtype(), "uint8", "bytes stay bytes");
    let golden = npz::read(&dir.join("golden/splat_garden.npz")).expect("deflated");
    assert_eq!(golden.need("sh").expect("there").shape(), [900, 4, 3], "coefficients");
}
