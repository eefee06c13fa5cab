//! Image metrics.

use super::{checker, pictures};
use lastlight::loss::In;
use lastlight::loss::metric::psnr::Decibel;
use lastlight::loss::metric::{self, Crop};

#[test]
fn metrics_have_their_closed_forms() {
    // The render is clamped, the photo is not; MSE 0.01 is 20 dB.
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
