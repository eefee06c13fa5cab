//! Feature planes and the head of the signed distance: seams, borders, the order of sums, the sphere.

use crate::chains::{assert_same_bits, values};
use lastlight::field::fetch::{self, Combine, Planes};
use lastlight::field::sdf_head;
use lastlight::num::par;

const SIDE: usize = 7;
const CHANNELS: usize = 5;

fn hexa(values: &[f32]) -> Planes<'_> {
    Planes { values, count: 6, side: SIDE, channels: CHANNELS, half_size: 0.5 }
}

fn random_planes() -> Vec<f32> {
    values(6 * SIDE * SIDE * CHANNELS, 3)
}

/// Points in the box and somewhat outside it.
fn points(n: usize) -> Vec<[f32; 3]> {
    values(3 * n, 4).as_chunks::<3>().0.iter().map(|p| p.map(|x| 0.6 * x)).collect()
}

fn features(planes: &Planes<'_>, point: [f32; 3]) -> Vec<f32> {
    let mut out = vec![0.0; 3 * planes.channels];
    fetch::forward(planes, Combine::Concat, &[point], &mut out);
    out
}

#[test]
fn features_jump_at_a_seam_by_the_difference_of_its_two_planes() {
    let values = random_planes();
    let planes = hexa(&values);
    // the missing coordinate of xy, xz, yz
    for (pair, missing) in [(0, 2), (1, 1), (2, 0)] {
        let at = |x: f32| {
            let mut p = [0.21, -0.13, 0.34];
            p[missing] = x;
            features(&planes, p)
        };
        let (minus, plus) = (at(0.0), at(f32::from_bits(1)));
        assert_same_bits(&at(-0.0), &minus, "both zeros read the plane −");
        assert_same_bits(&at(-1e-30), &minus, "below 0 the plane −");
        assert_same_bits(&at(1e-30), &plus, "above 0 the plane +");
        let three = |sign: usize| {
            let plane = SIDE * SIDE * CHANNELS;
            let parts: Vec<f32> =
                (0..3).flat_map(|k| values[(2 * k + sign) * plane..][..plane].to_vec()).collect();
            let planes = Planes { values: &parts, count: 3, ..planes };
            let mut p = [0.21, -0.13, 0.34];
            p[missing] = 0.0;
            features(&planes, p)
        };
        let own = pair * CHANNELS..(pair + 1) * CHANNELS;
        let (lower, upper) = (three(0), three(1));
        assert_same_bits(&minus[own.clone()], &lower[own.clone()], "the plane − of the pair");
        assert_same_bits(&plus[own.clone()], &upper[own.clone()], "the plane + of the pair");
        let jump = own.clone().fold(0.0, |sum, c| sum + (plus[c] - minus[c]).abs());
        assert!(jump > 0.1, "random planes jump: {jump}");
        for c in (0..3 * CHANNELS).filter(|c| !own.contains(c)) {
            assert_eq!(minus[c], plus[c], "the other pairs do not jump");
        }
    }
}

#[test]
fn mirrored_planes_do_not_jump() {
    let plane = SIDE * SIDE * CHANNELS;
    let mut values = random_planes();
    for pair in 0..3 {
        values.copy_within(2 * pair * plane..(2 * pair + 1) * plane, (2 * pair + 1) * plane);
    }
    let planes = hexa(&values);
    for missing in 0..3 {
        let at = |x: f32| {
            let mut p = [0.21, -0.13, 0.34];
            p[missing] = x;
            features(&planes, p)
        };
        assert_same_bits(&at(f32::from_bits(1)), &at(0.0), "no jump");
    }
}

