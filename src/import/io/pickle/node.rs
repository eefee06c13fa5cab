//! Values on the stack of the machine (nodes), and the list of accepted names.

use super::value::Value;
use crate::num::array::Array;
use crate::{Error, Result};

/// Index of a node.
pub(super) type Id = u32;

/// An error inside a step of the machine, which adds file and byte.
pub(super) fn wrong(expected: impl Into<String>, got: impl Into<String>) -> Error {
    Error::input("pickle").expected(expected).got(got)
}

/// An accepted name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Class {
    Reconstruct,
    FromBuffer,
    Ndarray,
    Dtype,
    Scalar,
    Encode,
    OrderedDict,
    Reconstructor,
    Object,
    EmptyBytes,
    Set,
    Ch,
    Select,
    Csc,
}

/// Every name that a pickle may contain: module and name. The reader builds the value of each itself.
pub const NAMES: [(&str, &str); 27] = [
    ("numpy.core.multiarray", "_reconstruct"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("numpy.core.multiarray", "scalar"),
    ("numpy._core.multiarray", "scalar"),
    ("numpy.core.numeric", "_frombuffer"),
    ("numpy._core.numeric", "_frombuffer"),
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
    ("_codecs", "encode"),
    ("collections", "OrderedDict"),
    ("copy_reg", "_reconstructor"),
    ("copyreg", "_reconstructor"),
    ("__builtin__", "object"),
    ("builtins", "object"),
    ("__builtin__", "bytes"),
    ("builtins", "bytes"),
    ("__builtin__", "set"),
    ("builtins", "set"),
    ("__builtin__", "frozenset"),
    ("builtins", "frozenset"),
    ("chumpy.ch", "Ch"),
    ("chumpy", "Ch"),
    ("chumpy.reordering", "Select"),
    ("scipy.sparse.csc", "csc_matrix"),
    ("scipy.sparse._csc", "csc_matrix"),
    ("scipy.sparse", "csc_matrix"),
    ("scipy.sparse._csc", "csc_array"),
];

impl Class {
    /// Meaning of a name.
    pub(super) fn named(module: &str, name: &str) -> Result<Self> {
        if !NAMES.contains(&(module, name)) {
            let shown: String = format!("{module}.{name}").chars().take(120).collect();
            return Err(Error::input("pickle")
                .expected("arrays and plain values only")
                .got(format!("the name {shown}"))
                .hint("it is not on the list of names that are read; nothing was run"));
        }
        Ok(match name {
            "_reconstruct" => Self::Reconstruct,
            "_frombuffer" => Self::FromBuffer,
            "ndarray" => Self::Ndarray,
            "dtype" => Self::Dtype,
            "scalar" => Self::Scalar,
            "encode" => Self::Encode,
            "OrderedDict" => Self::OrderedDict,
            "_reconstructor" => Self::Reconstructor,
            "object" => Self::Object,
            "bytes" => Self::EmptyBytes,
            "set" | "frozenset" => Self::Set,
            "Ch" => Self::Ch,
            "Select" => Self::Select,
            _ => Self::Csc,
        })
    }
}

/// A value on the stack.
#[derive(Debug)]
pub(super) enum Node<'a> {
    None,
    Bool(bool),
    Int(i64),
    Float(f64),
    Text(String),
    /// A string of Python 2, in the file.
    Str(&'a [u8]),
    /// One with escapes resolved.
    Made(Vec<u8>),
    Bytes(&'a [u8]),
    /// Bytes that were written as text.
    Encoded(Vec<u8>),
    List(Vec<Id>),
    Tuple(Vec<Id>),
    Dict(Vec<(Id, Id)>),
    Global(Class),
    Dtype {
        descr: String,
        endian: u8,
    },
    /// An array whose state is still to come.
    Shell,
    Array(Array),
    Objects(Vec<usize>, Vec<Id>),
    /// An array of text.
    Texts(Vec<usize>, Vec<String>),
    Unread(String),
    Instance(Class, Option<Id>),
}

impl Node<'_> {
    /// Bytes of the references to others.
    pub(super) fn references(&self) -> usize {
        match self {
            Self::List(ids) | Self::Tuple(ids) | Self::Objects(_, ids) => size_of_val(&ids[..]),
            Self::Dict(pairs) => size_of_val(&pairs[..]),
            _ => 0,
        }
    }

    /// Bytes it holds itself.
    pub(super) fn payload(&self) -> usize {
        match self {
            Self::Text(t) => t.len(),
            Self::Str(b) | Self::Bytes(b) => b.len(),
            Self::Made(b) | Self::Encoded(b) => b.len(),
            Self::Array(a) => 8 * a.len(),
            Self::Texts(_, t) => t.iter().fold(0, |n, t| n + t.len() + size_of::<Value>()),
            _ => 0,
        }
    }
}
