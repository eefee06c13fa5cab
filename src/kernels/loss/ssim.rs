//! `loss.ssim`: mean structural similarity of two images.
//!
//! SSIM = (2μ_xμ_y + C₁)(2σ_xy + C₂) / ((μ_x² + μ_y² + C₁)(σ_x² + σ_y² + C₂))   (Wang et al. 2004, eq. 13)
//!
//! with local moments under an 11×11 Gaussian window, σ = 1.5, zero padding; both images are multiplied by
//! the mask, and the map is averaged over the kept pixels and the three channels.
//!
//! | symbol | argument | shape | unit, range |
//! |---|---|---|---|
//! | x | `x` | (H, W, 3) | sRGB-encoded, 0..1 |
//! | y | `y` | (H, W, 3) | sRGB-encoded, 0..1 |
//! | – | `mask` | (H, W) | 0 or 1 |
//! | value | return | () | 1 for equal images |
//!
//! # Rounding
//! The textbook form subtracts nearly equal second moments four times. This implementation filters the half
//! sum h = (x + y)·½ − ½ and the difference d = x − y instead, because
//!
//! 2μ_xμ_y = (μ_x² + μ_y²) − μ_d²,   2σ_xy = (σ_x² + σ_y²) − σ_d²,   σ_x² + σ_y² = 2σ_h² + ½σ_d²
//!
//! turn the two quotients into l = 1 − μ_d²/B₁ and c = 1 − σ_d²/B₂, which are exact where the images agree,
//! and four filtered images suffice instead of five. The shift by ½ makes σ_h² exact on black and on white.
//! One filter pass goes down the columns, then along the rows, and each is a left fold of the 11 products
//! from the first tap to the last, in f32; pixels outside are x = y = 0, so h = −½. Then, per value,
//!
//! v_d = e_d − m_d², v_h = e_h − m_h², m = m_h + ½, B₁ = (2m² + ½m_d²) + C₁, B₂ = (2v_h + ½v_d) + C₂,
//! l = 1 − m_d²·(1/B₁), c = 1 − v_d·(1/B₂), SSIM = l·c
//!
//! and the map is summed in f64 (rows of 16 logical lanes, tree over rows: [`super`]), divided once, rounded
//! once. Therefore SSIM(x, x) = 1 and SSIM(x, y) = SSIM(y, x) in bits.
//!
//! # Kinks and domain
//! The function is smooth for finite images: B₁ ≥ C₁; B₂ > 0 for values of moderate size (|x|, |y| below
//! about 30, where the rounding of σ² stays below C₂). Pixels that the mask excludes get no gradient. It is
//! an error if no pixel is kept. Zero padding lowers the value near the border, as in the 3DGS code.
//!
//! # Adjoint
//! With the filter G (self-adjoint, as the window is symmetric) and the derivatives of the map by the four
//! moments,
//!
//! P = ∂/∂e_h = 2lu/B₂,  Q = ∂/∂e_d = −½l(1+c)/B₂,  ∂/∂m_d = −(m_d/B₁)(1+l)c − 2m_dQ,
//! ∂/∂m_h = 4m·t·c/B₁ − 2m_hP
//!
//! where t = 1 − l, u = 1 − c, the gradients are
//!
//! x̄ += s·mask·(G(½∂m_h + ∂m_d) + 2d·G(Q) + h·G(P)),   ȳ += s·mask·(G(½∂m_h − ∂m_d) − 2d·G(Q) + h·G(P)),
//! s = v̄/n.
//!
//! The four maps are saved; h and d are recomputed; s is applied last, so the gradient is linear in v̄ up to
//! one rounding. Without `y_bar` only three maps are filtered. At x = y the gradient is exactly 0.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::loss::ssim::{C1, C2, In, WINDOW, forward};
//! let image = [0.2, 0.5, 0.9, 1.0, 0.0, 0.3];
//! assert_eq!(forward(&In { x: &image, y: &image, mask: None, height: 1, width: 2 })?.0, 1.0);
//! // one white pixel against a black one: μ_x = w and σ_x² = w − w², where w is the window's central weight
//! let w = WINDOW[5] * WINDOW[5];
//! let by_hand = C1 * C2 / ((w * w + C1) * (w - w * w + C2));
//! let (value, _) = forward(&In { x: &[1.0; 3], y: &[0.0; 3], mask: None, height: 1, width: 1 })?;
//! assert!((f64::from(value) - by_hand).abs() < 1e-6);
//! # Ok::<(), lastlight::Error>(())
//! ```

