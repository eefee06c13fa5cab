//! `--like FILE`: runs a recorded run again, with the arguments in its record.
//!
//! Records of commands that train hold the arguments of the run. What is typed beside `--like` takes precedence; where results go, and what
//! changes none, is never taken from the record.
//!
//! `--resume` does the same with the record in the folder of `--out`, but refuses options that differ.

use clap::parser::ValueSource;
use clap::{Arg, ArgMatches, Command};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

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

/// Arguments that a resumed run may have otherwise: places of files, whose contents the checkpoint checks, when checkpoints are written, how far it goes, what is made of
/// its steps, and what changes no bit.
const MOVABLE: [&str; 6] = ["allow-outside", "checkpoint-every", "chunk", "images", "start-share", "until"];

/// The files of a folder from which `--resume` takes arguments: that which a run writes when it starts, else its record.
pub(crate) const COMMAND: &str = "command.json";
const RESULT: &str = "result.json";

/// The command line in full: with `--like`, the recorded arguments and those that are typed; with `--resume`, those of the run in the folder;
/// else as it is.
///
/// # Errors
/// When the file is no record of the same command, one of the command lines is not valid, or a run is resumed with other options.
pub(crate) fn expanded(arguments: &[OsString], tree: &Command) -> Result<Vec<OsString>, clap::Error> {
    let has = |option: &str| {
        arguments.iter().any(|a| a == option || a.to_string_lossy().starts_with(&format!("{option}=")))
    };
    let unchanged = || Ok(arguments.to_vec());
    if !has("--like") && !has("--resume") {
        return unchanged();
    }
    let strict = tree;
    let mut tree = relaxed(tree.clone());
    let matches = match tree.try_get_matches_from_mut(arguments) {
        Ok(matches) => matches,
        Err(e) if has("--like") => return Err(e),
        Err(_) => return unchanged(), // the parser reports it with the arguments that are required
    };
    let (path, typed) = leaf(&matches);
    let wrong = |message: String| usage_error(&tree, &path, message);
    let Some(command) = path.iter().try_fold(&tree, |command, name| command.find_subcommand(name)) else {
        return unchanged();
    };
    let within = |dir: &Path, names: [&str; 2]| names.map(|n| dir.join(n)).into_iter().find(|f| f.is_file());
    let like = typed.try_get_one::<PathBuf>(NAME).ok().flatten();
    let like = like.map(|file| within(file, [RESULT, COMMAND]).unwrap_or_else(|| file.clone()));
    let folder = folder_of_resumed(typed);
    let resumed = folder.as_deref().and_then(|dir| within(dir, [COMMAND, RESULT]));
    let is_resumed = like.is_none();
    let Some(file) = like.or(resumed) else {
        return match folder.filter(|_| lacks_required(strict, &path, typed)) {
            Some(dir) => Err(wrong(nothing_to_resume(&dir, &path))),
            None => unchanged(),
        };
    };
    let words = match recorded(&file) {
        Ok(words) => words,
        Err(_) if is_resumed => return unchanged(), // a folder of a command that does not record its arguments
        Err(e) => return Err(wrong(e)),
    };
    let program = arguments.first().cloned().unwrap_or_default();
    let full: Vec<OsString> =
        std::iter::once(program.clone()).chain(words.iter().map(OsString::from)).collect();
    let earlier = tree.clone().try_get_matches_from_mut(full)?;
    let (recorded_path, earlier) = leaf(&earlier);
    if recorded_path != path && is_resumed {
        return unchanged(); // the checkpoint is refused as that of another command
    }
    if recorded_path != path {
        let (of, now, file) = (recorded_path.join(" "), path.join(" "), file.display());
        return Err(wrong(format!(
            "{file}: expected a record of {now}, got one of {of}; `lastlight {of} --like {file}` runs that again"
        )));
    }
    if is_resumed {
        same_options(command, typed, earlier, &file, &path).map_err(wrong)?;
    }
    let given = |argument: &Arg| {
        let name = long_name(argument);
        match (is_given(typed, argument), is_given(earlier, argument)) {
            (true, _) if name != NAME => Some(typed),
            (false, true) if !NOT_TAKEN.contains(&name) => Some(earlier),
            _ => None,
        }
    };
    for argument in command.get_arguments() {
        if given(argument).is_some_and(|from| std::ptr::eq(from, earlier))
            && let Some(value) = missing_path(argument, earlier)
        {
            let (value, file) = (value.display(), file.display());
            return Err(wrong(format!(
                "{value}: no such file or folder; the path comes from the record {file} and is relative to the current folder: run the \
                 command where the recorded run was started, or type the path beside it"
            )));
        }
    }
    Ok(std::iter::once(program).chain(words_of(command, &path, given)).collect())
}

