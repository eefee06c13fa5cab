//! What the host asks of an image-to-point model, and the window through which the model sees pictures.
//!
//! A [`Guide`] has n factors and a graph over them. It compares two pictures in the space of its factors, and says which places of the body a factor
//! moves. It sees squares of its own side: [`Window`] cuts them out of a picture and averages whole blocks of pixels, and spreads gradients back.

use crate::math::digraph::Digraph;
use crate::{Error, Result};

/// Which part of a picture the guide was trained on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Framing {
    /// The whole picture: the training camera's own framing.
    Whole,
    /// The square around the person's box, with a margin of a tenth.
    Person,
}

/// A trained image-to-point model, weights frozen, posterior means only.
pub trait Guide: Sync {
    /// Number of factors n, at most 32.
    fn factors(&self) -> usize;

    /// Which factor has a direct effect on which; no cycle.
    fn graph(&self) -> Digraph;

    /// Side S of the pictures below.
    fn side(&self) -> usize;

    /// What part of a picture they show.
    fn framing(&self) -> Framing;

    /// A text that differs between any two guides, e.g. the digest of the weights.
    fn identity(&self) -> String;

    /// L_lat of a rendered and a real picture (S, S, 3), and ∂L_lat/∂rendered (S, S, 3).
    ///
    /// # Errors
    /// When a number is not finite.
    fn discrepancy(&self, rendered: &[f32], real: &[f32]) -> Result<(f64, Vec<f32>)>;

    /// For each factor i and each canonical place t (G, 3), scene units: ‖D(Ẑʳ with row i from the real picture)(t) − D(Ẑʳ)(t)‖, (n, G).
    ///
    /// # Errors
    /// When a number is not finite.
    fn swap_scores(&self, rendered: &[f32], real: &[f32], places: &[[f32; 3]]) -> Result<Vec<Vec<f64>>>;
}

/// A square of a picture (H, W, 3) as S×S averages of f×f pixels. What lies outside the picture is black.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    top: isize,
    left: isize,
    factor: usize,
    side: usize,
    height: usize,
    width: usize,
}

impl Window {
    /// The window of a framing; `rectangle` is `[top, left], [bottom, right]` of the person's box.
    ///
    /// # Errors
    /// When the whole picture is not a whole multiple of the side.
    pub fn new(
        framing: Framing,
        side: usize,
        [height, width]: [usize; 2],
        rectangle: [[usize; 2]; 2],
    ) -> Result<Self> {
        match framing {
            Framing::Whole => {
                if height != width || !height.is_multiple_of(side) || height == 0 {
                    return Err(Error::input("pictures for the model")
                        .expected(format!("squares, a whole multiple of {side} pixels"))
                        .got(format!("{width}x{height}"))
                        .hint("the model was trained on whole pictures of the training camera"));
                }
                Ok(Self { top: 0, left: 0, factor: height / side, side, height, width })
            }
            Framing::Person => {
                let [[top, left], [bottom, right]] = rectangle;
                let most = Ord::max(bottom - top, right - left);
                // The square with a tenth on either side, in whole blocks.
                let factor = Ord::max(1, (12 * most).div_ceil(10 * side));
                let start = |a: usize, b: usize| ((a + b) as isize - (factor * side) as isize).div_euclid(2);
                Ok(Self { top: start(top, bottom), left: start(left, right), factor, side, height, width })
            }
        }
    }

    /// Pixels of the picture in block (r, c), as indices.
    fn block(&self, r: usize, c: usize) -> impl Iterator<Item = usize> + '_ {
        let f = self.factor;
        let inside =
            |start: isize, i: usize, n: usize| usize::try_from(start + i as isize).ok().filter(|&x| x < n);
        (0..f * f).filter_map(move |e| {
            let y = inside(self.top, r * f + e / f, self.height)?;
            let x = inside(self.left, c * f + e % f, self.width)?;
            Some(y * self.width + x)
        })
    }

    /// (S, S, 3) averages: left folds over the block, row by row, times 1/f².
    pub fn take(&self, image: &[f32]) -> Vec<f32> {
        let (s, scale) = (self.side, 1.0 / (self.factor * self.factor) as f32);
        let mut out = vec![0.0; s * s * 3];
        for (i, pixel) in out.chunks_exact_mut(3).enumerate() {
            for at in self.block(i / s, i % s) {
                for k in 0..3 {
                    pixel[k] += image[3 * at + k];
                }
            }
            for x in pixel {
                *x *= scale;
            }
        }
        out
    }

    /// (H, W, 3): the adjoint of [`Self::take`].
    pub fn spread(&self, bar: &[f32]) -> Vec<f32> {
        let (s, scale) = (self.side, 1.0 / (self.factor * self.factor) as f32);
        let mut out = vec![0.0; self.height * self.width * 3];
        for (i, pixel) in bar.chunks_exact(3).enumerate() {
            for at in self.block(i / s, i % s) {
                for k in 0..3 {
                    out[3 * at + k] = pixel[k] * scale;
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn averages_and_their_adjoint_agree() {
        let image: Vec<f32> = (0..6 * 6 * 3).map(|i| (i % 17) as f32).collect();
        let whole = Window::new(Framing::Whole, 3, [6, 6], [[0, 0], [6, 6]]).expect("6 = 2·3");
        assert_eq!(
            whole.take(&image)[0],
            (image[0] + image[3] + image[18] + image[21]) / 4.0,
            "a block's mean"
        );
        let person = Window::new(Framing::Person, 3, [6, 6], [[1, 2], [4, 5]]).expect("always fits");
        for window in [whole, person] {
            let bar: Vec<f32> = (0..27).map(|i| (i % 5) as f32 - 2.0).collect();
            let (taken, spread) = (window.take(&image), window.spread(&bar));
            let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).fold(0.0, |s, (a, b)| s + a * b);
            assert!((dot(&taken, &bar) - dot(&image, &spread)).abs() < 1e-3, "⟨Ax, b⟩ = ⟨x, Aᵀb⟩");
        }
        assert!(Window::new(Framing::Whole, 4, [6, 6], [[0, 0], [6, 6]]).is_err(), "6 is no multiple of 4");
    }
}
