//! From images to tokens and back.

use super::call::RunResult;
use super::case::Draw;
use super::op::{Case, CheckedCall, Op};
use crate::nn::{fuse, tokens, unpatch};
use crate::num::array::entries;
use crate::{Error, Result};
use reference::settings::Setting;

/// `nn.tokens`
pub(super) static TOKENS: Op = Op {
    work_unit: "products",
    work_ns: [1.0, 60.0],
    check: check_tokens,
    cases: 3,
    ..Op::new(&reference::nn::tokens::SIGNATURE, run_tokens, case_tokens)
};

fn shape(x: &CheckedCall<'_>) -> tokens::Shape {
    tokens::Shape { views: x.dim("B"), height: x.dim("H"), width: x.dim("W"), patch: x.dim("P") }
}

fn check_tokens(x: &CheckedCall<'_>) -> Result<()> {
    let shape = shape(x);
    if shape.grid().is_none() {
        return Err(Error::input("array 'image'")
            .expected(format!(
                "sides that are multiples of the patch, which is 1 to {} pixels wide",
                tokens::MAX_PATCH
            ))
            .got(format!("{}x{} pixels, patch {}", shape.height, shape.width, shape.patch)));
    }
    if x.has("photo") != x.has("w_photo") {
        let [there, missing] = if x.has("photo") { ["photo", "w_photo"] } else { ["w_photo", "photo"] };
        return Err(Error::input(format!("array '{there}'"))
            .expected(format!("array '{missing}' with it"))
            .got("none"));
    }
    if x.dim("D") == 0 {
        return Err(Error::input("array 'bias'").expected("at least one column").got("none"));
    }
    x.single("eps", 1e-6, |eps| eps > 0.0, "above 0").map(drop)
}

/// Inputs in the order of the ports.
const TOKENS_IN: [&str; 9] =
    ["image", "rays", "photo", "w_image", "w_rays", "w_photo", "bias", "norm_gain", "norm_bias"];

fn run_tokens(x: &CheckedCall<'_>) -> Result<RunResult> {
    let arrays = TOKENS_IN.map(|name| x.f32s(name));
    let [image, rays, photo, w_image, w_rays, w_photo, bias, norm_gain, norm_bias] = &arrays;
    let shape = shape(x);
    let input = tokens::In {
        image,
        rays,
        photo,
        w_image,
        w_rays,
        w_photo,
        bias,
        norm_gain,
        norm_bias,
        eps: x.number("eps").unwrap_or(1e-6),
        shape,
    };
    let [rows, columns] = shape.grid().expect("checked before");
    let size = [shape.views, rows, columns, bias.len()];
    let mut y = vec![0.0; entries(&size)];
    let saved = tokens::forward(&input, &mut y);
    let mut ran = RunResult::default();
    ran.outputs.put("tokens", &size, y);
    if let Some(y_bar) = x.bar("tokens", &size)? {
        let start = |i: usize| x.start(TOKENS_IN[i], arrays[i].len());
        let mut bar = tokens::InBar {
            image: start(0),
            rays: start(1),
            photo: start(2),
            w_image: start(3),
            w_rays: start(4),
            w_photo: start(5),
            bias: start(6),
            norm_gain: start(7),
            norm_bias: start(8),
        };
        tokens::adjoint(&input, &saved, &y_bar, &mut bar);
        let bars = [
            bar.image,
            bar.rays,
            bar.photo,
            bar.w_image,
            bar.w_rays,
            bar.w_photo,
            bar.bias,
            bar.norm_gain,
            bar.norm_bias,
        ];
        for (name, values) in TOKENS_IN.into_iter().zip(bars).filter(|(name, _)| x.has(name)) {
            ran.gradients.put(name, &x.shape(name), values);
        }
    }
    Ok(ran)
}

/// Case 0: one view without a photo; case 1: two views with photos and a large ε; case 2: squares of 8 pixels, more columns
/// than one panel of a product has, and an even width.
fn case_tokens(case: usize) -> Case {
    let [views, height, width, patch, d] = [[1, 4, 6, 2, 5], [2, 6, 9, 3, 4], [3, 8, 16, 8, 18]][case];
    let draw = |array, shape: &[usize]| Draw::new(36, case, array).normals(entries(shape));
    let mut made = Case::default();
    for (i, name) in TOKENS_IN.into_iter().enumerate() {
        let channels = if name.ends_with("rays") { 6 } else { 3 };
        let shape: &[usize] = match i {
            0..3 => &[views, height, width, channels],
            3..6 => &[d, patch, patch, channels],
            _ => &[d],
        };
        if case > 0 || !name.ends_with("photo") {
            made.inputs.put(name, shape, draw(i as u16, shape));
        }
    }
    if case == 1 {
        made.settings.insert("eps".to_owned(), Setting::Number(0.25));
    }
    made
}

/// `nn.fuse`
pub(super) static FUSE: Op = Op {
    work_unit: "products",
    work_ns: [1.0, 60.0],
    check: check_fuse,
    ..Op::new(&reference::nn::fuse::SIGNATURE, run_fuse, case_fuse)
};

