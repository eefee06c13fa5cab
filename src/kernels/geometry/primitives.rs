//! The primitives of a tree: triangles with an area, and groups of triangles at one place, which are found by
//! sorting and never by comparing pairs.
//!
//! A tree over boxes with one centre is proposed in quadratic time, because every merge costs the same and only
//! one pair of boxes agrees to merge per round. Triangles with one centre therefore become one primitive of the
//! proposed tree, and other boxes are made uneven. Of triangles with equal corners, only the first is kept: all
//! of them are hit at the same t, and the lowest index wins.

use super::triangle::{bounds, is_degenerate};
use crate::num::order::{max, min};
use crate::num::par;
use obvhs::aabb::Aabb;

/// Up to this number, triangles with one centre remain primitives of their own.
const FEW: usize = 8;
const CHUNK: usize = 16_384;

type Corners = [[f32; 3]; 3];
/// Lower and upper corner of a box.
pub(super) type Box3 = [[f32; 3]; 2];
/// The box of no triangle.
pub(super) const NOTHING: Box3 = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];

/// Returns the smallest box around both.
pub(super) fn union(a: Box3, b: Box3) -> Box3 {
    [[0, 1, 2].map(|k| min(a[0][k], b[0][k])), [0, 1, 2].map(|k| max(a[1][k], b[1][k]))]
}

/// Returns twice the centre of the triangle's box, as bits; the two zeros have the same bits.
fn centre(t: Corners) -> [u32; 3] {
    let [lo, hi] = bounds(t);
    [0, 1, 2].map(|k| (lo[k] + hi[k] + 0.0).to_bits())
}

