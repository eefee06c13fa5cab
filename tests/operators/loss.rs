//! Losses and image metrics: closed forms, invariances, an independent f64 evaluation, golden arrays.

use crate::common::golden;
use lastlight::loss::metric::{self, Crop, psnr::Decibel};
use lastlight::loss::{In, l1, mse, ssim};
use lastlight::num::array::Arrays;
use lastlight::num::par::with_threads;

fn array(a: &Arrays, name: &str) -> Vec<f64> {
    a.need(name).expect("the golden file holds it").to_f64()
}

/// Uniform numbers in 0..1 by position, for test pictures only (splitmix64).
fn noise(seed: u64, n: usize) -> Vec<f32> {
    (0..n as u64)
        .map(|i| {
            let mut z = (seed << 32).wrapping_add(i).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            ((z ^ (z >> 31)) >> 40) as f32 / 16_777_216.0
        })
        .collect()
}

/// A picture with flat, smooth and noisy parts, and a version of it with an error of size `e`.
fn pictures(height: usize, width: usize, e: f32) -> (Vec<f32>, Vec<f32>) {
    let (u, v) = (noise(1, height * width * 3), noise(2, height * width * 3));
    let y: Vec<f32> = (0..height * width * 3)
        .map(|i| {
            let (r, c) = (i / 3 / width, i / 3 % width);
            match (r * 4 / height, c * 3 / width) {
                (0, _) => 0.0,
                (1, 0) => 1.0,
                (1, _) => c as f32 / width as f32,
                (2, 1) => 0.7,
                _ => 0.2 + 0.6 * u[i],
            }
        })
        .collect();
    let x = y.iter().zip(&v).map(|(y, v)| y + e * (v - 0.5)).collect();
    (x, y)
}

fn checker(height: usize, width: usize) -> Vec<f32> {
    (0..height * width)
        .map(|i| f32::from(u8::from(!(i / width * 7 + i % width * 3).is_multiple_of(5))))
        .collect()
}

fn relative_l2(got: &[f32], want: &[f64]) -> f64 {
    let (mut error, mut norm) = (0.0, 0.0);
    for (g, w) in got.iter().zip(want) {
        error += (f64::from(*g) - w) * (f64::from(*g) - w);
        norm += w * w;
    }
    (error / norm).sqrt()
}

/// Mean SSIM as the textbook writes it: f64, 121 taps per pixel; with the gradient by x from the chain rule applied to the
/// textbook's five moments.
fn textbook(x: &[f64], y: &[f64], mask: Option<&[f32]>, height: usize, width: usize) -> (f64, Vec<f64>) {
    let (c1, c2) = (1e-4, 9e-4);
    let g: Vec<f64> = (0..11).map(|k| libm::exp(-f64::from((k - 5) * (k - 5)) / 4.5)).collect();
    let norm: f64 = g.iter().fold(0.0, |a, b| a + b);
    let m = |p: usize| mask.map_or(1.0, |m| f64::from(m[p]));
    let kept = (0..height * width).filter(|&p| m(p) != 0.0).count() as f64 * 3.0;
    let (mut total, mut x_bar) = (0.0, vec![0.0; x.len()]);
    for r in 0..height {
        for c in 0..width {
            if m(r * width + c) == 0.0 {
                continue;
            }
            for ch in 0..3 {
                let mut taps = Vec::new();
                for i in 0..11 {
                    for j in 0..11 {
                        let (rr, cc) = ((r + i) as isize - 5, (c + j) as isize - 5);
                        if rr >= 0 && cc >= 0 && (rr as usize) < height && (cc as usize) < width {
                            taps.push((rr as usize * width + cc as usize, g[i] * g[j] / (norm * norm)));
                        }
                    }
                }
                let mut e = [0.0; 5];
                for &(p, w) in &taps {
                    let (a, b) = (x[p * 3 + ch] * m(p), y[p * 3 + ch] * m(p));
                    for (e, t) in e.iter_mut().zip([a, b, a * a, b * b, a * b]) {
                        *e += w * t;
                    }
                }
                let [ux, uy, xx, yy, xy] = e;
                let (a1, a2) = (2.0 * ux * uy + c1, 2.0 * (xy - ux * uy) + c2);
                let (b1, b2) = (ux * ux + uy * uy + c1, xx - ux * ux + yy - uy * uy + c2);
                let s = a1 * a2 / (b1 * b2);
                total += s;
                let by_ux = s * (2.0 * uy / a1 - 2.0 * uy / a2 - 2.0 * ux / b1 + 2.0 * ux / b2);
                let (by_xx, by_xy) = (-s / b2, s * 2.0 / a2);
                for &(p, w) in &taps {
                    let (a, b) = (x[p * 3 + ch] * m(p), y[p * 3 + ch] * m(p));
                    x_bar[p * 3 + ch] += w * m(p) * (by_ux + 2.0 * a * by_xx + b * by_xy) / kept;
                }
            }
        }
    }
    (total / kept, x_bar)
}

