//! A set of 3-D Gaussians as it is stored: unconstrained parameters, as in every 3DGS file.
//!
//! Conversions to and from the records of `io` and the named arrays of the operators. Activations
//! (scale = e^s, opacity = 1/(1+e^−l)) and their inverses are taken in f64 with `libm` and rounded once.

use crate::io::gaussian_ply::{GaussianRecord, SH_C0};
use crate::io::splat_file::{self, Splat};
use crate::num::array::Arrays;
use crate::num::order;
use crate::{Error, Result};
use std::collections::BTreeMap;

/// Largest magnitude of a logarithmic scale: its square and the square of e^40 are far inside single
/// precision.
pub const MAX_SCALE_LOG: f32 = 40.0;
/// Largest magnitude of a coordinate, a logit or a coefficient.
pub const MAX_VALUE: f32 = 1e12;
/// Smallest length of a quaternion; below it is zero. The largest is one over it.
pub const MIN_QUAT: f64 = 1e-12;
/// Largest opacity that has a logit in single precision, 1 − 2⁻²⁴; the smallest is 2⁻²⁴.
const MAX_OPACITY: f64 = 1.0 - 1.0 / 16_777_216.0;

/// Stored parameters of N Gaussians.
///
/// | field | shape | meaning |
/// |---|---|---|
/// | `means` | (N, 3) | centre, scene units |
/// | `quats` | (N, 4) | w, x, y, z; any length but zero |
/// | `scales_log` | (N, 3) | natural logarithm of the standard deviations |
/// | `opacity_logits` | (N) | logit of the opacity |
/// | `sh` | (N, K, 3) | spherical-harmonics coefficients of the sRGB-encoded colour, K = (degree+1)² |
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gaussians {
    /// (N, 3)
    pub means: Vec<[f32; 3]>,
    /// (N, 4) wxyz
    pub quats: Vec<[f32; 4]>,
    /// (N, 3)
    pub scales_log: Vec<[f32; 3]>,
    /// (N)
    pub opacity_logits: Vec<f32>,
    /// (N, K, 3) row-major
    pub sh: Vec<f32>,
    /// 0 to 3
    pub sh_degree: usize,
}

impl Gaussians {
    /// N.
    pub fn len(&self) -> usize {
        self.means.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.means.is_empty()
    }

    /// K = (degree+1)², coefficients per channel.
    pub fn sh_coefficients(&self) -> usize {
        (self.sh_degree + 1) * (self.sh_degree + 1)
    }

    /// Checks lengths, finite values within [`MAX_VALUE`], quaternions of positive length and scales that
    /// single precision can square. `name` is the file or the source of the scene.
    ///
    /// # Errors
    /// Names the row and the parameter.
    pub fn validate(&self, name: &str) -> Result<()> {
        let n = self.len();
        if self.sh_degree > 3 {
            let e = Error::input(name).at("spherical harmonics");
            return Err(e.expected("degree 0 to 3").got(self.sh_degree.to_string()));
        }
        let k = self.sh_coefficients();
        for (field, len, expected) in [
            ("quaternions", self.quats.len(), n),
            ("scales", self.scales_log.len(), n),
            ("opacities", self.opacity_logits.len(), n),
            ("spherical harmonics", self.sh.len(), 3 * k * n),
        ] {
            if len != expected {
                let e = Error::input(name).at(field);
                return Err(e.expected(format!("{expected} values for {n} Gaussians")).got(len.to_string()));
            }
        }
        match (0..n).find_map(|i| self.fault(i).map(|fault| (i, fault))) {
            None => Ok(()),
            Some((row, Fault { field, expected, got })) => {
                Err(Error::input(name).at(format!("Gaussian {row}, {field}")).expected(expected).got(got))
            }
        }
    }

