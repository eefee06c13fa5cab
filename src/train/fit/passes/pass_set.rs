//! The images of a view that are written beside photo and foreground.

use crate::{Error, Result};
use serde_json::{Value, json};

/// Images that are written in addition to photo and foreground.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PassSet([bool; 5]);

impl PassSet {
    /// Names of the passes, in the order in which they are written.
    pub const NAMES: [&str; 5] = ["radiance", "depth", "normal", "albedo", "material"];
    /// Only photo and foreground.
    pub const NONE: Self = Self([false; 5]);
    /// Every pass.
    pub const ALL: Self = Self([true; 5]);

    /// The passes of these names; `all` is every pass, `photo` adds none.
    ///
    /// # Errors
    /// When a name is unknown.
    pub fn parse<T: AsRef<str>>(names: &[T]) -> Result<Self> {
        let mut set = Self::NONE;
        for name in names.iter().map(AsRef::as_ref) {
            match Self::NAMES.iter().position(|n| *n == name) {
                Some(at) => set.0[at] = true,
                None if name == "all" => set = Self::ALL,
                None if name == "photo" => {}
                None => {
                    let known = Self::NAMES.join(", ");
                    return Err(Error::input("--passes")
                        .expected(format!("photo, {known} or all"))
                        .got(name));
                }
            }
        }
        Ok(set)
    }

    /// Whether the pass of that name is written.
    pub fn has(self, name: &str) -> bool {
        Self::NAMES.iter().position(|n| *n == name).is_some_and(|at| self.0[at])
    }

    /// Whether no pass is written.
    pub fn is_empty(self) -> bool {
        self == Self::NONE
    }

    /// The names of the passes.
    pub fn names(self) -> Vec<&'static str> {
        Self::NAMES.into_iter().filter(|name| self.has(name)).collect()
    }

    /// As part of a record: `true` for all, `false` for none, else the names.
    pub fn record(self) -> Value {
        match self {
            Self::ALL => json!(true),
            Self::NONE => json!(false),
            some => json!(some.names()),
        }
    }
}
