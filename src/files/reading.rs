//! How the files that a capture names are found.

use super::paths::{accept, locate};
use std::path::{Path, PathBuf};

/// How the files of a capture are found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reading {
    /// Folder of the images, in place of the one the capture names.
    pub images: Option<PathBuf>,
    /// Accept absolute paths and paths that lead out of the folder.
    pub outside: bool,
    /// Leave masks out.
    pub without_masks: bool,
}

impl Reading {
    /// The image that a capture in the folder `root` names.
    pub(super) fn image(&self, root: &Path, named: &str) -> Option<PathBuf> {
        let Some(folder) = &self.images else { return locate(root, named) };
        let file = named.rsplit('/').next().unwrap_or(named);
        // A folder of images holds what the capture names, or the files alone.
        let inside = accept(named, false).ok().and_then(|n| locate(folder, &n));
        inside.or_else(|| locate(folder, file))
    }
}
