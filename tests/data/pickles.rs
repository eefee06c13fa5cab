//! The restricted unpickler: values of every protocol, a fixed list of names, bounds on memory, depth and
//! time.

use crate::common::not_run;
use crate::python::{Py, dump, object_npy};
use lastlight::io::pickle::{NAMES, Value, parse, parse_npy};
use lastlight::num::array::Array;
use std::process::Command;

fn read(bytes: &[u8]) -> Value {
    parse(bytes, "a.pkl").unwrap_or_else(|e| panic!("{e}: {}", bytes.escape_ascii()))
}

/// Refused with all of these parts in one line.
fn refused(bytes: &[u8], parts: &[&str]) {
    let e = parse(bytes, "a.pkl").map(|v| v.describe()).expect_err("a bad pickle").to_string();
    for part in parts {
        assert!(e.contains(part), "'{part}' in '{e}'");
    }
    assert!(e.contains("a.pkl"), "names the file: {e}");
}

fn text(t: &str) -> Value {
    Value::Text(t.into())
}

#[test]
fn opcodes_of_all_protocols() {
    for (bytes, expected) in [
        (&b"N."[..], Value::None),
        (b"I00\n.", Value::Bool(false)),
        (b"I01\n.", Value::Bool(true)),
        (b"I-7\n.", Value::Int(-7)),
        (b"L4294967295L\n.", Value::Int(4_294_967_295)),
        (b"J\xfe\xff\xff\xff.", Value::Int(-2)),
        (b"M\x01\x02.", Value::Int(513)),
        (b"\x8a\x02\xff\x00.", Value::Int(255)),
        (b"\x8a\x00.", Value::Int(0)),
        (b"\x8b\x01\x00\x00\x00\xff.", Value::Int(-1)),
        (b"F-1.5\n.", Value::Float(-1.5)),
        (b"G\x3f\xf8\x00\x00\x00\x00\x00\x00.", Value::Float(1.5)),
        (b"S'a\\x41\\n\\101\\\\'\n.", text("aA\nA\\")),
        (b"S\"it's\"\n.", text("it's")),
        (b"U\x02\xff\xfe.", Value::Bytes(vec![255, 254])),
        (b"V\\u00e9x\n.", text("éx")),
        (b"X\x02\x00\x00\x00\xc3\xa9.", text("é")),
        (b"\x80\x04\x8c\x01a.", text("a")),
        (b"\x80\x04\x95\x05\x00\x00\x00\x00\x00\x00\x00\x8c\x01a\x94..", text("a")),
        (b"C\x02\x00\x01.", Value::Bytes(vec![0, 1])),
        (b"\x80\x05\x96\x01\x00\x00\x00\x00\x00\x00\x00\x07.", Value::Bytes(vec![7])),
        (b"(lp0\nI1\naI2\na.", Value::List(vec![Value::Int(1), Value::Int(2)])),
        (b"(I1\nI2\nt.", Value::Tuple(vec![Value::Int(1), Value::Int(2)])),
        (b"K\x01K\x02\x86.", Value::Tuple(vec![Value::Int(1), Value::Int(2)])),
        (b"(dp0\nS'a'\nI1\ns.", Value::Dict(vec![(text("a"), Value::Int(1))])),
        (b"]q\x00(K\x01K\x02e.", Value::List(vec![Value::Int(1), Value::Int(2)])),
        (b"\x8f(K\x01\x90.", Value::List(vec![Value::Int(1)])),
        (b"K\x07q\x05K\x08h\x05\x86.", Value::Tuple(vec![Value::Int(8), Value::Int(7)])),
        (b"K\x01K\x020.", Value::Int(1)),
        (b"(K\x011K\x02.", Value::Int(2)),
        (b"K\x032\x86.", Value::Tuple(vec![Value::Int(3), Value::Int(3)])),
    ] {
        assert_eq!(read(bytes), expected, "{}", bytes.escape_ascii());
    }
    assert_eq!(
        read(b"ccollections\nOrderedDict\n(](](K\x01K\x02eetR."),
        Value::Dict(vec![(Value::Int(1), Value::Int(2))]),
        "an ordered dictionary of Python 2"
    );
}

