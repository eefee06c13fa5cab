//! What the host asks of an image-to-point model, and the window through which the model sees pictures.
//!
//! A [`Guide`] has n factors and a graph over them. It compares two pictures in the space of its factors, and says which places of the body a factor
//! moves. It sees squares of its own side: a [`Framing`] says which [`Square`] of a picture, [`Window`] brings it to that side, and gradients back.
//!
//! # The window
//! A [`Window`] is the mean over cells of a square ([`mod@crate::nn::window`]).
//!
//! It departs from `last.md` in three places. The square is that of the projected points, not of the projected box of the body with its 0.05 m (§4.2): it follows the
//! pose more closely. It is brought to S×S by means over cells of any size, not by averages of whole blocks (§11), so that pictures of any size serve and a person has one size. And the points
//! are those of the body as it is posed, in training with the folds of its clothes, in a capture without.

use crate::math::digraph::Digraph;
pub use crate::nn::window::Window;
use crate::num::order;
use crate::scene::bound;
use crate::scene::camera::Camera;
use crate::{Error, Result};

/// Which part of a picture the guide was trained on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Framing {
    /// The square around the person's projected points, with a margin of a tenth of their extent on either side (`last.md` §4.2).
    #[default]
    Person,
    /// The least square around the whole picture: the training camera's own framing.
    Whole,
}

impl Framing {
    /// The square of a picture (H, W) with somebody in `person`; none where a person is asked for who is nowhere in it.
    pub fn square(self, size: [usize; 2], person: Option<Square>) -> Option<Square> {
        match self {
            Self::Whole => Some(Square::whole(size)),
            Self::Person => person.filter(|square| square.meets(size)),
        }
    }
}

/// Who should be seen is nowhere in a picture.
pub fn nowhere(picture: &str) -> Error {
    Error::input(picture)
        .expected("a person in front of the camera and in the picture, for the model to look at")
        .got("points behind the camera, or none in the picture")
}

/// A square of a picture, pixels; it may reach beyond the borders.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Square {
    /// left and top
    pub corner: [f64; 2],
    /// side
    pub side: f64,
}

impl Square {
    /// The least that holds a picture (H, W), about its centre.
    pub fn whole([height, width]: [usize; 2]) -> Self {
        let side = Ord::max(height, width) as f64;
        Self { corner: [width, height].map(|n| 0.5 * (n as f64 - side)), side }
    }

    /// The window of `side` pixels on this square of pictures (H, W).
    pub fn window(&self, side: usize, size: [usize; 2]) -> Window {
        Window::new(side, size, self.corner, self.side)
    }

    /// Whether it shares a pixel with a picture (H, W).
    fn meets(&self, [height, width]: [usize; 2]) -> bool {
        [width, height].iter().zip(self.corner).all(|(n, from)| from < *n as f64 && from + self.side > 0.0)
    }

    /// About the smallest upright rectangle around projected points, a tenth wider on either side than the longer of its sides. None if there is no point,
    /// one has no place in the picture, or all have the same.
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
        assert_eq!((white[0], white[3], white[6]), (0.0, 0.5, 1.0), "black lies around the picture");
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
        // x from 1.5 to 6.5, y from 3 to 4.25: side 5 with a tenth on either side.
        assert_eq!(person, Some(Square { corner: [1.0, 0.625], side: 6.0 }), "about the points");
        let behind = Camera { model: Model::Pinhole, ..camera.clone() };
        assert_eq!(Square::around(&behind, &[[0.0, 0.0, -1.0]]), None, "a point behind the camera");
        assert_eq!(Square::around(&camera, &[]), None, "nobody");
        let whole = Square { corner: [0.0, -1.0], side: 8.0 };
        assert_eq!(Framing::Whole.square([6, 8], None), Some(whole), "about the picture");
        assert_eq!(Framing::Person.square([6, 8], None), None, "nobody is there");
        assert_eq!(Framing::Person.square([6, 8], person), person, "about the person");
        let beside = Square { corner: [8.0, 0.0], side: 5.0 };
        assert_eq!(Framing::Person.square([6, 8], Some(beside)), None, "beside the picture");
        let partly = Some(Square { corner: [-4.5, -3.0], side: 5.0 });
        assert_eq!(Framing::Person.square([6, 8], partly), partly, "half in it");
    }
}
