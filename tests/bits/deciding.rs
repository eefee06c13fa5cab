//! What decides bits, as one hash; and the record of the last run of all cells.

use std::fs;
use std::path::Path;
use std::process::Command;

/// Folders with everything in them, and files, from the root.
const PLACES: [&str; 10] = [
    "src/num",
    "src/kernels",
    "src/train/optim",
    "src/train/tape",
    "src/train/Cargo.toml",
    "reference/src",
    "reference/Cargo.toml",
    "Cargo.lock",
    "rust-toolchain.toml",
    ".cargo/config.toml",
];

/// Beginnings of the sections of the root manifest that decide bits: profiles, versions and features of
/// dependencies.
const SECTIONS: [&str; 4] = ["profile", "workspace.dependencies", "patch", "replace"];

/// Standard output of a program that succeeds.
pub(crate) fn output(program: &str, arguments: &[&str], dir: &Path) -> Result<Vec<u8>, String> {
    let call = || format!("{program} {}", arguments.join(" "));
    match Command::new(program).args(arguments).current_dir(dir).output() {
        Ok(o) if o.status.success() => Ok(o.stdout),
        Ok(o) => Err(format!("{}: {}", call(), String::from_utf8_lossy(&o.stderr).trim())),
        Err(e) => Err(format!("{}: {e}", call())),
    }
}

/// FNV-1a.
struct Hash(u64);

impl Hash {
    /// Adds bytes and their number.
    fn take(&mut self, bytes: &[u8]) {
        for byte in bytes.iter().chain(&(bytes.len() as u64).to_le_bytes()) {
            self.0 = (self.0 ^ u64::from(*byte)).wrapping_mul(0x100_0000_01b3);
        }
    }
}

/// Files below a place that git does not ignore, sorted.
fn files(root: &Path, place: &str) -> Result<Vec<String>, String> {
    let listed = output("git", &["ls-files", "-co", "--exclude-standard", "-z", "--", place], root)?;
    let mut names = Vec::new();
    for name in listed.split(|byte| *byte == 0).filter(|name| !name.is_empty()) {
        names.push(String::from_utf8(name.to_vec()).map_err(|e| format!("{place}: {e}"))?);
    }
    names.sort();
    names.dedup();
    if names.is_empty() { Err(format!("{place}: no such files")) } else { Ok(names) }
}

/// The hash of everything that decides bits below `root`: names and bytes of files, sections of the root
/// manifest, and what `compiler` prints.
pub(crate) fn deciding(root: &Path, compiler: &str) -> Result<String, String> {
    let read = |name: &str| fs::read(root.join(name)).map_err(|e| format!("{name}: {e}"));
    let mut hash = Hash(0xcbf2_9ce4_8422_2325);
    for place in PLACES {
        for name in files(root, place)? {
            hash.take(name.as_bytes());
            hash.take(&read(&name)?);
        }
    }
    let manifest = String::from_utf8(read("Cargo.toml")?).map_err(|e| format!("Cargo.toml: {e}"))?;
    let mut is_deciding = false;
    for line in manifest.lines().map(str::trim_end) {
        if let Some(header) = line.strip_prefix('[') {
            let header = header.trim_start_matches('[');
            let is_of =
                |section: &str| header.strip_prefix(section).is_some_and(|rest| rest.starts_with(['.', ']']));
            is_deciding = SECTIONS.iter().any(|section| is_of(section));
        }
        if is_deciding && !line.is_empty() {
            hash.take(line.as_bytes());
        }
    }
    if compiler.is_empty() {
        return Err("rustc -vV prints nothing".to_owned());
    }
    hash.take(compiler.as_bytes());
    Ok(format!("{:016x}", hash.0))
}

/// What a record names beside its cells.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Head {
    /// the commit; `dirty` where files differ from it
    pub(crate) commit: String,
    pub(crate) toolchain: String,
    pub(crate) flags: String,
    pub(crate) processor: String,
    /// of what decides bits
    pub(crate) hash: String,
}

impl Head {
    /// That of a run which began with this one and ended with `after`: `None` where what decides bits changed meanwhile;
    /// the commit is `dirty` where it is another one.
    pub(crate) fn until(&self, after: &Self) -> Option<Self> {
        let commit = if self.commit == after.commit { &self.commit } else { "dirty" }.to_owned();
        let is_same = *self == Self { commit: self.commit.clone(), ..after.clone() };
        is_same.then(|| Self { commit, ..self.clone() })
    }
}

