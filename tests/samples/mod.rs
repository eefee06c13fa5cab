//! Small valid files of every format, made here.
#![allow(dead_code, reason = "each test binary uses some of them")]

pub(crate) mod gltf;

use lastlight::io::{gaussian_ply, image_file, npz, safetensors, splat_file};
use lastlight::num::array::Arrays;
use std::collections::BTreeMap;

pub(crate) fn arrays() -> Arrays {
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

pub(crate) fn gaussians(degree: usize) -> gaussian_ply::GaussianRecord {
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

pub(crate) fn npz_file(packing: npz::Packing) -> Vec<u8> {
    npz::to_bytes(&arrays(), packing).expect("arrays fit")
}

/// A field with every part, as a file.
pub(crate) fn field_file() -> Vec<u8> {
    use lastlight::scene::field::{Field, Heads, Network, Panoramas, Placement, Planes, Settings};
    let network = |widths: &[usize]| Network {
        widths: widths.to_vec(),
        weights: widths.windows(2).map(|n| vec![0.25; n[0] * n[1]]).collect(),
    };
    let field = Field {
        planes: Planes { values: vec![0.5; 6 * 4 * 2], count: 6, side: 2, channels: 2 },
        panoramas: Some(Panoramas { values: vec![0.5; 8], levels: 1, height: 2, width: 2, channels: 2 }),
        heads: Heads {
            sdf: network(&[6, 2, 1]),
            color: Some(network(&[8, 3])),
            albedo: Some(network(&[6, 3])),
            material: Some(network(&[6, 2])),
            normal: Some(network(&[6, 3])),
            rho: Some(network(&[6, 1])),
        },
        settings: Settings::default(),
        placement: Placement::new([0.1, 0.2, 0.3], 2.5),
    };
    field.to_bytes().expect("a valid field")
}

pub(crate) fn safetensors_file() -> Vec<u8> {
    let meta = BTreeMap::from([("step".to_owned(), "12".to_owned())]);
    safetensors::to_bytes(&arrays(), &meta)
}

pub(crate) fn ply_ascii() -> Vec<u8> {
    b"ply\nformat ascii 1.0\ncomment a comment\nelement vertex 2\nproperty float x\nproperty float y\nproperty double z\n\
      property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\nproperty list uchar int vertex_indices\n\
      end_header\n0 1 2 10 20 30\n3 4 5.5 40 50 60\n3 0 1 0\n"
        .to_vec()
}

pub(crate) fn splat() -> Vec<u8> {
    splat_file::to_bytes(&splat_file::from_gaussians(&gaussians(0), "sample").expect("in range"))
}

/// A smooth image, (H, W, C) bytes.
pub(crate) fn pixels(w: usize, h: usize, c: usize) -> Vec<u8> {
    (0..w * h * c).map(|i| ((i / c % w) * 5 + (i / (c * w)) * 3 + i % c * 40) as u8).collect()
}

pub(crate) fn png(w: usize, h: usize, c: usize) -> Vec<u8> {
    image_file::png_bytes(w, h, c, &pixels(w, h, c)).expect("sizes agree")
}

pub(crate) fn jpeg(w: usize, h: usize) -> Vec<u8> {
    let mut out = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut out, 90)
        .encode(&pixels(w, h, 3), w as u32, h as u32, image::ExtendedColorType::Rgb8)
        .expect("an image");
    out
}

pub(crate) fn hdr(w: usize, h: usize) -> Vec<u8> {
    let mut out = Vec::new();
    let data: Vec<image::Rgb<f32>> = (0..w * h).map(|i| image::Rgb([i as f32, 0.5, 0.125])).collect();
    image::codecs::hdr::HdrEncoder::new(&mut out).encode(&data, w, h).expect("an image");
    // A line that other programs write and the strict reader refuses.
    let at = out.iter().position(|&b| b == b'\n').expect("a header") + 1;
    out.splice(at..at, b"GAMMA=1\nPRIMARIES=0 0 0 0 0 0 0 0\n".iter().copied());
    out
}

pub(crate) fn exr(w: usize, h: usize) -> Vec<u8> {
    let data: Vec<f32> = (0..w * h * 3).map(|i| i as f32 * 0.25 - 1.0).collect();
    image_file::exr_bytes(w, h, &["R", "G", "B"], &data).expect("finite")
}

/// Camera-to-world with OpenGL axes at (0, 0, i), looking to −z.
pub(crate) fn pose(i: usize) -> String {
    format!("[[1,0,0,0],[0,1,0,0],[0,0,1,{i}.0],[0,0,0,1]]")
}

pub(crate) fn transforms(frames: usize) -> Vec<u8> {
    let list: Vec<String> = (0..frames)
        .map(|i| format!("{{\"file_path\":\"images/{i:04}.png\",\"transform_matrix\":{}}}", pose(i)))
        .collect();
    format!(
        "{{\"fl_x\":20.0,\"fl_y\":21.0,\"cx\":8.0,\"cy\":6.0,\"w\":16,\"h\":12,\"k1\":0.01,\"frames\":[{}]}}",
        list.join(",")
    )
    .into_bytes()
}

/// `cameras.bin`: one camera of the given model.
pub(crate) fn cameras_bin(model: i32, params: &[f64]) -> Vec<u8> {
    let mut b = 1u64.to_le_bytes().to_vec();
    b.extend(7u32.to_le_bytes());
    b.extend(model.to_le_bytes());
    b.extend(16u64.to_le_bytes());
    b.extend(12u64.to_le_bytes());
    params.iter().for_each(|p| b.extend(p.to_le_bytes()));
    b
}

/// `images.bin`: n images of camera 7 at (0, 0, −i), the odd ones without observations.
pub(crate) fn images_bin(n: usize) -> Vec<u8> {
    let mut b = (n as u64).to_le_bytes().to_vec();
    for i in 0..n {
        b.extend((i as u32 + 1).to_le_bytes());
        for x in [2.0, 0.0, 0.0, 0.0, 0.0, 0.0, i as f64] {
            b.extend(f64::to_le_bytes(x));
        }
        b.extend(7u32.to_le_bytes());
        b.extend(format!("{i:04}.png\0").bytes());
        let points: u64 = if i % 2 == 0 { 2 } else { 0 };
        b.extend(points.to_le_bytes());
        for j in 0..points {
            b.extend(1.5f64.to_le_bytes());
            b.extend(2.5f64.to_le_bytes());
            b.extend((j as i64 - 1).to_le_bytes());
        }
    }
    b
}

/// `points3D.bin`: two points.
pub(crate) fn points_bin() -> Vec<u8> {
    let mut b = 2u64.to_le_bytes().to_vec();
    for i in 0..2u8 {
        b.extend(u64::from(i).to_le_bytes());
        for x in [f64::from(i), 0.5, 3.0] {
            b.extend(x.to_le_bytes());
        }
        b.extend([10 + i, 20, 30]);
        b.extend(0.25f64.to_le_bytes());
        b.extend(u64::from(i).to_le_bytes());
        for _ in 0..i {
            b.extend([1, 0, 0, 0, 0, 0, 0, 0]);
        }
    }
    b
}

pub(crate) fn cameras_txt(model: &str, params: &str) -> Vec<u8> {
    format!("# Camera list\n# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n7 {model} 16 12 {params}\n")
        .into_bytes()
}

/// The same images as [`images_bin`]; the second lines of the odd ones are empty.
pub(crate) fn images_txt(n: usize) -> Vec<u8> {
    let mut out = String::from("# Image list\n#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n");
    for i in 0..n {
        out.push_str(&format!("{} 2 0 0 0 0 0 {i} 7 {i:04}.png\n", i + 1));
        out.push_str(if i % 2 == 0 { "1.5 2.5 -1 1.5 2.5 0\n" } else { "\n" });
    }
    out.into_bytes()
}

pub(crate) fn points_txt() -> Vec<u8> {
    b"# 3D point list\n0 0 0.5 3 10 20 30 0.25\n1 1 0.5 3 11 20 30 0.25 1 0\n".to_vec()
}
