//! The tree of commands: headings, examples, short help, forms and meanings of options. What clap parses is what this test reads.

use lastlight::cli::clap::Command;
use std::collections::{BTreeMap, BTreeSet};

/// Lines of the longest `-h` at 100 columns.
const SCREEN: usize = 50;
/// Headings in their order; a command whose result is a model has the third of the first row, others that of the second.
const HEADINGS: [[&str; 4]; 2] = [["Input", "Output", "Model", "Run"], ["Input", "Output", "Method", "Run"]];
/// What the value of an option or a positional argument may be called.
const VALUE_NAMES: [&str; 27] = [
    "MINE",
    "REFERENCE",
    "SIZE",
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

/// Fails with all problems at once.
fn none(problems: &[String]) {
    assert!(problems.is_empty(), "{} problems:\n{}", problems.len(), problems.join("\n"));
}

#[test]
fn every_option_is_under_one_of_four_headings_in_their_order() {
    let mut problems = Vec::new();
    for (path, command) in commands() {
        let mut seen: Vec<&str> = Vec::new();
        for argument in command.get_arguments() {
            match argument.get_help_heading() {
                Some(heading) if seen.contains(&heading) => {}
                Some(heading) => seen.push(heading),
                None => problems.push(format!("'{path}' {argument}: no heading")),
            }
        }
        let fits = |all: &[&str; 4]| {
            let at: Option<Vec<usize>> = seen.iter().map(|h| all.iter().position(|a| a == h)).collect();
            at.is_some_and(|at| at.is_sorted())
        };
        if !HEADINGS.iter().any(fits) {
            problems.push(format!("'{path}': headings {seen:?}"));
        }
    }
    none(&problems);
}

#[test]
fn every_help_has_examples_and_is_wrapped_by_clap() {
    let mut problems = Vec::new();
    for (path, mut command) in commands() {
        let long = command.render_long_help().to_string();
        let short = command.render_help().to_string();
        let text = command.get_after_long_help().map(ToString::to_string).unwrap_or_default();
        let name = format!("lastlight {path}");
        if !(long.contains("Examples:") && short.contains("Examples:") && text.contains(name.trim())) {
            problems.push(format!("'{path}': no examples of this command"));
        }
        if short.lines().count() > SCREEN {
            problems.push(format!("'{path}': -h is {} lines, more than one screen", short.lines().count()));
        }
        let is_prose = |line: &str| !line.is_empty() && !line.starts_with(' ') && line != "Examples:";
        let lines: Vec<&str> = text.lines().collect();
        for pair in lines.windows(2).filter(|pair| is_prose(pair[0]) && is_prose(pair[1])) {
            problems.push(format!("'{path}': a paragraph is one line: {pair:?}"));
        }
        let is_wide =
            |line: &&str| line.chars().count() > 110 && !line.trim_start().starts_with("lastlight ");
        problems.extend(long.lines().filter(is_wide).map(|line| format!("'{path}': not wrapped: {line}")));
    }
    none(&problems);
}

#[test]
fn an_option_has_one_form_and_one_meaning() {
    let mut problems = Vec::new();
    let mut names: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    let mut values: BTreeMap<String, BTreeSet<Vec<String>>> = BTreeMap::new();
    let mut shorts: BTreeSet<(char, String)> = BTreeSet::new();
    for (path, command) in commands() {
        for argument in command.get_arguments() {
            let name = argument.get_long().unwrap_or(argument.get_id().as_str()).to_owned();
            shorts.extend(argument.get_short().map(|short| (short, name.clone())));
            if argument.get_all_aliases().is_some() {
                problems.push(format!("'{path}' --{name} has an alias"));
            }
            if !argument.get_action().takes_values() {
                names.entry(name).or_default().insert(String::new());
                continue;
            }
            let shown: Vec<&str> =
                argument.get_value_names().unwrap_or_default().iter().map(|n| n.as_str()).collect();
            let shown = shown.join(" ");
            if !VALUE_NAMES.contains(&&*shown) && !OF_ONE.contains(&(&*name, &*shown)) {
                problems.push(format!("'{path}' {argument}: the value is called {shown}"));
            }
            if argument.is_positional() {
                continue;
            }
            if argument.get_num_args().is_some_and(|n| n.max_values() > 1) {
                problems.push(format!("'{path}' --{name} would swallow positional arguments"));
            }
            names.entry(name.clone()).or_default().insert(shown);
            let all: Vec<String> =
                argument.get_possible_values().iter().map(|v| v.get_name().to_owned()).collect();
            if !all.is_empty() {
                values.entry(name).or_default().insert(all);
            }
        }
    }
    for (name, shown) in
        names.iter().filter(|(name, shown)| shown.len() > 1 && !SEVERAL_NAMES.contains(&name.as_str()))
    {
        problems.push(format!("--{name} has the forms {shown:?}"));
    }
    let may_differ = |name: &str| SEVERAL_SETS.iter().any(|(n, _)| *n == name);
    for (name, sets) in values.iter().filter(|(name, sets)| sets.len() > 1 && !may_differ(name)) {
        problems.push(format!("--{name} accepts {sets:?}"));
    }
    none(&problems);
    let expected =
        [('V', "version"), ('h', "help"), ('j', "threads"), ('o', "out"), ('q', "quiet"), ('v', "verbose")];
    let shorts: Vec<(char, &str)> = shorts.iter().map(|(short, name)| (*short, name.as_str())).collect();
    assert_eq!(shorts, expected, "the only short forms");
}

#[test]
fn names_are_lists_of_values_that_completions_know() {
    // Parts, animations and joints of a character are in its file, names of arrays in the file of the inputs.
    let free = ["hide", "animation", "elbow", "wrt"];
    let mut problems = Vec::new();
    for (path, command) in commands() {
        for argument in command.get_arguments().filter(|a| a.get_action().takes_values()) {
            let mut shown = argument.get_value_names().unwrap_or_default().iter();
            let is_name = shown.any(|n| ["NAME", "LIST"].contains(&n.as_str()));
            let is_free = free.contains(&argument.get_id().as_str());
            if is_name && !is_free && argument.get_possible_values().is_empty() {
                problems.push(format!("'{path}' {argument}: its values are not listed"));
            }
        }
    }
    none(&problems);
}
