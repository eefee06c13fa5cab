//! Miniatures of the layouts in which captures of persons are published, and what is true of them: the person, the cameras and the poses are
//! those of [`super::mini_person`].
#![allow(dead_code, reason = "each test program uses its part")]

use super::common::copy_hdf5;
use super::mini_person::{
    Cam, K, KX, Mini, V, V3, betas, matrix, mean_hands, rotated, thetas, thetas_of, write_picture,
};
use super::python::{Py, dump, object_npy};
use lastlight::io::npz;
use lastlight::io::smpl::{self, BodyModel};
use lastlight::num::array::Arrays;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::Path;

/// What is true of a source.
pub(crate) struct Truth {
    /// Points by the number of the frame, in the source's world.
    pub(crate) points: BTreeMap<i64, Vec<V3>>,
    pub(crate) cameras: BTreeMap<usize, Cam>,
    /// Our world from the source's.
    pub(crate) world: fn(V3) -> V3,
    /// Pixels of the source per pixel.
    pub(crate) scale: usize,
    pub(crate) side: usize,
    /// Joints and points of the body.
    pub(crate) body: [usize; 2],
}

/// SMPL's.
pub(crate) const BODY: [usize; 2] = [K, V];

/// (x, y, z) stays.
pub(crate) fn same(x: V3) -> V3 {
    x
}

/// z up from a camera's axes.
pub(crate) fn up(x: V3) -> V3 {
    [x[0], x[2], -x[1]]
}

/// Distortion that moves pixels of a small picture by up to one.
pub(crate) const D: [f64; 5] = [-0.08, 0.01, 0.002, -0.001, 0.003];

pub(crate) fn model() -> BodyModel {
    smpl::from_arrays(&Mini::new().arrays()).expect("a body model")
}

pub(crate) fn flat(rows: &[V3]) -> Vec<f64> {
    rows.iter().flatten().copied().collect()
}

/// `params/N.npy`.
pub(crate) fn params(poses: &[f64], rh: V3, th: V3) -> Vec<u8> {
    object_npy(&Py::Dict(vec![
        ("poses", Py::Array(vec![1, poses.len()], poses.to_vec())),
        ("Rh", Py::Array(vec![1, 3], rh.to_vec())),
        ("Th", Py::Array(vec![1, 3], th.to_vec())),
        ("shapes", Py::Array(vec![1, 10], betas())),
    ]))
}

/// A person standing in a world with z up: Rh turns y up to z up and a little about, Th lifts it.
fn standing(frame: usize) -> (V3, V3) {
    let half = std::f64::consts::FRAC_PI_2;
    // The turn about the vertical after the one about x, as one axis-angle, through matrices.
    let spin = [0.0, 0.0, 0.4 * frame as f64];
    let columns = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
        .map(|e| rotated(spin, rotated([half, 0.0, 0.0], e)));
    let r: [[f64; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| columns[j][i]));
    (lastlight::scene::person::rotation_vector(&r), [0.05 * frame as f64, -0.1, 0.35])
}

/// Points of a frame of ZJU-MoCap and MonoCap.
fn easymocap(frame: usize) -> (Vec<V3>, Vec<f64>, V3, V3) {
    let (mini, turns, (rh, th)) = (Mini::new(), thetas(frame, [0.0; 3]), standing(frame));
    let place = move |x: V3| -> V3 {
        let y = rotated(rh, x);
        std::array::from_fn(|c| y[c] + th[c])
    };
    (mini.posed(&mini.shaped(&betas()), &turns, &place), flat(&turns), rh, th)
}

