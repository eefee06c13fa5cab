//! One `.npy` array: header and elements, in any order and byte order NumPy writes.
//!
//! Element types are widened to those of [`Array`]: bool → u8, i16 u16 → i32, u32 u64 → i64, f16 → f32; all
//! exact.

use super::memory;
use crate::num::array::{Array, Element};
use crate::num::order;
use crate::{Error, Result};
use std::io::Read;

/// First bytes of every `.npy`.
pub const MAGIC: &[u8] = b"\x93NUMPY";
/// Longest header read; NumPy itself refuses more than 10 000 bytes.
const MAX_HEADER: usize = 1 << 16;
/// NumPy's largest rank.
const MAX_RANK: usize = 64;

/// Contents of the header.
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    kind: u8,
    size: usize,
    big_endian: bool,
    fortran: bool,
    shape: Vec<usize>,
}

impl Header {
    /// Bytes of the elements.
    pub fn data_bytes(&self) -> u64 {
        self.shape.iter().fold(self.size as u64, |n, &d| n * d as u64)
    }

    /// Bytes of the array that they become.
    pub fn decoded_bytes(&self) -> u64 {
        let wider = matches!((self.kind, self.size), (b'i' | b'f', 2) | (b'u', 2 | 4));
        self.data_bytes().saturating_mul(if wider { 2 } else { 1 })
    }
}

/// Bytes before the header text, from the first twelve bytes of the file, and the length of the text.
pub fn prefix(start: &[u8], name: &str) -> Result<(usize, usize)> {
    let wrong =
        |at: &str, expected: &str, got: String| Err(Error::input(name).at(at).expected(expected).got(got));
    if start.len() < 10 {
        return wrong("byte 0: npy header", "at least 10 bytes", format!("{}", start.len()));
    }
    if &start[..6] != MAGIC {
        return wrong("byte 0: magic", "\\x93NUMPY", format!("{:02x?}", &start[..6]));
    }
    let (before, len) = match start[6] {
        1 => (10, usize::from(u16::from_le_bytes([start[8], start[9]]))),
        2 | 3 if start.len() >= 12 => {
            (12, u32::from_le_bytes([start[8], start[9], start[10], start[11]]) as usize)
        }
        2 | 3 => return wrong("byte 8: header length", "4 bytes", format!("{}", start.len() - 8)),
        v => return wrong("byte 6: format version", "1, 2 or 3", v.to_string()),
    };
    if len > MAX_HEADER {
        return wrong("byte 8: header length", &format!("at most {MAX_HEADER} bytes"), len.to_string());
    }
    Ok((before, len))
}

/// Parses the header text, a Python dictionary of three known keys.
pub fn header(text: &[u8], name: &str) -> Result<Header> {
    let Ok(text) = std::str::from_utf8(text) else {
        return Err(Error::input(name).at("npy header").expected("text").got("bytes that are not UTF-8"));
    };
    let mut p = Literal { text: text.as_bytes(), at: 0, name };
    let (mut descr, mut fortran, mut shape) = (None, None, None);
    p.eat(b'{')?;
    while p.peek() != Some(b'}') {
        let key = p.string()?;
        p.eat(b':')?;
        let fresh = match key.as_str() {
            "descr" => descr.replace(p.string()?).is_none(),
            "fortran_order" => fortran.replace(p.boolean()?).is_none(),
            "shape" => shape.replace(p.tuple()?).is_none(),
            _ => return Err(p.error("one of descr, fortran_order, shape", &key)),
        };
        if !fresh {
            return Err(p.error("every key once", &format!("'{key}' twice")));
        }
        if p.peek() == Some(b',') {
            p.eat(b',')?;
        } else {
            break;
        }
    }
    p.eat(b'}')?;
    let missing =
        |key: &str| Error::input(name).at("npy header").expected(format!("key '{key}'")).got(text.trim());
    let descr = descr.ok_or_else(|| missing("descr"))?;
    let fortran = fortran.ok_or_else(|| missing("fortran_order"))?;
    let shape = shape.ok_or_else(|| missing("shape"))?;
    checked(&descr, fortran, &shape, name)
}

