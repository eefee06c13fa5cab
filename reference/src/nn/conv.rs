//! `nn.conv`: a convolution of images, channels last, followed by a leaky ReLU.
//!
//! y(b,r,q,o) = λ(β(o) + Σ over i, j, c of W(o,i,j,c)·x(b, s·r+i−p, s·q+j−p, c)),
//! x = 0 beyond the border,   λ(z) = z where z > 0, else a·z
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | x | `x` | (B, H, W, C) |
//! | W | `weight` | (O, KH, KW, C) |
//! | β | `bias` | (O) |
//! | s, p | settings `stride`, `pad` | () |
//! | a | setting `slope` | (); 1: λ is the identity |
//! | y | `y` | (B, ⌊(H+2p−KH)/s⌋+1, ⌊(W+2p−KW)/s⌋+1, O) |
//!
//! # Rounding
//! A left fold over (i, j, c) from 0; then the bias, then λ.
//!
//! # Kinks and domain
//! At z = 0 the slope of λ is a. C ≥ 1.

use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `nn.conv`.
    pub struct In<'a, S> {
        x: &'a Arr<S> = Port::var("B,H,W,C", "images"),
        weight: &'a Arr<S> = Port::var("O,KH,KW,C", "one filter per output (cross-correlation)"),
        bias: &'a Arr<S> = Port::var("O", "added last"),
    }
}

/// `nn.conv`
pub static SIGNATURE: Signature = Signature {
    name: "nn.conv",
    summary: "convolution of images, channels last, zero padding, followed by a leaky ReLU",
    inputs: In::<f64>::PORTS,
    outputs: ports![y: Port::var("B,H',W',O", "")],
    settings: &[
        SettingSpec::number("stride", "1", "pixels between outputs, 1 or more"),
        SettingSpec::number("pad", "0", "zeros on every side, in pixels"),
        SettingSpec::number("slope", "1", "slope of the leaky ReLU that follows, not negative; 1 for none"),
    ],
    ..Signature::EMPTY
};

/// Settings of `nn.conv`.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Pixels between outputs.
    pub stride: usize,
    /// Zeros on every side, in pixels.
    pub pad: usize,
    /// Slope of the leaky ReLU.
    pub slope: f64,
}

impl Settings {
    fn of<S>(call: &Call<'_, S>) -> Result<Self, String> {
        let (stride, pad) = (call.settings.whole("stride", 1.0)?, call.settings.whole("pad", 0.0)?);
        Ok(Self { stride, pad, slope: call.settings.number("slope") })
    }
}

/// Output rows and columns.
fn size<S>(input: &In<'_, S>, settings: Settings) -> Result<[usize; 2], String> {
    let Settings { stride, pad, .. } = settings;
    let ([height, width], [kh, kw]) =
        ([1, 2].map(|axis| input.x.shape[axis]), [1, 2].map(|axis| input.weight.shape[axis]));
    if kh == 0 || kw == 0 || kh > height + 2 * pad || kw > width + 2 * pad {
        return Err(format!(
            "input weight: a kernel of {kh}x{kw} does not fit into {height}x{width} padded by {pad}"
        ));
    }
    Ok([(height + 2 * pad - kh) / stride + 1, (width + 2 * pad - kw) / stride + 1])
}

/// The twin of `nn.conv`.
///
/// # Errors
/// When the kernel does not fit.
pub fn forward<S: Scalar>(input: &In<'_, S>, settings: Settings, out: &mut Out<'_, S>) -> Result<(), String> {
    let [rows, columns] = size(input, settings)?;
    let (In { x, weight, bias }, Settings { stride, pad, slope }) = (*input, settings);
    let [batch, height, width, channels] = [0, 1, 2, 3].map(|axis| x.shape[axis]);
    let [outputs, kh, kw] = [0, 1, 2].map(|axis| weight.shape[axis]);
    let y = out.array("y", &[batch, rows, columns, outputs]);
    for pixel in 0..batch * rows * columns {
        let (b, r, q) = (pixel / (rows * columns), pixel / columns % rows, pixel % columns);
        for o in 0..outputs {
            let mut sum = S::zero();
            for i in 0..kh {
                for j in 0..kw {
                    let (h, w) = (stride * r + i, stride * q + j);
                    if h < pad || h >= height + pad || w < pad || w >= width + pad {
                        continue;
                    }
                    for c in 0..channels {
                        let at = ((b * height + h - pad) * width + w - pad) * channels + c;
                        sum = sum + weight.data[((o * kh + i) * kw + j) * channels + c] * x.data[at];
                    }
                }
            }
            let z = sum + bias.data[o];
            out.put(y, pixel * outputs + o, if z.value() > 0.0 { z } else { z * slope });
        }
        out.flush();
    }
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input or a setting is invalid, or the kernel does not fit.
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, Settings::of(call)?, out)
}

/// Number of products, including those with padding.
///
/// # Errors
/// As [`run`].
pub fn work(call: &Call<'_, f64>) -> Result<u64, String> {
    let input = In::of(call.arrays)?;
    let [rows, columns] = size(&input, Settings::of(call)?)?;
    Ok((input.x.shape[0] * rows * columns * input.weight.data.len()) as u64)
}
