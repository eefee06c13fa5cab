//! Named parameters.

use super::{Tape, Var};
use ndarray::ArrayD;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Named parameters, in the order of their names: the order in which they are put on a tape, digested and
/// stored.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Params(BTreeMap<String, Arc<ArrayD<f32>>>);

impl Params {
    /// Makes an empty set.
    pub fn new() -> Self {
        Self::default()
    }

    /// Stores a parameter, replacing one of that name.
    pub fn set(&mut self, name: &str, array: impl Into<Arc<ArrayD<f32>>>) {
        self.0.insert(name.to_owned(), array.into());
    }

    /// The parameter of that name.
    pub fn get(&self, name: &str) -> Option<&ArrayD<f32>> {
        self.0.get(name).map(|a| &**a)
    }

    /// The parameter of that name for an update in place; copied first if a tape still shares it.
    pub fn get_mut(&mut self, name: &str) -> Option<&mut ArrayD<f32>> {
        self.0.get_mut(name).map(Arc::make_mut)
    }

    /// Names and arrays in order.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &ArrayD<f32>)> {
        self.0.iter().map(|(name, a)| (name.as_str(), &**a))
    }

    /// The parameters whose names begin with `prefix`, without copying.
    pub fn of(&self, prefix: &str) -> Self {
        let own = self.0.iter().filter(|(name, _)| name.starts_with(prefix));
        Self(own.map(|(name, a)| (name.clone(), Arc::clone(a))).collect())
    }

    /// Puts every parameter on the tape as a constant, without copying.
    pub fn constants(&self, tape: &mut Tape) -> BTreeMap<String, Var> {
        self.0.iter().map(|(name, a)| (name.clone(), tape.constant(Arc::clone(a)))).collect()
    }

    /// Number of parameters (arrays, not entries).
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there are no parameters.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Puts every parameter on the tape as a leaf with its name, without copying.
    pub fn record(&self, tape: &mut Tape) -> BTreeMap<String, Var> {
        self.0.iter().map(|(name, a)| (name.clone(), tape.leaf(name, Arc::clone(a)))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::IxDyn;

    #[test]
    fn parameters_are_shared_with_the_tape_and_updated_in_place_after_it() {
        let mut params = Params::new();
        params.set("w", ArrayD::from_elem(IxDyn(&[2]), 1.0));
        let mut tape = Tape::new();
        let vars = params.record(&mut tape);
        let address = tape.value(vars["w"]).as_ptr();
        drop(tape);
        let w = params.get_mut("w").expect("it was set");
        assert_eq!(w.as_ptr(), address, "neither recording nor updating copies");
    }
}
