//! A body of 24 joints and 48 points under the keys of SMPL, or of 55 and 110 under those of SMPL-X, posed by
//! formulas of its own, and images of it of 16² or 32².
#![allow(dead_code, reason = "each test program uses its part")]

use super::python::{Py, dump};
use lastlight::io::image_file;
use lastlight::io::npz;
use lastlight::last::generate::{self, Settings};
use lastlight::num::array::Arrays;
use lastlight::scene::person::PersonCapture;
use std::path::Path;
use std::sync::atomic::AtomicBool;

pub(crate) type V3 = [f64; 3];
pub(crate) type M3 = [[f64; 3]; 3];

/// Joints of SMPL.
pub(crate) const K: usize = 24;
/// Points: two per joint.
pub(crate) const V: usize = 2 * K;
/// Joints of SMPL-X: 22 of the body, jaw, eyes, 15 of either hand.
pub(crate) const KX: usize = 55;
/// Shape coefficients.
pub(crate) const B: usize = 10;
/// Parents.
pub(crate) const PARENTS: [usize; K] =
    [0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21];

/// Places of the joints, metres, y up, facing +z.
#[rustfmt::skip]
const JOINTS: [V3; K] = [
    [0.0, -0.2, 0.0], [0.1, -0.3, 0.0], [-0.1, -0.3, 0.0], [0.0, -0.1, 0.0], [0.12, -0.7, 0.0], [-0.12, -0.7, 0.0],
    [0.0, 0.05, 0.02], [0.12, -1.1, -0.02], [-0.12, -1.1, -0.02], [0.0, 0.1, 0.0], [0.13, -1.15, 0.1], [-0.13, -1.15, 0.1],
    [0.0, 0.3, 0.0], [0.08, 0.2, 0.0], [-0.08, 0.2, 0.0], [0.0, 0.45, 0.05], [0.2, 0.22, 0.0], [-0.2, 0.22, 0.0],
    [0.45, 0.2, 0.0], [-0.45, 0.2, 0.0], [0.7, 0.2, 0.0], [-0.7, 0.2, 0.0], [0.8, 0.2, 0.0], [-0.8, 0.2, 0.0],
];

/// Parents and places of K or KX joints.
fn skeleton(k: usize) -> (Vec<usize>, Vec<V3>) {
    let (mut parents, mut places) = (PARENTS.to_vec(), JOINTS.to_vec());
    if k == KX {
        parents.truncate(22);
        places.truncate(22);
        for x in [0.0, 0.03, -0.03] {
            parents.push(15);
            places.push([x, 0.5, 0.1]);
        }
        for (wrist, side) in [(20, 1.0), (21, -1.0)] {
            for joint in 0..15 {
                // Five fingers of three joints.
                let (finger, phalanx) = (joint / 3, joint % 3);
                parents.push(if phalanx == 0 { wrist } else { parents.len() - 1 });
                places.push([side * (0.76 + 0.03 * phalanx as f64), 0.2, 0.04 - 0.02 * finger as f64]);
            }
        }
    }
    (parents, places)
}