fn annots(cameras: &BTreeMap<usize, Cam>, ims: Option<Vec<Vec<String>>>) -> Vec<u8> {
    let each = |f: &dyn Fn(&Cam) -> Py| Py::List(cameras.values().map(f).collect());
    let mut entries = vec![(
        "cams",
        Py::Dict(vec![
            ("K", each(&|c| Py::Array(vec![3, 3], flat(&c.k)))),
            ("D", each(&|c| Py::Array(vec![5, 1], c.d.clone()))),
            ("R", each(&|c| Py::Array(vec![3, 3], flat(&c.r)))),
            ("T", each(&|c| Py::Array(vec![3, 1], c.t.iter().map(|x| 1000.0 * x).collect()))),
        ]),
    )];
    if let Some(ims) = ims {
        let frame = |paths: &Vec<String>| {
            Py::Dict(vec![("ims", Py::List(paths.iter().map(|p| Py::Str(p.clone())).collect()))])
        };
        entries.push(("ims", Py::List(ims.iter().map(frame).collect())));
    }
    object_npy(&Py::Dict(entries))
}

/// ZJU-MoCap.
pub(crate) fn zju(dir: &Path, refined: bool, count: usize, frames: usize) -> Truth {
    let side = 32;
    let cameras: BTreeMap<usize, Cam> =
        (0..count).map(|c| (c, Cam::around(side, 0.9 * c as f64, true, &D))).collect();
    let path =
        |c: usize, f: usize| format!("{}Camera_B{}/{f:06}.jpg", if refined { "images/" } else { "" }, c + 1);
    let mut points = BTreeMap::new();
    let (bodies, masks) = if refined { ("smpl_params", "mask") } else { ("new_params", "mask_cihp") };
    for f in 0..frames {
        let (x, poses, rh, th) = easymocap(f);
        std::fs::create_dir_all(dir.join(bodies)).expect("made");
        std::fs::write(dir.join(format!("{bodies}/{f}.npy")), params(&poses, rh, th)).expect("written");
        for (c, cam) in &cameras {
            let (rgb, mask) = cam.photograph(side, &x);
            write_picture(&dir.join(path(*c, f)), side, 3, &rgb);
            // Not zero is the person, whatever the label.
            let labels: Vec<u8> = mask.iter().enumerate().map(|(i, m)| m * (1 + (i % 20) as u8)).collect();
            write_picture(&dir.join(format!("{masks}/Camera_B{}/{f:06}.png", c + 1)), side, 1, &labels);
        }
        points.insert(f as i64, x);
    }
    // Copies of the refined set were written on Windows.
    let stored = |p: String| if refined { p.replace('/', "\\") } else { p };
    let ims = (0..frames).map(|f| (0..count).map(|c| stored(path(c, f))).collect()).collect();
    std::fs::write(dir.join("annots.npy"), annots(&cameras, Some(ims))).expect("written");
    if !refined {
        // Points of the release, with which the body is compared.
        let mut a = Arrays::new();
        a.put("0", &[V, 3], flat(&points[&0]));
        let zip = npz::to_bytes(&a, npz::Packing::Stored).expect("made");
        // The member of the archive is the file.
        let start = zip.windows(6).position(|w| w == b"\x93NUMPY").expect("an array");
        let end = start + 128 + 8 * 3 * V;
        std::fs::create_dir_all(dir.join("new_vertices")).expect("made");
        std::fs::write(dir.join("new_vertices/0.npy"), &zip[start..end]).expect("written");
    }
    Truth { points, cameras, world: same, scale: 2, side, body: BODY }
}

/// MonoCap: two cameras, three frames.
pub(crate) fn monocap(dir: &Path) -> Truth {
    let side = 16;
    let cameras: BTreeMap<usize, Cam> =
        (0..2).map(|c| (c, Cam::around(side, 1.2 * c as f64, true, &[0.0; 5]))).collect();
    let mut points = BTreeMap::new();
    for f in 0..3 {
        let (x, poses, rh, th) = easymocap(f);
        std::fs::create_dir_all(dir.join("params")).expect("made");
        std::fs::write(dir.join(format!("params/{f}.npy")), params(&poses, rh, th)).expect("written");
        for (c, cam) in &cameras {
            let (rgb, mask) = cam.photograph(side, &x);
            write_picture(&dir.join(format!("images/{c:02}/{f:04}.jpg")), side, 3, &rgb);
            let mask: Vec<u8> = mask.iter().map(|m| 255 * m).collect();
            write_picture(&dir.join(format!("mask/{c:02}/{f:04}.png")), side, 1, &mask);
        }
        points.insert(f as i64, x);
    }
    std::fs::write(dir.join("annots.npy"), annots(&cameras, None)).expect("written");
    Truth { points, cameras, world: same, scale: 1, side, body: BODY }
}

