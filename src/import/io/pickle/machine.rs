//! The stack machine: opcodes to nodes, nodes to a tree.

use super::node::{Class, Id, Node, wrong};
use super::value::Value;
use super::{instance, text};
use crate::{Error, Result};
use std::collections::BTreeMap;

/// Opcodes executed.
const MAX_OPS: usize = 1 << 24;
/// Nodes made.
const MAX_NODES: usize = 1 << 22;
/// Depth of the tree.
const MAX_DEPTH: usize = 100;
/// Bytes that nodes, and a tree of them, may take beyond eight times the file.
const SLACK: usize = 64 << 20;
/// What a node of the tree costs.
const NODE_COST: usize = 64;

/// State of the machine.
pub(super) struct Machine<'a> {
    bytes: &'a [u8],
    at: usize,
    pub(super) name: &'a str,
    pub(super) nodes: Vec<Node<'a>>,
    stack: Vec<Id>,
    marks: Vec<usize>,
    memo: BTreeMap<u32, Id>,
    /// bytes that nodes may still take
    left: usize,
}

/// Bytes that the nodes of a file of that size may take, and its tree.
fn most(bytes: usize) -> usize {
    bytes.saturating_mul(8).saturating_add(SLACK)
}

pub(super) fn run(bytes: &[u8], name: &str) -> Result<Value> {
    let mut m = Machine {
        bytes,
        at: 0,
        name,
        nodes: Vec::new(),
        stack: Vec::new(),
        marks: Vec::new(),
        memo: BTreeMap::new(),
        left: most(bytes.len()),
    };
    for _ in 0..MAX_OPS {
        let start = m.at;
        let code = m.take(1, "an opcode")?[0];
        if code == b'.' {
            let top = m.pop("STOP").map_err(|e| e.within(format!("{name}: byte {start}")))?;
            let mut budget = most(bytes.len());
            return m.tree(top, MAX_DEPTH, &mut budget);
        }
        m.step(code).map_err(|e| e.within(format!("{name}: byte {start}")))?;
        if m.nodes.len() > MAX_NODES {
            return Err(m.error("pickle").expected(format!("at most {MAX_NODES} values")).got("more"));
        }
    }
    Err(m.error("pickle").expected(format!("at most {MAX_OPS} opcodes")).got("more"))
}

impl<'a> Machine<'a> {
    pub(super) fn error(&self, place: &str) -> Error {
        Error::input(self.name).at(place)
    }

