//! Nodes, the list of names, and what is built for each of them.

use super::Value;
use super::machine::{Id, Machine};
use crate::io::npy;
use crate::num::array::Array;
use crate::{Error, Result};

/// A name that is known.
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

/// Every name that a pickle may contain: module and name. Each stands for a value this reader makes itself.
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
    /// What a name stands for.
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

/// What lies on the stack.
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

/// A string of Python 2: text if it is UTF-8.
pub(super) fn string(bytes: &[u8]) -> Value {
    match std::str::from_utf8(bytes) {
        Ok(t) => Value::Text(t.to_owned()),
        Err(_) => Value::Bytes(bytes.to_vec()),
    }
}

/// Keys and values in turn.
pub(super) fn pairs(items: &[Id]) -> Result<Vec<(Id, Id)>> {
    if !items.len().is_multiple_of(2) {
        return Err(Machine::wrong("keys and values in turn", format!("{} values", items.len())));
    }
    Ok(items.as_chunks::<2>().0.iter().map(|&[k, v]| (k, v)).collect())
}

/// The bytes of a quoted string of Python 2.
pub(super) fn unquoted(line: &[u8]) -> Result<Vec<u8>> {
    let line = line.trim_ascii();
    let bad = || {
        Machine::wrong(
            "a quoted string",
            String::from_utf8_lossy(&line[..crate::num::order::min(line.len(), 40)]),
        )
    };
    let (Some(&quote @ (b'\'' | b'"')), true) = (line.first(), line.len() >= 2) else { return Err(bad()) };
    if line[line.len() - 1] != quote {
        return Err(bad());
    }
    let inner = &line[1..line.len() - 1];
    let mut out = Vec::with_capacity(inner.len());
    let mut i = 0;
    while i < inner.len() {
        if inner[i] != b'\\' {
            out.push(inner[i]);
            i += 1;
            continue;
        }
        let code = *inner.get(i + 1).ok_or_else(bad)?;
        i += 2;
        match code {
            b'n' => out.push(b'\n'),
            b't' => out.push(b'\t'),
            b'r' => out.push(b'\r'),
            b'a' => out.push(7),
            b'b' => out.push(8),
            b'f' => out.push(12),
            b'v' => out.push(11),
            b'\\' | b'\'' | b'"' => out.push(code),
            b'x' => {
                let digits = inner.get(i..i + 2).and_then(|d| std::str::from_utf8(d).ok()).ok_or_else(bad)?;
                out.push(u8::from_str_radix(digits, 16).map_err(|_| bad())?);
                i += 2;
            }
            b'0'..=b'7' => {
                let mut x = u32::from(code - b'0');
                for _ in 0..2 {
                    let Some(d @ b'0'..=b'7') = inner.get(i) else { break };
                    x = 8 * x + u32::from(d - b'0');
                    i += 1;
                }
                out.push(u8::try_from(x).map_err(|_| bad())?);
            }
            other => out.extend([b'\\', other]),
        }
    }
    Ok(out)
}

/// Text with `\u0000` and `\U00000000`.
pub(super) fn unescaped(line: &str) -> Result<String> {
    let bad = || Machine::wrong("text with \\u escapes", line.chars().take(40).collect::<String>());
    let mut out = String::with_capacity(line.len());
    let mut rest = line;
    while let Some(at) = rest.find('\\') {
        out.push_str(&rest[..at]);
        let digits = match rest.as_bytes().get(at + 1) {
            Some(b'u') => 4,
            Some(b'U') => 8,
            _ => {
                out.push('\\');
                rest = &rest[at + 1..];
                continue;
            }
        };
        let hex = rest.get(at + 2..at + 2 + digits).ok_or_else(bad)?;
        let code = u32::from_str_radix(hex, 16).ok().and_then(char::from_u32).ok_or_else(bad)?;
        out.push(code);
        rest = &rest[at + 2 + digits..];
    }
    out.push_str(rest);
    Ok(out)
}

