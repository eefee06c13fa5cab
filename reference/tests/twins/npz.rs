//! Reading golden files, and comparing arrays.

use std::fs::File;
use std::io::Read;
use std::path::PathBuf;

use reference::array::{Arr, Named};

/// The golden file of that name, if this machine has it.
fn find(name: &str) -> Option<PathBuf> {
    let root = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden").join(name);
    let shared = std::env::var_os("LASTLIGHT_DATA").map(|data| PathBuf::from(data).join("golden").join(name));
    [Some(root), shared].into_iter().flatten().find(|path| path.exists())
}

/// The numbers of a `.npy` as NumPy writes golden files: format version 1, row-major, little-endian.
fn numbers(bytes: &[u8]) -> Arr<f64> {
    let (start, rest) = bytes.split_first_chunk::<10>().expect("the start of an npy file");
    assert_eq!(start[..8], *b"\x93NUMPY\x01\x00", "an npy file of version 1");
    let (header, values) = rest.split_at(usize::from(u16::from_le_bytes([start[8], start[9]])));
    let header = std::str::from_utf8(header).expect("a header in ASCII");
    assert!(header.contains("'fortran_order': False"), "golden arrays are row-major");
    let between = |from: &str, to: &str| {
        let (_, rest) = header.split_once(from).unwrap_or_else(|| panic!("{from} in {header}"));
        rest.split_once(to).unwrap_or_else(|| panic!("{to} in {header}")).0
    };
    let dimensions = between("'shape': (", ")").split(',').map(str::trim).filter(|d| !d.is_empty());
    let shape: Vec<usize> = dimensions.map(|d| d.parse().expect("a dimension")).collect();
    let (fours, eights) = (values.as_chunks::<4>(), values.as_chunks::<8>());
    let (data, rest): (Vec<f64>, _) = match between("'descr': '", "'") {
        "<f8" => (eights.0.iter().map(|b| f64::from_le_bytes(*b)).collect(), eights.1),
        "<f4" => (fours.0.iter().map(|b| f64::from(f32::from_le_bytes(*b))).collect(), fours.1),
        "<i8" => (eights.0.iter().map(|b| i64::from_le_bytes(*b) as f64).collect(), eights.1),
        "<i4" => (fours.0.iter().map(|b| f64::from(i32::from_le_bytes(*b))).collect(), fours.1),
        other => panic!("a dtype golden files have, not {other}"),
    };
    assert!(rest.is_empty(), "whole elements");
    Arr::new(&shape, data)
}

/// All arrays of a golden file; without the file prints a note and returns `None`.
pub(crate) fn golden(name: &str) -> Option<Named<f64>> {
    let file = format!("{name}.npz");
    let Some(path) = find(&file) else {
        use std::io::Write;
        let line = format!("not run: {file} is neither in tests/golden nor in $LASTLIGHT_DATA/golden");
        writeln!(std::io::stderr(), "{line}").expect("standard error is open");
        return None;
    };
    let mut archive = zip::ZipArchive::new(File::open(path).expect("readable")).expect("a zip archive");
    let mut arrays = Named::new();
    for i in 0..archive.len() {
        let mut entry = archive.by_index(i).expect("an entry");
        let name = entry.name().expect("a name").trim_end_matches(".npy").to_owned();
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).expect("entry bytes");
        arrays.insert(name, numbers(&bytes));
    }
    Some(arrays)
}

/// ‖a − b‖ / ‖b‖; 0 when both are zero.
pub(crate) fn relative(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len(), "as many entries");
    let norm = |x: &mut dyn Iterator<Item = f64>| x.fold(0.0, |sum, x| sum + x * x).sqrt();
    let difference = norm(&mut a.iter().zip(b).map(|(a, b)| a - b));
    let size = norm(&mut b.iter().copied());
    if difference == 0.0 { 0.0 } else { difference / size }
}
