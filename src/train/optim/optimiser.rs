//! Adam for named parameters.
//!
//! The values are those of [`Params`]; an [`Optimiser`] has one state for each parameter that it updates.
//! With one counter per row ([`Counters::Row`]) a row is the part of the array with the same index along the
//! first axis; with a global one the array is a single column.
//!
//! # Example
//! ```
//! # use lastlight_train as lastlight;
//! use lastlight::optim::{adam::Rule, optimiser::Optimiser};
//! use lastlight::tape::{Grads, Params};
//! use ndarray::arr1;
//! let mut params = Params::new();
//! params.set("w", arr1(&[1.0_f32]).into_dyn());
//! let mut optimiser = Optimiser::new(Rule::default(), &params)?;
//! let grads = Grads([("w".to_owned(), arr1(&[123.0]).into_dyn())].into());
//! optimiser.step(&mut params, &grads, |_| Some(0.25))?; // the first step has length lr, whatever the gradient
//! assert!((params.get("w").expect("set above")[0] - 0.75).abs() < 1e-7);
//! # Ok::<(), lastlight::Error>(())
//! ```

use super::adam::{Adam, Counters, Rule};
use crate::num::array::{Arrays, entries};
use crate::tape::{Grads, Params};
use crate::{Error, Result};
use ndarray::{ArrayD, IxDyn};
use std::collections::BTreeMap;

/// Names of values and states in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArrayNames {
    /// `param/NAME`, and `adam/NAME.m`, `.v`, `.steps`.
    Folders,
    /// `NAME`, and `NAME.adam.m`, `.v`, `.steps`.
    Beside,
}

impl ArrayNames {
    /// Names of the value and of the state of a parameter.
    fn of(self, name: &str) -> [String; 2] {
        match self {
            Self::Folders => [format!("param/{name}"), format!("adam/{name}")],
            Self::Beside => [name.to_owned(), format!("{name}.adam")],
        }
    }

    /// Writes the values.
    pub fn save(self, params: &Params, out: &mut Arrays) {
        for (name, array) in params.iter() {
            let [value, _] = self.of(name);
            out.put(&value, array.shape(), array.iter().copied().collect());
        }
    }

    /// Replaces the values of `params` by those in a file.
    ///
    /// # Errors
    /// A missing array, another shape, a number that is not finite as f32.
    pub fn load(self, params: &mut Params, from: &Arrays) -> Result<()> {
        let mut loaded = Params::new();
        for (name, array) in params.iter() {
            let [value, _] = self.of(name);
            let pattern: Vec<String> = array.shape().iter().map(ToString::to_string).collect();
            let stored = from.shape(&value, &pattern.join(","), &mut BTreeMap::new())?.to_f32();
            from.finite([value.as_str()])?;
            let stored = ArrayD::from_shape_vec(IxDyn(array.shape()), stored);
            loaded.set(name, stored.expect("the shape was checked"));
        }
        *params = loaded;
        Ok(())
    }
}

/// States of parameters by name.
#[derive(Clone, Debug)]
pub struct Optimiser {
    rule: Rule,
    states: BTreeMap<String, Adam>,
}

/// Rows and columns of the state of a parameter.
fn sizes(rule: &Rule, shape: &[usize]) -> [usize; 2] {
    match rule.counters {
        Counters::Row => [shape.first().copied().unwrap_or(1), entries(shape.get(1..).unwrap_or_default())],
        Counters::Global => [entries(shape), 1],
    }
}

impl Optimiser {
    /// Makes zero states for all parameters that are not empty.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn new(rule: Rule, params: &Params) -> Result<Self> {
        Self::of(rule, params, |_| true)
    }

    /// Makes zero states for the parameters selected by name; the others are not optimised.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn of(rule: Rule, params: &Params, is_chosen: impl Fn(&str) -> bool) -> Result<Self> {
        let states = params
            .iter()
            .filter(|(name, array)| !array.is_empty() && is_chosen(name))
            .map(|(name, array)| {
                let [rows, width] = sizes(&rule, array.shape());
                Ok((name.to_owned(), Adam::new(rule, rows, width)?))
            })
            .collect::<Result<_>>()?;
        Ok(Self { rule, states })
    }

    /// Names of the optimised parameters, in order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.states.keys().map(String::as_str)
    }

    /// The state of a parameter.
    pub fn get(&self, name: &str) -> Option<&Adam> {
        self.states.get(name)
    }

    /// The state of a parameter, mutable.
    pub fn get_mut(&mut self, name: &str) -> Option<&mut Adam> {
        self.states.get_mut(name)
    }

    /// One step of every parameter for which there is a rate; the others and their states are unchanged.
    ///
    /// # Errors
    /// A result that is not finite; the error names the parameter; the parameters before it, in the order of
    /// names, have been updated.
    ///
    /// # Panics
    /// When a parameter or its gradient is missing.
    pub fn step(
        &mut self,
        params: &mut Params,
        grads: &Grads,
        rate: impl Fn(&str) -> Option<f64>,
    ) -> Result<()> {
        for (name, adam) in &mut self.states {
            let Some(rate) = rate(name) else { continue };
            let grad = grads.get(name).expect("every optimised parameter has a gradient");
            step(name, adam, params, grad, rate, None)?;
        }
        Ok(())
    }

    /// One step of the rows of a parameter where `active` is 1.
    ///
    /// # Errors
    /// A result that is not finite.
    ///
    /// # Panics
    /// When there is no such parameter.
    pub fn step_rows(
        &mut self,
        params: &mut Params,
        name: &str,
        grad: &ArrayD<f32>,
        rate: f64,
        active: &[u8],
    ) -> Result<()> {
        let adam = self.states.get_mut(name).expect("an optimised parameter");
        step(name, adam, params, grad, rate, Some(active))
    }

    /// Writes the states.
    pub fn save(&self, names: ArrayNames, out: &mut Arrays) {
        for (name, adam) in &self.states {
            let [_, state] = names.of(name);
            adam.save(&state, out);
        }
    }

    /// Replaces the states by those in a file.
    ///
    /// # Errors
    /// Missing arrays, wrong shapes, numbers out of range; the states before the invalid one, in the order of
    /// names, have been replaced.
    pub fn load(&mut self, names: ArrayNames, from: &Arrays) -> Result<()> {
        for (name, adam) in &mut self.states {
            let [_, state] = names.of(name);
            *adam = Adam::load_sized(self.rule, &state, from, [adam.rows(), adam.width()])?;
        }
        Ok(())
    }
}

