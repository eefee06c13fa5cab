//! Scenes of Gaussians, images, captures and arrays.

use super::{Base, Workshop, below, files};
use crate::samples;
use crate::tree::Tree;
use image::ImageFormat;
use lastlight::io::{gaussian_ply, npz, splat_file};
use lastlight::scene::gaussians::Gaussians;
use std::io::Cursor;

pub(super) fn bases(shop: &Workshop) -> Vec<Base> {
    let mut all = scenes();
    all.extend(images());
    all.extend(captures());
    all.extend(arrays(shop));
    all
}

/// A small scene of Gaussians as `.ply`.
pub(super) fn scene_ply() -> Vec<u8> {
    gaussian_ply::to_bytes(&samples::gaussians(1))
}

fn scenes() -> Vec<Base> {
    let g = Gaussians::from_record(samples::gaussians(1), "sample").expect("a good scene");
    let packed = |packing| npz::to_bytes(&g.to_arrays(), packing).expect("arrays fit");
    let archives = files(&[
        ("stored.npz", &packed(npz::Packing::Stored)),
        ("deflated.npz", &packed(npz::Packing::Deflated)),
    ]);
    let splats = splat_file::to_bytes(
        &splat_file::from_gaussians(&samples::gaussians(0), "sample").expect("in range"),
    );
    let mut points = capture("png", ImageFormat::Png);
    points.insert("points.ply".into(), points_ascii());
    points.insert("binary.ply".into(), points_binary());
    let render = "splat render {file} --cameras orbit:1 --size 8x8 --out out --threads 1 --quiet";
    vec![
        Base::new(
            "npz, scene",
            archives,
            &["stored.npz", "deflated.npz"],
            &["convert {file} out.ply --threads 1", render],
        )
        .share(20),
        Base::new(
            "ply, scene",
            files(&[("scene.ply", &scene_ply())]),
            &["scene.ply"],
            &["convert {file} out.npz --threads 1", render],
        )
        .share(20),
        Base::new(
            "splat",
            files(&[("a.splat", &splats)]),
            &["a.splat"],
            &["convert {file} out.ply --threads 1", render],
        ),
        Base::new(
            "ply, points",
            points,
            &["points.ply", "binary.ply"],
            &[
                "splat fit capture --init {file} --iterations 1 --max-gaussians 120 --out out --threads 1 --quiet",
            ],
        ),
    ]
}

/// Number of points that a fit may start from, and a few more.
const POINTS: u8 = 110;

const POINT: &str = "property float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n";

fn points_ascii() -> Vec<u8> {
    let mut out =
        format!("ply\nformat ascii 1.0\ncomment points\nelement vertex {POINTS}\n{POINT}end_header\n");
    for i in 0..POINTS {
        let x = f32::from(i) / 50.0 - 1.0;
        out += &format!("{x} {} {} {i} 20 30\n", f32::from(i % 7) / 7.0, -3.0 - x);
    }
    out.into_bytes()
}

fn points_binary() -> Vec<u8> {
    let mut out =
        format!("ply\nformat binary_little_endian 1.0\nelement vertex {POINTS}\n{POINT}end_header\n")
            .into_bytes();
    for i in 0..POINTS {
        let x = f32::from(i) / 50.0 - 1.0;
        [x, f32::from(i % 7) / 7.0, -3.0 - x].iter().for_each(|c| out.extend(c.to_le_bytes()));
        out.extend([i, 20, 30]);
    }
    out
}

/// An image of 16 × 12 pixels in any format.
fn encoded(format: ImageFormat) -> Vec<u8> {
    let pixels = image::RgbImage::from_raw(16, 12, samples::pixels(16, 12, 3)).expect("sizes agree");
    let mut out = Cursor::new(Vec::new());
    pixels.write_to(&mut out, format).expect("encodes");
    out.into_inner()
}

/// A capture of three images in `capture/`.
fn capture(extension: &str, format: ImageFormat) -> Tree {
    let json =
        String::from_utf8(samples::transforms(3)).expect("text").replace(".png", &format!(".{extension}"));
    let mut out = Tree::from([("capture/transforms.json".to_owned(), json.into_bytes())]);
    for i in 0..3 {
        out.insert(format!("capture/images/{i:04}.{extension}"), encoded(format));
    }
    out
}

const FIT: &str =
    "splat fit capture --iterations 1 --initial 20 --max-gaussians 60 --out out --threads 1 --quiet";
const VIEWS: &str = "splat render scene.ply --cameras capture --out out --threads 1 --quiet";
const LIT: &str = "mesh render cube.obj --env {file} --cameras orbit:1 --size 8x8 --samples 1 --bounces 0 --passes photo --out out --threads 1 --quiet";

