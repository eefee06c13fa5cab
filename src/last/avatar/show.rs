//! Renders a fitted person from any camera, with the Gaussian blur scaled to the resolution of the fit; also
//! creates cameras around the person.
//!
//! The renderer widens every Gaussian by a fixed fraction of a pixel (`blur_px2`, b), and a fit learns shapes
//! that are correct with this blur at the resolution of its input images: many Gaussians are thinner than a
//! pixel and cover it only because of b. In an enlarged image a pixel is smaller relative to the person, the
//! same b covers less of the surface, and the surface dissolves into isolated dots. An enlarged image
//! therefore uses the blur of the fit, converted to its own pixels:
//!
//! b′ = b · max(1, m)²,   m = s(camera) / max over the capture's cameras of s,   s = √(f_x f_y) / z
//!
//! with z the depth of the middle of the person; an orthographic camera has s = √(f_x f_y). For a camera of
//! the capture, the image is bit-identical to the one that is scored.

use super::store::Stored;
use crate::Result;
use crate::fit::orbit::Orbit;
use crate::num::order;
use crate::scene::camera::{Camera, Model};
use crate::scene::person::Pose;
use crate::splat::render::{Out, Settings};

/// Free margin around a person in an orbit, as a fraction of its extent.
const MARGIN: f32 = 0.05;

/// Pixels per unit of length at a position; 0 if the camera does not see it.
fn scale(camera: &Camera, place: [f32; 3], near: f32) -> f32 {
    let r = camera.rotation[2];
    let z = ((r[0] * place[0] + r[1] * place[1]) + r[2] * place[2]) + camera.translation[2];
    let focal = (camera.focal_px[0] * camera.focal_px[1]).sqrt();
    match camera.model {
        _ if !(z >= near) => 0.0,
        Model::Orthographic => focal,
        Model::Pinhole | Model::Fisheye => focal / z,
    }
}

impl Stored {
    /// Renders a pose from a camera; `moment` is the moment of the capture with this pose, if there is one.
    ///
    /// # Errors
    /// If the camera is invalid or the pose belongs to another body.
    pub fn picture(&self, pose: &Pose, moment: Option<usize>, camera: &Camera) -> Result<Out> {
        self.avatar.drawn(pose, moment, camera, &self.settings_for(pose, camera))
    }

    fn settings_for(&self, pose: &Pose, camera: &Camera) -> Settings {
        let mut settings = self.avatar.render.clone();
        let near = settings.profile.near;
        let middle = self.middle(std::slice::from_ref(pose)).0;
        let most =
            |place| self.cameras.iter().fold(0.0, |most, (_, c)| order::max(most, scale(c, place, near)));
        let mut seen = most(middle);
        if seen == 0.0
            && let Some(first) = self.poses.first()
        {
            // A pose of a person at a different position.
            seen = most(self.middle(std::slice::from_ref(first)).0);
        }
        let magnified = scale(camera, middle, near) / seen;
        if magnified > 1.0 && magnified.is_finite() {
            settings.profile.blur_px2 *= magnified * magnified;
        }
        settings
    }

    /// Centre of the bounding box of the body over some poses, and the largest distance of a point from it.
    fn middle(&self, poses: &[Pose]) -> ([f32; 3], f32) {
        let template = &self.avatar.body.template;
        let points: Vec<[f32; 3]> =
            poses.iter().flat_map(|p| template.posed(&p.transforms, &p.axis_angles)).collect();
        let middle = std::array::from_fn(|k| {
            let low = points.iter().fold(f32::INFINITY, |m, x| order::min(m, x[k]));
            let high = points.iter().fold(f32::NEG_INFINITY, |m, x| order::max(m, x[k]));
            0.5 * (low + high)
        });
        let far = points.iter().fold(0.0, |m, x| {
            let d: [f32; 3] = std::array::from_fn(|k| x[k] - middle[k]);
            order::max(m, (d[0] * d[0] + d[1] * d[1]) + d[2] * d[2])
        });
        (middle, far.sqrt())
    }

    /// A circle of cameras whose images contain the whole person in all of the given poses; a given centre or
    /// distance is kept.
    ///
    /// # Errors
    /// If a value of the orbit is out of range.
    pub fn around(&self, orbit: Orbit, poses: &[Pose]) -> Result<Vec<Camera>> {
        let (middle, reach) = self.middle(poses);
        let orbit = Orbit {
            center: orbit.center.or(Some(middle)),
            radius: orbit.radius.or_else(|| Some(orbit.distance((1.0 + MARGIN) * reach))),
            ..orbit
        };
        Ok(orbit.shots(&self.avatar.gaussians)?.into_iter().map(|s| s.camera).collect())
    }
}
