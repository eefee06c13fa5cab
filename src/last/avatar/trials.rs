//! Acceptance tests of the fit, on a body of two joints and a guide with known factors: density control (eq.
//! 8–9), the progressive update (eq. 10–12), and bit-identical results for any number of threads.

use super::calibrate;
use super::density::{Density, Mode};
use super::evaluate::Evaluation;
use super::fit::PersonFit;
use super::guide::{Framing, Guide};
use super::progressive::{Cap, Keys, Order, Progressive};
use super::settings::Settings;
use crate::fit::training::{self, Fit, History, Schedule};
use crate::io::image_file;
use crate::io::npz;
use crate::math::digraph::Digraph;
use crate::num::array::Arrays;
use crate::num::par;
use crate::scene::person::PersonCapture;
use crate::{Error, Result};
use serde_json::json;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// Side of the images.
const SIDE: usize = 24;

/// Two factors: the left half of an image, and the right half, which depends on it. A position belongs to the
/// factor of its side.
struct Halves {
    edge: bool,
    /// The two images are reported to be equal.
    blind: bool,
    framing: Framing,
    /// Rejects input images in which the person is not in the middle.
    strict: bool,
}

fn halves(blind: bool) -> Halves {
    Halves { edge: true, blind, framing: Framing::Whole, strict: false }
}

/// Position of the brightness centroid of a square image relative to its centre, in sides.
fn off_centre(picture: &[f32], side: usize) -> [f32; 2] {
    let light = |i: usize| picture[3 * i] + picture[3 * i + 1] + picture[3 * i + 2];
    let mut sums = [0.0; 3];
    for i in 0..side * side {
        let at = [i % side, i / side].map(|x| (x as f32 + 0.5) / side as f32 - 0.5);
        sums = [sums[0] + light(i), sums[1] + light(i) * at[0], sums[2] + light(i) * at[1]];
    }
    [sums[1] / sums[0], sums[2] / sums[0]]
}

impl Guide for Halves {
    fn factors(&self) -> usize {
        2
    }
    fn graph(&self) -> Digraph {
        if self.edge { Digraph::new(2, &[(0, 1)]) } else { Digraph::empty(2) }
    }
    fn side(&self) -> usize {
        SIDE / 2
    }
    fn framing(&self) -> Framing {
        self.framing
    }
    fn identity(&self) -> String {
        format!("halves {} {}", self.edge, self.blind)
    }
    fn discrepancy(&self, rendered: &[f32], real: &[f32]) -> Result<(f64, Vec<f32>)> {
        let off = off_centre(real, self.side());
        if self.strict && off.iter().any(|x| x.abs() > 0.1) {
            return Err(Error::check("input image")
                .expected("a person in the middle")
                .got(format!("{off:?}")));
        }
        let scale = if self.blind { 0.0 } else { 1.0 / rendered.len() as f32 };
        let bar: Vec<f32> = rendered.iter().zip(real).map(|(a, b)| 2.0 * scale * (a - b)).collect();
        let value = rendered.iter().zip(real).fold(0.0, |s, (a, b)| s + f64::from(scale * (a - b) * (a - b)));
        Ok((value, bar))
    }
    fn swap_scores(&self, rendered: &[f32], real: &[f32], places: &[[f32; 3]]) -> Result<Vec<Vec<f64>>> {
        if rendered.len() != real.len() {
            return Err(Error::input("images").expected("one size"));
        }
        let score =
            |side: f32| places.iter().map(|p| f64::from(crate::num::order::max(side * p[0], 0.0))).collect();
        Ok(vec![score(-1.0), score(1.0)])
    }
}

fn capture(dir: &Path) -> PersonCapture {
    capture_in(dir, SIDE, 0)
}

