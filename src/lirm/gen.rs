//! Data sets of rendered objects with known shape, materials and light.
//!
//! ```text
//! DIR/dataset.json                     settings, objects, digests
//! DIR/object_00000/object.json         generator and parameters, light, test protocol, exposures, digests
//!                 /object.glb          shape and materials (`truth`)
//!                 /environment.exr     the environment map
//!                 /uniform/            a capture with passes (fit::passes), under a white dome
//!                 /environment/        under a map
//!                 /shiny/              under the map, roughness times U(0.3, 0.6)
//! ```
//!
//! Object k, its cameras, light and samples depend only on the seed and k, so sets can be generated in parts
//! and on several machines, each in a folder of its own: `dataset.json` lists the objects of the last run.
//! The module `folder` describes how a folder is created, resumed and overwritten.

use super::folder::{FORMAT, RECORD, announce, begin, finished, header, write_object};
pub use super::settings::{Lighting, Set, Settings, Version};
use super::shots::shots;
use super::subject::{Light, Subject};
use super::truth;
use crate::fit::passes::{Recorder, Shot, Style};
use crate::geometry::bvh::Bvh;
use crate::io::{atomic, hex};
use crate::num::par;
use crate::num::rng::{self, Rng};
use crate::scene::from_data_gen;
use crate::scene::light::Lights;
use crate::shade::render::{Passes, Scene, Settings as Tracing, render};
use crate::shade::{exposure, sensor::Sensor};
use crate::{Error, Result};
use serde_json::{Map, Value, json};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Render samples of an image; the item is the object, the step the image.
const RENDER_PURPOSE: u16 = 0x0420;
/// Sensor noise of an object's images; the item is the object.
const SENSOR_PURPOSE: u16 = 0x0701;

/// The result of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// Number of objects in the set.
    pub objects: usize,
    /// Number of images rendered by this run; the others already existed.
    pub rendered: usize,
    /// Digest of all files.
    pub digest: u64,
}

/// Generates the set in `dir`, one object after another. `progress` receives the number of finished images,
/// the total number of images, and the name of the current object.
///
/// # Errors
/// If a setting, a model or a map is invalid, a file cannot be written, `resume` finds other settings, or
/// `stop` was set.
pub fn run(
    dir: &Path,
    settings: &Settings,
    resume: bool,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(usize, usize, &str),
) -> Result<Summary> {
    settings.validate()?;
    let per_object = settings.image_count() * settings.versions().len();
    let total = per_object * settings.objects as usize;
    let (mut listed, mut rendered, mut digest) = (Vec::new(), 0, crate::num::bits::Digest::new());
    let record = settings.record()?;
    begin(dir, &record, resume)?;
    let job = Job { dir, settings, record: &record, resume, stop };
    for n in 0..settings.objects {
        let k = settings.first + n;
        let name = format!("object_{k:05}");
        let folder = dir.join(&name);
        let done = n as usize * per_object;
        let kept = if resume { finished(&folder, settings, &record, k)? } else { None };
        let object = match kept {
            Some(object) => object,
            None => {
                let mut visited = 0;
                let (object, made) = job.object(&folder, k, &mut |label| {
                    progress(done + visited, total, &format!("{name} · {label}"));
                    visited += 1;
                })?;
                rendered += made;
                object
            }
        };
        digest.bytes(format!("{object:#}").as_bytes());
        listed.push(
            json!({ "folder": name, "shape": object["shape"]["name"], "versions": object["versions"] }),
        );
    }
    progress(total, total, "done");
    let digest = digest.value();
    let top = json!({
        "format": FORMAT, "complete": true, "settings": record, "objects": listed, "digest": hex(digest),
    });
    atomic::write_bytes(&dir.join(RECORD), format!("{top:#}\n").as_bytes())?;
    Ok(Summary { objects: listed.len(), rendered, digest })
}

/// Settings common to all objects of a run.
struct Job<'a> {
    /// The folder of the set.
    dir: &'a Path,
    settings: &'a Settings,
    /// The settings as written in every record.
    record: &'a Map<String, Value>,
    /// Whether existing images are kept.
    resume: bool,
    stop: &'a AtomicBool,
}

impl Job<'_> {
    /// Generates the missing files of object `k` with all its versions. `made` is called for every image with
    /// the name of its version. Returns the object's record and the number of images rendered.
    fn object(&self, folder: &Path, k: u64, made: &mut dyn FnMut(&str)) -> Result<(Value, usize)> {
        let Job { settings, .. } = *self;
        atomic::sweep(folder)?;
        let versions = settings.versions();
        let needs_map = versions.iter().any(|version| version.is_under_map());
        let (subject, light) = par::join(
            || Subject::new(settings, k),
            || if needs_map { Light::new(settings, k).map(Some) } else { Ok(None) },
        );
        let (subject, light) = (subject?, light?);
        announce(self.dir, self.record)?;
        let bvh = Bvh::build(&subject.object.mesh.positions, &subject.object.mesh.triangles);
        let (shots, protocol) = shots(settings, k);
        let (mut records, mut rendered) = (Vec::new(), 0);
        for version in versions {
            let header = header(self.record, k, version);
            let recorder = Recorder::open(&folder.join(version.name()), header, self.resume)?;
            let (digest, count) =
                captured(settings, k, version, &subject, &bvh, light.as_ref(), |capture| {
                    capture.shoot(recorder, &shots, self.stop, &mut || made(version.name()))
                })?;
            rendered += count;
            let mut record = json!({
                "folder": version.name(),
                "lighting": if version.is_under_map() { Lighting::Environment } else { Lighting::Uniform }.name(),
                "digest": hex(digest),
            });
            if version.is_shiny() {
                record["roughness_factor"] = json!(f64::from(subject.gloss(settings.seed, k)));
            }
            records.push(record);
        }
        let mut record = json!({
            "object": k,
            "shape": subject.record,
            "vertices": subject.object.mesh.positions.len(),
            "triangles": subject.object.mesh.triangles.len(),
            "versions": records,
            "settings": self.record,
        });
        if settings.truth {
            record["truth"] = truth::write(folder, &subject.object, light.as_ref().map(|l| &l.map))?;
        }
        if let Some(light) = light {
            record["environment"] = light.record;
        }
        if let Some(protocol) = protocol {
            record["protocol"] = protocol;
        }
        write_object(folder, &record)?;
        Ok((record, rendered))
    }
}

