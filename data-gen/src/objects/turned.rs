//! Bodies of revolution: vessels with a wall, turned solids, mugs with handles, tins.

use super::sheets::{Run, frames, lathe, smooth_run, straight_run, tube};
use super::soup::Soup;
use super::{CREASED, Part, SMOOTH};
use crate::draws::Draws;
use crate::space::{V3, larger, mix, smoothstep};
use reference::num::elem::{cos, sin};
use std::f64::consts::{PI, TAU};

/// Number of columns of a body of revolution.
const AROUND: usize = 96;

/// Radii at heights, from foot to rim, of a kind of vessel.
fn vessel_profile(draws: &mut Draws) -> Vec<[f64; 2]> {
    let u = |draws: &mut Draws, low: f64, high: f64| draws.range(low, high);
    match draws.named_whole("vessel", 0, 5) {
        // Vase: foot, belly, neck, lip.
        0 => {
            let (belly, neck) = (u(draws, 0.4, 0.7), u(draws, 0.12, 0.35));
            let h = u(draws, 1.2, 2.0);
            let lip = neck * u(draws, 1.05, 1.9);
            vec![
                [u(draws, 0.2, 0.4), 0.0],
                [belly * 0.85, 0.22 * h],
                [belly, u(draws, 0.33, 0.5) * h],
                [neck * 1.15, 0.72 * h],
                [neck, 0.85 * h],
                [lip, h],
            ]
        }
        // Bottle.
        1 => {
            let (r, neck, h) = (u(draws, 0.3, 0.5), u(draws, 0.1, 0.16), u(draws, 1.6, 2.4));
            let shoulder = u(draws, 0.5, 0.68);
            vec![
                [r * 0.96, 0.0],
                [r, 0.06 * h],
                [r, 0.3 * h],
                [r, shoulder * h],
                [neck * 1.1, (shoulder + 0.18) * h],
                [neck, (shoulder + 0.25) * h],
                [neck, h],
            ]
        }
        // Bowl.
        2 => {
            let (r, h) = (u(draws, 0.7, 1.1), u(draws, 0.4, 0.8));
            let foot = u(draws, 0.25, 0.4);
            vec![
                [foot * r, 0.0],
                [foot * r * 1.05, 0.08 * h],
                [0.75 * r, u(draws, 0.3, 0.42) * h],
                [0.95 * r, 0.75 * h],
                [r, h],
            ]
        }
        // Goblet.
        3 => {
            let (cup, stem, h) = (u(draws, 0.35, 0.5), u(draws, 0.05, 0.1), u(draws, 1.2, 1.7));
            vec![
                [u(draws, 0.3, 0.42), 0.0],
                [u(draws, 0.2, 0.28), 0.04 * h],
                [stem, 0.14 * h],
                [stem * 1.2, 0.38 * h],
                [cup * 0.75, 0.52 * h],
                [cup, 0.72 * h],
                [cup * u(draws, 0.8, 1.05), h],
            ]
        }
        // Jar or amphora.
        _ => {
            let (r, h) = (u(draws, 0.45, 0.65), u(draws, 0.9, 1.5));
            vec![
                [r * u(draws, 0.4, 0.9), 0.0],
                [r, 0.35 * h],
                [r * 0.97, 0.62 * h],
                [r * u(draws, 0.5, 0.8), 0.86 * h],
                [r * u(draws, 0.55, 0.9), h],
            ]
        }
    }
}

