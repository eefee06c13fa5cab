//! Results that are known without a computer, and invariances.

use reference::array::{Arr, Named};
use reference::num::rng::{Key, normal_f64, uniform_f64};
use reference::splat::color::{basis, direction};
use reference::splat::covariance::rotation;

use crate::scenes::{dot, frontal, gradient, named, normal, refused, run, scene, uniform};

#[test]
fn spherical_harmonics_obey_the_addition_theorem() {
    for item in 0..50 {
        let d =
            std::array::from_fn(|i| normal_f64(Key { seed: 1, item, step: 0, purpose: 0, draw: i as u16 }));
        let basis = basis(3, direction(d, [0.0; 3]));
        for l in 0..4_usize {
            let sum = basis[l * l..(l + 1) * (l + 1)].iter().fold(0.0, |sum, y| sum + y * y);
            let expected = (2 * l + 1) as f64 / (4.0 * std::f64::consts::PI);
            assert!((sum - expected).abs() <= 2e-15, "degree {l}: {sum} against {expected}");
        }
    }
}

#[test]
fn the_identity_quaternion_gives_a_diagonal_factor() {
    let inputs = named([
        ("quats", Arr::new(&[1, 4], vec![3.0, 0.0, 0.0, 0.0])),
        ("scales", Arr::new(&[1, 3], vec![0.5, 2.0, 7.0])),
    ]);
    let factors = &run("splat.covariance", &inputs, &[]).outputs["factors"];
    assert_eq!(factors.data, [0.5, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 7.0]);
}

#[test]
fn rotations_are_orthogonal_and_turn_the_right_way() {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let about_z = rotation([half, 0.0, 0.0, half]);
    let x_to = about_z.map(|row| row[0]);
    assert!(
        (x_to[1] - 1.0).abs() < 1e-15 && x_to[0].abs() < 1e-15,
        "a quarter turn about z takes x to y: {x_to:?}"
    );
    let quats = normal(&[20, 4], 40);
    for i in 0..20 {
        let r = rotation(quats.row(i));
        for a in 0..3 {
            for b in 0..3 {
                let product = r[0][a] * r[0][b] + r[1][a] * r[1][b] + r[2][a] * r[2][b];
                // Nine roundings in an entry, five in the product.
                let error = (product - f64::from(u8::from(a == b))).abs();
                assert!(error <= 8.0 * f64::EPSILON, "column {a} times column {b}: {product}");
            }
        }
    }
}

#[test]
fn powers_of_two_in_the_length_of_a_quaternion_change_no_bit() {
    let quats = normal(&[10, 4], 41);
    for i in 0..10 {
        let q: [f64; 4] = quats.row(i);
        for power in [2.0_f64, 0.25, 2.0_f64.powi_exact(400), 2.0_f64.powi_exact(-500)] {
            assert_eq!(rotation(q.map(|q| q * power)), rotation(q), "times {power:e}");
        }
        assert_eq!(rotation(q.map(|q| -q)), rotation(q), "q and −q are one rotation");
    }
}

/// Exact powers of two.
trait PowerOfTwo {
    fn powi_exact(self, n: i32) -> Self;
}

impl PowerOfTwo for f64 {
    fn powi_exact(self, n: i32) -> Self {
        assert_eq!(self, 2.0, "powers of two only");
        f64::from_bits(((n + 1023) as u64) << 52)
    }
}

#[test]
fn the_gradient_of_a_quaternion_is_orthogonal_to_it() {
    let inputs = named([("quats", normal(&[20, 4], 42)), ("scales", uniform(&[20, 3], [0.1, 2.0], 43))]);
    let bars = named([("factors", normal(&[20, 3, 3], 44))]);
    let factors = &run("splat.covariance", &inputs, &[]).outputs["factors"];
    let bar = &gradient("splat.covariance", &inputs, &[], &bars)["quats"];
    let fold = |a: &[f64], b: &[f64]| a.iter().zip(b).fold(0.0, |sum, (a, b)| sum + a * b);
    for i in 0..20 {
        let (q, q_bar): ([f64; 4], [f64; 4]) = (inputs["quats"].row(i), bar.row(i));
        let (f, f_bar): ([f64; 9], [f64; 9]) = (factors.row(i), bars["factors"].row(i));
        // What cancels in ⟨q, q̄⟩ are terms of the size of F·F̄.
        let size = (fold(&f, &f) * fold(&f_bar, &f_bar)).sqrt();
        let radial = fold(&q, &q_bar) / size;
        assert!(radial.abs() <= 1e-15, "radial component {radial:e}");
    }
}

