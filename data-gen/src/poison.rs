//! Numerically critical values, inserted one at a time into otherwise valid arrays.

/// A numerically critical value.
#[derive(Clone, Copy, Debug)]
pub struct Poison {
    /// Description of the value.
    pub name: &'static str,
    /// The value; every finite one except the last two is also a single-precision number or rounds to one.
    pub value: f64,
}

const fn poison(name: &'static str, value: f64) -> Poison {
    Poison { name, value }
}

/// The table: NaN and infinities, ends of the ranges, denormals, zeros of both signs, thresholds of
/// splatting.
pub const TABLE: &[Poison] = &[
    poison("NaN", f64::NAN),
    poison("+infinity", f64::INFINITY),
    poison("-infinity", f64::NEG_INFINITY),
    poison("+0", 0.0),
    poison("-0", -0.0),
    poison("smallest single denormal", f32::from_bits(1) as f64),
    poison("minus the smallest single denormal", -(f32::from_bits(1) as f64)),
    poison("largest single denormal", f32::from_bits(0x007f_ffff) as f64),
    poison("smallest single normal", f32::MIN_POSITIVE as f64),
    poison("1e-20", 1e-20),
    poison("-1e-20", -1e-20),
    poison("1e-10", 1e-10),
    poison("single epsilon", f32::EPSILON as f64),
    poison("0.005, floor of the compensation", 0.005),
    poison("1/255", 1.0 / 255.0),
    poison("just below 1/255", 1.0 / 255.0 - 1e-9),
    poison("0.01, near plane", 0.01),
    poison("0.99, cap of alpha", 0.99),
    poison("just below 1", 1.0 - f32::EPSILON as f64 / 2.0),
    poison("1", 1.0),
    poison("-1", -1.0),
    poison("16, side of a tile", 16.0),
    poison("88.8, exp leaves single range", 88.8),
    poison("-104, exp reaches single zero", -104.0),
    poison("2^24 + 1, no single number", 16_777_217.0),
    poison("1e10, far plane", 1e10),
    poison("2^31", 2_147_483_648.0),
    poison("1e20", 1e20),
    poison("-1e20", -1e20),
    poison("largest single", f32::MAX as f64),
    poison("minus the largest single", f32::MIN as f64),
    poison("smallest double denormal", f64::from_bits(1)),
    poison("largest double", f64::MAX),
];

/// A copy of an array with one entry replaced.
#[derive(Clone, Debug)]
pub struct Poisoned {
    /// The value that was inserted.
    pub poison: Poison,
    /// Index of the replaced entry.
    pub index: usize,
    /// All entries of the array.
    pub entries: Vec<f64>,
}

/// Every value of the table at every given index of an array, with indices in the outer loop.
///
/// ```
/// let copies: Vec<_> = data_gen::poison::copies(&[1.0, 2.0], &[1]).collect();
/// assert_eq!(copies.len(), data_gen::poison::TABLE.len());
/// assert!(copies[0].entries[0] == 1.0 && copies[0].entries[1].is_nan());
/// ```
///
/// # Panics
/// If an index is outside the array.
pub fn copies<'a>(of: &'a [f64], places: &'a [usize]) -> impl Iterator<Item = Poisoned> + 'a {
    places.iter().flat_map(move |&index| {
        TABLE.iter().map(move |&poison| {
            let mut entries = of.to_vec();
            entries[index] = poison.value;
            Poisoned { poison, index, entries }
        })
    })
}
