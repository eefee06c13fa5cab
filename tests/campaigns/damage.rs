//! What is done to a file. Bytes are damaged anywhere (`mutate`) or near the beginning; texts, JSON documents, archives and PNG
//! files also in ways that keep the rest of the file valid, so that the damage reaches the code behind the checksum or the parser.

use crate::mutate::{Draws, apply};
use serde_json::{Value, json};
use std::io::{Cursor, Read as _, Write as _};

/// What is in the place of the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Content {
    /// a file with these bytes
    File(Vec<u8>),
    /// nothing
    Missing,
    /// a folder
    Folder,
}

/// How the file is read, which decides what is done to it.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Json,
    /// 8 bytes of length, a JSON document, data
    Safetensors,
    /// a JSON document in a chunk
    Glb,
    Archive,
    Png,
    Text,
    Bytes,
}

fn kind(bytes: &[u8]) -> Kind {
    if bytes.starts_with(b"PK\x03\x04") {
        return Kind::Archive;
    }
    if bytes.starts_with(b"\x89PNG\r\n\x1a\n") {
        return Kind::Png;
    }
    if bytes.starts_with(b"glTF") && bytes.len() > 20 {
        return Kind::Glb;
    }
    if bytes.starts_with(b"{") && serde_json::from_slice::<Value>(bytes).is_ok() {
        return Kind::Json;
    }
    if bytes.get(8) == Some(&b'{') && header(bytes).is_some() {
        return Kind::Safetensors;
    }
    let start = &bytes[..Ord::min(bytes.len(), 256)];
    let printable = start.iter().filter(|b| matches!(b, b' '..=b'~' | b'\n' | b'\r' | b'\t')).count();
    if 10 * printable >= 9 * start.len() { Kind::Text } else { Kind::Bytes }
}

/// The bytes of the header of a safetensors file.
fn header(bytes: &[u8]) -> Option<&[u8]> {
    let (length, rest) = bytes.split_first_chunk::<8>()?;
    rest.get(..usize::try_from(u64::from_le_bytes(*length)).ok()?)
}

/// Damages a file; `others` are files that pieces are taken from. Gives a description and what is in its place.
pub(crate) fn damage(draws: &mut Draws, bytes: &[u8], others: &[&[u8]]) -> (String, Content) {
    let own = match (draws.below(10), kind(bytes)) {
        (0..=4, Kind::Json) => json_text(draws, bytes),
        (0..=3, Kind::Safetensors) => safetensors(draws, bytes),
        (0..=3, Kind::Glb) => glb(draws, bytes),
        (0..=5, Kind::Archive) => archive(draws, bytes, others),
        (0..=4, Kind::Png) => png(draws, bytes, others),
        (0..=3, Kind::Text) | (5, Kind::Json) => number(draws, bytes),
        _ => None,
    };
    if let Some((what, bytes)) = own {
        return (what, Content::File(bytes));
    }
    match draws.below(24) {
        0 => ("empty".into(), Content::File(Vec::new())),
        1 => ("missing".into(), Content::Missing),
        2 => ("a folder in its place".into(), Content::Folder),
        3 => {
            let other = draws.below(others.len());
            (format!("the bytes of file {other}"), Content::File(others[other].to_vec()))
        }
        n => {
            let reach = if n < 14 { Ord::min(bytes.len(), 512) } else { bytes.len() };
            let (what, bytes) = mutated(draws, bytes, reach, others);
            (what, Content::File(bytes))
        }
    }
}

/// One to four mutations of the first `reach` bytes.
fn mutated(draws: &mut Draws, bytes: &[u8], reach: usize, others: &[&[u8]]) -> (String, Vec<u8>) {
    let mut head = bytes[..reach].to_vec();
    let mut what = if reach < bytes.len() { format!("the first {reach} bytes") } else { "bytes".into() };
    for _ in 0..=draws.below(4) {
        let m = draws.mutation();
        apply(&mut head, &m, others);
        what += &format!(" {m:?}");
    }
    head.extend_from_slice(&bytes[reach..]);
    (what, head)
}

/// What a number in a text becomes.
const NUMBERS: [&str; 24] = [
    "NaN",
    "nan",
    "inf",
    "-inf",
    "Infinity",
    "1e999",
    "-1e999",
    "1e308",
    "3.5e38",
    "1e-320",
    "-0",
    "0",
    "-1",
    "1.5",
    "255",
    "256",
    "65536",
    "16777217",
    "2147483648",
    "4294967296",
    "9223372036854775808",
    "99999999999999999999",
    "0x10",
    "",
];

