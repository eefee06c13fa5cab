//! Captures of persons: the published layouts, body models, and the project's own.

use super::{Base, Workshop};
use crate::mini_person::{KX, Mini, write_picture};
use crate::person_layouts as layouts;
use crate::tree::{self, Tree};
use lastlight::io::npz;
use std::path::Path;

const IMPORT: &str = "last import person --out out --body body.npz --threads 1 --quiet";
const IMPORT_ALONE: &str = "last import person --out out --threads 1 --quiet";
const IMPORT_PICKLE: &str = "last import person --out out --body body.pkl --threads 1 --quiet";

/// A layout in the folder `person`, a body model beside it.
fn layout(format: &'static str, command: &'static str, joints: usize, make: impl FnOnce(&Path)) -> Base {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let person = dir.path().join("person");
    std::fs::create_dir(&person).expect("made");
    make(&person);
    let mini = Mini::of(joints);
    npz::write(&dir.path().join("body.npz"), &mini.arrays()).expect("written");
    if joints != KX {
        std::fs::write(dir.path().join("body.pkl"), mini.pickle()).expect("written");
    }
    let files = tree::read(dir.path()).expect("readable");
    let damaged = of_each_kind(&files);
    Base::new(format, files, &damaged.iter().map(String::as_str).collect::<Vec<_>>(), &[command])
}

/// Everything but images, and the first image of each folder; the body models have a base of their own.
fn of_each_kind(files: &Tree) -> Vec<String> {
    let mut folders: Vec<&str> = Vec::new();
    let mut out = Vec::new();
    for name in files.keys().filter(|n| n.starts_with("person/") || n.starts_with("body_models/")) {
        let folder = name.rsplit_once('/').map_or("", |(folder, _)| folder);
        let is_image = [".png", ".jpg"].iter().any(|e| name.ends_with(e));
        if !is_image || !folders.contains(&folder) {
            out.push(name.clone());
        }
        if is_image {
            folders.push(folder);
        }
    }
    out
}

/// PeopleSnapshot with its images.
fn snapshot(dir: &Path) {
    let (truth, photographs) = layouts::snapshot(dir, 4);
    for (f, rgb) in photographs.iter().enumerate() {
        write_picture(&dir.join(format!("images/image_{f:04}.png")), truth.side, 3, rgb);
    }
}

/// MonoCap is recognised by the name of its folder, and holds out ten cameras by default.
const MONOCAP: &str = "last import person --layout monocap --train-camera 0 --test-camera 1 --train-frames 0:1:2 --test-frames 0:1:1 --out out \
                       --body body.npz --threads 1 --quiet";

pub(super) fn bases(shop: &Workshop) -> Vec<Base> {
    let body = layout("body models", IMPORT, 24, |dir| drop(layouts::zju(dir, false, 2, 1)));
    let body = Base {
        damaged: vec!["body.npz".into(), "body.pkl".into()],
        commands: vec!["last import person --out out --body {file} --threads 1 --quiet"],
        ..body
    };
    let mut all = vec![
        body.share(20),
        layout("ZJU-MoCap", IMPORT, 24, |dir| drop(layouts::zju(dir, false, 2, 2))),
        layout("ZJU-MoCap, refined", IMPORT, 24, |dir| drop(layouts::zju(dir, true, 6, 2))),
        layout("MonoCap", MONOCAP, 24, |dir| drop(layouts::monocap(dir))),
        layout("ARAH", IMPORT_ALONE, 24, |dir| drop(layouts::arah(dir))),
        layout("DNA-Rendering", IMPORT, KX, |dir| drop(layouts::dna(dir))),
        layout("PeopleSnapshot", IMPORT_PICKLE, 24, snapshot),
        layout("InstantAvatar", IMPORT, 24, |dir| drop(layouts::instant_avatar(dir))),
        layout("Anim-NeRF", IMPORT_ALONE, 24, |dir| drop(layouts::anim_nerf(dir))),
    ];
    shop.run(
        "last gen --scale smoke --split all --observational 8 --groups 2 --appearances 1 --body-points 64 --render-as points --frames 3 --test-cameras 1 \
         --set-size 64 --video-size 24 --samples 1 --out data --threads 1 --quiet",
    );
    let fit = "last fit data/video --out out --iterations 1 --max-gaussians 64 --threads 1 --quiet";
    let data = super::below("data", &shop.tree("data"));
    let mut video = data.clone();
    video.retain(|name, _| name.starts_with("data/video/"));
    let names =
        video.keys().filter(|n| n.ends_with(".json") || n.ends_with(".npz") || n.ends_with("_f0000.png"));
    let names: Vec<&str> = names.map(String::as_str).collect();
    let inspect = "last inspect data/video --out out --threads 1";
    all.push(Base::new("person capture", video.clone(), &names, &[fit, inspect, inspect]).share(20));
    let mut sets = data;
    sets.retain(|name, _| !name.starts_with("data/video/"));
    let names: Vec<&str> = sets.keys().map(String::as_str).collect();
    let pretrain = "last pretrain data --out out --iterations 3 --batch-images 4 --batch-groups 2 --batch-points 16 --factor-dim 2 --threads 1 --quiet";
    all.push(Base::new("LAST data set", sets.clone(), &names, &[pretrain]).share(5));
    all
}
