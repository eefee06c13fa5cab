//! What every command has: errors as JSON, colours, help topics, completions, versions, and runs from a record.

use crate::common::not_run;
use crate::program::{code, json, lastlight, refused, stderr, stdout};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

#[test]
fn errors_are_one_line_of_json() {
    let dir = tempfile::tempdir().expect("a folder");
    let kinds = [
        (&["convert", "none.ply", "out.splat", "--json"][..], "input", "none.ply"),
        (&["splat", "fit", "--json"], "usage", "required arguments"),
        (&["oracle", "show", "splat.rendr", "--json"], "usage", "splat.render"),
    ];
    for (args, kind, part) in kinds {
        refused(args, dir.path(), 2, &[part]);
        let text = stderr(&lastlight(args, dir.path()));
        let last: Value = serde_json::from_str(text.lines().last().expect("a line")).expect("JSON");
        assert_eq!(last["error"]["kind"], kind, "{args:?}: {text}");
    }
}

#[test]
fn colours_are_asked_for_or_absent() {
    let dir = tempfile::tempdir().expect("a folder");
    let escape = |args: &[&str]| stderr(&lastlight(args, dir.path())).contains('\u{1b}');
    assert!(!escape(&["convert", "a.ply", "b.ply"]), "no terminal, no colours");
    assert!(escape(&["convert", "a.ply", "b.ply", "--color", "always"]), "an error in colour");
    assert!(!escape(&["convert", "a.ply", "b.ply", "--color", "never"]), "an error without");
    assert!(escape(&["--color=always", "nonsense"]), "a usage error in colour");
}

#[test]
fn quiet_is_silent_and_verbose_tells_times() {
    let dir = tempfile::tempdir().expect("a folder");
    let run = |flag: &str| {
        let o = lastlight(&["oracle", "mint", "nn.linear", "-o", "g", "-j", "2", flag], dir.path());
        assert_eq!(code(&o), 0, "{}", stderr(&o));
        stderr(&o)
    };
    assert_eq!(run("-q"), "", "nothing beside the result");
    assert!(run("-v").contains("with 2 threads"), "threads and time");
    assert_eq!(code(&lastlight(&["doctor", "-q", "-v"], dir.path())), 2, "one or the other");
}

#[test]
fn help_has_topics_and_commands() {
    let dir = tempfile::tempdir().expect("a folder");
    for (topic, word) in
        [("captures", "transforms.json"), ("profiles", "gsplat"), ("exit-codes", "130"), ("env", "NO_COLOR")]
    {
        let text = stdout(&lastlight(&["help", topic], dir.path()));
        assert!(text.contains(word) && !text.contains("Usage:"), "{topic}: {text}");
    }
    let text = stdout(&lastlight(&["help", "splat", "fit"], dir.path()));
    assert!(text.contains("Usage: lastlight splat fit") && text.contains("--max-gaussians"), "{text}");
    let same = stdout(&lastlight(&["splat", "fit", "--help"], dir.path()));
    assert_eq!(text.trim_end(), same.trim_end(), "the same as --help");
    refused(&["help", "nonsense"], dir.path(), 2, &["captures", "splat", "nonsense"]);
    let short = stdout(&lastlight(&["splat", "fit", "-h"], dir.path()));
    assert!(short.lines().count() < text.lines().count() && !short.contains("--tile"), "-h is shorter");
}

#[test]
fn completions_and_manual_pages_are_generated() {
    let dir = tempfile::tempdir().expect("a folder");
    for (kind, word) in [
        ("bash", "complete"),
        ("zsh", "#compdef lastlight"),
        ("fish", "complete -c lastlight"),
        ("powershell", "Register-ArgumentCompleter"),
        ("man", ".TH lastlight 1"),
    ] {
        let text = stdout(&lastlight(&["generate", kind], dir.path()));
        assert!(text.contains(word), "{kind}: {}", &text[..text.len().min(300)]);
        if kind != "man" {
            assert!(text.contains("max-gaussians"), "{kind} knows the options");
        }
    }
    let written = stdout(&lastlight(&["generate", "man", "--out", "man"], dir.path()));
    let files = std::fs::read_dir(dir.path().join("man")).expect("pages").count();
    assert!(written.contains(&format!("{files} manual pages")) && written.contains(": man"), "{written}");
    let page =
        std::fs::read_to_string(dir.path().join("man/lastlight-splat-fit.1")).expect("a page per command");
    assert!(page.contains(".SH EXAMPLES\n.EX\n") && page.contains(".EE\n.SH NOTES\n"), "{page}");
    assert!(!page.contains("EXTRA"), "a heading that says something");
    // The text of an option that -h leaves out.
    assert!(page.contains("Side of a tile in pixels"), "{page}");
    let record = json(&["generate", "zsh", "--out", "zsh", "--json"], dir.path());
    assert_eq!(record["files"], serde_json::json!(["zsh/_lastlight"]), "what was written");
}

