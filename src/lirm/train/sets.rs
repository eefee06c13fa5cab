//! The sets of images of some objects of a step: losses and gradients.
//!
//! ```text
//! forward of set m  state m−1 ─► transformer ─► state m ─► decode ─► render ─► losses
//! adjoint of set m  state m−1 ◄─ transformer ◄─── (+) ◄─── decode ◄─ render ◄─── 1
//!                                                  ▲
//!                              set m+1, if gradients flow through the state
//! ```
//!
//! Objects are taken together, set by set. With a detached state ([`Stage::state_gradient`] is false) the
//! adjoint of a set follows its forward pass, and a step needs the memory of one set. Otherwise all forward
//! passes come first, then the adjoints from the last set to the first: the gradient of an object is then
//! that of its loss as a function of the weights, and a state is trained for the sets that follow it too.
//!
//! The loss of an object is the mean over its sets, or with [`Stage::last_set_only`] that of its last set;
//! earlier ones are then not rendered.

use super::Training;
use super::object::Object;
use super::stage::Stage;
use super::truth::ObjectLoss;
use crate::Result;
use crate::field::render::InBar;
use crate::fit::training::Watch;
use crate::lirm::model::decode::Rendering;
use crate::lirm::model::transformer::{Keep, Saved};
use crate::lirm::model::weights::{Gradients, Ready};
use crate::num::par;
use crate::scene::field::Field;
use std::sync::{Mutex, PoisonError};

/// A set of an object after its forward pass.
#[derive(Debug)]
struct SetPass {
    /// Number of the object.
    object: usize,
    /// Number of the set.
    set: usize,
    /// The state that was read, and the one after it.
    states: [Vec<f32>; 2],
    /// None if nothing pulls on the set.
    saved: Option<Saved>,
    /// None if the set is not compared.
    compared: Option<(Field, ObjectLoss)>,
}

/// The sets of some objects of a step.
struct Sets<'a> {
    ready: &'a Ready<'a>,
    objects: &'a [Object],
    stage: &'a Stage,
    rendering: Rendering,
    /// Objects of the whole step.
    batch: usize,
    keep: Keep,
}

