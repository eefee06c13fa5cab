//! Weights of the network and of the heads: from a file, from arrays, or by a formula.
//!
//! Three lines of Python create the file (with `torch`, `torchvision`, `lpips` and `safetensors` installed):
//!
//! ```text
//! import lpips, torchvision, safetensors.torch
//! w = {**torchvision.models.vgg16(weights="DEFAULT").features.state_dict(prefix="features."), **{k: v for k, v in lpips.LPIPS(net="vgg").state_dict().items() if k[:3] == "lin" and k[3].isdigit()}}
//! safetensors.torch.save_file({k: v.contiguous() for k, v in w.items()}, "lpips_vgg.safetensors")
//! ```
//!
//! The arrays `features.0.weight` (64, 3, 3, 3), `features.0.bias` (64) … `features.28.bias`,
//! `lin0.model.1.weight` (1, 64, 1, 1) … `lin4.model.1.weight` are read; other arrays of the file are
//! ignored.

use crate::io::safetensors;
use crate::num::array::{Array, Arrays};
use crate::{Error, Result};
use std::path::Path;

/// Text that tools print if there are no weights; the surrogate [`crate::loss::metric::rfd`] has its own
/// name.
pub const NO_WEIGHTS: &str = "LPIPS: no weights";

/// Convolutions: index in torchvision's `features`, name in the paper, number of outputs in VGG16.
pub const CONVOLUTIONS: [(usize, &str, usize); 13] = [
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

/// Convolutions whose outputs are compared: relu1_2, relu2_2, relu3_3, relu4_3, relu5_3.
pub const TAPS: [usize; 5] = [1, 3, 6, 9, 12];

/// One convolution.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// Shape (outputs, 3, 3, inputs).
    pub weight: Vec<f32>,
    /// Shape (outputs).
    pub bias: Vec<f32>,
    /// Number of input channels.
    pub inputs: usize,
    /// Number of output channels.
    pub outputs: usize,
}

/// All weights. The numbers of channels are not fixed, so that small networks can be checked; those of VGG16
/// are in [`CONVOLUTIONS`].
#[derive(Clone, Debug, PartialEq)]
pub struct Weights {
    /// The thirteen convolutions.
    pub layers: Vec<Layer>,
    /// One weight per channel for each tap.
    pub heads: Vec<Vec<f32>>,
}

/// Returns the names of the arrays of all convolutions and heads.
pub fn names() -> Vec<String> {
    let conv = CONVOLUTIONS
        .iter()
        .flat_map(|(at, ..)| ["weight", "bias"].map(|part| format!("features.{at}.{part}")));
    conv.chain((0..TAPS.len()).map(|j| format!("lin{j}.model.1.weight"))).collect()
}

fn expect<'a>(arrays: &'a Arrays, name: &str, shape: &[Option<usize>]) -> Result<&'a Array> {
    let array = arrays.need(name)?;
    let fits = array.shape().len() == shape.len()
        && array.shape().iter().zip(shape).all(|(a, b)| b.is_none_or(|b| *a == b));
    if fits && array.is_float() {
        return Ok(array);
    }
    let wanted: Vec<String> = shape.iter().map(|s| s.map_or("any".to_owned(), |s| s.to_string())).collect();
    Err(Error::input(format!("array '{name}'"))
        .expected(format!("floats of shape ({})", wanted.join(", ")))
        .got(format!("{} {:?}", array.dtype(), array.shape())))
}

fn finite(name: &str, values: Vec<f32>) -> Result<Vec<f32>> {
    match values.iter().position(|x| !x.is_finite()) {
        None => Ok(values),
        Some(i) => Err(Error::input(format!("array '{name}'"))
            .at(format!("entry {i}"))
            .expected("a finite number in f32")
            .got(values[i].to_string())),
    }
}

/// Converts (outputs, inputs, 3, 3) to (outputs, 3, 3, inputs).
fn channels_last(weight: &[f32], inputs: usize) -> Vec<f32> {
    let filter = 9 * inputs;
    (0..weight.len())
        .map(|at| {
            let (o, rest) = (at / filter, at % filter);
            weight[o * filter + rest % inputs * 9 + rest / inputs]
        })
        .collect()
}

