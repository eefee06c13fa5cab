//! What is written of a moving person is true of it: poses of `body.npz`, a character's factors, light.

use crate::common::real_data;
use data_gen::figure::appearance::Appearance;
use data_gen::figure::factors::{Drive, WRINKLE};
use data_gen::figure::skeleton::{bones, pose};
use data_gen::figure::template::Template;
use data_gen::figure::video;
use lastlight::fit::passes::PassSet;
use lastlight::geometry::bvh::Bvh;
use lastlight::io::{capture, npz};
use lastlight::last::avatar::guide::Framing;
use lastlight::last::character::{CharacterSettings, CharacterSubject};
use lastlight::last::figure::{self, ClothedFigure};
use lastlight::last::generate::{self, Settings};
use lastlight::last::model::data::Data;
use lastlight::last::model::pictures::Pictures;
use lastlight::last::subject::Subject;
use lastlight::num::array::Arrays;
use lastlight::scene::camera::Model;
use lastlight::scene::from_data_gen;
use lastlight::scene::passes::PassImages;
use reference::body::skin::{self, Affine};

use std::path::Path;
use std::sync::atomic::AtomicBool;

fn small() -> Settings {
    Settings {
        count: 6,
        appearances: 2,
        points: 256,
        frames: 5,
        test_cameras: 2,
        video_size: 32,
        set_size: 16,
        samples: 4,
        mechanism: "LIN".into(),
        ..Settings::smoke()
    }
}

fn make(settings: &Settings, dir: &Path) {
    generate::run(settings, dir, false, &AtomicBool::new(false), &mut |_, _, _| {}).expect("a data set");
}

fn floats(arrays: &Arrays, name: &str) -> Vec<f64> {
    arrays.need(name).expect("there").to_f64()
}

fn rows(flat: &[f64]) -> Vec<[f64; 3]> {
    flat.as_chunks().0.to_vec()
}

/// The largest difference of a coordinate.
fn apart(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    assert_eq!(a.len(), b.len(), "as many points");
    let coordinates = a.as_flattened().iter().zip(b.as_flattened());
    coordinates.fold(0.0, |m, (x, y)| if (x - y).abs() > m { (x - y).abs() } else { m })
}

/// Points skinned by weights (P, K) and transforms (K, 4, 4).
fn skinned(points: &[[f64; 3]], weights: &[f64], transforms: &[f64]) -> Vec<[f64; 3]> {
    let bones: Vec<Affine<f64>> = transforms
        .as_chunks::<16>()
        .0
        .iter()
        .map(|g| [0, 4, 8].map(|r| [0, 1, 2, 3].map(|c| g[r + c])))
        .collect();
    let by_weight = weights.chunks(bones.len());
    points.iter().zip(by_weight).map(|(x, w)| skin::point(&skin::blend(w, &bones), *x)).collect()
}

/// The factors without those that displace points before they are skinned.
fn undisplaced(factors: &[f64]) -> Drive {
    let bare = Drive::new(&[]);
    Drive { wrinkle: 0.0, width: 0.0, skirt: bare.skirt, ..Drive::new(factors) }
}

