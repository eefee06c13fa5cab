//! Generated cases.

use super::scene::{HEADS, with_scene};
use super::zeros::Reached;
use crate::ops::call::{Call, rows};
use crate::ops::case::Draw;
use crate::ops::op::{Case, CheckedCall, Op};
use reference::settings::Setting;

/// Seed of all draws. R4 compares the sums of few numbers of both signs, the gradient of β above all, to 1e-6: their
/// rounding errors are as large where they cancel to a tenth of their terms.
const SEED: u64 = 72;

/// Minimum distance of generated hidden units and signed distances from 0: finite differences on the live plan then
/// cross no kink, and f32 takes the decisions of f64.
const MARGIN: f64 = 2e-4;

/// Case 0: six planes, all heads; case 1: directional embedding, numerical normals, the analytic rule, more rays
/// than a block; case 2: three planes, a trunk, early stop; case 3: no values, central differences, left rule; case 4: as
/// case 1 without numerical normals, with n·r and least weight.
/// One ray in five starts in the box, and the last one misses it.
pub(super) fn case(case: usize, op: &'static Op) -> Case {
    let n = [7, 70, 9, 11, 70][case];
    let mut made = Case::default();
    put_field(case, &mut made);
    put_settings(case, &mut made);
    let pool = candidates(case, 4 * n);
    let [origins, directions] = [0, 1].map(|k| pool.iter().flat_map(|ray| ray[k]).collect::<Vec<f32>>());
    made.inputs.put("origins", &[pool.len(), 3], origins);
    made.inputs.put("directions", &[pool.len(), 3], directions);
    let mut rays: Vec<[[f32; 3]; 2]> = apart(&made, op)
        .into_iter()
        .zip(pool)
        .filter_map(|(is_apart, ray)| is_apart.then_some(ray))
        .collect();
    assert!(rays.len() >= n, "enough candidates away from the kinks");
    rays.truncate(n);
    rays[n - 1] = [[0.25, -1.0, 0.125], [0.0, -1.0, 0.0]];
    let [origins, directions] = [0, 1].map(|k| rays.iter().flat_map(|ray| ray[k]).collect::<Vec<f32>>());
    made.inputs.put("origins", &[n, 3], origins);
    made.inputs.put("directions", &[n, 3], directions);
    made
}

/// Rays that cross the box.
fn candidates(case: usize, n: usize) -> Vec<[[f32; 3]; 2]> {
    let draw = |array| Draw::new(SEED, case, array);
    let inside = rows::<3>(&draw(0).uniforms(3 * n, -0.2, 0.2));
    let directions = rows::<3>(&draw(1).normals(3 * n));
    let ray = |(i, (x, d)): (usize, ([f32; 3], [f32; 3]))| {
        let length = ((d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]).sqrt();
        let d = d.map(|x| x / length);
        let back = if i % 5 == 3 { 0.15 } else { 1.2 };
        [std::array::from_fn(|k| x[k] - back * d[k]), d]
    };
    inside.into_iter().zip(directions).enumerate().map(ray).collect()
}

/// Whether each ray is away from all kinks.
fn apart(case: &Case, op: &'static Op) -> Vec<bool> {
    let call = Call { inputs: case.inputs.clone(), settings: case.settings.clone(), ..Call::default() };
    let of = |x: &CheckedCall<'_>| {
        with_scene(x, |scene| {
            let intervals = scene.all_intervals();
            let margin = |ray: usize| {
                let mut reached = Reached::new(x, scene);
                let taken = intervals.start[ray + 1] - intervals.start[ray];
                reached.ray((&intervals, &[]), (ray, taken), true);
                reached.margin
            };
            Ok((0..scene.rays.len()).map(|ray| margin(ray) >= MARGIN).collect())
        })
    };
    CheckedCall::new(op, &call, true).and_then(|x| of(&x)).expect("a generated case is valid")
}

/// Planes, panoramas, heads, β and background.
fn put_field(case: usize, made: &mut Case) {
    let [count, side, channels] = [[6, 3, 4], [6, 3, 3], [3, 3, 5], [6, 3, 4], [6, 3, 3]][case];
    let draw = |array| Draw::new(SEED, case, array);
    let shape = [count, side, side, channels];
    made.inputs.put("planes", &shape, draw(2).normals(crate::num::array::entries(&shape)));
    let f = if case == 2 { channels } else { 3 * channels };
    let widths: [&[usize]; 6] = match case {
        0 => [&[5, 4, 1], &[6, 5, 4, 3], &[5, 6, 4, 3], &[4, 5, 6, 2], &[6, 4, 5, 3], &[]],
        1 | 4 => [&[5, 4, 1], &[6, 5, 4, 3], &[], &[], &[6, 4, 5, 3], &[5, 4, 1]],
        2 => [&[6, 5, 4], &[], &[], &[], &[], &[]],
        _ => [&[6, 5, 1], &[], &[], &[], &[], &[]],
    };
    if case == 1 || case == 4 {
        let mut values = draw(3).normals(72);
        if case == 4 {
            // The gradients of ρ are differences of the panoramas, whose sums must not cancel.
            values[36..].iter_mut().for_each(|x| *x += 2.0);
        }
        made.inputs.put("panoramas", &[2, 4, 3, 3], values);
    }
    for (h, ((_, names), widths)) in HEADS.iter().zip(widths).enumerate() {
        let mut k = f + if h == 1 { [0, 3, 0, 0, 4][case] } else { 0 };
        for (l, (name, width)) in names.iter().zip(widths).enumerate() {
            let values = draw(10 + 8 * h as u16 + l as u16).normals(width * k);
            let scaled = values.into_iter().map(|w| w / (k as f32).sqrt()).collect();
            made.inputs.put(name, &[*width, k], scaled);
            k = *width;
        }
    }
    made.inputs.put("beta", &[], vec![[0.125, 0.25, 0.125, 0.125, 0.75][case]]);
    made.inputs.put("background", &[], vec![[1.0, 1.0, 0.25, 0.5, 0.75][case]]);
}

fn put_settings(case: usize, made: &mut Case) {
    let mut set = |key: &str, value: Setting| {
        made.settings.insert(key.to_owned(), value);
    };
    set("half_size", Setting::Number(0.5));
    set("samples", Setting::Number([12.0, 8.0, 16.0, 13.0, 8.0][case]));
    set("rule", Setting::Text(["midpoint", "analytic", "midpoint", "left", "analytic"][case].to_owned()));
    match case {
        1 => {
            set("normals", Setting::Text("forward".to_owned()));
            set("epsilon", Setting::Number(0.125));
        }
        2 => {
            set("combine", Setting::Text("sum".to_owned()));
            set("early_stop", Setting::Number(0.875));
        }
        3 => {
            set("normals", Setting::Text("central".to_owned()));
            set("epsilon", Setting::Number(0.125));
        }
        4 => set("least_weight", Setting::Number(0.125)),
        _ => {}
    }
}