    /// The first parameter of a Gaussian that is out of range; the columns have one row per Gaussian.
    fn fault(&self, i: usize) -> Option<Fault> {
        // Phrased so that NaN fails.
        let held = |x: &f32| x.abs() <= MAX_VALUE;
        let finite = || format!("finite numbers up to {MAX_VALUE:e}");
        let fault = |field, expected, got| Some(Fault { field, expected, got });
        if !self.means[i].iter().all(held) {
            return fault("mean", finite(), format!("{:?}", self.means[i]));
        }
        if !(MIN_QUAT..=1.0 / MIN_QUAT).contains(&quat_norm(&self.quats[i])) {
            let expected = format!("a length from {MIN_QUAT:e} to {:e}", 1.0 / MIN_QUAT);
            return fault("quaternion", expected, format!("{:?}", self.quats[i]));
        }
        if !self.scales_log[i].iter().all(|x| x.abs() <= MAX_SCALE_LOG) {
            let expected = format!("logarithms from -{MAX_SCALE_LOG} to {MAX_SCALE_LOG}");
            return fault("scale", expected, format!("{:?}", self.scales_log[i]));
        }
        if !held(&self.opacity_logits[i]) {
            return fault("opacity logit", finite(), self.opacity_logits[i].to_string());
        }
        let width = 3 * self.sh_coefficients();
        let bad = self.sh[i * width..(i + 1) * width].iter().find(|x| !held(x))?;
        fault("spherical harmonics", finite(), bad.to_string())
    }

    /// Removes the Gaussians that [`Self::validate`] refuses, such as those with a zero quaternion or NaN; returns how many.
    ///
    /// # Panics
    /// When the columns have different numbers of rows.
    pub fn drop_invalid(&mut self) -> usize {
        let keep: Vec<bool> = (0..self.len()).map(|i| self.fault(i).is_none()).collect();
        self.keep_rows(&keep);
        keep.iter().filter(|k| !**k).count()
    }

    /// From the record of a PLY file; `name` is the file name in errors.
    ///
    /// # Errors
    /// See [`Self::validate`].
    pub fn from_record(r: GaussianRecord, name: &str) -> Result<Self> {
        let g = Self::from_record_unchecked(r);
        g.validate(name)?;
        Ok(g)
    }

    /// Like [`Self::from_record`], but not validated.
    pub fn from_record_unchecked(r: GaussianRecord) -> Self {
        let GaussianRecord { means, quats, scales_log, opacity_logits, sh, sh_degree, comments: _ } = r;
        Self { means, quats, scales_log, opacity_logits, sh, sh_degree }
    }

    /// The record of a PLY file with the given comment lines.
    pub fn to_record(&self, comments: &[String]) -> GaussianRecord {
        GaussianRecord {
            means: self.means.clone(),
            quats: self.quats.clone(),
            scales_log: self.scales_log.clone(),
            opacity_logits: self.opacity_logits.clone(),
            sh: self.sh.clone(),
            sh_degree: self.sh_degree,
            comments: comments.to_vec(),
        }
    }

    /// From the rows of a `.splat` file (degree 0).
    ///
    /// # Errors
    /// See [`Self::validate`].
    pub fn from_splats(splats: &[Splat], name: &str) -> Result<Self> {
        Self::from_record(splat_file::to_gaussians(splats), name)
    }

    /// The rows of a `.splat` file: quantised, sorted, degree 0 of the spherical harmonics only.
    ///
    /// # Errors
    /// When a value leaves the range of the format.
    pub fn to_splats(&self, name: &str) -> Result<Vec<Splat>> {
        splat_file::from_gaussians(&self.to_record(&[]), name)
    }

    /// From the arguments of `splat.render`: `means`, `quats`, `scales` (linear), `opacities` (0..1), and
    /// `sh` or `rgb`. Other names are ignored. Opacities 0 and 1 have no logit and become 2⁻²⁴ and 1 − 2⁻²⁴.
    ///
    /// # Errors
    /// When an array is missing, has another shape, or holds a value out of range.
    pub fn from_arrays(a: &Arrays, name: &str) -> Result<Self> {
        Self::from_arrays_unnamed(a, true)
            .and_then(|g| g.validate(name).map(|()| g))
            .map_err(|e| if e.to_string().starts_with(name) { e } else { e.within(name) })
    }

