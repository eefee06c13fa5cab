//! The README and the book: every command line parses, and every line of the README's listings is run on small data, or is listed here
//! with the reason why it is not.

use crate::program::{code, lastlight, stderr, stdout};
use lastlight::io::npz;
use lastlight::num::array::Array;
use std::path::Path;

const README: &str = include_str!("../../README.md");
/// What precedes the listing of the output of `oracle compare`.
const PRINTS: &str = "`oracle compare mine.npz ours.npz` prints:";

/// Chapters with listings.
const BOOK: [(&str, &str); 17] = [
    ("adjoint_of_blending", include_str!("../../src/book/adjoint_of_blending.md")),
    ("bibliography", include_str!("../../src/book/bibliography.md")),
    ("bit_contract", include_str!("../../src/book/bit_contract.md")),
    ("conventions", include_str!("../../src/book/conventions.md")),
    ("field", include_str!("../../src/book/field.md")),
    ("field_adjoint", include_str!("../../src/book/field_adjoint.md")),
    ("fitting", include_str!("../../src/book/fitting.md")),
    ("formats", include_str!("../../src/book/formats.md")),
    ("known_truth", include_str!("../../src/book/known_truth.md")),
    ("learned_causes", include_str!("../../src/book/learned_causes.md")),
    ("light_and_rays", include_str!("../../src/book/light_and_rays.md")),
    ("meshes", include_str!("../../src/book/meshes.md")),
    ("notation", include_str!("../../src/book/notation.md")),
    ("one_gaussian", include_str!("../../src/book/one_gaussian.md")),
    ("oracle_and_gradcheck", include_str!("../../src/book/oracle_and_gradcheck.md")),
    ("profiles", include_str!("../../src/book/profiles.md")),
    ("mod", include_str!("../../src/book/mod.rs")),
];

/// Lines of the README, and how they are run in one folder after the lines of `setup`: the same with smaller data, in this order.
struct Session {
    setup: &'static [&'static str],
    lines: &'static [(&'static str, &'static str)],
}

const SCENE: &[&str] = &["oracle mint splat.render --out cases"];
const SMALL_FIT: &str = "splat fit PHOTOS --out fit --iterations 30 --initial 200";

