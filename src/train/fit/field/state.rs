//! What a fit optimises: planes, panoramas, heads, 1/β where it is learned, and the light, with the moments of Adam.

use super::settings::{Beta, HeadForm, Materials, Settings};
use crate::field::render::InBar;
use crate::num::array::Arrays;
use crate::num::elem::f64 as elem;
use crate::optim::adam::{Adam, Counters, Decay, Rule};
use crate::optim::initial::Initial;
use crate::scene::field::{self, Field, Heads, Network, Panoramas, Placement, Planes, Stencil};
use crate::{Error, Result};
use std::collections::BTreeMap;

/// Purpose of the first values; the item is the entry, the step the array.
const PURPOSE: u16 = 0x0533;
/// Half size of the box of a field whose object is in the ball of radius ½: 1.05 times the radius.
pub const HALF_SIZE: f32 = 0.525;
/// Largest first value of planes and panoramas.
const SPREAD: f32 = 0.1;
/// Xavier gain of the network of the signed distance (LIRM), and of the others, which begin with more contrast.
const GAINS: [f32; 2] = [0.25, std::f32::consts::SQRT_2];
/// Factor of the signed distance's row of a trunk, so that the first surface is close to the sphere.
const TRUNK_ROW: f32 = 0.05;
/// Units of hidden layers: of separate heads, of a trunk.
const HIDDEN: [usize; 2] = [32, 64];
/// Levels, rows and columns of panoramas.
const PANORAMAS: [usize; 3] = [4, 64, 32];
/// Rows and columns of the light.
pub(super) const LIGHT: [usize; 2] = [16, 32];
/// Adam for fields: published betas of LIRM, one counter per array, no decay (smoothness is a loss here).
const RULE: Rule = Rule {
    beta1: 0.9,
    beta2: 0.95,
    eps: 1e-8,
    weight_decay: 0.0,
    decay: Decay::Decoupled,
    counters: Counters::Global,
};

/// The state between iterations.
#[derive(Clone, Debug)]
pub(super) struct State {
    /// Planes, panoramas, heads; its settings are those of the current iteration.
    pub(super) field: Field,
    /// Shape (16, 32, 3) before `nn.softplus`; empty where no light is learned.
    pub(super) light: Vec<f32>,
    /// ln 1/β; empty where it is scheduled.
    pub(super) sharpness: Vec<f32>,
    moments: BTreeMap<String, Adam>,
}

/// Gradients with respect to the state.
#[derive(Clone, Debug, Default)]
pub(super) struct Gradients {
    pub(super) field: InBar,
    pub(super) light: Vec<f32>,
}

/// First values of the layers of a network.
fn network(seed: u64, first: u32, widths: &[usize], gain: f32) -> Network {
    let layer = |(l, w): (usize, &[usize])| {
        let drawn = Initial::numbered(seed, PURPOSE, first + l as u32).xavier_uniform(&[w[1], w[0]], gain);
        drawn.into_raw_vec_and_offset().0
    };
    Network { widths: widths.to_vec(), weights: widths.windows(2).enumerate().map(layer).collect() }
}

fn heads(s: &Settings, features: usize) -> Heads {
    let [h, wide] = HIDDEN;
    let of = |k: u32, widths: &[usize], gain| network(s.seed, 16 * k, widths, gain);
    let value = |k: u32, inputs: usize, outputs: usize| of(k, &[inputs, h, h, h, outputs], GAINS[1]);
    let two = |k: u32, outputs: usize| of(k, &[features, h, h, outputs], GAINS[1]);
    let materials = s.materials != Materials::Off;
    let is_trunk = s.heads == HeadForm::Trunk;
    let sdf = if is_trunk {
        let mut trunk = of(1, &[features, wide, wide, 4], GAINS[1]);
        let row = &mut trunk.weights[2][..wide];
        row.iter_mut().for_each(|w| *w *= TRUNK_ROW);
        trunk
    } else {
        of(1, &[features, h, h, 1], GAINS[0])
    };
    let inputs = features + if s.embedding { s.channels + usize::from(s.cosine) } else { 0 };
    Heads {
        sdf,
        color: (!is_trunk).then(|| value(2, inputs, 3)),
        albedo: materials.then(|| two(3, 3)),
        material: materials.then(|| two(4, 2)),
        normal: s.has_normal_head().then(|| value(5, features, 3)),
        rho: s.embedding.then(|| two(6, 1)),
    }
}

