//! `generate`: shell completions and manual pages, from the tree of commands.

mod manual;

use crate::console as cli;
use crate::io::atomic;
use crate::{Error, Result};
use clap_complete::Shell;
use serde_json::json;
use std::path::PathBuf;

/// Generate shell completions or manual pages.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight generate bash > ~/.local/share/bash-completion/completions/lastlight
  lastlight generate zsh > ~/.zfunc/_lastlight
  lastlight generate fish > ~/.config/fish/completions/lastlight.fish
  lastlight generate powershell >> $PROFILE
  lastlight generate man > ~/.local/share/man/man1/lastlight.1
  lastlight generate man --out ~/.local/share/man/man1

Without --out the text goes to standard output; `man` then is the page of `lastlight` itself. With --out, `man` writes one page per command, and the completions are a file with the name that the shell expects; the files are printed.")]
pub(crate) struct Args {
    /// What to generate
    #[arg(value_enum, value_name = "KIND")]
    kind: Kind,
    /// Folder for the files [default: standard output]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// What can be generated.
#[derive(Clone, Copy, clap::ValueEnum)]
enum Kind {
    /// completions of bash
    Bash,
    /// completions of zsh
    Zsh,
    /// completions of fish
    Fish,
    /// completions of PowerShell
    Powershell,
    /// manual pages in roff
    Man,
}

impl Kind {
    fn shell(self) -> Option<Shell> {
        match self {
            Self::Bash => Some(Shell::Bash),
            Self::Zsh => Some(Shell::Zsh),
            Self::Fish => Some(Shell::Fish),
            Self::Powershell => Some(Shell::PowerShell),
            Self::Man => None,
        }
    }
}

/// Writes the text for the commands of `tree`.
///
/// # Errors
/// When a file or standard output cannot be written.
pub(crate) fn run(args: &Args, mut tree: clap::Command) -> Result<()> {
    let Some(dir) = &args.out else {
        let mut text = Vec::new();
        match args.kind.shell() {
            Some(shell) => clap_complete::generate(shell, &mut tree, "lastlight", &mut text),
            None => text = manual::page(tree).map_err(|e| Error::input("manual page").got(e.to_string()))?.1,
        }
        return cli::say(String::from_utf8_lossy(&text).trim_end());
    };
    std::fs::create_dir_all(dir).map_err(|e| Error::os(dir, &e))?;
    let failed = |e: std::io::Error| Error::os(dir, &e);
    let files = match args.kind.shell() {
        Some(shell) => {
            vec![clap_complete::generate_to(shell, &mut tree, "lastlight", dir).map_err(failed)?]
        }
        None => {
            let pages = manual::pages(tree).map_err(failed)?.into_iter();
            let write = |(name, text): (String, Vec<u8>)| {
                let path = dir.join(name);
                atomic::write_bytes(&path, &text).map(|()| path)
            };
            pages.map(write).collect::<Result<Vec<_>>>()?
        }
    };
    if cli::is_json() {
        return cli::say_json(&json!({ "files": files }));
    }
    match files.as_slice() {
        [file] => cli::say(&format!("written: {}", file.display())),
        all => cli::say(&format!("{} manual pages written, one per command: {}", all.len(), dir.display())),
    }
}
