//! `field.fetch`

use super::{check_sizes, half_size};
use crate::field::fetch::{self, Combine, Planes};
use crate::ops::call::RunResult;
use crate::ops::case::Draw;
use crate::ops::op::{Case, CheckedCall, Op};
use crate::tape::check::Prediction;
use crate::{Error, Result};
use reference::settings::Setting;

/// `field.fetch`
pub(in crate::ops) static FETCH: Op = Op {
    work_unit: "texels",
    work_ns: [10.0, 100.0],
    check,
    predict,
    cases: 3,
    ..Op::new(&reference::field::fetch::SIGNATURE, run, case)
};

fn check(x: &CheckedCall<'_>) -> Result<()> {
    check_sizes(x, "planes", &["C"])?;
    if ![3, 6].contains(&x.dim("P")) || x.dim("S") < 2 {
        return Err(Error::input("array 'planes'")
            .expected("3 or 6 planes of 2×2 texels or more")
            .got(format!("{:?}", x.shape("planes"))));
    }
    half_size(x).map(drop)
}

fn combine(x: &CheckedCall<'_>) -> Combine {
    if x.word("combine") == Some("sum") { Combine::Sum } else { Combine::Concat }
}

fn planes<'a>(x: &CheckedCall<'_>, values: &'a [f32]) -> Result<Planes<'a>> {
    let [count, side, channels] = ["P", "S", "C"].map(|letter| x.dim(letter));
    Ok(Planes { values, count, side, channels, half_size: half_size(x)? })
}

fn run(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (points, values, combine) = (x.rows::<3>("points"), x.f32s("planes"), combine(x));
    let planes = planes(x, &values)?;
    let shape = [points.len(), combine.width(planes.channels)];
    let mut features = vec![0.0; shape[0] * shape[1]];
    fetch::forward(&planes, combine, &points, &mut features);
    let mut ran = RunResult::default();
    ran.outputs.put("features", &shape, features);
    if let Some(bar) = x.bar("features", &shape)? {
        let mut points_bar = x.start_rows::<3>("points", points.len());
        let mut planes_bar = x.start("planes", values.len());
        fetch::adjoint(&planes, combine, &points, &bar, &mut points_bar, &mut planes_bar);
        ran.gradients.put("points", &[points.len(), 3], points_bar.into_flattened());
        ran.gradients.put("planes", &x.shape("planes"), planes_bar);
    }
    Ok(ran)
}

/// Coordinates outside the box, and texels of cells that no point reads.
fn predict(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    let (points, values) = (x.rows::<3>("points"), x.f32s("planes"));
    let planes = planes(x, &values)?;
    let outside: Vec<bool> = points.as_flattened().iter().map(|p| p.abs() >= planes.half_size).collect();
    let mut unread = vec![true; values.len()];
    for point in &points {
        for pair in 0..3 {
            let corners = planes.corners(pair, *point);
            let offsets = [0, 1, planes.side, planes.side + 1];
            for (offset, w) in offsets.into_iter().zip(corners.weights).filter(|(_, w)| *w != 0.0) {
                debug_assert!(w > 0.0, "weights are not negative");
                unread[(corners.at + offset) * planes.channels..][..planes.channels].fill(false);
            }
        }
    }
    let zeros = [("points".to_owned(), outside), ("planes".to_owned(), unread)];
    Ok(Prediction { zeros: zeros.into(), ..Prediction::default() })
}

/// Minimum distance of generated coordinates from the border of a cell, in texels, and from 0.
const MARGIN: f32 = 0.05;

/// Case 0: six planes, one point in five partly outside the box; 1: three planes, their sum; 2: six planes of
/// more channels than eight, more points than one task has.
fn case(case: usize) -> Case {
    let [n, count, side, channels] = [[13, 6, 5, 3], [29, 3, 4, 5], [90, 6, 9, 11]][case];
    let half_size = [0.5, 0.75, 0.5][case];
    let apart = |p: &[f32]| {
        p.iter().all(|p| {
            let u = (p + 1.0) * 0.5 * (side - 1) as f32;
            (u - u.round()).abs() >= MARGIN && p.abs() >= MARGIN
        })
    };
    let pool = Draw::new(60, case, 0).uniforms(40 * n, -1.0, 1.0);
    let mut points: Vec<f32> =
        pool.chunks_exact(3).filter(|p| apart(p)).take(n).flatten().map(|p| p * half_size).collect();
    assert_eq!(points.len(), 3 * n, "enough candidates away from the borders");
    if case != 1 {
        points.iter_mut().skip(4).step_by(15).for_each(|p| *p += if *p > 0.0 { 1.0 } else { -1.0 });
    }
    let mut made = Case::default();
    made.inputs.put("points", &[n, 3], points);
    let shape = [count, side, side, channels];
    let texels = Draw::new(60, case, 1).normals(crate::num::array::entries(&shape));
    made.inputs.put("planes", &shape, texels);
    made.settings.insert("half_size".to_owned(), Setting::Number(f64::from(half_size)));
    if case == 1 {
        made.settings.insert("combine".to_owned(), Setting::Text("sum".to_owned()));
    }
    made
}
