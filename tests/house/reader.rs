//! Reads the paths of a Rust source text: its declarations of modules, its imports, and the paths its code
//! names.

/// One name that a `use` declaration binds.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Import {
    /// Segments of the imported path, beginning with `crate`, `self`, `super` or a name.
    pub(crate) path: Vec<String>,
    /// The name it is bound to; `*` for all names of the path.
    pub(crate) name: String,
    /// Whether others can reach it here (`pub`, `pub(crate)`, …).
    pub(crate) public: bool,
    /// Whether it is in a module of tests.
    pub(crate) in_test: bool,
}

/// A path that code names.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Named {
    /// Its segments.
    pub(crate) path: Vec<String>,
    /// Whether it is in a module of tests.
    pub(crate) in_test: bool,
}

/// What one file declares and names. Inline modules belong to their file.
#[derive(Clone, Debug, Default)]
pub(crate) struct Source {
    /// Modules in files of their own (`mod name;`).
    pub(crate) modules: Vec<String>,
    /// Those of them that are compiled for tests only.
    pub(crate) test_modules: Vec<String>,
    /// Imports, those inside functions included.
    pub(crate) imports: Vec<Import>,
    /// Paths in code, single names included.
    pub(crate) paths: Vec<Named>,
    /// Names of functions, types and constants at the top of the file.
    pub(crate) items: Vec<String>,
    /// Names of `macro_rules!`.
    pub(crate) macros: Vec<String>,
}

pub(crate) fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// The end of a string literal whose text begins at `at`; `hashes` is `None` where `\` escapes.
fn string_end(text: &[char], mut at: usize, hashes: Option<usize>) -> usize {
    while at < text.len() {
        match (text[at], hashes) {
            ('\\', None) => at += 1,
            ('"', None) => return at + 1,
            ('"', Some(n)) if text[at + 1..].iter().take_while(|c| **c == '#').count() >= n => {
                return at + 1 + n;
            }
            _ => {}
        }
        at += 1;
    }
    at
}

/// A part of a source text that is not code.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Skipped {
    /// A comment.
    Comment,
    /// A string literal of any kind.
    Literal,
    /// A character literal or a lifetime.
    Character,
}

/// The part that begins at `at` and is not code, with the index of its end; `at` is not inside a word.
pub(crate) fn skipped(text: &[char], at: usize) -> Option<(Skipped, usize)> {
    let starts = |at: usize, what: &str| what.chars().enumerate().all(|(i, c)| text.get(at + i) == Some(&c));
    let run =
        |at: usize, within: &dyn Fn(char) -> bool| text[at..].iter().take_while(|c| within(**c)).count();
    match text[at] {
        '/' if starts(at, "//") => Some((Skipped::Comment, at + run(at, &|c| c != '\n'))),
        '/' if starts(at, "/*") => {
            let (mut end, mut depth) = (at, 0);
            while end < text.len() {
                match () {
                    () if starts(end, "/*") => (depth, end) = (depth + 1, end + 2),
                    () if starts(end, "*/") => (depth, end) = (depth - 1, end + 2),
                    () => end += 1,
                }
                if depth == 0 {
                    break;
                }
            }
            Some((Skipped::Comment, end))
        }
        '"' => Some((Skipped::Literal, string_end(text, at + 1, None))),
        '\'' => {
            let end = if text.get(at + 1) == Some(&'\\') {
                at + 3 + run((at + 3).min(text.len()), &|c| c != '\'') + 1
            } else if text.get(at + 2) == Some(&'\'') {
                at + 3
            } else {
                at + 1 + run(at + 1, &is_word)
            };
            Some((Skipped::Character, end))
        }
        'r' | 'b' => {
            let prefix = ["br", "r", "b"].into_iter().find(|p| starts(at, p))?;
            let hashes = if prefix == "b" { 0 } else { run(at + prefix.len(), &|c| c == '#') };
            let begin = at + prefix.len() + hashes;
            let raw = (prefix != "b").then_some(hashes);
            (text.get(begin) == Some(&'"')).then(|| (Skipped::Literal, string_end(text, begin + 1, raw)))
        }
        _ => None,
    }
}

