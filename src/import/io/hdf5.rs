//! HDF5 files of captures, read through `hdf5-reader`: arrays by path, rows of large ones, names in a group.
//!
//! The file is read in parts, never mapped and never read completely: containers have many gigabytes. Links
//! to other files are not followed. Declared sizes are limited before memory is allocated.

use super::{guard, name_of, npy};
use crate::num::array::Array;
use crate::{Error, Result};
use hdf5_reader::filters::FilterRegistry;
use hdf5_reader::messages::filter_pipeline::FilterDescription;
use hdf5_reader::{ByteOrder, Datatype, FileStorage, Hdf5File, OpenOptions, SliceInfo, SliceInfoElem};
use std::path::Path;
use std::sync::Arc;

/// Maximum number of bytes of one read.
const MAX_READ: usize = 1 << 30;
/// Most bytes of one chunk.
const MAX_CHUNK: usize = 1 << 28;

/// h5py's number of its own compression.
const LZF: u16 = 32000;

/// Undoes [`LZF`]; its third number is the size of a chunk.
fn lzf(
    filter: &FilterDescription,
    stream: &[u8],
    _: usize,
) -> std::result::Result<Vec<u8>, hdf5_reader::error::Error> {
    let size = filter.client_data.get(2).map_or(MAX_CHUNK, |size| *size as usize);
    super::lzf::decoded(stream, Ord::min(size, MAX_CHUNK))
        .ok_or_else(|| hdf5_reader::error::Error::DecompressionError("LZF".into()))
}

/// An open file.
pub(super) struct Hdf5 {
    file: Hdf5File,
    name: String,
}

impl std::fmt::Debug for Hdf5 {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Hdf5({})", self.name)
    }
}

/// What the file contains instead, as the crate describes it.
fn found(e: &hdf5_reader::error::Error) -> String {
    use hdf5_reader::error::Error as E;
    match e {
        E::Io(e) => e.kind().to_string(),
        E::InvalidMagic => "a file that does not start as HDF5 does".into(),
        E::GroupNotFound(_) => "no such group".into(),
        E::DatasetNotFound(_) => "no such data set".into(),
        E::ChecksumMismatch { expected, actual } => {
            format!("data with checksum {actual:#010x} instead of {expected:#010x}")
        }
        E::TypeMismatch { expected, actual } => format!("type {actual} instead of {expected}"),
        other => other.to_string(),
    }
}

impl Hdf5 {
    /// Opens a file.
    pub(super) fn open(path: &Path) -> Result<Self> {
        let name = name_of(path);
        let meta = std::fs::metadata(path).map_err(|e| Error::os(path, &e))?;
        if !meta.is_file() {
            return Err(Error::input(name).expected("an HDF5 file").got("something else"));
        }
        let file = guard(&name, || {
            let broken = |e: hdf5_reader::error::Error| {
                Error::input(name.clone()).expected("an HDF5 file").got(found(&e))
            };
            let storage = Arc::new(FileStorage::open(path).map_err(broken)?);
            let mut filters = FilterRegistry::new();
            filters.register(LZF, Box::new(lzf));
            let options = OpenOptions {
                filter_registry: Some(filters),
                max_read_bytes: MAX_READ,
                max_chunk_bytes: MAX_CHUNK,
                ..OpenOptions::default()
            };
            Hdf5File::from_storage_with_options(storage, options).map_err(broken)
        })?;
        Ok(Self { file, name })
    }

    /// Name in errors.
    pub(super) fn name(&self) -> &str {
        &self.name
    }

    fn error(&self, at: &str, expected: &str, got: &dyn std::fmt::Display) -> Error {
        Error::input(self.name.clone()).at(format!("'{at}'")).expected(expected).got(got.to_string())
    }

    fn dataset(&self, at: &str) -> Result<hdf5_reader::Dataset> {
        self.file.dataset(at).map_err(|e| self.error(at, "a data set", &found(&e)))
    }

    /// Whether there is a data set of that path.
    pub(super) fn has(&self, at: &str) -> bool {
        guard(&self.name, || self.dataset(at).map(|_| ())).is_ok()
    }

