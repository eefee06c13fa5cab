//! Closed textured surfaces around the skeleton: body, head, hair, shirt, skirt or trousers, shoes.
//!
//! Every part is a closed tube through ellipses, skinned with the weights of [`super::skeleton::weights`] at
//! its rest positions, which are those of the template. Cloth is displaced across its tube (both sides of a
//! hem together) by the wrinkles of [`super::factors::Drive::wrinkles`] and by two finer waves, all of them
//! proportional to u_W; on sleeves and trouser legs they run around the part's own axis and are weaker.
//! Posture moves cloth only by skinning. A fold depends on the rest position. If folds and width would move a
//! vertex inwards by more than [`INWARDS`] of the smallest radius of curvature of its ellipse, the
//! displacement is limited to that value, so that no tube turns inside out. A skirt, and a shirt over
//! trousers, cover another surface: inwards they move by at most [`CLOSEST`] of the distance to it at rest
//! under the same width and length. Vertices moved by the length of a garment use the skinning weights of the
//! height to which they are moved, so that they bend like the surface below.

use super::appearance::{Appearance, Bottom};
use super::factors::{Drive, WRINKLE};
use super::loft::{Shell, normals};
use super::skeleton::{BONES, Bone, METRES, V3, add, bones, framed, metric, pose, scale, weights};
use super::{garments, texture};
use crate::surface::{Material, Surface};
use reference::body::skin;
use reference::num::elem::sin;
use std::f64::consts::TAU;

/// Amplitudes of the finer folds at u_W = 1, in the figure frame.
pub const FINE_FOLDS: [f64; 2] = [0.008, 0.005];

/// Largest inward displacement of vertices, as a fraction of the radius of curvature.
pub const INWARDS: f64 = 0.8;

/// Largest inward displacement of cloth, as a fraction of the distance to the surface below; the remaining
/// distance keeps its two sides apart.
pub const CLOSEST: f64 = 0.9;

/// Number of steps that move cloth outside of the surface below.
const OUTWARD_STEPS: usize = 4;

/// Scale of folds around limbs.
pub(super) const OWN_FOLDS: f64 = 0.25;

/// Sum of the amplitudes of all folds at u_W = 1.
pub(super) const WRINKLES: f64 = WRINKLE + FINE_FOLDS[0] + FINE_FOLDS[1];

/// The surface under cloth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Under {
    /// Bare legs.
    Legs,
    /// Hips and legs in trousers.
    Trousers,
}

impl Under {
    /// Distance of a position from the surface under the factors, metres; negative inside.
    fn room(self, place: V3, drive: &Drive) -> f64 {
        match self {
            Self::Legs => garments::above_legs(place, drive),
            Self::Trousers => garments::above_trousers(place, drive),
        }
    }
}

/// The coordinates on which the folds of a part depend.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Folds {
    /// The part has no folds.
    None,
    /// Height and azimuth about the axis of the body.
    Body,
    /// Length along and turn around the part's own axis; the amplitude is scaled by this factor.
    Own(f64),
}

/// One closed surface at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Name of the part.
    pub name: &'static str,
    /// Positions in the figure frame, shape (V).
    pub positions: Vec<V3>,
    /// Unit normals, shape (V).
    pub normals: Vec<V3>,
    /// Texture coordinates, shape (V).
    pub uvs: Vec<[f64; 2]>,
    /// Triangles, counter-clockwise seen from outside, shape (T).
    pub triangles: Vec<[u32; 3]>,
    /// Index of the first vertex at the same position, shape (V).
    pub weld: Vec<u32>,
    /// Skinning weights, shape (V, K).
    pub weights: Vec<[f64; BONES]>,
    /// Index of the material.
    pub material: usize,
    folds: Folds,
    /// Unit direction of the folds, away from the part's axis, shape (V).
    outward: Vec<V3>,
    /// Scale of the folds, shape (V).
    slack: Vec<f64>,
    /// Length along and turn around the part's own axis, for its folds, shape (V).
    around_along: Vec<[f64; 2]>,
    /// Displacement at u_B = 1.
    width: f64,
    /// Smallest radius of the ellipse, and its smallest radius of curvature, shape (V).
    radii: Vec<[f64; 2]>,
    /// Height below which the length of the skirt moves the part.
    rim: Option<f64>,
    /// The surface that the part covers.
    under: Option<Under>,
    /// Whether a vertex is outside of that surface at rest, shape (V); vertices on the inner side of a hem
    /// need not be.
    covers: Vec<bool>,
}

/// A person at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Closed surfaces, which overlap.
    pub parts: Vec<Part>,
    appearance: Appearance,
}

/// Vertices of one part in one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct PosedPart {
    /// Positions in the figure frame, shape (V).
    pub positions: Vec<V3>,
    /// Unit normals, shape (V).
    pub normals: Vec<V3>,
}

