//! The language of the texts: no text contains a phrase of the column "not" in the word list of
//! `CONTRIBUTING.md`.
//!
//! Texts are the README and its neighbours, the book, all doc comments, and the string literals of the
//! commands and of the study, which are help, messages and reports. Phrases are the code in that column; they
//! are searched as whole words, in any case. Phrases of letters are searched outside code, so that
//! identifiers are free; the others (options, file names) also inside.

use super::ROOT;
use super::prose::{Part, find, line, text_of};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

/// Uses that are correct: file, phrase, reason.
const EXCEPTIONS: &[(&str, &str, &str)] =
    &[("data-gen/src/environments/room.rs", "pictures", "pictures that hang on the walls of the room")];

/// Documents outside the source folders, besides the book.
const DOCUMENTS: [&str; 4] = ["ARCHITECTURE.md", "CHANGELOG.md", "CONTRIBUTING.md", "README.md"];

/// Folders whose doc comments are checked.
const DOCUMENTED: [&str; 3] = ["src", "data-gen", "reference"];

/// Folders whose string literals are checked too.
const PRINTED: [&str; 2] = ["src/cli", "src/study"];

/// A phrase to avoid and what to write instead.
#[derive(Debug, PartialEq)]
struct Word {
    phrase: String,
    write: String,
}

impl Word {
    /// Whether it is searched inside code too.
    fn is_name(&self) -> bool {
        self.phrase.starts_with("--") || self.phrase.contains('.')
    }
}

/// The rows of the word list: the lines of the last table under "Language of texts".
fn table(contributing: &str) -> impl Iterator<Item = (usize, &str)> {
    let rows = contributing.lines().enumerate().skip_while(|(_, l)| *l != "## Language of texts");
    rows.skip(1).take_while(|(_, l)| !l.starts_with("## ")).filter(|(_, l)| l.starts_with('|'))
}

/// The word list of `CONTRIBUTING.md`.
fn words(contributing: &str) -> Vec<Word> {
    let mut out = Vec::new();
    for (_, row) in table(contributing) {
        let cells: Vec<&str> = row.trim_matches('|').split('|').map(str::trim).collect();
        let [write, not] = cells[..] else { panic!("the row has two cells: {row}") };
        for phrase in not.split('`').skip(1).step_by(2) {
            out.push(Word { phrase: phrase.to_lowercase(), write: write.to_owned() });
        }
    }
    out
}

/// The text without the word list itself.
fn without_list(contributing: &str) -> String {
    let rows: Vec<usize> = table(contributing).map(|(i, _)| i).collect();
    contributing
        .lines()
        .enumerate()
        .map(|(i, l)| if rows.contains(&i) { "\n".into() } else { format!("{l}\n") })
        .collect()
}

/// The section of the version that is not released.
fn unreleased(changelog: &str) -> &str {
    let first = changelog.find("\n## [").map_or(0, |i| i + 1);
    let length = changelog[first..].find("\n## [").unwrap_or(changelog.len() - first);
    &changelog[..first + length]
}

/// One text to be checked.
struct Text {
    file: String,
    content: String,
    part: Part,
    /// Whether names in code are checked; a changelog contains former names.
    names: bool,
}

fn texts(root: &Path) -> Vec<Text> {
    let read = |file: &str| fs::read_to_string(root.join(file)).expect("the file is readable");
    let text = |file: &str, content: String, part: Part| {
        let names = file != "CHANGELOG.md";
        Text { file: file.to_owned(), content, part, names }
    };
    let mut out = Vec::new();
    for file in DOCUMENTS {
        let content = match file {
            "CONTRIBUTING.md" => without_list(&read(file)),
            "CHANGELOG.md" => unreleased(&read(file)).to_owned(),
            _ => read(file),
        };
        out.push(text(file, content, Part::Markdown));
    }
    for file in files(root, "src/book", "md") {
        out.push(text(&file, read(&file), Part::Markdown));
    }
    for folder in DOCUMENTED {
        for file in files(root, folder, "rs") {
            let content = read(&file);
            if PRINTED.iter().any(|f| file.starts_with(&format!("{f}/"))) {
                out.push(text(&file, content.clone(), Part::Literals));
            }
            out.push(text(&file, content, Part::Docs));
        }
    }
    out
}

/// Files of a folder and its subfolders with an extension, as paths below the root, sorted.
fn files(root: &Path, folder: &str, extension: &str) -> Vec<String> {
    let mut out = Vec::new();
    for entry in fs::read_dir(root.join(folder)).expect("the folder is readable") {
        let entry = entry.expect("an entry");
        let path = format!("{folder}/{}", entry.file_name().to_string_lossy());
        if entry.path().is_dir() {
            out.extend(files(root, &path, extension));
        } else if path.ends_with(&format!(".{extension}")) {
            out.push(path);
        }
    }
    out.sort();
    out
}

