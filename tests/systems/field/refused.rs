//! Images and settings that no fit can be made of, each with its message.

use super::{settings, targets};
use crate::ball;
use lastlight::fit::field::{FieldFit, HeadForm, Materials, Settings, Targets};
use lastlight::scene::field::Rule;

fn refused(settings: Settings, targets: &Targets, parts: &[&str]) {
    let e = FieldFit::new(settings, targets, None, None).expect_err("refused");
    assert_eq!(e.exit_code(), 2, "{e}");
    let text = e.to_string();
    for part in parts {
        assert!(text.contains(part), "'{part}' in '{text}'");
    }
}

#[test]
fn settings_out_of_range_or_at_odds_are_refused_by_option() {
    let targets = targets();
    let base = settings();
    let trunk = Settings { heads: HeadForm::Trunk, rule: Rule::Midpoint, ..base.clone() };
    for (settings, parts) in [
        (Settings { iterations: 0, ..base.clone() }, ["--iterations", "1 to", "0"]),
        (Settings { planes: 4, ..base.clone() }, ["--planes", "6 or 3", "4"]),
        (Settings { side: 7, ..base.clone() }, ["--side", "8 to 1024", "7"]),
        (Settings { channels: 0, ..base.clone() }, ["--channels", "1 to 128", "0"]),
        (Settings { samples: 7, ..base.clone() }, ["--ray-samples", "8 to 4096", "7"]),
        (Settings { crop: 15, ..base.clone() }, ["--crop-side", "16 to 512", "15"]),
        (Settings { crops: 0, ..base.clone() }, ["--crops", "1 to 64", "0"]),
        (Settings { inverse_beta: [0.5, 9.0], ..base.clone() }, ["--first-inverse-beta", "1 to", "0.5"]),
        (Settings { inverse_beta: [1.0, f32::NAN], ..base.clone() }, ["--inverse-beta", "1 to", "NaN"]),
        (
            Settings { inverse_beta: [90.0, 80.0], ..base.clone() },
            ["--first-inverse-beta", "at most 80, that of --inverse-beta", "90"],
        ),
        (Settings { rates: [0.0, 1e-3], ..base.clone() }, ["--plane-rate", "to 1", "0"]),
        (Settings { rates: [1e-3, 2.0], ..base.clone() }, ["--network-rate", "to 1", "2"]),
        (Settings { eikonal: -1.0, ..base.clone() }, ["--eikonal", "0 to", "-1"]),
        (Settings { variation: f32::INFINITY, ..base.clone() }, ["--variation", "0 to", "inf"]),
        (
            Settings { rule: Rule::Analytic, ..trunk.clone() },
            ["--rule", "midpoint, with --heads trunk", "analytic"],
        ),
        (Settings { embedding: true, ..trunk }, ["--nde", "separate heads", "--heads trunk"]),
    ] {
        refused(settings, &targets, &parts);
    }
}

#[test]
fn one_image_is_not_enough() {
    let mut one = targets();
    one.train.truncate(1);
    refused(settings(), &one, &["at least two training images", "got 1"]);
}

#[test]
fn a_crop_is_at_most_the_smallest_image() {
    let mut mixed = targets();
    mixed.train[2] = ball::target(2, 18);
    let parts = ["--crop-side", "0002.png", "at most 18, the smaller side of the image", "got 19"];
    refused(Settings { crop: 19, ..settings() }, &mixed, &parts);
    FieldFit::new(Settings { crop: 18, ..settings() }, &mixed, None, None).expect("as large as it may be");
}

#[test]
fn passes_must_be_in_every_image() {
    let mut some = targets();
    some.train[1].material = None;
    refused(settings(), &some, &["--materials", "albedo, material and normal", "shaded or off"]);
    for materials in [Materials::Off, Materials::Shaded] {
        FieldFit::new(Settings { materials, ..settings() }, &some, None, None).expect("no passes are needed");
    }
}

#[test]
fn views_that_miss_the_box_are_refused() {
    let mut aside = targets();
    for t in &mut aside.train {
        // Five boxes to the side.
        t.camera.translation[0] += 5.0;
    }
    refused(
        settings(),
        &aside,
        &["--box", "covers the object", "no foreground pixel of any training image sees"],
    );
}

#[test]
fn cameras_inside_the_object_are_refused() {
    let mut inside = targets();
    let t = &mut inside.train[1];
    t.camera.translation = [0.0; 3];
    t.foreground.fill(1.0);
    refused(settings(), &inside, &["0001.png", "camera outside the object", "nothing but the object"]);
    // In an empty corner of the box a camera may be: its image shows background, too.
    let mut corner = targets();
    let t = &mut corner.train[1];
    let eye = t.camera.rotation[2].map(|x| -0.5 * x);
    t.camera.translation = std::array::from_fn(|i| {
        let r = t.camera.rotation[i];
        -(r[0] * eye[0] + r[1] * eye[1] + r[2] * eye[2])
    });
    FieldFit::new(settings(), &corner, None, None).expect("rays begin at the camera");
}
