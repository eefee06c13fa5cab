//! What the program writes and reads again: models, avatars, checkpoints and records.

use super::{Base, Workshop, below, files, scenes};
use crate::long::TINY;
use crate::samples;
use crate::tree::Tree;

/// A finished run in `run/`, its inputs, and the command that continues it; `make` is that command without `--resume`.
fn resumed(
    shop: &Workshop,
    format: &'static str,
    make: &'static str,
    resume: &'static str,
    inputs: &[&str],
    damaged: &[&str],
) -> Base {
    crate::tree::remove(&shop.dir.join("run")).expect("removed");
    shop.run(make);
    let mut all = below("run", &shop.tree("run"));
    for input in inputs {
        all.extend(below(input, &shop.tree(input)));
    }
    Base { same_digest: true, ..Base::new(format, all, damaged, &[resume]) }
}

/// A small LIRM model, its training, and a state of it; beside images of an object in `object/`.
fn lirm(shop: &Workshop) -> Vec<Base> {
    const CAPTURE: &str = "object/object_00000/uniform";
    let train = "lirm train --stage 1a --config sizes/tiny.json --iterations 2 --batch 1 --objects-at-once 1 --checkpoint-every 1 --out run --threads 1 --json --quiet";
    let resume = "lirm train --stage 1a --config sizes/tiny.json --iterations 2 --batch 1 --objects-at-once 1 --checkpoint-every 1 --out run --threads 1 --json --quiet --resume";
    let read = "lirm reconstruct object/object_00000/uniform --model {file} --ray-samples 16 --out out --threads 1 --quiet";
    let update = "lirm update {file} object/object_00000/uniform --model model.safetensors --ray-samples 16 --out out --threads 1 --quiet";
    crate::tree::write(&shop.dir.join("sizes"), &files(&[("tiny.json", TINY.as_bytes())])).expect("written");
    let of_training =
        resumed(shop, "checkpoint of lirm train", train, resume, &["sizes"], &["run/checkpoint.safetensors"]);
    let model = files(&[("model.safetensors", &shop.bytes("run/model.safetensors"))]);
    let photos = below(CAPTURE, &shop.tree(CAPTURE));
    let with_photos: Tree = photos.into_iter().chain(model).collect();
    let of_model = Base::new("LIRM model", with_photos.clone(), &["model.safetensors"], &[read]);
    shop.run("lirm reconstruct object/object_00000/uniform --model run/model.safetensors --ray-samples 16 --out state --threads 1 --quiet");
    let state = files(&[("state.safetensors", &shop.bytes("state/state.safetensors"))]);
    let with_state = with_photos.into_iter().chain(state).collect();
    let of_state = Base::new("LIRM state", with_state, &["state.safetensors"], &[update]);
    vec![of_training.share(1), of_model.share(5), of_state.share(5)]
}