    /// Groups and data sets of a group, each sorted; of the root for "/".
    pub(super) fn names(&self, at: &str) -> Result<(Vec<String>, Vec<String>)> {
        guard(&self.name, || {
            let group = if at == "/" { self.file.root_group() } else { self.file.group(at) };
            let group = group.map_err(|e| self.error(at, "a group", &found(&e)))?;
            let (mut groups, mut sets) =
                group.member_names().map_err(|e| self.error(at, "a group", &found(&e)))?;
            groups.sort();
            sets.sort();
            Ok((groups, sets))
        })
    }

    /// Shape of a data set.
    pub(super) fn shape(&self, at: &str) -> Result<Vec<usize>> {
        guard(&self.name, || Ok(self.dataset(at)?.shape().iter().map(|&d| d as usize).collect()))
    }

    /// A data set of numbers.
    pub(super) fn array(&self, at: &str) -> Result<Array> {
        guard(&self.name, || {
            let set = self.dataset(at)?;
            let descr = description(set.dtype())
                .ok_or_else(|| self.error(at, "integers or floats", &format!("{:?}", set.dtype())))?;
            let raw =
                set.read_raw_bytes().map_err(|e| self.error(at, "data that can be read", &found(&e)))?;
            let place = format!("{}: '{at}'", self.name);
            let header = npy::described(&descr, false, set.shape(), &place)?;
            npy::decode(&header, &raw, &place)
        })
    }

    /// Finite numbers and their shape.
    pub(super) fn numbers(&self, at: &str) -> Result<(Vec<usize>, Vec<f64>)> {
        let a = self.array(at)?;
        let values = a.to_f64();
        match values.iter().find(|x| !x.is_finite()) {
            Some(x) => Err(self.error(at, "finite numbers", x)),
            None => Ok((a.shape().to_vec(), values)),
        }
    }

    /// The bytes of a data set of bytes.
    pub(super) fn bytes(&self, at: &str) -> Result<Vec<u8>> {
        guard(&self.name, || {
            let set = self.dataset(at)?;
            if !matches!(set.dtype(), Datatype::FixedPoint { size: 1, .. }) {
                return Err(self.error(at, "bytes", &format!("{:?}", set.dtype())));
            }
            set.read_raw_bytes().map_err(|e| self.error(at, "data that can be read", &found(&e)))
        })
    }

    /// Row `i` of a data set (n, H, W) of bytes, with H and W.
    pub(super) fn row(&self, at: &str, i: usize) -> Result<(Vec<u8>, [usize; 2])> {
        guard(&self.name, || {
            let set = self.dataset(at)?;
            let &[n, h, w] = set.shape() else {
                return Err(self.error(at, "shape (n, H, W)", &format!("{:?}", set.shape())));
            };
            if i as u64 >= n {
                return Err(self.error(at, &format!("more than {i} rows"), &n));
            }
            let all = |_| SliceInfoElem::Slice { start: 0, end: u64::MAX, step: 1 };
            let mut selections: Vec<SliceInfoElem> = (0..3).map(all).collect();
            selections[0] = SliceInfoElem::Index(i as u64);
            let which = SliceInfo { selections };
            // Masks are written as signed bytes too; not 0 is not 0.
            let row: Vec<u8> = match set.dtype() {
                Datatype::FixedPoint { signed: true, .. } => {
                    set.read_slice::<i8>(&which).map(|row| row.iter().map(|x| x.cast_unsigned()).collect())
                }
                _ => set.read_slice::<u8>(&which).map(|row| row.iter().copied().collect()),
            }
            .map_err(|e| self.error(at, "rows of bytes", &found(&e)))?;
            Ok((row, [h as usize, w as usize]))
        })
    }
}

/// NumPy's name of an element type.
fn description(t: &Datatype) -> Option<String> {
    let order = |o: &ByteOrder| if matches!(o, ByteOrder::BigEndian) { '>' } else { '<' };
    match t {
        Datatype::FixedPoint { size, signed, byte_order } => {
            Some(format!("{}{}{size}", order(byte_order), if *signed { 'i' } else { 'u' }))
        }
        Datatype::FloatingPoint { size, byte_order } => Some(format!("{}f{size}", order(byte_order))),
        // Encoding of booleans.
        Datatype::Enum { base, .. } => description(base),
        _ => None,
    }
}
