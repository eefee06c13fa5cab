//! Valid files of every format, and the commands that read them.
//!
//! A base is a folder of small files. Some are damaged, one at a time; each of its commands reads all of them. They are written by the
//! library, by the program itself, or by the writers of the tests' miniatures.

mod models;
mod persons;
mod results;
mod scenes;

use crate::program::Program;
use crate::tree::{self, Tree};
use std::path::{Path, PathBuf};

/// Files that are read together.
#[derive(Clone, Debug)]
pub struct Base {
    /// the format: a row of the table
    pub format: &'static str,
    /// all files
    pub files: Tree,
    /// names of those that are damaged
    pub damaged: Vec<String>,
    /// commands; `{file}` is the name of the damaged file, `{op}` that name without folder, case and extension, `out` what a command writes
    pub commands: Vec<&'static str>,
    /// executions of this format among those of all formats
    pub share: u32,
    /// a run that is accepted must have the digest that it has with the valid file
    pub same_digest: bool,
    /// left out where the undamaged files are refused
    pub optional: bool,
}

impl Base {
    fn new(format: &'static str, files: Tree, damaged: &[&str], commands: &[&'static str]) -> Self {
        Self {
            format,
            files,
            damaged: damaged.iter().map(|n| (*n).to_owned()).collect(),
            commands: commands.to_vec(),
            share: 10,
            same_digest: false,
            optional: false,
        }
    }

    fn share(self, share: u32) -> Self {
        Self { share, ..self }
    }

    /// The words of a command.
    pub fn words(&self, command: usize, file: &str) -> Vec<String> {
        let stem = file.rsplit('/').next().unwrap_or(file);
        let op = stem.rsplit_once('_').map_or(stem, |(op, _)| op);
        let replace = |word: &str| word.replace("{file}", file).replace("{op}", op);
        self.commands[command].split(' ').map(replace).collect()
    }
}

/// Where bases are made: the program, and a folder.
pub struct Workshop<'a> {
    program: &'a Program,
    dir: PathBuf,
}

impl<'a> Workshop<'a> {
    /// In an existing folder.
    pub fn new(program: &'a Program, dir: &Path) -> Self {
        Self { program, dir: dir.to_path_buf() }
    }

    /// Runs a command that must succeed.
    ///
    /// # Panics
    /// When it does not.
    pub fn run(&self, line: &str) {
        let words: Vec<String> = line.split(' ').map(str::to_owned).collect();
        let e = self.program.run(&words, &self.dir).expect("the program starts");
        assert!(e.status.success(), "{line}: {}: {}", e.ended(), e.text());
    }

    /// Everything below one of its folders.
    ///
    /// # Panics
    /// When it cannot be read.
    pub fn tree(&self, folder: &str) -> Tree {
        tree::read(&self.dir.join(folder)).expect("readable")
    }

    /// The bytes of a file.
    ///
    /// # Panics
    /// When it cannot be read.
    pub fn bytes(&self, file: &str) -> Vec<u8> {
        std::fs::read(self.dir.join(file)).expect("readable")
    }
}

/// The files of a tree in a folder of that name.
fn below(folder: &str, files: &Tree) -> Tree {
    files.iter().map(|(name, bytes)| (format!("{folder}/{name}"), bytes.clone())).collect()
}

/// A tree of a few files.
fn files(list: &[(&str, &[u8])]) -> Tree {
    list.iter().map(|(name, bytes)| ((*name).to_owned(), bytes.to_vec())).collect()
}

/// All bases.
///
/// # Panics
/// When one cannot be made.
pub fn all(program: &Program, dir: &Path) -> Vec<Base> {
    let shop = Workshop::new(program, dir);
    let mut all = scenes::bases(&shop);
    all.extend(models::bases());
    all.extend(persons::bases(&shop));
    all.extend(results::bases(&shop));
    all
}
