//! Adam over rows, each row with its own step counter.
//!
//! m ← m + (1−β₁)(g − m),  v ← v + (1−β₂)(g² − v),  θ ← θ − lr·m̂/(√v̂ + ε),  m̂ = m/(1−β₁ᵗ),  v̂ = v/(1−β₂ᵗ)
//!                                                                              (Kingma & Ba 2015, alg. 1)
//!
//! | symbol | name | shape | remark |
//! |---|---|---|---|
//! | θ | `param` | (N, …) | updated in place; initial value in the operator |
//! | g | `grad`, `grads` | (N, …), (S, N, …) | per iteration |
//! | – | `active` | (N), (S, N) | a row's value, moments and counter are updated only where 1 |
//! | m, v | `m`, `v` | (N, …) | moments, from 0 |
//! | t | `steps` | (N) or (1) | [`Counters`] |
//!
//! Weight decay w enters in one of two ways ([`Decay`]): `adam` adds w·θ to the gradient, [`super::adamw`]
//! shrinks θ by 1 − lr·w before the step.
//!
//! # Rounding
//! All in f32, per element, with constants computed in f64 and rounded once (c₁ = 1−β₁, c₂ = 1−β₂, a =
//! 1/(1−β₁ᵗ), b = 1/(1−β₂ᵗ), lr, k = lr·w):
//!
//! g' = g + w·θ (coupled only);  m' = m + c₁·(g' − m);  v' = v + c₂·(g'·g' − v);
//! θ' = θ − k·θ (decoupled only);  θ'' = θ' − lr·((m'·a)/(√(v'·b) + ε))
//!
//! This form has the exact fixed points m = g, v = g²; β·v + (1−β)·g² in f32 is off by 1.3e-5 at β₂ = 0.999,
//! because the two rounded constants do not add up to 1. For the same reason weight decay subtracts k·θ
//! instead of multiplying by 1 − lr·w. Powers of β are running f64 products. Elements are independent, so the
//! result does not depend on lanes or threads.
//!
//! # Kinks and domain
//! |g| below 1e-22 leaves v = 0 and moves θ by lr·m̂/ε; g = 0 leaves θ unchanged. g² overflows beyond 1.8e19: a step with a
//! result that is not finite is an error, and the state is then unusable. ε = 0 is an error (0/0).
//! A row that was reset starts again at t = 0 with `Counters::Row`, so its first step has length lr; with
//! `Counters::Global` it is 0.1/√0.001 = 3.16 times too long, as in the 3DGS code.
//!
//! # Adjoint
//! None.
//!
//! # Example
//! ```
//! # use lastlight_train as lastlight;
//! use lastlight::optim::adam::{Adam, Rule};
//! let mut adam = Adam::new(Rule::default(), 1, 1)?;
//! let mut param = [1.0f32];
//! adam.step(&mut param, &[123.0], &[0.25], None)?; // the first step has length lr, whatever the gradient
//! assert!((param[0] - 0.75).abs() < 1e-7);
//! # Ok::<(), lastlight::Error>(())
//! ```

pub use super::rule::{Counters, Decay, Rule};

use super::kernel::{BLOCK, COUPLED, Constants, Corrections, DECOUPLED, NONE, Shared, Task};
use crate::num::array::{Arrays, retain_rows};
use crate::num::{order, par};
use crate::{Error, Result};

/// Moments and counters of one parameter array (N, W).
#[derive(Clone, Debug)]
pub struct Adam {
    rule: Rule,
    width: usize,
    /// (N, W)
    m: Vec<f32>,
    /// (N, W)
    v: Vec<f32>,
    /// (N), or (1) with a global counter
    steps: Vec<u32>,
    /// Largest counter.
    most_steps: u32,
    corrections: Corrections,
}

/// Approximate number of elements of one task.
const TASK: usize = 16_384;

