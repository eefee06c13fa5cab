//! The functions of a source text: names, the types they belong to, and the tokens of their bodies.

use super::reader::{CFG_TEST, is_for_tests, tokens};

/// A function with a body, or a `static` with its value.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Function {
    /// Its own name.
    pub(crate) name: String,
    /// The type or trait whose block it is in.
    pub(crate) owner: Option<String>,
    /// Whether it is a `static` or `const` at the top of the file, or a `const fn`.
    pub(crate) is_constant: bool,
    /// The tokens between its braces, without those of functions inside it; of a value, those behind `=`.
    pub(crate) body: Vec<String>,
}

impl Function {
    /// `name`, or `Type::name`.
    pub(crate) fn label(&self) -> String {
        self.owner.as_ref().map_or_else(|| self.name.clone(), |owner| format!("{owner}::{}", self.name))
    }
}

pub(crate) fn is_word(token: &str) -> bool {
    token.starts_with(|c: char| c.is_alphanumeric() || c == '_')
}

/// Where the bracket that opens at `open` is closed.
pub(crate) fn closing(t: &[String], open: usize) -> usize {
    let mut depth = 0_usize;
    for (at, token) in t.iter().enumerate().skip(open) {
        match token.as_str() {
            "(" | "[" | "{" => depth += 1,
            ")" | "]" | "}" => depth = depth.saturating_sub(1),
            _ => continue,
        }
        if depth == 0 {
            return at;
        }
    }
    t.len()
}

/// Where the first of `wanted` is from `at` on, outside brackets that open behind `at`.
fn first(t: &[String], mut at: usize, wanted: &[&str]) -> Option<usize> {
    while let Some(token) = t.get(at) {
        match token.as_str() {
            found if wanted.contains(&found) => return Some(at),
            "(" | "[" | "{" => at = closing(t, at),
            ")" | "]" | "}" => return None,
            _ => {}
        }
        at += 1;
    }
    None
}

/// Tokens of a source text without `mod NAME { … }` and `mod NAME;` under `#[cfg(test)]`.
pub(crate) fn shipped(text: &str) -> Vec<String> {
    let t = tokens(text);
    let mut out = Vec::new();
    let mut at = 0;
    while at < t.len() {
        if t[at] == "mod" && is_for_tests(&t, at) {
            at = if t.get(at + 2).is_some_and(|s| s == "{") { closing(&t, at + 2) + 1 } else { at + 3 };
            out.truncate(out.len() - CFG_TEST.len());
        } else {
            out.push(t[at].clone());
            at += 1;
        }
    }
    out
}

/// The type of an `impl` or the name of a `trait`, whose header is `t[from..open]`.
fn owner(t: &[String], from: usize, open: usize) -> Option<String> {
    let mut depth = 0_usize;
    let mut name = None;
    let mut done = false;
    for at in from..open {
        match t[at].as_str() {
            "<" => depth += 1,
            ">" if at > 0 && t[at - 1] != "-" => depth = depth.saturating_sub(1),
            "for" if depth == 0 && t.get(at + 1).is_none_or(|s| s != "<") => (name, done) = (None, false),
            "where" | ":" | ";" if depth == 0 => done = true,
            "dyn" | "mut" | "unsafe" => {}
            word if depth == 0 && !done && is_word(word) => name = Some(word.to_owned()),
            _ => {}
        }
    }
    name
}

