//! Data sets of rendered objects whose shape, materials and light are known.
//!
//! ```text
//! DIR/dataset.json                     settings, objects, digests
//! DIR/object_00000/object.json         what was made: generator and parameters, light, test protocol, exposures, digests
//!                 /object.glb          shape and materials (`truth`)
//!                 /environment.exr     the map
//!                 /uniform/            a capture with passes (fit::passes), under a white dome
//!                 /environment/        under a map
//!                 /shiny/              under the map, roughness times U(0.3, 0.6)
//! ```
//!
//! Object k, its cameras, light and samples depend on the seed and k alone, so sets can be made in pieces and on several machines, each in a
//! folder of its own: `dataset.json` lists the objects of the last run.
//! How a folder is begun, continued and started over: `folder`.

use super::folder::{FORMAT, RECORD, VERSIONS, announce, begin, finished, header, hex};
use super::subject::{Light, Subject};
use super::truth;
use crate::fit::passes::{Recorder, Shot, Style};
use crate::geometry::bvh::Bvh;
use crate::io::capture::Split;
use crate::io::{self, atomic};
use crate::num::par;
use crate::num::rng::{self, Rng};
use crate::scene::camera::{Camera, Model};
use crate::scene::environment_file::Options as MapOptions;
use crate::scene::from_data_gen;
use crate::scene::light::Lights;
use crate::scene::mesh::Object;
use crate::shade::render::{Passes, Scene, Settings as Tracing, render};
use crate::shade::{exposure, sensor::Sensor};
use crate::{Error, Result};
use data_gen::cameras::{self, Framing, Placed};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// Samples of a picture; the item is the object, the step the picture.
const RENDER_PURPOSE: u16 = 0x0420;
/// Sensor noise of an object's pictures; the item is the object.
const SENSOR_PURPOSE: u16 = 0x0701;

/// Light regimes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lighting {
    /// A white dome of radiance 1.
    Uniform,
    /// A map with a high dynamic range.
    Environment,
    /// Both, from the same cameras.
    Both,
}

/// Which cameras.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Set {
    /// Drawn as for training.
    Train,
    /// The 48 test views of an object: inputs are the training split, outputs the test split, the rest validation.
    Test,
    /// A camera on a head, with motion blur and sensor noise; every eighth picture is the test split.
    Egocentric,
}

/// What is made.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Number of objects; files given in `meshes` count from 0.
    pub objects: u64,
    /// Index of the first.
    pub first: u64,
    /// Models to use instead of built-in objects.
    pub meshes: Vec<PathBuf>,
    /// Maps to use instead of built-in environments.
    pub maps: Vec<PathBuf>,
    /// How those maps are read; `rotate` is added to a drawn turn.
    pub map_options: MapOptions,
    /// The test map that colours the axes ([`crate::shade::axes`]) instead of any other, read by `map_options`, neither turned by a draw nor scaled.
    pub axes: bool,
    /// Light.
    pub lighting: Lighting,
    /// A second version under the map with smaller roughness.
    pub shiny: bool,
    /// Cameras.
    pub set: Set,
    /// Projection of the egocentric set: a wide fisheye or a pinhole. The other sets are pinhole pictures.
    pub camera: Model,
    /// Pictures per object and light; the test set has its own number.
    pub views: usize,
    /// Pixels a side.
    pub size: usize,
    /// Whether training views hold the whole object.
    pub framing: Framing,
    /// Samples per pixel.
    pub samples: u32,
    /// Surfaces after the first that light may come by.
    pub bounces: u32,
    /// Side of a square with as many texels as an object's textures have.
    pub texture: usize,
    /// Columns of a built-in map; half as many rows.
    pub map_width: usize,
    /// Whether passes beside photograph and foreground are written.
    pub passes: bool,
    /// Whether shape, materials and map are written.
    pub truth: bool,
    /// Of every draw.
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
            size: 256,
            framing: Framing::Loose,
            samples: 64,
            bounces: 1,
            texture: 512,
            map_width: 512,
            passes: true,
            truth: true,
            seed: 0,
        }
    }
}