#[test]
fn arrays_sparse_matrices_and_chumpy_as_python_2_writes_them() {
    let dense = vec![0.0, 1.5, 0.0, -2.0, 0.0, 0.25];
    let v = read(&dump(&Py::Dict(vec![
        ("a", Py::Array(vec![2, 3], (0..6).map(f64::from).collect())),
        ("tree", Py::Counts(vec![2], vec![u32::MAX, 0])),
        ("shapes", Py::Ch(Box::new(Py::Array(vec![2], vec![1.0, 2.0])))),
        ("J", Py::Csc(2, 3, dense.clone())),
        ("objects", Py::Objects(vec![2], vec![Py::Int(1), Py::Str("x".into())])),
    ])));
    let array =
        |key: &str| v.get(key).and_then(Value::to_array).unwrap_or_else(|| panic!("{key} is an array"));
    assert_eq!(array("a"), Array::new(&[2, 3], (0..6).map(f64::from).collect::<Vec<f64>>()), "values");
    assert_eq!(array("tree"), Array::new(&[2], vec![4_294_967_295i64, 0]), "32 bits without sign");
    assert_eq!(array("shapes"), Array::new(&[2], vec![1.0, 2.0]), "what the Ch holds");
    assert_eq!(array("J"), Array::new(&[2, 3], dense), "columns written out");
    assert_eq!(
        v.get("objects"),
        Some(&Value::Objects(vec![2], vec![Value::Int(1), text("x")])),
        "objects stay values"
    );
    let npy = object_npy(&Py::Dict(vec![("Rh", Py::Array(vec![1, 3], vec![0.1, 0.2, 0.3]))]));
    let (shape, values) = parse_npy(&npy, "0.npy").expect("valid").numbers("Rh", "0.npy").expect("numbers");
    assert_eq!((shape, values), (vec![1, 3], vec![0.1, 0.2, 0.3]), "a dictionary in an array of rank 0");
}

#[test]
fn names_that_are_not_on_the_list_are_refused_and_nothing_runs() {
    let trace = tempfile::tempdir().expect("a temporary folder");
    let file = trace.path().join("ran");
    let command = format!("touch {}", file.display());
    let mut system = b"cos\nsystem\n(S'".to_vec();
    system.extend(command.as_bytes());
    system.extend(b"'\ntR.");
    refused(&system, &["os.system", "nothing was run"]);
    let mut stacked = b"\x80\x04\x8c\x05posix\x8c\x06system\x93\x8c".to_vec();
    stacked.push(command.len() as u8);
    stacked.extend(command.as_bytes());
    stacked.extend(b"\x85R.");
    refused(&stacked, &["posix.system"]);
    assert!(!file.exists(), "no command was run");
    for (module, name) in [
        ("__builtin__", "eval"),
        ("builtins", "exec"),
        ("builtins", "getattr"),
        ("numpy", "load"),
        ("numpy.core.multiarray", "fromfile"),
        ("numpy.testing._private.utils", "runstring"),
        ("subprocess", "Popen"),
        ("chumpy.ch", "MatVecMult"),
        ("numpy.ndarray", "tofile"),
        ("", "system"),
    ] {
        let named = format!("{module}.{name}");
        refused(format!("c{module}\n{name}\n.").as_bytes(), &[&named]);
        refused(format!("(i{module}\n{name}\n.").as_bytes(), &[&named]);
    }
    refused(b"Pabc\n.", &["persistent"]);
    refused(b"\x82\x01.", &["extension"]);
    // A name on the list is a value to call, not a value.
    for (module, name) in NAMES {
        refused(format!("c{module}\n{name}\n.").as_bytes(), &["the name"]);
    }
    refused(b"cnumpy.core.multiarray\n_reconstruct\n(c__builtin__\nobject\nK\x00\x85U\x01btR.", &["ndarray"]);
    refused(b"cnumpy\ndtype\n(U\x02f8K\x00K\x01tR}b.", &["tuple"]);
    refused(b"ccopy_reg\n_reconstructor\n(c__builtin__\nobject\nc__builtin__\nobject\nNtR.", &["class"]);
}

