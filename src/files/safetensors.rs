//! `.safetensors`: named arrays with text metadata; the format of checkpoints.
//!
//! Layout: u64 length of the header, the header (JSON: name → dtype, shape, data offsets), the elements
//! without gaps. Written with names sorted, so equal contents give equal bytes; any reader of the format
//! accepts them.

use super::{MAX_FILE_BYTES, guard, json, name_of, npy, read_bytes};
use crate::num::array::{Array, Arrays};
use crate::{Error, Result};
use safetensors::{Dtype, SafeTensorError, SafeTensors};
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::path::Path;

/// Longest header read, in bytes.
const MAX_HEADER: u64 = 16 << 20;

/// Contents of a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tensors {
    /// The arrays by name.
    pub arrays: Arrays,
    /// Free text by key.
    pub metadata: BTreeMap<String, String>,
}

/// Reads a file. BF16 and F16 are widened to f32, bool to u8, and so on as in [`super::npz`].
///
/// # Errors
/// When the file is not readable, malformed, or contains an element type that is not supported.
pub fn read(path: &Path) -> Result<Tensors> {
    parse(&read_bytes(path, MAX_FILE_BYTES)?, &name_of(path))
}

/// Like [`read`] for bytes in memory; `name` is the file name in errors.
///
/// # Errors
/// See [`read`].
pub fn parse(bytes: &[u8], name: &str) -> Result<Tensors> {
    if bytes.len() < 8 {
        return Err(Error::input(name)
            .at("byte 0: header length")
            .expected("8 bytes")
            .got(bytes.len().to_string()));
    }
    let mut c = super::bytes::Cursor::new(bytes, name);
    let header = c.u64(format_args!("header length"))?;
    if header > MAX_HEADER || header > c.left() as u64 {
        return Err(Error::input(name)
            .at("byte 0: header length")
            .expected(format!("at most {} bytes", crate::num::order::min(MAX_HEADER, c.left() as u64)))
            .got(header.to_string()));
    }
    guard(name, || {
        let end = 8 + header as usize;
        let explained = |e: SafeTensorError| explain(name, &bytes[8..end], bytes.len() - end, &e);
        let (_, meta) = SafeTensors::read_metadata(bytes).map_err(explained)?;
        let tensors = SafeTensors::deserialize(bytes).map_err(explained)?;
        let metadata = meta.metadata().clone().unwrap_or_default().into_iter().collect();
        let mut arrays = Arrays::new();
        for (key, view) in tensors.iter() {
            let array = decode(view.dtype(), view.shape(), view.data(), name)
                .map_err(|e| e.at(format!("array '{key}'")))?;
            arrays.0.insert(key.to_owned(), array);
        }
        Ok(Tensors { arrays, metadata })
    })
}

fn decode(dtype: Dtype, shape: &[usize], data: &[u8], name: &str) -> Result<Array> {
    let descr = match dtype {
        Dtype::BOOL => "|b1",
        Dtype::U8 => "|u1",
        Dtype::I8 => "|i1",
        Dtype::U16 => "<u2",
        Dtype::I16 => "<i2",
        Dtype::U32 => "<u4",
        Dtype::I32 => "<i4",
        Dtype::U64 => "<u8",
        Dtype::I64 => "<i8",
        Dtype::F16 => "<f2",
        Dtype::F32 => "<f4",
        Dtype::F64 => "<f8",
        Dtype::BF16 => {
            // The upper half of an f32.
            let wide: Vec<u8> = data.chunks_exact(2).flat_map(|c| [0, 0, c[0], c[1]]).collect();
            return decode(Dtype::F32, shape, &wide, name);
        }
        other => {
            let expected = "bool, an integer, bf16, f16, f32 or f64";
            return Err(Error::input(name).at("dtype").expected(expected).got(format!("{other:?}")));
        }
    };
    npy::decode(&npy::plain(descr, shape, name)?, data, name)
}

/// The decoder's error, with the place added that the decoder does not report.
fn explain(name: &str, header: &[u8], data: usize, e: &SafeTensorError) -> Error {
    let file = Error::input(name);
    let fault =
        || fault(header, data).unwrap_or_else(|| ("header".into(), "consistent sizes".into(), e.to_string()));
    match e {
        SafeTensorError::InvalidOffset(_)
        | SafeTensorError::TensorInvalidInfo
        | SafeTensorError::ValidationOverflow
        | SafeTensorError::MetadataIncompleteBuffer => {
            let (at, expected, got) = fault();
            file.at(at).expected(expected).got(got)
        }
        SafeTensorError::InvalidHeaderDeserialization(e) => {
            let (expected, got) = json::describe(header, e);
            file.at(format!("header, byte {}", 8 + e.column())).expected(expected).got(got)
        }
        other => file.at("header").expected("a safetensors header").got(other.to_string()),
    }
}

