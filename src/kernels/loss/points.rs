//! `loss.points`: distance of decoded points from their targets (LAST, eq. 4).
//!
//! ordered (default):  L = 1/B · Σ over b of L_b,   L_b = 1/P · Σ over p, c of w_c Δ²,
//! Δ = x(b,p,c) − y(b,p,c),   w = 1/σ_x² for xyz, 1/σ_c² for rgb
//!
//! chamfer:  L = 1/(B·P) · Σ over b, p of d(x(b,p), y(b,f(b,p))) +
//! 1/(B·Q) · Σ over b, q of d(x(b,g(b,q)), y(b,q))
//!
//! with the same weighted square d(u, v) = ‖Δxyz‖²/σ_x² + ‖Δrgb‖²/σ_c²; f and g are nearest neighbours in
//! this distance.
//!
//! The model of LAST uses [`item`] and [`item_adjoint`]: L_b alone with a weight per item, for any number of
//! channels and weights w.
//!
//! | symbol | argument | shape | unit, range |
//! |--------|----------|-------|-------------|
//! | x | `x` | (B, P, D) | D = 3: xyz in scene units; D = 6: xyz and rgb |
//! | y | `y` | (B, Q, E) | E = D, or 3: targets without colour, whose term is omitted; Q = P for the ordered form |
//! | σ_x | `sigma_x` | () | > 0, scene units; 0.05 by default |
//! | σ_c | `sigma_c` | () | > 0, sRGB-encoded; 0.2 by default |
//! | f | plan array `nearest_x` | (B, P) | rows of y |
//! | g | plan array `nearest_y` | (B, Q) | rows of x |
//! | L | return | () | ≥ 0 |
//!
//! # Rounding
//! 1/σ² is computed in f64 and rounded once to f32. Ordered: Δ and w_c Δ in f32, their product in f64, a left
//! fold over p, then c, in f64; one division by P; items by the pairwise tree, one division by B, rounded
//! once to f32. Chamfer: Δ, its squares, the left fold x, y, z, the product with 1/σ² and the sum of both
//! parts in f32. Per item a left fold over its points in f64; items by the pairwise tree; one division in f64
//! per direction; both directions are added in f64 and rounded once to f32.
//!
//! # Kinks and domain
//! The ordered form has no kinks. The derivative of the Chamfer form jumps where two neighbours are equally
//! near: the lowest index is selected, and the gradient is that for the plan. The form uses squares without a
//! root, so it is smooth at distance 0. An empty set is an error. Colours without a target get no gradient.
//!
//! # Adjoint
//! Ordered, with the cotangent L̄_b = L̄/B: x̄ += ((2/P)·L̄_b)·(w_c Δ), ȳ −= the same, in f32. Chamfer, each
//! term d(u, v) with its share s = L̄/(B·P) or L̄/(B·Q): ū += 2·s·Δ/σ², v̄ −= the same. Per entry the terms
//! are a left fold from +0, first those of f with p ascending, then those of g with q ascending, completed
//! before the sum is added to the caller's gradient.
//!
//! Twin: `reference::loss::points`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::loss::points::{In, Sigmas, ordered};
//! let sigmas = Sigmas { xyz: 0.5, rgb: 0.5 };
//! let input = In { x: &[1.0, 0.0, 0.0], y: &[0.0; 3], batch: 1, channels: [3, 3], sigmas };
//! assert_eq!(ordered(&input)?, 4.0);
//! # Ok::<(), lastlight::Error>(())
//! ```

use super::finite;
use crate::num::{par, sum};
use crate::{Error, Result};

/// Scales: a difference of one σ contributes 1 to the weighted square.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sigmas {
    /// Scale of positions σ_x, in scene units.
    pub xyz: f64,
    /// Scale of colours σ_c, sRGB-encoded.
    pub rgb: f64,
}

impl Default for Sigmas {
    fn default() -> Self {
        Self { xyz: 0.05, rgb: 0.2 }
    }
}

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (B, P, D).
    pub x: &'a [f32],
    /// Shape (B, Q, E).
    pub y: &'a [f32],
    /// Number of items, B.
    pub batch: usize,
    /// Channels D and E, each 3 or 6, with E ≤ D.
    pub channels: [usize; 2],
    /// Scales σ_x and σ_c.
    pub sigmas: Sigmas,
}

