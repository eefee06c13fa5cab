//! `shade.ggx`: the metallic-roughness BRDF, a Lambert lobe and a GGX lobe.
//!
//! ```text
//! f = (1−m)·a/π + D·V·F          α = max(r², α_min)
//! D = α²‖h‖⁴ / (π (α²(n·h)² + ‖n×h‖²)²)          h = v + l, not normalised   (Walter et al. 2007, eq. 33)
//! V = ½ / (n·l·K(n·v) + n·v·K(n·l))          K(c) = √(c² + α²(1−c²))   (Heitz 2014, height-correlated Smith)
//! F = F₀ + (1−F₀)(1−c_d)⁵          F₀ = 0.04(1−m) + m·a          c_d = √(½(1 + v·l))          (Schlick 1994)
//! ```
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | n | `normal` | (P, 3) | any length; normalised here; 0 reflects nothing |
//! | v | `view` | (P, 3) | unit, towards the eye; not normalised here |
//! | l | `light` | (P, 3) | unit, towards the light; not normalised here |
//! | a | `albedo` | (P, 3) | linear, 0..1 |
//! | r | `roughness` | (P) | 0..1 |
//! | m | `metallic` | (P) | 0..1 |
//! | f | `brdf` | (P, 3) | 1/sr, without the cosine |
//!
//! D is expressed with ‖n×h‖², because 1 − (n·h)² cancels for smooth surfaces, where it determines the
//! result.
//!
//! # Rounding
//! Every product is symmetric in v and l, and the two products that are exchanged by a swap are added, so
//! f(v, l) and f(l, v) have the same bits. Sums of three are (x + y) + z. Components of n×h have errors of
//! about 1e-7 whatever their size, so D has a relative error of about 1e-7/α on the flank of its peak. (1−c)⁵
//! is ((x²)·(x²))·x with x = max(1 − c_d, 0).
//!
//! # Kinks and domain
//! f = 0 with zero gradient where n·l ≤ 0 or n·v ≤ 0. Below α_min = 1e-3, α equals α_min and r has no
//! gradient; at equality it has one. There is no other special case for smooth surfaces, and no perfect
//! mirror. The denominator of V is not taken below 1e-15, where cosines under 1e-12 would leave the range of
//! f32; there it has no gradient. The BRDF does not conserve energy: its diffuse lobe has no factor 1 − F, so
//! a white dielectric reflects up to 1.5 of the light (`tests/operators/shade/` contains a table).
//!
//! # Adjoint
//! The adjoint uses logarithmic derivatives of D and V; nothing is saved, and all values are recomputed. The
//! steps after the sums over lights are in double precision. n̄ = (ḡ − n(n·ḡ))/‖N‖ where ḡ accumulates the
//! gradients of n·l, n·v, n·h and ‖n×h‖².
//!
//! Twin: `reference::shade::ggx`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::shade::ggx::{In, forward};
//! let up = [[0.0, 0.0, 1.0]];
//! let albedo = [[0.5; 3]];
//! let x = In { normal: &up, view: &up, light: &up, albedo: &albedo, roughness: &[1.0], metallic: &[0.0] };
//! let mut brdf = [[0.0; 3]];
//! forward(x, &mut brdf);
//! // D = 1/π, V = ¼ and F = 0.04, so f = 0.5/π + 0.01/π
//! assert!((brdf[0][0] - 0.51 / std::f32::consts::PI).abs() < 1e-6);
//! ```

use super::vector::{add, cross, dot, scale, select, unit};
use crate::num::lanes::{Real, f32x8};
use crate::num::par;

/// Smallest α_GGX.
pub const ALPHA_MIN: f32 = 1e-3;
/// Smallest denominator of V.
pub const DENOMINATOR_MIN: f32 = 1e-15;
/// Smallest α²(n·h)² + ‖n×h‖².
const SQUARE_MIN: f32 = 1e-30;
/// Reflectance of a dielectric at normal incidence.
pub const F0_DIELECTRIC: f32 = 0.04;
/// 1/π.
const INV_PI: f32 = std::f32::consts::FRAC_1_PI;