    /// Like [`Self::from_arrays`], but values may be any numbers; not validated.
    ///
    /// # Errors
    /// When an array is missing or has another shape.
    pub fn from_arrays_unchecked(a: &Arrays, name: &str) -> Result<Self> {
        Self::from_arrays_unnamed(a, false).map_err(|e| e.within(name))
    }

    fn from_arrays_unnamed(a: &Arrays, is_checked: bool) -> Result<Self> {
        let mut dims = BTreeMap::new();
        if is_checked {
            a.finite(["means", "quats", "scales", "opacities", "sh", "rgb"])?;
        }
        let means = rows(&a.shape("means", "N,3", &mut dims)?.to_f32());
        let quats = rows(&a.shape("quats", "N,4", &mut dims)?.to_f32());
        let scales: Vec<[f64; 3]> = rows(&a.shape("scales", "N,3", &mut dims)?.to_f64());
        let opacities = a.shape("opacities", "N", &mut dims)?.to_f64();
        let (sh, k) = if a.get("sh").is_some() {
            (a.shape("sh", "N,K,3", &mut dims)?.to_f32(), dims[&'K'])
        } else {
            let rgb = a
                .shape("rgb", "N,3", &mut dims)
                .map_err(|e| e.hint("colours are 'sh' (N,K,3) or 'rgb' (N,3)"))?;
            (rgb.to_f64().iter().map(|c| ((c - 0.5) / SH_C0) as f32).collect(), 1)
        };
        let Some(sh_degree) = (0..4).find(|d| (d + 1) * (d + 1) == k) else {
            return Err(Error::input("array 'sh'").expected("1, 4, 9 or 16 coefficients").got(k.to_string()));
        };
        let bad_scale = scales.iter().enumerate().find(|(_, s)| !s.iter().all(|x| *x > 0.0));
        if let (true, Some((i, s))) = (is_checked, bad_scale) {
            return Err(Error::input("array 'scales'")
                .at(format!("row {i}"))
                .expected("positive numbers")
                .got(format!("{s:?}")));
        }
        let bad_opacity = opacities.iter().enumerate().find(|(_, o)| !(0.0..=1.0).contains(*o));
        if let (true, Some((i, o))) = (is_checked, bad_opacity) {
            return Err(Error::input("array 'opacities'")
                .at(format!("row {i}"))
                .expected("a number from 0 to 1")
                .got(o.to_string()));
        }
        let scales_log = scales.iter().map(|s| s.map(|x| libm::log(x) as f32)).collect();
        let logit = |o: f64| {
            if !(0.0..=1.0).contains(&o) {
                return f32::NAN;
            }
            let o = order::clamp(o, 1.0 - MAX_OPACITY, MAX_OPACITY);
            libm::log(o / (1.0 - o)) as f32
        };
        let opacity_logits = opacities.into_iter().map(logit).collect();
        Ok(Self { means, quats, scales_log, opacity_logits, sh, sh_degree })
    }

    /// The arguments of `splat.render` that describe the Gaussians, with activated scales and opacities, and
    /// `sh_degree`.
    pub fn to_arrays(&self) -> Arrays {
        let n = self.len();
        let exp = |x: &f32| libm::exp(f64::from(*x)) as f32;
        let sigmoid = |x: &f32| (1.0 / (1.0 + libm::exp(-f64::from(*x)))) as f32;
        Arrays::new()
            .with("means", &[n, 3], self.means.as_flattened().to_vec())
            .with("quats", &[n, 4], self.quats.as_flattened().to_vec())
            .with("scales", &[n, 3], self.scales_log.as_flattened().iter().map(exp).collect())
            .with("opacities", &[n], self.opacity_logits.iter().map(sigmoid).collect())
            .with("sh", &[n, self.sh_coefficients(), 3], self.sh.clone())
            .with("sh_degree", &[], vec![self.sh_degree as i64])
    }
}