fn step(
    name: &str,
    adam: &mut Adam,
    params: &mut Params,
    grad: &ArrayD<f32>,
    rate: f64,
    active: Option<&[u8]>,
) -> Result<()> {
    let param = params.get_mut(name).expect("every state has its parameter");
    let param = param.as_slice_mut().expect("parameters are contiguous");
    adam.step(param, grad.as_slice().expect("gradients are contiguous"), &[rate], active)
        .map_err(|e: Error| e.within(format!("optimiser of {name}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn array(shape: &[usize], at: f32) -> ArrayD<f32> {
        let size = entries(shape);
        ArrayD::from_shape_vec(IxDyn(shape), (0..size).map(|i| libm::sinf(i as f32 + at)).collect())
            .expect("as many values as the shape has")
    }

    fn params() -> Params {
        let mut params = Params::new();
        params.set("a.weight", array(&[3, 2], 0.0));
        params.set("a.bias", array(&[3], 1.0));
        params.set("empty", array(&[0, 2], 0.0));
        params
    }

    fn grads() -> Grads {
        let of = |(name, a): (&str, &ArrayD<f32>)| (name.to_owned(), array(a.shape(), 5.0));
        Grads(params().iter().map(of).collect())
    }

    #[test]
    fn resumed_parameters_take_the_steps_of_those_that_were_not_interrupted() {
        for (rule, names) in [
            (Rule::SPLAT, ArrayNames::Beside),
            (Rule { counters: Counters::Global, ..Rule::default() }, ArrayNames::Folders),
        ] {
            let (mut values, mut optimiser) =
                (params(), Optimiser::new(rule, &params()).expect("a rule in its range"));
            optimiser.step(&mut values, &grads(), |_| Some(0.1)).expect("finite");
            let mut file = Arrays::new();
            names.save(&values, &mut file);
            optimiser.save(names, &mut file);
            let (mut resumed, mut states) =
                (params(), Optimiser::new(rule, &params()).expect("a rule in its range"));
            names.load(&mut resumed, &file).expect("the same shapes");
            states.load(names, &file).expect("the same shapes");
            for (values, optimiser) in [(&mut values, &mut optimiser), (&mut resumed, &mut states)] {
                optimiser.step(values, &grads(), |name| (name != "a.bias").then_some(0.2)).expect("finite");
            }
            assert_eq!(values, resumed, "{names:?}");
            let mut other = Params::new();
            other.set("a.bias", array(&[4], 0.0));
            assert!(names.load(&mut other, &file).is_err(), "another shape");
            let mut other = Optimiser::new(rule, &other).expect("a rule in its range");
            assert!(other.load(names, &file).is_err(), "states of another shape");
            // Finite in the file, infinite in f32.
            let [value, _] = names.of("a.bias");
            file.put(&value, &[3], vec![0.0, 4e38_f64, 0.0]);
            let refused = names.load(&mut params(), &file).expect_err("too large");
            assert!(
                refused.to_string().contains("index [1]: expected a number that is finite as f32"),
                "{refused}"
            );
        }
    }

    #[test]
    fn parameters_without_a_rate_and_rows_that_rest_keep_their_bits() {
        let (mut values, before) = (params(), params());
        let mut optimiser =
            Optimiser::of(Rule::SPLAT, &values, |name| name.starts_with("a.")).expect("a rule in its range");
        assert_eq!(optimiser.names().collect::<Vec<_>>(), ["a.bias", "a.weight"], "the selected ones");
        optimiser.step(&mut values, &grads(), |name| (name == "a.bias").then_some(0.1)).expect("finite");
        assert_ne!(values.get("a.bias"), before.get("a.bias"), "it has a rate");
        assert_eq!(values.get("a.weight"), before.get("a.weight"), "it has none");
        let grad = array(&[3, 2], 5.0);
        optimiser.step_rows(&mut values, "a.weight", &grad, 0.1, &[0, 1, 0]).expect("finite");
        let moved: Vec<bool> = values
            .get("a.weight")
            .into_iter()
            .zip(before.get("a.weight"))
            .flat_map(|(now, before)| now.iter().zip(before).map(|(a, b)| a != b))
            .collect();
        assert_eq!(moved, [false, false, true, true, false, false], "the second row alone");
    }
}
