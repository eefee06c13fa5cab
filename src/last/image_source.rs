//! The subject shown in the images of a data set.

use super::points::{Dots, Points};
use crate::Result;
use crate::num::array::Arrays;
use crate::scene::camera::Camera;
use crate::scene::mesh::Object;
use data_gen::figure::samples::Frame;

/// A function that returns the surfaces of a frame, given its position in a list of frames.
pub type Surfaces<'a> = Box<dyn Fn(usize) -> Result<Object> + Sync + 'a>;

/// The subject rendered for the sets: the figure in its appearances, or a character from a file.
pub trait ImageSource: Sync {
    /// Sizes at which its points are drawn.
    fn dots(&self) -> &Dots;

    /// The arrays of `template.npz`.
    fn rest(&self) -> Arrays;

    /// The shaded points of a frame.
    ///
    /// # Errors
    /// If the subject cannot be posed as requested.
    fn points(&self, frame: &Frame) -> Result<Points>;

    /// The camera of every image, which is the training camera of the video; images are square with the given
    /// side.
    fn camera(&self, side: usize) -> Camera;

    /// Prepares the surfaces of some frames.
    fn surfaces<'a>(&'a self, frames: &'a [&'a Frame]) -> Surfaces<'a>;
}