fn check_fuse(x: &CheckedCall<'_>) -> Result<()> {
    let (columns, d) = (x.dim("D2"), x.dim("D"));
    if d == 0 || x.dim("H") == 0 {
        return Err(Error::input("array 'w2'").expected("a row and a column").got("none"));
    }
    if columns != 2 * d {
        return Err(Error::input("array 'w1'")
            .expected(format!("{} columns", 2 * d))
            .got(columns.to_string()));
    }
    Ok(())
}

/// Inputs in the order of the ports.
const FUSE_IN: [&str; 6] = ["state", "position", "w1", "b1", "w2", "b2"];

fn run_fuse(x: &CheckedCall<'_>) -> Result<RunResult> {
    let arrays = FUSE_IN.map(|name| x.f32s(name));
    let [state, position, w1, b1, w2, b2] = &arrays;
    let rule = match x.word("fuse") {
        Some("residual") => fuse::Rule::Residual,
        _ => fuse::Rule::Published,
    };
    let input = fuse::In { state, position, w1, b1, w2, b2, rule };
    let (size, mut y) = (x.shape("position"), vec![0.0; position.len()]);
    let saved = fuse::forward(&input, &mut y);
    let mut ran = RunResult::default();
    ran.outputs.put("tokens", &size, y);
    if let Some(y_bar) = x.bar("tokens", &size)? {
        let start = |i: usize| x.start(FUSE_IN[i], arrays[i].len());
        let mut bar = fuse::InBar {
            state: start(0),
            position: start(1),
            w1: start(2),
            b1: start(3),
            w2: start(4),
            b2: start(5),
        };
        fuse::adjoint(&input, &saved, &y_bar, &mut bar);
        let bars = [bar.state, bar.position, bar.w1, bar.b1, bar.w2, bar.b2];
        for (name, values) in FUSE_IN.into_iter().zip(bars) {
            ran.gradients.put(name, &x.shape(name), values);
        }
    }
    Ok(ran)
}

/// Case 0: as published; case 1: residual, more rows than one task has, a hidden layer of another width.
fn case_fuse(case: usize) -> Case {
    let [t, d, hidden] = [[5, 3, 4], [41, 6, 19]][case];
    let shapes: [&[usize]; 6] = [&[t, d], &[t, d], &[hidden, 2 * d], &[hidden], &[d, hidden], &[d]];
    let mut made = Case::default();
    for (i, (name, shape)) in FUSE_IN.into_iter().zip(shapes).enumerate() {
        made.inputs.put(name, shape, Draw::new(37, case, i as u16).normals(entries(shape)));
    }
    if case == 1 {
        made.settings.insert("fuse".to_owned(), Setting::Text("residual".to_owned()));
    }
    made
}

/// `nn.unpatch`
pub(super) static UNPATCH: Op = Op {
    work_unit: "products",
    work_ns: [1.0, 60.0],
    check: check_unpatch,
    ..Op::new(&reference::nn::unpatch::SIGNATURE, run_unpatch, case_unpatch)
};

fn check_unpatch(x: &CheckedCall<'_>) -> Result<()> {
    match ["H", "W", "D", "R", "C"].into_iter().find(|axis| x.dim(axis) == 0) {
        Some(axis) => Err(Error::input("arrays").expected(format!("an entry along {axis}")).got("none")),
        None => Ok(()),
    }
}

fn run_unpatch(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (grids, weight, bias) = (x.f32s("tokens"), x.f32s("weight"), x.f32s("bias"));
    let shape = unpatch::Shape {
        grids: x.dim("N"),
        height: x.dim("H"),
        width: x.dim("W"),
        patch: x.dim("R"),
        channels: x.dim("C"),
    };
    let input = unpatch::In { tokens: &grids, weight: &weight, bias: &bias, shape };
    let size = [shape.grids, shape.patch * shape.height, shape.patch * shape.width, shape.channels];
    let mut y = vec![0.0; entries(&size)];
    unpatch::forward(&input, &mut y);
    let mut ran = RunResult::default();
    ran.outputs.put("y", &size, y);
    if let Some(y_bar) = x.bar("y", &size)? {
        let mut bar = unpatch::InBar {
            tokens: x.start("tokens", grids.len()),
            weight: x.start("weight", weight.len()),
            bias: x.start("bias", bias.len()),
        };
        unpatch::adjoint(&input, &y_bar, &mut bar);
        ran.gradients.put("tokens", &x.shape("tokens"), bar.tokens);
        ran.gradients.put("weight", &x.shape("weight"), bar.weight);
        ran.gradients.put("bias", &x.shape("bias"), bar.bias);
    }
    Ok(ran)
}

/// Case 0: two grids; case 1: squares of 4 texels, more channels than one panel of a product has.
fn case_unpatch(case: usize) -> Case {
    let ([n, h, w, d], [r, c]) = [([2, 2, 3, 5], [2, 3]), ([1, 3, 2, 19], [4, 17])][case];
    let mut made = Case::default();
    let shapes: [&[usize]; 3] = [&[n, h, w, d], &[d, r, r, c], &[c]];
    for (i, (name, shape)) in ["tokens", "weight", "bias"].into_iter().zip(shapes).enumerate() {
        made.inputs.put(name, shape, Draw::new(38, case, i as u16).normals(entries(shape)));
    }
    made
}