/// A bar with two joints, bent over four moments, in front of one camera; the images are discs of two colours
/// with the given width, and the person is shifted to the right by the given number of columns.
fn capture_in(dir: &Path, width: usize, right: usize) -> PersonCapture {
    let columns = 12;
    let points: Vec<f32> = (0..columns * 4)
        .flat_map(|i| {
            let (x, y) = ((i % columns) as f32 / 11.0 - 0.5, (i / columns) as f32 * 0.06 - 0.09);
            [1.4 * x, y, 0.0]
        })
        .collect();
    let n = points.len() / 3;
    let weights: Vec<f32> =
        points.chunks(3).flat_map(|p| if p[0] < 0.0 { [1.0, 0.0] } else { [0.0, 1.0] }).collect();
    let moments = 4;
    let transforms: Vec<f32> = (0..moments)
        .flat_map(|t| {
            let still = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.];
            let (s, c) = (libm::sin(0.2 * t as f64) as f32, libm::cos(0.2 * t as f64) as f32);
            [still, [c, -s, 0., 0., s, c, 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.]].concat()
        })
        .collect();
    let body = Arrays::new()
        .with("points", &[n, 3], points.clone())
        .with("weights", &[n, 2], weights)
        .with("parents", &[2], vec![-1i32, 0])
        .with("joints", &[2, 3], vec![0.0f32, 0.0, 0.0, 0.0, 0.0, 0.0])
        .with("transforms", &[moments, 2, 4, 4], transforms)
        .with("global_rotation", &[moments, 3], vec![0.0f32; 3 * moments])
        .with("global_translation", &[moments, 3], vec![0.0f32; 3 * moments]);
    let bytes = npz::to_bytes(&body, npz::Packing::Stored).expect("an archive");
    for folder in ["images", "foreground"] {
        std::fs::create_dir_all(dir.join(folder)).expect("a folder");
    }
    std::fs::write(dir.join("body.npz"), bytes).expect("written");
    let frames: Vec<_> = (0..moments)
        .map(|t| {
            let (mut rgb, mut mask) = (vec![0u8; SIDE * width * 3], vec![0u8; SIDE * width]);
            let angle = 0.2 * t as f64;
            for i in 0..SIDE * width {
                let (x, y) = ((i % width) as f64 - right as f64 - 11.5, 11.5 - (i / width) as f64);
                let across = if x < 0.0 { y } else { y * libm::cos(angle) - x * libm::sin(angle) };
                if across.abs() < 2.5 && x * x + y * y < 64.0 {
                    rgb[3 * i..3 * i + 3].copy_from_slice(if x < 0.0 {
                        &[220, 60, 40]
                    } else {
                        &[50, 90, 230]
                    });
                    mask[i] = 255;
                }
            }
            let name = format!("c00_f{t:04}.png");
            image_file::write_png(&dir.join("images").join(&name), width, SIDE, 3, &rgb).expect("written");
            image_file::write_png(&dir.join("foreground").join(&name), width, SIDE, 1, &mask)
                .expect("written");
            json!({
                "file_path": format!("images/{name}"), "foreground_path": format!("foreground/{name}"),
                "transform_matrix": [[1., 0., 0., 0.], [0., 1., 0., 0.], [0., 0., 1., 4.], [0., 0., 0., 1.]],
                "frame": t, "time": t as f64 / moments as f64, "camera": 0,
            })
        })
        .collect();
    let train = json!({
        "w": width, "h": SIDE, "fl_x": 46.0, "fl_y": 46.0, "cx": 12.0 + right as f64, "cy": 12.0, "camera_model": "PINHOLE",
        "frames": frames,
    });
    std::fs::write(dir.join("transforms_train.json"), train.to_string()).expect("written");
    PersonCapture::open(dir).expect("a capture")
}

fn settings() -> Settings {
    let host = Settings::baseline();
    Settings {
        iterations: 60,
        max_gaussians: 200,
        weights_network: true,
        pose_network: true,
        density: Density { prune_distance_m: 0.5, ..host.density.clone() },
        ..host
    }
}

fn guided(lambda: f64) -> Settings {
    Settings {
        density: Density { mode: Mode::Or, ..settings().density },
        progressive: Some(Progressive { lambda, ..Progressive::published() }),
        latent_weight: 0.1,
        ..settings()
    }
}