/// Every place of a text with a phrase of the list: line and index of the word.
fn check(text: &Text, words: &[Word]) -> Vec<(usize, usize)> {
    let without_code = text_of(&text.content, text.part, false);
    let with_code = text_of(&text.content, text.part, true);
    let mut out = Vec::new();
    for (k, word) in words.iter().enumerate() {
        if word.is_name() && !text.names {
            continue;
        }
        let chars = if word.is_name() { &with_code } else { &without_code };
        out.extend(find(chars, &word.phrase).into_iter().map(|i| (line(chars, i), k)));
    }
    out
}

#[test]
fn texts_are_in_the_language_of_the_word_list() {
    let root = Path::new(ROOT);
    let contributing = fs::read_to_string(root.join("CONTRIBUTING.md")).expect("the file is readable");
    let words = words(&contributing);
    assert!(words.len() >= 40, "the word list is found: {} phrases", words.len());
    let mut used = vec![false; EXCEPTIONS.len()];
    let mut found = String::new();
    for text in texts(root) {
        for (line, k) in check(&text, &words) {
            let Word { phrase, write } = &words[k];
            match EXCEPTIONS.iter().position(|(file, of, _)| *file == text.file && of == phrase) {
                Some(e) => used[e] = true,
                None => writeln!(found, "{}:{line}: '{phrase}': write {write}", text.file).expect("a string"),
            }
        }
    }
    assert!(found.is_empty(), "phrases of the word list in CONTRIBUTING.md:\n{found}");
    let unused: Vec<_> = EXCEPTIONS.iter().zip(used).filter(|(_, used)| !used).map(|(e, _)| e).collect();
    assert!(unused.is_empty(), "exceptions without a use: {unused:?}");
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIST: &str = "\
## Other
| a | b |
## Language of texts
Text with `code`.

| write | not |
|---|---|
| image | `picture`, `pictures` |
| by default | `unless told otherwise` |
| the new name | `--raw`, `last.md` |

## End
| c | d |
";

    fn found(content: &str, part: Part) -> Vec<(usize, String)> {
        let words = words(LIST);
        let text = Text { file: "a".into(), content: content.into(), part, names: true };
        check(&text, &words).into_iter().map(|(line, k)| (line, words[k].phrase.clone())).collect()
    }

    #[test]
    fn the_word_list_is_read() {
        let words = words(LIST);
        let phrases: Vec<&str> = words.iter().map(|w| w.phrase.as_str()).collect();
        assert_eq!(phrases, ["picture", "pictures", "unless told otherwise", "--raw", "last.md"], "in order");
        assert_eq!(words[1].write, "image", "of its row");
        assert!(!without_list(LIST).contains("picture"), "the list itself is no text");
        assert_eq!(without_list(LIST).lines().count(), LIST.lines().count(), "lines keep their numbers");
        assert_eq!(
            unreleased("# C\n## [2] new\na\n## [1] old\nb\n"),
            "# C\n## [2] new\na",
            "the first section"
        );
    }

    #[test]
    fn phrases_are_found_in_markdown() {
        let hit = |line: usize, phrase: &str| vec![(line, phrase.to_owned())];
        assert_eq!(found("A text.\nA Picture.", Part::Markdown), hit(2, "picture"), "a word in any case");
        assert_eq!(
            found("so, unless\n  told otherwise, x", Part::Markdown),
            hit(1, "unless told otherwise"),
            "over a line"
        );
        assert_eq!(found("with `x --raw`", Part::Markdown), hit(1, "--raw"), "an option in code");
        assert_eq!(found("see [it](../last.md)", Part::Markdown), hit(1, "last.md"), "a file");
        assert!(
            found("depicture, picturesque, --raw-data, at-last.md", Part::Markdown).is_empty(),
            "whole words only"
        );
        assert!(found("`picture` and\n```text\na picture\n```\n", Part::Markdown).is_empty(), "no code");
        assert!(
            found("unless `x` told otherwise, unless\n\ntold otherwise", Part::Markdown).is_empty(),
            "not across code or paragraphs"
        );
    }

    #[test]
    fn phrases_are_found_in_doc_comments() {
        let text = "//! Of a picture,\nfn picture() {} // a picture\n    /// unless told\n    /// otherwise\nlet s = \"a picture\";\n";
        let want = [(1, "picture".to_owned()), (3, "unless told otherwise".to_owned())];
        assert_eq!(found(text, Part::Docs), want, "docs alone");
        assert!(found("/// Text `a\n/// picture` of\n", Part::Docs).is_empty(), "code over two lines");
    }

    #[test]
    fn phrases_are_found_in_string_literals() {
        let text = "/// a picture\nlet picture = f(\"a picture\", 'p', r#\"\"picture\" \"#); // a \"picture\"\nlet t = \"{picture} unless \\\n   told otherwise\";\n";
        let want =
            [(2, "picture".to_owned()), (2, "picture".to_owned()), (3, "unless told otherwise".to_owned())];
        assert_eq!(found(text, Part::Literals), want, "literals alone, without arguments");
    }
}
