//! Projection: the clamp of the tangent and its derivatives, compensation, the camera models.

use super::{middle, on_axis, without};
use crate::scenes::{frontal, gradient, named, run, scene};
use reference::array::{Arr, Named};
use reference::fd;

/// One tilted Gaussian at x/z = `slope`; its Σ' entry xx as a function, and the gradient of it.
struct Tilted {
    slope: f64,
}

impl Tilted {
    fn inputs(&self, dz: f64) -> Named<f64> {
        let mut inputs = frontal(&[([3.0 * self.slope, 0.1, 3.0 + dz], 1.0, 0.5, 0.5)], 100, 80);
        inputs.insert("scales".to_owned(), Arr::new(&[1, 3], vec![0.2, 0.3, 0.9]));
        inputs.insert("quats".to_owned(), Arr::new(&[1, 4], vec![0.9, 0.1, 0.3, -0.2]));
        without(&inputs, &["rgb", "background", "opacities"])
    }
    fn conic(&self, dz: f64, with: &[(&str, &str)]) -> f64 {
        run("splat.project", &self.inputs(dz), with).outputs["conics"].data[0]
    }
    fn z_bar(&self, with: &[(&str, &str)]) -> f64 {
        let bars = named([("conics", Arr::new(&[1, 1, 3], vec![1.0, 0.0, 0.0]))]);
        gradient("splat.project", &self.inputs(0.0), with, &bars)["means"].data[2]
    }
}

#[test]
fn beyond_the_tangent_limit_the_gradient_is_that_of_the_limited_function() {
    // W = 100, f = 100: tan = ½. Inria limits |x/z| to 0.65, gsplat (centred) to ½ + 0.15 as well.
    for clamp in ["gsplat", "inria"] {
        let with = [("clamp", clamp)];
        for slope in [0.3, 0.75, -0.75] {
            let tilted = Tilted { slope };
            let difference = fd::richardson(|h| tilted.conic(h, &with), 1e-4);
            let exact = tilted.z_bar(&with);
            assert!(
                (difference - exact).abs() <= 1e-9 * exact.abs(),
                "{clamp} {slope}: {difference} against {exact}"
            );
        }
    }
}

#[test]
fn inrias_backward_doubles_the_derivative_of_the_jacobian_beyond_the_limit() {
    let (inside, beyond) = (Tilted { slope: 0.3 }, Tilted { slope: 0.75 });
    // Only the 1e-7 in det² is left inside.
    let (a, b) =
        (inside.z_bar(&[("clamp", "inria")]), inside.z_bar(&[("clamp", "inria"), ("inria_bwd", "1")]));
    assert!(((a - b) / a).abs() < 1e-7, "{a} against {b}");
    // Beyond: conic_xx as a function of J02 alone, at J02 = −f·lim/z; the true slope of J02 in z is f·lim/z², Inria's twice it.
    let (exact, theirs) =
        (beyond.z_bar(&[("clamp", "inria")]), beyond.z_bar(&[("clamp", "inria"), ("inria_bwd", "1")]));
    let (z, limit) = (3.0, 0.65);
    let conic = |j02: f64| {
        // Σ' from J written out, Σ from the covariance operator.
        let both = named([
            ("quats", Arr::new(&[1, 4], vec![0.9, 0.1, 0.3, -0.2])),
            ("scales", Arr::new(&[1, 3], vec![0.2, 0.3, 0.9])),
        ]);
        let f: [f64; 9] = run("splat.covariance", &both, &[]).outputs["factors"].row(0);
        let j = [[100.0 / z, 0.0, j02], [0.0, 100.0 / z, -100.0 * 0.1 / (z * z)]];
        let v = |i: usize, k: usize| j[i][0] * f[k] + j[i][1] * f[3 + k] + j[i][2] * f[6 + k];
        let sum = |a: usize, b: usize| (0..3).fold(0.0, |s, k| s + v(a, k) * v(b, k));
        let (a, b, c) = (sum(0, 0) + 0.3, sum(0, 1), sum(1, 1) + 0.3);
        c / (a * c - b * b)
    };
    let j02 = -100.0 * limit / z;
    assert!((conic(j02) - beyond.conic(0.0, &[("clamp", "inria")])).abs() < 1e-12 * conic(j02));
    let slope = fd::richardson(|h| conic(j02 + h), 1e-3);
    let extra = slope * 100.0 * limit / (z * z);
    assert!((theirs - exact - extra).abs() <= 1e-6 * exact.abs(), "{theirs} − {exact} against {extra}");
    assert!(extra.abs() > 1e-3 * exact.abs(), "the deviation is no rounding");
}

#[test]
fn inrias_backward_damps_the_conic_by_det() {
    // Without a blur a tiny ellipse has det ≈ 1e-4; the factor is det²/(det² + 1e-7).
    let mut inputs = frontal(&[on_axis(2.0, 0.5, 0.5)], 33, 33);
    inputs.insert("scales".to_owned(), Arr::filled(&[1, 3], 0.002));
    let inputs = without(&inputs, &["rgb", "background", "opacities"]);
    let bars = named([("conics", Arr::new(&[1, 1, 3], vec![1.0, 0.5, 0.25]))]);
    let bar = |with: &[(&str, &str)]| gradient("splat.project", &inputs, with, &bars)["scales"].data[0];
    let (exact, theirs) = (bar(&[("blur_px2", "0")]), bar(&[("blur_px2", "0"), ("inria_bwd", "1")]));
    let det = (0.1_f64 * 0.1) * (0.1 * 0.1);
    let factor = det * det / (det * det + 1e-7);
    assert!((theirs / exact - factor).abs() < 1e-12, "{theirs} / {exact} against {factor}");
}

