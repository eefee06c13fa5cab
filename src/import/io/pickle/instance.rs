//! Objects of known classes: the array that each holds.

use super::node::Class;
use super::value::Value;
use crate::num::array::Array;
use crate::{Error, Result};

/// Largest dense matrix made from a sparse one, in elements.
const MAX_DENSE: usize = 1 << 22;

/// The array that an object holds.
pub(super) fn instance(class: Class, state: &Value) -> Result<Value> {
    let array = |key: &str| -> Result<Array> {
        let v = state.need(key, &format!("{class:?}"))?;
        v.to_array().ok_or_else(|| {
            Error::input(format!("{class:?}"))
                .at(format!("key '{key}'"))
                .expected("numbers")
                .got(v.describe())
        })
    };
    match class {
        Class::Ch => array("x").map(Value::Array),
        Class::Select => {
            let (from, at) = (array("a")?.to_f64(), array("idxs")?);
            let at = at.to_i64().unwrap_or_default();
            let picked: Option<Vec<f64>> =
                at.iter().map(|&i| usize::try_from(i).ok().and_then(|i| from.get(i).copied())).collect();
            let picked = picked.ok_or_else(|| {
                Error::input("Select").expected(format!("indices below {}", from.len())).got("another")
            })?;
            let shape = match state.get("preferred_shape").and_then(Value::to_array).and_then(|a| a.to_i64())
            {
                Some(s) => s,
                None => vec![picked.len() as i64],
            };
            let count = picked.len();
            let sides: Option<Vec<usize>> = shape.iter().map(|&d| usize::try_from(d).ok()).collect();
            sides.and_then(|sides| Array::of_shape(&sides, picked)).map(Value::Array).ok_or_else(|| {
                Error::input("Select").expected(format!("shape {shape:?}")).got(count.to_string())
            })
        }
        _ => dense(&array("data")?, &array("indices")?, &array("indptr")?, state),
    }
}

/// Compressed columns written out; repeated entries add up in their order.
fn dense(data: &Array, indices: &Array, starts: &Array, state: &Value) -> Result<Value> {
    let wrong = |expected: &str, got: String| Error::input("csc_matrix").expected(expected).got(got);
    let shape =
        state.get("_shape").or_else(|| state.get("shape")).and_then(Value::to_array).and_then(|a| a.to_i64());
    let Some([rows, columns]) = shape.as_deref().and_then(|s| <[i64; 2]>::try_from(s).ok()) else {
        return Err(wrong("a shape of two sides", format!("{shape:?}")));
    };
    let side = |d: i64| usize::try_from(d).ok();
    let size = side(rows).zip(side(columns)).and_then(|(r, c)| Some((r, c, r.checked_mul(c)?)));
    let Some((rows, columns, size)) = size.filter(|s| s.2 <= MAX_DENSE) else {
        return Err(wrong("at most 2^22 elements", format!("{rows}x{columns}")));
    };
    let (data, indices, starts) = (data.to_f64(), indices.to_i64(), starts.to_i64());
    let (Some(indices), Some(starts)) = (indices, starts) else {
        return Err(wrong("integer indices", "fractions".into()));
    };
    let is_sound = starts.len() == columns + 1
        && starts.first() == Some(&0)
        && starts.last() == Some(&(data.len() as i64))
        && starts.windows(2).all(|w| w[0] <= w[1])
        && indices.len() == data.len()
        && indices.iter().all(|&i| i >= 0 && (i as usize) < rows);
    if !is_sound {
        return Err(wrong(
            "columns that fit the shape",
            format!("{} entries for {rows}x{columns}", data.len()),
        ));
    }
    let mut out = vec![0.0; size];
    for column in 0..columns {
        for e in starts[column] as usize..starts[column + 1] as usize {
            out[indices[e] as usize * columns + column] += data[e];
        }
    }
    Ok(Value::Array(Array::new(&[rows, columns], out)))
}
