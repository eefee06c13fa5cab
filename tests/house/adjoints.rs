//! Every hand-derived adjoint that a system runs is one that the operator list runs: read off the sources.
//!
//! Three rules:
//!
//! * in the folders of operators, every function that is named as an adjoint is reached from an entry of
//!   `LIST` in `src/oracle/ops.rs`;
//! * elsewhere, no function is named as an adjoint, and
//! * no function computes with cotangents (`arithmetic.rs`).
//!
//! Exceptions are listed here, each with its reason; one that is no longer needed fails, too.
//!
//! A function is reached by a path of two segments or more, called or handed over, which is resolved as the
//! compiler does it (imports, re-exports); by a bare name, where it is called and is defined in the same file
//! or imported there; by `.name(`, which reaches the methods of that name in the files that the caller's file
//! names, because types of values are not available here; by its name in a `static`, `const` or `const fn` of
//! an entry. Only operators and entries pass it on.

mod planted;

use super::ROOT;
use super::arithmetic;
use super::functions::{Function, functions, is_word, shipped};
use super::levels::{MEMBERS, Member};
use super::modules::Modules;
use crate::exceptions::{COMPUTING, NAMED, OFF_THE_LIST};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// Folders of operators, as MEMBER/FOLDER: levels 1 to 6, and the optimisers.
const OPERATORS: &[&str] = &[
    "num/math",
    "kernels/nn",
    "kernels/geometry",
    "kernels/splat",
    "kernels/field",
    "kernels/shade",
    "kernels/causal",
    "kernels/body",
    "kernels/loss",
    "train/optim",
];

/// Folders that run adjoints and define none: the tape, fits, systems, commands. A member without folders is
/// listed by itself.
const SYSTEMS: &[&str] = &[
    "train/tape",
    "train/fit",
    "train/experiment",
    "oracle/oracle",
    "last",
    "lirm",
    "study",
    "cli",
    "import/io",
    "import/scene",
    "scene",
    "files",
];

/// Folders that are neither: foundations, and the entries, whose gradients are checked.
const OTHERS: &[&str] = &["num/error", "num/num", "oracle/ops"];

/// Folders of `OPERATORS` that are not there yet.
const PLANNED: &[&str] = &[];

/// What tells an adjoint by its name: at its end.
const ENDINGS: &[&str] = &["_back", "_bar", "spread"];

/// What tells an adjoint by its name: anywhere.
const MARKS: &[&str] =
    &["adjoint", "backward", "backprop", "pullback", "pull_back", "vjp", "grad", "deriv", "jacob", "slope"];

fn is_adjoint(name: &str) -> bool {
    ENDINGS.iter().any(|ending| name.ends_with(ending)) || MARKS.iter().any(|mark| name.contains(mark))
}

/// Sources as the checks see them: modules, and the functions of each.
struct Code {
    modules: Modules,
    functions: Vec<(usize, Function)>,
    /// Which file names which.
    named: BTreeSet<(usize, usize)>,
}

impl Code {
    /// The code of some members; `file` returns the text of a file below `src/`.
    fn new(members: &[&str], file: &dyn Fn(&Path) -> Option<String>) -> Self {
        let mut modules = Modules::default();
        for member in members {
            modules.add_member(member, &Path::new(member).join("lib.rs"), file);
        }
        let mut all = Vec::new();
        for (index, module) in
            modules.all.iter().enumerate().filter(|(index, _)| !modules.is_for_tests(*index))
        {
            let code = shipped(&file(&module.file).expect("a file that was read before"));
            all.extend(functions(&code).into_iter().map(|f| (index, f)));
        }
        let named = modules.arrows().into_iter().filter(|a| !a.in_test).map(|a| (a.from, a.to)).collect();
        Self { modules, functions: all, named }
    }

    fn label(&self, function: usize) -> String {
        let (module, f) = &self.functions[function];
        format!("{} {}", self.modules.all[*module].file.display(), f.label())
    }

    /// Whether a module is in one of the folders.
    fn is_in(&self, module: usize, folders: &[&str]) -> bool {
        let path = self.modules.path(module).replace("::", "/");
        folders.iter().any(|folder| {
            path.strip_prefix(folder).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
        })
    }

    /// Indices of the functions in some folders.
    fn inside<'a>(&'a self, folders: &'a [&str]) -> impl Iterator<Item = usize> + 'a {
        (0..self.functions.len()).filter(|f| self.is_in(self.functions[*f].0, folders))
    }

