//! `loss.lpips`: learned perceptual distance, VGG16 with the heads of version 0.1.
//!
//! value = Σ_l (1/(H_l W_l)) Σ_p Σ_c w_lc (f̂_lpc(x) − f̂_lpc(y))²,   f̂ = f/(‖f‖ + 1e-10)
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | x, y | `x`, `y` | (H, W, 3) | sRGB-encoded, at least 16×16 |
//! | filters | `features.0.weight`, `features.0.bias` … `features.28.bias` | (O, C, 3, 3), (O) | optional, all or none |
//! | w | `lin0.model.1.weight` … `lin4.model.1.weight` | (1, C, 1, 1) | optional with the filters |
//! | – | setting `rescale` | () | 1: 2x − 1 is used instead of x |
//! | – | `layers` | (5) | the terms of the sum |
//! | value | `value` | () | |
//!
//! Without weights, generated ones are used: weight k of `features.i` is (2u − 1) √(6/(9·in)), u =
//! (splitmix64((i+1)·2⁴⁰ + k) ≫ 11)·2⁻⁵³, biases 0; weight k of head j is u/channels with u from (100+j)·2⁴⁰
//! + k; rounded to f32.
//!
//! The network is a chain of fourteen stages, thirteen convolutions and the heads; every convolution writes
//! its output after max(·, 0) as `relu1_1` … (2, H, W, C), x first. A stage behind a max pooling computes the
//! maxima from the output of the previous stage.
//!
//! # Plan
//! `active1_1` … (2, H, W, C): 1 where an output is positive; `pool1` … `pool4` (2, H, W, C): 2·row + column
//! of the entry selected by a maximum.
//!
//! # Rounding
//! Left folds in memory order; that of a convolution starts with its bias and has one step per product.
//!
//! # Kinks and domain
//! max(z, 0) has slope 0 at 0; of equal entries a maximum selects the first; √0 has slope 0.

mod ports;

use crate::array::{Arr, Named, Out};
use crate::inputs::{Dims, argument};
use crate::ports::{Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;
use ports::{INPUTS, INTERMEDIATES, PLAN};

/// `loss.lpips`
pub static SIGNATURE: Signature = Signature {
    name: "loss.lpips",
    summary: "learned perceptual distance: VGG16 with the heads of version 0.1, user-supplied weights",
    inputs: INPUTS,
    outputs: ports![value: Port::var("", "0 for equal images")],
    intermediates: INTERMEDIATES,
    plan: PLAN,
    settings: &[SettingSpec::flag(
        "rescale",
        "1",
        "1: use 2x − 1, as published; 0: use the images unchanged",
    )],
    ..Signature::EMPTY
};

/// Inputs of `loss.lpips`, bound by hand: the names of the weights are no identifiers.
#[derive(Clone, Debug)]
pub struct In<'a, S> {
    /// Input `x`.
    pub x: &'a Arr<S>,
    /// Input `y`.
    pub y: &'a Arr<S>,
    /// The other inputs in their order; `None`: generated weights.
    pub weights: Option<Vec<&'a Arr<S>>>,
}

impl<'a, S: Scalar> In<'a, S> {
    /// The inputs under the names of their ports.
    ///
    /// # Errors
    /// When one is missing or has the wrong shape, or the images are too small.
    pub fn of(arrays: &'a Named<S>) -> Result<Self, String> {
        let (mut dims, find) = (Dims::default(), |name: &str| arrays.get(name));
        let x: &Arr<S> = argument(&INPUTS[0], &find, &mut dims)?;
        let y = argument(&INPUTS[1], &find, &mut dims)?;
        let [h, w] = [x.shape[0], x.shape[1]];
        if h < 16 || w < 16 {
            return Err(format!("input x: expected at least 16x16 pixels, got {h}x{w}"));
        }
        let mut weights: Vec<&Arr<S>> = Vec::new();
        for port in &INPUTS[2..] {
            weights.extend(argument::<S, Option<&Arr<S>>>(port, &find, &mut dims)?);
        }
        if !weights.is_empty() && weights.len() != INPUTS.len() - 2 {
            return Err(format!(
                "inputs of weights: expected {} or none, got {}",
                INPUTS.len() - 2,
                weights.len()
            ));
        }
        Ok(Self { x, y, weights: (!weights.is_empty()).then_some(weights) })
    }

    /// Channels after convolution `k`.
    fn channels(&self, k: usize) -> usize {
        self.weights.as_ref().map_or(CONVOLUTIONS[k].2, |weights| weights[2 * k].shape[0])
    }

    /// Rows and columns at convolution `k`.
    fn size(&self, k: usize) -> [usize; 2] {
        let [mut h, mut w] = [self.x.shape[0], self.x.shape[1]];
        for _ in POOLED.iter().filter(|&&p| p <= k) {
            (h, w) = (h / 2, w / 2);
        }
        [h, w]
    }
}

