//! Networks, softmax and windows.

use super::call::RunResult;
use super::case::Draw;
use super::op::{Case, CheckedCall, Op};
use crate::nn::{decoder, mlp, softmax, window::Window};
use crate::num::array::Array;
use crate::num::order;
use crate::tape::check::Prediction;
use crate::{Error, Result};
use reference::settings::Setting;

/// `nn.mlp`
pub(super) static MLP: Op = Op {
    work_unit: "products",
    work_ns: [1.0, 60.0],
    check: |x| sizes(x).map(drop),
    ..Op::new(&reference::nn::mlp::SIGNATURE, run_mlp, case_mlp)
};

/// Outputs and inputs of every layer, and the layer that also takes the input.
fn sizes(x: &CheckedCall<'_>) -> Result<(Vec<[usize; 2]>, Option<usize>)> {
    let (widths, skip) = (x.f64s("widths"), x.number("skip").unwrap_or(0.0));
    let wrong = |got: String| {
        Error::input("array 'widths'")
            .expected("the columns of x, then at least one width above 0, consistent with 'weights', 'biases' and 'skip'")
            .got(got)
    };
    if widths.len() < 2 || !widths.iter().all(|w| *w >= 1.0 && *w <= 1e6) || widths[0] as usize != x.dim("K")
    {
        return Err(wrong(format!("{widths:?}")));
    }
    if !(skip >= 0.0 && skip == skip.trunc() && skip < (widths.len() - 1) as f64) {
        return Err(Error::input("setting skip")
            .expected("a layer after the first, or 0")
            .got(skip.to_string()));
    }
    let skip = (skip > 0.0).then_some(skip as usize);
    let of = |l: usize| {
        [widths[l + 1] as usize, widths[l] as usize + if skip == Some(l) { x.dim("K") } else { 0 }]
    };
    let layers: Vec<[usize; 2]> = (0..widths.len() - 1).map(of).collect();
    let total = layers.iter().fold([0, 0], |[w, b], [n, k]| [w + n * k, b + n]);
    if total != [x.dim("W"), x.dim("B")] || x.dim("M") == 0 {
        return Err(wrong(format!("{} weights and {} biases", x.dim("W"), x.dim("B"))));
    }
    Ok((layers, skip))
}

fn run_mlp(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (layers, skip) = sizes(x)?;
    let (rows, weights, biases, m) = (x.f32s("x"), x.f32s("weights"), x.f32s("biases"), x.dim("M"));
    let (mut w, mut b) = (&weights[..], &biases[..]);
    let mut next = |[n, k]: &[usize; 2]| {
        let (weight, bias);
        (weight, w) = w.split_at(n * k);
        (bias, b) = b.split_at(*n);
        mlp::Layer { weight, bias }
    };
    let network: Vec<mlp::Layer<'_>> = layers.iter().map(&mut next).collect();
    let input = mlp::In { x: &rows, layers: &network, m, skip };
    let (y, saved) = mlp::forward(&input);
    let mut ran = RunResult::default();
    let n = layers.last().map_or(0, |[n, _]| *n);
    ran.outputs.put("y", &[m, n], y);
    if let Some(y_bar) = x.bar("y", &[m, n])? {
        let mut bar = mlp::InBar { x: x.start("x", rows.len()), layers: Vec::new() };
        let (starts, zeros) = ([x.start("weights", weights.len()), x.start("biases", biases.len())], [0, 0]);
        layers.iter().fold(zeros, |[w, b], [n, k]| {
            bar.layers.push([starts[0][w..w + n * k].to_vec(), starts[1][b..b + n].to_vec()]);
            [w + n * k, b + n]
        });
        mlp::adjoint(&input, &saved, &y_bar, &mut bar);
        let joined = |i: usize| bar.layers.iter().flat_map(|layer| &layer[i]).copied().collect::<Vec<f32>>();
        ran.gradients.put("weights", &[weights.len()], joined(0));
        ran.gradients.put("biases", &[biases.len()], joined(1));
        ran.gradients.put("x", &x.shape("x"), bar.x);
    }
    Ok(ran)
}