/// Nearest neighbours, the discrete decisions of the Chamfer form.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Plan {
    /// Nearest rows of y, shape (B, P).
    pub nearest_x: Vec<i32>,
    /// Nearest rows of x, shape (B, Q).
    pub nearest_y: Vec<i32>,
}

/// Factors 1/σ_x², 1/σ_c².
type Scale = [f32; 2];

impl In<'_> {
    /// Checks the inputs and returns the number of points per item, P and Q.
    ///
    /// # Errors
    /// Returns an error for wrong sizes, an empty set, or a σ whose 1/σ² is not a positive f32.
    pub fn check(&self) -> Result<[usize; 2]> {
        let what = || Error::input("loss.points");
        let [d, e] = self.channels;
        if !matches!([d, e], [3, 3] | [6, 3] | [6, 6]) {
            return Err(what()
                .expected("points with 3 or 6 channels, and targets with the same number or 3")
                .got(format!("{d} and {e}")));
        }
        for (name, points, channels) in [("x", self.x, d), ("y", self.y, e)] {
            let row = self.batch * channels;
            if points.is_empty() || row == 0 || !points.len().is_multiple_of(row) {
                return Err(what()
                    .at(format!("array '{name}'"))
                    .expected(format!("{} items of at least one point with {channels} channels", self.batch))
                    .got(format!("{} numbers", points.len())));
            }
        }
        for (name, sigma, factor) in
            [("sigma_x", self.sigmas.xyz, self.scale()[0]), ("sigma_c", self.sigmas.rgb, self.scale()[1])]
        {
            if !(sigma > 0.0 && factor > 0.0 && factor.is_finite()) {
                return Err(what()
                    .at(format!("setting {name}"))
                    .expected("a positive number whose inverse square is within the range of f32")
                    .got(sigma.to_string()));
            }
        }
        Ok([self.x.len() / (self.batch * d), self.y.len() / (self.batch * e)])
    }

    fn scale(&self) -> Scale {
        [self.sigmas.xyz, self.sigmas.rgb].map(|sigma| (1.0 / (sigma * sigma)) as f32)
    }

    /// Returns w of every channel of x.
    fn precision(&self) -> Vec<f32> {
        let scale = self.scale();
        (0..self.channels[0]).map(|c| scale[c / 3]).collect()
    }

    /// Returns x and y of item `b`.
    fn item(&self, b: usize) -> [&[f32]; 2] {
        [self.x, self.y].map(|points| {
            let n = points.len() / self.batch;
            &points[b * n..][..n]
        })
    }
}

/// Returns the weighted squared distance of two points, without colour if one of them has none.
#[inline(always)]
fn square(u: &[f32], v: &[f32], scale: Scale) -> f32 {
    let part = |from: usize| {
        let [x, y, z] = [0, 1, 2].map(|c| u[from + c] - v[from + c]);
        x * x + y * y + z * z
    };
    let shape = part(0) * scale[0];
    if u.len() == 3 || v.len() == 3 { shape } else { shape + part(3) * scale[1] }
}

/// Returns the mean of the terms `f(b)` of all items, with `n` points each.
fn mean(batch: usize, n: usize, f: impl Fn(usize) -> f64 + Sync + Send) -> f64 {
    sum::tree_f64(&par::map(batch, f)) / (batch * n) as f64
}

/// Refuses different numbers of points.
fn same(p: usize, q: usize) -> Result<usize> {
    if p == q {
        return Ok(p);
    }
    Err(Error::input("loss.points")
        .expected(format!("as many points in y as in x, {p}"))
        .got(q.to_string())
        .hint("use the Chamfer form for points without a common order"))
}

/// One item of the ordered form: points, targets and the weights of the channels.
#[derive(Clone, Copy, Debug)]
pub struct Item<'a> {
    /// Shape (P, D).
    pub x: &'a [f32],
    /// Targets, shape (P, E), with E ≤ D; channels beyond E do not contribute.
    pub y: &'a [f32],
    /// Weights w of the channels, shape (D).
    pub precision: &'a [f32],
}

impl Item<'_> {
    /// Returns P, which is at least 1, and E.
    fn sizes(&self) -> [usize; 2] {
        let p = self.x.len() / self.precision.len();
        [p, self.y.len() / p]
    }
}

