//! Arguments that several commands have.

use super::meter::Meter;
use super::report::{Page, Section, Stat};
use crate::console;
use crate::fit::orbit::Orbit;
use crate::loss::lpips;
use crate::scene::convert::{Invalid, read_scene_with};
use crate::scene::gaussians::Gaussians;
use crate::{Error, Result, choices};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// The scene in the folder of `splat fit`.
pub(super) const SCENE: &str = "scene.ply";

/// Seed, resumption and replacement of a command that fills a folder.
#[derive(clap::Args)]
pub(super) struct OutputArgs {
    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(super) seed: u64,
    /// Continue the interrupted run in the folder of --out; the result is bit-identical to that of an uninterrupted run
    #[arg(long)]
    pub(super) resume: bool,
    /// Replace existing results
    #[arg(long, conflicts_with = "resume")]
    pub(super) force: bool,
}

/// Replacement.
#[derive(clap::Args)]
pub(super) struct ForceArgs {
    /// Replace existing results
    #[arg(long)]
    pub(super) force: bool,
}

/// How a scene file is read.
#[derive(clap::Args)]
pub(super) struct SceneArgs {
    /// Leave out Gaussians that are not valid (a zero quaternion, NaN, a number out of range) instead of refusing the file
    #[arg(long)]
    drop_invalid: bool,
}

impl SceneArgs {
    /// What is done with Gaussians that are not valid.
    pub(super) fn invalid(&self) -> Invalid {
        if self.drop_invalid { Invalid::Drop } else { Invalid::Refuse }
    }

    /// Reads a scene; prints how many Gaussians were left out.
    ///
    /// # Errors
    /// Those of [`read_scene_with`].
    pub(super) fn read(&self, path: &Path, meter: &Meter) -> Result<Gaussians> {
        let (scene, dropped) = read_scene_with(path, self.invalid())?;
        if dropped > 0 {
            meter.note(&dropped_text(dropped, dropped + scene.len()));
        }
        Ok(scene)
    }
}

/// How many Gaussians were left out, as text.
pub(super) fn dropped_text(dropped: usize, of: usize) -> String {
    format!("left out {dropped} of {of} Gaussians that are not valid (--drop-invalid)")
}

/// Perceptual metrics.
#[derive(clap::Args)]
pub(super) struct MetricArgs {
    /// Weights of LPIPS (VGG16 and heads; none are shipped, the surrogate RFD is used without). The documentation of `lastlight::loss::lpips` describes the file
    #[arg(long, value_name = "FILE")]
    lpips: Option<PathBuf>,
    /// Feed LPIPS values in 0 … 1 without 2x − 1, as GauHuman and Instant-NVR do
    #[arg(long, requires = "lpips")]
    lpips_raw: bool,
}

impl MetricArgs {
    /// The weights, if a file is given.
    ///
    /// # Errors
    /// When the file is missing or malformed.
    pub(super) fn load(&self) -> Result<Option<lpips::Metric>> {
        self.lpips.as_deref().map(|path| lpips::Metric::load(path, !self.lpips_raw)).transpose()
    }
}

/// With scores: notes that a surrogate takes the place of LPIPS where there are no weights.
pub(super) fn note_missing_weights(metric: Option<&lpips::Metric>, meter: &Meter) {
    if metric.is_none() {
        meter.note(lpips::NO_WEIGHTS);
    }
}

/// What a run leaves behind, files apart.
pub(super) struct Outcome {
    /// the result
    pub(super) record: Value,
    /// the report; that of a run that was complete before is there
    pub(super) page: Option<Page>,
    /// the result for a terminal
    pub(super) lines: Vec<String>,
    /// mean PSNR of the held-out images in dB, that of the box for a person; NaN where nothing is held out
    pub(super) held_out_db: f64,
}

impl Outcome {
    /// The cards of its report.
    pub(super) fn stats(&self) -> &[Stat] {
        self.page.as_ref().map_or(&[], |page| &page.stats)
    }

    /// The parts of its report.
    pub(super) fn sections(&self) -> &[Section] {
        self.page.as_ref().map_or(&[], |page| &page.sections)
    }

    /// Writes the report into `dir`; prints the record as JSON, or the lines and where the report is.
    ///
    /// # Errors
    /// When the report or standard output cannot be written.
    pub(super) fn publish(&self, dir: &Path) -> Result<()> {
        let report = match &self.page {
            Some(page) => page.write(dir)?,
            None => dir.join("report/index.html"),
        };
        if crate::console::is_json() {
            return crate::console::say_json(&self.record);
        }
        self.lines.iter().try_for_each(|line| crate::console::say(line))?;
        crate::console::say(&format!("report      {}", report.display()))
    }
}