#[test]
fn body_and_sets_reproduce_the_posed_points() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    // Eight factors: folds, width and skirt displace points, posture, elbow and yaw turn bones.
    let settings = Settings { set: "all".into(), graph: "ER-9".into(), factors: 8, groups: 1, ..small() };
    make(&settings, folder.path());
    let template = Template::new(settings.points);
    let body = npz::read(&folder.path().join("video/body.npz")).expect("readable");
    let (at_rest, weights) = (rows(&floats(&body, "points")), floats(&body, "weights"));
    let (transforms, factors) = (floats(&body, "transforms"), floats(&body, "factors"));
    assert!(apart(&at_rest, &template.points) < 1e-6, "the template at rest");
    let look = Appearance::new(0, 0);
    let mut worst = 0.0f64;
    for t in 0..settings.frames {
        let u = &factors[8 * t..8 * t + 8];
        let posed = skinned(&at_rest, &weights, &transforms[12 * 16 * t..12 * 16 * (t + 1)]);
        let truth = template.posed(&undisplaced(u), &look).points;
        let off = apart(&posed, &truth);
        assert!(off < 1e-5, "frame {t}: {off} from the posed points");
        worst = if off > worst { off } else { worst };
        // With what displaces, the template of that frame is skinned by the same arrays.
        let drive = Drive::new(u);
        let canonical: Vec<[f64; 3]> =
            (0..settings.points).map(|p| template.canonical(p, &drive)[0]).collect();
        let posed = skinned(&canonical, &weights, &transforms[12 * 16 * t..12 * 16 * (t + 1)]);
        let off = apart(&posed, &template.posed(&drive, &look).points);
        assert!(off < 1e-5, "frame {t}: {off} from the displaced and posed points");
    }
    println!("body.npz: worst {worst:.1e}");
    // Written points of the sets: the written template displaced and posed by the written factors.
    let shard = npz::read(&folder.path().join("observational/0000.npz")).expect("readable");
    let weights = floats(&npz::read(&folder.path().join("template.npz")).expect("readable"), "weights");
    let (points, u) = (rows(&floats(&shard, "points")), floats(&shard, "u"));
    for (i, (written, u)) in points.chunks(settings.points).zip(u.chunks(8)).enumerate() {
        let drive = Drive::new(u);
        let transforms: Vec<f64> = pose(&bones(), &drive)
            .iter()
            .flat_map(|g| g.iter().flatten().copied().chain([0.0, 0.0, 0.0, 1.0]))
            .collect();
        let canonical: Vec<[f64; 3]> =
            (0..settings.points).map(|p| template.canonical(p, &drive)[0]).collect();
        let off = apart(written, &skinned(&canonical, &weights, &transforms));
        assert!(off < 1e-5, "observed frame {i}: {off} from the written points");
    }
}

