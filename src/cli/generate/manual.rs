//! Manual pages in roff.
//!
//! Titles, options and subcommands are those of `clap_mangen`. The text below the options has headings of its own here: examples, in which
//! lines stay as they are, and notes.

use clap::Command;
use clap_mangen::Man;
use clap_mangen::roff::{Roff, roman};
use std::io::Result;

/// The pages of a command and of all commands below it: names of files, and their texts.
pub(super) fn pages(tree: Command) -> Result<Vec<(String, Vec<u8>)>> {
    fn below(command: &Command, out: &mut Vec<(String, Vec<u8>)>) -> Result<()> {
        out.push(page(command.clone())?);
        command.get_subcommands().filter(|c| !c.is_hide_set()).try_for_each(|c| below(c, out))
    }
    let mut tree = tree;
    tree.build();
    let mut out = Vec::new();
    below(&tree, &mut out)?;
    Ok(out)
}

/// The page of one command: the name of its file, and its text.
pub(super) fn page(command: Command) -> Result<(String, Vec<u8>)> {
    let text = command.get_after_long_help().or(command.get_after_help()).map(ToString::to_string);
    let has_commands = command.get_subcommands().any(|c| !c.is_hide_set());
    // `clap_mangen` leaves out the help of options that -h leaves out.
    let command = command.mut_args(|argument| argument.hide_short_help(false));
    let release = concat!("lastlight ", env!("CARGO_PKG_VERSION"));
    let man = Man::new(command).source(release).manual("lastlight");
    let mut page = Vec::new();
    man.render_title(&mut page)?;
    man.render_name_section(&mut page)?;
    man.render_synopsis_section(&mut page)?;
    man.render_description_section(&mut page)?;
    man.render_options_section(&mut page)?;
    if has_commands {
        man.render_subcommands_section(&mut page)?;
    }
    extra(&text.unwrap_or_default()).to_writer(&mut page)?;
    Ok((man.get_filename(), page))
}

/// The examples with which the text begins, then the rest; lines that are indented there keep their form.
fn extra(text: &str) -> Roff {
    let mut out = Roff::default();
    let (examples, notes) = match text.strip_prefix("Examples:\n") {
        Some(rest) => rest.split_once("\n\n").unwrap_or((rest, "")),
        None => ("", text),
    };
    for (heading, text) in [("EXAMPLES", examples), ("NOTES", notes)] {
        if !text.trim().is_empty() {
            out.control("SH", [heading]);
            paragraphs(text, &mut out);
        }
    }
    out
}

/// Paragraphs filled by troff, and indented lines as they are.
fn paragraphs(text: &str, out: &mut Roff) {
    let mut is_example = false;
    for line in text.trim_end().lines() {
        if line.starts_with("  ") != is_example && !line.is_empty() {
            is_example = !is_example;
            out.control(if is_example { "EX" } else { "EE" }, []);
        }
        match line {
            "" if is_example => out.text([roman("")]),
            "" => out.control("PP", []),
            line => out.text([roman(line)]),
        };
    }
    if is_example {
        out.control("EE", []);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn examples_keep_their_lines_and_prose_is_filled() {
        let text =
            "Examples:\n  lastlight a    one\n  .b\n\nFirst.\n\nTwo kinds:\n  x   1\n  y   2\nAfter it.";
        let page = extra(text).to_roff();
        let at = |word: &str| page.find(word).unwrap_or_else(|| panic!("'{word}' in {page}"));
        let order =
            [".SH EXAMPLES", ".EX", "lastlight a", ".EE", ".SH NOTES", "First.", ".PP", "Two kinds:"].map(at);
        assert!(order.is_sorted(), "{page}");
        assert_eq!((page.matches("\n.EX\n").count(), page.matches(".EE\n").count()), (2, 2), "{page}");
        assert!(page.trim_end().ends_with("After it."), "{page}");
        assert_eq!(extra("").to_roff(), Roff::default().to_roff(), "nothing");
    }
}
