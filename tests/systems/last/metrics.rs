//! T14: image metrics in closed form, against scikit-image, and the box of a person.

use lastlight::loss::metric::{person, psnr, rfd, ssim, ssim_sk};
use lastlight::loss::{In, lpips};
use lastlight::num::par::with_threads;
use lastlight::scene::bound;
use lastlight::scene::camera::{Camera, Model};

/// The image of `ssim_sk.py`.
fn image(height: usize, width: usize, seed: usize) -> Vec<f32> {
    (0..height * width * 3)
        .map(|i| {
            let noise = (i * 7919 + seed * 104_729) % 251;
            let slope = (i / 3 % width) * 3 + (i / (3 * width)) * 2;
            ((noise / (1 + seed) + slope) % 256) as f32 / 256.0
        })
        .collect()
}

/// An image and one near it.
fn pair(height: usize, width: usize) -> [Vec<f32>; 2] {
    let x = image(height, width, 1);
    let y = x.iter().zip(image(height, width, 2)).map(|(x, z)| (7.0 * x + z) / 8.0).collect();
    [x, y]
}

fn of<'a>(x: &'a [f32], y: &'a [f32], height: usize, width: usize) -> In<'a> {
    In { x, y, mask: None, height, width }
}

#[test]
fn psnr_of_a_constant_error_is_its_level() {
    let (height, width) = (9, 14);
    let y = image(height, width, 1).iter().map(|v| 0.5 * v).collect::<Vec<_>>();
    let x: Vec<f32> = y.iter().map(|v| v + 0.125).collect();
    let p = psnr::forward(&of(&x, &y, height, width)).unwrap();
    assert_eq!(p.mse, 1.0 / 64.0, "⅛ everywhere");
    let level = 10.0 * libm::log10(64.0);
    assert!((p.db.finite().unwrap() - level).abs() < 1e-12, "{} instead of {level}", p.db);
}

#[test]
fn levels_per_channel_and_pooled_differ_by_the_known_amount() {
    // Errors a, b, b by channel: pooled −10 log₁₀((a² + 2b²)/3), per channel −(10/3) log₁₀(a² b⁴).
    let (height, width) = (12, 10);
    let y = vec![0.25f32; height * width * 3];
    for (a, b) in [(0.5f32, 0.125f32), (0.25, 0.0625), (0.03125, 0.5)] {
        let x: Vec<f32> = (0..y.len()).map(|i| 0.25 + if i % 3 == 0 { a } else { b }).collect();
        let input = of(&x, &y, height, width);
        let [pooled, by_channel] = [psnr::forward(&input), psnr::per_channel(&input)]
            .map(|p| p.unwrap().db.finite().expect("errors everywhere"));
        let (a, b) = (f64::from(a) * f64::from(a), f64::from(b) * f64::from(b));
        let gap = 10.0 * libm::log10((a + 2.0 * b) / 3.0) - 10.0 / 3.0 * libm::log10(a * b * b);
        assert!((by_channel - pooled - gap).abs() < 1e-12, "{by_channel} − {pooled} instead of {gap}");
    }
}

#[test]
fn an_error_inside_the_box_weighs_by_the_area_of_the_box() {
    let (height, width) = (16, 20);
    let y = vec![0.5f32; height * width * 3];
    let mask: Vec<f32> = (0..height * width).map(|p| f32::from(u8::from(p / width < 4))).collect();
    let x: Vec<f32> = (0..y.len()).map(|i| 0.5 + 0.25 * mask[i / 3]).collect();
    let full = psnr::forward(&of(&x, &y, height, width)).unwrap().db.finite().unwrap();
    let boxed = In { mask: Some(&mask), ..of(&x, &y, height, width) };
    let boxed = psnr::forward(&boxed).unwrap().db.finite().unwrap();
    assert!(
        (full - boxed - 10.0 * libm::log10(4.0)).abs() < 1e-12,
        "a quarter of the image: {full}, {boxed}"
    );
}