/// A vase, bottle, bowl, goblet or jar with a wall, round or fluted.
pub(super) fn vessel(draws: &mut Draws) -> Vec<Part> {
    let outer = vessel_profile(draws);
    let least = outer.iter().fold(f64::INFINITY, |s, p| crate::space::smaller(s, p[0]));
    let wall = larger(0.025, draws.range(0.25, 0.4) * least);
    let wall = crate::space::smaller(wall, 0.06);
    let flutes = if draws.chance(0.35) { draws.named_whole("flutes", 5, 25) } else { 0 };
    let deep = draws.range(0.02, 0.07);
    let top = outer[outer.len() - 1];
    let foot = outer[0];
    // Along the inside: the same points with smaller radius, ending above the foot on the axis.
    let floor = foot[1] + 0.1 * top[1];
    let mut inner: Vec<[f64; 2]> = outer.iter().rev().map(|p| [p[0] - wall, p[1]]).collect();
    inner.retain(|p| p[1] > floor + 0.05 * top[1]);
    let bottom = inner[inner.len() - 1];
    inner.push([0.55 * bottom[0], floor + 0.25 * (bottom[1] - floor)]);
    inner.push([0.0, floor]);
    let runs: Vec<Run> = vec![
        straight_run([0.0, foot[1] + 0.03 * top[1]], [0.85 * foot[0], foot[1] + 0.02 * top[1]], 6),
        straight_run([0.85 * foot[0], foot[1] + 0.02 * top[1]], foot, 3),
        smooth_run(&outer, 8, 0.3 * least),
        smooth_run(&[top, [top[0] - 0.5 * wall, top[1] + 0.4 * wall], [top[0] - wall, top[1]]], 3, 0.0),
        smooth_run(&inner, 5, 0.02),
    ];
    let n = flutes as f64;
    let height = top[1];
    let soup = lathe(AROUND, &runs, |a, z| {
        let fade = smoothstep(0.05, 0.25, z / height) * (1.0 - smoothstep(0.75, 0.92, z / height));
        1.0 + deep * fade * cos(n * a) * if flutes > 0 { 1.0 } else { 0.0 }
    });
    vec![Part::new(soup, 0.7)]
}

/// A turned solid made of beads and coves: baluster, chess piece, spinning top.
pub(super) fn turned(draws: &mut Draws) -> Vec<Part> {
    vec![Part::new(turned_soup(draws), CREASED)]
}

pub(super) fn turned_soup(draws: &mut Draws) -> Soup {
    let pieces = draws.named_whole("pieces", 4, 9);
    let mut z = 0.0;
    let mut r = draws.range(0.3, 0.5);
    let mut runs: Vec<Run> = vec![straight_run([0.0, 0.0], [r, 0.0], 8)];
    for k in 0..pieces {
        let h = draws.range(0.1, 0.45);
        let end = if k + 1 == pieces { draws.range(0.05, 0.3) } else { draws.range(0.12, 0.5) };
        let (a, b) = ([r, z], [end, z + h]);
        let swing = draws.range(-0.5, 0.9) * h;
        match draws.whole(0, 4) {
            // A bead or a cove between the two radii.
            0 | 1 => {
                let n = 14;
                let run = (0..=n).map(|i| {
                    let t = i as f64 / n as f64;
                    let p = mix(a, b, t);
                    if i == 0 || i == n { p } else { [larger(p[0] + swing * sin(PI * t), 0.05), p[1]] }
                });
                let mut run: Run = run.collect();
                run[n] = b;
                runs.push(run);
            }
            2 => runs.push(straight_run(a, b, 6)),
            _ => {
                runs.push(straight_run(a, [a[0], b[1]], 4));
                if (a[0] - b[0]).abs() > 0.01 {
                    runs.push(straight_run([a[0], b[1]], b, 3));
                } else {
                    r = a[0];
                    z = b[1];
                    continue;
                }
            }
        }
        (r, z) = (b[0], b[1]);
    }
    // A dome on top.
    let dome = draws.range(0.3, 1.2) * r;
    let n = 8;
    let mut run: Run = (0..=n)
        .map(|i| {
            let t = 0.5 * PI * f64::from(i) / f64::from(n);
            [r * cos(t), z + dome * sin(t)]
        })
        .collect();
    run[0] = [r, z];
    run[n as usize] = [0.0, z + dome];
    runs.push(run);
    lathe(AROUND, &runs, |_, _| 1.0)
}

/// A cylinder with bevelled rims and given radius and height.
pub(super) fn cylinder(r: f64, h: f64, top: f64, bevel: f64) -> Soup {
    let runs: Vec<Run> = vec![
        straight_run([0.0, 0.0], [r - bevel, 0.0], 6),
        straight_run([r - bevel, 0.0], [r, bevel], 2),
        straight_run([r, bevel], [top, h - bevel], 10),
        straight_run([top, h - bevel], [top - bevel, h], 2),
        straight_run([top - bevel, h], [0.0, h], 6),
    ];
    lathe(64, &runs, |_, _| 1.0)
}

