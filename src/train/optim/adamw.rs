//! Adam with decoupled weight decay: θ ← θ·(1 − lr·w), then the step of [`super::adam`].
//!
//! (Loshchilov & Hutter 2019, alg. 2, with the schedule multiplier inside lr.) Symbols, rounding and domain
//! are those of
//! [`super::adam`], where the decay is one of two compiled into the same kernel. It has no adjoint. Rows that
//! are not active are not decayed either.
//!
//! # Example
//! ```
//! # use lastlight_train as lastlight;
//! use lastlight::optim::{adam::{In, Rule, Settings}, adamw};
//! let rule = Rule { weight_decay: 0.5, ..Rule::default() };
//! let x = In { param: &[2.0], grads: &[0.0, 0.0], active: None, rows: 1, width: 1 };
//! let out = adamw::forward(&x, &Settings { lr: 0.5, rule })?;
//! assert_eq!(out.trajectory, [1.5, 1.125]); // with a zero gradient only the decay acts: a factor 1 − 0.5·0.5 per step
//! # Ok::<(), lastlight::Error>(())
//! ```

use super::adam::{Decay, In, Out, Settings, trajectory};
use crate::Result;

/// S steps from zero moments.
///
/// # Errors
/// Wrong sizes or settings; a result that is not finite.
pub fn forward(x: &In<'_>, settings: &Settings) -> Result<Out> {
    trajectory("optim.adamw", x, settings, Decay::Decoupled)
}
