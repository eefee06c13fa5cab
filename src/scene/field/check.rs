//! Checks of a field: sizes, heads that fit, finite numbers, settings in their ranges.

use super::{Field, Heads, Network, Panoramas, Placement, Planes, Settings};
use crate::{Error, Result};

/// Largest side of planes and panoramas, in texels.
const MAX_SIDE: usize = 4096;
/// Largest number of channels, and of units of a layer.
const MAX_WIDTH: usize = 2048;
/// Largest number of layers of a network.
const MAX_LAYERS: usize = 16;
/// Largest number of levels of panoramas.
const MAX_LEVELS: usize = 64;
/// Largest number of steps of a ray.
const MAX_SAMPLES: usize = 65_536;
/// Largest magnitude of a value or weight, half size, and of the placement.
pub const MAX_VALUE: f32 = 1e12;
/// Smallest and largest 1/β.
pub const INVERSE_BETA: [f32; 2] = [1e-6, 1e6];

/// A number for a message, with an exponent if it would be long.
fn text(x: f64) -> String {
    if x != 0.0 && !(1e-4..1e9).contains(&x.abs()) { format!("{x:e}") } else { x.to_string() }
}

/// Refuses a number outside a range; NaN is outside.
fn within(what: &str, x: f64, range: std::ops::RangeInclusive<f64>) -> Result<()> {
    if range.contains(&x) {
        return Ok(());
    }
    let e = Error::input(what).expected(format!("{} to {}", text(*range.start()), text(*range.end())));
    Err(e.got(text(x)))
}

/// Refuses a size outside a range.
fn sized(what: &str, n: usize, range: std::ops::RangeInclusive<usize>) -> Result<()> {
    within(what, n as f64, *range.start() as f64..=*range.end() as f64)
}

/// Refuses an array of another length, or with a number that is not finite.
fn values(what: &str, shape: &[usize], x: &[f32]) -> Result<()> {
    let expected = shape.iter().try_fold(1_usize, |n, k| n.checked_mul(*k));
    if expected != Some(x.len()) {
        let e = Error::input(what).expected(format!("values of the shape {shape:?}"));
        return Err(e.got(format!("{} values", x.len())));
    }
    // Phrased so that NaN fails.
    let Some(i) = x.iter().position(|v| !(v.abs() <= MAX_VALUE)) else { return Ok(()) };
    let mut rest = i;
    let mut index = vec![0; shape.len()];
    for (slot, size) in index.iter_mut().zip(shape).rev() {
        (*slot, rest) = (rest % size, rest / size);
    }
    let e = Error::input(what).at(format!("index {index:?}"));
    Err(e.expected(format!("a finite number up to {MAX_VALUE:e}")).got(x[i].to_string()))
}

impl Planes {
    fn validate(&self) -> Result<()> {
        if self.count != 3 && self.count != 6 {
            let e = Error::input("planes").expected("three or six planes");
            return Err(e.got(self.count.to_string()));
        }
        sized("planes: side", self.side, 2..=MAX_SIDE)?;
        sized("planes: channels", self.channels, 1..=MAX_WIDTH / 3)?;
        values("planes", &self.shape(), &self.values)
    }
}

impl Panoramas {
    fn validate(&self) -> Result<()> {
        sized("panoramas: levels", self.levels, 1..=MAX_LEVELS)?;
        sized("panoramas: height", self.height, 2..=MAX_SIDE)?;
        sized("panoramas: width", self.width, 2..=MAX_SIDE)?;
        sized("panoramas: channels", self.channels, 1..=MAX_WIDTH / 3)?;
        values("panoramas", &self.shape(), &self.values)
    }
}

impl Network {
    fn validate(&self, name: &str, inputs: usize, outputs: &[usize]) -> Result<()> {
        let what = format!("head '{name}'");
        if self.widths.len() != self.weights.len() + 1 {
            let e = Error::input(what).expected("a width before and after each layer");
            return Err(e.got(format!("{} widths, {} layers", self.widths.len(), self.weights.len())));
        }
        sized(&format!("{what}: layers"), self.weights.len(), 1..=MAX_LAYERS)?;
        for width in &self.widths {
            sized(&format!("{what}: units"), *width, 1..=MAX_WIDTH)?;
        }
        if self.inputs() != inputs {
            let e = Error::input(what).expected(format!("{inputs} inputs"));
            return Err(e.got(self.inputs().to_string()));
        }
        if !outputs.contains(&self.outputs()) {
            let all: Vec<String> = outputs.iter().map(usize::to_string).collect();
            let e = Error::input(what).expected(format!("{} outputs", all.join(" or ")));
            return Err(e.got(self.outputs().to_string()));
        }
        for (i, (shape, weights)) in self.layers().enumerate() {
            values(&format!("{what}, layer {i}"), &shape, weights)?;
        }
        Ok(())
    }
}