#[test]
fn ssim_sk_agrees_with_scikit_image() {
    // tests/systems/last/ssim_sk.py
    let theirs = [
        (7, 7, 1.0, 0.9852741829771193),
        (7, 7, 2.0, 0.9862264200615991),
        (24, 31, 1.0, 0.9864498913311698),
        (24, 31, 2.0, 0.987327217205288),
        (40, 19, 1.0, 0.9858847991981282),
        (40, 19, 2.0, 0.9868770041063426),
    ];
    for (height, width, range, want) in theirs {
        let [x, y] = pair(height, width);
        let got = ssim_sk::forward(&of(&x, &y, height, width), range).unwrap();
        println!("SSIM-sk {height}x{width}, range {range}: {got}, off by {:.1e}", (got - want).abs());
        assert!((got - want).abs() <= 1e-14, "{height}x{width}, range {range}: {got} instead of {want}");
    }
}

#[test]
fn equal_images_have_similarity_one_and_distance_zero_in_bits() {
    for (height, width) in [(7, 7), (12, 9), (33, 29)] {
        let x = image(height, width, 1);
        let mask: Vec<f32> = (0..height * width).map(|p| f32::from(u8::from(p % 5 != 1))).collect();
        for mask in [None, Some(&mask[..])] {
            let same = In { mask, ..of(&x, &x, height, width) };
            assert_eq!(ssim::forward(&same).unwrap(), 1.0, "SSIM-g");
            assert_eq!(ssim_sk::forward(&same, 1.0).unwrap(), 1.0, "SSIM-sk");
            assert_eq!(ssim_sk::forward(&same, 2.0).unwrap(), 1.0, "SSIM-sk-range2");
            assert_eq!(rfd::forward(&same).unwrap(), 0.0, "RFD");
        }
    }
}

#[test]
fn rfd_sees_structure_more_than_contrast_and_is_bounded() {
    let (height, width) = (40, 44);
    let x = image(height, width, 1);
    let gray = vec![0.5f32; x.len()];
    let value = |a: &[f32], b: &[f32]| rfd::forward(&of(a, b, height, width)).unwrap();
    // the same mean squared error: half the contrast, or the contrast kept and the pixels moved
    let faint: Vec<f32> = x.iter().map(|v| 0.8 * v).collect();
    let error = |a: &[f32]| a.iter().zip(&x).fold(0.0, |s, (a, b)| s + (a - b) * (a - b)) / x.len() as f32;
    let step = error(&faint).sqrt();
    let noisy: Vec<f32> =
        x.iter().enumerate().map(|(i, v)| if i * 7919 % 5 < 2 { v + step } else { v - step }).collect();
    let noisy: Vec<f32> = noisy.iter().map(|v| lastlight::num::order::clamp(*v, 0.0, 1.0)).collect();
    let (contrast, structure) = (value(&faint, &x), value(&noisy, &x));
    println!("RFD: contrast {contrast:.3}, noise {structure:.1}, grey {:.1}", value(&gray, &x));
    assert!(contrast < 0.1 * structure, "contrast {contrast}, structure {structure}");
    assert!(value(&gray, &x) > structure, "no structure is worse");
    assert_eq!(value(&gray, &x), value(&x, &gray), "symmetric in bits where both are in 0..1");
    let black = vec![0.0f32; x.len()];
    let worst = value(&black, &vec![1.0; x.len()]);
    assert!((900.0..=4000.0).contains(&worst), "black against white: {worst}");
    let sensor: Vec<f32> = (0..x.len()).map(|i| f32::from(u8::from(i * 7919 % 3 == 0)) / 1024.0).collect();
    let noise = value(&sensor, &black);
    assert!(noise < 0.002 * worst, "noise in black is no structure: {noise} of {worst}");
}

