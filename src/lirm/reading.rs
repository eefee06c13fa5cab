//! Images of an object as the model reads them, and sets of them one after the other.

use super::model::config::{Background, Config, PATCH, Rays};
use super::model::transformer::Input;
use super::model::weights::Ready;
use super::views::{View, Views};
use crate::fit::field::targets::placed;
use crate::num::sum;
use crate::scene::field::Placement;
use crate::scene::rays::{PLUCKER, moment, plucker};
use crate::{Error, Result};

/// Pixels per side of the images that models are trained with.
pub const INPUT_SIDE: usize = 64;
/// Most tokens of a set: 64 images of 512².
const MOST_TOKENS: usize = 262_144;

impl Input {
    /// An image as a model reads it, with rays in the units of the field; a plain model does not read the
    /// photo.
    pub fn of(view: &View, placement: &Placement, config: &Config) -> Self {
        let wide = |x: &[f32]| -> Vec<f32> { x.iter().map(|x| 2.0 * x - 1.0).collect() };
        let camera = placed(&view.picture.camera, placement);
        Self {
            size: [camera.width, camera.height],
            image: match config.background {
                Background::White => wide(&view.picture.color),
                Background::Marked => marked(wide(&view.picture.color), &view.picture.foreground),
            },
            rays: match config.rays {
                Rays::Plucker => plucker(&camera),
                Rays::Nearest => nearest(plucker(&camera)),
            },
            photo: if config.is_whole { wide(&view.photo) } else { Vec::new() },
        }
    }
}

/// Adds 2·(1 − m) to the colours of an image, where m is the part of a pixel that the object covers: a
/// background of 1 becomes 3.
fn marked(mut image: Vec<f32>, foreground: &[f32]) -> Vec<f32> {
    for (pixel, m) in image.as_chunks_mut::<3>().0.iter_mut().zip(foreground) {
        *pixel = pixel.map(|x| x + 2.0 * (1.0 - m));
    }
    image
}

/// Replaces the moments m of rays (d, m) by the points d × m of their lines that are nearest to the origin,
/// in f64 and rounded once.
fn nearest(mut rays: Vec<f32>) -> Vec<f32> {
    for [a, b, c, x, y, z] in rays.as_chunks_mut::<PLUCKER>().0 {
        [*x, *y, *z] = moment([*a, *b, *c], [*x, *y, *z]);
    }
    rays
}

/// Refuses more tokens than a set may have.
///
/// # Errors
/// If there are more.
pub fn check_tokens(tokens: usize) -> Result<()> {
    if tokens <= MOST_TOKENS {
        return Ok(());
    }
    Err(Error::input("images")
        .expected(format!("at most {MOST_TOKENS} squares of {PATCH}x{PATCH} pixels in a set"))
        .got(tokens.to_string())
        .hint("--images-per-set reads fewer images at a time, --downscale makes them smaller"))
}

/// The images of a set as inputs.
///
/// # Errors
/// When there is none, a side is not a multiple of [`PATCH`], or they have too many tokens.
pub fn inputs(views: &Views, config: &Config) -> Result<Vec<Input>> {
    if views.all.is_empty() {
        return Err(Error::input("images").expected("at least one").got("none"));
    }
    for view in &views.all {
        let (width, height) = (view.picture.camera.width, view.picture.camera.height);
        if !width.is_multiple_of(PATCH) || !height.is_multiple_of(PATCH) {
            return Err(Error::input(view.picture.name.clone())
                .at("image size")
                .expected(format!("sides that are multiples of {PATCH} pixels"))
                .got(format!("{width}x{height}"))
                .hint("--crop-side 64 cuts a square around the object and brings it to 64 pixels"));
        }
    }
    let all: Vec<Input> = views.all.iter().map(|v| Input::of(v, &views.placement, config)).collect();
    check_tokens(all.iter().fold(0, |sum, v| sum + v.tokens()))?;
    Ok(all)
}