/// Minimum distance of generated numbers from the kink of a unit.
const MARGIN: f32 = 0.05;

/// W x + b.
fn affine(weight: &[f32], x: &[f32], bias: &[f32]) -> Vec<f32> {
    let row = |(row, bias): (&[f32], &f32)| row.iter().zip(x).fold(0.0, |sum, (w, x)| sum + w * x) + bias;
    weight.chunks_exact(x.len()).zip(bias).map(row).collect()
}

/// Case 0: two layers; case 1: four layers, of which the third also takes the input, and more rows than one
/// task has. Each hidden unit is active in some rows and inactive in others, and never near its kink.
fn case_mlp(case: usize) -> Case {
    let (m, widths, skip) = [(17, &[3, 7, 2][..], 0), (70, &[2, 5, 4, 6, 3][..], 2)][case];
    let k = |l: usize| widths[l] + if skip > 0 && l == skip { widths[0] } else { 0 };
    let layers = 0..widths.len() - 1;
    let weights = layers.clone().fold(0, |sum, l| sum + widths[l + 1] * k(l));
    let biases = layers.fold(0, |sum, l| sum + widths[l + 1]);
    let draw = |array, len| Draw::new(13, case, array).normals(len);
    let mut made = Case::default();
    made.inputs.put("widths", &[widths.len()], widths.iter().map(|w| *w as i32).collect());
    let (mut weight, mut bias) = (draw(1, weights), draw(2, biases));
    let mut rows = draw(0, m * widths[0]);
    if skip > 0 {
        // Draws for which each unit is active and inactive in some rows, and both units of each hidden weight
        // are active in some row.
        weight = draw(26, weights);
        bias = Draw::new(13, case, 41).uniforms(biases, -0.5, 0.75);
        let apart = |row: &[f32]| {
            let (mut w, mut b, mut value) = (&weight[..], &bias[..], row.to_vec());
            (0..widths.len() - 2).all(|l| {
                if l == skip {
                    value.extend(row);
                }
                let (n, k) = (widths[l + 1], value.len());
                value = affine(&w[..n * k], &value, &b[..n]);
                (w, b) = (&w[n * k..], &b[n..]);
                let apart = value.iter().all(|z| z.abs() >= MARGIN);
                value.iter_mut().for_each(|z| *z = order::max(*z, 0.0));
                apart
            })
        };
        let pool = draw(0, 8 * m * widths[0]);
        rows = pool.chunks_exact(widths[0]).filter(|row| apart(row)).take(m).flatten().copied().collect();
    }
    made.inputs.put("x", &[m, widths[0]], rows);
    made.inputs.put("weights", &[weights], weight);
    made.inputs.put("biases", &[biases], bias);
    if skip > 0 {
        made.settings.insert("skip".to_owned(), Setting::Number(skip as f64));
    }
    made
}

/// `nn.softmax`
pub(super) static SOFTMAX: Op =
    Op { check: check_softmax, ..Op::new(&reference::nn::softmax::SIGNATURE, run_softmax, case_softmax) };

fn check_softmax(x: &CheckedCall<'_>) -> Result<()> {
    if x.dim("K") == 0 {
        return Err(Error::input("array 'x'").expected("at least one column").got("none"));
    }
    let floor = x.single("floor", 0.0, |floor| floor >= 0.0, "not negative")?;
    x.rule("base", "a weight of at least 0", |w| w >= 0.0)?;
    for (i, row) in x.f32s("base").chunks_exact(x.dim("K")).enumerate() {
        let sum = row.iter().fold(0.0, |sum, w| sum + (w + floor));
        if !sum.is_finite() {
            return Err(Error::input("array 'base'")
                .at(format!("row {i}"))
                .expected("weights, floor included, whose sum is in the range of f32")
                .got(format!("the sum {sum}")));
        }
    }
    Ok(())
}

