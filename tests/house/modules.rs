//! The modules of all members as one tree, and the arrows between them: who names whose items.

use super::reader::{Import, Named, Source, read};
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fs;
use std::path::{Path, PathBuf};

/// Re-exports of re-exports are followed so far.
const MAX_STEPS: usize = 32;

/// One module with a file, or the root of a member.
#[derive(Debug)]
pub(crate) struct Module {
    /// Last segment of its path; of a root, the name of the member.
    pub(crate) name: String,
    /// None for a root.
    pub(crate) parent: Option<usize>,
    /// Its file, relative to where it was read from.
    pub(crate) file: PathBuf,
    children: BTreeMap<String, usize>,
    source: Source,
}

/// Modules of several members.
#[derive(Debug, Default)]
pub(crate) struct Modules {
    /// Parents before children.
    pub(crate) all: Vec<Module>,
}

/// An arrow: module `from` names `path`, an item of module `to`.
#[derive(Clone, Debug)]
pub(crate) struct Arrow {
    /// Index of the module whose file names it.
    pub(crate) from: usize,
    /// Index of the module that defines it.
    pub(crate) to: usize,
    /// The path as written.
    pub(crate) path: String,
    /// Whether only tests name it.
    pub(crate) in_test: bool,
}

impl Modules {
    /// Adds the member `name` with its root file and everything that it declares; `file` returns the text of
    /// a file.
    pub(crate) fn add_member(&mut self, name: &str, root: &Path, file: &dyn Fn(&Path) -> Option<String>) {
        let text = file(root).expect("a root file");
        let folder = root.parent().expect("a folder").to_path_buf();
        let mut waiting = VecDeque::from([(name.to_owned(), None, root.to_path_buf(), folder, text)]);
        while let Some((name, parent, path, folder, text)) = waiting.pop_front() {
            let index = self.all.len();
            if let Some(parent) = parent {
                let parent: &mut Module = &mut self.all[parent];
                parent.children.insert(name.clone(), index);
            }
            let source = read(&text);
            for child in &source.modules {
                let below = folder.join(child);
                let places = [folder.join(format!("{child}.rs")), below.join("mod.rs")];
                let (place, text) = places
                    .iter()
                    .find_map(|p| Some((p.clone(), file(p)?)))
                    .unwrap_or_else(|| panic!("{}: no file of module {child}", path.display()));
                waiting.push_back((child.clone(), Some(index), place, below, text));
            }
            self.all.push(Module { name, parent, file: path, children: BTreeMap::new(), source });
        }
    }

    /// Adds a member from the folder `root/src/NAME`.
    pub(crate) fn read_member(&mut self, root: &Path, name: &str) {
        let relative = Path::new("src").join(name).join("lib.rs");
        self.add_member(name, &relative, &|path| fs::read_to_string(root.join(path)).ok());
    }

    /// From a module up to its root, itself first.
    fn upwards(&self, module: usize) -> Vec<usize> {
        std::iter::successors(Some(module), |m| self.all[*m].parent).collect()
    }

    /// Path of a module below its member: `kernels::nn::mlp`.
    pub(crate) fn path(&self, module: usize) -> String {
        let names: Vec<_> = self.upwards(module).iter().rev().map(|m| self.all[*m].name.as_str()).collect();
        names.join("::")
    }

    /// The root of a module's member.
    pub(crate) fn root(&self, module: usize) -> usize {
        *self.upwards(module).last().expect("itself")
    }

    /// Imports of a module's file.
    pub(crate) fn imports(&self, module: usize) -> &[Import] {
        &self.all[module].source.imports
    }

    /// Whether a module is compiled for tests only: declared so, or below one that is.
    pub(crate) fn is_for_tests(&self, module: usize) -> bool {
        let is_declared = |m: &usize| {
            let Some(parent) = self.all[*m].parent else { return false };
            self.all[parent].source.test_modules.contains(&self.all[*m].name)
        };
        self.upwards(module).iter().any(is_declared)
    }

