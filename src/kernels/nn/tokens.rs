//! `nn.tokens`: images, the rays of their pixels and photos become tokens, one for each square of pixels.
//!
//! z(b,r,q,o) = β(o) + Σ over i, j, c of A(o,i,j,c)·image(b, pr+i, pq+j, c)
//!   + Σ of R(o,i,j,c)·rays(b, pr+i, pq+j, c) + Σ of F(o,i,j,c)·photo(b, pr+i, pq+j, c)
//!
//! tokens(b,r,q,·) = LayerNorm(z(b,r,q,·))        (LIRM, Fig. 2)
//!
//! | symbol | argument | shape | range |
//! |---|---|---|---|
//! | image | `image` | (B, H, W, 3) | finite; LIRM: masked, over white, sRGB-encoded, 2x − 1 |
//! | rays | `rays` | (B, H, W, 6) | finite; unit direction d and moment o × d, [`plucker`](crate::scene::rays::plucker); or d and the point d × (o × d) of the ray that is nearest to the origin |
//! | photo | `photo` | (B, H, W, 3) | finite; the image before masking; absent with F: no third sum |
//! | A | `w_image` | (D, P, P, 3) | finite |
//! | R | `w_rays` | (D, P, P, 6) | finite |
//! | F | `w_photo` | (D, P, P, 3) | finite |
//! | β | `bias` | (D) | finite |
//! | | `norm_gain`, `norm_bias` | (D) | of the LayerNorm, [`super::layernorm`] |
//! | ε | `eps` | () | > 0; LIRM takes 10⁻⁶ |
//! | p | | () | P, 1 to 26; LIRM takes 8. H and W are multiples of it |
//! | tokens | `tokens` | (B, H/P, W/P, D) | |
//!
//! The three sums are convolutions whose stride is the size of their kernel, which is one linear layer over 12P² numbers. The published code
//! adds a bias in the first two; only the sum of the biases has an effect, so there is one. No position is added: a token's place is in its
//! rays. LIRM starts A and R at uniform numbers in ±1/√fan-in and F at 0, so that a model trained without photos continues unchanged
//! with them. The scaled first values of this project have twice that bound for d, and five times that for moments and points.
//!
//! # Rounding
//! z without β is one chain from +0 over (i, j, c) of the image, then of the rays, then of the photo, each in memory order of the weights:
//! the chain of [`super::linear`] over a row of 12P² ≤ 4096 numbers. β is added after it. Weights of 0 change no bit. P ≤ 26 keeps each part
//! within 4096 products. Then the rounding of [`super::layernorm`].
//!
//! # Kinks and domain
//! Smooth, because of ε. Sides that are not multiples of P are refused: no pixel is dropped or invented.
//!
//! # Adjoint
//! z̄ is the gradient that [`super::layernorm`] gives; then the gradients of three convolutions, [`super::conv`], and β̄(o) += Σ z̄(·,o)
//!
//! Views are processed in index order. For every view, the sums of β̄, of gain and bias of the LayerNorm and of the weights are completed
//! before they are added to the caller's gradients. Hence the gradients of a batch are those of its views in consecutive calls, bit for bit,
//! and views of several sizes can share weights. z and the statistics of its rows are saved.
//!
//! Twin: `reference::nn::tokens`.
//!
//! # Example
//! ```
//! # use lastlight_kernels as lastlight;
//! use lastlight::nn::tokens::{In, Shape, forward};
//! let shape = Shape { views: 1, height: 1, width: 2, patch: 1 };
//! let x = In {
//!     image: &[1.0, 2.0, 3.0, 0.0, 0.0, 0.0],
//!     rays: &[0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 2.0, 0.0],
//!     photo: &[],
//!     w_image: &[1.0, 0.0, 0.0, 0.0, 0.0, 1.0],
//!     w_rays: &[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0],
//!     w_photo: &[],
//!     bias: &[0.0; 2],
//!     norm_gain: &[2.0, 2.0],
//!     norm_bias: &[0.0, 10.0],
//!     eps: 3.0,
//!     shape,
//! };
//! let mut tokens = [0.0; 4];
//! forward(&x, &mut tokens);
//! // z = (1, 3) and (0, −2), both of variance 1; √(1 + 3) = 2
//! assert_eq!(tokens, [-1.0, 11.0, 1.0, 9.0]);
//! ```

