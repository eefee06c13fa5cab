//! Settings of a data set of rendered objects.

use crate::fit::passes::PassSet;
use crate::io;
use crate::scene::camera::Model;
use crate::scene::environment_file::Options as MapOptions;
use crate::{Error, Result};
use data_gen::cameras::Framing;
use serde_json::{Map, Value, json};
use std::path::PathBuf;

/// A version of an object: its light, and whether its materials are smoother.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Version {
    /// Under a white dome of radiance 1.
    Uniform,
    /// Under the map of the object.
    Environment,
    /// Under the map, with smaller roughness.
    Shiny,
}

impl Version {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Uniform, Self::Environment, Self::Shiny];

    /// Returns the name, which is that of the folder.
    pub fn name(self) -> &'static str {
        match self {
            Self::Uniform => "uniform",
            Self::Environment => "environment",
            Self::Shiny => "shiny",
        }
    }

    /// Returns the version of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|version| version.name() == name)
    }

    /// Whether the light is a map.
    pub fn is_under_map(self) -> bool {
        self != Self::Uniform
    }

    /// Whether materials are smoother.
    pub fn is_shiny(self) -> bool {
        self == Self::Shiny
    }
}

/// The lighting of a set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lighting {
    /// A white dome of radiance 1.
    Uniform,
    /// An environment map with a high dynamic range.
    Environment,
    /// Both, with the same cameras.
    Both,
}

impl Lighting {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Uniform, Self::Environment, Self::Both];

    /// Returns the name in settings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Uniform => "uniform",
            Self::Environment => "environment",
            Self::Both => "both",
        }
    }

    /// Returns the lighting of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|lighting| lighting.name() == name)
    }
}

/// The cameras of a set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Set {
    /// Training cameras, drawn at random.
    Train,
    /// The 48 test views of an object: inputs are the training split, outputs the test split, the others
    /// validation.
    Test,
    /// A head-mounted camera, with motion blur and sensor noise; every eighth image is in the test split.
    Egocentric,
}

impl Set {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Train, Self::Test, Self::Egocentric];

    /// Returns the name in settings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Test => "test",
            Self::Egocentric => "egocentric",
        }
    }

    /// Returns the cameras of that name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|set| set.name() == name)
    }
}

/// Settings of a set.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Number of objects; files given in `meshes` are counted from 0.
    pub objects: u64,
    /// Index of the first object.
    pub first: u64,
    /// Models to use instead of built-in objects.
    pub meshes: Vec<PathBuf>,
    /// Maps to use instead of built-in environments.
    pub maps: Vec<PathBuf>,
    /// Interpretation of those maps; `rotate` is added to a random rotation.
    pub map_options: MapOptions,
    /// Whether to use the test map that colours the axes ([`crate::shade::axes`]) instead of any other,
    /// interpreted by `map_options`, with neither random rotation nor scaling.
    pub axes: bool,
    /// The lighting.
    pub lighting: Lighting,
    /// Whether to add a version under the map with smaller roughness.
    pub shiny: bool,
    /// The cameras.
    pub set: Set,
    /// Projection of the egocentric set: a wide fisheye or a pinhole. The other sets use pinhole cameras.
    pub camera: Model,
    /// Number of images per object and light; the test set has a fixed number.
    pub views: usize,
    /// Frames of the head-mounted camera, which has ten per second, from one image to the next.
    pub every: usize,
    /// Side of an image in pixels.
    pub size: usize,
    /// Whether training views contain the whole object.
    pub framing: Framing,
    /// Number of samples per pixel.
    pub samples: u32,
    /// Maximum number of bounces of light after the first hit.
    pub bounces: u32,
    /// Side of a square with as many texels as the textures of an object.
    pub texture: usize,
    /// Number of columns of a built-in map; it has half as many rows.
    pub map_width: usize,
    /// Passes to write besides photo and foreground.
    pub passes: PassSet,
    /// Whether to write shape, materials and map.
    pub truth: bool,
    /// Seed of every draw.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            objects: 1,
            first: 0,
            meshes: Vec::new(),
            maps: Vec::new(),
            map_options: MapOptions::default(),
            axes: false,
            lighting: Lighting::Uniform,
            shiny: false,
            set: Set::Train,
            camera: Model::Fisheye,
            views: 32,
            every: 1,
            size: 256,
            framing: Framing::Loose,
            samples: 64,
            bounces: 1,
            texture: 512,
            map_width: 512,
            passes: PassSet::ALL,
            truth: true,
            seed: 0,
        }
    }
}

