//! The layout of a person's capture: what `last gen` writes is read, and everything inconsistent is an error
//! of its own.

use crate::common;
use crate::mini_person::{V3, apart, figure_video, rotated, write_picture};
use data_gen::figure::factors::Drive;
use data_gen::figure::skeleton::{bones, pose};
use lastlight::io::npz;
use lastlight::last::avatar::pose;
use lastlight::num::array::Arrays;
use lastlight::scene::person::{Kind, PersonCapture};
use reference::body::skin;
use serde_json::Value;
use std::path::Path;

#[test]
fn what_last_gen_writes_is_read() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    figure_video(dir.path());
    let c = PersonCapture::open(dir.path()).expect("the folder above the video is found");
    assert_eq!(
        c,
        PersonCapture::open(&dir.path().join("video")).expect("the video itself"),
        "the same capture"
    );
    let t = &c.template;
    assert_eq!((&t.kind, t.len(), t.joints.len(), c.moments()), (&Kind::Figure, 256, 12, 4), "sizes");
    assert_eq!((t.unit_m, c.box_margin), (0.85, (0.05 / 0.85) as f32), "5 cm in units of 0.85 m");
    assert_eq!((c.train.len(), c.test.len(), c.factors.len()), (4, 2, 4), "images and causes");
    assert!(c.train.iter().all(|&i| c.shots[i].camera_id == 0), "camera 0 trains");
    // The points are where the figure's own skinning puts them.
    let arrays = npz::read(&dir.path().join("video/body.npz")).expect("there");
    let weights = arrays.need("weights").expect("there").to_f64();
    for moment in 0..c.moments() {
        let posed = pose(&bones(), &Drive::new(&c.factors[moment]));
        let expected: Vec<V3> = t
            .points
            .iter()
            .zip(weights.chunks_exact(12))
            .map(|(x, w)| skin::point(&skin::blend(w, &posed), x.map(f64::from)))
            .collect();
        let off = apart(&c.posed_points(moment), &expected);
        assert!(off < 1e-6, "moment {moment}: {off:e}");
        let joints: Vec<V3> = (0..12).map(|k| skin::point(&posed[k], t.joints[k].map(f64::from))).collect();
        assert!(apart(&c.posed_joints(moment), &joints) < 1e-6, "joints move with their own transforms");
        // Rotations relative to the parents give the transforms again.
        let none = vec![[0.0; 3]; 12];
        let same = pose::forward(t, &c.poses[moment].transforms, &none).transforms;
        let worst = c.poses[moment].transforms.iter().zip(&same).flat_map(|(a, b)| {
            (0..12).map(|i| (a[i / 4][i % 4] - b[i / 4][i % 4]).abs()).collect::<Vec<f32>>()
        });
        assert!(worst.fold(0.0f32, |m, d| if d > m { d } else { m }) < 1e-6, "no correction changes nothing");
    }
    // A correction of one joint rotates its subtree about the joint.
    let (k, angle) = (5, 0.3);
    let mut correction = vec![[0.0; 3]; 12];
    correction[k] = [0.0, angle as f32, 0.0];
    let before = &c.poses[1].transforms;
    let after = pose::forward(t, before, &correction).transforms;
    let mut below = [false; 12];
    for &j in &t.order {
        below[j] = j == k || t.parents[j].is_some_and(|p| below[p]);
    }
    let wide = |a: &[[f32; 4]; 3]| a.map(|r| r.map(f64::from));
    for j in 0..12 {
        let x = [0.3, -0.2, 0.7];
        let pivot = t.joints[k].map(f64::from);
        let y = rotated([0.0, angle, 0.0], std::array::from_fn(|i| x[i] - pivot[i]));
        let turned: V3 = std::array::from_fn(|i| y[i] + pivot[i]);
        let expected = skin::point(&wide(&before[j]), if below[j] { turned } else { x });
        let got = skin::point(&wide(&after[j]), x);
        assert!((0..3).all(|i| (got[i] - expected[i]).abs() < 1e-5), "joint {j}: {got:?} and {expected:?}");
    }
    let report = lastlight::last::inspect::inspect(dir.path(), 3).expect("examined");
    assert!(report.is_usable() && report.images.len() == 5, "three training images and two cameras");
    assert!(
        report.images.iter().all(|l| l.on_mask > 0.95 && l.in_box > 0.99),
        "{:?}",
        report.record()["checked_images"]
    );
    // Every joint that moves points has its dot where the camera sees it.
    for look in &report.images {
        let is_it = |s: &&lastlight::scene::person::Shot| s.camera_id == look.camera && s.time == look.time;
        let shot = c.shots.iter().find(is_it).expect("the image under test");
        let (w, h, rgb) = &look.overlay;
        let zoom = w / shot.camera.width;
        assert_eq!((*w, *h), (zoom * shot.camera.width, zoom * shot.camera.height), "integer pixels");
        for joint in c.posed_joints(shot.time) {
            let at = lastlight::scene::bound::project(&shot.camera, joint.map(f64::from)).expect("in front");
            let [x, y] = at.map(|v| (v * zoom as f64).floor() as usize);
            assert_eq!(rgb[3 * (y * w + x)..][..3], [235, 64, 52], "{}: a joint at {x}, {y}", look.name);
        }
    }
}

