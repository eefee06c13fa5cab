//! A convolution of pictures, channels last.
//!
//! y(b,r,q,o) = β(o) + Σ over i, j, c of W(o,i,j,c)·x(b, s·r+i−p, s·q+j−p, c),   x = 0 beyond the border
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | x | `x` | (B, H, W, C) |
//! | W | `weight` | (O, KH, KW, C) |
//! | β | `bias` | (O) |
//! | s, p | settings `stride`, `pad` | () |
//! | y | `y` | (B, ⌊(H+2p−KH)/s⌋+1, ⌊(W+2p−KW)/s⌋+1, O) |
//!
//! # Rounding
//! A left fold over (i, j, c) from 0; the bias is added last.

use crate::array::{ANY, Named, Out, expect};
use crate::scalar::Scalar;
use crate::settings::Settings;

fn whole(settings: &Settings<'_>, name: &str, default: f64, least: f64) -> Result<usize, String> {
    let x = settings.number(name, default)?;
    if x >= least && x <= 65_536.0 && x == x.trunc() {
        return Ok(x as usize);
    }
    Err(format!("setting {name}: expected a whole number from {least} to 65536, got {x}"))
}

/// Sizes of a convolution.
struct Sizes {
    batch: usize,
    height: usize,
    width: usize,
    channels: usize,
    outputs: usize,
    kernel: [usize; 2],
    stride: usize,
    pad: usize,
    /// Output rows and columns.
    out: [usize; 2],
}

impl Sizes {
    fn of<S>(arrays: &Named<S>, settings: &Settings<'_>) -> Result<Self, String> {
        let x = expect(arrays, "x", &[ANY, ANY, ANY, ANY])?;
        let [batch, height, width, channels] = [0, 1, 2, 3].map(|axis| x.shape[axis]);
        let weight = expect(arrays, "weight", &[ANY, ANY, ANY, channels])?;
        let [outputs, kh, kw] = [0, 1, 2].map(|axis| weight.shape[axis]);
        let (stride, pad) = (whole(settings, "stride", 1.0, 1.0)?, whole(settings, "pad", 0.0, 0.0)?);
        if kh == 0 || kw == 0 || kh > height + 2 * pad || kw > width + 2 * pad {
            return Err(format!(
                "input weight: a kernel of {kh}x{kw} does not fit into {height}x{width} padded by {pad}"
            ));
        }
        let out = [(height + 2 * pad - kh) / stride + 1, (width + 2 * pad - kw) / stride + 1];
        Ok(Self { batch, height, width, channels, outputs, kernel: [kh, kw], stride, pad, out })
    }
}

/// Number of products, those beyond the border included.
///
/// # Errors
/// As [`forward`].
pub fn products<S>(arrays: &Named<S>, settings: &Settings<'_>) -> Result<u64, String> {
    let s = Sizes::of(arrays, settings)?;
    let outputs = s.batch * s.out[0] * s.out[1] * s.outputs;
    Ok((outputs * s.kernel[0] * s.kernel[1] * s.channels) as u64)
}

/// The twin of `nn.conv`.
///
/// # Errors
/// When an input or a setting is not what it should be, or the kernel does not fit.
pub fn forward<S: Scalar>(
    arrays: &Named<S>,
    settings: &Settings<'_>,
    out: &mut Out<S>,
) -> Result<(), String> {
    let Sizes { batch, height, width, channels, outputs, kernel, stride, pad, out: size } =
        Sizes::of(arrays, settings)?;
    let (x, weight) = (&arrays["x"], &arrays["weight"]);
    let bias = expect(arrays, "bias", &[outputs])?;
    let ([kh, kw], [rows, columns]) = (kernel, size);
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
            out.put(y, pixel * outputs + o, sum + bias.data[o]);
        }
        out.flush();
    }
    Ok(())
}