/// Finds the first array whose offsets disagree with its shape, with the array before it, or with the file.
fn fault(header: &[u8], data: usize) -> Option<(String, String, String)> {
    let entries: Map<String, Value> = serde_json::from_slice(header).ok()?;
    let mut ranges = Vec::new();
    for (key, entry) in entries.iter().filter(|(k, _)| *k != "__metadata__") {
        let offsets: Vec<u64> =
            entry.get("data_offsets")?.as_array()?.iter().map(Value::as_u64).collect::<Option<_>>()?;
        ranges.push((*offsets.first()?, *offsets.get(1)?, key, entry));
    }
    ranges.sort_by(|a, b| (a.0, a.1, a.2).cmp(&(b.0, b.1, b.2)));
    let mut at = 0;
    for (start, end, key, entry) in ranges {
        let place = format!("array '{key}', data_offsets");
        if start != at || end < start {
            return Some((place, format!("a range that starts at {at}"), format!("[{start}, {end}]")));
        }
        let dtype: Dtype = serde_json::from_value(entry.get("dtype")?.clone()).ok()?;
        let shape: Vec<u64> = serde_json::from_value(entry.get("shape")?.clone()).ok()?;
        let bits = shape.iter().try_fold(dtype.bitsize() as u64, |n, &d| n.checked_mul(d));
        if bits != (end - start).checked_mul(8) {
            let size = bits.map_or("too many".to_owned(), |b| (b / 8).to_string());
            return Some((
                place,
                format!("{size} bytes for shape {shape:?} of {dtype:?}"),
                (end - start).to_string(),
            ));
        }
        at = end;
    }
    Some(("data".into(), format!("{at} bytes after the header"), data.to_string()))
}

/// How single-precision arrays are written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// As they are.
    #[default]
    Single,
    /// As the nearest half-precision numbers.
    Half,
}

/// The bytes of a file; equal contents give equal bytes.
pub fn to_bytes(arrays: &Arrays, metadata: &BTreeMap<String, String>) -> Vec<u8> {
    to_bytes_in(Precision::Single, arrays, metadata)
}

/// Like [`to_bytes`], with single-precision arrays in the given precision.
pub fn to_bytes_in(precision: Precision, arrays: &Arrays, metadata: &BTreeMap<String, String>) -> Vec<u8> {
    let width = |a: &Array| if is_half(precision, a) { 2 } else { width(a) };
    let code = |a: &Array| if is_half(precision, a) { "F16" } else { code(a) };
    let mut header = Map::new();
    if !metadata.is_empty() {
        header.insert("__metadata__".into(), json!(metadata));
    }
    // Wide elements first, so that every array starts at a multiple of its element size.
    let mut sorted: Vec<(&String, &Array)> = arrays.0.iter().collect();
    sorted.sort_by_key(|(_, a)| std::cmp::Reverse(width(a)));
    let mut at = 0;
    for (key, a) in &sorted {
        let end = at + width(a) * a.len();
        let entry = json!({ "dtype": code(a), "shape": a.shape(), "data_offsets": [at, end] });
        header.insert((*key).clone(), entry);
        at = end;
    }
    let mut text = Value::Object(header).to_string();
    while !text.len().is_multiple_of(8) {
        text.push(' ');
    }
    let mut out = Vec::with_capacity(8 + text.len() + at);
    out.extend_from_slice(&(text.len() as u64).to_le_bytes());
    out.extend_from_slice(text.as_bytes());
    for (_, a) in sorted {
        match a {
            Array::F32(values) if precision == Precision::Half => {
                out.extend(values.iter().flat_map(|x| npy::half_from_f32(*x).to_le_bytes()));
            }
            _ => npy::elements_le(a, &mut out),
        }
    }
    out
}

/// The half-precision number nearest to `x`, as a file of that precision holds it.
pub fn rounded_to_half(x: f32) -> f32 {
    npy::half_to_f32(npy::half_from_f32(x))
}

fn is_half(precision: Precision, a: &Array) -> bool {
    precision == Precision::Half && matches!(a, Array::F32(_))
}

fn width(a: &Array) -> usize {
    match a {
        Array::U8(_) | Array::I8(_) => 1,
        Array::F32(_) | Array::I32(_) => 4,
        Array::F64(_) | Array::I64(_) => 8,
    }
}

fn code(a: &Array) -> &'static str {
    match a {
        Array::F32(_) => "F32",
        Array::F64(_) => "F64",
        Array::U8(_) => "U8",
        Array::I8(_) => "I8",
        Array::I32(_) => "I32",
        Array::I64(_) => "I64",
    }
}

/// Writes a file atomically.
///
/// # Errors
/// When it cannot be written, or an array is called `__metadata__`.
pub fn write(path: &Path, arrays: &Arrays, metadata: &BTreeMap<String, String>) -> Result<()> {
    write_in(path, Precision::Single, arrays, metadata)
}

/// Like [`write()`], with single-precision arrays in the given precision.
///
/// # Errors
/// See [`write()`].
pub fn write_in(
    path: &Path,
    precision: Precision,
    arrays: &Arrays,
    metadata: &BTreeMap<String, String>,
) -> Result<()> {
    if arrays.get("__metadata__").is_some() {
        return Err(Error::input(name_of(path))
            .at("array '__metadata__'")
            .expected("another name")
            .got("the reserved one"));
    }
    super::atomic::write_bytes(path, &to_bytes_in(precision, arrays, metadata))
}
