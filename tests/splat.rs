//! The splat renderer against arrays made by other programs, and against itself under changes that must not show.

use lastlight::io;
use lastlight::num::array::Arrays;
use lastlight::scene::camera::{Camera, Model};
use lastlight::scene::profile::Profile;
use lastlight::splat::color::Sh;
use lastlight::splat::render::{self, Color, In, InBar, OutBar, Settings, Shape};
use std::path::{Path, PathBuf};

fn golden(name: &str) -> Option<Arrays> {
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name);
    let shared = std::env::var_os("LASTLIGHT_DATA").map(|d| PathBuf::from(d).join("golden").join(name));
    let path = [Some(own), shared].into_iter().flatten().find(|p| p.exists());
    if path.is_none() {
        eprintln!("not run: {name} needs LASTLIGHT_DATA");
    }
    path.map(|p| io::npz::read(&p).expect("a golden file reads"))
}

struct Case {
    means: Vec<[f32; 3]>,
    quats: Vec<[f32; 4]>,
    scales: Vec<[f32; 3]>,
    opacities: Vec<f32>,
    sh: Vec<f32>,
    coefficients: usize,
    degree: usize,
    cameras: Vec<Camera>,
    background: [f32; 3],
}

fn rows<const M: usize>(x: &[f32]) -> Vec<[f32; M]> {
    x.as_chunks::<M>().0.to_vec()
}

impl Case {
    fn new(a: &Arrays) -> Self {
        let f = |n: &str| a.need(n).expect("golden input").to_f32();
        let n = |s: &str| a.scalar(s).expect("golden scalar") as usize;
        let (v, k) = (f("view_from_world"), f("intrinsics"));
        let cameras = v
            .chunks(16)
            .zip(k.chunks(9))
            .map(|(v, k)| Camera::from_matrices(v, k, n("width"), n("height"), Model::Pinhole))
            .collect();
        Self {
            means: rows(&f("means")),
            quats: rows(&f("quats")),
            scales: rows(&f("scales")),
            opacities: f("opacities"),
            coefficients: a.need("sh").expect("sh").shape()[1],
            sh: f("sh"),
            degree: n("sh_degree"),
            cameras,
            background: f("background").try_into().expect("three numbers"),
        }
    }

    fn input(&self) -> In<'_> {
        In {
            means: &self.means,
            shape: Shape::QuatScale { quats: &self.quats, scales: &self.scales },
            opacities: &self.opacities,
            color: Color::Sh(Sh { values: &self.sh, coefficients: self.coefficients, degree: self.degree }),
            cameras: &self.cameras,
            background: self.background,
        }
    }
}

/// ‖ours − theirs‖ / ‖theirs‖
fn relative(ours: &[f32], theirs: &[f64]) -> f64 {
    assert_eq!(ours.len(), theirs.len(), "same length");
    let (mut d, mut s) = (0.0, 0.0);
    for (a, b) in ours.iter().zip(theirs) {
        d += (f64::from(*a) - b) * (f64::from(*a) - b);
        s += b * b;
    }
    (d / s).sqrt()
}

#[test]
fn golden_pictures_and_gradients() {
    for name in ["splat_random.npz", "splat_hard.npz", "splat_garden.npz"] {
        let Some(a) = golden(name) else { continue };
        let case = Case::new(&a);
        let x = case.input();
        let near = a.scalar("near").expect("near") as f32;
        let settings = Settings { profile: Profile { near, ..Profile::GSPLAT }, ..Settings::default() };
        x.validate(&settings).expect("valid");
        let (out, saved) = render::forward(&x, &settings);
        let g = |n: &str| a.need(n).expect("golden output").to_f64();
        for (what, ours) in [("image", &out.image), ("alpha", &out.alpha), ("depth", &out.depth)] {
            let e = relative(ours, &g(what));
            println!("{name} {what} {e:.2e}");
            assert!(e <= 2e-6, "{name} {what}: relative L2 {e:.2e}");
        }
        let bar = |n: &str| a.need(n).expect("golden cotangent").to_f32();
        let (ib, ab, db) = (bar("image_bar"), bar("alpha_bar"), bar("depth_bar"));
        let out_bar = OutBar { image: Some(&ib), alpha: Some(&ab), depth: Some(&db) };
        let mut x_bar = InBar::zeros_like(&x);
        render::adjoint(&x, &settings, &saved, out_bar, &mut x_bar);
        for (what, ours) in [
            ("means_bar", x_bar.means.as_flattened()),
            ("quats_bar", x_bar.quats.as_flattened()),
            ("scales_bar", x_bar.scales.as_flattened()),
            ("opacities_bar", &x_bar.opacities),
            ("sh_bar", &x_bar.sh),
        ] {
            let e = relative(ours, &g(what));
            println!("{name} {what} {e:.2e}");
            assert!(e <= 2e-5, "{name} {what}: relative L2 {e:.2e}");
        }
        let radii = a.need("radii_px").expect("radii").to_f64();
        let differ = saved
            .rows
            .iter()
            .zip(radii.chunks(2))
            .filter(|(r, t)| (r.radii == [0, 0]) != (t[0] == 0.0))
            .count();
        println!("{name}: radii zero pattern differs in {differ} of {}", saved.rows.len());
    }
}

