//! What an error of the command line adds to that of the parser: where a word belongs that is no command, what an option expects.

use crate::choices::{INTEGER, invalid};
use clap::Command;
use clap::error::{ContextKind, ContextValue, Error, ErrorKind};
use lastlight_oracle::ops;
use std::error::Error as _;

/// Topics of `help`: name, one line, text.
pub(crate) type Topics = [(&'static str, &'static str, &'static str)];

/// Most commands and topics that are suggested.
const MOST: usize = 5;

/// Options that other programs have, by what they are here.
const ELSEWHERE: [(&str, &str, &str); 3] = [
    ("splat fit", "--size", "images are fitted at their own size; --downscale N shrinks them"),
    ("splat eval", "--size", "images are scored at their own size; --downscale N shrinks them"),
    ("splat fit", "--cameras", "the cameras are those of the capture"),
];

/// The error with what helps.
pub(crate) fn explained(mut e: Error, tree: &Command, topics: &Topics) -> Error {
    match e.kind() {
        ErrorKind::ValueValidation => with_type(e),
        ErrorKind::InvalidSubcommand => {
            let word = text(&e, ContextKind::InvalidSubcommand);
            let tips = related(&word, tree, topics).into_iter().map(|name| format!("'lastlight {name}'"));
            let tips: Vec<String> = tips.collect();
            if !tips.is_empty() {
                e.remove(ContextKind::SuggestedSubcommand);
                let tip = format!("see {}", tips.join(", "));
                e.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip.into()]));
            }
            e
        }
        ErrorKind::UnknownArgument => {
            let word = text(&e, ContextKind::InvalidArg);
            let name = word.split('=').next().unwrap_or(&word);
            let usage = e.get(ContextKind::Usage).map(ToString::to_string).unwrap_or_default();
            let here =
                ELSEWHERE.iter().find(|(command, option, _)| *option == name && usage.contains(command));
            let tip = here.map_or_else(|| owners(name, tree), |(.., tip)| Some((*tip).to_owned()));
            match tip {
                Some(tip) => {
                    e.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip.into()]));
                }
                // The parser explains how it could be a value, which an option is not meant to be.
                None if name.starts_with("--") => {
                    e.remove(ContextKind::Suggested);
                }
                None => {}
            }
            e
        }
        _ => e,
    }
}

fn text(e: &Error, kind: ContextKind) -> String {
    match e.get(kind) {
        Some(ContextValue::String(text)) => text.clone(),
        Some(ContextValue::Strings(all)) => all.join(" "),
        _ => String::new(),
    }
}

/// Names what a number must be; the parsers of the standard library report a digit that is invalid.
fn with_type(e: Error) -> Error {
    let Some(source) = e.source() else { return e };
    let expected = if source.is::<std::num::ParseIntError>() {
        INTEGER
    } else if source.is::<std::num::ParseFloatError>() {
        "a number"
    } else {
        return e;
    };
    let (argument, value) = (text(&e, ContextKind::InvalidArg), text(&e, ContextKind::InvalidValue));
    invalid(&format!("invalid value '{value}' for '{argument}': expected {expected}"))
}

/// Commands that have an option which this one has not.
fn owners(option: &str, tree: &Command) -> Option<String> {
    let name = option.strip_prefix("--")?;
    let has = |command: &Command| command.get_arguments().any(|a| a.get_long() == Some(name));
    let all: Vec<String> =
        leaves(tree).into_iter().filter(|(_, c)| has(c)).map(|(path, _)| format!("'{path}'")).collect();
    (!all.is_empty()).then(|| format!("{option} is an option of {}", all.join(", ")))
}

/// The commands that do something, with their paths.
fn leaves(tree: &Command) -> Vec<(String, &Command)> {
    let mut out = Vec::new();
    for command in tree.get_subcommands() {
        let name = command.get_name();
        if command.has_subcommands() {
            out.extend(leaves(command).into_iter().map(|(path, c)| (format!("{name} {path}"), c)));
        } else {
            out.push((name.to_owned(), command));
        }
    }
    out
}

/// Commands and topics for a word that is neither: those of that name, those of almost that name, or those whose description has the word.
pub(crate) fn related(word: &str, tree: &Command, topics: &Topics) -> Vec<String> {
    let word = word.to_lowercase();
    let all = leaves(tree);
    let last = |path: &str| path.rsplit(' ').next().unwrap_or_default().to_owned();
    let mut out: Vec<String> =
        all.iter().filter(|(path, _)| last(path) == word).map(|(path, _)| path.clone()).collect();
    if out.is_empty() {
        let groups = tree.get_subcommands().map(|c| c.get_name().to_owned());
        let names: Vec<String> = groups.chain(all.iter().map(|(path, _)| last(path))).collect();
        let titles = topics.iter().map(|(name, ..)| *name);
        let close = ops::similar(&word, names.iter().map(String::as_str).chain(titles));
        if let Some(&close) = close.first() {
            let is_topic = topics.iter().any(|(name, ..)| *name == close);
            let paths = all.iter().filter(|(path, _)| last(path) == close).map(|(path, _)| path.clone());
            out = if is_topic { vec![format!("help {close}")] } else { paths.collect() };
            if out.is_empty() {
                out.push(format!("help {close}"));
            }
        }
    }
    if out.is_empty() && word.len() > 2 {
        let has =
            |text: &str| text.to_lowercase().split(|c: char| !c.is_alphanumeric()).any(|part| part == word);
        let topics = topics.iter().filter(|(_, about, text)| has(about) || has(text));
        out.extend(topics.map(|(name, ..)| format!("help {name}")));
        let described = |c: &Command| c.get_about().is_some_and(|about| has(&about.to_string()));
        out.extend(all.iter().filter(|(_, c)| described(c)).map(|(path, _)| path.clone()));
    }
    out.truncate(MOST);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_lead_to_commands_and_topics() {
        let tree = crate::command();
        let of = |word: &str| related(word, &tree, &crate::topics::TOPICS);
        assert_eq!(of("fit"), ["splat fit", "last fit", "field fit"], "a command of a group");
        assert_eq!(of("rendr"), ["splat render", "last render", "mesh render"], "almost a command");
        assert_eq!(of("splt"), ["help splat"], "almost a group");
        assert_eq!(of("profile"), ["help profiles"], "almost a topic");
        assert_eq!(of("photos").first().map(String::as_str), Some("help captures"), "{:?}", of("photos"));
        assert!(of("zzzzzzzz").is_empty(), "nothing");
    }
}