/// A moment as ARAH and 3DGS-Avatar have it.
pub(crate) fn posed_model(path: &Path, rest: &[V3], turns: &[V3], trans: V3) {
    let body = model();
    let joints = lastlight::scene::person::smpl::joints(&body, rest);
    let bones = lastlight::scene::person::smpl::chain(&body.parents, &joints, turns);
    let square = |a: &[[f64; 4]; 3]| -> Vec<f32> {
        a.iter().flatten().copied().chain([0.0, 0.0, 0.0, 1.0]).map(|x| x as f32).collect()
    };
    let squares: Vec<f32> = bones.iter().flat_map(square).collect();
    let angles = flat(turns);
    let model = Arrays::new()
        .with("minimal_shape", &[V, 3], flat(rest))
        .with("betas", &[1, 10], betas())
        .with("bone_transforms", &[24, 4, 4], squares)
        .with("trans", &[3], trans.to_vec())
        .with("root_orient", &[3], angles[..3].to_vec())
        .with("pose_body", &[63], angles[3..66].to_vec())
        .with("pose_hand", &[6], angles[66..].to_vec())
        .with("Jtr_posed", &[24, 3], vec![0.0f64; 72]);
    npz::write(path, &model).expect("written");
}

/// ARAH's version of ZJU-MoCap: two cameras, three frames; the body is in `body_models/misc` beside the folder.
pub(crate) fn arah(dir: &Path) -> Truth {
    let side = 32;
    let mini = Mini::new();
    mini.misc(&dir.with_file_name("body_models").join("misc"));
    let cameras: BTreeMap<usize, Cam> =
        (1..3).map(|c| (c, Cam::around(side, 0.7 * c as f64, false, &D))).collect();
    // Some sets write names with zeros in front.
    let called = |c: usize| if c == 2 { "02".to_owned() } else { c.to_string() };
    let mut params = json!({"all_cam_names": ["1", "02"]});
    for (c, cam) in &cameras {
        let column = |v: &[f64]| v.iter().map(|x| vec![*x]).collect::<Vec<_>>();
        params[called(*c)] = json!({"K": cam.k, "D": column(&cam.d), "R": cam.r, "T": column(&cam.t)});
    }
    std::fs::create_dir_all(dir.join("models")).expect("made");
    std::fs::write(dir.join("cam_params.json"), params.to_string()).expect("written");
    let mut points = BTreeMap::new();
    for f in 0..3 {
        // The world has y down: half a turn about x puts the person upright.
        let turns = thetas(f, [std::f64::consts::PI, 0.1, 0.0]);
        let trans = [0.05, -0.1 * f as f64, 0.1];
        let rest = mini.shaped(&betas());
        let x = mini.posed(&rest, &turns, &|x| std::array::from_fn(|c| x[c] + trans[c]));
        posed_model(&dir.join(format!("models/{f:06}.npz")), &rest, &turns, trans);
        for (c, cam) in &cameras {
            let (rgb, mask) = cam.photograph(side, &x);
            write_picture(&dir.join(format!("{}/{f:06}.jpg", called(*c))), side, 3, &rgb);
            write_picture(&dir.join(format!("{}/{f:06}.png", called(*c))), side, 1, &mask);
        }
        points.insert(f as i64, x);
    }
    Truth { points, cameras, world: same, scale: 1, side, body: BODY }
}

/// Points of PeopleSnapshot: a camera's axes are the world, the person stands upside down in them.
fn turning(frame: usize, mini: &Mini, rest: &[V3]) -> (Vec<V3>, Vec<V3>, V3) {
    let turns = thetas(frame, [std::f64::consts::PI, 0.2 * frame as f64, 0.0]);
    let trans = [0.02 * frame as f64, 0.1, 3.0];
    let body = mini.shaped(&betas());
    (mini.posed_about(&body, rest, &turns, &|x| std::array::from_fn(|c| x[c] + trans[c])), turns, trans)
}

