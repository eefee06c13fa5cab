//! Objects of a training from the folder of a set that `lirm gen` has written.
//!
//! Object k of the training is object k mod N of the set, in the order of their numbers. A set with the seed and settings of the training's
//! own objects ([`super::source::Rendered`]) gives the same training: its images have the same pixels.

use super::distances::Distances;
use super::source::Source;
use super::stage::{SIDE, VIEWS};
use crate::fit::field::targets::Pictures;
use crate::io::read_bytes;
use crate::lirm::folder::{FORMAT, RECORD};
use crate::lirm::truth;
use crate::lirm::views::Views;
use crate::scene::field::Placement;
use crate::scene::model;
use crate::scene::views::{Masks, Options};
use crate::{Error, Result};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Largest accepted size of the record of a set.
const MOST_BYTES: u64 = 1 << 26;

/// The objects of a set.
#[derive(Clone, Debug)]
pub struct Stored {
    objects: Vec<PathBuf>,
    digest: String,
}

impl Stored {
    /// Opens a set.
    ///
    /// # Errors
    /// If the folder is not that of a complete set, or its images are not those that a training reads.
    pub fn open(dir: &Path) -> Result<Self> {
        let named = |expected: &str, got: &str| {
            Error::input(dir.display().to_string()).expected(expected.to_owned()).got(got.to_owned())
        };
        let record: Value = serde_json::from_slice(&read_bytes(&dir.join(RECORD), MOST_BYTES)?)
            .map_err(|e| named("the folder of a set of lirm gen", &e.to_string()))?;
        if record["format"] != FORMAT || record["complete"] != true {
            return Err(named("the folder of a complete set of lirm gen", "another, or an interrupted one"));
        }
        let settings = &record["settings"];
        if settings["size"] != SIDE || settings["views"] != VIEWS {
            return Err(named(
                &format!("{VIEWS} images of {SIDE}x{SIDE} pixels of every object"),
                &format!("{} of {}", settings["views"], settings["size"]),
            ));
        }
        let listed = record["objects"].as_array().into_iter().flatten();
        let objects: Vec<PathBuf> = listed.filter_map(|o| Some(dir.join(o["folder"].as_str()?))).collect();
        if objects.is_empty() {
            return Err(named("at least one object", "none"));
        }
        Ok(Self { objects, digest: record["digest"].as_str().unwrap_or_default().to_owned() })
    }

    fn folder(&self, k: u64) -> &Path {
        &self.objects[(k % self.objects.len() as u64) as usize]
    }
}

impl Source for Stored {
    fn object(&self, k: u64, version: &str) -> Result<Views> {
        let options = Options { background: [1.0; 3], masks: Masks::Ignore, ..Options::default() };
        let pictures = Pictures::load(&self.folder(k).join(version), &options, None)?;
        let which: Vec<usize> = (0..pictures.pictures.len()).collect();
        // Objects of a set are in the ball of radius ½, the origin at its centre.
        Views::of_capture(&pictures, &which, Placement::new([0.0; 3], 1.0))
    }

    fn distances(&self, k: u64) -> Result<Distances> {
        let object = model::read(&self.folder(k).join(truth::OBJECT))?;
        Distances::of(&object.mesh, 0, k % self.objects.len() as u64)
    }

    fn record(&self) -> String {
        format!("{} objects of a set with the digest {}", self.objects.len(), self.digest)
    }
}