#[test]
fn the_open_body_plays_its_part() {
    let Some(file) = real_data("body") else { return };
    let casting = CharacterSettings {
        file,
        animations: vec!["Stand".into(), "Reach".into()],
        elbow: None,
        hide: Vec::new(),
        play: false,
    };
    let settings =
        Settings { set: "video".into(), character: Some(casting.clone()), passes: PassSet::ALL, ..small() };
    let folder = tempfile::tempdir().expect("a temporary folder");
    make(&settings, folder.path());
    let video = capture::read_capture(&folder.path().join("video")).expect("a capture");
    assert_eq!(video.frames.len(), settings.frames + settings.test_cameras, "every image");
    for frame in &video.frames {
        let mask = PassImages::read(frame).expect("passes").foreground.expect("a mask");
        let side = settings.video_size;
        let covered = mask.iter().filter(|a| **a > 0.5).count();
        assert!(
            (30..side * side / 2).contains(&covered),
            "{}: {covered} of {} pixels",
            frame.name,
            side * side
        );
        let is_border = |i: usize| [i % side, i / side].iter().any(|&k| k == 0 || k == side - 1);
        let cut = (0..side * side).filter(|&i| is_border(i) && mask[i] > 0.0).count();
        assert_eq!(cut, 0, "{}: nothing is cut by the border", frame.name);
        let tall = (0..side).filter(|&r| mask[r * side..(r + 1) * side].iter().any(|a| *a > 0.5)).count();
        assert!(tall > side / 2, "{}: {tall} of {side} rows", frame.name);
    }

    // The written poses are those of the character.
    let scm = settings.scm().expect("a model");
    let actor = CharacterSubject::new(&casting, &scm, &settings).expect("an actor");
    let third = CharacterSubject::new(&casting, &scm, &Settings { subject: 3, ..settings.clone() })
        .expect("an actor");
    let frames = settings.frames;
    assert_eq!(
        third.factors(1),
        video::frame(&scm, settings.seed, 3, 1, frames).u,
        "subject 3 moves as it does"
    );
    assert_ne!(third.factors(1), actor.factors(1), "and not as subject 0");
    let body = npz::read(&folder.path().join("video/body.npz")).expect("readable");
    let (at_rest, weights) = (rows(&floats(&body, "points")), floats(&body, "weights"));
    let (transforms, factors) = (floats(&body, "transforms"), floats(&body, "factors"));
    let (c, n) = (actor.character(), settings.factors);
    let template = c.template(settings.points, settings.seed).expect("a template");
    let bones = 16 * c.joints().len();
    for t in 0..settings.frames {
        let u = &factors[n * t..n * (t + 1)];
        let pose = c.pose_of(actor.meaning(), 0.0, u).expect("a pose");
        let truth = c.cloud(&template, &pose, &undisplaced(u)).points;
        let off = apart(&skinned(&at_rest, &weights, &transforms[bones * t..bones * (t + 1)]), &truth);
        println!("character, frame {t}: {off:.1e}");
        assert!(off < 1e-5, "frame {t}: {off} from the posed points");
    }

    // Each factor moves what it should.
    let surface = |u: [f64; 4]| -> Vec<[f64; 3]> {
        let pose = c.pose_of(actor.meaning(), 0.0, &u).expect("a pose");
        let object = c.posed(&pose, &Drive::new(&u)).expect("a surface");
        object.mesh.positions.iter().map(|p| p.map(f64::from)).collect()
    };
    let base = surface([0.0; 4]);
    let moved = |u: [f64; 4]| -> Vec<f64> {
        let square = |a: &[f64; 3], b: &[f64; 3]| {
            let d = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
            (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt()
        };
        surface(u).iter().zip(&base).map(|(a, b)| square(a, b)).collect()
    };
    let largest = |d: &[f64]| d.iter().fold(0.0, |m: f64, x| if *x > m { *x } else { m });
    let share = |d: &[f64]| d.iter().filter(|x| **x > 1e-6).count() as f64 / d.len() as f64;
    // Posture moves the points of joints that differ between the two animations, the arms among them, and
    // nothing else.
    let posture = moved([1.5, 0.0, 0.0, 0.0]);
    let transforms = |u: f64| c.transforms(&c.pose_of(actor.meaning(), 0.0, &[u]).expect("a pose"));
    let (still, walked) = (transforms(0.0), transforms(1.5));
    let differs = |j: usize| {
        still[j].as_flattened().iter().zip(walked[j].as_flattened()).any(|(a, b)| (a - b).abs() > 1e-9)
    };
    let turned: Vec<bool> = (0..still.len()).map(differs).collect();
    for name in ["mixamorig:LeftArm", "mixamorig:RightArm"] {
        assert!(turned[c.joint(name).expect("a joint")], "{name} turns");
    }
    for (i, d) in posture.iter().enumerate() {
        let (of, weights) = c.influences()[i];
        let hangs = of.iter().zip(&weights).any(|(&j, &w)| w > 0.0 && turned[usize::from(j)]);
        assert!(hangs || *d < 1e-6, "vertex {i} belongs to joints at rest and moves by {d}");
    }
    println!("posture moves {:.3} of the vertices, at most {:.3}", share(&posture), largest(&posture));
    assert!(largest(&posture) > 0.1, "posture moves a hand by {}", largest(&posture));
    let elbow = moved([0.0, 1.5, 0.0, 0.0]);
    assert!(largest(&elbow) > 0.1, "the forearm moves: {}", largest(&elbow));
    // Only points of the elbow and the joints below it.
    let joints = c.joints();
    let bent = actor.meaning().elbow.expect("an elbow");
    let hangs = |mut j: usize| loop {
        match joints[j].parent {
            _ if j == bent => return true,
            Some(p) => j = p,
            None => return false,
        }
    };
    for (i, d) in elbow.iter().enumerate() {
        let (of, weights) = c.influences()[i];
        let is_forearm = of.iter().zip(&weights).any(|(&j, &w)| w > 0.0 && hangs(usize::from(j)));
        assert!(is_forearm || *d < 1e-6, "vertex {i} of another limb moves {d}");
    }
    let folds = moved([0.0, 0.0, 1.5, 0.0]);
    assert!((0.01..=1.5 * WRINKLE * 1.05).contains(&largest(&folds)), "folds: {}", largest(&folds));
    assert!((0.05..0.9).contains(&share(&folds)), "the trunk alone: {}", share(&folds));
    assert_eq!(largest(&moved([0.0, 0.0, 0.0, 1.5])), 0.0, "light moves nothing");
    let azimuths: Vec<f64> = (0..settings.frames).map(|t| actor.light_azimuth(t)).collect();
    assert!(azimuths.iter().enumerate().all(|(t, a)| *a == 0.8 * factors[n * t + 3]), "light: {azimuths:?}");
}

#[test]
fn sets_of_the_knight_and_of_the_open_body_show_all_of_them() {
    for (file, animations) in [("characters/Knight.glb", vec!["Walking_A"]), ("body", vec!["Stand", "Reach"])]
    {
        let Some(file) = real_data(file) else { continue };
        let casting = CharacterSettings {
            file: file.clone(),
            animations: animations.into_iter().map(str::to_owned).collect(),
            elbow: None,
            hide: Vec::new(),
            play: false,
        };
        let settings = Settings {
            set: "all".into(),
            character: Some(casting),
            count: 24,
            groups: 4,
            appearances: 1,
            set_size: 64,
            points: 512,
            frames: 2,
            ..small()
        };
        let folder = tempfile::tempdir().expect("a temporary folder");
        make(&settings, folder.path());
        let pictures =
            Pictures::read(folder.path(), true, Framing::default()).expect("what pretraining reads");
        assert_eq!((pictures.observed(), pictures.groups().len()), (24, 4), "{}: all items", file.display());
        let observed = npz::read(&folder.path().join("observational/0000.npz")).expect("readable");
        let groups = npz::read(&folder.path().join("interventions/0000.npz")).expect("readable");
        let side = settings.set_size;
        for (arrays, name) in [(&observed, "mask"), (&groups, "base_mask"), (&groups, "after_mask")] {
            let masks = floats(arrays, name);
            for (i, mask) in masks.chunks(side * side).enumerate() {
                let covered = mask.iter().filter(|a| **a > 127.0).count();
                let share = covered as f64 / (side * side) as f64;
                assert!((0.05..0.5).contains(&share), "{}, {name} {i}: {share} covered", file.display());
                let is_border = |i: usize| [i % side, i / side].iter().any(|&k| k == 0 || k == side - 1);
                let cut = (0..side * side).filter(|&i| is_border(i) && mask[i] > 0.0).count();
                assert_eq!(cut, 0, "{}, {name} {i}: cut by the border", file.display());
            }
        }
    }
}

#[test]
fn light_changes_colour_and_nothing_else() {
    let person = ClothedFigure::new(&Appearance::new(3, 0));
    let camera = from_data_gen::camera(&video::camera(0, 48), Model::Pinhole);
    let picture = |light: f64| {
        let drive = Drive::new(&[0.4, -0.2, 0.7, light]);
        let object = person.object(&drive);
        let bvh = Bvh::build(&object.mesh.positions, &object.mesh.triangles);
        let settings = figure::lighting(16, 5);
        figure::passes(&object, &bvh, drive.light_azimuth, &camera, &settings).expect("an image")
    };
    let (left, right) = (picture(-1.0), picture(1.0));
    assert!(left.alpha.iter().filter(|a| **a == 1.0).count() > 100, "a person is seen");
    assert_eq!(left.alpha, right.alpha, "mask");
    assert_eq!(left.depth_z, right.depth_z, "depth");
    assert_eq!(left.normal, right.normal, "normals");
    assert_eq!(left.albedo, right.albedo, "albedo");
    assert_eq!((&left.roughness, &left.metallic), (&right.roughness, &right.metallic), "material");
    let seen = left.color.iter().zip(&right.color).zip(&left.alpha).filter(|(_, a)| **a == 1.0);
    let (sum, count) =
        seen.fold((0.0, 0.0), |(s, n), ((a, b), _)| (s + f64::from((a[1] - b[1]).abs()), n + 1.0));
    let black = left.color.iter().zip(&left.alpha).all(|(c, a)| *a > 0.0 || *c == [0.0; 3]);
    println!("mean change of a covered pixel: {:.3}", sum / count);
    assert!(sum / count > 0.02 && black, "light from the other side: {} a pixel", sum / count);
}