/// The camera of PeopleSnapshot and InstantAvatar: at the origin.
fn still(side: usize, d: &[f64]) -> Cam {
    Cam { t: [0.0; 3], r: matrix([0.0; 3]), ..Cam::around(side, 0.0, false, d) }
}

/// `camera.pkl`.
fn camera_pkl(cam: &Cam, side: usize) -> Vec<u8> {
    dump(&Py::Dict(vec![
        ("camera_t", Py::Array(vec![3], cam.t.to_vec())),
        ("camera_rt", Py::Array(vec![3], vec![0.0; 3])),
        ("camera_f", Py::Array(vec![2], vec![cam.k[0][0], cam.k[1][1]])),
        ("camera_c", Py::Array(vec![2], vec![cam.k[0][2], cam.k[1][2]])),
        ("camera_k", Py::Array(vec![5], cam.d.clone())),
        ("width", Py::Int(side as i64)),
        ("height", Py::Int(side as i64)),
    ]))
}

/// PeopleSnapshot of 4, 11 or 101 frames without pictures; gives points, and the pictures to come.
pub(crate) fn snapshot(dir: &Path, frames: usize) -> (Truth, Vec<Vec<u8>>) {
    std::fs::create_dir_all(dir).expect("made");
    let side = 16;
    let (mini, cam) = (Mini::new(), still(side, &D));
    // The person at rest is not the model's shape: clothes.
    let rest: Vec<V3> = mini.shaped(&betas()).iter().map(|x| [1.02 * x[0], x[1], 1.05 * x[2]]).collect();
    std::fs::write(dir.join("camera.pkl"), camera_pkl(&cam, side)).expect("written");
    let (mut points, mut photographs) = (BTreeMap::new(), Vec::new());
    for f in 0..frames {
        let (x, ..) = turning(f, &mini, &rest);
        photographs.push(cam.photograph(side, &x).0);
        points.insert(f as i64, x);
    }
    // Masks and poses.
    copy_hdf5(&format!("snapshot_{frames}"), dir);
    let lines: Vec<String> = rest.iter().map(|x| format!("v {:?} {:?} {:?}", x[0], x[1], x[2])).collect();
    std::fs::write(
        dir.join("consensus.obj"),
        format!("# person\n{}\nvt 0 0\nf 1/1 2/1 3/1\n", lines.join("\n")),
    )
    .expect("written");
    (
        Truth { points, cameras: BTreeMap::from([(0, cam)]), world: up, scale: 1, side, body: BODY },
        photographs,
    )
}

/// PeopleSnapshot as InstantAvatar prepares it: four frames.
pub(crate) fn instant_avatar(dir: &Path) -> Truth {
    let (side, frames) = (16, 4);
    let (mini, cam) = (Mini::new(), still(side, &[]));
    let rest = mini.shaped(&betas());
    let (mut points, mut angles, mut transl) = (BTreeMap::new(), Vec::new(), Vec::new());
    for f in 0..frames {
        let (x, turns, t) = turning(f, &mini, &rest);
        let (rgb, mask) = cam.photograph(side, &x);
        write_picture(&dir.join(format!("images/image_{f:04}.png")), side, 3, &rgb);
        let mut a = Arrays::new();
        a.put("m", &[side, side], mask);
        let zip = npz::to_bytes(&a, npz::Packing::Stored).expect("made");
        let start = zip.windows(6).position(|w| w == b"\x93NUMPY").expect("an array");
        std::fs::create_dir_all(dir.join("masks")).expect("made");
        std::fs::write(dir.join(format!("masks/mask_{f:04}.npy")), &zip[start..start + 128 + side * side])
            .expect("written");
        angles.push(flat(&turns));
        transl.push(t);
        points.insert(f as i64, x);
    }
    let eye: Vec<f64> = (0..16).map(|i| f64::from(u8::from(i % 5 == 0))).collect();
    let camera = Arrays::new()
        .with("intrinsic", &[3, 3], flat(&cam.k))
        .with("extrinsic", &[4, 4], eye)
        .with("height", &[], vec![side as i64])
        .with("width", &[], vec![side as i64]);
    npz::write(&dir.join("cameras.npz"), &camera).expect("written");
    // Poses of all frames are coarse; those of the training frames are refined.
    let coarse = Arrays::new()
        .with("betas", &[10], betas())
        .with(
            "thetas",
            &[frames, 72],
            angles
                .iter()
                .enumerate()
                .flat_map(|(f, a)| a.iter().map(move |x| if f < 3 { x + 0.3 } else { *x }))
                .collect::<Vec<f64>>(),
        )
        .with("transl", &[frames, 3], flat(&transl));
    npz::write(&dir.join("poses.npz"), &coarse).expect("written");
    let fine = Arrays::new()
        .with("betas", &[1, 10], betas())
        .with(
            "global_orient",
            &[3, 3],
            angles[..3].iter().flat_map(|a| a[..3].to_vec()).collect::<Vec<f64>>(),
        )
        .with("body_pose", &[3, 69], angles[..3].iter().flat_map(|a| a[3..].to_vec()).collect::<Vec<f64>>())
        .with("transl", &[3, 3], flat(&transl[..3]));
    std::fs::create_dir_all(dir.join("poses")).expect("made");
    npz::write(&dir.join("poses/anim_nerf_train.npz"), &fine).expect("written");
    Truth { points, cameras: BTreeMap::from([(0, cam)]), world: up, scale: 1, side, body: BODY }
}

