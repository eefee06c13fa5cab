//! The renderer: the chain of single operators, a sphere in closed form, rays beside the box, kinks, early stop.

use super::made::{CHANNELS, HALF_SIZE, Made, flat, rays, unit};
use lastlight::field::composite;
use lastlight::field::fetch::{self, Combine};
use lastlight::field::normal::{self, Stencil};
use lastlight::field::render::{Plan, Rule, Scene, Settings};
use lastlight::field::{density, embed, interval, normal_head, sdf_head, value_head};

/// ‖a − b‖/‖b‖.
fn distance(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len(), "as many entries");
    let norm = |x: &mut dyn Iterator<Item = f64>| x.fold(0.0, |sum, x| sum + x * x).sqrt();
    let difference = norm(&mut a.iter().zip(b).map(|(a, b)| f64::from(*a) - f64::from(*b)));
    if difference == 0.0 { 0.0 } else { difference / norm(&mut b.iter().map(|b| f64::from(*b))) }
}

fn features(scene: &Scene<'_>, points: &[[f32; 3]]) -> Vec<f32> {
    let mut out = vec![0.0; points.len() * scene.settings.combine.width(CHANNELS)];
    fetch::forward(&scene.planes, scene.settings.combine, points, &mut out);
    out
}

fn distances(scene: &Scene<'_>, points: &[[f32; 3]]) -> Vec<f32> {
    let features = features(scene, points);
    let half_size = scene.planes.half_size;
    sdf_head::forward(&sdf_head::In {
        features: &features,
        points,
        weights: scene.heads.sdf.weights,
        half_size,
    })
    .0
}

/// Values of points (colour, albedo, material, normal), by the single operators.
fn values_of(scene: &Scene<'_>, points: &[[f32; 3]], direction: [f32; 3]) -> Vec<f32> {
    let features = features(scene, points);
    let heads = &scene.heads;
    let [color, albedo, material, normals] =
        [&heads.color, &heads.albedo, &heads.material, &heads.normal].map(|n| n.expect("a head"));
    let n = normal_head::forward(&normals, &features, points).0;
    let color = match (&scene.panoramas, heads.rho) {
        (Some(panoramas), Some(rho)) => {
            let rho = value_head::forward(&rho, &features).0;
            let rays = vec![direction; points.len()];
            let h = embed::forward(panoramas, &n, Some(&rays), &rho, None).0;
            let f = features.len() / points.len();
            let rows = features.chunks_exact(f).zip(h.chunks_exact(panoramas.channels));
            let joined: Vec<f32> = rows.flat_map(|(f, h)| [f, h].concat()).collect();
            value_head::forward(&color, &joined).0
        }
        _ => value_head::forward(&color, &features).0,
    };
    let (albedo, material) =
        (value_head::forward(&albedo, &features).0, value_head::forward(&material, &features).0);
    let row =
        |i: usize| [&color[3 * i..][..3], &albedo[3 * i..][..3], &material[2 * i..][..2], &n[i]].concat();
    (0..points.len()).flat_map(row).collect()
}

/// One ray by the single operators: values, opacity, Σ wx, Σ wn.
fn chain(scene: &Scene<'_>, plan: &Plan, ray: usize) -> (Vec<f32>, f32, [f32; 3], [f32; 3]) {
    let (rays, intervals) = (&scene.rays, &plan.intervals);
    let ends: Vec<[f32; 2]> =
        (intervals.start[ray]..intervals.start[ray + 1]).map(|s| intervals.ends(ray, s)).collect();
    let at =
        |t: &dyn Fn(&[f32; 2]) -> f32| -> Vec<[f32; 3]> { ends.iter().map(|e| rays.at(ray, t(e))).collect() };
    let middles = at(&|[begin, end]| begin + 0.5 * (end - begin));
    let (mut sigma, delta) =
        (vec![0.0; ends.len()], ends.iter().map(|[begin, end]| end - begin).collect::<Vec<f32>>());
    let begins = distances(scene, &at(&|e| e[0]));
    match scene.settings.rule {
        Rule::Left => density::forward(&begins, scene.beta, &mut sigma),
        Rule::Midpoint => density::forward(&distances(scene, &middles), scene.beta, &mut sigma),
        Rule::Analytic => {
            interval::forward(&begins, &distances(scene, &at(&|e| e[1])), scene.beta, &mut sigma);
        }
    }
    let values = values_of(scene, &middles, rays.directions[ray]);
    let background = vec![scene.settings.background; 11];
    let out = composite::forward(&composite::In {
        sigma: &sigma,
        delta: &delta,
        values: &values,
        background: &background,
        samples: ends.len(),
    });
    let sum = |x: &[[f32; 3]]| {
        std::array::from_fn(|k| x.iter().zip(&out.weights).fold(0.0, |sum, (x, w)| sum + w * x[k]))
    };
    let n = match scene.settings.numerical_normals {
        Some((stencil, epsilon)) => {
            let stencils: Vec<[f32; 3]> = middles
                .iter()
                .flat_map(|x| (0..stencil.width()).map(|i| stencil.point(i, epsilon, *x)))
                .collect();
            sum(&normal::forward(&distances(scene, &stencils), stencil, epsilon).1)
        }
        None => [0.0; 3],
    };
    (out.value, out.opacity[0], sum(&middles), n)
}

