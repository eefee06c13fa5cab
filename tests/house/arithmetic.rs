//! Arithmetic on cotangents in the body of a function.
//!
//! A place is one of a cotangent when a word of it is `bar`, `bars`, `grad`, `gradient`, … or ends with one
//! of these behind `_`, or when its name is bound to such a place by `for`, by a closure of an iterator, or
//! by `let`. Found are
//!
//! * assignments to such a place by `+=`, `-=`, `*=`, `/=`, or by `=` with a binary operator on the right,
//! * `let` and fields of such a name with a binary operator on the right,
//! * binary operators with such a place on one side,
//! * arguments with a binary operator of functions that are named as adjoints.
//!
//! Operators inside `[…]` are those of indices and sizes, and do not count. Arithmetic by methods, and on
//! numbers whose names do not reveal their type, is not found.

use super::functions::{closing, is_word};
use std::collections::BTreeSet;

/// Words of a cotangent or a gradient.
const NAMES: [&str; 8] = ["bar", "bars", "grad", "grads", "gradient", "gradients", "cotangent", "cotangents"];

/// Keywords: no names, and no values in front of an operator.
const KEYWORDS: [&str; 13] =
    ["return", "in", "if", "else", "match", "as", "while", "break", "mut", "let", "for", "move", "ref"];

/// Methods that give a size.
const SIZES: [&str; 4] = ["len", "count", "dim", "rows"];

fn is_bar(word: &str) -> bool {
    NAMES.iter().any(|n| word == *n || word.strip_suffix(n).is_some_and(|w| w.ends_with('_')))
}

fn is_name(token: &str) -> bool {
    is_word(token) && !KEYWORDS.contains(&token)
}

/// Whether a value may end with this token, so that a sign behind it has two sides.
fn ends_value(token: &str) -> bool {
    is_name(token) || token == ")" || token == "]"
}

/// A body, and names in it that are bound to cotangents.
struct Body<'a> {
    t: &'a [String],
    aliases: BTreeSet<&'a str>,
}

impl<'a> Body<'a> {
    fn new(t: &'a [String]) -> Self {
        let mut body = Self { t, aliases: BTreeSet::new() };
        for at in 0..t.len() {
            let names = match body.token(at) {
                "for" => body.of_loop(at),
                "|" => body.of_closure(at),
                "let" => body.of_let(at),
                _ => None,
            };
            if let Some(names) = names {
                body.aliases.extend(names.iter().filter(|s| is_name(s)).map(String::as_str));
            }
        }
        body
    }

