//! Rescaling of the factors' codes.
//!
//! L_rec does not determine the scale of the codes: û·c with the decoder's first weights divided by c is the
//! same function. As long as only encoder and decoder are trained, codes stay about as small as their initial
//! values. The group losses, however, depend on the scale: the spread hinge raises the variance to ¼, with a
//! gradient proportional to the code, and s² in L_eq has a lower limit. Therefore, if the variance of a
//! factor, averaged over its dimensions, is below that of an active unit (0.01, Burda et al. 2016) when the
//! group losses start, every factor is rescaled to a variance of about 1:
//!
//! ```text
//! c = 2^round(−½ log₂ s²) ≤ 16 μ ← c·μ: the rows of the encoder's last layer and their biases
//!                              ℓ ← ℓ + 2 ln c: their biases
//!                              decoder: the columns of the first layer that multiply the factor, divided by c
//!                              mechanisms: columns of the first layer that multiply a parent, divided by its c;
//!                                          rows of the last layer of a child, times its c; Ωᵢⱼ times cⱼ/cᵢ
//! ```
//!
//! The limit keeps ℓ, whose initial value is −2, below 4, above which it has no gradient
//! ([`crate::causal::posterior::LOGVAR`]).
//!
//! Adam's moments are rescaled with their parameters (m by 1/c if the parameter is multiplied by c, v by
//! 1/c²), as are the covariances of earlier batches. Scaling by powers of two is exact: the decoded points of
//! a mean and the results of an intervention have the same bits before and after.

use super::decoder::LATENT;
use super::evaluation::ACTIVE;
use super::step::Model;
use super::structure::{self, Sizes};
use crate::causal::independence::History;
use crate::num::elem::f64::{exp2, ln};
use crate::num::order;
use crate::optim::optimiser::Optimiser;

/// Lower limit of the variances, so that c ≤ 16.
const SMALLEST: f64 = 1.0 / 256.0;

/// Whether the code of some factor has almost no variance.
pub fn are_needed(spread: &[f64]) -> bool {
    spread.iter().any(|s| *s < ACTIVE)
}

/// The scale c of each factor, from the variances of their codes.
pub fn of(spread: &[f64]) -> Vec<f64> {
    spread.iter().map(|s| exp2(libm::round(-0.5 * ln(order::max(*s, SMALLEST)) / ln(2.0)))).collect()
}

