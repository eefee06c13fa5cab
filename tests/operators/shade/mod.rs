//! Materials and light: operators against golden arrays and closed forms, the environment as a light, images
//! of paths.

mod emitters;
mod environment;
mod limits;
mod operators;
mod paths;
mod pictures;
mod vectors;

use lastlight::geometry::bvh::Bvh;
use lastlight::scene::camera::{Camera, Model};
use lastlight::scene::light::Lights;
use lastlight::scene::material::Material;
use lastlight::scene::mesh::{Mesh, Object};
use lastlight::shade::render::{Passes, Scene, Settings, render};
use lastlight::shade::vector::{cross, dot, sub, unit};

/// Directional albedo ∫ f cos dω of a white surface: (metallic, roughness) and n·v = 0.1, 0.5, 0.9. By
/// another program: numpy in f64, half vectors on a grid stratified by D·n·h.
const ALBEDO: [(f32, f32, [f64; 3]); 6] = [
    (0.0, 0.3, [1.34391, 1.07012, 1.03968]),
    (0.0, 0.6, [1.12433, 1.04631, 1.03297]),
    (0.0, 1.0, [1.05332, 1.02090, 1.01326]),
    (1.0, 0.3, [0.88494, 0.97510, 0.98942]),
    (1.0, 0.6, [0.88249, 0.78212, 0.81456]),
    (1.0, 1.0, [0.76021, 0.45069, 0.32751]),
];
/// n·v of the columns of [`ALBEDO`].
const COSINES: [f32; 3] = [0.1, 0.5, 0.9];

/// Counter-drawn numbers.
fn uniform(item: usize, draw: u16) -> f32 {
    lastlight::num::rng::Rng::new(5).uniform_f32(item as u64, 0, 0, draw)
}

/// A unit vector, uniform on the sphere.
fn on_sphere(item: usize, draw: u16) -> [f32; 3] {
    let r = lastlight::num::rng::Rng::new(6);
    unit(std::array::from_fn(|k| r.normal_f32(item as u64, k as u32, 0, draw))).0
}

/// A camera at `eye` directed at `at`, z up unless its direction is along z.
fn look(eye: [f32; 3], at: [f32; 3], fov_rad: f64, width: usize, height: usize) -> Camera {
    let z = unit(sub(at, eye)).0;
    let up = if z[2].abs() > 0.99 { [0.0, 1.0, 0.0] } else { [0.0, 0.0, 1.0] };
    let x = unit(cross(z, up)).0;
    let y = cross(z, x);
    let f = (0.5 * height as f64 / libm::tan(0.5 * fov_rad)) as f32;
    Camera {
        rotation: [x, y, z],
        translation: [-dot(x, eye), -dot(y, eye), -dot(z, eye)],
        focal_px: [f; 2],
        center_px: [0.5 * width as f32, 0.5 * height as f32],
        width,
        height,
        model: Model::Pinhole,
    }
}

/// A latitude–longitude sphere of n bands.
fn sphere(radius: f32, n: usize, smooth: bool) -> Mesh {
    let mut mesh = Mesh::default();
    for i in 0..=n {
        for j in 0..=2 * n {
            let (t, p) = (
                std::f64::consts::PI * i as f64 / n as f64,
                std::f64::consts::PI * (j % (2 * n)) as f64 / n as f64,
            );
            let d =
                [libm::sin(t) * libm::cos(p), libm::sin(t) * libm::sin(p), libm::cos(t)].map(|x| x as f32);
            mesh.positions.push(d.map(|x| radius * x));
            mesh.uvs.push([j as f32 / (2 * n) as f32, i as f32 / n as f32]);
            if smooth {
                mesh.normals.push(d);
            }
        }
    }
    let across = 2 * n + 1;
    for i in 0..n {
        for j in 0..2 * n {
            let a = (i * across + j) as u32;
            let w = across as u32;
            mesh.triangles.extend([[a, a + w, a + w + 1], [a, a + w + 1, a + 1]]);
        }
    }
    mesh
}

/// A square of half-size `half` in the plane z = 0, seen from above; texture coordinates with v down in −y.
fn square(half: f32) -> Mesh {
    Mesh {
        positions: vec![[-half, -half, 0.0], [half, -half, 0.0], [half, half, 0.0], [-half, half, 0.0]],
        normals: Vec::new(),
        uvs: vec![[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    }
}

/// One mesh of one material.
fn object(mesh: Mesh, material: Material) -> Object {
    Object { material_of: vec![0; mesh.triangles.len()], mesh, materials: vec![material] }
}

/// Renders an object under light.
fn shoot(object: &Object, lights: &Lights, camera: &Camera, settings: &Settings) -> Passes {
    let bvh = Bvh::build(&object.mesh.positions, &object.mesh.triangles);
    let scene = Scene::new(object, &bvh, lights).expect("a good scene");
    render(&scene, camera, None, settings).expect("a good camera")
}