impl<'a> Machine<'a> {
    fn node(&self, id: Id) -> &Node<'a> {
        &self.nodes[id as usize]
    }

    fn tuple(&self, id: Id) -> Result<&[Id]> {
        match self.node(id) {
            Node::Tuple(items) => Ok(items),
            _ => Err(Self::wrong("a tuple of arguments", "another value")),
        }
    }

    fn bytes_of(&self, id: Id) -> Option<&[u8]> {
        match self.node(id) {
            Node::Str(b) | Node::Bytes(b) => Some(b),
            Node::Made(b) | Node::Encoded(b) => Some(b),
            _ => None,
        }
    }

    fn word(&self, id: Id) -> Result<String> {
        match self.node(id) {
            Node::Text(t) => Ok(t.clone()),
            _ => {
                let b = self.bytes_of(id).ok_or_else(|| Self::wrong("text", "another value"))?;
                Ok(String::from_utf8_lossy(b).into_owned())
            }
        }
    }

    /// What a call of a known name gives.
    pub(super) fn call(&mut self, class: Id, args: Id) -> Result<Node<'a>> {
        let Node::Global(class) = *self.node(class) else {
            return Err(Self::wrong("a known name to call", "another value"));
        };
        let args = self.tuple(args)?.to_vec();
        self.charge(size_of_val(&args[..]))?;
        let usage = |got: usize| Self::wrong(format!("the usual arguments of {class:?}"), format!("{got}"));
        match class {
            Class::Reconstruct => match args.first().map(|&a| self.node(a)) {
                Some(Node::Global(Class::Ndarray)) => Ok(Node::Shell),
                _ => Err(Self::wrong("an ndarray to reconstruct", "another class")),
            },
            Class::Dtype => {
                let descr = self.word(*args.first().ok_or_else(|| usage(0))?)?;
                let (endian, descr) = match descr.as_bytes().first() {
                    Some(&e @ (b'<' | b'>' | b'|' | b'=')) => (e, descr[1..].to_owned()),
                    _ => (b'=', descr),
                };
                Ok(Node::Dtype { descr, endian })
            }
            Class::Scalar => {
                let [dtype, raw] = args[..] else { return Err(usage(args.len())) };
                match self.elements(dtype, &[], false, raw)? {
                    Node::Array(a) if a.is_float() => Ok(Node::Float(a.to_f64()[0])),
                    Node::Array(a) => Ok(Node::Int(a.to_i64().map_or(0, |v| v[0]))),
                    other => Ok(other),
                }
            }
            Class::FromBuffer => {
                let [raw, dtype, shape, order] = args[..] else { return Err(usage(args.len())) };
                let shape = self.shape(shape)?;
                let order = self.word(order)?;
                let fortran = match order.as_str() {
                    "C" => false,
                    "F" => true,
                    _ => return Err(Self::wrong("the order C or F", order)),
                };
                self.elements(dtype, &shape, fortran, raw)
            }
            Class::Encode => {
                let [text, how] = args[..] else { return Err(usage(args.len())) };
                let (text, how) = (self.word(text)?, self.word(how)?);
                if !matches!(how.as_str(), "latin1" | "latin-1" | "iso-8859-1") {
                    return Err(Self::wrong("the encoding latin1", how));
                }
                let bytes: Option<Vec<u8>> = text.chars().map(|c| u8::try_from(u32::from(c)).ok()).collect();
                Ok(Node::Encoded(bytes.ok_or_else(|| Self::wrong("characters below 256", "another"))?))
            }
            Class::OrderedDict => {
                let Some(&list) = args.first() else { return Ok(Node::Dict(Vec::new())) };
                let Node::List(list) = self.node(list) else { return Err(usage(args.len())) };
                let mut out = Vec::with_capacity(list.len());
                for &pair in list {
                    match self.node(pair) {
                        Node::List(p) | Node::Tuple(p) if p.len() == 2 => out.push((p[0], p[1])),
                        _ => return Err(Self::wrong("pairs of key and value", "another value")),
                    }
                }
                Ok(Node::Dict(out))
            }
            Class::Set => match args.first().map(|&a| self.node(a)) {
                None => Ok(Node::List(Vec::new())),
                Some(Node::List(l) | Node::Tuple(l)) => Ok(Node::List(l.clone())),
                Some(_) => Err(Self::wrong("the members of a set", "another value")),
            },
            Class::EmptyBytes if args.is_empty() => Ok(Node::Encoded(Vec::new())),
            Class::Reconstructor => {
                let Some(&first) = args.first() else { return Err(usage(0)) };
                self.instance_of(first)
            }
            Class::Ch | Class::Select | Class::Csc if args.is_empty() => Ok(Node::Instance(class, None)),
            _ => Err(usage(args.len())),
        }
    }

    fn instance_of(&self, class: Id) -> Result<Node<'a>> {
        match self.node(class) {
            Node::Global(c @ (Class::Ch | Class::Select | Class::Csc)) => Ok(Node::Instance(*c, None)),
            Node::Global(Class::OrderedDict) => Ok(Node::Dict(Vec::new())),
            _ => Err(Self::wrong("a class whose instances are read", "another")),
        }
    }

    /// Gives an object its state.
    pub(super) fn build(&mut self, object: Id, state: Id) -> Result<()> {
        let replacement = match self.node(object) {
            Node::Shell => {
                let &[_, shape, dtype, fortran, raw] = self.tuple(state)? else {
                    return Err(Self::wrong("the five parts of an array's state", "others"));
                };
                let fortran = match self.node(fortran) {
                    Node::Bool(b) => *b,
                    Node::Int(i) => *i != 0,
                    _ => return Err(Self::wrong("the order of an array, true or false", "another value")),
                };
                let shape = self.shape(shape)?;
                self.elements(dtype, &shape, fortran, raw)?
            }
            Node::Dtype { descr, .. } => {
                let parts = self.tuple(state)?;
                let endian = parts.get(1).and_then(|&e| self.word(e).ok()).unwrap_or_default();
                let endian = endian.as_bytes().first().copied().unwrap_or(b'=');
                Node::Dtype { descr: descr.clone(), endian }
            }
            Node::Instance(class, _) => Node::Instance(*class, Some(state)),
            // What an OrderedDict says beside its entries.
            Node::Dict(_) => return Ok(()),
            _ => return Err(Self::wrong("an array or a known object to build", "another value")),
        };
        self.charge(replacement.payload() + replacement.references())?;
        self.nodes[object as usize] = replacement;
        Ok(())
    }

    fn shape(&self, id: Id) -> Result<Vec<usize>> {
        let side = |&i: &Id| match self.node(i) {
            Node::Int(n) if *n >= 0 => Ok(*n as usize),
            _ => Err(Self::wrong("a shape of non-negative integers", "another value")),
        };
        match self.node(id) {
            Node::Tuple(items) => items.iter().map(side).collect(),
            Node::Int(_) => Ok(vec![side(&id)?]),
            _ => Err(Self::wrong("the shape of an array", "another value")),
        }
    }

    /// An array from its raw elements.
    fn elements(&self, dtype: Id, shape: &[usize], fortran: bool, raw: Id) -> Result<Node<'a>> {
        let Node::Dtype { descr, endian } = self.node(dtype) else {
            return Err(Self::wrong("an element type", "another value"));
        };
        if descr.starts_with('O') {
            let Node::List(items) = self.node(raw) else {
                return Err(Self::wrong("a list of objects", "another value"));
            };
            let count = shape.iter().try_fold(1usize, |n, &d| n.checked_mul(d));
            if count != Some(items.len()) || fortran && shape.len() > 1 {
                return Err(Self::wrong(format!("objects for shape {shape:?}"), items.len().to_string()));
            }
            return Ok(Node::Objects(shape.to_vec(), items.clone()));
        }
        if let Some(chars) = descr.strip_prefix('U').and_then(|n| n.parse::<usize>().ok()).filter(|n| *n > 0)
        {
            return self.texts(shape, chars, *endian == b'>', fortran, raw);
        }
        if !matches!(descr.as_bytes().first(), Some(b'b' | b'i' | b'u' | b'f')) {
            return Ok(Node::Unread(format!("an array of '{descr}' of shape {shape:?}")));
        }
        let raw = self.bytes_of(raw).ok_or_else(|| Self::wrong("the bytes of an array", "another value"))?;
        let dims: Vec<u64> = shape.iter().map(|&d| d as u64).collect();
        let descr = format!("{}{descr}", char::from(*endian));
        let header = npy::described(&descr, fortran, &dims, "array")?;
        npy::decode(&header, raw, "array").map(Node::Array)
    }
}

