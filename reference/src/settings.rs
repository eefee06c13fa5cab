//! Settings of an operator: numbers and words by name, checked against its signature.

use std::collections::BTreeMap;

use crate::ports::{Kind, SettingSpec};

/// One setting.
#[derive(Clone, Debug, PartialEq)]
pub enum Setting {
    /// A number.
    Number(f64),
    /// A word, or a number in decimal text.
    Text(String),
}

/// The settings of one request; those that are not set have the defaults of the signature.
#[derive(Clone, Copy, Debug)]
pub struct Settings<'a> {
    specs: &'static [SettingSpec],
    given: &'a BTreeMap<String, Setting>,
}

/// A finite number.
fn finite(key: &str, setting: &Setting) -> Result<f64, String> {
    let x = match setting {
        Setting::Number(x) => *x,
        Setting::Text(text) => {
            text.parse().map_err(|_| format!("setting {key}: expected a number, got {text}"))?
        }
    };
    if x.is_finite() { Ok(x) } else { Err(format!("setting {key}: expected a finite number, got {x}")) }
}

impl<'a> Settings<'a> {
    /// Checks names and values.
    ///
    /// # Errors
    /// Names the first setting that the operator does not have or whose value is inadmissible.
    pub fn new(specs: &'static [SettingSpec], given: &'a BTreeMap<String, Setting>) -> Result<Self, String> {
        for (key, setting) in given {
            let Some(spec) = specs.iter().find(|spec| spec.key == key) else {
                let known: Vec<_> = specs.iter().map(|spec| spec.key).collect();
                return Err(format!("setting {key}: unknown here; known: {}", known.join(", ")));
            };
            match (spec.kind, setting) {
                (Kind::Number, _) => drop(finite(key, setting)?),
                (Kind::Flag, _) => match finite(key, setting)? {
                    0.0 | 1.0 => {}
                    other => return Err(format!("setting {key}: expected 0 or 1, got {other}")),
                },
                (Kind::Choice(words), Setting::Text(text)) if words.contains(&text.as_str()) => {}
                (Kind::Choice(words), Setting::Text(text)) => {
                    return Err(format!("setting {key}: expected one of {}, got {text}", words.join(", ")));
                }
                (Kind::Choice(_), Setting::Number(x)) => {
                    return Err(format!("setting {key}: expected a word, got {x}"));
                }
            }
        }
        Ok(Self { specs, given })
    }

    fn default(&self, key: &str) -> &'static str {
        let spec = self.specs.iter().find(|spec| spec.key == key);
        spec.unwrap_or_else(|| panic!("the signature has no setting {key}")).default
    }

    /// The number of that name, if it is set.
    pub fn given_number(&self, key: &str) -> Option<f64> {
        finite(key, self.given.get(key)?).ok()
    }

    /// The word of that name, if it is set.
    pub fn given_word(&self, key: &str) -> Option<&'a str> {
        match self.given.get(key)? {
            Setting::Text(text) => Some(text),
            Setting::Number(_) => None,
        }
    }

    /// The number of that name, or its default.
    ///
    /// # Panics
    /// When the signature has no such setting, or its default is not a number.
    pub fn number(&self, key: &str) -> f64 {
        self.given_number(key)
            .unwrap_or_else(|| self.default(key).parse().expect("the default of the setting is a number"))
    }

    /// The word of that name, or its default.
    ///
    /// # Panics
    /// When the signature has no such setting.
    pub fn word(&self, key: &str) -> &'a str {
        self.given_word(key).unwrap_or_else(|| self.default(key))
    }

    /// Whether the setting of that name, or its default, is 1.
    ///
    /// # Panics
    /// When the signature has no such setting, or its default is not a number.
    pub fn flag(&self, key: &str) -> bool {
        self.number(key) == 1.0
    }

    /// The integer of that name, or its default.
    ///
    /// # Errors
    /// When it is not an integer from `least` to 65536.
    ///
    /// # Panics
    /// When the signature has no such setting, or its default is not a number.
    pub fn whole(&self, key: &str, least: f64) -> Result<usize, String> {
        let x = self.number(key);
        if x >= least && x <= 65_536.0 && x == x.trunc() {
            return Ok(x as usize);
        }
        Err(format!("setting {key}: expected a whole number from {least} to 65536, got {x}"))
    }
}