impl Settings {
    /// Checks the ranges of all settings.
    ///
    /// # Errors
    /// If a setting is out of range; the error names it.
    pub fn validate(&self) -> Result<()> {
        let within = |name: &str, x: usize, low: usize, high: usize| {
            if (low..=high).contains(&x) {
                return Ok(());
            }
            Err(Error::input(format!("setting {name}"))
                .expected(format!("{low} to {high}"))
                .got(x.to_string()))
        };
        within("views", self.views, 1, 100_000)?;
        within("every", self.every, 1, 1000)?;
        within("frames", self.views * self.every, 1, 100_000)?;
        within("size", self.size, 8, 4096)?;
        within("texture", self.texture, 32, 4096)?;
        within("map_width", self.map_width, 8, 8192)?;
        within("samples", self.samples as usize, 1, 1_000_000)?;
        within("bounces", self.bounces as usize, 0, 64)?;
        if (self.axes || !self.maps.is_empty()) && self.lighting == Lighting::Uniform {
            let e = Error::input("setting env").expected("environment lighting");
            return Err(e.got("uniform lighting, which uses no map").hint("--lighting environment or both"));
        }
        if self.axes && !self.maps.is_empty() {
            return Err(Error::input("setting maps")
                .expected("only the axes map")
                .got("other maps in addition"));
        }
        if self.shiny && self.lighting == Lighting::Uniform {
            return Err(Error::input("setting shiny")
                .expected("environment lighting, because roughness is hardly visible under a white dome")
                .got("uniform lighting")
                .hint("--lighting environment or both"));
        }
        if self.camera == Model::Orthographic {
            return Err(Error::input("setting camera").expected("fisheye or pinhole").got("orthographic"));
        }
        Ok(())
    }

    /// Number of images of one object under one light.
    pub(super) fn image_count(&self) -> usize {
        if self.set == Set::Test { 48 } else { self.views }
    }

    /// Projection of the images.
    pub(super) fn model(&self) -> Model {
        if self.set == Set::Egocentric { self.camera } else { Model::Pinhole }
    }

    /// Versions of an object.
    pub(super) fn versions(&self) -> Vec<Version> {
        let has = |version: &Version| match version {
            Version::Uniform => self.lighting != Lighting::Environment,
            Version::Environment => self.lighting != Lighting::Uniform,
            Version::Shiny => self.lighting != Lighting::Uniform && self.shiny,
        };
        Version::ALL.into_iter().filter(has).collect()
    }

    /// All settings that affect an object's files, for resumed runs and for readers. Files are identified by
    /// name and contents.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn record(&self) -> Result<Map<String, Value>> {
        let names = |paths: &[PathBuf]| paths.iter().map(|p| io::identity(p)).collect::<Result<Vec<_>>>();
        let o = &self.map_options;
        let entries = [
            ("meshes", json!(names(&self.meshes)?)),
            ("maps", json!(names(&self.maps)?)),
            ("map_axes", json!([o.orientation.name(), o.mirror, o.rotate, o.scale])),
            ("lighting", json!(self.lighting.name())),
            ("shiny", json!(self.shiny)),
            ("set", json!(self.set.name())),
            ("camera", json!(self.model().name())),
            ("views", json!(self.image_count())),
            ("size", json!(self.size)),
            ("framing", json!(self.framing.name())),
            ("samples", json!(self.samples)),
            ("bounces", json!(self.bounces)),
            ("texture", json!(self.texture)),
            ("map_width", json!(self.map_width)),
            ("passes", self.passes.record()),
            ("truth", json!(self.truth)),
            ("seed", json!(self.seed)),
        ];
        let axes = self.axes.then(|| ("axes", json!(true)));
        let every = (self.every != 1).then(|| ("every", json!(self.every)));
        Ok(entries.into_iter().chain(axes).chain(every).map(|(k, v)| (k.to_owned(), v)).collect())
    }
}
