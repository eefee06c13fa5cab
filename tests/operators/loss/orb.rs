//! Scores of Stanford-ORB against values that NumPy and SciPy compute from the definitions (erosion: a minimum filter of 5×5
//! with 1 beyond the border; window: a convolution with mirrored border), and closed forms.

use lastlight::loss::metric::orb::{self, Depth, In};
use lastlight::loss::metric::psnr::Decibel;

const SIZE: [usize; 2] = [14, 17];
/// Scale and error of depth.
const DEPTH: [f64; 2] = [1.9312413940047108, 0.19857103174634877];
const PIXELS: usize = SIZE[0] * SIZE[1];

/// The render.
fn render() -> Vec<f32> {
    (0..3 * PIXELS).map(|i| (((37 * i * i + 11 * i) % 256) as f64 / 96.0) as f32).collect()
}

/// A truth that is not like it.
fn other() -> Vec<f32> {
    (0..3 * PIXELS).map(|i| (((29 * i * i + 91 * i + 7) % 256) as f64 / 64.0) as f32).collect()
}

/// A truth that is the render times a factor per channel, and a small error.
fn like(x: &[f32]) -> Vec<f32> {
    let off = |i: usize| 0.03125 * ((i % 7) as f64 - 3.0);
    (0..x.len()).map(|i| (f64::from(x[i]) * [0.5, 0.75, 1.25][i % 3] + off(i)) as f32).collect()
}

/// A disc with a hole of one pixel, and a bar that reaches the border of the image.
fn foreground() -> Vec<f32> {
    let value = |p: usize| {
        let (r, c) = ((p / SIZE[1]) as i64, (p % SIZE[1]) as i64);
        if c >= 12 && (5..=11).contains(&r) {
            1.0
        } else if (r, c) == (4, 5) {
            0.4
        } else {
            f32::from(u8::from((r - 6) * (r - 6) + (c - 8) * (c - 8) <= 36))
        }
    };
    (0..PIXELS).map(value).collect()
}

fn input<'a>(x: &'a [f32], y: &'a [f32], foreground: &'a [f32]) -> In<'a> {
    In { x, y, foreground, height: SIZE[0], width: SIZE[1] }
}

fn close(what: &str, got: Decibel, expected: f64) {
    let got = got.finite().expect("finite");
    assert!((got - expected).abs() < 1e-9, "{what}: {got} and {expected}");
}

#[test]
fn they_are_those_that_numpy_computes() {
    let (x, fg) = (render(), foreground());
    let eroded = orb::erode(&fg, SIZE);
    let count = |m: &[bool]| m.iter().filter(|m| **m).count();
    assert_eq!((count(&orb::mask(&fg)), count(&eroded)), (135, 46), "the hole erodes, the border does not");
    assert!(eroded[8 * SIZE[1] + 16], "a pixel at the border of the image");
    let y = other();
    let pair = input(&x, &y, &fg);
    close("PSNR-H", orb::psnr_h(&pair).unwrap(), 2.630698679523424);
    close("PSNR-L", orb::psnr_l(&orb::aligned(&pair).unwrap()), 18.936451262652124);
    close("PSNR-A", orb::psnr_albedo(&pair).unwrap(), 15.594444481135099);
    let z = like(&x);
    let pair = input(&x, &z, &fg);
    let images = orb::aligned(&pair).unwrap();
    close("PSNR-H", orb::psnr_h(&pair).unwrap(), 30.296598016942944);
    close("PSNR-L", orb::psnr_l(&images), 35.8011270108796);
    close("PSNR-A", orb::psnr_albedo(&pair).unwrap(), 33.935594538514245);
    close("PSNR-mask", orb::psnr_inside(&pair, false).unwrap().unwrap(), 26.288423112903693);
    close("PSNR-eroded", orb::psnr_inside(&pair, true).unwrap().unwrap(), 28.66293575713022);
    for (s, expected) in images.scales.iter().zip([0.49538285, 0.75217243, 1.25167584]) {
        assert!((s - expected).abs() < 1e-8, "{s} and {expected}");
    }
    let ssim = orb::ssim3(&images).unwrap();
    assert!((ssim - 0.9980840822239704).abs() < 1e-12, "{ssim}");
    let [twice, _] = images.encoded_twice();
    let brightest = |v: &[f32]| v.iter().fold(0.0f32, |m, v| if *v > m { *v } else { m });
    let once: Vec<f32> = images.x.iter().map(|v| *v as f32).collect();
    assert!(
        twice.iter().zip(&once).all(|(a, b)| a >= b) && brightest(&twice) <= 1.0,
        "encoded twice is brighter, within 0..1"
    );
}

