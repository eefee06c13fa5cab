//! Panoramas: the seam of the azimuth, the poles, levels, the order of sums; a plan that freezes the cells.

use crate::chains::{assert_same_bits, values};
use lastlight::field::embed::{self, Panoramas};
use lastlight::num::array::Arrays;
use lastlight::num::par;
use lastlight::ops::{self, Call};

const SIZES: [usize; 4] = [3, 6, 5, 4];

fn random() -> Vec<f32> {
    let [levels, height, width, channels] = SIZES;
    values(levels * height * width * channels, 11)
}

fn panoramas(values: &[f32]) -> Panoramas<'_> {
    let [levels, height, width, channels] = SIZES;
    Panoramas { values, levels, height, width, channels }
}

fn look(values: &[f32], direction: [f32; 3], rho: f32) -> Vec<f32> {
    embed::forward(&panoramas(values), &[direction], None, &[rho], None).0
}

#[test]
fn the_azimuth_wraps_without_a_seam() {
    let values = random();
    // atan2(x, y) jumps by a turn at x = 0, y < 0
    for z in [-0.6, 0.0, 0.3] {
        let [left, right] = [-1e-7, 1e-7].map(|x| look(&values, [x, -1.0, z], 0.4));
        for (a, b) in left.iter().zip(&right) {
            assert!((a - b).abs() < 1e-5, "at z = {z}: {left:?}, {right:?}");
        }
    }
    let exact = [0.0, -0.0].map(|x| look(&values, [x, -1.0, 0.3], 0.4));
    for (a, b) in exact[0].iter().zip(&exact[1]) {
        assert!((a - b).abs() < 1e-5, "both zeros");
    }
    // the centre of row k is at (k + ½)/H of the turn from −π
    let azimuth = std::f64::consts::TAU * (4.5 / 6.0 - 0.5);
    let direction = [libm::sin(azimuth) as f32, libm::cos(azimuth) as f32, 0.0];
    let own = &values[(4 * 5 + 2) * 4..][..4];
    for (a, b) in look(&values, direction, 0.0).iter().zip(own) {
        assert!((a - b).abs() < 1e-5, "row 4, the middle column");
    }
}

#[test]
fn poles_and_ends_of_the_levels_are_texels() {
    let values = random();
    let level = 6 * 5 * 4;
    // at a pole the azimuth is 0, between rows 2 and 3
    for (z, column) in [(1.0, 4), (-3.0, 0)] {
        for (rho, l) in [(0.0, 0), (0.5, 1), (1.0, 2)] {
            let texel = |row: usize| &values[l * level + (row * 5 + column) * 4..][..4];
            let expected: Vec<f32> = texel(2).iter().zip(texel(3)).map(|(a, b)| 0.5 * a + 0.5 * b).collect();
            for (a, b) in look(&values, [0.0, 0.0, z], rho).iter().zip(&expected) {
                assert!((a - b).abs() < 1e-6, "pole {z}, level {l}");
            }
        }
    }
    assert_same_bits(&look(&values, [0.0; 3], 0.5), &look(&values, [-0.0, 0.0, 0.0], 0.5), "no direction");
}

#[test]
fn reflection_keeps_the_plane_and_turns_the_normal_part() {
    // a ray straight down is reflected straight up, at any length of the normal
    let up = embed::reflect([0.0_f32, 0.0, 7.0], Some([0.6, 0.0, -0.8]));
    assert!((up[0] - 0.6).abs() < 1e-6 && up[1] == 0.0 && (up[2] - 0.8).abs() < 1e-6, "{up:?}");
    assert_eq!(embed::reflect([0.0_f32; 3], Some([0.0, -2.0, 0.0])), [0.0, -1.0, 0.0], "without a normal");
    assert_eq!(embed::reflect([0.0_f32, 4.0, 0.0], None), [0.0, 1.0, 0.0], "without a ray");
}

#[test]
fn gradients_of_panoramas_are_left_folds_over_points_in_index_order() {
    let texels = random();
    let panoramas = panoramas(&texels);
    let n = 9000;
    let normals: Vec<[f32; 3]> = values(3 * n, 12).as_chunks::<3>().0.to_vec();
    let rho: Vec<f32> = values(n, 13).iter().map(|x| x.abs()).collect();
    let (_, places) = embed::forward(&panoramas, &normals, None, &rho, None);
    let bar = values(4 * n, 14);
    let reference = || {
        // one point at a time
        let mut sums = vec![0.5; texels.len()];
        for (place, g) in places.iter().zip(bar.chunks_exact(4)) {
            panoramas.scatter(std::slice::from_ref(place), g, &mut sums);
        }
        sums
    };
    let expected = par::with_threads(1, reference).expect("a thread starts");
    for (threads, part) in [(1, n), (3, n), (2, 1234)] {
        let run = || {
            let mut ours = vec![0.5; texels.len()];
            for (places, bar) in places.chunks(part).zip(bar.chunks(4 * part)) {
                panoramas.scatter(places, bar, &mut ours);
            }
            ours
        };
        assert_same_bits(&par::with_threads(threads, run).expect("threads start"), &expected, "one order");
    }
}

#[test]
fn a_plan_freezes_cells_and_levels() {
    let op = ops::find("field.embed").expect("on the list");
    let made = (op.case)(0);
    let call = Call { inputs: made.inputs, settings: made.settings, ..Call::default() };
    let first = ops::run(op, &call).expect("it runs");
    let frozen = Call { plan: Some(first.plan.clone()), ..call.clone() };
    assert_eq!(ops::run(op, &frozen).expect("it runs"), first, "its own plan changes nothing");
    let mut other = first.plan.clone();
    let shift: Vec<i32> =
        first.plan.need("level").expect("a plan").to_f64().iter().map(|l| 2 - *l as i32).collect();
    other.put("level", &[shift.len()], shift.clone());
    let frozen = Call { plan: Some(other), ..call.clone() };
    let [ours, twin] = [ops::run(op, &frozen), ops::run_f64(op, &frozen)].map(|ran| ran.expect("it runs"));
    let of = |ran: &ops::RunResult| ran.outputs.need("h").expect("an output").to_f64();
    for (a, b) in of(&ours).iter().zip(of(&twin)) {
        assert!((a - b).abs() < 1e-5, "the same plan, the same values: {a} {b}");
    }
    for spoil in [
        ("level", vec![3; shift.len()], vec![shift.len()]),
        ("cell", vec![-2; 2 * shift.len()], vec![shift.len(), 2]),
    ] {
        let mut bad: Arrays = first.plan.clone();
        bad.put(spoil.0, &spoil.2, spoil.1);
        let e = ops::run(op, &Call { plan: Some(bad), ..call.clone() }).expect_err("refused");
        assert!(e.to_string().contains("plan"), "{e}");
    }
}
