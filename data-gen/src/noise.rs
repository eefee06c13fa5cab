//! Smooth noise over space: gradients on a lattice, selected by a permutation that is drawn once (after
//! Perlin 2002).

use crate::draws::Draws;
use crate::space::V3;

/// A noise field.
#[derive(Clone, Debug)]
pub(crate) struct Noise {
    table: [u8; 512],
}

/// Directions to the edges of a cube, four of them twice.
const GRADIENTS: [V3; 16] = [
    [1.0, 1.0, 0.0],
    [-1.0, 1.0, 0.0],
    [1.0, -1.0, 0.0],
    [-1.0, -1.0, 0.0],
    [1.0, 0.0, 1.0],
    [-1.0, 0.0, 1.0],
    [1.0, 0.0, -1.0],
    [-1.0, 0.0, -1.0],
    [0.0, 1.0, 1.0],
    [0.0, -1.0, 1.0],
    [0.0, 1.0, -1.0],
    [0.0, -1.0, -1.0],
    [1.0, 1.0, 0.0],
    [-1.0, 1.0, 0.0],
    [0.0, -1.0, 1.0],
    [0.0, -1.0, -1.0],
];

impl Noise {
    /// Creates a field from 255 draws.
    pub(crate) fn new(draws: &mut Draws) -> Self {
        let mut order: [u8; 256] = std::array::from_fn(|i| i as u8);
        for i in (1..256).rev() {
            let j = draws.whole(0, i + 1);
            order.swap(i, j);
        }
        Self { table: std::array::from_fn(|i| order[i & 255]) }
    }

    /// A value of the lattice cell, 0..256, uncorrelated with those of its neighbours.
    pub(crate) fn cell(&self, x: i64, y: i64, z: i64) -> u8 {
        let t = |i: usize| usize::from(self.table[i]);
        let [x, y, z] = [x, y, z].map(|k| (k & 255) as usize);
        self.table[t(t(x) + y) + z]
    }

    /// Values of about −1..1, zero at integer lattice points, period 256.
    pub(crate) fn at(&self, p: V3) -> f64 {
        let low = p.map(f64::floor);
        let f = [p[0] - low[0], p[1] - low[1], p[2] - low[2]];
        let [x, y, z] = low.map(|k| (k as i64 & 255) as usize);
        let t = |i: usize| usize::from(self.table[i]);
        let fade = f.map(|t| t * t * t * (t * (t * 6.0 - 15.0) + 10.0));
        let corner = |dx: usize, dy: usize, dz: usize| {
            let g = GRADIENTS[t(t(t((x + dx) & 255) + ((y + dy) & 255)) + ((z + dz) & 255)) & 15];
            g[0] * (f[0] - dx as f64) + g[1] * (f[1] - dy as f64) + g[2] * (f[2] - dz as f64)
        };
        let along = |a: f64, b: f64, t: f64| a + t * (b - a);
        let face = |dz: usize| {
            let a = along(corner(0, 0, dz), corner(1, 0, dz), fade[0]);
            let b = along(corner(0, 1, dz), corner(1, 1, dz), fade[0]);
            along(a, b, fade[1])
        };
        along(face(0), face(1), fade[2])
    }

    /// Sum of n octaves, each with half the wavelength and half the amplitude of the previous one, in about
    /// −1..1.
    pub(crate) fn octaves(&self, p: V3, n: usize) -> f64 {
        let (mut sum, mut height, mut total) = (0.0, 1.0, 0.0);
        let mut q = p;
        for _ in 0..n {
            sum += height * self.at(q);
            total += height;
            height *= 0.5;
            // An offset, so that the zeros of the lattices do not coincide.
            q = q.map(|x| 2.0 * x + 19.19);
        }
        sum / total
    }
}
