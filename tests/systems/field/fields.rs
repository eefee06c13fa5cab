//! Fields that are known: an empty one, a sphere, one beside its own images.

use super::{ITERATIONS, finish, new, settings, targets};
use lastlight::fit::field::mesh::{self, bake, shape};
use lastlight::fit::field::surface::Distances;
use lastlight::fit::field::{Settings, Target, Targets, score, view};
use lastlight::fit::training::{Fit as _, History};
use lastlight::num::order;
use lastlight::scene::field::{Field, Placement};

/// The field of a fit of a few iterations.
fn fitted() -> Field {
    let targets = targets();
    let mut fit = new(Settings { iterations: 4, crops: 1, ..settings() }, &targets);
    finish(&mut fit, &mut History::default(), None);
    fit.field().clone()
}

/// A field without a surface: the network adds a large constant to the distance.
fn empty() -> Field {
    let mut field = fitted();
    field.planes.values.fill(1.0);
    field.heads.sdf.weights.iter_mut().for_each(|w| w.fill(1.0));
    field
}

/// A field whose planes are zero: by definition a sphere with a tenth of the radius of the box.
fn sphere() -> Field {
    let mut field = fitted();
    field.planes.values.fill(0.0);
    field
}

/// A field that is a ball of 0.3: the network gives the same −0.25 everywhere, and |x| is less a tenth of the box.
fn ball() -> Field {
    let mut field = fitted();
    field.planes.values.fill(1.0);
    let [first, second, last] = field.heads.sdf.weights.as_mut_slice() else { panic!("three layers") };
    let (inputs, units) = (first.len() / last.len(), last.len());
    first.fill(1.0 / inputs as f32);
    second.fill(1.0 / units as f32);
    last.fill((0.1 * 0.525 - 0.3) / units as f32);
    field
}

fn coarse() -> mesh::Settings {
    mesh::Settings { side: 64, texture: 256, smoothing: 0, ..mesh::Settings::default() }
}

#[test]
fn an_empty_field_renders_as_background_is_scored_and_gives_no_mesh() {
    let (field, targets) = (empty(), targets());
    let cells = view::occupancy(&field).expect("finite");
    let images = view::render(&field, Some(&cells), &targets.train[0].camera, true);
    assert_eq!(images.samples, 0, "no cell is occupied");
    assert!(images.opacity.iter().all(|o| *o == 0.0), "nothing is opaque");
    assert!(images.values.iter().all(|v| *v == field.settings.background), "background");
    assert!(images.normals.iter().all(|n| *n == [0.0; 3]), "no normals");
    let scores = score(&field, &cells, &targets.test[0]).expect("white images have scores");
    assert!(scores.image.score.psnr_db > 0.0 && scores.image.score.psnr_db < 30.0, "a score");
    assert!(scores.numerical_deg.is_none() && scores.depth.is_none(), "nothing to compare");
    let e = bake(&field, &coarse()).expect_err("no surface").to_string();
    assert!(e.contains("field mesh") && e.contains("the field is empty"), "{e}");
}

#[test]
fn a_fit_goes_on_when_its_field_is_empty() {
    // A first 1/β beyond which nothing is sampled: the grid of a field without a surface has no cells.
    let targets = targets();
    let mut far = targets.clone();
    for t in &mut far.train {
        t.foreground.fill(0.0);
        t.color.fill(1.0);
    }
    far.train[0].foreground = targets.train[0].foreground.clone();
    let settings = Settings { inverse_beta: [400.0, 400.0], ..settings() };
    let mut fit = new(settings, &far);
    let mut history = History::default();
    finish(&mut fit, &mut history, None);
    assert!(history.len() == ITERATIONS && history.loss.iter().all(|x| x.is_finite()), "{:?}", history.loss);
}

#[test]
fn the_mesh_of_zero_planes_is_a_sphere_of_a_tenth_of_the_box() {
    let mut field = sphere();
    let radius = 0.1 * field.settings.half_size;
    let (mesh, cavities, parts) = shape(&field, &coarse()).expect("finite").expect("a surface");
    assert_eq!((cavities, parts), (0, 1), "one closed surface");
    let cell = 2.0 * field.settings.half_size / 63.0;
    for x in &mesh.positions {
        let r = ((x[0] * x[0] + x[1] * x[1]) + x[2] * x[2]).sqrt();
        assert!((r - radius).abs() < 0.1 * cell, "{r}, not {radius}");
    }
    for (x, n) in mesh.positions.iter().zip(&mesh.normals) {
        let out = (x[0] * n[0] + x[1] * n[1] + x[2] * n[2]) / radius;
        assert!(out > 0.9, "normals point outwards: {out}");
    }
    // In the world.
    field.placement = Placement::new([3.0, -2.0, 1.0], 0.25);
    let baked = bake(&field, &coarse()).expect("a surface");
    for x in &baked.object.mesh.positions {
        let d: Vec<f64> = (0..3).map(|k| f64::from(x[k]) - field.placement.center[k]).collect();
        let r = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
        assert!((r - 4.0 * f64::from(radius)).abs() < 0.4 * f64::from(cell), "{r}: four times as large");
    }
    // Every head at 0.5: networks without bias give sigmoid(0).
    let material = &baked.object.materials[0];
    let texel = material.base_color_map.as_ref().expect("a map").texels[0];
    assert!(texel[..3].iter().all(|x| (127..=128).contains(x)), "{texel:?}");
}