impl Settings {
    /// Checks ranges.
    ///
    /// # Errors
    /// Names the setting.
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
        within("size", self.size, 8, 4096)?;
        within("texture", self.texture, 32, 4096)?;
        within("map_width", self.map_width, 8, 8192)?;
        within("samples", self.samples as usize, 1, 1_000_000)?;
        within("bounces", self.bounces as usize, 0, 64)?;
        if (self.axes || !self.maps.is_empty()) && self.lighting == Lighting::Uniform {
            let e = Error::input("setting env").expected("light from an environment");
            return Err(e.got("uniform light, which shows no map").hint("--lighting environment or both"));
        }
        if self.axes && !self.maps.is_empty() {
            return Err(Error::input("setting maps").expected("the axes map alone").got("others beside it"));
        }
        if self.shiny && self.lighting == Lighting::Uniform {
            return Err(Error::input("setting shiny")
                .expected("an environment: roughness hardly shows under a white dome")
                .got("uniform light")
                .hint("--lighting environment or both"));
        }
        if self.camera == Model::Orthographic {
            return Err(Error::input("setting camera").expected("fisheye or pinhole").got("orthographic"));
        }
        Ok(())
    }

    /// Pictures of one object under one light.
    fn pictures(&self) -> usize {
        if self.set == Set::Test { 48 } else { self.views }
    }

    /// Projection of the pictures.
    fn model(&self) -> Model {
        if self.set == Set::Egocentric { self.camera } else { Model::Pinhole }
    }

    /// Names of the versions of an object: folder, whether under the map, whether shiny.
    pub(super) fn versions(&self) -> Vec<(&'static str, bool, bool)> {
        let mut out = Vec::new();
        if self.lighting != Lighting::Environment {
            out.push((VERSIONS[0], false, false));
        }
        if self.lighting != Lighting::Uniform {
            out.push((VERSIONS[1], true, false));
            if self.shiny {
                out.push((VERSIONS[2], true, true));
            }
        }
        out
    }

    /// All that decides an object's files, for continued runs and for readers. Files are known by name and bytes.
    ///
    /// # Errors
    /// When a file cannot be read.
    pub fn record(&self) -> Result<Map<String, Value>> {
        let names = |paths: &[PathBuf]| paths.iter().map(|p| io::identity(p)).collect::<Result<Vec<_>>>();
        let o = &self.map_options;
        let entries = [
            ("meshes", json!(names(&self.meshes)?)),
            ("maps", json!(names(&self.maps)?)),
            ("map_axes", json!([o.orientation.name(), o.mirror, o.rotate, o.scale])),
            ("lighting", json!(format!("{:?}", self.lighting).to_lowercase())),
            ("shiny", json!(self.shiny)),
            ("set", json!(format!("{:?}", self.set).to_lowercase())),
            ("camera", json!(self.model().name())),
            ("views", json!(self.pictures())),
            ("size", json!(self.size)),
            ("framing", json!(format!("{:?}", self.framing).to_lowercase())),
            ("samples", json!(self.samples)),
            ("bounces", json!(self.bounces)),
            ("texture", json!(self.texture)),
            ("map_width", json!(self.map_width)),
            ("passes", json!(self.passes)),
            ("truth", json!(self.truth)),
            ("seed", json!(self.seed)),
        ];
        let axes = self.axes.then(|| ("axes", json!(true)));
        Ok(entries.into_iter().chain(axes).map(|(k, v)| (k.to_owned(), v)).collect())
    }
}

/// What was made.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// Objects in the set.
    pub objects: usize,
    /// Pictures rendered by this run; the others were there.
    pub rendered: usize,
    /// Of everything written.
    pub digest: u64,
}

