//! Gradients of encoder and decoder against differences of the same networks written once more, in double
//! precision.

use lastlight::last::model::decoder::{Decoder, HIDDEN, Target};
use lastlight::last::model::encoder::{Encoder, Input};
use lastlight::loss::points::{self, Sigmas};
use lastlight::num::rng::Rng;
use lastlight::tape::{Params, Tape};
use ndarray::{ArrayD, IxDyn};
use std::collections::BTreeMap;

/// Parameters and inputs in double precision, by name.
type Values = BTreeMap<String, Vec<f64>>;

fn draws(part: u16, len: usize) -> Vec<f32> {
    (0..len).map(|i| Rng::new(11).normal_f32(i as u64, 0, 0x7e59, part)).collect()
}

fn leaky(x: f64) -> f64 {
    if x > 0.0 { x } else { f64::from(0.2_f32) * x }
}

fn dense(values: &Values, weight: &str, x: &[f64]) -> Vec<f64> {
    values[weight]
        .chunks_exact(x.len())
        .map(|row| row.iter().zip(x).fold(0.0, |s, (w, x)| s + w * x))
        .collect()
}

fn plus(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a + b).collect()
}

/// ⟨ours, direction⟩ against the difference of `value` along the direction, for every array.
fn check(what: &str, values: &Values, grads: &Values, value: &dyn Fn(&Values) -> f64) {
    for (at, (name, grad)) in grads.iter().enumerate() {
        let v: Vec<f64> = draws(100 + at as u16, grad.len()).into_iter().map(f64::from).collect();
        let at = |t: f64| {
            let mut moved = values.clone();
            let array = moved.get_mut(name).expect("a value");
            array.iter_mut().zip(&v).for_each(|(x, v)| *x += t * v);
            value(&moved)
        };
        let h = 1e-7;
        let difference = (at(h) - at(-h)) / (2.0 * h);
        let ours = grad.iter().zip(&v).fold(0.0, |s, (g, v)| s + g * v);
        let error = (ours - difference).abs() / (1e-6 + difference.abs());
        assert!(error < 1e-4, "{what}, {name}: {ours} against {difference}, relative {error:e}");
    }
}

fn stored(params: &Params) -> Values {
    params.iter().map(|(name, a)| (name.to_owned(), a.iter().map(|&x| f64::from(x)).collect())).collect()
}

#[test]
fn the_decoders_gradients_are_those_of_its_loss() {
    let decoder = Decoder { features: 5, latent: 3, outputs: 6 };
    let mut params = Params::new();
    decoder.draw(3, &mut params);
    for (at, (name, _)) in decoder.shapes().into_iter().enumerate().filter(|(_, (n, _))| n.ends_with("bias"))
    {
        let array = params.get_mut(&name).expect("drawn");
        let values = draws(at as u16, array.len());
        array.iter_mut().zip(values).for_each(|(a, v)| *a = 0.3 * v);
    }
    let (items, q) = (2, 7);
    let (codes, base) = (draws(20, q * 5), draws(21, q * 6));
    let (wanted, z) = (draws(22, items * q * 6), draws(23, items * 3));
    let (scale, precision) = ([0.5, 0.5, 0.5, 1.0, 1.0, 1.0], [4.0, 4.0, 4.0, 0.25, 0.25, 0.25]);
    let weights = [0.7, 1.3];
    let targets: Vec<Target<'_>> = (0..items)
        .map(|b| Target {
            codes: &codes,
            base: &base,
            wanted: &wanted[b * q * 6..][..q * 6],
            weight: weights[b],
        })
        .collect();
    let passed = decoder.pass(&params, &z, &targets, &scale, &precision);
    let mut values = stored(&params);
    values.insert("z".into(), z.iter().map(|&z| f64::from(z)).collect());
    let mut grads: Values = decoder
        .shapes()
        .into_iter()
        .zip(&passed.grads)
        .map(|((name, _), g)| (name, g.iter().map(|&g| f64::from(g)).collect()))
        .collect();
    grads.insert("z".into(), passed.z_bar.iter().map(|&g| f64::from(g)).collect());
    let value = |v: &Values| {
        let mut total = 0.0;
        for (b, z) in v["z"].chunks_exact(3).enumerate() {
            let shift = plus(&dense(v, "decoder.latent.weight", z), &v["decoder.dense0.bias"]);
            for p in 0..q {
                let code: Vec<f64> = codes[p * 5..(p + 1) * 5].iter().map(|&c| f64::from(c)).collect();
                let mut h = plus(&dense(v, "decoder.point.weight", &code), &shift);
                for i in 1..=HIDDEN.len() {
                    h = h.into_iter().map(leaky).collect();
                    let y = dense(v, &format!("decoder.dense{i}.weight"), &h);
                    h = plus(&y, &v[&format!("decoder.dense{i}.bias")]);
                }
                for (c, y) in h.iter().enumerate() {
                    let at = p * 6 + c;
                    let error =
                        f64::from(base[at]) + f64::from(scale[c]) * y - f64::from(wanted[b * q * 6 + at]);
                    total += f64::from(weights[b]) * f64::from(precision[c]) * error * error / q as f64;
                }
            }
        }
        total
    };
    check("decoder", &values, &grads, &value);
    the_loss_is_that_of_loss_points(&decoder, &params, &z, &targets[..]);
    let total = passed.losses.iter().zip(weights).fold(0.0, |s, (l, w)| s + f64::from(w) * l);
    assert!((total / value(&values) - 1.0).abs() < 1e-5, "the loss itself: {total}");
}