const SESSIONS: [Session; 8] = [
    Session {
        setup: &[],
        lines: &[
            ("lastlight doctor", "doctor"),
            ("lastlight oracle list", "oracle list"),
            ("lastlight oracle show splat.render", "oracle show splat.render"),
            ("lastlight oracle mint splat.render --out cases", "oracle mint splat.render --out cases"),
            (
                "lastlight oracle run splat.render --in cases/splat.render_0.npz --out ours.npz --dump",
                "oracle run splat.render --in cases/splat.render_0.npz --out ours.npz --dump",
            ),
            (
                "lastlight oracle compare ours.npz cases/splat.render_0.npz --html report.html",
                "oracle compare ours.npz cases/splat.render_0.npz --html report.html",
            ),
        ],
    },
    Session {
        setup: &[
            SCENE[0],
            "splat render cases/splat.render_0.npz --cameras orbit:8 --size 24x24 --out PHOTOS",
        ],
        lines: &[
            ("lastlight splat fit PHOTOS --out fit", SMALL_FIT),
            ("lastlight splat fit --out fit --resume", "splat fit --out fit --resume"),
            (
                "lastlight splat render fit --cameras orbit:36 --out turntable",
                "splat render fit --cameras orbit:3 --size 24x24 --out turntable",
            ),
            (
                "lastlight splat render theirs.ply --cameras orbit:36 --up -y --out around",
                "splat render fit/scene.ply --cameras orbit:3 --up -y --size 24x24 --out around",
            ),
            ("lastlight splat eval fit/scene.ply PHOTOS", "splat eval fit/scene.ply PHOTOS"),
        ],
    },
    Session {
        setup: &[SCENE[0], "convert cases/splat.render_0.npz demo/scene/scene.ply"],
        lines: &[
            (
                "lastlight splat render demo/scene --cameras orbit:36 --size 240x180 --out turntable",
                "splat render demo/scene --cameras orbit:8 --size 24x24 --out turntable",
            ),
            (
                "lastlight splat fit turntable --out fit --iterations 1500",
                "splat fit turntable --out fit --iterations 30 --initial 200",
            ),
        ],
    },
    Session {
        setup: &[
            SCENE[0],
            "splat render cases/splat.render_0.npz --cameras orbit:8 --size 24x24 --out scene",
        ],
        lines: &[
            (
                "lastlight splat fit scene --out fit",
                "splat fit scene --out fit --iterations 30 --initial 200",
            ),
            (
                "lastlight splat fit scene --images photos --out fit",
                "splat fit scene --images scene --out other --iterations 3 --initial 200",
            ),
            (
                "lastlight splat render fit --cameras orbit:36 --out turntable",
                "splat render fit --cameras orbit:3 --size 24x24 --out turntable",
            ),
        ],
    },
    Session {
        setup: &[],
        lines: &[
            (
                "lastlight last gen --scale smoke --appearances 1 --out person",
                "last gen --scale smoke --appearances 1 --out person --observational 24 --groups 8 --body-points 128 --frames 3 \
                 --test-cameras 1 --render-as points",
            ),
            ("lastlight last inspect person --out check", "last inspect person --out check"),
            (
                "lastlight last pretrain person --out model --iterations 1000",
                "last pretrain person --out model --iterations 3 --batch-images 12 --batch-groups 4 --batch-points 32 --factor-dim 2",
            ),
            (
                "lastlight last tune model/model.safetensors person/video --out tuned.safetensors",
                "last tune model/model.safetensors person/video --out tuned.safetensors --iterations 2",
            ),
            (
                "lastlight last intervene tuned.safetensors person/video --out do",
                "last intervene tuned.safetensors person/video --out do",
            ),
            (
                "lastlight last fit person/video --out fit --model tuned.safetensors",
                "last fit person/video --out fit --model tuned.safetensors --iterations 4",
            ),
            (
                "lastlight last render fit --cameras orbit:36 --pose 5 --out around",
                "last render fit --cameras orbit:3 --pose 1 --out around",
            ),
            ("lastlight last eval fit person/video", "last eval fit person/video"),
        ],
    },
    Session {
        setup: &[],
        lines: &[
            (
                "lastlight lirm gen --objects 1 --size 128 --framing whole --out object",
                "lirm gen --objects 1 --size 16 --framing whole --out object --views 8 --samples 2 --texture 32",
            ),
            (
                "lastlight field fit object/object_00000/uniform --out field",
                "field fit object/object_00000/uniform --out field --iterations 4 --side 8 --channels 2 --ray-samples 16 --crop-side 16 \
                 --crops 1",
            ),
            (
                "lastlight field eval field object/object_00000/uniform --mesh object/object_00000/object.glb",
                "field eval field object/object_00000/uniform --mesh object/object_00000/object.glb",
            ),
            (
                "lastlight field mesh field --out object.glb",
                "field mesh field --out object.glb --side 33 --texture 64",
            ),
            (
                "lastlight field relight object.glb --env studio --cameras orbit:8 --out relit",
                "field relight object.glb --env studio --cameras orbit:2 --size 16 --samples 1 --out relit",
            ),
            ("lastlight mesh view object.glb --out page", "mesh view object.glb --out page"),
        ],
    },
    Session {
        setup: &[],
        lines: &[
            (
                "lastlight lirm gen --cameras test --size 128 --seed 2 --out unseen",
                "lirm gen --cameras test --size 64 --seed 2 --out unseen --samples 1 --texture 32",
            ),
            (
                "lastlight lirm reconstruct unseen/object_00000/uniform --inputs 0017,0025,0035,0043 --out r1",
                "lirm reconstruct unseen/object_00000/uniform --inputs 0017,0025,0035,0043 --out r1 --ray-samples 16",
            ),
            (
                "lastlight lirm update r1 unseen/object_00000/uniform --inputs 0020,0029,0038,0046 --out r2",
                "lirm update r1 unseen/object_00000/uniform --inputs 0020,0029,0038,0046 --out r2 --ray-samples 16",
            ),
            ("lastlight lirm eval --sets 2", "lirm eval --objects 1 --sets 1 --samples 1 --ray-samples 16"),
        ],
    },
    Session {
        setup: &[],
        lines: &[(
            "lastlight lirm gen --objects 2 --size 128 --lighting both --out objects",
            "lirm gen --objects 2 --size 16 --lighting both --out objects --views 2 --samples 2",
        )],
    },
];

