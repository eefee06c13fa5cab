//! What images show: orientation, cameras, materials, odd meshes, exposure.

use super::{look, object, shoot, sphere, square};
use lastlight::io::image_file;
use lastlight::scene::camera::{Camera, Model};
use lastlight::scene::light::{Environment, Lights};
use lastlight::scene::material::{Alpha, Material, Texture, Transfer, Wrap};
use lastlight::scene::mesh::Object;
use lastlight::shade::render::{Brdf, Scene, Settings};
use lastlight::shade::vector::{dot, unit};
use lastlight::shade::{axes, exposure, tonemap};
use std::sync::Arc;

fn near(a: [f32; 3], b: [f32; 3], by: f32) -> bool {
    (0..3).all(|k| (a[k] - b[k]).abs() <= by)
}

fn few() -> Settings {
    Settings { samples: 4, bounces: 0, seed: 1, ..Settings::default() }
}

#[test]
fn a_view_along_each_axis_shows_the_colour_of_that_axis() {
    let lights = Lights { environment: Some(axes::map(128)), lamps: Vec::new() };
    let nothing = Object { materials: vec![Material::default()], ..Object::default() };
    for (i, (axis, color)) in axes::AXES.into_iter().enumerate() {
        let view = look([0.0; 3], axis, 0.8, 33, 33);
        let out = shoot(&nothing, &lights, &view, &few());
        let middle = if i % 2 == 1 { color.map(|x| 0.25 * x) } else { color };
        assert!(near(out.color[16 * 33 + 16], middle, 0.02), "axis {axis:?}: {:?}", out.color[16 * 33 + 16]);
        let ring = out.color[16 * 33 + 26]; // about 14 degrees to the side
        assert!(near(ring, color, 0.02), "around axis {axis:?}: {ring:?}, want {color:?}");
        assert!(out.alpha.iter().all(|a| *a == 0.0), "nothing is met");
    }
    // Looking to +y with z up and 57° to every side: +x is to the right, beyond the border, and so are −x on
    // the left, +z above, −z below. Between the discs the map is grey, lighter above the horizon.
    let wide = look([0.0; 3], [0.0, 1.0, 0.0], 2.0, 101, 101);
    let out = shoot(&nothing, &lights, &wide, &few());
    let at = |x: usize, y: usize| out.color[y * 101 + x];
    for x in [4, 96] {
        assert!(near(at(x, 44), [0.4; 3], 1e-6), "above the horizon, column {x}: {:?}", at(x, 44));
        assert!(near(at(x, 56), [0.2; 3], 1e-6), "below it, column {x}: {:?}", at(x, 56));
    }
    // With a view half as wide again the discs themselves come in, each on its side.
    let wider = look([0.0; 3], [0.0, 1.0, 0.0], 2.8, 101, 101);
    let out = shoot(&nothing, &lights, &wider, &few());
    let at = |x: usize, y: usize| out.color[y * 101 + x];
    let sides =
        [("right", at(99, 50), 0), ("left", at(1, 50), 1), ("above", at(50, 1), 4), ("below", at(50, 99), 5)];
    for (side, got, axis) in sides {
        assert!(near(got, axes::AXES[axis].1, 0.02), "{side} of +y: {got:?}, want {:?}", axes::AXES[axis].1);
    }
    let turned = look([0.0; 3], [1.0, 1.0, 0.0], 1.8, 101, 101);
    let out = shoot(&nothing, &lights, &turned, &few());
    let (left, right) = (out.color[50 * 101 + 10], out.color[50 * 101 + 90]);
    assert!(near(right, axes::AXES[0].1, 0.05), "+x is right of +y, got {right:?}");
    assert!(near(left, axes::AXES[2].1, 0.05), "+y is left of +x, got {left:?}");
}

/// The image in the book was made by another program.
#[test]
fn the_book_shows_the_axes_map() {
    use base64::Engine as _;
    let chapter = include_str!("../../../src/book/light_and_rays.md");
    let (_, rest) = chapter.split_once("data:image/png;base64,").expect("an image in the chapter");
    let text = rest.lines().next().expect("a line");
    let png = base64::engine::general_purpose::STANDARD.decode(text).expect("base64");
    let picture = image_file::parse(&png, "the image of the book").expect("a PNG");
    let map = axes::map(128);
    assert_eq!((picture.width, picture.height), (map.width, map.height), "size");
    let want = tonemap::srgb_u8(&map.radiance, 1.0);
    let n = picture.channels.len();
    for (i, want) in want.chunks_exact(3).enumerate() {
        let got = [0, 1, 2].map(|c| (255.0 * picture.value(n * i + c)).round() as u8);
        assert_eq!(got, want, "row {}, column {}", i / map.width, i % map.width);
    }
}

