//! The mechanism by which the parents of a node determine it: one network per node, or one weight per edge.
//! `structure` and `intervene` use it.

/// The mechanism by which parents act.
#[derive(Clone, Copy, Debug)]
pub enum Mechanism<'a> {
    /// One weight per edge.
    Linear {
        /// Weights Ω, shape (n, n).
        weight: &'a [f64],
    },
    /// One network per node.
    Networks(Networks<'a>),
    /// Both in sequence, as printed in the LAST paper: weights in every sweep but the last (eq. 2), networks
    /// in the last (eq. 3).
    Printed {
        /// Weights Ω, shape (n, n).
        weight: &'a [f64],
        /// Networks of the last sweep, or of a single application.
        networks: Networks<'a>,
    },
}

/// The mechanism that acts in one sweep.
enum Acting<'b, 'a> {
    Weight(&'a [f64]),
    Networks(&'b Networks<'a>),
}

impl<'a> Mechanism<'a> {
    fn networks(&self) -> Option<&Networks<'a>> {
        match self {
            Self::Linear { .. } => None,
            Self::Networks(networks) | Self::Printed { networks, .. } => Some(networks),
        }
    }

    fn weight(&self) -> Option<&'a [f64]> {
        match self {
            Self::Networks(_) => None,
            Self::Linear { weight } | Self::Printed { weight, .. } => Some(weight),
        }
    }

    /// Whether a sweep uses the networks at 0.
    pub(super) fn is_centred(&self, is_last: bool) -> bool {
        matches!(self.acting(is_last), Acting::Networks(_))
    }

    fn acting(&self, is_last: bool) -> Acting<'_, 'a> {
        match self {
            Self::Linear { weight } => Acting::Weight(weight),
            Self::Printed { weight, .. } if !is_last => Acting::Weight(weight),
            Self::Networks(networks) | Self::Printed { networks, .. } => Acting::Networks(networks),
        }
    }
}

/// One network of two hidden layers per node; the bias of the last layer cancels and is omitted.
#[derive(Clone, Copy, Debug)]
pub struct Networks<'a> {
    /// Shape (n, h, n·k).
    pub w0: &'a [f64],
    /// Shape (n, h).
    pub b0: &'a [f64],
    /// Shape (n, h, h).
    pub w1: &'a [f64],
    /// Shape (n, h).
    pub b1: &'a [f64],
    /// Shape (n, k, h).
    pub w2: &'a [f64],
    /// Hidden width h.
    pub hidden: usize,
    /// Slope of the leaky ReLU at 0 and below.
    pub slope: f64,
}

/// Gradients of a mechanism; the adjoint adds to them. Those of the other kind of mechanism are empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MechanismBar {
    /// Shape (n, n).
    pub weight: Vec<f64>,
    /// Shape (n, h, n·k).
    pub w0: Vec<f64>,
    /// Shape (n, h).
    pub b0: Vec<f64>,
    /// Shape (n, h, h).
    pub w1: Vec<f64>,
    /// Shape (n, h).
    pub b1: Vec<f64>,
    /// Shape (n, k, h).
    pub w2: Vec<f64>,
}

