//! Body models of the SMPL family: `.pkl` of SMPL (Python 2, chumpy, scipy), `.npz` of SMPL and SMPL-X, and
//! the folder `body_models/misc` of ARAH.
//!
//! | key | shape (SMPL) | holds |
//! |---|---|---|
//! | `v_template` | (6890, 3) | the mean body in its rest pose, metres, y up, facing +z |
//! | `shapedirs` | (6890, 3, 10 or 300) | how points move with shape (SMPL-X: 300 shape, then 100 expression) |
//! | `posedirs` | (6890, 3, 207) | how points move with the rotations of a pose; may be absent |
//! | `J_regressor` | (24, 6890), sparse or dense | joints from points |
//! | `weights` | (6890, 24) | skinning weights |
//! | `kintree_table` | (2, 24) | parents; the root's is 4294967295 or −1 |
//! | `f` | (13776, 3) | triangles |
//! | `hands_meanl`, `hands_meanr` | (45) | rotations of the last 30 joints in the mean hand (SMPL-H, SMPL-X) |
//!
//! The files are licensed to their users and are not part of this program. A pickle is read by
//! [`super::pickle`], which runs no code.

use super::{name_of, npz, pickle};
use crate::num::array::{Array, Arrays};
use crate::{Error, Result};
use std::path::Path;

/// Parents of SMPL's 24 joints, for files without them.
pub const SMPL_PARENTS: [i64; 24] =
    [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21];

/// Most points, joints and coefficients of a model.
const MAX_POINTS: usize = 1 << 20;
const MAX_JOINTS: usize = 256;
const MAX_SHAPES: usize = 1024;

/// A body model: V points, K joints, B coefficients; checked sizes, finite numbers, parents before children.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyModel {
    /// (V)
    pub template: Vec<[f64; 3]>,
    /// (V, 3, B) row-major
    pub shapes: Vec<f64>,
    /// B
    pub shape_count: usize,
    /// (V, 3, 9(K−1)) row-major
    pub pose_shapes: Option<Vec<f64>>,
    /// (K, V) row-major
    pub regressor: Vec<f64>,
    /// (V, K) row-major
    pub weights: Vec<f64>,
    /// (K)
    pub parents: Vec<Option<usize>>,
    /// (F)
    pub faces: Vec<[u32; 3]>,
    /// (30) axis-angles of the mean hands, left then right: the last joints
    pub mean_hands: Option<Vec<[f64; 3]>>,
}

impl BodyModel {
    /// Number of joints K.
    pub fn joints(&self) -> usize {
        self.parents.len()
    }
}

const KEYS: [&str; 9] = [
    "v_template",
    "shapedirs",
    "posedirs",
    "J_regressor",
    "weights",
    "kintree_table",
    "f",
    HANDS[0],
    HANDS[1],
];
const HANDS: [&str; 2] = ["hands_meanl", "hands_meanr"];
/// Joints of a hand.
const HAND: usize = 15;

/// Reads a model: `.pkl`, `.npz`, or a folder with ARAH's `skinning_weights_all.npz` and its neighbours (of
/// which `gender` chooses).
///
/// # Errors
/// When a file is malformed, a pickle names something outside the accepted list, an array is missing, or
/// shapes do not agree.
pub fn read(path: &Path, gender: &str) -> Result<BodyModel> {
    let name = name_of(path);
    if path.is_dir() {
        return read_folder(path, gender);
    }
    let arrays = match path.extension().and_then(|e| e.to_str()) {
        Some("npz") => npz::read_some(path, &KEYS)?,
        Some("pkl") => {
            let value = pickle::read(path)?;
            let mut arrays = Arrays::new();
            for key in KEYS {
                if let Some(v) = value.get(key) {
                    let a = v.to_array().ok_or_else(|| {
                        Error::input(name.clone())
                            .at(format!("key '{key}'"))
                            .expected("an array of numbers")
                            .got(v.describe())
                    })?;
                    arrays.0.insert(key.to_owned(), a);
                }
            }
            arrays
        }
        _ => {
            return Err(Error::input(name)
                .expected("a body model: .pkl, .npz, or ARAH's folder body_models/misc")
                .got("another file"));
        }
    };
    from_arrays(&arrays).map_err(|e| e.within(name))
}