/// Description of a part to be created.
pub(super) struct Piece {
    pub(super) name: &'static str,
    pub(super) shell: Shell,
    pub(super) material: usize,
    pub(super) folds: Folds,
    /// Scale of the folds as a function of the rest position in metres.
    pub(super) slack: fn(V3) -> f64,
    /// Displacement at u_B = 1.
    pub(super) width: f64,
    /// Height in metres below which the length of the skirt moves the part.
    pub(super) rim: Option<f64>,
    /// The surface that the part covers.
    pub(super) under: Option<Under>,
    /// Texture coordinates as a function of turn around, length along, and rest position in metres.
    pub(super) uv: fn([f64; 2], V3) -> [f64; 2],
}

impl Part {
    fn new(piece: Piece) -> Self {
        let Piece { name, shell, material, folds, slack, width, rim, under, uv } = piece;
        let rest = Drive::new(&[]);
        let positions: Vec<V3> = shell.positions.iter().map(|&p| framed(p)).collect();
        let bones = bones();
        Self {
            name,
            normals: normals(&positions, &shell.triangles, &shell.weld),
            uvs: shell.around_along.iter().zip(&shell.positions).map(|(&al, &p)| uv(al, p)).collect(),
            weights: positions.iter().map(|&x| weights(&bones, x)).collect(),
            slack: shell.positions.iter().map(|&p| slack(p)).collect(),
            positions,
            triangles: shell.triangles,
            weld: shell.weld,
            material,
            folds,
            outward: shell.outward,
            around_along: shell.around_along,
            width,
            radii: (shell.halves.iter())
                .map(|&[a, b]| [a / METRES, if b > 0.0 { a * a / b / METRES } else { 0.0 }])
                .collect(),
            rim: rim.map(|z| framed([0.0, 0.0, z])[2]),
            covers: shell
                .positions
                .iter()
                .map(|&p| under.is_some_and(|under| under.room(p, &rest) > 0.0))
                .collect(),
            under,
        }
    }

    /// Displacement by the folds at a vertex.
    fn fold(&self, v: usize, drive: &Drive, phases: [f64; 2]) -> f64 {
        let (share, x) = (self.slack[v], self.positions[v]);
        if drive.wrinkle == 0.0 || share == 0.0 {
            return 0.0;
        }
        let fine = |height: f64, azimuth: f64| {
            drive.wrinkle
                * (FINE_FOLDS[0] * sin(29.0 * height + 5.0 * azimuth + phases[0])
                    + FINE_FOLDS[1] * sin(47.0 * height - 8.0 * azimuth + phases[1]))
        };
        share
            * match self.folds {
                Folds::None => 0.0,
                Folds::Body => {
                    let azimuth = reference::scalar::Scalar::atan2(x[1], x[0]);
                    drive.wrinkles(x).0 + fine(x[2], azimuth)
                }
                Folds::Own(weaker) => {
                    let [turn, length] = self.around_along[self.weld[v] as usize];
                    let (height, azimuth) = (length / METRES, TAU * turn);
                    weaker
                        * (WRINKLE * drive.wrinkle * sin(12.0 * height + 3.0 * azimuth)
                            + fine(height, azimuth))
                }
            }
    }

    /// A vertex at rest, moved by the length of the skirt.
    fn hung(&self, v: usize, drive: &Drive) -> V3 {
        let mut x = self.positions[v];
        if let Some(rim) = self.rim {
            x[2] = drive.skirt_height(rim, x[2]);
        }
        x
    }

    /// Canonical position of a vertex under the factors, before skinning.
    fn canonical(&self, v: usize, drive: &Drive, phases: [f64; 2]) -> V3 {
        let x = self.hung(v, drive);
        let [radius, curvature] = self.radii[v];
        let moved = drive.girth(self.width, radius) + self.fold(v, drive, phases);
        let least = -INWARDS * curvature;
        let mut moved = if moved < least { least } else { moved };
        let at = |moved: f64| add(x, scale(self.outward[v], moved));
        if let Some(under) = self.under.filter(|_| self.covers[v]) {
            let room = |moved: f64| under.room(metric(at(moved)), drive) / METRES;
            let least = -CLOSEST * room(0.0);
            moved = if moved < least { least } else { moved };
            // The outward direction is not exactly the direction of the shortest distance.
            for _ in 0..OUTWARD_STEPS {
                let left = room(moved);
                moved = if left < 0.0 { moved - left } else { moved };
            }
        }
        at(moved)
    }

    fn posed(
        &self,
        drive: &Drive,
        bones: &[Bone; BONES],
        transforms: &[skin::Affine<f64>; BONES],
        phases: [f64; 2],
    ) -> PosedPart {
        let is_moved =
            |v: usize| self.rim.is_some_and(|rim| self.positions[v][2] < rim) && drive.skirt != 1.0;
        let positions: Vec<V3> = (0..self.positions.len())
            .map(|v| {
                let x = self.canonical(v, drive, phases);
                let held = if is_moved(v) { weights(bones, self.hung(v, drive)) } else { self.weights[v] };
                skin::point(&skin::blend(&held, transforms), x)
            })
            .collect();
        let normals = normals(&positions, &self.triangles, &self.weld);
        PosedPart { positions, normals }
    }
}