/// Makes the set in `dir`, object after object. `progress` is told pictures done, pictures in all, and which object is on.
///
/// # Errors
/// When a setting, a model or a map is not valid, a file cannot be written, `resume` meets other settings, or `stop` was set.
pub fn run(
    dir: &Path,
    settings: &Settings,
    resume: bool,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(usize, usize, &str),
) -> Result<Summary> {
    settings.validate()?;
    let per_object = settings.pictures() * settings.versions().len();
    let total = per_object * settings.objects as usize;
    let (mut listed, mut rendered, mut digest) = (Vec::new(), 0, crate::num::bits::Digest::new());
    let asked = settings.record()?;
    begin(dir, &asked, resume)?;
    for n in 0..settings.objects {
        let k = settings.first + n;
        let name = format!("object_{k:05}");
        let folder = dir.join(&name);
        let done = n as usize * per_object;
        let kept = if resume { finished(&folder, settings, &asked, k)? } else { None };
        let record = match kept {
            Some(record) => record,
            None => {
                let mut looked = 0;
                let (record, made) = one(dir, &folder, settings, &asked, k, resume, stop, &mut |label| {
                    progress(done + looked, total, &format!("{name} · {label}"));
                    looked += 1;
                })?;
                rendered += made;
                record
            }
        };
        digest.bytes(format!("{record:#}").as_bytes());
        listed.push(
            json!({ "folder": name, "shape": record["shape"]["name"], "versions": record["versions"] }),
        );
    }
    progress(total, total, "done");
    let digest = digest.value();
    let top = json!({
        "format": FORMAT, "complete": true, "settings": asked, "objects": listed, "digest": hex(digest),
    });
    atomic::write_bytes(&dir.join(RECORD), format!("{top:#}\n").as_bytes())?;
    Ok(Summary { objects: listed.len(), rendered, digest })
}