pub use super::In;
use super::{CHANNELS, assert_like, finite, row_sum};
use crate::Result;
use crate::num::lanes::{Real, f32x8};
use crate::num::{par, sum};

/// Half of the symmetric window, outermost tap first: exp(−(k−5)²/(2·1.5²)) / Σ, k = 0…5. Rounded to f32, the
/// eleven taps add up, from the first to the last, to exactly 1.
pub const WINDOW: [f64; 6] = [
    0.0010283800844791092,
    0.007598758135239185,
    0.03600077212843083,
    0.10936068950970002,
    0.2130055377112537,
    0.26601172486179436,
];
/// Stabilises the luminance quotient: (0.01·range)² with range 1.
pub const C1: f64 = 0.01 * 0.01;
/// Stabilises the structure quotient: (0.03·range)² with range 1.
pub const C2: f64 = 0.03 * 0.03;

/// Taps of the window.
const TAPS: usize = 11;
/// Number of values that the window extends to each side along an interleaved row.
const PAD: usize = TAPS / 2 * CHANNELS;
/// Rows computed together, because they share input rows.
const BLOCK: usize = 2;
/// Input rows of a block.
const SPAN: usize = TAPS + BLOCK - 1;
/// Pixels that one task masks.
const ROW_CHUNK: usize = 4096;
/// Number of saved maps and of filtered images.
const MAPS: usize = 4;

/// Returns the window in f32.
fn taps() -> [f32; TAPS] {
    std::array::from_fn(|k| WINDOW[if k < 6 { k } else { 10 - k }] as f32)
}

/// Intermediate values that the adjoint needs.
#[derive(Clone, Debug)]
pub struct Saved {
    /// Maps (H, 4, 3 W): ½∂m_h + ∂m_d, Q, P, ½∂m_h − ∂m_d; zero where a pixel is excluded.
    maps: Vec<f32>,
    /// Masked images x·mask and y·mask, (H, W, 3) each, if there is a mask.
    masked: Option<(Vec<f32>, Vec<f32>)>,
    /// Number n of kept values.
    count: usize,
}

#[inline(always)]
fn load<V: Real>(from: &[f32], i: usize) -> V {
    let s = &from[i..i + V::N];
    V::from_fn(|l| s[l])
}

#[inline(always)]
fn store<V: Real>(to: &mut [f32], i: usize, v: V) {
    for (l, slot) in to[i..i + V::N].iter_mut().enumerate() {
        *slot = v.lane(l);
    }
}

/// Runs a body for every value of a row, eight at a time, then one at a time, with the same bits.
macro_rules! along {
    ($n:expr, $V:ident, $i:ident => $body:block) => {{
        let (n, mut $i) = ($n, 0);
        while $i + 8 <= n {
            type $V = f32x8;
            $body
            $i += 8;
        }
        while $i < n {
            type $V = f32;
            $body
            $i += 1;
        }
    }};
}

/// Returns the half sum (shifted by ½) and the difference.
#[inline(always)]
fn half_sum_and_difference<V: Real>(a: V, b: V) -> (V, V) {
    let half = V::splat(0.5);
    ((a + b) * half - half, a - b)
}

/// Performs one step of the left folds down the columns: input row `j` of the block is added to every output
/// row that uses it.
#[inline(always)]
fn fold_down<V: Real, const M: usize>(
    acc: &mut [[V; M]; BLOCK],
    j: usize,
    taps: &[f32; TAPS],
    values: [V; M],
) {
    for (o, row) in acc.iter_mut().enumerate() {
        if j == o {
            for m in 0..M {
                row[m] = V::splat(taps[0]) * values[m];
            }
        } else if j > o && j - o < TAPS {
            for m in 0..M {
                row[m] = row[m] + V::splat(taps[j - o]) * values[m];
            }
        }
    }
}

/// Returns a left fold along an interleaved row; `line[i]` is the first tap.
#[inline(always)]
fn fold_along<V: Real>(line: &[f32], i: usize, taps: &[f32; TAPS]) -> V {
    let s = &line[i..i + CHANNELS * (TAPS - 1) + V::N];
    let mut acc = V::splat(taps[0]) * load::<V>(s, 0);
    for k in 1..TAPS {
        acc = acc + V::splat(taps[k]) * load::<V>(s, CHANNELS * k);
    }
    acc
}

/// Returns rows `first − 5 …` of an image that a block needs; `outside` represents the rows beyond its
/// borders.
fn span<'a>(
    first: usize,
    height: usize,
    row: impl Fn(usize) -> &'a [f32],
    outside: &'a [f32],
) -> [&'a [f32]; SPAN] {
    std::array::from_fn(|j| match (first + j).checked_sub(TAPS / 2) {
        Some(r) if r < height => row(r),
        _ => outside,
    })
}

