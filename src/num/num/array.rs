//! Named arrays of the element types that the library's interfaces accept.
//!
//! [`Arrays`] represents the contents of `.npz` and `.safetensors` files, the inputs and outputs of operators
//! in `ops`, and the plan of a renderer. Kernels work on slices instead: `&[[f32; 3]]` is an (N, 3) array.

use crate::{Error, Result};
use ndarray::{ArrayD, IxDyn};
use std::collections::BTreeMap;

/// One row-major array with its element type.
#[derive(Clone, Debug, PartialEq)]
pub enum Array {
    /// Single precision.
    F32(ArrayD<f32>),
    /// Double precision.
    F64(ArrayD<f64>),
    /// Unsigned bytes, used for masks.
    U8(ArrayD<u8>),
    /// Signed bytes, used for the signs of clamped values.
    I8(ArrayD<i8>),
    /// 32-bit integers, used for indices.
    I32(ArrayD<i32>),
    /// 64-bit integers, used for offsets.
    I64(ArrayD<i64>),
}

/// Evaluates one expression with the inner array, whatever its element type.
#[macro_export]
macro_rules! with_array {
    ($array:expr, $a:ident => $body:expr) => {
        match $array {
            $crate::num::array::Array::F32($a) => $body,
            $crate::num::array::Array::F64($a) => $body,
            $crate::num::array::Array::U8($a) => $body,
            $crate::num::array::Array::I8($a) => $body,
            $crate::num::array::Array::I32($a) => $body,
            $crate::num::array::Array::I64($a) => $body,
        }
    };
}

/// Element types of [`Array`]; the trait lets [`Arrays::put`] accept vectors of any of them.
pub trait Element: Clone + Copy {
    /// Wraps an array of this element.
    fn wrap(a: ArrayD<Self>) -> Array
    where
        Self: Sized;
}
macro_rules! element {
    ($($t:ty => $v:ident),*) => { $(impl Element for $t {
        fn wrap(a: ArrayD<Self>) -> Array { Array::$v(a) }
    })* };
}
element!(f32 => F32, f64 => F64, u8 => U8, i8 => I8, i32 => I32, i64 => I64);

impl Array {
    /// Builds an array from row-major values.
    pub fn new<T: Element>(shape: &[usize], values: Vec<T>) -> Self {
        let a = ArrayD::from_shape_vec(IxDyn(shape), values)
            .expect("the number of values must be the product of the shape");
        T::wrap(a)
    }

    /// Like [`Self::new`] for a shape from an external source; returns `None` if the shape does not match the
    /// number of values or cannot be indexed.
    pub fn of_shape<T: Element>(shape: &[usize], values: Vec<T>) -> Option<Self> {
        ArrayD::from_shape_vec(IxDyn(shape), values).ok().map(T::wrap)
    }

    /// Returns the shape, which is `[]` for a 0-d array.
    pub fn shape(&self) -> &[usize] {
        with_array!(self, a => a.shape())
    }

    /// Number of elements.
    pub fn len(&self) -> usize {
        with_array!(self, a => a.len())
    }

    /// Whether there are no elements.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the name of the element type as in NumPy.
    pub fn dtype(&self) -> &'static str {
        match self {
            Self::F32(_) => "float32",
            Self::F64(_) => "float64",
            Self::U8(_) => "uint8",
            Self::I8(_) => "int8",
            Self::I32(_) => "int32",
            Self::I64(_) => "int64",
        }
    }

    /// Whether the elements are floating-point numbers.
    pub fn is_float(&self) -> bool {
        matches!(self, Self::F32(_) | Self::F64(_))
    }

    /// Returns the elements in row-major order as f64; the conversion is exact except for i64 beyond 2⁵³.
    pub fn to_f64(&self) -> Vec<f64> {
        match self {
            Self::F32(a) => a.iter().map(|&x| f64::from(x)).collect(),
            Self::F64(a) => a.iter().copied().collect(),
            Self::U8(a) => a.iter().map(|&x| f64::from(x)).collect(),
            Self::I8(a) => a.iter().map(|&x| f64::from(x)).collect(),
            Self::I32(a) => a.iter().map(|&x| f64::from(x)).collect(),
            Self::I64(a) => a.iter().map(|&x| x as f64).collect(),
        }
    }

    /// Returns the elements in row-major order, rounded to f32.
    pub fn to_f32(&self) -> Vec<f32> {
        match self {
            Self::F32(a) => a.iter().copied().collect(),
            other => other.to_f64().into_iter().map(|x| x as f32).collect(),
        }
    }

    /// Returns the elements in row-major order as i64, or `None` if a floating-point element is not integral.
    pub fn to_i64(&self) -> Option<Vec<i64>> {
        match self {
            Self::I64(a) => Some(a.iter().copied().collect()),
            Self::F32(_) | Self::F64(_) => self
                .to_f64()
                .into_iter()
                .map(|x| (x.trunc() == x && x.abs() <= 9.0e15).then_some(x as i64))
                .collect(),
            other => Some(other.to_f64().into_iter().map(|x| x as i64).collect()),
        }
    }
}