#[test]
fn a_sphere_has_no_gradient_in_its_rotation() {
    let mut inputs = scene(6, 32, 24);
    inputs.insert("scales".to_owned(), Arr::filled(&[6, 3], 0.2));
    let bars = named([("image", normal(&[2, 24, 32, 3], 45))]);
    let gradient = gradient("splat.render", &inputs, &[], &bars);
    let size = |x: &Arr<f64>| x.data.iter().fold(0.0, |m: f64, x| if x.abs() > m { x.abs() } else { m });
    assert!(size(&gradient["quats"]) <= 1e-12 * size(&gradient["scales"]), "{:?}", gradient["quats"]);
}

#[test]
fn needles_keep_a_positive_determinant() {
    let n = 200;
    let mut inputs = frontal(&vec![([0.0, 0.0, 4.0], 1.0, 0.9, 1.0); n], 64, 48);
    inputs.insert("quats".to_owned(), normal(&[n, 4], 46));
    inputs.insert("means".to_owned(), {
        let mut means = uniform(&[n, 3], [-1.0, 1.0], 47);
        means.data.iter_mut().skip(2).step_by(3).for_each(|z| *z += 4.0);
        means
    });
    // 100 px per unit at distance 1: aspect 20 000 in space.
    let scales: Vec<f64> = (0..n).flat_map(|_| [20.0, 1e-3, 1e-3]).collect();
    inputs.insert("scales".to_owned(), Arr::new(&[n, 3], scales));
    let inputs: Named<f64> =
        inputs.into_iter().filter(|(name, _)| name != "rgb" && name != "background").collect();
    let answer = run("splat.project", &inputs, &[]);
    let mut longest = 0.0;
    for i in 0..n {
        let [s, k1, k2]: [f64; 3] = answer.outputs["shape"].row(i);
        let det = 1.0 / (k1 * k1) / (k2 * k2);
        assert!(det >= 0.09, "Gaussian {i}: det {det}");
        assert!(s.abs() <= 1.0 + 1e-12, "Gaussian {i}: s {s} with the larger entry as pivot");
        longest = if 1.0 / k1 > longest { 1.0 / k1 } else { longest };
    }
    assert!(longest > 300.0, "the needles are long: {longest} px");
}

#[test]
fn a_gaussian_in_the_pixel_centre_has_its_opacity() {
    // Mean at pixel (10, 8), whose centre is (10.5, 8.5); principal point (16, 12), f = 100 px.
    let mean = [(10.5 - 16.0) / 100.0 * 2.0, (8.5 - 12.0) / 100.0 * 2.0, 2.0];
    let mut inputs = frontal(&[(mean, 0.05, 0.6, 0.8)], 32, 24);
    inputs.insert("background".to_owned(), Arr::new(&[3], vec![0.25; 3]));
    let answer = run("splat.render", &inputs, &[]);
    let pixel = 8 * 32 + 10;
    let image: [f64; 3] = answer.outputs["image"].row(pixel);
    assert!((image[1] - (0.6 * 0.8 + 0.4 * 0.25)).abs() < 1e-14, "{image:?}");
    assert!((answer.outputs["alpha"].data[pixel] - 0.6).abs() < 1e-14);
    assert!((answer.outputs["depth"].data[pixel] - 1.2).abs() < 1e-14);
    // Four pixels to the right: variance (100·0.05/2)² + 0.3 and no more than first-order terms on the x axis.
    let j = -mean[0] / 4.0 * 100.0;
    let variance = (0.05 * 50.0) * (0.05 * 50.0) + (0.05 * j) * (0.05 * j) + 0.3;
    let cross = 0.05 * 0.05 * (mean[0] / 4.0 * 100.0) * (mean[1] / 4.0 * 100.0);
    let other =
        (0.05 * 50.0) * (0.05 * 50.0) + (0.05 * mean[1] / 4.0 * 100.0) * (0.05 * mean[1] / 4.0 * 100.0) + 0.3;
    let conic = other / (variance * other - cross * cross);
    let expected = 0.6 * reference::num::elem::exp(-0.5 * 16.0 * conic);
    assert!((answer.outputs["alpha"].data[pixel + 4] - expected).abs() < 1e-13);
}

