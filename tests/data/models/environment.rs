//! Environment maps in the orientations of other programs.

use lastlight::io::image_file::{Encoding, Picture, Samples};
use lastlight::scene::environment_file::{Options, Orientation, from_picture, orient};
use lastlight::scene::light::Environment;
use lastlight::scene::material::Transfer;

/// Texel (row, column) has the radiance (row, column, row·column): each one its own.
fn numbered(width: usize, height: usize) -> Environment {
    let radiance = (0..width * height).map(|i| [(i / width) as f32, (i % width) as f32, i as f32]).collect();
    Environment { width, height, radiance }
}

/// The direction of a texel of ours.
fn direction(map: &Environment, i: usize) -> [f64; 3] {
    let u = ((i % map.width) as f64 + 0.5) / map.width as f64;
    let v = ((i / map.width) as f64 + 0.5) / map.height as f64;
    let (phi, theta) = ((u - 0.5) * std::f64::consts::TAU, v * std::f64::consts::PI);
    [libm::sin(theta) * libm::sin(phi), libm::sin(theta) * libm::cos(phi), libm::cos(theta)]
}

#[test]
fn every_orientation_follows_its_formula() {
    let file = numbered(24, 12);
    for orientation in Orientation::ALL {
        assert_eq!(Orientation::parse(orientation.name()).ok(), Some(orientation), "its name");
        let ours = orient(file.clone(), &Options { orientation, ..Options::default() });
        for i in 0..file.radiance.len() {
            // Where the program's own formula finds this direction in its file.
            let [u, v] = orientation.texture_coordinates(orientation.own_axes(direction(&ours, i)));
            let (x, y) = (u * 24.0 - 0.5, v * 12.0 - 0.5);
            assert!((x - x.round()).abs() < 1e-9 && (y - y.round()).abs() < 1e-9, "a texel centre: {x}, {y}");
            let texel = y.round() as usize * 24 + x.round() as usize % 24;
            assert_eq!(ours.radiance[i], file.radiance[texel], "{orientation:?}, texel {i}");
        }
    }
    assert!(Orientation::parse("unity").expect_err("unknown").to_string().contains("mitsuba"), "listed");
}

#[test]
fn known_directions() {
    // What an image's centre shows, by the documentation of each program.
    let centre = |o: Orientation, own: [f64; 3]| o.texture_coordinates(own)[0];
    assert_eq!(centre(Orientation::Mitsuba, [0.0, 0.0, 1.0]), 0.5, "Mitsuba: +Z");
    assert_eq!(centre(Orientation::Nvdiffrec, [0.0, 0.0, -1.0]), 0.5, "nvdiffrec: −Z");
    assert_eq!(centre(Orientation::Blender, [1.0, 0.0, 0.0]), 0.5, "Blender: +x");
    assert_eq!(centre(Orientation::Blender, [0.0, -1.0, 0.0]), 0.75, "Blender: −y to the right");
    assert_eq!(centre(Orientation::Ours, [0.0, 1.0, 0.0]), 0.5, "ours: +y");
    assert_eq!(centre(Orientation::Ours, [1.0, 0.0, 0.0]), 0.75, "ours: +x to the right");
    for o in Orientation::ALL {
        let up = o.own_axes([0.0, 0.0, 1.0]);
        assert_eq!(o.texture_coordinates(up)[1], 0.0, "{o:?}: the top is up");
    }
}

#[test]
fn rotations_and_mirrors_permute_texels() {
    let file = numbered(24, 12);
    let turned = |rotate: f64| orient(file.clone(), &Options { rotate, ..Options::default() });
    assert_eq!(turned(0.0), file, "nothing");
    assert_eq!(turned(360.0), file, "all the way round");
    // A quarter turn counter-clockwise: what was at +y (u = ½) is at −x (u = ¼).
    assert_eq!(turned(90.0).radiance[6], file.radiance[12], "+y went to −x");
    assert_eq!(orient(turned(90.0), &Options { rotate: -90.0, ..Options::default() }), file, "and back");
    let mirror = orient(file.clone(), &Options { mirror: true, ..Options::default() });
    assert_eq!(mirror.radiance[24..26], [file.radiance[47], file.radiance[46]], "columns reversed");
    assert_eq!(orient(mirror, &Options { mirror: true, ..Options::default() }), file, "twice is nothing");
    // Half a column: the mean of neighbours.
    let half = turned(7.5).radiance[3];
    assert_eq!(half, [0.0, 3.5, 3.5], "between columns 3 and 4");
    // Five columns have no quarter: interpolated, but the mean of a row stays.
    let odd = numbered(5, 2);
    let blender = orient(odd.clone(), &Options { orientation: Orientation::Blender, ..Options::default() });
    let sum = |m: &Environment| m.radiance[..5].iter().fold(0.0, |s, t| s + t[1]);
    assert!((sum(&blender) - sum(&odd)).abs() < 1e-5, "the row keeps its light");
    let scaled = orient(file.clone(), &Options { scale: 0.25, ..Options::default() });
    assert_eq!(scaled.radiance[30], file.radiance[30].map(|x| 0.25 * x), "scale");
}