/// Words, `::` and single characters of a source text, without comments, literals of text and lifetimes.
pub(crate) fn tokens(text: &str) -> Vec<String> {
    let text: Vec<char> = text.chars().collect();
    let mut out = Vec::new();
    let mut at = 0;
    while at < text.len() {
        let c = text[at];
        if let Some((_, end)) = skipped(&text, at) {
            at = end;
        } else if is_word(c) {
            let word: String = text[at..].iter().take_while(|c| is_word(**c)).collect();
            at += word.chars().count();
            // `r#gen`
            if word == "r" && text.get(at) == Some(&'#') {
                at += 1;
            } else {
                out.push(word);
            }
        } else if c == ':' && text.get(at + 1) == Some(&':') {
            out.push("::".into());
            at += 2;
        } else {
            if !c.is_whitespace() {
                out.push(c.into());
            }
            at += 1;
        }
    }
    out
}

/// Reads the tree of a `use` declaration from `at` on, below `prefix`; returns where it ends.
fn use_tree(t: &[String], mut at: usize, prefix: &[String], public: bool, into: &mut Vec<Import>) -> usize {
    let mut path = prefix.to_vec();
    loop {
        match t.get(at).map(String::as_str) {
            Some("{") => {
                at += 1;
                while t.get(at).is_some_and(|s| s != "}") {
                    at = use_tree(t, at, &path, public, into);
                    at += usize::from(t.get(at).is_some_and(|s| s == ","));
                }
                return at + 1;
            }
            Some("*") => {
                into.push(Import { path, name: "*".into(), public, in_test: false });
                return at + 1;
            }
            Some("::") => at += 1,
            Some(word) if word.starts_with(is_word) => {
                // `a::{self}` is `a`
                if word != "self" || path.is_empty() {
                    path.push(word.to_owned());
                }
                at += 1;
                if t.get(at).is_none_or(|s| s != "::") {
                    break;
                }
            }
            _ => return at + 1,
        }
    }
    let mut name = path.last().cloned().unwrap_or_default();
    if t.get(at).is_some_and(|s| s == "as") {
        name.clone_from(&t[at + 1]);
        at += 2;
    }
    into.push(Import { path, name, public, in_test: false });
    at
}

/// A path seen from its file instead of an inline module at `depth`: as many `super` less.
fn from_file(path: &[String], depth: usize) -> Vec<String> {
    let supers = path.iter().take_while(|s| *s == "super").count();
    if depth == 0 || supers == 0 {
        return path.to_vec();
    }
    let rest = &path[supers.min(depth)..];
    if supers > depth { rest.to_vec() } else { [&["self".to_owned()], rest].concat() }
}

/// Whether the token before `at` ends a visibility.
fn is_public(t: &[String], at: usize) -> bool {
    match at.checked_sub(1).map(|i| t[i].as_str()) {
        Some("pub") => true,
        Some(")") => {
            t[..at].iter().rposition(|s| s == "(").is_some_and(|open| open > 0 && t[open - 1] == "pub")
        }
        _ => false,
    }
}

/// The attribute of what is compiled for tests only.
pub(crate) const CFG_TEST: [&str; 7] = ["#", "[", "cfg", "(", "test", ")", "]"];

/// Whether the token at `at` follows that attribute.
pub(crate) fn is_for_tests(t: &[String], at: usize) -> bool {
    at >= CFG_TEST.len() && t[at - CFG_TEST.len()..at] == CFG_TEST
}