#[test]
fn ssim_agrees_with_golden_arrays() {
    let Some(file) = golden("loss_ssim") else { return };
    let f = |name: &str| array(&file, name);
    let narrow = |name: &str| f(name).into_iter().map(|v| v as f32).collect::<Vec<_>>();
    let (x, y, bar) = (narrow("x"), narrow("y"), f("value_bar")[0] as f32);
    let input = In { x: &x, y: &y, mask: None, height: 33, width: 29 };
    let (value, saved) = ssim::forward(&input).unwrap();
    let (mut x_bar, mut y_bar) = (vec![0.0; x.len()], vec![0.0; y.len()]);
    ssim::adjoint(&input, &saved, bar, &mut x_bar, Some(&mut y_bar));
    let error = (f64::from(value) - f("value")[0]).abs();
    let (ex, ey) = (relative_l2(&x_bar, &f("x_bar")), relative_l2(&y_bar, &f("y_bar")));
    println!("ssim golden: value {error:.2e}, x_bar {ex:.2e}, y_bar {ey:.2e}");
    assert!(error <= 2e-6, "value differs by {error:e}");
    assert!(ex <= 2e-5 && ey <= 2e-5, "gradients differ by {ex:e}, {ey:e}");
    let metric = metric::ssim::forward(&input).unwrap();
    assert!((metric - f("value")[0]).abs() <= 1e-13, "the f64 metric gives {metric}");
    let mut alone = vec![0.0; x.len()];
    ssim::adjoint(&input, &saved, bar, &mut alone, None);
    assert_eq!(alone, x_bar, "x_bar does not depend on whether y_bar is wanted");
}

#[test]
fn ssim_agrees_with_the_textbook_form_in_f64() {
    let (height, width) = (37, 41);
    for (e, with_mask) in
        [(0.8, false), (0.1, false), (0.01, false), (1e-3, false), (0.3, true), (0.02, true)]
    {
        let (x, y) = pictures(height, width, e);
        let mask = with_mask.then(|| checker(height, width));
        let wide = |v: &[f32]| v.iter().map(|&v| f64::from(v)).collect::<Vec<_>>();
        let (want, want_bar) = textbook(&wide(&x), &wide(&y), mask.as_deref(), height, width);
        let input = In { x: &x, y: &y, mask: mask.as_deref(), height, width };
        let (value, saved) = ssim::forward(&input).unwrap();
        let mut x_bar = vec![0.0; x.len()];
        ssim::adjoint(&input, &saved, 1.0, &mut x_bar, None);
        let (ev, eg) = ((f64::from(value) - want).abs(), relative_l2(&x_bar, &want_bar));
        println!("error {e}, mask {with_mask}: value {want:.6} off by {ev:.1e}, gradient by {eg:.1e}");
        assert!(ev <= 2e-6, "value off by {ev:e} at error {e}");
        assert!(eg <= 2e-5, "gradient off by {eg:e} at error {e}");
    }
}

#[test]
fn ssim_of_equal_images_is_one_without_gradient() {
    for (height, width) in [(1, 1), (2, 3), (7, 5), (33, 29), (40, 16)] {
        let (x, _) = pictures(height, width, 0.4);
        for mask in [None, Some(checker(height, width))] {
            let mask = mask.filter(|m| m.contains(&1.0));
            let input = In { x: &x, y: &x, mask: mask.as_deref(), height, width };
            let (value, saved) = ssim::forward(&input).unwrap();
            assert_eq!(value, 1.0, "{height}x{width}");
            let mut x_bar = vec![0.0; x.len()];
            ssim::adjoint(&input, &saved, 1.0, &mut x_bar, None);
            assert!(x_bar.iter().all(|&g| g == 0.0), "no gradient where the images agree");
            assert_eq!(metric::ssim::forward(&In { y: &clamp(&x), ..input }).unwrap(), 1.0);
        }
    }
}