    /// The module that defines what `path` names in the file of `from`; None for what no member defines.
    pub(crate) fn defining(&self, from: usize, path: &[String]) -> Option<usize> {
        self.resolve(from, path, MAX_STEPS)
    }

    /// [`Self::defining`] in so many steps.
    fn resolve(&self, from: usize, path: &[String], steps: usize) -> Option<usize> {
        let (first, rest) = path.split_first()?;
        let module = &self.all[from];
        if steps == 0 {
            return None;
        }
        let start = match first.as_str() {
            "crate" => self.root(from),
            "self" => from,
            "super" => module.parent?,
            name => {
                if let Some(child) = module.children.get(name) {
                    *child
                } else if let Some(import) =
                    module.source.imports.iter().find(|i| i.name == *name && i.path != *path)
                {
                    return self.resolve(from, &[&import.path, rest].concat(), steps - 1);
                } else {
                    let member = name.strip_prefix("lastlight_")?;
                    self.all.iter().position(|m| m.parent.is_none() && m.name == member)?
                }
            }
        };
        self.walk(start, rest, steps - 1)
    }

    /// Follows `rest` from a module: its modules, its imports, its glob imports; otherwise it defines the
    /// item itself.
    fn walk(&self, start: usize, rest: &[String], steps: usize) -> Option<usize> {
        let Some((name, below)) = rest.split_first() else { return Some(start) };
        let module = &self.all[start];
        if name == "super" {
            return self.walk(module.parent?, below, steps);
        }
        if let Some(child) = module.children.get(name) {
            return self.walk(*child, below, steps);
        }
        if module.source.items.contains(name) {
            return Some(start);
        }
        if let Some(import) = module.source.imports.iter().find(|i| i.name == *name) {
            let path = [&import.path, below].concat();
            return self.resolve(start, &path, steps.checked_sub(1)?).or(Some(start));
        }
        for import in module.source.imports.iter().filter(|i| i.name == "*") {
            let Some(whole) = self.resolve(start, &import.path, steps.checked_sub(1)?) else { continue };
            let source = &self.all[whole].source;
            if self.all[whole].children.contains_key(name)
                || source.items.contains(name)
                || source.imports.iter().any(|i| i.name == *name && i.public)
            {
                return self.walk(whole, rest, steps.checked_sub(1)?);
            }
        }
        // exported macros are found at the root
        if module.parent.is_none() {
            let holder = (0..self.all.len())
                .find(|m| self.root(*m) == start && self.all[*m].source.macros.contains(name));
            return holder.or(Some(start));
        }
        Some(start)
    }

    /// Whether `module` lies below `above`.
    fn is_below(&self, module: usize, above: usize) -> bool {
        module != above && self.upwards(module).contains(&above)
    }

    /// All arrows. A module that re-exports what lies below it has no arrow there by that alone.
    pub(crate) fn arrows(&self) -> Vec<Arrow> {
        let mut out = Vec::new();
        for (from, module) in self.all.iter().enumerate() {
            let mut add = |path: &[String], export: bool, in_test: bool| {
                if let Some(to) = self.defining(from, path)
                    && to != from
                    && !(export && self.is_below(to, from))
                {
                    out.push(Arrow { from, to, path: path.join("::"), in_test });
                }
            };
            for import in &module.source.imports {
                add(&import.path, import.public, import.in_test);
            }
            for Named { path, in_test } in &module.source.paths {
                let first = path[0].as_str();
                // a single name is a path of its own only where the file re-exports it and uses it, too
                if path.len() > 1 || module.source.imports.iter().any(|i| i.public && i.name == first) {
                    add(path, false, *in_test);
                }
            }
        }
        out
    }

