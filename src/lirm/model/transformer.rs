//! One set of images: from the last state to the next.
//!
//! ```text
//! state ─► fuse ─► (T_s, D) ─┐                                    ┌─► rows of the state ─► LayerNorm ─► state
//! images ─► tokens ─► (T_i, D) ─┴─► block 0 ─► … ─► block n−1 ────┴─► rows of the images: not used
//! ```
//!
//! Images may have different sizes. Without `recompute`, what every block saves is kept until the adjoint;
//! with it, only the input of every block is, and each block runs again: the same bits.

use super::config::{EPS, PATCH};
use super::weights::{Gradients, Ready, lend, lend_block};
use crate::nn::{block, fuse, layernorm, tokens};

/// An image as the model reads it; all arrays are row-major.
#[derive(Clone, Debug)]
pub struct Input {
    /// Width and height in pixels, multiples of [`PATCH`].
    pub size: [usize; 2],
    /// (H, W, 3) colours over white, 2x − 1, with a background of 1 or 3 ([`super::config::Background`]).
    pub image: Vec<f32>,
    /// (H, W, 6) coordinates of the rays ([`super::config::Rays`]), in units of the field.
    pub rays: Vec<f32>,
    /// (H, W, 3) the image with what is behind the object, 2x − 1; empty where it is not read.
    pub photo: Vec<f32>,
}

impl Input {
    /// Number of tokens.
    pub fn tokens(&self) -> usize {
        self.size[0] / PATCH * (self.size[1] / PATCH)
    }
}

/// What the adjoint of a set needs.
#[derive(Debug)]
pub struct Saved {
    views: Vec<tokens::Saved>,
    fused: fuse::Saved,
    places: Vec<f32>,
    /// The input of every block.
    at: Vec<Vec<f32>>,
    /// What every block saves; empty with recomputation.
    blocks: Vec<block::Saved>,
    /// (T_s, D) before the final LayerNorm.
    last: Vec<f32>,
    norm: layernorm::Saved,
}

