//! `loss.lpips` beyond the golden arrays: what it must be for any weights, the file of weights, and what is
//! refused.

use crate::lpips_weights::torchvision;
use lastlight::io::safetensors;
use lastlight::loss::lpips::{self, CONVOLUTIONS, In, Plan, TAPS, Weights};
use lastlight::num::array::Arrays;
use lastlight::num::par::with_threads;
use lastlight::num::rng::Rng;
use std::collections::{BTreeMap, BTreeSet};

const CHANNELS: [usize; 13] = [4, 5, 6, 4, 5, 6, 7, 6, 5, 6, 7, 6, 8];

/// Arrays of a slim network.
fn slim() -> Arrays {
    let rng = Rng::new(1);
    let mut arrays = Arrays::new();
    let mut draw = |name: String, shape: &[usize], low: f32, high: f32| {
        let (mut n, step) = (1, arrays.0.len() as u32);
        shape.iter().for_each(|s| n *= s);
        let values: Vec<f32> =
            (0..n).map(|i| low + (high - low) * rng.uniform_f32(i as u64, step, 13, 0)).collect();
        arrays.put(&name, shape, values);
    };
    let mut inputs = 3;
    for (k, (at, ..)) in CONVOLUTIONS.into_iter().enumerate() {
        let bound = (6.0 / (9.0 * inputs as f32)).sqrt();
        draw(format!("features.{at}.weight"), &[CHANNELS[k], inputs, 3, 3], -bound, bound);
        draw(format!("features.{at}.bias"), &[CHANNELS[k]], 0.0, 0.2);
        inputs = CHANNELS[k];
    }
    for (j, tap) in TAPS.into_iter().enumerate() {
        draw(format!("lin{j}.model.1.weight"), &[1, CHANNELS[tap], 1, 1], 0.1, 1.0);
    }
    arrays
}

fn image(height: usize, width: usize, draw: u16) -> Vec<f32> {
    let rng = Rng::new(2);
    (0..3 * height * width).map(|i| rng.uniform_f32(i as u64, 0, 14, draw)).collect()
}

fn of<'a>(x: &'a [f32], y: &'a [f32], [height, width]: [usize; 2], weights: &'a Weights) -> In<'a> {
    In { x, y, height, width, rescale: true, weights }
}

#[test]
fn equal_images_are_at_distance_zero_without_gradient_and_the_two_change_places() {
    let weights = Weights::from_arrays(&slim()).unwrap();
    for size in [[16, 16], [33, 18], [40, 47]] {
        let (a, b) = (image(size[0], size[1], 0), image(size[0], size[1], 1));
        let (value, layers, saved) = lpips::forward(of(&a, &a, size, &weights), None).unwrap();
        assert_eq!((value, layers), (0.0, [0.0; 5]), "equal images");
        let mut bar = vec![0.0; a.len()];
        lpips::adjoint(of(&a, &a, size, &weights), &saved, 1.0, &mut bar, None);
        assert!(bar.iter().all(|g| *g == 0.0), "no gradient");
        let run = |x: &[f32], y: &[f32]| {
            let input = of(x, y, size, &weights);
            let (value, _, saved) = lpips::forward(input, None).unwrap();
            let (mut x_bar, mut y_bar) = (vec![0.0; x.len()], vec![0.0; x.len()]);
            lpips::adjoint(input, &saved, 1.5, &mut x_bar, Some(&mut y_bar));
            let mut alone = vec![0.0; x.len()];
            lpips::adjoint(input, &saved, 1.5, &mut alone, None);
            assert_eq!(alone, x_bar, "x_bar does not depend on whether y_bar is computed");
            (value.to_bits(), x_bar, y_bar)
        };
        let (there, back) = (run(&a, &b), run(&b, &a));
        assert!(f32::from_bits(there.0) > 0.0, "different images");
        assert_eq!(there.0, back.0, "symmetric in bits");
        assert!(there.1 == back.2 && there.2 == back.1, "gradients change places");
    }
}

#[test]
fn of_equal_entries_a_maximum_takes_the_first() {
    let weights = Weights::from_arrays(&slim()).unwrap();
    let size = [16, 16];
    let (gray, other) = (vec![0.25; 16 * 16 * 3], image(16, 16, 1));
    let (_, _, saved) = lpips::forward(of(&gray, &other, size, &weights), None).unwrap();
    let plan = saved.plan();
    // away from the border of a constant image every entry is the same
    let [rows, columns] = lpips::sizes(16, 16)[2];
    let channels = CHANNELS[1];
    for (r, q) in [(2, 2), (3, 4), (4, 3)] {
        for c in 0..channels {
            assert_eq!(plan.pool[0][(r * columns + q) * channels + c], 0, "row {r}, column {q} of {rows}");
        }
    }
    let again = lpips::forward(of(&gray, &other, size, &weights), Some(&plan)).unwrap();
    assert_eq!(again.2.relu, saved.relu, "a plan given back changes nothing");
    let last = Plan { pool: plan.pool.iter().map(|p| vec![3; p.len()]).collect(), ..plan };
    let moved = lpips::forward(of(&gray, &other, size, &weights), Some(&last)).unwrap();
    assert_ne!(moved.2.relu[2], saved.relu[2], "another plan is obeyed");
}

