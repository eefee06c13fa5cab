//! Right factors that are packed once and reused.

use super::super::par;
use super::matrix::View;
use super::pack::pack_columns;
use super::tile::{COLUMNS, Columns};

/// Number of multiplications from which on the work is shared between threads.
pub(super) const PARALLEL: usize = 1 << 18;

/// A right factor (k, n) packed once, for use with many left factors.
#[derive(Clone, Debug, Default)]
pub struct Packed {
    /// Panels (⌈n/16⌉, k): panel p contains columns 16p..16p+16 for every k.
    pub(super) panels: Vec<Columns>,
    pub(super) k: usize,
    pub(super) n: usize,
}

impl Packed {
    /// Packs a (k, n) matrix.
    pub fn new(b: View<'_>) -> Self {
        Self::reusing(Vec::new(), b)
    }

    /// Packs a row-major (k, n) matrix on this thread, reusing the memory of `self`; `read(first, into)`
    /// copies the numbers from index `first` on.
    #[must_use]
    pub fn renewed(self, (k, n): (usize, usize), read: impl Fn(usize, &mut [f32])) -> Self {
        let mut panels = self.panels;
        panels.resize(n.div_ceil(COLUMNS) * k, Columns::ZERO);
        for (p, panel) in panels.chunks_exact_mut(k.max(1)).enumerate() {
            let (first, width) = (p * COLUMNS, COLUMNS.min(n - p * COLUMNS));
            for (row, columns) in panel.iter_mut().enumerate() {
                let at = row * n + first;
                if width == COLUMNS {
                    read(at, &mut columns.0); // size known at compile time
                } else {
                    columns.0[width..].fill(0.0);
                    read(at, &mut columns.0[..width]);
                }
            }
        }
        Self { panels, k, n }
    }

    /// Number of rows k.
    pub fn rows(&self) -> usize {
        self.k
    }

    /// Returns the sums of the columns, each a left fold from +0.
    pub fn column_sums(&self) -> impl Iterator<Item = f32> {
        let panels = (0..self.n.div_ceil(COLUMNS)).map(|p| {
            self.panel(p).iter().fold([0.0; COLUMNS], |mut sums, columns| {
                sums.iter_mut().zip(columns.0).for_each(|(sum, x)| *sum += x);
                sums
            })
        });
        panels.flatten().take(self.n)
    }

    /// Packs into memory that may already be allocated.
    pub(super) fn reusing(mut panels: Vec<Columns>, b: View<'_>) -> Self {
        let (k, n) = (b.rows, b.columns);
        if k * n < PARALLEL / 4 {
            return Self::here(panels, b);
        }
        panels.resize(n.div_ceil(COLUMNS) * k, Columns::ZERO);
        par::chunks_mut(&mut panels, k, |p, panel| pack_columns(b, p * COLUMNS, panel));
        Self { panels, k, n }
    }

    /// Packs a (k, n) matrix on this thread, reusing the memory of `self`.
    #[must_use]
    pub fn repacked(self, b: View<'_>) -> Self {
        Self::here(self.panels, b)
    }

    /// Like [`Self::reusing`], on this thread alone.
    pub(super) fn here(mut panels: Vec<Columns>, b: View<'_>) -> Self {
        let (k, n) = (b.rows, b.columns);
        panels.resize(n.div_ceil(COLUMNS) * k, Columns::ZERO);
        for (p, panel) in panels.chunks_mut(k.max(1)).enumerate() {
            pack_columns(b, p * COLUMNS, panel);
        }
        Self { panels, k, n }
    }

    /// Returns columns 16p..16p+16, ordered by k.
    pub(super) fn panel(&self, p: usize) -> &[Columns] {
        &self.panels[p * self.k..(p + 1) * self.k]
    }
}