fn run_softmax(x: &CheckedCall<'_>) -> Result<RunResult> {
    let (logits, base, shape) = (x.f32s("x"), x.f32s("base"), x.shape("x"));
    let floor = x.number("floor").unwrap_or(0.0) as f32;
    let y = softmax::forward(&softmax::In { x: &logits, base: &base, floor, k: x.dim("K") });
    let mut ran = RunResult::default();
    if let Some(y_bar) = x.bar("y", &shape)? {
        let mut bar = x.start("x", logits.len());
        softmax::adjoint(&y, x.dim("K"), &y_bar, &mut bar);
        ran.gradients.put("x", &shape, bar);
    }
    ran.outputs.put("y", &shape, y);
    Ok(ran)
}

/// Case 0: prior weights, some of them 0 except for the floor; case 1: the plain softmax over more rows than
/// one task has.
fn case_softmax(case: usize) -> Case {
    let [m, k] = [[21, 5], [300, 3]][case];
    let mut made = Case::default();
    made.inputs.put("x", &[m, k], Draw::new(14, case, 0).normals(m * k));
    if case == 0 {
        let weights = Draw::new(14, case, 1).uniforms(m * k, 0.05, 1.0);
        let some = weights.into_iter().enumerate().map(|(i, w)| if i % 7 == 3 { 0.0 } else { w });
        made.inputs.put("base", &[m, k], some.collect());
        made.settings.insert("floor".to_owned(), Setting::Number(0.0625));
    }
    made
}

/// `nn.decoder`
pub(super) static DECODER: Op = Op {
    work_unit: "products",
    work_ns: [1.0, 60.0],
    check: check_decoder,
    cases: 5,
    ..Op::new(&reference::nn::decoder::SIGNATURE, run_decoder, case_decoder)
};

fn check_decoder(x: &CheckedCall<'_>) -> Result<()> {
    if ["B", "Q", "D", "H0", "H1", "H2", "O"].iter().all(|letter| x.dim(letter) > 0) {
        return Ok(());
    }
    Err(Error::input("array 'codes'")
        .expected("an item, a coordinate, a factor, hidden units and an output")
        .got("none"))
}

/// Names of the parameters, in the order of the gradients.
const PARAMETERS: [&str; 9] =
    ["point", "latent", "bias0", "weight1", "bias1", "weight2", "bias2", "weight3", "bias3"];

fn run_decoder(x: &CheckedCall<'_>) -> Result<RunResult> {
    let p = PARAMETERS.map(|name| x.f32s(name));
    let params = decoder::Params {
        sizes: decoder::Sizes {
            features: x.dim("F"),
            latent: x.dim("D"),
            hidden: ["H0", "H1", "H2"].map(|letter| x.dim(letter)),
            outputs: x.dim("O"),
        },
        point: &p[0],
        latent: &p[1],
        weights: [&p[3], &p[5], &p[7]],
        biases: [&p[2], &p[4], &p[6], &p[8]],
    };
    let [codes, base, z, scale] = ["codes", "base", "z", "scale"].map(|name| x.f32s(name));
    let (size, shape) = (x.dim("Q") * x.dim("O"), [x.dim("B"), x.dim("Q"), x.dim("O")]);
    let features = x.dim("Q") * x.dim("F");
    let items: Vec<decoder::Item<'_>> = (0..x.dim("B"))
        .map(|b| decoder::Item {
            codes: &codes[b * features..(b + 1) * features],
            base: &base[b * size..(b + 1) * size],
        })
        .collect();
    let mut ran = RunResult::default();
    // Coordinates shared by all items use another entry point of the same network.
    let is_shared =
        items.iter().all(|item| item.codes == items[0].codes) && (features > 0 || x.dim("Q") == 1);
    let points = if is_shared {
        let mut y = decoder::values(&params, items[0].codes, &z);
        decoder::placed(&mut y, &base, &scale);
        y
    } else {
        decoder::forward(&params, &z, &items, &scale)
    };
    ran.outputs.put("points", &shape, points);
    if let Some(points_bar) = x.bar("points", &shape)? {
        let passed = decoder::adjoint(&params, &z, &items, &scale, &|b, _, bar| {
            bar.copy_from_slice(&points_bar[b * size..(b + 1) * size]);
            0.0
        });
        let names = PARAMETERS.into_iter().chain(["z"]);
        for (name, grad) in names.zip(passed.grads.into_iter().chain([passed.z_bar])) {
            let mut bar = x.start(name, grad.len());
            bar.iter_mut().zip(grad).for_each(|(bar, g)| *bar += g);
            ran.gradients.put(name, &x.shape(name), bar);
        }
    }
    Ok(ran)
}