/// The commit that is checked out, `dirty` where the tree differs from it; the record itself may.
pub(crate) fn commit(root: &Path, record: &str) -> Result<String, String> {
    let except = format!(":(exclude){record}");
    let changed = output("git", &["status", "--porcelain", "--", ".", &except], root)?;
    if !changed.is_empty() {
        return Ok("dirty".to_owned());
    }
    let commit = output("git", &["rev-parse", "HEAD"], root)?;
    Ok(String::from_utf8_lossy(&commit).trim().to_owned())
}

/// A record as text.
pub(crate) fn print(head: &Head, cells: &[&str]) -> String {
    let cells: String = cells.iter().map(|cell| format!("    \"{cell}\",\n")).collect();
    let Head { commit, toolchain, flags, processor, hash } = head;
    format!(
        "# The last run of all cells of the bit matrix, written by `cargo bits --all`. `cargo bits --gate` runs all cells when `hash` is another one:\n\
         # that of {},\n# of the sections {} of Cargo.toml, and of `rustc -vV`.\n\
         commit = \"{commit}\"\ntoolchain = \"{toolchain}\"\nflags = \"{flags}\"\nprocessor = \"{processor}\"\nhash = \"{hash}\"\ncells = [\n{cells}]\n",
        PLACES.join(", "),
        SECTIONS.join(", ")
    )
}

