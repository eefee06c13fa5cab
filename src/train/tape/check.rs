//! Gradient checks: five rungs, from cheap to expensive.
//!
//! | rung | compares | bound |
//! |---|---|---|
//! | R0 | the gradients of the shipped operator with properties that need no reference: present, finite, zero where predicted, not zero elsewhere | |
//! | R1 | the twin's `Dual` with the twin's `Rev`: ⟨Jv, w⟩ = ⟨v, Jᵀw⟩ | 1e-13 per operator, 1e-11 end to end |
//! | R2 | finite differences of the twin on the frozen plan with `Dual` | 1e-7 with Richardson, order 2 |
//! | R3 | the same on the live plan, where the decision logs are equal | 1e-6, at most 5 % skipped |
//! | R4 | the shipped hand-derived adjoint with `Rev` on the same plan | relative L2 2e-5 (1e-12 in f64), 1−cos 1e-9, bias 1e-6; linearity and accumulation in bits |
//!
//! The frozen plan contains every decision, those that the shipped operator does not store included. Values that carry
//! no gradient although they change with the inputs (a normal that only selects where a panorama is read) keep those
//! of the inputs in all evaluations of R2 and R3, and are not part of the decision log.
//!
//! A vacuous check (constant outputs, all gradients zero) fails. [`Sabotaged`] is the negative control: with
//! a flipped sign, a dropped term or an error of 1 %, R4 must fail.
//!
//! [`function`] checks a user-supplied function:
//!
//! ```
//! # use lastlight_train as lastlight;
//! use lastlight::check;
//! // f(x) = Σ x³ with its gradient 3x²
//! let report = check::function(
//!     "cubes",
//!     |x| Ok(vec![x["x"].iter().map(|x| x * x * x).fold(0.0, |a, b| a + b)]),
//!     |x, y_bar| Ok([("x".to_owned(), x["x"].iter().map(|x| 3.0 * x * x * y_bar[0]).collect())].into()),
//!     &[("x".to_owned(), vec![1.0, -2.0, 0.5])].into(),
//!     &check::Options::default(),
//! )?;
//! assert!(report.passed(), "{report}");
//! # Ok::<(), lastlight::Error>(())
//! ```

mod function;
mod rungs;
mod sabotage;
mod subject;

pub use super::probe::{Derivative, Distance, Evaluation, Step, UNIT, Values};
pub use super::report::{Entry, Measure, Report, Rung};
pub use function::{function, function_with_log};
pub use sabotage::{Sabotage, Sabotaged};
pub use subject::{
    ACCUMULATION_UNITS, BIAS, COSINE, DOT_CHAIN, DOT_OPERATOR, FROZEN, LIVE, NULL_UNITS, OUTPUT_F32,
    OUTPUT_F64, On, Options, Prediction, SHIPPED_F32, SHIPPED_F64, SKIPPED, Subject, Variable,
};

use crate::Result;
use rungs::{r0, r1, r2, r3, r4};

/// Runs the chosen rungs in order.
///
/// # Errors
/// Errors of the subject; a failed rung is not an error but a report that did not pass.
pub fn run(subject: &dyn Subject, options: &Options) -> Result<Report> {
    let mut rungs = Vec::new();
    let differentiable = !subject.variables().is_empty();
    if options.rungs[0] {
        rungs.push(r0(subject)?);
    }
    if differentiable {
        if options.rungs[1] {
            rungs.push(r1(subject, options)?);
        }
        if options.rungs[2] {
            rungs.push(r2(subject, options)?);
        }
        if options.rungs[3] {
            rungs.push(r3(subject, options)?);
        }
    }
    if options.rungs[4] {
        rungs.push(r4(subject, options)?);
    }
    Ok(Report { subject: subject.name(), rungs })
}