#[test]
fn a_render_is_the_chain_of_the_single_operators() {
    let numerical = |stencil| Some((stencil, 0.0625));
    for (mut made, rule, normals) in [
        (Made::random(80, 25), Rule::Midpoint, None),
        (Made::random(40, 9), Rule::Left, numerical(Stencil::Central)),
        (Made::embedded(40, 35), Rule::Analytic, numerical(Stencil::Forward)),
        (Made::random(40, 5), Rule::Midpoint, numerical(Stencil::Central)),
    ] {
        (made.settings.rule, made.settings.numerical_normals) = (rule, normals);
        let (out, plan) = made.render();
        let (mut values, mut opacity, mut points, mut normals) = (vec![], vec![], vec![], vec![]);
        made.with(|scene| {
            for ray in 0..made.origins.len() {
                let (v, o, x, n) = chain(scene, &plan, ray);
                values.extend(v);
                opacity.push(o);
                points.push(x.map(|x| x / if o > 0.98 { o } else { 0.98 }));
                let is_there = o > 0.98 && !out.normals.is_empty();
                normals.push(if is_there { unit(n.map(f64::from)).map(|n| n as f32) } else { [0.0; 3] });
            }
        });
        let valid = opacity.iter().filter(|o| **o > 0.98).count();
        assert!(valid > 2 && valid < opacity.len(), "{rule:?}: {valid} rays are valid");
        assert!(distance(&out.values, &values) < 1e-6, "{rule:?}: values");
        assert!(distance(&out.opacity, &opacity) < 1e-6, "{rule:?}: opacities");
        assert!(distance(out.points.as_flattened(), points.as_flattened()) < 1e-6, "{rule:?}: points");
        if !out.normals.is_empty() {
            assert!(distance(out.normals.as_flattened(), normals.as_flattened()) < 2e-6, "{rule:?}: normals");
        }
    }
}

/// Radius of the sphere.
const RADIUS: f64 = 0.05;
/// Scale of the density there.
const BETA: f64 = 0.005;

/// Rays towards points at distance `offset` from the centre, at a right angle to it.
fn rays_beside(n: usize, offset: f64) -> (Vec<[f32; 3]>, Vec<[f32; 3]>) {
    let (origins, directions) = rays(n, 12);
    let move_aside = |(o, d): ([f32; 3], [f32; 3])| {
        let (d, o) = (unit(d.map(f64::from)), o.map(f64::from));
        let along = o[0] * d[0] + o[1] * d[1] + o[2] * d[2];
        let aside = unit(std::array::from_fn(|k| o[k] - along * d[k]));
        (std::array::from_fn(|k| (offset * aside[k] - 1.1 * d[k]) as f32), d.map(|d| d as f32))
    };
    origins.into_iter().zip(directions).map(move_aside).unzip()
}

fn sphere(offset: f64, samples: usize, rule: Rule) -> Made {
    let mut made = Made::sphere(rays_beside(24, offset));
    let numerical_normals = Some((Stencil::Central, 0.004));
    made.settings = Settings { samples, rule, numerical_normals, ..made.settings.clone() };
    made.beta = BETA as f32;
    made
}

/// Mean distance from the surface to where light is absorbed, behind it, for a plane of density: ∫₀^∞ T − ∫₋∞⁰ (1 − T)
/// with T = exp(−½eᵘ) for u < 0 and exp(−u − ½e⁻ᵘ) for u > 0, in units of β: 2(1 − e^(−½)) − (ln ½ + γ + E₁(½)).
const BEHIND: f64 = 0.343_096;

