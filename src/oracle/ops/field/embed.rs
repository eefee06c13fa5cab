//! `field.embed`

use super::check_sizes;
use crate::field::embed::{self, Decision, Panoramas, Place};
use crate::num::array::Arrays;
use crate::ops::call::RunResult;
use crate::ops::case::Draw;
use crate::ops::op::{Case, CheckedCall, Op};
use crate::tape::check::Prediction;
use crate::{Error, Result};

/// `field.embed`
pub(in crate::ops) static EMBED: Op =
    Op { check, predict, cases: 3, ..Op::new(&reference::field::embed::SIGNATURE, run, case) };

fn check(x: &CheckedCall<'_>) -> Result<()> {
    check_sizes(x, "panoramas", &["L", "C"])?;
    if x.dim("H") < 2 || x.dim("W") < 2 {
        return Err(Error::input("array 'panoramas'")
            .expected("two rows and columns or more")
            .got(format!("{:?}", x.shape("panoramas"))));
    }
    x.rule("rho", "0 to 1", |rho| (0.0..=1.0).contains(&rho))
}

fn panoramas<'a>(x: &CheckedCall<'_>, values: &'a [f32]) -> Panoramas<'a> {
    let [levels, height, width, channels] = ["L", "H", "W", "C"].map(|letter| x.dim(letter));
    Panoramas { values, levels, height, width, channels }
}

/// The decisions of a plan.
fn decisions(plan: &Arrays, panoramas: &Panoramas<'_>, n: usize) -> Result<Vec<Decision>> {
    let need = |name: &str| plan.need(name).map_err(|e| e.within("plan"));
    let (cell, level) = (need("cell")?, need("level")?);
    let (cells, levels) = (cell.to_i64().unwrap_or_default(), level.to_i64().unwrap_or_default());
    let [height, width] = [panoramas.height, panoramas.width].map(|size| size as i64);
    let top = Ord::max(panoramas.levels as i64 - 2, 0);
    let is_there = |c: &[i64]| (-1..height).contains(&c[0]) && (0..width - 1).contains(&c[1]);
    if cell.shape() != [n, 2]
        || level.shape() != [n]
        || !cells.chunks_exact(2).all(is_there)
        || !levels.iter().all(|level| (0..=top).contains(level))
    {
        return Err(Error::input("plan: arrays 'cell' and 'level'")
            .expected(format!("cells and levels of the panoramas for {n} points"))
            .got(format!("shapes {:?} and {:?}", cell.shape(), level.shape())));
    }
    Ok(cells.chunks_exact(2).zip(levels).map(|(c, l)| [c[0] as i32, c[1] as i32, l as i32]).collect())
}

fn run(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (normal, rho, values) = (x.rows::<3>("normal"), x.f32s("rho"), x.f32s("panoramas"));
    let ray = x.has("ray_direction").then(|| x.rows::<3>("ray_direction"));
    let (panoramas, n) = (panoramas(x, &values), rho.len());
    let given = x.call.plan.as_ref().map(|plan| decisions(plan, &panoramas, n)).transpose()?;
    let (h, places) = embed::forward(&panoramas, &normal, ray.as_deref(), &rho, given.as_deref());
    let shape = [n, panoramas.channels];
    let mut ran = RunResult::default();
    ran.outputs.put("h", &shape, h);
    ran.plan.put("cell", &[n, 2], places.iter().flat_map(|place| place.cell).collect());
    ran.plan.put("level", &[n], places.iter().map(|place| place.level).collect());
    if let Some(bar) = x.bar("h", &shape)? {
        let (mut rho_bar, mut bars) = (x.start("rho", n), x.start("panoramas", values.len()));
        embed::adjoint(&panoramas, &places, &bar, &mut rho_bar, &mut bars);
        ran.gradients.put("rho", &[n], rho_bar);
        ran.gradients.put("panoramas", &x.shape("panoramas"), bars);
    }
    Ok(ran)
}

/// Texels that no point reads; ρ with one panorama.
fn predict(x: &CheckedCall<'_>, ran: &RunResult) -> Result<Prediction> {
    let values = x.f32s("panoramas");
    let panoramas = panoramas(x, &values);
    let mut unread = vec![1.0; values.len()];
    // A cotangent of ones from places in the middle of their cells reaches every texel that is read.
    for [row, column, level] in decisions(&ran.plan, &panoramas, x.dim("N"))? {
        let place = Place { cell: [row, column], level, fractions: [0.5; 3] };
        let mut reached = vec![0.0; values.len()];
        panoramas.scatter(&[place], &vec![1.0; panoramas.channels], &mut reached);
        unread.iter_mut().zip(reached).filter(|(_, r)| *r > 0.0).for_each(|(u, _)| *u = 0.0);
    }
    let unread = unread.into_iter().map(|u| u > 0.0).collect();
    let zeros =
        [("panoramas".to_owned(), unread), ("rho".to_owned(), vec![panoramas.levels == 1; x.dim("N")])];
    let unread = if panoramas.levels == 1 { vec!["rho".to_owned()] } else { Vec::new() };
    Ok(Prediction { zeros: zeros.into(), unread, ..Prediction::default() })
}

/// Case 0: four panoramas; case 1: normals without rays and more points than one task has; case 2: one panorama.
fn case(case: usize) -> Case {
    let (n, shape) = [(9, [4, 5, 6, 3]), (90, [3, 9, 4, 11]), (12, [1, 4, 3, 2])][case];
    let draw = |array| Draw::new(68, case, array);
    let mut made = Case::default();
    made.inputs.put("normal", &[n, 3], draw(0).normals(3 * n));
    if case != 1 {
        let rays = crate::ops::call::rows::<3>(&draw(1).normals(3 * n));
        let rays: Vec<[f32; 3]> = rays.into_iter().map(|v| embed::reflect(v, None)).collect();
        made.inputs.put("ray_direction", &[n, 3], rays.into_flattened());
    }
    // away from the borders of the level intervals
    let apart = |u: f32| {
        let intervals = (Ord::max(shape[0], 2) - 1) as f32;
        let at = (intervals * u).floor();
        (at + 0.1 + 0.8 * (intervals * u - at)) / intervals
    };
    made.inputs.put("rho", &[n], draw(2).uniforms(n, 0.0, 1.0).into_iter().map(apart).collect());
    made.inputs.put("panoramas", &shape, draw(3).normals(crate::num::array::entries(&shape)));
    made
}
