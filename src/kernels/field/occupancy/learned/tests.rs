//! Bounds contain the values of random fields, and bounds that lack a margin or have a wrong sign do not.

use super::*;
use crate::num::rng::Rng;

const R: f32 = 0.8;
const SIDE: usize = 9;
const CHANNELS: usize = 7;

/// Numbers in −1..1.
fn numbers(n: usize, seed: u64) -> Vec<f32> {
    let rng = Rng::new(seed);
    (0..n).map(|i| 2.0 * rng.uniform_f32(i as u64, 0, 0, 0) - 1.0).collect()
}

/// Boxes of all sizes, some of one point, some that begin or end at a centre plane, some across it.
fn boxes(n: usize, seed: u64) -> Vec<Box3> {
    let drawn = numbers(8 * n, seed);
    let one = |(i, d): (usize, &[f32; 8])| {
        let size = if i % 7 == 0 { 0.0 } else { R * elem::exp(-4.0 + 4.0 * d[6]) };
        let mut low = [0, 1, 2].map(|k| 1.01 * R * d[k]);
        let mut high = [0, 1, 2].map(|k| low[k] + size * d[3 + k].abs());
        let k = i % 3;
        match i % 5 {
            0 => (low[k], high[k]) = (0.0, size + 1e-6),
            1 => (low[k], high[k]) = (-size, -0.0),
            2 => (low[k], high[k]) = (-0.3 * size, 0.7 * size),
            _ => {}
        }
        [low, high]
    };
    drawn.as_chunks::<8>().0.iter().enumerate().map(one).collect()
}

/// Points of a box: its corners and random ones.
fn points([low, high]: Box3, seed: u64) -> Vec<[f32; 3]> {
    let drawn = numbers(3 * 24, seed);
    let mut all: Vec<[f32; 3]> =
        (0..8).map(|c| [0, 1, 2].map(|k| if c >> k & 1 == 1 { high[k] } else { low[k] })).collect();
    for d in drawn.as_chunks::<3>().0 {
        all.push([0, 1, 2].map(|k| {
            let x = low[k] + (high[k] - low[k]) * (0.5 + 0.5 * d[k]);
            crate::num::order::clamp(x, low[k], high[k])
        }));
    }
    for x in &mut all {
        for k in 0..3 {
            // A lower end of 0 is no point of a larger box.
            if low[k] == 0.0 && high[k] > 0.0 && x[k] == 0.0 {
                x[k] = f32::MIN_POSITIVE;
            }
        }
    }
    all
}

/// Returns how many values are outside their bounds, and the mean width of bounds over that of values.
fn outside(learned: &Learned<'_>, seed: u64) -> (usize, f64) {
    let boxes = boxes(1500, seed);
    let (mut bounds, mut s) = (Vec::new(), Vec::new());
    learned.bounds(&boxes, &mut bounds);
    assert_eq!(bounds.len(), boxes.len());
    let (mut count, mut ratios) = (0, Vec::new());
    for (i, (b, [lo, hi])) in boxes.iter().zip(bounds).enumerate() {
        learned.values(&points(*b, seed + 1 + i as u64), &mut s);
        count += s.iter().filter(|s| !(lo <= **s && **s <= hi)).count();
        let [least, most] = s.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[a, b], s| {
            [crate::num::order::min(a, *s), crate::num::order::max(b, *s)]
        });
        if most - least > 0.02 * R {
            ratios.push(f64::from((hi - lo) / (most - least)));
        }
    }
    (count, ratios.iter().fold(0.0, |sum, r| sum + r) / ratios.len() as f64)
}

/// Runs a check on random fields of every form.
fn with_fields(mut check: impl FnMut(&str, Learned<'_>, u64)) {
    let forms: [(usize, Combine, &[usize]); 6] = [
        (6, Combine::Concat, &[8, 8, 1]),
        (3, Combine::Concat, &[12, 1]),
        (6, Combine::Sum, &[9, 5, 8, 1]),
        (3, Combine::Sum, &[8, 16, 4]),
        (6, Combine::Concat, &[1]),
        (3, Combine::Concat, &[4]),
    ];
    for (f, (count, combine, widths)) in forms.into_iter().enumerate() {
        let seed = 1000 * (f as u64 + 1);
        let values: Vec<f32> =
            numbers(count * SIDE * SIDE * CHANNELS, seed).iter().map(|v| 0.3 * v).collect();
        let mut inputs = combine.width(CHANNELS);
        let mut weights = Vec::new();
        for (l, n) in widths.iter().enumerate() {
            let scale = 1.5 / (inputs as f32).sqrt();
            weights.push(
                numbers(n * inputs, seed + 1 + l as u64).iter().map(|w| scale * w).collect::<Vec<f32>>(),
            );
            inputs = *n;
        }
        let views: Vec<&[f32]> = weights.iter().map(Vec::as_slice).collect();
        let network = Network { weights: &views, inputs: combine.width(CHANNELS) };
        let planes = Planes { values: &values, count, side: SIDE, channels: CHANNELS, half_size: R };
        let learned = Learned::new(planes, combine, &network).expect("finite numbers");
        check(&format!("{count} planes, {combine:?}, {widths:?}"), learned, seed);
    }
}

#[test]
fn bounds_contain_the_values_of_points() {
    with_fields(|name, learned, seed| {
        let (count, ratio) = outside(&learned, seed);
        println!("{name}: bounds {ratio:.2} times as wide as the values");
        assert_eq!(count, 0, "{name}");
        assert!(ratio < 8.0, "{name}: bounds are {ratio} times as wide as the values");
    });
}

#[test]
fn without_a_margin_or_with_a_wrong_sign_values_leave_their_bounds() {
    let (mut bare, mut all) = (0, 0);
    with_fields(|name, mut learned, seed| {
        learned.margins.fill(0.0);
        learned.lines.margin = 0.0;
        bare += outside(&learned, seed).0;
        all += 1;
        // The lower bounds of one side of the first layer, with the sign of the box turned.
        let turned: Vec<Box3> =
            boxes(300, seed).iter().map(|[low, high]| [high.map(|x| -x), low.map(|x| -x)]).collect();
        let (mut bounds, mut s) = (Vec::new(), Vec::new());
        learned.bounds(&turned, &mut bounds);
        let mut count = 0;
        for (b, [lo, hi]) in boxes(300, seed).iter().zip(bounds) {
            learned.values(&points(*b, seed), &mut s);
            count += s.iter().filter(|s| !(lo <= **s && **s <= hi)).count();
        }
        assert!(count > 100, "{name}: bounds of the box on the other side: {count} outside");
    });
    assert!(bare > 0, "{all} fields without margins: no value outside");
}

#[test]
fn swapped_parts_of_weights_are_no_bounds() {
    with_fields(|name, mut learned, seed| {
        if learned.layers.len() < 3 {
            return;
        }
        // w⁺ and w⁻ exchanged: the lower interval takes the larger ends.
        let (k, n) = (learned.layers[1].inputs, learned.layers[1].outputs);
        let weight = numbers(n * k, seed + 2);
        let scale = 1.5 / (k as f32).sqrt();
        let split: Vec<f32> =
            weight.iter().flat_map(|w| if *w > 0.0 { [0.0, scale * w] } else { [scale * w, 0.0] }).collect();
        assert!(outside(&learned, seed).0 == 0);
        learned.layers[1].parts = Packed::new(View::new(&split, n, 2 * k).t());
        assert!(outside(&learned, seed).0 > 0, "{name}: exchanged parts still bound");
    });
}
