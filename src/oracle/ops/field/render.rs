//! `field.render`

mod case;
mod scene;
mod zeros;

use super::{check_sizes, half_size};
use crate::field::render::{self, HeadsBar, InBar, OutBar, Plan, Rule, Scene};
use crate::num::array::Arrays;
use crate::ops::call::{RunResult, rows};
use crate::ops::op::{CheckedCall, Op};
use crate::{Error, Result};
use scene::{HEADS, combine, given, layers, settings, whole, with_scene};

/// `field.render`
pub(in crate::ops) static RENDER: Op = Op {
    work_unit: "products",
    work_ns: [1.0, 60.0],
    check,
    predict: zeros::predict,
    cases: 5,
    ..Op::new(&reference::field::render::SIGNATURE, run, |case| case::case(case, &RENDER))
};

/// Rays per chunk of the adjoint.
const CHUNK: usize = 4096;

/// Checks a head: its layers follow each other, from `inputs` to one of `outputs`.
fn check_head(x: &CheckedCall<'_>, names: &[&str], inputs: usize, outputs: &[usize]) -> Result<()> {
    let mut width = inputs;
    let present = layers(x, names);
    if present.iter().zip(names).any(|(a, b)| a != b) {
        return Err(Error::input(format!("array '{}'", names[0]))
            .expected("the layers before the others")
            .got("a gap"));
    }
    for (l, name) in present.iter().enumerate() {
        let shape = x.shape(name);
        let is_last = l + 1 == present.len();
        if shape.len() != 2 || shape[1] != width || shape[0] == 0 || (is_last && !outputs.contains(&shape[0]))
        {
            let what = if is_last { format!("({outputs:?}, {width})") } else { format!("(N, {width})") };
            return Err(Error::input(format!("array '{name}'")).expected(what).got(format!("{shape:?}")));
        }
        width = shape[0];
    }
    Ok(())
}

fn check(x: &CheckedCall<'_>) -> Result<()> {
    check_sizes(x, "planes", &["C", "N"])?;
    if ![3, 6].contains(&x.dim("P")) || x.dim("S") < 2 {
        let got = format!("{:?}", x.shape("planes"));
        return Err(Error::input("array 'planes'").expected("3 or 6 planes of 2×2 texels or more").got(got));
    }
    half_size(x)?;
    x.rule("beta", "above 0", |beta| beta > 0.0)?;
    for (i, d) in x.rows::<3>("directions").iter().enumerate() {
        let length = ((d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]).sqrt();
        if !((length - 1.0).abs() <= 1e-3) {
            let e = Error::input("array 'directions'").at(format!("row {i}"));
            return Err(e.expected("unit length").got(format!("the length {length}")));
        }
    }
    let features = combine(x).width(x.dim("C"));
    let has = |head: usize| x.has(HEADS[head].1[0]);
    let is_trunk = x.shape("sdf_w2").first() == Some(&4);
    let embedded = if x.has("panoramas") { x.dim("D") } else { 0 };
    check_head(x, HEADS[0].1, features, &[1, 4])?;
    // Behind the features of the embedding there may be n·r.
    let has_cosine = embedded > 0 && x.shape("color_w0").last() == Some(&(features + embedded + 1));
    check_head(x, HEADS[1].1, features + embedded + usize::from(has_cosine), &[3])?;
    check_head(x, HEADS[2].1, features, &[3])?;
    check_head(x, HEADS[3].1, features, &[2])?;
    check_head(x, HEADS[4].1, features, &[3])?;
    check_head(x, HEADS[5].1, features, &[1])?;
    if x.has("panoramas") && !(has(1) && has(4) && has(5)) || has(5) && !x.has("panoramas") {
        let e = Error::input("array 'panoramas'");
        return Err(e
            .expected("panoramas together with the heads color, normal and rho")
            .got("some of them"));
    }
    let wanted = settings(x)?;
    if is_trunk && (has(1) || wanted.rule != Rule::Midpoint || wanted.numerical_normals.is_some()) {
        let e = Error::input("array 'sdf_w2'");
        return Err(e
            .expected("1 output; 4 only with rule=midpoint, normals=none and without a colour head")
            .got("4"));
    }
    x.call.plan.as_ref().map_or(Ok(()), |plan| check_plan(x, plan))
}

/// Checks the steps of a plan and, in that of the twin, the cells of panoramas.
fn check_plan(x: &CheckedCall<'_>, plan: &Arrays) -> Result<()> {
    let n = x.dim("N");
    let (start, index, taken) = (whole(plan, "start")?, whole(plan, "index")?, whole(plan, "taken")?);
    let is_valid = start.len() == n + 1
        && start[0] == 0
        && start[n] == index.len() as i64
        && start.windows(2).all(|w| w[0] <= w[1])
        && taken.len() == n
        && taken.iter().zip(start.windows(2)).all(|(t, w)| (0..=w[1] - w[0]).contains(t))
        && index.iter().all(|i| (0..1 << 24).contains(i));
    if !is_valid {
        return Err(Error::input("plan: arrays 'start', 'index', 'taken'")
            .expected(format!("steps of {n} rays"))
            .got(format!("{}, {} and {} numbers", start.len(), index.len(), taken.len())));
    }
    if plan.get("valid").is_some_and(|valid| valid.len() != n) {
        return Err(Error::input("plan: array 'valid'").expected(format!("{n} numbers")));
    }
    if let Some(shaded) = plan.get("shaded") {
        let e = Error::input("plan: array 'shaded'");
        if settings(x)?.least_weight.is_none() || x.shape("sdf_w2").first() == Some(&4) {
            return Err(e.expected("none without least_weight, and none with a trunk").got("one"));
        }
        if shaded.len() != index.len() {
            let expected = format!("{} numbers, one per step", index.len());
            return Err(e.expected(expected).got(shaded.len().to_string()));
        }
    }
    let [height, width, levels] = ["H", "W", "L"].map(|letter| x.dim(letter) as i64);
    let is_cell = |c: &[i64]| {
        c.len() == 3
            && (-1..height).contains(&c[0])
            && (0..width - 1).contains(&c[1])
            && (0..Ord::max(levels - 1, 1)).contains(&c[2])
    };
    if plan.get("panorama").is_some() && !whole(plan, "panorama")?.chunks(3).all(is_cell) {
        return Err(Error::input("plan: array 'panorama'").expected("cells and levels of the panoramas"));
    }
    Ok(())
}