/// A pinhole at the origin looking along +z.
fn camera() -> Camera {
    Camera {
        rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        translation: [0.0; 3],
        focal_px: [40.0, 30.0],
        center_px: [16.0, 12.0],
        width: 32,
        height: 24,
        model: Model::Pinhole,
    }
}

#[test]
fn the_box_of_a_person_is_the_silhouette_of_its_faces() {
    let camera = camera();
    // Facing the camera: the near face covers all, 40·0.5/2 = 10 and 30·0.4/2 = 6 pixels to each side.
    let mask = bound::bound_mask(&camera, [[-0.5, -0.4, 2.0], [0.5, 0.4, 3.0]]).unwrap();
    for r in 0..24 {
        for c in 0..32 {
            let inside = (6..26).contains(&c) && (6..18).contains(&r);
            assert_eq!(mask[r * 32 + c], f32::from(u8::from(inside)), "pixel {r}, {c}");
        }
    }
    assert_eq!(bound::rectangle(&mask, 32), Some([[6, 6], [18, 26]]), "its rectangle");
    assert_eq!(bound::rectangle(&[0.0; 8], 4), None, "no one, no rectangle");
    // Off the axis every ray through a covered pixel meets the box, and every other one misses it.
    let (low, high) = ([0.1f32, -0.5, 1.2], [0.6, 0.2, 2.5]);
    let mask = bound::bound_mask(&camera, [low, high]).unwrap();
    let mut covered = 0;
    for (p, m) in mask.iter().enumerate() {
        let d = [((p % 32) as f64 + 0.5 - 16.0) / 40.0, ((p / 32) as f64 + 0.5 - 12.0) / 30.0, 1.0];
        let (mut near, mut far) = (0.0f64, f64::INFINITY);
        for k in 0..3 {
            let [a, b] = [f64::from(low[k]) / d[k], f64::from(high[k]) / d[k]];
            near = lastlight::num::order::max(near, lastlight::num::order::min(a, b));
            far = lastlight::num::order::min(far, lastlight::num::order::max(a, b));
        }
        assert_eq!(*m == 1.0, near <= far, "pixel {p}: {near}..{far}");
        covered += usize::from(*m == 1.0);
    }
    assert!(covered > 100, "{covered} pixels were covered");
    let behind = bound::bound_mask(&camera, [[-0.5, -0.4, -0.1], [0.5, 0.4, 3.0]]).unwrap_err();
    assert!(behind.to_string().contains("behind"), "{behind}");
    assert!(bound::bound_mask(&camera, [high, low]).is_err(), "an empty box");
    assert!(bound::bound_mask(&camera, [[f32::NAN; 3], high]).is_err(), "a box of NaN");
    let b = bound::bounds(&[[0.0, 1.0, 2.0], [-1.0, 3.0, 2.0]], 0.5).unwrap();
    assert_eq!(b, [[-1.5, 0.5, 1.5], [0.5, 3.5, 2.5]], "widened bounds");
    assert!(bound::bounds(&[], 0.5).is_err(), "no point");
}

