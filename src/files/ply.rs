//! PLY files of any content, read strictly: ascii or binary of either byte order, properties in any order and
//! of any type.
//!
//! Scalars become columns. List properties (faces) are checked, and kept by [`parse_with_lists`]. What follows the last element is an error,
//! and so is a row that is too short or too long.

use super::bytes::Cursor;
use super::ply_data::Values;
pub use super::ply_data::{Column, Element, Format, List, Ply, Type};
use super::{MAX_FILE_BYTES, memory, name_of, read_bytes};
use crate::num::order;
use crate::{Error, Result};
use std::path::Path;

/// Longest header read, in bytes.
const MAX_HEADER: usize = 1 << 20;

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
    parse_keeping(bytes, name, false)
}

/// Like [`parse`], and keeps list properties.
///
/// # Errors
/// See [`read`].
pub fn parse_with_lists(bytes: &[u8], name: &str) -> Result<Ply> {
    parse_keeping(bytes, name, true)
}

fn parse_keeping(bytes: &[u8], name: &str, keep_lists: bool) -> Result<Ply> {
    let (mut ply, mut declared, body_at, lines) = header(bytes, name)?;
    let body = &bytes[body_at..];
    for d in &declared {
        check_size(d, ply.format, body.len(), name)?;
    }
    // A value is held in four or eight bytes.
    let values = declared
        .iter()
        .fold(0_u64, |n, d| n.saturating_add(d.element.rows as u64 * d.properties.len() as u64));
    // Items of lists have at least one byte in the file.
    let items = if keep_lists { body.len() as u64 } else { 0 };
    memory::check(name, values.saturating_add(items).saturating_mul(8))?;
    declared.iter_mut().for_each(|d| start(d, keep_lists));
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
                let element =
                    Element { name: (*element).to_owned(), rows, columns: Vec::new(), lists: Vec::new() };
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

/// Makes room for the values of an element.
fn start(d: &mut Declared, keep_lists: bool) {
    let rows = d.element.rows;
    for (name, p) in &d.properties {
        let name = name.clone();
        match *p {
            Property::Scalar(kind) => {
                let values = Values::of(kind, rows);
                d.element.columns.push(Column { name, kind, values });
            }
            Property::List { item, .. } if keep_lists => {
                let (ends, values) = (Vec::with_capacity(rows), Values::of(item, 0));
                d.element.lists.push(List { name, ends, values });
            }
            Property::List { .. } => {}
        }
    }
}

fn binary(declared: &mut [Declared], bytes: &[u8], body_at: usize, big: bool, name: &str) -> Result<()> {
    let mut c = Cursor::new(bytes, name);
    c.take(body_at, format_args!("header"))?;
    for d in declared {
        let element = d.element.name.clone();
        for row in 0..d.element.rows {
            let (mut columns, mut lists) = (d.element.columns.iter_mut(), d.element.lists.iter_mut());
            for (property, kind) in &d.properties {
                let place = format_args!("element {element}, row {row}, property {property}");
                match *kind {
                    Property::Scalar(t) => {
                        let x = t.decode(c.take(t.size(), place)?, big);
                        columns.next().expect("one column for every scalar property").values.push(x);
                    }
                    Property::List { count, item } => {
                        let n = count.decode(c.take(count.size(), place)?, big);
                        if n < 0.0 {
                            return Err(c.error(place).expected("a length").got(n.to_string()));
                        }
                        let values = c.take((n as usize).saturating_mul(item.size()), place)?;
                        if let Some(list) = lists.next() {
                            for value in values.chunks_exact(item.size()) {
                                list.values.push(item.decode(value, big));
                            }
                            list.end_row();
                        }
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
            let (mut columns, mut lists) = (d.element.columns.iter_mut(), d.element.lists.iter_mut());
            for (property, kind) in &d.properties {
                let at = format!(", property {property}");
                let mut number = |t: Type| {
                    let word = words.next().ok_or_else(|| fail(&at, "a number", "the end of the line"))?;
                    t.decode_text(word).ok_or_else(|| fail(&at, &format!("a number of type {t:?}"), word))
                };
                match *kind {
                    Property::Scalar(t) => {
                        let x = number(t)?;
                        columns.next().expect("one column for every scalar property").values.push(x);
                    }
                    Property::List { count, item } => {
                        let n = number(count)?;
                        if n < 0.0 {
                            return Err(fail(&at, "a length", &n.to_string()));
                        }
                        // At most the number of words in the line.
                        let mut list = lists.next();
                        for _ in 0..n as u64 {
                            let x = number(item)?;
                            if let Some(list) = &mut list {
                                list.values.push(x);
                            }
                        }
                        if let Some(list) = list {
                            list.end_row();
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
