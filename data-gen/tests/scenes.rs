//! The scenes agree with their documentation and are reproducible.

use std::collections::BTreeMap;

use data_gen::poison;
use data_gen::splats::{Gaussians, Scene, View, bench_scene, bench_view, demo, small_random};
use reference::array::{Arr, Named};
use reference::num::bits::digest_f64;
use reference::twins::{Request, value};

fn flat<const K: usize>(x: &[[f64; K]]) -> Vec<f64> {
    x.iter().flatten().copied().collect()
}

fn render(gaussians: &Gaussians, views: &[View]) -> BTreeMap<String, Arr<f64>> {
    let (n, c) = (gaussians.means.len(), views.len());
    let k = (gaussians.sh_degree + 1) * (gaussians.sh_degree + 1);
    let arrays = [
        ("means", Arr::new(&[n, 3], flat(&gaussians.means))),
        ("quats", Arr::new(&[n, 4], flat(&gaussians.quats))),
        ("scales", Arr::new(&[n, 3], flat(&gaussians.scales))),
        ("opacities", Arr::new(&[n], gaussians.opacities.clone())),
        ("sh", Arr::new(&[n, k, 3], gaussians.sh.clone())),
        ("sh_degree", Arr::scalar(gaussians.sh_degree as f64)),
        ("view_from_world", Arr::new(&[c, 4, 4], views.iter().flat_map(|v| v.view_from_world).collect())),
        ("intrinsics", Arr::new(&[c, 3, 3], views.iter().flat_map(|v| v.intrinsics).collect())),
        ("width", Arr::scalar(views[0].width as f64)),
        ("height", Arr::scalar(views[0].height as f64)),
        ("background", Arr::new(&[3], vec![0.0; 3])),
    ];
    let inputs: Named<f64> = arrays.into_iter().map(|(name, x)| (name.to_owned(), x)).collect();
    let settings = BTreeMap::new();
    value(&Request { op: "splat.render", inputs: &inputs, settings: &settings, plan: None })
        .expect("a render")
        .outputs
}

fn digest(gaussians: &Gaussians) -> u64 {
    let all: Vec<f64> = [
        flat(&gaussians.means),
        flat(&gaussians.quats),
        flat(&gaussians.scales),
        gaussians.opacities.clone(),
        gaussians.sh.clone(),
    ]
    .concat();
    digest_f64(&[all.len()], &all).expect("no NaN")
}

fn check_views(scene: &Scene) {
    for view in &scene.views {
        let v = &view.view_from_world;
        for a in 0..3 {
            for b in 0..3 {
                let product = (0..3).fold(0.0, |sum, k| sum + v[4 * a + k] * v[4 * b + k]);
                assert!(
                    (product - f64::from(u8::from(a == b))).abs() < 1e-14,
                    "rows {a}, {b} of the rotation"
                );
            }
        }
        let det = (0..3).fold(0.0, |sum, k| {
            let at = |r: usize, c: usize| v[4 * r + c % 3];
            sum + at(0, k) * (at(1, k + 1) * at(2, k + 2) - at(1, k + 2) * at(2, k + 1))
        });
        assert!((det - 1.0).abs() < 1e-14, "a rotation, not a reflection: {det}");
        assert!(v[6] <= 0.0, "the world's z axis points up, opposite to the image's y");
    }
}

#[test]
fn scenes_never_change() {
    for (name, gaussians, expected) in [
        ("demo", demo().gaussians, 0x8457f04795428833_u64),
        ("bench", bench_scene(100, 1), 0xe811b346c78d8ac8),
        ("small", small_random(30, 1, 64, 48).gaussians, 0xf3ac4bacc93978c7),
    ] {
        assert_eq!(digest(&gaussians), expected, "{name}");
    }
    assert_ne!(digest(&bench_scene(100, 1)), digest(&bench_scene(100, 2)));
}

#[test]
fn the_demo_shows_something() {
    let scene = demo();
    check_views(&scene);
    assert!((300..=2000).contains(&scene.gaussians.means.len()), "{} Gaussians", scene.gaussians.means.len());
    let outputs = render(&scene.gaussians, &scene.views[..2]);
    let [h, w] = [scene.views[0].height, scene.views[0].width];
    for view in 0..2 {
        let alpha = &outputs["alpha"].data[view * h * w..(view + 1) * h * w];
        let covered = alpha.iter().filter(|&&a| a > 0.9).count() as f64 / (h * w) as f64;
        assert!(covered > 0.25 && covered < 0.95, "view {view}: {covered} of the image is covered");
        let image = &outputs["image"].data[view * h * w * 3..(view + 1) * h * w * 3];
        assert!(image.iter().all(|&c| (0.0..=1.0).contains(&c)), "colours stay in range");
        for hue in 0..3 {
            let pure = image.chunks(3).filter(|c| (0..3).all(|k| k == hue || c[hue] > c[k] + 0.3)).count();
            assert!(pure > 50, "view {view}: channel {hue} has a colour of its own");
        }
    }
}