#[test]
fn culling_and_tile_size_do_not_show() {
    for name in ["splat_random.npz", "splat_hard.npz", "splat_garden.npz"] {
        let Some(a) = golden(name) else { continue };
        let case = Case::new(&a);
        let x = case.input();
        for profile in [Profile::EXACT, Profile::GSPLAT] {
            let base = Settings { profile, ..Settings::default() };
            let (out, saved) = render::forward(&x, &base);
            for (tile, cull) in [(8, true), (32, true), (16, false), (8, false), (32, false)] {
                let (other, _) = render::forward(&x, &Settings { tile, cull, ..base.clone() });
                assert_eq!(other, out, "{name}: tile {tile}, cull {cull}");
            }
            let mut bars = Vec::new();
            for cull in [true, false] {
                let settings = Settings { cull, ..base.clone() };
                let (_, saved) = render::forward(&x, &settings);
                let ones = vec![1.0; out.image.len()];
                let mut bar = InBar::zeros_like(&x);
                render::adjoint(
                    &x,
                    &settings,
                    &saved,
                    OutBar { image: Some(&ones), ..OutBar::default() },
                    &mut bar,
                );
                bars.push(bar);
            }
            assert_eq!(bars[0], bars[1], "{name}: gradients with and without culling");
            assert!(!saved.plan.tile_entry.is_empty(), "{name}: something was drawn");
        }
    }
}

/// The picture that gsplat's CUDA rasterizer made of four Gaussians, as the Brush project keeps it.
#[test]
fn brush_case_in_profile_gsplat() {
    let Some(data) = std::env::var_os("LASTLIGHT_DATA") else {
        eprintln!("not run: the Brush case needs LASTLIGHT_DATA");
        return;
    };
    let path = PathBuf::from(data).join("data/splats/tiny_case.safetensors");
    let a = io::safetensors::read(&path).expect("the file reads").arrays;
    let f = |n: &str| a.need(n).expect("array").to_f32();
    let scales_log: Vec<[f32; 3]> = rows(&f("scales"));
    let logits = f("opacities");
    let (mut scales, mut opacities) = (vec![[0.0; 3]; 4], vec![0.0; 4]);
    lastlight::splat::activate::forward(&scales_log, &logits, &mut scales, &mut opacities);
    let focal = 123.0 / 2.0;
    let case = Case {
        means: rows(&f("means")),
        quats: rows(&f("quats")),
        scales,
        opacities,
        sh: f("coeffs"),
        coefficients: 16,
        degree: 3,
        cameras: vec![Camera {
            rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            translation: [-0.123, -0.456, 8.0],
            focal_px: [focal, focal],
            center_px: [61.5, 41.0],
            width: 123,
            height: 82,
            model: Model::Pinhole,
        }],
        background: [0.0; 3],
    };
    let settings = Settings { profile: Profile::GSPLAT, ..Settings::default() };
    let (out, _) = render::forward(&case.input(), &settings);
    let theirs = a.need("out_img").expect("picture").to_f64();
    let rgb: Vec<f64> = theirs.chunks(4).flat_map(|p| p[..3].to_vec()).collect();
    let alpha: Vec<f64> = theirs.chunks(4).map(|p| p[3]).collect();
    let (e_rgb, e_alpha) = (relative(&out.image, &rgb), relative(&out.alpha, &alpha));
    println!("Brush case: rgb {e_rgb:.2e}, alpha {e_alpha:.2e}");
    assert!(e_rgb <= 2e-6, "rgb: relative L2 {e_rgb:.2e}");
    assert!(e_alpha <= 2e-6, "alpha: relative L2 {e_alpha:.2e}");
}