/// A mirror ball seen along +y by parallel rays: the normal at 45° to the right reflects +x, at 45° above +z,
/// in the middle −y.
#[test]
fn a_mirror_ball_shows_the_axes_where_it_should() {
    let lights = Lights { environment: Some(axes::map(128)), lamps: Vec::new() };
    let chrome = Material { metallic: 1.0, roughness: 0.0, ..Material::default() };
    let ball = object(sphere(1.0, 96, true), chrome);
    let side = 101;
    let mut view = look([0.0, -5.0, 0.0], [0.0; 3], 0.5, side, side);
    view.model = Model::Orthographic;
    view.focal_px = [45.0; 2]; // the ball has a radius of 45 pixels
    let out = shoot(&ball, &lights, &view, &Settings { samples: 16, ..few() });
    let at = |x: f32, z: f32| {
        let (i, j) = ((50.5 + 45.0 * x) as usize, (50.5 - 45.0 * z) as usize);
        out.color[j * side + i]
    };
    let d = std::f32::consts::FRAC_1_SQRT_2;
    let places = [((d, 0.0), 0), ((-d, 0.0), 1), ((0.0, d), 4), ((0.0, -d), 5)];
    for ((x, z), axis) in places {
        let (_, color) = axes::AXES[axis];
        let got = at(x, z);
        let want = if axis % 2 == 1 { color.map(|c| 0.25 * c) } else { color };
        assert!(near(got, want, 0.1), "at ({x}, {z}): {got:?}, want {want:?}");
    }
    let got = at(0.0, 0.0);
    assert!(near(got, axes::AXES[3].1.map(|c| 0.25 * c), 0.05), "the middle shows −y: {got:?}");
    assert!(near(out.normal[50 * side + 50], [0.0, -1.0, 0.0], 0.03), "its normal points to the camera");
    assert!(
        (out.depth_z[50 * side + 50] - 4.0).abs() < 2e-3,
        "its depth is 4: {}",
        out.depth_z[50 * side + 50]
    );
}

/// Rays are the inverse of the projection of every model.
#[test]
fn rays_go_through_the_pixels_they_are_named_after() {
    for model in [Model::Pinhole, Model::Orthographic, Model::Fisheye] {
        let mut c = look([1.0, -2.0, 0.5], [0.2, 0.1, 0.0], 0.9, 64, 48);
        c.model = model;
        c.focal_px = [40.0, 44.0];
        for i in 0..50 {
            let px = [64.0 * super::uniform(i, 50), 48.0 * super::uniform(i, 51)];
            let (origin, direction) = c.ray(px).expect("inside the circle");
            assert!((dot(direction, direction) - 1.0).abs() < 1e-5, "unit");
            let p: [f32; 3] = std::array::from_fn(|k| origin[k] + 3.0 * direction[k]);
            let x: [f32; 3] = std::array::from_fn(|k| dot(c.rotation[k], p) + c.translation[k]);
            let got = match model {
                Model::Pinhole => [x[0] / x[2], x[1] / x[2]],
                Model::Orthographic => [x[0], x[1]],
                Model::Fisheye => {
                    let rho = (x[0] * x[0] + x[1] * x[1]).sqrt();
                    let ratio = libm::atan2f(rho, x[2]) / rho;
                    [x[0] * ratio, x[1] * ratio]
                }
            };
            for k in 0..2 {
                let got = got[k] * c.focal_px[k] + c.center_px[k];
                assert!((got - px[k]).abs() < 2e-3, "{model:?}: {got}, want {}", px[k]);
            }
        }
    }
    let mut c = look([0.0; 3], [0.0, 1.0, 0.0], 0.9, 64, 64);
    (c.model, c.focal_px) = (Model::Fisheye, [5.0; 2]);
    assert!(c.ray([1.0, 1.0]).is_none(), "beyond 180 degrees there is no ray");
}

