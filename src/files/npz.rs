//! `.npz` and `.npy`: named arrays as NumPy stores them.
//!
//! Reads every integer width, bool, f16, f32 and f64 in either byte order and in C or Fortran order, from
//! stored or deflated members; writes deterministic bytes (names sorted, one fixed time stamp, no platform
//! field).

use super::read::reported;
use super::{MAX_FILE_BYTES, guard, memory, name_of, npy, read_bytes};
use crate::num::array::{Array, Arrays};
use crate::{Error, Result};
use std::borrow::Cow;
use std::io::{Cursor, Read, Write};
use std::path::Path;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive};

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
/// Arrays above this size, in bytes, that are deflated by more than [`BOMB_RATIO`] are taken for an attack.
const BOMB_BYTES: u64 = 64 << 20;
/// See [`BOMB_BYTES`].
const BOMB_RATIO: u64 = 200;
/// Longest array name.
const MAX_NAME: usize = 1024;

/// Reads a `.npz`, or a `.npy` as one array under the name of the file without its extension.
///
/// # Errors
/// When the file is not readable, malformed, holds something other than numbers, or would take more memory than the limit.
pub fn read(path: &Path) -> Result<Arrays> {
    Archive::open(path)?.read(&|_| true)
}

/// Reads only the arrays of the given names from a `.npz`; missing ones are left out, and the others are not
/// checked.
///
/// # Errors
/// When the file is not readable, the archive is malformed, or an array of these names is refused by [`read`].
pub fn read_some(path: &Path, names: &[&str]) -> Result<Arrays> {
    Archive::open(path)?.read(&|key| names.contains(&key))
}

/// Like [`read`] for bytes in memory; `name` is the file name in errors.
///
/// # Errors
/// See [`read`].
pub fn parse(bytes: &[u8], name: &str) -> Result<Arrays> {
    Archive::new(Cow::Borrowed(bytes), name)?.read(&|_| true)
}

/// A file whose directory has been read and checked. Arrays are inflated when they are read, and no others are.
pub struct Archive<'a> {
    name: String,
    content: Content<'a>,
}

enum Content<'a> {
    /// A `.npy` file: the name of its array, and its bytes.
    One(String, Cow<'a, [u8]>),
    Zip(ZipArchive<Cursor<Cow<'a, [u8]>>>, Vec<Member>),
}

/// A member of an archive, as the directory states it.
struct Member {
    key: String,
    declared: u64,
    packed: u64,
}

impl Archive<'static> {
    /// Opens a `.npz` or a `.npy`.
    ///
    /// # Errors
    /// When the file is not readable or its directory is malformed.
    pub fn open(path: &Path) -> Result<Self> {
        Self::new(Cow::Owned(read_bytes(path, MAX_FILE_BYTES)?), &name_of(path))
    }
}

impl<'a> Archive<'a> {
    /// Like [`Archive::open`] for bytes in memory; `name` is the file name in errors.
    ///
    /// # Errors
    /// When the directory is malformed.
    pub fn new(bytes: Cow<'a, [u8]>, name: &str) -> Result<Self> {
        if bytes.starts_with(npy::MAGIC) {
            let stem = Path::new(name)
                .file_stem()
                .map_or_else(|| "array".into(), |s| s.to_string_lossy().into_owned());
            return Ok(Self { name: name.to_owned(), content: Content::One(stem, bytes) });
        }
        guard(name, || {
            let size = bytes.len() as u64;
            let mut zip =
                ZipArchive::new(Cursor::new(bytes)).map_err(|e| broken(name, "zip directory".into(), &e))?;
            let (mut members, mut packed) = (Vec::with_capacity(zip.len()), 0_u64);
            for i in 0..zip.len() {
                let member = member(&mut zip, i, name)?;
                // Members that overlap (a zip bomb) would add up to more than the file.
                packed = packed.saturating_add(member.packed);
                if packed > size {
                    return Err(Error::input(name)
                        .at(format!("array '{}'", member.key))
                        .expected(format!("members that fit side by side into {size} bytes"))
                        .got(format!("{packed} bytes so far")));
                }
                members.push(member);
            }
            Ok(Self { name: name.to_owned(), content: Content::Zip(zip, members) })
        })
    }

    /// Names of the arrays, in the order of the file.
    pub fn names(&self) -> Vec<String> {
        match &self.content {
            Content::One(key, _) => vec![key.clone()],
            Content::Zip(_, members) => members.iter().map(|m| m.key.clone()).collect(),
        }
    }

    /// Reads the arrays of the names that are wanted: first all their headers, from which the memory is estimated, then the elements.
    ///
    /// # Errors
    /// When an array holds something other than numbers, is there twice, or is inflated from suspiciously few bytes; when the arrays together
    /// would take more memory than the limit.
    pub fn read(&mut self, is_wanted: &dyn Fn(&str) -> bool) -> Result<Arrays> {
        let name = &self.name;
        let mut out = Arrays::new();
        let (zip, members) = match &mut self.content {
            Content::Zip(zip, members) => (zip, members),
            Content::One(key, bytes) => {
                if is_wanted(key) {
                    out.0.insert(key.clone(), npy::parse(bytes, name)?);
                }
                return Ok(out);
            }
        };
        guard(name, || {
            let (mut wanted, mut total) = (Vec::new(), Total::default());
            for (i, member) in members.iter().enumerate().filter(|(_, m)| is_wanted(&m.key)) {
                let place = format!("array '{}'", member.key);
                let mut data = zip.by_index(i).map_err(|e| broken(name, place.clone(), &e))?;
                let header = header(&mut data, member, name).map_err(|e| e.at(place.clone()))?;
                total.add(member, &header, name).map_err(|e| e.at(place))?;
                wanted.push((i, header));
            }
            memory::check(name, total.bytes)?;
            for (i, expected) in wanted {
                let (member, place) = (&members[i], format!("array '{}'", members[i].key));
                let mut data = zip.by_index(i).map_err(|e| broken(name, place.clone(), &e))?;
                let array = elements(&mut data, member, &expected, name).map_err(|e| e.at(place.clone()))?;
                if out.0.insert(member.key.clone(), array).is_some() {
                    return Err(Error::input(name).at(place).expected("one member").got("two"));
                }
            }
            Ok(())
        })?;
        Ok(out)
    }
}

