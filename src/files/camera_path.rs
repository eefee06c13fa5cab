//! `camera_path.json` of the nerfstudio viewer: cameras without images.
//!
//! Per camera: `camera_to_world`, 16 numbers row by row with OpenGL axes, and `fov`, the vertical field of
//! view in degrees; for all of them `render_width`, `render_height` and `camera_type`, which must be
//! `perspective`.

use super::frame::Frame;
use super::transforms::parse;
use super::{name_of, read_bytes};
use crate::{Error, Result};
use serde_json::{Value, json};
use std::path::Path;

/// Longest file read, in bytes.
const MAX_BYTES: u64 = 64 << 20;

/// The cameras of a file in their order; `None` if it is not such a file.
///
/// # Errors
/// When it is one and malformed.
pub(super) fn read(path: &Path) -> Result<Option<Vec<Frame>>> {
    let bytes = read_bytes(path, MAX_BYTES)?;
    // Anything else is for the other readers, with their own errors.
    let Ok(value) = serde_json::from_slice::<Value>(&bytes) else { return Ok(None) };
    if value.get("camera_path").is_none() { Ok(None) } else { frames(&value, &name_of(path)).map(Some) }
}

fn frames(value: &Value, name: &str) -> Result<Vec<Frame>> {
    let error = |at: String, expected: &str, got: Option<&Value>| {
        let got = got.map_or_else(|| "nothing".to_owned(), |v| v.to_string().chars().take(60).collect());
        Error::input(name).at(at).expected(expected).got(got)
    };
    if let Some(kind) = value.get("camera_type").filter(|t| t.as_str() != Some("perspective")) {
        return Err(error("camera_type".into(), "perspective", Some(kind)));
    }
    let side = |key: &str| {
        let length = value.get(key).and_then(Value::as_u64).filter(|n| *n > 0);
        length.ok_or_else(|| error(key.into(), "a whole number of pixels", value.get(key)))
    };
    let (width, height) = (side("render_width")?, side("render_height")?);
    let Some(list) = value["camera_path"].as_array().filter(|list| !list.is_empty()) else {
        return Err(error("camera_path".into(), "a list of cameras", value.get("camera_path")));
    };
    let mut out = Vec::with_capacity(list.len());
    for (i, camera) in list.iter().enumerate() {
        let at = |key: &str| format!("camera_path[{i}].{key}");
        let pose = camera.get("camera_to_world");
        let Some(m) = pose.and_then(Value::as_array).filter(|m| m.len() == 16) else {
            return Err(error(at("camera_to_world"), "16 numbers", pose));
        };
        let fov = camera.get("fov").and_then(Value::as_f64).filter(|x| (0.1..179.0).contains(x));
        let fov = fov.ok_or_else(|| error(at("fov"), "0.1 to 179 degrees", camera.get("fov")))?;
        let focal = 0.5 * height as f64 / libm::tan(0.5 * fov.to_radians());
        out.push(json!({
            "file_path": format!("{i:05}"), "w": width, "h": height, "fl_x": focal, "fl_y": focal,
            "transform_matrix": m.chunks(4).collect::<Vec<_>>(),
        }));
    }
    Ok(parse(json!({"frames": out}).to_string().as_bytes(), name)?.frames)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::frame::Focal;

    fn path(fov: f64) -> Value {
        let pose = [1.0, 0.0, 0.0, 2.0, 0.0, 1.0, 0.0, 3.0, 0.0, 0.0, 1.0, 4.0, 0.0, 0.0, 0.0, 1.0];
        json!({
            "camera_type": "perspective", "render_width": 64, "render_height": 48, "fps": 24,
            "camera_path": [{"camera_to_world": pose, "fov": fov, "aspect": 1.5}],
        })
    }

    #[test]
    fn cameras_have_a_vertical_field_of_view() {
        let f = frames(&path(90.0), "p").expect("valid");
        let Focal::Pixels([fx, fy]) = f[0].focal else { panic!("pixels") };
        assert!((fx - 24.0).abs() < 1e-9 && fx == fy, "half the height: {fx}");
        assert_eq!((f[0].size, f[0].name.as_str()), (Some([64, 48]), "00000"), "size and name");
        assert_eq!(f[0].view_from_world[2], [0.0, 0.0, -1.0, 4.0], "OpenGL axes are turned");
        for (key, bad) in
            [("camera_type", json!("fisheye")), ("render_width", json!(0)), ("camera_path", json!([]))]
        {
            let mut value = path(90.0);
            value[key] = bad;
            assert!(frames(&value, "p").expect_err("refused").to_string().contains(key), "{key}");
        }
        assert!(frames(&path(180.0), "p").expect_err("refused").to_string().contains("fov"), "a flat angle");
    }
}