use super::conv;
use super::layernorm;
use super::linear::column_sums;
use crate::num::par;
use std::mem::take;

/// Rows per task of the bias; the number changes no bit.
const ROWS: usize = 32;
/// Largest side of a square of pixels.
pub const MAX_PATCH: usize = 26;
/// Channels of the image, of the rays and of the photo.
const CHANNELS: [usize; 3] = [3, 6, 3];

/// Sizes of the images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Number of views, B.
    pub views: usize,
    /// Height H in pixels.
    pub height: usize,
    /// Width W in pixels.
    pub width: usize,
    /// Side P of the square of pixels of one token.
    pub patch: usize,
}

impl Shape {
    /// Returns the rows and columns of tokens of a view, or `None` if a side is 0 or not a multiple of P, or if P is not
    /// from 1 to [`MAX_PATCH`].
    pub fn grid(&self) -> Option<[usize; 2]> {
        let Self { height, width, patch, .. } = *self;
        let fits = (1..=MAX_PATCH).contains(&patch)
            && [height, width].iter().all(|side| *side > 0 && side.is_multiple_of(patch));
        fits.then(|| [height / patch, width / patch])
    }
}

/// Inputs.
#[derive(Clone, Copy, Debug)]
pub struct In<'a> {
    /// Shape (B, H, W, 3).
    pub image: &'a [f32],
    /// Shape (B, H, W, 6).
    pub rays: &'a [f32],
    /// Shape (B, H, W, 3); empty together with its weights.
    pub photo: &'a [f32],
    /// Shape (D, P, P, 3).
    pub w_image: &'a [f32],
    /// Shape (D, P, P, 6).
    pub w_rays: &'a [f32],
    /// Shape (D, P, P, 3); empty together with the photo.
    pub w_photo: &'a [f32],
    /// Shape (D), not empty.
    pub bias: &'a [f32],
    /// Shape (D).
    pub norm_gain: &'a [f32],
    /// Shape (D).
    pub norm_bias: &'a [f32],
    /// Added to the variance.
    pub eps: f64,
    /// Sizes of the images.
    pub shape: Shape,
}

/// z, and the statistics of its rows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Saved {
    /// Shape (B, H/P, W/P, D).
    pub linear: Vec<f32>,
    /// Mean and 1/√(v + ε) of every token.
    pub norm: layernorm::Saved,
}

/// Gradients; the adjoint adds to them. A gradient that is not requested is empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InBar {
    /// Shape (B, H, W, 3).
    pub image: Vec<f32>,
    /// Shape (B, H, W, 6).
    pub rays: Vec<f32>,
    /// Shape (B, H, W, 3).
    pub photo: Vec<f32>,
    /// Shape (D, P, P, 3).
    pub w_image: Vec<f32>,
    /// Shape (D, P, P, 6).
    pub w_rays: Vec<f32>,
    /// Shape (D, P, P, 3).
    pub w_photo: Vec<f32>,
    /// Shape (D).
    pub bias: Vec<f32>,
    /// Shape (D).
    pub norm_gain: Vec<f32>,
    /// Shape (D).
    pub norm_bias: Vec<f32>,
}

impl InBar {
    /// Returns zeros in the shapes of the inputs.
    pub fn zeros_like(x: &In<'_>) -> Self {
        let zeros = |like: &[f32]| vec![0.0; like.len()];
        Self {
            image: zeros(x.image),
            rays: zeros(x.rays),
            photo: zeros(x.photo),
            w_image: zeros(x.w_image),
            w_rays: zeros(x.w_rays),
            w_photo: zeros(x.w_photo),
            bias: zeros(x.bias),
            norm_gain: zeros(x.norm_gain),
            norm_bias: zeros(x.norm_bias),
        }
    }

    /// Gradients of pixels and weights of every convolution.
    fn parts(&mut self) -> [(&mut Vec<f32>, &mut Vec<f32>); 3] {
        [
            (&mut self.image, &mut self.w_image),
            (&mut self.rays, &mut self.w_rays),
            (&mut self.photo, &mut self.w_photo),
        ]
    }
}