impl Ready<'_> {
    /// The state after one more set of images, in the axes of a placement.
    ///
    /// # Panics
    /// If a side of an image is not a multiple of [`PATCH`], or the state is not one of this model.
    pub fn read_views(&self, state: &[f32], views: &[View], at: &Placement) -> Vec<f32> {
        let inputs: Vec<Input> = views.iter().map(|view| Input::of(view, at, &self.config)).collect();
        self.read(state, &inputs, None).0
    }

    /// The state after a set of images of an object, brought to the size that models are trained with.
    ///
    /// # Errors
    /// If they cannot be shrunk.
    ///
    /// # Panics
    /// If there is no such image.
    pub fn read_chosen(
        &self,
        state: &[f32],
        views: &Views,
        which: &[usize],
        at: &Placement,
    ) -> Result<Vec<f32>> {
        Ok(self.read_views(state, &views.chosen(which).sized(INPUT_SIDE)?.all, at))
    }

    /// Reads sets of images one after the other; returns the last state, and how much each set has changed it
    /// ([`change`]).
    ///
    /// # Panics
    /// If the state is not one of this model.
    pub fn read_all(&self, state: &[f32], sets: &[Vec<Input>]) -> (Vec<f32>, Vec<f64>) {
        let (mut state, mut changes) = (state.to_vec(), Vec::with_capacity(sets.len()));
        for set in sets {
            let next = self.read(&state, set, None).0;
            changes.push(change(&state, &next));
            state = next;
        }
        (state, changes)
    }
}

/// The relative change of a state, ‖Tᵐ − Tᵐ⁻¹‖ / ‖Tᵐ‖, in f64; 1 after no state, which is zero. If ‖Tᵐ‖ is 0,
/// it is 1, or 0 if nothing moved.
pub fn change(before: &[f32], after: &[f32]) -> f64 {
    let length = |x: Vec<f64>| sum::tree_f64(&x).sqrt();
    let square = |x: f64| x * x;
    let moved = before.iter().zip(after).map(|(a, b)| square(f64::from(*b) - f64::from(*a))).collect();
    let (moved, whole) = (length(moved), length(after.iter().map(|x| square(f64::from(*x))).collect()));
    if whole > 0.0 { moved / whole } else { f64::from(u8::from(moved > 0.0)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::camera::{Camera, Model};

    #[test]
    fn a_marked_background_has_a_value_that_no_color_has() {
        // White background, a black pixel, a white one of the object, and one that is half covered with black.
        let image = [[1.0; 3], [-1.0; 3], [1.0; 3], [0.0; 3]].concat();
        let found = marked(image, &[0.0, 1.0, 1.0, 0.5]);
        assert_eq!(found, [[3.0; 3], [-1.0; 3], [1.0; 3], [1.0; 3]].concat());
    }

    #[test]
    fn a_change_is_relative_to_the_new_state() {
        assert_eq!(change(&[0.0, 0.0], &[3.0, 4.0]), 1.0, "after no state");
        assert_eq!(change(&[3.0, 0.0], &[3.0, 4.0]), 0.8);
        assert_eq!((change(&[1.0], &[0.0]), change(&[0.0], &[0.0])), (1.0, 0.0), "a state of zeros");
    }

    #[test]
    fn nearest_points_are_on_their_rays_and_at_right_angles_to_them() {
        let camera = Camera {
            rotation: [[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]],
            translation: [0.1, -0.2, 1.5],
            focal_px: [9.0, 9.0],
            center_px: [4.0, 4.0],
            width: 8,
            height: 8,
            model: Model::Pinhole,
        };
        let (rays, points) = (plucker(&camera), nearest(plucker(&camera)));
        for (ray, point) in rays.as_chunks::<PLUCKER>().0.iter().zip(points.as_chunks::<PLUCKER>().0) {
            let ([d, m], [same, c]) = ([&ray[..3], &ray[3..]], [&point[..3], &point[3..]]);
            assert_eq!(d, same);
            let three = |x: &[f32]| [x[0], x[1], x[2]];
            // The moment of a point of the line is that of the line, and no other point of the line is as near to the origin.
            let own = moment(three(c), three(d));
            assert!(own.iter().zip(m).all(|(a, b)| (a - b).abs() < 1e-6), "{own:?} {m:?}");
            assert!(((c[0] * d[0] + c[1] * d[1]) + c[2] * d[2]).abs() < 1e-6, "{c:?} {d:?}");
        }
        assert!(nearest(vec![0.0; PLUCKER]).iter().all(|x| *x == 0.0), "a pixel without a ray stays one");
    }
}
