//! What the model sees of a picture: a square of it, shrunk by a whole factor, on black, in −½ … ½.
//!
//! A square picture whose side is a multiple of the model's is seen as a whole, as in training, where the camera stands still. Of any other picture a
//! square around the person's box is seen, 10 % larger, its side rounded up to a whole multiple; what lies beyond the border is black.
//!
//! Pixels of a block are summed row by row from +0 and divided by their number. The adjoint spreads evenly.

use crate::num::order;

/// The part of a picture that is seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sight {
    /// left column and top row; may lie beyond the border
    pub corner: [i64; 2],
    /// pixels per pixel seen, along each axis
    pub factor: usize,
    /// side of what is seen
    pub side: usize,
}

/// Margin around a box.
const MARGIN: f64 = 0.1;

impl Sight {
    /// The part of a (width, height) picture that a model of `side` sees; `around` is the person's box [x₀, y₀, x₁, y₁] in pixels.
    pub fn new(side: usize, [width, height]: [usize; 2], around: [f64; 4]) -> Self {
        if width == height && width.is_multiple_of(side) {
            return Self { corner: [0, 0], factor: width / side, side };
        }
        let [x0, y0, x1, y1] = around;
        let extent = order::max(order::max(x1 - x0, y1 - y0), 1.0) * (1.0 + MARGIN);
        let factor = Ord::max(1, libm::ceil(extent / side as f64) as usize);
        let half = (factor * side) as f64 * 0.5;
        let corner = |a: f64, b: f64| libm::floor((a + b) * 0.5 - half) as i64;
        Self { corner: [corner(x0, x1), corner(y0, y1)], factor, side }
    }

    /// Index of a pixel of the picture (W, H) in a block, where it exists.
    fn pixel(&self, [width, height]: [usize; 2], [x, y]: [usize; 2]) -> Option<usize> {
        let x = usize::try_from(self.corner[0] + x as i64).ok().filter(|&x| x < width)?;
        let y = usize::try_from(self.corner[1] + y as i64).ok().filter(|&y| y < height)?;
        Some(y * width + x)
    }

    /// What is seen (S, S, 3) of a picture (H, W, 3) with colours in 0 … 1.
    ///
    /// # Panics
    /// When the picture does not have its size.
    pub fn seen(&self, size: [usize; 2], picture: &[f32]) -> Vec<f32> {
        assert_eq!(picture.len(), size[0] * size[1] * 3, "a picture is (H, W, 3)");
        let (s, f) = (self.side, self.factor);
        let share = 1.0 / (f * f) as f32;
        let mut out = Vec::with_capacity(s * s * 3);
        for at in 0..s * s {
            let mut sum = [0.0_f32; 3];
            for k in 0..f * f {
                let place = [at % s * f + k % f, at / s * f + k / f];
                if let Some(pixel) = self.pixel(size, place) {
                    let colour = &picture[pixel * 3..][..3];
                    sum.iter_mut().zip(colour).for_each(|(s, c)| *s += c);
                }
            }
            out.extend(sum.map(|c| c * share - 0.5));
        }
        out
    }

    /// The gradient by the picture (H, W, 3), given that by what is seen.
    ///
    /// # Panics
    /// When the cotangent is not (S, S, 3).
    pub fn adjoint(&self, size: [usize; 2], seen_bar: &[f32]) -> Vec<f32> {
        let (s, f) = (self.side, self.factor);
        assert_eq!(seen_bar.len(), s * s * 3, "the cotangent is (S, S, 3)");
        let share = 1.0 / (f * f) as f32;
        let mut bar = vec![0.0; size[0] * size[1] * 3];
        for (at, g) in seen_bar.chunks_exact(3).enumerate() {
            for k in 0..f * f {
                let place = [at % s * f + k % f, at / s * f + k / f];
                if let Some(pixel) = self.pixel(size, place) {
                    bar[pixel * 3..][..3].iter_mut().zip(g).for_each(|(b, g)| *b = g * share);
                }
            }
        }
        bar
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_picture_stays_and_gradients_add_up() {
        for (size, around) in
            [([128, 128], [0.0; 4]), ([100, 70], [20.0, 5.0, 60.0, 66.0]), ([10, 10], [-5.0, 0.0, 90.0, 9.0])]
        {
            let sight = Sight::new(64, size, around);
            let picture = vec![0.75; size[0] * size[1] * 3];
            let seen = sight.seen(size, &picture);
            assert!(seen.iter().all(|x| (-0.5..=0.25).contains(x)), "{size:?}: between black and the colour");
            // ⟨seen(x + d) − seen(x), ȳ⟩ = ⟨d, adjoint(ȳ)⟩: the map is affine.
            let cotangent: Vec<f32> = (0..seen.len()).map(|i| (i % 7) as f32 - 3.0).collect();
            let bar = sight.adjoint(size, &cotangent);
            let moved: Vec<f32> = (0..picture.len()).map(|i| (i % 5) as f32).collect();
            let black = sight.seen(size, &vec![0.0; picture.len()]);
            let dot = |a: &[f32], b: &[f32]| {
                a.iter().zip(b).fold(0.0, |s, (a, b)| s + f64::from(*a) * f64::from(*b))
            };
            let change: Vec<f32> = sight.seen(size, &moved).iter().zip(&black).map(|(a, b)| a - b).collect();
            let (left, right) = (dot(&change, &cotangent), dot(&moved, &bar));
            assert!((left - right).abs() <= 1e-4 * (1.0 + left.abs()), "{size:?}: {left} against {right}");
        }
    }

    #[test]
    fn whole_pictures_are_box_filtered() {
        let sight = Sight::new(64, [128, 128], [0.0; 4]);
        assert_eq!((sight.corner, sight.factor), ([0, 0], 2), "a square multiple is seen as a whole");
        let mut picture = vec![0.0; 128 * 128 * 3];
        picture[0] = 1.0;
        assert_eq!(sight.seen([128, 128], &picture)[0], 0.25 - 0.5, "a quarter of one pixel");
    }
}
