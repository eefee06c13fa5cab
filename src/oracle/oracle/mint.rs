//! `oracle mint`: golden files from the f64 twin.

use super::run::{add_settings, gather};
use crate::io::npz;
use crate::num::array::{Array, Arrays};
use crate::ops::{self, Call, Kind, Op, Setting, Settings};
use crate::{Error, Result};
use serde::Serialize;
use std::fmt;
use std::path::PathBuf;

/// What to mint.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// operators; all if empty
    pub ops: Vec<String>,
    /// folder of the files
    pub out: PathBuf,
    /// splatting profile, a shorthand for the setting of that name
    pub profile: Option<String>,
    /// `KEY=VALUE`; takes precedence over the settings of a case
    pub set: Vec<String>,
}

/// Files written.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Report {
    /// in the order of writing
    pub files: Vec<PathBuf>,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for file in &self.files {
            writeln!(f, "wrote {}", file.display())?;
        }
        Ok(())
    }
}

/// Settings as arrays `setting_KEY`; a word becomes its index in the operator's list.
fn settings_as_arrays(op: &Op, settings: &Settings) -> Result<Arrays> {
    let mut out = Arrays::new();
    for (key, value) in settings {
        let number = match value {
            Setting::Number(x) => Some(*x),
            Setting::Text(text) => op.settings.iter().find(|s| s.key == key).and_then(|s| match s.kind {
                Kind::Choice(words) => words.iter().position(|w| w == text).map(|i| i as f64),
                Kind::Number | Kind::Flag => text.parse().ok(),
            }),
        };
        let number = number
            .ok_or_else(|| Error::input(op.name).at(format!("setting {key}")).expected("a known value"))?;
        out.put(&format!("setting_{key}"), &[], vec![number]);
    }
    Ok(out)
}

/// The golden arrays of one generated case: inputs, settings, cotangents, outputs, intermediates and
/// gradients, in f64.
///
/// # Errors
/// When the generated case is not valid input.
pub fn golden(op: &'static Op, case: usize) -> Result<Arrays> {
    golden_with(op, case, None, &[])
}

/// [`golden`] with other settings: a profile, and `KEY=VALUE`, which take precedence over those of the case.
///
/// # Errors
/// When a setting is unknown, or the case is not valid input under these settings.
pub fn golden_with(op: &'static Op, case: usize, profile: Option<&str>, set: &[String]) -> Result<Arrays> {
    let made = (op.case)(case);
    let mut call = Call { inputs: made.inputs, settings: made.settings, dump: true, ..Call::default() };
    add_settings(op, &mut call.settings, profile, set)?;
    if op.adjoint {
        let value = ops::run_f64(op, &call)?;
        call.cotangents = ops::draw_cotangents(op, &value.outputs);
    }
    let ran = ops::run_f64(op, &call)?;
    let mut out = gather(&ran);
    let wide = |a: &Array| if a.is_float() { Array::new(a.shape(), a.to_f64()) } else { a.clone() };
    out.0.extend(call.inputs.0.iter().map(|(n, a)| (n.clone(), wide(a))));
    out.0.extend(call.cotangents.0.iter().map(|(n, a)| (format!("{n}_bar"), wide(a))));
    out.0.extend(settings_as_arrays(op, &call.settings)?.0);
    Ok(out)
}

/// Writes `OP_CASE.npz` for every case of the chosen operators.
///
/// # Errors
/// An unknown operator or setting, or files that cannot be written.
pub fn mint(options: &Options, progress: &mut dyn FnMut(&str)) -> Result<Report> {
    let Options { ops: names, out: dir, profile, set } = options;
    let chosen = ops::choose(names)?;
    std::fs::create_dir_all(dir).map_err(|e| Error::os(dir, &e))?;
    let mut report = Report::default();
    for op in chosen {
        for case in 0..op.cases {
            let path = dir.join(format!("{}_{case}.npz", op.name));
            npz::write(&path, &golden_with(op, case, profile.as_deref(), set)?)?;
            progress(&format!("{}", path.display()));
            report.files.push(path);
        }
    }
    Ok(report)
}
