//! The five parameter arrays of a set of Gaussians, one after the other: the order used by files, digests,
//! optimisers and updates.

use super::gaussians::Gaussians;
use crate::num::array::{Arrays, retain_rows};
use crate::num::bits::Digest;
use crate::{Error, Result};
use std::collections::BTreeMap;

/// One of the parameter arrays of [`Gaussians`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Column {
    /// (N, 3)
    Means,
    /// (N, 4)
    Quats,
    /// (N, 3)
    ScalesLog,
    /// (N)
    OpacityLogits,
    /// (N, K, 3)
    Sh,
}

impl Column {
    /// All of them, in the order in which they are stored and digested.
    pub const ALL: [Self; 5] = [Self::Means, Self::Quats, Self::ScalesLog, Self::OpacityLogits, Self::Sh];

    /// The name in checkpoints and errors, which is that of the field.
    pub fn name(self) -> &'static str {
        match self {
            Self::Means => "means",
            Self::Quats => "quats",
            Self::ScalesLog => "scales_log",
            Self::OpacityLogits => "opacity_logits",
            Self::Sh => "sh",
        }
    }

    /// Shape of a row, for K coefficients per channel; that of a single number is empty.
    fn row(self, coefficients: usize) -> Vec<usize> {
        match self {
            Self::Means | Self::ScalesLog => vec![3],
            Self::Quats => vec![4],
            Self::OpacityLogits => Vec::new(),
            Self::Sh => vec![coefficients, 3],
        }
    }
}

fn coefficients(sh_degree: usize) -> usize {
    (sh_degree + 1) * (sh_degree + 1)
}

/// The rows of a column, which is complete.
fn rows<const N: usize>(column: Column, values: &[f32]) -> Vec<[f32; N]> {
    let (rows, rest) = values.as_chunks();
    assert!(rest.is_empty(), "{}: {} numbers are no rows of {N}", column.name(), values.len());
    rows.to_vec()
}

impl Gaussians {
    /// The values of a column, row-major.
    pub fn column(&self, column: Column) -> &[f32] {
        match column {
            Column::Means => self.means.as_flattened(),
            Column::Quats => self.quats.as_flattened(),
            Column::ScalesLog => self.scales_log.as_flattened(),
            Column::OpacityLogits => &self.opacity_logits,
            Column::Sh => &self.sh,
        }
    }

    /// The values of a column, to be changed.
    pub fn column_mut(&mut self, column: Column) -> &mut [f32] {
        match column {
            Column::Means => self.means.as_flattened_mut(),
            Column::Quats => self.quats.as_flattened_mut(),
            Column::ScalesLog => self.scales_log.as_flattened_mut(),
            Column::OpacityLogits => &mut self.opacity_logits,
            Column::Sh => &mut self.sh,
        }
    }

    /// All columns in their order.
    pub fn columns(&self) -> [(Column, &[f32]); 5] {
        Column::ALL.map(|column| (column, self.column(column)))
    }

    /// All columns in their order, to be changed.
    pub fn columns_mut(&mut self) -> [(Column, &mut [f32]); 5] {
        let Self { means, quats, scales_log, opacity_logits, sh, sh_degree: _ } = self;
        [
            (Column::Means, means.as_flattened_mut()),
            (Column::Quats, quats.as_flattened_mut()),
            (Column::ScalesLog, scales_log.as_flattened_mut()),
            (Column::OpacityLogits, opacity_logits),
            (Column::Sh, sh),
        ]
    }

    /// Numbers in a row of a column.
    pub fn width(&self, column: Column) -> usize {
        match column {
            Column::Means | Column::ScalesLog => 3,
            Column::Quats => 4,
            Column::OpacityLogits => 1,
            Column::Sh => 3 * self.sh_coefficients(),
        }
    }

    /// Shape of a column.
    pub fn shape(&self, column: Column) -> Vec<usize> {
        [vec![self.len()], column.row(self.sh_coefficients())].concat()
    }