#[test]
fn the_compensation_is_the_ratio_of_areas_and_has_a_floor() {
    let project = |scale: f64| {
        let mut inputs = frontal(&[on_axis(2.0, 0.5, 0.5)], 33, 33);
        inputs.insert("scales".to_owned(), Arr::filled(&[1, 3], scale));
        without(&inputs, &["rgb", "background"])
    };
    let with = [("antialiased", "1")];
    let compensation =
        |scale: f64| run("splat.project", &project(scale), &with).outputs["compensation"].data[0];
    let variance = (0.02_f64 * 50.0) * (0.02 * 50.0);
    assert!((compensation(0.02) - variance / (variance + 0.3)).abs() < 1e-15);
    assert_eq!(compensation(1e-6), 0.005);
    let bars = named([("compensation", Arr::filled(&[1, 1], 1.0))]);
    let bar = |scale: f64| gradient("splat.project", &project(scale), &with, &bars)["scales"].data[0];
    assert_eq!(bar(1e-6), 0.0, "flat below the floor");
    assert!(bar(0.02) > 0.0);
    let mut inputs = frontal(&[on_axis(2.0, 0.5, 0.5)], 33, 33);
    inputs.insert("scales".to_owned(), Arr::filled(&[1, 3], 0.02));
    let image = middle(&run("splat.render", &inputs, &with));
    assert!((image - 0.25 * variance / (variance + 0.3)).abs() < 1e-15, "the opacity is compensated");
}

#[test]
fn the_fisheye_is_smooth_across_its_axis_and_its_series() {
    let at = |x: f64, with: &[(&str, &str)]| {
        let mut inputs = frontal(&[([x, 0.5 * x, 2.0], 1.0, 0.5, 0.5)], 64, 64);
        inputs.insert("scales".to_owned(), Arr::new(&[1, 3], vec![0.2, 0.3, 0.9]));
        inputs.insert("quats".to_owned(), Arr::new(&[1, 4], vec![0.9, 0.1, 0.3, -0.2]));
        let inputs = without(&inputs, &["rgb", "background", "opacities"]);
        run("splat.project", &inputs, with).outputs
    };
    let fisheye = [("camera", "fisheye")];
    // ρ²/z² = 1.25 x²/4 crosses 0.01, where the series hands over, at x = 0.1789.
    let switch = (0.04_f64 / 1.25).sqrt();
    for (name, tolerance) in [("means_px", 1e-13), ("conics", 1e-11), ("shape", 1e-11)] {
        let (below, above) = (at(switch * (1.0 - 1e-15), &fisheye), at(switch * (1.0 + 1e-15), &fisheye));
        for (a, b) in below[name].data.iter().zip(&above[name].data) {
            assert!((a - b).abs() <= tolerance * b.abs(), "{name}: {a} against {b}");
        }
    }
    // On the axis it is the pinhole.
    let (fish, pin) = (at(0.0, &fisheye), at(0.0, &[]));
    for name in ["means_px", "conics", "shape"] {
        for (a, b) in fish[name].data.iter().zip(&pin[name].data) {
            assert!((a - b).abs() <= 1e-14 * b.abs(), "{name}: {a} against {b}");
        }
    }
    // At 45° the angle is π/4.
    let mut inputs = frontal(&[([2.0, 0.0, 2.0], 0.1, 0.5, 0.5)], 64, 64);
    inputs = without(&inputs, &["rgb", "background", "opacities"]);
    let u = run("splat.project", &inputs, &fisheye).outputs["means_px"].data[0];
    assert!((u - 32.0 - 100.0 * std::f64::consts::FRAC_PI_4).abs() < 1e-12, "{u}");
}

#[test]
fn the_orthographic_image_does_not_depend_on_depth() {
    let at = |z: f64| {
        let inputs = without(
            &frontal(&[([0.1, 0.05, z], 0.04, 0.5, 0.5)], 64, 64),
            &["rgb", "background", "opacities"],
        );
        run("splat.project", &inputs, &[("camera", "orthographic")]).outputs
    };
    let (a, b) = (at(1.0), at(7.0));
    assert_eq!(a["means_px"].data, [42.0, 37.0]);
    assert_eq!(a["conics"], b["conics"]);
    assert!((a["conics"].data[0] - 1.0 / 16.3).abs() < 1e-15);
}

#[test]
fn factors_and_quaternions_give_one_image() {
    let inputs = scene(10, 24, 20);
    let both = named([("quats", inputs["quats"].clone()), ("scales", inputs["scales"].clone())]);
    let mut skinned = without(&inputs, &["quats", "scales"]);
    skinned.extend(run("splat.covariance", &both, &[]).outputs);
    assert_eq!(run("splat.render", &skinned, &[]).outputs, run("splat.render", &inputs, &[]).outputs);
}

#[test]
fn whole_pixels_shift_the_exact_image() {
    // Means whose projections move by exactly 5 pixels when the principal point does.
    let mut inputs = frontal(&[on_axis(2.0, 0.9, 1.0), on_axis(2.5, 0.4, 0.3)], 48, 48);
    let still = run("splat.render", &inputs, &[]).outputs["alpha"].clone();
    inputs.get_mut("intrinsics").expect("intrinsics").data[2] += 5.0;
    let shifted = run("splat.render", &inputs, &[]).outputs["alpha"].clone();
    for y in 0..48 {
        for x in 5..48 {
            assert_eq!(shifted.data[48 * y + x], still.data[48 * y + x - 5], "pixel {x}, {y}");
        }
    }
}
