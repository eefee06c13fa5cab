//! Text from files as a terminal may show it: control characters escaped, long strings shortened.

use std::borrow::Cow;

/// Longest run of characters without a space that a note or an error shows.
const LONGEST_WORD: usize = 240;
/// Longest note or error, in characters.
const LONGEST_TEXT: usize = 4000;

/// Whether a terminal obeys the character, or shows text in another order because of it.
fn is_hidden(c: char) -> bool {
    let reorders = matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
    (c.is_control() && !matches!(c, '\n' | '\t')) || reorders
}

/// The text with control characters as `\u{1b}`; line breaks and tabs stay.
pub(crate) fn escaped(text: &str) -> Cow<'_, str> {
    if !text.contains(is_hidden) {
        return Cow::Borrowed(text);
    }
    let shown = |c: char| if is_hidden(c) { c.escape_unicode().to_string() } else { c.to_string() };
    Cow::Owned(text.chars().map(shown).collect())
}

/// A JSON document with control characters inside its strings as `\u007f`.
pub(crate) fn escaped_json(document: &str) -> Cow<'_, str> {
    if !document.contains(is_hidden) {
        return Cow::Borrowed(document);
    }
    let shown = |c: char| if is_hidden(c) { format!("\\u{:04x}", u32::from(c)) } else { c.to_string() };
    Cow::Owned(document.chars().map(shown).collect())
}

/// The text without the middle of its longest words, and without its own if it is still long.
pub(crate) fn shortened(text: &str) -> Cow<'_, str> {
    if text.chars().count() <= LONGEST_WORD {
        return Cow::Borrowed(text);
    }
    let words: String =
        text.split_inclusive(char::is_whitespace).map(|word| middle_out(word, LONGEST_WORD)).collect();
    Cow::Owned(middle_out(&words, LONGEST_TEXT).into_owned())
}

fn middle_out(text: &str, most: usize) -> Cow<'_, str> {
    let count = text.chars().count();
    if count <= most {
        return Cow::Borrowed(text);
    }
    let side = most / 3;
    let start: String = text.chars().take(side).collect();
    let end: String = text.chars().skip(count - side).collect();
    Cow::Owned(format!("{start}[… {} characters …]{end}", count - 2 * side))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_escaped_and_text_stays() {
        assert_eq!(escaped("Größe 3×4 → 日本\n\t."), "Größe 3×4 → 日本\n\t.", "text");
        assert_eq!(escaped("a\u{1b}[31mb\u{7}\r\u{9b}"), "a\\u{1b}[31mb\\u{7}\\u{d}\\u{9b}", "controls");
        assert_eq!(escaped("x\u{202e}gnp.y"), "x\\u{202e}gnp.y", "another order");
    }

    #[test]
    fn a_json_document_stays_one() {
        let value = serde_json::json!({"message": "a\u{7f}\u{1b}[31m\u{9b}\u{202e}é\n"});
        let shown = escaped_json(&format!("{value:#}")).into_owned();
        assert!(!shown.contains(is_hidden), "{shown}");
        assert_eq!(serde_json::from_str::<serde_json::Value>(&shown).expect("JSON"), value, "{shown}");
    }

    #[test]
    fn long_strings_lose_their_middle() {
        let path = format!("/{}", "a/".repeat(100));
        assert_eq!(shortened(&path), path, "a usual path stays");
        let text = format!("a.ply: expected a number, got '{}' (a hint)", "x".repeat(5000));
        let short = shortened(&text);
        assert!(short.chars().count() < 400, "{} characters", short.chars().count());
        assert!(
            short.starts_with("a.ply: expected a number, got 'xx") && short.ends_with("x' (a hint)"),
            "{short}"
        );
        assert!(short.contains("characters …]"), "states how many are left out: {short}");
        assert!(shortened(&"word ".repeat(5000)).chars().count() <= LONGEST_TEXT, "many words");
    }
}
