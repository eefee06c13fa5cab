//! Values of options: names with one line each, sizes of images, operators.

use crate::scene::camera::MAX_SIDE;
use clap::builder::{PossibleValue, PossibleValuesParser, StringValueParser, TypedValueParser};
use clap::error::{ContextKind, ContextValue, ErrorKind};
use lastlight_oracle::ops;
use std::ffi::OsStr;

/// Names that an option accepts, each with what it means.
pub(crate) type Choices = [(&'static str, &'static str)];

/// Accepts one of these names; help and completions show them, an error suggests the closest one.
pub(crate) fn choices(names: &Choices) -> PossibleValuesParser {
    PossibleValuesParser::new(names.iter().map(|value| possible(*value)).collect::<Vec<_>>())
}

/// Semantics of the renderer.
pub(crate) const PROFILES: &Choices = &[
    ("exact", "all constants as in the equations"),
    ("gsplat", "constants and cut-offs of gsplat"),
    ("inria", "constants and cut-offs of the original implementation"),
    ("unlimited", "as exact, with no smallest alpha and no early stop"),
];

/// Axes of a panorama.
pub(crate) const ENV_AXES: &Choices = &[
    ("ours", "centre column looks along +x, z up"),
    ("mitsuba", "of Mitsuba's envmap"),
    ("nvdiffrec", "of nvdiffrec"),
    ("blender", "of Blender's world texture"),
];

/// Images beside the photo and the foreground.
pub(crate) const PASSES: &Choices = &[
    ("photo", "photo and foreground, which are always written"),
    ("radiance", "linear radiance (EXR)"),
    ("depth", "camera z (EXR)"),
    ("normal", "world normals (EXR)"),
    ("albedo", "base colour (PNG)"),
    ("material", "metallic and roughness (PNG)"),
    ("all", "all of these"),
];

fn sides(text: &str) -> Result<[usize; 2], String> {
    let wrong = || format!("expected S or WxH with sides of 1 to {MAX_SIDE} pixels, such as 512 or 800x600");
    let side = |text: &str| text.parse().ok().filter(|n| (1..=MAX_SIDE).contains(n)).ok_or_else(wrong);
    match text.split_once(['x', '×']) {
        Some((width, height)) => Ok([side(width)?, side(height)?]),
        None => side(text).map(|side| [side, side]),
    }
}

/// Width and height of an image in pixels: `S` for a square, or `WxH`.
///
/// # Errors
/// When the text is neither, or a side is out of range; names the range.
pub(crate) fn size(text: &str) -> Result<[usize; 2], String> {
    sides(text)
}

/// Side of a square image in pixels: `S`, or `SxS`.
///
/// # Errors
/// When the text is neither, or the side is out of range; names the range.
pub(crate) fn square(text: &str) -> Result<usize, String> {
    match sides(text)? {
        [width, height] if width == height => Ok(width),
        _ => Err("expected a square size, such as 256 or 256x256".to_owned()),
    }
}

/// A number of things: `7000`, or with a power of ten, `7e3`.
#[derive(Clone)]
pub(crate) struct Count;

impl Count {
    /// The number, if the text is one.
    fn parse(text: &str) -> Option<usize> {
        let Some((digits, power)) = text.split_once(['e', 'E']) else { return text.parse().ok() };
        let (whole, fraction) = digits.split_once('.').unwrap_or((digits, ""));
        let power = power.parse::<usize>().ok().filter(|p| (fraction.len()..=18).contains(p))?;
        let digits: usize = format!("{whole}{fraction}").parse().ok()?;
        digits.checked_mul(10_usize.checked_pow(u32::try_from(power - fraction.len()).ok()?)?)
    }
}

impl TypedValueParser for Count {
    type Value = usize;

    fn parse_ref(
        &self,
        command: &clap::Command,
        argument: Option<&clap::Arg>,
        value: &OsStr,
    ) -> Result<usize, clap::Error> {
        let text = StringValueParser::new().parse_ref(command, argument, value)?;
        Self::parse(&text).ok_or_else(|| {
            let option = argument.map_or_else(String::new, |a| format!(" for '{a}'"));
            invalid(&format!("invalid value '{text}'{option}: expected {INTEGER}, such as 7000 or 7e3"))
        })
    }
}

