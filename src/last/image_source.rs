//! Who is shown in the images of a data set.

use super::points::{Dots, Points};
use crate::Result;
use crate::num::array::Arrays;
use crate::scene::camera::Camera;
use crate::scene::mesh::Object;
use data_gen::figure::samples::Frame;

/// Surfaces of some frames, by their place among them.
pub type Surfaces<'a> = Box<dyn Fn(usize) -> Result<Object> + Sync + 'a>;

/// Who is photographed for the sets: the figure in its looks, or a character from a file.
pub trait ImageSource: Sync {
    /// How large its points are drawn.
    fn dots(&self) -> &Dots;

    /// The arrays of `template.npz`.
    fn rest(&self) -> Arrays;

    /// The points of a frame, shaded.
    ///
    /// # Errors
    /// When it cannot take the pose.
    fn points(&self, frame: &Frame) -> Result<Points>;

    /// The camera of every picture, the one that trains in a video; square pictures of the given side.
    fn camera(&self, side: usize) -> Camera;

    /// Prepares the surfaces of some frames.
    fn surfaces<'a>(&'a self, frames: &'a [&'a Frame]) -> Surfaces<'a>;
}