impl<'a> In<'a> {
    /// Checks the shapes; returns the numbers of tokens of a view and of columns.
    fn checked(&self) -> [usize; 2] {
        let [rows, columns] = self.shape.grid().expect("sides are multiples of the patch");
        assert!(!self.bias.is_empty(), "a token has a column");
        assert_eq!(self.photo.is_empty(), self.w_photo.is_empty(), "the photo comes with its weights");
        [rows * columns, self.bias.len()]
    }

    /// The convolutions, without the third if there is no photo.
    fn parts(&self) -> impl Iterator<Item = conv::In<'a>> {
        let Shape { views, height, width, patch } = self.shape;
        let outputs = self.bias.len();
        let arrays = [(self.image, self.w_image), (self.rays, self.w_rays), (self.photo, self.w_photo)];
        let count = if self.w_photo.is_empty() { 2 } else { 3 };
        arrays.into_iter().zip(CHANNELS).take(count).map(move |((x, weight), channels)| conv::In {
            x,
            weight,
            bias: &[],
            shape: conv::Shape {
                batch: views,
                height,
                width,
                channels,
                outputs,
                kernel: [patch, patch],
                stride: patch,
                pad: 0,
            },
        })
    }

    /// The LayerNorm of rows of z.
    fn norm<'z>(&self, linear: &'z [f32]) -> layernorm::In<'z>
    where
        'a: 'z,
    {
        layernorm::In { x: linear, gain: self.norm_gain, bias: self.norm_bias, eps: self.eps }
    }
}

/// Writes the tokens (B, H/P, W/P, D) and returns what the adjoint needs.
///
/// # Panics
/// Panics if a side is not a multiple of the patch, the patch is too large, or a buffer does not have the size of its shape.
pub fn forward(x: &In<'_>, tokens: &mut [f32]) -> Saved {
    let [per_view, d] = x.checked();
    assert_eq!(tokens.len(), x.shape.views * per_view * d, "tokens have the size of their shape");
    let mut linear = vec![0.0; tokens.len()];
    x.parts().for_each(|part| conv::resume(part, &mut linear));
    par::chunks_mut(&mut linear, ROWS * d, |_, rows| {
        for row in rows.chunks_exact_mut(d) {
            row.iter_mut().zip(x.bias).for_each(|(z, b)| *z += b);
        }
    });
    let norm = layernorm::forward(&x.norm(&linear), tokens);
    Saved { linear, norm }
}

/// Adds the gradients for the cotangent `tokens_bar` (B, H/P, W/P, D) to `x_bar`.
///
/// # Panics
/// Panics if a buffer does not have the size of its shape.
pub fn adjoint(x: &In<'_>, saved: &Saved, tokens_bar: &[f32], x_bar: &mut InBar) {
    let [per_view, d] = x.checked();
    assert_eq!(tokens_bar.len(), x.shape.views * per_view * d, "the cotangent has the size of the tokens");
    let mut linear_bar = Vec::with_capacity(tokens_bar.len());
    for view in 0..x.shape.views {
        let mine = view * per_view * d..(view + 1) * per_view * d;
        let mut bar = layernorm::InBar {
            x: vec![0.0; mine.len()],
            gain: take(&mut x_bar.norm_gain),
            bias: take(&mut x_bar.norm_bias),
        };
        let norm = &saved.norm[view * per_view..(view + 1) * per_view];
        layernorm::adjoint(&x.norm(&saved.linear[mine.clone()]), norm, &tokens_bar[mine], &mut bar);
        (x_bar.norm_gain, x_bar.norm_bias) = (bar.gain, bar.bias);
        x_bar.bias.iter_mut().zip(column_sums(&bar.x, d)).for_each(|(bar, sum)| *bar += sum);
        linear_bar.append(&mut bar.x);
    }
    for (part, (pixels, weight)) in x.parts().zip(x_bar.parts()) {
        let mut bar = conv::InBar { x: take(pixels), weight: take(weight), bias: Vec::new() };
        conv::adjoint(part, &linear_bar, &mut bar);
        (*pixels, *weight) = (bar.x, bar.weight);
    }
}
