//! Values, records, and the reverse sweep.

use ndarray::{ArrayD, IxDyn};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A value on a [`Tape`], identified by its index in the order of creation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Var(usize);

/// Accumulator for the cotangent of one value during the backward sweep.
///
/// The first contribution is moved in, later ones are added to it, in the order of the sweep: last
/// record first, and within a record in the order of the calls of its adjoint. The order, and so every bit,
/// depends only on the program.
#[derive(Debug)]
pub struct Bar<'a> {
    shape: &'a [usize],
    wanted: bool,
    held: &'a mut Option<ArrayD<f32>>,
}

impl Bar<'_> {
    /// Whether this cotangent is needed; for a constant it is not, and the adjoint may skip the work.
    pub fn wanted(&self) -> bool {
        self.wanted
    }

    /// Adds a contribution. The first one keeps its buffer.
    ///
    /// # Panics
    /// When the shape differs from that of the value.
    pub fn add(&mut self, x_bar: ArrayD<f32>) {
        assert_eq!(x_bar.shape(), self.shape, "a cotangent has the shape of its value");
        if !self.wanted {
            return;
        }
        match self.held {
            None => *self.held = Some(x_bar),
            Some(sum) => {
                // sum ← sum + x_bar, entry by entry
                for (s, x) in sum.iter_mut().zip(x_bar.iter()) {
                    *s += *x;
                }
            }
        }
    }

    /// The buffer itself, zeros if nothing has been added yet, for adjoints that accumulate into `x_bar`.
    pub fn accumulator(&mut self) -> &mut ArrayD<f32> {
        self.held.get_or_insert_with(|| ArrayD::zeros(IxDyn(self.shape)))
    }
}

