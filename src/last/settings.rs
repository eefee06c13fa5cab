//! Settings of a data set.

use super::character_settings::CharacterSettings;
use super::points::Rendering;
use crate::fit::passes::PassSet;
use crate::{Error, Result};
use data_gen::figure::graph::Graph;
use data_gen::figure::mechanism::{Mechanism, Scm};
use data_gen::figure::{MAX_FACTORS, video};
use serde_json::{Value, json};

/// Number of bounces of light after the first hit, for surfaces of video and sets.
pub const BOUNCES: u32 = 1;

/// Number of factors that act on a character: posture, elbow, folds, light.
pub const CHARACTER_FACTORS: usize = 4;

/// The sets to be generated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Which {
    /// A video of a moving subject.
    pub video: bool,
    /// Observational frames.
    pub observational: bool,
    /// Frames before and after do(i, v).
    pub interventions: bool,
}

impl Which {
    /// Parses `video`, `observational`, `interventions`, `training` (both of these) or `all`.
    ///
    /// # Errors
    /// For any other name.
    pub fn parse(name: &str) -> Result<Self> {
        let only = |video, observational, interventions| Self { video, observational, interventions };
        match name {
            "video" => Ok(only(true, false, false)),
            "observational" => Ok(only(false, true, false)),
            "interventions" => Ok(only(false, false, true)),
            "training" => Ok(only(false, true, true)),
            "all" => Ok(only(true, true, true)),
            other => Err(Error::input("set")
                .expected("video, observational, interventions, training (both of these) or all")
                .got(other)),
        }
    }
}

/// All settings that affect a data set.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Name of the sets, as read by [`Which::parse`].
    pub set: String,
    /// Name of the graph: `FORK` … `EMPTY`, `ER-m`.
    pub graph: String,
    /// Number of factors, 2 to 8.
    pub factors: usize,
    /// Name of the mechanism: `LIN`, `NL`, `NG`, `NL-NG`.
    pub mechanism: String,
    /// Whether to use unit noise and coefficients as drawn instead of unit variances.
    pub raw: bool,
    /// How the subject of the video is rendered.
    pub video_look: Rendering,
    /// How the subjects of the sets are rendered.
    pub set_look: Rendering,
    /// Side of the images of the video, pixels.
    pub video_size: usize,
    /// Side of the images of the sets, pixels.
    pub set_size: usize,
    /// Number of samples per pixel, for surfaces only.
    pub samples: u32,
    /// Number of observational frames.
    pub count: usize,
    /// Number of intervention groups.
    pub groups: usize,
    /// Number of appearances in the sets.
    pub appearances: usize,
    /// Number of points of the template.
    pub points: usize,
    /// Number of frames of the video.
    pub frames: usize,
    /// Number of test cameras of the video, 1 to 22.
    pub test_cameras: usize,
    /// Whether the video also contains depth, normals, albedo, material and linear radiance.
    pub passes: PassSet,
    /// Appearance of the subject of the video.
    pub subject: u64,
    /// A character that replaces the built-in figure.
    pub character: Option<CharacterSettings>,
    /// Seed of every draw.
    pub seed: u64,
}

impl Settings {
    /// The default sizes.
    pub fn full() -> Self {
        Self {
            set: "all".into(),
            graph: "FORK".into(),
            factors: 4,
            mechanism: "NL".into(),
            raw: false,
            video_look: Rendering::Mesh,
            set_look: Rendering::Discs,
            video_size: 256,
            set_size: 64,
            samples: 16,
            count: 2048,
            groups: 256,
            appearances: 64,
            points: 2048,
            frames: 100,
            test_cameras: 22,
            passes: PassSet::NONE,
            subject: 0,
            character: None,
            seed: 0,
        }
    }

    /// Small sizes, generated in seconds.
    pub fn smoke() -> Self {
        Self {
            video_size: 64,
            count: 128,
            groups: 16,
            appearances: 8,
            points: 1024,
            frames: 20,
            test_cameras: 4,
            ..Self::full()
        }
    }