fn run(x: &CheckedCall<'_>) -> Result<RunResult> {
    with_scene(x, |scene| {
        let mut plan = match &x.call.plan {
            Some(arrays) => given(arrays, scene)?,
            None => Plan::new(scene.all_intervals()),
        };
        let out = render::forward(scene, &mut plan);
        let mut ran = RunResult::default();
        put_plan(&plan, &out, &mut ran.plan);
        if x.lend() {
            gradients(x, scene, &plan, &out, &mut ran.gradients)?;
        }
        put_outputs(scene, out, &mut ran.outputs);
        Ok(ran)
    })
}

/// The output arrays of the values: name, first channel, width.
fn parts(scene: &Scene<'_>) -> Vec<(&'static str, usize, usize)> {
    let c = scene.channels();
    [("color", c.color, 3), ("albedo", c.albedo, 3), ("material", c.material, 2), ("normal", c.normal, 3)]
        .into_iter()
        .filter_map(|(name, at, width)| Some((name, at?, width)))
        .collect()
}

fn put_plan(plan: &Plan, out: &render::Out, into: &mut Arrays) {
    let (n, m) = (plan.intervals.rays(), plan.intervals.samples());
    into.put("start", &[n + 1], plan.intervals.start.iter().map(|s| *s as i64).collect());
    into.put("index", &[m], plan.intervals.index.iter().map(|i| *i as i32).collect());
    into.put("taken", &[n], plan.last.iter().map(|t| *t as i32).collect());
    if !plan.shaded.is_empty() {
        into.put("shaded", &[m], plan.shaded.clone());
    }
    into.put("valid", &[n], out.opacity.iter().map(|o| u8::from(*o > render::VALID)).collect());
}

fn put_outputs(scene: &Scene<'_>, out: render::Out, into: &mut Arrays) {
    let n = out.opacity.len();
    let q = out.values.len() / n.max(1);
    for (name, at, width) in parts(scene) {
        let values = out.values.chunks_exact(q).flat_map(|row| &row[at..at + width]).copied().collect();
        into.put(name, &[n, width], values);
    }
    into.put("point", &[n, 3], out.points.into_flattened());
    if scene.settings.numerical_normals.is_some() {
        into.put("numerical_normal", &[n, 3], out.normals.into_flattened());
    }
    into.put("opacity", &[n], out.opacity);
}

fn gradients(
    x: &CheckedCall<'_>,
    scene: &Scene<'_>,
    plan: &Plan,
    out: &render::Out,
    into: &mut Arrays,
) -> Result<()> {
    let n = out.opacity.len();
    let q = out.values.len() / n.max(1);
    let mut values = vec![0.0; n * q];
    for (name, at, width) in parts(scene) {
        if let Some(bar) = x.bar(name, &[n, width])? {
            for (row, bar) in values.chunks_exact_mut(q).zip(bar.chunks_exact(width)) {
                row[at..at + width].copy_from_slice(bar);
            }
        }
    }
    let opacity = x.bar("opacity", &[n])?.unwrap_or_default();
    let points = rows::<3>(&x.bar("point", &[n, 3])?.unwrap_or_default());
    let normals = match scene.settings.numerical_normals {
        Some(_) => rows::<3>(&x.bar("numerical_normal", &[n, 3])?.unwrap_or_default()),
        None => Vec::new(),
    };
    let out_bar = OutBar { values: &values, opacity: &opacity, points: &points, normals: &normals };
    let mut bar = InBar::zeros_like(scene);
    bar.planes = x.start("planes", bar.planes.len());
    bar.panoramas = if x.has("panoramas") { x.start("panoramas", bar.panoramas.len()) } else { Vec::new() };
    bar.beta = x.start("beta", 1)[0];
    bar.background = x.start("background", 1)[0];
    for ((_, names), head) in HEADS.iter().zip(by_head(&mut bar.heads)) {
        for (name, array) in layers(x, names).into_iter().zip(head) {
            *array = x.start(name, array.len());
        }
    }
    render::adjoint(scene, plan, out, &out_bar, CHUNK, &mut bar);
    into.put("planes", &x.shape("planes"), bar.planes);
    if x.has("panoramas") {
        into.put("panoramas", &x.shape("panoramas"), bar.panoramas);
    }
    into.put("beta", &[], vec![bar.beta]);
    into.put("background", &[], vec![bar.background]);
    for ((_, names), head) in HEADS.iter().zip(by_head(&mut bar.heads)) {
        for (name, array) in layers(x, names).into_iter().zip(head) {
            into.put(name, &x.shape(name), std::mem::take(array));
        }
    }
    Ok(())
}

/// The gradients of the heads in the order of [`HEADS`].
fn by_head(bar: &mut HeadsBar) -> [&mut Vec<Vec<f32>>; 6] {
    let HeadsBar { sdf, color, albedo, material, normal, rho } = bar;
    [sdf, color, albedo, material, normal, rho]
}