#[test]
fn poses_between_two_move_evenly() {
    let (a, b) =
        (look([0.0, -3.0, 0.0], [0.0; 3], 0.8, 8, 8), look([1.0, -3.0, 0.5], [1.0, 0.0, 0.5], 0.8, 8, 8));
    let c = a.between(&b, 0.5).center();
    assert!(near(c, [0.5, -3.0, 0.25], 1e-5), "{c:?}");
    let turned = look([0.0, -3.0, 0.0], [3.0, 0.0, 0.0], 0.8, 8, 8);
    let half = a.between(&turned, 0.5);
    let want =
        unit([libm::sinf(std::f32::consts::FRAC_PI_8), libm::cosf(std::f32::consts::FRAC_PI_8), 0.0]).0;
    assert!(near(half.rotation[2], want, 1e-5), "half of 45 degrees: {:?}", half.rotation[2]);
    for end in [&a, &turned] {
        let same = a.between(end, 0.0);
        assert!((0..3).all(|k| near(same.rotation[k], a.rotation[k], 1e-6)), "time 0 is the first pose");
    }
}

/// A square of 0.5 that crosses a pixel row within the shutter covers what it passes half of the time.
#[test]
fn motion_blurs_what_moves() {
    let plane = object(square(0.5), Material::default());
    let camera = |x: f32| Camera { translation: [x, 0.0, 5.0], ..flat() };
    let sharp = shoot(&plane, &Lights::default(), &camera(0.0), &Settings { samples: 64, ..few() });
    let bvh = lastlight::geometry::bvh::Bvh::build(&plane.mesh.positions, &plane.mesh.triangles);
    let lights = Lights::default();
    let scene = Scene::new(&plane, &bvh, &lights).expect("a good scene");
    let moving = lastlight::shade::render::render(
        &scene,
        &camera(0.0),
        Some(&camera(1.0)),
        &Settings { samples: 64, ..few() },
    );
    let moving = moving.expect("good cameras");
    let row = |alpha: &[f32]| alpha[16 * 32..17 * 32].to_vec();
    let (s, m) = (row(&sharp.alpha), row(&moving.alpha));
    assert_eq!((s[9], s[16], s[23]), (0.0, 1.0, 0.0), "sharp: {s:?}");
    // the square spans 12..20 at first and 20..28 at the end: pixel 19.5 is covered for nearly all of the
    // time, pixel 24 for half
    assert!((m[24] - 0.44).abs() < 0.12 && (m[14] - 0.31).abs() < 0.12, "blurred: {m:?}");
    assert!((0..32).all(|i| m[i] <= 1.0), "{m:?}");
}

/// Light and coverage are those of the complete exposure, geometry that of the pose half-way: bit for bit
/// that of a camera at rest there.
#[test]
fn geometry_of_a_moving_camera_is_that_of_the_pose_half_way() {
    let texels = (0..64).map(|i| [(i * 29) as u8, (i * 53) as u8, 90, 255]).collect();
    let material = Material {
        base_color_map: texture(texels, 8, Transfer::Srgb),
        roughness: 0.4,
        ..Material::default()
    };
    let ball = object(sphere(1.0, 24, true), material);
    let bvh = lastlight::geometry::bvh::Bvh::build(&ball.mesh.positions, &ball.mesh.triangles);
    let lights = Lights { environment: Some(axes::map(32)), lamps: Vec::new() };
    let scene = Scene::new(&ball, &bvh, &lights).expect("a good scene");
    for model in [Model::Pinhole, Model::Fisheye] {
        let camera = |x: f32| Camera { model, ..look([x, -4.0, 0.5], [0.3 * x, 0.0, 0.0], 0.7, 40, 40) };
        let (open, close) = (camera(0.0), camera(0.4));
        let settings = Settings { samples: 9, ..few() };
        let shot = |from: &Camera, to: Option<&Camera>| {
            lastlight::shade::render::render(&scene, from, to, &settings).expect("good cameras")
        };
        let (moving, still) = (shot(&open, Some(&close)), shot(&open.between(&close, 0.5), None));
        assert_eq!(moving.depth_z, still.depth_z, "{model:?}: depth");
        assert_eq!(moving.normal, still.normal, "{model:?}: normals");
        assert_eq!(moving.albedo, still.albedo, "{model:?}: albedo");
        assert_eq!((&moving.roughness, &moving.metallic), (&still.roughness, &still.metallic), "{model:?}");
        let partly = |a: &[f32]| a.iter().filter(|a| **a > 0.0 && **a < 1.0).count();
        let (m, s) = (partly(&moving.alpha), partly(&still.alpha));
        assert!(m as f32 > 1.25 * s as f32, "{model:?}: {m} pixels partly covered, {s} at rest");
        assert_ne!(moving.color, still.color, "{model:?}: the photo is blurred");
    }
}

