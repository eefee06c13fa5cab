//! Values built for the names in the list.

use super::machine::Machine;
use super::node::{Class, Id, Node, wrong};
use crate::Result;
use crate::io::npy;

impl<'a> Machine<'a> {
    fn node(&self, id: Id) -> &Node<'a> {
        &self.nodes[id as usize]
    }

    fn tuple(&self, id: Id) -> Result<&[Id]> {
        match self.node(id) {
            Node::Tuple(items) => Ok(items),
            _ => Err(wrong("a tuple of arguments", "another value")),
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
                let b = self.bytes_of(id).ok_or_else(|| wrong("text", "another value"))?;
                Ok(String::from_utf8_lossy(b).into_owned())
            }
        }
    }

    /// Result of calling a known name.
    pub(super) fn call(&mut self, class: Id, args: Id) -> Result<Node<'a>> {
        let Node::Global(class) = *self.node(class) else {
            return Err(wrong("a known name to call", "another value"));
        };
        let args = self.tuple(args)?.to_vec();
        self.charge(size_of_val(&args[..]))?;
        let usage = |got: usize| wrong(format!("the usual arguments of {class:?}"), format!("{got}"));
        match class {
            Class::Reconstruct => match args.first().map(|&a| self.node(a)) {
                Some(Node::Global(Class::Ndarray)) => Ok(Node::Shell),
                _ => Err(wrong("an ndarray to reconstruct", "another class")),
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
                    _ => return Err(wrong("the order C or F", order)),
                };
                self.elements(dtype, &shape, fortran, raw)
            }
            Class::Encode => {
                let [text, how] = args[..] else { return Err(usage(args.len())) };
                let (text, how) = (self.word(text)?, self.word(how)?);
                if !matches!(how.as_str(), "latin1" | "latin-1" | "iso-8859-1") {
                    return Err(wrong("the encoding latin1", how));
                }
                let bytes: Option<Vec<u8>> = text.chars().map(|c| u8::try_from(u32::from(c)).ok()).collect();
                Ok(Node::Encoded(bytes.ok_or_else(|| wrong("characters below 256", "another"))?))
            }
            Class::OrderedDict => {
                let Some(&list) = args.first() else { return Ok(Node::Dict(Vec::new())) };
                let Node::List(list) = self.node(list) else { return Err(usage(args.len())) };
                let mut out = Vec::with_capacity(list.len());
                for &pair in list {
                    match self.node(pair) {
                        Node::List(p) | Node::Tuple(p) if p.len() == 2 => out.push((p[0], p[1])),
                        _ => return Err(wrong("pairs of key and value", "another value")),
                    }
                }
                Ok(Node::Dict(out))
            }
            Class::Set => match args.first().map(|&a| self.node(a)) {
                None => Ok(Node::List(Vec::new())),
                Some(Node::List(l) | Node::Tuple(l)) => Ok(Node::List(l.clone())),
                Some(_) => Err(wrong("the members of a set", "another value")),
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
            _ => Err(wrong("a class whose instances are read", "another")),
        }
    }

    /// Gives an object its state.
    pub(super) fn build(&mut self, object: Id, state: Id) -> Result<()> {
        let replacement = match self.node(object) {
            Node::Shell => {
                let &[_, shape, dtype, fortran, raw] = self.tuple(state)? else {
                    return Err(wrong("the five parts of an array's state", "others"));
                };
                let fortran = match self.node(fortran) {
                    Node::Bool(b) => *b,
                    Node::Int(i) => *i != 0,
                    _ => return Err(wrong("the order of an array, true or false", "another value")),
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
            // Attributes of an OrderedDict besides its entries.
            Node::Dict(_) => return Ok(()),
            _ => return Err(wrong("an array or a known object to build", "another value")),
        };
        self.charge(replacement.payload() + replacement.references())?;
        self.nodes[object as usize] = replacement;
        Ok(())
    }

    fn shape(&self, id: Id) -> Result<Vec<usize>> {
        let side = |&i: &Id| match self.node(i) {
            Node::Int(n) if *n >= 0 => Ok(*n as usize),
            _ => Err(wrong("a shape of non-negative integers", "another value")),
        };
        match self.node(id) {
            Node::Tuple(items) => items.iter().map(side).collect(),
            Node::Int(_) => Ok(vec![side(&id)?]),
            _ => Err(wrong("the shape of an array", "another value")),
        }
    }

    /// An array from its raw elements.
    fn elements(&self, dtype: Id, shape: &[usize], fortran: bool, raw: Id) -> Result<Node<'a>> {
        let Node::Dtype { descr, endian } = self.node(dtype) else {
            return Err(wrong("an element type", "another value"));
        };
        if descr.starts_with('O') {
            let Node::List(items) = self.node(raw) else {
                return Err(wrong("a list of objects", "another value"));
            };
            let count = shape.iter().try_fold(1usize, |n, &d| n.checked_mul(d));
            if count != Some(items.len()) || fortran && shape.len() > 1 {
                return Err(wrong(format!("objects for shape {shape:?}"), items.len().to_string()));
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
        let raw = self.bytes_of(raw).ok_or_else(|| wrong("the bytes of an array", "another value"))?;
        let dims: Vec<u64> = shape.iter().map(|&d| d as u64).collect();
        let descr = format!("{}{descr}", char::from(*endian));
        let header = npy::described(&descr, fortran, &dims, "array")?;
        npy::decode(&header, raw, "array").map(Node::Array)
    }
}

impl<'a> Machine<'a> {
    /// An array of text: UTF-32, each element of the same length, padded with zeros.
    fn texts(&self, shape: &[usize], chars: usize, is_big: bool, fortran: bool, raw: Id) -> Result<Node<'a>> {
        let raw = self.bytes_of(raw).ok_or_else(|| wrong("the bytes of an array", "another value"))?;
        let each = chars.checked_mul(4);
        let size = shape.iter().try_fold(each.unwrap_or(0), |n, &d| n.checked_mul(d));
        if each.is_none() || size != Some(raw.len()) || fortran && shape.len() > 1 {
            return Err(wrong(
                format!("{chars} characters each for shape {shape:?}"),
                format!("{} bytes", raw.len()),
            ));
        }
        let character = |b: &[u8; 4]| {
            let code = if is_big { u32::from_be_bytes(*b) } else { u32::from_le_bytes(*b) };
            char::from_u32(code).ok_or_else(|| wrong("text", format!("the code {code:#x}")))
        };
        let text = |element: &[u8]| -> Result<String> {
            let all: String = element.as_chunks::<4>().0.iter().map(character).collect::<Result<_>>()?;
            Ok(all.trim_end_matches('\0').to_owned())
        };
        let texts = raw.chunks_exact(4 * chars).map(text).collect::<Result<_>>()?;
        Ok(Node::Texts(shape.to_vec(), texts))
    }
}