/// Stages of the chain: convolutions, then the heads.
pub const STAGES: usize = CONVOLUTIONS.len() + 1;

/// Convolutions: index in `features`, name, number of outputs in VGG16.
const CONVOLUTIONS: [(usize, &str, usize); 13] = [
    (0, "1_1", 64),
    (2, "1_2", 64),
    (5, "2_1", 128),
    (7, "2_2", 128),
    (10, "3_1", 256),
    (12, "3_2", 256),
    (14, "3_3", 256),
    (17, "4_1", 512),
    (19, "4_2", 512),
    (21, "4_3", 512),
    (24, "5_1", 512),
    (26, "5_2", 512),
    (28, "5_3", 512),
];
const TAPS: [usize; 5] = [1, 3, 6, 9, 12];
/// Convolutions preceded by a max pooling.
const POOLED: [usize; 4] = [2, 4, 7, 10];
const SHIFT: [f64; 3] = [-0.030, -0.088, -0.188];
const SCALE: [f64; 3] = [0.458, 0.448, 0.450];
const EPS: f64 = 1e-10;

fn uniform(seed: u64) -> f64 {
    let z = seed.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) >> 11) as f64 / 9_007_199_254_740_992.0
}

/// Weights (O, C, 3, 3) and biases (O) of convolution `k`.
fn filters<S: Scalar>(x: &In<'_, S>, k: usize) -> (Vec<f64>, Vec<f64>) {
    if let Some(weights) = &x.weights {
        let values = |x: &Arr<S>| x.data.iter().map(|v| v.value()).collect();
        return (values(weights[2 * k]), values(weights[2 * k + 1]));
    }
    let (inputs, outputs) = (if k == 0 { 3 } else { x.channels(k - 1) }, x.channels(k));
    let at = CONVOLUTIONS[k].0;
    let scale = (6.0 / (9.0 * inputs as f64)).sqrt();
    let weight = |k: usize| {
        let u = uniform(((at as u64 + 1) << 40) + k as u64);
        f64::from(((2.0 * u - 1.0) * scale) as f32)
    };
    ((0..outputs * inputs * 9).map(weight).collect(), vec![0.0; outputs])
}

/// Weights of head `j`.
fn head<S: Scalar>(x: &In<'_, S>, j: usize) -> Vec<f64> {
    if let Some(weights) = &x.weights {
        return weights[2 * CONVOLUTIONS.len() + j].data.iter().map(|v| v.value()).collect();
    }
    let channels = x.channels(TAPS[j]);
    let weight = |k: usize| {
        let u = uniform(((100 + j as u64) << 40) + k as u64);
        f64::from((u / channels as f64) as f32)
    };
    (0..channels).map(weight).collect()
}

/// A decision array of that shape, if the plan has it.
fn decided<'a>(
    plan: Option<&'a Named<f64>>,
    name: &str,
    shape: &[usize],
) -> Result<Option<&'a [f64]>, String> {
    match plan.and_then(|plan| plan.get(name)) {
        Some(x) if x.shape != shape => {
            Err(format!("plan {name}: expected shape {shape:?}, got {:?}", x.shape))
        }
        given => Ok(given.map(|x| x.data.as_slice())),
    }
}

/// Input of convolution `k`, (2, H, W, C): the images, the output of the previous stage, or its maxima.
fn seen_by<S: Scalar>(
    x: &In<'_, S>,
    relu: &[&Arr<S>],
    plan: Option<&Named<f64>>,
    out: &mut Out<'_, S>,
) -> Result<Vec<S>, String> {
    let k = relu.len();
    let Some(before) = relu.last() else {
        return Ok([x.x.data.as_slice(), x.y.data.as_slice()].concat());
    };
    let Some(p) = POOLED.iter().position(|&p| p == k) else { return Ok(before.data.clone()) };
    let ([h, w], [rows, columns], c) = (x.size(k), x.size(k - 1), x.channels(k - 1));
    let name = format!("pool{}", p + 1);
    let given = decided(plan, &name, &[2, h, w, c])?;
    let (mut seen, mut taken) = (Vec::new(), Vec::new());
    for at in 0..2 * h * w * c {
        let (item, r, q, channel) = (at / (h * w * c), at / (w * c) % h, at / c % w, at % c);
        let entry =
            |e: usize| before.data[((item * rows + 2 * r + e / 2) * columns + 2 * q + e % 2) * c + channel];
        let best = match given {
            Some(given) => given[at] as usize,
            None => (1..4).fold(0, |b, e| if entry(e).value() > entry(b).value() { e } else { b }),
        };
        seen.push(entry(best));
        taken.push(best as f64);
    }
    out.plan.insert(name, crate::array::Arr::new(&[2, h, w, c], taken));
    Ok(seen)
}

