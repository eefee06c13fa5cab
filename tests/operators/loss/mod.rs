//! Losses and image metrics: closed forms, invariances, an independent f64 evaluation, golden arrays.

mod metrics;
mod orb;
mod sets;
mod similarity;

use lastlight::loss::metric::{self, Crop};
use lastlight::loss::{In, l1, mse, ssim};
use lastlight::num::par::with_threads;

/// Uniform numbers in 0..1 by position, for test images only (splitmix64).
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

/// An image with flat, smooth and noisy parts, and a version of it with an error of size `e`.
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
