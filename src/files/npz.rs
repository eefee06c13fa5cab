//! `.npz` and `.npy`: named arrays as NumPy stores them.
//!
//! Reads every integer width, bool, f16, f32 and f64 in either byte order and in C or Fortran order, from stored or
//! deflated members; writes deterministic bytes (names sorted, one fixed time stamp, no platform field).

use super::{MAX_FILE_BYTES, guard, name_of, npy, read_bytes};
use crate::num::array::Arrays;
use crate::{Error, Result};
use std::io::{Read, Write};
use std::path::Path;
use zip::CompressionMethod;
use zip::write::SimpleFileOptions;

/// How members are stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Packing {
    /// Uncompressed: the bytes depend only on the arrays.
    #[default]
    Stored,
    /// Deflated at level 6: the bytes also depend on the version of the compressor.
    Deflated,
}

/// Deflate compresses by a factor of at most 1032; a larger declared ratio is refused.
const MAX_RATIO: u64 = 1040;
/// Bytes that a file of any size may unpack to; larger files may unpack to 16 times their size.
const MAX_UNPACKED: u64 = 1 << 30;
/// Longest array name.
const MAX_NAME: usize = 1024;

/// Reads a `.npz`, or a `.npy` as one array under the name of the file without its extension.
///
/// # Errors
/// When the file is not readable, malformed, or holds something other than numbers.
pub fn read(path: &Path) -> Result<Arrays> {
    parse(&read_bytes(path, MAX_FILE_BYTES)?, &name_of(path))
}

/// Reads only the arrays of the given names from a `.npz`; missing ones are left out, and the others are not checked.
///
/// # Errors
/// When the file is not readable, the archive is malformed, or an array of these names holds something other than numbers.
pub fn read_some(path: &Path, names: &[&str]) -> Result<Arrays> {
    parse_wanted(&read_bytes(path, MAX_FILE_BYTES)?, &name_of(path), &|key| names.contains(&key))
}

/// Like [`read`] for bytes in memory; `name` is the file name in errors.
///
/// # Errors
/// See [`read`].
pub fn parse(bytes: &[u8], name: &str) -> Result<Arrays> {
    parse_wanted(bytes, name, &|_| true)
}

fn parse_wanted(bytes: &[u8], name: &str, is_wanted: &dyn Fn(&str) -> bool) -> Result<Arrays> {
    let mut out = Arrays::new();
    if bytes.starts_with(npy::MAGIC) {
        let stem = Path::new(name).file_stem().map_or_else(|| "array".into(), |s| s.to_string_lossy());
        out.0.insert(stem.into_owned(), npy::parse(bytes, name)?);
        return Ok(out);
    }
    guard(name, || {
        let broken = |at: String, e: &dyn std::fmt::Display| {
            Error::input(name).at(at).expected("a well-formed zip archive of .npy files").got(e.to_string())
        };
        let reader = std::io::Cursor::new(bytes);
        let mut archive = zip::ZipArchive::new(reader).map_err(|e| broken("zip directory".into(), &e))?;
        let (mut packed_total, mut declared_total) = (0u64, 0u64);
        for i in 0..archive.len() {
            let mut member = archive.by_index(i).map_err(|e| broken(format!("member {i}"), &e))?;
            let member_name = member.name().map_err(|e| broken(format!("member {i}"), &e))?.into_owned();
            let key = match member_name.strip_suffix(".npy") {
                Some(key) if !key.is_empty() && key.len() <= MAX_NAME => key.to_owned(),
                _ => {
                    let shown: String = member_name.chars().take(80).collect();
                    let e = Error::input(name).at(format!("member {i}"));
                    return Err(e.expected("a name ending in .npy").got(format!("'{shown}'")));
                }
            };
            let place = format!("array '{key}'");
            // Members that overlap (a zip bomb) would add up to more than the file.
            packed_total = packed_total.saturating_add(member.compressed_size());
            if packed_total > bytes.len() as u64 {
                return Err(Error::input(name)
                    .at(place)
                    .expected(format!("members that fit side by side into {} bytes", bytes.len()))
                    .got(format!("{packed_total} bytes so far")));
            }
            if !matches!(member.compression(), CompressionMethod::Stored | CompressionMethod::Deflated) {
                let got = format!("{:?}", member.compression());
                return Err(Error::input(name).at(place).expected("a stored or deflated member").got(got));
            }
            let (declared, packed) = (member.size(), member.compressed_size());
            declared_total = declared_total.saturating_add(declared);
            let most = MAX_UNPACKED.max(16 * bytes.len() as u64);
            if declared_total > most {
                return Err(Error::input(name)
                    .at(place)
                    .expected(format!("arrays of at most {most} bytes together"))
                    .got(format!("{declared_total} bytes so far")));
            }
            if !is_wanted(&key) {
                continue;
            }
            let array = read_member(&mut member, declared, packed, name).map_err(|e| e.at(place))?;
            if out.0.insert(key.clone(), array).is_some() {
                return Err(Error::input(name)
                    .at(format!("array '{key}'"))
                    .expected("one member")
                    .got("two"));
            }
        }
        Ok(())
    })?;
    Ok(out)
}