    /// Gaussians of the given columns, requested in their order; not validated.
    ///
    /// # Errors
    /// The errors of `values`.
    ///
    /// # Panics
    /// When the numbers of a column are no multiple of its width.
    pub fn from_columns(
        sh_degree: usize,
        mut values: impl FnMut(Column) -> Result<Vec<f32>>,
    ) -> Result<Self> {
        Ok(Self {
            means: rows(Column::Means, &values(Column::Means)?),
            quats: rows(Column::Quats, &values(Column::Quats)?),
            scales_log: rows(Column::ScalesLog, &values(Column::ScalesLog)?),
            opacity_logits: values(Column::OpacityLogits)?,
            sh: values(Column::Sh)?,
            sh_degree,
        })
    }

    /// Puts every column as `PREFIX` followed by its name.
    pub fn save(&self, prefix: &str, out: &mut Arrays) {
        for (column, values) in self.columns() {
            out.put(&format!("{prefix}{}", column.name()), &self.shape(column), values.to_vec());
        }
    }

    /// Takes back what [`Self::save`] put, and validates it.
    ///
    /// # Errors
    /// A missing array, shapes that disagree, a number out of range.
    pub fn load(prefix: &str, sh_degree: usize, from: &Arrays) -> Result<Self> {
        let mut dims = BTreeMap::new();
        let g = Self::from_columns(sh_degree, |column| {
            let row = column.row(coefficients(sh_degree));
            let pattern = row.iter().fold("N".to_owned(), |pattern, n| format!("{pattern},{n}"));
            let name = format!("{prefix}{}", column.name());
            Ok::<_, Error>(from.shape(&name, &pattern, &mut dims)?.to_f32())
        })?;
        g.validate("parameters")?;
        Ok(g)
    }

    /// Adds every column with its shape to a digest.
    ///
    /// # Errors
    /// When a parameter is NaN.
    pub fn add_to(&self, digest: &mut Digest) -> Result<()> {
        self.columns().into_iter().try_for_each(|(column, values)| digest.f32(&self.shape(column), values))
    }

    /// Keeps the Gaussians where `keep` is true, in their order.
    pub fn keep_rows(&mut self, keep: &[bool]) {
        let width = self.width(Column::Sh);
        retain_rows(&mut self.means, 1, keep);
        retain_rows(&mut self.quats, 1, keep);
        retain_rows(&mut self.scales_log, 1, keep);
        retain_rows(&mut self.opacity_logits, 1, keep);
        retain_rows(&mut self.sh, width, keep);
    }

    /// Appends exact copies of the given rows.
    pub fn copy_rows(&mut self, rows: &[u32]) {
        let width = self.width(Column::Sh);
        for r in rows.iter().map(|r| *r as usize) {
            self.means.push(self.means[r]);
            self.quats.push(self.quats[r]);
            self.scales_log.push(self.scales_log[r]);
            self.opacity_logits.push(self.opacity_logits[r]);
            self.sh.extend_from_within(r * width..(r + 1) * width);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::gaussians::tests::scene;

    #[test]
    fn columns_have_their_widths_and_come_back_from_arrays() {
        let mut g = scene();
        for (column, values) in g.columns() {
            assert_eq!(values.len(), 2 * g.width(column), "{}", column.name());
            assert_eq!(crate::num::array::entries(&g.shape(column)), values.len(), "{}", column.name());
        }
        let mut arrays = Arrays::new();
        g.save("param/", &mut arrays);
        assert_eq!(arrays.need("param/sh").expect("saved").shape(), [2, 4, 3], "shape of the colours");
        assert_eq!(Gaussians::load("param/", 1, &arrays).expect("loaded"), g, "the same Gaussians");
        assert!(Gaussians::load("param/", 2, &arrays).is_err(), "of another degree");
        let copy = scene();
        for ((column, to), (_, from)) in g.columns_mut().into_iter().zip(copy.columns()) {
            to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
            assert_eq!(to[1], 2.0 * from[1], "{}", column.name());
        }
        let mut g = scene();
        g.copy_rows(&[1, 0]);
        g.keep_rows(&[false, true, false, true]);
        assert_eq!(
            (g.len(), g.means[1], &g.sh[12..]),
            (2, [0.0, 1.0, 2.0], &scene().sh[..12]),
            "rows follow"
        );
    }

    #[test]
    #[should_panic(expected = "quats: 7 numbers are no rows of 4")]
    fn a_column_with_a_remainder_is_refused() {
        let values = |column| if column == Column::Quats { vec![0.0; 7] } else { vec![0.0; 6] };
        drop(Gaussians::from_columns(0, |column| Ok(values(column))));
    }
}