/// PeopleSnapshot as Anim-NeRF and 3DGS-Avatar prepare it: four frames; the body is in `body_models/misc` beside the folder.
pub(crate) fn anim_nerf(dir: &Path) -> Truth {
    let (side, frames) = (32, 4);
    let (mini, cam) = (Mini::new(), still(side, &D));
    mini.misc(&dir.with_file_name("body_models").join("misc"));
    std::fs::create_dir_all(dir.join("animnerf_models")).expect("made");
    std::fs::write(dir.join("camera.pkl"), camera_pkl(&cam, side)).expect("written");
    let rest = mini.shaped(&betas());
    let mut points = BTreeMap::new();
    for f in 0..frames {
        let (x, turns, trans) = turning(f, &mini, &rest);
        posed_model(&dir.join(format!("animnerf_models/{f:06}.npz")), &rest, &turns, trans);
        let (rgb, mask) = cam.photograph(side, &x);
        // Pictures are counted, models are named: their numbers need not agree.
        write_picture(&dir.join(format!("image/{:06}.jpg", f + 1)), side, 3, &rgb);
        write_picture(&dir.join(format!("mask/{:06}.png", f + 1)), side, 1, &mask);
        points.insert(f as i64, x);
    }
    Truth { points, cameras: BTreeMap::from([(0, cam)]), world: up, scale: 1, side, body: BODY }
}

/// DNA-Rendering: five cameras, three frames, a body of [`KX`] joints.
pub(crate) fn dna(dir: &Path) -> Truth {
    let (side, frames) = (32, 3);
    let mini = Mini::of(KX);
    let hands = mean_hands().concat();
    let rest = mini.shaped(&betas());
    let cameras: BTreeMap<usize, Cam> =
        [24, 25, 26, 27, 28].map(|c| (c, Cam::around(side, 0.8 * c as f64, false, &D))).into();
    let mut points = BTreeMap::new();
    for f in 0..frames {
        // What is stored of the hands comes on top of their mean.
        let mut turns = thetas_of(KX, f, [std::f64::consts::PI, 0.3, 0.0]);
        for (v, mean) in turns[KX - 30..].iter_mut().zip(hands.as_chunks::<3>().0) {
            *v = std::array::from_fn(|c| v[c] + mean[c]);
        }
        let t = [0.0, 0.05 * f as f64, 0.1];
        points.insert(f as i64, mini.posed(&rest, &turns, &|x| std::array::from_fn(|c| 1.1 * x[c] + t[c])));
    }
    copy_hdf5("dna", dir);
    Truth { points, cameras, world: same, scale: 2, side, body: mini.size() }
}
