//! Folders as what is in them.

use std::collections::BTreeMap;
use std::fs;
use std::io::Result;
use std::path::Path;

/// Contents of the files below a folder by their path in it, `/` between names. A folder without files is its path with `/` behind it.
pub type Tree = BTreeMap<String, Vec<u8>>;

/// What is below a folder; nothing if there is no folder.
///
/// # Errors
/// When something in it cannot be read.
pub fn read(dir: &Path) -> Result<Tree> {
    let mut tree = Tree::new();
    if dir.is_dir() {
        walk(dir, "", &mut tree)?;
    }
    Ok(tree)
}

fn walk(dir: &Path, prefix: &str, tree: &mut Tree) -> Result<()> {
    let mut empty = true;
    for entry in fs::read_dir(dir)? {
        let entry = entry?;
        empty = false;
        let name = format!("{prefix}{}", entry.file_name().to_string_lossy());
        if entry.file_type()?.is_dir() {
            walk(&entry.path(), &format!("{name}/"), tree)?;
        } else {
            tree.insert(name, fs::read(entry.path())?);
        }
    }
    if empty && !prefix.is_empty() {
        tree.insert(prefix.into(), Vec::new());
    }
    Ok(())
}

/// Writes a tree below a folder.
///
/// # Errors
/// When a file cannot be written.
pub fn write(dir: &Path, tree: &Tree) -> Result<()> {
    fs::create_dir_all(dir)?;
    for (name, bytes) in tree {
        put(dir, name, bytes)?;
    }
    Ok(())
}

fn put(dir: &Path, name: &str, bytes: &[u8]) -> Result<()> {
    let path = dir.join(name);
    if name.ends_with('/') {
        return fs::create_dir_all(path);
    }
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder)?;
    }
    fs::write(path, bytes)
}

/// Removes a file or a folder with all that is in it; nothing if there is none.
///
/// # Errors
/// When it cannot be removed.
pub fn remove(path: &Path) -> Result<()> {
    match fs::symlink_metadata(path) {
        Ok(m) if m.is_dir() => fs::remove_dir_all(path),
        Ok(_) => fs::remove_file(path),
        Err(_) => Ok(()),
    }
}

/// Makes a folder hold a tree again; gives the names that were missing, changed or added.
///
/// # Errors
/// When a file cannot be read, written or removed.
pub fn restore(dir: &Path, tree: &Tree) -> Result<Vec<String>> {
    let now = read(dir)?;
    let mut changed = Vec::new();
    for name in now.keys().filter(|name| !tree.contains_key(*name)) {
        changed.push(name.clone());
        // The highest folder that the tree does not have.
        let mut top = name.trim_end_matches('/');
        while let Some((above, _)) = top.rsplit_once('/') {
            let inside = format!("{above}/");
            if tree.keys().any(|t| t.starts_with(&inside)) {
                break;
            }
            top = above;
        }
        remove(&dir.join(top))?;
    }
    for (name, bytes) in tree.iter().filter(|(name, bytes)| now.get(*name) != Some(bytes)) {
        changed.push(name.clone());
        put(dir, name, bytes)?;
    }
    Ok(changed)
}