/// Linear albedo, roughness and metallic of a point.
#[derive(Clone, Copy, Debug)]
pub struct Material<L> {
    /// Linear albedo, 0..1.
    pub albedo: [L; 3],
    /// Roughness, 0..1.
    pub roughness: L,
    /// Metallic, 0..1.
    pub metallic: L,
}

/// A point and a view direction: the values that do not depend on the light.
#[derive(Clone, Copy, Debug)]
pub struct Point<L> {
    /// Unit normal, or zero.
    pub normal: [L; 3],
    /// Direction towards the eye.
    pub view: [L; 3],
    /// Cosine n·v.
    pub nv: L,
    /// Squared roughness α².
    pub a2: L,
    /// Term K(n·v).
    pub kv: L,
    /// Diffuse BRDF (1−m)·a/π.
    pub diffuse: [L; 3],
    /// Reflectance F₀ at normal incidence.
    pub f0: [L; 3],
}

/// Values that depend on the light but not on the colour.
#[derive(Clone, Copy, Debug)]
pub struct Facet<L: Real> {
    /// Whether both cosines are positive.
    pub on: L::Mask,
    /// Cosine n·l.
    pub nl: L,
    /// Half vector h = v + l, not normalised.
    h: [L; 3],
    /// Product n·h.
    nh: L,
    /// Cross product n×h.
    c: [L; 3],
    /// α²(n·h)² + ‖n×h‖², or 1 where `on` is not set.
    q: L,
    /// Normal distribution D.
    pub d: L,
    /// Term K(n·l).
    kl: L,
    /// Denominator of V before its lower bound.
    den: L,
    /// Visibility V.
    pub vis: L,
    /// Fresnel factor (1−c_d)⁵.
    p: L,
}

/// Returns K(c) = √(c² + α²(1−c²)).
#[inline(always)]
fn stretched<L: Real>(c: L, a2: L) -> L {
    let c2 = c * c;
    (c2 + a2 * (L::splat(1.0) - c2)).sqrt()
}

impl<L: Real> Point<L> {
    /// Builds a point whose normal is unit or zero.
    #[inline(always)]
    pub fn new(normal: [L; 3], view: [L; 3], m: &Material<L>) -> Self {
        let s = L::splat;
        let alpha = (m.roughness * m.roughness).max(s(ALPHA_MIN));
        let a2 = alpha * alpha;
        let nv = dot(normal, view);
        let rest = s(1.0) - m.metallic;
        let dielectric = s(F0_DIELECTRIC) * rest;
        Self {
            normal,
            view,
            nv,
            a2,
            kv: stretched(nv, a2),
            diffuse: m.albedo.map(|a| rest * a * s(INV_PI)),
            f0: m.albedo.map(|a| dielectric + m.metallic * a),
        }
    }

    /// Returns the factors of the GGX lobe for a light direction.
    #[inline(always)]
    pub fn facet(&self, light: [L; 3]) -> Facet<L> {
        let s = L::splat;
        let (zero, one) = (s(0.0), s(1.0));
        let nl = dot(self.normal, light);
        let on = L::and(nl.gt(zero), self.nv.gt(zero));
        let h = add(self.view, light);
        let nh = dot(self.normal, h);
        let c = cross(self.normal, h);
        // If v = −l within rounding, h vanishes: D is 0 there, not 0/0.
        let q = L::select(on, (self.a2 * (nh * nh) + dot(c, c)).max(s(SQUARE_MIN)), one);
        let ratio = dot(h, h) / q;
        let d = self.a2 * (ratio * ratio) * s(INV_PI);
        let kl = stretched(nl, self.a2);
        let den = L::select(on, nl * self.kv + self.nv * kl, one);
        let vis = s(0.5) / den.max(s(DENOMINATOR_MIN));
        let cd = (s(0.5) * (one + dot(self.view, light)).max(zero)).sqrt();
        let x = (one - cd).max(zero);
        let x2 = x * x;
        Facet { on, nl, h, nh, c, q, d, kl, den, vis, p: x2 * x2 * x }
    }

