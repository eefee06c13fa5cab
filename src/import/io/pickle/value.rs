//! Contents of a pickle, as plain values.

use crate::num::array::Array;
use crate::{Error, Result};

/// A value of a pickle.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// `None`
    None,
    /// `True`, `False`
    Bool(bool),
    /// an integer of at most 64 bits
    Int(i64),
    /// a float
    Float(f64),
    /// text; strings of Python 2 that are UTF-8
    Text(String),
    /// bytes; other strings of Python 2
    Bytes(Vec<u8>),
    /// a list, or a set
    List(Vec<Value>),
    /// a tuple
    Tuple(Vec<Value>),
    /// a dictionary, in its order; the last of equal keys counts
    Dict(Vec<(Value, Value)>),
    /// an array of numbers
    Array(Array),
    /// an array of objects or of text: shape, and entries row-major
    Objects(Vec<usize>, Vec<Value>),
    /// an array of elements that are not read (bytes, complex numbers, records), described
    Unread(String),
}

impl Value {
    /// Description for messages.
    pub fn describe(&self) -> String {
        match self {
            Self::None => "None".into(),
            Self::Bool(b) => format!("{b}"),
            Self::Int(i) => format!("the integer {i}"),
            Self::Float(x) => format!("the number {x}"),
            Self::Text(t) => format!("the text '{}'", t.chars().take(40).collect::<String>()),
            Self::Bytes(b) => format!("{} bytes", b.len()),
            Self::List(l) => format!("a list of {}", l.len()),
            Self::Tuple(l) => format!("a tuple of {}", l.len()),
            Self::Dict(d) => {
                let keys: Vec<String> = d
                    .iter()
                    .take(12)
                    .map(|(k, _)| match k {
                        Self::Text(t) => t.clone(),
                        other => other.describe(),
                    })
                    .collect();
                format!("a dictionary of {}", keys.join(", "))
            }
            Self::Array(a) => format!("an array of shape {:?}", a.shape()),
            Self::Objects(shape, _) => format!("an array of objects of shape {shape:?}"),
            Self::Unread(what) => what.clone(),
        }
    }

    /// The entry of a dictionary under a text key.
    pub fn get(&self, key: &str) -> Option<&Value> {
        let Self::Dict(d) = self else { return None };
        d.iter().rev().find(|(k, _)| matches!(k, Self::Text(t) if t == key)).map(|(_, v)| v)
    }

    /// [`Self::get`], or an error that names the file and the key.
    ///
    /// # Errors
    /// When this is no dictionary with that key.
    pub fn need(&self, key: &str, name: &str) -> Result<&Value> {
        self.get(key).ok_or_else(|| {
            Error::input(name).at(format!("key '{key}'")).expected("to be there").got(self.describe())
        })
    }

    /// The entries of a list, a tuple, or an array of objects.
    pub fn items(&self) -> Option<&[Value]> {
        match self {
            Self::List(l) | Self::Tuple(l) | Self::Objects(_, l) => Some(l),
            _ => None,
        }
    }

    /// Numbers as an array: itself, a number (rank 0), or nested lists of one length each.
    pub fn to_array(&self) -> Option<Array> {
        let number = |v: &Value| match v {
            Self::Bool(b) => Some(f64::from(u8::from(*b))),
            Self::Int(i) => Some(*i as f64),
            Self::Float(x) => Some(*x),
            _ => None,
        };
        if let Self::Array(a) = self {
            return Some(a.clone());
        }
        if let Some(x) = number(self) {
            return Some(Array::new(&[], vec![x]));
        }
        let rows: Vec<Array> = self.items()?.iter().map(Self::to_array).collect::<Option<_>>()?;
        let first = rows.first()?.shape().to_vec();
        if rows.iter().any(|r| r.shape() != first) {
            return None;
        }
        let shape: Vec<usize> = std::iter::once(rows.len()).chain(first).collect();
        Array::of_shape(&shape, rows.iter().flat_map(Array::to_f64).collect())
    }

    /// Numbers of an entry, finite, with their shape.
    ///
    /// # Errors
    /// When the key is missing, holds no numbers, or one that is not finite.
    pub fn numbers(&self, key: &str, name: &str) -> Result<(Vec<usize>, Vec<f64>)> {
        let v = self.need(key, name)?;
        let wrong =
            |got: String| Error::input(name).at(format!("key '{key}'")).expected("finite numbers").got(got);
        let a = v.to_array().ok_or_else(|| wrong(v.describe()))?;
        let values = a.to_f64();
        if let Some(i) = values.iter().position(|x| !x.is_finite()) {
            return Err(wrong(format!("{} at {i}", values[i])));
        }
        Ok((a.shape().to_vec(), values))
    }
}