#[test]
fn zero_planes_are_a_sphere_at_its_depth_with_its_normals() {
    for (rule, samples, bound) in
        [(Rule::Analytic, 1200, 1e-3), (Rule::Midpoint, 2400, 5e-3), (Rule::Left, 9600, 0.2)]
    {
        let made = sphere(0.0, samples, rule);
        let (out, _) = made.render();
        for ray in 0..made.origins.len() {
            let d = made.directions[ray].map(f64::from);
            let x = out.points[ray].map(f64::from);
            let depth = x[0] * d[0] + x[1] * d[1] + x[2] * d[2];
            let error = (depth - (BEHIND * BETA - RADIUS)).abs() / BETA;
            assert!(error < bound, "{rule:?}: depth {depth}, off by {error}β");
            assert!((out.opacity[ray] - 1.0).abs() < 1e-5, "{rule:?}: opacity {}", out.opacity[ray]);
            for (n, d) in out.normals[ray].into_iter().zip(d) {
                assert!((f64::from(n) + d).abs() < 1e-3, "{rule:?}: {:?} towards the ray", out.normals[ray]);
            }
        }
    }
}

#[test]
fn normals_of_the_sphere_are_radial_beside_its_centre() {
    let made = sphere(0.03, 1200, Rule::Analytic);
    let (out, _) = made.render();
    for (x, n) in out.points.iter().zip(&out.normals) {
        let radial = unit(x.map(f64::from));
        let cosine = radial.iter().zip(n).fold(0.0, |sum, (r, n)| sum + r * f64::from(*n));
        // the mean of normals along the ray and the normal at the mean point
        assert!(cosine > 0.9995, "{n:?} at {x:?}: {cosine}");
    }
}

#[test]
fn the_opacity_beside_the_sphere_is_the_integral() {
    // Simpson's rule for the density along a ray; the sphere is met or not
    let exact = |offset: f64| {
        let sigma = |t: f64| {
            let s = (offset * offset + t * t).sqrt() - RADIUS;
            let psi = if s > 0.0 { 0.5 * libm::exp(-s / BETA) } else { 1.0 - 0.5 * libm::exp(s / BETA) };
            psi / BETA
        };
        let (n, h) = (8000, 0.4 / 8000.0);
        let weight = |i: i32| f64::from(if i == 0 || i == n { 1 } else { 2 + 2 * (i % 2) });
        let depth = (0..=n).fold(0.0, |sum, i| sum + weight(i) * sigma(-0.2 + h * f64::from(i))) * h / 3.0;
        -libm::expm1(-depth)
    };
    let mut seen = (1.0_f64, 0.0_f64);
    for offset in [0.03, 0.045, 0.049, 0.052, 0.06, 0.075] {
        let (made, exact) = (sphere(offset, 1200, Rule::Analytic), exact(offset));
        seen = (if exact < seen.0 { exact } else { seen.0 }, if exact > seen.1 { exact } else { seen.1 });
        for opacity in made.render().0.opacity {
            let error = (f64::from(opacity) - exact).abs();
            assert!(error < 2e-3 * exact + 1e-5, "at {offset}: {opacity} for {exact}");
        }
    }
    assert!(seen.0 < 0.1 && seen.1 > 0.99, "from {} to {}", seen.0, seen.1);
}

#[test]
fn odd_and_even_sample_counts_meet_the_centre_alike() {
    for axis in 0..3 {
        let [mut o, mut d] = [[0.0; 3]; 2];
        (o[axis], d[axis]) = (-1.0, 1.0);
        let depths: Vec<f32> = [599, 600, 601]
            .into_iter()
            .map(|samples| {
                let mut made = sphere(0.0, samples, Rule::Analytic);
                (made.origins, made.directions) = (vec![o], vec![d]);
                let (out, plan) = made.render();
                let gradients = flat(&mut made.gradients(&out, &plan, 64));
                assert!(gradients.iter().all(|g| g.is_finite()), "axis {axis}, {samples} samples");
                out.points[0][axis]
            })
            .collect();
        for depth in &depths {
            assert!((depth - depths[0]).abs() < 1e-3 * BETA as f32, "axis {axis}: {depths:?}");
        }
    }
}

