//! Layers of transformers.

mod block;

use super::call::RunResult;
use super::case::Draw;
use super::op::{Case, CheckedCall, Op};
use crate::nn::{attention, gelu, layernorm, weight_norm};
use crate::tape::check::Prediction;
use crate::{Error, Result};
use reference::settings::Setting;

pub(super) use block::BLOCK;

/// `nn.gelu`
pub(super) static GELU: Op = Op::new(&reference::nn::gelu::SIGNATURE, run_gelu, case_gelu);

fn run_gelu(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (shape, values) = (x.shape("x"), x.f32s("x"));
    let mut y = vec![0.0; values.len()];
    gelu::forward(&values, &mut y);
    let mut ran = RunResult::default();
    ran.outputs.put("y", &shape, y);
    if let Some(y_bar) = x.bar("y", &shape)? {
        let mut bar = x.start("x", values.len());
        gelu::adjoint(&values, &y_bar, &mut bar);
        ran.gradients.put("x", &shape, bar);
    }
    Ok(ran)
}

/// Case 0: around 0; case 1: both tails.
fn case_gelu(case: usize) -> Case {
    let shape: &[usize] = [&[7, 11][..], &[3, 5, 4]][case];
    let n = crate::num::array::entries(shape);
    let factor = [1.0, 3.0][case];
    let mut made = Case::default();
    made.inputs.put("x", shape, Draw::new(31, case, 0).normals(n).into_iter().map(|x| factor * x).collect());
    made
}

/// `nn.layernorm`
pub(super) static LAYERNORM: Op = Op {
    check: check_layernorm,
    ..Op::new(&reference::nn::layernorm::SIGNATURE, run_layernorm, case_layernorm)
};

fn check_layernorm(x: &CheckedCall<'_>) -> Result<()> {
    if x.dim("K") == 0 {
        return Err(Error::input("array 'x'").expected("at least one column").got("none"));
    }
    x.single("eps", 1e-6, |eps| eps > 0.0, "above 0").map(drop)
}

fn run_layernorm(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (shape, rows, gain, bias) = (x.shape("x"), x.f32s("x"), x.f32s("gain"), x.f32s("bias"));
    let input = layernorm::In { x: &rows, gain: &gain, bias: &bias, eps: x.number("eps").unwrap_or(1e-6) };
    let mut y = vec![0.0; rows.len()];
    let saved = layernorm::forward(&input, &mut y);
    let mut ran = RunResult::default();
    ran.outputs.put("y", &shape, y);
    if let Some(y_bar) = x.bar("y", &shape)? {
        let k = gain.len();
        let mut bar = layernorm::InBar {
            x: x.start("x", rows.len()),
            gain: x.start("gain", k),
            bias: x.start("bias", k),
        };
        layernorm::adjoint(&input, &saved, &y_bar, &mut bar);
        ran.gradients.put("x", &shape, bar.x);
        ran.gradients.put("gain", &[k], bar.gain);
        ran.gradients.put("bias", &[k], bar.bias);
    }
    Ok(ran)
}

/// Case 0: a few rows; case 1: more rows and columns than one task has, far from 0, with a large ε.
fn case_layernorm(case: usize) -> Case {
    let [m, k] = [[5, 7], [41, 130]][case];
    let draw = |array, len| Draw::new(32, case, array).normals(len);
    let mut made = Case::default();
    let shift = [0.0, 3.0][case];
    made.inputs.put("x", &[m, k], draw(0, m * k).into_iter().map(|x| x + shift).collect());
    made.inputs.put("gain", &[k], draw(1, k));
    made.inputs.put("bias", &[k], draw(2, k));
    if case == 1 {
        made.settings.insert("eps".to_owned(), Setting::Number(0.25));
    }
    made
}

/// `nn.weight_norm`
pub(super) static WEIGHT_NORM: Op = Op {
    check: check_weight_norm,
    ..Op::new(&reference::nn::weight_norm::SIGNATURE, run_weight_norm, case_weight_norm)
};

fn check_weight_norm(x: &CheckedCall<'_>) -> Result<()> {
    let k = x.dim("K");
    if x.dim("N") == 0 || k == 0 {
        return Err(Error::input("array 'v'").expected("a row and a column").got("none"));
    }
    match x.f32s("v").chunks_exact(k).position(|row| row.iter().all(|v| *v == 0.0)) {
        Some(row) => Err(Error::input("array 'v'")
            .at(format!("row {row}"))
            .expected("a number other than 0")
            .got("zeros: they have no direction")),
        None => Ok(()),
    }
}