/// Replaces one number that is written in digits.
fn number(draws: &mut Draws, bytes: &[u8]) -> Option<(String, Vec<u8>)> {
    let is_part = |b: u8| b.is_ascii_digit() || matches!(b, b'-' | b'+' | b'.' | b'e' | b'E');
    let mut found: Vec<(usize, usize)> = Vec::new();
    let mut at = 0;
    while at < bytes.len() {
        let len = bytes[at..].iter().take_while(|b| is_part(**b)).count();
        if bytes[at..at + len].iter().any(u8::is_ascii_digit) {
            found.push((at, len));
        }
        at += len + 1;
    }
    if found.is_empty() {
        return None;
    }
    let ((at, len), value) = (found[draws.below(found.len())], NUMBERS[draws.below(NUMBERS.len())]);
    let out = [&bytes[..at], value.as_bytes(), &bytes[at + len..]].concat();
    Some((format!("the number at {at} becomes '{value}'"), out))
}

/// A key that is renamed to another after the document is written, which gives the same key twice.
const TWICE: &str = "\u{2}twice\u{2}";

/// Pointers to all values of a document but the document itself.
fn pointers(value: &Value, at: &str, out: &mut Vec<String>) {
    let mut below = |key: &str, value: &Value| {
        let at = format!("{at}/{}", key.replace('~', "~0").replace('/', "~1"));
        out.push(at.clone());
        pointers(value, &at, out);
    };
    match value {
        Value::Object(map) => map.iter().for_each(|(key, value)| below(key, value)),
        Value::Array(list) => list.iter().enumerate().for_each(|(i, value)| below(&i.to_string(), value)),
        _ => {}
    }
}

/// What a value becomes.
fn value(draws: &mut Draws) -> Value {
    match draws.below(18) {
        0 => Value::Null,
        1 => json!(true),
        2 => json!(0),
        3 => json!(-1),
        4 => json!(1e308),
        5 => json!(-1e-308),
        6 => json!(u64::MAX),
        7 => json!(u32::MAX),
        8 => json!(""),
        9 => json!("x".repeat(5000)),
        10 => json!("\u{1b}[31m\u{7}red\u{0}"),
        11 => json!("../../../etc/passwd"),
        12 => json!("/dev/zero"),
        13 => json!([]),
        14 => json!({}),
        15 => json!([[[[[[[[1.5]]]]]]]]),
        16 => json!("NaN"),
        _ => json!(draws.below(300)),
    }
}

/// Edits a JSON document at one value.
fn edit(draws: &mut Draws, bytes: &[u8]) -> Option<(String, Vec<u8>)> {
    let mut root: Value = serde_json::from_slice(bytes).ok()?;
    let mut all = Vec::new();
    pointers(&root, "", &mut all);
    if all.is_empty() {
        return None;
    }
    let at = all[draws.below(all.len())].clone();
    let other = all[draws.below(all.len())].clone();
    let (above, last) = at.rsplit_once('/')?;
    let key = last.replace("~1", "/").replace("~0", "~");
    let (old, copy) = (root.pointer(&at)?.clone(), root.pointer(&other)?.clone());
    let how = draws.below(6);
    let new = value(draws);
    let parent = if above.is_empty() { &mut root } else { root.pointer_mut(above)? };
    let what = match (how, parent) {
        (0, Value::Object(map)) => map.remove(&key).map(|_| "removed"),
        (0, Value::Array(list)) => key.parse().ok().map(|i: usize| list.remove(i)).map(|_| "removed"),
        (1, Value::Object(map)) => map.insert(TWICE.into(), old).map_or(Some("twice"), |_| None),
        (1, Value::Array(list)) => (list.push(old), Some("once more at the end")).1,
        (2, Value::Object(map)) => map
            .remove(&key)
            .and_then(|v| map.insert(format!("{key}\u{7}"), v))
            .or(Some(Value::Null))
            .map(|_| "renamed"),
        (3, parent) => (*slot(parent, &key)? = copy, Some("another value of the document")).1,
        (_, parent) => (*slot(parent, &key)? = new, Some("replaced")).1,
    }?;
    let text = root.to_string().replace(&json!(TWICE).to_string(), &json!(key).to_string());
    Some((format!("JSON {at} {what}"), text.into_bytes()))
}

fn slot<'a>(parent: &'a mut Value, key: &str) -> Option<&'a mut Value> {
    match parent {
        Value::Object(map) => map.get_mut(key),
        Value::Array(list) => list.get_mut(key.parse::<usize>().ok()?),
        _ => None,
    }
}

/// One edit of a document, or a document of many brackets.
fn json_text(draws: &mut Draws, bytes: &[u8]) -> Option<(String, Vec<u8>)> {
    if draws.below(40) == 0 {
        return Some(("100 000 brackets".into(), vec![b'['; 100_000]));
    }
    edit(draws, bytes)
}

/// The header with one edit or one number replaced, and its length.
fn safetensors(draws: &mut Draws, bytes: &[u8]) -> Option<(String, Vec<u8>)> {
    let old = header(bytes)?;
    let (what, text) = if draws.below(2) == 0 { edit(draws, old)? } else { number(draws, old)? };
    let length = (text.len() as u64).to_le_bytes();
    Some((format!("header: {what}"), [&length, &text[..], &bytes[8 + old.len()..]].concat()))
}

