//! How the parents of a node act on it: one network per node, or one weight per edge. Used by `structure` and `intervene`.

/// How parents act.
#[derive(Clone, Copy, Debug)]
pub enum Mechanism<'a> {
    /// a number per edge
    Linear {
        /// Ω (n, n)
        weight: &'a [f64],
    },
    /// a network per node
    Networks(Networks<'a>),
}

/// One network of two hidden layers per node; the bias of the last layer cancels and is left out.
#[derive(Clone, Copy, Debug)]
pub struct Networks<'a> {
    /// (n, h, n·k)
    pub w0: &'a [f64],
    /// (n, h)
    pub b0: &'a [f64],
    /// (n, h, h)
    pub w1: &'a [f64],
    /// (n, h)
    pub b1: &'a [f64],
    /// (n, k, h)
    pub w2: &'a [f64],
    /// hidden width h
    pub hidden: usize,
    /// slope of the leaky ReLU at 0 and below
    pub slope: f64,
}

/// Gradients of a mechanism, accumulated into; those of the other kind are empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MechanismBar {
    /// (n, n)
    pub weight: Vec<f64>,
    /// (n, h, n·k)
    pub w0: Vec<f64>,
    /// (n, h)
    pub b0: Vec<f64>,
    /// (n, h, h)
    pub w1: Vec<f64>,
    /// (n, h)
    pub b1: Vec<f64>,
    /// (n, k, h)
    pub w2: Vec<f64>,
}

impl MechanismBar {
    /// Zeros in the shapes of the mechanism.
    pub fn zeros_like(x: &Mechanism<'_>) -> Self {
        let zeros = |x: &[f64]| vec![0.0; x.len()];
        match x {
            Mechanism::Linear { weight } => Self { weight: zeros(weight), ..Self::default() },
            Mechanism::Networks(g) => Self {
                w0: zeros(g.w0),
                b0: zeros(g.b0),
                w1: zeros(g.w1),
                b1: zeros(g.b1),
                w2: zeros(g.w2),
                ..Self::default()
            },
        }
    }
}

/// Arguments of both hidden activations, and the result.
#[derive(Clone, Debug, Default, PartialEq)]
struct Pass {
    hidden: [Vec<f64>; 2],
    y: Vec<f64>,
}

/// The networks at 0, one pass per node; empty for a linear mechanism.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Zero(Vec<Pass>);

/// Which node, and the factors of all nodes (n, k).
#[derive(Clone, Copy)]
pub(super) struct At<'a> {
    pub(super) node: usize,
    pub(super) z: &'a [f64],
}

/// Mechanisms of all nodes behind a mask.
pub(super) struct Bank<'a> {
    mask: &'a [f64],
    mechanism: Mechanism<'a>,
    n: usize,
    k: usize,
}

/// Σ row·x, left fold from +0.
fn dot(row: &[f64], x: &[f64]) -> f64 {
    row.iter().zip(x).fold(0.0, |sum, (w, x)| sum + w * x)
}

impl Networks<'_> {
    fn act(&self, x: f64) -> f64 {
        if x > 0.0 { x } else { self.slope * x }
    }

    fn activated(&self, x: &[f64]) -> Vec<f64> {
        x.iter().map(|x| self.act(*x)).collect()
    }

    fn pass(&self, node: usize, x: &[f64], k: usize) -> Pass {
        let (h, d) = (self.hidden, x.len());
        let layer = |w: &[f64], b: &[f64], x: &[f64]| -> Vec<f64> {
            w.chunks_exact(x.len()).zip(b).map(|(row, b)| dot(row, x) + b).collect()
        };
        let p0 = layer(&self.w0[node * h * d..][..h * d], &self.b0[node * h..][..h], x);
        let p1 = layer(&self.w1[node * h * h..][..h * h], &self.b1[node * h..][..h], &self.activated(&p0));
        let last = self.activated(&p1);
        let y = self.w2[node * k * h..][..k * h].chunks_exact(h).map(|row| dot(row, &last)).collect();
        Pass { hidden: [p0, p1], y }
    }

    /// Adds the gradients of one pass; the result is that of its input.
    fn pass_adjoint(
        &self,
        node: usize,
        x: &[f64],
        pass: &Pass,
        y_bar: &[f64],
        bar: &mut MechanismBar,
    ) -> Vec<f64> {
        let (h, d, k) = (self.hidden, x.len(), y_bar.len());
        let [p0, p1] = &pass.hidden;
        let through = |bars: Vec<f64>, p: &[f64]| -> Vec<f64> {
            bars.into_iter().zip(p).map(|(bar, p)| if *p > 0.0 { bar } else { self.slope * bar }).collect()
        };
        let last_bar =
            outer(&self.w2[node * k * h..][..k * h], &self.activated(p1), y_bar, &mut bar.w2[node * k * h..]);
        let p1_bar = through(last_bar, p1);
        bar.b1[node * h..].iter_mut().zip(&p1_bar).for_each(|(b, g)| *b += g);
        let first_bar = outer(
            &self.w1[node * h * h..][..h * h],
            &self.activated(p0),
            &p1_bar,
            &mut bar.w1[node * h * h..],
        );
        let p0_bar = through(first_bar, p0);
        bar.b0[node * h..].iter_mut().zip(&p0_bar).for_each(|(b, g)| *b += g);
        outer(&self.w0[node * h * d..][..h * d], x, &p0_bar, &mut bar.w0[node * h * d..])
    }
}

