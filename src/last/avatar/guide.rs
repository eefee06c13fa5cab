//! The interface of an image-to-point model, as used by the fit, and the window through which the model reads
//! images.
//!
//! A [`Guide`] has n factors and a graph over them. It compares two images in the space of its factors, and
//! computes which positions of the body a factor displaces. Its inputs are square images of a fixed side: a
//! [`Framing`] determines which [`Square`] of an image is used, and [`Window`] resamples it to that side and
//! maps gradients back.
//!
//! # The window
//! A [`Window`] computes means over the cells of a square ([`mod@crate::nn::window`]).
//!
//! The paper does not define the crop. The square used here encloses the projected points of the posed body,
//! in training including the displacement by the folds of the clothes, for a capture without it; it follows
//! the pose more closely than the projection of a box around the body. It is resampled to S×S by means over
//! cells of any size, so that images of any size can be used and the person always has the same size.

use crate::math::digraph::Digraph;
pub use crate::nn::window::Window;
use crate::num::order;
use crate::scene::bound;
use crate::scene::camera::Camera;
use crate::{Error, Result};

/// The part of an image that the guide was trained on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Framing {
    /// The square around the projected points of the person, with a margin of a tenth of their extent on each
    /// side.
    #[default]
    Person,
    /// The smallest square around the whole image.
    Whole,
}

impl Framing {
    /// The square of an image (H, W) with the given square around the person; `None` if the framing is
    /// [`Self::Person`] and the person is outside the image.
    pub fn square(self, size: [usize; 2], person: Option<Square>) -> Option<Square> {
        match self {
            Self::Whole => Some(Square::whole(size)),
            Self::Person => person.filter(|square| square.meets(size)),
        }
    }
}

/// The error for a person who is outside an image.
pub fn nowhere(picture: &str) -> Error {
    Error::input(picture)
        .expected("a person who is in front of the camera and at least partly inside the image")
        .got("projected points that are all outside the image, or points behind the camera")
}

/// A square of an image, in pixels; it may extend beyond the borders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Square {
    /// Left and top edges.
    pub corner: [f64; 2],
    /// Length of the side.
    pub side: f64,
}

impl Square {
    /// The smallest square that contains an image (H, W), with the same centre.
    pub fn whole([height, width]: [usize; 2]) -> Self {
        let side = Ord::max(height, width) as f64;
        Self { corner: [width, height].map(|n| 0.5 * (n as f64 - side)), side }
    }

    /// The window of `side` pixels on this square of images of size (H, W).
    pub fn window(&self, side: usize, size: [usize; 2]) -> Window {
        Window::new(side, size, self.corner, self.side)
    }

    /// Whether the square overlaps an image (H, W).
    fn meets(&self, [height, width]: [usize; 2]) -> bool {
        [width, height].iter().zip(self.corner).all(|(n, from)| from < *n as f64 && from + self.side > 0.0)
    }

    /// The square around projected points: it encloses their axis-aligned bounding rectangle, with a margin
    /// on each side of a tenth of the longer side of the rectangle. `None` if there are no points, a point
    /// has no projection, or all projections are the same.
    pub fn around(camera: &Camera, points: &[[f32; 3]]) -> Option<Self> {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for p in points {
            let at = bound::project(camera, p.map(f64::from))?;
            for k in 0..2 {
                (low[k], high[k]) = (order::min(low[k], at[k]), order::max(high[k], at[k]));
            }
        }
        let side = 1.2 * order::max(high[0] - low[0], high[1] - low[1]);
        let corner = [0, 1].map(|k| 0.5 * (low[k] + high[k] - side));
        (side > 0.0 && side.is_finite()).then_some(Self { corner, side })
    }
}

/// A trained image-to-point model with frozen weights, evaluated at the posterior means.
pub trait Guide: Sync {
    /// Number of factors n, at most 32.
    fn factors(&self) -> usize;

    /// The directed graph of direct effects between factors, without cycles.
    fn graph(&self) -> Digraph;

    /// Side S of the input images, pixels.
    fn side(&self) -> usize;

    /// The part of an image that the input shows.
    fn framing(&self) -> Framing;

    /// An identifier that differs between any two guides, for example the digest of the weights.
    fn identity(&self) -> String;