#[test]
fn outside_the_box_the_border_is_read_without_a_slope() {
    let values = random_planes();
    let planes = hexa(&values);
    let bar = vec![1.0; 3 * CHANNELS];
    let inside = 0.5_f32.next_down();
    for sign in [-1.0, 1.0] {
        let slope = |x: f32| planes.point_bar(Combine::Concat, [sign * x, 0.11, -0.23], &bar);
        assert_eq!(slope(0.5)[0], 0.0, "on the border");
        assert_eq!(slope(0.7)[0], 0.0, "outside");
        assert_ne!(slope(0.4)[0], 0.0, "inside");
        // u is rounded; a little farther inside it is below S − 1
        assert_ne!(slope(inside - 1e-6)[0], 0.0, "just inside");
        assert!(slope(0.7)[1] != 0.0 && slope(0.7)[2] != 0.0, "other coordinates keep their slopes");
        let at = |x: f32| features(&planes, [sign * x, 0.11, -0.23]);
        assert_same_bits(&at(0.5), &at(0.7), "the border");
    }
    // a corner of a cell belongs to the cell that starts there: texel 4 of 0 to 6 is at x = R/3
    let quarter = Planes { half_size: 1.0, side: 5, values: &values[..6 * 25 * CHANNELS], ..planes };
    let corners = quarter.corners(0, [0.5, -0.5, 1.0]);
    assert_eq!((corners.fractions, corners.is_inside), ([0.0, 0.0], [true, true]), "texels 3 and 1");
    assert_eq!(corners.at, (5 + 3) * 5 + 1, "row 3, column 1 of xy+");
    assert_eq!(corners.weights, [1.0, 0.0, 0.0, 0.0]);
}

#[test]
fn gradients_of_texels_are_left_folds_over_points_in_index_order() {
    let values = random_planes();
    let planes = hexa(&values);
    let points = points(9000);
    for combine in [Combine::Concat, Combine::Sum] {
        let width = combine.width(CHANNELS);
        let bar = crate::chains::values(points.len() * width, 5);
        let mut expected = vec![0.25_f32; values.len()];
        for (point, g) in points.iter().zip(bar.chunks_exact(width)) {
            for pair in 0..3 {
                let corners = planes.corners(pair, *point);
                let g = if combine == Combine::Concat { &g[pair * CHANNELS..] } else { g };
                for (offset, w) in [0, 1, SIDE, SIDE + 1].into_iter().zip(corners.weights) {
                    for c in 0..CHANNELS {
                        expected[(corners.at + offset) * CHANNELS + c] += w * g[c];
                    }
                }
            }
        }
        for (threads, part) in [(1, 9000), (3, 9000), (2, 1234)] {
            let run = || {
                let mut ours = vec![0.25_f32; values.len()];
                for (points, bar) in points.chunks(part).zip(bar.chunks(part * width)) {
                    planes.scatter(combine, points, bar, &mut ours);
                }
                ours
            };
            let ours = par::with_threads(threads, run).expect("threads start");
            assert_same_bits(&ours, &expected, "threads and parts change nothing");
        }
    }
}

#[test]
fn zero_planes_are_a_sphere() {
    let zeros = vec![0.0; 6 * SIDE * SIDE * CHANNELS];
    let points = points(50);
    let mut features = vec![0.0; 50 * 3 * CHANNELS];
    fetch::forward(&hexa(&zeros), Combine::Concat, &points, &mut features);
    let (w0, w1, w2) = (values(8 * 15, 6), values(6 * 8, 7), values(6, 8));
    let weights: [&[f32]; 3] = [&w0, &w1, &w2];
    let x = sdf_head::In { features: &features, points: &points, weights: &weights, half_size: 0.5 };
    for (s, p) in sdf_head::forward(&x).0.iter().zip(&points) {
        let [x, y, z] = p.map(f64::from);
        let expected = (x * x + y * y + z * z).sqrt() - 0.05;
        assert!((f64::from(*s) - expected).abs() < 1e-7, "{p:?}: {s} for {expected}");
    }
}

#[test]
fn the_sphere_has_no_slope_at_its_centre_and_a_unit_slope_beside_it() {
    let (features, weights): (_, [&[f32]; 2]) = ([1.0_f32], [&[1.0], &[0.0]]);
    for (point, slope) in [
        ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
        ([-0.0, 0.0, -0.0], [0.0, 0.0, 0.0]),
        ([1e-30, 0.0, 0.0], [2.0, 0.0, 0.0]),
        ([0.0, -1e-42, 0.0], [0.0, -2.0, 0.0]),
    ] {
        let points = [point];
        let x = sdf_head::In { features: &features, points: &points, weights: &weights, half_size: 0.5 };
        let (sdf, saved) = sdf_head::forward(&x);
        assert_eq!(sdf, [-0.05], "at {point:?}");
        let mut points_bar = [[0.0; 3]];
        let mut bar = lastlight::field::network::NetworkBar {
            x: vec![0.0],
            weights: weights.iter().map(|w| vec![0.0; w.len()]).collect(),
        };
        sdf_head::adjoint(&x, &saved, &[2.0], &mut points_bar, &mut bar);
        assert_eq!(points_bar, [slope], "at {point:?}");
    }
}