    fn take(&mut self, n: usize, what: &str) -> Result<&'a [u8]> {
        let left = self.bytes.len() - self.at;
        if n > left {
            return Err(self
                .error(&format!("byte {}", self.at))
                .expected(format!("{what} of {n} bytes"))
                .got(if left == 0 {
                    "the end of the file".to_owned()
                } else {
                    format!("{left} before the end")
                }));
        }
        let out = &self.bytes[self.at..self.at + n];
        self.at += n;
        Ok(out)
    }

    fn number(&mut self, n: usize) -> Result<u64> {
        let b = self.take(n, "a number")?;
        Ok(b.iter().rev().fold(0, |x, &b| x << 8 | u64::from(b)))
    }

    /// A payload whose length is written in `n` bytes before it.
    fn sized(&mut self, n: usize) -> Result<&'a [u8]> {
        let len = self.number(n)?;
        let len = usize::try_from(len).map_err(|_| wrong("a length that fits", len.to_string()))?;
        self.take(len, "a payload")
    }

    /// Up to the end of the line.
    fn line(&mut self) -> Result<&'a [u8]> {
        let rest = &self.bytes[self.at..];
        let Some(len) = rest.iter().position(|&b| b == b'\n') else {
            return Err(wrong("the end of a line", "the end of the file"));
        };
        self.at += len + 1;
        Ok(rest[..len].strip_suffix(b"\r").unwrap_or(&rest[..len]))
    }

    fn text_line(&mut self) -> Result<&'a str> {
        let line = self.line()?;
        std::str::from_utf8(line).map_err(|_| wrong("text", "bytes that are not UTF-8"))
    }

    /// Counts bytes that are made; a step makes no more than one value that is there already holds.
    pub(super) fn charge(&mut self, bytes: usize) -> Result<()> {
        self.left = self.left.checked_sub(bytes).ok_or_else(|| self.too_much())?;
        Ok(())
    }

    fn too_much(&self) -> Error {
        self.error("values")
            .expected(format!("at most {} bytes once shared parts are written out", most(self.bytes.len())))
            .got("more: parts of the pickle refer to each other many times")
    }

    fn push(&mut self, node: Node<'a>) {
        self.nodes.push(node);
        // Bounded by MAX_NODES plus one.
        self.stack.push((self.nodes.len() - 1) as Id);
    }

    fn pop(&mut self, what: &str) -> Result<Id> {
        // Values below a mark belong to somebody else.
        let floor = self.marks.last().copied().unwrap_or(0);
        if self.stack.len() <= floor {
            return Err(wrong(format!("a value on the stack for {what}"), "none"));
        }
        self.stack.pop().ok_or_else(|| wrong("a value", "none"))
    }

    fn top(&self, what: &str) -> Result<Id> {
        let floor = self.marks.last().copied().unwrap_or(0);
        if self.stack.len() <= floor {
            return Err(wrong(format!("a value on the stack for {what}"), "none"));
        }
        Ok(self.stack[self.stack.len() - 1])
    }

    /// What was pushed since the last mark.
    fn since_mark(&mut self) -> Result<Vec<Id>> {
        let mark = self.marks.pop().ok_or_else(|| wrong("a mark on the stack", "none"))?;
        Ok(self.stack.split_off(mark))
    }

    fn memoize(&mut self, index: u64) -> Result<()> {
        let index = u32::try_from(index).map_err(|_| wrong("a memo index below 2^32", index.to_string()))?;
        let top = self.top("the memo")?;
        self.memo.insert(index, top);
        Ok(())
    }

    fn recall(&mut self, index: u64) -> Result<()> {
        let found = u32::try_from(index).ok().and_then(|i| self.memo.get(&i).copied());
        self.stack.push(found.ok_or_else(|| wrong("a memo that was written", format!("memo {index}")))?);
        Ok(())
    }

    fn parsed<T: std::str::FromStr>(&mut self, what: &str) -> Result<T> {
        let line = self.text_line()?.trim();
        line.parse().map_err(|_| wrong(what, format!("'{}'", line.chars().take(40).collect::<String>())))
    }

    fn global(&mut self, module: &str, name: &str) -> Result<()> {
        let class = Class::named(module, name)?;
        self.push(Node::Global(class));
        Ok(())
    }

    fn long(bytes: &[u8]) -> Result<i64> {
        if bytes.len() > 8 {
            return Err(wrong("an integer of at most 64 bits", format!("one of {} bytes", bytes.len())));
        }
        let negative = bytes.last().is_some_and(|&b| b > 127);
        let mut full = [if negative { 0xff } else { 0 }; 8];
        full[..bytes.len()].copy_from_slice(bytes);
        Ok(i64::from_le_bytes(full))
    }

    fn text(bytes: &[u8]) -> Result<Node<'a>> {
        // Python lets lone surrogates pass; nothing read here has them.
        match std::str::from_utf8(bytes) {
            Ok(t) => Ok(Node::Text(t.to_owned())),
            Err(_) => Err(wrong("UTF-8 text", "other bytes")),
        }
    }

    fn step(&mut self, code: u8) -> Result<()> {
        match code {
            b'(' => self.marks.push(self.stack.len()),
            b'0' => {
                // POP also takes a mark.
                if self.marks.last() == Some(&self.stack.len()) {
                    self.marks.pop();
                } else {
                    self.pop("POP")?;
                }
            }
            b'1' => drop(self.since_mark()?),
            b'2' => {
                let top = self.top("DUP")?;
                self.stack.push(top);
            }
            b'N' => self.push(Node::None),
            0x88 => self.push(Node::Bool(true)),
            0x89 => self.push(Node::Bool(false)),
            b'I' => match self.text_line()?.trim() {
                "00" => self.push(Node::Bool(false)),
                "01" => self.push(Node::Bool(true)),
                digits => {
                    let x = digits
                        .parse()
                        .map_err(|_| wrong("an integer", digits.chars().take(40).collect::<String>()))?;
                    self.push(Node::Int(x));
                }
            },
            b'J' => {
                let x = self.number(4)? as u32 as i32;
                self.push(Node::Int(i64::from(x)));
            }
            b'K' => {
                let x = self.number(1)?;
                self.push(Node::Int(x as i64));
            }
            b'M' => {
                let x = self.number(2)?;
                self.push(Node::Int(x as i64));
            }
            b'L' => {
                let line = self.text_line()?.trim();
                let digits = line.strip_suffix('L').unwrap_or(line);
                let x = digits.parse().map_err(|_| {
                    wrong("an integer of at most 64 bits", digits.chars().take(40).collect::<String>())
                })?;
                self.push(Node::Int(x));
            }
            0x8a | 0x8b => {
                let x = Self::long(self.sized(if code == 0x8a { 1 } else { 4 })?)?;
                self.push(Node::Int(x));
            }
            b'F' => {
                let x = self.parsed("a number")?;
                self.push(Node::Float(x));
            }
            b'G' => {
                let bits = self.number(8)?.swap_bytes();
                self.push(Node::Float(f64::from_bits(bits)));
            }
            b'S' => {
                let line = self.line()?;
                let unquoted = text::unquoted(line)?;
                self.push(Node::Made(unquoted));
            }
            b'T' => {
                let b = self.sized(4)?;
                self.push(Node::Str(b));
            }
            b'U' => {
                let b = self.sized(1)?;
                self.push(Node::Str(b));
            }
            b'V' => {
                // Raw: characters below 256 stand for themselves, others are escaped.
                let line: String = self.line()?.iter().map(|&b| char::from(b)).collect();
                let text = text::unescaped(&line)?;
                self.push(Node::Text(text));
            }
            b'X' | 0x8c | 0x8d => {
                let b = self.sized(match code {
                    b'X' => 4,
                    0x8c => 1,
                    _ => 8,
                })?;
                let node = Self::text(b)?;
                self.push(node);
            }
            b'B' | b'C' | 0x8e | 0x96 => {
                let b = self.sized(match code {
                    b'B' => 4,
                    b'C' => 1,
                    _ => 8,
                })?;
                self.push(Node::Bytes(b));
            }
            b']' | 0x8f => self.push(Node::List(Vec::new())),
            b'}' => self.push(Node::Dict(Vec::new())),
            b')' => self.push(Node::Tuple(Vec::new())),
            b'l' | 0x91 => {
                let items = self.since_mark()?;
                self.push(Node::List(items));
            }
            b't' => {
                let items = self.since_mark()?;
                self.push(Node::Tuple(items));
            }
            0x85..=0x87 => {
                let mut items = Vec::with_capacity(3);
                for _ in 0..=(code - 0x85) {
                    items.push(self.pop("a tuple")?);
                }
                items.reverse();
                self.push(Node::Tuple(items));
            }
            b'd' => {
                let items = self.since_mark()?;
                let pairs = text::pairs(&items)?;
                self.push(Node::Dict(pairs));
            }
            b'a' => {
                let item = self.pop("APPEND")?;
                self.extend(&[item])?;
            }
            b'e' | 0x90 => {
                let items = self.since_mark()?;
                self.extend(&items)?;
            }
            b's' => {
                let (value, key) = (self.pop("SETITEM")?, self.pop("SETITEM")?);
                self.set(&[(key, value)])?;
            }
            b'u' => {
                let items = self.since_mark()?;
                self.set(&text::pairs(&items)?)?;
            }
            b'p' => {
                let i = self.parsed("a memo index")?;
                self.memoize(i)?;
            }
            b'q' | b'r' => {
                let i = self.number(if code == b'q' { 1 } else { 4 })?;
                self.memoize(i)?;
            }
            0x94 => self.memoize(self.memo.len() as u64)?,
            b'g' => {
                let i = self.parsed("a memo index")?;
                self.recall(i)?;
            }
            b'h' | b'j' => {
                let i = self.number(if code == b'h' { 1 } else { 4 })?;
                self.recall(i)?;
            }
            b'c' => {
                let (module, name) = (self.text_line()?, self.text_line()?);
                self.global(module, name)?;
            }
            0x93 => {
                let (name, module) = (self.pop("STACK_GLOBAL")?, self.pop("STACK_GLOBAL")?);
                let text = |m: &Self, id: Id| match &m.nodes[id as usize] {
                    Node::Text(t) => Ok(t.clone()),
                    _ => Err(wrong("a name", "another value")),
                };
                let (module, name) = (text(self, module)?, text(self, name)?);
                self.global(&module, &name)?;
            }
            b'R' | 0x81 => {
                let (args, class) = (self.pop("REDUCE")?, self.pop("REDUCE")?);
                let node = self.call(class, args)?;
                self.charge(node.payload() + node.references())?;
                self.push(node);
            }
            b'b' => {
                let (state, object) = (self.pop("BUILD")?, self.top("BUILD")?);
                self.build(object, state)?;
            }
            0x80 => {
                let version = self.number(1)?;
                if version > 5 {
                    return Err(wrong("protocol 0 to 5", version.to_string()));
                }
            }
            0x95 => {
                let len = self.number(8)?;
                let left = (self.bytes.len() - self.at) as u64;
                if len > left {
                    return Err(wrong(format!("a frame of at most {left} bytes"), len.to_string()));
                }
            }
            b'i' => {
                let (module, name) = (self.text_line()?, self.text_line()?);
                Class::named(module, name)?;
                return Err(wrong("no INST", format!("one of {module}.{name}")));
            }
            b'P' | b'Q' => {
                return Err(wrong("values", "a persistent reference to something outside the file"));
            }
            0x82..=0x84 => return Err(wrong("values", "a code of an extension registry")),
            0x97 | 0x98 => return Err(wrong("values", "a buffer outside the file")),
            b'o' | 0x92 => {
                return Err(wrong("values that are read here", "an object made with arguments"));
            }
            other => return Err(wrong("an opcode of protocol 0 to 5", format!("{other:#04x}"))),
        }
        Ok(())
    }

    fn extend(&mut self, items: &[Id]) -> Result<()> {
        let top = self.top("APPENDS")?;
        match &mut self.nodes[top as usize] {
            Node::List(list) => list.extend_from_slice(items),
            _ => return Err(wrong("a list to append to", "another value")),
        }
        Ok(())
    }

    fn set(&mut self, pairs: &[(Id, Id)]) -> Result<()> {
        let top = self.top("SETITEMS")?;
        match &mut self.nodes[top as usize] {
            Node::Dict(dict) => dict.extend_from_slice(pairs),
            _ => return Err(wrong("a dictionary to put into", "another value")),
        }
        Ok(())
    }

    /// The tree below a node; `budget` counts down.
    pub(super) fn tree(&self, id: Id, depth: usize, budget: &mut usize) -> Result<Value> {
        let node = &self.nodes[id as usize];
        let cost = NODE_COST + node.payload();
        *budget = budget.checked_sub(cost).ok_or_else(|| self.too_much())?;
        let deeper = depth.checked_sub(1).ok_or_else(|| {
            self.error("values")
                .expected(format!("at most {MAX_DEPTH} levels"))
                .got("more, or a value that contains itself")
        })?;
        let mut all = |ids: &[Id]| -> Result<Vec<Value>> {
            ids.iter().map(|&i| self.tree(i, deeper, budget)).collect()
        };
        Ok(match node {
            Node::None => Value::None,
            Node::Bool(b) => Value::Bool(*b),
            Node::Int(i) => Value::Int(*i),
            Node::Float(x) => Value::Float(*x),
            Node::Text(t) => Value::Text(t.clone()),
            Node::Str(b) => text::string(b),
            Node::Made(b) => text::string(b),
            Node::Bytes(b) => Value::Bytes(b.to_vec()),
            Node::Encoded(b) => Value::Bytes(b.clone()),
            Node::List(l) => Value::List(all(l)?),
            Node::Tuple(l) => Value::Tuple(all(l)?),
            Node::Dict(d) => {
                let mut out = Vec::with_capacity(d.len());
                for &(k, v) in d {
                    let pair = all(&[k, v])?;
                    let [k, v] = <[Value; 2]>::try_from(pair).map_err(|_| self.error("a pair"))?;
                    out.push((k, v));
                }
                Value::Dict(out)
            }
            Node::Array(a) => Value::Array(a.clone()),
            Node::Objects(shape, l) => Value::Objects(shape.clone(), all(l)?),
            Node::Texts(shape, t) => {
                Value::Objects(shape.clone(), t.iter().map(|t| Value::Text(t.clone())).collect())
            }
            Node::Unread(what) => Value::Unread(what.clone()),
            Node::Shell => return Err(self.error("array").expected("its shape and elements").got("none")),
            Node::Dtype { descr, .. } => Value::Text(descr.clone()),
            Node::Global(c) => {
                return Err(self.error("values").expected("a value").got(format!("the name {c:?} itself")));
            }
            Node::Instance(class, state) => {
                let state = state.ok_or_else(|| {
                    self.error("values").expected(format!("what the {class:?} holds")).got("nothing")
                })?;
                let state = self.tree(state, deeper, budget)?;
                let value = instance::instance(*class, &state).map_err(|e| e.within(self.name))?;
                if let Value::Array(a) = &value {
                    *budget = budget.checked_sub(8 * a.len()).ok_or_else(|| self.too_much())?;
                }
                value
            }
        })
    }
}