#[test]
fn bombs_end_in_an_error() {
    // Ten lists of ten of the one before: 10^12 values from 300 bytes.
    let mut laughs = b"]q\x00(K\x01K\x02e0".to_vec();
    for level in 0..12u8 {
        laughs.push(b']');
        laughs.extend([b'q', level + 1, b'(']);
        (0..10).for_each(|_| laughs.extend([b'h', level]));
        laughs.extend(b"e0");
    }
    laughs.extend([b'h', 12, b'.']);
    refused(&laughs, &["many times"]);
    // A list that contains itself.
    refused(b"]q\x00h\x00a.", &["contains itself"]);
    // Nested a thousand deep.
    let mut deep = vec![b']'; 1000];
    deep.extend(vec![b'a'; 999]);
    deep.push(b'.');
    refused(&deep, &["levels"]);
    // Declared sizes beyond the file.
    refused(b"T\xff\xff\xff\x7fabc.", &["payload", "before the end"]);
    refused(b"\x80\x04\x8e\xff\xff\xff\xff\xff\xff\xff\x7fabc.", &["payload"]);
    refused(b"\x80\x04\x95\xff\xff\xff\xff\xff\xff\xff\x7f.", &["frame"]);
    let mut huge = dump(&Py::Csc(2, 2, vec![1.0; 4]));
    let at = huge.windows(5).position(|w| w == b"(K\x02K\x02").expect("the shape is there");
    huge.splice(at + 1..at + 5, *b"J\xff\xff\xff\x7fJ\xff\xff\xff\x7f");
    refused(&huge, &["2^22"]);
    // Elements that are not there.
    let array = dump(&Py::Array(vec![3], vec![1.0, 2.0]));
    refused(&array, &["24 bytes", "16"]);
    refused(&dump(&Py::Array(vec![1 << 31, 1 << 31, 1 << 31], vec![])), &["size that can be held"]);
    // A text of a megabyte, turned into bytes again and again: each time a copy of its own, six bytes of
    // file.
    let mut copies = b"\x80\x02c_codecs\nencode\nq\x00X\x00\x00\x10\x00".to_vec();
    copies.extend(vec![b'a'; 1 << 20]);
    copies.extend(b"X\x06\x00\x00\x00latin1\x86q\x010");
    (0..1000).for_each(|_| copies.extend(b"h\x00h\x01R0"));
    copies.extend(b"N.");
    refused(&copies, &["many times"]);
    // The same with a long tuple of arguments that a call refuses only after checking it.
    let mut sets = b"\x80\x02c__builtin__\nset\nq\x00(".to_vec();
    sets.extend(vec![b'N'; 1 << 18]);
    sets.extend(b"l\x85q\x010");
    (0..1000).for_each(|_| sets.extend(b"h\x00h\x01R0"));
    sets.extend(b"N.");
    refused(&sets, &["many times"]);
    // Columns without entries: some hundred bytes of file, 32 MiB of zeros, three times.
    let empty = dump(&Py::Csc(1, 1, vec![0.0]));
    let at = empty.windows(5).position(|w| w == b"(K\x01K\x01").expect("the shape is there");
    let mut tall = empty;
    tall.splice(at + 1..at + 3, *b"J\x00\x00\x40\x00");
    let end = tall.pop();
    assert_eq!(end, Some(b'.'), "STOP");
    assert!(parse(&[&tall[..], b"."].concat(), "one.pkl").is_ok(), "one of them may be");
    tall.extend(b"q\xf00(h\xf0h\xf0h\xf0l.");
    refused(&tall, &["many times"]);
    // Nothing, in more places than can be counted: a list, but no array.
    let mut flat = dump(&Py::Array(vec![0, 1 << 43], vec![]));
    assert_eq!(flat.pop(), Some(b'.'), "STOP");
    flat.extend(b"q\xf00(");
    (0..1 << 20).for_each(|_| flat.extend(b"h\xf0"));
    flat.extend(b"l.");
    assert!(parse(&flat, "flat.pkl").expect("a list").to_array().is_none(), "no array of 2^63 columns");
    let many = [vec![b'N'; (1 << 22) + 2], b".".to_vec()].concat();
    refused(&many, &["values"]);
    refused(&[vec![b'('; 1 << 24], b".".to_vec()].concat(), &["opcodes"]);
}