    /// Returns f of a facet.
    #[inline(always)]
    pub fn brdf(&self, x: &Facet<L>) -> [L; 3] {
        let (zero, one) = (L::splat(0.0), L::splat(1.0));
        let dv = x.d * x.vis;
        let f = std::array::from_fn(|k| self.diffuse[k] + dv * (self.f0[k] + (one - self.f0[k]) * x.p));
        select(x.on, f, [zero; 3])
    }

    /// Returns f(n, v, l).
    #[inline(always)]
    pub fn eval(&self, light: [L; 3]) -> [L; 3] {
        self.brdf(&self.facet(light))
    }
}

impl Point<f32> {
    /// Returns the same point in every lane.
    #[inline(always)]
    pub fn wide(&self) -> Point<f32x8> {
        let s = f32x8::splat;
        Point {
            normal: self.normal.map(s),
            view: self.view.map(s),
            nv: s(self.nv),
            a2: s(self.a2),
            kv: s(self.kv),
            diffuse: self.diffuse.map(s),
            f0: self.f0.map(s),
        }
    }
}

/// Gradients of one point, summed over its lights.
#[derive(Clone, Copy, Debug)]
pub struct PointBar<L> {
    /// Gradient of the unit normal.
    pub normal: [L; 3],
    /// Gradient of a, before the factors that do not depend on the light.
    albedo: [L; 3],
    /// Gradient of m.
    metallic: L,
    /// Gradient of α².
    a2: L,
    /// Σ of the cotangents of the diffuse lobe.
    diffuse: [L; 3],
}

impl<L: Copy> PointBar<L> {
    /// Returns zeros.
    pub(super) fn zeros(zero: L) -> Self {
        Self { normal: [zero; 3], albedo: [zero; 3], metallic: zero, a2: zero, diffuse: [zero; 3] }
    }
}

impl<L: Real> PointBar<L> {
    /// Adds the gradient of ⟨f, `f_bar`⟩ + n·l·`nl_bar` for one light; lanes where the facet is off add
    /// nothing.
    #[inline(always)]
    pub fn add(
        &mut self,
        point: &Point<L>,
        m: &Material<L>,
        light: [L; 3],
        x: &Facet<L>,
        f_bar: [L; 3],
        nl_bar: L,
    ) {
        let s = L::splat;
        let (zero, one) = (s(0.0), s(1.0));
        let g = select(x.on, f_bar, [zero; 3]);
        let nl_bar = L::select(x.on, nl_bar, zero);
        self.diffuse = add(self.diffuse, g);
        // Adjoint of f = diffuse + D V F.
        let dv = x.d * x.vis;
        let rest = dv * (one - x.p); // ∂(D V F)/∂F₀
        for k in 0..3 {
            let f0_bar = g[k] * rest;
            self.albedo[k] = self.albedo[k] + f0_bar;
            self.metallic = self.metallic + f0_bar * (m.albedo[k] - s(F0_DIELECTRIC));
        }
        let fresnel: [L; 3] = std::array::from_fn(|k| point.f0[k] + (one - point.f0[k]) * x.p);
        let dv_bar = dot(g, fresnel);
        // Adjoint of D = α² (‖h‖²/q)²/π,   q = α²(n·h)² + ‖n×h‖². 1/q is multiplied by small factors before
        // large ones.
        let log_bar = dv_bar * dv; // of ln D and ln V
        let inv_q = one / x.q;
        let q_log_bar = s(-4.0) * log_bar; // of ½ ln q
        let nh_bar = q_log_bar * (point.a2 * x.nh * inv_q);
        // ∂ ln D/∂α² = 1/α² − 2(n·h)²/q, without the cancellation on the flank of the peak.
        let spread = dot(x.c, x.c) - point.a2 * (x.nh * x.nh);
        let mut a2_bar = log_bar * (spread * inv_q / point.a2);
        // Adjoint of V = ½/den,   den = n·l K(n·v) + n·v K(n·l).
        let open = x.den.ge(s(DENOMINATOR_MIN));
        let den_bar = L::select(open, -(log_bar / x.den.max(s(DENOMINATOR_MIN))), zero);
        let (kv_bar, kl_bar) = (den_bar * x.nl, den_bar * point.nv);
        let slope = one - point.a2;
        let nl_bar = (nl_bar + den_bar * point.kv) + kl_bar * (x.nl * slope / x.kl);
        let nv_bar = den_bar * x.kl + kv_bar * (point.nv * slope / point.kv);
        let half = s(0.5);
        a2_bar = a2_bar + kv_bar * (half * (one - point.nv * point.nv) / point.kv);
        a2_bar = a2_bar + kl_bar * (half * (one - x.nl * x.nl) / x.kl);
        self.a2 = self.a2 + L::select(x.on, a2_bar, zero);
        // n appears in n·l, n·v, n·h, and in ½‖n×h‖² with gradient h×(n×h).
        let across = scale(cross(x.h, scale(x.c, inv_q)), q_log_bar);
        let along = add(add(scale(light, nl_bar), scale(point.view, nv_bar)), scale(x.h, nh_bar));
        self.normal = add(self.normal, select(x.on, add(along, across), [zero; 3]));
    }
}