/// The value of an argument that is a relative path to something that is not there.
fn missing_path(argument: &Arg, matches: &ArgMatches) -> Option<PathBuf> {
    let is_path =
        argument.get_value_names().is_some_and(|names| names.iter().all(|n| n == "DIR" || n == "FILE"));
    let mut values = matches.get_raw(argument.get_id().as_str()).into_iter().flatten().map(PathBuf::from);
    values.find(|path| is_path && path.is_relative() && !path.exists())
}

/// Whether an argument that the command at `path` of the tree requires is missing.
fn lacks_required(tree: &Command, path: &[String], typed: &ArgMatches) -> bool {
    let command = path.iter().try_fold(tree, |command, name| command.find_subcommand(name));
    command.is_some_and(|c| c.get_arguments().any(|a| a.is_required_set() && !is_given(typed, a)))
}

/// That a folder holds no run that could be continued without its arguments.
fn nothing_to_resume(dir: &Path, path: &[String]) -> String {
    let what = if !dir.exists() {
        "no such folder".to_owned()
    } else if crate::io::atomic::is_unused(dir).unwrap_or(false) {
        "the folder is empty".to_owned()
    } else {
        format!("there is no {COMMAND} in it")
    };
    format!(
        "--resume: {} holds no interrupted run: {what}; `lastlight help {}` shows how one is started",
        dir.display(),
        path.join(" ")
    )
}

/// The arguments without those that [`NOT_TAKEN`] lists: what a run keeps of them, so that it can be resumed.
pub(crate) fn kept(arguments: &[String], tree: &Command) -> Vec<String> {
    let mut tree = relaxed(tree.clone());
    let all = std::iter::once("lastlight").chain(arguments.iter().map(String::as_str));
    let Ok(matches) = tree.try_get_matches_from_mut(all) else { return arguments.to_vec() };
    let (path, own) = leaf(&matches);
    let Some(command) = path.iter().try_fold(&tree, |command, name| command.find_subcommand(name)) else {
        return arguments.to_vec();
    };
    let given = |argument: &Arg| {
        (is_given(own, argument) && !NOT_TAKEN.contains(&long_name(argument))).then_some(own)
    };
    words_of(command, &path, given).into_iter().map(|w| w.to_string_lossy().into_owned()).collect()
}

