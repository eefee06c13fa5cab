//! Layers.

use super::call::{Checked, Ran};
use super::case::Draw;
use super::op::{Case, Op, Port, Width, no_rule, no_zeros};
use crate::Result;
use crate::nn::linear;

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