#[test]
fn the_encoders_gradients_are_those_of_its_outputs() {
    let encoder = Encoder::new(Input::Picture { side: 64 }, 2).expect("a side of the list");
    let mut params = Params::new();
    encoder.draw(5, &mut params);
    let x: Vec<f32> = draws(30, 64 * 64 * 3).into_iter().map(|x| 0.3 * x).collect();
    let cotangent = draws(31, 4);
    let mut tape = Tape::new();
    let picture = tape.leaf("picture", encoder.batch(x.clone()));
    let vars = params.record(&mut tape);
    let y = encoder.record(&mut tape, &vars, picture);
    let bar = ArrayD::from_shape_vec(IxDyn(&[1, 4]), cotangent.clone()).expect("(1, 2 d)");
    let grads = tape.backward(y, bar);
    let grads: Values =
        grads.0.iter().map(|(name, g)| (name.clone(), g.iter().map(|&g| f64::from(g)).collect())).collect();
    let mut values = stored(&params);
    values.insert("picture".into(), x.iter().map(|&x| f64::from(x)).collect());
    let value = |v: &Values| {
        let (mut x, mut side, mut channels) = (v["picture"].clone(), 64, 3);
        for i in 0..4 {
            let (weight, bias) =
                (&v[&format!("encoder.conv{i}.weight")], &v[&format!("encoder.conv{i}.bias")]);
            let half = side / 2;
            let mut out = vec![0.0; half * half * bias.len()];
            for at in 0..out.len() {
                let (o, c, r) = (at % bias.len(), at / bias.len() % half, at / bias.len() / half);
                let mut sum = bias[o];
                for tap in 0..16 {
                    let (row, column) =
                        ((2 * r + tap / 4).wrapping_sub(1), (2 * c + tap % 4).wrapping_sub(1));
                    if row < side && column < side {
                        for k in 0..channels {
                            sum += weight[(o * 16 + tap) * channels + k]
                                * x[(row * side + column) * channels + k];
                        }
                    }
                }
                out[at] = leaky(sum);
            }
            (x, side, channels) = (out, half, bias.len());
        }
        let hidden = plus(&dense(v, "encoder.dense0.weight", &x), &v["encoder.dense0.bias"]);
        let hidden: Vec<f64> = hidden.into_iter().map(leaky).collect();
        let y = plus(&dense(v, "encoder.dense1.weight", &hidden), &v["encoder.dense1.bias"]);
        y.iter().zip(&cotangent).fold(0.0, |s, (y, c)| s + y * f64::from(*c))
    };
    check("encoder", &values, &grads, &value);
}

/// What the pass sums is the operator's loss, in its bits.
fn the_loss_is_that_of_loss_points(decoder: &Decoder, params: &Params, z: &[f32], targets: &[Target<'_>]) {
    let sigmas = Sigmas { xyz: 0.05, rgb: 0.2 };
    let precision = [sigmas.xyz, sigmas.rgb].map(|s| [(1.0 / (s * s)) as f32; 3]).concat();
    let scale = [0.5, 0.5, 0.5, 1.0, 1.0, 1.0];
    let passed = decoder.pass(params, z, targets, &scale, &precision);
    let y = decoder.forward(params, targets[0].codes, z);
    for ((target, y), loss) in targets.iter().zip(y.chunks_exact(targets[0].wanted.len())).zip(passed.losses)
    {
        let x: Vec<f32> = (0..y.len()).map(|at| target.base[at] + scale[at % 6] * y[at]).collect();
        let input = points::In { x: &x, y: target.wanted, batch: 1, channels: [6, 6], sigmas };
        let operator = points::ordered(&input).expect("finite points");
        assert_eq!(loss as f32, operator, "the pass and loss.points");
    }
}