impl State {
    /// Returns the first values.
    ///
    /// # Errors
    /// When a setting of the optimiser is out of its range.
    pub(super) fn new(s: &Settings, placement: Placement) -> Result<Self> {
        let side = s.stage(0).side;
        let drawn = |k: u32, shape: &[usize]| {
            Initial::numbered(s.seed, PURPOSE, k).uniform(shape, SPREAD).into_raw_vec_and_offset().0
        };
        let planes = Planes {
            values: drawn(0, &[s.planes, side, side, s.channels]),
            count: s.planes,
            side,
            channels: s.channels,
        };
        let [levels, height, width] = PANORAMAS;
        let panoramas = s.embedding.then(|| Panoramas {
            values: drawn(1, &[levels, height, width, s.channels]),
            levels,
            height,
            width,
            channels: s.channels,
        });
        let features = planes.features(s.combine);
        let settings = field::Settings {
            half_size: HALF_SIZE,
            combine: s.combine,
            rule: s.rule,
            stencil: Stencil::Central,
            ..field::Settings::default()
        };
        let field = Field { planes, panoramas, heads: heads(s, features), settings, placement };
        let is_learned = s.materials == Materials::Shaded;
        let first = elem::ln(f64::from(s.inverse_beta[0])) as f32;
        let mut state = Self {
            field,
            // softplus(0.54) = 1
            light: if is_learned { vec![0.541_324_85; 3 * LIGHT[0] * LIGHT[1]] } else { Vec::new() },
            sharpness: if s.beta == Beta::Learned { vec![first] } else { Vec::new() },
            moments: BTreeMap::new(),
        };
        state.reset()?;
        state.at(s, 0);
        Ok(state)
    }

    /// Removes the light from what is learned: a known one is used.
    pub(super) fn with_known_light(mut self) -> Result<Self> {
        self.light.clear();
        self.reset()?;
        Ok(self)
    }

    /// Sets what an iteration renders with.
    pub(super) fn at(&mut self, s: &Settings, iteration: usize) {
        let samples = s.stage(iteration).samples;
        let scheduled = s.inverse_beta_at(iteration);
        let learned = self.sharpness.first().map(|x| elem::exp(f64::from(*x)) as f32);
        self.render_with(samples, learned.unwrap_or(scheduled));
    }

    /// Sets the settings that change during a fit.
    fn render_with(&mut self, samples: usize, inverse_beta: f32) {
        let side = self.field.planes.side;
        let settings = &mut self.field.settings;
        settings.samples = samples;
        settings.inverse_beta = inverse_beta;
        // One texel: with less, differences see the creases of the interpolation.
        settings.epsilon = 2.0 * settings.half_size / (side - 1) as f32;
    }

    /// Names, shapes and values of all arrays.
    fn arrays(&mut self) -> Vec<(String, Vec<usize>, &mut Vec<f32>)> {
        let Self { field, light, sharpness, .. } = self;
        let Field { planes, panoramas, heads, .. } = field;
        let mut all = vec![("planes".to_owned(), planes.shape().to_vec(), &mut planes.values)];
        if let Some(p) = panoramas {
            all.push(("panoramas".to_owned(), p.shape().to_vec(), &mut p.values));
        }
        for (name, network) in Heads::NAMES.into_iter().zip(heads.all_mut()) {
            let Some(Network { widths, weights }) = network else { continue };
            for (l, (w, n)) in weights.iter_mut().zip(widths.windows(2)).enumerate() {
                all.push((format!("heads/{name}/{l}"), vec![n[1], n[0]], w));
            }
        }
        if !light.is_empty() {
            all.push(("light".to_owned(), [LIGHT.as_slice(), &[3]].concat(), light));
        }
        if !sharpness.is_empty() {
            all.push(("sharpness".to_owned(), vec![1], sharpness));
        }
        all
    }

    /// Starts the moments again.
    fn reset(&mut self) -> Result<()> {
        let sizes: Vec<(String, usize)> = self.arrays().into_iter().map(|(n, _, x)| (n, x.len())).collect();
        self.moments =
            sizes.into_iter().map(|(name, n)| Ok((name, Adam::new(RULE, n, 1)?))).collect::<Result<_>>()?;
        Ok(())
    }

    /// Gives the planes another side, and starts the moments again.
    pub(super) fn grow(&mut self, side: usize) -> Result<()> {
        self.field.planes = resized(&self.field.planes, side);
        self.reset()
    }

    /// One step of Adam with the rates of planes and panoramas, and of networks.
    ///
    /// # Errors
    /// When a result is not finite.
    pub(super) fn step(&mut self, mut g: Gradients, [planes, networks]: [f64; 2]) -> Result<()> {
        let inverse_beta = self.field.settings.inverse_beta;
        // ∂L/∂ln(1/β) = −β·∂L/∂β
        let sharpness = vec![-g.field.beta / inverse_beta];
        let mut moments = std::mem::take(&mut self.moments);
        let mut heads = g.field.heads.arrays_mut();
        for (name, _, values) in self.arrays() {
            let (grad, rate) = match name.as_str() {
                "planes" => (&g.field.planes, planes),
                "panoramas" => (&g.field.panoramas, planes),
                "light" => (&g.light, planes),
                "sharpness" => (&sharpness, networks),
                _ => (&*heads.next().expect("a gradient per layer"), networks),
            };
            let adam = moments.get_mut(&name).expect("moments of every array");
            adam.step(values, grad, &[rate], None).map_err(|e| e.within(format!("optimiser of {name}")))?;
        }
        self.moments = moments;
        Ok(())
    }