/// A set of named arrays, sorted by name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Arrays(pub BTreeMap<String, Array>);

impl Arrays {
    /// Returns an empty set.
    pub fn new() -> Self {
        Self::default()
    }

    /// Stores row-major values under a name.
    pub fn put<T: Element>(&mut self, name: &str, shape: &[usize], values: Vec<T>) {
        self.0.insert(name.to_owned(), Array::new(shape, values));
    }

    /// Like [`Self::put`], but returns the set (builder form).
    #[must_use]
    pub fn with<T: Element>(mut self, name: &str, shape: &[usize], values: Vec<T>) -> Self {
        self.put(name, shape, values);
        self
    }

    /// Returns the array with this name, if it exists.
    pub fn get(&self, name: &str) -> Option<&Array> {
        self.0.get(name)
    }

    /// Returns the array with this name.
    ///
    /// # Errors
    /// Returns an error if the array is missing; the error lists the names of the existing arrays.
    pub fn need(&self, name: &str) -> Result<&Array> {
        self.get(name).ok_or_else(|| {
            let have: Vec<_> = self.0.keys().map(String::as_str).collect();
            Error::input(format!("array '{name}'"))
                .expected("to be present")
                .got(format!("only [{}]", have.join(", ")))
        })
    }

    /// Checks the shape of an array against a pattern such as `"N,K,3"`; equal letters must have equal sizes
    /// across calls.
    ///
    /// # Errors
    /// Returns an error if the rank, a fixed size or the size of an already bound letter differs.
    pub fn shape(&self, name: &str, pattern: &str, dims: &mut BTreeMap<char, usize>) -> Result<&Array> {
        let array = self.need(name)?;
        let got = array.shape();
        let wrong = |dims: &BTreeMap<char, usize>| {
            let bound: Vec<_> = dims.iter().map(|(k, v)| format!("{k}={v}")).collect();
            let with = if bound.is_empty() { String::new() } else { format!(" with {}", bound.join(", ")) };
            Error::input(format!("array '{name}'"))
                .expected(format!("shape ({pattern}){with}"))
                .got(format!("{got:?}"))
        };
        let parts: Vec<&str> = if pattern.is_empty() { Vec::new() } else { pattern.split(',').collect() };
        if parts.len() != got.len() {
            return Err(wrong(dims));
        }
        for (part, &size) in parts.iter().zip(got) {
            let fits = match part.parse::<usize>() {
                Ok(fixed) => fixed == size,
                Err(_) => {
                    let letter = part.chars().next().expect("a part of the pattern is not empty");
                    *dims.entry(letter).or_insert(size) == size
                }
            };
            if !fits {
                return Err(wrong(dims));
            }
        }
        Ok(array)
    }

    /// Refuses numbers that are not finite as f32 (NaN, ±∞, and f64 that round to ±∞) in every floating-point
    /// array with one of the given names; missing arrays are skipped.
    ///
    /// # Errors
    /// The error names the array, the index and the value.
    pub fn finite<'a>(&self, names: impl IntoIterator<Item = &'a str>) -> Result<()> {
        for name in names {
            let Some(array) = self.get(name).filter(|a| a.is_float()) else { continue };
            if let Some((i, x)) =
                array.to_f64().into_iter().enumerate().find(|(_, x)| !(*x as f32).is_finite())
            {
                let mut rest = i;
                let mut index = vec![0; array.shape().len()];
                for (slot, &size) in index.iter_mut().zip(array.shape()).rev() {
                    *slot = rest % size;
                    rest /= size;
                }
                return Err(Error::input(format!("array '{name}'"))
                    .at(format!("index {index:?}"))
                    .expected("a number that is finite as f32")
                    .got(x.to_string()));
            }
        }
        Ok(())
    }

    /// Returns a single number stored under a name, as f64.
    ///
    /// # Errors
    /// Returns an error if the array is missing or has more than one element.
    pub fn scalar(&self, name: &str) -> Result<f64> {
        let a = self.need(name)?;
        if a.len() != 1 {
            return Err(Error::input(format!("array '{name}'"))
                .expected("one number")
                .got(format!("shape {:?}", a.shape())));
        }
        Ok(a.to_f64()[0])
    }
}

/// Keeps the rows of a row-major array for which `keep` is true, in their order.
pub fn retain_rows<T: Copy>(array: &mut Vec<T>, width: usize, keep: &[bool]) {
    let mut to = 0;
    for (r, _) in keep.iter().enumerate().filter(|(_, k)| **k) {
        array.copy_within(r * width..(r + 1) * width, to * width);
        to += 1;
    }
    array.truncate(to * width);
}

/// Returns the number of entries of a shape.
pub fn entries(shape: &[usize]) -> usize {
    let mut entries = 1;
    for side in shape {
        entries *= side;
    }
    entries
}