/// Case 0: some coordinates of every item; 1: one coordinate of each, the rows of one product; in both,
/// weights are small compared with the biases, so that no derivative is taken near the kink of a unit. Case
/// 2: more items than one batch, each hidden unit on both sides of its kink; 3: vectors without coordinates;
/// 4: coordinates shared by all items; in these, weights are large, and items near a kink are excluded.
fn case_decoder(case: usize) -> Case {
    let ([b, q, f, d], [h0, h1, h2, o]) = [
        ([3, 5, 4, 3], [7, 6, 5, 6]),
        ([11, 1, 2, 2], [6, 5, 4, 3]),
        ([35, 2, 3, 2], [6, 5, 4, 3]),
        ([24, 1, 0, 3], [5, 4, 5, 2]),
        ([8, 3, 2, 2], [4, 5, 4, 3]),
    ][case];
    let shapes: [(&str, &[usize]); 12] = [
        ("codes", &[b, q, f]),
        ("z", &[b, d]),
        ("point", &[h0, f]),
        ("latent", &[h0, d]),
        ("bias0", &[h0]),
        ("weight1", &[h1, h0]),
        ("bias1", &[h1]),
        ("weight2", &[h2, h1]),
        ("bias2", &[h2]),
        ("weight3", &[o, h2]),
        ("bias3", &[o]),
        ("base", &[b, q, o]),
    ];
    let mut made = Case::default();
    for (at, (name, shape)) in shapes.into_iter().enumerate() {
        let len = crate::num::array::entries(shape);
        let draw = Draw::new(15, case, at as u16);
        let values = match name {
            "z" | "codes" | "base" => draw.normals(len),
            _ if case >= 2 && name.starts_with("bias") => draw.uniforms(len, -0.5, 0.5),
            _ if case >= 2 => draw.normals(len),
            _ if name.starts_with("bias") => {
                let sign = |i: usize| if i % 3 == 1 { -1.0 } else { 1.0 };
                draw.uniforms(len, 2.0, 3.0).into_iter().enumerate().map(|(i, b)| sign(i) * b).collect()
            }
            _ => draw.normals(len).into_iter().map(|w| 0.15 * w).collect(),
        };
        made.inputs.put(name, shape, values);
    }
    made.inputs.put("scale", &[o], (0..o).map(|c| if c < 3 { 0.5 } else { 1.25 }).collect());
    if case >= 2 {
        let (codes, z) = away_from_kinks(&made, case, [b, q, f, d]);
        made.inputs.put("codes", &[b, q, f], codes);
        made.inputs.put("z", &[b, d], z);
    }
    made
}

/// Codes (B, Q, F) and factors (B, D) of items with no hidden unit near its kink.
fn away_from_kinks(made: &Case, case: usize, [b, q, f, d]: [usize; 4]) -> (Vec<f32>, Vec<f32>) {
    let get = |name: &str| made.inputs.get(name).map(Array::to_f32).unwrap_or_default();
    let [point, latent, bias0] = ["point", "latent", "bias0"].map(get);
    let layers = [("weight1", "bias1"), ("weight2", "bias2")].map(|(w, b)| (get(w), get(b)));
    let apart = |code: &[f32], z: &[f32]| {
        let mut h = affine(&latent, z, &bias0);
        for (h, row) in h.iter_mut().zip(point.chunks_exact(order::max(f, 1))) {
            *h += row.iter().zip(code).fold(0.0, |sum, (w, x)| sum + w * x);
        }
        let mut apart = h.iter().all(|x| x.abs() >= MARGIN);
        for (weight, bias) in &layers {
            h.iter_mut().for_each(|x| *x = if *x > 0.0 { *x } else { decoder::SLOPE * *x });
            h = affine(weight, &h, bias);
            apart &= h.iter().all(|x| x.abs() >= MARGIN);
        }
        apart
    };
    let (mut codes, mut zs, mut at) = (Vec::new(), Vec::new(), 0);
    let draw =
        |array: u16, i: usize, n: usize| Draw::new(15, case, array).normals((i + 1) * n).split_off(i * n);
    while zs.len() < b * d {
        let own = if case == 4 { 0 } else { at };
        let (code, z) = (draw(0, own, q * f), draw(1, at, d));
        if (0..q).all(|i| apart(&code[i * f..(i + 1) * f], &z)) {
            codes.extend(code);
            zs.extend(z);
        }
        at += 1;
    }
    (codes, zs)
}