    fn token(&self, at: usize) -> &'a str {
        self.t.get(at).map_or("", String::as_str)
    }

    fn before(&self, at: usize) -> &'a str {
        at.checked_sub(1).map_or("", |at| self.token(at))
    }

    fn find(&self, from: usize, wanted: &str) -> Option<usize> {
        (from..self.t.len()).find(|at| self.t[*at] == wanted)
    }

    fn has_bar(&self, from: usize, to: usize) -> bool {
        self.t[from..to].iter().any(|s| is_bar(s) || self.aliases.contains(s.as_str()))
    }

    /// The pattern of `for PATTERN in …bar… {`.
    fn of_loop(&self, at: usize) -> Option<&'a [String]> {
        let inside = self.find(at, "in")?;
        self.has_bar(inside, self.find(inside, "{")?).then(|| &self.t[at + 1..inside])
    }

    /// The pattern of `…bar….method(|PATTERN|`.
    fn of_closure(&self, at: usize) -> Option<&'a [String]> {
        let method = at.checked_sub(2)?;
        let is_first = self.token(at - 1) == "(" && self.before(method) == "." && is_word(self.token(method));
        let end = self.find(at + 1, "|").filter(|_| is_first)?;
        self.has_bar(self.place(method), method).then(|| &self.t[at + 1..end])
    }

    /// The name of `let NAME = &mut bar[i];`.
    fn of_let(&self, at: usize) -> Option<&'a [String]> {
        let name = at + 1 + usize::from(self.token(at + 1) == "mut");
        let mut value = name + 2;
        while ["&", "mut", "*"].contains(&self.token(value)) {
            value += 1;
        }
        let end = self.find(value, ";").filter(|_| self.token(name + 1) == "=")?;
        let is_place = self.place(end) <= value && !self.t[value..end].iter().any(|s| s == "(");
        (is_place && self.has_bar(value, end)).then(|| &self.t[name..=name])
    }

    /// Where the place that ends before `end` begins: `*a.b[i].c`.
    fn place(&self, end: usize) -> usize {
        let mut at = end;
        while at > 0 {
            match self.token(at - 1) {
                "]" | ")" => at = self.opening(at - 1),
                "." | "*" | "::" | "?" => at -= 1,
                name if is_name(name) => at -= 1,
                _ => break,
            }
        }
        at
    }

    /// Where the bracket that closes at `close` is opened.
    fn opening(&self, close: usize) -> usize {
        let mut depth = 0_usize;
        for at in (0..=close).rev() {
            match self.token(at) {
                "]" | ")" | "}" => depth += 1,
                "[" | "(" | "{" => depth = depth.saturating_sub(1),
                _ => continue,
            }
            if depth == 0 {
                return at;
            }
        }
        0
    }

    /// Where the expression from `at` on ends: at `;`, the bracket that encloses it, and a comma where
    /// `has_commas`.
    fn expression(&self, mut at: usize, has_commas: bool) -> usize {
        while at < self.t.len() {
            match self.token(at) {
                "(" | "[" | "{" => at = closing(self.t, at),
                ")" | "]" | "}" | ";" => return at,
                "," if has_commas => return at,
                _ => {}
            }
            at += 1;
        }
        self.t.len()
    }

    /// Whether the sign at `at` is an operator with two sides, and assigns nothing.
    fn is_binary(&self, at: usize) -> bool {
        let is_sign = match self.token(at) {
            "/" => true,
            "-" => self.token(at + 1) != ">",
            "+" | "*" => true,
            _ => false,
        };
        is_sign && self.token(at + 1) != "=" && ends_value(self.before(at))
    }

    /// Whether an expression computes, outside `[…]`.
    fn computes(&self, from: usize, to: usize) -> bool {
        let mut at = from;
        while at < to {
            if self.token(at) == "[" {
                at = closing(self.t, at);
            } else if self.is_binary(at) {
                return true;
            }
            at += 1;
        }
        false
    }

    /// Whether `=` at `at` assigns: it is no part of `==`, `<=`, `=>`; behind `>` it follows the type of a
    /// `let`.
    fn assigns(&self, at: usize) -> bool {
        let binds = || {
            let ends = ["let", "=", ";", "{", "}"];
            self.t[..at].iter().rev().find(|s| ends.contains(&s.as_str())).is_some_and(|s| s == "let")
        };
        !["=", ">"].contains(&self.token(at + 1))
            && match self.before(at) {
                "=" | "<" | "!" => false,
                ">" => binds(),
                _ => true,
            }
    }

    /// Whether the word at `at` is a name of a cotangent or bound to one, and more than the size of it is
    /// read.
    fn is_read(&self, at: usize) -> bool {
        let is_own = ![".", "::"].contains(&self.before(at)) && self.aliases.contains(self.token(at));
        let mut end = at + 1;
        while self.token(end) == "." && is_name(self.token(end + 1)) {
            end += 2;
        }
        (is_bar(self.token(at)) || is_own) && !SIZES.contains(&self.token(end - 1))
    }

    /// Whether what is on one side of an operator has a word of a cotangent outside indices.
    fn reads(&self, from: usize, to: usize) -> bool {
        let mut at = from;
        while at < to {
            if self.token(at) == "[" {
                at = closing(self.t, at);
            } else if self.is_read(at) {
                return true;
            }
            at += 1;
        }
        false
    }

    /// Where the place that begins at `at` ends.
    fn place_end(&self, mut at: usize) -> usize {
        while ["&", "*", "-"].contains(&self.token(at)) {
            at += 1;
        }
        loop {
            match self.token(at) {
                "." | "::" => at += 1,
                "[" | "(" => at = closing(self.t, at) + 1,
                name if is_name(name) => at += 1,
                _ => return Ord::min(at, self.t.len()),
            }
        }
    }

    /// The assignment at `at`, from the beginning of its place or of its `let`.
    fn assignment(&self, at: usize) -> Option<(usize, usize)> {
        let is_compound = ["+", "-", "*", "/"].contains(&self.before(at));
        let to = at - usize::from(is_compound);
        let end = self.expression(at + 1, false);
        let begins = self.t[..at].iter().rposition(|s| [";", "{", "}"].contains(&s.as_str()));
        let begins = begins.map_or(0, |i| i + 1);
        let is_let = self.t[begins..at].iter().any(|s| s == "let");
        let from = if is_let { begins } else { self.place(to) };
        let is_bar = if is_let { self.t[from..to].iter().any(|s| is_bar(s)) } else { self.has_bar(from, to) };
        (is_bar && (is_compound || self.computes(at + 1, end))).then_some((from, end))
    }

    /// The call at `at`, if an argument computes.
    fn call(&self, at: usize) -> Option<(usize, usize)> {
        let end = closing(self.t, at);
        let mut from = at + 1;
        while from < end {
            let to = Ord::min(self.expression(from, true), end);
            if self.computes(from, to) {
                return Some((at - 1, end + 1));
            }
            from = to + 1;
        }
        None
    }

    /// What is computed with cotangents at the token `at`.
    fn found(&self, at: usize, is_adjoint: fn(&str) -> bool) -> Option<(usize, usize)> {
        match self.token(at) {
            "=" if self.assigns(at) => self.assignment(at),
            ":" if is_bar(self.before(at)) => {
                let end = self.expression(at + 1, true);
                let is_field = [",", "}"].contains(&self.token(end)) || end == self.t.len();
                (is_field && self.computes(at + 1, end)).then_some((at - 1, end))
            }
            "(" if is_adjoint(self.before(at)) => self.call(at),
            _ if self.is_binary(at) => {
                let (from, to) = (self.place(at), self.place_end(at + 1));
                (self.reads(from, at) || self.reads(at + 1, to)).then_some((from, to))
            }
            _ => None,
        }
    }
}