fn clamp(x: &[f32]) -> Vec<f32> {
    x.iter().map(|&v| lastlight::num::order::clamp(v, 0.0, 1.0)).collect()
}

/// Away from the border the map of two constant images is (2ab + C1)/(a² + b² + C1); a mask that keeps only pixels
/// with all of their window inside would need the border too, so the closed form of the padded window is taken: with W
/// the window's weight inside the image, μ = aW and σ² = a²W(1 − W).
#[test]
fn ssim_of_constant_images_has_its_closed_form() {
    let (height, width) = (9, 14);
    let g: Vec<f64> = (0..11).map(|k| libm::exp(-f64::from((k - 5) * (k - 5)) / 4.5)).collect();
    let norm = g.iter().fold(0.0, |a, b| a + b);
    let inside = |at: usize, size: usize| -> f64 {
        (0..11).filter(|k| (5..size + 5).contains(&(at + k))).fold(0.0, |a, k| a + g[k] / norm)
    };
    for (a, b) in [(1.0f32, 0.0f32), (0.0, 1.0), (0.25, 0.75), (1.0, 0.9), (0.5, 0.5), (0.0, 0.0)] {
        let (x, y) = (vec![a; height * width * 3], vec![b; height * width * 3]);
        let (a, b) = (f64::from(a), f64::from(b));
        let mut want = 0.0;
        for r in 0..height {
            for c in 0..width {
                let w = inside(r, height) * inside(c, width);
                let v = w * (1.0 - w);
                want += (2.0 * a * b * w * w + 1e-4) / ((a * a + b * b) * w * w + 1e-4)
                    * (2.0 * a * b * v + 9e-4)
                    / ((a * a + b * b) * v + 9e-4);
            }
        }
        want /= (height * width) as f64;
        let input = In { x: &x, y: &y, mask: None, height, width };
        let (value, _) = ssim::forward(&input).unwrap();
        assert!((f64::from(value) - want).abs() <= 1e-6, "{a} {b}: {value} instead of {want}");
        let metric = metric::ssim::forward(&input).unwrap();
        assert!((metric - want).abs() <= 1e-13, "{a} {b}: {metric} instead of {want}");
    }
}

#[test]
fn ssim_is_symmetric_in_bits() {
    let (x, y) = pictures(21, 19, 0.5);
    let there = In { x: &x, y: &y, mask: None, height: 21, width: 19 };
    let back = In { x: &y, y: &x, ..there };
    let ((v, s), (w, t)) = (ssim::forward(&there).unwrap(), ssim::forward(&back).unwrap());
    assert_eq!(v.to_bits(), w.to_bits());
    let mut bars = vec![vec![0.0; x.len()]; 4];
    let [a, b, c, d] = bars.get_disjoint_mut([0, 1, 2, 3]).unwrap();
    ssim::adjoint(&there, &s, 1.3, a, Some(b));
    ssim::adjoint(&back, &t, 1.3, c, Some(d));
    assert_eq!((a, b), (d, c), "gradients change places");
}

