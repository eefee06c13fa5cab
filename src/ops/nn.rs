//! Layers.

use super::call::{Checked, Ran};
use super::case::Draw;
use super::op::{Case, Kind, Op, Port, SettingSpec, Width, no_rule, no_zeros};
use crate::nn::{act, conv, linear};
use crate::tape::check::Prediction;
use crate::{Error, Result};
use reference::settings::Setting;

/// `nn.linear`
pub(super) static LINEAR: Op = Op {
    name: "nn.linear",
    summary: "an affine map of every row: y = x·Wᵀ + b",
    inputs: &[
        Port::var("x", "M,K", "rows"),
        Port::var("weight", "N,K", "one row per output"),
        Port::var("bias", "N", "added last"),
    ],
    outputs: &[Port::var("y", "M,N", "")],
    intermediates: &[],
    plan: &[],
    companions: &[],
    settings: &[],
    stages: &[],
    adjoint: true,
    width: Width::F32,
    work_unit: "products",
    work_ns: [1.0, 60.0],
    check: no_rule,
    run: run_linear,
    predict: no_zeros,
    cases: 2,
    case: case_linear,
};

fn run_linear(x: &Checked<'_>) -> Result<Ran> {
    let (m, n, k) = (x.dim("M"), x.dim("N"), x.dim("K"));
    let (rows, weight, bias) = (x.f32s("x"), x.f32s("weight"), x.f32s("bias"));
    let input = linear::In { x: &rows, weight: &weight, bias: &bias, m, n, k };
    let mut y = vec![0.0; m * n];
    linear::forward(input, &mut y);
    let mut ran = Ran::default();
    ran.outputs.put("y", &[m, n], y);
    if let Some(y_bar) = x.bar("y", &[m, n])? {
        let mut bar = linear::InBar {
            x: x.start("x", m * k),
            weight: x.start("weight", n * k),
            bias: x.start("bias", n),
        };
        linear::adjoint(input, &y_bar, &mut bar);
        ran.gradients.put("x", &[m, k], bar.x);
        ran.gradients.put("weight", &[n, k], bar.weight);
        ran.gradients.put("bias", &[n], bar.bias);
    }
    Ok(ran)
}

fn case_linear(case: usize) -> Case {
    let [m, n, k] = [[3, 2, 5], [37, 19, 130]][case];
    let draw = |array, len| Draw::new(10, case, array).normals(len);
    let mut made = Case::default();
    made.inputs.put("x", &[m, k], draw(0, m * k));
    made.inputs.put("weight", &[n, k], draw(1, n * k));
    made.inputs.put("bias", &[n], draw(2, n));
    made
}

