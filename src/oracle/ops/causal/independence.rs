//! `causal.independence`.

use super::{diagonal, entry};
use crate::causal::independence::{self, Edges, Form, RIDGE};
use crate::ops::call::RunResult;
use crate::ops::case::Draw;
use crate::ops::op::{Case, CheckedCall, Op};
use crate::tape::check::Prediction;
use crate::{Error, Result};
use reference::settings::Setting;

/// `causal.independence`
pub(crate) static INDEPENDENCE: Op = Op {
    work_unit: "entries",
    work_ns: [2000.0, 60000.0],
    check,
    run,
    predict,
    cases: 4,
    case,
    ..entry(&reference::causal::independence::SIGNATURE)
};

fn check(x: &CheckedCall<'_>) -> Result<()> {
    let d = x.dim("N") * x.dim("K");
    if x.dim("B") * d == 0 {
        return Err(Error::input("array 'mu'")
            .expected("at least one sample, factor and dimension")
            .got("an empty axis"));
    }
    if x.has("mask") != x.has("weight") {
        return Err(Error::input("edges").expected("both 'mask' and 'weight', or none").got("one of them"));
    }
    if x.has("carried") && x.dim("D") != d {
        return Err(Error::input("array 'carried'")
            .expected(format!("{d} rows, factors times dimensions of a factor"))
            .got(x.dim("D").to_string()));
    }
    if x.has("among") && x.word("form") == Some("total") {
        return Err(Error::input("array 'among'").expected("form pairs").got("form total"));
    }
    super::bounded(x)?;
    match x.number("ridge") {
        Some(ridge) if !(ridge >= 0.0) => {
            Err(Error::input("setting ridge").expected("0 or more").got(ridge.to_string()))
        }
        _ => super::positive(x, "share"),
    }
}

fn run(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (n, k) = (x.dim("N"), x.dim("K"));
    let [mu, logvar, mask] = ["mu", "logvar", "mask"].map(|name| x.f64s(name));
    let [weight, among, carried] = ["weight", "among", "carried"].map(|name| x.f64s(name));
    let input = independence::In {
        mu: &mu,
        logvar: &logvar,
        edges: x.has("mask").then_some(Edges { mask: &mask, weight: &weight }),
        among: x.has("among").then_some(&among[..]),
        carried: x.has("carried").then_some(&carried[..]),
        share: x.number("share").unwrap_or(1.0),
        ridge: x.number("ridge").unwrap_or(RIDGE),
        form: if x.word("form") == Some("total") { Form::Total } else { Form::Pairs },
        batch: x.dim("B"),
        n,
        k,
    };
    let (value, saved) = independence::forward(&input)?;
    let mut ran = RunResult::default();
    ran.outputs.put("value", &[], vec![value]);
    if x.call.dump {
        ran.intermediates.put("covariance", &[n * k, n * k], saved.covariance.clone());
        ran.intermediates.put("information", &[n, n], saved.information.clone());
    }
    if let Some(bar) = x.bar_f64("value", &[])? {
        let start = |name: &str| x.start_f64(name, x.f64s(name).len());
        let [mu, logvar, mask, weight] = ["mu", "logvar", "mask", "weight"].map(start);
        let mut all = independence::InBar { mu, logvar, mask, weight };
        independence::adjoint(&input, &saved, bar[0], &mut all);
        let named = [("mu", all.mu), ("logvar", all.logvar), ("mask", all.mask), ("weight", all.weight)];
        for (name, values) in named.into_iter().filter(|(name, _)| x.has(name)) {
            ran.gradients.put(name, &x.shape(name), values);
        }
    }
    Ok(ran)
}

fn predict(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    let loops = ["mask", "weight"].into_iter().filter(|name| x.has(name));
    let zeros = loops.map(|name| (name.to_owned(), diagonal(x.dim("N")))).collect();
    Ok(Prediction { zeros, ..Prediction::default() })
}

/// Case 0: one batch; 1: some pairs, with a carried covariance; 2: with edges; 3: total correlation.
fn case(case: usize) -> Case {
    let shape = [[9, 3, 2], [7, 4, 2], [8, 3, 2], [9, 3, 3]][case];
    let [batch, n, k] = shape;
    let (len, d) = (batch * n * k, n * k);
    let mut made = Case::default();
    made.inputs.put("mu", &shape, Draw::new(67, case, 0).normals(len));
    made.inputs.put("logvar", &shape, Draw::new(67, case, 1).uniforms(len, -2.0, 0.5));
    match case {
        1 => {
            let pairs = [0.0, 1.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.25, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0];
            made.inputs.put("among", &[n, n], pairs.to_vec());
            let entry = |at: usize| if at / d == at % d { 0.5_f32 } else { 0.03 };
            made.inputs.put("carried", &[d, d], (0..d * d).map(entry).collect());
            made.settings.insert("share".to_owned(), Setting::Number(8.0 / 15.0));
        }
        2 => {
            made.inputs.put("mask", &[n, n], Draw::new(67, case, 2).uniforms(n * n, 0.2, 0.9));
            made.inputs.put("weight", &[n, n], Draw::new(67, case, 3).normals(n * n));
        }
        3 => drop(made.settings.insert("form".to_owned(), Setting::Text("total".to_owned()))),
        _ => {}
    }
    made
}