/// Names of folders that say nothing without the folder that contains them.
const GENERIC: [&str; 11] = [
    "video",
    "images",
    "train",
    "test",
    "data",
    "capture",
    "dataset",
    "views",
    "uniform",
    "environment",
    "shiny",
];

/// A capture by name: its folder, that of its `transforms.json`, or the last two folders where the last one is generic, such as `0` or `video`.
pub(super) fn name(capture: &Path) -> String {
    let folder = if capture.is_file() { capture.parent().unwrap_or(capture) } else { capture };
    let full = folder.canonicalize().unwrap_or_else(|_| folder.to_path_buf());
    let mut names = full.iter().rev().map(|n| n.to_string_lossy()).filter(|n| n != "/");
    let Some(last) = names.next() else { return full.display().to_string() };
    let says_nothing = GENERIC.contains(&&*last) || last.chars().all(|c| c.is_ascii_digit());
    match names.next() {
        Some(above) if says_nothing => format!("{above}/{last}"),
        _ => last.into_owned(),
    }
}

/// A circle of cameras. Defaults depend on the command and are listed in its help.
#[derive(clap::Args)]
pub(super) struct OrbitArgs {
    /// Image size of an orbit: S for squares, or WxH
    #[arg(long, value_name = "S|WxH", value_parser = choices::size)]
    size: Option<[usize; 2]>,
    /// Horizontal field of view of an orbit in degrees
    #[arg(long, value_name = "DEG")]
    fov: Option<f64>,
    /// Angle of an orbit above the horizon in degrees
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    elevation: Option<f64>,
    /// Distance of an orbit's cameras from its centre [default: the whole scene fits]
    #[arg(long, value_name = "R")]
    radius: Option<f32>,
}

/// Defaults of an orbit.
#[derive(Clone, Copy, Debug)]
pub(super) struct DefaultArgs {
    /// Width and height in pixels.
    pub(super) size: [usize; 2],
    /// Horizontal, degrees.
    pub(super) fov: f64,
    /// Above the horizon, degrees.
    pub(super) elevation: f64,
}

impl OrbitArgs {
    /// Size, field of view, elevation, radius: as given, or the defaults.
    pub(super) fn resolved(&self, usual: DefaultArgs) -> ([usize; 2], f64, f64, Option<f32>) {
        let size = self.size.unwrap_or(usual.size);
        (size, self.fov.unwrap_or(usual.fov), self.elevation.unwrap_or(usual.elevation), self.radius)
    }

    /// The circle given by `--cameras orbit:N`; `None` for other values, with a note on options of an orbit that are given beside them.
    ///
    /// # Errors
    /// When N is not an integer.
    pub(super) fn parse(&self, cameras: &str, usual: DefaultArgs) -> Result<Option<Orbit>> {
        let wrong = || {
            let e = Error::input("--cameras").expected("orbit:N with a number of views N, such as orbit:36");
            e.got(cameras)
        };
        if cameras == "orbit" && !Path::new(cameras).exists() {
            return Err(wrong());
        }
        let Some(count) = cameras.strip_prefix("orbit:") else {
            // A name with a number is no path that was mistyped.
            let number =
                cameras.split_once(':').map(|(_, number)| number).filter(|_| !Path::new(cameras).exists());
            if let Some(number) = number.filter(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit())) {
                return Err(wrong().hint(format!(
                    "orbit:{number} gives {}",
                    if number == "1" { "1 view".to_owned() } else { format!("{number} views") }
                )));
            }
            let given = [
                ("--size", self.size.is_some()),
                ("--fov", self.fov.is_some()),
                ("--elevation", self.elevation.is_some()),
                ("--radius", self.radius.is_some()),
            ];
            for (option, _) in given.iter().filter(|(_, is_given)| *is_given && !console::is_quiet()) {
                console::note(&format!(
                    "{option} has no effect: it is for --cameras orbit:N, and those of {cameras} are complete"
                ));
            }
            return Ok(None);
        };
        let count = count.parse().map_err(|_| wrong())?;
        let (size, fov, elevation, radius) = self.resolved(usual);
        Ok(Some(Orbit {
            count,
            center: None,
            arc_rad: None,
            radius,
            elevation_rad: elevation.to_radians(),
            fov_x_rad: fov.to_radians(),
            size,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn captures_have_names_that_say_something() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        for (path, expected) in
            [("fox", "fox"), ("walk/0", "walk/0"), ("subject/video", "subject/video"), ("a/desk2", "desk2")]
        {
            let folder = dir.path().join(path);
            std::fs::create_dir_all(&folder).expect("made");
            assert_eq!(name(&folder), expected, "{path}");
        }
        let file = dir.path().join("fox/transforms.json");
        std::fs::write(&file, "{}").expect("written");
        assert_eq!(name(&file), "fox", "the folder of the file");
    }
}
