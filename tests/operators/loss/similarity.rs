//! SSIM against golden arrays, the textbook in f64 and closed forms.

use super::{checker, pictures};
use crate::common::golden;
use lastlight::loss::metric;
use lastlight::loss::{In, ssim};
use lastlight::num::array::Arrays;

fn array(a: &Arrays, name: &str) -> Vec<f64> {
    a.need(name).expect("the golden file holds it").to_f64()
}

fn relative_l2(got: &[f32], want: &[f64]) -> f64 {
    let (mut error, mut norm) = (0.0, 0.0);
    for (g, w) in got.iter().zip(want) {
        error += (f64::from(*g) - w) * (f64::from(*g) - w);
        norm += w * w;
    }
    (error / norm).sqrt()
}

/// Mean SSIM as the textbook writes it: f64, 121 taps per pixel; with the gradient by x from the chain rule
/// applied to the textbook's five moments.
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

/// Away from the border the map of two constant images is (2ab + C1)/(a² + b² + C1); a mask that keeps only
/// pixels with all of their window inside would need the border too, so the closed form of the padded window
/// is taken: with W the window's weight inside the image, μ = aW and σ² = a²W(1 − W).
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