#[test]
fn cut_or_spoiled_files_end_in_an_error() {
    let valid = dump(&Py::Dict(vec![
        ("a", Py::Array(vec![2], vec![1.0, 2.0])),
        ("s", Py::Ch(Box::new(Py::Array(vec![1], vec![1.0])))),
        ("J", Py::Csc(2, 2, vec![1.0, 0.0, 0.0, 1.0])),
        ("l", Py::List(vec![Py::None, Py::Float(0.5), Py::Tuple(vec![])])),
    ]));
    read(&valid);
    for n in 0..valid.len() {
        refused(&valid[..n], &[]);
    }
    // Every byte changed in several ways: an error or a value, never a panic.
    for at in 0..valid.len() {
        for change in [1u8, 0x80, 0xff, valid[at] ^ b'(', valid[at] ^ b'b'] {
            let mut bytes = valid.clone();
            bytes[at] ^= change;
            let _ = parse(&bytes, "a.pkl");
        }
    }
    for (bytes, part) in [
        (&b"."[..], "a value on the stack"),
        (b"\x80\x06N.", "protocol 0 to 5"),
        (b"K\x01a.", "a value on the stack"),
        (b"K\x01K\x02a.", "a list to append to"),
        (b"t.", "a mark"),
        (b"(K\x01u.", "in turn"),
        (b"}(K\x01u.", "in turn"),
        (b"h\x07.", "memo 7"),
        (b"\x8a\x09\x00\x00\x00\x00\x00\x00\x00\x00\x01.", "64 bits"),
        (b"L99999999999999999999L\n.", "64 bits"),
        (b"Fnothing\n.", "a number"),
        (b"X\x01\x00\x00\x00\xff.", "UTF-8"),
        (b"S'open\n.", "quoted"),
        (b"\xee.", "opcode"),
        (b"c_codecs\nencode\n(V\\u0394\nVlatin1\ntR.", "below 256"),
        (b"c_codecs\nencode\n(Va\nVrot13\ntR.", "latin1"),
    ] {
        refused(bytes, &[part]);
    }
    assert!(parse_npy(b"\x93NUMPY\x01\x00\xff\xff", "a.npy").is_err(), "a header that is not there");
}

/// What Python makes of the same values, for protocols 0 to 5.
const SCRIPT: &str = r#"
import pickle, sys, collections
import numpy as np
value = {
    "none": None, "true": True, "int": -5, "big": 2**40, "float": 0.1, "text": "é\n'x'", "bytes": b"\x00\xff", "empty": b"",
    "list": [1, [2.5, "a"]], "tuple": (1, 2, 3, 4), "set": {7}, "ordered": collections.OrderedDict([("b", 1), ("a", 2)]),
    "f8": np.arange(6.0).reshape(2, 3), "f4": np.float32([[1.5, -2.0]]), "i4": np.array([1, -2], ">i4"),
    "fortran": np.asfortranarray(np.arange(6).reshape(2, 3)), "bool": np.array([True, False]), "scalar": np.float64(2.5),
    "index": np.int64(-3), "rank0": np.array(4.0), "none_there": np.zeros((0, 3)), "names": np.array(["a", "bcd"]),
    "objects": np.array([{"k": 1}, None], object), "words": np.array([b"ab"]),
}
value["shared"] = value["f8"]
for protocol in range(6):
    with open(f"{sys.argv[1]}/{protocol}.pkl", "wb") as f:
        pickle.dump(value, f, protocol)