/// `nn.leaky_relu`
pub(super) static LEAKY_RELU: Op = Op {
    name: "nn.leaky_relu",
    summary: "x where it is positive, slope·x elsewhere",
    inputs: &[Port::var("x", "...", "")],
    outputs: &[Port::var("y", "...", "")],
    intermediates: &[],
    plan: &[],
    companions: &[],
    settings: &[SettingSpec {
        key: "slope",
        kind: Kind::Number,
        default: "0.2",
        doc: "factor of values that are not positive",
    }],
    stages: &[],
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

fn slope(x: &Checked<'_>) -> f64 {
    x.number("slope").unwrap_or(0.2)
}

fn check_leaky_relu(x: &Checked<'_>) -> Result<()> {
    let slope = slope(x);
    if (slope as f32).is_finite() {
        return Ok(());
    }
    Err(Error::input("setting slope").expected("a number within the range of f32").got(format!("{slope:e}")))
}

fn run_leaky_relu(x: &Checked<'_>) -> Result<Ran> {
    let (shape, values, slope) = (x.shape("x"), x.f32s("x"), slope(x) as f32);
    let mut y = vec![0.0; values.len()];
    act::leaky_relu(&values, slope, &mut y);
    let mut ran = Ran::default();
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
    let n = super::call::entries(shape);
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
    name: "nn.conv",
    summary: "a convolution of pictures, channels last, zeros beyond the border",
    inputs: &[
        Port::var("x", "B,H,W,C", "pictures"),
        Port::var("weight", "O,KH,KW,C", "one filter per output, not mirrored"),
        Port::var("bias", "O", "added last"),
    ],
    outputs: &[Port::var("y", "B,H',W',O", "")],
    intermediates: &[],
    plan: &[],
    companions: &[],
    settings: &[
        SettingSpec {
            key: "stride",
            kind: Kind::Number,
            default: "1",
            doc: "pixels between outputs, 1 or more",
        },
        SettingSpec { key: "pad", kind: Kind::Number, default: "0", doc: "zeros on every side, in pixels" },
    ],
    stages: &[],
    adjoint: true,
    width: Width::F32,
    work_unit: "products",
    work_ns: [1.0, 60.0],
    check: check_conv,
    run: run_conv,
    predict: unread,
    cases: 3,
    case: case_conv,
};

/// Largest stride and pad.
const MOST: f64 = 65_536.0;

fn conv_shape(x: &Checked<'_>) -> Result<conv::Shape> {
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

fn check_conv(x: &Checked<'_>) -> Result<()> {
    let shape = conv_shape(x)?;
    if shape.out().is_some() {
        return Ok(());
    }
    Err(Error::input("array 'weight'")
        .expected(format!("a kernel that fits into {}x{} padded by {}", shape.height, shape.width, shape.pad))
        .got(format!("{}x{}", shape.kernel[0], shape.kernel[1])))
}

fn run_conv(x: &Checked<'_>) -> Result<Ran> {
    let shape = conv_shape(x)?;
    let (pictures, weight, bias) = (x.f32s("x"), x.f32s("weight"), x.f32s("bias"));
    let input = conv::In { x: &pictures, weight: &weight, bias: &bias, shape };
    let [rows, columns] = shape.out().expect("checked before");
    let size = [shape.batch, rows, columns, shape.outputs];
    let mut y = vec![0.0; super::call::entries(&size)];
    conv::forward(input, &mut y);
    let mut ran = Ran::default();
    ran.outputs.put("y", &size, y);
    if let Some(y_bar) = x.bar("y", &size)? {
        let mut bar = conv::InBar {
            x: x.start("x", pictures.len()),
            weight: x.start("weight", weight.len()),
            bias: x.start("bias", bias.len()),
        };
        conv::adjoint(input, &y_bar, &mut bar);
        ran.gradients.put("x", &x.shape("x"), bar.x);
        ran.gradients.put("weight", &x.shape("weight"), bar.weight);
        ran.gradients.put("bias", &x.shape("bias"), bar.bias);
    }
    Ok(ran)
}

/// Pixels that no output reads, between strides or beyond the last, have no gradient.
fn unread(x: &Checked<'_>, _: &Ran) -> Result<Prediction> {
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

/// The encoder's kernel, an oblong one of stride 1, and one that skips pixels between outputs and at the border.
fn case_conv(case: usize) -> Case {
    let [x, w] =
        [[[2, 8, 10, 3], [5, 4, 4, 3]], [[1, 7, 6, 2], [3, 3, 2, 2]], [[3, 9, 12, 25], [18, 2, 3, 25]]][case];
    let [stride, pad] = [[2.0, 1.0], [1.0, 1.0], [3.0, 0.0]][case];
    let draw = |array, shape: &[usize]| Draw::new(12, case, array).normals(super::call::entries(shape));
    let mut made = Case::default();
    made.inputs.put("x", &x, draw(0, &x));
    made.inputs.put("weight", &w, draw(1, &w));
    made.inputs.put("bias", &[w[0]], draw(2, &w[..1]));
    made.settings.insert("stride".to_owned(), Setting::Number(stride));
    made.settings.insert("pad".to_owned(), Setting::Number(pad));
    made
}
