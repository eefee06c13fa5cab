//! Text as pickles write it.

use super::node::{Id, wrong};
use super::value::Value;
use crate::Result;

/// A string of Python 2: text if it is UTF-8.
pub(super) fn string(bytes: &[u8]) -> Value {
    match std::str::from_utf8(bytes) {
        Ok(t) => Value::Text(t.to_owned()),
        Err(_) => Value::Bytes(bytes.to_vec()),
    }
}

/// Keys and values in turn.
pub(super) fn pairs(items: &[Id]) -> Result<Vec<(Id, Id)>> {
    if !items.len().is_multiple_of(2) {
        return Err(wrong("keys and values in turn", format!("{} values", items.len())));
    }
    Ok(items.as_chunks::<2>().0.iter().map(|&[k, v]| (k, v)).collect())
}

/// The bytes of a quoted string of Python 2.
pub(super) fn unquoted(line: &[u8]) -> Result<Vec<u8>> {
    let line = line.trim_ascii();
    let bad =
        || wrong("a quoted string", String::from_utf8_lossy(&line[..crate::num::order::min(line.len(), 40)]));
    let (Some(&quote @ (b'\'' | b'"')), true) = (line.first(), line.len() >= 2) else { return Err(bad()) };
    if line[line.len() - 1] != quote {
        return Err(bad());
    }
    let inner = &line[1..line.len() - 1];
    let mut out = Vec::with_capacity(inner.len());
    let mut i = 0;
    while i < inner.len() {
        if inner[i] != b'\\' {
            out.push(inner[i]);
            i += 1;
            continue;
        }
        let code = *inner.get(i + 1).ok_or_else(bad)?;
        i += 2;
        match code {
            b'n' => out.push(b'\n'),
            b't' => out.push(b'\t'),
            b'r' => out.push(b'\r'),
            b'a' => out.push(7),
            b'b' => out.push(8),
            b'f' => out.push(12),
            b'v' => out.push(11),
            b'\\' | b'\'' | b'"' => out.push(code),
            b'x' => {
                let digits = inner.get(i..i + 2).and_then(|d| std::str::from_utf8(d).ok()).ok_or_else(bad)?;
                out.push(u8::from_str_radix(digits, 16).map_err(|_| bad())?);
                i += 2;
            }
            b'0'..=b'7' => {
                let mut x = u32::from(code - b'0');
                for _ in 0..2 {
                    let Some(d @ b'0'..=b'7') = inner.get(i) else { break };
                    x = 8 * x + u32::from(d - b'0');
                    i += 1;
                }
                out.push(u8::try_from(x).map_err(|_| bad())?);
            }
            other => out.extend([b'\\', other]),
        }
    }
    Ok(out)
}

/// Text with `\u0000` and `\U00000000`.
pub(super) fn unescaped(line: &str) -> Result<String> {
    let bad = || wrong("text with \\u escapes", line.chars().take(40).collect::<String>());
    let mut out = String::with_capacity(line.len());
    let mut rest = line;
    while let Some(at) = rest.find('\\') {
        out.push_str(&rest[..at]);
        let digits = match rest.as_bytes().get(at + 1) {
            Some(b'u') => 4,
            Some(b'U') => 8,
            _ => {
                out.push('\\');
                rest = &rest[at + 1..];
                continue;
            }
        };
        let hex = rest.get(at + 2..at + 2 + digits).ok_or_else(bad)?;
        let code = u32::from_str_radix(hex, 16).ok().and_then(char::from_u32).ok_or_else(bad)?;
        out.push(code);
        rest = &rest[at + 2 + digits..];
    }
    out.push_str(rest);
    Ok(out)
}
