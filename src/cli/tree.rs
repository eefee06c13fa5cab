//! The tree of commands as it is shown: headings, short options, and what `-h` leaves out.
//!
//! Commands declare their arguments in any order. [`refined`] gives every option the heading and the short form that it has everywhere
//! (see [`options`](crate::options)), sorts the headings, and shortens examples for `-h`.

use crate::choices;
use crate::like;
use crate::options::{self, Heading};
use clap::Command;

/// Examples that `-h` shows.
const FEW: usize = 2;

/// The commands below `root` in their shown form.
pub(crate) fn refined(root: Command) -> Command {
    below(root, "")
}

fn below(command: Command, path: &str) -> Command {
    let mut out = with_order(command, path);
    let names: Vec<String> = out.get_subcommands().map(|c| c.get_name().to_owned()).collect();
    for name in names {
        let path = format!("{path} {name}").trim_start().to_owned();
        out = out.mut_subcommand(name, |c| below(c, &path));
    }
    out
}

/// The command with its arguments in the order of their headings. clap lists headings in the order in which arguments are declared, and arguments
/// of a command cannot be reordered, so the command is built again.
fn with_order(command: Command, path: &str) -> Command {
    let mut arguments: Vec<clap::Arg> = command.get_arguments().cloned().collect();
    if options::RECORDED.contains(&path) {
        arguments.push(like());
    }
    arguments.sort_by_key(Heading::of);
    let shown = arguments.into_iter().map(|argument| {
        let heading = Heading::of(&argument).text(path);
        let rare = options::is_rare(&argument);
        let argument = numeric(argument.help_heading(heading).hide_short_help(rare));
        if argument.get_long() == Some("out") { argument.short('o') } else { argument }
    });
    // clap takes names that live as long as the program; the tree is made at most twice.
    let name: &'static str = command.get_name().to_owned().leak();
    let mut out = Command::new(name)
        .args(shown.collect::<Vec<_>>())
        .groups(command.get_groups().cloned().collect::<Vec<_>>())
        .subcommands(command.get_subcommands().cloned().collect::<Vec<_>>())
        .subcommand_required(command.is_subcommand_required_set())
        .arg_required_else_help(command.is_arg_required_else_help_set())
        .args_conflicts_with_subcommands(command.is_args_conflicts_with_subcommands_set())
        .subcommand_negates_reqs(command.is_subcommand_negates_reqs_set());
    if let Some(about) = command.get_about() {
        out = out.about(about.clone());
    }
    if let Some(about) = command.get_long_about() {
        out = out.long_about(about.clone());
    }
    if let Some(text) = command.get_after_help() {
        let text = text.to_string();
        out = out.after_help(shortened(&text)).after_long_help(text);
    }
    out
}

/// The argument with counts as [`choices::Count`] reads them. A negative number is a value, which its option accepts or refuses, and no option.
fn numeric(argument: clap::Arg) -> clap::Arg {
    if !argument.get_action().takes_values() {
        return argument;
    }
    let is_integer = argument.get_value_parser().type_id() == std::any::TypeId::of::<usize>();
    // Sizes of images and numbers of a list are integers too.
    let is_count = is_integer
        && argument.get_possible_values().is_empty()
        && argument.get_value_names().is_none_or(|names| names.iter().all(|name| name.as_str() != "S|WxH"));
    let argument = if argument.is_positional() { argument } else { argument.allow_negative_numbers(true) };
    if is_count { argument.value_parser(choices::Count) } else { argument }
}

/// The option of commands whose record can be run again.
fn like() -> clap::Arg {
    clap::Arg::new(like::NAME)
        .long(like::NAME)
        .value_name("FILE")
        .value_parser(clap::value_parser!(std::path::PathBuf))
        .help("Run a recorded run again: take all arguments that are not given from this result.json (or study.json, or the folder of a run), but for --out")
}

/// The first examples, and where the others are.
fn shortened(text: &str) -> String {
    let examples: Vec<&str> = text.lines().take_while(|line| !line.is_empty()).take(1 + FEW).collect();
    format!("{}\n\n--help prints all options and more.", examples.join("\n"))
}
