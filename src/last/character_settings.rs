//! Settings of a character in a data set, and the meaning of its factors.

use serde_json::{Value, json};
use std::path::PathBuf;

/// A character and the meaning of its factors.
#[derive(Clone, Debug, PartialEq)]
pub struct CharacterSettings {
    /// Path of a `.gltf` or `.glb` file, or of the folder of the open body.
    pub file: PathBuf,
    /// Name of one animation, or of two to mix.
    pub animations: Vec<String>,
    /// The joint that u_O bends; searched for by name if absent.
    pub elbow: Option<String>,
    /// Names of parts that are not shown.
    pub hide: Vec<String>,
    /// Whether the animations are also played.
    pub play: bool,
}

impl CharacterSettings {
    /// Name of the file or folder.
    pub(super) fn name(&self) -> String {
        self.file.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned())
    }

    /// The settings as recorded; the path is recorded as the name of the file.
    pub fn record(&self) -> Value {
        json!({
            "file": self.name(), "animations": self.animations, "elbow": self.elbow, "hide": self.hide, "play": self.play,
        })
    }

    /// The command-line options that give these settings; the path is replaced by the name of the file, so
    /// that a record does not depend on its location.
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

/// Quotes a word of a command line for a POSIX shell.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=,+@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}