#[test]
fn the_image_is_linear_in_colour_and_background() {
    let inputs = scene(12, 24, 20);
    let answer = run("splat.render", &inputs, &[]);
    let mut black = inputs.clone();
    black.insert("background".to_owned(), Arr::new(&[3], vec![0.0; 3]));
    let unlit = run("splat.render", &black, &[]);
    for (i, lit) in answer.outputs["image"].data.iter().enumerate() {
        let rest = 1.0 - answer.outputs["alpha"].data[i / 3];
        let expected = unlit.outputs["image"].data[i] + rest * inputs["background"].data[i % 3];
        assert!((lit - expected).abs() < 1e-14, "pixel {}: {lit} against {expected}", i / 3);
    }
}

#[test]
fn equal_images_are_similar_and_have_no_loss() {
    let x = uniform(&[12, 17, 3], [0.0, 1.0], 50);
    let same = named([("x", x.clone()), ("y", x.clone())]);
    let similarity = run("loss.ssim", &same, &[]).outputs["value"].data[0];
    assert_eq!(similarity, 1.0);
    let bars = named([("value", Arr::scalar(1.0))]);
    let flat = gradient("loss.ssim", &same, &[], &bars);
    assert!(flat["x"].data.iter().all(|g| g.abs() <= 1e-15), "SSIM has its maximum there");
    for op in ["loss.l1", "loss.mse"] {
        assert_eq!(run(op, &same, &[]).outputs["value"].data, [0.0]);
        assert!(
            gradient(op, &same, &[], &bars)["x"].data.iter().all(|&g| g == 0.0),
            "{op}: gradient 0 at x = y"
        );
    }
}

#[test]
fn losses_of_constant_images_are_known() {
    let (a, b) = (0.75, 0.25);
    let flat = |v: f64| Arr::filled(&[30, 30, 3], v);
    let mask = Arr::new(&[30, 30], (0..900).map(|i| if i % 30 < 15 { 1.0 } else { 0.0 }).collect());
    let inputs = named([("x", flat(a)), ("y", flat(b)), ("mask", mask)]);
    assert!((run("loss.l1", &inputs, &[]).outputs["value"].data[0] - 0.5).abs() < 1e-14);
    assert!((run("loss.mse", &inputs, &[]).outputs["value"].data[0] - 0.25).abs() < 1e-14);
    let bars = named([("value", Arr::scalar(2.0))]);
    let l1 = gradient("loss.l1", &inputs, &[], &bars);
    let mse = gradient("loss.mse", &inputs, &[], &bars);
    let values = 3.0 * 450.0;
    for pixel in 0..900 {
        let kept = if pixel % 30 < 15 { 1.0 } else { 0.0 };
        assert!((l1["x"].data[3 * pixel] - kept * 2.0 / values).abs() < 1e-17);
        assert!((mse["y"].data[3 * pixel] + kept * 2.0 * 2.0 * 0.5 / values).abs() < 1e-17);
    }
    // One pixel more than the window away from every border the variances vanish.
    use reference::loss::{In, Pair, ssim};
    let whole = named([("x", flat(a)), ("y", flat(b))]);
    let pair = Pair::of(&In::of(&whole).expect("two images")).expect("two images");
    let centre = ssim::map_at(&pair, &ssim::window(), [15, 15, 0]);
    let expected = (2.0 * a * b + 1e-4) / (a * a + b * b + 1e-4);
    assert!((centre - expected).abs() < 1e-12, "{centre} against {expected}");
    let corner = ssim::map_at(&pair, &ssim::window(), [0, 0, 0]);
    assert!(corner < centre, "zero padding lowers the border");
}

