//! The learned perceptual distance.

use super::call::{Checked, Ran, entries};
use super::case::Draw;
use super::op::{Case, Dtype, Kind, Op, Port, SettingSpec, Width, no_zeros};
use crate::loss::lpips::{self, CONVOLUTIONS, POOLED, Plan, TAPS, Weights};
use crate::num::array::Arrays;
use crate::{Error, Result};
use reference::settings::Setting;

const fn weight(name: &'static str, shape: &'static str) -> Port {
    Port::fixed(name, shape, "absent, all of them: weights by a formula").or_absent()
}

const INPUTS: &[Port] = &[
    Port::var("x", "H,W,3", "usually the render, sRGB-encoded"),
    Port::var("y", "H,W,3", "usually the photograph, sRGB-encoded"),
    weight("features.0.weight", "C11,3,3,3"),
    weight("features.0.bias", "C11"),
    weight("features.2.weight", "C12,C11,3,3"),
    weight("features.2.bias", "C12"),
    weight("features.5.weight", "C21,C12,3,3"),
    weight("features.5.bias", "C21"),
    weight("features.7.weight", "C22,C21,3,3"),
    weight("features.7.bias", "C22"),
    weight("features.10.weight", "C31,C22,3,3"),
    weight("features.10.bias", "C31"),
    weight("features.12.weight", "C32,C31,3,3"),
    weight("features.12.bias", "C32"),
    weight("features.14.weight", "C33,C32,3,3"),
    weight("features.14.bias", "C33"),
    weight("features.17.weight", "C41,C33,3,3"),
    weight("features.17.bias", "C41"),
    weight("features.19.weight", "C42,C41,3,3"),
    weight("features.19.bias", "C42"),
    weight("features.21.weight", "C43,C42,3,3"),
    weight("features.21.bias", "C43"),
    weight("features.24.weight", "C51,C43,3,3"),
    weight("features.24.bias", "C51"),
    weight("features.26.weight", "C52,C51,3,3"),
    weight("features.26.bias", "C52"),
    weight("features.28.weight", "C53,C52,3,3"),
    weight("features.28.bias", "C53"),
    weight("lin0.model.1.weight", "1,C12,1,1"),
    weight("lin1.model.1.weight", "1,C22,1,1"),
    weight("lin2.model.1.weight", "1,C33,1,1"),
    weight("lin3.model.1.weight", "1,C43,1,1"),
    weight("lin4.model.1.weight", "1,C53,1,1"),
];

const INTERMEDIATES: &[Port] = &[
    Port::fixed("layers", "5", "the terms of the sum"),
    Port::fixed("relu1_1", "2,H1,W1,C11", "what passes, of x, then y"),
    Port::fixed("relu1_2", "2,H1,W1,C12", "what passes, of x, then y"),
    Port::fixed("relu2_1", "2,H2,W2,C21", "what passes, of x, then y"),
    Port::fixed("relu2_2", "2,H2,W2,C22", "what passes, of x, then y"),
    Port::fixed("relu3_1", "2,H3,W3,C31", "what passes, of x, then y"),
    Port::fixed("relu3_2", "2,H3,W3,C32", "what passes, of x, then y"),
    Port::fixed("relu3_3", "2,H3,W3,C33", "what passes, of x, then y"),
    Port::fixed("relu4_1", "2,H4,W4,C41", "what passes, of x, then y"),
    Port::fixed("relu4_2", "2,H4,W4,C42", "what passes, of x, then y"),
    Port::fixed("relu4_3", "2,H4,W4,C43", "what passes, of x, then y"),
    Port::fixed("relu5_1", "2,H5,W5,C51", "what passes, of x, then y"),
    Port::fixed("relu5_2", "2,H5,W5,C52", "what passes, of x, then y"),
    Port::fixed("relu5_3", "2,H5,W5,C53", "what passes, of x, then y"),
];

