//! `--like FILE`: runs a recorded run again, with the arguments in its record.
//!
//! Records of commands that train hold the arguments of the run. What is typed beside `--like` takes precedence; where results go, and what
//! changes none, is never taken from the record.

use clap::parser::ValueSource;
use clap::{Arg, ArgMatches, Command};
use std::ffi::OsString;
use std::path::Path;

/// The name of the option.
pub(crate) const NAME: &str = "like";

/// The key of the arguments in a record.
pub(crate) const ARGUMENTS: &str = "arguments";

/// Arguments that are not taken from a record.
const NOT_TAKEN: [&str; 13] = [
    "color",
    "force",
    "help",
    "jobs",
    "json",
    "like",
    "max-memory",
    "out",
    "quiet",
    "resume",
    "threads",
    "verbose",
    "version",
];

/// The command line in full: with `--like`, the recorded arguments and those that are typed; else as it is.
///
/// # Errors
/// When the file is no record of the same command, or one of the command lines is not valid.
pub(crate) fn expanded(arguments: &[OsString], tree: &Command) -> Result<Vec<OsString>, clap::Error> {
    if !arguments.iter().any(|a| a == "--like" || a.to_string_lossy().starts_with("--like=")) {
        return Ok(arguments.to_vec());
    }
    let mut tree = relaxed(tree.clone());
    let typed = tree.try_get_matches_from_mut(arguments)?;
    let (path, typed) = leaf(&typed);
    let wrong = |message: String| tree.clone().error(clap::error::ErrorKind::ValueValidation, message);
    let Ok(Some(file)) = typed.try_get_one::<std::path::PathBuf>(NAME) else { return Ok(arguments.to_vec()) };
    let words = recorded(file).map_err(wrong)?;
    let program = arguments.first().cloned().unwrap_or_default();
    let full: Vec<OsString> =
        std::iter::once(program.clone()).chain(words.iter().map(OsString::from)).collect();
    let earlier = tree.clone().try_get_matches_from_mut(full)?;
    let (recorded_path, earlier) = leaf(&earlier);
    if recorded_path != path {
        let (of, now) = (recorded_path.join(" "), path.join(" "));
        return Err(wrong(format!("{}: expected a record of {now}, got one of {of}", file.display())));
    }
    let Some(command) = path.iter().try_fold(&tree, |command, name| command.find_subcommand(name)) else {
        return Ok(arguments.to_vec());
    };
    let (mut options, mut positional) = (Vec::new(), Vec::new());
    for argument in command.get_arguments() {
        let name = argument.get_long().unwrap_or_else(|| argument.get_id().as_str());
        let from = match (is_given(typed, argument), is_given(earlier, argument)) {
            (true, _) if name != NAME => typed,
            (false, true) if !NOT_TAKEN.contains(&name) => earlier,
            _ => continue,
        };
        let values = || from.get_raw(argument.get_id().as_str()).into_iter().flatten();
        if argument.is_positional() {
            positional.extend(values().map(OsString::from));
        } else if argument.get_action().takes_values() {
            options.extend(values().map(|value| {
                let mut word = OsString::from(format!("--{name}="));
                word.push(value);
                word
            }));
        } else {
            options.push(OsString::from(format!("--{name}")));
        }
    }
    let path = path.into_iter().map(OsString::from);
    let end = (!positional.is_empty()).then(|| OsString::from("--"));
    Ok(std::iter::once(program).chain(path).chain(options).chain(end).chain(positional).collect())
}

/// The arguments in a record.
fn recorded(file: &Path) -> Result<Vec<String>, String> {
    let what = file.display();
    let text = std::fs::read_to_string(file).map_err(|e| format!("{what}: {e}"))?;
    let record: serde_json::Value = serde_json::from_str(&text).map_err(|e| format!("{what}: {e}"))?;
    serde_json::from_value(record[ARGUMENTS].clone()).map_err(|_| {
        format!("{what}: expected a record with the arguments of its run, such as a result.json")
    })
}

/// The tree without required arguments: a part of a command line is valid.
fn relaxed(command: Command) -> Command {
    let names: Vec<String> = command.get_subcommands().map(|c| c.get_name().to_owned()).collect();
    let mut out = command.mut_args(|argument| argument.required(false));
    for name in names {
        out = out.mut_subcommand(name, relaxed);
    }
    out
}

/// The names of the chosen commands, and the matches of the last.
fn leaf(matches: &ArgMatches) -> (Vec<String>, &ArgMatches) {
    let (mut path, mut at) = (Vec::new(), matches);
    while let Some((name, below)) = at.subcommand() {
        path.push(name.to_owned());
        at = below;
    }
    (path, at)
}

fn is_given(matches: &ArgMatches, argument: &Arg) -> bool {
    let id = argument.get_id().as_str();
    matches.try_contains_id(id).is_ok() && matches.value_source(id) == Some(ValueSource::CommandLine)
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::ArgAction;

    fn tree() -> Command {
        let fit = Command::new("fit").args([
            Arg::new("dir").required(true),
            Arg::new("out").long("out").required(true),
            Arg::new("seed").long("seed"),
            Arg::new("hide").long("hide").value_delimiter(',').action(ArgAction::Append),
            Arg::new("strict").long("strict").action(ArgAction::SetTrue),
            Arg::new("resume").long("resume").action(ArgAction::SetTrue),
            Arg::new(NAME).long(NAME).value_parser(clap::value_parser!(std::path::PathBuf)),
        ]);
        Command::new("lastlight").subcommand(Command::new("splat").subcommands([fit, Command::new("eval")]))
    }

    #[test]
    fn typed_arguments_take_precedence_and_outputs_are_not_taken() {
        let dir = tempfile::tempdir().expect("a folder");
        let file = dir.path().join("result.json");
        let old =
            ["splat", "fit", "photos", "--out", "a", "--seed", "3", "--hide", "x,y", "--strict", "--resume"];
        std::fs::write(&file, serde_json::json!({ "arguments": old }).to_string()).expect("written");
        let of = |words: &[&str]| {
            let like = file.to_string_lossy().into_owned();
            let words: Vec<OsString> =
                words.iter().map(|w| OsString::from(if *w == "LIKE" { &like } else { *w })).collect();
            let full = expanded(&words, &tree()).map_err(|e| e.to_string())?;
            Ok::<_, String>(
                full.into_iter().map(|w| w.into_string().expect("text")).collect::<Vec<_>>().join(" "),
            )
        };
        let full = of(&["p", "splat", "fit", "--like", "LIKE", "--out", "b", "--seed", "4"]);
        assert_eq!(
            full.as_deref(),
            Ok("p splat fit --out=b --seed=4 --hide=x --hide=y --strict -- photos"),
            "both"
        );
        assert_eq!(
            of(&["p", "splat", "fit", "d", "--out", "b"]).as_deref(),
            Ok("p splat fit d --out b"),
            "unchanged"
        );
        assert!(of(&["p", "splat", "eval", "--like", "LIKE"]).is_err(), "a command without the option");
        std::fs::write(&file, "{}").expect("written");
        let e = of(&["p", "splat", "fit", "--like", "LIKE"]).expect_err("no arguments");
        assert!(e.contains("a record with the arguments of its run"), "{e}");
    }
}