/// ARAH's folder: one file per quantity, with an entry per gender.
fn read_folder(path: &Path, gender: &str) -> Result<BodyModel> {
    let mut arrays = Arrays::new();
    for (key, file, is_needed) in [
        ("v_template", "v_templates.npz", true),
        ("weights", "skinning_weights_all.npz", true),
        ("J_regressor", "J_regressors.npz", true),
        ("posedirs", "posedirs_all.npz", false),
        ("shapedirs", "shapedirs_all.npz", false),
        ("f", "faces.npz", false),
    ] {
        let file = path.join(file);
        if !file.is_file() {
            if is_needed && key != "v_template" {
                return Err(Error::input(name_of(&file))
                    .expected("ARAH's body model data")
                    .got("no such file"));
            }
            continue;
        }
        let found = npz::read_some(&file, &[if key == "f" { "faces" } else { gender }])?;
        if let Some((_, a)) = found.0.into_iter().next() {
            arrays.0.insert(key.to_owned(), a);
        } else if is_needed {
            return Err(Error::input(name_of(&file))
                .at(format!("array '{gender}'"))
                .expected("to be there")
                .got("none"));
        }
    }
    let points = arrays.get("weights").map_or(0, |w| w.shape().first().copied().unwrap_or(0));
    if arrays.get("v_template").is_none() {
        // Subjects of that layout contain their own points.
        arrays.put("v_template", &[points, 3], vec![0.0f32; 3 * points]);
    }
    // Stored flat by some versions.
    if let Some(a) = arrays.0.remove("posedirs") {
        let n = a.len() / (3 * crate::num::order::max(points, 1));
        let shaped = if a.len() == 3 * points * n { Array::new(&[points, 3, n], a.to_f64()) } else { a };
        arrays.0.insert("posedirs".to_owned(), shaped);
    }
    from_arrays(&arrays).map_err(|e| e.within(name_of(path)))
}

/// Checks the arrays of a model.
///
/// # Errors
/// When one is missing, or shapes do not agree.
pub fn from_arrays(arrays: &Arrays) -> Result<BodyModel> {
    arrays.finite(KEYS)?;
    let wrong = |key: &str, expected: String, got: String| {
        Error::input(format!("array '{key}'")).expected(expected).got(got)
    };
    let shaped = |key: &str, shape: &[usize]| -> Result<Vec<f64>> {
        let a = arrays.need(key)?;
        if a.shape() != shape {
            return Err(wrong(key, format!("shape {shape:?}"), format!("{:?}", a.shape())));
        }
        Ok(a.to_f64())
    };
    let [v, k] = match arrays.need("weights")?.shape() {
        &[v, k] if v > 0 && v <= MAX_POINTS && k > 0 && k <= MAX_JOINTS => [v, k],
        other => return Err(wrong("weights", "shape (V, K)".into(), format!("{other:?}"))),
    };
    let template: Vec<[f64; 3]> = shaped("v_template", &[v, 3])?.as_chunks::<3>().0.to_vec();
    let (shapes, shape_count) = match arrays.get("shapedirs") {
        None => (Vec::new(), 0),
        Some(a) => match a.shape() {
            &[av, 3, b] if av == v && b <= MAX_SHAPES => (a.to_f64(), b),
            other => return Err(wrong("shapedirs", format!("shape ({v}, 3, B)"), format!("{other:?}"))),
        },
    };
    let pose_shapes = match arrays.get("posedirs") {
        None => None,
        Some(_) => Some(shaped("posedirs", &[v, 3, 9 * (k - 1)])?),
    };
    let parents = match arrays.get("kintree_table") {
        Some(table) => {
            let values = table.to_i64().filter(|_| table.shape() == [2, k]);
            values.map(|t| t[..k].to_vec()).ok_or_else(|| {
                wrong("kintree_table", format!("integers of shape [2, {k}]"), format!("{:?}", table.shape()))
            })?
        }
        None if k == SMPL_PARENTS.len() => SMPL_PARENTS.to_vec(),
        None => return Err(wrong("kintree_table", "the parents of the joints".into(), "none".into())),
    };
    let parents = parents
        .iter()
        .enumerate()
        .map(|(i, &p)| match p {
            _ if i == 0 => Ok(None),
            p if p >= 0 && (p as usize) < i => Ok(Some(p as usize)),
            p => Err(wrong("kintree_table", format!("a parent of joint {i} before it"), p.to_string())),
        })
        .collect::<Result<_>>()?;
    let faces = match arrays.get("f") {
        None => Vec::new(),
        Some(f) => {
            let values = f.to_i64().filter(|x| x.iter().all(|&i| i >= 0 && i < v as i64));
            match (values, f.shape()) {
                (Some(x), [_, 3]) => x.as_chunks::<3>().0.iter().map(|t| t.map(|i| i as u32)).collect(),
                _ => return Err(wrong("f", format!("(F, 3) indices below {v}"), format!("{:?}", f.shape()))),
            }
        }
    };
    let mean_hands = match HANDS.map(|key| arrays.get(key)) {
        [Some(_), Some(_)] if k > 2 * HAND => {
            let flat = HANDS.map(|key| shaped(key, &[3 * HAND]));
            let [left, right] = flat;
            Some([left?, right?].concat().as_chunks::<3>().0.to_vec())
        }
        _ => None,
    };
    Ok(BodyModel {
        template,
        shapes,
        shape_count,
        pose_shapes,
        regressor: shaped("J_regressor", &[k, v])?,
        weights: shaped("weights", &[v, k])?,
        parents,
        faces,
        mean_hands,
    })
}
