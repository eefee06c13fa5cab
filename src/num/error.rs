//! The error type of the library: what failed, where, what was expected, what was found, and what to do about
//! it.
//!
//! ```
//! # use lastlight_num as lastlight;
//! use lastlight::Error;
//! let e = Error::input("garden.ply").at("element vertex, row 17, property opacity").expected("a finite number").got("NaN");
//! assert_eq!(e.to_string(), "garden.ply: element vertex, row 17, property opacity: expected a finite number, got NaN");
//! ```

use std::fmt;

/// Result type of this library.
pub type Result<T> = std::result::Result<T, Error>;

/// Classes of errors; the class decides the exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Kind {
    /// Wrong usage or invalid input; the exit code is 2.
    Input,
    /// A check ran and failed; the exit code is 1.
    Check,
    /// The user interrupted the run, and all completed results are on disk; the exit code is 130.
    Interrupted,
}

/// The error type of the library.
#[derive(Clone, Debug)]
pub struct Error(Box<Parts>);

// The parts are boxed, so that every `Result` is only one word larger than its value.
#[derive(Clone, Debug)]
struct Parts {
    kind: Kind,
    what: String,
    at: Option<String>,
    expected: Option<String>,
    got: Option<String>,
    hint: Option<String>,
}

impl Error {
    fn new(kind: Kind, what: impl Into<String>) -> Self {
        Self(Box::new(Parts { kind, what: what.into(), at: None, expected: None, got: None, hint: None }))
    }

    /// Reports wrong usage or invalid input; `what` names the file, the operator or the argument.
    pub fn input(what: impl Into<String>) -> Self {
        Self::new(Kind::Input, what)
    }

    /// Reports a check that failed; `what` names the check.
    pub fn check(what: impl Into<String>) -> Self {
        Self::new(Kind::Check, what)
    }

    /// Reports that the user interrupted the run.
    pub fn interrupted(what: impl Into<String>) -> Self {
        Self::new(Kind::Interrupted, what)
    }

    /// Reports an operating-system error on a file, without the system's error number.
    pub fn os(path: &std::path::Path, e: &std::io::Error) -> Self {
        use std::io::ErrorKind;
        let message = match e.kind() {
            ErrorKind::NotFound => "no such file or folder".to_owned(),
            ErrorKind::PermissionDenied => "permission denied".to_owned(),
            ErrorKind::IsADirectory => "is a folder, not a file".to_owned(),
            ErrorKind::NotADirectory => "is a file, not a folder".to_owned(),
            ErrorKind::StorageFull => "no space left on the device".to_owned(),
            _ => {
                let text = e.to_string();
                text.split_once(" (os error").map(|(text, _)| text.to_owned()).unwrap_or(text)
            }
        };
        Self::input(path.display().to_string()).got(message)
    }

    /// Sets the place inside `what`: a line, a field, an array and an index. A place set before is appended
    /// to the new one.
    #[must_use]
    pub fn at(mut self, place: impl Into<String>) -> Self {
        let place = place.into();
        self.0.at = Some(match self.0.at.take() {
            Some(inner) => format!("{place}: {inner}"),
            None => place,
        });
        self
    }

    /// Sets a file or an operator as the new `what`; the previous one becomes the place.
    #[must_use]
    pub fn within(mut self, what: impl Into<String>) -> Self {
        let inner = std::mem::replace(&mut self.0.what, what.into());
        self.at(inner)
    }

    /// Sets what would have been valid.
    #[must_use]
    pub fn expected(mut self, text: impl Into<String>) -> Self {
        self.0.expected = Some(text.into());
        self
    }

    /// Sets what was found instead.
    #[must_use]
    pub fn got(mut self, text: impl Into<String>) -> Self {
        self.0.got = Some(text.into());
        self
    }

    /// Sets a suggestion for the user.
    #[must_use]
    pub fn hint(mut self, text: impl Into<String>) -> Self {
        self.0.hint = Some(text.into());
        self
    }

    /// Returns the class of the error.
    pub fn kind(&self) -> Kind {
        self.0.kind
    }

    /// Returns the exit code of a command that ends with this error: 1 if a check failed, 2 for wrong usage
    /// or invalid input.
    pub fn exit_code(&self) -> u8 {
        match self.0.kind {
            Kind::Check => 1,
            Kind::Input => 2,
            Kind::Interrupted => 130,
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0.what)?;
        if let Some(at) = &self.0.at {
            write!(f, ": {at}")?;
        }
        match (&self.0.expected, &self.0.got) {
            (Some(e), Some(g)) => write!(f, ": expected {e}, got {g}")?,
            (Some(e), None) => write!(f, ": expected {e}")?,
            (None, Some(g)) => write!(f, ": {g}")?,
            (None, None) => {}
        }
        if let Some(hint) = &self.0.hint {
            write!(f, " ({hint})")?;
        }
        Ok(())
    }
}

impl std::error::Error for Error {}
