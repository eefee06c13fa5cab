//! First values: bounds, deviations, and what a plain model gives to a whole one.

use super::*;
use crate::nn::fuse;
use crate::num::order;

#[test]
fn counts_are_those_of_the_paper_and_of_the_arrays() {
    let paper = Config { is_whole: true, ..Config::PAPER };
    assert!((count(&paper) as f64 / 1e6 - 326.0).abs() < 1.0, "{}", count(&paper));
    let small = Config { is_whole: true, ..Config::SMALL };
    assert!((count(&small) as f64 / 1e6 - 5.8).abs() < 0.05, "{}", count(&small));
    for config in [Config::SMALL, small, Config { planes: 3, plane_tokens: 11, embed_tokens: 0, ..small }] {
        let arrays = first(&config, 0);
        assert_eq!(arrays.iter().fold(0, |sum, (_, a)| sum + a.len()), count(&config));
    }
}

#[test]
fn first_weights_are_those_of_their_directions() {
    let params = first(&Config::SMALL, 3);
    let (v, g) = (params.get("block/01/fc1/v").expect("there"), params.get("block/01/fc1/g").expect("there"));
    let row = v.index_axis(Axis(0), 7);
    let length = row.iter().fold(0.0, |s, x| s + f64::from(*x) * f64::from(*x)).sqrt();
    assert!((f64::from(g[7]) - length).abs() < 1e-7 * length);
    assert!((length / (0.04 * 16.0) - 1.0).abs() < 0.3, "√256 times the deviation: {length}");
}

/// Bounds and deviations of the issue and of PyTorch's layers: fans are written out.
#[test]
fn published_first_values_have_the_published_bounds() {
    let c = Config {
        first_values: FirstValues::Published,
        fuse: Fuse::Published,
        blocks: 1,
        is_whole: true,
        ..Config::SMALL
    };
    let params = first(&c, 5);
    let of = |name: &str| params.get(name).expect("an array");
    let extent = |name: &str| {
        let (low, high) = of(name)
            .iter()
            .fold((0.0_f32, 0.0_f32), |(low, high), x| (order::min(low, *x), order::max(high, *x)));
        (f64::from(low), f64::from(high))
    };
    for (name, bound) in [
        ("tokens/image", 1.0 / 192_f64.sqrt()),
        ("tokens/rays", 1.0 / 384_f64.sqrt()),
        ("unpatch/planes/v", 1.0 / 1024_f64.sqrt()),
        ("unpatch/panoramas/v", 1.0 / 1024_f64.sqrt()),
        ("block/00/qkv", (6.0 / (256.0 + 768.0_f64)).sqrt()),
        ("heads/color/1", 0.25 * (6.0 / 64_f64).sqrt()),
    ] {
        let (low, high) = extent(name);
        let bound = bound * (1.0 + 1e-6);
        assert!(-bound <= low && low < -0.98 * bound, "{name}: {low} beside {bound}");
        assert!(0.98 * bound < high && high <= bound, "{name}: {high} beside {bound}");
    }
    for (name, deviation) in [
        ("block/00/out", 0.02),
        ("block/00/fc1/v", 0.02),
        ("block/00/fc2/v", 0.02),
        ("fuse/w1", 0.02),
        ("fuse/w2", 0.02),
        ("places/planes", 1.0 / 8.0),
        ("places/panoramas", 1.0 / 4.0),
    ] {
        let square = of(name).iter().fold(0.0, |sum, x| sum + f64::from(*x) * f64::from(*x));
        let found = (square / of(name).len() as f64).sqrt();
        assert!((found / deviation - 1.0).abs() < 0.05, "{name}: {found} beside {deviation}");
    }
    let is_0 = |name: &str| of(name).iter().all(|x| *x == 0.0);
    assert!(is_0("tokens/photo") && is_0("tokens/bias") && is_0("block/00/qkv/bias"), "start at 0");
    let residual = first(&Config { fuse: Fuse::Residual, ..c }, 5);
    assert!(residual.get("fuse/w2").is_some_and(|w| w.iter().all(|x| *x == 0.0)), "P in every round");
}

