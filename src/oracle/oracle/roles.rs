//! The arrays of a user-supplied program, by what they are.

use super::compare::unravel;
use super::names::{UNNAMED, guess, is_known, is_unnamed, meant};
use crate::num::array::{Array, Arrays};
use crate::ops::{Op, Port};
use std::collections::BTreeMap;

/// What is wrong with the shape or the values of an array, which has the shape of `like`.
pub(super) fn fault(name: &str, array: &Array, like: (&str, &[usize])) -> Option<String> {
    let (of, shape) = like;
    if array.shape() != shape {
        return Some(format!("{name} has shape {:?}, but {of} has {shape:?}", array.shape()));
    }
    let values = array.to_f64();
    let i = values.iter().position(|x| !x.is_finite())?;
    Some(format!("{name}{:?} is {}", unravel(i, shape), values[i]))
}

/// The arrays of a program, by what they are.
pub(super) struct Roles {
    /// outputs with a cotangent in `IN.npz`, by name; the array is the cotangent
    pub(super) outputs: BTreeMap<String, Array>,
    /// inputs that it differentiates
    pub(super) inputs: Vec<String>,
    /// what is missing, unknown or malformed
    pub(super) failures: Vec<String>,
    /// outputs without a cotangent
    pub(super) unchecked: Vec<String>,
    /// what is not checked because an operator of the list does not have it, as lines of text
    pub(super) notes: Vec<String>,
    /// names of the gradients to check instead, if some inputs have none
    pub(super) hint: Option<String>,
}

impl Roles {
    /// Sorts the arrays of `IN.npz` and of the first `OUT.npz`; `op` is the operator whose case `IN.npz` is.
    pub(super) fn new(input: &Arrays, out: &Arrays, wrt: &[String], op: Option<&Op>) -> Self {
        let bar_of = |name: &str| name.strip_suffix("_bar").map(str::to_owned);
        let has = |name: &str| input.get(name).is_some();
        let mut failures = Vec::new();
        // x_bar next to an input x is a gradient, as in files of `oracle mint`.
        let cotangents: Vec<String> =
            input.0.keys().filter_map(|n| bar_of(n)).filter(|y| out.get(y).is_some() || !has(y)).collect();
        let is_input = |name: &String| {
            input.get(name).is_some_and(Array::is_float)
                && bar_of(name).is_none()
                && !name.starts_with("setting_")
                && out.get(name).is_none()
                && op.is_none_or(|op| has_port(op.inputs, name))
        };
        // Inputs without a gradient by the operator's signature are not checked.
        let is_constant = |name: &str| {
            op.is_some_and(|op| !op.smooth_inputs().contains(&name))
                && out.get(&format!("{name}_bar")).is_none()
        };
        let inputs: Vec<String> = match wrt {
            [] => input.0.keys().filter(|n| is_input(n) && !is_constant(n)).cloned().collect(),
            names => names.to_vec(),
        };
        let (lacking, written): (Vec<_>, Vec<_>) = cotangents.into_iter().partition(|y| out.get(y).is_none());
        let gradients = inputs.iter().map(|x| format!("{x}_bar"));
        let absent: Vec<String> = gradients.filter(|g| out.get(g).is_none()).collect();
        let stray: Vec<&String> = (out.0.keys())
            .filter(|n| !written.contains(n) && !has(n) && !bar_of(n).is_some_and(|x| has(&x)))
            .collect();
        for name in &lacking {
            failures.push(format!("no output {name}: IN.npz contains {name}_bar, but OUT.npz no {name}"));
        }
        for name in &absent {
            let x = name.strip_suffix("_bar").unwrap_or(name);
            failures.push(format!("no gradient of {x}: OUT.npz contains no {name}"));
        }
        let wanted: Vec<String> = lacking.into_iter().chain(absent).collect();
        let mut unchecked = Vec::new();
        for name in stray {
            match meant(name, &wanted) {
                Some(close) => {
                    failures.push(format!("unknown name {name} in OUT.npz: did you mean {close}?"))
                }
                None if is_unnamed(name) => {
                    failures.push(format!("unknown name {name} in OUT.npz: {UNNAMED}"))
                }
                None if bar_of(name).is_some() => failures.push(format!(
                    "unknown name {name} in OUT.npz: IN.npz contains no {}",
                    name.strip_suffix("_bar").unwrap_or(name)
                )),
                None => unchecked.push(name.clone()),
            }
        }
        let outputs: BTreeMap<String, Array> = written
            .into_iter()
            .filter_map(|y| Some((y.clone(), input.get(&format!("{y}_bar"))?.clone())))
            .collect();
        for (y, bar) in &outputs {
            let like = format!("{y}_bar");
            failures.extend(out.get(y).and_then(|a| fault(y, a, (&like, bar.shape()))));
        }
        for x in &inputs {
            let name = format!("{x}_bar");
            let (Some(g), Some(like)) = (out.get(&name), input.get(x)) else { continue };
            failures.extend(fault(&name, g, (x, like.shape())));
        }
        let mut notes = Vec::new();
        if let Some(op) = op.filter(|_| wrt.is_empty()) {
            let constant: Vec<&str> =
                input.0.keys().filter(|n| is_input(n) && is_constant(n)).map(String::as_str).collect();
            if !constant.is_empty() {
                let names = constant.join(", ");
                notes.push(format!("not checked, inputs of {} without a gradient: {names}", op.name));
            }
            let absent =
                |y: &&Port| input.get(&format!("{}_bar", y.name)).is_some() && out.get(y.name).is_none();
            let absent: Vec<&str> = op.outputs.iter().filter(absent).map(|y| y.name).collect();
            if !absent.is_empty() {
                notes.push(format!("not checked, not written by the program: {}", absent.join(", ")));
            }
        }
        let hint = (failures.iter().any(|f| f.starts_with("no gradient of")))
            .then(|| inputs.iter().filter(|x| out.get(&format!("{x}_bar")).is_some()))
            .and_then(|written| wrt_hint(written));
        Self { outputs, inputs, failures, unchecked, notes, hint }
    }
}

/// Whether a list of ports has this name.
fn has_port(ports: &[Port], name: &str) -> bool {
    ports.iter().any(|p| p.name == name)
}

/// The operator of the list whose case a file is, such as one that `oracle mint` wrote: it has every array of
/// the file, and the file has its inputs. `writer`: the operator that the name of the file states.
pub(super) fn operator(input: &Arrays, out: &Arrays, writer: Option<String>) -> Option<&'static Op> {
    let names = |arrays: &Arrays| arrays.0.keys().cloned().collect::<Vec<_>>();
    let hints: Vec<String> = writer.into_iter().collect();
    let op = guess(&names(input), &names(out), &hints).op?;
    let has = |p: &Port| p.optional || input.get(p.name).is_some();
    (input.0.keys().all(|name| is_known(op, name)) && op.inputs.iter().all(has)).then_some(op)
}

/// How to check the gradients of these inputs only.
pub(super) fn wrt_hint<'a>(names: impl Iterator<Item = &'a String>) -> Option<String> {
    let names: Vec<&str> = names.map(String::as_str).collect();
    (!names.is_empty()).then(|| {
        let these = if names.len() == 1 { "this gradient" } else { "these gradients" };
        format!("--wrt {} checks {these} only", names.join(","))
    })
}