/// Returns L_b.
///
/// # Panics
/// Panics if there is no point.
pub fn item(x: &Item<'_>) -> f64 {
    let [p, e] = x.sizes();
    let rows = x.x.chunks_exact(x.precision.len()).zip(x.y.chunks_exact(e));
    let mut loss = 0.0;
    for (u, v) in rows {
        for c in 0..e {
            let error = u[c] - v[c];
            loss += f64::from(x.precision[c] * error) * f64::from(error);
        }
    }
    loss / p as f64
}

/// Adds the gradient of x, for the cotangent `bar` of L_b, to `x_bar`.
///
/// # Panics
/// Panics if there is no point, or if the gradient does not have the shape of x.
pub fn item_adjoint(x: &Item<'_>, bar: f32, x_bar: &mut [f32]) {
    super::assert_like(x_bar, x.x);
    let ([_, e], d) = (x.sizes(), x.precision.len());
    for (i, row) in x_bar.chunks_exact_mut(d).enumerate() {
        for (c, x_bar) in row.iter_mut().enumerate().take(e) {
            *x_bar += x.slope(bar, i * d + c, i * e + c, c);
        }
    }
}

impl Item<'_> {
    /// Returns the derivative of bar·L_b by entry `at` of x, whose target is entry `of`, in channel `c`.
    fn slope(&self, bar: f32, at: usize, of: usize, c: usize) -> f32 {
        let share = 1.0 / self.sizes()[0] as f32;
        ((2.0 * share) * bar) * (self.precision[c] * (self.x[at] - self.y[of]))
    }
}

/// Returns the value of the ordered form.
///
/// # Errors
/// Returns an error for wrong sizes or σ, or points that are not finite.
pub fn ordered(x: &In<'_>) -> Result<f32> {
    let [p, q] = x.check()?;
    same(p, q)?;
    let precision = x.precision();
    let value = mean(x.batch, 1, |b| {
        let [u, v] = x.item(b);
        item(&Item { x: u, y: v, precision: &precision })
    });
    Ok(finite("loss.points", value)? as f32)
}

/// Returns nearest neighbours in both directions; of equally near ones, the lowest index.
///
/// # Errors
/// Returns an error for wrong sizes or σ.
pub fn plan(x: &In<'_>) -> Result<Plan> {
    x.check()?;
    let ([d, e], scale) = (x.channels, x.scale());
    let nearest = |from: &[f32], n: usize, to: &[f32], m: usize| -> Vec<i32> {
        let of = |u: &[f32]| {
            let (mut best, mut least) = (0, f32::INFINITY);
            for (k, v) in to.chunks_exact(m).enumerate() {
                let far = square(u, v, scale);
                if far < least {
                    (best, least) = (k as i32, far);
                }
            }
            best
        };
        from.chunks_exact(n).map(of).collect()
    };
    let items = par::map(x.batch, |b| {
        let [u, v] = x.item(b);
        (nearest(u, d, v, e), nearest(v, e, u, d))
    });
    let mut plan = Plan::default();
    for (f, g) in items {
        plan.nearest_x.extend(f);
        plan.nearest_y.extend(g);
    }
    Ok(plan)
}

impl Plan {
    /// Checks that the plan matches its points.
    fn check(&self, x: &In<'_>) -> Result<[usize; 2]> {
        let [p, q] = x.check()?;
        for (name, near, n, below) in
            [("nearest_x", &self.nearest_x, p, q), ("nearest_y", &self.nearest_y, q, p)]
        {
            let what = || Error::input(format!("plan: array '{name}'"));
            if near.len() != x.batch * n {
                return Err(what().expected(format!("{}x{n} entries", x.batch)).got(near.len().to_string()));
            }
            if let Some(i) = near.iter().position(|&k| usize::try_from(k).map_or(true, |k| k >= below)) {
                return Err(what()
                    .at(format!("entry {i}"))
                    .expected(format!("an index from 0 to {}", below - 1))
                    .got(near[i].to_string()));
            }
        }
        Ok([p, q])
    }
}

