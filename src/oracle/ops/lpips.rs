//! The learned perceptual distance.

use super::call::RunResult;
use super::case::Draw;
use super::op::{Case, CheckedCall, Op, Width, no_zeros};
use crate::loss::lpips::{self, CONVOLUTIONS, POOLED, Plan, TAPS, Weights};
use crate::num::array::Arrays;
use crate::num::array::entries;
use crate::{Error, Result};
use reference::settings::Setting;

/// `loss.lpips`
pub(super) static LPIPS: Op = Op {
    signature: &reference::loss::lpips::SIGNATURE,
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

fn check(x: &CheckedCall<'_>) -> Result<()> {
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

/// Shapes (2, H, W, C) at every convolution and every max pooling.
fn shapes(x: &CheckedCall<'_>, weights: &Weights) -> (Vec<[usize; 4]>, Vec<[usize; 4]>) {
    let sizes = lpips::sizes(x.dim("H"), x.dim("W"));
    let of = |k: usize, channels: usize| [2, sizes[k][0], sizes[k][1], channels];
    let relu = (0..CONVOLUTIONS.len()).map(|k| of(k, weights.layers[k].outputs)).collect();
    (relu, POOLED.iter().map(|&k| of(k, weights.layers[k].inputs)).collect())
}

/// Reads the arrays of a plan and checks their shapes and values.
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

fn run(x: &CheckedCall<'_>) -> Result<RunResult> {
    let weights =
        if x.has("features.0.weight") { Weights::from_arrays(&x.inputs)? } else { Weights::by_formula() };
    let (a, b) = (x.f32s("x"), x.f32s("y"));
    let [height, width] = [x.dim("H"), x.dim("W")];
    let rescale = x.number("rescale") != Some(0.0);
    let images = lpips::In { x: &a, y: &b, height, width, rescale, weights: &weights };
    let (relu, pool) = shapes(x, &weights);
    let plan = x.call.plan.as_ref().map(|plan| given(plan, &relu, &pool)).transpose()?;
    let (value, layers, saved) = lpips::forward(images, plan.as_ref())?;
    let mut ran = RunResult::default();
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

/// Two images and a small network: a few channels per convolution, biases, heads; case 1 with odd image sides
/// and without rescaling.
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