np.save(f"{sys.argv[1]}/dict.npy", {"cams": {"K": [np.eye(3)]}, "ims": [{"ims": ["a/0.jpg"]}]})
np.save(f"{sys.argv[1]}/plain.npy", np.arange(3))
class Evil:
    def __reduce__(self):
        import os
        return (os.system, ("touch " + sys.argv[1] + "/ran",))
for protocol in range(6):
    with open(f"{sys.argv[1]}/evil{protocol}.pkl", "wb") as f:
        pickle.dump([1, Evil()], f, protocol)
"#;

#[test]
fn what_python_writes() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let script = folder.path().join("make.py");
    std::fs::write(&script, SCRIPT).expect("written");
    let made = Command::new("python3").arg(&script).arg(folder.path()).output();
    match made {
        Ok(o) if o.status.success() => {}
        other => {
            let why =
                other.map_or_else(|e| e.to_string(), |o| String::from_utf8_lossy(&o.stderr).into_owned());
            return not_run(&format!("python3 with numpy: {}", why.lines().last().unwrap_or_default()));
        }
    }
    let floats = |v: Vec<f64>, shape: &[usize]| Value::Array(Array::new(shape, v));
    for protocol in 0..6 {
        let bytes = std::fs::read(folder.path().join(format!("{protocol}.pkl"))).expect("made");
        let v = read(&bytes);
        let is = |key: &str, expected: Value| {
            assert_eq!(v.get(key), Some(&expected), "protocol {protocol}: {key}");
        };
        is("none", Value::None);
        is("true", Value::Bool(true));
        is("int", Value::Int(-5));
        is("big", Value::Int(1 << 40));
        is("float", Value::Float(0.1));
        is("text", text("é\n'x'"));
        is("bytes", Value::Bytes(vec![0, 255]));
        is("empty", Value::Bytes(vec![]));
        is("list", Value::List(vec![Value::Int(1), Value::List(vec![Value::Float(2.5), text("a")])]));
        is("tuple", Value::Tuple((1..5).map(Value::Int).collect()));
        is("set", Value::List(vec![Value::Int(7)]));
        is("ordered", Value::Dict(vec![(text("b"), Value::Int(1)), (text("a"), Value::Int(2))]));
        is("f8", floats((0..6).map(f64::from).collect(), &[2, 3]));
        is("shared", floats((0..6).map(f64::from).collect(), &[2, 3]));
        is("f4", Value::Array(Array::new(&[1, 2], vec![1.5f32, -2.0])));
        is("i4", Value::Array(Array::new(&[2], vec![1i32, -2])));
        is("fortran", Value::Array(Array::new(&[2, 3], (0..6).collect::<Vec<i64>>())));
        is("bool", Value::Array(Array::new(&[2], vec![1u8, 0])));
        is("scalar", Value::Float(2.5));
        is("index", Value::Int(-3));
        is("rank0", floats(vec![4.0], &[]));
        is("none_there", floats(vec![], &[0, 3]));
        is("names", Value::Objects(vec![2], vec![text("a"), text("bcd")]));
        is(
            "objects",
            Value::Objects(vec![2], vec![Value::Dict(vec![(text("k"), Value::Int(1))]), Value::None]),
        );
        assert!(matches!(v.get("words"), Some(Value::Unread(_))), "protocol {protocol}: bytes are described");
        let evil = std::fs::read(folder.path().join(format!("evil{protocol}.pkl"))).expect("made");
        refused(&evil, &["system"]);
    }
    assert!(!folder.path().join("ran").exists(), "nothing was run");
    let npy = |name: &str| {
        let bytes = std::fs::read(folder.path().join(name)).expect("made");
        parse_npy(&bytes, name).expect("read")
    };
    let dict = npy("dict.npy");
    let ims = dict.get("ims").and_then(Value::items).expect("a list of frames");
    assert_eq!(ims[0].get("ims"), Some(&Value::List(vec![text("a/0.jpg")])), "paths");
    assert_eq!(npy("plain.npy"), Value::Array(Array::new(&[3], vec![0i64, 1, 2])), "numbers");
}