    /// The functions that `path` names in the file of `module`, for a function of `owner`.
    fn named(&self, module: usize, owner: Option<&str>, path: &[String]) -> Vec<usize> {
        let Some((name, before)) = path.split_last() else { return Vec::new() };
        let mut holder = before.last().filter(|s| s.starts_with(char::is_uppercase)).map(String::as_str);
        let (target, name) = if before.first().is_some_and(|s| s == "Self") {
            holder = owner;
            (Some(module), name.clone())
        } else if before.is_empty() {
            let import = self.modules.imports(module).iter().find(|i| i.name == *name && !i.in_test);
            match import {
                Some(import) => (
                    self.modules.defining(module, &import.path),
                    import.path.last().expect("an import has a path").clone(),
                ),
                None => (Some(module), name.clone()),
            }
        } else {
            if let (1, Some(first)) = (before.len(), before.first())
                && let Some(import) = self.modules.imports(module).iter().find(|i| i.name == *first)
            {
                // a type under another name
                holder = holder.and(import.path.last().map(String::as_str));
            }
            // a type of this file is found by its name alone
            let own = (before.len() == 1).then_some(module);
            (self.modules.defining(module, path).or(own), name.clone())
        };
        let Some(target) = target else { return Vec::new() };
        let is_it =
            |(at, f): &(usize, Function)| *at == target && f.name == name && f.owner.as_deref() == holder;
        (0..self.functions.len()).filter(|f| is_it(&self.functions[*f])).collect()
    }

    /// The functions that a function reaches by one step.
    fn calls(&self, function: usize) -> BTreeSet<usize> {
        let (module, f) = &self.functions[function];
        let hands_over = f.is_constant && self.is_in(*module, OTHERS);
        let t = &f.body;
        let token = |at: usize| t.get(at).map_or("", String::as_str);
        let mut out = BTreeSet::new();
        let mut at = 0;
        while at < t.len() {
            if !is_word(&t[at]) {
                at += 1;
                continue;
            }
            let before = at.checked_sub(1).map_or("", token);
            let is_range = before == "." && at > 1 && token(at - 2) == ".";
            let mut path = vec![t[at].clone()];
            while token(at + 1) == "::" && is_word(token(at + 2)) {
                path.push(t[at + 2].clone());
                at += 2;
            }
            let is_called = token(at + 1) == "(" || token(at + 1) == "::" && token(at + 2) == "<";
            at += 1;
            if before == "." && !is_range || before == "::" {
                // a method, or a segment behind generics
                if is_called {
                    out.extend(self.methods(*module, &path[path.len() - 1]));
                }
            } else if path.len() > 1 || is_called || hands_over {
                out.extend(self.named(*module, f.owner.as_deref(), &path));
            }
        }
        out
    }

    /// Methods of that name in the files that a module names, itself included.
    fn methods(&self, module: usize, name: &str) -> Vec<usize> {
        let is_it = |(at, f): &(usize, Function)| {
            f.name == name && f.owner.is_some() && (*at == module || self.named.contains(&(module, *at)))
        };
        (0..self.functions.len()).filter(|f| is_it(&self.functions[*f])).collect()
    }

    /// The values that `LIST` names in the file `ops` of the member `oracle`.
    fn entries(&self) -> Vec<usize> {
        let ops = |(module, f): &(usize, Function)| {
            self.modules.path(*module) == "oracle::ops" && f.is_constant && f.name == "LIST"
        };
        let list = (0..self.functions.len()).find(|f| ops(&self.functions[*f])).expect("a list of operators");
        self.calls(list).into_iter().collect()
    }

    /// Functions that are reached from the given ones.
    fn reached(&self, from: Vec<usize>) -> BTreeSet<usize> {
        let mut seen: BTreeSet<usize> = from.iter().copied().collect();
        let mut work = from;
        while let Some(f) = work.pop() {
            for target in self.calls(f) {
                let module = self.functions[target].0;
                if (self.is_in(module, OPERATORS) || self.is_in(module, OTHERS)) && seen.insert(target) {
                    work.push(target);
                }
            }
        }
        seen
    }

    /// Adjoints in the folders of operators, and whether the list reaches each.
    fn adjoints(&self) -> Vec<(String, bool)> {
        let reached = self.reached(self.entries());
        let adjoints = self.inside(OPERATORS).filter(|f| self.is_named(*f));
        adjoints.map(|f| (self.label(f), reached.contains(&f))).collect()
    }

    /// Functions of systems that are named as adjoints.
    fn named_in_systems(&self) -> Vec<String> {
        self.inside(SYSTEMS).filter(|f| self.is_named(*f)).map(|f| self.label(f)).collect()
    }

