//! The box around a person: posed points, grown by [`PersonCapture::box_margin`] on every side, as a camera
//! sees it ([`bound`]).

use super::{PersonCapture, Shot};
use crate::Result;
use crate::scene::bound;
use crate::scene::camera::Model;

impl PersonCapture {
    /// Lower and upper corner of the box of a moment.
    ///
    /// # Errors
    /// For a template without points.
    pub fn bounds(&self, time: usize) -> Result<[[f32; 3]; 2]> {
        bound::bounds(&self.posed_points(time), self.box_margin)
    }

    /// (H, W) 1 inside the projected box of the shot's moment, 0 outside. All pixels of the image count where
    /// the box is no polygon (a fisheye bends its edges) or reaches behind the camera.
    pub fn box_mask(&self, shot: &Shot) -> Vec<f32> {
        let camera = &shot.camera;
        let mask = self.bounds(shot.time).and_then(|bounds| bound::bound_mask(camera, bounds));
        match mask {
            Ok(mask) if camera.model != Model::Fisheye => mask,
            _ => vec![1.0; camera.height * camera.width],
        }
    }
}
