//! Procedural objects: closed meshes with charts, and materials painted on them.
//!
//! ```text
//! make(seed, k) ──► generator of k ──► parts (soups of points on charts) ──► placed in the ball of radius ½
//!                                        │ normals with creases, atlas
//!                                        └ painted: albedo, roughness, metallic as textures
//! round   superquadrics, blobs, rocks, polyhedra, rings        flat    letters, gears, stars
//! turned  vessels, turned solids, mugs, tins                   built   stacks, furniture, packages, toys
//! bent    knots, shells, chains, columns                       paint/  patterns, lettering, wear
//! ```
//!
//! Object k of a seed does not depend on the number of objects generated. Every part is closed: each edge
//! belongs to two triangles, which use it in opposite directions; parts may touch or intersect.

mod atlas;
mod bent;
mod built;
mod flat;
mod glyphs;
mod paint;
mod polygon;
mod round;
mod sheets;
mod soup;
mod turned;

use crate::draws::Draws;
use crate::space::{rotated, rotation, sub};
use crate::surface::Surface;
use soup::Soup;
use std::f64::consts::TAU;

/// Purpose numbers of random draws. The item is the number of the object.
pub mod purpose {
    /// Generator and parameters of the shape.
    pub const SHAPE: u16 = 0x0300;
    /// Rotation of the object.
    pub const POSE: u16 = 0x0301;
    /// The material of a part; the step is its group.
    pub const MATERIAL: u16 = 0x0302;
    /// The noise of a material; the step is its group.
    pub const NOISE: u16 = 0x0303;
    /// Words of lettering; the step is the group.
    pub const WORDS: u16 = 0x0304;
}

/// Radius of the ball that contains an object, minus a small margin for rounding.
pub const RADIUS: f64 = 0.5 - 1.0 / 2_097_152.0;

/// Cosine of the crease angle of smooth shapes.
const SMOOTH: f64 = 0.3;
/// Cosine of the crease angle of shapes with edges.
const CREASED: f64 = 0.85;

/// The material of a part, if its shape determines it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Wish {
    Any,
    Printed,
    Metallic,
    Paper,
}

/// A closed mesh of one material.
#[derive(Clone, Debug)]
struct Part {
    soup: Soup,
    crease_cos: f64,
    group: usize,
    wish: Wish,
}

impl Part {
    fn new(soup: Soup, crease_cos: f64) -> Self {
        Self { soup, crease_cos, group: 0, wish: Wish::Any }
    }

    /// Assigns the part to a group; parts of one group have the same material.
    fn group(self, group: usize) -> Self {
        Self { group, ..self }
    }

    fn printed(self) -> Self {
        Self { wish: Wish::Printed, ..self }
    }

    fn metallic(self) -> Self {
        Self { wish: Wish::Metallic, group: self.group + 50, ..self }
    }

    fn paper(self) -> Self {
        Self { wish: Wish::Paper, ..self }
    }
}

/// Merges parts of the same group and material.
fn joined(parts: Vec<Part>) -> Vec<Part> {
    let mut out: Vec<Part> = Vec::new();
    for p in parts {
        let alike = |q: &&mut Part| q.group == p.group && q.wish == p.wish && q.crease_cos == p.crease_cos;
        match out.iter_mut().find(alike) {
            Some(q) => q.soup.append(&p.soup),
            None => out.push(p),
        }
    }
    out
}

type Generator = fn(&mut Draws) -> Vec<Part>;

/// All generators with their names and weights.
const GENERATORS: [(&str, f64, Generator); 19] = [
    ("superquadric", 1.0, round::superquadric),
    ("supertorus", 0.7, round::supertorus),
    ("blob", 1.0, round::blob),
    ("rock", 0.7, round::rock),
    ("polyhedron", 0.9, round::polyhedron),
    ("vessel", 1.3, turned::vessel),
    ("turned", 0.9, turned::turned),
    ("mug", 0.9, turned::mug),
    ("tin", 0.7, turned::tin),
    ("knot", 1.1, bent::knot),
    ("shell", 0.6, bent::shell),
    ("chain", 0.6, bent::chain),
    ("column", 0.8, bent::column),
    ("letters", 1.1, flat::letters),
    ("cutout", 1.0, flat::cutout),
    ("stack", 1.4, built::stack),
    ("furniture", 1.0, built::furniture),
    ("package", 0.9, built::package),
    ("toy", 0.8, built::toy),
];

