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

fn numbers(bytes: &[u8]) -> Arr<f64> {
    let npy = npyz::NpyFile::new(bytes).expect("an npy header");
    assert!(npy.order() == npyz::Order::C, "golden arrays are row-major");
    let shape: Vec<usize> = npy.shape().iter().map(|&d| d as usize).collect();
    let text = match npy.dtype() {
        npyz::DType::Plain(text) => text.to_string(),
        other => panic!("a plain dtype, not {other:?}"),
    };
    let data: Vec<f64> = match text.as_str() {
        "<f8" => npy.into_vec().expect("f64"),
        "<f4" => npy.into_vec::<f32>().expect("f32").into_iter().map(f64::from).collect(),
        "<i8" => npy.into_vec::<i64>().expect("i64").into_iter().map(|x| x as f64).collect(),
        "<i4" => npy.into_vec::<i32>().expect("i32").into_iter().map(f64::from).collect(),
        other => panic!("a dtype golden files have, not {other}"),
    };
    Arr::new(&shape, data)
}

/// All arrays of a golden file; without the file says so and gives `None`.
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