/// Lines that are not run here, and why.
const MARKED: [(&str, &str); 22] = [
    ("cargo run --release -- demo", "a minute; `report.rs` runs it smaller"),
    ("cargo test --release --workspace", "runs this test"),
    ("cargo build --release", "builds this program"),
    ("export PATH=\"$PWD/target/release:$PATH\"", "a setting of the shell"),
    (
        "lastlight gradcheck --exec 'python3 mine.py' --in case.npz",
        "needs Python with NumPy; `oracle.rs` runs a shell script",
    ),
    ("lastlight gradcheck --all", "minutes; `tests/operators/gradients.rs` checks all operators"),
    ("cargo doc --no-deps --open", "opens a browser; `.ci/run` builds the documentation"),
    ("cargo run --release --example render_one_gaussian", "an example: compiled with the tests"),
    ("cargo run --release --example check_my_gradient", "an example: compiled with the tests"),
    ("cargo run --release --example oracle_roundtrip", "an example: compiled with the tests"),
    ("mkdir -p scene/images", "of the shell"),
    ("mkdir -p scene", "of the shell"),
    ("colmap automatic_reconstructor --workspace_path scene --image_path photos --dense 0", "needs COLMAP"),
    ("ffmpeg -i phone.mp4 -vf fps=2 -q:v 2 scene/images/%04d.jpg", "needs ffmpeg and a video"),
    (
        "colmap feature_extractor --database_path scene/database.db --image_path scene/images --ImageReader.single_camera 1 \
         --ImageReader.camera_model OPENCV",
        "needs COLMAP",
    ),
    ("colmap sequential_matcher --database_path scene/database.db", "needs COLMAP"),
    ("mkdir scene/sparse", "of the shell"),
    (
        "colmap mapper --database_path scene/database.db --image_path scene/images --output_path scene/sparse",
        "needs COLMAP",
    ),
    (
        "lastlight last gen --character Knight.glb --animation Walking_A --split all --out knight",
        "needs a character that is not included",
    ),
    ("lastlight last study E7 --out study --scale quick", "minutes; `cli_study.rs` runs a smaller study"),
    ("lastlight mesh render model.glb --env probe.hdr --out relit", "`mesh_cli` runs it"),
    ("lastlight mesh compare ours.glb theirs.obj", "`mesh_cli` runs it"),
];

/// The first line after `PRINTS` up to the end of the listing.
fn shown() -> &'static str {
    let (_, rest) = README.split_once(PRINTS).expect("the README shows what `oracle compare` prints");
    let (_, block) = rest.split_once("```text\n").expect("a listing");
    block.split_once("```").expect("its end").0
}

/// Commands of the listings of the README, without the comments to their right.
fn listed() -> Vec<&'static str> {
    let mut lines = Vec::new();
    let mut inside = false;
    for line in README.replace(shown(), "").lines() {
        if line.starts_with("```") {
            inside = line == "```text";
        } else if inside && !line.is_empty() {
            let command = line.split("  ").next().expect("a first part").trim_end();
            let at = README.find(command).expect("a part of the README");
            lines.push(&README[at..at + command.len()]);
        }
    }
    lines
}

/// A command line as a shell splits it; only plain words and '…' occur.
fn words(line: &str) -> Vec<String> {
    let mut out = vec![String::new()];
    let mut quoted = false;
    for c in line.chars() {
        match c {
            '\'' => quoted = !quoted,
            ' ' if !quoted => out.push(String::new()),
            _ => out.last_mut().expect("one at least").push(c),
        }
    }
    out.retain(|word| !word.is_empty() && word != "…");
    out
}

