//! Closed textured surfaces over the skeleton: body, head, hair, shirt, skirt or trousers, shoes.
//!
//! Every part is a closed tube through ellipses, skinned by the weights of [`super::skeleton::weights`] at its rest positions, those
//! of the template. Cloth is displaced across its tube (both sides of a hem together) by the wrinkles of [`super::factors::Drive::wrinkles`] and by two
//! finer waves, all of them proportional to u_W; sleeves and trouser legs take them around their own axis and weaker. Posture
//! moves cloth by skinning alone.

use super::appearance::{Appearance, Bottom};
use super::factors::{Drive, WRINKLE};
use super::loft::{Ring, Shell, normals};
use super::skeleton::{BONES, METRES, SKIRT, V3, add, bones, framed, pose, scale, weights};
use super::{garments, texture};
use crate::surface::{Material, Surface};
use reference::body::skin;
use reference::num::elem::sin;
use std::f64::consts::TAU;

/// Amplitudes of the finer folds at u_W = 1, in the figure's frame.
pub const FINE_FOLDS: [f64; 2] = [0.008, 0.005];

/// Where a part gets its folds from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Folds {
    /// none
    None,
    /// height and azimuth about the body's axis
    Body,
    /// length along and turn around the part's own axis, weaker by the factor
    Own(f64),
}

/// One closed surface at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Its name.
    pub name: &'static str,
    /// (V) in the figure's frame
    pub positions: Vec<V3>,
    /// (V) unit
    pub normals: Vec<V3>,
    /// (V)
    pub uvs: Vec<[f64; 2]>,
    /// (T) counter-clockwise from outside
    pub triangles: Vec<[u32; 3]>,
    /// (V) the first vertex at the same place
    pub weld: Vec<u32>,
    /// (V, K) skinning weights
    pub weights: Vec<[f64; BONES]>,
    /// Index into the materials.
    pub material: usize,
    folds: Folds,
    /// (V) unit direction of the folds, away from the part's axis
    outward: Vec<V3>,
    /// (V) share of the folds
    slack: Vec<f64>,
    /// (V) length along and turn around, for folds about the own axis
    around_along: Vec<[f64; 2]>,
    /// Displacement at u_B = 1.
    width: f64,
    /// Whether the skirt's length moves it.
    is_skirt: bool,
}

/// A person at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Closed surfaces; they overlap.
    pub parts: Vec<Part>,
    appearance: Appearance,
}

/// Vertices of one part in one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct PosedPart {
    /// (V) in the figure's frame
    pub positions: Vec<V3>,
    /// (V) unit
    pub normals: Vec<V3>,
}

/// What a maker of parts says about one.
pub(super) struct Piece {
    pub(super) name: &'static str,
    pub(super) shell: Shell,
    pub(super) material: usize,
    pub(super) folds: Folds,
    /// Share of the folds at a rest position in metres.
    pub(super) slack: fn(V3) -> f64,
    pub(super) is_trunk: bool,
    pub(super) is_skirt: bool,
    /// Texture coordinates from turn around, length along, rest position in metres.
    pub(super) uv: fn([f64; 2], V3) -> [f64; 2],
}

impl Part {
    fn new(piece: Piece) -> Self {
        let Piece { name, shell, material, folds, slack, is_trunk, is_skirt, uv } = piece;
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
            width: if is_trunk { 0.02 } else { 0.006 },
            is_skirt,
        }
    }

    /// Displacement of the folds at a vertex whose canonical position is x.
    fn fold(&self, v: usize, x: V3, drive: &Drive, phases: [f64; 2]) -> f64 {
        let share = self.slack[v];
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

    fn posed(&self, drive: &Drive, transforms: &[skin::Affine<f64>; BONES], phases: [f64; 2]) -> PosedPart {
        let positions: Vec<V3> = (0..self.positions.len())
            .map(|v| {
                let mut x = self.positions[v];
                if self.is_skirt {
                    x[2] = drive.skirt_height(framed([0.0, 0.0, SKIRT[0][0]])[2], x[2]);
                }
                let moved = drive.width * self.width + self.fold(v, x, drive, phases);
                let x = add(x, scale(self.outward[v], moved));
                skin::point(&skin::blend(&self.weights[v], transforms), x)
            })
            .collect();
        let normals = normals(&positions, &self.triangles, &self.weld);
        PosedPart { positions, normals }
    }
}

impl Figure {
    /// The person of a look.
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
        let transforms = pose(&bones(), drive);
        self.parts.iter().map(|part| part.posed(drive, &transforms, self.appearance.fold_phases)).collect()
    }

    /// The materials, their cloth dyed by the hue of the factors.
    pub fn materials(&self, drive: &Drive) -> Vec<Material> {
        texture::materials(&self.appearance, drive.hue)
    }

    /// Every part as a surface of its own.
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

/// Linear interpolation between the ring keys of a head, for what lies on it: half axes and centre at a height.
pub(super) fn section(keys: &[Ring], z: f64) -> [f64; 3] {
    let value = |r: &Ring| [r.half[0], r.half[1], r.center[1]];
    let last = keys.len() - 1;
    if z <= keys[0].center[2] {
        return value(&keys[0]);
    }
    match keys.windows(2).find(|k| z <= k[1].center[2]) {
        None => value(&keys[last]),
        Some(k) => {
            let t = (z - k[0].center[2]) / (k[1].center[2] - k[0].center[2]);
            let (a, b) = (value(&k[0]), value(&k[1]));
            std::array::from_fn(|i| a[i] + t * (b[i] - a[i]))
        }
    }
}
