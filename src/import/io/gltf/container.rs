//! The container, its JSON, and the bytes it refers to.

use crate::io::bytes::Cursor;
use crate::io::capture;
use crate::{Error, Result};
use base64::Engine;
use gltf::json::validation::{Error as Invalid, Validate};
use gltf::{Document, json};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Extensions a file may require.
pub(super) const EXTENSIONS: [&str; 3] =
    ["KHR_texture_transform", "KHR_materials_emissive_strength", "KHR_mesh_quantization"];

/// The two chunks of a GLB: a header of 12 bytes, then length, type and data of each chunk.
pub(super) fn container<'a>(bytes: &'a [u8], name: &'a str) -> Result<(&'a [u8], Option<&'a [u8]>)> {
    let mut c = Cursor::new(bytes, name);
    c.take(4, format_args!("magic"))?;
    let version = c.u32(format_args!("version"))?;
    if version != 2 {
        return Err(Error::input(name).at("byte 4: version").expected("2").got(version.to_string()));
    }
    let length = c.u32(format_args!("length"))?;
    if u64::from(length) != bytes.len() as u64 {
        return Err(Error::input(name)
            .at("byte 8: length")
            .expected(format!("the {} bytes there are", bytes.len()))
            .got(length.to_string()));
    }
    let (mut text, mut blob) = (None, None);
    while c.left() > 0 {
        let length = c.u32(format_args!("chunk length"))? as usize;
        let kind: [u8; 4] = c.array(format_args!("chunk type"))?;
        let data = c.take(length, format_args!("chunk '{}'", kind.escape_ascii()))?;
        match (&kind, text, blob) {
            (b"JSON", None, None) => text = Some(data),
            (b"BIN\0", Some(_), None) => blob = Some(data),
            // Other chunks are for extensions, and to be ignored.
            (b"JSON" | b"BIN\0", ..) => {
                let e = Error::input(name).at(format!("chunk '{}'", kind.escape_ascii()));
                return Err(e.expected("one JSON chunk, then at most one BIN chunk").got("another order"));
            }
            (_, None, _) => {
                let e = Error::input(name).at("byte 16: chunk type");
                return Err(e.expected("JSON").got(kind.escape_ascii().to_string()));
            }
            _ => {}
        }
    }
    let text =
        text.ok_or_else(|| Error::input(name).at("byte 12").expected("a JSON chunk").got("nothing"))?;
    Ok((text, blob))
}

/// The checked JSON part.
pub(super) fn document(text: &[u8], name: &str) -> Result<Document> {
    let root = json::Root::from_slice(text).map_err(|e| crate::io::json::error(text, name, &e))?;
    if !root.asset.version.starts_with("2.") {
        return Err(Error::input(name)
            .at("asset.version")
            .expected("2.x")
            .got(root.asset.version.chars().take(20).collect::<String>()));
    }
    if let Some(other) = root.extensions_required.iter().find(|e| !EXTENSIONS.contains(&e.as_str())) {
        let hint = match other.as_str() {
            "KHR_draco_mesh_compression" | "EXT_meshopt_compression" => {
                "decompress the meshes, for example with gltf-transform"
            }
            "KHR_texture_basisu" | "EXT_texture_webp" | "EXT_texture_avif" => {
                "convert the images to PNG or JPEG"
            }
            _ => "export without it",
        };
        return Err(Error::input(name)
            .at("extensionsRequired")
            .expected(EXTENSIONS.join(", "))
            .got(other.chars().take(80).collect::<String>())
            .hint(hint));
    }
    let mut first = None;
    root.validate(&root, json::Path::new, &mut |path, e| {
        // Required extensions were checked above.
        if first.is_none() && !matches!(e, Invalid::Unsupported) {
            first = Some((path().to_string(), e));
        }
    });
    match first {
        None => Ok(Document::from_json_without_validation(root)),
        Some((path, e)) => {
            let (expected, got) = match e {
                Invalid::IndexOutOfBounds => ("an index of an object in the file", "an index out of bounds"),
                Invalid::Missing => ("a value", "none"),
                Invalid::Oversize => ("a size that fits into memory", "a larger one"),
                _ => ("a value that glTF allows", "another value"),
            };
            Err(Error::input(name).at(path).expected(expected).got(got))
        }
    }
}

/// Bytes of a URI: a data URI, or a file beside.
pub(super) fn resolve(
    uri: &str,
    name: &str,
    place: &str,
    fetch: &dyn Fn(&str) -> Result<Vec<u8>>,
) -> Result<Vec<u8>> {
    let fail = |expected: &str, got: String| Err(Error::input(name).at(place).expected(expected).got(got));
    let short: String = uri.chars().take(60).collect();
    if let Some(rest) = uri.strip_prefix("data:") {
        let Some((kind, data)) = rest.split_once(',') else {
            return fail("a data URI with a comma", format!("'{short}'"));
        };
        if !kind.ends_with(";base64") {
            return fail("base64 in a data URI", format!("'{}'", kind.chars().take(60).collect::<String>()));
        }
        let decoded = base64::engine::general_purpose::STANDARD.decode(data);
        return decoded.or_else(|e| fail("base64", e.to_string()));
    }
    let Some(path) = percent_decoded(uri) else {
        return fail("a percent-encoded path", format!("'{short}'"));
    };
    match capture::clean(&path) {
        Ok(path) => fetch(&path).map_err(|e| e.within(name).at(place)),
        Err(why) => fail("a path inside the folder of the file", format!("'{short}', {why}")),
    }
}

fn percent_decoded(uri: &str) -> Option<String> {
    let mut out = Vec::with_capacity(uri.len());
    let mut bytes = uri.bytes();
    while let Some(b) = bytes.next() {
        if b == b'%' {
            let mut digit = || char::from(bytes.next()?).to_digit(16);
            let (high, low) = (digit()?, digit()?);
            out.push((high * 16 + low) as u8);
        } else {
            out.push(b);
        }
    }
    String::from_utf8(out).ok()
}

/// The bytes of every buffer.
pub(super) fn buffers(
    document: &Document,
    blob: Option<&[u8]>,
    name: &str,
    fetch: &dyn Fn(&str) -> Result<Vec<u8>>,
) -> Result<Vec<Arc<Vec<u8>>>> {
    let mut files: BTreeMap<&str, Arc<Vec<u8>>> = BTreeMap::new();
    let mut out: Vec<Arc<Vec<u8>>> = Vec::new();
    for b in document.buffers() {
        let place = format!("buffers[{}]", b.index());
        let data = match b.source() {
            gltf::buffer::Source::Uri(uri) => match files.get(uri) {
                Some(known) => Arc::clone(known),
                None => {
                    let data = Arc::new(resolve(uri, name, &place, fetch)?);
                    files.insert(uri, Arc::clone(&data));
                    data
                }
            },
            gltf::buffer::Source::Bin => match blob {
                Some(blob) if b.index() == 0 => Arc::new(blob.to_vec()),
                _ => {
                    return Err(Error::input(name)
                        .at(place)
                        .expected("a uri, or to be the first buffer of a GLB with a BIN chunk")
                        .got("neither"));
                }
            },
        };
        if data.len() < b.length() {
            let e = Error::input(name).at(format!("{place}.byteLength"));
            return Err(e
                .expected(format!("at most the {} bytes there are", data.len()))
                .got(b.length().to_string()));
        }
        out.push(data);
    }
    Ok(out)
}
