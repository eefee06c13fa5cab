//! A camera as a frame of `transforms.json`, in the nerfstudio dialect.

use crate::Result;
use crate::io::capture::clean;
use crate::io::memory;
use crate::scene::camera::{Camera, Model};
use crate::scene::views::{View, Views};
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

/// Cameras of a fit as a `transforms.json`, beside the scene file named `scene` that was fitted; which of
/// them were held out is listed.
pub fn cameras(views: &Views, scene: &str) -> Value {
    // A name that leads elsewhere would be refused when the file is read.
    let name = |view: &View| clean(&view.name).unwrap_or_else(|_| view.name.replace(['/', '\\', ':'], "_"));
    let model = |view: &View| json!(model_name(view.camera.model));
    let first = views.views.first().map_or(Value::Null, model);
    let list = views.views.iter().map(|view| {
        let mut frame = frame(&name(view), &view.camera);
        if model(view) != first {
            frame["camera_model"] = model(view);
        }
        frame
    });
    let names = |which: &[usize]| which.iter().map(|&i| name(&views.views[i])).collect::<Vec<_>>();
    json!({
        "camera_model": first, SCENE: scene, "train_filenames": names(&views.train), "test_filenames": names(&views.test),
        "frames": list.collect::<Vec<_>>(),
    })
}

/// Key of the scene file that a `transforms.json` lies beside.
pub(super) const SCENE: &str = "scene";

/// The `camera_model` of a projection without distortion.
pub fn model_name(model: Model) -> &'static str {
    match model {
        Model::Fisheye => "OPENCV_FISHEYE",
        Model::Orthographic => "ORTHOGRAPHIC",
        Model::Pinhole => "PINHOLE",
    }
}