    /// L_lat between a rendered and a real image (S, S, 3), and its gradient ∂L_lat/∂rendered (S, S, 3).
    ///
    /// # Errors
    /// If a value is not finite.
    fn discrepancy(&self, rendered: &[f32], real: &[f32]) -> Result<(f64, Vec<f32>)>;

    /// For each factor i and each canonical position t (G, 3), in scene units: ‖D(Ẑʳ with row i from the real
    /// image)(t) − D(Ẑʳ)(t)‖, shape (n, G).
    ///
    /// # Errors
    /// If a value is not finite.
    fn swap_scores(&self, rendered: &[f32], real: &[f32], places: &[[f32; 3]]) -> Result<Vec<Vec<f64>>>;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::camera::Model;

    #[test]
    fn means_of_cells_and_their_adjoint_agree() {
        let image: Vec<f32> = (0..6 * 8 * 3).map(|i| (i % 17) as f32).collect();
        let square = |corner: [f64; 2], side: f64| Square { corner, side }.window(3, [6, 8]);
        let inside = square([1.0, 0.0], 6.0);
        let at = |r: usize, c: usize| image[3 * (8 * r + c)];
        assert_eq!(inside.take(&image)[0], (at(0, 1) + at(0, 2) + at(1, 1) + at(1, 2)) / 4.0, "four pixels");
        let fine = square([2.0, 1.0], 1.5);
        assert_eq!(fine.take(&image)[0], at(1, 2), "a cell within a pixel");
        let between = fine.take(&image)[3 * (3 + 1)];
        let mixed = [at(1, 2), at(1, 3), at(2, 2), at(2, 3)].iter().fold(0.0, |s, x| s + x / 4.0);
        assert_ne!(between, mixed, "the second cell ends where the pixel does: {between}");
        assert_eq!(square([2.25, 1.25], 1.5).take(&image)[3 * (3 + 1)], mixed, "a cell over four pixels");
        let spread = |window: &Window, bar: &[f32]| {
            let mut image_bar = vec![0.0; image.len()];
            window.spread(bar, &mut image_bar);
            image_bar
        };
        for window in [inside, fine, square([-2.3, -1.1], 9.7), square([4.2, 3.9], 5.0)] {
            let bar: Vec<f32> = (0..27).map(|i| (i % 5) as f32 - 2.0).collect();
            let (taken, spread) = (window.take(&image), spread(&window, &bar));
            let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).fold(0.0, |s, (a, b)| s + a * b);
            assert!((dot(&taken, &bar) - dot(&image, &spread)).abs() < 1e-3, "⟨Ax, b⟩ = ⟨x, Aᵀb⟩");
        }
        let white = square([-3.0, 0.0], 6.0).take(&[1.0; 6 * 8 * 3]);
        assert_eq!((white[0], white[3], white[6]), (0.0, 0.5, 1.0), "black surrounds the image");
    }

    #[test]
    fn squares_are_about_the_person_or_the_picture() {
        let camera = Camera {
            model: Model::Orthographic,
            focal_px: [10.0; 2],
            center_px: [4.0, 3.0],
            rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            translation: [0.0; 3],
            width: 8,
            height: 6,
        };
        let points = [[-0.25, 0.0, 2.0], [0.25, 0.125, 3.0]];
        let person = Square::around(&camera, &points);
        // x from 1.5 to 6.5, y from 3 to 4.25: side 5 with a tenth on each side.
        assert_eq!(person, Some(Square { corner: [1.0, 0.625], side: 6.0 }), "about the points");
        let behind = Camera { model: Model::Pinhole, ..camera.clone() };
        assert_eq!(Square::around(&behind, &[[0.0, 0.0, -1.0]]), None, "a point behind the camera");
        assert_eq!(Square::around(&camera, &[]), None, "nobody");
        let whole = Square { corner: [0.0, -1.0], side: 8.0 };
        assert_eq!(Framing::Whole.square([6, 8], None), Some(whole), "around the image");
        assert_eq!(Framing::Person.square([6, 8], None), None, "no person in the image");
        assert_eq!(Framing::Person.square([6, 8], person), person, "around the person");
        let beside = Square { corner: [8.0, 0.0], side: 5.0 };
        assert_eq!(Framing::Person.square([6, 8], Some(beside)), None, "outside the image");
        let partly = Some(Square { corner: [-4.5, -3.0], side: 5.0 });
        assert_eq!(Framing::Person.square([6, 8], partly), partly, "half inside the image");
    }
}
