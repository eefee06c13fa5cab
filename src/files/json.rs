//! Errors of JSON documents in the form of this library: line and column, what was expected there, and what
//! the file contains.

use crate::{Error, Result};
use serde_json::Value;
use serde_json::error::Category;

/// Parses a JSON document; `name` is the file name in errors.
///
/// # Errors
/// When the document is malformed.
pub fn parse(bytes: &[u8], name: &str) -> Result<Value> {
    serde_json::from_slice(bytes).map_err(|e| error(bytes, name, &e))
}

/// The error of a parser that read `bytes`; `name` is the file name in errors.
pub fn error(bytes: &[u8], name: &str, e: &serde_json::Error) -> Error {
    let (expected, got) = describe(bytes, e);
    Error::input(name).at(format!("line {}, column {}", e.line(), e.column())).expected(expected).got(got)
}

/// The expected and the actual text of an error. The parser's message contains both in several forms, and the
/// place once more.
pub(super) fn describe(bytes: &[u8], e: &serde_json::Error) -> (String, String) {
    let message = e.to_string();
    let place = format!(" at line {} column {}", e.line(), e.column());
    let message = message.strip_suffix(place.as_str()).unwrap_or(&message);
    if e.classify() == Category::Eof {
        return ("a complete JSON document".into(), "the end of the file".into());
    }
    if let Some((got, expected)) = message.split_once(", expected ") {
        let got =
            ["invalid type: ", "invalid value: "].iter().find_map(|p| got.strip_prefix(p)).unwrap_or(got);
        return (expected.into(), got.into());
    }
    let found = || character(bytes, e.line(), e.column());
    match message {
        "expected value" => ("a JSON value".into(), found()),
        "expected ident" => ("true, false or null".into(), found()),
        "key must be a string" => ("a key in double quotes".into(), found()),
        "trailing characters" => ("the end of the file".into(), found()),
        "trailing comma" => ("no comma before a closing bracket".into(), found()),
        _ => match message.strip_prefix("expected ") {
            Some(expected) => (expected.into(), found()),
            None => ("valid JSON".into(), message.into()),
        },
    }
}

/// The character at a place of the text; lines and columns count from 1, columns in bytes.
fn character(bytes: &[u8], line: usize, column: usize) -> String {
    let text = bytes.split(|&b| b == b'\n').nth(line.saturating_sub(1)).unwrap_or_default();
    let rest = text.get(column.saturating_sub(1)..).unwrap_or_default();
    let Some(&first) = rest.first() else { return "the end of the line".into() };
    let valid = rest.utf8_chunks().next().map(|c| c.valid()).unwrap_or_default();
    valid.chars().next().map_or_else(|| format!("byte {first:#04x}"), |c| format!("{c:?}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_states_once_what_was_expected() {
        for (text, message) in [
            (&b"ply\nformat"[..], "line 1, column 1: expected a JSON value, got 'p'"),
            (b"", "line 1, column 0: expected a complete JSON document, got the end of the file"),
            (
                b"{\n  \"a\": [1",
                "line 2, column 9: expected a complete JSON document, got the end of the file",
            ),
            (b"{\n  \"a\" 1}", "line 2, column 7: expected `:`, got '1'"),
            (b"{a: 1}", "line 1, column 2: expected a key in double quotes, got 'a'"),
            (b"[1 2]", "line 1, column 4: expected `,` or `]`, got '2'"),
            (b"[1, 2,]", "line 1, column 7: expected no comma before a closing bracket, got ']'"),
            (b"{} x", "line 1, column 4: expected the end of the file, got 'x'"),
            (b"[nul]", "line 1, column 5: expected true, false or null, got ']'"),
            (b"\xff", "line 1, column 1: expected a JSON value, got byte 0xff"),
        ] {
            let e = parse(text, "a.json").expect_err("malformed").to_string();
            assert_eq!(e, format!("a.json: {message}"), "{text:?}");
        }
    }

    #[test]
    fn an_error_of_a_typed_reader_names_both_types() {
        let bytes = b"[\"x\"]";
        let e = serde_json::from_slice::<[f64; 1]>(bytes).expect_err("a text");
        let e = error(bytes, "a.json", &e).to_string();
        assert_eq!(e, "a.json: line 1, column 4: expected f64, got string \"x\"", "one expected, one got");
    }
}
