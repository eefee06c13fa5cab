//! `causal.held`: the values at which the factors of counterfactuals are held.
//!
//! h_p = v_g, or h_p = u_p,i, where g is the group of pair p and i its target.
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | v | `shared` | (G, k), or `factors` |
//! | u | `factors` | (P, n, k), or `shared` |
//! | i | `target` | (G) |
//! | M | `members` | () pairs of a group |
//! | h | `held` | (P, k), P = G·M |

use crate::array::{Arr, Out};
use crate::causal::code::factor;
use crate::inputs::{inputs, required};
use crate::ports::{Dtype, Port, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `causal.held`.
    pub struct In<'a, S> {
        shared: Option<&'a Arr<S>> = Port::var("G,K", "a value for each group; or factors"),
        factors: Option<&'a Arr<S>> = Port::var("P,N,K", "factors of each pair; or shared"),
        target: &'a Arr<S> = Port::int("G", Dtype::I32, "the factor that is set; read with factors"),
        members: &'a Arr<S> = Port::int("", Dtype::I32, "pairs of a group"),
    }
}

/// `causal.held`
pub static SIGNATURE: Signature = Signature {
    name: "causal.held",
    summary: "the values at which the factors of counterfactuals are held",
    inputs: In::<f64>::PORTS,
    outputs: ports![held: Port::var("P,K", "")],
    ..Signature::EMPTY
};

/// The twin of `causal.held`.
///
/// # Errors
/// When both are absent or present, their shape does not match the groups, or a target is not a factor.
pub fn forward<S: Scalar>(input: &In<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let members = input.members.data[0].value() as usize;
    let groups = input.target.data.len();
    let k = match (input.shared, input.factors) {
        (Some(shared), None) => shared.shape[1],
        (None, Some(factors)) if factors.shape[0] == groups * members => factors.shape[2],
        _ => {
            return Err("inputs shared, factors: expected exactly one of them, with entries for every group"
                .to_owned());
        }
    };
    let held = out.array("held", &[groups * members, k]);
    for pair in 0..groups * members {
        let g = pair / members;
        for c in 0..k {
            let x = match input.shared {
                Some(shared) => shared.data[g * k + c],
                None => {
                    let factors = required("factors", input.factors)?;
                    let n = factors.shape[1];
                    factors.data[(pair * n + factor(input.target.data[g], n)?) * k + c]
                }
            };
            out.put(held, pair * k + c, x);
        }
        out.flush();
    }
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or as [`forward`].
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, out)
}