/// Mixes the bits of a centre; the highest bits select a counter.
fn hash([a, b, c]: [u32; 3]) -> u64 {
    let mix = |x: u64| (x ^ (x >> 32)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    mix(mix(mix(u64::from(a) | u64::from(b) << 32)) ^ u64::from(c))
}

/// The order of triangles at one place: by the surface of the box, then by corners, then by index.
fn key(t: Corners) -> ([u32; 3], u32, [[u32; 3]; 3]) {
    let [lo, hi] = bounds(t);
    let [x, y, z] = [0, 1, 2].map(|k| hi[k] - lo[k]);
    (centre(t), (x * y + y * z + z * x).to_bits(), t.map(|p| p.map(f32::to_bits)))
}

/// Returns the triangles whose centre may be that of more than [`FEW`] triangles; a few others are among them.
fn crowded(corners: &[Corners]) -> Vec<u32> {
    if corners.len() <= FEW {
        return Vec::new();
    }
    let bits = (2 * corners.len()).next_power_of_two().trailing_zeros();
    let mut slots = vec![0_u32; corners.len()];
    par::chunks_mut(&mut slots, CHUNK, |c, out| {
        for (slot, &t) in out.iter_mut().zip(&corners[c * CHUNK..]) {
            *slot = (hash(centre(t)) >> (64 - bits)) as u32;
        }
    });
    let mut counts = vec![0_u8; 1 << bits];
    for &slot in &slots {
        let count = &mut counts[slot as usize];
        *count = count.saturating_add(1);
    }
    (0..corners.len() as u32).filter(|&i| counts[slots[i as usize] as usize] as usize > FEW).collect()
}

/// Removes copies, and moves triangles with one centre to the end if there are more than [`FEW`]. Returns the
/// first triangle and the number of triangles of each such group.
fn gather(corners: &mut Vec<Corners>, index: &mut Vec<u32>) -> Vec<(u32, u32)> {
    let mut crowd = crowded(corners);
    if crowd.is_empty() {
        return Vec::new();
    }
    crowd.sort_by_cached_key(|&i| (key(corners[i as usize]), i));
    let mut moved = vec![false; corners.len()];
    crowd.iter().for_each(|&i| moved[i as usize] = true);
    crowd.dedup_by(|i, first| key(corners[*i as usize]).2 == key(corners[*first as usize]).2);
    let (mut grouped, mut groups) = (Vec::with_capacity(crowd.len()), Vec::new());
    for run in crowd.chunk_by(|&a, &b| centre(corners[a as usize]) == centre(corners[b as usize])) {
        if run.len() > FEW {
            groups.push((grouped.len() as u32, run.len() as u32));
            grouped.extend_from_slice(run);
        } else {
            run.iter().for_each(|&i| moved[i as usize] = false);
        }
    }
    let order: Vec<u32> = (0..corners.len() as u32).filter(|&i| !moved[i as usize]).chain(grouped).collect();
    let singles = order.len() - groups.iter().fold(0, |n, g| n + g.1 as usize);
    groups.iter_mut().for_each(|g| g.0 += singles as u32);
    *corners = order.iter().map(|&i| corners[i as usize]).collect();
    *index = order.iter().map(|&i| index[i as usize]).collect();
    groups
}

/// Triangles with non-zero area, in scaled coordinates, without those that no query returns because an equal
/// one comes before them.
pub(super) struct Triangles {
    pub(super) corners: Vec<[[f32; 3]; 3]>,
    pub(super) index: Vec<u32>,
    /// First triangle and number of triangles of each group with one centre; groups come after all others.
    groups: Vec<(u32, u32)>,
}

impl Triangles {
    pub(super) fn new(positions: &[[f32; 3]], triangles: &[[u32; 3]], scale: f32) -> Self {
        let parts = par::map(triangles.len().div_ceil(CHUNK), |c| {
            let mut kept = Vec::with_capacity(CHUNK);
            for i in c * CHUNK..Ord::min((c + 1) * CHUNK, triangles.len()) {
                let corners = triangles[i].map(|v| positions[v as usize].map(|x| x * scale));
                if !is_degenerate(corners) {
                    kept.push((corners, i as u32));
                }
            }
            kept
        });
        let n = parts.iter().fold(0, |n, part| n + part.len());
        let (mut corners, mut index) = (Vec::with_capacity(n), Vec::with_capacity(n));
        for (c, i) in parts.into_iter().flatten() {
            corners.push(c);
            index.push(i);
        }
        let groups = gather(&mut corners, &mut index);
        Self { corners, index, groups }
    }

    /// Number of triangles that are primitives of their own.
    fn singles(&self) -> usize {
        self.groups.first().map_or(self.corners.len(), |g| g.0 as usize)
    }

    /// Returns the triangles of a primitive.
    pub(super) fn members(&self, primitive: u32) -> std::ops::Range<u32> {
        match (primitive as usize).checked_sub(self.singles()) {
            Some(group) => self.groups[group].0..self.groups[group].0 + self.groups[group].1,
            None => primitive..primitive + 1,
        }
    }

    /// Returns the boxes from which the tree is proposed.
    pub(super) fn boxes(&self) -> Vec<Aabb> {
        let singles = self.singles();
        let mut boxes = vec![Aabb::default(); singles + self.groups.len()];
        par::chunks_mut(&mut boxes[..singles], CHUNK, |c, out| {
            for (i, (b, &t)) in out.iter_mut().zip(&self.corners[c * CHUNK..]).enumerate() {
                *b = uneven(bounds(t), c * CHUNK + i);
            }
        });
        for (i, b) in boxes[singles..].iter_mut().enumerate() {
            let all = self.members((singles + i) as u32);
            *b = uneven(all.fold(NOTHING, |b, t| union(b, bounds(self.corners[t as usize]))), singles + i);
        }
        boxes
    }
}

/// Enlarges a box by up to 2⁻¹⁰ of its size, or a few units in the last place, depending on its number. In a row
/// of equal boxes every merge would otherwise cost the same, and building the tree would take quadratic time.
fn uneven([lo, hi]: Box3, number: usize) -> Aabb {
    let size = (0..3).fold(0.0, |m, k| max(m, hi[k] - lo[k]));
    let mut bits = (number as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mut by = |at: f32| {
        bits = (bits ^ (bits >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        max(size * (1.0 / 1_024.0), at.abs() * (1.0 / 1_048_576.0)) * ((bits >> 40) as f32 / 16_777_216.0)
    };
    let (lo, hi) = (lo.map(|x| x - by(x)), hi.map(|x| x + by(x)));
    Aabb::new(lo.into(), hi.into())
}
