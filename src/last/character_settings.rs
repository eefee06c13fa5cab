//! Which character a data set shows, and what its factors mean.

use serde_json::{Value, json};
use std::path::PathBuf;

/// Which character, and what its factors mean.
#[derive(Clone, Debug, PartialEq)]
pub struct CharacterSettings {
    /// `.gltf`, `.glb`, or the folder of the open body.
    pub file: PathBuf,
    /// One animation, or two to mix.
    pub animations: Vec<String>,
    /// The joint u_O bends; searched for by name if absent.
    pub elbow: Option<String>,
    /// Parts left out.
    pub hide: Vec<String>,
    /// The animations run on.
    pub play: bool,
}

impl CharacterSettings {
    /// Name of the file or folder.
    pub(super) fn name(&self) -> String {
        self.file.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned())
    }

    /// What settings record: the name of the file stands for its path.
    pub fn record(&self) -> Value {
        json!({
            "file": self.name(), "animations": self.animations, "elbow": self.elbow, "hide": self.hide, "play": self.play,
        })
    }

    /// The options that give it; the name of the file stands for its path, so that a record does not depend on where it lies.
    pub fn options(&self) -> String {
        let mut out = format!(" --character {}", quoted(&self.name()));
        for a in &self.animations {
            out.push_str(&format!(" --animation {}", quoted(a)));
        }
        if let Some(e) = &self.elbow {
            out.push_str(&format!(" --elbow {}", quoted(e)));
        }
        for h in &self.hide {
            out.push_str(&format!(" --hide {}", quoted(h)));
        }
        if self.play {
            out.push_str(" --animate");
        }
        out
    }
}

/// A word of a command line as a POSIX shell reads it.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=,+@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}