    /// Checks the ranges of all settings.
    ///
    /// # Errors
    /// If a setting is out of range; the error names it.
    pub fn validate(&self) -> Result<()> {
        let which = Which::parse(&self.set)?;
        let of_character = |is_wrong: bool, name: &str, expected: &str, got: String| match &self.character {
            Some(_) if is_wrong => {
                Err(Error::input(format!("setting {name}")).expected(expected.to_owned()).got(got))
            }
            _ => Ok(()),
        };
        let sets = which.observational || which.interventions;
        let plays = self.character.as_ref().is_some_and(|c| c.play);
        let look = self.video_look;
        of_character(
            which.video && look != Rendering::Mesh,
            "video look",
            "mesh for a character",
            look.name().into(),
        )?;
        of_character(
            sets && self.appearances != 1,
            "appearances",
            "1, because a character has one appearance",
            self.appearances.to_string(),
        )?;
        of_character(
            sets && plays,
            "play",
            "no animation in the sets, because their images have no order in time",
            "animations that are also played".into(),
        )?;
        let within = |name: &str, x: usize, low: usize, high: usize| {
            if (low..=high).contains(&x) {
                Ok(())
            } else {
                Err(Error::input(format!("setting {name}"))
                    .expected(format!("{low} to {high}"))
                    .got(x.to_string()))
            }
        };
        within("factors", self.factors, 2, MAX_FACTORS)?;
        within("samples", self.samples as usize, 1, 65_536)?;
        within("points", self.points, 64, 1 << 15)?;
        if which.observational {
            within("count", self.count, 1, 1 << 24)?;
        }
        if which.interventions {
            within("groups", self.groups, 1, 1 << 20)?;
        }
        if which.observational || which.interventions {
            within("set size", self.set_size, 8, 512)?;
            within("appearances", self.appearances, 1, 1 << 16)?;
        }
        if which.video {
            within("video size", self.video_size, 8, 4096)?;
            within("frames", self.frames, 1, 100_000)?;
            within("test cameras", self.test_cameras, 1, video::CAMERAS - 1)?;
        }
        if which.video && !self.passes.is_empty() && self.video_look != Rendering::Mesh {
            return Err(Error::input("setting passes")
                .expected("--video-render-as mesh, because points have no depth, normals or material")
                .got(self.video_look.name()));
        }
        if self.character.is_some() && self.factors > CHARACTER_FACTORS {
            return Err(Error::input("setting factors")
                .expected(format!(
                    "2 to {CHARACTER_FACTORS} for a character, because further factors have no effect"
                ))
                .got(self.factors.to_string()));
        }
        Ok(())
    }

    /// The structural causal model of the data.
    ///
    /// # Errors
    /// If graph and factors do not match, or a name is unknown.
    pub fn scm(&self) -> Result<Scm> {
        let fail = |e: String| Error::input("settings").expected("a causal model").got(e);
        let graph = Graph::named(&self.graph, self.factors, self.seed).map_err(fail)?;
        let mechanism = Mechanism::parse(&self.mechanism).map_err(fail)?;
        Ok(Scm::new(graph, mechanism, !self.raw, self.seed))
    }

    pub(super) fn record(&self) -> Value {
        let mut record = json!({
            "set": self.set, "graph": self.graph, "factors": self.factors, "mechanism": self.mechanism,
            "raw": self.raw, "video_look": self.video_look.name(), "set_look": self.set_look.name(),
            "video_size": self.video_size, "set_size": self.set_size, "samples": self.samples,
            "count": self.count, "groups": self.groups, "appearances": self.appearances,
            "points": self.points, "frames": self.frames, "test_cameras": self.test_cameras, "passes": self.passes.record(),
            "subject": self.subject, "seed": self.seed, "bounces": BOUNCES,
        });
        // Recorded only for characters, so that records of the figure keep their bytes.
        if let Some(c) = &self.character {
            record["character"] = c.record();
        }
        record
    }

    /// A command line that generates the same data, apart from the folder.
    pub fn command(&self) -> String {
        let which = Which::parse(&self.set).ok();
        let mut words = vec![format!(
            "lastlight last gen --split {} --graph {} --factors {} --equations {} --body-points {} --samples {} --seed {}",
            self.set, self.graph, self.factors, self.mechanism, self.points, self.samples, self.seed
        )];
        if self.raw {
            words.push("--no-standardize".into());
        }
        if which.is_some_and(|w| w.observational) {
            words.push(format!("--observational {}", self.count));
        }
        if which.is_some_and(|w| w.interventions) {
            words.push(format!("--groups {}", self.groups));
        }
        if which.is_some_and(|w| w.observational || w.interventions) {
            words.push(format!(
                "--appearances {} --set-render-as {} --set-size {}",
                self.appearances,
                self.set_look.name(),
                self.set_size
            ));
        }
        if which.is_some_and(|w| w.video) {
            words.push(format!(
                "--frames {} --test-cameras {} --subject {} --video-render-as {} --video-size {}",
                self.frames,
                self.test_cameras,
                self.subject,
                self.video_look.name(),
                self.video_size
            ));
            if !self.passes.is_empty() {
                words.push(format!("--passes {}", self.passes.names().join(",")));
            }
        }
        if let Some(c) = &self.character {
            words.push(c.options().trim_start().to_owned());
        }
        words.join(" ")
    }
}