const PLAN: &[Port] = &[
    Port::int("active1_1", "2,H1,W1,C11", Dtype::U8, "1 where an output passes"),
    Port::int("active1_2", "2,H1,W1,C12", Dtype::U8, "1 where an output passes"),
    Port::int("active2_1", "2,H2,W2,C21", Dtype::U8, "1 where an output passes"),
    Port::int("active2_2", "2,H2,W2,C22", Dtype::U8, "1 where an output passes"),
    Port::int("active3_1", "2,H3,W3,C31", Dtype::U8, "1 where an output passes"),
    Port::int("active3_2", "2,H3,W3,C32", Dtype::U8, "1 where an output passes"),
    Port::int("active3_3", "2,H3,W3,C33", Dtype::U8, "1 where an output passes"),
    Port::int("active4_1", "2,H4,W4,C41", Dtype::U8, "1 where an output passes"),
    Port::int("active4_2", "2,H4,W4,C42", Dtype::U8, "1 where an output passes"),
    Port::int("active4_3", "2,H4,W4,C43", Dtype::U8, "1 where an output passes"),
    Port::int("active5_1", "2,H5,W5,C51", Dtype::U8, "1 where an output passes"),
    Port::int("active5_2", "2,H5,W5,C52", Dtype::U8, "1 where an output passes"),
    Port::int("active5_3", "2,H5,W5,C53", Dtype::U8, "1 where an output passes"),
    Port::int("pool1", "2,H2,W2,C12", Dtype::U8, "2·row + column of the entry taken"),
    Port::int("pool2", "2,H3,W3,C22", Dtype::U8, "2·row + column of the entry taken"),
    Port::int("pool3", "2,H4,W4,C33", Dtype::U8, "2·row + column of the entry taken"),
    Port::int("pool4", "2,H5,W5,C43", Dtype::U8, "2·row + column of the entry taken"),
];

/// `loss.lpips`
pub(super) static LPIPS: Op = Op {
    name: "loss.lpips",
    summary: "learned perceptual distance: VGG16 with the heads of version 0.1, the user's weights",
    inputs: INPUTS,
    outputs: &[Port::var("value", "", "0 for equal images")],
    intermediates: INTERMEDIATES,
    plan: PLAN,
    companions: &[],
    settings: &[SettingSpec {
        key: "rescale",
        kind: Kind::Flag,
        default: "1",
        doc: "2x − 1 first, as published; 0: images as they are",
    }],
    stages: &[],
    adjoint: true,
    width: Width::F32,
    work_unit: "products",
    work_ns: [2.0, 12.0],
    check,
    run,
    predict: no_zeros,
    cases: 2,
    case,
};

fn check(x: &Checked<'_>) -> Result<()> {
    let given = lpips::names().iter().filter(|name| x.has(name)).count();
    if given != 0 && given != lpips::names().len() {
        let missing: Vec<String> = lpips::names().into_iter().filter(|name| !x.has(name)).collect();
        return Err(Error::input("weights")
            .expected("all arrays or none")
            .got(format!("no {}", missing.join(", "))));
    }
    let [height, width] = [x.dim("H"), x.dim("W")];
    if height < lpips::SMALLEST || width < lpips::SMALLEST {
        return Err(Error::input("array 'x'")
            .expected(format!("at least {0}x{0} pixels", lpips::SMALLEST))
            .got(format!("{height}x{width}")));
    }
    Ok(())
}

/// Shapes (2, H, W, C) at every convolution, and of every maximum.
fn shapes(x: &Checked<'_>, weights: &Weights) -> (Vec<[usize; 4]>, Vec<[usize; 4]>) {
    let sizes = lpips::sizes(x.dim("H"), x.dim("W"));
    let of = |k: usize, channels: usize| [2, sizes[k][0], sizes[k][1], channels];
    let relu = (0..CONVOLUTIONS.len()).map(|k| of(k, weights.layers[k].outputs)).collect();
    (relu, POOLED.iter().map(|&k| of(k, weights.layers[k].inputs)).collect())
}

