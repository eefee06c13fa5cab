//! `loss.variation`: squared differences of neighbouring texels.
//!
//! value = (1/N) Σ [(x[p, i+1, j, c] − x[p, i, j, c])² + (x[p, i, j+1, c] − x[p, i, j, c])²]
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | x | `planes` | (P, H, W, C) |
//! | N | number of entries | () |
//! | | `value` | () |
//!
//! # Rounding
//! A left fold over planes, rows, columns, channels, then one division.
//!
//! # Kinks and domain
//! Smooth. At least one entry.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `loss.variation`.
    pub struct In<'a, S> {
        planes: &'a Arr<S> = Port::var("P,H,W,C", "feature planes, or a map"),
    }
}

/// `loss.variation`
pub static SIGNATURE: Signature = Signature {
    name: "loss.variation",
    summary: "mean squared difference of neighbouring texels",
    inputs: In::<f64>::PORTS,
    outputs: ports![value: Port::var("", "mean over the entries of the squared differences to the entries below and to the right")],
    settings: &[SettingSpec::choice(
        "columns",
        &["open", "periodic"],
        "open",
        "whether the last column is a neighbour of the first",
    )],
    ..Signature::EMPTY
};

/// The twin of `loss.variation`.
///
/// # Errors
/// When there is no entry.
pub fn forward<S: Scalar>(input: &In<'_, S>, is_periodic: bool, out: &mut Out<'_, S>) -> Result<(), String> {
    let x = input.planes;
    let [planes, rows, columns, channels] = [x.shape[0], x.shape[1], x.shape[2], x.shape[3]];
    let entries = planes * rows * columns * channels;
    if entries == 0 {
        return Err("input planes: expected at least one entry, got none".to_owned());
    }
    let at = |p: usize, i: usize, j: usize, c: usize| x.data[((p * rows + i) * columns + j) * channels + c];
    let value = out.array("value", &[]);
    for p in 0..planes {
        for i in 0..rows {
            for j in 0..columns {
                for c in 0..channels {
                    if i + 1 < rows {
                        let d = at(p, i + 1, j, c) - at(p, i, j, c);
                        out.add(value, 0, d * d, entries as f64);
                    }
                    if j + 1 < columns || is_periodic {
                        let d = at(p, i, (j + 1) % columns, c) - at(p, i, j, c);
                        out.add(value, 0, d * d, entries as f64);
                    }
                }
                out.flush();
            }
        }
    }
    out.divide(value, 0, entries as f64);
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When the input is missing or has the wrong shape, or has no entry.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, call.settings.word("columns") == "periodic", out)
}
