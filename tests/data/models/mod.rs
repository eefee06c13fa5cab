//! Models, characters and environment maps from files.
//!
//! Closed forms on hand-written files (`samples/gltf.rs`), round trips of the writers, and the real models of
//! `$LASTLIGHT_DATA/data`.

mod baked;
mod character;
mod environment;
mod files;
mod ply;
mod real;
mod textured;

use crate::samples::gltf::Builder;
use lastlight::io::gltf::{self, Gltf};
use lastlight::scene::mesh::Object;
use lastlight::scene::model;

/// Refuses every path.
fn nothing(path: &str) -> lastlight::Result<Vec<u8>> {
    Err(lastlight::Error::input(path.to_owned()).expected("no other file").got("a path"))
}

fn parse(b: &Builder) -> Gltf {
    let (a, c) = (gltf::parse(&b.gltf(), "a.gltf", &nothing), gltf::parse(&b.glb(), "a.glb", &nothing));
    let (a, c) = (a.unwrap_or_else(|e| panic!("{e}")), c.unwrap_or_else(|e| panic!("{e}")));
    assert_eq!(a, c, "both containers hold the same");
    a
}

fn object(b: &Builder) -> Object {
    model::from_gltf(&parse(b), "a.gltf").unwrap_or_else(|e| panic!("{e}"))
}

/// The largest difference of coordinates; the lists are as long as each other.
fn apart(a: &[[f32; 3]], b: &[[f64; 3]]) -> f64 {
    assert_eq!(a.len(), b.len(), "as many points");
    let each = a.iter().flatten().zip(b.iter().flatten()).map(|(x, y)| (f64::from(*x) - y).abs());
    each.fold(0.0, |m, d| if d > m || d.is_nan() { d } else { m })
}
