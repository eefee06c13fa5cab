//! Rays and triangles, without adjoint.

use super::call::RunResult;
use super::case::Draw;
use super::op::{Case, CheckedCall, Op, Width};
use crate::geometry::trace;
use crate::tape::check::Prediction;
use crate::{Error, Result};
use std::f32::consts::PI;

/// `geometry.trace`
pub(super) static TRACE: Op = Op {
    signature: &reference::geometry::trace::SIGNATURE,
    adjoint: false,
    width: Width::F32,
    work_unit: "ray-triangle tests",
    work_ns: [12.0, 12.0],
    check,
    run,
    predict,
    cases: 2,
    case,
};

fn rows(flat: &[f32]) -> Vec<[f32; 3]> {
    flat.as_chunks().0.to_vec()
}

fn check(x: &CheckedCall<'_>) -> Result<()> {
    let vertices = x.dim("V");
    let index = x.f64s("triangles");
    if let Some(i) = index.iter().position(|&i| !(0.0 <= i && i < vertices as f64)) {
        let e = Error::input("array 'triangles'").at(format!("row {}", i / 3));
        return Err(e.expected(format!("indices below {vertices}")).got(index[i].to_string()));
    }
    // in f32, since a direction that is not 0 in double precision may be 0 in single precision
    match rows(&x.f32s("direction")).iter().position(|d| *d == [0.0; 3]) {
        None => Ok(()),
        Some(i) => Err(Error::input("array 'direction'")
            .at(format!("row {i}"))
            .expected("a nonzero direction")
            .got("zeros")),
    }
}

fn run(x: &CheckedCall<'_>) -> Result<RunResult> {
    let triangles: Vec<[u32; 3]> =
        x.f64s("triangles").as_chunks().0.iter().map(|t: &[f64; 3]| t.map(|i| i as u32)).collect();
    let out = trace::forward(&trace::In {
        vertices: &rows(&x.f32s("vertices")),
        triangles: &triangles,
        origin: &rows(&x.f32s("origin")),
        direction: &rows(&x.f32s("direction")),
    });
    let mut ran = RunResult::default();
    let n = x.dim("R");
    ran.outputs.put("t", &[n], out.t);
    ran.outputs.put("triangle", &[n], out.triangle);
    Ok(ran)
}

fn predict(_: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    Ok(Prediction { infinite: vec!["t".to_owned()], ..Prediction::default() })
}

/// Case 0: random triangles; case 1: a closed surface over a grid of angles, so that neighbours share edges.
/// Two rays in three hit.
fn case(case: usize) -> Case {
    let draw = |array| Draw::new(30, case, array);
    let mut made = Case::default();
    let (vertices, triangles): (Vec<f32>, Vec<i32>) = if case == 0 {
        let index = draw(1).uniforms(3 * 40, 0.0, 30.0);
        (draw(0).normals(3 * 30), index.into_iter().map(|i| i as i32).collect())
    } else {
        closed(draw(0).uniforms(24 * 12, 0.8, 1.2))
    };
    let rays = [60, 300][case];
    made.inputs.put("vertices", &[vertices.len() / 3, 3], vertices);
    made.inputs.put("triangles", &[triangles.len() / 3, 3], triangles);
    made.inputs.put("origin", &[rays, 3], draw(2).uniforms(3 * rays, -1.5, 1.5));
    made.inputs.put("direction", &[rays, 3], draw(3).normals(3 * rays));
    made
}

/// A ring of 24 sections with 12 corners each, at the given distances from its core.
fn closed(distance: Vec<f32>) -> (Vec<f32>, Vec<i32>) {
    use crate::num::elem::{cos, sin};
    let (u, v) = (24, 12);
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for i in 0..u {
        for j in 0..v {
            let (a, b) = (PI / 12.0 * i as f32, PI / 6.0 * j as f32);
            let r = 0.4 * distance[i * v + j];
            let ring = 1.0 + r * cos(b);
            vertices.extend([ring * cos(a), ring * sin(a), r * sin(b)]);
            let at = |i: usize, j: usize| ((i % u) * v + j % v) as i32;
            triangles.extend([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            triangles.extend([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    (vertices, triangles)
}
