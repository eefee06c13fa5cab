//! Colours of spherical harmonics.

use super::{on_axis, without};
use crate::scenes::{frontal, gradient, named, normal, run, scene};
use reference::array::Arr;

#[test]
fn dark_channels_are_clamped_without_gradient() {
    let mut inputs = without(&frontal(&[on_axis(2.0, 0.5, 0.0)], 33, 33), &["rgb"]);
    let c0 = 0.282_094_791_773_878_14;
    inputs.insert("sh".to_owned(), Arr::new(&[1, 1, 3], vec![-1.0 / c0, -0.5 / c0, 0.5 / c0]));
    inputs.insert("sh_degree".to_owned(), Arr::scalar(0.0));
    let answer = run("splat.render", &inputs, &[]);
    let mask = &answer.plan["color_mask"].data;
    assert_eq!((mask[0], mask[2]), (0.0, 1.0));
    assert_eq!(answer.intermediates["colors"].data[0], 0.0);
    let bars = named([("image", Arr::filled(&[1, 33, 33, 3], 1.0))]);
    let bar = &gradient("splat.render", &inputs, &[], &bars)["sh"].data;
    assert!(bar[0] == 0.0 && bar[2] > 0.0, "{bar:?}");
}

#[test]
fn unused_bands_have_no_gradient() {
    let mut inputs = scene(5, 24, 18);
    inputs.insert("sh_degree".to_owned(), Arr::scalar(1.0));
    let bars = named([("image", normal(&[2, 18, 24, 3], 70))]);
    let bar = &gradient("splat.render", &inputs, &[], &bars)["sh"];
    for i in 0..5 {
        let row = &bar.data[48 * i..48 * (i + 1)];
        assert!(row[..12].iter().any(|&x| x != 0.0) && row[12..].iter().all(|&x| x == 0.0));
    }
}

#[test]
fn a_gaussian_in_the_camera_centre_has_direction_zero() {
    let mut inputs = named([
        ("means", Arr::filled(&[1, 3], 0.0)),
        ("sh", normal(&[1, 16, 3], 71)),
        ("sh_degree", Arr::scalar(3.0)),
    ]);
    inputs.insert("view_from_world".to_owned(), frontal(&[], 8, 8)["view_from_world"].clone());
    let answer = run("splat.color", &inputs, &[]);
    assert!(answer.outputs["colors"].data.iter().all(|x| x.is_finite()));
    let bars = named([("colors", Arr::filled(&[1, 1, 3], 1.0))]);
    assert_eq!(gradient("splat.color", &inputs, &[], &bars)["means"].data, [0.0; 3]);
}