fn broken(name: &str, at: String, e: &dyn std::fmt::Display) -> Error {
    Error::input(name).at(at).expected("a well-formed zip archive of .npy files").got(reported(e))
}

/// Reads what the directory states about a member.
fn member(zip: &mut ZipArchive<Cursor<Cow<'_, [u8]>>>, i: usize, name: &str) -> Result<Member> {
    let member = zip.by_index(i).map_err(|e| broken(name, format!("member {i}"), &e))?;
    let member_name = member.name().map_err(|e| broken(name, format!("member {i}"), &e))?.into_owned();
    let key = match member_name.strip_suffix(".npy") {
        Some(key) if !key.is_empty() && key.len() <= MAX_NAME => key.to_owned(),
        _ => {
            let shown: String = member_name.chars().take(80).collect();
            let e = Error::input(name).at(format!("member {i}"));
            return Err(e.expected("a name ending in .npy").got(format!("'{shown}'")));
        }
    };
    if !matches!(member.compression(), CompressionMethod::Stored | CompressionMethod::Deflated) {
        let got = format!("{:?}", member.compression());
        let e = Error::input(name).at(format!("array '{key}'"));
        return Err(e.expected("a stored or deflated member").got(got));
    }
    Ok(Member { key, declared: member.size(), packed: member.compressed_size() })
}

/// What the arrays that are read take together.
#[derive(Default)]
struct Total {
    bytes: u64,
    declared: u64,
    packed: u64,
}

impl Total {
    /// Adds an array.
    ///
    /// # Errors
    /// When it, or all so far, are inflated from suspiciously few bytes.
    fn add(&mut self, member: &Member, header: &npy::Header, name: &str) -> Result<()> {
        self.bytes = self.bytes.saturating_add(header.decoded_bytes());
        self.declared = self.declared.saturating_add(member.declared);
        self.packed = self.packed.saturating_add(member.packed);
        for (declared, packed) in [(member.declared, member.packed), (self.declared, self.packed)] {
            if declared > BOMB_BYTES && declared > packed.saturating_mul(BOMB_RATIO) {
                return Err(Error::input(name)
                    .at("compression")
                    .expected(format!(
                        "arrays of up to {}, or deflated by up to {BOMB_RATIO}",
                        memory::size(BOMB_BYTES)
                    ))
                    .got(format!("{} in {}", memory::size(declared), memory::size(packed)))
                    .hint("a file that is what it says can be stored without compression"));
            }
        }
        Ok(())
    }
}

/// Reads the header of a member and compares the size of the member with it.
fn header(data: &mut dyn Read, member: &Member, name: &str) -> Result<npy::Header> {
    let mut exact = |n: usize| -> Result<Vec<u8>> {
        let mut buffer = Vec::new();
        data.take(n as u64).read_to_end(&mut buffer).map_err(|e| corrupt(&e, name))?;
        if buffer.len() < n {
            let e = Error::input(name).at("npy header");
            return Err(e.expected(format!("{n} bytes")).got(buffer.len().to_string()));
        }
        Ok(buffer)
    };
    // Ten bytes for version 1, twelve for the others.
    let mut start = exact(10)?;
    if start[6] > 1 {
        start.extend(exact(2)?);
    }
    let (before, len) = npy::prefix(&start, name)?;
    let header = npy::header(&exact(len)?, name)?;
    let expected = (before + len) as u64 + header.data_bytes();
    if member.declared != expected || expected > member.packed.saturating_mul(MAX_RATIO).saturating_add(1024)
    {
        return Err(Error::input(name)
            .at("member size")
            .expected(format!("{expected} bytes, for its shape"))
            .got(format!("{} declared, {} packed", member.declared, member.packed)));
    }
    Ok(header)
}

fn corrupt(e: &std::io::Error, name: &str) -> Error {
    Error::input(name).expected("data that unpack").got(reported(e))
}

fn elements(data: &mut dyn Read, member: &Member, header: &npy::Header, name: &str) -> Result<Array> {
    let before = member.declared - header.data_bytes();
    std::io::copy(&mut data.take(before), &mut std::io::sink()).map_err(|e| corrupt(&e, name))?;
    let array = npy::decode_from(header, data, name)?;
    // The archive verifies the checksum when its end is reached.
    match data.read(&mut [0]) {
        Ok(0) => Ok(array),
        Ok(_) => Err(Error::input(name).expected(format!("{} bytes", header.data_bytes())).got("more")),
        Err(e) => Err(corrupt(&e, name)),
    }
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