/// An error of a value in the form of the parser's own.
pub(crate) fn invalid(message: &str) -> clap::Error {
    let message = format!("{message}\n\nFor more information, try '--help'.\n");
    clap::Error::raw(ErrorKind::ValueValidation, message)
}

/// What an option of integers accepts, for errors.
pub(crate) const INTEGER: &str = "an integer of at least 0";

/// Values that completions know, of which others are accepted too.
#[derive(Clone)]
pub(crate) struct Known {
    /// the values that completions show, each with what it means, or with an empty text
    pub(crate) names: &'static Choices,
    /// whether another value is accepted
    pub(crate) accepts: fn(&str) -> bool,
}

impl TypedValueParser for Known {
    type Value = String;

    fn parse_ref(
        &self,
        command: &clap::Command,
        argument: Option<&clap::Arg>,
        value: &OsStr,
    ) -> Result<String, clap::Error> {
        let text = StringValueParser::new().parse_ref(command, argument, value)?;
        if (self.accepts)(&text) { Ok(text) } else { choices(self.names).parse_ref(command, argument, value) }
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(self.names.iter().map(|value| possible(*value))))
    }
}

/// A value with its meaning, if there is one.
fn possible((name, meaning): (&'static str, &'static str)) -> PossibleValue {
    let value = PossibleValue::new(name);
    if meaning.is_empty() { value } else { value.help(meaning) }
}

/// The name of an operator of the list.
#[derive(Clone)]
pub(crate) struct Operator;

impl TypedValueParser for Operator {
    type Value = String;

    fn parse_ref(
        &self,
        command: &clap::Command,
        argument: Option<&clap::Arg>,
        value: &OsStr,
    ) -> Result<String, clap::Error> {
        let name = StringValueParser::new().parse_ref(command, argument, value)?;
        if ops::LIST.iter().any(|op| op.name == name) {
            return Ok(name);
        }
        let mut e = clap::Error::new(ErrorKind::InvalidValue).with_cmd(command);
        if let Some(argument) = argument {
            e.insert(ContextKind::InvalidArg, ContextValue::String(argument.to_string()));
        }
        e.insert(ContextKind::InvalidValue, ContextValue::String(name.clone()));
        let is_group = |op: &&ops::Op| op.name.split_once('.').is_some_and(|(group, _)| group == name);
        let list = |what: String| ContextValue::StyledStrs(vec![what.into()]);
        let close = ops::similar(&name, ops::LIST.iter().map(|op| op.name));
        if ops::LIST.iter().copied().any(|op| is_group(&op)) {
            let what = format!("'{name}' is a group: `lastlight oracle list {name}` prints its operators");
            e.insert(ContextKind::Suggested, list(what));
        } else if close.is_empty() {
            let what = "`lastlight oracle list` prints all operators".to_owned();
            e.insert(ContextKind::Suggested, list(what));
        } else {
            let close = close.into_iter().map(str::to_owned).collect();
            e.insert(ContextKind::SuggestedValue, ContextValue::Strings(close));
        }
        Err(e)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(ops::LIST.iter().map(|op| PossibleValue::new(op.name).help(op.summary))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_one_side_or_two() {
        assert_eq!(size("640x480"), Ok([640, 480]), "two sides");
        assert_eq!(size("64"), Ok([64, 64]), "a square");
        assert_eq!((square("64"), square("64x64")), (Ok(64), Ok(64)), "a square in both forms");
        assert!(square("64x48").is_err(), "no square");
        for bad in ["", "0x3", "640x", "axb", "99999x2", "0", "-4"] {
            let e = size(bad).expect_err("refused");
            assert!(e.contains(&format!("1 to {MAX_SIDE}")), "'{bad}' names the range: {e}");
        }
    }

    #[test]
    fn counts_may_have_a_power_of_ten() {
        for (text, n) in [("0", 0), ("7000", 7000), ("7e3", 7000), ("1.5e4", 15_000), ("2E0", 2)] {
            assert_eq!(Count::parse(text), Some(n), "{text}");
        }
        for bad in ["", "-5", "e3", "1e", "1e-3", "1.5", "1.25e1", "1e30", "1e18446744073709551617", "many"] {
            assert_eq!(Count::parse(bad), None, "{bad}");
        }
    }
}
