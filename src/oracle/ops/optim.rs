//! Optimisers, without adjoint.

use super::call::RunResult;
use super::case::Draw;
use super::op::{Case, CheckedCall, Op, Width, no_rule, no_zeros};
use crate::optim::{adam, adamw, muon};
use crate::{Error, Result};
use reference::settings::Setting;

/// `optim.adam`
pub(super) static ADAM: Op = Op {
    signature: &reference::optim::adam::SIGNATURE,
    adjoint: false,
    width: Width::F32,
    work_unit: "entries",
    work_ns: [30.0, 30.0],
    check: no_decay,
    run: run_adam,
    predict: no_zeros,
    cases: 2,
    case: case_adam,
};

/// `optim.adamw`
pub(super) static ADAMW: Op =
    Op { signature: &reference::optim::adamw::SIGNATURE, check: no_rule, run: run_adamw, ..ADAM };

/// `optim.muon`
pub(super) static MUON: Op = Op {
    signature: &reference::optim::muon::SIGNATURE,
    work_ns: [200.0, 200.0],
    check: no_rule,
    run: run_muon,
    case: case_muon,
    ..ADAM
};

fn no_decay(x: &CheckedCall<'_>) -> Result<()> {
    match x.number("weight_decay") {
        None | Some(0.0) => Ok(()),
        Some(w) => Err(Error::input("setting weight_decay")
            .expected("0, or operator optim.adamw")
            .got(w.to_string())),
    }
}

fn run(
    x: &CheckedCall<'_>,
    weight_decay: f64,
    forward: impl Fn(&adam::In<'_>, &adam::Settings) -> Result<adam::Out>,
) -> Result<RunResult> {
    let (param, grads) = (x.f32s("param"), x.f32s("grads"));
    let rows = x.dim("N");
    let width = param.len().checked_div(rows).unwrap_or(1);
    let active: Vec<u8> = x.f32s("active").into_iter().map(|a| a as u8).collect();
    let rule = adam::Rule {
        beta1: x.number("beta1").unwrap_or(0.9),
        beta2: x.number("beta2").unwrap_or(0.999),
        eps: x.number("eps").unwrap_or(1e-8),
        weight_decay,
        counters: adam::Counters::parse(x.word("counters").unwrap_or("row"))?,
        ..adam::Rule::default()
    };
    let input = adam::In {
        param: &param,
        grads: &grads,
        active: x.has("active").then_some(&active[..]),
        rows,
        width,
    };
    let out = forward(&input, &adam::Settings { lr: x.number("lr").unwrap_or(1e-3), rule })?;
    let mut ran = RunResult::default();
    ran.outputs.put("trajectory", &x.shape("grads"), out.trajectory);
    if x.call.dump {
        let shape = x.shape("param");
        ran.intermediates.put("m", &shape, out.m);
        ran.intermediates.put("v", &shape, out.v);
        ran.intermediates.put(
            "steps",
            &[rows],
            counters(
                &out.steps,
                rule.counters == adam::Counters::Global,
                &active,
                rows,
                grads.len() / param.len().max(1),
            ),
        );
    }
    Ok(ran)
}

/// The step count at the last update of each row; a global counter may have advanced since.
fn counters(own: &[u32], global: bool, active: &[u8], rows: usize, steps: usize) -> Vec<i64> {
    if !global {
        return own.iter().map(|&t| i64::from(t)).collect();
    }
    let last = |row: usize| (0..steps).rev().find(|s| active.get(s * rows + row).is_none_or(|a| *a == 1));
    (0..rows).map(|row| last(row).map_or(0, |s| s as i64 + 1)).collect()
}

fn run_adam(x: &CheckedCall<'_>) -> Result<RunResult> {
    run(x, 0.0, adam::forward)
}

fn run_adamw(x: &CheckedCall<'_>) -> Result<RunResult> {
    run(x, x.number("weight_decay").unwrap_or(0.01), adamw::forward)
}

/// Case 0: every row is active; case 1: rows of three, some of them inactive in some steps.
fn case_adam(case: usize) -> Case {
    let [steps, rows, width] = [[12, 7, 1], [9, 5, 3]][case];
    let mut made = Case::default();
    let shape: &[usize] = if case == 0 { &[rows] } else { &[rows, width] };
    let mut all = vec![steps];
    all.extend(shape);
    made.inputs.put("param", shape, Draw::new(30, case, 0).normals(rows * width));
    made.inputs.put("grads", &all, Draw::new(30, case, 1).normals(steps * rows * width));
    if case == 1 {
        let active = Draw::new(30, case, 2).flags(steps * rows, 0.7);
        made.inputs.put("active", &[steps, rows], active.into_iter().map(|a| a as u8).collect());
    }
    made.settings.insert("lr".to_owned(), Setting::Number(0.0625));
    made
}

fn run_muon(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (param, grads) = (x.f32s("param"), x.f32s("grads"));
    let rule = muon::Rule {
        momentum: x.number("momentum").unwrap_or(0.95),
        weight_decay: x.number("weight_decay").unwrap_or(0.0),
        rms: x.number("rms").unwrap_or(0.2),
    };
    let input = muon::In { param: &param, grads: &grads, shape: [x.dim("B"), x.dim("R"), x.dim("C")] };
    let out = muon::forward(&input, &muon::Settings { lr: x.number("lr").unwrap_or(1e-3), rule })?;
    let mut ran = RunResult::default();
    ran.outputs.put("trajectory", &x.shape("grads"), out.trajectory);
    if x.call.dump {
        ran.intermediates.put("m", &x.shape("param"), out.m);
    }
    Ok(ran)
}

/// Case 0: one wide matrix; case 1: two tall ones, with decay.
fn case_muon(case: usize) -> Case {
    let [steps, matrices, rows, columns] = [[6, 1, 4, 7], [5, 2, 6, 3]][case];
    let mut made = Case::default();
    let entries = matrices * rows * columns;
    let shape = [matrices, rows, columns];
    made.inputs.put("param", &shape, Draw::new(94, case, 0).normals(entries));
    let all = [steps, matrices, rows, columns];
    made.inputs.put("grads", &all, Draw::new(94, case, 1).normals(steps * entries));
    made.settings.insert("lr".to_owned(), Setting::Number(0.0625));
    if case == 1 {
        made.settings.insert("weight_decay".to_owned(), Setting::Number(0.5));
    }
    made
}
