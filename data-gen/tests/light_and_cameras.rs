//! Environment maps have the documented orientation and range; cameras have the documented positions.

use data_gen::cameras::{self, CameraView, Framing, OBJECT_RADIUS};
use data_gen::environments::{self, KINDS};
use data_gen::light::{Map, direction};
use data_gen::splats::View;
use reference::num::bits::digest_f32;
use reference::num::elem::{cos, sin};

type V3 = [f64; 3];

fn dot(a: V3, b: V3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn luminance(c: [f32; 3]) -> f64 {
    let [r, g, b] = c.map(f64::from);
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

fn texel(map: &Map, i: usize) -> V3 {
    let (row, column) = (i / map.width, i % map.width);
    direction((column as f64 + 0.5) / map.width as f64, (row as f64 + 0.5) / map.height as f64)
}

fn brightest(map: &Map) -> usize {
    (0..map.radiance.len())
        .fold(0, |best, i| if luminance(map.radiance[i]) > luminance(map.radiance[best]) { i } else { best })
}

#[test]
fn directions_follow_the_convention() {
    for (u, v, want) in [
        (0.5, 0.5, [0.0, 1.0, 0.0]),
        (0.75, 0.5, [1.0, 0.0, 0.0]),
        (0.25, 0.5, [-1.0, 0.0, 0.0]),
        (0.0, 0.5, [0.0, -1.0, 0.0]),
        (0.3, 0.0, [0.0, 0.0, 1.0]),
    ] {
        let d = direction(u, v);
        assert!(dot(d, want) > 1.0 - 1e-12, "u {u}, v {v} points to {d:?}, not {want:?}");
    }
}

#[test]
fn maps_are_finite_of_the_mean_they_promise_and_bright_where_they_say() {
    for k in 0..24 {
        let map = environments::make(3, k, 256, 128);
        assert_eq!(map.radiance.len(), 256 * 128, "map {k}: texels");
        let all = map.radiance.iter().flatten();
        assert!(all.clone().all(|x| x.is_finite() && *x >= 0.0), "map {k}: finite radiance ≥ 0");
        let (mut sum, mut weight) = (0.0, 0.0);
        for (i, c) in map.radiance.iter().enumerate() {
            let z = texel(&map, i)[2];
            let s = (1.0 - z * z).sqrt();
            sum += s * luminance(*c);
            weight += s;
        }
        let mean = sum / weight;
        assert!((0.5..1.6).contains(&mean), "map {k} ({}): mean {mean}", map.kind);
        let top = brightest(&map);
        if let Some(b) = map.brightest {
            // The middle of a source and its brightest texel are inside the source, whose size is 0.6 for the
            // largest soft box.
            let reach = if map.kind == "low sun" || map.kind == "clear sky" { 0.035 } else { 0.9 };
            let angle = dot(texel(&map, top), b);
            assert!(angle > 1.0 - reach * reach, "map {k} ({}): brightest {angle}", map.kind);
        }
        if map.kind == "clear sky" || map.kind == "low sun" {
            let mut sky: Vec<f64> = (0..map.radiance.len() / 2).map(|i| luminance(map.radiance[i])).collect();
            sky.sort_by(f64::total_cmp);
            let ratio = luminance(map.radiance[top]) / sky[sky.len() / 2];
            assert!(ratio > 1e3, "map {k}: the sun is {ratio} times the sky");
        }
    }
}

#[test]
fn the_first_maps_show_every_kind_and_rows_stand_alone() {
    for (k, kind) in KINDS.iter().enumerate() {
        let map = environments::make(5, k as u64, 64, 32);
        assert_eq!(map.kind, *kind, "map {k}");
        let scene = environments::scene(5, k as u64);
        assert_eq!(scene.row(17, 64, 32), map.radiance[17 * 64..18 * 64], "row 17 of map {k}");
    }
}

#[test]
fn the_suns_irradiance_does_not_depend_on_the_size() {
    let irradiance = |size: usize| {
        let map = environments::make(5, 0, 2 * size, size);
        let up: f64 = (0..map.radiance.len()).fold(0.0, |s, i| {
            let d = texel(&map, i);
            let z = if d[2] > 0.0 { d[2] } else { 0.0 };
            s + luminance(map.radiance[i]) * z * (1.0 - d[2] * d[2]).sqrt()
        });
        let step = std::f64::consts::PI / size as f64;
        up * step * step
    };
    let (fine, coarse) = (irradiance(512), irradiance(64));
    assert!((fine / coarse - 1.0).abs() < 0.15, "irradiance {fine} at 512 rows, {coarse} at 64");
}

fn eye(v: &View) -> V3 {
    let m = &v.view_from_world;
    std::array::from_fn(|i| -(m[i] * m[3] + m[4 + i] * m[7] + m[8 + i] * m[11]))
}

/// Position in the image, pixels, and depth.
fn project(v: &View, p: V3) -> [f64; 3] {
    let m = &v.view_from_world;
    let q: V3 =
        std::array::from_fn(|i| m[4 * i] * p[0] + m[4 * i + 1] * p[1] + m[4 * i + 2] * p[2] + m[4 * i + 3]);
    let k = &v.intrinsics;
    [k[0] * q[0] / q[2] + k[2], k[4] * q[1] / q[2] + k[5], q[2]]
}

fn check_rotation(v: &View) {
    let row = |i: usize| -> V3 { std::array::from_fn(|j| v.view_from_world[4 * i + j]) };
    for a in 0..3 {
        for b in 0..3 {
            let want = f64::from(u8::from(a == b));
            assert!((dot(row(a), row(b)) - want).abs() < 1e-13, "rows {a}, {b} of a rotation");
        }
    }
    let (x, y, z) = (row(0), row(1), row(2));
    let cross = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
    assert!(dot(cross, z) > 0.999, "x right, y down, z forward are right-handed");
}

/// Whether the silhouette of the ball is inside the image.
fn holds_ball(p: &CameraView) -> bool {
    let half = 0.5 * p.fov * std::f64::consts::PI / 180.0;
    // Sine of the angular radius of the ball, and of the smallest angle between the axis and the border of
    // the image.
    OBJECT_RADIUS / p.distance <= sin(half) * (1.0 + 1e-9)
}

#[test]
fn training_views_are_drawn_as_published() {
    let mut fovs = Vec::new();
    for k in 0..40 {
        let whole = cameras::training(1, k, 32, 256, Framing::Whole);
        let loose = cameras::training(1, k, 32, 256, Framing::Loose);
        assert_eq!((whole.len(), loose.len()), (32, 32), "views of object {k}");
        fovs.push(whole[0].fov);
        for p in &whole {
            check_rotation(&p.view);
            assert!(holds_ball(p), "object {k}: the ball is inside the image");
            let c = project(&p.view, [0.0; 3]);
            assert!(
                (c[0] - 128.0).abs() < 1e-9 && (c[1] - 128.0).abs() < 1e-9,
                "the camera is aimed at the origin: {c:?}"
            );
            assert!((-5.0..=70.0).contains(&p.elevation), "elevation {}", p.elevation);
            assert!(p.fov == whole[0].fov && (15.0..=85.0).contains(&p.fov), "one angle of view per object");
            let above = project(&p.view, [0.0, 0.0, 0.1]);
            assert!(above[1] < 128.0, "z points up in the image");
        }
        for p in &loose {
            check_rotation(&p.view);
            let e = eye(&p.view);
            assert!((dot(e, e).sqrt() - p.distance).abs() < 1e-12, "distance from the origin");
            let forward: V3 = std::array::from_fn(|j| p.view.view_from_world[8 + j]);
            let want = cos(p.off_axis * std::f64::consts::PI / 180.0);
            let got = -dot(e, forward) / p.distance;
            assert!((got - want).abs() < 1e-12, "cosine {got} off the axis instead of {want}");
            let c = project(&p.view, [0.0; 3]);
            assert!(
                c[..2].iter().all(|x| (0.0..=256.0).contains(x)),
                "the origin is inside the image: {c:?}"
            );
        }
    }
    fovs.sort_by(f64::total_cmp);
    assert!(fovs[0] < 25.0 && fovs[39] > 75.0, "angles of view from {} to {}", fovs[0], fovs[39]);
    assert_eq!(
        cameras::training(1, 7, 8, 256, Framing::Loose),
        cameras::training(1, 7, 32, 256, Framing::Loose)[..8],
        "a view does not depend on how many there are"
    );
}

#[test]
fn test_views_are_those_of_the_protocol() {
    for k in 0..10 {
        let t = cameras::test(1, k, 512);
        assert_eq!(t.views.len(), 48, "three rings of sixteen");
        for p in &t.views {
            check_rotation(&p.view);
            assert!(holds_ball(p) && (p.distance - 1.183).abs() < 1e-3, "distance {}", p.distance);
            assert_eq!(p.fov, 50.0, "angle of view");
        }
        let at = |ring: usize| t.inputs.iter().filter(|&&i| i / 16 == ring).count();
        assert_eq!([at(0), at(1), at(2)], [0, 8, 8], "8 of 16 at 20 and at 40 degrees");
        let mut given = t.inputs;
        given.sort_unstable();
        let mut round = t.sequential;
        round.sort_unstable();
        assert_eq!(given, round, "two orders of the same images");
        assert!(given.windows(2).all(|w| w[0] < w[1]), "no image twice");
        assert!(t.outputs.windows(2).all(|w| w[0] < w[1]), "no output twice");
        assert!(t.outputs.iter().all(|o| !given.contains(o)), "inputs and outputs are disjoint");
        let turns = t.sequential.map(|i| i % 16);
        assert!(turns.windows(2).all(|w| w[0] <= w[1]), "the sequential order goes round once");
        assert_ne!(t.inputs, t.sequential, "random order is another");
    }
    assert_ne!(cameras::test(1, 0, 8).inputs, cameras::test(1, 1, 8).inputs, "objects differ");
}

#[test]
fn heads_move_smoothly_and_keep_the_object_in_view() {
    for k in 0..10 {
        let frames = cameras::head(1, k, 60, 256);
        assert_eq!(frames.len(), 60, "frames");
        for f in &frames {
            check_rotation(&f.open);
            check_rotation(&f.close);
            let (a, b) = (eye(&f.open), eye(&f.close));
            let d = dot(a, a).sqrt();
            assert!((0.75..1.56).contains(&d), "object {k}: {d} away");
            let step =
                dot([a[0] - b[0], a[1] - b[1], a[2] - b[2]], [a[0] - b[0], a[1] - b[1], a[2] - b[2]]).sqrt();
            assert!(step > 1e-4 && step < 0.05, "object {k}: moves {step} while the shutter is open");
            assert!(f.off_axis < 45.0, "object {k}: {} off the axis", f.off_axis);
        }
        for f in frames.iter().cloned() {
            let (open, close) = (f.open.clone(), f.close.clone());
            let p = f.through_pinhole();
            assert_eq!(
                (p.open.view_from_world, p.close.view_from_world),
                (open.view_from_world, close.view_from_world),
                "object {k}: the same motion"
            );
            for view in [&p.open, &p.close] {
                let half = (0.5 * cameras::HEAD_PINHOLE_FOV).to_radians();
                let off = view.intrinsics[0] * sin(half) - 128.0 * cos(half);
                assert!(off.abs() < 1e-9, "object {k}: the border is 35 degrees off the axis: {off}");
                assert_eq!(view.intrinsics[0], view.intrinsics[4], "object {k}: square pixels");
            }
        }
        let turn = frames.iter().map(|f| f.off_axis).fold(0.0, |m, x| if x > m { x } else { m });
        assert!(turn > 3.0, "object {k}: the viewing direction varies, by {turn} degrees");
    }
}

#[test]
fn maps_have_the_bits_they_had() {
    let mut all = Vec::new();
    for k in 0..KINDS.len() as u64 {
        all.extend(environments::make(0, k, 64, 32).radiance.into_iter().flatten());
    }
    let digest = digest_f32(&[all.len()], &all).expect("no NaN");
    assert_eq!(format!("{digest:016x}"), "4e8c52c1ec8589d9", "maps 0 to 5 of seed 0");
}