/// W̄ += ȳ·xᵀ; gives Wᵀȳ, a left fold over the rows.
fn outer(w: &[f64], x: &[f64], y_bar: &[f64], w_bar: &mut [f64]) -> Vec<f64> {
    let mut x_bar = vec![0.0; x.len()];
    let rows = w.chunks_exact(x.len()).zip(w_bar.chunks_exact_mut(x.len()));
    for ((row, row_bar), g) in rows.zip(y_bar) {
        x_bar.iter_mut().zip(row).for_each(|(bar, w)| *bar += g * w);
        row_bar.iter_mut().zip(x).for_each(|(bar, x)| *bar += g * x);
    }
    x_bar
}

impl<'a> Bank<'a> {
    pub(super) fn new(mask: &'a [f64], mechanism: Mechanism<'a>, n: usize, k: usize) -> Self {
        assert_eq!(mask.len(), n * n, "mask is (n, n)");
        match &mechanism {
            Mechanism::Linear { weight } => assert_eq!(weight.len(), n * n, "weight is (n, n)"),
            Mechanism::Networks(g) => {
                let h = g.hidden;
                assert!(g.w0.len() == n * h * n * k && g.b0.len() == n * h, "first layer is (n, h, n·k)");
                assert!(g.w1.len() == n * h * h && g.b1.len() == n * h, "second layer is (n, h, h)");
                assert_eq!(g.w2.len(), n * k * h, "last layer is (n, k, h)");
            }
        }
        Self { mask, mechanism, n, k }
    }

    /// The networks at 0.
    pub(super) fn zero(&self) -> Zero {
        let Mechanism::Networks(g) = &self.mechanism else { return Zero(Vec::new()) };
        let nothing = vec![0.0; self.n * self.k];
        Zero((0..self.n).map(|j| g.pass(j, &nothing, self.k)).collect())
    }

    /// Ã(·,j)∘z, all factors in order.
    fn masked(&self, j: usize, z: &[f64]) -> Vec<f64> {
        z.iter().enumerate().map(|(at, z)| self.mask[at / self.k * self.n + j] * z).collect()
    }

    /// What the parents of node j give it (k).
    pub(super) fn effect(&self, zero: &Zero, j: usize, z: &[f64]) -> Vec<f64> {
        match &self.mechanism {
            Mechanism::Linear { weight } => {
                let w = |i: usize| self.mask[i * self.n + j] * weight[i * self.n + j];
                (0..self.k).map(|c| (0..self.n).fold(0.0, |sum, i| sum + w(i) * z[i * self.k + c])).collect()
            }
            Mechanism::Networks(g) => {
                let pass = g.pass(j, &self.masked(j, z), self.k);
                pass.y.iter().zip(&zero.0[j].y).map(|(y, at_zero)| y - at_zero).collect()
            }
        }
    }

    /// Adds the gradients of [`Self::effect`] for the cotangent `c` (k), without those of the networks at 0.
    pub(super) fn effect_adjoint(
        &self,
        at: At<'_>,
        c: &[f64],
        z_bar: &mut [f64],
        mask_bar: &mut [f64],
        bar: &mut MechanismBar,
    ) {
        let (n, k, j, z) = (self.n, self.k, at.node, at.z);
        match &self.mechanism {
            Mechanism::Linear { weight } => {
                for i in 0..n {
                    let (m, w) = (self.mask[i * n + j], weight[i * n + j]);
                    let both = dot(c, &z[i * k..(i + 1) * k]);
                    mask_bar[i * n + j] += w * both;
                    bar.weight[i * n + j] += m * both;
                    z_bar[i * k..].iter_mut().zip(c).for_each(|(z_bar, c)| *z_bar += m * w * c);
                }
            }
            Mechanism::Networks(g) => {
                let x = self.masked(j, z);
                let x_bar = g.pass_adjoint(j, &x, &g.pass(j, &x, k), c, bar);
                for i in 0..n {
                    let (x_bar, z) = (&x_bar[i * k..(i + 1) * k], &z[i * k..(i + 1) * k]);
                    mask_bar[i * n + j] += dot(x_bar, z);
                    let m = self.mask[i * n + j];
                    z_bar[i * k..].iter_mut().zip(x_bar).for_each(|(z_bar, x_bar)| *z_bar += m * x_bar);
                }
            }
        }
    }

    /// Adds the gradients that come through the networks at 0; `sums` (n, k) are the cotangents of the effects.
    pub(super) fn zero_adjoint(&self, zero: &Zero, sums: &[f64], bar: &mut MechanismBar) {
        let Mechanism::Networks(g) = &self.mechanism else { return };
        let nothing = vec![0.0; self.n * self.k];
        for (j, pass) in zero.0.iter().enumerate() {
            let y_bar: Vec<f64> = sums[j * self.k..(j + 1) * self.k].iter().map(|c| -c).collect();
            g.pass_adjoint(j, &nothing, pass, &y_bar, bar);
        }
    }
}