/// A mug: a wall with a floor, and a handle whose ends are inside the wall.
pub(super) fn mug(draws: &mut Draws) -> Vec<Part> {
    let (r, h) = (draws.named("radius", 0.38, 0.6), draws.named("height", 0.8, 1.2));
    let top = r * draws.range(0.9, 1.15);
    let wall = draws.range(0.04, 0.07);
    let edge = 0.03;
    let runs: Vec<Run> = vec![
        straight_run([0.0, 0.02], [0.8 * r, 0.02], 6),
        straight_run([0.8 * r, 0.02], [0.86 * r, 0.0], 2),
        straight_run([0.86 * r, 0.0], [r - edge, 0.0], 2),
        smooth_run(&[[r - edge, 0.0], [r - 0.3 * edge, 0.3 * edge], [r, edge]], 3, 0.0),
        straight_run([r, edge], [top, h], 16),
        smooth_run(&[[top, h], [top - 0.5 * wall, h + 0.4 * wall], [top - wall, h]], 4, 0.0),
        straight_run([top - wall, h], [r - wall, 2.0 * wall], 14),
        smooth_run(&[[r - wall, 2.0 * wall], [r - 1.6 * wall, 1.4 * wall], [0.7 * r, 1.2 * wall]], 3, 0.0),
        straight_run([0.7 * r, 1.2 * wall], [0.0, 1.2 * wall], 5),
    ];
    let body = lathe(AROUND, &runs, |_, _| 1.0);
    let reach = draws.range(0.28, 0.42);
    let (low, high) = (draws.range(0.14, 0.24) * h, draws.range(0.74, 0.86) * h);
    let square = draws.range(0.9, 2.2);
    let n = 40;
    let wall_at = |z: f64| r + (top - r) * (z - edge) / (h - edge) - 0.6 * wall;
    let curve: Vec<V3> = (0..=n)
        .map(|i| {
            let t = PI * (i as f64 / n as f64) - 0.5 * PI;
            let (c, s) = (cos(t), sin(t));
            let bow = crate::space::power(c, 1.0 / square);
            let z = 0.5 * (low + high) + 0.5 * (high - low) * s;
            [wall_at(z) + reach * bow, 0.0, z]
        })
        .collect();
    let (a, b) = (draws.range(0.035, 0.06), draws.range(0.05, 0.1));
    let handle = tube(&frames(&curve), 24, None, |_, j| {
        let t = TAU * j as f64 / 24.0;
        [a * cos(t), b * sin(t)]
    });
    let mut both = body;
    if draws.chance(0.6) {
        both.append(&handle);
        vec![Part::new(both, 0.75)]
    } else {
        vec![Part::new(both, 0.75), Part::new(handle, SMOOTH)]
    }
}

/// A tin or a round box: a labelled cylinder with rims.
pub(super) fn tin(draws: &mut Draws) -> Vec<Part> {
    let (r, h) = (draws.named("radius", 0.3, 0.6), draws.named("height", 0.5, 1.4));
    let rim = 0.03;
    let label: Vec<Run> = vec![
        straight_run([0.0, 0.07], [r - 0.04, 0.07], 3),
        straight_run([r - 0.04, 0.07], [r, 0.07], 1),
        straight_run([r, 0.07], [r, h - 0.07], 16),
        straight_run([r, h - 0.07], [r - 0.04, h - 0.07], 1),
        straight_run([r - 0.04, h - 0.07], [0.0, h - 0.07], 3),
    ];
    let lid = |up: f64| {
        let at = |r: f64, z: f64| [r, 0.5 * h + up * (0.5 * h - z)];
        let mut runs: Vec<Run> = vec![
            straight_run(at(0.0, 0.04), at(r - 2.0 * rim, 0.04), 6),
            straight_run(at(r - 2.0 * rim, 0.04), at(r - rim, 0.0), 2),
            smooth_run(&[at(r - rim, 0.0), at(r + 0.3 * rim, -0.2 * rim), at(r + 0.6 * rim, rim)], 3, 0.0),
            straight_run(at(r + 0.6 * rim, rim), at(r + 0.1 * rim, 0.075), 2),
            straight_run(at(r + 0.1 * rim, 0.075), at(0.0, 0.08), 6),
        ];
        if up > 0.0 {
            runs.reverse();
            for run in &mut runs {
                run.reverse();
            }
        }
        lathe(AROUND, &runs, |_, _| 1.0)
    };
    let mut lids = lid(1.0);
    lids.append(&lid(-1.0));
    vec![Part::new(lathe(AROUND, &label, |_, _| 1.0), CREASED).printed(), Part::new(lids, CREASED).metallic()]
}