/// Adjoint of one record: cotangents of its outputs (`None` is zero; they may be taken) and the accumulators
/// of its inputs, both in recorded order.
type Adjoint = Box<dyn FnOnce(Vec<Option<ArrayD<f32>>>, &mut [Bar<'_>]) + Send>;

struct Record {
    operator: &'static str,
    inputs: Vec<Var>,
    outputs: Vec<Var>,
    adjoint: Adjoint,
}

struct Value {
    array: Arc<ArrayD<f32>>,
    name: Option<String>,
    wanted: bool,
}

/// A record of operators and their values; one backward sweep consumes the records.
///
/// ```
/// # use lastlight_train as lastlight;
/// use lastlight::tape::Tape;
/// use ndarray::{ArrayD, IxDyn};
/// let mut tape = Tape::new();
/// let x = tape.leaf("x", ArrayD::from_elem(IxDyn(&[2]), 3.0));
/// let value = tape.value(x);
/// let squared = value.mapv(|x| x * x);
/// let y = tape.record("square", &[x], vec![squared], move |y_bar, x_bar| {
///     if let Some(y_bar) = &y_bar[0] {
///         x_bar[0].add(y_bar * &*value * 2.0);
///     }
/// })[0];
/// let grads = tape.backward(y, ArrayD::from_elem(IxDyn(&[2]), 1.0));
/// assert_eq!(grads.get("x").unwrap().as_slice().unwrap(), &[6.0, 6.0]);
/// ```
#[derive(Default)]
pub struct Tape {
    values: Vec<Value>,
    records: Vec<Record>,
}

impl Tape {
    /// An empty tape.
    pub fn new() -> Self {
        Self::default()
    }

    fn push(&mut self, array: Arc<ArrayD<f32>>, name: Option<String>, wanted: bool) -> Var {
        self.values.push(Value { array, name, wanted });
        Var(self.values.len() - 1)
    }

    /// Adds a value whose gradient is returned under this name; takes an array or a shared one.
    ///
    /// # Panics
    /// When the name is in use: the gradients of two leaves would be merged.
    pub fn leaf(&mut self, name: &str, array: impl Into<Arc<ArrayD<f32>>>) -> Var {
        let taken = self.values.iter().any(|v| v.name.as_deref() == Some(name));
        assert!(!taken, "leaf '{name}' is on the tape already");
        self.push(array.into(), Some(name.to_owned()), true)
    }

    /// Adds a value without a gradient.
    pub fn constant(&mut self, array: impl Into<Arc<ArrayD<f32>>>) -> Var {
        self.push(array.into(), None, false)
    }

    /// The array of a value, shared.
    pub fn value(&self, var: Var) -> Arc<ArrayD<f32>> {
        Arc::clone(&self.values[var.0].array)
    }

    /// The number in a value with a single entry.
    ///
    /// # Panics
    /// When the value does not have exactly one entry.
    pub fn scalar(&self, var: Var) -> f32 {
        let array = &self.values[var.0].array;
        assert_eq!(array.len(), 1, "a scalar holds one number");
        array.iter().copied().next().expect("the length was checked")
    }

    /// Records one operator that has just been run. The closure and everything it saved are dropped if no
    /// input depends on a leaf.
    pub fn record(
        &mut self,
        operator: &'static str,
        inputs: &[Var],
        outputs: Vec<impl Into<Arc<ArrayD<f32>>>>,
        adjoint: impl FnOnce(Vec<Option<ArrayD<f32>>>, &mut [Bar<'_>]) + Send + 'static,
    ) -> Vec<Var> {
        let wanted = inputs.iter().any(|v| self.values[v.0].wanted);
        let outputs: Vec<Var> = outputs.into_iter().map(|a| self.push(a.into(), None, wanted)).collect();
        if wanted {
            let record = Record {
                operator,
                inputs: inputs.to_vec(),
                outputs: outputs.clone(),
                adjoint: Box::new(adjoint),
            };
            self.records.push(record);
        }
        outputs
    }

    /// Σᵢ wᵢ xᵢ of scalars: a left fold over the list from the first product.
    ///
    /// # Panics
    /// When the list is empty or an entry is not a scalar.
    pub fn weighted_sum(&mut self, terms: &[(Var, f32)]) -> Var {
        assert!(!terms.is_empty(), "a sum of losses has at least one term");
        let mut sum = self.scalar(terms[0].0) * terms[0].1;
        for &(var, weight) in &terms[1..] {
            sum += self.scalar(var) * weight;
        }
        let inputs: Vec<Var> = terms.iter().map(|t| t.0).collect();
        let weights: Vec<f32> = terms.iter().map(|t| t.1).collect();
        let out = ArrayD::from_elem(IxDyn(&[]), sum);
        self.record("weighted_sum", &inputs, vec![out], move |mut out_bar, x_bar| {
            let Some(out_bar) = out_bar[0].take() else { return };
            let g = out_bar.iter().copied().next().expect("a scalar holds one number");
            for (bar, w) in x_bar.iter_mut().zip(weights) {
                if bar.wanted() {
                    let shape = bar.shape.to_vec();
                    bar.add(ArrayD::from_elem(IxDyn(&shape), g * w));
                }
            }
        })[0]
    }

    /// Names of the recorded operators in order; for reports.
    pub fn operators(&self) -> impl Iterator<Item = &'static str> {
        self.records.iter().map(|r| r.operator)
    }

    /// Cotangents of all leaves, given that of `var`. Records are replayed in reverse order and dropped after
    /// use.
    ///
    /// # Panics
    /// When the shape of `seed` differs from that of `var`.
    pub fn backward(mut self, var: Var, seed: ArrayD<f32>) -> Grads {
        assert_eq!(seed.shape(), self.values[var.0].array.shape(), "the seed has the shape of the value");
        let mut held: Vec<Option<ArrayD<f32>>> = self.values.iter().map(|_| None).collect();
        held[var.0] = Some(seed);
        while let Some(record) = self.records.pop() {
            let out_bar: Vec<_> = record.outputs.iter().map(|v| held[v.0].take()).collect();
            if out_bar.iter().all(Option::is_none) {
                continue; // nothing downstream depends on this operator
            }
            // An operator may take a value twice (x·x): each occurrence has its own accumulator; they are
            // summed in list order.
            let mut first: Vec<Option<ArrayD<f32>>> = Vec::with_capacity(record.inputs.len());
            for (i, v) in record.inputs.iter().enumerate() {
                let repeated = record.inputs[..i].contains(v);
                first.push(if repeated { None } else { held[v.0].take() });
            }
            let mut bars: Vec<Bar<'_>> = record
                .inputs
                .iter()
                .zip(&mut first)
                .map(|(v, held)| {
                    let value = &self.values[v.0];
                    Bar { shape: value.array.shape(), wanted: value.wanted, held }
                })
                .collect();
            (record.adjoint)(out_bar, &mut bars);
            drop(bars);
            for (v, bar) in record.inputs.iter().zip(first) {
                let Some(bar) = bar else { continue };
                let value = &self.values[v.0];
                if value.wanted {
                    Bar { shape: value.array.shape(), wanted: true, held: &mut held[v.0] }.add(bar);
                }
            }
        }
        let mut grads = BTreeMap::new();
        for (value, held) in self.values.into_iter().zip(held) {
            if let Some(name) = value.name {
                grads.insert(name, held.unwrap_or_else(|| ArrayD::zeros(value.array.raw_dim())));
            }
        }
        Grads(grads)
    }

    /// [`Self::backward`] of a scalar with seed 1.
    ///
    /// # Panics
    /// When `var` has more than one entry.
    pub fn backward_scalar(self, var: Var) -> Grads {
        let shape = self.values[var.0].array.raw_dim();
        assert_eq!(self.values[var.0].array.len(), 1, "a loss is one number");
        self.backward(var, ArrayD::from_elem(shape, 1.0))
    }
}

/// Gradients by the names of the leaves; a leaf that nothing depends on has zeros.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Grads(pub BTreeMap<String, ArrayD<f32>>);

impl Grads {
    /// The gradient of the leaf of that name.
    pub fn get(&self, name: &str) -> Option<&ArrayD<f32>> {
        self.0.get(name)
    }

    /// Removes and returns it.
    pub fn take(&mut self, name: &str) -> Option<ArrayD<f32>> {
        self.0.remove(name)
    }

    /// Adds another item's gradients, name by name: a batch is summed by calling this in index order.
    pub fn add(&mut self, other: Self) {
        for (name, g) in other.0 {
            match self.0.get_mut(&name) {
                None => {
                    self.0.insert(name, g);
                }
                Some(sum) => {
                    assert_eq!(sum.shape(), g.shape(), "gradients of one leaf have one shape");
                    for (s, x) in sum.iter_mut().zip(g.iter()) {
                        *s += *x;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn product(tape: &mut Tape, a: Var, b: Var) -> Var {
        let (x, y) = (tape.value(a), tape.value(b));
        let out = &*x * &*y;
        tape.record("product", &[a, b], vec![out], move |out_bar, x_bar| {
            let Some(g) = &out_bar[0] else { return };
            x_bar[0].add(g * &*y);
            x_bar[1].add(g * &*x);
        })[0]
    }

    #[test]
    fn a_value_used_twice_gathers_both_contributions() {
        let mut tape = Tape::new();
        let x = tape.leaf("x", ArrayD::from_elem(IxDyn(&[]), 3.0));
        let c = tape.constant(ArrayD::from_elem(IxDyn(&[]), 5.0));
        let unused = tape.leaf("unused", ArrayD::from_elem(IxDyn(&[2]), 1.0));
        let square = product(&mut tape, x, x); // 9
        let cx = product(&mut tape, c, x); // 15
        let loss = tape.weighted_sum(&[(square, 0.5), (cx, 2.0)]); // x²/2 + 10 x
        assert_eq!(tape.scalar(loss), 34.5, "the value");
        assert_eq!(tape.operators().collect::<Vec<_>>(), ["product", "product", "weighted_sum"], "the order");
        let grads = tape.backward_scalar(loss);
        assert_eq!(grads.get("x").and_then(|g| g.first().copied()), Some(13.0), "x + 10");
        assert_eq!(
            grads.get("unused").map(|g| g.len()),
            Some(tape_len(unused)),
            "a leaf without effect has zeros"
        );
    }

    fn tape_len(_: Var) -> usize {
        2
    }

    #[test]
    fn the_first_contribution_keeps_its_buffer() {
        let mut tape = Tape::new();
        let x = tape.leaf("x", ArrayD::from_elem(IxDyn(&[64]), 1.0));
        let y =
            tape.record("identity", &[x], vec![ArrayD::from_elem(IxDyn(&[64]), 1.0)], |mut y_bar, x_bar| {
                x_bar[0].add(y_bar[0].take().expect("y is the seed"));
            })[0];
        let seed = ArrayD::from_elem(IxDyn(&[64]), 2.0);
        let address = seed.as_ptr();
        let grads = tape.backward(y, seed);
        assert_eq!(grads.get("x").map(|g| g.as_ptr()), Some(address), "moved, not copied");
    }
}
