//! Muon: momentum whose matrix is replaced by a nearly orthogonal one, so that every direction of a layer moves equally far.
//!
//! m ← m + (1−μ)(g − m),  u = g + μ(m − g),  X = u/‖u‖,  five times X ← a·X + (b·A + c·A²)·X with A = X·Xᵀ,  (Jordan et al. 2024)
//!
//! θ ← θ − lr·w·θ − lr·r·√max(R, C)·X        (decoupled decay; the factor that makes r the root mean square of X's part: Liu et al. 2025)
//!
//! | symbol | name | shape | remark |
//! |---|---|---|---|
//! | θ | `param` | (B, R, C) | B matrices, each by itself; updated in place; initial value in the operator |
//! | g | `grad`, `grads` | (B, R, C), (S, B, R, C) | per step |
//! | m | `m` | (B, R, C) | momentum, from 0 |
//! | μ | `momentum` | () | in \[0, 1); 0.95 |
//! | w | `weight_decay` | () | ≥ 0 |
//! | r | `rms` | () | > 0; root mean square of a step in units of lr, 0.2 resembles Adam |
//! | a, b, c | | () | 3.4445, −4.7750, 2.0315 |
//!
//! With the singular value decomposition u = P·Σ·Qᵀ the iteration computes about P·Qᵀ. Its polynomial does not converge: it takes singular values
//! of X between 0.003 and 1 to between 0.68 and 1.21, in five steps. ‖u‖ is the Frobenius norm. Matrices with R > C are transposed first: A is the smaller
//! of the two products.
//!
//! Adam divides every entry by its own size, and the gradient of a layer is often nearly of low rank: a few directions then decide all steps.
//! Muon suits matrices that multiply vectors. Vectors, first and last layers keep another optimiser.
//!
//! # Rounding
//! All in f32, with constants computed in f64 and rounded once (c₁ = 1−μ, μ, k = lr·w, η = lr·r·√max(R, C)):
//!
//! m' = m + c₁·(g − m);  u = g + μ·(m' − g);  X = u·(1/‖u‖), ‖u‖² the f64 sum over 16 lanes of exact squares ([`sum`]), 1/‖u‖ rounded once;
//! the products are those of [`mod@crate::num::gemm`];  H = b·A + c·A²;  X' = a·X + H·X;  θ' = θ − k·θ;  θ'' = θ' − η·X.
//!
//! # Kinks and domain
//! u = 0 leaves X = 0: only the decay acts. Small singular values grow by up to 3.4445⁵ = 485: where u is close to a matrix of lower rank, the directions in which it
//! is not are rounding errors, and X is determined by the bits alone. A result that is not finite is an error, and the state is then unusable.
//!
//! # Adjoint
//! None.
//!
//! # Example
//! ```
//! # use lastlight_train as lastlight;
//! use lastlight::optim::muon::{Muon, Rule};
//! let mut muon = Muon::new(Rule { rms: 1.0, ..Rule::default() }, [1, 2, 2])?;
//! let mut param = [0.0f32; 4];
//! muon.step(&mut param, &[5.0, 0.0, 0.0, 0.1], 0.1)?; // both directions move about equally, though one gradient is 50 times the other
//! assert!(param[0] < -0.09 && param[3] < -0.09 && param[1] == 0.0);
//! # Ok::<(), lastlight::Error>(())
//! ```

use crate::num::array::Arrays;
use crate::num::gemm::{Finish, View, gemm};
use crate::num::sum;
use crate::{Error, Result};

/// Coefficients of X, A·X and A²·X.
const POLYNOMIAL: [f32; 3] = [3.4445, -4.7750, 2.0315];
/// Iterations.
const ITERATIONS: usize = 5;

/// Settings of a step except the learning rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rule {
    /// μ in [0, 1).
    pub momentum: f64,
    /// w ≥ 0.
    pub weight_decay: f64,
    /// r > 0.
    pub rms: f64,
}

impl Default for Rule {
    fn default() -> Self {
        Self { momentum: 0.95, weight_decay: 0.0, rms: 0.2 }
    }
}

impl Rule {
    fn check(&self) -> Result<()> {
        let wrong = |name: &str, expected: &str, got: f64| {
            Err(Error::input("muon").at(format!("setting {name}")).expected(expected).got(got.to_string()))
        };
        if !(0.0..1.0).contains(&self.momentum) {
            return wrong("momentum", "0 ≤ momentum < 1", self.momentum);
        }
        if !(self.weight_decay >= 0.0 && self.weight_decay.is_finite()) {
            return wrong("weight_decay", "a finite number, not negative", self.weight_decay);
        }
        if !(self.rms > 0.0 && self.rms.is_finite()) {
            return wrong("rms", "a finite number above 0", self.rms);
        }
        Ok(())
    }
}

/// Momentum of one parameter array (B, R, C).
#[derive(Clone, Debug)]
pub struct Muon {
    rule: Rule,
    /// B, R, C
    shape: [usize; 3],
    /// (B, R, C)
    m: Vec<f32>,
}

