//! Miniatures of published captures of one object: a sphere, in which cameras, depth, normals and light agree.

#![allow(dead_code, reason = "a member of tests/ uses a part of them")]

use lastlight::io::image_file;
use lastlight::io::npy;
use lastlight::num::array::Array;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

pub(crate) const SIDE: usize = 24;
pub(crate) const RADIUS: f64 = 0.4;
pub(crate) const CENTER: [f64; 3] = [0.1, -0.05, 0.2];
pub(crate) const FOV: f64 = 0.9;

pub(crate) type Vector = [f64; 3];

pub(crate) fn dot(a: Vector, b: Vector) -> f64 {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

pub(crate) fn unit(a: Vector) -> Vector {
    let l = dot(a, a).sqrt();
    a.map(|x| x / l)
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// A camera with OpenGL axes.
pub(crate) struct Camera {
    pub(crate) eye: Vector,
    /// Right, up, backward.
    pub(crate) axes: [Vector; 3],
}

impl Camera {
    /// Camera i of an orbit, directed a little beside the sphere.
    pub(crate) fn at(i: usize) -> Self {
        let (a, h) = (1.1 * i as f64 + 0.3, 0.4 + 0.3 * i as f64);
        let eye = [1.3 * libm::cos(a), 1.3 * libm::sin(a), h];
        let backward = unit(std::array::from_fn(|k| eye[k] - CENTER[k] - 0.03 * k as f64));
        let right = unit(cross([0.0, 0.0, 1.0], backward));
        Self { eye, axes: [right, cross(backward, right), backward] }
    }

    pub(crate) fn matrix(&self) -> Value {
        let row = |k: usize| json!([self.axes[0][k], self.axes[1][k], self.axes[2][k], self.eye[k]]);
        json!([row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]])
    }

    /// World direction through the middle of a pixel with z = 1 along the axis.
    pub(crate) fn ray(&self, pixel: usize) -> Vector {
        let f = 0.5 * SIDE as f64 / libm::tan(0.5 * FOV);
        let half = 0.5 * SIDE as f64;
        let x = ((pixel % SIDE) as f64 + 0.5 - half) / f;
        let y = ((pixel / SIDE) as f64 + 0.5 - half) / f;
        std::array::from_fn(|k| x * self.axes[0][k] - y * self.axes[1][k] - self.axes[2][k])
    }

    /// Depth z and normal of the sphere.
    pub(crate) fn hit(&self, pixel: usize) -> Option<(f64, Vector)> {
        let d = self.ray(pixel);
        let o: Vector = std::array::from_fn(|k| self.eye[k] - CENTER[k]);
        let (a, b, c) = (dot(d, d), dot(o, d), dot(o, o) - RADIUS * RADIUS);
        let inside = b * b - a * c;
        let z = (-b - inside.sqrt()) / a;
        (inside > 0.0).then(|| (z, std::array::from_fn(|k| (o[k] + z * d[k]) / RADIUS)))
    }

    pub(crate) fn own(&self, v: Vector) -> Vector {
        self.axes.map(|axis| dot(axis, v))
    }

    /// Radiance of a pixel: the normal as a colour.
    pub(crate) fn radiance(&self, pixel: usize) -> [f32; 3] {
        self.hit(pixel).map_or([0.0; 3], |(_, n)| n.map(|x| (0.4 + 0.3 * x) as f32))
    }
}

pub(crate) fn put(path: &Path, bytes: &[u8]) {
    std::fs::create_dir_all(path.parent().expect("inside a folder")).expect("made");
    std::fs::write(path, bytes).expect("written");
}

pub(crate) fn png(path: &Path, channels: usize, values: impl Fn(usize) -> Vec<f32>) {
    let all: Vec<f32> = (0..SIDE * SIDE).flat_map(values).collect();
    let bytes = image_file::to_u8(&all).expect("numbers");
    put(path, &image_file::png_bytes(SIDE, SIDE, channels, &bytes).expect("an image"));
}

pub(crate) fn exr(path: &Path, [w, h]: [usize; 2], names: &[&str], values: impl Fn(usize) -> Vec<f32>) {
    let all: Vec<f32> = (0..w * h).flat_map(values).collect();
    put(path, &image_file::exr_bytes(w, h, names, &all).expect("an image"));
}

pub(crate) fn array(path: &Path, channels: usize, values: impl Fn(usize) -> Vec<f32>) {
    let all: Vec<f32> = (0..SIDE * SIDE).flat_map(values).collect();
    let shape = if channels == 1 { vec![SIDE, SIDE] } else { vec![SIDE, SIDE, channels] };
    put(path, &npy::to_bytes(&Array::new(&shape, all)));
}

pub(crate) fn mask(path: &Path, c: &Camera) {
    png(path, 1, |p| vec![f32::from(u8::from(c.hit(p).is_some()))]);
}

pub(crate) fn encoded(x: f32) -> f32 {
    (1.055 * libm::pow(f64::from(x), 1.0 / 2.4) - 0.055) as f32
}

/// A map in the axes of a camera: the world direction as a colour.
fn probe(path: &Path, c: &Camera) {
    let [w, h] = [64, 32];
    exr(path, [w, h], &["R", "G", "B"], |i| {
        let azimuth = ((i % w) as f64 + 0.5) / w as f64 * 2.0 - 1.0;
        let (phi, theta) =
            (azimuth * std::f64::consts::PI, ((i / w) as f64 + 0.5) / h as f64 * std::f64::consts::PI);
        // u = atan2(X, −Z)/2π + ½, v = acos(Y)/π in OpenGL axes of the camera.
        let own = [libm::sin(theta) * libm::sin(phi), libm::cos(theta), -libm::sin(theta) * libm::cos(phi)];
        (0..3).map(|k| (2.0 + (0..3).fold(0.0, |s, a| s + own[a] * c.axes[a][k])) as f32).collect()
    });
}

/// Writes a set like Stanford-ORB's; gives the folder of the object. Cameras 0, 1, 2 are for training, 3 is held out, 4 is another scene.
pub(crate) fn orb(root: &Path) -> PathBuf {
    let scene = |set: &str, scene: &str| root.join(set).join(scene);
    let list = |of: &[usize], folder: &str| {
        let frames: Vec<Value> = of
            .iter()
            .map(|i| json!({"file_path": format!("{folder}/{i:04}"), "transform_matrix": Camera::at(*i).matrix()}))
            .collect();
        json!({"camera_angle_x": FOV, "frames": frames})
    };
    for set in ["blender_LDR", "blender_HDR"] {
        for (of, folder, name) in [
            (&[0usize, 1, 2][..], "train", "ball_scene001"),
            (&[3], "test", "ball_scene001"),
            (&[4], "test", "ball_scene002"),
        ] {
            for i in of {
                let (dir, c) = (scene(set, name), Camera::at(*i));
                mask(&dir.join(format!("{folder}_mask/{i:04}.png")), &c);
                let file = dir.join(format!("{folder}/{i:04}"));
                match set {
                    "blender_LDR" => {
                        png(&file.with_extension("png"), 3, |p| c.radiance(p).map(encoded).to_vec())
                    }
                    _ => exr(&file.with_extension("exr"), [SIDE; 2], &["R", "G", "B"], |p| {
                        c.radiance(p).to_vec()
                    }),
                }
            }
        }
        let dir = scene(set, "ball_scene001");
        put(&dir.join("transforms_train.json"), list(&[0, 1, 2], "train").to_string().as_bytes());
        put(&dir.join("transforms_test.json"), list(&[3], "test").to_string().as_bytes());
        let mut novel = list(&[4], "test");
        novel["frames"][0]["scene_name"] = json!("ball_scene002");
        put(&dir.join("transforms_novel.json"), novel.to_string().as_bytes());
    }
    let truth = root.join("ground_truth");
    let c = Camera::at(3);
    let own = truth.join("ball_scene001");
    array(&own.join("z_depth/0003.npy"), 1, |p| vec![c.hit(p).map_or(-1.0, |(z, _)| z as f32)]);
    array(&own.join("surface_normal/0003.npy"), 3, |p| {
        c.hit(p).map_or(vec![0.0; 3], |(_, n)| c.own(n).map(|x| x as f32).to_vec())
    });
    png(&own.join("pseudo_gt_albedo/0003.png"), 3, |_| vec![0.6, 0.4, 0.2]);
    put(&own.join("mesh_blender/mesh.obj"), b"v 0 0 1\nv 1 0 1\nv 0 2 1\nf 1 2 3\n");
    probe(&own.join("env_map/0003.exr"), &c);
    probe(&truth.join("ball_scene002/env_map/0004.exr"), &Camera::at(4));
    root.join("blender_LDR/ball_scene001")
}

/// Writes a set like the renders of DTC; gives its folder.
pub(crate) fn dtc(root: &Path) -> PathBuf {
    let images = root.join("ball/images");
    let poses: Vec<Value> = (0..4).map(|i| Camera::at(i).matrix()).collect();
    let rig =
        json!({"intrinsic": {"width": SIDE, "height": SIDE, "fov": FOV.to_degrees()}, "to_world": poses});
    put(&images.join("CameraRig.json"), rig.to_string().as_bytes());
    let info = json!({"rgb": {"autoexposure_scale": [0.5, 1.0, 1.5, 2.0], "sensor_gain": [2, 2, 2, 2]}});
    put(&images.join("image_process_info.json"), info.to_string().as_bytes());
    for i in 0..4 {
        let (c, file) =
            (Camera::at(i), |kind: &str, end: &str| images.join(format!("rgb/{kind}{i:07}.{end}")));
        png(&file("rgb", "png"), 3, |p| c.radiance(p).map(encoded).to_vec());
        mask(&file("mask", "png"), &c);
        exr(&file("depth", "exr"), [SIDE; 2], &["Z"], |p| vec![c.hit(p).map_or(0.0, |(z, _)| z as f32)]);
        exr(&file("normal", "exr"), [SIDE; 2], &["R", "G", "B"], |p| {
            c.hit(p).map_or(vec![0.0; 3], |(_, n)| n.map(|x| x as f32).to_vec())
        });
        png(&file("metallic_roughness", "png"), 3, |_| vec![0.2, 0.6, 0.0]);
    }
    root.join("ball")
}