/// Sums of the [`PointBar`]s of eight points, in double precision.
#[derive(Clone, Debug)]
pub(super) struct Sums([PointBar<f64>; 8]);

impl Default for Sums {
    fn default() -> Self {
        Self([PointBar::zeros(0.0); 8])
    }
}

/// Gradients (N̄, ā, r̄, m̄) of eight points.
pub(super) type Bar8 = [([f32; 3], [f32; 3], f32, f32); 8];

impl Sums {
    /// Adds to every sum.
    #[inline]
    pub(super) fn add(&mut self, bar: &PointBar<f32x8>) {
        let three = |to: &mut [f64; 3], x: &[f32x8; 3], l: usize| {
            (0..3).for_each(|k| to[k] += f64::from(x[k].to_array()[l]));
        };
        for (l, to) in self.0.iter_mut().enumerate() {
            three(&mut to.normal, &bar.normal, l);
            three(&mut to.albedo, &bar.albedo, l);
            three(&mut to.diffuse, &bar.diffuse, l);
            to.metallic += f64::from(bar.metallic.to_array()[l]);
            to.a2 += f64::from(bar.a2.to_array()[l]);
        }
    }

    /// Applies the adjoints of α² = max(r², α_min)², of the diffuse lobe, and of n = N/‖N‖ with ‖N‖ =
    /// `length` (0: no gradient). The results are rounded once.
    pub(super) fn finish(&self, point: &Point<f32x8>, m: &Material<f32x8>, length: f32x8) -> Bar8 {
        std::array::from_fn(|l| {
            let (bar, one) = (&self.0[l], |x: f32x8| f64::from(x.to_array()[l]));
            let dot = |a: [f64; 3], b: [f64; 3]| (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2];
            let [albedo, n] = [m.albedo, point.normal].map(|v| v.map(one));
            let (r, metallic, length) = (m.roughness.to_array()[l], one(m.metallic), one(length));
            let rough = r * r >= ALPHA_MIN;
            let r = f64::from(r);
            let inv_pi = std::f64::consts::FRAC_1_PI;
            let rest = (1.0 - metallic) * inv_pi;
            let radial = dot(n, bar.normal);
            let turn = |k: usize| if length > 0.0 { (bar.normal[k] - n[k] * radial) / length } else { 0.0 };
            (
                [0, 1, 2].map(|k| turn(k) as f32),
                [0, 1, 2].map(|k| (bar.diffuse[k] * rest + bar.albedo[k] * metallic) as f32),
                // r̄ = ∂α²/∂r for α² = r⁴.
                if rough { (bar.a2 * (4.0 * (r * r) * r)) as f32 } else { 0.0 },
                (bar.metallic - dot(bar.diffuse, albedo) * inv_pi) as f32,
            )
        })
    }
}

/// Inputs, P rows each.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (P, 3).
    pub normal: &'a [[f32; 3]],
    /// Shape (P, 3).
    pub view: &'a [[f32; 3]],
    /// Shape (P, 3).
    pub light: &'a [[f32; 3]],
    /// Shape (P, 3).
    pub albedo: &'a [[f32; 3]],
    /// Shape (P).
    pub roughness: &'a [f32],
    /// Shape (P).
    pub metallic: &'a [f32],
}

