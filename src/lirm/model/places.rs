//! First values of the place tokens of planes, from the positions of their texels.
//!
//! The 8×8 texels of a token hold features of a column of space: two coordinates of its position are those of
//! the middle of its square, the third is that of its side, ±½, or 0 for a plane of a tri-plane. With x in
//! −1..1 its features φ are
//!
//! one of P for its plane;   x, y, z;   0.7·sin and cos of πx/2, πy/2, πz/2;   0.5·sin and cos of πx, πy, πz
//!
//! and the token is φ·R / ‖φ‖, where R (P + 15, D) has normal draws: the deviation is 1, as that of an
//! image's token after its LayerNorm. (The published one, 1/√(tokens per plane), is small beside what the
//! first blocks add to all tokens alike: after the last LayerNorm of a model with such first values 84 % of
//! the state's variance were one vector common to all tokens.) Neighbours begin alike, and what the first
//! layers learn for one place serves all of them. The tokens are trained like others. Features, products and
//! their left fold are in f64 and rounded once.

use super::config::Config;
use crate::num::elem::f64 as elem;
use crate::optim::initial::Initial;
use core::f64::consts::PI;
use ndarray::{ArrayD, IxDyn};

/// Features besides that of the plane.
const OTHERS: usize = 15;
/// Frequencies, in half turns from −1 to 1, and their weights.
const WAVES: [(f64, f64); 2] = [(0.5, 0.7), (1.0, 0.5)];
/// The axes of the rows and columns of a pair of planes, and the one that it lacks.
const AXES: [[usize; 3]; 3] = [[0, 1, 2], [0, 2, 1], [1, 2, 0]];

/// The position of a token.
fn position(c: &Config, plane: usize, [row, column]: [usize; 2]) -> [f64; 3] {
    let (pair, third) = if c.planes == 6 { (plane / 2, plane % 2) } else { (plane, 2) };
    let [first, second, other] = AXES[pair];
    let middle = |i: usize| (2 * i + 1) as f64 / c.plane_tokens as f64 - 1.0;
    let mut x = [0.0; 3];
    (x[first], x[second], x[other]) = (middle(row), middle(column), [-0.5, 0.5, 0.0][third]);
    x
}

fn features(c: &Config, plane: usize, x: [f64; 3]) -> Vec<f64> {
    let mut all = vec![0.0; c.planes];
    all[plane] = 1.0;
    all.extend(x);
    for x in x {
        for (half_turns, weight) in WAVES {
            let angle = PI * half_turns * x;
            all.extend([weight * elem::sin(angle), weight * elem::cos(angle)]);
        }
    }
    all
}

/// Returns the tokens, shape (P·t², D), from the draws of R.
pub fn first(c: &Config, draws: &Initial) -> ArrayD<f32> {
    let (side, width) = (c.plane_tokens, c.width);
    let r = draws.normal(&[c.planes + OTHERS, width], 1.0);
    let mut values = Vec::with_capacity(c.planes * side * side * width);
    for (plane, row, column) in
        (0..c.planes * side * side).map(|i| (i / (side * side), i / side % side, i % side))
    {
        let of = features(c, plane, position(c, plane, [row, column]));
        let length = of.iter().fold(0.0, |sum, x| sum + x * x).sqrt();
        let number = |k: usize| of.iter().enumerate().fold(0.0, |sum, (i, x)| sum + x * f64::from(r[[i, k]]));
        values.extend((0..width).map(|k| (number(k) / length) as f32));
    }
    ArrayD::from_shape_vec(IxDyn(&[c.planes * side * side, width]), values).expect("a row per token")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_are_those_of_the_texels() {
        let c = Config { plane_tokens: 4, ..Config::SMALL };
        // xy−, first row, last column; yz+, third row, second column.
        assert_eq!(position(&c, 0, [0, 3]), [-0.75, 0.75, -0.5]);
        assert_eq!(position(&c, 5, [2, 1]), [0.5, 0.25, -0.25]);
        let three = Config { planes: 3, ..c };
        assert_eq!(position(&three, 1, [3, 0]), [0.75, 0.0, -0.75]);
    }

    #[test]
    fn neighbours_are_alike_and_the_deviation_is_one() {
        let c = Config::SMALL;
        let tokens = first(&c, &Initial::named(1, 0x0550, "places/planes"));
        let row = |i: usize| tokens.index_axis(ndarray::Axis(0), i).iter().copied().collect::<Vec<f32>>();
        let square = |x: &[f32]| x.iter().fold(0.0, |s, x| s + f64::from(*x) * f64::from(*x));
        let deviation =
            (tokens.iter().fold(0.0, |s, x| s + f64::from(*x) * f64::from(*x)) / tokens.len() as f64).sqrt();
        assert!((deviation - 1.0).abs() < 0.1, "{deviation}");
        let alike = |i: usize, j: usize| {
            let (a, b) = (row(i), row(j));
            let product = a.iter().zip(&b).fold(0.0, |s, (a, b)| s + f64::from(*a) * f64::from(*b));
            product / (square(&a) * square(&b)).sqrt()
        };
        let (near, far) = (alike(0, 1), alike(0, 63));
        assert!(near > 0.9 && far < near - 0.3, "{near} beside, {far} across");
        assert!(alike(0, 64) < 0.9, "the planes of two sides differ: {}", alike(0, 64));
    }
}