impl MechanismBar {
    /// Returns zeros in the shapes of the mechanism.
    pub fn zeros_like(x: &Mechanism<'_>) -> Self {
        let zeros = |x: &[f64]| vec![0.0; x.len()];
        let of = |get: fn(&Networks<'_>) -> usize| vec![0.0; x.networks().map_or(0, get)];
        Self {
            weight: x.weight().map(zeros).unwrap_or_default(),
            w0: of(|g| g.w0.len()),
            b0: of(|g| g.b0.len()),
            w1: of(|g| g.w1.len()),
            b1: of(|g| g.b1.len()),
            w2: of(|g| g.w2.len()),
        }
    }
}

/// Transposed layers of one node, with inputs as rows, so that one input is combined with all outputs at
/// once. An output is still one chain over its inputs.
#[derive(Debug)]
struct Transposed {
    /// Shape (n·k, h).
    first: Vec<f64>,
    /// Shape (h, h).
    second: Vec<f64>,
    /// Shape (h, k).
    last: Vec<f64>,
}

/// Intermediate values of one pass through a network.
#[derive(Clone, Debug, Default, PartialEq)]
struct Pass {
    /// Input, shape (n·k).
    x: Vec<f64>,
    /// Arguments of both activations, shape (h) each.
    before: [Vec<f64>; 2],
    /// Results of both activations, shape (h) each.
    after: [Vec<f64>; 2],
    /// Output, shape (k).
    y: Vec<f64>,
}

/// The networks at 0, one pass per node; empty for a linear mechanism.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Zero(Vec<Pass>);

/// Buffers that all passes of a call share.
#[derive(Debug)]
pub(super) struct Work {
    pass: Pass,
    /// Cotangents of both activations (h) and of the input (n·k).
    bars: [Vec<f64>; 3],
}

/// The node, the sweep, and the factors of all nodes (n, k).
#[derive(Clone, Copy)]
pub(super) struct At<'a> {
    pub(super) node: usize,
    pub(super) is_last: bool,
    pub(super) z: &'a [f64],
}

/// Mechanisms of all nodes together with the mask.
pub(super) struct Bank<'a> {
    mask: &'a [f64],
    mechanism: Mechanism<'a>,
    turned: Vec<Transposed>,
    n: usize,
    k: usize,
}

/// Returns Σ row·x, a left fold from +0.
fn dot(row: &[f64], x: &[f64]) -> f64 {
    row.iter().zip(x).fold(0.0, |sum, (w, x)| sum + w * x)
}

/// Returns the transpose.
fn turned(w: &[f64], columns: usize) -> Vec<f64> {
    let rows = w.len() / columns;
    (0..w.len()).map(|at| w[at % rows * columns + at / rows]).collect()
}

/// Computes y = Wx from the transpose of W; every entry is a left fold over x from +0.
fn product(turned: &[f64], x: &[f64], y: &mut [f64]) {
    y.fill(0.0);
    for (row, x) in turned.chunks_exact(y.len()).zip(x) {
        y.iter_mut().zip(row).for_each(|(y, w)| *y += w * x);
    }
}

/// Adds entry by entry, up to the length of the shorter slice.
pub(super) fn add(into: &mut [f64], what: &[f64]) {
    into.iter_mut().zip(what).for_each(|(into, what)| *into += what);
}

/// Computes W̄ += ȳ·xᵀ and x̄ = Wᵀȳ, a left fold over the rows.
fn product_adjoint(w: &[f64], x: &[f64], y_bar: &[f64], w_bar: &mut [f64], x_bar: &mut [f64]) {
    x_bar.fill(0.0);
    let rows = w.chunks_exact(x.len()).zip(w_bar.chunks_exact_mut(x.len()));
    for ((row, row_bar), g) in rows.zip(y_bar) {
        x_bar.iter_mut().zip(row).for_each(|(bar, w)| *bar += g * w);
        row_bar.iter_mut().zip(x).for_each(|(bar, x)| *bar += g * x);
    }
}

impl Pass {
    fn sized(d: usize, h: usize, k: usize) -> Self {
        let zeros = |len| vec![0.0; len];
        Self { x: zeros(d), before: [zeros(h), zeros(h)], after: [zeros(h), zeros(h)], y: zeros(k) }
    }
}