#[test]
fn versions_name_the_build() {
    let dir = tempfile::tempdir().expect("a folder");
    let plain = format!("lastlight {}\n", env!("CARGO_PKG_VERSION"));
    assert_eq!(stdout(&lastlight(&["--version"], dir.path())), plain, "one line");
    let text = stdout(&lastlight(&["-V", "--verbose"], dir.path()));
    for name in ["commit", "rustc", "processor", "lanes", "bit table"] {
        assert!(text.lines().any(|l| l.starts_with(name) && l.len() > 12), "{name}: {text}");
    }
    let record = json(&["--version", "--json"], dir.path());
    assert_eq!(record["bit_table"].as_str().map(str::len), Some(16), "{record}");
}

#[test]
fn next_steps_are_typed_as_the_program_was() {
    let dir = tempfile::tempdir().expect("a folder");
    let next = |cargo: Option<&str>| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lastlight"));
        command.env_remove("CARGO").env_remove("CARGO_PKG_NAME").current_dir(dir.path());
        if let Some(cargo) = cargo {
            command.env("CARGO", cargo).env("CARGO_PKG_NAME", "lastlight");
        }
        let o = command.args(["demo", "--only", "splat", "--iterations", "4"]).output().expect("starts");
        stdout(&o)
    };
    let path = env!("CARGO_BIN_EXE_lastlight");
    assert!(next(None).contains(&format!("  {path} splat render demo/scene --cameras")), "its path");
    assert!(next(Some("cargo")).contains(" -- splat render demo/scene --cameras"), "through cargo");
}

#[test]
fn a_recorded_run_is_run_again() {
    let dir = tempfile::tempdir().expect("a folder");
    let at = dir.path();
    let first = json(
        &["demo", "--only", "splat", "--iterations", "6", "--seed", "4", "--out", "a", "--json", "-q"],
        at,
    );
    let like = |more: &[&'static str]| {
        json(&[&["demo", "--like", "a/result.json", "--json", "-q"][..], more].concat(), at)["scene"].clone()
    };
    let again = like(&["--out", "b"]);
    assert_eq!(again["digest"], first["scene"]["digest"], "the same arguments, the same bits");
    let other = like(&["--out", "c", "--iterations", "3"]);
    assert_eq!(
        (&other["iterations"], &other["settings"]["seed"]),
        (&3.into(), &4.into()),
        "what is typed wins"
    );
    refused(&["splat", "fit", "--like", "a/result.json", "--out", "d"], at, 2, &["splat fit", "demo"]);
    refused(&["demo", "--like", "none.json"], at, 2, &["none.json"]);
}

/// The Python listings of a page, in order: a listing that begins with `# NAME.py` is written to that file, any other is run.
fn run_listings(page: &str, dir: &Path) -> usize {
    let binary = Path::new(env!("CARGO_BIN_EXE_lastlight")).parent().expect("a folder");
    let path = std::env::var("PATH").unwrap_or_default();
    let mut count = 0;
    for listing in page.split("```python\n").skip(1) {
        let listing = listing.split("```").next().unwrap_or_default();
        count += 1;
        let named =
            listing.lines().next().and_then(|l| l.strip_prefix("# ")).filter(|name| name.ends_with(".py"));
        let file = dir.join(named.unwrap_or("listing.py"));
        std::fs::write(&file, listing).expect("written");
        if named.is_some() {
            continue;
        }
        let o = Command::new("python3")
            .arg(&file)
            .current_dir(dir)
            .env("PATH", format!("{}:{path}", binary.display()))
            .output()
            .expect("python3 starts");
        assert_eq!(code(&o), 0, "{listing}\n{}", stderr(&o));
    }
    count
}

#[cfg(unix)]
#[test]
fn the_python_listings_of_readme_and_book_run() {
    let has_numpy =
        Command::new("python3").args(["-c", "import numpy"]).output().is_ok_and(|o| o.status.success());
    if !has_numpy {
        return not_run("python3 with numpy is not there: Python listings of README and book");
    }
    let dir = tempfile::tempdir().expect("a folder");
    let pages = [include_str!("../../README.md"), include_str!("../../src/book/oracle_and_gradcheck.md")];
    let count = pages.iter().fold(0, |n, page| n + run_listings(page, dir.path()));
    assert!(count >= 2, "{count} listings");
    let others = std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("src/book")).expect("the book");
    let all = others.filter_map(|e| std::fs::read_to_string(e.expect("an entry").path()).ok());
    let in_book = all.fold(0, |n, page| n + page.matches("```python\n").count());
    assert_eq!(in_book, pages[1].matches("```python\n").count(), "every listing of the book is run");
    let o = lastlight(&["gradcheck", "--exec", "python3 mine.py", "--in", "case.npz"], dir.path());
    assert_eq!(code(&o), 0, "the program of the book: {}{}", stdout(&o), stderr(&o));
}
