//! Hostile and damaged input: bombs, links, control characters, limits of the system.

use crate::mesh_cli::workplace;
use crate::program::{code, json, lastlight, refused, stderr, stdout};
use lastlight::io::{image_file, npz};
use lastlight::num::array::Arrays;
use lastlight::scene::convert::{read_scene, write_scene};
use lastlight::scene::gaussians::Gaussians;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use zip::write::SimpleFileOptions;

/// A scene of `n` Gaussians.
fn scene(n: usize) -> Gaussians {
    Gaussians {
        means: (0..n).map(|i| [i as f32, 0.0, 1.0]).collect(),
        quats: vec![[1.0, 0.0, 0.0, 0.0]; n],
        scales_log: vec![[-2.0; 3]; n],
        opacity_logits: vec![1.0; n],
        sh: vec![0.5; 3 * n],
        sh_degree: 0,
    }
}

/// Runs the program and watches the largest memory it ever held, in bytes; 0 where the system does not state it.
fn watched(args: &[&str], dir: &Path) -> (Output, u64) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_lastlight"))
        .args(args)
        .current_dir(dir)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the binary starts");
    let status = format!("/proc/{}/status", child.id());
    let mut most = 0;
    while child.try_wait().expect("a child").is_none() {
        let text = std::fs::read_to_string(&status).unwrap_or_default();
        let peak = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        let kib = peak.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok());
        most = Ord::max(most, kib.unwrap_or(0) * 1024);
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    if most == 0 {
        eprintln!("skipped: this system does not state the memory of a process");
    }
    (child.wait_with_output().expect("it ends"), most)
}

/// Adds a deflated member of `bytes` zeros, an array of that many u8, to the arrays of a file.
fn with_zeros(arrays: &Arrays, name: &str, bytes: usize) -> Vec<u8> {
    let start = npz::to_bytes(arrays, npz::Packing::Stored).expect("fits");
    let mut zip = zip::ZipWriter::new_append(std::io::Cursor::new(start)).expect("our own archive");
    let options = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Deflated);
    zip.start_file(format!("{name}.npy"), options).expect("a member");
    let mut header = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': ({bytes},), }}");
    while !(10 + header.len() + 1).is_multiple_of(64) {
        header.push(' ');
    }
    header.push('\n');
    zip.write_all(b"\x93NUMPY\x01\x00").expect("in memory");
    zip.write_all(&(header.len() as u16).to_le_bytes()).expect("in memory");
    zip.write_all(header.as_bytes()).expect("in memory");
    let block = vec![0; 1 << 20];
    for _ in 0..bytes >> 20 {
        zip.write_all(&block).expect("in memory");
    }
    zip.finish().expect("in memory").into_inner()
}

#[test]
fn bombs_are_not_inflated() {
    const BOMB: usize = 400 << 20;
    const MOST: u64 = 200 << 20;
    let work = tempfile::tempdir().expect("a temporary folder");
    let dir = work.path();
    let write = |name: &str, bytes: Vec<u8>| {
        assert!(bytes.len() < 1_000_000, "{name}: {} bytes", bytes.len());
        std::fs::write(dir.join(name), bytes).expect("writable");
    };
    let arrays = scene(3).to_arrays();
    let mut without_means = arrays.clone();
    without_means.0.remove("means");
    write("beside.npz", with_zeros(&arrays, "unused", BOMB));
    write("inside.npz", with_zeros(&without_means, "means", BOMB));
    let linear = Arrays::new()
        .with("x", &[1, 2], vec![1.0_f32, 2.0])
        .with("weight", &[1, 2], vec![3.0_f32, 4.0])
        .with("bias", &[1], vec![0.5_f32]);
    write("output.npz", with_zeros(&linear, "y", BOMB));
    write("input.npz", with_zeros(&Arrays::new().with("x", &[1, 2], vec![1.0_f32, 2.0]), "weight", BOMB));
    npz::write(&dir.join("plain.npz"), &arrays).expect("writable");
    let cases: [(&[&str], i32, &str); 6] = [
        (&["convert", "beside.npz", "a.ply"], 0, "3 Gaussians"),
        (&["convert", "inside.npz", "b.ply"], 2, "array 'means': compression"),
        (
            &["oracle", "run", "nn.linear", "--in", "output.npz", "--out", "c.npz"],
            0,
            "ignored, not needed for a run: outputs y",
        ),
        (
            &["oracle", "run", "nn.linear", "--in", "input.npz", "--out", "d.npz"],
            2,
            "array 'weight': compression",
        ),
        (&["oracle", "compare", "beside.npz", "plain.npz", "--present-only"], 0, "unused"),
        (&["oracle", "compare", "inside.npz", "plain.npz"], 2, "array 'means': compression"),
    ];
    for (args, exit, part) in cases {
        let (o, most) = watched(args, dir);
        let text = format!("{}{}", stdout(&o), stderr(&o));
        assert_eq!(code(&o), exit, "{args:?}: {text}");
        assert!(text.contains(part), "{args:?}: '{part}' in {text}");
        assert!(most < MOST, "{args:?}: {most} bytes");
    }
}