/// Returns the value of the map and its derivatives [½∂m_h + ∂m_d, Q, P, ½∂m_h − ∂m_d] from the four filtered
/// images.
#[inline(always)]
fn similarity<V: Real>(m_h: V, m_d: V, e_h: V, e_d: V) -> (V, [V; MAPS]) {
    let (half, one, two, four) = (V::splat(0.5), V::splat(1.0), V::splat(2.0), V::splat(4.0));
    let m = m_h + half;
    let dd = m_d * m_d;
    let (v_h, v_d) = (e_h - m_h * m_h, e_d - dd);
    let i1 = one / ((two * (m * m) + half * dd) + V::splat(C1 as f32));
    let i2 = one / ((two * v_h + half * v_d) + V::splat(C2 as f32));
    let (t, u) = (dd * i1, v_d * i2);
    let (l, c) = (one - t, one - u);
    let p = two * (l * u) * i2;
    let q = -(half * (l * (one + c)) * i2);
    let by_m_d = -((m_d * i1) * ((one + l) * c)) - two * m_d * q;
    let by_m_h = half * ((four * m * i1) * (t * c) - two * m_h * p);
    (l * c, [by_m_h + by_m_d, q, p, by_m_h - by_m_d])
}

/// Returns the product of image and mask.
fn masked(image: &[f32], mask: &[f32]) -> Vec<f32> {
    let mut out = vec![0.0f32; image.len()];
    par::chunks_mut(&mut out, CHANNELS * ROW_CHUNK, |chunk, out| {
        let at = chunk * ROW_CHUNK;
        let pixels = image[CHANNELS * at..].chunks_exact(CHANNELS).zip(&mask[at..]);
        for (to, (from, &m)) in out.chunks_exact_mut(CHANNELS).zip(pixels) {
            for c in 0..CHANNELS {
                to[c] = from[c] * m;
            }
        }
    });
    out
}

/// Returns the value and the intermediate values that the adjoint needs.
///
/// # Errors
/// Returns an error for wrong sizes, a mask value other than 0 and 1, a mask that keeps no pixel, or images
/// that are not finite.
pub fn forward(x: &In<'_>) -> Result<(f32, Saved)> {
    let count = CHANNELS * x.check("loss.ssim")?;
    let masked = x.mask.map(|m| (masked(x.x, m), masked(x.y, m)));
    let (a, b) = masked.as_ref().map_or((x.x, x.y), |(a, b)| (&a[..], &b[..]));
    let (n, height, taps) = (x.row(), x.height, taps());
    let mut maps = vec![0.0f32; height * MAPS * n];
    let mut sums = vec![0.0f64; height];
    let outside = vec![0.0f32; n];
    let len = n + 2 * PAD;
    par::chunks_mut2(&mut maps, BLOCK * MAPS * n, &mut sums, BLOCK, |block, maps, sums| {
        let first = block * BLOCK;
        // Lines are filtered down the columns, (BLOCK, 4: h, d, h², d²; 3 W + padding).
        let mut lines = vec![0.0f32; BLOCK * MAPS * len];
        for (i, line) in lines.chunks_exact_mut(len).enumerate() {
            // Beyond the left and right border, the same fold runs over pixels x = y = 0.
            let value = [-0.5, 0.0, 0.25, 0.0][i % MAPS];
            let edge = taps[1..].iter().fold(taps[0] * value, |acc, w| acc + w * value);
            line[..PAD].fill(edge);
            line[len - PAD..].fill(edge);
        }
        let rows_a = span(first, height, |r| &a[r * n..][..n], &outside).map(|r| &r[..n]);
        let rows_b = span(first, height, |r| &b[r * n..][..n], &outside).map(|r| &r[..n]);
        along!(n, V, i => {
            let mut acc = [[V::splat(0.0); MAPS]; BLOCK];
            for j in 0..SPAN {
                let (h, d) = half_sum_and_difference(load::<V>(rows_a[j], i), load::<V>(rows_b[j], i));
                fold_down(&mut acc, j, &taps, [h, d, h * h, d * d]);
            }
            for (o, row) in acc.iter().enumerate() {
                for (m, &v) in row.iter().enumerate() {
                    store(&mut lines, (o * MAPS + m) * len + PAD + i, v);
                }
            }
        });
        let mut terms = vec![0.0f32; n];
        for (o, (maps, sum)) in maps.chunks_exact_mut(MAPS * n).zip(sums).enumerate() {
            let line = |m: usize| &lines[(o * MAPS + m) * len..][..len];
            let lines = [line(0), line(1), line(2), line(3)];
            along!(n, V, i => {
                let [m_h, m_d, e_h, e_d] = lines.map(|l| fold_along::<V>(l, i, &taps));
                let (value, by) = similarity(m_h, m_d, e_h, e_d);
                store(&mut terms, i, value);
                for (m, v) in by.into_iter().enumerate() {
                    store(maps, m * n + i, v);
                }
            });
            if let Some(mask) = x.mask_row(first + o) {
                for i in 0..n {
                    if mask[i / CHANNELS] == 0.0 {
                        terms[i] = 0.0;
                        for m in 0..MAPS {
                            maps[m * n + i] = 0.0;
                        }
                    }
                }
            }
            *sum = row_sum(n, |i| f64::from(terms[i]));
        }
    });
    let total = finite("loss.ssim", sum::tree_f64(&sums))?;
    Ok(((total / count as f64) as f32, Saved { maps, masked, count }))
}

