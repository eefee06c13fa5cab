//! `nn.tokens`: squares of pixels of images, rays and photos as tokens, one linear layer and a LayerNorm.
//!
//! z(b,r,q,o) = β(o) + Σ over i, j and the channels c of all arrays of W(o,i,j,c)·x(b, pr+i, pq+j, c),
//! tokens(b,r,q,·) = (z − μ)/√(v + ε)·γ + δ,   μ and v: mean of z(b,r,q,·), mean of the squared distances from μ
//!
//! | symbol | argument | shape |
//! |---|---|---|
//! | x | `image`, `rays`, `photo` | (B, H, W, 3), (B, H, W, 6), (B, H, W, 3) |
//! | W | `w_image`, `w_rays`, `w_photo` | (D, P, P, 3), (D, P, P, 6), (D, P, P, 3) |
//! | β | `bias` | (D) |
//! | γ, δ | `norm_gain`, `norm_bias` | (D) |
//! | ε | setting `eps` | () |
//! | tokens | `tokens` | (B, H/P, W/P, D) |
//!
//! `photo` and `w_photo` are both absent or both present; p = P.
//!
//! # Rounding
//! Left folds; pixel by pixel, within a pixel the channels of image, rays, photo.
//!
//! # Kinks and domain
//! Smooth for ε > 0. H and W are multiples of P, which is 1 to 26.

use super::layernorm::normalized;
use crate::array::{Arr, Out};
use crate::inputs::inputs;
use crate::ports::{Port, SettingSpec, Signature, ports};
use crate::scalar::Scalar;
use crate::twins::Call;

inputs! {
    /// Inputs of `nn.tokens`.
    pub struct In<'a, S> {
        image: &'a Arr<S> = Port::var("B,H,W,3", "images, masked"),
        rays: &'a Arr<S> = Port::var("B,H,W,6", "direction and moment of the ray of every pixel"),
        photo: Option<&'a Arr<S>> = Port::var("B,H,W,3", "images before masking; absent: without them"),
        w_image: &'a Arr<S> = Port::var("D,P,P,3", "weights of the images"),
        w_rays: &'a Arr<S> = Port::var("D,P,P,6", "weights of the rays"),
        w_photo: Option<&'a Arr<S>> = Port::var("D,P,P,3", "weights of the photos, 0 at first; absent with the photos"),
        bias: &'a Arr<S> = Port::var("D", "added to the sums"),
        norm_gain: &'a Arr<S> = Port::var("D", "gain of the LayerNorm"),
        norm_bias: &'a Arr<S> = Port::var("D", "bias of the LayerNorm"),
    }
}

/// `nn.tokens`
pub static SIGNATURE: Signature = Signature {
    name: "nn.tokens",
    summary: "images, rays and photos as tokens: a linear layer over squares of pixels, then a LayerNorm",
    inputs: In::<f64>::PORTS,
    outputs: ports![tokens: Port::var("B,H',W',D", "one per square of pixels")],
    settings: &[SettingSpec::number("eps", "1e-6", "added to the variance, above 0")],
    ..Signature::EMPTY
};

/// Largest P.
const MAX_PATCH: usize = 26;

/// Rows and columns of tokens.
fn grid<S>(input: &In<'_, S>) -> Result<[usize; 2], String> {
    let ([height, width], patch) = ([1, 2].map(|axis| input.image.shape[axis]), input.w_image.shape[1]);
    if !(1..=MAX_PATCH).contains(&patch) || [height, width].iter().any(|side| *side == 0 || side % patch != 0)
    {
        return Err(format!("input image: {height}x{width} pixels are not squares of {patch}"));
    }
    if input.photo.is_some() != input.w_photo.is_some() {
        return Err("input photo: given without w_photo, or w_photo without it".to_owned());
    }
    Ok([height / patch, width / patch])
}

/// The twin of `nn.tokens`.
///
/// # Errors
/// When the image does not consist of squares, or one of `photo` and `w_photo` is missing.
pub fn forward<S: Scalar>(input: &In<'_, S>, eps: f64, out: &mut Out<'_, S>) -> Result<(), String> {
    let [rows, columns] = grid(input)?;
    let [views, height, width] = [0, 1, 2].map(|axis| input.image.shape[axis]);
    let (patch, d) = (input.w_image.shape[1], input.bias.data.len());
    let tokens = out.array("tokens", &[views, rows, columns, d]);
    let mut pairs = vec![(input.image, input.w_image), (input.rays, input.w_rays)];
    pairs.extend(input.photo.zip(input.w_photo));
    for token in 0..views * rows * columns {
        let (b, r, q) = (token / (rows * columns), token / columns % rows, token % columns);
        let mut z = Vec::new();
        for o in 0..d {
            let mut sum = S::zero();
            for i in 0..patch {
                for j in 0..patch {
                    let pixel = (b * height + patch * r + i) * width + patch * q + j;
                    for (x, weight) in &pairs {
                        let channels = x.shape[3];
                        for c in 0..channels {
                            let w = weight.data[((o * patch + i) * patch + j) * channels + c];
                            sum = sum + w * x.data[pixel * channels + c];
                        }
                    }
                }
            }
            z.push(sum + input.bias.data[o]);
        }
        for (o, n) in normalized(&z, eps).into_iter().enumerate() {
            out.put(tokens, token * d + o, n * input.norm_gain.data[o] + input.norm_bias.data[o]);
        }
        out.flush();
    }
    Ok(())
}

/// [`forward`] on named arrays.
///
/// # Errors
/// When an input is missing or has the wrong shape, or as [`forward`].
pub fn run<S: Scalar>(call: &Call<'_, S>, out: &mut Out<'_, S>) -> Result<(), String> {
    forward(&In::of(call.arrays)?, call.settings.number("eps"), out)
}

/// Number of products.
///
/// # Errors
/// As [`run`].
pub fn work(call: &Call<'_, f64>) -> Result<u64, String> {
    let input = In::of(call.arrays)?;
    let [rows, columns] = grid(&input)?;
    let weights = [Some(input.w_image), Some(input.w_rays), input.w_photo];
    let weights = weights.iter().flatten().fold(0, |n, w| n + w.data.len());
    Ok((input.image.shape[0] * rows * columns * weights) as u64)
}
