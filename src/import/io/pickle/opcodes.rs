//! The opcodes of protocols 0 to 5, by what they do: push a number, a text or a collection, move the stack
//! and the memo, change what is on top, make objects; everything else is refused.

use super::machine::{Machine, most};
use super::node::{Class, Id, Node, wrong};
use super::text;
use super::tree::MAX_DEPTH;
use super::value::Value;
use crate::{Error, Result};

/// Opcodes executed.
const MAX_OPS: usize = 1 << 24;
/// Nodes made.
const MAX_NODES: usize = 1 << 22;

/// Runs a pickle to its STOP and gives the value on top.
pub(super) fn run(bytes: &[u8], name: &str) -> Result<Value> {
    let mut m = Machine::new(bytes, name);
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

/// An integer of the pickle, little-endian in two's complement.
fn long(bytes: &[u8]) -> Result<i64> {
    if bytes.len() > 8 {
        return Err(wrong("an integer of at most 64 bits", format!("one of {} bytes", bytes.len())));
    }
    let negative = bytes.last().is_some_and(|&b| b > 127);
    let mut full = [if negative { 0xff } else { 0 }; 8];
    full[..bytes.len()].copy_from_slice(bytes);
    Ok(i64::from_le_bytes(full))
}

fn utf8<'a>(bytes: &[u8]) -> Result<Node<'a>> {
    // Python accepts lone surrogates; the supported files contain none.
    match std::str::from_utf8(bytes) {
        Ok(t) => Ok(Node::Text(t.to_owned())),
        Err(_) => Err(wrong("UTF-8 text", "other bytes")),
    }
}

/// Parses digits of an integer; `what` is expected.
fn integer(digits: &str, what: &str) -> Result<i64> {
    digits.parse().map_err(|_| wrong(what, digits.chars().take(40).collect::<String>()))
}

impl<'a> Machine<'a> {
    fn step(&mut self, code: u8) -> Result<()> {
        if let Some(node) = self.number_of(code)? {
            self.push(node);
            return Ok(());
        }
        if let Some(node) = self.text_of(code)? {
            self.push(node);
            return Ok(());
        }
        if let Some(node) = self.collection_of(code)? {
            self.push(node);
            return Ok(());
        }
        let is_done = self.move_stack(code)? || self.change_top(code)? || self.make_object(code)?;
        if is_done { Ok(()) } else { Err(refusal(code)) }
    }

    /// None, booleans, integers, floats.
    fn number_of(&mut self, code: u8) -> Result<Option<Node<'a>>> {
        Ok(Some(match code {
            b'N' => Node::None,
            0x88 => Node::Bool(true),
            0x89 => Node::Bool(false),
            b'I' => match self.text_line()?.trim() {
                "00" => Node::Bool(false),
                "01" => Node::Bool(true),
                digits => Node::Int(integer(digits, "an integer")?),
            },
            b'J' => Node::Int(i64::from(self.number(4)? as u32 as i32)),
            b'K' => Node::Int(self.number(1)? as i64),
            b'M' => Node::Int(self.number(2)? as i64),
            b'L' => {
                let line = self.text_line()?.trim();
                Node::Int(integer(line.strip_suffix('L').unwrap_or(line), "an integer of at most 64 bits")?)
            }
            0x8a => Node::Int(long(self.sized(1)?)?),
            0x8b => Node::Int(long(self.sized(4)?)?),
            b'F' => Node::Float(self.parsed("a number")?),
            b'G' => Node::Float(f64::from_bits(self.number(8)?.swap_bytes())),
            _ => return Ok(None),
        }))
    }

    /// Texts and bytes.
    fn text_of(&mut self, code: u8) -> Result<Option<Node<'a>>> {
        Ok(Some(match code {
            b'S' => Node::Made(text::unquoted(self.line()?)?),
            b'T' => Node::Str(self.sized(4)?),
            b'U' => Node::Str(self.sized(1)?),
            b'V' => {
                // Raw: characters below 256 are literal, others are escaped.
                let line: String = self.line()?.iter().map(|&b| char::from(b)).collect();
                Node::Text(text::unescaped(&line)?)
            }
            b'X' => utf8(self.sized(4)?)?,
            0x8c => utf8(self.sized(1)?)?,
            0x8d => utf8(self.sized(8)?)?,
            b'B' => Node::Bytes(self.sized(4)?),
            b'C' => Node::Bytes(self.sized(1)?),
            0x8e | 0x96 => Node::Bytes(self.sized(8)?),
            _ => return Ok(None),
        }))
    }

    /// Lists, tuples, dictionaries.
    fn collection_of(&mut self, code: u8) -> Result<Option<Node<'a>>> {
        Ok(Some(match code {
            b']' | 0x8f => Node::List(Vec::new()),
            b'}' => Node::Dict(Vec::new()),
            b')' => Node::Tuple(Vec::new()),
            b'l' | 0x91 => Node::List(self.since_mark()?),
            b't' => Node::Tuple(self.since_mark()?),
            b'd' => Node::Dict(text::pairs(&self.since_mark()?)?),
            0x85..=0x87 => {
                let mut items = Vec::with_capacity(3);
                for _ in 0..=(code - 0x85) {
                    items.push(self.pop("a tuple")?);
                }
                items.reverse();
                Node::Tuple(items)
            }
            _ => return Ok(None),
        }))
    }

    /// Marks, copies of what is on the stack, the memo, and what only describes the file; false for other
    /// opcodes.
    fn move_stack(&mut self, code: u8) -> Result<bool> {
        match code {
            b'(' => self.marks.push(self.stack.len()),
            // POP also takes a mark.
            b'0' if self.marks.last() == Some(&self.stack.len()) => drop(self.marks.pop()),
            b'0' => drop(self.pop("POP")?),
            b'1' => drop(self.since_mark()?),
            b'2' => {
                let top = self.top("DUP")?;
                self.stack.push(top);
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
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// Items that are put into a collection; false for other opcodes.
    fn change_top(&mut self, code: u8) -> Result<bool> {
        match code {
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
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// Names and what is made of them; false for other opcodes.
    fn make_object(&mut self, code: u8) -> Result<bool> {
        match code {
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
            b'i' => {
                let (module, name) = (self.text_line()?, self.text_line()?);
                Class::named(module, name)?;
                return Err(wrong("no INST", format!("one of {module}.{name}")));
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
            _ => return Ok(false),
        }
        Ok(true)
    }

    fn global(&mut self, module: &str, name: &str) -> Result<()> {
        let class = Class::named(module, name)?;
        self.push(Node::Global(class));
        Ok(())
    }
}

/// Why an opcode is refused.
fn refusal(code: u8) -> Error {
    match code {
        b'P' | b'Q' => wrong("values", "a persistent reference to something outside the file"),
        0x82..=0x84 => wrong("values", "a code of an extension registry"),
        0x97 | 0x98 => wrong("values", "a buffer outside the file"),
        b'o' | 0x92 => wrong("values that are read here", "an object made with arguments"),
        other => wrong("an opcode of protocol 0 to 5", format!("{other:#04x}")),
    }
}