impl Figure {
    /// The person with an appearance.
    pub fn new(appearance: &Appearance) -> Self {
        let mut pieces = garments::body(appearance);
        pieces.extend(garments::shirt(appearance));
        match appearance.bottom {
            Bottom::Skirt => pieces.extend(garments::skirt()),
            Bottom::Trousers => pieces.extend(garments::trousers()),
        }
        Self { parts: pieces.into_iter().map(Part::new).collect(), appearance: appearance.clone() }
    }

    /// Vertices of every part under the factors.
    pub fn posed(&self, drive: &Drive) -> Vec<PosedPart> {
        let bones = bones();
        let transforms = pose(&bones, drive);
        let phases = self.appearance.fold_phases;
        self.parts.iter().map(|part| part.posed(drive, &bones, &transforms, phases)).collect()
    }

    /// The materials, with cloth colours rotated by the hue of the factors.
    pub fn materials(&self, drive: &Drive) -> Vec<Material> {
        texture::materials(&self.appearance, drive.hue)
    }

    /// The materials in [`Self::materials`] that the hue of the factors changes, with their indices.
    pub fn dyed(&self, drive: &Drive) -> Vec<(usize, Material)> {
        texture::dyed(&self.appearance, drive.hue)
    }

    /// Every part as a separate surface.
    pub fn surfaces(&self, drive: &Drive) -> Vec<Surface> {
        let materials = self.materials(drive);
        let posed = self.posed(drive);
        self.parts
            .iter()
            .zip(posed)
            .map(|(part, posed)| Surface {
                positions: posed.positions,
                normals: posed.normals,
                uvs: part.uvs.clone(),
                triangles: part.triangles.clone(),
                material: materials[part.material].clone(),
            })
            .collect()
    }
}

/// Linear interpolation at a height between rows sorted by ascending heights, which are their first entries.
pub(super) fn section<const K: usize>(rows: &[[f64; K]], z: f64) -> [f64; K] {
    let last = rows.len() - 1;
    if z <= rows[0][0] {
        return rows[0];
    }
    match rows.windows(2).find(|k| z <= k[1][0]) {
        None => rows[last],
        Some(k) => {
            let t = (z - k[0][0]) / (k[1][0] - k[0][0]);
            std::array::from_fn(|i| k[0][i] + t * (k[1][i] - k[0][i]))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::skeleton::{dot, sub};

    /// Turn, length and canonical position of the vertices of a ring of every part, ring by ring.
    fn worst(u: &[f64]) -> f64 {
        let drive = Drive::new(u);
        let mut worst = f64::INFINITY;
        for index in 0..12 {
            let look = Appearance::new(9, index);
            for part in &Figure::new(&look).parts {
                for v in 1..part.positions.len() {
                    // Hair is positioned vertex by vertex and never moves; poles are on no ring.
                    let same_ring = part.around_along[v][1] == part.around_along[v - 1][1];
                    let rest = sub(part.positions[v], part.positions[v - 1]);
                    if !same_ring || part.radii[v][0] == 0.0 || dot(rest, rest) == 0.0 {
                        continue;
                    }
                    let [a, b] = [v - 1, v].map(|v| part.canonical(v, &drive, look.fold_phases));
                    let ratio = dot(sub(b, a), rest) / dot(rest, rest);
                    worst = if ratio < worst { ratio } else { worst };
                }
            }
        }
        worst
    }

    #[test]
    fn cloth_lies_outside_of_what_it_covers() {
        let (mut checked, mut worst) = (0, f64::INFINITY);
        for wrinkle in [-2.5, 0.0, 2.5] {
            for [width, length] in
                [[-2.5, -2.5], [-2.5, 2.5], [2.5, -2.5], [2.5, 2.5], [0.0, 0.0], [0.0, 2.5]]
            {
                let drive = Drive::new(&[0.0, 0.0, wrinkle, 0.0, width, length]);
                for index in 0..4 {
                    let look = Appearance::new(9, index);
                    for part in &Figure::new(&look).parts {
                        let Some(under) = part.under else { continue };
                        for v in (0..part.positions.len()).filter(|&v| part.covers[v]) {
                            let left =
                                under.room(metric(part.canonical(v, &drive, look.fold_phases)), &drive);
                            worst = if left < worst { left } else { worst };
                            checked += 1;
                        }
                    }
                }
            }
        }
        println!("{checked} vertices, the lowest {:.2} mm above what it covers", 1e3 * worst);
        assert!(checked > 100_000, "too few vertices: {checked}");
        // The distance between the outlines is 3 mm.
        assert!(worst > -0.001, "a vertex is {worst} m inside of what it covers");
    }

    #[test]
    fn no_ring_turns_inside_out() {
        for wrinkle in [-3.0, -1.0, 0.0, 1.0, 3.0] {
            for width in [-2.0, 0.0, 2.0] {
                let worst = worst(&[0.0, 0.0, wrinkle, 0.0, width]);
                println!("u_W {wrinkle}, u_B {width}: shortest edge {worst:.3} of its length at rest");
                assert!(worst > 0.0, "u_W {wrinkle}, u_B {width}: an edge is {worst} of itself at rest");
            }
        }
    }
}