/// One stage of the twin of `loss.lpips`: the convolution after those whose results are `relu`, or the heads
/// after the last convolution.
///
/// # Errors
/// When the plan does not match.
pub fn stage<S: Scalar>(
    input: &In<'_, S>,
    relu: &[&Arr<S>],
    rescale: bool,
    plan: Option<&Named<f64>>,
    out: &mut Out<'_, S>,
) -> Result<(), String> {
    if relu.len() < CONVOLUTIONS.len() {
        return convolution(input, relu, rescale, plan, out);
    }
    heads(input, relu, out);
    Ok(())
}

fn convolution<S: Scalar>(
    x: &In<'_, S>,
    relu: &[&Arr<S>],
    rescale: bool,
    plan: Option<&Named<f64>>,
    out: &mut Out<'_, S>,
) -> Result<(), String> {
    let k = relu.len();
    let ([h, w], name) = (x.size(k), CONVOLUTIONS[k].1);
    let (weight, bias) = filters(x, k);
    let (outputs, inputs) = (bias.len(), if k == 0 { 3 } else { x.channels(k - 1) });
    let shape = [2, h, w, outputs];
    let seen = seen_by(x, relu, plan, out)?;
    let normalised = |v: S, c: usize| {
        let centred = if rescale { v * 2.0 - 1.0 } else { v };
        if k == 0 { (centred - SHIFT[c]) / SCALE[c] } else { v }
    };
    let given = decided(plan, &format!("active{name}"), &shape)?;
    let slot = out.array(&format!("relu{name}"), &shape);
    let mut active = Vec::with_capacity(2 * h * w * outputs);
    for pixel in 0..2 * h * w {
        let (item, r, q) = (pixel / (h * w), pixel / w % h, pixel % w);
        // the entries under the filter, in the order (C, 3, 3)
        let mut patch = Vec::new();
        for (c, tap) in (0..9 * inputs).map(|at| (at / 9, at % 9)) {
            let (row, column) = (r + tap / 3, q + tap % 3);
            if row >= 1 && row <= h && column >= 1 && column <= w {
                let v = seen[((item * h + row - 1) * w + column - 1) * inputs + c];
                patch.push((9 * c + tap, normalised(v, c)));
            }
        }
        for o in 0..outputs {
            let mut sum = S::from_f64(bias[o]);
            for &(at, v) in &patch {
                let factor = weight[9 * inputs * o + at];
                sum = sum.chain2(v, sum.value() + factor * v.value(), [1.0, factor]);
            }
            let at = pixel * outputs + o;
            let passes = given.map_or(sum.value() > 0.0, |given| given[at] == 1.0);
            out.put(slot, at, if passes { sum } else { S::zero() });
            active.push(if passes { 1.0 } else { 0.0 });
        }
        out.flush();
    }
    out.plan.insert(format!("active{name}"), crate::array::Arr::new(&shape, active));
    Ok(())
}

fn heads<S: Scalar>(x: &In<'_, S>, relu: &[&Arr<S>], out: &mut Out<'_, S>) {
    let (value, layers) = (out.array("value", &[]), out.array("layers", &[5]));
    for (l, tap) in TAPS.into_iter().enumerate() {
        let ([h, w], weight, f) = (x.size(tap), head(x, l), relu[tap]);
        let c = weight.len();
        for pixel in 0..h * w {
            let unit = |item: usize| -> Vec<S> {
                let f = &f.data[(item * h * w + pixel) * c..][..c];
                let norm = f.iter().fold(S::zero(), |sum, v| sum + *v * *v).sqrt() + EPS;
                f.iter().map(|v| *v / norm).collect()
            };
            let (a, b) = (unit(0), unit(1));
            let mut term = S::zero();
            for k in 0..c {
                let d = a[k] - b[k];
                term = term + d * d * weight[k];
            }
            let term = term / (h * w) as f64;
            out.add(value, 0, term, 1.0);
            out.add(layers, l, term, 1.0);
            out.flush();
        }
    }
}

/// [`stage`] on named arrays, including those of the previous stages.
///
/// # Errors
/// When an input or the plan is invalid.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    let results = CONVOLUTIONS[..call.stage].iter().map(|(_, name, _)| &call.arrays[&format!("relu{name}")]);
    let relu: Vec<&Arr<S>> = results.collect();
    stage(&In::of(call.arrays)?, &relu, call.settings.flag("rescale"), call.plan, out)
}

/// Number of products of both images.
///
/// # Errors
/// As [`run`].
pub fn work(call: &Call<'_, f64>) -> Result<u64, String> {
    let (x, mut sum) = (In::of(call.arrays)?, 0);
    for k in 0..CONVOLUTIONS.len() {
        let ([h, w], inputs) = (x.size(k), if k == 0 { 3 } else { x.channels(k - 1) });
        sum += (2 * h * w * 9 * inputs * x.channels(k)) as u64;
    }
    Ok(sum)
}
