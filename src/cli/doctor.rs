//! `doctor`: what this build and this machine are, and whether they compute the right bits.

use crate::num::bits::Digest;
use crate::num::rng::Rng;
use crate::num::{env, gemm, par};
use crate::scene::camera::{Camera, Model};

use crate::{Error, Result, version};
use lastlight_kernels::splat::color::Sh;
use lastlight_kernels::splat::render::{self, Color, In, InBar, OutBar, Settings, Shape};
use serde_json::json;

/// Print what this build and this machine are, and check that they compute the right bits.
///
/// A tiny built-in scene is rendered and differentiated; the digests of the image and of the gradients must be
/// those of every other machine. Exit code 1 when they are not.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight doctor
  lastlight doctor --json --threads 1")]
pub(super) struct Args {}

/// Digest of the image of the built-in scene.
const PICTURE: u64 = 0xe42f_dc6a_fe72_92cf;
/// Digest of the gradients of its mean squared colour.
const GRADIENTS: u64 = 0x7726_c3f0_82de_54e7;

/// Purpose number of the draws of the built-in scene.
const PURPOSE: u16 = 0xd0c7;
/// Gaussians in it.
const N: usize = 96;

pub(super) fn run(Args {}: &Args) -> Result<()> {
    let (picture, gradients) = digests()?;
    let right = picture == PICTURE && gradients == GRADIENTS;
    let probe = env::probe();
    let hex = |x: u64| format!("{x:016x}");
    if crate::console::is_json() {
        crate::console::say_json(&json!({
            "lastlight": env!("CARGO_PKG_VERSION"),
            "architecture": std::env::consts::ARCH,
            "os": std::env::consts::OS,
            "build": if cfg!(debug_assertions) { "debug" } else { "release" },
            "built_for": built_for(),
            "cpu": cpu_features(),
            "lanes": version::LANES,
            "identity": version::record(),
            "product_lanes": gemm::product_lanes(),
            "threads": par::threads(),
            "probe": probe.as_ref().map_or_else(ToString::to_string, |()| "default floating-point environment".into()),
            "digests": {"image": hex(picture), "gradients": hex(gradients)},
            "expected": {"image": hex(PICTURE), "gradients": hex(GRADIENTS)},
            "ok": right && probe.is_ok(),
        }))?;
    } else {
        let line = |name: &str, value: String| crate::console::say(&format!("{name:<14}{value}"));
        line("lastlight", env!("CARGO_PKG_VERSION").to_owned())?;
        line("machine", format!("{} {}", std::env::consts::ARCH, std::env::consts::OS))?;
        line("build", if cfg!(debug_assertions) { "debug".into() } else { "release".to_owned() })?;
        line("built for", built_for().join(" "))?;
        line("cpu features", cpu_features().join(" "))?;
        line(
            "lanes",
            format!(
                "{} of f32 in one register of this build, matrix products in lanes of {}{}; sums have 16 logical lanes on every machine",
                version::LANES,
                gemm::product_lanes(),
                std::env::var("LASTLIGHT_LANES")
                    .map_or_else(|_| String::new(), |x| format!(" (LASTLIGHT_LANES={x})"))
            ),
        )?;
        line("threads", par::threads().to_string())?;
        line(
            "rounding",
            probe.as_ref().map_or_else(ToString::to_string, |()| "default, in every thread".into()),
        )?;
        line("image", verdict(picture, PICTURE))?;
        line("gradients", verdict(gradients, GRADIENTS))?;
        if right && probe.is_ok() {
            crate::console::say("all checks passed")?;
        }
    }
    probe?;
    if right {
        return Ok(());
    }
    Err(Error::check("doctor")
        .at("digests of the built-in scene")
        .expected(format!("{} and {}", hex(PICTURE), hex(GRADIENTS)))
        .got(format!("{} and {}", hex(picture), hex(gradients)))
        .hint("this build does not compute the published bits: please report the output of doctor --json"))
}

fn verdict(got: u64, expected: u64) -> String {
    if got == expected {
        format!("digest {got:016x} ok (matches the reference)")
    } else {
        format!("digest {got:016x} WRONG, expected {expected:016x}")
    }
}