impl Sets<'_> {
    /// Reads set `set` of every object that has one, and compares the fields. The states become those after the
    /// set; the losses are added to those of the objects.
    fn forward(
        &self,
        set: usize,
        states: &mut [Vec<f32>],
        losses: &mut [f32],
        watch: &mut dyn Watch,
    ) -> Result<Vec<SetPass>> {
        let active: Vec<usize> =
            (0..self.objects.len()).filter(|k| set < self.objects[*k].sets.len()).collect();
        let is_compared = |k: usize| !self.stage.last_set_only || set + 1 == self.objects[k].sets.len();
        let read = par::map(active.len(), |i| {
            let k = active[i];
            let is_pulled = is_compared(k) || self.stage.state_gradient;
            self.ready.read(&states[k], &self.objects[k].sets[set], is_pulled.then_some(self.keep))
        });
        watch.lap("transformer");
        let compared = par::map(active.len(), |i| {
            let object = &self.objects[active[i]];
            if !is_compared(active[i]) {
                return Ok(None);
            }
            // The mean over the objects of the step and the compared sets of each.
            let sets = if self.stage.last_set_only { 1 } else { object.sets.len() };
            let weight = 1.0 / (self.batch * sets) as f32;
            let field = self.ready.decode(&read[i].0, self.rendering, object.placement);
            let loss = object.truth(set).losses(&field, weight, self.stage)?;
            Ok(Some((field, loss)))
        });
        let compared = compared.into_iter().collect::<Result<Vec<_>>>()?;
        watch.lap("render and losses");
        let mut all = Vec::with_capacity(active.len());
        for (((next, saved), compared), object) in read.into_iter().zip(compared).zip(active) {
            let before = std::mem::replace(&mut states[object], next.clone());
            losses[object] += compared.as_ref().map_or(0.0, |(_, loss)| loss.loss);
            all.push(SetPass { object, set, states: [before, next], saved, compared });
        }
        Ok(all)
    }

    /// The gradients of sets of different objects. `state_bars` has one entry per object: the cotangent of the
    /// state after this set, from the set that follows (empty: none). Afterwards it is that of the state before
    /// this set.
    fn pull(&self, read: Vec<SetPass>, state_bars: &mut [Vec<f32>], watch: &mut dyn Watch) -> Vec<Gradients> {
        let bars: Vec<Option<InBar>> = par::map(read.len(), |i| {
            let (field, loss) = read[i].compared.as_ref()?;
            Some(self.objects[read[i].object].truth(read[i].set).pull(field, loss))
        });
        watch.lap("adjoint of the render");
        let later: Vec<Vec<f32>> = read.iter().map(|x| std::mem::take(&mut state_bars[x.object])).collect();
        let n = read.len();
        let objects: Vec<usize> = read.iter().map(|x| x.object).collect();
        let own: Vec<_> = read.into_iter().zip(bars).zip(later).map(Mutex::new).collect();
        let made = par::map(n, |i| {
            let mut own = own[i].lock().unwrap_or_else(PoisonError::into_inner);
            let ((read, bar), later) = &mut *own;
            let [before, next] = &read.states;
            let mut g = self.ready.zeros();
            let mut next_bar = if later.is_empty() { vec![0.0; next.len()] } else { std::mem::take(later) };
            if let Some(bar) = bar {
                self.ready.pull_decoded(next, bar, &mut g, &mut next_bar);
            }
            // The state before the first set is a constant.
            let is_passed = self.stage.state_gradient && read.set > 0;
            let mut before_bar = if is_passed { vec![0.0; before.len()] } else { Vec::new() };
            let views = &self.objects[read.object].sets[read.set];
            let saved = read.saved.take().expect("it was kept");
            self.ready.pull_read(before, views, saved, &next_bar, &mut g, &mut before_bar);
            (g, before_bar)
        });
        watch.lap("adjoint of the transformer");
        let mut gradients = Vec::with_capacity(n);
        for (object, (g, before_bar)) in objects.into_iter().zip(made) {
            state_bars[object] = before_bar;
            gradients.push(g);
        }
        gradients
    }
}

impl Training<'_> {
    /// The losses of some objects of a step, and their gradients, both by object.
    pub(super) fn losses(
        &self,
        ready: &Ready<'_>,
        objects: &[Object],
        step: usize,
        watch: &mut dyn Watch,
    ) -> Result<(Vec<f32>, Vec<Gradients>)> {
        let s = &self.settings;
        let keep = if s.recompute { Keep::Inputs } else { Keep::All };
        let rendering = s.stage.rendering(step);
        let sets = Sets { ready, objects, stage: &s.stage, rendering, batch: s.batch, keep };
        let mut states: Vec<Vec<f32>> = objects.iter().map(|_| ready.no_state()).collect();
        let mut losses = vec![0.0; objects.len()];
        let mut sums: Vec<Option<Gradients>> = objects.iter().map(|_| None).collect();
        let mut state_bars: Vec<Vec<f32>> = objects.iter().map(|_| Vec::new()).collect();
        let mut pull = |read: Vec<SetPass>, watch: &mut dyn Watch| {
            let read: Vec<SetPass> = read.into_iter().filter(|x| x.saved.is_some()).collect();
            let of: Vec<usize> = read.iter().map(|x| x.object).collect();
            for (object, g) in of.into_iter().zip(sets.pull(read, &mut state_bars, watch)) {
                match &mut sums[object] {
                    Some(sum) => sum.add(&g),
                    none => *none = Some(g),
                }
            }
        };
        let mut waiting = Vec::new();
        for set in 0..objects.iter().map(|o| o.sets.len()).fold(0, Ord::max) {
            let read = sets.forward(set, &mut states, &mut losses, watch)?;
            if s.stage.state_gradient {
                waiting.push(read);
            } else {
                pull(read, watch);
            }
        }
        waiting.into_iter().rev().for_each(|read| pull(read, watch));
        Ok((losses, sums.into_iter().flatten().collect()))
    }
}