/// Every `lastlight …` of a text: whole lines (complete commands), and pieces in code font or in quotation marks.
fn mentioned(text: &str) -> Vec<(String, bool)> {
    let mut out = Vec::new();
    for prefix in ["lastlight ", "cargo run --release -- "] {
        for (at, _) in text.match_indices(prefix) {
            let rest = &text[at + prefix.len()..];
            let end = match text[..at].chars().last() {
                None | Some('\n') => rest.find("  ").into_iter().chain(rest.find('\n')).min(),
                Some(mark @ ('`' | '"')) => rest.find(mark),
                _ => continue,
            };
            let line = rest[..end.unwrap_or(rest.len())].replace('\n', " ");
            out.push((line, !matches!(text[..at].chars().last(), Some('`'))));
        }
    }
    out
}

#[test]
fn every_command_line_of_readme_and_book_parses() {
    let mut parsed = 0;
    for (name, text) in [("README", README)].into_iter().chain(BOOK) {
        for (line, complete) in mentioned(text) {
            if line.starts_with("COMMAND") {
                continue;
            }
            let line = line.replace(" OP", " nn.linear");
            let all = std::iter::once("lastlight".to_owned()).chain(words(&line));
            if let Err(e) = lastlight_cli::command().try_get_matches_from(all) {
                let kind = format!("{:?}", e.kind());
                // In the text, a command may be named without all of its arguments.
                // A run that is resumed has its arguments in its folder.
                let partial = (!complete || line.contains("--resume")) && kind.starts_with("Missing");
                assert!(partial || kind.starts_with("Display"), "{name}: lastlight {line}\n{e}");
            }
            parsed += 1;
        }
    }
    assert!(parsed > 40, "the lines are found: {parsed}");
}

#[test]
fn every_line_of_the_readme_is_run_or_marked() {
    let known = || {
        let run = SESSIONS.iter().flat_map(|s| s.lines).map(|(line, _)| *line);
        run.chain(MARKED.iter().map(|(line, _)| *line))
    };
    let listed = listed();
    for line in &listed {
        assert!(known().any(|k| k == *line), "neither run nor marked: {line}");
    }
    for line in known() {
        assert!(listed.contains(&line), "no longer in the README: {line}");
    }
}

fn run(line: &str, dir: &Path) {
    let all = words(line);
    let all: Vec<&str> = all.iter().map(String::as_str).collect();
    let o = lastlight(&all, dir);
    assert_eq!(code(&o), 0, "{line}: {}", stderr(&o));
}

#[test]
fn the_readme_runs_on_small_data() {
    for session in &SESSIONS {
        let work = tempfile::tempdir().expect("a folder");
        std::fs::create_dir_all(work.path().join("demo/scene")).expect("a folder");
        session.setup.iter().for_each(|line| run(line, work.path()));
        for (listed, small) in session.lines {
            let same = |line: &str| words(line).into_iter().take(2).collect::<Vec<_>>();
            let command = listed.strip_prefix("lastlight ").expect("a command of this program");
            assert_eq!(same(command), same(small), "the same command");
            run(small, work.path());
        }
    }
}

/// The gradient of the weights has the wrong sign.
#[test]
fn the_readme_shows_what_compare_prints() {
    let work = tempfile::tempdir().expect("a folder");
    let dir = work.path();
    run("oracle mint nn.linear --out cases", dir);
    run("oracle run nn.linear --in cases/nn.linear_0.npz --out ours.npz", dir);
    let mut arrays = npz::read(&dir.join("ours.npz")).expect("arrays");
    let bar = arrays.0.get_mut("weight_bar").expect("a gradient");
    let (shape, values) = (bar.shape().to_vec(), bar.to_f64());
    *bar = Array::new::<f32>(&shape, values.iter().map(|x| -x as f32).collect());
    npz::write(&dir.join("mine.npz"), &arrays).expect("written");
    let o = lastlight(&["oracle", "compare", "mine.npz", "ours.npz"], dir);
    assert_eq!(code(&o), 1, "they differ: {}", stderr(&o));
    assert_eq!(shown().trim_end(), stdout(&o).trim_end(), "the listing in the README is the output");
}