#[test]
fn masked_ssim_is_that_of_masked_images() {
    let (h, w) = (14, 11);
    let mask = Arr::new(&[h, w], (0..h * w).map(|i| f64::from(u8::from(i % 5 != 0))).collect());
    let x = uniform(&[h, w, 3], [0.0, 1.0], 51);
    let y = uniform(&[h, w, 3], [0.0, 1.0], 52);
    let times = |x: &Arr<f64>| {
        Arr::new(&[h, w, 3], x.data.iter().enumerate().map(|(i, x)| x * mask.data[i / 3]).collect())
    };
    let masked = named([("x", times(&x)), ("y", times(&y))]);
    use reference::loss::{In, Pair, ssim};
    let pair = Pair::of(&In::of(&masked).expect("two images")).expect("two images");
    let (mut sum, mut count) = (0.0, 0.0);
    for i in (0..3 * h * w).filter(|i| mask.data[i / 3] == 1.0) {
        sum += ssim::map_at(&pair, &ssim::window(), [i / 3 / w, i / 3 % w, i % 3]);
        count += 1.0;
    }
    let value = run("loss.ssim", &named([("x", x), ("y", y), ("mask", mask)]), &[]).outputs["value"].data[0];
    assert!((value - sum / count).abs() < 1e-14, "{value} against {}", sum / count);
}

#[test]
fn a_newborn_row_steps_as_far_as_its_counter_says() {
    // Born after 10 000 steps, constant gradient: lr with a counter of its own, 0.1/√0.001 lr with the global one.
    let (steps, lr) = (10_000, 1e-3);
    let active = (0..steps).map(|s| f64::from(u8::from(s + 1 == steps))).collect();
    let inputs = named([
        ("param", Arr::new(&[1], vec![0.0])),
        ("grads", Arr::new(&[steps, 1], vec![0.3; steps])),
        ("active", Arr::new(&[steps, 1], active)),
    ]);
    let step = |counters: &str| {
        let answer = run("optim.adam", &inputs, &[("counters", counters), ("eps", "1e-15")]);
        -answer.outputs["trajectory"].data[steps - 1] / lr
    };
    assert!((step("row") - 1.0).abs() < 1e-12, "{}", step("row"));
    assert!((step("global") - 3.1623).abs() < 1e-4, "{}", step("global"));
    assert_eq!(run("optim.adam", &inputs, &[]).intermediates["steps"].data, [1.0]);
}

#[test]
fn inactive_rows_do_not_move() {
    let inputs = named([
        ("param", Arr::new(&[2, 2], vec![1.0, 2.0, 3.0, 4.0])),
        ("grads", Arr::filled(&[3, 2, 2], 0.5)),
        ("active", Arr::new(&[3, 2], vec![1.0, 0.0, 1.0, 0.0, 1.0, 0.0])),
    ]);
    let answer = run("optim.adamw", &inputs, &[("weight_decay", "0.1")]);
    for step in 0..3 {
        assert_eq!(answer.outputs["trajectory"].data[4 * step + 2..4 * step + 4], [3.0, 4.0]);
    }
    assert_eq!(answer.intermediates["steps"].data, [3.0, 0.0]);
    assert_eq!(answer.intermediates["m"].data[2..], [0.0, 0.0]);
    // First step: decay by lr·0.1, then lr against the gradient.
    let first = 1.0 - 1e-3 * 0.1 * 1.0 - 1e-3;
    assert!((answer.outputs["trajectory"].data[0] - first).abs() < 1e-10);
}