/// Whether a record is of this hash and has all these cells.
pub(crate) fn is_of(record: &str, hash: &str, cells: &[&str]) -> bool {
    let has = |line: &str| record.lines().any(|l| l == line);
    has(&format!("hash = \"{hash}\"")) && cells.iter().all(|cell| has(&format!("    \"{cell}\",")))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A repository with one file in every place.
    struct Tree(tempfile::TempDir);

    impl Tree {
        fn new() -> Self {
            let tree = Self(tempfile::tempdir().expect("a folder"));
            for place in PLACES {
                let is_file = place.ends_with(".toml") || place.ends_with(".lock");
                tree.write(&if is_file { place.to_owned() } else { format!("{place}/a.rs") }, place);
            }
            tree.write(".gitignore", "*.swp\n");
            tree.write(
                "Cargo.toml",
                "[workspace]\nmembers = []\n\n[workspace.dependencies]\nwide = \"=1\"\n\n[package]\nname = \"x\"\n\n[profile.release]\nopt-level = 3\n",
            );
            output("git", &["init", "-q"], tree.0.path()).expect("a repository");
            tree
        }

        fn write(&self, name: &str, text: &str) {
            let file = self.0.path().join(name);
            fs::create_dir_all(file.parent().expect("a folder")).expect("made");
            fs::write(file, text).expect("written");
        }

        fn edit(&self, name: &str, from: &str, to: &str) {
            let text = fs::read_to_string(self.0.path().join(name)).expect("there");
            assert!(text.contains(from), "{name} has {from}");
            self.write(name, &text.replace(from, to));
        }

        fn remove(&self, name: &str) {
            fs::remove_file(self.0.path().join(name)).expect("removed");
        }

        fn hash(&self) -> Result<String, String> {
            deciding(self.0.path(), "rustc 1")
        }

        fn git(&self, arguments: &[&str]) {
            let who = ["-c", "user.name=a", "-c", "user.email=a@b", "-c", "commit.gpgsign=false"];
            output("git", &[&who, arguments].concat(), self.0.path()).expect("git");
        }
    }

    #[test]
    fn everything_that_decides_changes_the_hash() {
        let tree = Tree::new();
        let first = tree.hash().expect("a hash");
        assert_eq!(first.len(), 16, "64 bits");
        let moved = |what: &str, change: &dyn Fn(), back: &dyn Fn()| {
            change();
            assert_ne!(tree.hash().expect("a hash"), first, "{what}");
            back();
            assert_eq!(tree.hash().expect("a hash"), first, "back from {what}");
        };
        for place in PLACES {
            let is_file = place.ends_with(".toml") || place.ends_with(".lock");
            let name = if is_file { place.to_owned() } else { format!("{place}/a.rs") };
            moved(&name, &|| tree.write(&name, "x"), &|| tree.write(&name, place));
        }
        moved("a new file", &|| tree.write("src/num/sub/b.rs", ""), &|| tree.remove("src/num/sub/b.rs"));
        moved(
            "another name",
            &|| (tree.write("src/num/b.rs", "src/num"), tree.remove("src/num/a.rs")).0,
            &|| (tree.write("src/num/a.rs", "src/num"), tree.remove("src/num/b.rs")).0,
        );
        let edit = |from: &'static str, to: &'static str| {
            moved(from, &|| tree.edit("Cargo.toml", from, to), &|| tree.edit("Cargo.toml", to, from));
        };
        edit("wide = \"=1\"", "wide = { version = \"=1\", features = [\"std\"] }");
        edit("opt-level = 3", "opt-level = 2");
        edit("[profile.release]", "[profile.dev]");
        assert_ne!(deciding(tree.0.path(), "rustc 2").expect("a hash"), first, "another compiler");
    }

    #[test]
    fn what_does_not_decide_changes_nothing_and_what_cannot_be_read_is_an_error() {
        let tree = Tree::new();
        let first = tree.hash();
        tree.write("src/cli/a.rs", "x");
        tree.write("src/num/.a.rs.swp", "x");
        tree.edit("Cargo.toml", "name = \"x\"", "name = \"y\"");
        assert_eq!(tree.hash(), first, "other folders, ignored files, other sections");
        tree.git(&["add", "."]);
        assert_eq!(tree.hash(), first, "known to git or not");
        assert!(deciding(tree.0.path(), "").is_err(), "no compiler");
        tree.remove("src/num/a.rs");
        assert!(tree.hash().is_err_and(|e| e.contains("src/num/a.rs")), "a listed file that is not there");
        tree.git(&["rm", "-q", "--cached", "src/num/a.rs"]);
        assert!(tree.hash().is_err_and(|e| e.contains("src/num: no such")), "a place without files");
        tree.write("src/num/a.rs", "src/num");
        assert_eq!(tree.hash(), first, "it is there again");
        fs::remove_dir_all(tree.0.path().join(".git")).expect("removed");
        assert!(tree.hash().is_err(), "no repository");
    }

    #[test]
    fn a_changed_tree_has_no_commit() {
        let tree = Tree::new();
        let now = || commit(tree.0.path(), "tests/bits-full.toml");
        tree.git(&["add", "."]);
        tree.git(&["commit", "-qm", "all"]);
        let clean = now().expect("a commit");
        assert!(clean.len() == 40 && clean.chars().all(|c| c.is_ascii_hexdigit()), "{clean}");
        tree.write("tests/bits-full.toml", "");
        assert_eq!(now().expect("a commit"), clean, "the record is no part of it");
        tree.write("src/cli/new.rs", "");
        assert_eq!(now().expect("a repository"), "dirty", "a new file");
        tree.remove("src/cli/new.rs");
        tree.edit("Cargo.toml", "name = \"x\"", "name = \"y\"");
        assert_eq!(now().expect("a repository"), "dirty", "a changed one");
    }

    #[test]
    fn a_record_is_of_its_hash_and_its_cells_and_of_one_run() {
        let text = |part: &str| part.to_owned();
        let head = Head {
            commit: text("c0"),
            toolchain: text("rustc 1"),
            flags: text("-C x"),
            processor: text("P"),
            hash: text("00ff"),
        };
        assert_eq!(head.until(&head), Some(head.clone()), "nothing changed");
        let moved = Head { commit: text("c1"), ..head.clone() };
        let dirty = Head { commit: text("dirty"), ..head.clone() };
        assert_eq!(head.until(&moved), Some(dirty), "another commit that decides the same");
        assert_eq!(head.until(&Head { hash: text("00fe"), ..head.clone() }), None, "another hash");
        let record = print(&head, &["a, 8 lanes", "b"]);
        assert!(record.contains("\ncommit = \"c0\"\ntoolchain = \"rustc 1\"\n"), "{record}");
        assert!(is_of(&record, "00ff", &["b", "a, 8 lanes"]), "what was recorded");
        assert!(is_of(&record, "00ff", &["b"]), "a machine with fewer cells");
        assert!(!is_of(&record, "00fe", &["b"]), "another hash");
        assert!(!is_of(&record, "00ff", &["b", "c"]), "a cell that was not run");
        assert!(!is_of(&record, "00ff", &["a"]), "a part of a name");
        assert!(!is_of("", "", &[]), "no record");
    }
}