/// The header of a C-ordered array.
pub fn plain(descr: &str, shape: &[usize], name: &str) -> Result<Header> {
    let shape: Vec<u64> = shape.iter().map(|&d| d as u64).collect();
    checked(descr, false, &shape, name)
}

/// The header of an array that another file describes.
pub fn described(descr: &str, fortran: bool, shape: &[u64], name: &str) -> Result<Header> {
    checked(descr, fortran, shape, name)
}

fn checked(descr: &str, fortran: bool, shape: &[u64], name: &str) -> Result<Header> {
    let unsupported = || {
        Error::input(name)
            .at("element type")
            .expected("a bool, integer (1 to 8 bytes) or float (2, 4 or 8 bytes) type, such as <f4")
            .got(format!("'{descr}'"))
    };
    let d = descr.as_bytes();
    let (endian, rest) = match d.first() {
        Some(b'<' | b'>' | b'|' | b'=') => (d[0], &d[1..]),
        _ => (b'=', d),
    };
    let [kind, digit] = rest else { return Err(unsupported()) };
    let size = match (kind, digit) {
        (b'b', b'1') => 1,
        (b'i' | b'u', b'1' | b'2' | b'4' | b'8') | (b'f', b'2' | b'4' | b'8') => usize::from(digit - b'0'),
        _ => return Err(unsupported()),
    };
    // Zero-sized dimensions do not excuse overflow of the others.
    let bytes =
        shape.iter().try_fold(size as u64, |n, &d| n.checked_mul(order::max(d, 1))).filter(|&n| n <= 1 << 46);
    let fits = bytes.is_some() && shape.iter().all(|&d| usize::try_from(d).is_ok());
    if !fits || shape.len() > MAX_RANK {
        return Err(Error::input(name)
            .at("shape")
            .expected(format!("rank at most {MAX_RANK} and a size that can be held"))
            .got(format!("{shape:?}")));
    }
    let shape = shape.iter().map(|&d| d as usize).collect();
    Ok(Header { kind: *kind, size, big_endian: endian == b'>', fortran, shape })
}

/// The elements after the header, exactly [`Header::data_bytes`] long.
pub fn decode(h: &Header, data: &[u8], name: &str) -> Result<Array> {
    if data.len() as u64 != h.data_bytes() {
        return Err(Error::input(name)
            .at(format!("elements of shape {:?}", h.shape))
            .expected(format!("{} bytes", h.data_bytes()))
            .got(data.len().to_string()));
    }
    decode_from(h, &mut &data[..], name)
}

/// The elements after the header, read from a stream into the array and nothing else.
pub fn decode_from(h: &Header, from: &mut dyn Read, name: &str) -> Result<Array> {
    macro_rules! values {
        ($t:ty, $n:literal => $f:expr) => {{
            let each =
                |b: [u8; $n]| $f(if h.big_endian { <$t>::from_be_bytes(b) } else { <$t>::from_le_bytes(b) });
            elements::<$n, _>(h, from, name, each)
        }};
    }
    match (h.kind, h.size) {
        (b'b', _) => {
            values!(u8, 1 => |x: u8| if x > 1 { Err(("a bool, 0 or 1", x.to_string())) } else { Ok(x) })
        }
        (b'u', 1) => values!(u8, 1 => Ok),
        (b'i', 1) => values!(i8, 1 => Ok),
        (b'u', 2) => values!(u16, 2 => |x: u16| Ok(i32::from(x))),
        (b'i', 2) => values!(i16, 2 => |x: i16| Ok(i32::from(x))),
        (b'u', 4) => values!(u32, 4 => |x: u32| Ok(i64::from(x))),
        (b'i', 4) => values!(i32, 4 => Ok),
        (b'i', _) => values!(i64, 8 => Ok),
        (b'f', 2) => values!(u16, 2 => |x: u16| Ok(half_to_f32(x))),
        (b'f', 4) => values!(f32, 4 => Ok),
        (b'f', _) => values!(f64, 8 => Ok),
        _ => values!(u64, 8 => |x: u64| {
            i64::try_from(x).map_err(|_| ("an integer below 2^63", "a larger one".to_owned()))
        }),
    }
}