#[test]
fn layers_of_known_numbers() {
    let inputs = named([
        ("x", Arr::new(&[2, 2], vec![1.0, 2.0, 3.0, 4.0])),
        ("weight", Arr::new(&[1, 2], vec![10.0, -1.0])),
        ("bias", Arr::new(&[1], vec![0.5])),
    ]);
    assert_eq!(run("nn.linear", &inputs, &[]).outputs["y"].data, [8.5, 26.5]);
    let bars = named([("y", Arr::new(&[2, 1], vec![1.0, 2.0]))]);
    let gradient = gradient("nn.linear", &inputs, &[], &bars);
    assert_eq!(gradient["weight"].data, [7.0, 10.0]);
    assert_eq!(gradient["bias"].data, [3.0]);
    assert_eq!(gradient["x"].data, [10.0, -1.0, 20.0, -2.0]);
}

#[test]
fn activations_of_known_numbers() {
    let inputs = named([
        ("scales_log", Arr::new(&[2, 3], vec![0.0; 6])),
        ("opacity_logits", Arr::new(&[2], vec![0.0, -800.0])),
    ]);
    let answer = run("splat.activate", &inputs, &[]);
    assert_eq!(answer.outputs["scales"].data, [1.0; 6]);
    assert_eq!(answer.outputs["opacities"].data, [0.5, 0.0]);
}

#[test]
fn the_adjoint_is_linear_in_the_cotangent() {
    let inputs = scene(10, 24, 18);
    let bars = named([("image", normal(&[2, 18, 24, 3], 60)), ("depth", normal(&[2, 18, 24], 61))]);
    let twice: Named<f64> = bars.iter().map(|(name, x)| (name.clone(), x.map(|x| 2.0 * x))).collect();
    let (once, double) =
        (gradient("splat.render", &inputs, &[], &bars), gradient("splat.render", &inputs, &[], &twice));
    for (name, x) in &once {
        assert!(x.map(|x| 2.0 * x) == double[name], "{name}: a factor of two changes no bit");
    }
    assert!(dot(&once, &once) > 0.0, "something was tested");
}

#[test]
fn bad_requests_are_refused_by_name() {
    let good = scene(3, 16, 16);
    let with = |name: &str, x: Option<Arr<f64>>| {
        let mut inputs = good.clone();
        match x {
            Some(x) => drop(inputs.insert(name.to_owned(), x)),
            None => drop(inputs.remove(name)),
        }
        inputs
    };
    for (inputs, word) in [
        (with("means", None), "means"),
        (with("quats", Some(Arr::filled(&[3, 4], 0.0))), "quats[0]"),
        (with("opacities", Some(Arr::filled(&[4], 0.5))), "opacities"),
        (with("scales", Some(Arr::filled(&[3, 3], f64::NAN))), "NaN"),
        (with("sh_degree", Some(Arr::scalar(4.0))), "sh_degree"),
        (with("width", Some(Arr::scalar(0.5))), "width"),
        (with("surprise", Some(Arr::scalar(0.5))), "surprise"),
    ] {
        let message = refused("splat.render", &inputs, &[]);
        assert!(message.contains(word), "{message}");
    }
    for setting in [
        ("stop", "sometimes"),
        ("profile", "mine"),
        ("alpha_min", "small"),
        ("antialiased", "2"),
        ("speed", "1"),
    ] {
        let message = refused("splat.render", &good, &[setting]);
        assert!(message.contains(setting.0), "{message}");
    }
    assert!(refused("splat.paint", &good, &[]).contains("splat.paint"));
    let pair = named([
        ("x", Arr::filled(&[2, 2, 3], 0.0)),
        ("y", Arr::filled(&[2, 2, 3], 0.0)),
        ("mask", Arr::filled(&[2, 2], 0.0)),
    ]);
    assert!(refused("loss.l1", &pair, &[]).contains("mask"));
}

#[test]
fn draws_have_the_moments_of_their_distributions() {
    let n = 20_000;
    let (mut mean, mut square, mut uniform_mean) = (0.0, 0.0, 0.0);
    for item in 0..n {
        let key = Key { seed: 9, item, step: 0, purpose: 1, draw: 0 };
        let x = normal_f64(key);
        mean += x / n as f64;
        square += x * x / n as f64;
        uniform_mean += uniform_f64(key) / n as f64;
    }
    assert!(mean.abs() < 0.03 && (square - 1.0).abs() < 0.04 && (uniform_mean - 0.5).abs() < 0.01);
}
