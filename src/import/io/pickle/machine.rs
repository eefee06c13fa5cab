//! The stack machine: bytes, stack, marks and memo.

use super::node::{Id, Node, wrong};
use crate::{Error, Result};
use std::collections::BTreeMap;

/// Bytes that nodes, and a tree of them, may take beyond eight times the file.
const SLACK: usize = 64 << 20;

/// State of the machine.
pub(super) struct Machine<'a> {
    pub(super) bytes: &'a [u8],
    /// bytes read
    pub(super) at: usize,
    pub(super) name: &'a str,
    pub(super) nodes: Vec<Node<'a>>,
    pub(super) stack: Vec<Id>,
    /// heights of the stack at its marks
    pub(super) marks: Vec<usize>,
    pub(super) memo: BTreeMap<u32, Id>,
    /// bytes that nodes may still take
    left: usize,
}

/// Bytes that the nodes of a file of that size may take, and its tree.
pub(super) fn most(bytes: usize) -> usize {
    bytes.saturating_mul(8).saturating_add(SLACK)
}

impl<'a> Machine<'a> {
    /// A machine at the start of a file.
    pub(super) fn new(bytes: &'a [u8], name: &'a str) -> Self {
        Self {
            bytes,
            at: 0,
            name,
            nodes: Vec::new(),
            stack: Vec::new(),
            marks: Vec::new(),
            memo: BTreeMap::new(),
            left: most(bytes.len()),
        }
    }

    pub(super) fn error(&self, place: &str) -> Error {
        Error::input(self.name).at(place)
    }

    pub(super) fn take(&mut self, n: usize, what: &str) -> Result<&'a [u8]> {
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

    pub(super) fn number(&mut self, n: usize) -> Result<u64> {
        let b = self.take(n, "a number")?;
        Ok(b.iter().rev().fold(0, |x, &b| x << 8 | u64::from(b)))
    }

    /// A payload whose length is written in `n` bytes before it.
    pub(super) fn sized(&mut self, n: usize) -> Result<&'a [u8]> {
        let len = self.number(n)?;
        let len = usize::try_from(len).map_err(|_| wrong("a length that fits", len.to_string()))?;
        self.take(len, "a payload")
    }

    /// Up to the end of the line.
    pub(super) fn line(&mut self) -> Result<&'a [u8]> {
        let rest = &self.bytes[self.at..];
        let Some(len) = rest.iter().position(|&b| b == b'\n') else {
            return Err(wrong("the end of a line", "the end of the file"));
        };
        self.at += len + 1;
        Ok(rest[..len].strip_suffix(b"\r").unwrap_or(&rest[..len]))
    }

    pub(super) fn text_line(&mut self) -> Result<&'a str> {
        let line = self.line()?;
        std::str::from_utf8(line).map_err(|_| wrong("text", "bytes that are not UTF-8"))
    }

    /// Counts bytes that are made; a step makes no more than one value that is there already holds.
    pub(super) fn charge(&mut self, bytes: usize) -> Result<()> {
        self.left = self.left.checked_sub(bytes).ok_or_else(|| self.too_much())?;
        Ok(())
    }

    pub(super) fn too_much(&self) -> Error {
        self.error("values")
            .expected(format!("at most {} bytes once shared parts are written out", most(self.bytes.len())))
            .got("more: parts of the pickle refer to each other many times")
    }

    pub(super) fn push(&mut self, node: Node<'a>) {
        self.nodes.push(node);
        // Bounded by MAX_NODES plus one.
        self.stack.push((self.nodes.len() - 1) as Id);
    }

    pub(super) fn pop(&mut self, what: &str) -> Result<Id> {
        // Values below a mark belong to an enclosing object.
        let floor = self.marks.last().copied().unwrap_or(0);
        if self.stack.len() <= floor {
            return Err(wrong(format!("a value on the stack for {what}"), "none"));
        }
        self.stack.pop().ok_or_else(|| wrong("a value", "none"))
    }

    pub(super) fn top(&self, what: &str) -> Result<Id> {
        let floor = self.marks.last().copied().unwrap_or(0);
        if self.stack.len() <= floor {
            return Err(wrong(format!("a value on the stack for {what}"), "none"));
        }
        Ok(self.stack[self.stack.len() - 1])
    }

    /// What was pushed since the last mark.
    pub(super) fn since_mark(&mut self) -> Result<Vec<Id>> {
        let mark = self.marks.pop().ok_or_else(|| wrong("a mark on the stack", "none"))?;
        Ok(self.stack.split_off(mark))
    }

    pub(super) fn memoize(&mut self, index: u64) -> Result<()> {
        let index = u32::try_from(index).map_err(|_| wrong("a memo index below 2^32", index.to_string()))?;
        let top = self.top("the memo")?;
        self.memo.insert(index, top);
        Ok(())
    }

    pub(super) fn recall(&mut self, index: u64) -> Result<()> {
        let found = u32::try_from(index).ok().and_then(|i| self.memo.get(&i).copied());
        self.stack.push(found.ok_or_else(|| wrong("a memo that was written", format!("memo {index}")))?);
        Ok(())
    }

    pub(super) fn parsed<T: std::str::FromStr>(&mut self, what: &str) -> Result<T> {
        let line = self.text_line()?.trim();
        line.parse().map_err(|_| wrong(what, format!("'{}'", line.chars().take(40).collect::<String>())))
    }

    pub(super) fn extend(&mut self, items: &[Id]) -> Result<()> {
        let top = self.top("APPENDS")?;
        match &mut self.nodes[top as usize] {
            Node::List(list) => list.extend_from_slice(items),
            _ => return Err(wrong("a list to append to", "another value")),
        }
        Ok(())
    }

    pub(super) fn set(&mut self, pairs: &[(Id, Id)]) -> Result<()> {
        let top = self.top("SETITEMS")?;
        match &mut self.nodes[top as usize] {
            Node::Dict(dict) => dict.extend_from_slice(pairs),
            _ => return Err(wrong("a dictionary to put into", "another value")),
        }
        Ok(())
    }
}