/// A parameter out of range.
struct Fault {
    field: &'static str,
    expected: String,
    got: String,
}

fn quat_norm(q: &[f32; 4]) -> f64 {
    let [w, x, y, z] = q.map(f64::from);
    (w * w + x * x + y * y + z * z).sqrt()
}

fn rows<T: Copy + Default, const K: usize>(flat: &[T]) -> Vec<[T; K]> {
    let mut out = vec![[T::default(); K]; flat.len() / K];
    out.as_flattened_mut().copy_from_slice(flat);
    out
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Two Gaussians of degree 1.
    pub(crate) fn scene() -> Gaussians {
        Gaussians {
            means: vec![[0.0, 1.0, 2.0], [3.0, 4.0, 5.0]],
            quats: vec![[1.0, 0.0, 0.0, 0.0], [0.1, -0.2, 0.3, 2.0]],
            scales_log: vec![[-4.0, -3.0, -5.0], [0.0, 1.0, 2.0]],
            opacity_logits: vec![-1.0, 3.0],
            sh: (0..24).map(|i| i as f32 / 8.0 - 1.0).collect(),
            sh_degree: 1,
        }
    }

    #[test]
    fn bad_scenes_are_refused_with_row_and_field() {
        scene().validate("a.ply").expect("a good scene");
        type Spoil = fn(&mut Gaussians);
        let cases: [(Spoil, &str); 8] = [
            (|g| g.quats[1] = [0.0; 4], "Gaussian 1, quaternion"),
            (|g| g.quats[0] = [1e-30, 0.0, 0.0, 0.0], "Gaussian 0, quaternion"),
            (|g| g.means[1][2] = f32::NAN, "Gaussian 1, mean"),
            (|g| g.scales_log[0][1] = 90.0, "Gaussian 0, scale"),
            (|g| g.opacity_logits[1] = f32::INFINITY, "Gaussian 1, opacity"),
            (|g| g.sh[23] = f32::NAN, "Gaussian 1, spherical"),
            (|g| g.opacity_logits.truncate(1), "opacities"),
            (|g| g.sh_degree = 4, "degree"),
        ];
        for (spoil, place) in cases {
            let mut g = scene();
            spoil(&mut g);
            let e = g.validate("a.ply").expect_err(place).to_string();
            assert!(e.starts_with("a.ply: ") && e.contains(place), "{e}");
        }
    }

    #[test]
    fn arrays_hold_activated_values() {
        let g = scene();
        let a = g.to_arrays();
        assert_eq!(a.need("scales").expect("there").to_f32()[3], 1.0, "e^0");
        let back = Gaussians::from_arrays(&a, "a.npz").expect("our own arrays");
        assert_eq!((&back.means, &back.quats, &back.sh), (&g.means, &g.quats, &g.sh), "stored as they are");
        for (x, y) in back.scales_log.as_flattened().iter().zip(g.scales_log.as_flattened()) {
            assert!((x - y).abs() <= 2e-7 * (1.0 + y.abs()), "{x} {y}");
        }
        for (x, y) in back.opacity_logits.iter().zip(&g.opacity_logits) {
            assert!((x - y).abs() < 2e-6, "{x} {y}");
        }
        let opaque = a.clone().with("opacities", &[2], vec![0.0f32, 1.0]);
        let g = Gaussians::from_arrays(&opaque, "a.npz").expect("0 and 1 are opacities");
        assert_eq!(g.opacity_logits[0], -g.opacity_logits[1], "limits are symmetric");
        let e = Gaussians::from_arrays(&a.with("opacities", &[2], vec![0.5f32, 1.5]), "a.npz")
            .expect_err("above 1");
        assert!(e.to_string().starts_with("a.npz: array 'opacities': row 1"), "{e}");
    }
}
