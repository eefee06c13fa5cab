//! Inside a folder, too, arrows go one way: no two of its files need each other.

use super::ROOT;
use super::levels::MEMBERS;
use super::modules::Modules;
use std::path::Path;

/// A member of files written here.
fn member(files: &[(&str, &str)]) -> Modules {
    let mut modules = Modules::default();
    modules.add_member("demo", Path::new("lib.rs"), &|path| {
        files.iter().find(|(name, _)| Path::new(name) == path).map(|(_, text)| (*text).to_owned())
    });
    modules
}

#[test]
fn no_folder_holds_an_import_cycle() {
    let mut modules = Modules::default();
    for (name, ..) in MEMBERS {
        modules.read_member(Path::new(ROOT), name);
    }
    assert!(modules.all.len() > 300, "the walk found {} modules only", modules.all.len());
    let arrows = modules.inside_folders().values().fold(0, |n, a| n + a.len());
    assert!(arrows > 500, "the walk found {arrows} arrows only");
    let cycles = modules.cycles();
    assert!(cycles.is_empty(), "{} import cycles:\n{}", cycles.len(), cycles.join("\n"));
}

#[test]
fn every_import_names_what_it_takes() {
    let mut modules = Modules::default();
    for (name, ..) in MEMBERS {
        modules.read_member(Path::new(ROOT), name);
    }
    let globs = modules.globs();
    assert!(globs.is_empty(), "name what is imported:\n{}", globs.join("\n"));
}

#[test]
fn imports_of_everything_are_found() {
    let modules = member(&[
        ("lib.rs", "mod a; mod b; pub use crate::b::*; #[cfg(test)] mod trials;"),
        ("a.rs", "use super::*; use rayon::prelude::*; fn f() { use crate::b::Kind::*; B }"),
        ("b.rs", "use lastlight_num::num::*; #[cfg(test)] mod tests { use super::*; use crate::a::*; }"),
        ("trials.rs", "use super::*;"),
    ]);
    let expected = ["a.rs: super::*", "a.rs: crate::b::Kind::*", "b.rs: lastlight_num::num::*"];
    assert_eq!(modules.globs(), expected, "outside tests, of this library, no re-export of a folder");
    let hidden = member(&[
        ("lib.rs", "mod a; mod b; pub use a::A; pub use b::B;"),
        ("a.rs", "use super::*; fn f(_: B) {}"),
        ("b.rs", "use super::*; fn f(_: A) {}"),
    ]);
    assert!(hidden.cycles().is_empty() && hidden.globs().len() == 2, "a cycle that only this rule sees");
}

#[test]
fn a_cycle_is_found_and_printed() {
    let two = member(&[
        ("lib.rs", "mod a; mod b; mod c;"),
        ("a.rs", "use crate::b::B;"),
        ("b.rs", "fn f() { super::c::g() }"),
        ("c.rs", "use super::{a, b};"),
    ]);
    let cycles = two.cycles();
    assert_eq!(cycles.len(), 1, "{cycles:?}");
    for part in
        ["demo: ", "a -> b (a.rs: crate::b::B)", "b -> c (b.rs: super::c::g)", "c -> a (c.rs: super::a)"]
    {
        assert!(cycles[0].contains(part), "{part}: {}", cycles[0]);
    }
    let deep = member(&[
        ("lib.rs", "mod a;"),
        ("a.rs", "mod x; mod y;"),
        ("a/x.rs", "mod inner { use super::super::y; }"),
        ("a/y.rs", "use super::x;"),
    ]);
    assert_eq!(deep.cycles().len(), 1, "in a folder, through an inline module");
    let tested = member(&[
        ("lib.rs", "mod a; mod b;"),
        ("a.rs", "#[cfg(test)] mod tests { use crate::b; }"),
        ("b.rs", "use crate::a;"),
    ]);
    assert!(tested.cycles().is_empty(), "nothing depends on a test");
}

#[test]
fn a_folders_own_file_is_a_part_of_it() {
    let files = |root: &'static str, b: &'static str| {
        member(&[("lib.rs", root), ("a.rs", "use super::shared;"), ("b.rs", b)]).cycles()
    };
    let quiet = "mod a; mod b; pub use a::A; pub use b::B; pub fn shared() {}";
    assert!(files(quiet, "").is_empty(), "declarations and re-exports are no arrows");
    assert!(
        files(quiet, "use super::A;").is_empty(),
        "a re-exported name belongs to the file that defines it"
    );
    assert_eq!(files("mod a; mod b; use a::A; pub fn shared() {}", "").len(), 1, "an import of its own");
    assert_eq!(files("mod a; mod b; pub fn shared() { a::f() }", "").len(), 1, "a path in its code");
    assert_eq!(
        files("mod a; mod b; pub use a::A; pub fn shared(_: A) {}", "").len(),
        1,
        "a re-export that it uses"
    );
    let whole = member(&[
        ("lib.rs", "mod a; mod b; pub use b::*;"),
        ("a.rs", "use super::item;"),
        ("b.rs", "pub fn item() { super::a::f() }"),
    ]);
    assert_eq!(whole.cycles().len(), 1, "through a re-export of everything");
}

#[test]
fn a_file_and_its_folder_are_one_part() {
    let modules = member(&[
        ("lib.rs", "mod a; mod b;"),
        ("a.rs", "mod below;"),
        ("a/below.rs", "use crate::b::B; use super::Own; fn f() {}"),
        ("b/mod.rs", "mod below;"),
        ("b/below.rs", "pub use crate::a::A;"),
    ]);
    let cycles = modules.cycles();
    assert_eq!(cycles.len(), 1, "{cycles:?}");
    assert!(cycles[0].contains("a -> b (a/below.rs: crate::b::B)"), "{}", cycles[0]);
}
