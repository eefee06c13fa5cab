//! `nn.softmax`: the softmax of ln w + x of every row.
//!
//! y(i,j) = w(i,j) e^{x(i,j)} / Σₖ w(i,k) e^{x(i,k)},   w = base + floor, or 1 without a base
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | x | `x` | (M, K) |
//! | | `base` | (M, K), optional |
//! | | setting `floor` | () |
//! | y | `y` | (M, K) |
//!
//! # Rounding
//! The value of the largest x with w > 0 is subtracted first.
//!
//! # Kinks and domain
//! No kinks. w ≥ 0. A row whose w are all 0 is 0 and has no gradient.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `nn.softmax`.
    pub struct In<'a, S> {
        x: &'a Arr<S> = Port::var("M,K", "logits"),
        base: Option<&'a Arr<S>> = Port::fixed("M,K", "prior weights w; absent: all 1"),
    }
}

/// `nn.softmax`
pub static SIGNATURE: Signature = Signature {
    name: "nn.softmax",
    summary: "softmax of every row, optionally with prior weights",
    inputs: In::<f64>::PORTS,
    outputs: ports![y: Port::var("M,K", "rows sum to 1, or to 0 without a weight")],
    settings: &[SettingSpec::number("floor", "0", "added to every entry of base")],
    ..Signature::EMPTY
};

/// The twin of `nn.softmax`.
pub fn forward<S: Scalar>(input: &In<'_, S>, floor: f64, out: &mut Out<'_, S>) {
    let In { x, base } = *input;
    let [m, k] = [x.shape[0], x.shape[1]];
    let y = out.array("y", &[m, k]);
    for i in 0..m {
        let row = i * k..(i + 1) * k;
        let weight = |at: usize| base.map_or(S::one(), |base| base.data[at] + floor);
        let most = row.clone().filter(|&at| weight(at).value() > 0.0).map(|at| x.data[at].value());
        let most = most.fold(f64::NEG_INFINITY, |most, x| if x > most { x } else { most });
        if most == f64::NEG_INFINITY {
            row.for_each(|at| out.put(y, at, S::zero()));
            out.flush();
            continue;
        }
        let part = |at: usize| match weight(at) {
            w if w.value() == 0.0 => S::zero(),
            w => w * (x.data[at] - S::from_f64(most)).exp(),
        };
        let parts: Vec<S> = row.clone().map(part).collect();
        let total = parts.iter().fold(S::zero(), |sum, part| sum + *part);
        for (at, part) in row.zip(parts) {
            out.put(y, at, part / total);
        }
        out.flush();
    }
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, call.settings.number("floor"), out);
    Ok(())
}