impl Ready<'_> {
    fn view<'s>(&'s self, x: &'s Input) -> tokens::In<'s> {
        let [width, height] = x.size;
        let has_photo = !x.photo.is_empty();
        tokens::In {
            image: &x.image,
            rays: &x.rays,
            photo: &x.photo,
            w_image: self.array("tokens/image"),
            w_rays: self.array("tokens/rays"),
            w_photo: if has_photo { self.array("tokens/photo") } else { &[] },
            bias: self.array("tokens/bias"),
            norm_gain: self.array("tokens/norm/gain"),
            norm_bias: self.array("tokens/norm/bias"),
            eps: EPS,
            shape: tokens::Shape { views: 1, height, width, patch: PATCH },
        }
    }

    fn final_norm<'s>(&'s self, x: &'s [f32]) -> layernorm::In<'s> {
        layernorm::In { x, gain: self.array("norm/gain"), bias: self.array("norm/bias"), eps: EPS }
    }

    /// The state before the first set: zeros.
    pub fn no_state(&self) -> Vec<f32> {
        vec![0.0; self.config.state_tokens() * self.config.width]
    }

    /// Reads a set of images; returns the next state (T_s, D), and what the adjoint needs if `keep` is set.
    ///
    /// # Panics
    /// Panics if the state has another size, or a side of an image is not a multiple of [`PATCH`].
    pub fn read(&self, state: &[f32], views: &[Input], keep: Option<Keep>) -> (Vec<f32>, Option<Saved>) {
        let d = self.config.width;
        let places = self.places();
        assert_eq!(state.len(), places.len(), "the state of this model");
        let rows = self.config.state_tokens();
        let all = rows + views.iter().fold(0, |sum, v| sum + v.tokens());
        let mut x = vec![0.0; all * d];
        let fused = fuse::forward(&self.fuse(state, &places), &mut x[..rows * d]);
        let fused = keep.is_some().then_some(fused);
        let (mut first, mut saved_views) = (rows * d, Vec::new());
        for view in views {
            let part = &mut x[first..][..view.tokens() * d];
            let saved = tokens::forward(&self.view(view), part);
            if keep.is_some() {
                saved_views.push(saved);
            }
            first += part.len();
        }
        let (mut at, mut blocks) = (Vec::new(), Vec::new());
        for b in 0..self.config.blocks {
            let mut y = vec![0.0; x.len()];
            match keep {
                Some(Keep::All) => blocks.push(block::forward(&self.block(b, &x), &mut y)),
                _ => block::values(&self.block(b, &x), &mut y),
            }
            let before = std::mem::replace(&mut x, y);
            if keep.is_some() {
                at.push(before);
            }
        }
        x.truncate(rows * d);
        let mut next = vec![0.0; x.len()];
        let norm = layernorm::forward(&self.final_norm(&x), &mut next);
        let saved = fused.map(|fused| Saved { views: saved_views, fused, places, at, blocks, last: x, norm });
        (next, saved)
    }

    /// Adds the gradients for the cotangent of the next state to `g`, and those of the state that was read to
    /// `state_bar`; if that is empty, the state is a constant.
    pub fn pull_read(
        &self,
        state: &[f32],
        views: &[Input],
        saved: Saved,
        next_bar: &[f32],
        g: &mut Gradients,
        state_bar: &mut Vec<f32>,
    ) {
        let Saved { views: saved_views, fused, places, at, mut blocks, last, norm } = saved;
        let rows = last.len();
        let all = at.first().map_or(rows, Vec::len);
        let mut x_bar = vec![0.0; all];
        lend(g, ["norm/gain", "norm/bias"].map(str::to_owned), |[gain, bias]| {
            let mut bar = layernorm::InBar { x: vec![0.0; rows], gain, bias };
            layernorm::adjoint(&self.final_norm(&last), &norm, next_bar, &mut bar);
            x_bar[..rows].copy_from_slice(&bar.x);
            [bar.gain, bar.bias]
        });
        for (b, x) in at.iter().enumerate().rev() {
            let x = self.block(b, x);
            let saved = blocks.pop().unwrap_or_else(|| block::forward(&x, &mut vec![0.0; all]));
            let zeros = vec![0.0; all];
            x_bar = lend_block(g, b, zeros, |bar| block::adjoint(&x, saved, &x_bar, bar));
        }
        let mut first = rows;
        for (view, saved) in views.iter().zip(&saved_views) {
            let part = &x_bar[first..][..view.tokens() * self.config.width];
            first += part.len();
            self.pull_view(view, saved, part, g);
        }
        let x = self.fuse(state, &places);
        let names = ["fuse/w1", "fuse/w1/bias", "fuse/w2", "fuse/w2/bias"].map(str::to_owned);
        let mut places_bar = vec![0.0; places.len()];
        lend(g, names, |[w1, b1, w2, b2]| {
            let position = std::mem::take(&mut places_bar);
            let mut bar = fuse::InBar { state: std::mem::take(state_bar), position, w1, b1, w2, b2 };
            fuse::adjoint(&x, &fused, &x_bar[..rows], &mut bar);
            (*state_bar, places_bar) = (bar.state, bar.position);
            [bar.w1, bar.b1, bar.w2, bar.b2]
        });
        let (planes, panoramas) = places_bar.split_at(self.config.tokens()[0] * self.config.width);
        for (name, part) in [("places/planes", planes), ("places/panoramas", panoramas)] {
            if let Some(sum) = g.get_mut(name) {
                sum.iter_mut().zip(part).for_each(|(s, p)| *s += p);
            }
        }
    }

    fn pull_view(&self, view: &Input, saved: &tokens::Saved, bar: &[f32], g: &mut Gradients) {
        let x = self.view(view);
        let mut photo = if view.photo.is_empty() { Vec::new() } else { g.taken("tokens/photo") };
        let names = ["tokens/image", "tokens/rays", "tokens/bias", "tokens/norm/gain", "tokens/norm/bias"];
        lend(g, names.map(str::to_owned), |[w_image, w_rays, bias, norm_gain, norm_bias]| {
            let w_photo = std::mem::take(&mut photo);
            let mut own = tokens::InBar {
                w_image,
                w_rays,
                w_photo,
                bias,
                norm_gain,
                norm_bias,
                ..tokens::InBar::default()
            };
            tokens::adjoint(&x, saved, bar, &mut own);
            photo = own.w_photo;
            [own.w_image, own.w_rays, own.bias, own.norm_gain, own.norm_bias]
        });
        if !view.photo.is_empty() {
            g.put("tokens/photo", photo);
        }
    }
}

/// What a pass keeps for its adjoint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Keep {
    /// What every block saves.
    All,
    /// The input of every block; the blocks run again in the adjoint.
    Inputs,
}
