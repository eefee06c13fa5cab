//! The training as a fit: single steps, and the state in a checkpoint.

use super::Training;
use crate::fit::training::{Fit, Step, Watch};
use crate::num::array::Arrays;
use crate::optim::optimiser::ArrayNames;
use crate::{Error, Result};
use serde_json::Value;
use std::collections::BTreeMap;

impl Fit for Training<'_> {
    fn kind(&self) -> &'static str {
        "last pretrain"
    }

    fn settings(&self) -> Value {
        self.settings.json()
    }

    fn iterations(&self) -> usize {
        (self.settings.steps + self.settings.refit) as usize
    }

    fn step(&mut self, i: usize, watch: &mut dyn Watch) -> Result<Step> {
        assert_eq!(i, self.step as usize, "steps come in order");
        let losses = self.advance()?;
        watch.lap("step");
        let w = &self.settings.weights;
        let loss = w.reconstruction * losses.reconstruction + w.groups * w.intervention * losses.intervention;
        if !loss.is_finite() {
            return Err(Error::check("image-to-point model")
                .at(format!("step {i}"))
                .expected("a finite loss")
                .got(loss.to_string()));
        }
        self.losses = losses;
        Ok(Step { loss: loss as f32, size: libm::round(losses.edges) as usize })
    }

    fn save(&self, out: &mut Arrays) {
        ArrayNames::Folders.save(&self.model.params, out);
        self.optimiser.save(ArrayNames::Folders, out);
        let last = self.last_h.unwrap_or(-1.0);
        out.put("state/lagrange", &[4], vec![self.lambda, self.rho, last, f64::from(self.rounds)]);
        out.put("state/step", &[1], vec![i64::from(self.step)]);
        if let Some(spread) = &self.spread {
            out.put("state/spread", &[spread.len()], spread.clone());
        }
        if let Some(units) = &self.units {
            out.put("state/units", &[units.len()], units.clone());
        }
        if let Some(length) = self.length {
            out.put("state/gradient", &[1], vec![length]);
        }
        let d = self.model.sizes.latent();
        out.put("state/covariances", &[self.history.past.len(), d, d], self.history.past.concat());
        if let Some(graph) = &self.graph {
            let n = self.settings.factors;
            out.put("state/graph", &[n, n], graph.clone());
        }
    }

    fn load(&mut self, from: &Arrays) -> Result<()> {
        let n = self.settings.factors.to_string();
        let mut dims = BTreeMap::new();
        let mut params = self.model.params.clone();
        ArrayNames::Folders.load(&mut params, from)?;
        self.optimiser.load(ArrayNames::Folders, from)?;
        let lagrange = from.shape("state/lagrange", "4", &mut dims)?.to_f64();
        let step = from.shape("state/step", "1", &mut dims)?.to_i64();
        let d = self.model.sizes.latent();
        let covariances = from.shape("state/covariances", &format!("M,{d},{d}"), &mut dims)?.to_f64();
        self.history.past = covariances.chunks_exact(d * d).map(<[f64]>::to_vec).collect();
        let spread = from.get("state/spread").is_some();
        let graph = from.get("state/graph").is_some();
        self.length = None;
        if from.get("state/gradient").is_some() {
            self.length = from.shape("state/gradient", "1", &mut dims)?.to_f64().first().copied();
        }
        self.units = None;
        if from.get("state/units").is_some() {
            self.units = Some(from.shape("state/units", &n, &mut dims)?.to_f64());
        }
        if spread {
            self.spread = Some(from.shape("state/spread", &n, &mut dims)?.to_f64());
        }
        if graph {
            self.graph = Some(from.shape("state/graph", &format!("{n},{n}"), &mut dims)?.to_f64());
        }
        self.step = step
            .and_then(|s| u32::try_from(*s.first()?).ok())
            .ok_or_else(|| Error::input("array 'state/step'").expected("a count"))?;
        (self.lambda, self.rho) = (lagrange[0], lagrange[1]);
        self.last_h = (lagrange[2] >= 0.0).then_some(lagrange[2]);
        self.rounds = lagrange[3] as u32;
        self.model.params = params;
        Ok(())
    }
}
