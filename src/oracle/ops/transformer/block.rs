//! Blocks of transformers.

use super::{check_tokens, heads, keys_bias};
use crate::nn::block;
use crate::ops::call::RunResult;
use crate::ops::case::Draw;
use crate::ops::op::{Case, CheckedCall, Op};
use crate::tape::check::Prediction;
use crate::{Error, Result};
use reference::settings::Setting;

/// `nn.block`
pub(in crate::ops) static BLOCK: Op = Op {
    work_unit: "products",
    work_ns: [1.0, 60.0],
    check,
    predict,
    ..Op::new(&reference::nn::block::SIGNATURE, run, case)
};

fn check(x: &CheckedCall<'_>) -> Result<()> {
    check_tokens(x)?;
    if x.dim("F") == 0 {
        return Err(Error::input("array 'w_fc1'").expected("at least one row").got("none"));
    }
    x.single("eps", 1e-6, |eps| eps > 0.0, "above 0").map(drop)
}

/// The bias of the keys has no gradient.
fn predict(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    Ok(keys_bias(x))
}

const NAMES: [&str; 13] = [
    "x", "ln1_gain", "ln1_bias", "w_qkv", "b_qkv", "w_out", "b_out", "ln2_gain", "ln2_bias", "w_fc1",
    "b_fc1", "w_fc2", "b_fc2",
];

fn run(x: &CheckedCall<'_>) -> Result<RunResult> {
    let a = NAMES.map(|name| x.f32s(name));
    let input = block::In {
        x: &a[0],
        ln1_gain: &a[1],
        ln1_bias: &a[2],
        w_qkv: &a[3],
        b_qkv: &a[4],
        w_out: &a[5],
        b_out: &a[6],
        ln2_gain: &a[7],
        ln2_bias: &a[8],
        w_fc1: &a[9],
        b_fc1: &a[10],
        w_fc2: &a[11],
        b_fc2: &a[12],
        tokens: x.dim("T"),
        heads: heads(x)?,
        eps: x.number("eps").unwrap_or(1e-6),
    };
    let (shape, mut y) = (x.shape("x"), vec![0.0; a[0].len()]);
    let saved = block::forward(&input, &mut y);
    let mut ran = RunResult::default();
    ran.outputs.put("y", &shape, y);
    if let Some(y_bar) = x.bar("y", &shape)? {
        let start = |i: usize| x.start(NAMES[i], a[i].len());
        let mut bar = block::InBar {
            x: start(0),
            ln1_gain: start(1),
            ln1_bias: start(2),
            w_qkv: start(3),
            b_qkv: start(4),
            w_out: start(5),
            b_out: start(6),
            ln2_gain: start(7),
            ln2_bias: start(8),
            w_fc1: start(9),
            b_fc1: start(10),
            w_fc2: start(11),
            b_fc2: start(12),
        };
        block::adjoint(&input, saved, &y_bar, &mut bar);
        let bars = [
            bar.x,
            bar.ln1_gain,
            bar.ln1_bias,
            bar.w_qkv,
            bar.b_qkv,
            bar.w_out,
            bar.b_out,
            bar.ln2_gain,
            bar.ln2_bias,
            bar.w_fc1,
            bar.b_fc1,
            bar.w_fc2,
            bar.b_fc2,
        ];
        for (name, values) in NAMES.into_iter().zip(bars) {
            ran.gradients.put(name, &x.shape(name), values);
        }
    }
    Ok(ran)
}

/// Case 0: one head, a hidden width that is no multiple of a lane; case 1: more tokens than a block of keys and a task of the
/// network have, two heads, a large ε.
fn case(case: usize) -> Case {
    let ([t, d, f], heads) = [([5, 4, 7], 1), ([67, 6, 24], 2)][case];
    let shapes: [&[usize]; 13] =
        [&[t, d], &[d], &[d], &[3 * d, d], &[3 * d], &[d, d], &[d], &[d], &[d], &[f, d], &[f], &[d, f], &[d]];
    let mut made = Case::default();
    for (i, (name, shape)) in NAMES.into_iter().zip(shapes).enumerate() {
        made.inputs.put(
            name,
            shape,
            Draw::new(35, case, i as u16).normals(crate::num::array::entries(shape)),
        );
    }
    made.settings.insert("heads".to_owned(), Setting::Number(heads as f64));
    if case == 1 {
        made.settings.insert("eps".to_owned(), Setting::Number(0.25));
    }
    made
}