/// What was expected of an element, and what was found.
type Refused = (&'static str, String);

/// Elements of one type.
fn elements<const N: usize, T: Element + Default>(
    h: &Header,
    from: &mut dyn Read,
    name: &str,
    each: impl Fn([u8; N]) -> std::result::Result<T, Refused>,
) -> Result<Array> {
    const BLOCK: usize = 8192;
    let n = crate::num::array::entries(&h.shape);
    let mut out: Vec<T> = memory::room(name, n)?;
    if h.fortran {
        out.resize(n, T::default());
    }
    let mut place = Place::new(&h.shape);
    let mut block = vec![0; N * order::min(n, BLOCK)];
    for first in (0..n).step_by(BLOCK) {
        let block = &mut block[..N * order::min(n - first, BLOCK)];
        from.read_exact(block)
            .map_err(|e| Error::input(name).expected("data that unpack").got(e.to_string()))?;
        for (i, bytes) in block.as_chunks::<N>().0.iter().enumerate() {
            let x = each(*bytes).map_err(|(expected, got)| {
                Error::input(name).at(format!("element {}", first + i)).expected(expected).got(got)
            })?;
            if h.fortran {
                out[place.next()] = x;
            } else {
                out.push(x);
            }
        }
    }
    Ok(Array::new(&h.shape, out))
}

/// Row-major places of elements in column-major order.
struct Place {
    /// Size, stride and current index of every axis.
    axes: Vec<[usize; 3]>,
    at: usize,
}

impl Place {
    fn new(shape: &[usize]) -> Self {
        let mut axes: Vec<[usize; 3]> = shape.iter().map(|&size| [size, 1, 0]).collect();
        for k in (1..axes.len()).rev() {
            axes[k - 1][1] = axes[k][0] * axes[k][1];
        }
        Self { axes, at: 0 }
    }

    fn next(&mut self) -> usize {
        let here = self.at;
        for [size, stride, index] in &mut self.axes {
            *index += 1;
            self.at += *stride;
            if *index < *size {
                break;
            }
            self.at -= *stride * *size;
            *index = 0;
        }
        here
    }
}

/// The half-precision number nearest to `x`, ties to even, as bits; beyond 65 519 it is infinite.
pub fn half_from_f32(x: f32) -> u16 {
    let bits = x.to_bits();
    let sign = ((bits >> 16) & 0x8000) as u16;
    let magnitude = bits & 0x7fff_ffff;
    if magnitude > 0x7f80_0000 {
        return sign | 0x7e00;
    }
    if magnitude >= 0x4780_0000 {
        return sign | 0x7c00; // from 65 536 on
    }
    // The unit in the last place is 2^-24 below 2^-14, and 2^-10 of the power of two above.
    let exponent = Ord::max((magnitude >> 23) as i32 - 127, -14);
    let unit = f64::from(f32::from_bits((exponent - 10 + 127) as u32 * 0x0080_0000));
    let steps = (f64::from(f32::from_bits(magnitude)) / unit).round_ties_even() as u16;
    // A normal number has 1024 of its steps before it; a carry goes into the exponent.
    sign | (((exponent + 14) as u16) << 10).wrapping_add(steps)
}

/// IEEE 754 binary16 to binary32, exact (payload of NaN shifted).
pub fn half_to_f32(h: u16) -> f32 {
    let sign = u32::from(h >> 15) << 31;
    let (e, m) = (u32::from(h >> 10) & 31, u32::from(h) & 1023);
    match (e, m) {
        (0, _) => {
            // m · 2⁻²⁴, exact in f32
            let x = m as f32 * f32::from_bits((127 - 24) << 23);
            f32::from_bits(x.to_bits() | sign)
        }
        (31, _) => f32::from_bits(sign | 0x7f80_0000 | m << 13),
        _ => f32::from_bits(sign | (e + 112) << 23 | m << 13),
    }
}

/// A `.npy` file.
pub fn parse(bytes: &[u8], name: &str) -> Result<Array> {
    let (before, len) = prefix(&bytes[..order::min(12, bytes.len())], name)?;
    let Some(text) = bytes.get(before..before + len) else {
        return Err(Error::input(name)
            .at(format!("byte {before}: npy header"))
            .expected(format!("{len} bytes"))
            .got(format!("{} before the end of the file", bytes.len() - before)));
    };
    decode(&header(text, name)?, &bytes[before + len..], name)
}

/// A `.npy` file, version 1.0, C order, little endian, elements aligned to 64 bytes.
pub fn to_bytes(a: &Array) -> Vec<u8> {
    let descr = match a {
        Array::F32(_) => "<f4",
        Array::F64(_) => "<f8",
        Array::U8(_) => "|u1",
        Array::I8(_) => "|i1",
        Array::I32(_) => "<i4",
        Array::I64(_) => "<i8",
    };
    let dims: Vec<String> = a.shape().iter().map(usize::to_string).collect();
    let comma = if dims.len() == 1 { "," } else { "" };
    let mut text =
        format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({}{comma}), }}", dims.join(", "));
    while !(10 + text.len() + 1).is_multiple_of(64) {
        text.push(' ');
    }
    text.push('\n');
    let len = u16::try_from(text.len()).expect("a shape of a few dimensions is short");
    let mut out = Vec::with_capacity(10 + text.len() + 8 * a.len());
    out.extend_from_slice(MAGIC);
    out.extend_from_slice(&[1, 0]);
    out.extend_from_slice(&len.to_le_bytes());
    out.extend_from_slice(text.as_bytes());
    elements_le(a, &mut out);
    out
}