fn finish(fit: &mut PersonFit<'_>) -> History {
    let stop = AtomicBool::new(false);
    let mut history = History::default();
    let schedule = Schedule { checkpoint: None, every: 1000, stop: &stop };
    training::run(fit, &mut history, schedule, &mut ()).expect("runs");
    history
}

fn digest(settings: Settings, capture: &PersonCapture, guide: Option<&dyn Guide>) -> String {
    let mut fit = PersonFit::new(settings, capture, guide).expect("valid");
    finish(&mut fit);
    fit.avatar().digest().expect("finite")
}

#[test]
fn a_guide_that_is_not_asked_changes_no_bit() {
    let dir = tempfile::tempdir().expect("a folder");
    let capture = capture(dir.path());
    let host = digest(settings(), &capture, None);
    let guide = halves(false);
    assert_eq!(digest(settings(), &capture, Some(&guide)), host, "all off");
    let of = |p: Progressive| digest(Settings { progressive: Some(p), ..settings() }, &capture, Some(&guide));
    let one_level = Progressive { lambda: f64::INFINITY, order: Order::None, ..Progressive::published() };
    assert_eq!(of(one_level.clone()), host, "λ = ∞ and one level");
    assert_eq!(of(Progressive { graph: Some(Digraph::empty(2)), ..one_level }), host, "no edges");
    assert_ne!(of(Progressive::published()), host, "two levels change the result");
}

#[test]
fn frozen_children_stay_and_parents_move() {
    let dir = tempfile::tempdir().expect("a folder");
    let capture = capture(dir.path());
    let guide = halves(false);
    for (cap, lambda) in [(Cap::Relative, 0.0), (Cap::Absolute, 0.0), (Cap::Relative, 0.1)] {
        let progressive = Progressive { cap, lambda, ..Progressive::published() };
        let s = Settings { progressive: Some(progressive), ..settings() };
        let mut fit = PersonFit::new(s, &capture, Some(&guide)).expect("valid");
        // Key Gaussians are known after iteration 10; density control acts after iteration 20.
        for i in 0..12 {
            fit.step(i, &mut ()).expect("runs");
        }
        let (before, members) = (fit.avatar().gaussians.clone(), fit.members().to_vec());
        let parent: Vec<usize> = (0..members.len()).filter(|&g| members[g] & 1 == 1).collect();
        let child: Vec<usize> = (0..members.len()).filter(|&g| members[g] == 2).collect();
        assert!(!parent.is_empty() && !child.is_empty(), "keys of both factors");
        assert!(members.contains(&0), "some are key to no factor");
        fit.step(12, &mut ()).expect("runs");
        let after = &fit.avatar().gaussians;
        let moved =
            |g: usize| after.means[g] != before.means[g] || after.scales_log[g] != before.scales_log[g];
        assert!(parent.iter().all(|&g| moved(g)), "parents move");
        assert_eq!(child.iter().any(|&g| moved(g)), lambda > 0.0, "children, {cap:?} λ = {lambda}");
        assert_eq!(
            fit.tally().renders,
            13 + 3 + 4,
            "a render per level and iteration, and one per image for key Gaussians"
        );
    }
}

#[test]
fn children_that_stop_take_no_step_and_others_take_five() {
    let dir = tempfile::tempdir().expect("a folder");
    let capture = capture(dir.path());
    let guide = halves(false);
    for (lambda, renders) in [(f64::INFINITY, 1), (0.0, 5)] {
        let progressive = Progressive { cap: Cap::Stop, lambda, ..Progressive::published() };
        let s = Settings { progressive: Some(progressive), ..settings() };
        let mut fit = PersonFit::new(s, &capture, Some(&guide)).expect("valid");
        for i in 0..12 {
            fit.step(i, &mut ()).expect("runs");
        }
        let (before, members, rendered) =
            (fit.avatar().gaussians.clone(), fit.members().to_vec(), fit.tally().renders);
        fit.step(12, &mut ()).expect("runs");
        // One render for level 0; for the level of the child, one to compute its gradient and one before each
        // further step.
        assert_eq!(fit.tally().renders - rendered, 1 + renders, "renders at λ = {lambda}");
        let after = &fit.avatar().gaussians;
        let children = (0..members.len()).filter(|&g| members[g] == 2);
        let moved = children.filter(|&g| after.means[g] != before.means[g]).count();
        assert_eq!(moved > 0, lambda == 0.0, "{moved} children moved at λ = {lambda}");
    }
}