/// One version of an object in memory, with the cameras and light of object k.
///
/// # Errors
/// If a model or a map is invalid.
pub(super) fn in_memory(
    settings: &Settings,
    k: u64,
    version: Version,
    subject: &Subject,
) -> Result<Vec<(Shot, RenderedImage)>> {
    let light = if version.is_under_map() { Some(Light::new(settings, k)?) } else { None };
    let bvh = Bvh::build(&subject.object.mesh.positions, &subject.object.mesh.triangles);
    let (shots, _) = shots(settings, k);
    captured(settings, k, version, subject, &bvh, light.as_ref(), |capture| {
        let one = |(i, shot): (usize, Shot)| {
            let image = capture.render(i, &shot)?;
            Ok((shot, image))
        };
        shots.into_iter().enumerate().map(one).collect()
    })
}

/// Calls `f` with one version of object `k`.
///
/// # Errors
/// That of `f`, or if the object or its light is invalid.
fn captured<T>(
    settings: &Settings,
    k: u64,
    version: Version,
    subject: &Subject,
    bvh: &Bvh,
    light: Option<&Light>,
    f: impl FnOnce(&Capture<'_>) -> Result<T>,
) -> Result<T> {
    let lights = lights(light.filter(|_| version.is_under_map()));
    let shiny = version.is_shiny().then(|| subject.with_roughness(subject.gloss(settings.seed, k)));
    let scene = Scene::new(shiny.as_ref().unwrap_or(&subject.object), bvh, &lights)?;
    f(&Capture { settings, k, scene: &scene, exposed: version.is_under_map() })
}

/// The light of a version: the object's map, or a white dome.
fn lights(light: Option<&Light>) -> Lights {
    let map = match light {
        Some(light) => light.map.clone(),
        None => from_data_gen::environment(&data_gen::environments::uniform()),
    };
    Lights { environment: Some(map), lamps: Vec::new() }
}

/// One object under one light.
struct Capture<'a> {
    settings: &'a Settings,
    k: u64,
    scene: &'a Scene<'a>,
    /// Whether images are exposed individually; under a white dome, white stays white.
    exposed: bool,
}

impl Capture<'_> {
    /// Renders the missing images; each image is written while the next one is rendered. `count` is called
    /// for every image. Returns the digest of all images and the number of images rendered.
    fn shoot(
        &self,
        mut recorder: Recorder,
        shots: &[Shot],
        stop: &AtomicBool,
        count: &mut dyn FnMut(),
    ) -> Result<(u64, usize)> {
        let mut rendered = 0;
        let mut ready: Option<(&Shot, RenderedImage)> = None;
        for (i, shot) in shots.iter().enumerate() {
            count();
            if recorder.has(shot)? {
                continue;
            }
            let stopped = stop.load(Ordering::Relaxed);
            let waiting = ready.take();
            let (next, written) = par::join(
                || if stopped { Ok(None) } else { self.render(i, shot).map(Some) },
                || waiting.map_or(Ok(()), |(shot, image)| image.put(&mut recorder, shot)),
            );
            written?;
            match next? {
                Some(image) => {
                    rendered += 1;
                    ready = Some((shot, image));
                }
                None => return Err(Error::interrupted("rendering").hint("continue with --resume")),
            }
        }
        if let Some((shot, image)) = ready {
            image.put(&mut recorder, shot)?;
        }
        Ok((recorder.finish(shots)?, rendered))
    }

    fn render(&self, i: usize, shot: &Shot) -> Result<RenderedImage> {
        let s = self.settings;
        let seed = Rng::new(s.seed).derive(self.k, i as u32, RENDER_PURPOSE);
        let tracing = Tracing { samples: s.samples, bounces: s.bounces, seed, ..Tracing::default() };
        let passes = render(self.scene, &shot.camera, shot.shutter_close.as_ref(), &tracing)?;
        let exposure = if self.exposed { exposure::auto(&passes.color, &passes.alpha) } else { 1.0 };
        let sensed = (s.set == Set::Egocentric).then(|| {
            let mut signal: Vec<[f32; 3]> = passes.color.iter().map(|c| c.map(|x| x * exposure)).collect();
            Sensor::default().apply(&mut signal, rng::derive(s.seed, self.k, SENSOR_PURPOSE), i as u32);
            signal
        });
        Ok(RenderedImage { passes, style: Style { exposure, transparent: false, passes: s.passes }, sensed })
    }
}

/// An image of an object.
pub(super) struct RenderedImage {
    /// What was rendered.
    pub(super) passes: Passes,
    /// How it is written, with the factor from radiance to the photo.
    pub(super) style: Style,
    /// The exposed radiance with sensor noise, of which the photo is made, but not `radiance/`.
    pub(super) sensed: Option<Vec<[f32; 3]>>,
}

impl RenderedImage {
    fn put(&self, recorder: &mut Recorder, shot: &Shot) -> Result<()> {
        recorder.put_with(shot, &self.passes, &self.style, self.sensed.as_deref())
    }
}