/// A command line: the names of the command, its options, its positional arguments, each from the matches that `given` chooses.
fn words_of<'a>(
    command: &Command,
    path: &[String],
    given: impl Fn(&Arg) -> Option<&'a ArgMatches>,
) -> Vec<OsString> {
    let (mut options, mut positional) = (Vec::new(), Vec::new());
    for argument in command.get_arguments() {
        let Some(from) = given(argument) else { continue };
        let name = long_name(argument);
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
    let path = path.iter().map(OsString::from);
    let end = (!positional.is_empty()).then(|| OsString::from("--"));
    path.chain(options).chain(end).chain(positional).collect()
}

/// The folder of a run that is resumed.
fn folder_of_resumed(typed: &ArgMatches) -> Option<PathBuf> {
    let is_resumed = typed.try_get_one::<bool>("resume").ok().flatten() == Some(&true);
    typed.try_get_one::<PathBuf>("out").ok().flatten().filter(|_| is_resumed).cloned()
}

/// Checks that no option is typed that the run in the folder was started without, or with another value.
fn same_options(
    command: &Command,
    typed: &ArgMatches,
    earlier: &ArgMatches,
    file: &Path,
    path: &[String],
) -> Result<(), String> {
    let shown = |matches: &ArgMatches, argument: &Arg| {
        let raw = matches.get_raw(argument.get_id().as_str()).into_iter().flatten();
        raw.map(|value| value.to_string_lossy().into_owned()).collect::<Vec<_>>().join(",")
    };
    let number = |text: &str| text.parse::<f64>().ok();
    let mut differences = Vec::new();
    let mut options = String::new();
    for argument in command.get_arguments() {
        let name = long_name(argument);
        let is_free = argument.is_positional() || NOT_TAKEN.contains(&name) || MOVABLE.contains(&name);
        if is_free || !is_given(typed, argument) {
            continue;
        }
        let (now, then) = (shown(typed, argument), shown(earlier, argument));
        if now == then || number(&now).is_some() && number(&now) == number(&then) {
            continue;
        }
        if argument.get_action().takes_values() {
            let then = if then.is_empty() { "none".to_owned() } else { then };
            differences.push(format!("--{name} {now} (there: {then})"));
            options += &format!(" --{name} {now}");
        } else {
            differences.push(format!("--{name} (not given there)"));
            options += &format!(" --{name}");
        }
    }
    if differences.is_empty() {
        return Ok(());
    }
    let (file, path) = (file.display(), path.join(" "));
    Err(format!(
        "--resume: expected the options of the run in the folder, which need not be typed again, got {}; \
         leave them out to continue that run, or start another one: lastlight {path} --like {file}{options} --out DIR",
        differences.join(", ")
    ))
}

fn long_name(argument: &Arg) -> &str {
    argument.get_long().unwrap_or_else(|| argument.get_id().as_str())
}

/// An error with the usage of the command at `path`.
fn usage_error(tree: &Command, path: &[String], message: String) -> clap::Error {
    let mut tree = tree.clone();
    tree.build();
    let mut at = &mut tree;
    for name in path {
        match at.find_subcommand_mut(name) {
            Some(_) => at = at.find_subcommand_mut(name).expect("found"),
            None => break,
        }
    }
    at.error(clap::error::ErrorKind::ValueValidation, message)
}

/// The arguments in a record.
fn recorded(file: &Path) -> Result<Vec<String>, String> {
    let what = file.display();
    let no_record = || {
        format!("{what}: expected a record with the arguments of its run, such as the result.json of a fit")
    };
    if file.is_dir() {
        return Err(format!("{}, got a folder", no_record()));
    }
    let bytes = std::fs::read(file).map_err(|e| crate::Error::os(file, &e).to_string())?;
    let record: serde_json::Value = serde_json::from_slice(&bytes)
        .map_err(|_| format!("{}, got a file that is not JSON", no_record()))?;
    serde_json::from_value(record[ARGUMENTS].clone()).map_err(|_| no_record())
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
            Arg::new("out").long("out").required(true).value_parser(clap::value_parser!(PathBuf)),
            Arg::new("seed").long("seed"),
            Arg::new("hide").long("hide").value_delimiter(',').action(ArgAction::Append),
            Arg::new("strict").long("strict").action(ArgAction::SetTrue),
            Arg::new("resume").long("resume").action(ArgAction::SetTrue),
            Arg::new(NAME).long(NAME).value_parser(clap::value_parser!(PathBuf)),
        ]);
        Command::new("lastlight").subcommand(Command::new("splat").subcommands([fit, Command::new("eval")]))
    }

    #[test]
    fn a_resumed_run_has_the_options_of_its_folder() {
        let dir = tempfile::tempdir().expect("a folder");
        let out = dir.path().join("a");
        std::fs::create_dir(&out).expect("made");
        let of = |words: &[&str]| {
            let out = out.to_string_lossy().into_owned();
            let typed = ["p", "splat", "fit", "--resume", "--out", &out];
            let all: Vec<OsString> = typed.iter().chain(words).map(OsString::from).collect();
            let full = expanded(&all, &tree()).map_err(|e| e.to_string())?;
            let words = full.into_iter().map(|w| w.into_string().expect("text").replace(&out, "OUT"));
            Ok::<_, String>(words.collect::<Vec<_>>().join(" "))
        };
        assert_eq!(of(&["photos"]).as_deref(), Ok("p splat fit --resume --out OUT photos"), "no record");
        let old =
            ["splat", "fit", "photos", "--out", "elsewhere", "--seed", "3", "--strict"].map(str::to_owned);
        let kept = kept(&old, &tree());
        assert_eq!(kept.join(" "), "splat fit --seed=3 --strict -- photos", "without the folder");
        std::fs::write(out.join(COMMAND), serde_json::json!({ ARGUMENTS: kept }).to_string())
            .expect("written");
        let full = "p splat fit --out=OUT --seed=3 --strict --resume -- photos";
        assert_eq!(of(&[]).as_deref(), Ok(full), "nothing is typed again");
        assert_eq!(of(&["photos", "--seed", "3.0"]).as_deref(), Ok(&*full.replace("=3", "=3.0")), "the same");
        assert_eq!(of(&["moved"]).as_deref(), Ok(&*full.replace("photos", "moved")), "another place");
        let e = of(&["--seed", "4", "--hide", "x"]).expect_err("others");
        for part in ["--seed 4 (there: 3)", "--hide x (there: none)", "--like", COMMAND, "--seed 4 --hide x"]
        {
            assert!(e.contains(part), "'{part}' in {e}");
        }
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