#[test]
fn maps_in_the_axes_of_a_camera() {
    // A smooth map is resampled by a rotation: it agrees with the function at the turned direction.
    let f = |d: [f64; 3]| [1.0 + d[0], 1.0 + d[1], 1.0 + d[2]].map(|x| x as f32);
    let mut map = numbered(128, 64);
    for i in 0..map.radiance.len() {
        map.radiance[i] = f(direction(&map, i));
    }
    let (s, c) = (libm::sin(0.6), libm::cos(0.6));
    // about x, so that the poles move
    let r = [[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]];
    let world = orient(map.clone(), &Options { world_from_map: Some(r), rotate: 90.0, ..Options::default() });
    let mut worst = 0.0f64;
    for i in 0..world.radiance.len() {
        let d = direction(&world, i);
        // Rᵀ of the direction turned back by 90° about z
        let d = [d[1], -d[0], d[2]];
        let m: [f64; 3] = std::array::from_fn(|k| r[0][k] * d[0] + r[1][k] * d[1] + r[2][k] * d[2]);
        let e = (0..3)
            .map(|k| f64::from((world.radiance[i][k] - f(m)[k]).abs()))
            .fold(0.0, |a, b| if b > a { b } else { a });
        worst = if e > worst { e } else { worst };
    }
    // Bilinear interpolation of a function of curvature 1 on cells of π/64, and the poles' half cell.
    assert!(worst < 0.026, "off by {worst}");
}

#[test]
fn pictures_become_radiance() {
    let picture = |samples, encoding, channels: &[&str]| Picture {
        width: 2,
        height: 1,
        channels: channels.iter().map(|&c| c.to_owned()).collect(),
        encoding,
        samples,
        orientation: lastlight::io::image_file::Orientation::STORED,
    };
    let bytes = picture(Samples::U8(vec![0, 128, 255, 255, 0, 64]), Encoding::Srgb, &["R", "G", "B"]);
    let read = |p: &Picture, transfer| {
        from_picture(p, &Options { transfer, ..Options::default() }, "a.png")
            .unwrap_or_else(|e| panic!("{e}"))
    };
    let srgb = read(&bytes, Transfer::Srgb).radiance[0];
    assert!((srgb[1] - 0.215_860_5).abs() < 1e-6 && srgb[2] == 1.0, "{srgb:?}");
    assert_eq!(read(&bytes, Transfer::Linear).radiance[0], [0.0, 128.0 / 255.0, 1.0], "linear");
    let grey = picture(Samples::F32(vec![0.0, 0.0]), Encoding::Linear, &["Y"]);
    assert_eq!(read(&grey, Transfer::Srgb).radiance, [[0.0; 3]; 2], "black, from grey, is a map");
    // Names decide, not places.
    let swapped = picture(
        Samples::F32(vec![1.0, 2.0, 3.0, 9.0, 4.0, 5.0, 6.0, 9.0]),
        Encoding::Linear,
        &["B", "G", "R", "A"],
    );
    assert_eq!(read(&swapped, Transfer::Srgb).radiance[0], [3.0, 2.0, 1.0], "by name");
    let bad = |p: &Picture, options: &Options, place: &str| {
        let e = from_picture(p, options, "a.exr").expect_err("refused");
        assert!(e.to_string().contains(place), "'{place}' is not in: {e}");
    };
    let d = Options::default();
    bad(&picture(Samples::F32(vec![1.0, -0.001]), Encoding::Linear, &["Y"]), &d, "row 0, column 1");
    bad(&picture(Samples::F32(vec![1.0, 1.0]), Encoding::Linear, &["Z"]), &d, "channels");
    bad(&grey, &Options { scale: f32::NAN, ..d.clone() }, "scale");
    bad(&grey, &Options { scale: -1.0, ..d.clone() }, "scale");
    bad(&grey, &Options { rotate: f64::INFINITY, ..d }, "rotation");
}
