//! What a trained model says about a render: how far its factors are from those of the photograph, and which points each factor moves
//! (`last.md` §11, §12.2).
//!
//! L_lat = 1/(2nk) Σ over i, c of (ΔẐ_ic/s_ic)² + (Δε_ic/t_ic)²,   Δ = rendered − real, posterior means, the final graph
//!
//! s, t are the standard deviations over the training set. The first half compares factors, the second mechanisms: a child that is off only because
//! its parent is off has Δε = 0. The literal reading has the first half alone, and divides by nk. The gradient goes through abduction (or the structure)
//! and the encoder to the render; the photograph is constant.
//!
//! s_ig = ‖D(Ẑʳ with factor i of Ẑᵍ)(t_g) − D(Ẑʳ)(t_g)‖, coordinates in units of σ = 0.05, colours of 0.2.

use super::data::Frame;
use super::file::Trained;
use super::pictures;
use super::settings::Reading;
use super::sight::Sight;
use super::structure::Structure;
use super::verdict::linked;
use crate::causal::structure;
use crate::scene::person::{PersonCapture, Photo, Shot};
use crate::tape::Tape;
use ndarray::{ArrayD, IxDyn};
use std::collections::BTreeMap;

/// Factors and noise of a picture, (n, k) each.
#[derive(Clone, Debug, PartialEq)]
pub struct Factors {
    /// Ẑ
    pub factors: Vec<f64>,
    /// ε
    pub noise: Vec<f64>,
}

impl Trained {
    /// Side of the pictures that the encoder takes.
    pub fn side(&self) -> Option<usize> {
        match self.model.encoder.input() {
            super::encoder::Input::Picture { side } => Some(side),
            super::encoder::Input::Vector { .. } => None,
        }
    }

    fn encoded(&self, tape: &mut Tape, seen: &[f32], wanted: bool) -> (crate::tape::Var, Vec<f64>) {
        let x = self.model.encoder.batch(seen.to_vec());
        let x = if wanted { tape.leaf("picture", x) } else { tape.constant(x) };
        let own = self.model.params.iter().filter(|(name, _)| name.starts_with("encoder."));
        let vars: BTreeMap<_, _> = own.map(|(name, a)| (name.to_owned(), tape.constant(a.clone()))).collect();
        let y = self.model.encoder.record(tape, &vars, x);
        let d = self.model.sizes.latent();
        let mu = tape.value(y).iter().take(d).map(|&m| f64::from(m)).collect();
        (y, mu)
    }

    /// Means and ℓ of what is seen (S, S, 3), d numbers each.
    ///
    /// # Panics
    /// When it does not have the size of the encoder's pictures.
    pub fn posterior(&self, seen: &[f32]) -> [Vec<f64>; 2] {
        let mut tape = Tape::new();
        let (y, mu) = self.encoded(&mut tape, seen, false);
        let ell = tape.value(y).iter().skip(mu.len()).map(|&l| f64::from(l)).collect();
        [mu, ell]
    }

    /// Factors and noise of what is seen (S, S, 3).
    ///
    /// # Panics
    /// When it does not have the size of the encoder's pictures.
    pub fn factors(&self, seen: &[f32]) -> Factors {
        let (_, mu) = self.encoded(&mut Tape::new(), seen, false);
        let [factors, noise] = linked(self, mu);
        Factors { factors, noise }
    }

    /// L_lat of what is seen of a render against the factors of the photograph, and its gradient by what is seen.
    ///
    /// # Panics
    /// When it does not have the size of the encoder's pictures.
    pub fn discrepancy(&self, seen: &[f32], real: &Factors) -> (f64, Vec<f32>) {
        let mut tape = Tape::new();
        let (y, mu) = self.encoded(&mut tape, seen, true);
        let [u, eps] = linked(self, mu.clone());
        let d = self.model.sizes.latent();
        let literal = self.settings.reading == Reading::Literal;
        let share = if literal { 1.0 / d as f64 } else { 0.5 / d as f64 };
        let mut value = 0.0;
        let mut half = |x: &[f64], real: &[f64], spread: &[f64]| -> Vec<f64> {
            (0..d)
                .map(|at| {
                    let off = (x[at] - real[at]) / spread[at];
                    value += share * (off * off);
                    2.0 * share * off / spread[at]
                })
                .collect()
        };
        let u_bar = half(&u, &real.factors, &self.factor_spread);
        let eps_bar = if literal { vec![0.0; d] } else { half(&eps, &real.noise, &self.noise_spread) };
        let s = Structure::new(self.model.sizes, &self.model.params);
        let mask = self.graph.adjacency();
        let x = structure::In {
            eps: &mu,
            mask: &mask,
            mechanism: s.mechanism(),
            batch: 1,
            n: self.model.sizes.factors,
            k: self.model.sizes.width,
            sweeps: s.sweeps(),
        };
        let mut bar = structure::InBar::zeros_like(&x);
        let direct = match self.settings.reading {
            Reading::Reference => {
                structure::abduct_adjoint(&x, &eps_bar, &mut bar);
                u_bar
            }
            Reading::Literal => {
                let (_, saved) = structure::forward(&x);
                structure::adjoint(&x, &saved, &u_bar, &mut bar);
                eps_bar
            }
        };
        let mu_bar = direct.iter().zip(&bar.eps).map(|(a, b)| (a + b) as f32);
        let y_bar: Vec<f32> = mu_bar.chain(std::iter::repeat_n(0.0, d)).collect();
        let y_bar = ArrayD::from_shape_vec(IxDyn(&[1, 2 * d]), y_bar).expect("(1, 2 d)");
        let mut grads = tape.backward(y, y_bar);
        let picture = grads.take("picture").expect("the picture is a leaf");
        (value, picture.into_raw_vec_and_offset().0)
    }

