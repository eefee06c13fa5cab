//! Relative paths written in files: cleaned, and resolved inside the folder.

use crate::{Error, Result};
use std::path::{Component, Path, PathBuf};

/// A path written in a file: backslashes become slashes, `.` and inner `..` are resolved.
///
/// # Errors
/// When it is absolute, empty, or leads out of the folder.
pub fn clean(text: &str) -> std::result::Result<String, &'static str> {
    let text = text.replace('\\', "/");
    if text.contains('\0') {
        return Err("a path with a NUL character");
    }
    let bytes = text.as_bytes();
    if text.starts_with('/') || (bytes.len() > 1 && bytes[1] == b':' && bytes[0].is_ascii_alphabetic()) {
        return Err("an absolute path");
    }
    let mut parts: Vec<&str> = Vec::new();
    for part in text.split('/') {
        match part {
            "" | "." => {}
            ".." => {
                if parts.pop().is_none() {
                    return Err("a path that leads out of the folder");
                }
            }
            p => parts.push(p),
        }
    }
    if parts.is_empty() { Err("an empty path") } else { Ok(parts.join("/")) }
}

/// [`clean`], or, for `outside`, also an absolute path or one that leads out of the folder, with slashes.
///
/// # Errors
/// Those of [`clean`]; with `outside`, when the path is empty or holds a NUL character.
pub fn accept(text: &str, outside: bool) -> std::result::Result<String, &'static str> {
    match clean(text) {
        Err(_) if outside && !text.is_empty() && !text.contains('\0') => Ok(text.replace('\\', "/")),
        other => other,
    }
}

/// Extensions that are tried when a file name has none, or another one.
const EXTENSIONS: [&str; 4] = ["png", "jpg", "jpeg", "exr"];

/// The file of a cleaned path: the path itself, with one of the usual extensions added, or with different
/// letter case.
pub fn locate(root: &Path, relative: &str) -> Option<PathBuf> {
    let exact = root.join(relative);
    if exact.is_file() {
        return Some(exact);
    }
    let added = EXTENSIONS.iter().map(|e| format!("{relative}.{e}"));
    let candidates: Vec<String> = std::iter::once(relative.to_owned()).chain(added).collect();
    if let Some(found) = candidates.iter().map(|c| root.join(c)).find(|p| p.is_file()) {
        return Some(found);
    }
    candidates.iter().find_map(|c| any_case(root, c)).filter(|p| p.is_file())
}

/// The path whose components match up to letter case, if exactly one matches at every level.
fn any_case(root: &Path, relative: &str) -> Option<PathBuf> {
    let mut at = root.to_path_buf();
    for part in Path::new(relative).components() {
        let Component::Normal(part) = part else { return None };
        if at.join(part).exists() {
            at.push(part);
            continue;
        }
        let wanted = part.to_str()?.to_lowercase();
        let mut matching = std::fs::read_dir(&at)
            .ok()?
            .filter_map(|e| e.ok()?.file_name().into_string().ok())
            .filter(|n| n.to_lowercase() == wanted);
        let found = matching.next()?;
        if matching.next().is_some() {
            return None;
        }
        at.push(found);
    }
    Some(at)
}

/// Deepest folder below a folder of results that is looked into.
const DEEPEST: usize = 32;

/// Checks that no folder link inside a folder leads out of it: a file written below such a link would be somewhere else. The folder itself may be
/// a link. A link to a file is harmless, because files are replaced and not written through. A folder that does not exist has no links.
///
/// # Errors
/// Names the link. Also when a folder cannot be read, or folders are nested more than 32 deep.
pub fn without_links_out(folder: &Path) -> Result<()> {
    if !folder.is_dir() {
        return Ok(());
    }
    let root = folder.canonicalize().map_err(|e| Error::os(folder, &e))?;
    let mut pending = vec![(folder.to_path_buf(), 0)];
    while let Some((at, depth)) = pending.pop() {
        let os = |e| Error::os(&at, &e);
        for entry in std::fs::read_dir(&at).map_err(os)? {
            let entry = entry.map_err(os)?;
            let (path, kind) = (entry.path(), entry.file_type().map_err(os)?);
            if kind.is_dir() {
                if depth == DEEPEST {
                    let e = Error::input(path.display().to_string());
                    return Err(e.expected(format!("folders at most {DEEPEST} deep")).got("a deeper one"));
                }
                pending.push((path, depth + 1));
            } else if kind.is_symlink() && path.is_dir() {
                let target = path.canonicalize().map_err(|e| Error::os(&path, &e))?;
                if !target.starts_with(&root) {
                    return Err(Error::input(path.display().to_string())
                        .expected("a folder, or a link to one inside the folder of results")
                        .got(format!("a link to {}", target.display()))
                        .hint("remove the link; files are not written through it"));
                }
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn links_that_lead_out_are_found() {
        use std::os::unix::fs::symlink;
        let dir = tempfile::tempdir().expect("a temporary folder");
        let (inside, outside) = (dir.path().join("in"), dir.path().join("out"));
        std::fs::create_dir_all(inside.join("a/b")).expect("made");
        std::fs::create_dir(&outside).expect("made");
        std::fs::write(outside.join("f"), "x").expect("writable");
        without_links_out(&dir.path().join("none")).expect("not there");
        symlink(&inside, dir.path().join("folder itself")).expect("linked");
        symlink(inside.join("a"), inside.join("within")).expect("linked");
        symlink(outside.join("f"), inside.join("a/file")).expect("linked");
        without_links_out(&dir.path().join("folder itself")).expect("links that stay, and to a file");
        symlink(&outside, inside.join("a/b/away")).expect("linked");
        let e = without_links_out(&inside).expect_err("a link that leads out").to_string();
        assert!(e.contains("a/b/away") && e.contains("a link to"), "{e}");
    }

    #[test]
    fn paths_outside_are_accepted_where_that_is_allowed() {
        assert_eq!(accept("..\\a/b.png", true), Ok("../a/b.png".into()), "parent folders");
        assert_eq!(accept("/data/b.png", true), Ok("/data/b.png".into()), "absolute paths");
        assert_eq!(accept("./a//b.png", true), Ok("a/b.png".into()), "others are cleaned");
        for bad in ["", "/a\0b"] {
            assert!(accept(bad, true).is_err(), "{bad:?}");
        }
    }

    #[test]
    fn paths_are_cleaned_and_kept_inside() {
        assert_eq!(clean(".\\images\\a.png"), Ok("images/a.png".into()), "backslashes");
        assert_eq!(clean("./a/../b//c"), Ok("b/c".into()), "dots");
        for bad in ["../a", "a/../../b", "/etc/passwd", "C:\\x", "c:/x", "", "./", "a\0b", "\\\\server\\x"] {
            assert!(clean(bad).is_err() && accept(bad, false).is_err(), "{bad:?}");
        }
    }
}