#[test]
fn rays_from_the_centre_and_both_zeros_have_one_image_and_finite_gradients() {
    for rule in [Rule::Left, Rule::Midpoint, Rule::Analytic] {
        let render = |zero: f32| {
            let mut made = Made::random(1, 31);
            made.origins = vec![[zero; 3], [zero, zero, -0.25], [zero, -1.0, zero]];
            made.directions = vec![[1.0, zero, zero], [zero, zero, 1.0], [zero, 1.0, zero]];
            made.settings.rule = rule;
            made.settings.numerical_normals = Some((Stencil::Forward, 0.0625));
            let (out, plan) = made.render();
            let gradients = flat(&mut made.gradients(&out, &plan, 64));
            (out, gradients)
        };
        let (plus, minus) = (render(0.0), render(-0.0));
        assert!(plus.1.iter().all(|g| g.is_finite()), "{rule:?}");
        assert!(plus.0.opacity.iter().all(|o| *o > 0.0), "{rule:?}: {:?}", plus.0.opacity);
        assert_eq!(plus.0.values, minus.0.values, "{rule:?}: values");
        assert_eq!(plus.0.points, minus.0.points, "{rule:?}: points");
        assert_eq!(plus.0.normals, minus.0.normals, "{rule:?}: normals");
        assert_eq!(plus.1, minus.1, "{rule:?}: gradients");
    }
}

#[test]
fn a_ray_that_misses_the_box_has_the_background_and_no_gradient() {
    let mut made = Made::embedded(3, 14);
    made.origins = vec![[2.0, 0.1, 0.1], [0.7, -1.0, 0.2], [0.1, 0.1, -1.0]];
    made.directions = vec![[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]];
    made.settings.rule = Rule::Analytic;
    made.settings.numerical_normals = Some((Stencil::Central, 0.0625));
    let (out, plan) = made.render();
    assert_eq!(plan.taken(), 0, "no samples");
    assert_eq!(out.values, vec![0.75; 33], "the background");
    assert_eq!((out.opacity.clone(), out.points.clone()), (vec![0.0; 3], vec![[0.0; 3]; 3]), "nothing");
    assert_eq!(out.normals, vec![[0.0; 3]; 3], "no normals");
    let mut bar = made.gradients(&out, &plan, 64);
    let background = std::mem::take(&mut bar.background);
    assert!(flat(&mut bar).iter().all(|g| *g == 0.0), "only the background has a gradient");
    let sum = crate::chains::values(54, 99)[..33].iter().fold(0.0, |sum, v| sum + f64::from(*v));
    assert!((f64::from(background) - sum).abs() < 1e-6, "the sum of all cotangents: {background} {sum}");
    // and it changes nothing for others
    let mut both = Made::embedded(5, 15);
    let alone = both.render().0;
    both.origins.insert(2, [2.0, 0.1, 0.1]);
    both.directions.insert(2, [1.0, 0.0, 0.0]);
    let mut with = both.render().0;
    with.values.drain(22..33);
    with.opacity.remove(2);
    assert_eq!((with.values, with.opacity), (alone.values, alone.opacity), "other rays");
}

#[test]
fn units_at_zero_have_no_slope() {
    // zero planes: every unit is at its kink, and the features are 0
    let mut made = Made::sphere(rays(40, 16));
    made.beta = 0.05;
    let (out, plan) = made.render();
    let mut bar = made.gradients(&out, &plan, 64);
    assert!(bar.beta != 0.0 && bar.background != 0.0, "β {} and background {}", bar.beta, bar.background);
    (bar.beta, bar.background) = (0.0, 0.0);
    assert!(flat(&mut bar).iter().all(|g| *g == 0.0), "planes and weights");
    for (values, rest) in out.values.chunks_exact(11).zip(&out.rest) {
        let grey = 0.5 * (1.0 - rest) + rest * 0.75;
        assert!(values[..8].iter().all(|v| (v - grey).abs() < 1e-6), "sigmoids of 0: {values:?}");
    }
}

#[test]
fn early_stop_changes_values_by_what_it_leaves_out() {
    for combine in [Combine::Concat, Combine::Sum] {
        let mut made = Made::random(120, 36);
        if combine == Combine::Sum {
            made = made.summed();
        }
        let (all, full) = made.render();
        for stop in [0.5, 0.0625, 0.01] {
            made.settings.early_stop = Some(stop);
            let (out, plan) = made.render();
            assert!(plan.taken() < full.taken(), "{stop}: fewer samples");
            for ray in 0..made.origins.len() {
                let is_stopped = plan.last[ray] < full.last[ray];
                assert!(!is_stopped || out.rest[ray] <= stop, "{stop}: ray {ray} stops");
                // values and background are within −1..1
                let bound = if is_stopped { 2.0 * out.rest[ray] + 1e-6 } else { 0.0 };
                for (a, b) in out.values[11 * ray..][..11].iter().zip(&all.values[11 * ray..][..11]) {
                    assert!((a - b).abs() <= bound, "{stop}: ray {ray}: {a} {b}");
                }
                assert!((out.opacity[ray] - all.opacity[ray]).abs() <= bound, "{stop}: ray {ray}");
            }
            let gradients = made.gradients(&out, &plan, 64);
            assert!(gradients.planes.iter().any(|g| *g != 0.0), "{stop}");
            made.settings.early_stop = None;
        }
    }
}