/// Tokens as text, with spaces between words only.
fn text(t: &[String]) -> String {
    let mut out = String::new();
    for token in t {
        if is_word(token) && out.ends_with(|c: char| c.is_alphanumeric() || c == '_') {
            out.push(' ');
        }
        out += token;
    }
    out
}

/// What a body computes with cotangents, as text without spaces; of nested ones the outer.
pub(crate) fn cotangents(t: &[String], is_adjoint: fn(&str) -> bool) -> Vec<String> {
    let body = Body::new(t);
    let mut found: Vec<_> = (0..t.len()).filter_map(|at| body.found(at, is_adjoint)).collect();
    found.sort_by_key(|(from, to)| (*from, usize::MAX - *to));
    let mut end = 0;
    found.retain(|(_, to)| {
        let is_outer = *to > end;
        end = Ord::max(end, *to);
        is_outer
    });
    found.into_iter().map(|(from, to)| text(&t[from..to])).collect()
}

#[cfg(test)]
mod tests {
    use super::super::reader::tokens;
    use super::cotangents;

    fn found(text: &str) -> Vec<String> {
        cotangents(&tokens(text), |name| name.contains("adjoint"))
    }

    #[test]
    fn every_way_to_write_a_derivative_is_found() {
        for (text, expected) in [
            ("bars.mask.iter_mut().zip(along).for_each(|(bar, a)| *bar *= a);", "*bar*=a"),
            ("x_bar[i] += w;", "x_bar[i]+=w"),
            ("self.x_bar[2 * i].y -= w;", "self.x_bar[2*i].y-=w"),
            ("gradient[i * n] = with - c[i];", "gradient[i*n]=with-c[i]"),
            ("for (to, from) in out.image_bar.iter_mut().zip(&x) { *to += w * from; }", "*to+=w*from"),
            ("x_bar.iter_mut().for_each(|g| *g /= n)", "*g/=n"),
            (
                "let y_bar: Vec<f32> = x.iter().map(|x| 2.0 * x).collect();",
                "let y_bar:Vec<f32>=x.iter().map(|x|2.0*x).collect()",
            ),
            ("let bar = a + b;", "let bar=a+b"),
            ("f(InBar { x_bar: 2.0 * x, y })", "x_bar:2.0*x"),
            ("acyclic::adjoint(&p, n, 1.0 + h, &mut p_bar);", "adjoint(&p,n,1.0+h,&mut p_bar)"),
            ("let out = y_bar.iter().zip(&x).map(|(g, x)| g * x).collect();", "g*x"),
            ("let g = &mut bars.x[i]; let y = g * w;", "g*w"),
            ("f(w * bars.x[i])", "w*bars.x[i]"),
            ("f(f64::from(x_bar[i]) * w)", "f64::from(x_bar[i])*w"),
            ("f(x_bar[3] - 1.0)", "x_bar[3]-1"),
        ] {
            let what = found(text);
            assert!(what.iter().any(|w| w.starts_with(expected)), "{text}: {what:?}");
        }
    }

    #[test]
    fn handing_on_is_not_computing() {
        for text in [
            "let mut x_bar = vec![0.0; n * k]; l1::adjoint(&x, &saved, -w, &mut x_bar, None);",
            "let row_bar = &mut x_bar[i * n..(i + 1) * n]; let n = x.len() * 2;",
            "if x_bar.len() == n && a >= b { return Out { x_bar, y: 2.0 * y } }",
            "for (i, row) in rows.iter().enumerate() { y[i] += row * w; } let f = |x_bar: &[f32]| -> f32 { 0.0 };",
            "x_bar = other; y = x.adjoint(n, &x_bar[3 * i..]); bar.x = vec![0.0; 3 * n];",
        ] {
            assert!(found(text).is_empty(), "{text}: {:?}", found(text));
        }
    }
}