/// All functions with a body, and the values at the top of the file.
pub(crate) fn functions(t: &[String]) -> Vec<Function> {
    let mut out = Vec::new();
    // owners with the end of their block, and the indices of the open functions with theirs
    let mut owners: Vec<(Option<String>, usize)> = Vec::new();
    let mut open_functions: Vec<(usize, usize)> = Vec::new();
    let mut depth = 0_usize;
    let mut at = 0;
    while at < t.len() {
        owners.retain(|(_, end)| at < *end);
        let begins = at == 0 || matches!(t[at - 1].as_str(), ";" | "{" | "}" | "]" | "unsafe" | "pub" | ")");
        match t[at].as_str() {
            "impl" | "trait" if begins => {
                if let Some(open) = first(t, at + 1, &["{", ";"]).filter(|open| t[*open] == "{") {
                    owners.push((owner(t, at + 1, open), closing(t, open)));
                    depth += 1;
                    at = open + 1;
                    continue;
                }
            }
            "fn" if t.get(at + 1).is_some_and(|s| is_word(s)) => {
                if let Some(open) = first(t, at + 2, &["{", ";"]).filter(|open| t[*open] == "{") {
                    let owner = owners.last().and_then(|(owner, _)| owner.clone());
                    // a function inside another one is no method
                    let owner = owner.filter(|_| open_functions.is_empty());
                    let is_constant = at > 0 && t[at - 1] == "const";
                    open_functions.push((out.len(), closing(t, open)));
                    out.push(Function { name: t[at + 1].clone(), owner, is_constant, body: Vec::new() });
                    depth += 1;
                    at = open + 1;
                    continue;
                }
            }
            "static" | "const" if depth == 0 && t.get(at + 2).is_some_and(|s| s == ":") => {
                let (value, end) = (first(t, at + 3, &["="]), first(t, at + 3, &[";"]));
                if let (Some(value), Some(end)) = (value, end) {
                    let body = t[value + 1..end].to_vec();
                    out.push(Function { name: t[at + 1].clone(), owner: None, is_constant: true, body });
                    at = end;
                    continue;
                }
            }
            "{" => depth += 1,
            "}" => {
                depth = depth.saturating_sub(1);
                if open_functions.last().is_some_and(|(_, end)| at == *end) {
                    open_functions.pop();
                    at += 1;
                    continue;
                }
            }
            _ => {}
        }
        if let Some((index, _)) = open_functions.last() {
            out[*index].body.push(t[at].clone());
        }
        at += 1;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(text: &str) -> Vec<String> {
        functions(&shipped(text)).iter().map(Function::label).collect()
    }

    #[test]
    fn methods_have_the_name_of_their_type() {
        let text = "fn a() {} impl<'a, T: Fn(u8) -> u8> Some<'a, T> where T: Copy { pub fn b(&self) { fn inner() {} } }
            impl fmt::Debug for dyn Other<u8> { fn c(&self) -> impl Fn(u8) { } } pub trait Up: Sized { fn d(&self); fn e() {} }
            unsafe impl<const N: usize> Few for [f32; N] { fn g() {} } fn last(x: [u8; 3]) -> [u8; 2] { x }";
        let expected = ["a", "Some::b", "inner", "Other::c", "Up::e", "f32::g", "last"];
        assert_eq!(labels(text), expected, "owners");
    }

    #[test]
    fn bodies_are_tokens_without_inner_functions() {
        let all =
            functions(&shipped("fn a() { b(\"{ // \"); fn c() { d() } e() } static F: G = H { i: j };"));
        let bodies: Vec<(&str, String)> = all.iter().map(|f| (&*f.name, f.body.join(" "))).collect();
        let expected =
            [("a", "b ( ) ; e ( )".to_owned()), ("c", "d ( )".to_owned()), ("F", "H { i : j }".to_owned())];
        assert_eq!(bodies, expected, "three bodies");
    }

    #[test]
    fn only_modules_of_tests_are_left_out() {
        let declared = "fn a() {}\n#[cfg(test)]\nmod tests;\nfn b() {}";
        assert_eq!(labels(declared), ["a", "b"], "what follows a declaration is read");
        let inline = "#[cfg(test)]\nmod tests { fn a() { \"}\" } }\nfn b() {} mod inner { fn c() {} }";
        assert_eq!(labels(inline), ["b", "c"], "what follows the block is read, and other modules");
        assert_eq!(labels("mod tests { fn a() {} }"), ["a"], "not compiled for tests only");
    }
}