    /// s_ig of every factor (n) and point (G), for one photograph.
    pub fn swap_scores(&self, rendered: &Factors, real: &Factors, points: &[[f32; 3]]) -> Vec<Vec<f64>> {
        let (n, k) = (self.model.sizes.factors, self.model.sizes.width);
        let mut z: Vec<f32> = rendered.factors.iter().map(|&z| z as f32).collect();
        let plain = z.clone();
        for i in 0..n {
            let mut swapped = plain.clone();
            for c in i * k..(i + 1) * k {
                swapped[c] = real.factors[c] as f32;
            }
            z.extend(swapped);
        }
        let frame: Frame = pictures::frame(points);
        let y = self.model.decoder.forward(&self.model.params, &frame.codes, &z);
        let size = points.len() * frame.outputs;
        (1..=n)
            .map(|i| {
                (0..points.len())
                    .map(|g| {
                        let sum = (0..frame.outputs).fold(0.0, |sum, c| {
                            let at = g * frame.outputs + c;
                            let off = f64::from(frame.scale[c]) * f64::from(y[i * size + at] - y[at]);
                            sum + f64::from(frame.precision[c]) * (off * off)
                        });
                        sum.sqrt()
                    })
                    .collect()
            })
            .collect()
    }

    /// Points and colours (G, 6) that the decoder gives at some coordinates.
    pub fn decoded(&self, factors: &[f64], points: &[[f32; 3]]) -> Vec<[f32; 6]> {
        let z: Vec<f32> = factors.iter().map(|&z| z as f32).collect();
        let frame: Frame = pictures::frame(points);
        let y = self.model.decoder.forward(&self.model.params, &frame.codes, &z);
        let value = |at: usize, c: usize| frame.base[at * 6 + c] + frame.scale[c] * y[at * 6 + c];
        (0..points.len()).map(|at| std::array::from_fn(|c| value(at, c))).collect()
    }

    /// What is seen of a picture whose person is in the box `around`.
    ///
    /// # Panics
    /// When the model takes vectors.
    pub fn sight(&self, size: [usize; 2], around: [f64; 4]) -> Sight {
        Sight::new(self.side().expect("a model of pictures"), size, around)
    }
}

/// The box [x₀, y₀, x₁, y₁] of the person in a shot, in pixels; the whole picture where nothing of it is seen.
pub fn around(capture: &PersonCapture, shot: &Shot) -> [f64; 4] {
    let width = shot.camera.width;
    let mask = capture.box_mask(shot);
    let mut around: Option<[usize; 4]> = None;
    for at in (0..mask.len()).filter(|&at| mask[at] != 0) {
        let (x, y) = (at % width, at / width);
        let [a, b, c, d] = around.unwrap_or([x, y, x + 1, y + 1]);
        around = Some([Ord::min(a, x), Ord::min(b, y), Ord::max(c, x + 1), Ord::max(d, y + 1)]);
    }
    around.unwrap_or([0, 0, width, shot.camera.height]).map(|x| x as f64)
}

/// What the model sees of a shot.
///
/// # Panics
/// When the model takes vectors.
pub fn seen(trained: &Trained, capture: &PersonCapture, shot: &Shot, photo: &Photo) -> Vec<f32> {
    let size = [shot.camera.width, shot.camera.height];
    let picture: Vec<f32> = photo.rgb.iter().map(|&b| f32::from(b) / 255.0).collect();
    trained.sight(size, around(capture, shot)).seen(size, &picture)
}
