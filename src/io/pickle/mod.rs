//! Python pickles, restricted: plain values and NumPy arrays come out, nothing is ever run.
//!
//! A pickle is a program for a stack machine; Python's own reader imports and calls what the program names. This reader interprets the
//! opcodes of protocols 0 to 5 on plain nodes, and knows a fixed list of names ([`NAMES`]) for which it builds values itself. A
//! pickle that names anything else is refused with that name, before anything is built for it. No name is ever looked up anywhere.
//!
//! | name in the pickle | what comes out |
//! |---|---|
//! | `numpy.core.multiarray._reconstruct` with `numpy.ndarray`, `numpy.dtype`; `…_frombuffer` | an array |
//! | `numpy.core.multiarray.scalar` | a number |
//! | `_codecs.encode` | bytes |
//! | `collections.OrderedDict`, `set`, `frozenset`, `bytes` | a dictionary, a list, bytes |
//! | `chumpy.ch.Ch`, `chumpy.reordering.Select` (through `copy_reg._reconstructor`) | the array it holds |
//! | `scipy.sparse.csc.csc_matrix` | a dense array |
//!
//! # Bounds
//! Payloads are slices of the file; every declared length is checked against the bytes that are left before it is used. A file has at most 2²⁴
//! opcodes and 2²² nodes, and what nodes hold, copies of one payload counted each time, is limited to a multiple of the file's size. Nodes may
//! be shared and refer to themselves; the tree that comes out may be at most 100 deep and its size is limited likewise, matrices written out
//! included, so repeating a list of itself ten times in ten levels ends in an error, not in 10¹⁰ values.
//!
//! # Why own code
//! `serde-pickle` reads built-in types only: a global either fails the whole file or becomes nothing, and an array that was pickled through
//! `_reconstruct` and `BUILD` cannot be put together from what it returns. All files read here (SMPL models, `annots.npy`,
//! `camera.pkl`) consist of such arrays.

mod build;
mod instance;
mod machine;

use super::{MAX_FILE_BYTES, name_of, npy, read_bytes};
use crate::num::array::Array;
use crate::num::order;
use crate::{Error, Result};
use std::path::Path;

pub use build::NAMES;

/// What a pickle holds.
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
    /// What it is, for messages.
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

/// Reads a pickle.
///
/// # Errors
/// When the file is not readable, malformed, names something outside [`NAMES`], or grows beyond the bounds.
pub fn read(path: &Path) -> Result<Value> {
    parse(&read_bytes(path, MAX_FILE_BYTES)?, &name_of(path))
}

/// Like [`read`] for bytes in memory; `name` stands for the file.
///
/// # Errors
/// See [`read`].
pub fn parse(bytes: &[u8], name: &str) -> Result<Value> {
    machine::run(bytes, name)
}

/// Reads a `.npy`: numbers as an array, an array of objects through its pickle. An object of rank 0 (what `np.save` makes of a dictionary) comes out
/// as itself.
///
/// # Errors
/// See [`read`].
pub fn read_npy(path: &Path) -> Result<Value> {
    parse_npy(&read_bytes(path, MAX_FILE_BYTES)?, &name_of(path))
}

/// Like [`read_npy`] for bytes in memory.
///
/// # Errors
/// See [`read`].
pub fn parse_npy(bytes: &[u8], name: &str) -> Result<Value> {
    let (before, len) = npy::prefix(&bytes[..order::min(12, bytes.len())], name)?;
    let text = bytes.get(before..before + len).unwrap_or_default();
    let of_objects = String::from_utf8_lossy(text).split_whitespace().collect::<String>();
    if !(of_objects.contains("'descr':'|O'") || of_objects.contains("'descr':'O'")) {
        return npy::parse(bytes, name).map(Value::Array);
    }
    match parse(&bytes[before + len..], name)? {
        Value::Objects(shape, mut entries) if shape.is_empty() && entries.len() == 1 => Ok(entries.remove(0)),
        other => Ok(other),
    }
}