    /// Writes the state.
    pub(super) fn save(&self, out: &mut Arrays) {
        let mut copy = self.clone();
        for (name, shape, values) in copy.arrays() {
            out.put(&format!("param/{name}"), &shape, std::mem::take(values));
        }
        for (name, adam) in &self.moments {
            adam.save(&format!("adam/{name}"), out);
        }
        let settings = &self.field.settings;
        out.put("render/samples", &[1], vec![settings.samples as i32]);
        out.put("render/inverse_beta", &[1], vec![settings.inverse_beta]);
        out.put("placement/center", &[3], self.field.placement.center.to_vec());
        out.put("placement/scale", &[1], vec![self.field.placement.scale]);
    }

    /// Replaces the state by a saved one of the same settings `s`.
    ///
    /// # Errors
    /// A missing array, another shape, a number that is not finite.
    pub(super) fn load(&mut self, s: &Settings, from: &Arrays) -> Result<()> {
        let stored = from.need("param/planes")?.shape().to_vec();
        let side = stored.get(1).copied().unwrap_or(0);
        let stages = s.stages();
        if !stages.iter().any(|stage| stage.side == side) {
            let sides = stages.map(|stage| stage.side.to_string()).join(", ");
            return Err(Error::input("array 'param/planes'")
                .expected(format!("planes with a side of one of the stages: {sides}"))
                .got(format!("{stored:?}")));
        }
        let inverse_beta = from.scalar("render/inverse_beta")? as f32;
        if !(inverse_beta > 0.0 && inverse_beta.is_finite()) {
            return Err(Error::input("array 'render/inverse_beta'")
                .expected("a positive number")
                .got(inverse_beta.to_string()));
        }
        let samples = from.scalar("render/samples")?;
        let Some(samples) = stages.map(|stage| stage.samples).into_iter().find(|n| *n as f64 == samples)
        else {
            return Err(Error::input("array 'render/samples'")
                .expected("the samples of one of the stages")
                .got(samples.to_string()));
        };
        let mut loaded = self.clone();
        loaded.grow(side)?;
        for (name, shape, values) in loaded.arrays() {
            let (name, sizes) =
                (format!("param/{name}"), shape.iter().map(usize::to_string).collect::<Vec<_>>());
            *values = from.shape(&name, &sizes.join(","), &mut BTreeMap::new())?.to_f32();
            from.finite([name.as_str()])?;
        }
        for (name, adam) in &mut loaded.moments {
            *adam = Adam::load_sized(RULE, &format!("adam/{name}"), from, [adam.rows(), adam.width()])?;
        }
        loaded.render_with(samples, inverse_beta);
        *self = loaded;
        Ok(())
    }
}

/// Planes with another side: bilinear at the same places (corners to corners), in f64, rounded once.
fn resized(planes: &Planes, side: usize) -> Planes {
    let (old, channels) = (planes.side, planes.channels);
    let place = |i: usize| {
        let x = i as f64 * (old - 1) as f64 / (side - 1) as f64;
        let at = Ord::min(x as usize, old - 2);
        (at, x - at as f64)
    };
    let mut values = Vec::with_capacity(planes.count * side * side * channels);
    for plane in planes.values.chunks_exact(old * old * channels) {
        for (row, v) in (0..side).map(place) {
            for (column, u) in (0..side).map(place) {
                for c in 0..channels {
                    let at =
                        |r: usize, k: usize| f64::from(plane[((row + r) * old + column + k) * channels + c]);
                    let top = (1.0 - u) * at(0, 0) + u * at(0, 1);
                    let bottom = (1.0 - u) * at(1, 0) + u * at(1, 1);
                    values.push(((1.0 - v) * top + v * bottom) as f32);
                }
            }
        }
    }
    Planes { values, side, ..planes.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_that_grow_keep_their_values_at_the_same_places() {
        let ramp = |i: usize| (0..9).map(move |k| (k * (i + 1)) as f32);
        let planes = Planes { values: (0..3).flat_map(ramp).collect(), count: 3, side: 3, channels: 1 };
        let grown = resized(&planes, 5);
        assert_eq!(grown.values.len(), 75, "three planes of 5×5");
        assert_eq!((grown.values[0], grown.values[4], grown.values[24]), (0.0, 2.0, 8.0), "corners");
        assert_eq!((grown.values[1], grown.values[5]), (0.5, 1.5), "between");
        assert_eq!(resized(&grown, 3), planes, "and back");
    }
}