#[test]
fn arrays_take_at_most_three_times_their_size() {
    let work = tempfile::tempdir().expect("a temporary folder");
    let dir = work.path();
    let n = 8_usize << 20;
    let values: Vec<f32> = (0..n).map(|i| i as f32).collect();
    let mut changed = values.clone();
    changed.iter_mut().for_each(|x| *x *= 2.0);
    npz::write(&dir.join("a.npz"), &Arrays::new().with("x", &[n], values)).expect("writable");
    npz::write(&dir.join("b.npz"), &Arrays::new().with("x", &[n], changed)).expect("writable");
    let idle = watched(&["oracle", "list"], dir).1;
    let (o, most) = watched(&["oracle", "compare", "a.npz", "b.npz"], dir);
    assert_eq!(code(&o), 1, "{}", stderr(&o));
    let declared = 2 * 4 * n as u64;
    assert!(most <= idle + 3 * 2 * declared, "{most} bytes for {declared} in files and as much in arrays");
    // A limit below the declared arrays is an error before anything is read.
    refused(
        &["oracle", "compare", "a.npz", "b.npz", "--max-memory", "40M"],
        dir,
        2,
        &["oracle compare", "--max-memory"],
    );
    refused(
        &["oracle", "compare", "a.npz", "b.npz", "--max-memory", "20M"],
        dir,
        2,
        &["a.npz: memory", "20.0 MiB"],
    );
    refused_usage(&["doctor", "--max-memory", "lots"], dir, "512M or 4G");
}

/// Runs and expects a usage error that holds `part`.
fn refused_usage(args: &[&str], dir: &Path, part: &str) {
    let o = lastlight(args, dir);
    assert_eq!(code(&o), 2, "{args:?}");
    assert!(stderr(&o).contains(part), "{args:?}: '{part}' in {}", stderr(&o));
}

/// A shell runs the program under a limit of address space: an input or an image that is too large for it is an error, and no abort.
#[cfg(target_os = "linux")]
#[test]
fn a_limit_of_address_space_is_an_error() {
    let work = tempfile::tempdir().expect("a temporary folder");
    let dir = work.path();
    let n = 16_usize << 20;
    npz::write(&dir.join("a.npz"), &Arrays::new().with("x", &[n], vec![1.0_f32; n])).expect("writable");
    write_scene(&dir.join("s.ply"), &scene(8), &[]).expect("writable");
    for command in
        ["oracle compare a.npz a.npz", "splat render s.ply --cameras orbit:1 --size 16000x16000 --out big"]
    {
        let line = format!("ulimit -v 1000000; exec \"$0\" --threads 2 {command}");
        let o = Command::new("sh")
            .args(["-c", &line, env!("CARGO_BIN_EXE_lastlight")])
            .current_dir(dir)
            .output()
            .expect("a shell");
        assert_eq!(o.status.code(), Some(2), "{command}: {}", stderr(&o));
        assert!(stderr(&o).contains("memory: expected at most"), "{command}: {}", stderr(&o));
    }
}

