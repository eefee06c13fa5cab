//! What a case is.

use std::collections::BTreeMap;

use reference::array::Named;
use reference::twins::Setting;

use crate::scenes::settings;

/// One operator with inputs.
pub(crate) struct Case {
    pub(crate) name: &'static str,
    pub(crate) op: &'static str,
    pub(crate) inputs: Named<f64>,
    pub(crate) settings: BTreeMap<String, Setting>,
    /// Inputs that have a gradient here.
    pub(crate) smooth: &'static [&'static str],
    /// Outputs that have one.
    pub(crate) outputs: &'static [&'static str],
    /// Bound of the dot-product test.
    pub(crate) bound: f64,
}

/// A case with the bound of one operator.
pub(super) fn case(
    name: &'static str,
    op: &'static str,
    inputs: Named<f64>,
    with: &[(&str, &str)],
    smooth: &'static [&'static str],
    outputs: &'static [&'static str],
) -> Case {
    Case { name, op, inputs, settings: settings(with), smooth, outputs, bound: 1e-13 }
}

impl Case {
    /// With another bound.
    pub(super) fn within(self, bound: f64) -> Self {
        Self { bound, ..self }
    }
}

/// Some of the arrays.
pub(crate) fn picked(from: &Named<f64>, names: &[&str]) -> Named<f64> {
    names.iter().map(|&name| (name.to_owned(), from[name].clone())).collect()
}
