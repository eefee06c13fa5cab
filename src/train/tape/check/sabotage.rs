//! The negative control: a correct subject with one gradient made wrong.

use super::subject::{On, Prediction, Subject, Variable};
use crate::Result;
use crate::tape::probe::{Evaluation, Values};

/// A way to make an adjoint wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sabotage {
    /// x̄ ← −x̄
    FlipSign,
    /// x̄ ← the contribution of the cotangent entries whose index has an odd number of ones in binary: about
    /// half of them, in a pattern that matches no array layout
    DropTerm,
    /// x̄ ← 1.01 x̄
    OnePercent,
}

impl Sabotage {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::FlipSign, Self::DropTerm, Self::OnePercent];
}

/// A subject whose shipped adjoint is wrong in one variable.
pub struct Sabotaged<'a> {
    /// the correct subject
    pub inner: &'a dyn Subject,
    /// variable whose gradient is wrong
    pub variable: &'a str,
    /// kind of error
    pub how: Sabotage,
}

impl Subject for Sabotaged<'_> {
    fn name(&self) -> String {
        format!("{} with {:?} of {}", self.inner.name(), self.how, self.variable)
    }
    fn end_to_end(&self) -> bool {
        self.inner.end_to_end()
    }
    fn unit(&self) -> f64 {
        self.inner.unit()
    }
    fn variables(&self) -> &[Variable] {
        self.inner.variables()
    }
    fn inputs(&self) -> &Values {
        self.inner.inputs()
    }
    fn cotangents(&self) -> &Values {
        self.inner.cotangents()
    }
    fn shipped(&self) -> Result<Values> {
        self.inner.shipped()
    }
    fn shipped_adjoint(&self, out_bar: &Values, start: Option<&Values>) -> Result<Values> {
        let mut grads = self.inner.shipped_adjoint(out_bar, start)?;
        let broken = match self.how {
            Sabotage::FlipSign => grads[self.variable].iter().map(|x| -x).collect(),
            Sabotage::OnePercent => grads[self.variable].iter().map(|x| 1.01 * x).collect(),
            Sabotage::DropTerm => {
                let mut part = out_bar.clone();
                for v in part.values_mut() {
                    for (_, x) in v.iter_mut().enumerate().filter(|(i, _)| i.count_ones().is_multiple_of(2)) {
                        *x = 0.0;
                    }
                }
                let mut grads = self.inner.shipped_adjoint(&part, start)?;
                grads.remove(self.variable).unwrap_or_default()
            }
        };
        grads.insert(self.variable.to_owned(), broken);
        Ok(grads)
    }
    fn value(&self, x: &Values, on: On) -> Result<Evaluation> {
        self.inner.value(x, on)
    }
    fn jvp(&self, x_dot: &Values, on: On) -> Result<Values> {
        self.inner.jvp(x_dot, on)
    }
    fn vjp(&self, out_bar: &Values) -> Result<Values> {
        self.inner.vjp(out_bar)
    }
    fn prediction(&self) -> Result<Prediction> {
        self.inner.prediction()
    }
}
