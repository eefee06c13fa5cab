//! `field.render`

use super::{check_sizes, half_size};
use crate::field::embed::Panoramas;
use crate::field::fetch::{Combine, Planes};
use crate::field::network::Network;
use crate::field::normal::Stencil;
use crate::field::render::{
    self, Heads, HeadsBar, InBar, Intervals, OutBar, Plan, Rays, Rule, Scene, Settings,
};
use crate::num::array::Arrays;
use crate::ops::call::{RunResult, rows};
use crate::ops::case::Draw;
use crate::ops::op::{Case, CheckedCall, Op};
use crate::{Error, Result};
use reference::settings::Setting;

/// `field.render`
pub(in crate::ops) static RENDER: Op = Op {
    work_unit: "products",
    work_ns: [1.0, 60.0],
    check,
    cases: 4,
    ..Op::new(&reference::field::render::SIGNATURE, run, case)
};

/// Rays per chunk of the adjoint.
const CHUNK: usize = 4096;

/// Heads with the names of their layers.
const HEADS: [(&str, &[&str]); 6] = [
    ("sdf", &["sdf_w0", "sdf_w1", "sdf_w2"]),
    ("color", &["color_w0", "color_w1", "color_w2", "color_w3"]),
    ("albedo", &["albedo_w0", "albedo_w1", "albedo_w2", "albedo_w3"]),
    ("material", &["material_w0", "material_w1", "material_w2", "material_w3"]),
    ("normal", &["normal_w0", "normal_w1", "normal_w2", "normal_w3"]),
    ("rho", &["rho_w0", "rho_w1", "rho_w2"]),
];

/// The layers of a head that are present.
fn layers<'a>(x: &CheckedCall<'_>, names: &'a [&'a str]) -> Vec<&'a str> {
    names.iter().copied().filter(|name| x.has(name)).collect()
}

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
    check_head(x, HEADS[1].1, features + embedded, &[3])?;
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
    Ok(())
}

fn combine(x: &CheckedCall<'_>) -> Combine {
    if x.word("combine") == Some("sum") { Combine::Sum } else { Combine::Concat }
}

fn settings(x: &CheckedCall<'_>) -> Result<Settings> {
    let samples = x.single(
        "samples",
        128.0,
        |n| n >= 1.0 && n == n.trunc() && n <= 1e6,
        "a whole number from 1 to 1e6",
    )? as usize;
    let half = half_size(x)?;
    let stop = x.single("early_stop", 0.0, |t| (0.0..1.0).contains(&t), "0 to 1")?;
    let epsilon = x.single("epsilon", 8.0 * f64::from(half) / samples as f64, |e| e > 0.0, "above 0")?;
    Ok(Settings {
        samples,
        rule: match x.word("rule") {
            Some("left") => Rule::Left,
            Some("analytic") => Rule::Analytic,
            _ => Rule::Midpoint,
        },
        combine: combine(x),
        early_stop: (stop > 0.0).then_some(stop),
        numerical_normals: match x.word("normals") {
            Some("forward") => Some((Stencil::Forward, epsilon)),
            Some("central") => Some((Stencil::Central, epsilon)),
            _ => None,
        },
        background: x.f32s("background")[0],
    })
}

/// The steps and numbers of samples of a plan.
fn given(plan: &Arrays, scene: &Scene<'_>) -> Result<Plan> {
    let whole = |name: &str| -> Result<Vec<i64>> {
        let array = plan.need(name).map_err(|e| e.within("plan"))?;
        Ok(array.to_i64().unwrap_or_default())
    };
    let (start, index, taken) = (whole("start")?, whole("index")?, whole("taken")?);
    let n = scene.rays.len();
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
    let all = scene.all_intervals();
    let intervals = Intervals {
        start: start.into_iter().map(|s| s as usize).collect(),
        index: index.into_iter().map(|i| i as u32).collect(),
        ..all
    };
    Ok(Plan { intervals, last: taken.into_iter().map(|t| t as u32).collect() })
}

/// Owned arrays of the networks, head by head.
struct Weights(Vec<Vec<Vec<f32>>>);

impl Weights {
    fn of(x: &CheckedCall<'_>) -> Self {
        Self(HEADS.iter().map(|(_, names)| layers(x, names).iter().map(|n| x.f32s(n)).collect()).collect())
    }

    fn views(&self) -> Vec<Vec<&[f32]>> {
        self.0.iter().map(|head| head.iter().map(Vec::as_slice).collect()).collect()
    }
}