/// Elements in row-major order, little endian.
pub fn elements_le(a: &Array, out: &mut Vec<u8>) {
    crate::with_array!(a, x => for v in x { out.extend_from_slice(&v.to_le_bytes()) });
}

/// A parser for the little of Python's literals that the header uses; no recursion.
struct Literal<'a> {
    text: &'a [u8],
    at: usize,
    name: &'a str,
}

impl<'a> Literal<'a> {
    fn error(&self, expected: &str, got: &str) -> Error {
        Error::input(self.name).at(format!("npy header, character {}", self.at)).expected(expected).got(got)
    }

    fn peek(&mut self) -> Option<u8> {
        while self.text.get(self.at).is_some_and(u8::is_ascii_whitespace) {
            self.at += 1;
        }
        self.text.get(self.at).copied()
    }

    fn found(&mut self) -> String {
        self.peek().map_or("the end".to_owned(), |c| format!("'{}'", c.escape_ascii()))
    }

    fn eat(&mut self, c: u8) -> Result<()> {
        if self.peek() == Some(c) {
            self.at += 1;
            return Ok(());
        }
        let got = self.found();
        Err(self.error(&format!("'{}'", char::from(c)), &got))
    }

    fn word(&mut self) -> &'a [u8] {
        self.peek();
        let start = self.at;
        while self.text.get(self.at).is_some_and(u8::is_ascii_alphanumeric) {
            self.at += 1;
        }
        &self.text[start..self.at]
    }

    fn string(&mut self) -> Result<String> {
        let quote = match self.peek() {
            Some(q @ (b'\'' | b'"')) => q,
            _ => {
                let got = self.found();
                return Err(self.error("a quoted string (structured types are not read)", &got));
            }
        };
        let start = self.at + 1;
        let Some(len) = self.text[start..].iter().position(|&c| c == quote) else {
            return Err(self.error("a closing quote", "the end"));
        };
        self.at = start + len + 1;
        Ok(String::from_utf8_lossy(&self.text[start..start + len]).into_owned())
    }

    fn boolean(&mut self) -> Result<bool> {
        match self.word() {
            b"True" => Ok(true),
            b"False" => Ok(false),
            [] => {
                let got = self.found();
                Err(self.error("True or False", &got))
            }
            other => {
                let got = format!("'{}'", other.escape_ascii());
                Err(self.error("True or False", &got))
            }
        }
    }

    fn tuple(&mut self) -> Result<Vec<u64>> {
        self.eat(b'(')?;
        let mut out = Vec::new();
        while self.peek() != Some(b')') {
            let word = self.word();
            let digits = word.strip_suffix(b"L").unwrap_or(word);
            let value = std::str::from_utf8(digits).ok().and_then(|s| s.parse::<u64>().ok());
            let Some(value) = value else {
                let got = match digits {
                    [] => self.found(),
                    d => format!("'{}'", d.escape_ascii()),
                };
                return Err(self.error("a non-negative integer", &got));
            };
            out.push(value);
            if self.peek() == Some(b',') {
                self.at += 1;
            } else {
                break;
            }
        }
        self.eat(b')')?;
        Ok(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_are_exact() {
        for (h, x) in [
            (0x0000, 0.0),
            (0x0001, 5.960_464_5e-8),
            (0x03ff, 6.097_555_2e-5),
            (0x0400, 6.103_515_6e-5),
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x7bff, 65504.0),
            (0x7c00, f32::INFINITY),
        ] {
            assert_eq!(half_to_f32(h).to_bits(), f32::to_bits(x), "{h:#x}");
        }
        assert!(half_to_f32(0x7e00).is_nan(), "NaN stays NaN");
        for h in (0..=u16::MAX).filter(|h| h & 0x7fff <= 0x7c00) {
            let x = half_to_f32(h);
            assert_eq!(half_from_f32(x), h, "{x} is exact");
            let next = half_to_f32(h + 1);
            if h & 0x7fff < 0x7bff {
                // Half-way, and one single-precision number to either side of it.
                let middle = 0.5 * (x + next);
                let [inner, outer] = [middle.to_bits() - 1, middle.to_bits() + 1].map(f32::from_bits);
                assert_eq!([inner, outer].map(half_from_f32), [h, h + 1], "{x}");
                assert_eq!(half_from_f32(middle), h + (h & 1), "{x}: a tie goes to the even one");
            }
        }
        assert_eq!([65519.9, 65520.0, 1e30].map(half_from_f32), [0x7bff, 0x7c00, 0x7c00]);
        assert!(half_to_f32(half_from_f32(f32::NAN)).is_nan());
        assert!(half_to_f32(0x8000).is_sign_negative(), "-0 keeps its sign");
    }

    #[test]
    fn fortran_and_big_endian() {
        let text = b"{'descr': '>i2', 'fortran_order': True, 'shape': (2, 3), }";
        let h = header(text, "a").expect("valid");
        let data: Vec<u8> = [1i16, 4, 2, 5, 3, 6].iter().flat_map(|x| x.to_be_bytes()).collect();
        assert_eq!(
            decode(&h, &data, "a").expect("valid"),
            Array::new(&[2, 3], vec![1i32, 2, 3, 4, 5, 6]),
            "row-major"
        );
    }

    #[test]
    fn bad_headers_say_where() {
        for (text, expected) in [
            ("{'descr': '|O', 'fortran_order': False, 'shape': ()}", "element type"),
            ("{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': ()}", "quoted string"),
            ("{'descr': '<f4', 'fortran_order': 0, 'shape': ()}", "True or False"),
            ("{'descr': '<f4', 'fortran_order': False, 'shape': (-1,)}", "non-negative"),
            ("{'descr': '<f4', 'fortran_order': False, 'shape': (0, 9999999999999999999)}", "shape"),
            ("{'descr': '<f4', 'fortran_order': False}", "key 'shape'"),
            ("{'descr': '<f4', 'descr': '<f4'", "twice"),
        ] {
            let e = header(text.as_bytes(), "a.npy").expect_err(text).to_string();
            assert!(e.starts_with("a.npy: ") && e.contains(expected), "{e}");
        }
    }
}