/// The JSON chunk with one edit or one number replaced, and all lengths.
fn glb(draws: &mut Draws, bytes: &[u8]) -> Option<(String, Vec<u8>)> {
    let word = |at: usize| Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?) as usize);
    let old = bytes.get(20..20 + word(12)?)?;
    let (what, mut text) = if draws.below(2) == 0 { edit(draws, old)? } else { number(draws, old)? };
    text.resize(text.len().next_multiple_of(4), b' ');
    let rest = &bytes[20 + old.len()..];
    let total = (20 + text.len() + rest.len()) as u32;
    let mut out = bytes[..8].to_vec();
    out.extend(total.to_le_bytes());
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(b"JSON");
    Some((format!("JSON chunk: {what}"), [&out, &text[..], rest].concat()))
}

/// Members of an archive.
fn members(bytes: &[u8]) -> Option<Vec<(String, Vec<u8>)>> {
    let mut zip = zip::ZipArchive::new(Cursor::new(bytes)).ok()?;
    let mut out = Vec::new();
    for i in 0..zip.len() {
        let mut member = zip.by_index(i).ok()?;
        let mut data = Vec::new();
        member.read_to_end(&mut data).ok()?;
        out.push((member.name().ok()?.into_owned(), data));
    }
    Some(out)
}

/// Changes a member or its name and writes the archive anew, with right checksums.
fn archive(draws: &mut Draws, bytes: &[u8], others: &[&[u8]]) -> Option<(String, Vec<u8>)> {
    let mut all = members(bytes)?;
    if all.is_empty() {
        return None;
    }
    let (i, j) = (draws.below(all.len()), draws.below(all.len()));
    let name = all[i].0.clone();
    let what = match draws.below(12) {
        0 => {
            all.remove(i);
            "removed".into()
        }
        1 => {
            all[i].0 =
                ["../a.npy", "a\u{1b}[31m.npy", "", "x", "a/b.npy", "means.npy\0"][draws.below(6)].into();
            format!("renamed to {:?}", all[i].0)
        }
        2 => {
            let data = std::mem::take(&mut all[i].1);
            all[i].1 = std::mem::replace(&mut all[j].1, data);
            format!("exchanged with '{}'", all[j].0)
        }
        3 => {
            let data = all[i].1.clone();
            all.push((format!("{name}.npy"), data));
            "copied".into()
        }
        4..=6 => {
            let reach = Ord::min(all[i].1.len(), 128);
            let (what, text) = number(draws, &all[i].1[..reach])?;
            all[i].1.splice(..reach, text);
            what
        }
        n => {
            let reach = if n < 9 { Ord::min(all[i].1.len(), 128) } else { all[i].1.len() };
            let (what, data) = mutated(draws, &all[i].1, reach, others);
            all[i].1 = data;
            what
        }
    };
    let mut out = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let packing = [zip::CompressionMethod::Stored, zip::CompressionMethod::Deflated][draws.below(2)];
    for (name, data) in all {
        out.start_file(name, zip::write::SimpleFileOptions::default().compression_method(packing)).ok()?;
        out.write_all(&data).ok()?;
    }
    Some((format!("member '{name}' {what}, {packing:?}"), out.finish().ok()?.into_inner()))
}

/// The checksum of PNG.
fn crc(bytes: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for &byte in bytes {
        crc ^= u32::from(byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 };
        }
    }
    !crc
}

/// Changes a chunk and gives it the right length and checksum.
fn png(draws: &mut Draws, bytes: &[u8], others: &[&[u8]]) -> Option<(String, Vec<u8>)> {
    let (mut chunks, mut at): (Vec<Vec<u8>>, usize) = (Vec::new(), 8);
    while at < bytes.len() {
        let length = u32::from_be_bytes(*bytes.get(at..)?.first_chunk()?) as usize;
        chunks.push(bytes.get(at + 4..at + 8 + length)?.to_vec());
        at += 12 + length;
    }
    // The header decides most.
    let i = if draws.below(2) == 0 { 0 } else { draws.below(chunks.len()) };
    let name = String::from_utf8_lossy(&chunks[i][..4]).into_owned();
    let what = match draws.below(8) {
        0 => {
            chunks.remove(i);
            "removed".into()
        }
        1 => {
            let copy = chunks[i].clone();
            chunks.insert(i, copy);
            "twice".into()
        }
        n => {
            // Its name with it, now and then.
            let from = if n == 2 { 0 } else { 4 };
            let data = chunks[i].split_off(from);
            let (what, data) = mutated(draws, &data, data.len(), others);
            chunks[i].extend(data);
            what
        }
    };
    let mut out = bytes[..8].to_vec();
    for chunk in chunks {
        out.extend((chunk.len().saturating_sub(4) as u32).to_be_bytes());
        out.extend(&chunk);
        out.extend(crc(&chunk).to_be_bytes());
    }
    Some((format!("chunk {name} {what}"), out))
}