/// Reads one file.
pub(crate) fn read(text: &str) -> Source {
    let t = tokens(text);
    let word = |at: usize, w: &str| t.get(at).is_some_and(|s| s == w);
    let mut out = Source::default();
    // depth of braces at which the open inline modules began, and whether they hold tests
    let mut inline: Vec<(usize, bool)> = Vec::new();
    let mut depth = 0_usize;
    let mut at = 0;
    while at < t.len() {
        let in_test = inline.last().is_some_and(|(_, is_test)| *is_test);
        match t[at].as_str() {
            "{" => depth += 1,
            "}" => {
                depth = depth.saturating_sub(1);
                if inline.last().is_some_and(|(began, _)| *began == depth) {
                    inline.pop();
                }
            }
            "mod" if word(at + 2, ";") => {
                out.modules.push(t[at + 1].clone());
                if is_for_tests(&t, at) {
                    out.test_modules.push(t[at + 1].clone());
                }
                at += 2;
            }
            "mod" if word(at + 2, "{") => {
                let is_test = is_for_tests(&t, at);
                inline.push((depth, is_test || inline.last().is_some_and(|(_, outer)| *outer)));
                at += 1;
            }
            "extern" if word(at + 1, "crate") && word(at + 2, "self") => {
                out.imports.push(Import {
                    path: vec!["crate".into()],
                    name: t[at + 4].clone(),
                    public: true,
                    in_test: false,
                });
                at += 4;
            }
            "use" => {
                let mut found = Vec::new();
                at = use_tree(&t, at + 1, &[], is_public(&t, at), &mut found);
                for mut import in found {
                    import.path = from_file(&import.path, inline.len());
                    import.in_test = in_test;
                    out.imports.push(import);
                }
                continue;
            }
            "macro_rules" if word(at + 1, "!") => {
                out.macros.push(t[at + 2].clone());
                at += 2;
            }
            "fn" | "struct" | "enum" | "trait" | "type" | "const" | "static" => {
                let name = t.get(at + 1).filter(|s| depth == 0 && s.starts_with(is_word));
                out.items.extend(name.cloned());
            }
            first if first.starts_with(is_word) => {
                // a field or a method, a segment after generics, `pub(in path)`
                let skipped = at > 0 && (t[at - 1] == "." || t[at - 1] == "::")
                    || at > 2 && t[at - 1] == "in" && t[at - 2] == "(" && t[at - 3] == "pub";
                let mut path = vec![first.to_owned()];
                while word(at + 1, "::") && t.get(at + 2).is_some_and(|s| s.starts_with(is_word)) {
                    path.push(t[at + 2].clone());
                    at += 2;
                }
                if !skipped {
                    out.paths.push(Named { path: from_file(&path, inline.len()), in_test });
                }
            }
            _ => {}
        }
        at += 1;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn imports(text: &str) -> Vec<String> {
        read(text).imports.iter().map(|i| format!("{} as {}", i.path.join("::"), i.name)).collect()
    }

    #[test]
    fn imports_are_read_with_groups_names_and_visibility() {
        assert_eq!(
            imports("use crate::{Error, num::{par, sum as s}, io::*, tape::{self}}; use super::super::a;"),
            [
                "crate::Error as Error",
                "crate::num::par as par",
                "crate::num::sum as s",
                "crate::io as *",
                "crate::tape as tape",
                "super::super::a as a"
            ],
            "a group"
        );
        let public = |text: &str| read(text).imports[0].public;
        assert!(public("pub use a::b;") && public("pub(crate) use a::b;"), "visible");
        assert!(!public("fn f(x: u8) {} use a::b;") && !public("use a::b;"), "private");
        assert_eq!(imports("extern crate self as last;"), ["crate as last"], "the member's own name");
    }

    #[test]
    fn comments_texts_and_lifetimes_are_not_code() {
        let text = "/* crate::a /* b */ */ // crate::c\n fn f<'d>(x: &'d str) { g('e', '\\n', '\\'', \"crate::h \\\" i\", r#\"j \" k\"#, b\"l\") }";
        let paths: Vec<_> = read(text).paths.into_iter().flat_map(|n| n.path).collect();
        assert_eq!(paths, ["f", "x", "str", "g"], "what is left");
        assert_eq!(read("lirm::r#gen::set()").paths[0].path, ["lirm", "gen", "set"], "a raw name");
    }

    #[test]
    fn an_inline_module_belongs_to_its_file() {
        let text = "mod below; fn f() {} mod tests { use super::*; use super::super::Up; fn g() { super::super::up() } } fn h() { super::up() }";
        let source = read(text);
        assert_eq!(source.modules, ["below"], "one file");
        let declared = read("mod a; #[cfg(test)] mod b;");
        assert_eq!(
            (declared.modules.len(), declared.test_modules),
            (2, vec!["b".to_owned()]),
            "one for tests"
        );
        assert_eq!(imports(text), ["self as *", "super::Up as Up"], "one level less inside");
        assert!(source.paths.iter().filter(|n| n.path == ["super", "up"]).count() == 2, "{:?}", source.paths);
        let tested = |text: &str| {
            let named = read(text).paths.into_iter().filter(|n| n.path.len() == 2);
            named.map(|n| n.in_test).collect::<Vec<_>>()
        };
        assert_eq!(
            tested("a::b; #[cfg(test)] mod tests { c::d; mod e { f::g } } h::i"),
            [false, true, true, false],
            "tests"
        );
        assert_eq!(source.items, ["f", "h"], "items of the file itself");
    }
}