fn run_weight_norm(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (shape, v, g) = (x.shape("v"), x.f32s("v"), x.f32s("g"));
    let input = weight_norm::In { v: &v, g: &g };
    let mut weight = vec![0.0; v.len()];
    weight_norm::forward(&input, &mut weight);
    let mut ran = RunResult::default();
    ran.outputs.put("weight", &shape, weight);
    if let Some(bar) = x.bar("weight", &shape)? {
        let mut made = weight_norm::InBar { v: x.start("v", v.len()), g: x.start("g", g.len()) };
        weight_norm::adjoint(&input, &bar, &mut made);
        ran.gradients.put("v", &shape, made.v);
        ran.gradients.put("g", &[g.len()], made.g);
    }
    Ok(ran)
}

fn case_weight_norm(case: usize) -> Case {
    let [n, k] = [[3, 5], [37, 70]][case];
    let mut made = Case::default();
    made.inputs.put("v", &[n, k], Draw::new(33, case, 0).normals(n * k));
    made.inputs.put("g", &[n], Draw::new(33, case, 1).normals(n));
    made
}

/// `nn.attention`
pub(super) static ATTENTION: Op = Op {
    work_unit: "products",
    work_ns: [1.0, 60.0],
    check: check_tokens,
    predict: predict_attention,
    cases: 3,
    ..Op::new(&reference::nn::attention::SIGNATURE, run_attention, case_attention)
};

fn heads(x: &CheckedCall<'_>) -> Result<usize> {
    let (heads, width) = (x.number("heads").unwrap_or(1.0), x.dim("D"));
    if heads >= 1.0 && heads == heads.trunc() && width > 0 && width % (heads as usize) == 0 {
        return Ok(heads as usize);
    }
    Err(Error::input("setting heads")
        .expected(format!("a divisor of the {width} columns"))
        .got(heads.to_string()))
}

/// Tokens, and weights for as many queries, keys and values as columns.
fn check_tokens(x: &CheckedCall<'_>) -> Result<()> {
    if x.dim("T") == 0 {
        return Err(Error::input("array 'x'").expected("at least one token").got("none"));
    }
    let (rows, width) = (x.dim("D3"), x.dim("D"));
    if rows != 3 * width {
        return Err(Error::input("array 'w_qkv'")
            .expected(format!("{} rows", 3 * width))
            .got(rows.to_string()));
    }
    heads(x).map(drop)
}

/// The bias of the keys has no gradient.
fn predict_attention(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    Ok(keys_bias(x))
}

fn keys_bias(x: &CheckedCall<'_>) -> Prediction {
    let width = x.dim("D");
    let of_keys = (0..3 * width).map(|i| i / width == 1).collect();
    Prediction { zeros: [("b_qkv".to_owned(), of_keys)].into(), ..Prediction::default() }
}

fn run_attention(x: &CheckedCall<'_>) -> Result<RunResult> {
    let names = ["x", "w_qkv", "b_qkv", "w_out", "b_out", "attended"];
    let arrays = names.map(|name| x.f32s(name));
    let [tokens, w_qkv, b_qkv, w_out, b_out, attended] = &arrays;
    let input = attention::In {
        x: tokens,
        w_qkv,
        b_qkv,
        w_out,
        b_out,
        attended,
        tokens: x.dim("T"),
        heads: heads(x)?,
    };
    let (shape, mut y) = (x.shape("x"), vec![0.0; tokens.len()]);
    let saved = attention::forward(&input, &mut y);
    let mut ran = RunResult::default();
    ran.outputs.put("y", &shape, y);
    if let Some(y_bar) = x.bar("y", &shape)? {
        let start = |i: usize| x.start(names[i], arrays[i].len());
        let mut bar = attention::InBar {
            x: start(0),
            w_qkv: start(1),
            b_qkv: start(2),
            w_out: start(3),
            b_out: start(4),
        };
        attention::adjoint(&input, &saved, &y_bar, &mut bar);
        for (name, values) in names.into_iter().zip([bar.x, bar.w_qkv, bar.b_qkv, bar.w_out, bar.b_out]) {
            ran.gradients.put(name, &x.shape(name), values);
        }
    }
    Ok(ran)
}

/// Case 0: one head; case 1: three heads, some tokens are not attended to; case 2: more tokens than two blocks of keys and
/// one task of queries have.
fn case_attention(case: usize) -> Case {
    let (t, d, heads) = [(5, 4, 1), (9, 6, 3), (201, 4, 2)][case];
    let draw = |array, len| Draw::new(34, case, array).normals(len);
    let mut made = Case::default();
    made.inputs.put("x", &[t, d], draw(0, t * d));
    made.inputs.put("w_qkv", &[3 * d, d], draw(1, 3 * d * d));
    made.inputs.put("b_qkv", &[3 * d], draw(2, 3 * d));
    made.inputs.put("w_out", &[d, d], draw(3, d * d));
    made.inputs.put("b_out", &[d], draw(4, d));
    if case == 1 {
        made.inputs.put("attended", &[t], (0..t).map(|i| f32::from(u8::from(i % 4 != 1))).collect());
    }
    made.settings.insert("heads".to_owned(), Setting::Number(heads as f64));
    made
}