fn images() -> Vec<Base> {
    let photo = |format, extension: &str, kind| {
        let name = format!("capture/images/0001.{extension}");
        Base::new(format, capture(extension, kind), &[&name], &[FIT])
    };
    let light = |format, name: &str, bytes: &[u8]| {
        let cube = super::models::OBJ_ALONE;
        Base::new(format, files(&[("cube.obj", cube), (name, bytes)]), &[name], &[LIT])
    };
    let optional = |base: Base| Base { optional: true, ..base };
    vec![
        photo("png", "png", ImageFormat::Png).share(20),
        photo("jpg", "jpg", ImageFormat::Jpeg).share(20),
        optional(photo("webp", "webp", ImageFormat::WebP)),
        optional(photo("tiff", "tiff", ImageFormat::Tiff)),
        optional(photo("bmp", "bmp", ImageFormat::Bmp)),
        light("png, panorama", "sky.png", &samples::png(16, 8, 3)),
        light("hdr", "sky.hdr", &samples::hdr(16, 8)).share(20),
        light("exr", "sky.exr", &panorama()).share(20),
    ]
}

/// A panorama without negative values.
pub(super) fn panorama() -> Vec<u8> {
    let data: Vec<f32> = (0..16 * 8 * 3).map(|i| i as f32 * 0.01).collect();
    lastlight::io::image_file::exr_bytes(16, 8, &["R", "G", "B"], &data).expect("finite")
}

fn captures() -> Vec<Base> {
    let photos = |names: &[(&str, Vec<u8>)], folder: &str| {
        let mut out: Tree =
            names.iter().map(|(name, bytes)| (format!("capture/{folder}{name}"), bytes.clone())).collect();
        (0..3).for_each(|i| drop(out.insert(format!("capture/images/{i:04}.png"), samples::png(16, 12, 3))));
        out.insert("scene.ply".into(), scene_ply());
        out
    };
    let mut json = capture("png", ImageFormat::Png);
    json.insert("scene.ply".into(), scene_ply());
    let opencv = [20.0, 21.0, 8.0, 6.0, 0.01, 0.02, 0.003, 0.004];
    let binary = photos(
        &[
            ("cameras.bin", samples::cameras_bin(4, &opencv)),
            ("images.bin", samples::images_bin(3)),
            ("points3D.bin", samples::points_bin()),
        ],
        "sparse/0/",
    );
    let text = photos(
        &[
            ("cameras.txt", samples::cameras_txt("RADIAL", "20 8 6 .1 .2")),
            ("images.txt", samples::images_txt(3)),
            ("points3D.txt", samples::points_txt()),
        ],
        "sparse/0/",
    );
    let model = |extension: &str| {
        ["cameras", "images", "points3D"].map(|n| format!("capture/sparse/0/{n}.{extension}"))
    };
    let colmap = |format, files, extension| {
        Base::new(format, files, &model(extension).each_ref().map(String::as_str), &[FIT, VIEWS]).share(20)
    };
    vec![
        Base::new("transforms.json", json, &["capture/transforms.json"], &[FIT, VIEWS]).share(20),
        colmap("COLMAP, binary", binary, "bin"),
        colmap("COLMAP, text", text, "txt"),
    ]
}

/// Inputs and plans of operators, minted by the program.
fn arrays(shop: &Workshop) -> Vec<Base> {
    crate::tree::write(&shop.dir, &files(&[("scene.ply", &scene_ply())])).expect("written");
    shop.run("oracle mint --out minted --threads 1");
    let mut inputs = shop.tree("minted");
    inputs.retain(|name, bytes| name.ends_with("_0.npz") && bytes.len() < 20_000);
    let names: Vec<&str> = inputs.keys().map(String::as_str).collect();
    let run = "oracle run {op} --in {file} --out out.npz --threads 1 --json";
    let compare = "oracle compare {file} {file} --op {op} --threads 1";
    let inputs_base =
        Base::new("npz, oracle inputs", inputs.clone(), &names, &[run, run, run, compare]).share(30);
    // Operators with a plan: the plan is that of a run.
    let mut planned = Tree::new();
    for op in ["splat.project", "nn.mlp", "splat.color", "geometry.trace"] {
        let input = format!("minted/{op}_0.npz");
        shop.run(&format!("oracle run {op} --in {input} --out {op}.npz --threads 1"));
        let plan = format!("{op}.plan.npz");
        if shop.dir.join(&plan).is_file() {
            planned.insert(format!("{op}_plan.npz"), shop.bytes(&plan));
            planned.insert(format!("in/{op}.npz"), shop.bytes(&input));
        }
    }
    let names: Vec<&str> = planned.keys().map(String::as_str).filter(|n| n.ends_with("_plan.npz")).collect();
    assert!(!names.is_empty(), "an operator with a plan");
    let reuse = "oracle run {op} --in in/{op}.npz --plan {file} --out out.npz --threads 1";
    let plans = Base::new("plan", planned.clone(), &names, &[reuse]);
    // LPIPS: the header is what is read; a file of all weights is large, so this has a small share.
    let mut scored = below("capture", &Tree::new());
    shop.run("splat render scene.ply --cameras orbit:8 --size 32x24 --out views --threads 1 --quiet");
    scored.extend(below("capture", &shop.tree("views")));
    scored.insert("scene.ply".into(), scene_ply());
    scored.insert("vgg.safetensors".into(), crate::weights::formula());
    let eval = "splat eval scene.ply capture --lpips {file} --threads 1 --quiet";
    vec![inputs_base, plans, Base::new("LPIPS weights", scored, &["vgg.safetensors"], &[eval]).share(1)]
}