impl Adam {
    /// Makes zero moments and counters for (`rows`, `width`) parameters.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn new(rule: Rule, rows: usize, width: usize) -> Result<Self> {
        rule.check()?;
        assert!(width > 0, "a row has at least one element");
        let counters = if rule.counters == Counters::Row { rows } else { 1 };
        Ok(Self {
            rule,
            width,
            m: vec![0.0; rows * width],
            v: vec![0.0; rows * width],
            steps: vec![0; counters],
            most_steps: 0,
            corrections: Corrections::new(),
        })
    }

    /// N.
    pub fn rows(&self) -> usize {
        self.m.len() / self.width
    }

    /// W.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The rule given to [`Self::new`].
    pub fn rule(&self) -> &Rule {
        &self.rule
    }

    /// First and second moments, (N, W) each.
    pub fn moments(&self) -> (&[f32], &[f32]) {
        (&self.m, &self.v)
    }

    /// Step counters: (N), or (1) with a global counter.
    pub fn steps(&self) -> &[u32] {
        &self.steps
    }

    /// One step: updates `param` (N, W) with the gradient `grad` (N, W). `lr` holds one rate, or one per
    /// column; rows where `active` (N) is 0 are not updated.
    ///
    /// # Errors
    /// A rate that is negative or not finite; a result that is not finite (the parameters and the state are
    /// then unusable).
    pub fn step(&mut self, param: &mut [f32], grad: &[f32], lr: &[f64], active: Option<&[u8]>) -> Result<()> {
        let (rows, width) = (self.rows(), self.width);
        assert!(
            param.len() == rows * width && grad.len() == rows * width,
            "param and grad have the shape of the moments"
        );
        assert!(lr.len() == 1 || lr.len() == width, "one learning rate, or one per column");
        assert!(active.is_none_or(|a| a.len() == rows), "active has one entry per row");
        if let Some(bad) = lr.iter().find(|r| !(**r >= 0.0 && r.is_finite())) {
            return Err(Error::input("adam")
                .at("setting lr")
                .expected("a finite rate, not negative")
                .got(bad.to_string()));
        }
        self.most_steps += 1;
        self.corrections.cover(&self.rule, self.most_steps);
        let mut global = [1.0; 2];
        if self.rule.counters == Counters::Global {
            self.steps[0] += 1;
            global = self.corrections.at(self.steps[0]);
        }
        let column = |i: usize| lr[if lr.len() == 1 { 0 } else { i % width }];
        let shared = Shared {
            scalar: Constants::new(&self.rule),
            vector: Constants::new(&self.rule),
            width,
            lr: (0..BLOCK * width).map(|i| column(i) as f32).collect(),
            shrink: (0..BLOCK * width).map(|i| (column(i) * self.rule.weight_decay) as f32).collect(),
            global,
            corrections: &self.corrections,
        };
        let task_rows = (TASK / width).div_ceil(BLOCK) * BLOCK;
        let len = task_rows * width;
        let mut counters = self.steps.chunks_mut(task_rows);
        let own_counters = self.rule.counters == Counters::Row;
        let mut fine = vec![true; param.len().div_ceil(len)];
        let tasks: Vec<(Task<'_>, &mut bool)> = param
            .chunks_mut(len)
            .zip(self.m.chunks_mut(len).zip(self.v.chunks_mut(len)))
            .zip(&mut fine)
            .enumerate()
            .map(|(i, ((param, (m, v)), fine))| {
                let (at, rows) = (i * task_rows, param.len() / width);
                let steps =
                    if own_counters { counters.next().unwrap_or_default() } else { Default::default() };
                let grad = &grad[at * width..][..param.len()];
                (Task { param, m, v, grad, active: active.map(|a| &a[at..at + rows]), steps }, fine)
            })
            .collect();
        par::each(tasks, |_, (task, fine)| {
            *fine = match (self.rule.weight_decay > 0.0, self.rule.decay) {
                (false, _) => shared.run::<NONE>(task),
                (true, Decay::Coupled) => shared.run::<COUPLED>(task),
                (true, Decay::Decoupled) => shared.run::<DECOUPLED>(task),
            };
        });
        if fine.iter().all(|f| *f) { Ok(()) } else { Err(self.diverged(param, grad)) }
    }

    /// Names the first element that is not finite.
    fn diverged(&self, param: &[f32], grad: &[f32]) -> Error {
        let bad = |i: &usize| !(param[*i].is_finite() && self.v[*i].is_finite());
        let i = (0..param.len()).find(bad).expect("a task found one");
        Error::input("adam")
            .at(format!("row {}, column {}", i / self.width, i % self.width))
            .expected("a finite result")
            .got(format!("parameter {}, second moment {}, gradient {}", param[i], self.v[i], grad[i]))
            .hint("gradients must be finite and below 1.8e19")
    }

    /// Zeroes the moments of the rows where `which` holds, and their own counters.
    pub fn reset_rows(&mut self, which: impl Fn(usize) -> bool) {
        let own = self.rule.counters == Counters::Row;
        for r in (0..self.rows()).filter(|r| which(*r)) {
            self.m[r * self.width..][..self.width].fill(0.0);
            self.v[r * self.width..][..self.width].fill(0.0);
            if own {
                self.steps[r] = 0;
            }
        }
    }

    /// Rescales the state after a change of units: parameter i of (N · W) is now `by(i)` times as large, so
    /// its gradients are 1/`by(i)` times as large.
    pub fn rescale(&mut self, by: impl Fn(usize) -> f32) {
        for (i, (m, v)) in self.m.iter_mut().zip(&mut self.v).enumerate() {
            let by = by(i);
            (*m, *v) = (*m / by, *v / by / by);
        }
    }

    /// Keeps the rows where `keep` is true, in their order.
    pub fn keep_rows(&mut self, keep: &[bool]) {
        assert_eq!(keep.len(), self.rows(), "keep has one entry per row");
        retain_rows(&mut self.m, self.width, keep);
        retain_rows(&mut self.v, self.width, keep);
        if self.rule.counters == Counters::Row {
            retain_rows(&mut self.steps, 1, keep);
        }
    }

    /// Appends `rows` rows with zero moments and counters.
    pub fn append(&mut self, rows: usize) {
        let n = self.rows() + rows;
        self.m.resize(n * self.width, 0.0);
        self.v.resize(n * self.width, 0.0);
        if self.rule.counters == Counters::Row {
            self.steps.resize(n, 0);
        }
    }

    /// Writes `NAME.m`, `NAME.v` (N, W) and `NAME.steps` for a checkpoint.
    pub fn save(&self, name: &str, to: &mut Arrays) {
        let shape = [self.rows(), self.width];
        to.put(&format!("{name}.m"), &shape, self.m.clone());
        to.put(&format!("{name}.v"), &shape, self.v.clone());
        to.put(
            &format!("{name}.steps"),
            &[self.steps.len()],
            self.steps.iter().map(|&t| i64::from(t)).collect(),
        );
    }

    /// Reads arrays written by [`Self::save`]; the caller supplies the rule.
    ///
    /// # Errors
    /// Missing arrays, inconsistent shapes, numbers out of range.
    pub fn load(rule: Rule, name: &str, from: &Arrays) -> Result<Self> {
        let mut dims = std::collections::BTreeMap::new();
        let names = ["m", "v", "steps"].map(|part| format!("{name}.{part}"));
        let m = from.shape(&names[0], "N,W", &mut dims)?.to_f32();
        let v = from.shape(&names[1], "N,W", &mut dims)?.to_f32();
        let (rows, width) = (dims[&'N'], dims[&'W']);
        let counters = if rule.counters == Counters::Row { rows } else { 1 };
        let steps = from.shape(&names[2], &counters.to_string(), &mut dims)?;
        from.finite([names[0].as_str(), names[1].as_str()])?;
        if let Some(bad) = v.iter().find(|v| **v < 0.0) {
            return Err(Error::input(&names[1]).expected("no negative second moment").got(bad.to_string()));
        }
        let steps: Option<Vec<u32>> = steps
            .to_i64()
            .and_then(|s| s.into_iter().map(|t| u32::try_from(t).ok().filter(|t| *t < u32::MAX)).collect());
        let steps =
            steps.ok_or_else(|| Error::input(&names[2]).expected("step counts").got("another number"))?;
        if width == 0 {
            return Err(Error::input(&names[0]).expected("at least one column").got("none"));
        }
        let most_steps = steps.iter().copied().fold(0, order::max);
        let mut adam = Self { m, v, steps, most_steps, ..Self::new(rule, 0, width)? };
        adam.corrections.cover(&adam.rule, most_steps);
        Ok(adam)
    }

    /// [`Self::load`] for an array of this many rows and columns.
    ///
    /// # Errors
    /// The same as [`Self::load`], and when the shape differs.
    pub fn load_sized(rule: Rule, name: &str, from: &Arrays, [rows, width]: [usize; 2]) -> Result<Self> {
        let adam = Self::load(rule, name, from)?;
        if (adam.rows(), adam.width()) != (rows, width) {
            return Err(Error::input(format!("array '{name}.m'"))
                .expected(format!("shape [{rows}, {width}]"))
                .got(format!("[{}, {}]", adam.rows(), adam.width())));
        }
        Ok(adam)
    }
}

