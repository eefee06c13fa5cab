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
        match closest(&name, ops::LIST.iter().map(|op| op.name)) {
            Some(close) => e.insert(ContextKind::SuggestedValue, ContextValue::String(close.to_owned())),
            None => e.insert(
                ContextKind::Suggested,
                ContextValue::StyledStrs(vec!["`lastlight oracle list` prints all operators".into()]),
            ),
        };
        Err(e)
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(ops::LIST.iter().map(|op| PossibleValue::new(op.name).help(op.summary))))
    }
}

/// The name that the fewest insertions, deletions and replacements make of `word`, if they change at most half of it.
fn closest<'a>(word: &str, names: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let best = names.map(|name| (edits(word, name), name)).min_by_key(|(edits, _)| *edits);
    best.filter(|(edits, _)| 2 * edits <= word.chars().count()).map(|(_, name)| name)
}

/// Levenshtein's distance.
fn edits(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(x != *y);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
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
    fn the_closest_name_is_suggested() {
        let close = |word: &str| closest(word, ["splat.render", "splat.blend", "nn.linear"].into_iter());
        assert_eq!(close("splat.rendr"), Some("splat.render"), "a letter is missing");
        assert_eq!(close("linear"), Some("nn.linear"), "a prefix is missing");
        assert_eq!(close("gemm"), None, "nothing is close");
        assert_eq!([edits("", "abc"), edits("kitten", "sitting"), edits("a", "a")], [3, 3, 0], "distances");
    }
}