/// All problems reported for a modified copy of a valid capture.
fn problems(good: &Path, spoil: &dyn Fn(&Path)) -> String {
    let dir = tempfile::tempdir().expect("a temporary folder");
    for (name, bytes) in common::tree(good) {
        let path = dir.path().join(&name);
        std::fs::create_dir_all(path.parent().expect("in a folder")).expect("made");
        std::fs::write(path, bytes).expect("written");
    }
    spoil(dir.path());
    let (_, problems) = PersonCapture::examine(dir.path()).expect("examined");
    let first = PersonCapture::open(dir.path()).expect_err("refused").to_string();
    assert_eq!(first, problems[0].to_string(), "the first of the problems");
    problems.iter().map(|e| format!("{e}\n")).collect()
}

#[test]
fn every_inconsistency_is_an_error_of_its_own() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    figure_video(folder.path());
    let good = &folder.path().join("video");
    let say = |parts: &[&str], spoil: &dyn Fn(&Path)| {
        let text = problems(good, spoil);
        parts.iter().for_each(|p| assert!(text.contains(p), "'{p}' in\n{text}"));
    };
    let body = |dir: &Path, change: &dyn Fn(&mut Arrays)| {
        let path = dir.join("body.npz");
        let mut arrays = npz::read(&path).expect("there");
        change(&mut arrays);
        npz::write(&path, &arrays).expect("written");
    };
    let cameras = |dir: &Path, change: &dyn Fn(&mut Value)| {
        let path = dir.join("transforms_train.json");
        let mut v: Value = serde_json::from_slice(&std::fs::read(&path).expect("there")).expect("JSON");
        change(&mut v);
        std::fs::write(path, v.to_string()).expect("written");
    };
    say(&["frames[2].file_path", "images/c00_f0002.png", "not there"], &|d| {
        std::fs::remove_file(d.join("images/c00_f0002.png")).expect("removed");
    });
    say(&["frames[1].foreground_path", "not there"], &|d| {
        std::fs::remove_file(d.join("foreground/c00_f0001.png")).expect("removed");
    });
    say(&["frames[0].foreground_path", "the mask of the person", "nothing"], &|d| {
        cameras(d, &|v| drop(v["frames"][0].as_object_mut().expect("a frame").remove("foreground_path")));
    });
    say(&["c00_f0001.png: mask size: expected 48x48, as the photo, got 24x24"], &|d| {
        write_picture(&d.join("foreground/c00_f0001.png"), 24, 1, &[255; 24 * 24]);
    });
    say(&["c00_f0003.png: image size: expected 48x48, as its camera declares, got 24x24"], &|d| {
        write_picture(&d.join("images/c00_f0003.png"), 24, 3, &[255; 24 * 24 * 3]);
    });
    let shorter = |a: &mut Arrays, name: &str| {
        let x = a.need(name).expect("there");
        let (shape, values) = (x.shape().to_vec(), x.to_f64());
        let n = shape[0] - 1;
        let rest = values.len() / shape[0] * n;
        a.put(name, &[&[n], &shape[1..]].concat(), values[..rest].to_vec());
    };
    say(&["array 'transforms': expected 4 poses, one for each moment that the cameras name, got 3"], &|d| {
        body(d, &|a| {
            shorter(a, "transforms");
            shorter(a, "factors");
        });
    });
    say(&["array 'factors'", "[4, n]"], &|d| body(d, &|a| shorter(a, "factors")));
    say(&["array 'poses'", "4 poses, as many as transforms", "got 3"], &|d| {
        body(d, &|a| a.put("poses", &[3, 12, 3], vec![0.0f32; 108]));
    });
    say(&["body.npz", "no such file"], &|d| std::fs::remove_file(d.join("body.npz")).expect("removed"));
    say(&["array 'weights'", "skinning weights", "cannot be posed"], &|d| {
        body(d, &|a| drop(a.0.remove("weights")));
    });
    say(&["array 'weights': point 0: expected weights that sum to 1, got 2"], &|d| {
        body(d, &|a| a.put("weights", &[256, 12], vec![2.0f32 / 12.0; 256 * 12]));
    });
    say(&["array 'weights': point 0", "not negative"], &|d| {
        body(d, &|a| {
            let mut w = a.need("weights").expect("there").to_f32();
            w[0] -= 2.0;
            w[1] += 2.0;
            a.put("weights", &[256, 12], w);
        });
    });
    say(&["array 'points'", "shape (P,3)"], &|d| body(d, &|a| a.put("points", &[256, 2], vec![0.0f32; 512])));
    say(&["array 'weights'", "P=255"], &|d| body(d, &|a| a.put("points", &[255, 3], vec![0.0f32; 765])));
    say(&["array 'points'", "index [7, 1]", "NaN"], &|d| {
        body(d, &|a| {
            let mut x = a.need("points").expect("there").to_f32();
            x[22] = f32::NAN;
            a.put("points", &[256, 3], x);
        });
    });
    let parents = |d: &Path, at: usize, parent: i32| {
        body(d, &|a| {
            let mut p: Vec<i32> = a
                .need("parents")
                .expect("there")
                .to_i64()
                .expect("whole")
                .iter()
                .map(|&x| x as i32)
                .collect();
            p[at] = parent;
            a.put("parents", &[12], p);
        });
    };
    say(&["array 'parents'", "without a cycle", "a cycle above the joints"], &|d| {
        let tree = npz::read(&d.join("body.npz")).expect("there").need("parents").expect("there").to_i64();
        let child = tree.expect("whole").iter().position(|&p| p == 1).expect("a child of joint 1");
        parents(d, 1, child as i32);
    });
    say(&["array 'parents': joint 2", "got 12"], &|d| parents(d, 2, 12));
    say(&["array 'parents': joint 3", "got 3"], &|d| parents(d, 3, 3));
    let transforms = |d: &Path, at: usize, value: f32| {
        body(d, &|a| {
            let mut x = a.need("transforms").expect("there").to_f32();
            x[at] = value;
            a.put("transforms", &[4, 12, 4, 4], x);
        });
    };
    say(&["array 'transforms': moment 1, joint 0", "last row"], &|d| transforms(d, 12 * 16 + 15, 2.0));
    say(&["array 'transforms'", "index [2, 3, 0, 1]", "NaN"], &|d| {
        transforms(d, (2 * 12 + 3) * 16 + 1, f32::NAN);
    });
    say(&["array 'transforms': moment 0, joint 0", "positive determinant"], &|d| transforms(d, 0, -1.0));
    say(&["array 'faces'", "below 256", "256 in face 0"], &|d| {
        body(d, &|a| a.put("faces", &[1, 3], vec![0i32, 1, 256]));
    });
    say(&["array 'pose_shapes'", "[256, 3, 99]"], &|d| {
        body(d, &|a| a.put("pose_shapes", &[256, 3, 9], vec![0.0f32; 256 * 27]));
    });
    say(&["array 'canonical'"], &|d| body(d, &|a| a.put("canonical", &[11, 4, 4], vec![0.0f32; 176])));
    say(&["global_translation", "both or neither"], &|d| {
        body(d, &|a| a.put("global_rotation", &[4, 3], vec![0.0f32; 12]));
    });
    say(&["frames[0].frame", "an integer", "\"x\""], &|d| {
        cameras(d, &|v| v["frames"][0]["frame"] = "x".into());
    });
    say(&["camera 0, moment 1", "one image"], &|d| cameras(d, &|v| v["frames"][2]["frame"] = 1.into()));
    say(&["lens", "without distortion"], &|d| {
        cameras(d, &|v| {
            v["camera_model"] = "OPENCV".into();
            v["frames"][0]["k1"] = 0.1.into();
        });
    });
    say(&["at least one training image"], &|d| cameras(d, &|v| v["frames"] = Value::Array(vec![])));
    say(
        &[
            "transforms_train.json: line 1, column 1: expected a complete JSON document, got the end of the file",
        ],
        &|d| {
            std::fs::write(d.join("transforms_train.json"), "{").expect("written");
        },
    );
    let nothing = PersonCapture::open(&folder.path().join("nothing")).expect_err("refused").to_string();
    assert!(nothing.contains("no such file or folder") && nothing.contains("last import"), "{nothing}");
    // An image with a valid header and damaged data is found when it is read.
    let c = PersonCapture::open(good).expect("good");
    let bytes = std::fs::read(good.join("images/c00_f0000.png")).expect("there");
    std::fs::write(good.join("images/c00_f0000.png"), &bytes[..bytes.len() - 30]).expect("written");
    let shot = c.shots.iter().find(|s| s.name.ends_with("c00_f0000.png")).expect("there");
    assert!(shot.photo().expect_err("cut").to_string().contains("c00_f0000.png"), "names the file");
}