#[test]
fn a_large_map_takes_at_most_twenty_bytes_a_texel() {
    let work = workplace();
    let dir = work.path();
    // Larger than four times the cells of a table.
    let (w, h) = (8192, 4352);
    let row: Vec<u8> = (0..w).flat_map(|j| [(j % 251) as u8, (j / 31 % 256) as u8, 90]).collect();
    image_file::write_png(&dir.join("map.png"), w, h, 3, &row.repeat(h)).expect("writable");
    let small =
        ["mesh", "render", "cube.obj", "--cameras", "orbit:1", "--size", "8x8", "--samples", "1", "--quiet"];
    let with = |out: &'static str, map: &'static str| [&small[..], &["--out", out, "--env", map]].concat();
    let (o, idle) = watched(&with("one", "axes"), dir);
    assert_eq!(code(&o), 0, "{}", stderr(&o));
    let (o, most) = watched(&with("two", "map.png"), dir);
    assert_eq!(code(&o), 0, "{}", stderr(&o));
    let texels = (w * h) as u64;
    println!("{:.1} bytes a texel", most.saturating_sub(idle) as f64 / texels as f64);
    assert!(most <= idle + 20 * texels, "{most} bytes, {idle} without the map, {texels} texels");
}

#[test]
fn control_characters_and_long_strings_of_files_are_not_printed() {
    let work = tempfile::tempdir().expect("a temporary folder");
    let dir = work.path();
    let evil = format!("\u{1b}[2J\u{1b}]0;title\u{7}{}", "x".repeat(5000));
    let name = evil.replace('\u{1b}', "\\u001b").replace('\u{7}', "\\u0007");
    let pose = "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]";
    let frame = format!(r#"{{"file_path": "{name}", "transform_matrix": {pose}}}"#);
    let transforms = format!(r#"{{"camera_angle_x": 0.7, "frames": [{frame}]}}"#);
    std::fs::create_dir(dir.join("capture")).expect("made");
    std::fs::write(dir.join("capture/transforms.json"), transforms).expect("writable");
    let o = Command::new(env!("CARGO_BIN_EXE_lastlight"))
        .args(["splat", "fit", "capture", "--out", "o"])
        .current_dir(dir)
        .output()
        .expect("the binary starts");
    let text = stderr(&o);
    assert_eq!(code(&o), 2, "{text}");
    assert!(!text.contains('\u{1b}') && !text.contains('\u{7}'), "no control characters: {text:?}");
    assert!(text.contains("\\u{1b}[2J"), "they are shown: {text}");
    assert!(text.len() < 1500, "{} bytes: {text}", text.len());
}

#[cfg(unix)]
#[test]
fn links_to_folders_outside_are_not_followed() {
    use std::os::unix::fs::symlink;
    let work = tempfile::tempdir().expect("a temporary folder");
    let dir = work.path();
    write_scene(&dir.join("s.ply"), &scene(8), &[]).expect("writable");
    let render = |more: &[&'static str]| {
        [&["splat", "render", "s.ply", "--cameras", "orbit:1", "--size", "16x16", "--quiet"][..], more]
            .concat()
    };
    assert_eq!(code(&lastlight(&render(&["--out", "r"]), dir)), 0, "a folder of renders");
    std::fs::remove_dir_all(dir.join("r/color")).expect("removed");
    std::fs::create_dir(dir.join("outside")).expect("made");
    symlink(dir.join("outside"), dir.join("r/color")).expect("linked");
    refused(&render(&["--out", "r", "--force"]), dir, 2, &["color", "a link to", "outside"]);
    assert_eq!(
        std::fs::read_dir(dir.join("outside")).expect("readable").count(),
        0,
        "nothing was written there"
    );
    // The folder of results itself may be a link.
    symlink(dir.join("elsewhere"), dir.join("linked")).expect("linked");
    std::fs::create_dir(dir.join("elsewhere")).expect("made");
    assert_eq!(code(&lastlight(&render(&["--out", "linked"]), dir)), 0, "a link given by the user");
    // A lock that is a link would be emptied.
    std::fs::write(dir.join("precious"), "mine").expect("writable");
    std::fs::create_dir(dir.join("new")).expect("made");
    symlink(dir.join("precious"), dir.join("new/.lastlight.lock")).expect("linked");
    refused(&render(&["--out", "new"]), dir, 2, &[".lastlight.lock", "a link"]);
    assert_eq!(std::fs::read(dir.join("precious")).expect("there"), b"mine", "untouched");
}

/// A shell runs the program under a limit of file sizes, which by default ends it by a signal and without a message.
#[cfg(unix)]
#[test]
fn a_limit_of_file_sizes_is_an_error() {
    let work = tempfile::tempdir().expect("a temporary folder");
    let dir = work.path();
    write_scene(&dir.join("s.ply"), &scene(4000), &[]).expect("writable");
    let o = Command::new("sh")
        .args(["-c", "ulimit -f 8; exec \"$0\" convert s.ply t.ply", env!("CARGO_BIN_EXE_lastlight")])
        .current_dir(dir)
        .output()
        .expect("a shell");
    assert_eq!(o.status.code(), Some(2), "{:?}: {}", o.status, stderr(&o));
    assert!(stderr(&o).starts_with("error: ") && stderr(&o).contains("t.ply"), "{}", stderr(&o));
    let names: Vec<_> =
        std::fs::read_dir(dir).expect("readable").map(|e| e.expect("an entry").file_name()).collect();
    assert_eq!(names, ["s.ply"], "no part of a file is left");
}

#[test]
fn invalid_gaussians_are_left_out_on_request() {
    let work = tempfile::tempdir().expect("a temporary folder");
    let dir = work.path();
    let mut bad = scene(6);
    bad.quats[1] = [0.0; 4];
    bad.means[3][2] = f32::NAN;
    bad.sh[3 * 4] = f32::INFINITY;
    write_scene(&dir.join("bad.ply"), &bad, &[]).expect("writable");
    npz::write(&dir.join("bad.npz"), &bad.to_arrays()).expect("writable");
    let none = Gaussians { quats: vec![[0.0; 4]; 2], ..scene(2) };
    write_scene(&dir.join("none.ply"), &none, &[]).expect("writable");
    for file in ["bad.ply", "bad.npz"] {
        refused(&["convert", file, "x.ply"], dir, 2, &[file, "--drop-invalid", "leave out 3 such"]);
        let out = format!("good-{file}.ply");
        let made = json(&["convert", file, &out, "--drop-invalid", "--json"], dir);
        assert_eq!((&made["gaussians"], &made["dropped"]), (&3.into(), &3.into()), "{file}: {made}");
        let kept = read_scene(&dir.join(&out)).expect("valid");
        assert_eq!(kept.means, [[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [5.0, 0.0, 1.0]], "{file}: the others");
    }
    let render = ["splat", "render", "bad.ply", "--cameras", "orbit:1", "--size", "16x16", "--out"];
    refused(&[&render[..], &["r"]].concat(), dir, 2, &["bad.ply", "--drop-invalid"]);
    let o = lastlight(&[&render[..], &["r", "--drop-invalid"]].concat(), dir);
    assert_eq!(code(&o), 0, "{}", stderr(&o));
    assert!(stderr(&o).contains("left out 3 of 6 Gaussians"), "{}", stderr(&o));
    refused(
        &["convert", "none.ply", "y.ply", "--drop-invalid"],
        dir,
        2,
        &["at least one valid", "2 that are not"],
    );
}