pub(super) fn bases(shop: &Workshop) -> Vec<Base> {
    let photos = files(&[("transforms.json", &samples::transforms(3))]);
    let images = (0..3).map(|i| (format!("images/{i:04}.png"), samples::png(16, 12, 3)));
    let capture: Tree = photos.into_iter().chain(images).collect();
    crate::tree::write(&shop.dir.join("photos"), &capture).expect("written");
    crate::tree::write(&shop.dir, &files(&[("scene.ply", &scenes::scene_ply())])).expect("written");
    let splat = "splat fit photos --iterations 4 --initial 20 --max-gaussians 60 --checkpoint-every 2 --out run --threads 1 --json --quiet";
    let splat_resume = "splat fit photos --iterations 4 --initial 20 --max-gaussians 60 --checkpoint-every 2 --out run --threads 1 --json --quiet --resume";
    let fit = "last fit data/video --iterations 4 --max-gaussians 64 --checkpoint-every 2 --out run --threads 1 --json --quiet";
    let fit_resume = "last fit data/video --iterations 4 --max-gaussians 64 --checkpoint-every 2 --out run --threads 1 --json --quiet --resume";
    let object = "field fit object/object_00000/uniform --iterations 4 --side 8 --channels 2 --ray-samples 16 --crop-side 16 --crops 1 --checkpoint-every 2 --out run --threads 1 --json --quiet";
    let object_resume = "field fit object/object_00000/uniform --iterations 4 --side 8 --channels 2 --ray-samples 16 --crop-side 16 --crops 1 --checkpoint-every 2 --out run --threads 1 --json --quiet --resume";
    let train = "last pretrain data --iterations 3 --batch-images 4 --batch-groups 2 --batch-points 16 --factor-dim 2 --out run --threads 1 --json --quiet";
    let train_resume = "last pretrain data --iterations 3 --batch-images 4 --batch-groups 2 --batch-points 16 --factor-dim 2 --out run --threads 1 --json --quiet --resume";
    let objects = "lirm gen --objects 1 --views 1 --size 8 --samples 1 --bounces 0 --texture 32 --passes photo --out run --threads 1 --json --quiet";
    let objects_resume = "lirm gen --objects 1 --views 1 --size 8 --samples 1 --bounces 0 --texture 32 --passes photo --out run --threads 1 --json --quiet --resume";
    let persons = "last gen --scale smoke --split video --body-points 64 --frames 2 --test-cameras 1 --video-size 8 --samples 1 --out run --threads 1 --json --quiet";
    let persons_resume = "last gen --scale smoke --split video --body-points 64 --frames 2 --test-cameras 1 --video-size 8 --samples 1 --out run --threads 1 --json --quiet --resume";
    let state = "run/checkpoint.safetensors";
    let mut all = vec![
        resumed(shop, "checkpoint of splat fit", splat, splat_resume, &["photos"], &[state]).share(20),
        resumed(shop, "checkpoint of last fit", fit, fit_resume, &["data/video"], &[state]).share(20),
    ];
    let fitted = below("run", &shop.tree("run"));
    shop.run("lirm gen --views 4 --size 16 --samples 1 --bounces 0 --texture 32 --no-truth --framing whole --out object --threads 1 --quiet");
    let photos = ["object/object_00000/uniform"];
    all.push(resumed(shop, "checkpoint of field fit", object, object_resume, &photos, &[state]).share(5));
    let field = files(&[("field.safetensors", &shop.bytes("run/field.safetensors"))]);
    let bake = "field mesh {file} --side 33 --texture 64 --out out.glb --threads 1 --quiet";
    all.push(Base::new("field", field, &["field.safetensors"], &[bake]));
    all.extend(lirm(shop));
    all.push(resumed(shop, "checkpoint of last pretrain", train, train_resume, &["data"], &[state]).share(2));
    let model = shop.bytes("run/model.safetensors");
    let video = below("data/video", &shop.tree("data/video"));
    all.push(resumed(
        shop,
        "record of lirm gen",
        objects,
        objects_resume,
        &[],
        &["run/dataset.json", "run/object_00000/object.json"],
    ));
    all.push(resumed(
        shop,
        "record of last gen",
        persons,
        persons_resume,
        &[],
        &["run/dataset.json", "run/video/transforms_train.json"],
    ));
    let avatar: Tree = fitted.into_iter().chain(video.clone()).collect();
    let render = "last render run --cameras orbit:1 --pose 0 --size 8x8 --out out --threads 1 --quiet";
    let eval = "last eval run data/video --threads 1 --quiet";
    all.push(Base::new("avatar", avatar, &["run/avatar.safetensors"], &[render, eval]));
    let trained: Tree = video.into_iter().chain([("model.safetensors".to_owned(), model)]).collect();
    let tune =
        "last tune model.safetensors data/video --iterations 1 --out out.safetensors --threads 1 --quiet";
    let intervene = "last intervene model.safetensors data/video --out out --threads 1 --quiet";
    all.push(Base::new("trained model", trained, &["model.safetensors"], &[tune, intervene]).share(5));
    all
}
