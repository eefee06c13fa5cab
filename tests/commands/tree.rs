//! The tree of commands: headings, examples, short help, forms and meanings of options. What clap parses is what this test reads.

use lastlight::cli::clap::Command;
use std::collections::{BTreeMap, BTreeSet};

/// Lines of the longest `-h` at 100 columns.
const SCREEN: usize = 50;
/// Headings in their order; a command whose result is a model has the third of the first row, others that of the second.
const HEADINGS: [[&str; 4]; 2] = [["Input", "Output", "Model", "Run"], ["Input", "Output", "Method", "Run"]];
/// What the value of an option or a positional argument may be called.
const VALUE_NAMES: [&str; 24] = [
    "DIR",
    "FILE",
    "FILE|NAME",
    "N",
    "X",
    "NAME",
    "KIND",
    "LIST",
    "FROM",
    "S|WxH",
    "KEY=VALUE",
    "CMD",
    "OP",
    "ID",
    "TOPIC",
    "WHEN",
    "DEG",
    "SECONDS",
    "R",
    "X,Y,Z",
    "R,G,B",
    "DB",
    "MIB",
    "D",
];
/// Value names of one option each.
const OF_ONE: [(&str, &str); 5] = [
    ("box", "X0,Y0,Z0,X1,Y1,Z1"),
    ("exposure", "auto|X"),
    ("train-frames", "START:STEP:COUNT"),
    ("test-frames", "START:STEP:COUNT"),
    ("pose", "FIRST:LAST"),
];
/// Options whose values have different names: a result is a file or a folder.
const SEVERAL_NAMES: [&str; 1] = ["out"];
/// Options that accept different names in different commands, since the sets differ.
const SEVERAL_SETS: [(&str, &str); 4] = [
    ("scale", "a study has three sizes, a data set two"),
    ("split", "parts of a capture, parts of a data set"),
    ("passes", "a Gaussian renderer has no materials"),
    ("cameras", "one command draws them, others read them"),
];

/// Every command with its path and the tree as it is shown.
fn commands() -> Vec<(String, Command)> {
    fn walk(command: &Command, path: &str, out: &mut Vec<(String, Command)>) {
        out.push((path.to_owned(), command.clone()));
        for below in command.get_subcommands() {
            walk(below, format!("{path} {}", below.get_name()).trim(), out);
        }
    }
    let mut tree = lastlight::cli::command().term_width(100);
    tree.build();
    let mut out = Vec::new();
    walk(&tree, "", &mut out);
    out
}

#[test]
fn every_option_is_under_one_of_four_headings_in_their_order() {
    for (path, command) in commands() {
        let mut seen: Vec<&str> = Vec::new();
        for argument in command.get_arguments() {
            let heading =
                argument.get_help_heading().unwrap_or_else(|| panic!("{path} {argument}: no heading"));
            if !seen.contains(&heading) {
                seen.push(heading);
            }
        }
        let fits = |all: &[&str; 4]| {
            let at: Option<Vec<usize>> = seen.iter().map(|h| all.iter().position(|a| a == h)).collect();
            at.is_some_and(|at| at.is_sorted())
        };
        assert!(HEADINGS.iter().any(fits), "'{path}': headings {seen:?}");
    }
}

#[test]
fn every_help_has_examples_and_is_wrapped_by_clap() {
    for (path, mut command) in commands() {
        let long = command.render_long_help().to_string();
        let short = command.render_help().to_string();
        let text = command.get_after_long_help().map(ToString::to_string).unwrap_or_default();
        assert!(long.contains("Examples:") && short.contains("Examples:"), "'{path}': help has examples");
        let name = format!("lastlight {path}");
        assert!(text.contains(name.trim()), "'{path}': its examples are of this command");
        assert!(
            short.lines().count() <= SCREEN,
            "'{path}': -h is one screen, not {} lines",
            short.lines().count()
        );
        let lines: Vec<&str> = text.lines().collect();
        for pair in lines.windows(2) {
            let is_prose = |line: &str| !line.is_empty() && !line.starts_with(' ') && line != "Examples:";
            assert!(!(is_prose(pair[0]) && is_prose(pair[1])), "'{path}': a paragraph is one line: {pair:?}");
        }
        for line in long.lines().filter(|l| !l.trim_start().starts_with("lastlight ")) {
            assert!(line.chars().count() <= 110, "'{path}': {line}");
        }
    }
}

#[test]
fn an_option_has_one_form_and_one_meaning() {
    let mut names: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    let mut values: BTreeMap<String, BTreeSet<Vec<String>>> = BTreeMap::new();
    let mut shorts: BTreeSet<(char, String)> = BTreeSet::new();
    for (path, command) in commands() {
        for argument in command.get_arguments() {
            let name = argument.get_long().unwrap_or(argument.get_id().as_str()).to_owned();
            if let Some(short) = argument.get_short() {
                shorts.insert((short, name.clone()));
            }
            assert_eq!(argument.get_all_aliases(), None, "'{path}' --{name}: no aliases");
            if !argument.get_action().takes_values() {
                names.entry(name).or_default().insert(String::new());
                continue;
            }
            let shown = argument
                .get_value_names()
                .unwrap_or_default()
                .iter()
                .map(|n| n.as_str())
                .collect::<Vec<_>>()
                .join(" ");
            let is_known = VALUE_NAMES.contains(&&*shown) || OF_ONE.contains(&(&*name, &*shown));
            assert!(is_known, "'{path}' {argument}: the value is called {shown}");
            let most = argument.get_num_args().map_or(1, |n| n.max_values());
            assert!(
                argument.is_positional() || most <= 1,
                "'{path}' --{name} would swallow positional arguments"
            );
            if argument.is_positional() {
                continue;
            }
            names.entry(name.clone()).or_default().insert(shown);
            let all =
                argument.get_possible_values().iter().map(|v| v.get_name().to_owned()).collect::<Vec<_>>();
            if !all.is_empty() {
                values.entry(name).or_default().insert(all);
            }
        }
    }
    for (name, shown) in &names {
        let several = SEVERAL_NAMES.contains(&&**name);
        assert!(shown.len() == 1 || several, "--{name} has the forms {shown:?}");
    }
    for (name, sets) in &values {
        let several = SEVERAL_SETS.iter().any(|(n, _)| n == name);
        assert!(sets.len() == 1 || several, "--{name} accepts {sets:?}");
    }
    let expected =
        [('V', "version"), ('h', "help"), ('j', "threads"), ('o', "out"), ('q', "quiet"), ('v', "verbose")];
    let shorts: Vec<(char, &str)> = shorts.iter().map(|(short, name)| (*short, name.as_str())).collect();
    assert_eq!(shorts, expected, "the only short forms");
}

#[test]
fn names_are_lists_of_values_that_completions_know() {
    let free = ["hide", "animation", "elbow"];
    for (path, command) in commands() {
        for argument in command.get_arguments().filter(|a| a.get_action().takes_values()) {
            let is_name = argument
                .get_value_names()
                .is_some_and(|n| n.iter().any(|n| ["NAME", "LIST"].contains(&n.as_str())));
            let id = argument.get_id().as_str();
            if is_name && !free.contains(&id) {
                assert!(
                    !argument.get_possible_values().is_empty(),
                    "'{path}' {argument}: its values are listed"
                );
            }
        }
    }
}