/// Inputs of the operator: S gradients for one parameter array.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// (N, W)
    pub param: &'a [f32],
    /// (S, N, W)
    pub grads: &'a [f32],
    /// (S, N); `None` updates every row at every step.
    pub active: Option<&'a [u8]>,
    /// N
    pub rows: usize,
    /// W, the product of the remaining sizes
    pub width: usize,
}

/// Settings of the operator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Learning rate.
    pub lr: f64,
    /// All other settings; the operator sets `decay`.
    pub rule: Rule,
}

/// Outputs of the operator.
#[derive(Clone, Debug, PartialEq)]
pub struct Out {
    /// (S, N, W): the parameters after each step.
    pub trajectory: Vec<f32>,
    /// (N, W), at the end.
    pub m: Vec<f32>,
    /// (N, W), at the end.
    pub v: Vec<f32>,
    /// (N) or (1), at the end.
    pub steps: Vec<u32>,
}

/// S steps of Adam with coupled weight decay from zero moments.
///
/// # Errors
/// Wrong sizes or settings; a result that is not finite.
pub fn forward(x: &In<'_>, settings: &Settings) -> Result<Out> {
    trajectory("optim.adam", x, settings, Decay::Coupled)
}

/// S steps from zero moments.
pub(super) fn trajectory(what: &str, x: &In<'_>, settings: &Settings, decay: Decay) -> Result<Out> {
    let len = x.rows * x.width;
    if x.width == 0 || x.param.len() != len || (len > 0 && !x.grads.len().is_multiple_of(len)) {
        return Err(Error::input(what)
            .expected(format!("param ({}, {}) and grads (S, {}, {})", x.rows, x.width, x.rows, x.width))
            .got(format!("{} and {} values", x.param.len(), x.grads.len())));
    }
    let steps = x.grads.len().checked_div(len).unwrap_or(0);
    if let Some(active) = x.active
        && (active.len() != steps * x.rows || active.iter().any(|a| *a > 1))
    {
        return Err(Error::input(what)
            .at("array 'active'")
            .expected(format!("({steps}, {}) zeros and ones", x.rows))
            .got(format!("{} values", active.len())));
    }
    let mut adam = Adam::new(Rule { decay, ..settings.rule }, x.rows, x.width).map_err(|e| e.within(what))?;
    let mut param = x.param.to_vec();
    let mut trajectory = Vec::with_capacity(x.grads.len());
    for s in 0..steps {
        let active = x.active.map(|a| &a[s * x.rows..(s + 1) * x.rows]);
        adam.step(&mut param, &x.grads[s * len..(s + 1) * len], &[settings.lr], active)
            .map_err(|e| e.at(format!("step {s}")).within(what))?;
        trajectory.extend_from_slice(&param);
    }
    Ok(Out { trajectory, m: adam.m, v: adam.v, steps: adam.steps })
}