#[test]
fn weights_come_from_a_file_by_their_torchvision_names() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("vgg.safetensors");
    let formula = Weights::by_formula();
    let mut arrays = torchvision(&formula);
    let written: BTreeSet<String> = arrays.0.keys().cloned().collect();
    assert_eq!(written, lpips::names().into_iter().collect(), "all names");
    arrays.put("features.30.unused", &[1], vec![0.0_f32]);
    safetensors::write(&path, &arrays, &BTreeMap::new()).unwrap();
    assert!(Weights::load(&path).unwrap() == formula, "read back, in our order");
    let spoil = |how: &dyn Fn(&mut Arrays)| {
        let mut arrays = arrays.clone();
        how(&mut arrays);
        Weights::from_arrays(&arrays).map(|_| ()).unwrap_err().to_string()
    };
    let missing = spoil(&|a| drop(a.0.remove("features.7.bias")));
    assert!(missing.contains("features.7.bias"), "{missing}");
    let shape = spoil(&|a| a.put("features.0.weight", &[64, 3, 5, 5], vec![0.0_f32; 4800]));
    assert!(shape.contains("features.0.weight") && shape.contains("3, 3"), "{shape}");
    let nan = spoil(&|a| a.put("lin2.model.1.weight", &[1, 256, 1, 1], vec![f32::NAN; 256]));
    assert!(nan.contains("lin2.model.1.weight") && nan.contains("finite"), "{nan}");
    let slim = dir.path().join("slim.safetensors");
    safetensors::write(&slim, &self::slim(), &BTreeMap::new()).unwrap();
    let e = Weights::load(&slim).map(|_| ()).unwrap_err().to_string();
    assert!(e.contains("channels of VGG16"), "{e}");
    assert!(Weights::load(&dir.path().join("none")).is_err(), "no file");
    assert_eq!(lpips::NO_WEIGHTS, "LPIPS: no weights", "as reported by tools");
}

#[test]
fn as_a_metric_the_render_is_limited_and_what_is_left_out_is_black() {
    let weights = Weights::from_arrays(&slim()).unwrap();
    let (height, width) = (20, 24);
    let (x, y) = (image(height, width, 0), image(height, width, 1));
    let bright: Vec<f32> = x.iter().map(|v| if *v > 0.9 { v + 3.0 } else { *v }).collect();
    let limited: Vec<f32> = x.iter().map(|v| if *v > 0.9 { 1.0 } else { *v }).collect();
    let score = |x: &[f32], y: &[f32], mask: Option<&[f32]>| {
        lpips::score(&lastlight::loss::In { x, y, mask, height, width }, true, &weights).unwrap()
    };
    assert_eq!(score(&bright, &y, None), score(&limited, &y, None), "limited to 0..1");
    let mask: Vec<f32> = (0..height * width).map(|p| f32::from(u8::from(p / width < 12))).collect();
    let black = |v: &[f32]| v.iter().enumerate().map(|(i, v)| v * mask[i / 3]).collect::<Vec<f32>>();
    assert_eq!(score(&x, &y, Some(&mask)), score(&black(&x), &black(&y), None), "black in both");
    let raw = lpips::score(&lastlight::loss::In { x: &x, y: &y, mask: None, height, width }, false, &weights);
    assert_ne!(raw.unwrap(), score(&x, &y, None), "{} is another number", lpips::NAME_RAW);
}

#[test]
fn bits_of_lpips_do_not_depend_on_threads() {
    let weights = Weights::from_arrays(&slim()).unwrap();
    let size = [41, 38];
    let (a, b) = (image(41, 38, 0), image(41, 38, 1));
    let run = |threads| {
        with_threads(threads, || {
            let input = of(&a, &b, size, &weights);
            let (value, layers, saved) = lpips::forward(input, None).unwrap();
            let (mut x_bar, mut y_bar) = (vec![0.0; a.len()], vec![0.0; a.len()]);
            lpips::adjoint(input, &saved, 1.0, &mut x_bar, Some(&mut y_bar));
            (value.to_bits(), layers.map(f64::to_bits), x_bar, y_bar)
        })
        .unwrap()
    };
    let one = run(1);
    assert!(one == run(2) && one == run(7), "1, 2 and 7 threads");
}

#[test]
fn images_that_cannot_be_seen_are_refused() {
    let weights = Weights::from_arrays(&slim()).unwrap();
    let (small, good) = (vec![0.5; 15 * 20 * 3], vec![0.5; 16 * 20 * 3]);
    let mut nan = good.clone();
    nan[7] = f32::NAN;
    let cases = [
        ("too small", of(&small, &small, [15, 20], &weights), "at least 16x16"),
        ("another size", of(&good, &small, [16, 20], &weights), "'y'"),
        ("NaN", of(&nan, &good, [16, 20], &weights), "finite"),
    ];
    for (name, input, text) in cases {
        let e = lpips::forward(input, None).map(|_| ()).unwrap_err().to_string();
        assert!(e.contains(text), "{name}: {e}");
    }
}