#[test]
fn normals_and_depth_are_those_that_numpy_computes() {
    let (x, fg) = (render(), foreground());
    let z = like(&x);
    let a = |i: usize| f64::from(x[i]) - 1.25;
    let b = |i: usize| a(i) + 0.25 * (f64::from(z[i]) - 0.5);
    let rows = |f: &dyn Fn(usize) -> f64| -> Vec<[f32; 3]> {
        (0..PIXELS).map(|p| std::array::from_fn(|k| f(3 * p + k) as f32)).collect()
    };
    let error = orb::normals(&rows(&a), &rows(&b), &fg, SIZE).unwrap().unwrap();
    assert!((error - 0.017843969398051593).abs() < 1e-12, "{error}");
    let channel = |image: &[f32], c: usize, scale: f64, add: f64| -> Vec<f32> {
        (0..PIXELS).map(|p| (f64::from(image[3 * p + c]) * scale + add) as f32).collect()
    };
    // The second view sees nothing: its depth counts as 1.
    let (near, nothing) = (channel(&x, 0, 1.0, 1.0), vec![0.0; PIXELS]);
    let (first, second) = (channel(&z, 0, 2.0, 3.0), channel(&z, 1, 1.0, 2.0));
    let views = [
        Depth { x: &near, y: &first, foreground: &fg, size: SIZE },
        Depth { x: &nothing, y: &second, foreground: &fg, size: SIZE },
    ];
    let [scale, error] = orb::depth(&views).unwrap().unwrap();
    assert!((scale - DEPTH[0]).abs() < 1e-9 && (error - DEPTH[1]).abs() < 1e-9, "{scale}, {error}");
    // Depth that is a multiple of the truth has no error; the scale belongs to the scene, not to the view.
    let half: Vec<f32> = first.iter().map(|z| 0.5 * z).collect();
    let same = Depth { x: &half, y: &first, foreground: &fg, size: SIZE };
    assert_eq!(orb::depth(&[same]).unwrap(), Some([2.0, 0.0]), "one view");
    let full = Depth { x: &first, ..same };
    let [scale, error] = orb::depth(&[same, full]).unwrap().unwrap();
    assert!(scale > 1.0 && scale < 2.0 && error > 0.0, "two scales do not exist: {scale}, {error}");
    assert_eq!(orb::depth(&[]).unwrap(), None);
    // Nothing seen: cos is 0.
    let up = vec![[0.0, 0.0, 1.0]; PIXELS];
    let error = orb::normals(&vec![[0.0; 3]; PIXELS], &up, &fg, SIZE).unwrap();
    assert_eq!(error, Some(1.0));
    assert_eq!(orb::normals(&up, &up, &vec![0.0; PIXELS], SIZE).unwrap(), None, "no foreground");
}

#[test]
fn closed_forms_hold() {
    let fg = vec![1.0; PIXELS];
    let y: Vec<f32> = render();
    // A scale per channel is no error, and the whole image counts.
    let scaled: Vec<f32> = y.iter().enumerate().map(|(i, y)| y * [0.5, 2.0, 4.0][i % 3]).collect();
    let pair = input(&scaled, &y, &fg);
    assert_eq!(orb::psnr_h(&pair).unwrap(), Decibel::Infinite);
    let images = orb::aligned(&pair).unwrap();
    assert_eq!((images.scales, orb::psnr_l(&images)), ([2.0, 0.5, 0.25], Decibel::Infinite));
    // 10⁻¹² in the denominator is 1.1·10⁻⁵ of its smallest value, C₁C₂.
    let off = 1.0 - orb::ssim3(&images).unwrap();
    assert!((0.0..1.2e-5).contains(&off), "equal images: {off}");
    // The mean is over the whole image: the same error on a quarter of it is 6.02 dB more.
    let grey = vec![0.64; 3 * PIXELS];
    let mut off = grey.clone();
    // Half of the pixels too dark, half too bright: the scale is that of least squares.
    off.as_chunks_mut::<3>().0.iter_mut().enumerate().for_each(|(p, v)| {
        *v = [if p % 2 == 0 { 0.6 } else { 0.7 }; 3];
    });
    let inside =
        |fg: &[f32]| orb::psnr_inside(&input(&off, &grey, fg), true).unwrap().unwrap().finite().unwrap();
    let whole = orb::psnr_l(&orb::aligned(&input(&off, &grey, &fg)).unwrap()).finite().unwrap();
    assert!((whole - inside(&fg)).abs() < 1e-12, "no background");
    let part: Vec<f32> = (0..PIXELS).map(|p| if p / SIZE[1] < 7 { 1.0 } else { 0.0 }).collect();
    let count = orb::erode(&part, SIZE).iter().filter(|m| **m).count();
    assert_eq!(count, 5 * SIZE[1], "two rows are eroded");
    let small = orb::psnr_l(&orb::aligned(&input(&off, &grey, &part)).unwrap()).finite().unwrap();
    let more = 10.0 * libm::log10(PIXELS as f64 / count as f64);
    assert!((small - inside(&part) - more).abs() < 1e-9, "{small}, {}, {more}", inside(&part));
    // A black render has no scale; the constant 0.5 bounds it.
    let black = vec![0.0; 3 * PIXELS];
    let images = orb::aligned(&input(&black, &grey, &fg)).unwrap();
    let encoded = 1.055 * libm::pow(0.64, 1.0 / 2.4) - 0.055;
    let bound = -20.0 * libm::log10(encoded - 0.5);
    assert!((orb::psnr_l(&images).finite().unwrap() - bound).abs() < 1e-6, "the bound is {bound}");
    assert_eq!(orb::psnr_inside(&input(&grey, &grey, &vec![0.0; PIXELS]), false).unwrap(), None);
    // What cannot be scored is refused.
    let mut bad = grey.clone();
    bad[5] = f32::NAN;
    for (x, y) in [(&bad, &grey), (&grey, &bad)] {
        assert!(orb::aligned(&input(x, y, &fg)).unwrap_err().to_string().contains("value 5"));
    }
    bad[5] = -0.1;
    assert!(
        orb::aligned(&input(&bad, &grey, &fg)).is_err() && orb::aligned(&input(&grey, &bad, &fg)).is_ok()
    );
    assert!(orb::psnr_h(&input(&grey[3..], &grey, &fg)).is_err(), "sizes");
}