impl Settings {
    /// Checks ranges.
    ///
    /// # Errors
    /// Names the setting.
    pub fn validate(&self) -> Result<()> {
        let positive = f64::from(f32::MIN_POSITIVE)..=f64::from(MAX_VALUE);
        within("setting 'half_size'", f64::from(self.half_size), positive.clone())?;
        within("setting 'samples'", self.samples as f64, 1.0..=MAX_SAMPLES as f64)?;
        let [least, most] = INVERSE_BETA.map(f64::from);
        within("setting 'inverse_beta'", f64::from(self.inverse_beta), least..=most)?;
        for (name, number) in [("early_stop", self.early_stop), ("least_weight", self.least_weight)] {
            if let Some(number) = number {
                within(&format!("setting '{name}'"), f64::from(number), 0.0..=1.0)?;
            }
        }
        within("setting 'epsilon'", f64::from(self.epsilon), positive)?;
        within("setting 'background'", f64::from(self.background), 0.0..=1.0)
    }
}

impl Heads {
    fn validate(&self, features: usize, embedding: Option<usize>) -> Result<()> {
        self.sdf.validate("sdf", features, &[1, 4])?;
        if self.is_trunk() && (self.color.is_some() || embedding.is_some()) {
            let e = Error::input("head 'sdf'").expected("1 output beside a head 'color' or panoramas");
            return Err(e.got("4 outputs, which are a signed distance and a colour"));
        }
        if embedding.is_some() && (self.color.is_none() || self.normal.is_none() || self.rho.is_none()) {
            let e = Error::input("panoramas").expected("heads 'color', 'normal' and 'rho'");
            return Err(e.got("not all of them"));
        }
        if embedding.is_none() && self.rho.is_some() {
            return Err(Error::input("head 'rho'")
                .expected("panoramas, which it selects a level of")
                .got("none"));
        }
        let mut color = features + embedding.unwrap_or(0);
        // Behind the features of the embedding there may be the cosine of the reflection.
        if embedding.is_some() && self.color.as_ref().is_some_and(|n| n.widths.first() == Some(&(color + 1)))
        {
            color += 1;
        }
        for (name, network, inputs, outputs) in [
            ("color", &self.color, color, 3),
            ("albedo", &self.albedo, features, 3),
            ("material", &self.material, features, 2),
            ("normal", &self.normal, features, 3),
            ("rho", &self.rho, features, 1),
        ] {
            network.iter().try_for_each(|network| network.validate(name, inputs, &[outputs]))?;
        }
        Ok(())
    }
}

impl Placement {
    /// Checks ranges, and that the rotation is one: orthonormal rows, the third the cross product of the
    /// others, to 10⁻⁶.
    ///
    /// # Errors
    /// Names the number.
    pub fn validate(&self) -> Result<()> {
        let [most, least] = [f64::from(MAX_VALUE), f64::from(f32::MIN_POSITIVE)];
        self.center.iter().try_for_each(|x| within("placement: centre", *x, -most..=most))?;
        within("placement: scale", self.scale, least..=most)?;
        let q = &self.rotation;
        let dot = |a: usize, b: usize| (q[a][0] * q[b][0] + q[a][1] * q[b][1]) + q[a][2] * q[b][2];
        for (a, b) in [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0)] {
            let off = dot(a, b) - f64::from(u8::from(a == b));
            within(
                "placement: rows of the rotation, products of two minus those of unit vectors",
                off,
                -1e-6..=1e-6,
            )?;
        }
        let [x, y, z] = q;
        let cross = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
        for (z, cross) in z.iter().zip(cross) {
            let what = "placement: third row of the rotation, minus the cross product of the others";
            within(what, z - cross, -1e-6..=1e-6)?;
        }
        Ok(())
    }
}

impl Field {
    /// Checks sizes, numbers and settings, and that the heads fit the planes and panoramas.
    ///
    /// # Errors
    /// Names the array, head or setting.
    pub fn validate(&self) -> Result<()> {
        self.settings.validate()?;
        self.planes.validate()?;
        self.panoramas.iter().try_for_each(Panoramas::validate)?;
        let features = self.planes.features(self.settings.combine);
        self.heads.validate(features, self.panoramas.as_ref().map(|p| p.channels))?;
        self.placement.validate()
    }
}
