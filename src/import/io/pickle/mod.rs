//! Python pickles, restricted: returns plain values and NumPy arrays, never runs code.
//!
//! A pickle is a program for a stack machine; Python's own reader imports and calls what the program names.
//! This reader interprets the opcodes of protocols 0 to 5 on plain nodes, and accepts a fixed list of names
//! ([`NAMES`]) for which it builds values itself. A pickle that names anything else is refused with that
//! name, before anything is built for it. Names are never imported.
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
//! Payloads are slices of the file; every declared length is checked against the bytes that are left before
//! it is used. A file has at most 2²⁴ opcodes and 2²² nodes, and what nodes hold, copies of one payload
//! counted each time, is limited to a multiple of the file's size. Nodes may be shared and refer to
//! themselves; the tree that comes out may be at most 100 deep and its size is limited likewise, matrices
//! written out included, so repeating a list of itself ten times in ten levels ends in an error, not in 10¹⁰
//! values.
//!
//! # Why own code
//! `serde-pickle` reads built-in types only: a global either makes the file fail or is dropped, and an array
//! that was pickled through `_reconstruct` and `BUILD` cannot be put together from what it returns. All files
//! read here (SMPL models, `annots.npy`, `camera.pkl`) consist of such arrays.

mod build;
mod instance;
mod machine;
mod node;
mod opcodes;
mod text;
mod tree;
mod value;

use super::{MAX_FILE_BYTES, name_of, npy, read_bytes};
use crate::Result;
use crate::num::order;
use std::path::Path;

pub use node::NAMES;
pub use value::Value;

/// Reads a pickle.
///
/// # Errors
/// When the file is not readable, malformed, names something outside [`NAMES`], or grows beyond the bounds.
pub fn read(path: &Path) -> Result<Value> {
    parse(&read_bytes(path, MAX_FILE_BYTES)?, &name_of(path))
}

/// Like [`read`] for bytes in memory; `name` is the file name in errors.
///
/// # Errors
/// See [`read`].
pub fn parse(bytes: &[u8], name: &str) -> Result<Value> {
    opcodes::run(bytes, name)
}

/// Reads a `.npy`: numbers as an array, an array of objects through its pickle. An object of rank 0 (what
/// `np.save` makes of a dictionary) comes out as itself.
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