    /// Imports of everything (`use super::*`, `use crate::…::*`) outside tests: they name nothing, so no
    /// arrow shows what they are for. A folder's file may re-export what lies below it.
    pub(crate) fn globs(&self) -> Vec<String> {
        let mut out = Vec::new();
        for (index, module) in self.all.iter().enumerate().filter(|(index, _)| !self.is_for_tests(*index)) {
            for import in module.source.imports.iter().filter(|i| i.name == "*" && !i.in_test) {
                let first = import.path.first().map_or("", String::as_str);
                let is_member = first.starts_with("lastlight_") && !import.public;
                let is_below = import.public
                    && self.defining(index, &import.path).is_some_and(|to| self.is_below(to, index));
                if (["super", "crate"].contains(&first) || is_member) && !is_below {
                    out.push(format!("{}: {}::*", module.file.display(), import.path.join("::")));
                }
            }
        }
        out
    }

    /// Root files of members that define or compute something themselves.
    pub(crate) fn defining_roots(&self) -> Vec<usize> {
        let defines = |m: &usize| {
            let source = &self.all[*m].source;
            self.all[*m].parent.is_none() && !(source.items.is_empty() && source.macros.is_empty())
        };
        (0..self.all.len()).filter(defines).collect()
    }

    /// The arrows between the parts of each folder: folder, then part to part, each with the first import
    /// that causes it. A part is a module directly in the folder with everything below it; the folder's own
    /// file is the part `mod`. A module of tests inside a file is a part that nothing names, so its arrows
    /// close no cycle and are left out.
    pub(crate) fn inside_folders(&self) -> BTreeMap<usize, BTreeMap<(String, String), Arrow>> {
        let mut out: BTreeMap<usize, BTreeMap<(String, String), Arrow>> = BTreeMap::new();
        for arrow in self.arrows().into_iter().filter(|a| !a.in_test) {
            let (from, to) = (self.upwards(arrow.from), self.upwards(arrow.to));
            let Some(at) = from.iter().position(|m| to.contains(m)) else { continue };
            let folder = from[at];
            let there = to.iter().position(|m| *m == folder).expect("it is common");
            let part = |way: &[usize], at: usize| match at.checked_sub(1) {
                Some(below) => self.all[way[below]].name.clone(),
                None => "mod".to_owned(),
            };
            let key = (part(&from, at), part(&to, there));
            out.entry(folder).or_default().entry(key).or_insert(arrow);
        }
        out
    }

    /// Every import cycle inside a folder, as text: one shortest cycle for each group of parts that reach
    /// each other.
    pub(crate) fn cycles(&self) -> Vec<String> {
        let mut out = Vec::new();
        for (folder, arrows) in self.inside_folders() {
            let mut told = BTreeSet::new();
            let parts: BTreeSet<&str> = arrows.keys().map(|(from, _)| from.as_str()).collect();
            for start in parts {
                if told.contains(start) {
                    continue;
                }
                let Some(cycle) = shortest_cycle(&arrows, start) else { continue };
                told.extend(cycle.iter().copied());
                let mut text = format!("{}: ", self.path(folder));
                for (i, part) in cycle.iter().enumerate() {
                    let next = cycle[(i + 1) % cycle.len()];
                    let arrow = &arrows[&((*part).to_owned(), next.to_owned())];
                    let file = self.all[arrow.from].file.display();
                    text += &format!("\n    {part} -> {next} ({file}: {})", arrow.path);
                }
                out.push(text);
            }
        }
        out
    }
}

/// A shortest way from `start` back to it.
fn shortest_cycle<'a>(arrows: &'a BTreeMap<(String, String), Arrow>, start: &'a str) -> Option<Vec<&'a str>> {
    let mut before: BTreeMap<&str, &str> = BTreeMap::new();
    let mut waiting = VecDeque::from([start]);
    while let Some(at) = waiting.pop_front() {
        for (_, to) in arrows.keys().filter(|(from, _)| from == at) {
            if to == start {
                let mut cycle = vec![at];
                while let Some(previous) = before.get(cycle[cycle.len() - 1]) {
                    cycle.push(previous);
                }
                cycle.reverse();
                return Some(cycle);
            }
            if !before.contains_key(to.as_str()) {
                before.insert(to, at);
                waiting.push_back(to);
            }
        }
    }
    None
}