#[test]
fn the_person_is_seen_wherever_it_stands() {
    let dir = tempfile::tempdir().expect("a folder");
    let capture = capture_in(dir.path(), 40, 15);
    let settings = Settings { latent_weight: 0.1, ..settings() };
    let run = |framing: Framing| {
        let guide = Halves { framing, strict: true, ..halves(false) };
        let mut fit = PersonFit::new(settings.clone(), &capture, Some(&guide)).expect("valid");
        (0..8).try_for_each(|i| fit.step(i, &mut ()).map(|_| ())).map(|()| fit.tally().encodings)
    };
    assert_eq!(run(Framing::Person).expect("in the middle of what is seen"), 8, "one encoder pass per step");
    let whole = run(Framing::Whole).expect_err("to the right of the middle of the image").to_string();
    assert!(whole.contains("a person in the middle"), "{whole}");
    // Half of the person is outside the image, then all of it.
    let mut gone = capture.clone();
    for (shift, is_seen) in [(-20.0, true), (-60.0, false)] {
        for shot in &mut gone.shots {
            shot.camera.center_px[0] = 27.0 + shift;
        }
        let guide = Halves { framing: Framing::Person, ..halves(false) };
        let mut fit = PersonFit::new(settings.clone(), &gone, Some(&guide)).expect("valid");
        assert_eq!(fit.step(0, &mut ()).is_ok(), is_seen, "moved by {shift} pixels");
    }
}

#[test]
fn no_discrepancy_adds_nothing() {
    let dir = tempfile::tempdir().expect("a folder");
    let capture = capture(dir.path());
    for (blind, mode) in [(true, Mode::Replace), (true, Mode::Budget), (false, Mode::Replace)] {
        let density = Density { mode, latent_threshold: 1e-7, pixel_threshold: 1e-6, ..settings().density };
        let s = Settings { density, ..settings() };
        let guide = halves(blind);
        let mut fit = PersonFit::new(s, &capture, Some(&guide)).expect("valid");
        finish(&mut fit);
        let added = fit.events().iter().fold(0, |n, e| n + e.cloned + e.split);
        assert_eq!(added > 0, !blind, "{mode:?}, blind {blind}: {added} added");
        let t = fit.tally();
        assert!(!blind || t.blind == t.gradients as f64, "no pixel affects the encoder");
    }
}

#[test]
fn calibration_makes_the_counts_equal() {
    let dir = tempfile::tempdir().expect("a folder");
    let capture = capture(dir.path());
    let guide = halves(false);
    let s = Settings { density: Density { pixel_threshold: 1e-4, ..settings().density }, ..settings() };
    let scale = calibrate::latent_scale(&s, &capture, &guide, &mut ()).expect("runs").expect("candidates");
    // Just beyond the Gaussian that lies exactly at the threshold.
    let density = Density { mode: Mode::Budget, latent_scale: scale * (1.0 + 1e-9), ..s.density.clone() };
    let mut fit = PersonFit::new(Settings { density, ..s.clone() }, &capture, Some(&guide)).expect("valid");
    for i in 0..30 {
        fit.step(i, &mut ()).expect("runs");
    }
    let event = fit.events().last().expect("a refinement at iteration 30 of 60");
    assert_eq!(event.iteration, 30, "half of the fit");
    assert!(event.pixel_candidates > 0, "something to make equal");
    assert_eq!(event.latent_candidates, event.pixel_candidates, "with c_τ = {scale}");
    let blind = halves(true);
    let none = calibrate::latent_scale(&s, &capture, &blind, &mut ()).expect("runs");
    assert_eq!(none, None, "nothing to make equal");
}

