//! The splat renderer against arrays made by other programs, and against itself under changes that must not
//! show.

use crate::common::{golden, real_data};
use lastlight::io;
use lastlight::num::array::Arrays;
use lastlight::scene::camera::{Camera, Model};
use lastlight::scene::profile::Profile;
use lastlight::splat::color::Sh;
use lastlight::splat::render::{self, Color, In, InBar, OutBar, Settings, Shape};

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
    for name in ["splat_random", "splat_hard", "splat_garden"] {
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
        assert_eq!(differ, 0, "{name}: rows whose radii are zero in one program only");
    }
}

#[test]
fn culling_and_tile_size_do_not_show() {
    for name in ["splat_random", "splat_hard", "splat_garden"] {
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

#[test]
fn profiles_differ_only_in_their_constants() {
    type Change = (&'static str, fn(&mut Profile));
    let gsplat = Profile::GSPLAT;
    // The constants in which the profiles differ, each set back to that of gsplat.
    let changes: [Change; 4] = [
        ("stop", |p| p.stop = Profile::GSPLAT.stop),
        ("near", |p| p.near = Profile::GSPLAT.near),
        ("clamp", |p| p.clamp = Profile::GSPLAT.clamp),
        ("footprint", |p| p.footprint = Profile::GSPLAT.footprint),
    ];
    let changed = |but: &str| {
        let mut profile = Profile::INRIA;
        changes.iter().filter(|(name, _)| *name != but).for_each(|(_, change)| change(&mut profile));
        profile
    };
    let mut seen = Vec::new();
    for name in ["splat_random", "splat_hard", "splat_garden"] {
        let Some(a) = golden(name) else { continue };
        let mut case = Case::new(&a);
        // One right before the first camera, nearer than inria looks.
        let Camera { rotation: r, translation: t, .. } = case.cameras[0];
        let there = [t[0], t[1], t[2] - 0.1];
        let near = [0, 1, 2].map(|c| -(r[0][c] * there[0] + r[1][c] * there[1] + r[2][c] * there[2]));
        case.means.push(near);
        case.quats.push([1.0, 0.0, 0.0, 0.0]);
        case.scales.push([0.002; 3]);
        case.opacities.push(0.5);
        case.sh.extend(vec![0.1; 3 * case.coefficients]);
        let x = case.input();
        let drawn = |profile: Profile| {
            let settings = Settings { profile, ..Settings::default() };
            let (out, saved) = render::forward(&x, &settings);
            let ones = vec![1.0; out.image.len()];
            let mut bar = InBar::zeros_like(&x);
            let out_bar = OutBar { image: Some(&ones), ..OutBar::default() };
            render::adjoint(&x, &settings, &saved, out_bar, &mut bar);
            (out, bar)
        };
        let theirs = drawn(gsplat.clone());
        assert!(
            drawn(changed("")) == theirs,
            "{name}: with gsplat's constants inria is gsplat, gradients too"
        );
        seen.extend(changes.iter().map(|(what, _)| *what).filter(|what| drawn(changed(what)) != theirs));
    }
    // T(1 − α) is hardly ever 1e-4 to the bit, which is all that the two rules of stopping disagree on.
    for what in ["near", "clamp", "footprint"] {
        assert!(seen.contains(&what), "{what} shows somewhere: {seen:?}");
    }
}

/// The image that gsplat's CUDA rasterizer made of four Gaussians, as the Brush project keeps it.
#[test]
fn brush_case_in_profile_gsplat() {
    let Some(path) = real_data("splats/tiny_case.safetensors") else { return };
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
    let theirs = a.need("out_img").expect("image").to_f64();
    let rgb: Vec<f64> = theirs.chunks(4).flat_map(|p| p[..3].to_vec()).collect();
    let alpha: Vec<f64> = theirs.chunks(4).map(|p| p[3]).collect();
    let (e_rgb, e_alpha) = (relative(&out.image, &rgb), relative(&out.alpha, &alpha));
    println!("Brush case: rgb {e_rgb:.2e}, alpha {e_alpha:.2e}");
    assert!(e_rgb <= 2e-6, "rgb: relative L2 {e_rgb:.2e}");
    assert!(e_alpha <= 2e-6, "alpha: relative L2 {e_alpha:.2e}");
}

/// With `inria_bwd` the shipped adjoint is not the derivative of the forward pass, so the gradient checks
/// leave it out; the twin reproduces the same three deviations on its reverse tape, on the same plan.
#[test]
fn deviating_gradients_of_inria_are_those_of_the_twin() {
    use lastlight::ops::{self, Call, Setting};
    for (name, index, saturated) in
        [("splat.blend", 1, true), ("splat.render", 0, true), ("splat.render", 4, false)]
    {
        let op = ops::find(name).expect("listed");
        let mut case = (op.case)(index);
        case.settings.insert("inria_bwd".to_owned(), Setting::Number(1.0));
        case.settings.insert("alpha_max".to_owned(), Setting::Number(if saturated { 0.3 } else { 0.99 }));
        let mut call = Call { inputs: case.inputs, settings: case.settings, ..Call::default() };
        let first = ops::run(op, &call).expect("a generated case runs");
        let capped = first.plan.need("cap_mask").expect("in the plan").to_f64().iter().any(|b| *b != 0.0);
        assert!(capped || !saturated, "{name} {index}: the cap is reached somewhere");
        call.cotangents = ops::draw_cotangents(op, &first.outputs);
        let ours = ops::run(op, &call).expect("with gradients").gradients;
        call.plan = Some(first.plan);
        let twin = ops::run_f64(op, &call).expect("the twin on our plan").gradients;
        for (what, theirs) in &twin.0 {
            let e = relative(&ours.need(what).expect("the same gradients").to_f32(), &theirs.to_f64());
            assert!(e <= 2e-5, "{name} {index} {what}: relative L2 {e:.2e}");
        }
        call.settings.insert("inria_bwd".to_owned(), Setting::Number(0.0));
        let exact = ops::run_f64(op, &call).expect("the twin").gradients;
        assert_ne!(exact, twin, "{name} {index}: the deviations are active");
    }
}

#[test]
fn no_gaussians_give_the_background() {
    let settings = Settings::default();
    let camera = Camera::from_matrices(
        &[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0],
        &[10.0, 0.0, 8.5, 0.0, 10.0, 8.5, 0.0, 0.0, 1.0],
        17,
        17,
        Model::Pinhole,
    );
    let x = In {
        means: &[],
        shape: Shape::QuatScale { quats: &[], scales: &[] },
        opacities: &[],
        color: Color::Rgb(&[]),
        cameras: &[camera],
        background: [0.25, 0.5, 0.75],
    };
    let (out, saved) = render::forward(&x, &settings);
    assert!(out.image.chunks(3).all(|p| p == [0.25, 0.5, 0.75]), "the background everywhere");
    let ones = vec![1.0; out.image.len()];
    let mut bar = InBar::zeros_like(&x);
    render::adjoint(&x, &settings, &saved, OutBar { image: Some(&ones), ..OutBar::default() }, &mut bar);
    assert_eq!(bar.background, [289.0; 3], "every pixel has the full background");
}