impl Muon {
    /// Makes zero momentum for `shape` matrices, rows and columns.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn new(rule: Rule, shape: [usize; 3]) -> Result<Self> {
        rule.check()?;
        Ok(Self { rule, shape, m: vec![0.0; shape[0] * shape[1] * shape[2]] })
    }

    /// One step: updates `param` (B, R, C) with the gradient `grad` (B, R, C).
    ///
    /// # Errors
    /// A rate that is negative or not finite; a result that is not finite (the parameters and the state are then unusable).
    pub fn step(&mut self, param: &mut [f32], grad: &[f32], lr: f64) -> Result<()> {
        let [_, rows, columns] = self.shape;
        assert!(
            param.len() == self.m.len() && grad.len() == self.m.len(),
            "param and grad have the shape of the momentum"
        );
        if !(lr >= 0.0 && lr.is_finite()) {
            return Err(Error::input("muon")
                .at("setting lr")
                .expected("a finite rate, not negative")
                .got(lr.to_string()));
        }
        let Rule { momentum, weight_decay, rms } = self.rule;
        let (rest, momentum) = ((1.0 - momentum) as f32, momentum as f32);
        let shrink = (lr * weight_decay) as f32;
        let length = (lr * rms * (Ord::max(rows, columns) as f64).sqrt()) as f32;
        let size = Ord::max(rows * columns, 1);
        for ((param, m), grad) in param.chunks_mut(size).zip(self.m.chunks_mut(size)).zip(grad.chunks(size)) {
            let update: Vec<f32> = m
                .iter_mut()
                .zip(grad)
                .map(|(m, g)| {
                    *m += rest * (g - *m);
                    g + momentum * (*m - g)
                })
                .collect();
            let direction = orthogonal(&update, [rows, columns]);
            for (x, o) in param.iter_mut().zip(&direction) {
                let shrunk = *x - shrink * *x;
                *x = shrunk - length * o;
            }
        }
        match param.iter().position(|x| !x.is_finite()) {
            None => Ok(()),
            Some(i) => Err(Error::input("muon")
                .at(format!("entry {i}"))
                .expected("a finite result")
                .got(format!("parameter {}, gradient {}", param[i], grad[i]))),
        }
    }

    /// Writes `NAME.m` for a checkpoint.
    pub fn save(&self, name: &str, to: &mut Arrays) {
        to.put(&format!("{name}.m"), &self.shape, self.m.clone());
    }

    /// Replaces the momentum by that of a checkpoint.
    ///
    /// # Errors
    /// A missing array, another shape, a number that is not finite.
    pub fn load(&mut self, name: &str, from: &Arrays) -> Result<()> {
        let array = format!("{name}.m");
        let [b, r, c] = self.shape;
        let m = from.shape(&array, &format!("{b},{r},{c}"), &mut Default::default())?.to_f32();
        from.finite([array.as_str()])?;
        self.m = m;
        Ok(())
    }
}

/// The nearly orthogonal matrix of a matrix (rows, columns), both row by row.
fn orthogonal(u: &[f32], [rows, columns]: [usize; 2]) -> Vec<f32> {
    let is_tall = rows > columns;
    let (r, c) = if is_tall { (columns, rows) } else { (rows, columns) };
    let mut x = if is_tall { transposed(u, [rows, columns]) } else { u.to_vec() };
    let square = sum::sum16_f64_by(x.len(), |i| f64::from(x[i]) * f64::from(x[i]));
    if square > 0.0 {
        let factor = (1.0 / square.sqrt()) as f32;
        x.iter_mut().for_each(|x| *x *= factor);
    }
    let [first, second, third] = POLYNOMIAL;
    let (mut gram, mut of_gram, mut moved) = (vec![0.0; r * r], vec![0.0; r * r], vec![0.0; r * c]);
    for _ in 0..ITERATIONS {
        gemm(View::new(&x, r, c), View::new(&x, r, c).t(), Finish::Store, &mut gram);
        gemm(View::new(&gram, r, r), View::new(&gram, r, r), Finish::Store, &mut of_gram);
        of_gram.iter_mut().zip(&gram).for_each(|(h, a)| *h = second * a + third * *h);
        gemm(View::new(&of_gram, r, r), View::new(&x, r, c), Finish::Store, &mut moved);
        x.iter_mut().zip(&moved).for_each(|(x, y)| *x = first * *x + y);
    }
    if is_tall { transposed(&x, [columns, rows]) } else { x }
}

fn transposed(x: &[f32], [rows, columns]: [usize; 2]) -> Vec<f32> {
    (0..columns).flat_map(|j| (0..rows).map(move |i| x[i * columns + j])).collect()
}

/// Inputs of the operator: S gradients for B matrices.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// (B, R, C)
    pub param: &'a [f32],
    /// (S, B, R, C)
    pub grads: &'a [f32],
    /// B, R, C
    pub shape: [usize; 3],
}

/// Settings of the operator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Learning rate.
    pub lr: f64,
    /// All other settings.
    pub rule: Rule,
}

/// Outputs of the operator.
#[derive(Clone, Debug, PartialEq)]
pub struct Out {
    /// (S, B, R, C): the parameters after each step.
    pub trajectory: Vec<f32>,
    /// (B, R, C), at the end.
    pub m: Vec<f32>,
}

/// S steps from zero momentum.
///
/// # Errors
/// Wrong sizes or settings; a result that is not finite.
pub fn forward(x: &In<'_>, settings: &Settings) -> Result<Out> {
    let what = "optim.muon";
    let [b, r, c] = x.shape;
    let len = b * r * c;
    if x.param.len() != len || (len > 0 && !x.grads.len().is_multiple_of(len)) {
        return Err(Error::input(what)
            .expected(format!("param ({b}, {r}, {c}) and grads (S, {b}, {r}, {c})"))
            .got(format!("{} and {} values", x.param.len(), x.grads.len())));
    }
    let mut muon = Muon::new(settings.rule, x.shape).map_err(|e| e.within(what))?;
    let mut param = x.param.to_vec();
    let mut trajectory = Vec::with_capacity(x.grads.len());
    for (s, grad) in x.grads.chunks(Ord::max(len, 1)).enumerate() {
        muon.step(&mut param, grad, settings.lr).map_err(|e| e.at(format!("step {s}")).within(what))?;
        trajectory.extend_from_slice(&param);
    }
    Ok(Out { trajectory, m: muon.m })
}