#[test]
fn the_mesh_of_a_turned_field_is_where_its_placement_says() {
    // Features grow along one axis of every plane, so that no turn of the surface is the surface.
    let mut field = ball();
    let (side, channels) = (field.planes.side, field.planes.channels);
    for (i, texel) in field.planes.values.chunks_mut(channels).enumerate() {
        texel.fill(0.6 + 0.8 * (i % side) as f32 / side as f32);
    }
    // The axes of the world are those of the field in turn.
    let rotation = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]];
    field.placement = Placement { rotation, ..Placement::new([3.0, -2.0, 1.0], 0.25) };
    let cell = 2.0 * field.settings.half_size / 63.0;
    let baked = bake(&field, &coarse()).expect("a surface");
    let farthest = |of: &Placement| {
        let point = |x: &[f32; 3]| of.to_field(x.map(f64::from)).map(|v| v as f32);
        let points = baked.object.mesh.positions.iter().map(point).collect();
        Distances::at(&field, points).sdf.iter().fold(0.0, |most, s| order::max(most, s.abs()))
    };
    let transposed = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let [own, other, none] = [rotation, transposed, Placement::new([0.0; 3], 1.0).rotation]
        .map(|rotation| farthest(&Placement { rotation, ..field.placement }));
    assert!(own < 0.1 * cell, "on the surface: {own}");
    assert!(other > cell && none > cell, "and of no other turn: {other} {none}");
}

#[test]
fn a_field_beside_its_own_images_has_perfect_scores() {
    let mut field = ball();
    field.settings.inverse_beta = 400.0;
    let cells = view::occupancy(&field).expect("finite");
    let mut target: Target = targets().train.remove(0);
    let images = view::render(&field, Some(&cells), &target.camera, true);
    target.color = images.color().expect("colours");
    target.albedo = Some(images.values_from(images.channels.albedo.expect("a head"), 3));
    target.normal = Some(images.normals.concat());
    let covered = |o: &f32| f32::from(u8::from(*o > 0.9));
    target.solid = images.opacity.iter().map(covered).collect();
    target.foreground = target.solid.clone();
    let (eye, forward) = (target.camera.center(), target.camera.rotation[2]);
    let z = |x: &[f32; 3]| (0..3).map(|k| (x[k] - eye[k]) * forward[k]).fold(0.0, |s, d| s + d);
    let depth = images.points.iter().zip(&target.solid);
    target.depth = Some(depth.map(|(x, s)| if *s > 0.0 { z(x) } else { 0.0 }).collect());
    assert!(target.solid.iter().filter(|s| **s > 0.0).count() > 60, "the surface is seen");
    let scores = score(&field, &cells, &target).expect("scores");
    assert_eq!((scores.image.score.psnr_db, scores.image.score.mae), (f64::INFINITY, 0.0), "colours");
    assert!(scores.numerical_deg.expect("normals") < 0.1, "normals: {:?}", scores.numerical_deg);
    assert!(scores.depth.expect("depth") < 1e-6, "depth: {:?}", scores.depth);
    assert!(scores.materials.albedo_db.expect("albedo") > 100.0, "albedo: {:?}", scores.materials.albedo_db);
    assert!(scores.head_deg.is_some(), "the normal head is compared");
    let json = scores.json();
    assert!(json["psnr_db"].is_null() && json["mae"] == 0.0, "no finite number: {json}");
    // The grid changes what is evaluated, and no colour by more than the rule allows.
    let all = view::render(&field, None, &target.camera, false);
    assert!(all.samples > images.samples, "cells are skipped");
    let far = |(a, b): (&f32, &f32)| (a - b).abs() > 1e-3;
    assert!(!all.values.iter().zip(&images.values).any(far), "the same image");
}

#[test]
fn the_losses_of_an_exact_render_are_zero() {
    // The images are those of the first field, so the first iteration has nothing to learn.
    let settings = Settings { eikonal: 0.0, variation: 0.0, ..settings() };
    let mut exact = targets();
    let first = new(settings.clone(), &exact).field().clone();
    for t in &mut exact.train {
        let images = view::render(&first, None, &t.camera, false);
        let channels = images.channels;
        let of = |at: Option<usize>, n: usize| images.values_from(at.expect("a head"), n);
        t.color = of(channels.color, 3);
        t.albedo = Some(of(channels.albedo, 3));
        t.material = Some(of(channels.material, 2));
        t.normal = Some(of(channels.normal, 3));
        t.solid.fill(1.0);
        t.foreground = images.opacity;
    }
    let loss = |targets: &Targets| new(settings.clone(), targets).step(0, &mut ()).expect("a step").loss;
    let zero = loss(&exact);
    assert!(zero.abs() < 1e-6, "{zero}");
    // Each of them is compared.
    type Change = (&'static str, fn(&mut Target));
    let changes: [Change; 5] = [
        ("colour", |t| t.color.iter_mut().for_each(|x| *x += 0.1)),
        ("albedo", |t| t.albedo.as_mut().expect("set").iter_mut().for_each(|x| *x += 0.1)),
        ("material", |t| t.material.as_mut().expect("set").iter_mut().for_each(|x| *x += 0.1)),
        ("normal", |t| t.normal.as_mut().expect("set").iter_mut().for_each(|x| *x += 0.1)),
        ("foreground", |t| t.foreground.iter_mut().for_each(|x| *x += 0.1)),
    ];
    for (name, change) in changes {
        let mut other = exact.clone();
        other.train.iter_mut().for_each(change);
        let loss = loss(&other);
        assert!(loss > 1e-3, "{name}: {loss}");
        // Not where pixels do not count.
        other.train.iter_mut().for_each(|t| t.kept = Some(vec![0.0; t.foreground.len()]));
        let mut fit = new(settings.clone(), &other);
        assert_eq!(fit.step(0, &mut ()).expect("a step").loss, 0.0, "{name}: masked");
    }
}