/// Gradients, P rows each; the adjoint adds to them.
#[derive(Clone, Debug, PartialEq)]
pub struct InBar {
    /// Shape (P, 3).
    pub normal: Vec<[f32; 3]>,
    /// Shape (P, 3).
    pub albedo: Vec<[f32; 3]>,
    /// Shape (P).
    pub roughness: Vec<f32>,
    /// Shape (P).
    pub metallic: Vec<f32>,
}

/// Rows per task, a multiple of the lane count. It changes no bit, because rows are independent.
const CHUNK: usize = 1024;

/// Returns eight rows; rows past the end repeat the last one.
#[inline(always)]
pub(super) fn rows8(rows: &[[f32; 3]], at: usize) -> [f32x8; 3] {
    let last = rows.len() - 1;
    let pick: [&[f32; 3]; 8] = std::array::from_fn(|l| &rows[Ord::min(at + l, last)]);
    std::array::from_fn(|k| f32x8::from_fn(|l| pick[l][k]))
}

/// Returns eight numbers; those past the end repeat the last one.
#[inline(always)]
pub(super) fn numbers8(x: &[f32], at: usize) -> f32x8 {
    let last = x.len() - 1;
    f32x8::from_fn(|l| x[Ord::min(at + l, last)])
}

/// Returns eight materials.
#[inline(always)]
pub(super) fn materials8(
    albedo: &[[f32; 3]],
    roughness: &[f32],
    metallic: &[f32],
    at: usize,
) -> Material<f32x8> {
    Material {
        albedo: rows8(albedo, at),
        roughness: numbers8(roughness, at),
        metallic: numbers8(metallic, at),
    }
}

/// Computes `brdf` (P, 3).
pub fn forward(x: In<'_>, brdf: &mut [[f32; 3]]) {
    assert!(
        [x.view.len(), x.light.len(), x.albedo.len(), x.roughness.len(), x.metallic.len(), brdf.len()]
            .iter()
            .all(|n| *n == x.normal.len()),
        "every argument has P rows"
    );
    par::chunks_mut(brdf, CHUNK, |c, out| {
        for at in (0..out.len()).step_by(8) {
            let row = c * CHUNK + at;
            let m = materials8(x.albedo, x.roughness, x.metallic, row);
            let point = Point::new(unit(rows8(x.normal, row)).0, rows8(x.view, row), &m);
            let f = point.eval(rows8(x.light, row)).map(f32x8::to_array);
            for (l, o) in out[at..].iter_mut().take(8).enumerate() {
                *o = [f[0][l], f[1][l], f[2][l]];
            }
        }
    });
}

/// Adds the gradients to `x_bar`.
pub fn adjoint(x: In<'_>, brdf_bar: &[[f32; 3]], x_bar: &mut InBar) {
    let p = x.normal.len();
    assert!(brdf_bar.len() == p && x_bar.normal.len() == p, "the cotangent and the gradients have P rows");
    let bars = par::map_batched(p.div_ceil(8), CHUNK / 8, |g| {
        let at = 8 * g;
        let m = materials8(x.albedo, x.roughness, x.metallic, at);
        let (n, length) = unit(rows8(x.normal, at));
        let point = Point::new(n, rows8(x.view, at), &m);
        let light = rows8(x.light, at);
        let mut bar = PointBar::zeros(f32x8::splat(0.0));
        let facet = point.facet(light);
        bar.add(&point, &m, light, &facet, rows8(brdf_bar, at), f32x8::splat(0.0));
        let mut sums = Sums::default();
        sums.add(&bar);
        sums.finish(&point, &m, length)
    });
    for (g, bar) in bars.into_iter().enumerate() {
        scatter_bar(&bar, 8 * g, x_bar);
    }
}

/// Adds eight rows of gradients; those past the end are dropped.
pub(super) fn scatter_bar(bar: &Bar8, at: usize, x_bar: &mut InBar) {
    for (i, (n, a, r, m)) in (at..x_bar.normal.len()).zip(bar) {
        for k in 0..3 {
            x_bar.normal[i][k] += n[k];
            x_bar.albedo[i][k] += a[k];
        }
        x_bar.roughness[i] += r;
        x_bar.metallic[i] += m;
    }
}