#[test]
fn a_plain_model_becomes_a_whole_one_whose_heads_begin_with_its_colours() {
    let plain = first(&Config::SMALL, 1);
    let (whole, config) = extended(&plain, &Config::SMALL, 2).expect("all arrays");
    assert!(config.is_whole);
    let (old, new) = (plain.get("heads/color/0").expect("there"), whole.get("heads/color/0").expect("there"));
    assert_eq!((old.shape(), new.shape()), (&[32, 48][..], &[32, 64][..]));
    let drawn = first(&config, 2);
    let drawn = drawn.get("heads/color/0").expect("there");
    assert!((48..64).all(|k| new[[5, k]] == 0.5 * drawn[[5, k]]), "half of the drawn columns");
    assert_eq!(new[[5, 47]], old[[5, 47]]);
    for l in 0..4 {
        let own = |name: &str| whole.get(&format!("heads/{name}/{l}")).expect("there").clone();
        let color = plain.get(&format!("heads/color/{l}")).expect("there");
        assert_eq!(own("albedo"), color, "albedo begins as the colour");
        assert_eq!(l < 3, own("material") == color, "and material with its hidden layers");
    }
    let is_0 = |name: &str| whole.get(name).is_some_and(|a| a.iter().all(|w| *w == 0.0));
    assert!(is_0("heads/material/3") && is_0("heads/rho/2"), "the middle of the range");
    assert!(whole.get("tokens/photo").is_some_and(|a| a.iter().all(|w| *w == 0.0)));
    assert_eq!(plain.get("block/00/fc2/g"), whole.get("block/00/fc2/g"));
    let fewer = Config { material_layers: 2, ..Config::SMALL };
    let (other, _) = extended(&first(&fewer, 1), &fewer, 2).expect("all arrays");
    let shape = |name: &str| other.get(name).map(|a| a.shape().to_vec());
    assert_eq!(shape("heads/albedo/2").zip(shape("heads/material/2")), Some((vec![3, 32], vec![2, 32])));
    let is_0 = |name: &str| other.get(name).is_some_and(|a| a.iter().all(|w| *w == 0.0));
    assert!(is_0("heads/albedo/2") && is_0("heads/material/2"), "the middle of the range");
    assert!(
        other.get("heads/albedo/1") == other.get("heads/color/1"),
        "and the hidden layers of the colours"
    );
    let mut missing = plain.clone();
    missing.set("norm/gain", ArrayD::from_elem(IxDyn(&[3]), 1.0));
    let e = extended(&missing, &Config::SMALL, 2).expect_err("another shape").to_string();
    assert!(e.contains("norm/gain"), "{e}");
}

#[test]
fn the_layer_that_fuses_adds_every_second_channel_of_a_state() {
    let c = Config { blocks: 1, width: 16, heads: 2, plane_tokens: 1, embed_tokens: 1, ..Config::SMALL };
    let params = first(&c, 3);
    let of = |name: &str| params.get(name).expect("an array").as_slice().expect("contiguous");
    let state: Vec<f32> = (0..16).map(|i| 0.3 * i as f32 - 2.0).collect();
    let position: Vec<f32> = (0..16).map(|i| 1.0 - 0.1 * i as f32).collect();
    let [w1, w2, b1, b2] = ["fuse/w1", "fuse/w2", "fuse/w1/bias", "fuse/w2/bias"].map(of);
    let mut y = vec![0.0; 16];
    let rule = fuse::Rule::Residual;
    fuse::forward(&fuse::In { state: &state, position: &position, w1, b1, w2, b2, rule }, &mut y);
    for (i, y) in y.into_iter().enumerate() {
        let expected = position[i] + if i % 2 == 0 { state[i] } else { 0.0 };
        assert!((y - expected).abs() < 1e-6, "channel {i}: {y} and {expected}");
    }
}

#[test]
fn first_texels_are_smooth_and_rows_have_one_length() {
    let params = first(&Config::SMALL, 3);
    let v = params.get("unpatch/planes/v").expect("an array");
    let shape = |name: &str| params.get(name).expect("an array").shape().to_vec();
    assert_eq!(v.shape(), [256, 8, 8, 16]);
    assert_eq!(shape("unpatch/planes/g"), [256], "a length for every input channel");
    assert_eq!(shape("unpatch/planes/bias"), [16], "a bias for every output channel");
    assert!(lengths(v).iter().all(|x| (x - 1.0 / 3_f32.sqrt()).abs() < 1e-6), "rows");
    // Mean squares of the texels, and of the differences of neighbours; white noise has twice the first.
    let (mut square, mut difference) = (0.0, 0.0);
    for row in v.axis_iter(Axis(0)).take(32) {
        for (i, j, c) in (0..8).flat_map(|i| (0..7).flat_map(move |j| (0..16).map(move |c| (i, j, c)))) {
            let (a, b) = (f64::from(row[[i, j, c]]), f64::from(row[[i, j + 1, c]]));
            square += a * a;
            difference += (a - b) * (a - b);
        }
    }
    assert!(difference < 0.5 * square, "{difference} beside {square}");
}