fn run(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (origins, directions) = (x.rows::<3>("origins"), x.rows::<3>("directions"));
    let (texels, maps) = (x.f32s("planes"), x.f32s("panoramas"));
    let (weights, settings) = (Weights::of(x), settings(x)?);
    let views = weights.views();
    let features = settings.combine.width(x.dim("C"));
    let net = |head: usize| {
        let inputs = if head == 1 && x.has("panoramas") { features + x.dim("D") } else { features };
        (!views[head].is_empty()).then_some(Network { weights: &views[head], inputs })
    };
    let [levels, height, width, channels] =
        ["L", "H", "W", "D"].map(|letter| if x.has("panoramas") { x.dim(letter) } else { 0 });
    let scene = Scene {
        rays: Rays { origins: &origins, directions: &directions },
        planes: Planes {
            values: &texels,
            count: x.dim("P"),
            side: x.dim("S"),
            channels: x.dim("C"),
            half_size: half_size(x)?,
        },
        panoramas: x.has("panoramas").then_some(Panoramas { values: &maps, levels, height, width, channels }),
        heads: Heads {
            sdf: Network { weights: &views[0], inputs: features },
            color: net(1),
            albedo: net(2),
            material: net(3),
            normal: net(4),
            rho: net(5),
        },
        beta: x.f32s("beta")[0],
        settings,
    };
    let mut plan = match &x.call.plan {
        Some(arrays) => given(arrays, &scene)?,
        None => Plan::new(scene.all_intervals()),
    };
    let out = render::forward(&scene, &mut plan);
    let mut ran = RunResult::default();
    put_plan(&plan, &out, &mut ran.plan);
    if x.with_gradients() {
        gradients(x, &scene, &plan, &out, &mut ran.gradients)?;
    }
    put_outputs(&scene, out, &mut ran.outputs);
    Ok(ran)
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

/// Case 0: six planes, all heads; case 1: directional embedding, numerical normals, the analytic rule, more rays
/// than a block; case 2: three planes, a trunk, early stop; case 3: no values, central differences, left rule.
fn case(case: usize) -> Case {
    let n = [7, 70, 9, 11][case];
    let [count, side, channels] = [[6, 3, 4], [6, 3, 3], [3, 3, 5], [6, 3, 4]][case];
    let draw = |array| Draw::new(69, case, array);
    let mut made = Case::default();
    let inside = draw(0).uniforms(3 * n, -0.2, 0.2);
    let directions: Vec<[f32; 3]> = rows::<3>(&draw(1).normals(3 * n))
        .into_iter()
        .map(|d| d.map(|x| x / ((d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]).sqrt()))
        .collect();
    let origins =
        inside.chunks_exact(3).zip(&directions).flat_map(|(x, d)| (0..3).map(|k| x[k] - 1.2 * d[k]));
    made.inputs.put("origins", &[n, 3], origins.collect());
    made.inputs.put("directions", &[n, 3], directions.into_flattened());
    let shape = [count, side, side, channels];
    made.inputs.put("planes", &shape, draw(2).normals(crate::num::array::entries(&shape)));
    let f = if case == 2 { channels } else { 3 * channels };
    let widths: [&[usize]; 6] = match case {
        0 => [&[5, 4, 1], &[6, 5, 4, 3], &[5, 6, 4, 3], &[4, 5, 6, 2], &[6, 4, 5, 3], &[]],
        1 => [&[5, 4, 1], &[6, 5, 4, 3], &[], &[], &[6, 4, 5, 3], &[5, 4, 1]],
        2 => [&[6, 5, 4], &[], &[], &[], &[], &[]],
        _ => [&[6, 5, 1], &[], &[], &[], &[], &[]],
    };
    if case == 1 {
        made.inputs.put("panoramas", &[2, 2, 2, 3], draw(3).normals(24));
    }
    for (h, ((_, names), widths)) in HEADS.iter().zip(widths).enumerate() {
        let mut k = if h == 1 && case == 1 { f + 3 } else { f };
        for (l, (name, width)) in names.iter().zip(widths).enumerate() {
            let scale = if h == 0 && l + 1 == widths.len() { 0.3 } else { 1.0 } / (k as f32).sqrt();
            let values = draw(10 + 8 * h as u16 + l as u16).normals(width * k);
            made.inputs.put(name, &[*width, k], values.into_iter().map(|w| w * scale).collect());
            k = *width;
        }
    }
    made.inputs.put("beta", &[], vec![[0.0625, 0.03125, 0.0625, 0.03125][case]]);
    made.inputs.put("background", &[], vec![[1.0, 1.0, 0.25, 0.5][case]]);
    let mut set = |key: &str, value: Setting| {
        made.settings.insert(key.to_owned(), value);
    };
    set("half_size", Setting::Number(0.5));
    set("samples", Setting::Number([12.0, 14.0, 16.0, 13.0][case]));
    set("rule", Setting::Text(["midpoint", "analytic", "midpoint", "left"][case].to_owned()));
    match case {
        1 => {
            set("normals", Setting::Text("forward".to_owned()));
            set("epsilon", Setting::Number(0.125));
        }
        2 => {
            set("combine", Setting::Text("sum".to_owned()));
            set("early_stop", Setting::Number(0.0625));
        }
        3 => {
            set("normals", Setting::Text("central".to_owned()));
            set("epsilon", Setting::Number(0.125));
        }
        _ => {}
    }
    made
}
