//! Layers of networks.

use super::call::RunResult;
use super::case::Draw;
use super::op::{Case, CheckedCall, Op, Width, no_zeros};
use crate::nn::{act, conv, linear};
use crate::tape::check::Prediction;
use crate::{Error, Result};
use reference::settings::Setting;

/// `nn.linear`
pub(super) static LINEAR: Op = Op {
    signature: &reference::nn::linear::SIGNATURE,
    adjoint: true,
    width: Width::F32,
    work_unit: "products",
    work_ns: [1.0, 60.0],
    check: check_slope,
    run: run_linear,
    predict: no_zeros,
    cases: 3,
    case: case_linear,
};

/// The slope of the leaky ReLU that follows a layer, if it is set.
fn slope_behind(x: &CheckedCall<'_>) -> Option<f32> {
    x.number("slope").map(|slope| slope as f32)
}

fn check_slope(x: &CheckedCall<'_>) -> Result<()> {
    match slope_behind(x) {
        Some(slope) if !(slope >= 0.0 && slope.is_finite()) => Err(Error::input("setting slope")
            .expected("not negative, within the range of f32")
            .got(slope.to_string())),
        _ => Ok(()),
    }
}

fn run_linear(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (m, n, k) = (x.dim("M"), x.dim("N"), x.dim("K"));
    let (rows, weight, bias) = (x.f32s("x"), x.f32s("weight"), x.f32s("bias"));
    let input = linear::In { x: &rows, weight: &weight, bias: &bias, m, n, k };
    let mut y = vec![0.0; m * n];
    match slope_behind(x) {
        Some(slope) => linear::forward_leaky(input, slope, &mut y),
        None => linear::forward(input, &mut y),
    }
    let mut ran = RunResult::default();
    if let Some(mut y_bar) = x.bar("y", &[m, n])? {
        let mut bar = linear::InBar {
            x: x.start("x", m * k),
            weight: x.start("weight", n * k),
            bias: x.start("bias", n),
        };
        match slope_behind(x) {
            Some(slope) => linear::adjoint_leaky(input, slope, &y, &mut y_bar, &mut bar),
            None => linear::adjoint(input, &y_bar, &mut bar),
        }
        ran.gradients.put("x", &[m, k], bar.x);
        ran.gradients.put("weight", &[n, k], bar.weight);
        ran.gradients.put("bias", &[n], bar.bias);
    }
    ran.outputs.put("y", &[m, n], y);
    Ok(ran)
}

/// A small layer, a large one, and one followed by a leaky ReLU.
fn case_linear(case: usize) -> Case {
    let [m, n, k] = [[3, 2, 5], [37, 19, 130], [7, 5, 6]][case];
    let draw = |array, len| Draw::new(10, case, array).normals(len);
    let mut made = Case::default();
    made.inputs.put("x", &[m, k], draw(0, m * k));
    made.inputs.put("weight", &[n, k], draw(1, n * k));
    made.inputs.put("bias", &[n], draw(2, n));
    if case == 2 {
        made.settings.insert("slope".to_owned(), Setting::Number(0.125));
    }
    made
}

/// `nn.leaky_relu`
pub(super) static LEAKY_RELU: Op = Op {
    signature: &reference::nn::act::SIGNATURE,
    adjoint: true,
    width: Width::F32,
    work_unit: "values",
    work_ns: [10.0, 100.0],
    check: check_leaky_relu,
    run: run_leaky_relu,
    predict: no_zeros,
    cases: 2,
    case: case_leaky_relu,
};

fn slope(x: &CheckedCall<'_>) -> f64 {
    x.number("slope").unwrap_or(0.2)
}

fn check_leaky_relu(x: &CheckedCall<'_>) -> Result<()> {
    let slope = slope(x);
    if (slope as f32).is_finite() {
        return Ok(());
    }
    Err(Error::input("setting slope").expected("a number within the range of f32").got(format!("{slope:e}")))
}

fn run_leaky_relu(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (shape, values, slope) = (x.shape("x"), x.f32s("x"), slope(x) as f32);
    let mut y = vec![0.0; values.len()];
    act::leaky_relu(&values, slope, &mut y);
    let mut ran = RunResult::default();
    ran.outputs.put("y", &shape, y);
    if let Some(y_bar) = x.bar("y", &shape)? {
        let mut bar = x.start("x", values.len());
        act::leaky_relu_adjoint(&values, slope, &y_bar, &mut bar);
        ran.gradients.put("x", &shape, bar);
    }
    Ok(ran)
}

/// Values of both signs, at least 0.05 from the kink.
fn case_leaky_relu(case: usize) -> Case {
    let shape: &[usize] = [&[7, 11][..], &[3, 5, 4]][case];
    let n = crate::num::array::entries(shape);
    let apart = |x: f32| if x > 0.0 { x + 0.05 } else { x - 0.05 };
    let mut made = Case::default();
    made.inputs.put("x", shape, Draw::new(11, case, 0).normals(n).into_iter().map(apart).collect());
    if case == 1 {
        made.settings.insert("slope".to_owned(), Setting::Number(0.0625));
    }
    made
}

/// `nn.conv`
pub(super) static CONV: Op = Op {
    signature: &reference::nn::conv::SIGNATURE,
    adjoint: true,
    width: Width::F32,
    work_unit: "products",
    work_ns: [1.0, 60.0],
    check: check_conv,
    run: run_conv,
    predict: unread,
    cases: 5,
    case: case_conv,
};

/// Largest stride and pad.
const MOST: f64 = 65_536.0;