    /// What functions of systems compute with cotangents: function and text.
    fn computed_in_systems(&self) -> Vec<(String, String)> {
        let of = |f: usize| {
            let found = arithmetic::cotangents(&self.functions[f].1.body, is_adjoint);
            found.into_iter().map(move |text| (self.label(f), text))
        };
        self.inside(SYSTEMS).flat_map(of).collect()
    }

    fn is_named(&self, function: usize) -> bool {
        let f = &self.functions[function].1;
        is_adjoint(&f.name) && !(f.is_constant && f.name.chars().all(|c| !c.is_lowercase()))
    }
}

fn repository() -> Code {
    let members: Vec<&str> = MEMBERS.iter().map(|(name, ..)| *name).collect();
    let src = Path::new(ROOT).join("src");
    Code::new(&members, &|path| fs::read_to_string(src.join(path)).ok())
}

/// What is not listed, and what is listed for nothing: `found` are the labels that need an entry of `listed`.
fn differences(found: &[String], listed: &[(&str, &str)]) -> Vec<String> {
    let missing = found.iter().filter(|label| !listed.iter().any(|(known, _)| known == label));
    let stale = listed.iter().filter(|(known, _)| !found.iter().any(|label| label == known));
    let missing = missing.map(|label| format!("{label}: not listed"));
    let stale = stale.map(|(known, _)| format!("{known}: listed, but not there or not needed"));
    let unreasoned =
        listed.iter().filter(|(_, reason)| reason.is_empty()).map(|(known, _)| format!("{known}: no reason"));
    missing.chain(stale).chain(unreasoned).collect()
}

/// [`differences`] of computations, which are listed by function and beginning.
fn computing_differences(found: &[(String, String)], listed: &[(&str, &str, &str)]) -> Vec<String> {
    let is_listed = |(label, text): &(String, String), (known, begins, _): &(&str, &str, &str)| {
        label == known && text.starts_with(begins)
    };
    let missing = found.iter().filter(|f| !listed.iter().any(|known| is_listed(f, known)));
    let stale = listed.iter().filter(|known| !found.iter().any(|f| is_listed(f, known)));
    let missing = missing.map(|(label, text)| format!("{label}: computes {text}"));
    let stale = stale.map(|(known, begins, _)| format!("{known}: '{begins}' listed, but not there"));
    missing.chain(stale).collect()
}

/// Folders that are in none or several of the tables, and those that are not there.
fn wrong_folders(code: &Code, members: &[Member]) -> Vec<String> {
    let mut out = Vec::new();
    let listed = || OPERATORS.iter().chain(SYSTEMS).chain(OTHERS).copied();
    for (member, _, folders) in members {
        for (folder, ..) in *folders {
            let name = if *folder == "*" { (*member).to_owned() } else { format!("{member}/{folder}") };
            let times = listed().filter(|l| *l == name).count();
            if times != 1 {
                out.push(format!("{name}: in {times} tables"));
            }
        }
    }
    for name in listed() {
        let is_there = (0..code.modules.all.len()).any(|m| code.is_in(m, &[name]));
        if is_there == PLANNED.contains(&name) {
            out.push(format!(
                "{name}: {}",
                if is_there { "is there, and in PLANNED" } else { "is not there" }
            ));
        }
    }
    out
}

#[test]
fn every_folder_is_of_operators_or_not() {
    let wrong = wrong_folders(&repository(), MEMBERS);
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn every_adjoint_of_an_operator_is_run_by_an_entry_of_the_list() {
    let code = repository();
    let (adjoints, entries) = (code.adjoints(), code.entries());
    assert!(
        adjoints.len() > 70 && entries.len() > 40,
        "{} adjoints, {} entries",
        adjoints.len(),
        entries.len()
    );
    let unreached: Vec<String> = adjoints.into_iter().filter(|(_, is)| !is).map(|(label, _)| label).collect();
    let wrong = differences(&unreached, OFF_THE_LIST);
    assert!(wrong.is_empty(), "adjoints beside the operator list: {wrong:#?}");
}

#[test]
fn no_system_derives_an_adjoint_of_its_own() {
    let code = repository();
    let count = code.inside(SYSTEMS).count();
    assert!(count > 2000, "{count} functions found");
    let wrong = differences(&code.named_in_systems(), NAMED);
    assert!(wrong.is_empty(), "adjoints outside the operators: {wrong:#?}");
    let wrong = computing_differences(&code.computed_in_systems(), COMPUTING);
    assert!(wrong.is_empty(), "arithmetic on cotangents outside the operators: {wrong:#?}");
}
