//! The parts of a file that readers see as text, with everything else blanked out.
//!
//! A blanked text has as many characters and lines as the file, in lower case. Code becomes [`BLANK`], which
//! is no white space, so that a phrase never matches across it; the marks of doc comments become spaces, so
//! that a phrase matches across the lines of a comment.

use super::reader::{Skipped, is_word, skipped};

/// Replaces a character that is not text.
pub(crate) const BLANK: char = '\u{1}';

/// The parts of a file that are text.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Part {
    /// All of it, as Markdown.
    Markdown,
    /// Doc comments of a Rust source, as Markdown.
    Docs,
    /// String literals of a Rust source, without the names between braces.
    Literals,
}

fn lower(c: char) -> char {
    c.to_lowercase().next().unwrap_or(c)
}

fn blank(text: &mut [char]) {
    for c in text.iter_mut().filter(|c| **c != '\n') {
        *c = BLANK;
    }
}

/// The text of a part of a file. Code in backticks and fences is text only with `with_code`.
pub(crate) fn text_of(file: &str, part: Part, with_code: bool) -> Vec<char> {
    let mut text = match part {
        Part::Markdown => file.chars().collect(),
        Part::Docs => docs(file),
        Part::Literals => literals(file),
    };
    if !with_code && part != Part::Literals {
        blank_code(&mut text);
    }
    text.into_iter().map(lower).collect()
}

/// The lines of doc comments.
fn docs(file: &str) -> Vec<char> {
    let mut out = Vec::new();
    for line in file.split_inclusive('\n') {
        let start = line.len() - line.trim_start().len();
        let is_doc = ["///", "//!"].iter().any(|mark| line[start..].starts_with(mark));
        let mut chars: Vec<char> = line.chars().collect();
        if is_doc {
            chars[..start + 3].fill(' ');
        } else {
            blank(&mut chars);
        }
        out.extend(chars);
    }
    out
}

/// The string literals.
fn literals(file: &str) -> Vec<char> {
    let text: Vec<char> = file.chars().collect();
    let mut out = text.clone();
    blank(&mut out);
    let mut at = 0;
    while at < text.len() {
        match skipped(&text, at) {
            Some((Skipped::Literal, end)) => {
                let inside = at + 1..end.saturating_sub(1).max(at + 1);
                out[inside.clone()].copy_from_slice(&text[inside.clone()]);
                blank_arguments(&mut out[inside]);
                at = end;
            }
            Some((_, end)) => at = end,
            None if is_word(text[at]) => at += text[at..].iter().take_while(|c| is_word(**c)).count(),
            None => at += 1,
        }
    }
    out
}

/// Blanks the arguments `{…}` of a format string, and makes a line break with its backslash white space.
fn blank_arguments(literal: &mut [char]) {
    let mut open = None;
    for i in 0..literal.len() {
        match (literal[i], open) {
            ('{', _) => open = Some(i),
            ('}', Some(from)) => {
                blank(&mut literal[from..=i]);
                open = None;
            }
            ('\\', _) if literal.get(i + 1) == Some(&'\n') => literal[i] = ' ',
            _ => {}
        }
    }
}

/// Blanks fenced code, and code between equal runs of backticks in one paragraph.
fn blank_code(text: &mut [char]) {
    let mut line_start = 0;
    let mut fence = None;
    for i in 0..=text.len() {
        if i < text.len() && text[i] != '\n' {
            continue;
        }
        let line: String = text[line_start..i].iter().collect();
        if line.trim_start_matches([' ', BLANK]).starts_with("```") {
            match fence.take() {
                None => fence = Some(line_start),
                Some(from) => blank(&mut text[from..i]),
            }
        }
        line_start = i + 1;
    }
    let mut at = 0;
    while at < text.len() {
        let ticks = |at: usize| text[at..].iter().take_while(|c| **c == '`').count();
        let n = ticks(at);
        if n == 0 {
            at += 1;
            continue;
        }
        let mut end = at + n;
        while end < text.len() && ticks(end) != n {
            let paragraph_ends = text[end] == '\n'
                && text[end + 1..]
                    .iter()
                    .take_while(|c| **c != '\n')
                    .all(|c| c.is_whitespace() || *c == BLANK);
            if paragraph_ends {
                break;
            }
            end += ticks(end).max(1);
        }
        if end < text.len() && text[end] == '`' {
            blank(&mut text[at..end + n]);
            at = end + n;
        } else {
            at += n;
        }
    }
}

/// The indices at which a phrase in lower case occurs as whole words; any white space without an empty line
/// separates its words.
pub(crate) fn find(text: &[char], phrase: &str) -> Vec<usize> {
    let words: Vec<Vec<char>> = phrase.split_whitespace().map(|w| w.chars().collect()).collect();
    let joins = |c: Option<&char>| c.is_some_and(|c| is_word(*c) || *c == '-');
    let match_at = |start: usize| {
        let mut at = start;
        for (i, word) in words.iter().enumerate() {
            if i > 0 {
                let space = text[at..].iter().take_while(|c| c.is_whitespace()).count();
                if space == 0 || text[at..at + space].iter().filter(|c| **c == '\n').count() > 1 {
                    return false;
                }
                at += space;
            }
            if !text[at..].starts_with(word) {
                return false;
            }
            at += word.len();
        }
        !(joins(text.get(at)) || start > 0 && joins(text.get(start - 1)))
    };
    (0..text.len()).filter(|&i| words.first().is_some_and(|w| text[i] == w[0]) && match_at(i)).collect()
}

/// The line of an index, from 1.
pub(crate) fn line(text: &[char], index: usize) -> usize {
    1 + text[..index].iter().filter(|c| **c == '\n').count()
}