/// Makes what is missing of one object with all its versions; gives its record, and how many pictures were rendered.
fn one(
    dir: &Path,
    folder: &Path,
    settings: &Settings,
    asked: &Map<String, Value>,
    k: u64,
    resume: bool,
    stop: &AtomicBool,
    made: &mut dyn FnMut(&str),
) -> Result<(Value, usize)> {
    atomic::sweep(folder)?;
    let versions = settings.versions();
    let needs_map = versions.iter().any(|v| v.1);
    let (subject, light) = par::join(
        || Subject::new(settings, k),
        || if needs_map { Light::new(settings, k).map(Some) } else { Ok(None) },
    );
    let (subject, light) = (subject?, light?);
    announce(dir, asked)?;
    let bvh = Bvh::build(&subject.object.mesh.positions, &subject.object.mesh.triangles);
    let (shots, protocol) = shots(settings, k);
    let (mut records, mut rendered) = (Vec::new(), 0);
    for (version, under_map, is_shiny) in versions {
        let lights = match (&light, under_map) {
            (Some(light), true) => Lights { environment: Some(light.map.clone()), lamps: Vec::new() },
            _ => Lights {
                environment: Some(from_data_gen::environment(&data_gen::environments::uniform())),
                lamps: Vec::new(),
            },
        };
        let gloss = subject.gloss(settings.seed, k);
        let shiny: Option<Object> = is_shiny.then(|| subject.with_roughness(gloss));
        let object = shiny.as_ref().unwrap_or(&subject.object);
        let scene = Scene::new(object, &bvh, &lights)?;
        let capture = Capture { settings, k, scene: &scene, exposed: under_map };
        let recorder = Recorder::open(&folder.join(version), header(asked, k, version), resume)?;
        let (digest, count) = capture.shoot(recorder, &shots, stop, &mut || made(version))?;
        rendered += count;
        let mut record = json!({
            "folder": version,
            "lighting": if under_map { "environment" } else { "uniform" },
            "digest": hex(digest),
        });
        if is_shiny {
            record["roughness_factor"] = json!(f64::from(gloss));
        }
        records.push(record);
    }
    let mut record = json!({
        "object": k,
        "shape": subject.record,
        "vertices": subject.object.mesh.positions.len(),
        "triangles": subject.object.mesh.triangles.len(),
        "versions": records,
        "settings": asked,
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
    atomic::write_bytes(&folder.join("object.json"), format!("{record:#}\n").as_bytes())?;
    Ok((record, rendered))
}

/// The pictures of an object, and of a test set the order and choice of its inputs.
pub(super) fn shots(settings: &Settings, k: u64) -> (Vec<Shot>, Option<Value>) {
    let still = |i: usize, p: &Placed, split: Split| Shot {
        name: format!("{i:04}"),
        camera: from_data_gen::camera(&p.view, Model::Pinhole),
        shutter_close: None,
        split,
        extra: Map::from_iter([
            ("fov_deg".to_owned(), json!(p.fov)),
            ("azimuth_deg".to_owned(), json!(p.azimuth)),
            ("elevation_deg".to_owned(), json!(p.elevation)),
        ]),
    };
    match settings.set {
        Set::Train => {
            let views = cameras::training(settings.seed, k, settings.views, settings.size, settings.framing);
            (views.iter().enumerate().map(|(i, p)| still(i, p, Split::Unknown)).collect(), None)
        }
        Set::Test => {
            let t = cameras::test(settings.seed, k, settings.size);
            let split = |i: usize| {
                if t.inputs.contains(&i) {
                    Split::Train
                } else if t.outputs.contains(&i) {
                    Split::Test
                } else {
                    Split::Val
                }
            };
            let shots = t.views.iter().enumerate().map(|(i, p)| still(i, p, split(i))).collect();
            let names = |list: &[usize]| list.iter().map(|i| format!("{i:04}")).collect::<Vec<_>>();
            let sets = |list: &[usize]| list.chunks(4).map(names).collect::<Vec<_>>();
            let protocol = json!({
                "input_sets_random": sets(&t.inputs),
                "input_sets_sequential": sets(&t.sequential),
                "outputs": names(&t.outputs),
            });
            (shots, Some(protocol))
        }
        Set::Egocentric => {
            let shot = |(i, m): (usize, &cameras::Moving)| {
                let camera = |v| -> Camera { from_data_gen::camera(v, settings.camera) };
                Shot {
                    name: format!("{i:04}"),
                    camera: camera(&m.open),
                    shutter_close: Some(camera(&m.close)),
                    split: if i % 8 == 7 { Split::Test } else { Split::Train },
                    extra: Map::from_iter([("time_s".to_owned(), json!(m.time))]),
                }
            };
            let mut frames = cameras::head(settings.seed, k, settings.views, settings.size);
            if settings.camera == Model::Pinhole {
                frames = frames.into_iter().map(cameras::Moving::through_pinhole).collect();
            }
            (frames.iter().enumerate().map(shot).collect(), None)
        }
    }
}

/// One object under one light.
struct Capture<'a> {
    settings: &'a Settings,
    k: u64,
    scene: &'a Scene<'a>,
    /// Whether pictures are exposed one by one; under a white dome white stays white.
    exposed: bool,
}

impl Capture<'_> {
    /// Renders what is missing; each picture is written while the next one is rendered. `count` is called for every picture. Gives
    /// the digest of all of them, and how many were rendered.
    fn shoot(
        &self,
        mut recorder: Recorder,
        shots: &[Shot],
        stop: &AtomicBool,
        count: &mut dyn FnMut(),
    ) -> Result<(u64, usize)> {
        let mut rendered = 0;
        let mut ready: Option<(&Shot, Picture)> = None;
        for (i, shot) in shots.iter().enumerate() {
            count();
            if recorder.has(shot)? {
                continue;
            }
            let stopped = stop.load(Ordering::Relaxed);
            let waiting = ready.take();
            let (next, written) = par::join(
                || if stopped { Ok(None) } else { self.picture(i, shot).map(Some) },
                || waiting.map_or(Ok(()), |(shot, picture)| picture.put(&mut recorder, shot)),
            );
            written?;
            match next? {
                Some(picture) => {
                    rendered += 1;
                    ready = Some((shot, picture));
                }
                None => return Err(Error::interrupted("rendering").hint("continue with --resume")),
            }
        }
        if let Some((shot, picture)) = ready {
            picture.put(&mut recorder, shot)?;
        }
        Ok((recorder.finish(shots)?, rendered))
    }

    fn picture(&self, i: usize, shot: &Shot) -> Result<Picture> {
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
        Ok(Picture { passes, style: Style { exposure, transparent: false, passes: s.passes }, sensed })
    }
}

/// A picture that is to be written.
struct Picture {
    passes: Passes,
    style: Style,
    /// What a sensor makes of the exposed radiance; the photograph shows it, `radiance/` does not.
    sensed: Option<Vec<[f32; 3]>>,
}

impl Picture {
    fn put(&self, recorder: &mut Recorder, shot: &Shot) -> Result<()> {
        recorder.put_with(shot, &self.passes, &self.style, self.sensed.as_deref())
    }
}