type Run = fn(&In<'_>, f32, &mut [f32], &mut [f32]) -> f32;

fn operators() -> [(&'static str, Run); 3] {
    macro_rules! run {
        ($m:ident) => {
            |x, bar, x_bar, y_bar| {
                let (value, saved) = $m::forward(x).expect("the input is valid");
                $m::adjoint(x, &saved, bar, x_bar, Some(y_bar));
                value
            }
        };
    }
    [("l1", run!(l1)), ("mse", run!(mse)), ("ssim", run!(ssim))]
}

#[test]
fn adjoints_are_linear_accumulate_and_vanish_in_bits() {
    let (height, width) = (23, 18);
    let (x, y) = pictures(height, width, 0.3);
    let mask = checker(height, width);
    for (name, run) in operators() {
        for mask in [None, Some(&mask[..])] {
            let input = In { x: &x, y: &y, mask, height, width };
            let n = x.len();
            let bars = |bar: f32, start: f32| {
                let (mut a, mut b) = (vec![start; n], vec![start; n]);
                run(&input, bar, &mut a, &mut b);
                [a, b].concat()
            };
            let (one, two, zero, onto) = (bars(0.7, 0.0), bars(1.4, 0.0), bars(0.0, 0.0), bars(0.7, 3.0));
            assert!(one.iter().any(|&g| g != 0.0), "{name}: gradients exist");
            for i in 0..2 * n {
                assert_eq!(two[i].to_bits(), (2.0 * one[i]).to_bits(), "{name}: linear");
                assert_eq!(zero[i], 0.0, "{name}: zero");
                assert_eq!(onto[i], 3.0 + one[i], "{name}: accumulates");
                if let Some(mask) = mask
                    && mask[i % n / 3] == 0.0
                {
                    assert_eq!(one[i], 0.0, "{name}: left-out pixels get nothing");
                }
            }
        }
    }
}

#[test]
fn bits_do_not_depend_on_thread_count() {
    let (height, width) = (45, 52);
    let (x, y) = pictures(height, width, 0.3);
    let mask = checker(height, width);
    for (name, run) in operators() {
        let result = |threads| {
            with_threads(threads, || {
                let input = In { x: &x, y: &y, mask: Some(&mask), height, width };
                let (mut a, mut b) = (vec![0.0f32; x.len()], vec![0.0f32; x.len()]);
                let value = run(&input, 1.0, &mut a, &mut b);
                let metrics = [
                    metric::ssim::forward(&input).unwrap(),
                    metric::psnr::forward(&input).unwrap().mse,
                    metric::mae::forward(&input).unwrap(),
                ];
                (value.to_bits(), a, b, metrics.map(f64::to_bits))
            })
            .unwrap()
        };
        let one = result(1);
        assert!(one == result(2) && one == result(7), "{name}");
    }
}

#[test]
fn l1_and_mse_are_means_over_kept_values() {
    let x = [0.5, 0.25, 1.0, 0.0, 0.0, 0.0];
    let y = [0.25, 0.5, 1.0, 8.0, 8.0, 8.0];
    let input = In { x: &x, y: &y, mask: Some(&[1.0, 0.0]), height: 1, width: 2 };
    let (mut a, mut b) = ([0.0; 6], [0.0; 6]);
    let (value, saved) = l1::forward(&input).unwrap();
    l1::adjoint(&input, &saved, 3.0, &mut a, Some(&mut b));
    assert_eq!((value, a, b), (0.5 / 3.0, [1.0, -1.0, 0.0, 0.0, 0.0, 0.0], [-1.0, 1.0, 0.0, 0.0, 0.0, 0.0]));
    let (mut a, mut b) = ([0.0; 6], [0.0; 6]);
    let (value, saved) = mse::forward(&input).unwrap();
    mse::adjoint(&input, &saved, 3.0, &mut a, Some(&mut b));
    assert_eq!(
        (value, a, b),
        (0.125 / 3.0, [0.5, -0.5, 0.0, 0.0, 0.0, 0.0], [-0.5, 0.5, 0.0, 0.0, 0.0, 0.0])
    );
}

#[test]
fn bad_input_is_refused() {
    let image = [0.5; 12];
    let good = In { x: &image, y: &image, mask: None, height: 2, width: 2 };
    let nan = [0.5, 0.5, f32::NAN, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5];
    let cases = [
        ("nothing kept", In { mask: Some(&[0.0; 4]), ..good }, "at least one kept pixel"),
        ("soft mask", In { mask: Some(&[1.0, 0.5, 1.0, 1.0]), ..good }, "index [0, 1]"),
        ("NaN mask", In { mask: Some(&[1.0, 1.0, f32::NAN, 1.0]), ..good }, "index [1, 0]"),
        ("short mask", In { mask: Some(&[1.0; 3]), ..good }, "'mask'"),
        ("short image", In { y: &image[..9], ..good }, "'y'"),
        ("no pixel", In { x: &[], y: &[], height: 0, ..good }, "at least one kept pixel"),
        ("NaN", In { x: &nan, ..good }, "finite images"),
    ];
    for (name, input, text) in cases {
        let errors = [
            l1::forward(&input).map(|_| ()).unwrap_err(),
            mse::forward(&input).map(|_| ()).unwrap_err(),
            ssim::forward(&input).map(|_| ()).unwrap_err(),
            metric::psnr::forward(&input).map(|_| ()).unwrap_err(),
            metric::ssim::forward(&input).map(|_| ()).unwrap_err(),
            metric::mae::forward(&input).map(|_| ()).unwrap_err(),
        ];
        for e in errors {
            assert!(e.to_string().contains(text), "{name}: {e}");
        }
    }
    assert!(Crop::new(&good, [0, 0], [3, 1]).is_err() && Crop::new(&good, [1, 0], [1, 1]).is_err());
}

#[test]
fn metrics_have_their_closed_forms() {
    // The render is clamped, the photograph is not; MSE 0.01 is 20 dB.
    let (height, width) = (12, 12);
    let n = height * width * 3;
    let (x, y) = (vec![1.7f32; n], vec![1.0f32; n]);
    let same = metric::psnr::forward(&In { x: &x, y: &y, mask: None, height, width }).unwrap();
    assert_eq!((same.mse, same.db), (0.0, Decibel::Infinite));
    assert_eq!(same.db.to_string(), "∞ dB (identical)");
    let grey = vec![0.5f32; n];
    let input = In { x: &vec![0.25; n], y: &grey, mask: None, height, width };
    let p = metric::psnr::forward(&input).unwrap();
    assert_eq!(p.mse, 0.0625);
    assert!((p.db.finite().unwrap() - 12.041_199_826_559_248).abs() < 1e-13);
    assert_eq!(metric::mae::forward(&input).unwrap(), 0.25);
    // One channel off by ½, one by ¼, one equal: no finite mean of levels; the MSE stays.
    let mixed: Vec<f32> = (0..n).map(|i| [0.0, 0.25, 0.5][i % 3]).collect();
    let per = metric::psnr::per_channel(&In { x: &mixed, y: &grey, mask: None, height, width }).unwrap();
    assert_eq!((per.mse, per.db), ((0.25 + 0.0625) / 3.0, Decibel::Infinite));
    let shifted: Vec<f32> = (0..n).map(|i| [0.0, 0.25, 0.375][i % 3]).collect();
    let per = metric::psnr::per_channel(&In { x: &shifted, y: &grey, mask: None, height, width }).unwrap();
    assert!(
        (per.db.finite().unwrap() - 12.041_199_826_559_248).abs() < 1e-13,
        "¼, 1/16, 1/64: the mean level is that of 1/16"
    );
    // Two ways to average two images.
    let (a, b) = (
        metric::psnr::Psnr { mse: 0.01, db: Decibel::from_mse(0.01) },
        metric::psnr::Psnr { mse: 0.0001, db: Decibel::from_mse(0.0001) },
    );
    let mean = metric::psnr::mean_of_psnr(&[a, b]).unwrap().finite().unwrap();
    let pooled = metric::psnr::psnr_of_mean(&[a, b]).unwrap().db.finite().unwrap();
    assert!(
        (mean - 30.0).abs() < 1e-12 && (pooled - 22.967_086_218_813_387).abs() < 1e-12,
        "{mean} {pooled}"
    );
    assert_eq!(metric::psnr::mean_of_psnr(&[a, same]), Some(Decibel::Infinite));
    assert!(metric::psnr::mean_of_psnr(&[]).is_none() && metric::psnr::psnr_of_mean(&[]).is_none());
    assert_eq!(metric::ssim::d_ssim_1000(0.9), 500.0 * (1.0 - 0.9));
}

#[test]
fn a_box_is_the_cropped_image() {
    let (x, y) = pictures(20, 24, 0.2);
    let mask = checker(20, 24);
    let full = In { x: &x, y: &y, mask: Some(&mask), height: 20, width: 24 };
    let whole = Crop::new(&full, [0, 0], [20, 24]).unwrap();
    assert_eq!(metric::psnr::forward(&whole.view()).unwrap(), metric::psnr::forward(&full).unwrap());
    let crop = Crop::new(&full, [3, 5], [4, 7]).unwrap();
    let v = crop.view();
    assert_eq!((v.height, v.width), (1, 2));
    assert_eq!(v.x, &x[(3 * 24 + 5) * 3..(3 * 24 + 7) * 3]);
    assert_eq!(v.mask.unwrap(), &mask[3 * 24 + 5..3 * 24 + 7]);
}

mod sets {
    //! Points and groups.

    use lastlight::loss::groups::{self, SPREAD, VARIANCE_FLOOR};
    use lastlight::loss::points::{self, Plan, Sigmas};

    const UNIT: Sigmas = Sigmas { xyz: 1.0, rgb: 0.5 };

    fn pair<'a>(x: &'a [f32], y: &'a [f32], batch: usize, channels: [usize; 2]) -> points::In<'a> {
        points::In { x, y, batch, channels, sigmas: UNIT }
    }

    #[test]
    fn ordered_points_cost_their_mean_weighted_square() {
        // 3² + 4² in space; a quarter in one colour, in units of a half
        let (x, y) = ([3.0, 0.0, 4.0, 0.5, 0.5, 0.75], [0.0, 0.0, 0.0, 0.5, 0.5, 0.5]);
        assert_eq!(points::ordered(&pair(&x, &y, 1, [6, 6])).expect("a value"), 25.25, "both parts");
        assert_eq!(
            points::ordered(&pair(&x, &y[..3], 1, [6, 3])).expect("a value"),
            25.0,
            "no colours known"
        );
        let twice: Vec<f32> = x.iter().chain(&y).copied().collect();
        let targets: Vec<f32> = y.iter().chain(&y).copied().collect();
        assert_eq!(
            points::ordered(&pair(&twice, &targets, 2, [6, 6])).expect("a value"),
            12.625,
            "two items"
        );
        let mut bar = [1.0_f32; 6];
        points::adjoint(&pair(&x, &y[..3], 1, [6, 3]), None, 2.0, &mut bar, None).expect("gradients");
        assert_eq!(bar, [13.0, 1.0, 17.0, 1.0, 1.0, 1.0], "added to what is there; none for colours");
    }

    #[test]
    fn equally_near_points_go_to_the_lowest_index() {
        let x = [0.0, 0.0, 0.0, 5.0, 0.0, 0.0];
        let y = [-1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        let sets = pair(&x, &y, 1, [3, 3]);
        let plan = points::plan(&sets).expect("a plan");
        assert_eq!(plan, Plan { nearest_x: vec![0, 1], nearest_y: vec![0, 0, 0] }, "nearest");
        // (1 + 16)/2 + (1 + 1 + 1)/3
        assert_eq!(points::chamfer(&sets, &plan).expect("a value"), 9.5, "value");
        let e = points::ordered(&sets).expect_err("numbers differ").to_string();
        assert!(e.contains("Chamfer"), "{e}");
        let wrong = Plan { nearest_x: vec![0, 3], ..plan };
        let e = points::chamfer(&sets, &wrong).expect_err("no such row").to_string();
        assert!(e.contains("nearest_x"), "{e}");
    }

    #[test]
    fn points_that_cannot_be_compared_are_refused() {
        for channels in [[3, 6], [4, 4], [6, 4]] {
            let e = points::ordered(&pair(&[0.0; 12], &[0.0; 12], 1, channels)).expect_err("refused");
            assert!(e.to_string().contains("3 or 6"), "{channels:?}: {e}");
        }
        let e = points::ordered(&pair(&[0.0; 7], &[0.0; 6], 1, [3, 3])).expect_err("refused");
        assert!(e.to_string().contains("'x'"), "{e}");
        for xyz in [0.0, -1.0, f64::NAN, 1e-30] {
            let sets =
                points::In { sigmas: Sigmas { xyz, rgb: 1.0 }, ..pair(&[0.0; 3], &[0.0; 3], 1, [3, 3]) };
            let e = points::ordered(&sets).expect_err("refused").to_string();
            assert!(e.contains("sigma_x"), "{xyz}: {e}");
        }
        assert!(points::ordered(&pair(&[f32::NAN, 0.0, 0.0], &[0.0; 3], 1, [3, 3])).is_err(), "no number");
    }

    /// Two groups for factor 0, one for factor 1; two members, two factors of one number.
    fn three(after: &[f64; 12]) -> groups::In<'_> {
        groups::In {
            after,
            eps: &[0.5; 12],
            eps_after: &[0.5; 12],
            target: &[0, 1, 0],
            variance: &[0.0, 4.0],
            given: None,
            members: 2,
            factors: 2,
            size: 1,
        }
    }

    #[test]
    fn groups_by_hand() {
        // values of the groups: 0.5, 3, 1.5; factor 0 spreads by ½, more than a quarter
        let after = [0.0, 9.0, 1.0, 9.0, 9.0, 2.0, 9.0, 4.0, 1.5, 9.0, 1.5, 9.0];
        let out = groups::forward(&three(&after)).expect("losses");
        assert_eq!(out.shared, [0.5, 3.0, 1.5], "values");
        assert_eq!(out.invariant, 0.0, "no cause changed");
        assert_eq!(out.spread, 0.0, "factor 1 has one group and is left out");
        let floor = VARIANCE_FLOOR;
        assert_eq!(out.equal, (0.5 / floor + 2.0 / 4.0) / 6.0, "the floor of the variance holds");
        // closer together: V = (0.2)²/2
        let after = [0.5, 9.0, 0.5, 9.0, 9.0, 2.0, 9.0, 4.0, 0.7, 9.0, 0.7, 9.0];
        let x = three(&after);
        let out = groups::forward(&x).expect("losses");
        assert!((out.spread - (SPREAD - 0.02)).abs() < 1e-15, "lacking spread: {}", out.spread);
        let mut bar = groups::InBar::zeros_like(&x);
        let only_spread = groups::Out { spread: 1.0, shared: vec![0.0; 3], ..groups::Out::default() };
        groups::adjoint(&x, &out, &only_spread, &mut bar);
        // dV/dv = ±0.2, shared by two members, drives the values apart
        let want = [0.1, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, -0.1, 0.0, -0.1, 0.0];
        for (i, (got, want)) in bar.after.iter().zip(want).enumerate() {
            assert!((got - want).abs() < 1e-15, "entry {i}: {got}");
        }
    }

    #[test]
    fn given_values_are_what_members_are_held_to() {
        let after = [0.0, 9.0, 1.0, 9.0, 9.0, 2.0, 9.0, 4.0, 1.5, 9.0, 1.5, 9.0];
        let given = [0.25, 3.0, 0.25];
        let x = groups::In { given: Some(&given), ..three(&after) };
        let x = groups::In { variance: &[1.0, 4.0], ..x };
        let out = groups::forward(&x).expect("losses");
        assert_eq!(out.shared, given, "not the means 0.5, 3, 1.5");
        // (0.25² + 0.75²) + 2·1.25² in the units of factor 0, (1 + 1)/4 of factor 1
        assert_eq!(out.equal, (0.0625 + 0.5625 + 3.125 + 0.5) / 6.0, "distances from what was given");
        assert_eq!(out.spread, SPREAD, "two equal values do not vary");
        let mut bar = groups::InBar::zeros_like(&x);
        let cotangent = groups::Out { equal: 3.0, shared: vec![0.0, 0.0, 7.0], ..groups::Out::default() };
        groups::adjoint(&x, &out, &cotangent, &mut bar);
        let want = [-0.25, 0.0, 0.75, 0.0, 0.0, -0.25, 0.0, 0.25, 1.25, 0.0, 1.25, 0.0];
        assert_eq!(bar.after, want, "towards what was given; nothing of the value's own gradient");
        assert_eq!(bar.given, [-0.5, 0.0, -2.5 + 7.0], "the opposite, and the value's own");
        let e = groups::forward(&groups::In { given: Some(&[1.0]), ..x }).expect_err("too few").to_string();
        assert!(e.contains("'given'"), "{e}");
    }

    #[test]
    fn one_factor_has_no_others() {
        let x = groups::In {
            after: &[1.0, 2.0],
            eps: &[0.0, 0.0],
            eps_after: &[3.0, 4.0],
            target: &[0, 0],
            variance: &[1.0],
            given: None,
            members: 1,
            factors: 1,
            size: 1,
        };
        let out = groups::forward(&x).expect("losses");
        assert_eq!((out.invariant, out.equal, out.spread), (0.0, 0.0, 0.0), "nothing to compare");
        let mut bar = groups::InBar::zeros_like(&x);
        let ones = groups::Out { equal: 1.0, invariant: 1.0, spread: 1.0, shared: vec![0.0; 2] };
        groups::adjoint(&x, &out, &ones, &mut bar);
        assert_eq!(bar, groups::InBar::zeros_like(&x), "no gradient");
        let e =
            groups::forward(&groups::In { target: &[0, 1], ..x }).expect_err("no such factor").to_string();
        assert!(e.contains("entry 1"), "{e}");
        let e = groups::forward(&groups::In { target: &[], ..x }).expect_err("empty").to_string();
        assert!(e.contains("at least one group"), "{e}");
    }
}