/// `nn.window`
pub(super) static WINDOW: Op = Op {
    work_unit: "pairs of a pixel and a cell",
    check: check_window,
    predict: outside,
    cases: 3,
    ..Op::new(&reference::nn::window::SIGNATURE, run_window, case_window)
};

/// The square (left, top, side) in pixels, and the side of the window in pixels.
fn square(x: &CheckedCall<'_>) -> Result<([f64; 3], usize)> {
    let (corner, length) = (x.f64s("corner"), x.inputs.scalar("length")?);
    Ok(([corner[0], corner[1], length], x.number("side").unwrap_or(4.0) as usize))
}

fn check_window(x: &CheckedCall<'_>) -> Result<()> {
    let side = x.number("side").unwrap_or(4.0);
    if !(1.0..=4096.0).contains(&side) || side != side.trunc() {
        return Err(Error::input("setting side")
            .expected("a whole number from 1 to 4096")
            .got(side.to_string()));
    }
    x.rule("length", "a length above 0", |a| a > 0.0)
}

fn run_window(x: &CheckedCall<'_>) -> Result<RunResult> {
    let ([left, top, length], side) = square(x)?;
    let (image, [height, width]) = (x.f32s("image"), [x.dim("H"), x.dim("W")]);
    let window = Window::new(side, [height, width], [left, top], length);
    let mut ran = RunResult::default();
    ran.outputs.put("window", &[side, side, 3], window.take(&image));
    if let Some(bar) = x.bar("window", &[side, side, 3])? {
        let mut image_bar = x.start("image", image.len());
        window.spread(&bar, &mut image_bar);
        ran.gradients.put("image", &[height, width, 3], image_bar);
    }
    Ok(ran)
}

/// Pixels outside the square have no gradient.
fn outside(x: &CheckedCall<'_>, _: &RunResult) -> Result<Prediction> {
    let ([left, top, length], _) = square(x)?;
    let meets = |from: f64, pixel: usize| pixel as f64 + 1.0 > from && (pixel as f64) < from + length;
    let width = x.dim("W");
    let pixel = |i: usize| !(meets(top, i / 3 / width) && meets(left, i / 3 % width));
    let zeros = (0..x.f32s("image").len()).map(pixel).collect();
    Ok(Prediction { zeros: [("image".to_owned(), zeros)].into(), ..Prediction::default() })
}

/// Case 0: cells larger than a pixel, partly to the left of the image; case 1: cells smaller than a pixel;
/// case 2: a square that extends beyond the image at the top, the right and the bottom.
fn case_window(case: usize) -> Case {
    let [h, w] = [[9, 12], [7, 8], [7, 9]][case];
    let mut made = Case::default();
    made.inputs.put("image", &[h, w, 3], Draw::new(16, case, 0).normals(h * w * 3));
    made.inputs.put("corner", &[2], [[-2.25_f32, 1.5], [2.125, 1.625], [5.5, -1.75]][case].to_vec());
    made.inputs.put("length", &[], vec![[9.5_f32, 3.25, 12.5][case]]);
    made.settings.insert("side".to_owned(), Setting::Number([4.0, 6.0, 5.0][case]));
    made
}