impl Weights {
    /// Reads the arrays listed by [`names`]; others are ignored.
    ///
    /// # Errors
    /// Returns an error if an array is missing, has another shape, or is not finite.
    pub fn from_arrays(arrays: &Arrays) -> Result<Self> {
        let (mut layers, mut inputs) = (Vec::new(), 3);
        for (at, ..) in CONVOLUTIONS {
            let [weight, bias] = ["weight", "bias"].map(|part| format!("features.{at}.{part}"));
            let array = expect(arrays, &weight, &[None, Some(inputs), Some(3), Some(3)])?;
            let outputs = array.shape()[0];
            if outputs == 0 {
                return Err(Error::input(format!("array '{weight}'")).expected("at least one channel"));
            }
            let values = finite(&weight, array.to_f32())?;
            let bias = finite(&bias, expect(arrays, &bias, &[Some(outputs)])?.to_f32())?;
            layers.push(Layer { weight: channels_last(&values, inputs), bias, inputs, outputs });
            inputs = outputs;
        }
        let head = |(j, tap): (usize, &usize)| {
            let name = format!("lin{j}.model.1.weight");
            let channels = layers[*tap].outputs;
            finite(&name, expect(arrays, &name, &[Some(1), Some(channels), Some(1), Some(1)])?.to_f32())
        };
        let heads = TAPS.iter().enumerate().map(head).collect::<Result<Vec<_>>>()?;
        Ok(Self { layers, heads })
    }

    /// Reads a safetensors file with VGG16 and the heads.
    ///
    /// # Errors
    /// Returns an error if the file cannot be read, or if an array is missing, has another shape, or is not
    /// finite.
    pub fn load(path: &Path) -> Result<Self> {
        let name = path.display().to_string();
        let weights = Self::from_arrays(&safetensors::read(path)?.arrays).map_err(|e| {
            e.within(name.clone()).hint(
                "the documentation of lastlight::loss::lpips contains a Python script that creates this file",
            )
        })?;
        let published =
            weights.layers.iter().zip(CONVOLUTIONS).all(|(l, (.., outputs))| l.outputs == outputs);
        if !published {
            let got: Vec<String> = weights.layers.iter().map(|l| l.outputs.to_string()).collect();
            return Err(Error::input(name).expected("the channels of VGG16").got(got.join(", ")));
        }
        Ok(weights)
    }

    /// Returns weights defined by a formula, for comparing programs rather than images. Weight k (in the
    /// order (out, in, 3, 3)) of `features.i` is (2u − 1) √(6/(9·in)), u = (splitmix64((i+1)·2⁴⁰ + k) ≫
    /// 11)·2⁻⁵³, biases are 0; weight k of head j is u/channels with u from (100+j)·2⁴⁰ + k; all are rounded
    /// to f32.
    pub fn by_formula() -> Self {
        let (mut layers, mut inputs) = (Vec::new(), 3usize);
        for (at, _, outputs) in CONVOLUTIONS {
            let scale = (6.0 / (9.0 * inputs as f64)).sqrt();
            let weight: Vec<f32> = (0..outputs * inputs * 9)
                .map(|k| ((2.0 * uniform(((at as u64 + 1) << 40) + k as u64) - 1.0) * scale) as f32)
                .collect();
            layers.push(Layer {
                weight: channels_last(&weight, inputs),
                bias: vec![0.0; outputs],
                inputs,
                outputs,
            });
            inputs = outputs;
        }
        let head = |(j, tap): (usize, &usize)| -> Vec<f32> {
            let channels = layers[*tap].outputs;
            (0..channels)
                .map(|k| (uniform(((100 + j as u64) << 40) + k as u64) / channels as f64) as f32)
                .collect()
        };
        let heads = TAPS.iter().enumerate().map(head).collect();
        Self { layers, heads }
    }
}

/// Returns splitmix64 (Steele, Lea and Flood 2014) as a number in 0..1.
fn uniform(seed: u64) -> f64 {
    let z = seed.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ z >> 31) >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
}