impl<'a> Machine<'a> {
    /// An array of text: UTF-32, each element of the same length, padded with zeros.
    fn texts(&self, shape: &[usize], chars: usize, is_big: bool, fortran: bool, raw: Id) -> Result<Node<'a>> {
        let raw = self.bytes_of(raw).ok_or_else(|| Self::wrong("the bytes of an array", "another value"))?;
        let each = chars.checked_mul(4);
        let size = shape.iter().try_fold(each.unwrap_or(0), |n, &d| n.checked_mul(d));
        if each.is_none() || size != Some(raw.len()) || fortran && shape.len() > 1 {
            return Err(Self::wrong(
                format!("{chars} characters each for shape {shape:?}"),
                format!("{} bytes", raw.len()),
            ));
        }
        let character = |b: &[u8; 4]| {
            let code = if is_big { u32::from_be_bytes(*b) } else { u32::from_le_bytes(*b) };
            char::from_u32(code).ok_or_else(|| Self::wrong("text", format!("the code {code:#x}")))
        };
        let text = |element: &[u8]| -> Result<String> {
            let all: String = element.as_chunks::<4>().0.iter().map(character).collect::<Result<_>>()?;
            Ok(all.trim_end_matches('\0').to_owned())
        };
        let texts = raw.chunks_exact(4 * chars).map(text).collect::<Result<_>>()?;
        Ok(Node::Texts(shape.to_vec(), texts))
    }
}
