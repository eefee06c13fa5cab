//! The pixels of an iteration: square crops, more often where the object is.
//!
//! Crop k of iteration i takes view (K·i + k) of an endless sequence of permutations of the views. Its first
//! row is drawn with a probability proportional to the foreground in its rows, plus 0.001 of the window, then
//! its first column likewise within these rows (LIRM, § 11.1).

use super::targets::Target;
use crate::num::rng::Rng;

/// Purpose of the order of views.
const PURPOSE_ORDER: u16 = 0x0531;
/// Purpose of the places of crops; the item is the crop, draw 0 the row, 1 the column.
const PURPOSE_PLACE: u16 = 0x0532;
/// What every place has besides its foreground.
const LEAST: f64 = 1e-3;

/// A square part of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crop {
    /// Index among the views.
    pub view: usize,
    /// First row and column.
    pub corner: [usize; 2],
    /// Rows and columns.
    pub size: [usize; 2],
}

impl Crop {
    /// Returns the indices of its pixels in an image of the given width, row by row.
    pub fn pixels(&self, width: usize) -> impl Iterator<Item = usize> + use<> {
        let Self { corner: [row, column], size: [rows, columns], .. } = *self;
        (row..row + rows).flat_map(move |r| (column..column + columns).map(move |c| r * width + c))
    }
}

/// Returns the start of a window of `size` over `mass`, with the probability of what the window covers.
fn start(mass: &[f64], size: usize, u: f64) -> usize {
    let places = mass.len() - size + 1;
    let least = LEAST * size as f64;
    let mut covered = mass[..size].iter().fold(0.0, |sum, m| sum + m);
    let mut sums = Vec::with_capacity(places);
    let mut total = 0.0;
    for place in 0..places {
        total += covered + least;
        sums.push(total);
        if place + size < mass.len() {
            // Foreground is never negative; a rounded difference may be.
            covered = crate::num::order::max(covered + mass[place + size] - mass[place], 0.0);
        }
    }
    sums.iter().position(|s| u * total < *s).unwrap_or(places - 1)
}

/// Returns the crops of an iteration.
pub fn draw(targets: &[Target], seed: u64, iteration: usize, crops: usize, side: usize) -> Vec<Crop> {
    let rng = Rng::new(seed);
    let n = targets.len();
    let one = |k: usize| {
        let at = iteration * crops + k;
        let epoch = u32::try_from(at / n).expect("fewer epochs than iterations times crops");
        let view = rng.permutation(n, epoch, PURPOSE_ORDER)[at % n];
        let target = &targets[view];
        let (width, height) = (target.camera.width, target.camera.height);
        let size = [Ord::min(side, height), Ord::min(side, width)];
        let step = u32::try_from(iteration).expect("validated");
        let draw = |axis: u16| rng.uniform_f64(k as u64, step, PURPOSE_PLACE, axis);
        let row_mass = |row: usize| {
            target.foreground[row * width..(row + 1) * width].iter().fold(0.0, |sum, m| sum + f64::from(*m))
        };
        let by_row: Vec<f64> = (0..height).map(|row| row_mass(row) / width as f64).collect();
        let row = start(&by_row, size[0], draw(0));
        let column_mass = |column: usize| {
            (row..row + size[0]).fold(0.0, |sum, r| sum + f64::from(target.foreground[r * width + column]))
        };
        let by_column: Vec<f64> = (0..width).map(|c| column_mass(c) / size[0] as f64).collect();
        Crop { view, corner: [row, start(&by_column, size[1], draw(1))], size }
    };
    (0..crops).map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_are_drawn_by_what_they_cover() {
        let mut mass = vec![0.0; 20];
        mass[10] = 1.0;
        // windows of 4 that contain entry 10 start at 7 … 10; the others have the least mass alone
        let starts: Vec<usize> = (0..1000).map(|k| start(&mass, 4, (f64::from(k) + 0.5) / 1000.0)).collect();
        let hits = starts.iter().filter(|s| (7..=10).contains(*s)).count();
        assert!((970..1000).contains(&hits), "{hits} of 1000");
        assert!(starts.windows(2).all(|w| w[0] <= w[1]), "ascending with the draw");
        assert_eq!((start(&[0.0; 5], 5, 0.99), start(&[0.0; 5], 1, 0.99)), (0, 4), "all places, one place");
    }
}
