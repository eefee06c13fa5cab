//! The trained model as a guide: computes how far the factors of a render are from those of the input image,
//! and which points each factor displaces (eq. 9 of the LAST paper and the key Gaussians of eq. 10–12).
//!
//! L_lat is [`mod@crate::loss::latent`] with Δ = rendered − real, computed from posterior means and the final
//! graph; s and t are the standard deviations over the training set. In the literal reading, L_lat consists
//! of its first half only. The gradient is propagated through abduction (or the structure) and the encoder to
//! the render; the input image is constant.
//!
//! s_ig = ‖D(Ẑʳ with factor i of Ẑᵍ)(t_g) − D(Ẑʳ)(t_g)‖, with coordinates in units of σ = 0.05 and colours in
//! units of 0.2.
//!
//! Images are squares of the encoder's input side with colours in 0 … 1.

use super::data::Frame;
use super::encoder::Input;
use super::evaluation::linked;
use super::file::Trained;
use super::pictures;
use super::settings::Reading;
use super::structure::Structure;
use crate::causal::structure;
use crate::last::avatar::guide::{Framing, Guide, Square, nowhere};
use crate::loss::latent::{self, Half};
use crate::math::digraph::Digraph;
use crate::scene::person::{PersonCapture, Photo, Shot};
use crate::tape::Tape;
use crate::{Error, Result};
use ndarray::{ArrayD, IxDyn};

/// Factors and noise of an image, (n, k) each.
#[derive(Clone, Debug, PartialEq)]
pub struct Factors {
    /// The factors Ẑ.
    pub factors: Vec<f64>,
    /// The noise ε.
    pub noise: Vec<f64>,
}

impl Trained {
    fn encoded(&self, tape: &mut Tape, seen: &[f32], wanted: bool) -> (crate::tape::Var, Vec<f64>) {
        let x = self.model.encoder.batch(seen.iter().map(|x| x - 0.5).collect());
        let x = if wanted { tape.leaf("picture", x) } else { tape.constant(x) };
        let vars = self.model.params.of("encoder.").constants(tape);
        let y = self.model.encoder.record(tape, &vars, x);
        let d = self.model.sizes.latent();
        let mu = tape.value(y).iter().take(d).map(|&m| f64::from(m)).collect();
        (y, mu)
    }

    /// Posterior means and ℓ of an encoder input (S, S, 3), d numbers each.
    ///
    /// # Panics
    /// If the input does not have the size that the encoder requires.
    pub fn posterior(&self, seen: &[f32]) -> [Vec<f64>; 2] {
        let mut tape = Tape::new();
        let (y, mu) = self.encoded(&mut tape, seen, false);
        let ell = tape.value(y).iter().skip(mu.len()).map(|&l| f64::from(l)).collect();
        [mu, ell]
    }

    /// Factors and noise of an encoder input (S, S, 3).
    ///
    /// # Panics
    /// If the input does not have the size that the encoder requires.
    pub fn encode(&self, seen: &[f32]) -> Factors {
        let (_, mu) = self.encoded(&mut Tape::new(), seen, false);
        let [factors, noise] = linked(self, mu);
        Factors { factors, noise }
    }

    /// L_lat between a rendered encoder input and the factors of the input image, and its gradient with
    /// respect to the rendered input.
    ///
    /// # Panics
    /// If the input does not have the size that the encoder requires.
    pub fn latent_loss(&self, seen: &[f32], real: &Factors) -> (f64, Vec<f32>) {
        let mut tape = Tape::new();
        let (y, mu) = self.encoded(&mut tape, seen, true);
        let [u, eps] = linked(self, mu.clone());
        let d = self.model.sizes.latent();
        let literal = self.settings.reading == Reading::Literal;
        let halves = [
            Half { x: &u, real: &real.factors, spread: &self.factor_spread },
            Half { x: &eps, real: &real.noise, spread: &self.noise_spread },
        ];
        let halves = if literal { &halves[..1] } else { &halves };
        let value = latent::forward(halves);
        let (mut u_bar, mut eps_bar) = (vec![0.0; d], vec![0.0; d]);
        latent::adjoint(halves, 0, 1.0, &mut u_bar);
        if !literal {
            latent::adjoint(halves, 1, 1.0, &mut eps_bar);
        }
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
        let picture = grads.take("picture").expect("the input image is a leaf of the tape");
        (value, picture.into_raw_vec_and_offset().0)
    }

    /// Scores s_ig of every factor (n) and point (G), for one input image.
    pub fn swapped(&self, rendered: &Factors, real: &Factors, points: &[[f32; 3]]) -> Vec<Vec<f64>> {
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

    /// Points and colours (G, 6) decoded at the given coordinates.
    pub fn decoded(&self, factors: &[f64], points: &[[f32; 3]]) -> Vec<[f32; 6]> {
        let z: Vec<f32> = factors.iter().map(|&z| z as f32).collect();
        let frame: Frame = pictures::frame(points);
        let y = self.model.decoder.forward(&self.model.params, &frame.codes, &z);
        let value = |at: usize, c: usize| frame.base[at * 6 + c] + frame.scale[c] * y[at * 6 + c];
        (0..points.len()).map(|at| std::array::from_fn(|c| value(at, c))).collect()
    }
}

impl Guide for Trained {
    fn factors(&self) -> usize {
        self.model.sizes.factors
    }

    fn graph(&self) -> Digraph {
        self.graph.clone()
    }

    fn side(&self) -> usize {
        match self.model.encoder.input() {
            Input::Picture { side } => side,
            Input::Vector { .. } => 0,
        }
    }

    fn framing(&self) -> Framing {
        self.settings.framing
    }

    fn identity(&self) -> String {
        self.digest().unwrap_or_else(|e| e.to_string())
    }

    fn discrepancy(&self, rendered: &[f32], real: &[f32]) -> Result<(f64, Vec<f32>)> {
        let (value, bar) = self.latent_loss(rendered, &self.encode(real));
        if value.is_finite() && bar.iter().all(|g| g.is_finite()) {
            return Ok((value, bar));
        }
        Err(Error::check("latent discrepancy").expected("finite numbers").got(value.to_string()))
    }

    fn swap_scores(&self, rendered: &[f32], real: &[f32], places: &[[f32; 3]]) -> Result<Vec<Vec<f64>>> {
        let scores = self.swapped(&self.encode(rendered), &self.encode(real), places);
        if scores.iter().flatten().all(|s| s.is_finite()) {
            return Ok(scores);
        }
        Err(Error::check("scores of exchanged factors").expected("finite numbers"))
    }
}

/// The encoder input (S, S, 3) cropped from the image of a shot.
///
/// # Errors
/// If the person is outside the image.
pub fn seen(trained: &Trained, capture: &PersonCapture, shot: &Shot, photo: &Photo) -> Result<Vec<f32>> {
    let picture: Vec<f32> = photo.rgb.iter().map(|&b| f32::from(b) / 255.0).collect();
    cut(trained, capture, shot, &picture)
}

/// The encoder input (S, S, 3) cropped from an image (H, W, 3) with the camera and the moment of a shot.
///
/// # Errors
/// If the person is outside the image.
///
/// # Panics
/// If the image does not have the size given by the camera.
pub fn cut(trained: &Trained, capture: &PersonCapture, shot: &Shot, picture: &[f32]) -> Result<Vec<f32>> {
    let size = [shot.camera.height, shot.camera.width];
    let person = Square::around(&shot.camera, &capture.posed_points(shot.time));
    let square = trained.framing().square(size, person).ok_or_else(|| nowhere(&shot.name))?;
    Ok(square.window(trained.side(), size).take(picture))
}
