//! Small dense matrices in f64, row-major: Cholesky factors, linear systems, determinants and inverses.
//!
//! The functions are meant for statistics over a few factors (n up to a few dozen); they use one thread and
//! plain loops.
//!
//! # Rounding
//! Every sum is a left fold in index order, starting from 0; subtracting such a sum from an entry is one
//! subtraction. [`cholesky`] proceeds row by row. [`inverse`] is Gauss–Jordan elimination with the largest
//! pivot of each column; ties go to the lowest row.
//!
//! ```
//! # use lastlight_num as lastlight;
//! use lastlight::math::dense;
//! let l = dense::cholesky(&[4.0, 2.0, 2.0, 5.0], 2).unwrap();
//! assert_eq!(l, [2.0, 0.0, 1.0, 2.0]);
//! assert_eq!(dense::solve(&l, 2, &[2.0, 5.0]), [0.0, 1.0]);
//! ```

use crate::Error;

/// The reason why a matrix has no Cholesky factor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NotPositive {
    /// Row of the first pivot that is not a finite number above 0.
    pub row: usize,
    /// Value of that pivot.
    pub pivot: f64,
}

impl NotPositive {
    /// Converts to an error reported by `what`, the code that uses the matrix.
    pub fn of(self, what: &str) -> Error {
        Error::input(what)
            .at(format!("row {} of the covariance", self.row))
            .expected("a positive definite matrix")
            .got(format!("pivot {:e}", self.pivot))
    }
}

/// Returns the lower triangular L with A = L·Lᵀ of a symmetric matrix (n, n); only the lower half of the
/// matrix is read.
///
/// # Errors
/// Returns an error if the matrix is not positive definite.
pub fn cholesky(a: &[f64], n: usize) -> Result<Vec<f64>, NotPositive> {
    assert_eq!(a.len(), n * n, "the matrix is square, (n, n)");
    let mut l = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let rest = a[i * n + j] - (0..j).fold(0.0, |sum, k| sum + l[i * n + k] * l[j * n + k]);
            if i > j {
                l[i * n + j] = rest / l[j * n + j];
            } else if rest > 0.0 && rest.is_finite() {
                l[i * n + i] = rest.sqrt();
            } else {
                return Err(NotPositive { row: i, pivot: rest });
            }
        }
    }
    Ok(l)
}

/// Returns the x with L·Lᵀ·x = b.
pub fn solve(l: &[f64], n: usize, b: &[f64]) -> Vec<f64> {
    let mut x = forward(l, n, b);
    for i in (0..n).rev() {
        let rest = x[i] - (i + 1..n).fold(0.0, |sum, k| sum + l[k * n + i] * x[k]);
        x[i] = rest / l[i * n + i];
    }
    x
}

/// Returns the x with L·x = b.
pub fn forward(l: &[f64], n: usize, b: &[f64]) -> Vec<f64> {
    assert!(l.len() == n * n && b.len() == n, "the triangular factor is (n, n), the right-hand side (n)");
    let mut x = vec![0.0; n];
    for i in 0..n {
        let rest = b[i] - (0..i).fold(0.0, |sum, k| sum + l[i * n + k] * x[k]);
        x[i] = rest / l[i * n + i];
    }
    x
}

/// Returns ln det(L·Lᵀ).
pub fn log_det(l: &[f64], n: usize) -> f64 {
    2.0 * (0..n).fold(0.0, |sum, i| sum + libm::log(l[i * n + i]))
}

/// Returns the product A·B of matrices (n, m) and (m, p).
pub fn product(a: &[f64], b: &[f64], n: usize, m: usize, p: usize) -> Vec<f64> {
    assert!(a.len() == n * m && b.len() == m * p, "the factors are (n, m) and (m, p)");
    let entry = |i: usize, j: usize| (0..m).fold(0.0, |sum, k| sum + a[i * m + k] * b[k * p + j]);
    (0..n * p).map(|at| entry(at / p, at % p)).collect()
}

/// Returns the inverse and the determinant of a matrix (n, n), or `None` if a pivot is 0.
pub fn inverse(a: &[f64], n: usize) -> Option<(Vec<f64>, f64)> {
    assert_eq!(a.len(), n * n, "the matrix is square, (n, n)");
    let mut work = a.to_vec();
    let mut out: Vec<f64> = (0..n * n).map(|at| if at / n == at % n { 1.0 } else { 0.0 }).collect();
    let mut det = 1.0;
    for c in 0..n {
        let mut best = c;
        for r in c + 1..n {
            if work[r * n + c].abs() > work[best * n + c].abs() {
                best = r;
            }
        }
        let pivot = work[best * n + c];
        if !(pivot.abs() > 0.0 && pivot.is_finite()) {
            return None;
        }
        if best != c {
            det = -det;
            for k in 0..n {
                work.swap(c * n + k, best * n + k);
                out.swap(c * n + k, best * n + k);
            }
        }
        det *= pivot;
        for k in 0..n {
            work[c * n + k] /= pivot;
            out[c * n + k] /= pivot;
        }
        for r in (0..n).filter(|&r| r != c) {
            let factor = work[r * n + c];
            if factor != 0.0 {
                for k in 0..n {
                    work[r * n + k] -= factor * work[c * n + k];
                    out[r * n + k] -= factor * out[c * n + k];
                }
            }
        }
    }
    Some((out, det))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_inverse_undoes_its_matrix_and_agrees_with_the_triangles() {
        let a = [4.0, 1.0, -0.5, 1.0, 3.0, 0.25, -0.5, 0.25, 2.0];
        let (inverse, det) = inverse(&a, 3).expect("regular");
        let one = product(&a, &inverse, 3, 3, 3);
        for (at, x) in one.iter().enumerate() {
            let want = f64::from(u8::from(at % 4 == 0));
            assert!((x - want).abs() < 1e-15, "entry {at} of A·A⁻¹ is {x}");
        }
        let l = cholesky(&a, 3).expect("positive definite");
        assert!((log_det(&l, 3) - libm::log(det)).abs() < 1e-14, "one determinant");
        let x = solve(&l, 3, &[1.0, -2.0, 0.5]);
        let back = product(&a, &x, 3, 3, 1);
        for (got, want) in back.iter().zip([1.0, -2.0, 0.5]) {
            assert!((got - want).abs() < 1e-15, "{got} instead of {want}");
        }
        let no_triangle = NotPositive { row: 1, pivot: -3.0 };
        assert_eq!(cholesky(&[1.0, 2.0, 2.0, 1.0], 2), Err(no_triangle), "an indefinite matrix has none");
        assert!(super::inverse(&[1.0, 2.0, 2.0, 4.0], 2).is_none(), "a singular matrix has no inverse");
    }
}