/// Multiplies the code of every factor i by cᵢ.
pub fn change(model: &mut Model, optimiser: &mut Optimiser, history: &mut History, c: &[f64]) {
    let Sizes { factors: n, width: k, .. } = model.sizes;
    let d = n * k;
    let unit = |column: usize| c[column / k];
    let [weight, bias] = model.encoder.last();
    let inputs = model.params.get(&weight).map_or(0, |w| w.shape()[1]);
    let rows = |row: usize| if row < d { unit(row) } else { 1.0 };
    type Factor<'a> = &'a dyn Fn(usize) -> f64;
    let scales: [(&str, Factor<'_>); 6] = [
        (&weight, &|at| rows(at / inputs)),
        (&bias, &rows),
        (LATENT, &|at| 1.0 / unit(at % d)),
        (structure::FIRST, &|at| 1.0 / unit(at % d)),
        (structure::LAST, &|at| unit(at / structure::HIDDEN)),
        (structure::EFFECTS, &|at| c[at % n] / c[at / n]),
    ];
    for (name, by) in scales {
        // The arrays of the mechanism depend on a setting.
        let Some(param) = model.params.get_mut(name) else { continue };
        for (at, value) in param.iter_mut().enumerate() {
            *value = (f64::from(*value) * by(at)) as f32;
        }
        if let Some(adam) = optimiser.get_mut(name) {
            adam.rescale(|at| by(at) as f32);
        }
    }
    let bias = model.params.get_mut(&bias).expect("the last layer has biases");
    for (column, ell) in bias.iter_mut().skip(d).enumerate() {
        *ell = (f64::from(*ell) + 2.0 * ln(unit(column))) as f32;
    }
    for covariance in &mut history.past {
        for (at, value) in covariance.iter_mut().enumerate() {
            *value *= unit(at / d) * unit(at % d);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::last::model::data::{Data, Item};
    use crate::last::model::settings::{Reading, Settings};
    use crate::last::model::step::{self, Batch, Context};
    use crate::last::model::structure::Kind;
    use crate::last::model::vectors::Vectors;
    use crate::optim::adam::{Adam, Counters, Rule};
    use crate::tape::Params;
    use data_gen::figure::graph::Graph;
    use data_gen::figure::mechanism::{Mechanism, Scm};

    #[test]
    fn units_are_powers_of_two_that_give_variances_about_one() {
        assert_eq!(of(&[1.0, 0.25, 0.01, 64.0]), [1.0, 2.0, 8.0, 0.125]);
        assert_eq!(of(&[0.0, 1e-5]), [16.0; 2], "the largest factor");
        let [_, most] = crate::causal::posterior::LOGVAR;
        assert!(-2.0 + 2.0 * ln(16.0) < most, "the first logarithm of a variance keeps its gradient");
        assert!(are_needed(&[1.0, 0.009]) && !are_needed(&[1.0, 0.02]), "one is enough");
        for s in [0.004, 0.03, 0.7, 3.0, 1e4] {
            let c = of(&[s])[0];
            assert!((0.49..=2.01).contains(&(s * c * c)), "{s} becomes {}", s * c * c);
        }
    }

    /// An optimiser without parameters.
    fn none() -> Optimiser {
        Optimiser::new(Rule::default(), &Params::new()).expect("a rule in its range")
    }

    /// A model for vectors, its data and 8 of their items.
    fn small() -> (Settings, Vectors, Model, Vec<Item>) {
        let scm = Scm::new(Graph::named("FORK", 4, 1).expect("a name"), Mechanism::Lin, true, 1);
        let data = Vectors::new(&scm, 1, 64, 16);
        let settings = Settings { points: 1, width: 2, observed: 16, groups: 4, ..Settings::default() };
        let model = Model::new(&settings, &data).expect("a model");
        (settings, data, model, (0..8).map(Item::Observed).collect())
    }

    #[test]
    fn what_is_decoded_keeps_its_bits() {
        let (_, data, mut model, items) = small();
        let c = [4.0, 1.0, 0.5, 8.0];
        let see = |model: &Model| {
            let [mu, ell] = model.encode(&data, &items);
            let z: Vec<f32> = mu.iter().map(|m| *m as f32).collect();
            let y = model.decoder.forward(&model.params, &data.frame().codes, &z);
            (mu, ell, y)
        };
        let (mu, ell, y) = see(&model);
        let mut history = History::default();
        history.push((0..64).map(f64::from).collect());
        change(&mut model, &mut none(), &mut history, &c);
        let (scaled, widened, again) = see(&model);
        assert_eq!(again, y, "the same points from the same images, bit for bit");
        let unit = |at: usize| c[at % 8 / 2];
        for at in 0..mu.len() {
            assert_eq!(scaled[at], mu[at] * unit(at), "mean {at}");
            let ratio = (widened[at] - ell[at]) / 2.0;
            assert!((ratio - ln(unit(at))).abs() < 1e-6, "deviation {at} grows by {ratio}");
        }
        assert_eq!(
            history.past[0][8 * 3 + 6],
            (8.0 * 3.0 + 6.0) * 1.0 * 8.0,
            "a covariance of factors 1 and 3"
        );
    }

    #[test]
    fn factors_and_noise_keep_their_bits() {
        let (settings, data, _, items) = small();
        for (kind, reading) in [
            (Kind::Networks, Reading::Reference),
            (Kind::Linear, Reading::Reference),
            (Kind::Linear, Reading::Literal),
            (Kind::Printed, Reading::Literal),
        ] {
            let mut model = Model::new(&Settings { kind, ..settings }, &data).expect("a model");
            for last in [structure::EFFECTS, structure::LAST] {
                let Some(weights) = model.params.get_mut(last) else { continue };
                weights.iter_mut().enumerate().for_each(|(at, w)| *w = 0.3 * libm::sinf(at as f32));
            }
            let mask: Vec<f64> = (0..16).map(|at| if at / 4 < at % 4 { 0.75 } else { 0.0 }).collect();
            let noise = |model: &Model| {
                let [mu, _] = model.encode(&data, &items);
                model.linked(reading, &mask, mu)
            };
            let before = noise(&model);
            let [u, eps] = &before;
            assert!(u.iter().zip(eps).any(|(u, e)| (u - e).abs() > 1e-3), "parents act");
            let c = [4.0, 1.0, 0.5, 8.0];
            change(&mut model, &mut none(), &mut History::default(), &c);
            for (new, old) in noise(&model).iter().zip(&before) {
                for (at, (new, old)) in new.iter().zip(old).enumerate() {
                    assert_eq!(*new, old * c[at % 8 / 2], "{kind:?}, {reading:?}, {at}");
                }
            }
        }
    }

    #[test]
    fn moments_of_adam_follow_their_parameters() {
        let (settings, data, mut model, _) = small();
        let c = [4.0, 1.0, 0.5, 8.0];
        // Only L_rec, whose gradient does not depend on the scale.
        let slope = |model: &Model| {
            let mut settings = settings;
            settings.weights.independence = 0.0;
            settings.groups = 0;
            let batch = Batch::draw(&settings, &data, 0);
            let context = Context {
                step: 0,
                kl: 0.0,
                groups: 0.0,
                lagrange: None,
                graph: None,
                spread: vec![1.0; 4],
                history: History::default(),
            };
            step::run(model, &settings, &data, &batch, &context).expect("finite").grads
        };
        let before = slope(&model);
        let [weight, bias] = model.encoder.last();
        let names = [weight, bias, LATENT.to_owned()];
        let rule = Rule { counters: Counters::Global, ..Rule::default() };
        let mut optimiser = Optimiser::of(rule, &model.params, |name| names.iter().any(|n| n == name))
            .expect("a rule in its range");
        optimiser.step(&mut model.params, &before, |_| Some(0.0)).expect("finite");
        change(&mut model, &mut optimiser, &mut History::default(), &c);
        let after = slope(&model);
        for name in &names {
            let grad = after.get(name).expect("a gradient").as_slice().expect("contiguous");
            let mut fresh = Adam::new(rule, grad.len(), 1).expect("a rule in its range");
            fresh.step(&mut vec![0.0; grad.len()], grad, &[0.0], None).expect("finite");
            // The result is as if the step had been made after rescaling; ℓ is rounded, so the noise differs
            // slightly.
            let old = optimiser.get(name).expect("a state");
            let [(m, v), (m_new, v_new)] = [old, &fresh].map(Adam::moments);
            for (old, new) in [(m, m_new), (v, v_new)] {
                let most = new.iter().fold(0.0, |most, x| if x.abs() > most { x.abs() } else { most });
                assert!(most > 0.0, "{name} has gradients");
                for (at, (old, new)) in old.iter().zip(new).enumerate() {
                    assert!((old - new).abs() < 1e-4 * most, "{name}, {at}: {old:e} and {new:e}");
                }
            }
        }
    }
}