/// Numbers in −1..1 that depend on their index alone.
fn noise(i: usize) -> f64 {
    let x = (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    (x >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// The body model.
pub(crate) struct Mini {
    parents: Vec<usize>,
    pub(crate) template: Vec<V3>,
    pub(crate) shapes: Vec<f64>,
    pub(crate) pose_shapes: Vec<f64>,
    pub(crate) regressor: Vec<f64>,
    pub(crate) weights: Vec<f64>,
    pub(crate) faces: Vec<u32>,
}

impl Mini {
    pub(crate) fn new() -> Self {
        Self::of(K)
    }

    /// With K or KX joints.
    pub(crate) fn of(k: usize) -> Self {
        let (parents, places) = skeleton(k);
        let v = 2 * k;
        // The points of a joint lie on opposite sides of it, so that their mean is the joint.
        let template = (0..v).map(|p| {
            let side = if p < k { 0.05 } else { -0.05 };
            let j = places[p % k];
            [j[0] + 0.3 * side, j[1] + 0.4 * side, j[2] + side]
        });
        let mut regressor = vec![0.0; k * v];
        let mut weights = vec![0.0; v * k];
        for p in 0..v {
            regressor[(p % k) * v + p] = 0.5;
            weights[p * k + p % k] += 0.75;
            weights[p * k + parents[p % k]] += 0.25;
        }
        Self {
            template: template.collect(),
            shapes: (0..v * 3 * B).map(|i| 0.02 * noise(i)).collect(),
            pose_shapes: (0..v * 3 * 9 * (k - 1)).map(|i| 0.01 * noise(i + 77)).collect(),
            regressor,
            weights,
            parents,
            faces: (0..v as u32 - 2).flat_map(|i| [i, i + 1, i + 2]).collect(),
        }
    }

    /// Joints and points.
    pub(crate) fn size(&self) -> [usize; 2] {
        [self.parents.len(), self.template.len()]
    }

    fn kintree(&self) -> Vec<u32> {
        let [joints, _] = self.size();
        let up = |k: usize| if k == 0 { u32::MAX } else { self.parents[k] as u32 };
        (0..joints).map(up).chain(0..joints as u32).collect()
    }

    /// As `SMPL_NEUTRAL.pkl` has it.
    pub(crate) fn pickle(&self) -> Vec<u8> {
        let flat: Vec<f64> = self.template.iter().flatten().copied().collect();
        dump(&Py::Dict(vec![
            ("J_regressor", Py::Csc(K, V, self.regressor.clone())),
            ("f", Py::Counts(vec![V - 2, 3], self.faces.clone())),
            ("kintree_table", Py::Counts(vec![2, K], self.kintree())),
            ("weights", Py::Array(vec![V, K], self.weights.clone())),
            ("posedirs", Py::Array(vec![V, 3, 9 * (K - 1)], self.pose_shapes.clone())),
            ("bs_style", Py::Str("lbs".into())),
            ("v_template", Py::Array(vec![V, 3], flat)),
            ("shapedirs", Py::Ch(Box::new(Py::Array(vec![V, 3, B], self.shapes.clone())))),
            ("bs_type", Py::Str("lrotmin".into())),
        ]))
    }

    /// As an `.npz` has it.
    pub(crate) fn arrays(&self) -> Arrays {
        let [k, v] = self.size();
        let mut out = Arrays::new()
            .with("v_template", &[v, 3], self.template.iter().flatten().copied().collect::<Vec<f64>>())
            .with("shapedirs", &[v, 3, B], self.shapes.clone())
            .with("posedirs", &[v, 3, 9 * (k - 1)], self.pose_shapes.clone())
            .with("J_regressor", &[k, v], self.regressor.clone())
            .with("weights", &[v, k], self.weights.clone())
            .with("kintree_table", &[2, k], self.kintree().into_iter().map(i64::from).collect::<Vec<i64>>())
            .with("f", &[v - 2, 3], self.faces.iter().map(|&i| i as i32).collect::<Vec<i32>>());
        if k == KX {
            let [left, right] = mean_hands();
            out = out.with("hands_meanl", &[45], left).with("hands_meanr", &[45], right);
        }
        out
    }

    /// As ARAH's folder has it.
    pub(crate) fn misc(&self, dir: &Path) {
        std::fs::create_dir_all(dir).expect("made");
        let a = self.arrays();
        for (file, key, name) in [
            ("skinning_weights_all", "weights", "neutral"),
            ("posedirs_all", "posedirs", "neutral"),
            ("J_regressors", "J_regressor", "neutral"),
            ("faces", "f", "faces"),
        ] {
            let mut out = Arrays::new();
            out.0.insert(name.into(), a.need(key).expect("there").clone());
            npz::write(&dir.join(format!("{file}.npz")), &out).expect("written");
        }
    }

    /// The person at rest.
    pub(crate) fn shaped(&self, betas: &[f64]) -> Vec<V3> {
        let at = |v: usize, c: usize| {
            (0..betas.len()).fold(self.template[v][c], |s, b| s + self.shapes[(3 * v + c) * B + b] * betas[b])
        };
        (0..self.template.len()).map(|v| [at(v, 0), at(v, 1), at(v, 2)]).collect()
    }

    /// Every joint rotates its subtree about its own position at rest, from the point upwards, without
    /// chained matrices.
    pub(crate) fn posed(&self, rest: &[V3], thetas: &[V3], place: &dyn Fn(V3) -> V3) -> Vec<V3> {
        self.posed_about(rest, rest, thetas, place)
    }

    /// Points at rest that turn about the joints of a body: clothes.
    pub(crate) fn posed_about(
        &self,
        body: &[V3],
        rest: &[V3],
        thetas: &[V3],
        place: &dyn Fn(V3) -> V3,
    ) -> Vec<V3> {
        let [count, points] = self.size();
        let joint = |k: usize| -> V3 {
            let row = &self.regressor[k * points..][..points];
            std::array::from_fn(|c| row.iter().zip(body).fold(0.0, |s, (r, x)| s + r * x[c]))
        };
        let joints: Vec<V3> = (0..count).map(joint).collect();
        let turned = |mut x: V3, mut k: usize| {
            loop {
                let j = joints[k];
                let y = rotated(thetas[k], std::array::from_fn(|c| x[c] - j[c]));
                x = std::array::from_fn(|c| y[c] + j[c]);
                if k == 0 {
                    return x;
                }
                k = self.parents[k];
            }
        };
        (0..points)
            .map(|v| {
                let mut x = rest[v];
                for k in 1..count {
                    for i in 0..9 {
                        let r = rotated(thetas[k], [0, 1, 2].map(|c| f64::from(u8::from(c == i % 3))))[i / 3];
                        let f = r - f64::from(u8::from(i % 4 == 0));
                        for c in 0..3 {
                            x[c] += self.pose_shapes[(3 * v + c) * 9 * (count - 1) + 9 * (k - 1) + i] * f;
                        }
                    }
                }
                let mut out = [0.0; 3];
                for k in 0..count {
                    let y = turned(x, k);
                    (0..3).for_each(|c| out[c] += self.weights[v * count + k] * y[c]);
                }
                place(out)
            })
            .collect()
    }
}

/// x turned about the axis of v by its length: Rodrigues' formula for vectors.
pub(crate) fn rotated(v: V3, x: V3) -> V3 {
    let angle = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    if angle == 0.0 {
        return x;
    }
    let k = v.map(|c| c / angle);
    let (s, c) = (libm::sin(angle), libm::cos(angle));
    let cross = [k[1] * x[2] - k[2] * x[1], k[2] * x[0] - k[0] * x[2], k[0] * x[1] - k[1] * x[0]];
    let dot = k[0] * x[0] + k[1] * x[1] + k[2] * x[2];
    std::array::from_fn(|i| x[i] * c + cross[i] * s + k[i] * dot * (1.0 - c))
}

/// The matrix of a rotation.
pub(crate) fn matrix(v: V3) -> M3 {
    let columns = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|e| rotated(v, e));
    std::array::from_fn(|i| std::array::from_fn(|j| columns[j][i]))
}

/// Rotations of the mean hands, 45 numbers each.
pub(crate) fn mean_hands() -> [Vec<f64>; 2] {
    [300, 400].map(|from| (0..45).map(|i| 0.4 * noise(from + i)).collect())
}

/// Axis-angles of moment t; the root's is `root`.
pub(crate) fn thetas(t: usize, root: V3) -> Vec<V3> {
    thetas_of(K, t, root)
}

/// The same of `joints`.
pub(crate) fn thetas_of(joints: usize, t: usize, root: V3) -> Vec<V3> {
    (0..joints)
        .map(|k| if k == 0 { root } else { [0, 1, 2].map(|c| 0.25 * noise(1000 * t + 3 * k + c)) })
        .collect()
}

/// Shape coefficients.
pub(crate) fn betas() -> Vec<f64> {
    (0..B).map(|b| noise(b + 5)).collect()
}

/// A camera as calibrations have it: x right, y down, z forward; OpenCV's pixel centres.
#[derive(Clone, Debug)]
pub(crate) struct Cam {
    pub(crate) k: M3,
    pub(crate) d: Vec<f64>,
    pub(crate) r: M3,
    pub(crate) t: V3,
}

impl Cam {
    /// `side` pixels, 3 m from the origin of a world whose up is `up` (+z or −y), turned about it by `angle`.
    pub(crate) fn around(side: usize, angle: f64, up_is_z: bool, d: &[f64]) -> Self {
        let turn =
            |x: V3| if up_is_z { rotated([0.0, 0.0, angle], x) } else { rotated([0.0, angle, 0.0], x) };
        // Rows of the rotation: the camera's axes in the world.
        let rows = if up_is_z {
            [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]
        } else {
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
        };
        let f = 1.1 * side as f64;
        let c = 0.5 * side as f64 - 0.5;
        Self {
            k: [[f, 0.0, c], [0.0, f, c + 0.25], [0.0, 0.0, 1.0]],
            d: d.to_vec(),
            r: rows.map(turn),
            t: [0.0, 0.0, 3.0],
        }
    }

    fn view(&self, x: V3) -> V3 {
        std::array::from_fn(|i| self.r[i][0] * x[0] + self.r[i][1] * x[1] + self.r[i][2] * x[2] + self.t[i])
    }

    /// Pixel of the ideal camera, pixel centres at halves.
    pub(crate) fn ideal(&self, x: V3) -> [f64; 2] {
        let v = self.view(x);
        [0, 1].map(|i| self.k[i][i] * v[i] / v[2] + self.k[i][2] + 0.5)
    }

    /// Pixel of the photo.
    pub(crate) fn distorted(&self, x: V3) -> [f64; 2] {
        let v = self.view(x);
        let (a, b) = (v[0] / v[2], v[1] / v[2]);
        let d = |i: usize| self.d.get(i).copied().unwrap_or(0.0);
        let r2 = a * a + b * b;
        let g = 1.0 + d(0) * r2 + d(1) * r2 * r2 + d(4) * r2 * r2 * r2;
        let p = [
            a * g + 2.0 * d(2) * a * b + d(3) * (r2 + 2.0 * a * a),
            b * g + d(2) * (r2 + 2.0 * b * b) + 2.0 * d(3) * a * b,
        ];
        [0, 1].map(|i| self.k[i][i] * p[i] + self.k[i][2] + 0.5)
    }

    /// A photo: the person in one colour on a colourful background; and its mask of 0 and 1.
    pub(crate) fn photograph(&self, side: usize, points: &[V3]) -> (Vec<u8>, Vec<u8>) {
        let at: Vec<[f64; 2]> = points.iter().map(|&x| self.distorted(x)).collect();
        let radius = 0.09 * side as f64;
        let (mut rgb, mut mask) = (Vec::new(), Vec::new());
        for i in 0..side * side {
            let p = [(i % side) as f64 + 0.5, (i / side) as f64 + 0.5];
            let on = at.iter().any(|q| {
                let d = [q[0] - p[0], q[1] - p[1]];
                d[0] * d[0] + d[1] * d[1] < radius * radius
            });
            mask.push(u8::from(on));
            rgb.extend(if on { PERSON } else { [10, 200, (i % 256) as u8] });
        }
        (rgb, mask)
    }
}

/// A small data set of the figure with its video, as `last gen` writes it.
pub(crate) fn figure_video(dir: &Path) {
    let settings = Settings {
        set: "video".into(),
        points: 256,
        frames: 4,
        test_cameras: 2,
        video_size: 48,
        samples: 2,
        mechanism: "LIN".into(),
        ..Settings::smoke()
    };
    generate::run(&settings, dir, false, &AtomicBool::new(false), &mut |_, _, _| {}).expect("a data set");
}

/// Colour of the person.
pub(crate) const PERSON: [u8; 3] = [200, 120, 60];

/// Writes an image; folders are made.
pub(crate) fn write_picture(path: &Path, side: usize, channels: usize, data: &[u8]) {
    std::fs::create_dir_all(path.parent().expect("in a folder")).expect("made");
    std::fs::write(path, image_file::png_bytes(side, side, channels, data).expect("sizes fit"))
        .expect("written");
}

/// The largest distance between points, relative to nothing.
pub(crate) fn apart(a: &[[f32; 3]], b: &[V3]) -> f64 {
    assert_eq!(a.len(), b.len(), "as many points");
    let of = |(x, y): (&[f32; 3], &V3)| (0..3).map(|c| (f64::from(x[c]) - y[c]).abs()).collect::<Vec<_>>();
    a.iter().zip(b).flat_map(of).fold(0.0, |m, d| if d > m { d } else { m })
}

/// Shots as (camera, number of the frame), sorted.
pub(crate) fn pairs(c: &PersonCapture, list: &[usize]) -> Vec<(usize, i64)> {
    let mut out: Vec<(usize, i64)> =
        list.iter().map(|&i| (c.shots[i].camera_id, c.numbers[c.shots[i].time])).collect();
    out.sort_unstable();
    out
}