/// An object and its parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Made {
    /// Name of the generator.
    pub generator: &'static str,
    /// Named parameters in the order in which they were drawn; materials are numbered.
    pub parameters: Vec<(String, f64)>,
    /// Name of the material of each surface.
    pub materials: Vec<String>,
    /// Closed meshes, one material each.
    pub surfaces: Vec<Surface>,
}

/// Names of the generators.
pub fn generators() -> Vec<&'static str> {
    GENERATORS.iter().map(|g| g.0).collect()
}

/// Centre and radius of a ball around all points, within about one percent of the smallest one.
pub fn enclosing_ball(points: &[[f64; 3]]) -> ([f64; 3], f64) {
    soup::ball(points.iter())
}

/// Object k of a seed, with a total of 512² texels of textures.
pub fn make(seed: u64, k: u64) -> Vec<Surface> {
    build(seed, k, 512).surfaces
}

/// Object k of a seed; its surfaces share about `size`² texels. Shapes do not depend on `size`.
///
/// The first 19 objects of every seed use each generator once, in order; later objects draw their generators.
pub fn build(seed: u64, k: u64, size: usize) -> Made {
    let mut draws = Draws::new(seed, k, 0, purpose::SHAPE);
    let weights = GENERATORS.map(|g| g.1);
    let drawn = draws.weighted(&weights);
    let which = usize::try_from(k).ok().filter(|&k| k < GENERATORS.len()).unwrap_or(drawn);
    build_with(which, draws, seed, k, size)
}

/// An object of a given generator (an index into [`generators`]), drawn as object k of a seed.
pub fn build_by(which: usize, seed: u64, k: u64, size: usize) -> Made {
    let mut draws = Draws::new(seed, k, 0, purpose::SHAPE);
    draws.unit();
    build_with(which, draws, seed, k, size)
}

fn build_with(which: usize, mut draws: Draws, seed: u64, k: u64, size: usize) -> Made {
    let (generator, _, shape) = GENERATORS[which];
    let mut parts = shape(&mut draws);
    place(&mut parts, &mut Draws::new(seed, k, 0, purpose::POSE));
    // Texels in proportion to area, but at least a sixteenth for a small part.
    let areas: Vec<f64> = parts.iter().map(|p| p.soup.area()).collect();
    let total = areas.iter().fold(0.0, |s, a| s + a);
    let mut surfaces = Vec::new();
    for (part, area) in parts.iter().zip(&areas) {
        let share = crate::space::larger((area / total).sqrt(), 0.25);
        let side = ((size as f64 * share) as usize).max(32);
        let mut shell = part.soup.shell(part.crease_cos);
        let atlas = atlas::pack(&shell, side);
        let material = paint::paint(&shell, &atlas, seed, k, part.group as u32, part.wish);
        surfaces.push(Surface {
            positions: std::mem::take(&mut shell.positions),
            normals: std::mem::take(&mut shell.normals),
            uvs: atlas.uvs,
            triangles: shell.triangles,
            material,
        });
    }
    let materials = surfaces.iter().map(|s| s.material.name.clone()).collect();
    Made { generator, parameters: draws.parameters(), materials, surfaces }
}

/// Rotates the object, in two of three cases only about the vertical, and scales it to the ball of radius ½
/// around the origin.
fn place(parts: &mut [Part], draws: &mut Draws) {
    let (center, radius) = soup::ball(parts.iter().flat_map(|p| &p.soup.points));
    let yaw = rotation([0.0, 0.0, 1.0], draws.range(0.0, TAU));
    let axis = draws.direction();
    let angle = draws.range(0.0, TAU);
    let tilt = rotation(axis, if draws.chance(1.0 / 3.0) { angle } else { 0.0 });
    for part in parts {
        let soup = std::mem::take(&mut part.soup);
        part.soup = soup.map(|p| rotated(&tilt, rotated(&yaw, sub(p, center)))).grown(RADIUS / radius);
    }
}
