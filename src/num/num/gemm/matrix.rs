//! Matrix views that the products accept, and the operations applied to a finished element.

/// Longest chain in k; part of the definition.
pub const CHUNK: usize = 4096;

/// A matrix view into a slice: element (i, j) is `values[i·row_stride + j·column_stride]`.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    pub(super) values: &'a [f32],
    pub(super) rows: usize,
    pub(super) columns: usize,
    pub(super) row_stride: usize,
    pub(super) column_stride: usize,
}

impl<'a> View<'a> {
    /// Returns a view of a row-major matrix that occupies the complete slice.
    ///
    /// # Panics
    /// Panics if the slice does not have rows·columns elements.
    pub fn new(values: &'a [f32], rows: usize, columns: usize) -> Self {
        assert_eq!(
            values.len(),
            rows * columns,
            "the slice has the size of a row-major ({rows}, {columns}) matrix"
        );
        Self { values, rows, columns, row_stride: columns, column_stride: 1 }
    }

    /// Returns a view with arbitrary strides, for example one head of an attention layer or a patch of an
    /// image.
    ///
    /// # Panics
    /// Panics if the last element is outside the slice.
    pub fn strided(
        values: &'a [f32],
        (rows, columns): (usize, usize),
        (row_stride, column_stride): (usize, usize),
    ) -> Self {
        if rows > 0 && columns > 0 {
            let last = (rows - 1) * row_stride + (columns - 1) * column_stride;
            assert!(last < values.len(), "element ({}, {}) is inside the slice", rows - 1, columns - 1);
        }
        Self { values, rows, columns, row_stride, column_stride }
    }

    /// Returns the transpose without moving data.
    #[must_use]
    pub fn t(self) -> Self {
        Self {
            rows: self.columns,
            columns: self.rows,
            row_stride: self.column_stride,
            column_stride: self.row_stride,
            ..self
        }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }
}

/// Operation applied to a finished element p of the product, after its chain.
#[derive(Clone, Copy, Debug)]
pub enum Finish<'a> {
    /// c = p.
    Store,
    /// c = c + p.
    Add,
    /// c = 0 + p; equal to `Add` if c is known to be +0, but c is not read.
    AddToZero,
    /// c = p + bias of the column, bias (n).
    Bias(&'a [f32]),
    /// c = p + bias where that is positive, the given slope times that elsewhere.
    Leaky(&'a [f32], f32),
    /// c = max(0, p); NaN stays NaN.
    Relu,
    /// c = 0 where the entry of the given matrix (m, n), whose n is repeated, is ≤ 0, and p elsewhere: the
    /// adjoint of `Relu` at its results.
    Gated(&'a [f32], usize),
    /// The chain starts at c instead of +0, and c is its end: a chain over k in parts. k is at most [`CHUNK`].
    Resume,
}

impl<'a> Finish<'a> {
    pub(super) fn bias(self) -> Option<&'a [f32]> {
        match self {
            Self::Store | Self::Add | Self::AddToZero | Self::Relu | Self::Gated(..) | Self::Resume => None,
            Self::Bias(bias) | Self::Leaky(bias, _) => Some(bias),
        }
    }
}