/// Adds the gradients; `y_bar` is `None` if not requested (it costs a fourth filtered map).
pub fn adjoint(x: &In<'_>, saved: &Saved, value_bar: f32, x_bar: &mut [f32], y_bar: Option<&mut [f32]>) {
    assert_like(x_bar, x.x);
    let rows = BLOCK * x.row();
    match y_bar {
        None => par::chunks_mut(x_bar, rows, |block, x_bar| {
            pull_back::<{ MAPS - 1 }>(x, saved, value_bar, block, [x_bar, &mut []]);
        }),
        Some(y_bar) => {
            assert_like(y_bar, x.y);
            par::chunks_mut2(x_bar, rows, y_bar, rows, |block, x_bar, y_bar| {
                pull_back::<MAPS>(x, saved, value_bar, block, [x_bar, y_bar]);
            });
        }
    }
}

/// Adds the gradient of one block of rows: filters the first `M` maps and adds to the rows of x̄ and, for M =
/// 4, of ȳ.
fn pull_back<const M: usize>(x: &In<'_>, saved: &Saved, value_bar: f32, block: usize, bars: [&mut [f32]; 2]) {
    let (a, b) = saved.masked.as_ref().map_or((x.x, x.y), |(a, b)| (&a[..], &b[..]));
    let (n, height, taps) = (x.row(), x.height, taps());
    let (first, len) = (block * BLOCK, n + 2 * PAD);
    let scale = (f64::from(value_bar) / saved.count as f64) as f32;
    let outside = vec![0.0f32; M * n];
    let mut lines = vec![0.0f32; BLOCK * M * len];
    let rows = span(first, height, |r| &saved.maps[r * MAPS * n..][..M * n], &outside).map(|r| &r[..M * n]);
    along!(n, V, i => {
        let mut acc = [[V::splat(0.0); M]; BLOCK];
        for j in 0..SPAN {
            fold_down(&mut acc, j, &taps, std::array::from_fn(|m| load::<V>(rows[j], m * n + i)));
        }
        for (o, row) in acc.iter().enumerate() {
            for (m, &v) in row.iter().enumerate() {
                store(&mut lines, (o * M + m) * len + PAD + i, v);
            }
        }
    });
    let [x_bar, y_bar] = bars;
    let weight = vec![scale; n];
    for (o, x_bar) in x_bar.chunks_exact_mut(n).enumerate() {
        let r = first + o;
        let (row_a, row_b) = (&a[r * n..][..n], &b[r * n..][..n]);
        let line = |m: usize| &lines[(o * M + m) * len..][..len];
        let weighted =
            x.mask_row(r).map(|mask| (0..n).map(|i| scale * mask[i / CHANNELS]).collect::<Vec<f32>>());
        let weight = weighted.as_ref().unwrap_or(&weight);
        along!(n, V, i => {
            let (h, d) = half_sum_and_difference(load::<V>(row_a, i), load::<V>(row_b, i));
            let w = load::<V>(weight, i);
            let by_d = (d + d) * fold_along::<V>(line(1), i, &taps);
            let by_h = h * fold_along::<V>(line(2), i, &taps);
            let x_term = (fold_along::<V>(line(0), i, &taps) + by_d) + by_h;
            store(x_bar, i, load::<V>(x_bar, i) + w * x_term);
            if M == MAPS {
                let y_bar = &mut y_bar[o * n..][..n];
                let y_term = (fold_along::<V>(line(3), i, &taps) - by_d) + by_h;
                store(y_bar, i, load::<V>(y_bar, i) + w * y_term);
            }
        });
    }
}
