//! A grid of bits over the box [−R, R]³.
//!
//! The box has n cells per axis, n even. A cell is found from the coordinates one by one, with p = x/R:
//!
//! a = ⌊|p|·n/2⌋ limited to 0..n/2−1,   i = n/2 + a for p > 0,   n/2 − 1 − a for p ≤ 0
//!
//! so that both zeros belong to the lower side and no cell has parts on two sides of a centre plane. i is
//! monotone in x; points outside the box belong to cells of the border.
//!
//! # Layout
//! Bricks of 8³ cells, the last one of each axis padded with zeros: a brick is eight words, one per x; bit
//! 8·y + z of a word is one cell.
//!
//! # Rounding
//! p and |p|·n/2 are rounded once each. [`BitGrid::edges`] returns a box that contains every number whose cell
//! lies in a range: an end is moved outward by 2⁻¹⁶ of its distance from the centre, which is more than the
//! roundings of p, of |p|·n/2 and of the end itself, and covers points that left the box by rounding. An end at
//! the centre is exact.

use super::primitives::Box3;
use crate::{Error, Result};

/// Cells per axis of a brick.
pub const BRICK: usize = 8;
/// Largest number of cells per axis.
const LARGEST: usize = 1024;
/// Relative distance by which an end of a range of cells is moved outward.
const OUTWARD: f32 = 1.0 / 65_536.0;

/// A bit per cell.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BitGrid {
    side: usize,
    /// Bits of R.
    half_size: u32,
    /// Bricks per axis.
    bricks: usize,
    words: Vec<u64>,
}

impl BitGrid {
    /// Returns a grid of zeros with `side` cells per axis.
    ///
    /// # Errors
    /// Returns an error if `side` is odd or not in 2..=1024, or R is not positive.
    pub fn new(side: usize, half_size: f32) -> Result<Self> {
        if !(2..=LARGEST).contains(&side) || !side.is_multiple_of(2) {
            let e = Error::input("grid").expected(format!("an even number of cells from 2 to {LARGEST}"));
            return Err(e.got(side.to_string()));
        }
        if !(half_size.is_normal() && half_size > 0.0) {
            return Err(Error::input("grid").expected("a positive half size").got(half_size.to_string()));
        }
        let bricks = side.div_ceil(BRICK);
        let words = vec![0; bricks * bricks * bricks * BRICK];
        Ok(Self { side, half_size: half_size.to_bits(), bricks, words })
    }

    /// Number of cells per axis n.
    pub fn side(&self) -> usize {
        self.side
    }

    /// Half size R of the box.
    pub fn half_size(&self) -> f32 {
        f32::from_bits(self.half_size)
    }

    /// Returns the cell of a point.
    #[inline(always)]
    pub fn cell(&self, point: [f32; 3]) -> [usize; 3] {
        let (half, half_size) = (self.side / 2, self.half_size());
        point.map(|x| {
            let p = x / half_size;
            // The conversion is the floor, and limits: the number is not negative.
            let a = Ord::min((p.abs() * half as f32) as usize, half - 1);
            if p > 0.0 { half + a } else { half - 1 - a }
        })
    }

    /// Returns the middle of a cell: R·(2i + 1 − n)/n.
    pub fn centre(&self, cell: [usize; 3]) -> [f32; 3] {
        let n = self.side as f32;
        cell.map(|i| self.half_size() * (((2 * i + 1) as f32 - n) / n))
    }

    /// Returns a box that contains all points of the cells `from` to `to`, the latter excluded.
    pub fn edges(&self, from: [usize; 3], to: [usize; 3]) -> Box3 {
        let half = (self.side / 2) as f32;
        let at = |i: usize, outward: f32| {
            let q = (i as f32 - half) / half;
            self.half_size() * q * (1.0 + if q > 0.0 { outward } else { -outward })
        };
        [from.map(|i| at(i, -OUTWARD)), to.map(|i| at(i, OUTWARD))]
    }

    #[inline(always)]
    fn place(&self, [x, y, z]: [usize; 3]) -> (usize, u32) {
        let brick = ((x / BRICK) * self.bricks + y / BRICK) * self.bricks + z / BRICK;
        (brick * BRICK + x % BRICK, (BRICK * (y % BRICK) + z % BRICK) as u32)
    }

    /// Returns the bit of a cell.
    #[inline(always)]
    pub fn is_set(&self, cell: [usize; 3]) -> bool {
        let (word, bit) = self.place(cell);
        self.words[word] >> bit & 1 == 1
    }

    /// Whether a bit of the cells from `low` to `high`, both included, is set.
    #[inline(always)]
    pub fn is_any_set(&self, low: [usize; 3], high: [usize; 3]) -> bool {
        if low == high {
            return self.is_set(low);
        }
        (low[0]..=high[0])
            .any(|x| (low[1]..=high[1]).any(|y| (low[2]..=high[2]).any(|z| self.is_set([x, y, z]))))
    }

    /// Sets the bits of the cells `from` to `to`, the latter excluded.
    pub fn set(&mut self, from: [usize; 3], to: [usize; 3]) {
        for x in from[0]..to[0] {
            for y in from[1]..to[1] {
                for z in from[2]..to[2] {
                    let (word, bit) = self.place([x, y, z]);
                    self.words[word] |= 1 << bit;
                }
            }
        }
    }

    /// Returns the number of bits that are set.
    pub fn count(&self) -> usize {
        self.words.iter().fold(0, |sum, word| sum + word.count_ones() as usize)
    }

    /// Returns the bits as words, in the layout of the module.
    pub fn words(&self) -> &[u64] {
        &self.words
    }

    /// Returns the first cells of the bricks that have a bit, in ascending order.
    pub fn occupied_bricks(&self) -> Vec<[usize; 3]> {
        let bricks = self.words.chunks_exact(BRICK).enumerate();
        let occupied = bricks.filter(|(_, words)| words.iter().any(|word| *word != 0));
        let first =
            |b: usize| [b / self.bricks / self.bricks, b / self.bricks % self.bricks, b % self.bricks];
        occupied.map(|(b, _)| first(b).map(|i| i * BRICK)).collect()
    }
}
