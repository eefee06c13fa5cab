//! Pickles and arrays of objects, written byte by byte as Python 2 and NumPy do.
#![allow(dead_code, reason = "each test program uses its part")]

/// A Python value.
#[derive(Clone, Debug)]
pub(crate) enum Py {
    None,
    Int(i64),
    Float(f64),
    /// `str` of Python 2
    Str(String),
    List(Vec<Py>),
    Tuple(Vec<Py>),
    Dict(Vec<(&'static str, Py)>),
    /// f8, little endian, C order
    Array(Vec<usize>, Vec<f64>),
    /// u4, little endian
    Counts(Vec<usize>, Vec<u32>),
    /// O
    Objects(Vec<usize>, Vec<Py>),
    /// chumpy.ch.Ch
    Ch(Box<Py>),
    /// scipy.sparse.csc.csc_matrix: rows, columns, dense values
    Csc(usize, usize, Vec<f64>),
}

/// Protocol 2.
pub(crate) fn dump(v: &Py) -> Vec<u8> {
    let mut out = vec![0x80, 2];
    put(v, &mut out);
    out.push(b'.');
    out
}

/// A `.npy` of one object, as `np.save` writes a dictionary.
pub(crate) fn object_npy(v: &Py) -> Vec<u8> {
    let mut text = "{'descr': '|O', 'fortran_order': False, 'shape': (), }".to_owned();
    while !(10 + text.len() + 1).is_multiple_of(64) {
        text.push(' ');
    }
    text.push('\n');
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    out.extend((text.len() as u16).to_le_bytes());
    out.extend(text.as_bytes());
    out.extend(dump(&Py::Objects(vec![], vec![v.clone()])));
    out
}

fn int(i: i64, out: &mut Vec<u8>) {
    match i {
        0..=255 => out.extend([b'K', i as u8]),
        _ => match i32::try_from(i) {
            Ok(x) => {
                out.push(b'J');
                out.extend(x.to_le_bytes());
            }
            Err(_) => {
                out.extend([0x8a, 8]);
                out.extend(i.to_le_bytes());
            }
        },
    }
}

fn short(text: &str, out: &mut Vec<u8>) {
    out.extend([b'U', text.len() as u8]);
    out.extend(text.as_bytes());
}

/// `_reconstruct`, then the state with elements `raw` (already on the stack form).
fn array(shape: &[usize], dtype: &str, raw: &[u8], out: &mut Vec<u8>) {
    out.extend(b"cnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\x00\x85U\x01b\x87R(K\x01(");
    shape.iter().for_each(|&d| int(d as i64, out));
    out.extend(b"tcnumpy\ndtype\n");
    short(dtype, out);
    out.extend(b"K\x00K\x01\x87R(K\x03");
    short(if dtype.starts_with('O') { "|" } else { "<" }, out);
    out.extend(b"NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb\x89");
    out.extend(raw);
    out.extend(b"tb");
}

fn bytes(raw: &[u8]) -> Vec<u8> {
    let mut out = vec![b'T'];
    out.extend((raw.len() as u32).to_le_bytes());
    out.extend(raw);
    out
}

fn put(v: &Py, out: &mut Vec<u8>) {
    match v {
        Py::None => out.push(b'N'),
        Py::Int(i) => int(*i, out),
        Py::Float(x) => {
            out.push(b'G');
            out.extend(x.to_be_bytes());
        }
        Py::Str(s) => out.extend(bytes(s.as_bytes())),
        Py::List(items) => {
            out.extend(b"](");
            items.iter().for_each(|i| put(i, out));
            out.push(b'e');
        }
        Py::Tuple(items) => {
            out.push(b'(');
            items.iter().for_each(|i| put(i, out));
            out.push(b't');
        }
        Py::Dict(entries) => {
            out.extend(b"}(");
            for (k, v) in entries {
                short(k, out);
                put(v, out);
            }
            out.push(b'u');
        }
        Py::Array(shape, values) => {
            let raw: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
            array(shape, "f8", &bytes(&raw), out);
        }
        Py::Counts(shape, values) => {
            let raw: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
            array(shape, "u4", &bytes(&raw), out);
        }
        Py::Objects(shape, items) => {
            let mut raw = Vec::new();
            put(&Py::List(items.clone()), &mut raw);
            array(shape, "O8", &raw, out);
        }
        Py::Ch(x) => {
            out.extend(b"ccopy_reg\n_reconstructor\ncchumpy.ch\nCh\nc__builtin__\nobject\nN\x87R}(");
            short("_dirty_vars", out);
            out.extend(b"c__builtin__\nset\n]\x85R");
            short("_itr", out);
            out.push(b'N');
            short("x", out);
            put(x, out);
            out.extend(b"ub");
        }
        Py::Csc(rows, columns, dense) => {
            let (mut data, mut indices, mut starts) = (vec![], vec![], vec![0]);
            for c in 0..*columns {
                for r in 0..*rows {
                    if dense[r * columns + c] != 0.0 {
                        data.push(dense[r * columns + c]);
                        indices.push(r as u32);
                    }
                }
                starts.push(data.len() as u32);
            }
            out.extend(
                b"ccopy_reg\n_reconstructor\ncscipy.sparse.csc\ncsc_matrix\nc__builtin__\nobject\nN\x87R",
            );
            put(
                &Py::Dict(vec![
                    ("format", Py::Str("csc".into())),
                    ("_shape", Py::Tuple(vec![Py::Int(*rows as i64), Py::Int(*columns as i64)])),
                    ("indptr", Py::Counts(vec![starts.len()], starts)),
                    ("indices", Py::Counts(vec![indices.len()], indices)),
                    ("data", Py::Array(vec![data.len()], data)),
                    ("maxprint", Py::Int(50)),
                ]),
                out,
            );
            out.push(b'b');
        }
    }
}
