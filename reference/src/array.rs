//! Named arrays, and the output object that twins write to.

use std::collections::BTreeMap;

use crate::scalar::Scalar;

/// A row-major array; the last axis varies fastest. A 0-d array has an empty shape and one entry.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Arr<S> {
    /// Lengths of the axes.
    pub shape: Vec<usize>,
    /// Entries.
    pub data: Vec<S>,
}

/// Arrays by name.
pub type Named<S> = BTreeMap<String, Arr<S>>;

/// Number of entries of a shape.
fn entries(shape: &[usize]) -> usize {
    let mut entries = 1;
    for &length in shape {
        entries *= length;
    }
    entries
}

impl<S: Copy> Arr<S> {
    /// Makes an array of the given shape.
    ///
    /// # Panics
    /// When the number of entries does not match the shape.
    pub fn new(shape: &[usize], data: Vec<S>) -> Self {
        assert!(entries(shape) == data.len(), "{} entries for shape {shape:?}", data.len());
        Self { shape: shape.to_vec(), data }
    }
    /// Makes an array of the given shape in which every entry is the same.
    pub fn filled(shape: &[usize], x: S) -> Self {
        Self { shape: shape.to_vec(), data: vec![x; entries(shape)] }
    }
    /// Makes a 0-d array.
    pub fn scalar(x: S) -> Self {
        Self { shape: Vec::new(), data: vec![x] }
    }
    /// Maps every entry.
    pub fn map<T>(&self, f: impl FnMut(&S) -> T) -> Arr<T> {
        Arr { shape: self.shape.clone(), data: self.data.iter().map(f).collect() }
    }
    /// Row `i` of `K` consecutive entries.
    pub fn row<const K: usize>(&self, i: usize) -> [S; K] {
        std::array::from_fn(|k| self.data[i * K + k])
    }
}

/// Where a twin writes its results.
///
/// `put` stores the value; in reverse mode it also seeds it with the cotangent of that entry, and
/// [`Out::flush`] sweeps the pixel or row back. In the other modes `flush` does nothing.
pub struct Out<'a, S> {
    bars: Option<&'a Named<f64>>,
    names: Vec<String>,
    arrays: Vec<Arr<S>>,
    seeds: Vec<Option<&'a [f64]>>,
    /// Discrete decisions.
    pub plan: Named<f64>,
}

/// An array of an [`Out`].
#[derive(Clone, Copy, Debug)]
pub struct Slot(usize);

impl<'a, S: Scalar> Out<'a, S> {
    /// Makes an empty output; `bars` holds the cotangents by output name and is given in reverse mode only.
    pub fn new(bars: Option<&'a Named<f64>>) -> Self {
        Self { bars, names: Vec::new(), arrays: Vec::new(), seeds: Vec::new(), plan: Named::new() }
    }
    /// Declares an array of zeros.
    pub fn array(&mut self, name: &str, shape: &[usize]) -> Slot {
        self.names.push(name.to_owned());
        self.arrays.push(Arr::filled(shape, S::zero()));
        self.seeds.push(self.bars.and_then(|bars| bars.get(name)).map(|bar| bar.data.as_slice()));
        Slot(self.names.len() - 1)
    }
    /// Writes one entry.
    pub fn put(&mut self, slot: Slot, index: usize, x: S) {
        if let Some(bar) = self.seeds[slot.0] {
            x.seed(bar[index]);
        }
        // In reverse mode the tape node of this number is about to be dropped.
        self.arrays[slot.0].data[index] = if self.bars.is_some() { x.detach() } else { x };
    }
    /// Writes one row of consecutive entries.
    pub fn put_row<const K: usize>(&mut self, slot: Slot, row: usize, x: [S; K]) {
        for (k, x) in x.into_iter().enumerate() {
            self.put(slot, row * K + k, x);
        }
    }
    /// Adds a term of a mean to one entry: a left fold over the calls, divided once at the end by
    /// [`Out::divide`]. In reverse mode the term is seeded with its share of the cotangent.
    pub fn add(&mut self, slot: Slot, index: usize, x: S, terms: f64) {
        if let Some(bar) = self.seeds[slot.0] {
            x.seed(bar[index] / terms);
        }
        let sum = &mut self.arrays[slot.0].data[index];
        *sum = *sum + if self.bars.is_some() { x.detach() } else { x };
    }
    /// Divides a mean by its number of terms.
    pub fn divide(&mut self, slot: Slot, index: usize, terms: f64) {
        let sum = &mut self.arrays[slot.0].data[index];
        *sum = *sum / terms;
    }
    /// Marks the end of a pixel or row.
    pub fn flush(&mut self) {
        S::sweep();
    }
    /// The arrays by name, and the plan.
    pub fn finish(self) -> (Named<S>, Named<f64>) {
        (self.names.into_iter().zip(self.arrays).collect(), self.plan)
    }
}
