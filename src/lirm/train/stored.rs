//! Objects of a training from the folder of a set that `lirm gen` has written.
//!
//! Object k of the training is object k mod N of the set, in the order of their numbers. A set with the seed
//! and settings of the training's own objects ([`super::source::BuiltInObjects`]) has the same pixels and the same
//! points with distances. Its cameras are written as inverse matrices, and differ in their last places
//! (2·10⁻⁶ at most, `tests/systems/lirm_views.rs`), so the weights of a training from a set are not those of
//! one in memory.

use super::distances::Distances;
use super::source::Source;
use super::stage::{SIDE, Stage, VIEWS};
use crate::fit::field::targets::Pictures;
use crate::io::paths::clean;
use crate::io::read_bytes;
use crate::lirm::folder::{FORMAT, RECORD};
use crate::lirm::r#gen::{Lighting, Version};
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

/// A text of a record without quotes.
fn plain(x: &Value) -> &str {
    x.as_str().unwrap_or_default()
}

/// The objects of a set.
#[derive(Clone, Debug)]
pub struct StoredSet {
    objects: Vec<PathBuf>,
    digest: String,
    seed: u64,
    is_built_in: bool,
}

impl StoredSet {
    /// Opens a set for a stage.
    ///
    /// # Errors
    /// If the folder is not that of a complete set, its images are not those that a training reads, or a
    /// light, a pass or the shapes that the stage compares are missing.
    pub fn open(dir: &Path, stage: &Stage) -> Result<Self> {
        let named = |expected: &str, got: &str| {
            Error::input(dir.display().to_string()).expected(expected.to_owned()).got(got.to_owned())
        };
        let record: Value = serde_json::from_slice(&read_bytes(&dir.join(RECORD), MOST_BYTES)?)
            .map_err(|e| named("the folder of a set of lirm gen", &e.to_string()))?;
        if record["format"] != FORMAT || record["complete"] != true {
            return Err(named("the folder of a complete set of lirm gen", "another, or an interrupted one"));
        }
        let settings = &record["settings"];
        if settings["size"] != SIDE || settings["views"] != VIEWS || settings["set"] != "train" {
            return Err(named(
                &format!("{VIEWS} images of {SIDE}x{SIDE} pixels of every object, by --cameras train"),
                &format!(
                    "{} of {}, by --cameras {}",
                    settings["views"],
                    settings["size"],
                    plain(&settings["set"])
                ),
            ));
        }
        let lighting = plain(&settings["lighting"]);
        let [uniform, environment] = [Lighting::Uniform, Lighting::Environment].map(Lighting::name);
        let has = [lighting != environment, lighting != uniform, settings["shiny"] == true];
        if let Some(i) = (0..3).find(|i| stage.light[*i] > 0.0 && !has[*i]) {
            let e = named(
                &format!(
                    "objects of the version {}, which stage {} draws",
                    Version::ALL[i].name(),
                    stage.name
                ),
                "none",
            );
            return Err(e.hint("lirm gen --lighting both --shiny makes all versions"));
        }
        let has = |name: &str| match &settings["passes"] {
            Value::Bool(all) => *all,
            some => some.as_array().is_some_and(|names| names.iter().any(|n| n == name)),
        };
        let needed = [
            ("normal", true),
            ("albedo", stage.is_whole),
            ("material", stage.is_whole),
            ("depth", stage.points > 0.0),
        ];
        if let Some((name, _)) = needed.iter().find(|(name, is_needed)| *is_needed && !has(name)) {
            return Err(named(&format!("the pass {name}, which stage {} compares", stage.name), "none"));
        }
        if stage.added > 0.0 {
            let e =
                Error::input("--added").expected("0 for the objects of a set").got(stage.added.to_string());
            return Err(e.hint("the objects that are rendered in memory can be added to each other"));
        }
        if stage.distances > 0.0 && settings["truth"] != true {
            return Err(named("the shape of every object, for --distances", "a set without truth"));
        }
        let listed = record["objects"].as_array().into_iter().flatten();
        let folder = |o: &Value| {
            let inner = clean(plain(&o["folder"]));
            inner.map(|inner| dir.join(inner)).map_err(|got| named("folders inside of that of the set", got))
        };
        let objects = listed.map(folder).collect::<Result<Vec<PathBuf>>>()?;
        if objects.is_empty() {
            return Err(named("at least one object", "none"));
        }
        Ok(Self {
            objects,
            digest: plain(&record["digest"]).to_owned(),
            seed: settings["seed"].as_u64().unwrap_or_default(),
            is_built_in: settings["meshes"].as_array().is_none_or(Vec::is_empty),
        })
    }

    fn folder(&self, k: u64) -> &Path {
        &self.objects[(k % self.objects.len() as u64) as usize]
    }
}

impl Source for StoredSet {
    fn object(&self, k: u64, version: Version) -> Result<Views> {
        let options =
            Options { background: [1.0; 3], masks: Masks::Ignore, strict: true, ..Options::default() };
        let folder = self.folder(k).join(version.name());
        let pictures = Pictures::load(&folder, &options, None)?;
        let all = &pictures.pictures;
        if all.len() != VIEWS || all.iter().any(|p| [p.camera.width, p.camera.height] != [SIDE; 2]) {
            let sizes: Vec<String> =
                all.iter().map(|p| format!("{}x{}", p.camera.width, p.camera.height)).collect();
            return Err(Error::input(folder.display().to_string())
                .expected(format!("{VIEWS} images of {SIDE}x{SIDE} pixels"))
                .got(format!("{}: {}", all.len(), sizes.join(", "))));
        }
        let which: Vec<usize> = (0..pictures.pictures.len()).collect();
        // Objects of a set are in the ball of radius ½, the origin at its centre.
        Views::of_capture(&pictures, &which, Placement::new([0.0; 3], 1.0))
    }

    fn distances(&self, k: u64) -> Result<Distances> {
        let object = model::read(&self.folder(k).join(truth::OBJECT))?;
        Distances::of(&object.mesh, self.seed, k % self.objects.len() as u64)
    }

    fn record(&self) -> String {
        format!("{} objects of a set with the digest {}", self.objects.len(), self.digest)
    }

    fn seed(&self) -> Option<u64> {
        self.is_built_in.then_some(self.seed)
    }
}
