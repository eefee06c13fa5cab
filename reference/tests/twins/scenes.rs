//! Small scenes and requests that tests share. All numbers are drawn by counter.

use std::collections::BTreeMap;

use reference::array::{Arr, Named};
use reference::num::elem;
use reference::num::rng::{Key, normal_f64, uniform_f64};
use reference::twins::{self, Request, Setting};

/// Settings from words and numbers in text.
pub(crate) fn settings(of: &[(&str, &str)]) -> BTreeMap<String, Setting> {
    of.iter().map(|(name, text)| ((*name).to_owned(), Setting::Text((*text).to_owned()))).collect()
}

/// Arrays by name.
pub(crate) fn named<const K: usize>(of: [(&str, Arr<f64>); K]) -> Named<f64> {
    of.into_iter().map(|(name, x)| (name.to_owned(), x)).collect()
}

/// Normal numbers of a shape; `purpose` tells draws apart.
pub(crate) fn normal(shape: &[usize], purpose: u16) -> Arr<f64> {
    let mut item = 0;
    Arr::filled(shape, 0.0).map(|_| {
        item += 1;
        normal_f64(Key { seed: 2, item, step: 0, purpose, draw: 0 })
    })
}

/// Uniform numbers in low..high.
pub(crate) fn uniform(shape: &[usize], [low, high]: [f64; 2], purpose: u16) -> Arr<f64> {
    let mut item = 0;
    Arr::filled(shape, 0.0).map(|_| {
        item += 1;
        low + (high - low) * uniform_f64(Key { seed: 3, item, step: 0, purpose, draw: 0 })
    })
}

/// Normal directions shaped like the named arrays.
pub(crate) fn directions(of: &Named<f64>, names: &[&str], purpose: u16) -> Named<f64> {
    let each = names.iter().enumerate().filter_map(|(k, &name)| {
        Some((name.to_owned(), normal(&of.get(name)?.shape, purpose + 100 * k as u16)))
    });
    each.collect()
}

/// Two cameras with unequal focal lengths, the second turned by 0.3 about the vertical.
pub(crate) fn cameras(width: usize, height: usize) -> Named<f64> {
    let (sin, cos) = (elem::sin(0.3), elem::cos(0.3));
    let first = [1.0, 0.0, 0.0, 0.1, 0.0, 1.0, 0.0, -0.2, 0.0, 0.0, 1.0, 4.0, 0.0, 0.0, 0.0, 1.0];
    let second = [cos, 0.0, sin, -0.3, 0.0, 1.0, 0.0, 0.1, -sin, 0.0, cos, 3.5, 0.0, 0.0, 0.0, 1.0];
    let (w, h) = (width as f64, height as f64);
    let k = [1.1 * w, 0.0, 0.48 * w, 0.0, 1.3 * w, 0.53 * h, 0.0, 0.0, 1.0];
    named([
        ("view_from_world", Arr::new(&[2, 4, 4], [first, second].concat())),
        ("intrinsics", Arr::new(&[2, 3, 3], [k, k].concat())),
        ("width", Arr::scalar(w)),
        ("height", Arr::scalar(h)),
    ])
}

/// Inputs of `splat.render` for `n` Gaussians and two cameras.
pub(crate) fn scene(n: usize, width: usize, height: usize) -> Named<f64> {
    let mut scene = cameras(width, height);
    scene.extend(named([
        ("means", uniform(&[n, 3], [-1.0, 1.0], 1)),
        ("quats", normal(&[n, 4], 2)),
        ("scales", uniform(&[n, 3], [0.05, 0.3], 3)),
        ("opacities", uniform(&[n], [0.1, 0.9], 4)),
        ("sh", normal(&[n, 16, 3], 5).map(|x| 0.2 * x)),
        ("sh_degree", Arr::scalar(3.0)),
        ("background", Arr::new(&[3], vec![0.2, 0.4, 0.7])),
    ]));
    scene
}

/// One Gaussian per (mean, scale, opacity, grey), unrotated, seen by one pinhole camera at the origin looking along +z with
/// focal length 100 px and the principal point in the middle.
pub(crate) fn frontal(of: &[([f64; 3], f64, f64, f64)], width: usize, height: usize) -> Named<f64> {
    let n = of.len();
    let identity: Vec<f64> = (0..16).map(|i| if i % 5 == 0 { 1.0 } else { 0.0 }).collect();
    let (w, h) = (width as f64, height as f64);
    named([
        ("means", Arr::new(&[n, 3], of.iter().flat_map(|g| g.0).collect())),
        ("quats", Arr::new(&[n, 4], of.iter().flat_map(|_| [1.0, 0.0, 0.0, 0.0]).collect())),
        ("scales", Arr::new(&[n, 3], of.iter().flat_map(|g| [g.1; 3]).collect())),
        ("opacities", Arr::new(&[n], of.iter().map(|g| g.2).collect())),
        ("rgb", Arr::new(&[n, 3], of.iter().flat_map(|g| [g.3; 3]).collect())),
        ("view_from_world", Arr::new(&[1, 4, 4], identity)),
        ("intrinsics", Arr::new(&[1, 3, 3], vec![100.0, 0.0, 0.5 * w, 0.0, 100.0, 0.5 * h, 0.0, 0.0, 1.0])),
        ("width", Arr::scalar(w)),
        ("height", Arr::scalar(h)),
        ("background", Arr::new(&[3], vec![0.0; 3])),
    ])
}

/// The answer of a request that must succeed.
pub(crate) fn run(op: &str, inputs: &Named<f64>, with: &[(&str, &str)]) -> twins::Results {
    let settings = settings(with);
    twins::value(&Request { op, inputs, settings: &settings, plan: None }).expect("a good request")
}

/// The message of a request that must fail.
pub(crate) fn refused(op: &str, inputs: &Named<f64>, with: &[(&str, &str)]) -> String {
    let settings = settings(with);
    twins::value(&Request { op, inputs, settings: &settings, plan: None }).expect_err("a bad request")
}

/// The gradient of a request that must succeed.
pub(crate) fn gradient(
    op: &str,
    inputs: &Named<f64>,
    with: &[(&str, &str)],
    bars: &Named<f64>,
) -> Named<f64> {
    let settings = settings(with);
    twins::vjp(&Request { op, inputs, settings: &settings, plan: None }, bars).expect("a good request").1
}

/// Σ over the arrays of `a`, entry times entry of `b`.
pub(crate) fn dot(a: &Named<f64>, b: &Named<f64>) -> f64 {
    let terms = a.iter().flat_map(|(name, x)| x.data.iter().zip(&b[name].data));
    terms.fold(0.0, |sum, (x, y)| sum + x * y)
}
