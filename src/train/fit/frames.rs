//! A camera as a frame of `transforms.json`, in the nerfstudio dialect.

use crate::Result;
use crate::io::memory;
use crate::scene::camera::{Camera, Model};
use serde_json::{Value, json};

/// Checks an estimate of what rendering with a camera takes: bytes per pixel, and bytes beside them.
///
/// # Errors
/// When it is above the memory limit.
pub(super) fn check_memory(c: &Camera, per_pixel: u64, beside: u64) -> Result<()> {
    let pixels = c.width as u64 * c.height as u64;
    memory::check(
        &format!("an image of {}x{} pixels", c.width, c.height),
        pixels.saturating_mul(per_pixel).saturating_add(beside),
    )
}

/// World-from-camera of a camera, row-major, with OpenGL axes: x right, y up, z backward.
pub fn world_from_camera(c: &Camera) -> Value {
    let eye = c.center();
    // World-from-view is the transpose of view-from-world.
    let row = |i: usize| {
        json!([
            f64::from(c.rotation[0][i]),
            -f64::from(c.rotation[1][i]),
            -f64::from(c.rotation[2][i]),
            f64::from(eye[i])
        ])
    };
    json!([row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]])
}

/// One frame: image, size, intrinsics, pose.
pub fn frame(file_path: &str, c: &Camera) -> Value {
    json!({
        "file_path": file_path,
        "w": c.width, "h": c.height,
        "fl_x": f64::from(c.focal_px[0]), "fl_y": f64::from(c.focal_px[1]),
        "cx": f64::from(c.center_px[0]), "cy": f64::from(c.center_px[1]),
        "transform_matrix": world_from_camera(c),
    })
}

/// The `camera_model` of a projection without distortion.
pub fn model_name(model: Model) -> &'static str {
    match model {
        Model::Fisheye => "OPENCV_FISHEYE",
        Model::Orthographic => "ORTHOGRAPHIC",
        Model::Pinhole => "PINHOLE",
    }
}