/// Arrays of a plan, held to their shapes and values.
fn given(plan: &Arrays, relu: &[[usize; 4]], pool: &[[usize; 4]]) -> Result<Plan> {
    let read = |name: String, shape: &[usize; 4], below: i64| -> Result<Vec<u8>> {
        let array = plan.need(&name)?;
        let values =
            array.to_i64().filter(|v| array.shape() == shape && v.iter().all(|v| (0..below).contains(v)));
        let values = values.ok_or_else(|| {
            Error::input("plan")
                .at(format!("array '{name}'"))
                .expected(format!("whole numbers below {below} of shape {shape:?}"))
        })?;
        Ok(values.into_iter().map(|v| v as u8).collect())
    };
    Ok(Plan {
        active: relu
            .iter()
            .zip(CONVOLUTIONS)
            .map(|(shape, (_, name, _))| read(format!("active{name}"), shape, 2))
            .collect::<Result<_>>()?,
        pool: pool
            .iter()
            .enumerate()
            .map(|(p, shape)| read(format!("pool{}", p + 1), shape, 4))
            .collect::<Result<_>>()?,
    })
}

fn run(x: &Checked<'_>) -> Result<Ran> {
    let weights =
        if x.has("features.0.weight") { Weights::from_arrays(&x.inputs)? } else { Weights::by_formula() };
    let (a, b) = (x.f32s("x"), x.f32s("y"));
    let [height, width] = [x.dim("H"), x.dim("W")];
    let rescale = x.number("rescale") != Some(0.0);
    let images = lpips::In { x: &a, y: &b, height, width, rescale, weights: &weights };
    let (relu, pool) = shapes(x, &weights);
    let plan = x.call.plan.as_ref().map(|plan| given(plan, &relu, &pool)).transpose()?;
    let (value, layers, saved) = lpips::forward(images, plan.as_ref())?;
    let mut ran = Ran::default();
    ran.outputs.put("value", &[], vec![value]);
    let decided = saved.plan();
    for (values, (shape, (_, name, _))) in decided.active.into_iter().zip(relu.iter().zip(CONVOLUTIONS)) {
        ran.plan.put(&format!("active{name}"), shape, values);
    }
    for (p, (values, shape)) in decided.pool.into_iter().zip(&pool).enumerate() {
        ran.plan.put(&format!("pool{}", p + 1), shape, values);
    }
    if x.call.dump {
        ran.intermediates.put("layers", &[5], layers.map(|t| t as f32).to_vec());
        for (values, (shape, (_, name, _))) in saved.relu.iter().zip(relu.iter().zip(CONVOLUTIONS)) {
            ran.intermediates.put(&format!("relu{name}"), shape, values.clone());
        }
    }
    if let Some(bar) = x.bar("value", &[])? {
        let (mut x_bar, mut y_bar) = (x.start("x", a.len()), x.start("y", b.len()));
        lpips::adjoint(images, &saved, bar[0], &mut x_bar, Some(&mut y_bar));
        ran.gradients.put("x", &[height, width, 3], x_bar);
        ran.gradients.put("y", &[height, width, 3], y_bar);
    }
    Ok(ran)
}

/// Two images under a slim network: a few channels per convolution, biases, heads; in case 1 odd sides, and images as they are.
fn case(case: usize) -> Case {
    const CHANNELS: [usize; 13] = [4, 4, 5, 6, 6, 5, 7, 6, 6, 8, 6, 7, 8];
    let [h, w] = [[16, 18], [19, 17]][case];
    let mut made = Case::default();
    let mut put = |array: u16, name: &str, shape: &[usize], low: f32, high: f32| {
        let n = entries(shape);
        made.inputs.put(name, shape, Draw::new(71, case, array).uniforms(n, low, high));
    };
    put(0, "x", &[h, w, 3], 0.05, 0.95);
    put(1, "y", &[h, w, 3], 0.05, 0.95);
    let mut inputs = 3;
    for (k, (at, ..)) in CONVOLUTIONS.into_iter().enumerate() {
        let bound = (6.0 / (9.0 * inputs as f32)).sqrt();
        let array = 2 + 2 * k as u16;
        put(array, &format!("features.{at}.weight"), &[CHANNELS[k], inputs, 3, 3], -bound, bound);
        put(array + 1, &format!("features.{at}.bias"), &[CHANNELS[k]], 0.0, 0.3);
        inputs = CHANNELS[k];
    }
    for (j, tap) in TAPS.into_iter().enumerate() {
        put(40 + j as u16, &format!("lin{j}.model.1.weight"), &[1, CHANNELS[tap], 1, 1], 0.1, 1.0);
    }
    if case == 1 {
        made.settings.insert("rescale".to_owned(), Setting::Number(0.0));
    }
    made
}
