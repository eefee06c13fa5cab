//! Objects by index.
//!
//! An object is in as many batches as [`super::Settings::uses`] has, twelve by default. Objects come in
//! blocks: a block is drawn in that many random orders, one after the other, and is then forgotten. A resumed
//! training renders the objects of its block again.

use super::distances::Distances;
use super::draws::Draws;
use super::stage::{SIDE, VIEWS};
use crate::lirm::r#gen::{Lighting, Settings, Version};
use crate::lirm::subject::Subject;
use crate::lirm::views::Views;
use crate::num::par;
use crate::{Error, Result};
use std::collections::BTreeMap;
use std::fmt::Debug;

/// Samples per pixel.
const SAMPLES: u32 = 8;

/// Number of the first object that is added to others; that of object k is k more.
const FIRST_ADDED: u64 = 1 << 20;

/// Images, and points with signed distances (empty where they are not compared).
pub type Scene = (Views, Distances);

/// Where the objects of a training come from.
pub trait Source: Sync + Debug {
    /// The images of object `k` in one of its versions.
    ///
    /// # Errors
    /// If the object cannot be made or read.
    fn object(&self, k: u64, version: Version) -> Result<Views>;

    /// Points around object `k` with signed distances.
    ///
    /// # Errors
    /// If the shape of the object is not known.
    fn distances(&self, k: u64) -> Result<Distances>;

    /// What decides the objects, for checkpoints.
    fn record(&self) -> String;

    /// The seed of the objects, if they are built-in ones.
    fn seed(&self) -> Option<u64>;

    /// A scene that changes: object `k` at half its size on one side, without and with another object on the
    /// other side. Points with distances are there if `is_compared`.
    ///
    /// # Errors
    /// If the source has no such scenes, or the objects cannot be made.
    fn added(&self, k: u64, version: Version, is_compared: bool) -> Result<[Scene; 2]> {
        let _ = (version, is_compared);
        Err(Error::input("--added")
            .at(format!("object {k}"))
            .expected("0 where objects are not rendered in memory")
            .got(self.record()))
    }
}

/// Built-in objects, rendered in memory with the pixels of `lirm gen`.
#[derive(Clone, Debug)]
pub struct BuiltInObjects {
    settings: Settings,
}

impl BuiltInObjects {
    /// The objects of a seed.
    pub fn new(seed: u64) -> Self {
        let settings = Settings {
            lighting: Lighting::Both,
            shiny: true,
            views: VIEWS,
            size: SIDE,
            samples: SAMPLES,
            seed,
            ..Settings::default()
        };
        Self { settings }
    }

    /// The settings of the set with the same pixels.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }
}

impl Source for BuiltInObjects {
    fn object(&self, k: u64, version: Version) -> Result<Views> {
        Views::rendered(&self.settings, k, version)
    }

    fn distances(&self, k: u64) -> Result<Distances> {
        Distances::of(&Subject::new(&self.settings, k)?.object.mesh, self.settings.seed, k)
    }

    fn record(&self) -> String {
        format!(
            "built-in objects of seed {}, {VIEWS} images of {SIDE}, {SAMPLES} samples",
            self.settings.seed
        )
    }

    fn seed(&self) -> Option<u64> {
        Some(self.settings.seed)
    }

    fn added(&self, k: u64, version: Version, is_compared: bool) -> Result<[Scene; 2]> {
        let s = &self.settings;
        let before = Subject::new(s, k)?.on_side(-1.0);
        let after = before.clone().with(&Subject::new(s, FIRST_ADDED + k)?.on_side(1.0))?;
        let scene = |subject: &Subject| {
            let distances = if is_compared {
                Distances::of(&subject.object.mesh, s.seed, k)?
            } else {
                Distances::default()
            };
            Ok((Views::of_subject(s, k, version, subject)?, distances))
        };
        Ok([scene(&before)?, scene(&after)?])
    }
}

/// The objects of the current block.
#[derive(Debug)]
pub(super) struct Pool<'a> {
    source: &'a dyn Source,
    /// One scene per object, or those without and with another object.
    objects: BTreeMap<u64, Vec<Scene>>,
}

impl<'a> Pool<'a> {
    pub(super) fn new(source: &'a dyn Source) -> Self {
        Self { source, objects: BTreeMap::new() }
    }

    pub(super) fn record(&self) -> String {
        self.source.record()
    }

    pub(super) fn seed(&self) -> Option<u64> {
        self.source.seed()
    }

    /// Makes the objects of the blocks of a step that are not there, and forgets the others.
    pub(super) fn fill(&mut self, draws: &Draws<'_>, step: usize) -> Result<()> {
        let needed = draws.objects(step);
        self.objects.retain(|k, _| needed.contains(k));
        let missing: Vec<u64> = needed.into_iter().filter(|k| !self.objects.contains_key(k)).collect();
        let made = par::map(missing.len(), |i| {
            let k = missing[i];
            let (version, is_compared) = (draws.version(k), draws.stage.distances > 0.0);
            let mut scenes = if draws.is_added(k) {
                Vec::from(self.source.added(k, version, is_compared)?)
            } else {
                let distances = if is_compared { self.source.distances(k)? } else { Distances::default() };
                vec![(self.source.object(k, version)?, distances)]
            };
            // Nothing compares with it.
            let views = scenes.iter_mut().flat_map(|(views, _)| &mut views.all);
            views.for_each(|view| view.picture.passes.radiance = None);
            Ok(scenes)
        });
        for (k, object) in missing.into_iter().zip(made) {
            self.objects.insert(k, object.map_err(|e: Error| e.within(format!("object {k}")))?);
        }
        Ok(())
    }

    /// The scenes of an object that [`Self::fill`] has made: one for all sets, or that of the first set and
    /// that of those after it.
    ///
    /// # Panics
    /// Panics if it has not.
    pub(super) fn get(&self, k: u64) -> &[Scene] {
        &self.objects[&k]
    }
}
