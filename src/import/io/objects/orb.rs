//! Stanford-ORB: one object in one scene, with held-out views, views in other scenes, and its ground truth.

use super::record::{Axes, Layout, ObjectSet, ObjectShot, Part, required, there};
use crate::io::capture::{Focal, Frame, Split, clean};
use crate::io::{json, name_of, read_bytes, transforms};
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// Longest list that is read, in bytes.
const MAX_BYTES: u64 = 64 << 20;

/// Folders of the two encodings of the images.
const ENCODED: [&str; 2] = ["blender_LDR", "blender_HDR"];

/// Whether a folder has the layout: training images with masks beside them.
pub(super) fn is_one(dir: &Path) -> bool {
    dir.join("transforms_train.json").is_file() && dir.join("train_mask").is_dir()
}

/// The folders that belong to an object in a scene.
struct Folders {
    /// Sets of images, LDR first, each with all scenes.
    sets: Vec<PathBuf>,
    /// Ground truth of all scenes.
    truth: PathBuf,
}

impl Folders {
    fn of(dir: &Path) -> Result<(Self, String)> {
        let dir = dir.canonicalize().map_err(|e| Error::os(dir, &e))?;
        let name = dir.file_name().and_then(|n| n.to_str());
        let parents = dir.parent().and_then(|set| Some((set, set.parent()?)));
        let (Some(name), Some((set, root))) = (name, parents) else {
            return Err(Error::input(name_of(&dir)).expected("a folder inside a set").got("the root"));
        };
        let mut sets: Vec<PathBuf> = ENCODED.iter().map(|n| root.join(n)).filter(|p| p.is_dir()).collect();
        if !sets.contains(&set.to_path_buf()) {
            sets = vec![set.to_path_buf()];
        }
        Ok((Self { sets, truth: root.join("ground_truth") }, name.to_owned()))
    }

    /// A file of a scene in the first set that has it.
    fn find(&self, scene: &str, relative: &str, ending: &str) -> Option<PathBuf> {
        let mut all = self.sets.iter().map(|s| s.join(scene).join(format!("{relative}.{ending}")));
        all.find(|p| p.is_file())
    }

    fn truth(&self, scene: &str, what: &str, file: &str, endings: &[&str]) -> Option<PathBuf> {
        let folder = self.truth.join(scene).join(what);
        endings.iter().find_map(|e| there(folder.join(format!("{file}.{e}"))))
    }
}

/// One of the lists.
struct List<'a> {
    path: &'a Path,
    folders: &'a Folders,
    /// The scene of the folder.
    scene: &'a str,
}

pub(super) fn read(dir: &Path) -> Result<ObjectSet> {
    let (folders, scene) = Folders::of(dir)?;
    let mut shots = Vec::new();
    for (file, part) in [
        ("transforms_train.json", Part::Own(Split::Train)),
        ("transforms_test.json", Part::Own(Split::Test)),
        ("transforms_novel.json", Part::Novel),
    ] {
        let path = dir.join(file);
        if path.is_file() || part == Part::Own(Split::Test) {
            shots.extend(List { path: &path, folders: &folders, scene: &scene }.shots(part)?);
        }
    }
    let scan = there(folders.truth.join(&scene).join("mesh_blender").join("mesh.obj"));
    Ok(ObjectSet { layout: Layout::Orb, shots, scan })
}

impl List<'_> {
    fn shots(&self, part: Part) -> Result<Vec<ObjectShot>> {
        let name = name_of(self.path);
        let bytes = read_bytes(self.path, MAX_BYTES)?;
        let frames = transforms::parse(&bytes, &name)?.frames;
        let value = json::parse(&bytes, &name)?;
        let scene_of = |i: usize| -> Result<String> {
            let wrong = |got: String| {
                let e = Error::input(name.clone()).at(format!("frames[{i}].scene_name"));
                e.expected("the name of the scene of the image, a folder").got(got)
            };
            match value["frames"][i].get("scene_name") {
                None if part == Part::Novel => Err(wrong("nothing".into())),
                None => Ok(self.scene.to_owned()),
                Some(v) => match v.as_str().and_then(|s| clean(s).ok()).filter(|s| !s.contains('/')) {
                    Some(scene) => Ok(scene),
                    None => Err(wrong(v.to_string().chars().take(60).collect())),
                },
            }
        };
        frames.iter().enumerate().map(|(i, f)| self.shot(f, i, &scene_of(i)?, part)).collect()
    }

    fn shot(&self, frame: &Frame, index: usize, scene: &str, part: Part) -> Result<ObjectShot> {
        let at = format!("frames[{index}], '{}'", frame.name);
        let relative = frame.name.strip_suffix(".png").or_else(|| frame.name.strip_suffix(".exr"));
        let relative = relative.unwrap_or(&frame.name);
        let wrong = |expected: &str, got: String| {
            Error::input(name_of(self.path)).at(at.clone()).expected(expected).got(got)
        };
        let (folder, file) = relative
            .rsplit_once('/')
            .ok_or_else(|| wrong("a path with its folder, such as train/0001", relative.to_owned()))?;
        let Focal::Angles(fov_x_rad, None) = frame.focal else {
            return Err(wrong("camera_angle_x, for square pixels", format!("{:?}", frame.focal)));
        };
        if !frame.lens.is_ideal() || frame.center.is_some() {
            return Err(wrong(
                "an ideal pinhole with its principal point in the centre",
                "another lens".into(),
            ));
        }
        let find = |relative: &str, ending: &str| self.folders.find(scene, relative, ending);
        let (photo, radiance) = (find(relative, "png"), find(relative, "exr"));
        if photo.is_none() && radiance.is_none() {
            let wanted = self.folders.sets[0].join(scene).join(format!("{relative}.png"));
            required(wanted, self.path, &at)?;
        }
        let mask = format!("{folder}_mask/{file}");
        let mask = match find(&mask, "png") {
            Some(mask) => mask,
            None => required(self.folders.sets[0].join(scene).join(format!("{mask}.png")), self.path, &at)?,
        };
        let is_test = part == Part::Own(Split::Test);
        let truth =
            |what: &str, endings: &[&str]| self.folders.truth(scene, what, file, endings).filter(|_| is_test);
        let name = match part {
            Part::Novel => format!("{scene}_{file}"),
            Part::Own(_) => format!("{folder}_{file}"),
        };
        Ok(ObjectShot {
            name: name.replace('/', "_"),
            part,
            exposure: radiance.as_ref().map(|_| 1.0),
            photo,
            radiance,
            mask,
            view_from_world: frame.view_from_world,
            fov_x_rad,
            size: frame.size,
            depth: truth("z_depth", &["npy"]),
            normal: truth("surface_normal", &["npy"]),
            normal_axes: Axes::Camera,
            albedo: truth("pseudo_gt_albedo", &["png", "npy"]),
            material: None,
            environment: self
                .folders
                .truth(scene, "env_map", file, &["exr", "hdr"])
                .filter(|_| part != Part::Own(Split::Train)),
        })
    }
}
