//! The text form of [`super::colmap`].

use super::colmap_model::{Camera, Image, MODELS, camera, check_pose};
use super::gaussian_ply::Points;
use crate::{Error, Result};
use std::collections::BTreeMap;

/// Lines with their numbers, from 1.
fn lines<'a>(bytes: &'a [u8], name: &str) -> Result<impl Iterator<Item = (usize, &'a str)>> {
    let text = std::str::from_utf8(bytes).map_err(|e| {
        Error::input(name).at(format!("byte {}", e.valid_up_to())).expected("UTF-8 text").got("other bytes")
    })?;
    Ok(text.lines().enumerate().map(|(i, l)| (i + 1, l.trim())))
}

fn skipped(line: &str) -> bool {
    line.is_empty() || line.starts_with('#')
}

/// One line's fields, taken from the left.
struct Fields<'a> {
    rest: &'a str,
    line: usize,
    name: &'a str,
}

impl<'a> Fields<'a> {
    fn new(rest: &'a str, line: usize, name: &'a str) -> Self {
        Self { rest, line, name }
    }

    fn error(&self, field: &str) -> Error {
        let comma = if field.is_empty() { "" } else { ", " };
        Error::input(self.name).at(format!("line {}{comma}{field}", self.line))
    }

    fn word(&mut self, field: &str) -> Result<&'a str> {
        let start = self.rest.trim_start();
        if start.is_empty() {
            return Err(self.error(field).expected("a field").got("the end of the line"));
        }
        let end = start.find(char::is_whitespace).unwrap_or(start.len());
        self.rest = &start[end..];
        Ok(&start[..end])
    }

    fn parse<T: std::str::FromStr>(&mut self, field: &str, expected: &str) -> Result<T> {
        let word = self.word(field)?;
        word.parse().map_err(|_| {
            let got: String = word.chars().take(60).collect();
            self.error(field).expected(expected).got(format!("'{got}'"))
        })
    }

    fn number(&mut self, field: &str) -> Result<f64> {
        let x: f64 = self.parse(field, "a number")?;
        if x.is_finite() {
            Ok(x)
        } else {
            Err(self.error(field).expected("a finite number").got(x.to_string()))
        }
    }

    fn done(&self) -> bool {
        self.rest.trim().is_empty()
    }
}

/// Parses `cameras.txt`.
///
/// # Errors
/// When it is malformed or a model is not supported.
pub fn parse_cameras(bytes: &[u8], name: &str) -> Result<BTreeMap<u32, Camera>> {
    let mut out = BTreeMap::new();
    for (number, line) in lines(bytes, name)?.filter(|(_, l)| !skipped(l)) {
        let mut f = Fields::new(line, number, name);
        let id: u32 = f.parse("id", "a camera id")?;
        let model_name = f.word("model")?;
        let model = MODELS.iter().position(|m| m.0 == model_name).ok_or_else(|| {
            let have: Vec<_> = MODELS.iter().filter(|m| m.2).map(|m| m.0).collect();
            let got: String = model_name.chars().take(60).collect();
            f.error("model").expected(format!("a camera model out of {}", have.join(", "))).got(got)
        })?;
        let size = [f.parse("width", "a number of pixels")?, f.parse("height", "a number of pixels")?];
        let mut p = Vec::new();
        while !f.done() {
            if p.len() > 16 {
                return Err(f.error("parameters").expected("at most 16").got("more"));
            }
            p.push(f.number("parameter")?);
        }
        let at = || Error::input(name).at(format!("line {number}, camera {id}"));
        if out.insert(id, camera(model, size, &p, &at)?).is_some() {
            return Err(at().expected("every id once").got("two cameras"));
        }
    }
    Ok(out)
}

/// Parses `images.txt`: two lines per image; the second, with the observations, may be empty.
///
/// # Errors
/// When it is malformed.
pub fn parse_images(bytes: &[u8], name: &str) -> Result<Vec<Image>> {
    let mut out = Vec::new();
    let mut all = lines(bytes, name)?;
    while let Some((number, line)) = all.next() {
        if skipped(line) {
            continue;
        }
        let mut f = Fields::new(line, number, name);
        let id: u32 = f.parse("id", "an image id")?;
        let mut pose = [0.0; 7];
        for (x, field) in pose.iter_mut().zip(["qw", "qx", "qy", "qz", "tx", "ty", "tz"]) {
            *x = f.number(field)?;
        }
        let [w, x, y, z, tx, ty, tz] = pose;
        check_pose(&pose[..4], &pose[4..], &|| Error::input(name).at(format!("line {number}, image {id}")))?;
        let camera = f.parse("camera id", "a camera id")?;
        let text = f.rest.trim();
        if text.is_empty() {
            return Err(f.error("name").expected("an image name").got("the end of the line"));
        }
        let image =
            Image { id, rotation: [w, x, y, z], translation: [tx, ty, tz], camera, name: text.to_owned() };
        out.push(image);
        let Some((number, line)) = all.next() else { break };
        let mut f = Fields::new(line, number, name);
        while !f.done() {
            f.number("observation x")?;
            f.number("observation y")?;
            f.parse::<i64>("observation point id", "a point id or -1")?;
        }
    }
    Ok(out)
}

/// Parses `points3D.txt`.
///
/// # Errors
/// When it is malformed.
pub fn parse_points(bytes: &[u8], name: &str) -> Result<Points> {
    let mut out = Points::default();
    for (number, line) in lines(bytes, name)?.filter(|(_, l)| !skipped(l)) {
        let mut f = Fields::new(line, number, name);
        f.parse::<u64>("id", "a point id")?;
        out.xyz.push([f.number("x")?, f.number("y")?, f.number("z")?]);
        let byte = "a colour from 0 to 255";
        out.rgb.push([f.parse("red", byte)?, f.parse("green", byte)?, f.parse("blue", byte)?]);
        f.number("error")?;
        while !f.done() {
            f.parse::<u32>("track image id", "an image id")?;
            f.parse::<u32>("track observation", "an index")?;
        }
    }
    Ok(out)
}