/// Returns the value of the Chamfer form for a plan.
///
/// # Errors
/// Returns an error for wrong sizes or σ, a plan that does not match the points, or points that are not
/// finite.
pub fn chamfer(x: &In<'_>, plan: &Plan) -> Result<f32> {
    let [p, q] = plan.check(x)?;
    let ([d, e], scale) = (x.channels, x.scale());
    let there = mean(x.batch, p, |b| {
        let [u, v] = x.item(b);
        let pairs = u.chunks_exact(d).zip(&plan.nearest_x[b * p..][..p]);
        pairs.fold(0.0, |sum, (u, &k)| sum + f64::from(square(u, &v[k as usize * e..][..e], scale)))
    });
    let back = mean(x.batch, q, |b| {
        let [u, v] = x.item(b);
        let pairs = v.chunks_exact(e).zip(&plan.nearest_y[b * q..][..q]);
        pairs.fold(0.0, |sum, (v, &i)| sum + f64::from(square(&u[i as usize * d..][..d], v, scale)))
    });
    Ok(finite("loss.points", there + back)? as f32)
}

/// Adds the gradients of the ordered form (`plan` absent) or of the Chamfer form; `y_bar` is `None` if not
/// requested.
///
/// # Errors
/// Returns an error under the conditions of [`ordered`] and [`chamfer`].
///
/// # Panics
/// Panics if a gradient does not have the shape of its input.
pub fn adjoint(
    x: &In<'_>,
    plan: Option<&Plan>,
    value_bar: f32,
    x_bar: &mut [f32],
    y_bar: Option<&mut [f32]>,
) -> Result<()> {
    let [p, q] = match plan {
        Some(plan) => plan.check(x)?,
        None => {
            let [p, q] = x.check()?;
            [same(p, q)?, q]
        }
    };
    let [d, e] = x.channels;
    let Some(plan) = plan else {
        ordered_adjoint(x, (f64::from(value_bar) / x.batch as f64) as f32, x_bar, y_bar);
        return Ok(());
    };
    // 2·L̄/(B·n)/σ² of both parts, for n points per item.
    let weights = |n: usize| {
        [x.sigmas.xyz, x.sigmas.rgb]
            .map(|sigma| (2.0 * f64::from(value_bar) / (x.batch * n) as f64 / (sigma * sigma)) as f32)
    };
    let (there, back) = (weights(p), weights(q));
    // Calls `term` for every term of item `b`: rows of x and of y, and its weight.
    let terms = |b: usize, term: &mut dyn FnMut(usize, usize, Scale)| {
        for (i, &k) in plan.nearest_x[b * p..][..p].iter().enumerate() {
            term(i, k as usize, there);
        }
        for (k, &i) in plan.nearest_y[b * q..][..q].iter().enumerate() {
            term(i as usize, k, back);
        }
    };
    let add = |bar: &mut [f32], sums: &[f32]| bar.iter_mut().zip(sums).for_each(|(bar, sum)| *bar += *sum);
    super::assert_like(x_bar, x.x);
    par::chunks_mut(x_bar, p * d, |b, bar| {
        let ([u, v], mut sums) = (x.item(b), vec![0.0_f32; bar.len()]);
        terms(b, &mut |i, k, weight| {
            for c in 0..e {
                sums[i * d + c] += weight[c / 3] * (u[i * d + c] - v[k * e + c]);
            }
        });
        add(bar, &sums);
    });
    if let Some(y_bar) = y_bar {
        super::assert_like(y_bar, x.y);
        par::chunks_mut(y_bar, q * e, |b, bar| {
            let ([u, v], mut sums) = (x.item(b), vec![0.0_f32; bar.len()]);
            terms(b, &mut |i, k, weight| {
                for c in 0..e {
                    sums[k * e + c] -= weight[c / 3] * (u[i * d + c] - v[k * e + c]);
                }
            });
            add(bar, &sums);
        });
    }
    Ok(())
}

/// Adds the gradients of the ordered form, with the cotangent `bar` of every L_b.
fn ordered_adjoint(x: &In<'_>, bar: f32, x_bar: &mut [f32], y_bar: Option<&mut [f32]>) {
    let (precision, [d, e]) = (x.precision(), x.channels);
    let of = |b: usize| {
        let [u, v] = x.item(b);
        Item { x: u, y: v, precision: &precision }
    };
    par::chunks_mut(x_bar, x.x.len() / x.batch, |b, x_bar| item_adjoint(&of(b), bar, x_bar));
    if let Some(y_bar) = y_bar {
        super::assert_like(y_bar, x.y);
        par::chunks_mut(y_bar, x.y.len() / x.batch, |b, y_bar| {
            for (at, y_bar) in y_bar.iter_mut().enumerate() {
                *y_bar -= of(b).slope(bar, at / e * d + at % e, at, at % e);
            }
        });
    }
}
