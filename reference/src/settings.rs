//! Settings of an operator: numbers and words by name.

use std::collections::BTreeMap;

/// One setting.
#[derive(Clone, Debug, PartialEq)]
pub enum Setting {
    /// A number.
    Number(f64),
    /// A word, or a number in decimal text.
    Text(String),
}

/// The settings of one request.
#[derive(Clone, Copy, Debug)]
pub struct Settings<'a>(pub &'a BTreeMap<String, Setting>);

impl Settings<'_> {
    /// The number of that name, or the default.
    ///
    /// # Errors
    /// When it is no finite number.
    pub fn number(&self, name: &str, default: f64) -> Result<f64, String> {
        let x = match self.0.get(name) {
            None => return Ok(default),
            Some(Setting::Number(x)) => *x,
            Some(Setting::Text(text)) => {
                text.parse().map_err(|_| format!("setting {name}: expected a number, got {text}"))?
            }
        };
        if x.is_finite() { Ok(x) } else { Err(format!("setting {name}: expected a finite number, got {x}")) }
    }

    /// The word of that name, or the default.
    ///
    /// # Errors
    /// When it is a number.
    pub fn text(&self, name: &str, default: &str) -> Result<String, String> {
        match self.0.get(name) {
            None => Ok(default.to_owned()),
            Some(Setting::Text(text)) => Ok(text.clone()),
            Some(Setting::Number(x)) => Err(format!("setting {name}: expected a word, got {x}")),
        }
    }

    /// Whether the setting of that name is 1, or the default.
    ///
    /// # Errors
    /// When it is neither 0 nor 1.
    pub fn flag(&self, name: &str, default: bool) -> Result<bool, String> {
        match self.number(name, f64::from(u8::from(default)))? {
            0.0 => Ok(false),
            1.0 => Ok(true),
            other => Err(format!("setting {name}: expected 0 or 1, got {other}")),
        }
    }

    /// Refuses settings the operator does not know.
    ///
    /// # Errors
    /// Names the first unknown setting.
    pub fn only(&self, known: &[&str]) -> Result<(), String> {
        match self.0.keys().find(|name| !known.contains(&name.as_str())) {
            None => Ok(()),
            Some(name) => Err(format!("setting {name}: unknown here; known: {}", known.join(", "))),
        }
    }
}