#[test]
fn scores_of_a_person_are_those_of_the_metrics() {
    let [x, y] = pair(24, 32);
    let mask = bound::bound_mask(&camera(), [[-0.5, -0.4, 2.0], [0.5, 0.4, 3.0]]).unwrap();
    let full = of(&x, &y, 24, 32);
    let scores = person::forward(&full, &mask, None).unwrap();
    assert_eq!(scores.boxed, psnr::forward(&In { mask: Some(&mask), ..full }).unwrap(), "PSNR-box");
    assert_eq!(scores.ssim_sk, ssim_sk::forward(&full, 1.0).unwrap(), "SSIM-sk");
    let names: Vec<&str> = scores.named().iter().map(|(name, _)| *name).collect();
    assert!(names.iter().enumerate().all(|(i, n)| !names[..i].contains(n)), "every name once: {names:?}");
    assert!(names.iter().all(|n| !n.starts_with("LPIPS")), "the surrogate is never called LPIPS");
    assert!(scores.named().iter().all(|(_, v)| v.is_finite()), "numbers: {scores:?}");
    for rescale in [true, false] {
        let metric = lpips::Metric { weights: lpips::Weights::by_formula(), rescale };
        let with = person::forward(&full, &mask, Some(&metric)).unwrap();
        let named = with.named();
        assert_eq!(named[..names.len()], scores.named(), "the others are the same");
        let [whole, boxed] = metric.names();
        assert_eq!(named[names.len()], (whole, metric.score(&full).unwrap()), "of the full image");
        assert_eq!(named.len(), names.len() + 1, "a box of {} pixels has none", lpips::SMALLEST - 1);
        let everywhere = person::forward(&full, &[1.0; 24 * 32], Some(&metric)).unwrap();
        let [.., a, b] = &everywhere.named()[..] else { panic!("two of them") };
        assert_eq!((a.0, b.0, a.1), (whole, boxed, b.1), "a box around everything");
        let both = [with.clone(), everywhere];
        let mean = person::mean(&both).unwrap().named();
        assert_eq!((mean.len(), mean[names.len()].0), (names.len() + 1, whole), "what all views have");
        assert_eq!(person::mean(&[with.clone(), with.clone()]), Some(with), "a mean of it");
    }
    let mean = person::mean(&[scores.clone(), scores.clone()]).unwrap();
    assert_eq!(mean, scores, "the mean of two equal views is each of them");
    assert!(person::mean(&[]).is_none(), "nothing has no mean");
    assert!(person::forward(&full, &[0.0; 24 * 32], None).is_err(), "a box that covers nothing");
    let mut cleared = x.clone();
    bound::clear_outside(&mut cleared, &mask, [0.0, 0.5, 1.0]);
    assert_eq!(cleared[..3], [0.0, 0.5, 1.0], "outside is the background");
    let at = (10 * 32 + 10) * 3;
    assert_eq!(cleared[at..at + 3], x[at..at + 3], "inside is the image");
}

#[test]
fn bits_of_the_new_metrics_do_not_depend_on_threads() {
    let [x, y] = pair(45, 52);
    let mask: Vec<f32> = (0..45 * 52).map(|p| f32::from(u8::from(p % 7 != 3))).collect();
    let input = In { mask: Some(&mask), ..of(&x, &y, 45, 52) };
    let run = |threads| {
        let all = || [ssim_sk::forward(&input, 1.0).unwrap(), rfd::forward(&input).unwrap()];
        with_threads(threads, || all().map(f64::to_bits)).unwrap()
    };
    assert!(run(1) == run(2) && run(1) == run(7), "the same bits for 1, 2 and 7 threads");
}

#[test]
fn metrics_refuse_what_they_cannot_see() {
    let small = vec![0.5f32; 6 * 6 * 3];
    assert!(ssim_sk::forward(&of(&small, &small, 6, 6), 1.0).is_err(), "smaller than the window");
    assert!(rfd::forward(&of(&small[..3 * 3 * 3], &small[..3 * 3 * 3], 3, 3)).is_err(), "3x3");
    let x = vec![0.5f32; 8 * 8 * 3];
    let mut border = vec![0.0f32; 64];
    border[0] = 1.0;
    let only = In { mask: Some(&border), ..of(&x, &x, 8, 8) };
    assert!(ssim_sk::forward(&only, 1.0).is_err(), "no kept window");
    assert!(ssim_sk::forward(&of(&x, &x, 8, 8), 0.0).is_err(), "no range");
    let mut nan = x.clone();
    nan[50] = f32::NAN;
    for e in [ssim_sk::forward(&of(&x, &nan, 8, 8), 1.0), rfd::forward(&of(&x, &nan, 8, 8))] {
        assert!(e.unwrap_err().to_string().contains("finite images"), "NaN is refused");
    }
}