/// A least weight changes values by what it leaves out, and nothing else.
#[test]
fn least_weight_replaces_values_by_the_background() {
    for rule in [Rule::Midpoint, Rule::Analytic] {
        let mut made = Made::embedded(120, 36);
        made.settings.rule = rule;
        let (all, full) = made.render();
        assert!(full.shaded.is_empty(), "without a least weight all samples have values");
        for least in [1e-3, 0.03125] {
            made.settings.least_weight = Some(least);
            let (out, plan) = made.render();
            let decoded = plan.shaded.iter().filter(|s| **s == 1).count();
            assert!(decoded > 0 && decoded < full.taken(), "{least}: {decoded} of {}", full.taken());
            let same = (&out.opacity, &out.points, &plan.last) == (&all.opacity, &all.points, &full.last);
            assert!(same, "{least}: opacities, points and samples");
            for ray in 0..made.origins.len() {
                let q = out.values.len() / made.origins.len();
                // values and background are within −1..1
                let left = out.rest[ray] - all.rest[ray];
                for (a, b) in out.values[q * ray..][..q].iter().zip(&all.values[q * ray..][..q]) {
                    assert!(
                        (a - b).abs() <= 2.0 * left + 1e-6,
                        "{least}: ray {ray}: {a} {b}, {left} left out"
                    );
                }
            }
            let bar = made.gradients(&out, &plan, 64);
            assert!(bar.planes.iter().any(|g| *g != 0.0), "{least}");
        }
        // above every weight: the background, and no gradient of any value
        made.settings.least_weight = Some(1.0);
        let (out, plan) = made.render();
        let background = made.settings.background;
        assert!(plan.shaded.iter().all(|s| *s == 0));
        assert!(out.values.iter().all(|v| (v - background).abs() < 1e-6), "the background everywhere");
        let bar = made.gradients(&out, &plan, 64);
        assert!(bar.heads.color.iter().flatten().all(|g| *g == 0.0), "no value is decoded");
    }
}

/// With panoramas a further input of the colour is the cosine of normal and reflection; its derivatives are checked on
/// the fifth case of the operator.
#[test]
fn the_cosine_of_the_reflection_is_an_input_of_the_colour() {
    let (plain, wide) = (Made::embedded(40, 16), Made::embedded(40, 16).with_cosine());
    let (out, plan) = plain.render();
    let (again, same_plan) = wide.render();
    assert!(again == out, "a column of 0 changes nothing");
    let (plain, wide) = (plain.gradients(&out, &plan, 64), wide.gradients(&again, &same_plan, 64));
    assert_eq!(wide.panoramas, plain.panoramas, "gradients of the panoramas");
    assert_eq!(wide.planes, plain.planes, "gradients of the planes");
    let width = wide.heads.color[0].len() / 6;
    let column = wide.heads.color[0].chunks_exact(width).map(|row| row[width - 1]);
    assert!(column.filter(|g| *g != 0.0).count() >= 3, "the weights of the cosine have gradients");
}

#[test]
fn a_ray_of_opacity_at_the_threshold_is_not_valid() {
    let mut made = Made::random(200, 36);
    made.settings.numerical_normals = Some((Stencil::Forward, 0.0625));
    let (out, plan) = made.render();
    let mut seen = [0, 0];
    for ray in 0..made.origins.len() {
        let is_valid = out.opacity[ray] > 0.98;
        seen[usize::from(is_valid)] += 1;
        assert_eq!(out.normals[ray] != [0.0; 3], is_valid, "ray {ray}: opacity {}", out.opacity[ray]);
        let inside = out.points[ray].iter().all(|x| x.abs() <= HALF_SIZE);
        assert!(inside, "ray {ray}: {:?}", out.points[ray]);
    }
    assert!(seen[0] > 5 && seen[1] > 5, "both kinds: {seen:?}");
    // a cotangent of normals alone reaches nothing through rays that are not valid
    let invalid: Vec<usize> = (0..made.origins.len()).filter(|ray| !(out.opacity[*ray] > 0.98)).collect();
    assert!(invalid.iter().all(|ray| out.lengths[*ray] == 0.0), "their length is not kept");
    assert_eq!(plan.last.len(), made.origins.len(), "one number per ray");
}
