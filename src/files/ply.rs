//! PLY files of any content, read strictly: ascii or binary of either byte order, properties in any order and
//! of any type.
//!
//! Scalars become columns; list properties (faces) are checked and skipped. What follows the last element is
//! an error, and so is a row that is too short or too long.

use super::bytes::Cursor;
use super::{MAX_FILE_BYTES, memory, name_of, read_bytes};
use crate::num::order;
use crate::{Error, Result};
use std::path::Path;

/// Longest header read, in bytes.
const MAX_HEADER: usize = 1 << 20;

/// How the elements are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// decimal text, one row a line
    Ascii,
    /// binary, least significant byte first
    LittleEndian,
    /// binary, most significant byte first
    BigEndian,
}

/// Type of a property.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Type {
    /// char, int8
    I8,
    /// uchar, uint8
    U8,
    /// short, int16
    I16,
    /// ushort, uint16
    U16,
    /// int, int32
    I32,
    /// uint, uint32
    U32,
    /// float, float32
    F32,
    /// double, float64
    F64,
}

impl Type {
    fn parse(word: &str) -> Option<Self> {
        Some(match word {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Whether the type is float or double.
    pub fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }

    /// Smallest and largest integer of the type.
    fn range(self) -> (i64, i64) {
        match self {
            Self::I8 => (-128, 127),
            Self::U8 => (0, 255),
            Self::I16 => (-32_768, 32_767),
            Self::U16 => (0, 65_535),
            Self::I32 => (i64::from(i32::MIN), i64::from(i32::MAX)),
            _ => (0, i64::from(u32::MAX)),
        }
    }

    fn decode(self, bytes: &[u8], big: bool) -> f64 {
        let mut raw = [0u8; 8];
        let n = self.size();
        raw[..n].copy_from_slice(&bytes[..n]);
        if big {
            raw[..n].reverse();
        }
        let word = u64::from_le_bytes(raw);
        match self {
            Self::I8 => f64::from(word as u8 as i8),
            Self::U8 => f64::from(word as u8),
            Self::I16 => f64::from(word as u16 as i16),
            Self::U16 => f64::from(word as u16),
            Self::I32 => f64::from(word as u32 as i32),
            Self::U32 => f64::from(word as u32),
            Self::F32 => f64::from(f32::from_bits(word as u32)),
            Self::F64 => f64::from_bits(word),
        }
    }

    fn decode_text(self, word: &str) -> Option<f64> {
        match self {
            // Rounded once, to the type of the property.
            Self::F32 => word.parse::<f32>().ok().map(f64::from),
            Self::F64 => word.parse::<f64>().ok(),
            _ => {
                let (lo, hi) = self.range();
                word.parse::<i64>().ok().filter(|x| (lo..=hi).contains(x)).map(|x| x as f64)
            }
        }
    }
}

/// Values of one property; single precision where that holds them exactly.
#[derive(Clone, Debug, PartialEq)]
enum Values {
    Narrow(Vec<f32>),
    Wide(Vec<f64>),
}

/// One scalar property of all rows of an element.
#[derive(Clone, Debug, PartialEq)]
pub struct Column {
    /// Name of the property.
    pub name: String,
    /// Its type in the file.
    pub kind: Type,
    values: Values,
}

impl Column {
    /// Row `i`, exact.
    pub fn f64(&self, i: usize) -> f64 {
        match &self.values {
            Values::Narrow(v) => f64::from(v[i]),
            Values::Wide(v) => v[i],
        }
    }

    /// Row `i`, rounded to single precision.
    pub fn f32(&self, i: usize) -> f32 {
        match &self.values {
            Values::Narrow(v) => v[i],
            Values::Wide(v) => v[i] as f32,
        }
    }

    fn push(&mut self, x: f64) {
        match &mut self.values {
            Values::Narrow(v) => v.push(x as f32),
            Values::Wide(v) => v.push(x),
        }
    }
}

/// One element, such as all vertices.
#[derive(Clone, Debug, PartialEq)]
pub struct Element {
    /// Name of the element.
    pub name: String,
    /// Number of rows.
    pub rows: usize,
    /// Its scalar properties, in the order of the file.
    pub columns: Vec<Column>,
}

impl Element {
    /// The property of that name.
    pub fn column(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|c| c.name == name)
    }
}

/// A file.
#[derive(Clone, Debug, PartialEq)]
pub struct Ply {
    /// How it was written.
    pub format: Format,
    /// Text of the `comment` and `obj_info` lines.
    pub comments: Vec<String>,
    /// Its elements.
    pub elements: Vec<Element>,
}

impl Ply {
    /// The element of that name.
    pub fn element(&self, name: &str) -> Option<&Element> {
        self.elements.iter().find(|e| e.name == name)
    }
}

enum Property {
    Scalar(Type),
    List { count: Type, item: Type },
}

struct Declared {
    element: Element,
    properties: Vec<(String, Property)>,
}

/// Reads a file.
///
/// # Errors
/// When it is not readable or malformed.
pub fn read(path: &Path) -> Result<Ply> {
    parse(&read_bytes(path, MAX_FILE_BYTES)?, &name_of(path))
}

/// Like [`read`] for bytes in memory; `name` is the file name in errors.
///
/// # Errors
/// See [`read`].
pub fn parse(bytes: &[u8], name: &str) -> Result<Ply> {
    let (mut ply, mut declared, body_at, lines) = header(bytes, name)?;
    let body = &bytes[body_at..];
    for d in &declared {
        check_size(d, ply.format, body.len(), name)?;
    }
    // A value is held in four or eight bytes.
    let values = declared
        .iter()
        .fold(0_u64, |n, d| n.saturating_add(d.element.rows as u64 * d.properties.len() as u64));
    memory::check(name, values.saturating_mul(8))?;
    match ply.format {
        Format::Ascii => ascii(&mut declared, body, lines, name)?,
        f => binary(&mut declared, bytes, body_at, f == Format::BigEndian, name)?,
    }
    ply.elements = declared.into_iter().map(|d| d.element).collect();
    Ok(ply)
}

fn header(bytes: &[u8], name: &str) -> Result<(Ply, Vec<Declared>, usize, usize)> {
    let mut ply = Ply { format: Format::Ascii, comments: Vec::new(), elements: Vec::new() };
    let mut format = None;
    let mut declared: Vec<Declared> = Vec::new();
    let (mut at, mut line_number) = (0, 0);
    loop {
        line_number += 1;
        let fail = |expected: &str, got: &str| {
            let got: String = got.chars().take(80).collect();
            Error::input(name).at(format!("header, line {line_number}")).expected(expected).got(got)
        };
        let window = &bytes[at..order::min(bytes.len(), MAX_HEADER)];
        let Some(len) = window.iter().position(|&b| b == b'\n') else {
            let got = if bytes.len() > MAX_HEADER { "more than a mebibyte" } else { "the end of the file" };
            return Err(fail(if line_number == 1 { "'ply'" } else { "end_header" }, got));
        };
        at += len + 1;
        let Ok(line) = std::str::from_utf8(&window[..len]) else {
            return Err(fail("text", "bytes that are not UTF-8"));
        };
        let line = line.strip_suffix('\r').unwrap_or(line);
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        if line_number == 1 {
            if line != "ply" {
                return Err(fail("'ply'", line));
            }
            continue;
        }
        match words.as_slice() {
            ["comment" | "obj_info", ..] => {
                let text = line.trim_start().split_once(' ').map_or("", |(_, t)| t);
                ply.comments.push(text.to_owned());
            }
            ["format", kind, version] => {
                let f = match *kind {
                    "ascii" => Format::Ascii,
                    "binary_little_endian" => Format::LittleEndian,
                    "binary_big_endian" => Format::BigEndian,
                    _ => return Err(fail("ascii, binary_little_endian or binary_big_endian", kind)),
                };
                if *version != "1.0" || format.replace(f).is_some() {
                    return Err(fail("'format KIND 1.0' once", line));
                }
            }
            ["element", element, count] => {
                let Some(rows) = count.parse::<u64>().ok().and_then(|n| usize::try_from(n).ok()) else {
                    return Err(fail("a number of rows", count));
                };
                if declared.iter().any(|d| d.element.name == *element) {
                    return Err(fail("every element once", element));
                }
                let element = Element { name: (*element).to_owned(), rows, columns: Vec::new() };
                declared.push(Declared { element, properties: Vec::new() });
            }
            ["property", rest @ ..] => {
                let Some(d) = declared.last_mut() else {
                    return Err(fail("an element before its properties", line));
                };
                let kind = |word: &str| {
                    Type::parse(word)
                        .ok_or_else(|| fail("char, uchar, short, ushort, int, uint, float or double", word))
                };
                let (property, property_name) = match rest {
                    ["list", count, item, n] => {
                        let (count, item) = (kind(count)?, kind(item)?);
                        if count.is_float() {
                            return Err(fail("an integer type for the length of a list", line));
                        }
                        (Property::List { count, item }, *n)
                    }
                    [word, n] => (Property::Scalar(kind(word)?), *n),
                    _ => return Err(fail("'property TYPE NAME' or 'property list TYPE TYPE NAME'", line)),
                };
                if d.properties.iter().any(|(n, _)| n == property_name) {
                    return Err(fail("every property of an element once", property_name));
                }
                d.properties.push((property_name.to_owned(), property));
            }
            ["end_header"] => break,
            _ => return Err(fail("format, comment, obj_info, element, property or end_header", line)),
        }
    }
    ply.format =
        format.ok_or_else(|| Error::input(name).at("header").expected("a 'format' line").got("none"))?;
    Ok((ply, declared, at, line_number))
}

/// Refuses row counts that the rest of the file cannot hold, before anything is allocated.
fn check_size(d: &Declared, format: Format, left: usize, name: &str) -> Result<()> {
    let least = d.properties.iter().fold(0, |n, (_, p)| match (format, p) {
        (Format::Ascii, _) => n + 2,
        (_, Property::Scalar(t) | Property::List { count: t, .. }) => n + t.size(),
    });
    // The last line of a text file may lack its end.
    let fits = (left + usize::from(format == Format::Ascii)).checked_div(least).unwrap_or(0);
    if d.element.rows > fits {
        return Err(Error::input(name)
            .at(format!("element {}", d.element.name))
            .expected(format!(
                "at most {fits} rows of {least} bytes or more in the {left} bytes after the header"
            ))
            .got(d.element.rows.to_string()));
    }
    Ok(())
}

fn start(d: &mut Declared) {
    let rows = d.element.rows;
    for (name, p) in &d.properties {
        let Property::Scalar(kind) = *p else { continue };
        let values = match kind {
            Type::I32 | Type::U32 | Type::F64 => Values::Wide(Vec::with_capacity(rows)),
            _ => Values::Narrow(Vec::with_capacity(rows)),
        };
        d.element.columns.push(Column { name: name.clone(), kind, values });
    }
}

fn binary(declared: &mut [Declared], bytes: &[u8], body_at: usize, big: bool, name: &str) -> Result<()> {
    let mut c = Cursor::new(bytes, name);
    c.take(body_at, format_args!("header"))?;
    for d in declared {
        start(d);
        let element = d.element.name.clone();
        for row in 0..d.element.rows {
            let mut columns = d.element.columns.iter_mut();
            for (property, kind) in &d.properties {
                let place = format_args!("element {element}, row {row}, property {property}");
                match *kind {
                    Property::Scalar(t) => {
                        let x = t.decode(c.take(t.size(), place)?, big);
                        columns.next().expect("one column for every scalar property").push(x);
                    }
                    Property::List { count, item } => {
                        let n = count.decode(c.take(count.size(), place)?, big);
                        if n < 0.0 {
                            return Err(c.error(place).expected("a length").got(n.to_string()));
                        }
                        c.take((n as usize).saturating_mul(item.size()), place)?;
                    }
                }
            }
        }
    }
    c.end()
}

fn ascii(declared: &mut [Declared], body: &[u8], header_lines: usize, name: &str) -> Result<()> {
    let mut line_number = header_lines;
    let mut lines = body.split(|&b| b == b'\n');
    for d in declared {
        start(d);
        let element = d.element.name.clone();
        for row in 0..d.element.rows {
            line_number += 1;
            let fail = |property: &str, expected: &str, got: &str| {
                let got: String = got.chars().take(80).collect();
                let e = Error::input(name)
                    .at(format!("line {line_number}: element {element}, row {row}{property}"));
                e.expected(expected).got(got)
            };
            let Some(line) = lines.next() else { return Err(fail("", "a row", "the end of the file")) };
            let Ok(line) = std::str::from_utf8(line) else {
                return Err(fail("", "text", "bytes that are not UTF-8"));
            };
            let mut words = line.split_ascii_whitespace();
            let mut columns = d.element.columns.iter_mut();
            for (property, kind) in &d.properties {
                let at = format!(", property {property}");
                let mut number = |t: Type| {
                    let word = words.next().ok_or_else(|| fail(&at, "a number", "the end of the line"))?;
                    t.decode_text(word).ok_or_else(|| fail(&at, &format!("a number of type {t:?}"), word))
                };
                match *kind {
                    Property::Scalar(t) => {
                        let x = number(t)?;
                        columns.next().expect("one column for every scalar property").push(x);
                    }
                    Property::List { count, item } => {
                        let n = number(count)?;
                        if n < 0.0 {
                            return Err(fail(&at, "a length", &n.to_string()));
                        }
                        // At most the number of words in the line.
                        for _ in 0..n as u64 {
                            number(item)?;
                        }
                    }
                }
            }
            if let Some(word) = words.next() {
                return Err(fail("", "the end of the line", word));
            }
        }
    }
    for line in lines {
        line_number += 1;
        if !line.iter().all(u8::is_ascii_whitespace) {
            let got: String = String::from_utf8_lossy(line).chars().take(80).collect();
            return Err(Error::input(name)
                .at(format!("line {line_number}"))
                .expected("the end of the file")
                .got(got));
        }
    }
    Ok(())
}