/// Target features that this build may use.
fn built_for() -> Vec<&'static str> {
    let mut have = Vec::new();
    macro_rules! feature { ($($name:literal),*) => { $(if cfg!(target_feature = $name) { have.push($name); })* } }
    feature!("sse2", "sse4.1", "avx", "avx2", "fma", "avx512f", "neon");
    have
}

/// Features that this machine has.
fn cpu_features() -> Vec<&'static str> {
    #[cfg_attr(not(target_arch = "x86_64"), expect(unused_mut, reason = "nothing is detected elsewhere"))]
    let mut have = Vec::new();
    #[cfg(target_arch = "x86_64")]
    {
        macro_rules! feature { ($($name:tt),*) => { $(if std::arch::is_x86_feature_detected!($name) { have.push($name); })* } }
        feature!("sse2", "sse4.1", "avx", "avx2", "fma", "avx512f");
    }
    have
}

/// Renders and differentiates the built-in scene: `N` Gaussians drawn from seed 0, SH degree 1, 64×48 pixels.
fn digests() -> Result<(u64, u64)> {
    let rng = Rng::new(0);
    let u = |i: usize, d: u16| rng.uniform_f32(i as u64, 0, PURPOSE, d);
    let means: Vec<[f32; 3]> =
        (0..N).map(|i| [u(i, 0) * 2.0 - 1.0, u(i, 1) * 1.5 - 0.75, u(i, 2) * 2.0 + 2.0]).collect();
    let quats: Vec<[f32; 4]> =
        (0..N).map(|i| [u(i, 3) + 0.1, u(i, 4) - 0.5, u(i, 5) - 0.5, u(i, 6) - 0.5]).collect();
    let scales: Vec<[f32; 3]> =
        (0..N).map(|i| [u(i, 7) * 0.2 + 0.01, u(i, 8) * 0.2 + 0.01, u(i, 9) * 0.05 + 0.01]).collect();
    let opacities: Vec<f32> = (0..N).map(|i| u(i, 10)).collect();
    let sh: Vec<f32> = (0..N * 12).map(|i| u(i / 12, 11 + (i % 12) as u16) - 0.5).collect();
    let camera = Camera {
        rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        translation: [0.0; 3],
        focal_px: [56.0, 56.0],
        center_px: [32.0, 24.0],
        width: 64,
        height: 48,
        model: Model::Pinhole,
    };
    let x = In {
        means: &means,
        shape: Shape::QuatScale { quats: &quats, scales: &scales },
        opacities: &opacities,
        color: Color::Sh(Sh { values: &sh, coefficients: 4, degree: 1 }),
        cameras: std::slice::from_ref(&camera),
        background: [0.25, 0.5, 0.75],
    };
    let settings = Settings::default();
    let (out, saved) = render::forward(&x, &settings);
    let mut picture = Digest::new();
    picture.f32(&[48, 64, 3], &out.image)?;
    picture.f32(&[48, 64], &out.alpha)?;
    picture.f32(&[48, 64], &out.depth)?;
    let mut bar = InBar::zeros_like(&x);
    // The cotangent is the image itself: the gradient of half its squared length.
    render::adjoint(&x, &settings, &saved, OutBar { image: Some(&out.image), ..OutBar::default() }, &mut bar);
    let mut gradients = Digest::new();
    gradients.f32(&[N, 3], bar.means.as_flattened())?;
    gradients.f32(&[N, 4], bar.quats.as_flattened())?;
    gradients.f32(&[N, 3], bar.scales.as_flattened())?;
    gradients.f32(&[N], &bar.opacities)?;
    gradients.f32(&[N, 4, 3], &bar.sh)?;
    gradients.f32(&[3], &bar.background)?;
    Ok((picture.value(), gradients.value()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_built_in_scene_has_the_published_bits_for_any_number_of_threads() {
        for n in [1, 3] {
            let (picture, gradients) = par::with_threads(n, digests).expect("threads start").expect("finite");
            assert_eq!(
                (picture, gradients),
                (PICTURE, GRADIENTS),
                "{n} threads: {picture:#018x}, {gradients:#018x}"
            );
        }
    }
}