#[test]
fn the_bench_scene_has_its_distributions() {
    let n = 4000;
    let scene = bench_scene(n, 3);
    let moments = |x: &[f64]| {
        let mean = x.iter().fold(0.0, |sum, x| sum + x) / x.len() as f64;
        let variance = x.iter().fold(0.0, |sum, x| sum + (x - mean) * (x - mean)) / x.len() as f64;
        (mean, variance.sqrt())
    };
    let near = |(mean, deviation): (f64, f64), expected: (f64, f64), tolerance: f64| {
        assert!(
            (mean - expected.0).abs() < tolerance && (deviation - expected.1).abs() < tolerance,
            "{mean} {deviation}"
        );
    };
    near(moments(&flat(&scene.means)), (0.0, 1.0 / 3.0_f64.sqrt()), 0.02);
    let logs: Vec<f64> = flat(&scene.scales).into_iter().map(reference::num::elem::ln).collect();
    near(moments(&logs), (reference::num::elem::ln(0.02), 0.4), 0.02);
    let logits: Vec<f64> = scene.opacities.iter().map(|o| reference::num::elem::ln(o / (1.0 - o))).collect();
    near(moments(&logits), (0.0, 1.5), 0.08);
    near(moments(&scene.sh), (0.0, 0.1), 0.002);
    assert!(scene.means.iter().flatten().all(|x| x.abs() < 1.0));
    assert!(scene.quats.iter().all(|q| (q.iter().fold(0.0, |s, q| s + q * q) - 1.0).abs() < 1e-14));
    let alpha = &render(&bench_scene(500, 3), &[bench_view(64, 64)])["alpha"];
    assert!(
        alpha.data[32 * 64 + 32] > 0.0 && alpha.data[0] < 1e-3,
        "the cube fills the middle, not the corners"
    );
}

#[test]
fn the_small_scene_is_seen_by_both_cameras() {
    let scene = small_random(40, 5, 48, 36);
    check_views(&scene);
    assert_eq!(scene.views.len(), 2);
    assert!(scene.views.iter().all(|view| view.intrinsics[0] != view.intrinsics[4]));
    let alpha = &render(&scene.gaussians, &scene.views)["alpha"];
    for view in 0..2 {
        let seen = alpha.data[view * 48 * 36..(view + 1) * 48 * 36].iter().filter(|&&a| a > 0.1).count();
        assert!(seen > 400, "view {view}: {seen} pixels");
    }
}

#[test]
fn poison_is_put_in_one_place_at_a_time() {
    let good = [1.0, 2.0, 3.0];
    let copies: Vec<_> = poison::copies(&good, &[0, 2]).collect();
    assert_eq!(copies.len(), 2 * poison::TABLE.len());
    for copy in &copies {
        let changed = (0..3).filter(|&i| copy.entries[i].to_bits() != good[i].to_bits());
        let only: Vec<usize> = changed.collect();
        assert!(only == [copy.index] || (only.is_empty() && copy.poison.value == good[copy.index]));
    }
    let names: std::collections::BTreeSet<_> = poison::TABLE.iter().map(|p| p.name).collect();
    assert_eq!(names.len(), poison::TABLE.len(), "names are unique");
}

#[test]
fn twins_answer_poison_with_numbers_or_an_error() {
    let scene = small_random(3, 7, 16, 16);
    let g = &scene.gaussians;
    let arrays = [
        ("means", vec![3, 3], flat(&g.means)),
        ("quats", vec![3, 4], flat(&g.quats)),
        ("scales", vec![3, 3], flat(&g.scales)),
        ("opacities", vec![3], g.opacities.clone()),
        ("rgb", vec![3, 3], vec![0.5; 9]),
    ];
    let mut inputs: Named<f64> =
        arrays.iter().map(|(name, shape, x)| ((*name).to_owned(), Arr::new(shape, x.clone()))).collect();
    inputs
        .insert("view_from_world".to_owned(), Arr::new(&[1, 4, 4], scene.views[0].view_from_world.to_vec()));
    inputs.insert("intrinsics".to_owned(), Arr::new(&[1, 3, 3], scene.views[0].intrinsics.to_vec()));
    inputs.insert("width".to_owned(), Arr::scalar(16.0));
    inputs.insert("height".to_owned(), Arr::scalar(16.0));
    inputs.insert("background".to_owned(), Arr::new(&[3], vec![0.1; 3]));
    let settings = BTreeMap::new();
    let (mut answered, mut refused) = (0, 0);
    for (name, shape, x) in &arrays {
        let places: Vec<usize> = (0..x.len() / 3).collect();
        for copy in poison::copies(x, &places) {
            let mut inputs = inputs.clone();
            inputs.insert((*name).to_owned(), Arr::new(shape, copy.entries.clone()));
            let request = Request { op: "splat.render", inputs: &inputs, settings: &settings, plan: None };
            match value(&request) {
                Ok(answer) => {
                    answered += 1;
                    let all = answer.outputs.values().chain(answer.intermediates.values());
                    let finite = all.flat_map(|x| &x.data).all(|x| x.is_finite());
                    assert!(finite, "{} at {name}[{}]", copy.poison.name, copy.index);
                }
                Err(message) => {
                    refused += 1;
                    assert!(message.contains(*name) || message.contains("Gaussian 0"), "{message}");
                }
            }
        }
    }
    assert!(answered > 200 && refused > 30, "{answered} answered, {refused} refused");
}
