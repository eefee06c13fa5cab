//! `tests/bits.toml`: one line per digest, in the order in which things are built on each other.
//!
//! ```text
//! "splat.color/0 forward" = { digest = "0123456789abcdef", shape = "colors 2x5x3", why = "first mint" }
//! ```
//!
//! A line is a key and an inline table of three strings, so the file is TOML; it is read here by its
//! quotation marks, and none of the four strings may hold one. The shape is listed beside the digest so that
//! a change of layout and a change of value look different. The last column is the reason for the last change
//! of the digest: it is cleared when the digest changes and filled in by the author of the change.

use std::path::PathBuf;

/// One line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Line {
    /// what was run
    pub(crate) name: String,
    /// 16 hexadecimal digits
    pub(crate) digest: String,
    /// the arrays with their shapes
    pub(crate) shape: String,
    /// the reason for the last change
    pub(crate) why: String,
}

/// What a line has in its last column when nothing was there before.
pub(crate) const FIRST: &str = "first mint";

const HEAD: &str = "\
# Digests of every operator and every system. They do not depend on threads, optimisation, vector width or platform;
# tests/bits/main.rs compares. `LASTLIGHT_REMINT=1 cargo bits` rewrites this file and empties `why` where a digest changed:
# state the cause there, in the commit that contains it.
";

/// Where the file is.
pub(crate) fn path() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../bits.toml")
}

/// The lines of a file.
pub(crate) fn parse(text: &str) -> Result<Vec<Line>, String> {
    let mut lines = Vec::new();
    for (i, row) in text.lines().enumerate() {
        if row.is_empty() || row.starts_with('#') {
            continue;
        }
        let parts: Vec<&str> = row.split('"').collect();
        let [_, name, " = { digest = ", digest, ", shape = ", shape, ", why = ", why, " }"] = parts[..]
        else {
            return Err(format!(
                "tests/bits.toml line {}: expected \"NAME\" = {{ digest = \"…\", shape = \"…\", why = \"…\" }}",
                i + 1
            ));
        };
        let [name, digest, shape, why] = [name, digest, shape, why].map(str::to_owned);
        lines.push(Line { name, digest, shape, why });
    }
    Ok(lines)
}

/// The file with these lines.
pub(crate) fn print(lines: &[Line]) -> String {
    let mut text = HEAD.to_owned();
    let mut group = "";
    for l in lines {
        let of = l.name.split(['/', ' ']).next().unwrap_or_default();
        if of != group {
            text.push('\n');
            group = of;
        }
        text += &format!(
            "\"{}\" = {{ digest = \"{}\", shape = \"{}\", why = \"{}\" }}\n",
            l.name, l.digest, l.shape, l.why
        );
    }
    text
}

/// The lines of the repository; none when there is no file yet.
pub(crate) fn load() -> Vec<Line> {
    match std::fs::read_to_string(path()) {
        Ok(text) => parse(&text).unwrap_or_else(|e| panic!("{e}")),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Vec::new(),
        Err(e) => panic!("{}: {e}", path().display()),
    }
}

/// New lines with the reasons of the old ones: kept where nothing changed, empty where something did.
pub(crate) fn merge(old: &[Line], new: Vec<Line>) -> Vec<Line> {
    let reason = |l: &Line| match old.iter().find(|o| o.name == l.name) {
        None => FIRST.to_owned(),
        Some(o) if (&o.digest, &o.shape) == (&l.digest, &l.shape) => o.why.clone(),
        Some(_) => String::new(),
    };
    new.into_iter().map(|l| Line { why: reason(&l), ..l }).collect()
}