fn conv_shape(x: &CheckedCall<'_>) -> Result<conv::Shape> {
    let whole = |key: &str, default: f64, least: f64| {
        let given = x.number(key).unwrap_or(default);
        if given >= least && given <= MOST && given == given.trunc() {
            return Ok(given as usize);
        }
        Err(Error::input(format!("setting {key}"))
            .expected(format!("a whole number from {least} to {MOST}"))
            .got(given.to_string()))
    };
    Ok(conv::Shape {
        batch: x.dim("B"),
        height: x.dim("H"),
        width: x.dim("W"),
        channels: x.dim("C"),
        outputs: x.dim("O"),
        kernel: [x.dim("KH"), x.dim("KW")],
        stride: whole("stride", 1.0, 1.0)?,
        pad: whole("pad", 0.0, 0.0)?,
    })
}

fn check_conv(x: &CheckedCall<'_>) -> Result<()> {
    check_slope(x)?;
    let shape = conv_shape(x)?;
    if shape.channels == 0 {
        return Err(Error::input("array 'x'").expected("at least one channel").got("none"));
    }
    if shape.out().is_some() {
        return Ok(());
    }
    Err(Error::input("array 'weight'")
        .expected(format!("a kernel that fits into {}x{} padded by {}", shape.height, shape.width, shape.pad))
        .got(format!("{}x{}", shape.kernel[0], shape.kernel[1])))
}

fn run_conv(x: &CheckedCall<'_>) -> Result<RunResult> {
    let shape = conv_shape(x)?;
    let (images, weight, bias) = (x.f32s("x"), x.f32s("weight"), x.f32s("bias"));
    let input = conv::In { x: &images, weight: &weight, bias: &bias, shape };
    let [rows, columns] = shape.out().expect("checked before");
    let size = [shape.batch, rows, columns, shape.outputs];
    let mut y = vec![0.0; crate::num::array::entries(&size)];
    match slope_behind(x) {
        Some(slope) => conv::forward_leaky(input, slope, &mut y),
        None => conv::forward(input, &mut y),
    }
    let mut ran = RunResult::default();
    if let Some(y_bar) = x.bar("y", &size)? {
        let mut bar = conv::InBar {
            x: x.start("x", images.len()),
            weight: x.start("weight", weight.len()),
            bias: x.start("bias", bias.len()),
        };
        match slope_behind(x) {
            Some(slope) => {
                let own = conv::gradients_leaky(input, slope, &y, &y_bar, [true; 3]);
                for (bar, own) in
                    [(&mut bar.x, own.x), (&mut bar.weight, own.weight), (&mut bar.bias, own.bias)]
                {
                    bar.iter_mut().zip(own).for_each(|(bar, g)| *bar += g);
                }
            }
            None => conv::adjoint(input, &y_bar, &mut bar),
        }
        ran.gradients.put("x", &x.shape("x"), bar.x);
        ran.gradients.put("weight", &x.shape("weight"), bar.weight);
        ran.gradients.put("bias", &x.shape("bias"), bar.bias);
    }
    ran.outputs.put("y", &size, y);
    Ok(ran)
}

/// Pixels that no output reads, between strides or beyond the last, have no gradient.
fn unread(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    let shape = conv_shape(x)?;
    let read = |size: usize, kernel: usize, outputs: usize| -> Vec<bool> {
        let sees =
            |at: usize, r: usize| (r * shape.stride..r * shape.stride + kernel).contains(&(at + shape.pad));
        (0..size).map(|at| (0..outputs).any(|r| sees(at, r))).collect()
    };
    let [rows, columns] = shape.out().expect("checked before");
    let tall = read(shape.height, shape.kernel[0], rows);
    let wide = read(shape.width, shape.kernel[1], columns);
    let pixel = |at: usize| !(tall[at / shape.width % shape.height] && wide[at % shape.width]);
    let unread = (0..x.f32s("x").len()).map(|i| pixel(i / shape.channels)).collect();
    Ok(Prediction { zeros: [("x".to_owned(), unread)].into(), ..Prediction::default() })
}

/// The kernel of the encoder, a rectangular one of stride 1, one that skips pixels between outputs and at the
/// border, that of the encoder with its leaky ReLU, and a batch with a leaky ReLU.
fn case_conv(case: usize) -> Case {
    let [x, w] = [
        [[2, 8, 10, 3], [5, 4, 4, 3]],
        [[1, 7, 6, 2], [3, 3, 2, 2]],
        [[3, 9, 12, 25], [18, 2, 3, 25]],
        [[1, 6, 4, 3], [4, 4, 4, 3]],
        [[3, 4, 5, 2], [3, 3, 3, 2]],
    ][case];
    let [stride, pad] = [[2.0, 1.0], [1.0, 1.0], [3.0, 0.0], [2.0, 1.0], [1.0, 1.0]][case];
    let draw = |array, shape: &[usize]| Draw::new(12, case, array).normals(crate::num::array::entries(shape));
    let mut made = Case::default();
    made.inputs.put("x", &x, draw(0, &x));
    made.inputs.put("weight", &w, draw(1, &w));
    made.inputs.put("bias", &[w[0]], draw(2, &w[..1]));
    made.settings.insert("stride".to_owned(), Setting::Number(stride));
    made.settings.insert("pad".to_owned(), Setting::Number(pad));
    if case >= 3 {
        made.settings.insert("slope".to_owned(), Setting::Number([0.2, 0.125][case - 3]));
    }
    made
}