impl Networks<'_> {
    fn turned(&self, node: usize, d: usize, k: usize) -> Transposed {
        let h = self.hidden;
        Transposed {
            first: turned(&self.w0[node * h * d..][..h * d], d),
            second: turned(&self.w1[node * h * h..][..h * h], h),
            last: turned(&self.w2[node * k * h..][..k * h], h),
        }
    }

    /// Applies the biases and the activation of a hidden layer.
    fn activate(&self, bias: &[f64], before: &mut [f64], after: &mut [f64]) {
        for ((before, after), b) in before.iter_mut().zip(after).zip(bias) {
            *before += b;
            *after = if *before > 0.0 { *before } else { self.slope * *before };
        }
    }

    /// Computes all values of the pass from its input.
    fn pass(&self, node: usize, turned: &Transposed, pass: &mut Pass) {
        let h = self.hidden;
        let Pass { x, before: [p0, p1], after: [a0, a1], y } = pass;
        product(&turned.first, x, p0);
        self.activate(&self.b0[node * h..], p0, a0);
        product(&turned.second, a0, p1);
        self.activate(&self.b1[node * h..], p1, a1);
        product(&turned.last, a1, y);
    }

    /// Adds the gradients of one pass; that of its input is written to `bars[2]`.
    fn pass_adjoint(
        &self,
        node: usize,
        pass: &Pass,
        y_bar: &[f64],
        bars: &mut [Vec<f64>; 3],
        bar: &mut MechanismBar,
    ) {
        let (h, d, k) = (self.hidden, pass.x.len(), y_bar.len());
        let through = |bars: &mut [f64], before: &[f64]| {
            for (bar, before) in bars.iter_mut().zip(before) {
                *bar = if *before > 0.0 { *bar } else { self.slope * *bar };
            }
        };
        let [bar1, bar0, x_bar] = bars;
        product_adjoint(
            &self.w2[node * k * h..][..k * h],
            &pass.after[1],
            y_bar,
            &mut bar.w2[node * k * h..],
            bar1,
        );
        through(bar1, &pass.before[1]);
        add(&mut bar.b1[node * h..], bar1);
        product_adjoint(
            &self.w1[node * h * h..][..h * h],
            &pass.after[0],
            bar1,
            &mut bar.w1[node * h * h..],
            bar0,
        );
        through(bar0, &pass.before[0]);
        add(&mut bar.b0[node * h..], bar0);
        product_adjoint(&self.w0[node * h * d..][..h * d], &pass.x, bar0, &mut bar.w0[node * h * d..], x_bar);
    }
}

impl<'a> Bank<'a> {
    pub(super) fn new(mask: &'a [f64], mechanism: Mechanism<'a>, n: usize, k: usize) -> Self {
        assert!(n > 0 && k > 0, "n and k are at least 1");
        assert_eq!(mask.len(), n * n, "mask is (n, n)");
        let mut turned = Vec::new();
        if let Some(weight) = mechanism.weight() {
            assert_eq!(weight.len(), n * n, "weight is (n, n)");
        }
        if let Some(g) = mechanism.networks() {
            let h = g.hidden;
            assert!(h > 0, "networks have hidden units");
            assert!(g.w0.len() == n * h * n * k && g.b0.len() == n * h, "first layer is (n, h, n·k)");
            assert!(g.w1.len() == n * h * h && g.b1.len() == n * h, "second layer is (n, h, h)");
            assert_eq!(g.w2.len(), n * k * h, "last layer is (n, k, h)");
            turned = (0..n).map(|j| g.turned(j, n * k, k)).collect();
        }
        Self { mask, mechanism, turned, n, k }
    }

    fn hidden(&self) -> usize {
        self.mechanism.networks().map_or(0, |g| g.hidden)
    }

    /// Returns buffers for [`Self::effect`] and [`Self::effect_adjoint`].
    pub(super) fn work(&self) -> Work {
        let (d, h) = (self.n * self.k, self.hidden());
        Work { pass: Pass::sized(d, h, self.k), bars: [vec![0.0; h], vec![0.0; h], vec![0.0; d]] }
    }