/// 32×32 pixels, 8 per unit, looking along −z … from z = 5 down.
fn flat() -> Camera {
    Camera {
        rotation: [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
        translation: [0.0, 0.0, 5.0],
        focal_px: [8.0; 2],
        center_px: [16.0; 2],
        width: 32,
        height: 32,
        model: Model::Orthographic,
    }
}

fn texture(texels: Vec<[u8; 4]>, width: usize, transfer: Transfer) -> Option<Arc<Texture>> {
    let height = texels.len() / width;
    Some(Arc::new(Texture { width, height, texels, transfer, wrap: [Wrap::Clamp; 2] }))
}

#[test]
fn textures_and_factors_reach_the_passes() {
    let m = Material {
        base_color: [0.5, 1.0, 1.0, 1.0],
        base_color_map: texture(vec![[255, 0, 0, 255], [0, 188, 0, 255]], 2, Transfer::Srgb),
        roughness: 0.8,
        metallic_roughness_map: texture(vec![[0, 255, 51, 0]], 1, Transfer::Linear),
        metallic: 1.0,
        emission: [0.0, 0.0, 2.0],
        ..Material::default()
    };
    let out = shoot(&object(square(2.0), m), &Lights::default(), &flat(), &few());
    let (left, right) = (16 * 32 + 1, 16 * 32 + 30);
    assert!(near(out.albedo[left], [0.5, 0.0, 0.0], 1e-3), "left half: {:?}", out.albedo[left]);
    assert!(near(out.albedo[right], [0.0, 0.503, 0.0], 2e-3), "188 is half linear: {:?}", out.albedo[right]);
    assert!((out.roughness[left] - 0.8).abs() < 1e-5 && (out.metallic[left] - 0.2).abs() < 1e-5, "G and B");
    assert!(near(out.color[left], [0.0, 0.0, 2.0], 1e-5), "it glows: {:?}", out.color[left]);
    assert_eq!(out.normal[left], [0.0, 0.0, 1.0], "flat");
}

/// The texel (0.5 + 0.3, 0.5, …) tilts the normal to +x of the image, (…, 0.5 + 0.3, …) to its top, whichever
/// way the coordinates run.
#[test]
fn normal_maps_tilt_right_and_up() {
    let tilt = |texel: [u8; 4], mirrored: bool| {
        let mut mesh = square(2.0);
        if mirrored {
            mesh.uvs.iter_mut().for_each(|uv| uv[0] = 1.0 - uv[0]);
        }
        let map = texture(vec![texel], 1, Transfer::Linear).expect("a texture");
        let m = Material { normal_map: Some((map, 1.0)), ..Material::default() };
        shoot(&object(mesh, m), &Lights::default(), &flat(), &few()).normal[16 * 32 + 16]
    };
    let (right, up) = ([204, 128, 230, 255], [128, 204, 230, 255]);
    let (r, u, back) = (tilt(right, false), tilt(up, false), tilt(right, true));
    let want = unit([0.6, 0.004, 0.804]).0;
    assert!(near(r, want, 0.01), "to the right: {r:?}, want {want:?}");
    assert!(near(u, [want[1], want[0], want[2]], 0.01), "up the image, which is +y here: {u:?}");
    assert!(near(back, [-want[0], want[1], want[2]], 0.01), "mirrored coordinates: {back:?}");
}

#[test]
fn alpha_lets_rays_and_light_through() {
    let lights = Lights { environment: Some(Environment::constant([1.0; 3])), lamps: Vec::new() };
    let run = |alpha: Alpha, a: f32| {
        let m = Material { base_color: [0.0, 0.0, 0.0, a], alpha, metallic: 1.0, ..Material::default() };
        let out = shoot(&object(square(2.0), m), &lights, &flat(), &Settings { samples: 256, ..few() });
        let at = 16 * 32 + 16;
        (out.alpha[at], out.color[at][0], out.depth_z[at])
    };
    let (cover, color, depth) = run(Alpha::Opaque, 0.2);
    assert!(cover == 1.0 && color < 0.05 && (depth - 5.0).abs() < 1e-5, "opaque: {cover}, {color}, {depth}");
    assert_eq!(run(Alpha::Mask(0.5), 0.2), (0.0, 1.0, 0.0), "cut out");
    assert_eq!(run(Alpha::Mask(0.5), 0.6).0, 1.0, "kept");
    let (cover, color, depth) = run(Alpha::Blend, 0.25);
    assert!((cover - 0.25).abs() < 0.1 && (color - 0.75).abs() < 0.1, "a quarter: {cover}, {color}");
    assert_eq!(depth, 0.0, "less than half is not there for the depth");
    // light through a pane: a Lambert floor below a half transparent square
    let mut two = object(square(4.0), Material { roughness: 1.0, ..Material::default() });
    let pane = Material { base_color: [0.0, 0.0, 0.0, 0.5], alpha: Alpha::Blend, ..Material::default() };
    let base = two.mesh.positions.len() as u32;
    two.mesh.positions.extend(square(400.0).positions.iter().map(|p| [p[0], p[1], 6.0]));
    two.mesh.uvs.extend(square(1.0).uvs);
    two.mesh.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
    two.materials.push(pane);
    two.material_of.extend([1, 1]);
    let settings = Settings { samples: 256, brdf: Brdf::Lambert, ..few() };
    let out = shoot(&two, &lights, &flat(), &settings);
    let mean = out.color.iter().fold(0.0, |s, c| s + c[0]) / 1024.0;
    assert!((mean - 0.5).abs() < 0.02, "half of the light arrives: {mean}");
}

#[test]
fn zero_normals_degenerate_triangles_and_black_maps_are_shaded_without_harm() {
    let mut mesh = sphere(1.0, 10, true);
    for (i, n) in mesh.normals.iter_mut().enumerate() {
        if i % 3 == 0 {
            *n = [0.0; 3];
        }
    }
    let k = mesh.positions.len() as u32;
    mesh.triangles.extend([[0, 0, 0], [1, 1, 2], [k - 1, k - 1, k - 1]]);
    let ball = object(mesh, Material { roughness: 0.1, metallic: 1.0, ..Material::default() });
    let view = look([0.0, -3.0, 1.0], [0.0; 3], 0.9, 24, 24);
    let black = Environment { width: 4, height: 2, radiance: vec![[0.0; 3]; 8] };
    for environment in [None, Some(black), Some(Environment::constant([1.0; 3]))] {
        let dark = environment.as_ref().is_none_or(|e| e.radiance[0] == [0.0; 3]);
        let out = shoot(
            &ball,
            &Lights { environment, lamps: Vec::new() },
            &view,
            &Settings { bounces: 2, ..few() },
        );
        assert!(out.color.iter().flatten().all(|x| x.is_finite() && *x >= 0.0), "finite");
        assert_eq!(dark, out.color.iter().all(|c| *c == [0.0; 3]), "light only where there is some");
        assert!(out.alpha[12 * 24 + 12] == 1.0, "the ball is there");
        for (n, a) in out.normal.iter().zip(&out.alpha) {
            let length = dot(*n, *n).sqrt();
            assert!(*a == 0.0 || (length - 1.0).abs() < 1e-5, "unit normals: {n:?}");
        }
    }
    // zero normals everywhere are flat shading
    let mut flat = sphere(1.0, 10, false);
    let lights = Lights { environment: Some(axes::map(16)), lamps: Vec::new() };
    let without = shoot(&object(flat.clone(), Material::default()), &lights, &view, &few());
    flat.normals = vec![[0.0; 3]; flat.positions.len()];
    let with = shoot(&object(flat, Material::default()), &lights, &view, &few());
    assert_eq!(with, without, "the face normal is used instead");
}

/// The same image at any scale and far from the origin: offsets follow the coordinates.
#[test]
fn no_surface_shadows_itself_at_any_scale() {
    let sun =
        lastlight::scene::light::Lamp::Distant { towards: unit([0.3, -1.0, 0.8]).0, irradiance: [1.0; 3] };
    let lights = Lights { environment: None, lamps: vec![sun] };
    for (scale, shift) in [
        (1.0_f32, 0.0_f32),
        (1e-4, 0.0),
        (1e5, 0.0),
        (1e-10, 0.0),
        (1e10, 0.0),
        (1e-15, 0.0),
        (1e15, 0.0),
        (1.0, 300.0),
    ] {
        let mut mesh = sphere(scale, 64, true);
        mesh.positions.iter_mut().flatten().for_each(|x| *x += shift);
        let ball = object(mesh, Material { roughness: 1.0, ..Material::default() });
        let eye = [shift + 0.0, shift - 4.0 * scale, shift + scale];
        let view = look(eye, [shift; 3], 0.3, 24, 24);
        let settings = Settings { samples: 16, brdf: Brdf::Lambert, ..few() };
        let out = shoot(&ball, &lights, &view, &settings);
        for (i, c) in out.color.iter().enumerate() {
            let cosine = dot(out.normal[i], unit([0.3, -1.0, 0.8]).0);
            if out.alpha[i] == 1.0 && cosine > 0.2 {
                let want = cosine / std::f32::consts::PI;
                assert!(
                    (c[0] / want - 1.0).abs() < 0.05,
                    "scale {scale}, shift {shift}, pixel {i}: {c:?}, {want}"
                );
            }
        }
    }
}

#[test]
fn a_scene_refuses_what_is_wrong() {
    let plane = object(square(1.0), Material::default());
    let bvh = lastlight::geometry::bvh::Bvh::build(&plane.mesh.positions, &plane.mesh.triangles);
    let refused = |lights: &Lights, word: &str| {
        let e = Scene::new(&plane, &bvh, lights).expect_err("refused").to_string();
        assert!(e.contains(word), "{e}");
    };
    let mut map = Environment::constant([1.0; 3]);
    map.radiance[1][2] = f32::NAN;
    refused(&Lights { environment: Some(map), lamps: Vec::new() }, "environment");
    let lamp = lastlight::scene::light::Lamp::Distant { towards: [0.0, 0.0, 2.0], irradiance: [1.0; 3] };
    refused(&Lights { environment: None, lamps: vec![lamp] }, "lamp 0");
    let lights = Lights::default();
    let scene = Scene::new(&plane, &bvh, &lights).expect("a good scene");
    let none = Settings { samples: 0, ..few() };
    let e = lastlight::shade::render::render(&scene, &flat(), None, &none).expect_err("no samples");
    assert!(e.to_string().contains("samples"), "{e}");
}

#[test]
fn exposure_brings_the_ninetieth_percentile_to_its_place() {
    let color: Vec<[f32; 3]> = (1..=100).map(|i| [i as f32 / 100.0; 3]).collect();
    let mut alpha = vec![1.0; 100];
    let e = exposure::auto(&color, &alpha);
    assert!((e - 0.8 / 0.9).abs() < 1e-5, "{e}");
    alpha[80..].fill(0.0); // foreground 0.01..0.80: the 72nd
    let e = exposure::auto(&color, &alpha);
    assert!((e - 0.8 / 0.72).abs() < 1e-5, "{e}");
    assert_eq!(exposure::auto(&[[100.0; 3]], &[1.0]), 0.25, "not darker than a quarter");
    assert_eq!(exposure::auto(&[[0.0; 3]], &[1.0]), 4.0, "a black object");
    assert_eq!(exposure::auto(&[[1.0; 3]], &[0.0]), 1.0, "no object");
    assert_eq!(exposure::auto(&[], &[]), 1.0, "no image");
}

#[test]
#[cfg(debug_assertions)]
#[should_panic(expected = "no value is NaN")]
fn a_picture_that_is_not_a_number_panics_in_debug_builds() {
    tonemap::srgb_u8(&[[0.0, f32::NAN, 0.0]], 1.0);
}

#[test]
fn bytes_are_srgb() {
    let table = lastlight::scene::material::linear_of_srgb();
    let linear: Vec<[f32; 3]> = (0..256).map(|i| [table[i], table[i] * 0.5, -table[i]]).collect();
    let bytes = tonemap::srgb_u8(&linear, 1.0);
    for i in 0..256 {
        assert_eq!(usize::from(bytes[3 * i]), i, "the inverse of the table");
        assert_eq!(bytes[3 * i + 2], 0, "negative is black");
    }
    let twice = tonemap::srgb_u8(&linear, 2.0);
    assert_eq!(
        twice[1..3 * 256].iter().step_by(3).collect::<Vec<_>>(),
        bytes.iter().step_by(3).collect::<Vec<_>>(),
        "half at twice"
    );
    assert_eq!(tonemap::srgb_u8(&[[9.0, 1.0, 0.5]], 1.0), [255, 255, 188], "cut at 1");
}
