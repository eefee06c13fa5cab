//! Philox against its published vectors, and what is drawn from it.

use lastlight::num::bits;
use lastlight::num::rng::{self, Rng};

#[test]
fn philox_gives_the_known_answers_of_random123() {
    let vectors = [
        ([0; 4], [0; 2], [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]),
        ([u32::MAX; 4], [u32::MAX; 2], [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]),
        (
            [0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344],
            [0xa409_3822, 0x299f_31d0],
            [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1],
        ),
    ];
    for (counter, key, words) in vectors {
        assert_eq!(rng::philox(counter, key), words);
    }
}

#[test]
fn the_counter_holds_item_step_purpose_and_draw() {
    let rng = Rng::new(0x299f_31d0_a409_3822);
    let block = rng.block(0x85a3_08d3_243f_6a88, 0x1319_8a2e, 0x0370, 0x7344);
    assert_eq!(block, [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1]);
}

#[test]
fn uniforms_are_midpoints_and_never_0_or_1() {
    assert_eq!(rng::uniform_f32([0; 4]), 0.5 / 8_388_608.0);
    assert_eq!(rng::uniform_f32([u32::MAX; 4]), 1.0 - 0.5 / 8_388_608.0);
    assert_eq!(rng::uniform_f64([0; 4]), 0.5 / 4_503_599_627_370_496.0);
    assert_eq!(rng::uniform_f64([u32::MAX; 4]), 1.0 - 0.5 / 4_503_599_627_370_496.0);
    assert!(rng::uniform_f32([u32::MAX; 4]) < 1.0 && rng::uniform_f64([u32::MAX; 4]) < 1.0, "below 1");
    assert_eq!(
        rng::uniform_f64([0, 0x8000_0000, 0, 0]),
        0.5 + 0.5 / 4_503_599_627_370_496.0,
        "x1 is the high word"
    );
}

#[test]
fn moments_of_uniforms_and_normals() {
    const N: u64 = 200_000;
    let rng = Rng::new(11);
    let moments = |draw: &dyn Fn(u64) -> f64| {
        let (mut mean, mut square) = (0.0, 0.0);
        for i in 0..N {
            let x = draw(i);
            mean += x;
            square += x * x;
        }
        (mean / N as f64, square / N as f64)
    };
    // Five standard errors: 1/√(12 N) of a uniform's mean, 1/√N of a normal's, √(2/N) of its square.
    let (mean, square) = moments(&|i| f64::from(rng.uniform_f32(i, 0, 0, 0)));
    assert!(
        (mean - 0.5).abs() < 5.0 * 6.5e-4 && (square - 1.0 / 3.0).abs() < 5.0 * 6.7e-4,
        "{mean} {square}"
    );
    let (mean, square) = moments(&|i| rng.normal_f64(i, 0, 1, 0));
    assert!(mean.abs() < 5.0 * 2.3e-3 && (square - 1.0).abs() < 5.0 * 3.2e-3, "{mean} {square}");
    assert_eq!(rng.normal_f32(5, 0, 1, 0), rng.normal_f64(5, 0, 1, 0) as f32);
}

#[test]
fn the_normal_quantile_has_the_values_of_a_calculation_in_60_digits() {
    let values = [
        (0.625, 0.318_639_363_964_375_163_02),
        (0.1, -1.281_551_565_544_600_435_3),
        (0.9, 1.281_551_565_544_600_593_5),
        (0.0749, -1.440_238_267_527_963_663_1),
        (0.925, 1.439_531_470_938_456_229_1),
        (0.01, -2.326_347_874_040_841_093_1),
        (0.001, -3.090_232_306_167_813_535_4),
        (1e-6, -4.753_424_308_822_898_957_3),
        (1e-9, -5.997_807_015_007_686_861_4),
        (2e-11, -6.604_077_590_405_634_277_6),
        (1e-11, -6.706_023_155_495_136_296_1),
        (1e-15, -7.941_345_326_170_996_771_3),
        (1e-50, -14.933_337_534_788_488_981),
        (1e-300, -37.047_096_299_361_199_237),
        (0.999_999, 4.753_424_308_817_087_765_7),
    ];
    for (p, x) in values {
        // The published accuracy is 1e-16; the evaluation adds a few roundings: 2 places at most here..
        let ulp = bits::ulp_f64(rng::inverse_normal(p), x);
        assert!(ulp <= 2, "p = {p:e}: {} instead of {x}, {ulp} places", rng::inverse_normal(p));
    }
    assert_eq!(rng::inverse_normal(0.5), 0.0);
    assert_eq!(rng::inverse_normal(0.25), -rng::inverse_normal(0.75));
}

#[test]
fn permutations_are_permutations_and_depend_on_their_coordinates() {
    let rng = Rng::new(5);
    for n in [0, 1, 2, 1000] {
        let p = rng.permutation(n, 3, 4);
        let mut sorted = p.clone();
        sorted.sort_unstable();
        assert!(sorted.iter().enumerate().all(|(i, &x)| i == x), "{n} elements");
        assert_eq!(p, rng.permutation(n, 3, 4));
    }
    assert_ne!(rng.permutation(1000, 3, 4), rng.permutation(1000, 4, 4));
    assert_ne!(rng.permutation(1000, 3, 4), Rng::new(6).permutation(1000, 3, 4));
}

#[test]
fn indices_lie_in_range_and_reach_every_value() {
    let rng = Rng::new(9);
    let mut seen = [0_u32; 7];
    for i in 0..7000 {
        seen[rng.index(7, i, 0, 0, 0)] += 1;
    }
    assert!(seen.iter().all(|&n| (800..1200).contains(&n)), "{seen:?}");
}

#[test]
fn derived_seeds_are_words_of_a_block_and_differ() {
    let words = Rng::new(7).block(3, 0, 0x1234, 0);
    assert_eq!(rng::derive(7, 3, 0x1234), u64::from(words[1]) << 32 | u64::from(words[0]), "x₁·2³² + x₀");
    assert_eq!(Rng::new(7).derive(3, 0, 0x1234), rng::derive(7, 3, 0x1234), "step 0");
    // what adding an item to a seed would confuse: neighbours in seed, item, step and purpose
    let mut all = Vec::new();
    for seed in 0..8 {
        for item in 0..8 {
            all.extend((0..8).map(|step| Rng::new(seed << 32).derive(item, step, 0x1234)));
            all.push(rng::derive(seed, item, 0x1235));
        }
    }
    let n = all.len();
    all.sort_unstable();
    all.dedup();
    assert_eq!(all.len(), n, "all different");
}