    /// Returns the networks at 0.
    pub(super) fn zero(&self) -> Zero {
        let Some(g) = self.mechanism.networks() else { return Zero(Vec::new()) };
        let at_zero = |(j, turned): (usize, &Transposed)| {
            let mut pass = Pass::sized(self.n * self.k, g.hidden, self.k);
            g.pass(j, turned, &mut pass);
            pass
        };
        Zero(self.turned.iter().enumerate().map(at_zero).collect())
    }

    /// Computes Ã(·,j)∘z for all factors in order.
    fn masked(&self, j: usize, z: &[f64], x: &mut [f64]) {
        for (i, (x, z)) in x.chunks_exact_mut(self.k).zip(z.chunks_exact(self.k)).enumerate() {
            let m = self.mask[i * self.n + j];
            x.iter_mut().zip(z).for_each(|(x, z)| *x = m * z);
        }
    }

    /// Computes the contribution of the parents to a node (k).
    pub(super) fn effect(&self, zero: &Zero, at: At<'_>, work: &mut Work, out: &mut [f64]) {
        let (n, k, j, z) = (self.n, self.k, at.node, at.z);
        match self.mechanism.acting(at.is_last) {
            Acting::Weight(weight) => {
                out.fill(0.0);
                for i in 0..n {
                    let w = self.mask[i * n + j] * weight[i * n + j];
                    out.iter_mut().zip(&z[i * k..]).for_each(|(out, z)| *out += w * z);
                }
            }
            Acting::Networks(g) => {
                self.masked(j, z, &mut work.pass.x);
                g.pass(j, &self.turned[j], &mut work.pass);
                let both = work.pass.y.iter().zip(&zero.0[j].y);
                out.iter_mut().zip(both).for_each(|(out, (y, at_zero))| *out = y - at_zero);
            }
        }
    }

    /// Adds the gradients of [`Self::effect`] for the cotangent `c` (k), without those of the networks at 0.
    pub(super) fn effect_adjoint(
        &self,
        at: At<'_>,
        c: &[f64],
        work: &mut Work,
        z_bar: &mut [f64],
        mask_bar: &mut [f64],
        bar: &mut MechanismBar,
    ) {
        let (n, k, j, z) = (self.n, self.k, at.node, at.z);
        match self.mechanism.acting(at.is_last) {
            Acting::Weight(weight) => {
                for i in 0..n {
                    let (m, w) = (self.mask[i * n + j], weight[i * n + j]);
                    let both = dot(c, &z[i * k..(i + 1) * k]);
                    mask_bar[i * n + j] += w * both;
                    bar.weight[i * n + j] += m * both;
                    z_bar[i * k..].iter_mut().zip(c).for_each(|(z_bar, c)| *z_bar += m * w * c);
                }
            }
            Acting::Networks(g) => {
                self.masked(j, z, &mut work.pass.x);
                g.pass(j, &self.turned[j], &mut work.pass);
                g.pass_adjoint(j, &work.pass, c, &mut work.bars, bar);
                for i in 0..n {
                    let (x_bar, z) = (&work.bars[2][i * k..(i + 1) * k], &z[i * k..(i + 1) * k]);
                    mask_bar[i * n + j] += dot(x_bar, z);
                    let m = self.mask[i * n + j];
                    z_bar[i * k..].iter_mut().zip(x_bar).for_each(|(z_bar, x_bar)| *z_bar += m * x_bar);
                }
            }
        }
    }

    /// Adds the gradients that come through the networks at 0; `sums` (n, k) are the cotangents of a sample's
    /// effects.
    pub(super) fn zero_adjoint(&self, zero: &Zero, sums: &[f64], work: &mut Work, bar: &mut MechanismBar) {
        let Some(g) = self.mechanism.networks() else { return };
        for (j, pass) in zero.0.iter().enumerate() {
            let y_bar: Vec<f64> = sums[j * self.k..(j + 1) * self.k].iter().map(|c| -c).collect();
            g.pass_adjoint(j, pass, &y_bar, &mut work.bars, bar);
        }
    }
}