fn read_member(
    member: &mut dyn Read,
    declared: u64,
    packed: u64,
    name: &str,
) -> Result<crate::num::array::Array> {
    let corrupt = |e: std::io::Error| Error::input(name).expected("data that unpack").got(e.to_string());
    let mut exact = |n: u64, at_most: bool| -> Result<Vec<u8>> {
        let mut buffer = Vec::new();
        member.take(n).read_to_end(&mut buffer).map_err(corrupt)?;
        if !at_most && (buffer.len() as u64) < n {
            return Err(Error::input(name)
                .at("npy header")
                .expected(format!("{n} bytes"))
                .got(buffer.len().to_string()));
        }
        Ok(buffer)
    };
    // Ten bytes for version 1, twelve for the others.
    let mut start = exact(10, false)?;
    if start[6] > 1 {
        start.extend(exact(2, false)?);
    }
    let (before, len) = npy::prefix(&start, name)?;
    let header = npy::header(&exact(len as u64, false)?, name)?;
    let expected = (before + len) as u64 + header.data_bytes();
    if declared != expected || expected > packed.saturating_mul(MAX_RATIO).saturating_add(1024) {
        return Err(Error::input(name)
            .at("member size")
            .expected(format!("{expected} bytes, for its shape"))
            .got(format!("{declared} declared, {packed} packed")));
    }
    // One byte more than needed: the archive verifies the checksum only when its end is reached.
    let data = exact(header.data_bytes() + 1, true)?;
    npy::decode(&header, &data, name)
}

/// The bytes of a `.npz`.
///
/// # Errors
/// When a name is longer than a zip archive can hold.
pub fn to_bytes(arrays: &Arrays, packing: Packing) -> Result<Vec<u8>> {
    let failed = |e: &dyn std::fmt::Display| {
        Error::input("npz").expected("arrays that a zip archive can hold").got(e.to_string())
    };
    let mut w = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (key, array) in &arrays.0 {
        let npy = npy::to_bytes(array);
        let options = SimpleFileOptions::default()
            .last_modified_time(zip::DateTime::default())
            .system(zip::System::Unix)
            .unix_permissions(0o644)
            .large_file(npy.len() as u64 >= u64::from(u32::MAX));
        let options = match packing {
            Packing::Stored => options.compression_method(CompressionMethod::Stored),
            Packing::Deflated => {
                options.compression_method(CompressionMethod::Deflated).compression_level(Some(6))
            }
        };
        w.start_file(format!("{key}.npy"), options).map_err(|e| failed(&e))?;
        w.write_all(&npy).map_err(|e| failed(&e))?;
    }
    Ok(w.finish().map_err(|e| failed(&e))?.into_inner())
}

/// Writes a `.npz` with stored members atomically.
///
/// # Errors
/// When the file cannot be written.
pub fn write(path: &Path, arrays: &Arrays) -> Result<()> {
    write_packed(path, arrays, Packing::Stored)
}

/// Writes a `.npz` with a choice of packing.
///
/// # Errors
/// When the file cannot be written.
pub fn write_packed(path: &Path, arrays: &Arrays, packing: Packing) -> Result<()> {
    super::atomic::write_bytes(path, &to_bytes(arrays, packing).map_err(|e| e.within(name_of(path)))?)
}
