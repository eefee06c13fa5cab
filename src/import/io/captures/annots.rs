//! Common parts of ZJU-MoCap and MonoCap: cameras of `annots.npy`, body parameters in `params/N.npy`.

use super::source::{Moment, SourceShot, distortion, intrinsics, pose, three, triples};
use crate::io::capture::{Lens, Split};
use crate::io::pickle::{self, Value};
use crate::io::{name_of, npz};
use crate::num::array::Array;
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// A calibrated camera.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Calibrated {
    view_from_world: [[f64; 4]; 4],
    intrinsics: [f64; 4],
    lens: Lens,
}

impl Calibrated {
    /// One of its images.
    pub(super) fn shot(
        &self,
        time: usize,
        camera: usize,
        split: Split,
        image: PathBuf,
        mask: PathBuf,
    ) -> SourceShot {
        SourceShot {
            time,
            camera,
            split,
            view_from_world: self.view_from_world,
            intrinsics: self.intrinsics,
            lens: self.lens,
            image: super::pixels::Pixels::Picture(image),
            mask: super::pixels::Pixels::Picture(mask),
        }
    }
}

/// `annots.npy`: a dictionary in an array of objects.
pub(super) fn read(dir: &Path) -> Result<(Value, String)> {
    let path = dir.join("annots.npy");
    Ok((pickle::read_npy(&path)?, name_of(&path)))
}

/// The cameras: K, D, R, and T in millimetres.
pub(super) fn cameras(annots: &Value, name: &str) -> Result<Vec<Calibrated>> {
    let cams = annots.need("cams", name)?;
    let list = |key: &str| -> Result<Vec<Vec<f64>>> {
        let v = cams.need(key, name)?;
        let wrong = |got: String| {
            Error::input(name).at(format!("cams.{key}")).expected("one matrix per camera").got(got)
        };
        // A list of arrays, or one array for all.
        let rows: Vec<Array> = match (v, v.items()) {
            (_, Some(items)) => items
                .iter()
                .map(|m| m.to_array().ok_or_else(|| wrong(m.describe())))
                .collect::<Result<_>>()?,
            (Value::Array(a), _) if a.shape().len() > 1 => {
                let n = a.shape()[0];
                let each = a.len() / crate::num::order::max(n, 1);
                let flat = a.to_f64();
                flat.chunks(crate::num::order::max(each, 1))
                    .map(|c| Array::new(&[c.len()], c.to_vec()))
                    .collect()
            }
            (other, _) => return Err(wrong(other.describe())),
        };
        let rows: Vec<Vec<f64>> = rows.iter().map(Array::to_f64).collect();
        match rows.iter().flatten().find(|x| !x.is_finite()) {
            Some(x) => Err(wrong(x.to_string())),
            None => Ok(rows),
        }
    };
    let (k, d, r, t) = (list("K")?, list("D")?, list("R")?, list("T")?);
    if [d.len(), r.len(), t.len()] != [k.len(); 3] {
        return Err(Error::input(name).at("cams").expected("as many K, D, R and T").got(format!(
            "{}, {}, {}, {}",
            k.len(),
            d.len(),
            r.len(),
            t.len()
        )));
    }
    (0..k.len())
        .map(|c| {
            let at = format!("camera {c}");
            let metres: Vec<f64> = t[c].iter().map(|x| x / 1000.0).collect();
            Ok(Calibrated {
                view_from_world: pose(&r[c], &metres, name).map_err(|e| e.at(at.clone()))?,
                intrinsics: intrinsics(&k[c], name).map_err(|e| e.at(at.clone()))?,
                lens: distortion(&d[c], name).map_err(|e| e.at(at))?,
            })
        })
        .collect()
}

/// `params/N.npy`: poses (72), Rh, Th, shapes; the moment, and the shape.
pub(super) fn params(path: &Path) -> Result<(Moment, Vec<f64>)> {
    let name = name_of(path);
    let value = pickle::read_npy(path)?;
    let (_, poses) = value.numbers("poses", &name)?;
    if poses.is_empty() || !poses.len().is_multiple_of(3) {
        return Err(Error::input(name)
            .at("'poses'")
            .expected("three numbers per joint")
            .got(poses.len().to_string()));
    }
    let (_, rh) = value.numbers("Rh", &name)?;
    let (_, th) = value.numbers("Th", &name)?;
    let (_, shapes) = value.numbers("shapes", &name)?;
    let moment = Moment {
        rotations: triples(&poses),
        global_rotation: rotation(&rh, &name)?,
        global_translation: three(&th, "Th", &name)?,
        scale: 1.0,
        transforms: None,
    };
    Ok((moment, shapes))
}

/// An axis-angle; some releases hold a matrix.
fn rotation(values: &[f64], name: &str) -> Result<[f64; 3]> {
    if values.len() == 9 {
        return Err(Error::input(name).at("'Rh'").expected("an axis-angle of three numbers").got("a matrix"));
    }
    three(values, "Rh", name)
}

/// The points of the first moment, where the release has them beside the parameters.
pub(super) fn reference(dir: &Path, numbers: &[i64]) -> Option<(PathBuf, usize, Vec<[f64; 3]>)> {
    let number = numbers.first()?;
    let folders = ["new_vertices", "vertices", "smpl_vertices"];
    let path = folders.iter().map(|f| dir.join(f).join(format!("{number}.npy"))).find(|p| p.is_file())?;
    // Used only for a comparison: a file that is not an array of points is ignored.
    let a = npz::read(&path).ok()?.0.into_values().next()?;
    (a.shape().len() == 2 && a.shape()[1] == 3).then(|| (path, 0, triples(&a.to_f64())))
}
