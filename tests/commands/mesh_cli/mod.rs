//! `mesh render` and `mesh compare` on the command line: what they write, print, refuse, continue and start
//! over; and the light of `lirm gen` with default options.

mod compare;
mod field;
mod refusals;
mod render;
mod resume;
mod view;

use crate::program::{self, code, lastlight, stderr, stdout};
use crate::samples::gltf;
use lastlight::io::image_file;
use std::path::Path;

/// Runs, expects success and returns stdout.
fn done(args: &[&str], dir: &Path) -> String {
    let o = lastlight(args, dir);
    assert_eq!(code(&o), 0, "{args:?}: {}", stderr(&o));
    stdout(&o)
}

/// Runs and expects exit code 2 and one error line with all of `parts`; what `--out` names is not made.
fn refused(args: &[&str], dir: &Path, parts: &[&str]) {
    let out = args.iter().position(|a| *a == "--out").map(|i| dir.join(args[i + 1]));
    let there = out.as_ref().is_some_and(|o| o.exists());
    program::refused(args, dir, 2, parts);
    assert_eq!(out.is_some_and(|o| o.exists()), there, "{args:?}: a refused command makes no folder");
}

fn write(path: &Path, bytes: impl AsRef<[u8]>) {
    std::fs::write(path, bytes).expect("written");
}

/// A cube of edge 2·`half` about the origin, with a material library and a texture of `red` beside it.
fn write_cube(dir: &Path, half: f64, red: u8) {
    let mut text = String::from("mtllib cube.mtl\nusemtl paint\nvt 0 0\nvt 1 0\nvt 0 1\nvt 1 1\n");
    for k in 0..8 {
        let side = |bit: usize| if k >> bit & 1 == 1 { half } else { -half };
        text += &format!("v {} {} {}\n", side(0), side(1), side(2));
    }
    // Counter-clockwise from outside.
    for [a, b, c, d] in [[1, 3, 4, 2], [5, 6, 8, 7], [1, 2, 6, 5], [3, 7, 8, 4], [1, 5, 7, 3], [2, 4, 8, 6]] {
        text += &format!("f {a}/1 {b}/2 {c}/4 {d}/3\n");
    }
    write(&dir.join("cube.obj"), text);
    write(&dir.join("cube.mtl"), "newmtl paint\nmap_Kd paint.png\n");
    write_paint(dir, red);
}

fn write_paint(dir: &Path, red: u8) {
    image_file::write_png(&dir.join("paint.png"), 2, 2, 3, &[red; 12]).expect("a texture");
}

/// A panorama of one row of four colours, as bright as `level`.
fn write_panorama(path: &Path, level: f32) {
    let data: Vec<f32> = (0..24).map(|i| level * (0.2 + 0.1 * i as f32)).collect();
    image_file::write_exr(path, 4, 2, &["R", "G", "B"], &data).expect("a panorama");
}

pub(crate) fn workplace() -> tempfile::TempDir {
    let dir = tempfile::tempdir().expect("a folder");
    write_cube(dir.path(), 0.5, 200);
    write_panorama(&dir.path().join("sky.exr"), 1.0);
    dir
}

/// A tiny run of the cube under the panorama.
const TINY: [&str; 12] = [
    "mesh",
    "render",
    "cube.obj",
    "--env",
    "sky.exr",
    "--size",
    "20x16",
    "--samples",
    "4",
    "--bounces",
    "1",
    "--quiet",
];

/// [`TINY`] with two views, unless `more` has cameras of its own.
fn tiny<'a>(more: &[&'a str]) -> Vec<&'a str> {
    let cameras: &[&str] = if more.contains(&"--cameras") { &[] } else { &["--cameras", "orbit:2"] };
    TINY.iter().chain(cameras).chain(more).copied().collect()
}

#[test]
fn help_has_examples() {
    let dir = tempfile::tempdir().expect("a folder");
    for command in ["render", "compare"] {
        let o = lastlight(&["mesh", command, "--help"], dir.path());
        let text = String::from_utf8(o.stdout).expect("text");
        assert_eq!(o.status.code(), Some(0), "{command}");
        assert!(text.contains("Examples:") && text.contains(&format!("lastlight mesh {command} ")), "{text}");
        assert!(o.stderr.is_empty(), "{command}: help is printed to stdout");
    }
    let text = done(&["mesh", "render", "--help"], dir.path());
    for word in ["--env-axes", "axes", "mitsuba", "--resume", "--force", "orbit:N"] {
        assert!(text.contains(word), "'{word}' in the help");
    }
    assert!(
        !text.contains("orb,") && !text.contains("orb]"),
        "no axes that the command line cannot express: {text}"
    );
}

/// The lines of the README on meshes, verbatim.
#[test]
fn the_lines_of_the_readme_run() {
    let work = workplace();
    let dir = work.path();
    let glb = gltf::triangle().glb();
    write(&dir.join("model.glb"), &glb);
    write(&dir.join("ours.glb"), &glb);
    write(&dir.join("theirs.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let mut probe = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n".to_vec();
    probe.extend([128, 120, 90, 129].repeat(8));
    write(&dir.join("probe.hdr"), probe);
    let mut ran = 0;
    // `mesh view` belongs to the section on objects, whose lines are one session of `readme`.
    let lines = include_str!("../../../README.md")
        .lines()
        .filter(|l| l.starts_with("lastlight mesh ") && !l.contains(" view "));
    for line in lines {
        let command = line.split("  ").next().expect("a line").split_whitespace().skip(1);
        done(&command.collect::<Vec<_>>(), dir);
        ran += 1;
    }
    assert_eq!(ran, 2, "both commands are in the README");
    assert!(dir.join("relit/transforms.json").is_file(), "a relit image");
}