#[test]
fn an_interrupted_fit_and_other_threads_give_the_same_bits() {
    let dir = tempfile::tempdir().expect("a folder");
    let capture = capture(dir.path());
    let guide = halves(false);
    let whole = digest(guided(0.1), &capture, Some(&guide));
    for threads in [1, 7] {
        let other = par::with_threads(threads, || digest(guided(0.1), &capture, Some(&guide)));
        assert_eq!(other.expect("threads"), whole, "{threads} threads");
    }
    let path = dir.path().join("checkpoint.safetensors");
    let mut first = PersonFit::new(guided(0.1), &capture, Some(&guide)).expect("valid");
    let mut history = History::default();
    for i in 0..33 {
        let step = first.step(i, &mut ()).expect("runs");
        history.loss.push(step.loss);
        history.size.push(step.size as i32);
    }
    training::save(&first, &history, &path).expect("written");
    let mut second = PersonFit::new(guided(0.1), &capture, Some(&guide)).expect("valid");
    let mut history = training::resume(&mut second, &path).expect("complete");
    let stop = AtomicBool::new(false);
    let schedule = Schedule { checkpoint: None, every: 1000, stop: &stop };
    training::run(&mut second, &mut history, schedule, &mut ()).expect("runs");
    assert_eq!(second.avatar().digest().expect("finite"), whole, "resumed");
    let mut other = PersonFit::new(guided(0.2), &capture, Some(&guide)).expect("valid");
    assert!(training::resume(&mut other, &path).is_err(), "another λ is refused");

    // The avatar file contains the same person.
    let file = dir.path().join("avatar.safetensors");
    super::store::write(&file, second.avatar(), &capture, &Fit::settings(&second)).expect("written");
    let stored = super::store::read(&file).expect("an avatar");
    assert_eq!(stored.avatar.digest().expect("finite"), whole, "stored and read");
    let camera = &capture.shots[0].camera;
    let picture = |a: &super::person::Avatar, pose| a.picture(pose, Some(2), camera).expect("renders").image;
    let same = picture(&stored.avatar, &stored.poses[2]) == picture(second.avatar(), &capture.poses[2]);
    assert!(same, "the same image from the file");
    // A moment of another capture with the same index is not treated as a moment of the fit.
    let with = |poses| Evaluation { learned_at: Some(poses), ..Evaluation::of(&stored.avatar, &capture) };
    let mut others = stored.poses.clone();
    others[1].transforms[0][0][3] += 0.5;
    others.truncate(3);
    assert_eq!(
        [0, 1, 2, 3].map(|t| with(&stored.poses).moment(t)),
        [0, 1, 2, 3].map(Some),
        "those of the fit"
    );
    assert_eq!([0, 1, 2, 3].map(|t| with(&others).moment(t)), [Some(0), None, Some(2), None], "others");
}

#[test]
fn what_cannot_be_is_refused() {
    let dir = tempfile::tempdir().expect("a folder");
    let capture = capture(dir.path());
    let missing = PersonFit::new(guided(0.1), &capture, None).err().expect("no guide").to_string();
    assert!(missing.contains("model"), "{missing}");
    let guide = halves(false);
    let graph = Some(Digraph::new(2, &[(0, 1), (1, 0)]));
    let progressive = Some(Progressive { graph, keys: Keys::All, ..Progressive::published() });
    let cyclic = PersonFit::new(Settings { progressive, ..settings() }, &capture, Some(&guide));
    assert!(cyclic.err().expect("a cycle").to_string().contains("cycle"), "a cyclic graph");
    let few = PersonFit::new(Settings { max_gaussians: 5, ..settings() }, &capture, None);
    assert!(few.err().expect("too few").to_string().contains("--max-gaussians"), "fewer than points");
    for bad in [
        Settings { iterations: 0, ..settings() },
        Settings { first_opacity: 1.0, ..settings() },
        Settings { ssim_weight: f32::NAN, ..settings() },
        Settings { latent_weight: -1.0, ..settings() },
    ] {
        assert!(bad.validate().is_err(), "{bad:?} is refused");
    }
}
