use super::config::Config;
use super::decode::Rendering;
use super::params::first;
use super::transformer::{Input, Keep};
use super::weights::Ready;
use crate::field::render::InBar;
use crate::fit::field::scene::Weights;
use crate::num::rng::Rng;
use crate::scene::field::Placement;
use crate::tape::Params;

const TINY: Config = Config {
    blocks: 2,
    width: 16,
    heads: 2,
    planes: 6,
    plane_tokens: 1,
    embed_tokens: 1,
    channels: 3,
    is_whole: true,
    ..Config::SMALL
};

fn numbers(seed: u64, n: usize) -> Vec<f32> {
    let rng = Rng::new(seed);
    (0..n).map(|i| 2.0 * rng.uniform_f32(i as u64, 0, 1, 0) - 1.0).collect()
}

fn view(seed: u64, size: [usize; 2]) -> Input {
    let n = size[0] * size[1];
    Input {
        size,
        image: numbers(seed, 3 * n),
        rays: numbers(seed + 1, 6 * n),
        photo: numbers(seed + 2, 3 * n),
    }
}

fn params() -> Params {
    let mut params = first(&TINY, 1);
    let names: Vec<String> = params.iter().map(|(name, _)| name.to_owned()).collect();
    // No array is 0, so that all parts have a gradient.
    for (k, name) in names.iter().enumerate() {
        let array = params.get_mut(name).expect("a name of its own");
        let noise = numbers(100 + k as u64, array.len());
        array.iter_mut().zip(noise).for_each(|(x, r)| *x += 0.1 * r);
    }
    params
}

const PLACEMENT: Placement = Placement::new([0.0; 3], 1.0);
const RENDERING: Rendering =
    Rendering { samples: 16, inverse_beta: 10.0, least_weight: None, early_stop: None };

/// A linear function of all texels of the field that a state decodes to, after two sets of images of two
/// sizes.
fn value(params: &Params, state: &[f32], views: &[Input], c: [&[f32]; 2]) -> f64 {
    let ready = Ready::new(TINY, params);
    let (next, _) = ready.read(state, views, None);
    let field = ready.decode(&next, RENDERING, PLACEMENT);
    let panoramas = field.panoramas.expect("a whole model has them").values;
    let dot = |x: &[f32], c: &[f32]| x.iter().zip(c).fold(0.0, |s, (x, c)| s + f64::from(*x) * f64::from(*c));
    dot(&field.planes.values, c[0]) + dot(&panoramas, c[1])
}

#[test]
fn gradients_are_difference_quotients_with_and_without_recomputation() {
    let params = params();
    let ready = Ready::new(TINY, &params);
    let views = [view(7, [16, 8]), view(17, [8, 8])];
    let state = numbers(3, TINY.state_tokens() * TINY.width);
    let c = [numbers(4, 6 * 64 * 3), numbers(5, 4 * 16 * 3)];
    // Heads have the gradients that the adjoint of the render gives them, in the arrays of their names.
    let names = ["sdf", "color", "albedo", "material", "normal", "rho"];
    let mut both = Vec::new();
    for keep in [Keep::All, Keep::Inputs] {
        let (next, saved) = ready.read(&state, &views, Some(keep));
        let field = ready.decode(&next, RENDERING, PLACEMENT);
        let weights = Weights::of(&field);
        let rays = crate::field::render::Rays { origins: &[], directions: &[] };
        let mut bar = InBar::zeros_like(&weights.scene(rays));
        bar.planes.copy_from_slice(&c[0]);
        bar.panoramas.copy_from_slice(&c[1]);
        let heads = &mut bar.heads;
        let layers = [
            &mut heads.sdf,
            &mut heads.color,
            &mut heads.albedo,
            &mut heads.material,
            &mut heads.normal,
            &mut heads.rho,
        ];
        let mut expected = Vec::new();
        for (k, (name, layers)) in names.iter().zip(layers).enumerate() {
            for (l, part) in layers.iter_mut().enumerate() {
                let noise = numbers(700 + 10 * k as u64 + l as u64, part.len());
                part.copy_from_slice(&noise);
                expected.push((format!("heads/{name}/{l}"), part.clone()));
            }
        }
        let mut g = ready.zeros();
        let mut next_bar = vec![0.0; next.len()];
        ready.pull_decoded(&next, &bar, &mut g, &mut next_bar);
        let mut state_bar = vec![0.0; state.len()];
        ready.pull_read(&state, &views, saved.expect("kept"), &next_bar, &mut g, &mut state_bar);
        let made = ready.finish(g);
        assert_eq!(expected.len(), made.0.keys().filter(|name| name.starts_with("heads/")).count());
        for (name, part) in &expected {
            assert_eq!(made.get(name).and_then(|g| g.as_slice()), Some(&part[..]), "{name}");
        }
        both.push((made, state_bar));
    }
    assert_eq!(both[0], both[1], "the same bits");
    let c = [&c[0][..], &c[1][..]];
    let (made, state_bar) = &both[0];
    // Compares a gradient, along numbers of a seed, with the quotient of values that are moved along them.
    let check = |name: &str, gradient: &[f32], seed: u64, moved: &dyn Fn(&[f32]) -> f64| {
        let direction = numbers(seed, gradient.len());
        let along = gradient.iter().zip(&direction).fold(0.0, |s, (g, d)| s + f64::from(*g) * f64::from(*d));
        let h = 2e-3;
        let at = |h: f32| moved(&direction.iter().map(|d| h * d).collect::<Vec<_>>());
        let quotient = (at(h) - at(-h)) / (2.0 * f64::from(h));
        let size = gradient.iter().fold(0.0, |s, g| s + f64::from(*g) * f64::from(*g)).sqrt();
        assert!((along - quotient).abs() < 0.02 * size + 1e-3, "{name}: {along} {quotient}, length {size}");
        assert!(size > 0.0, "{name} has a gradient");
    };
    for (name, gradient) in made.0.iter().filter(|(name, _)| !name.starts_with("heads/")) {
        let gradient = gradient.as_slice().expect("contiguous");
        check(name, gradient, 900, &|change| {
            let mut params = params.clone();
            let array = params.get_mut(name).expect("a parameter");
            array.iter_mut().zip(change).for_each(|(x, d)| *x += d);
            value(&params, &state, &views, c)
        });
        if name.ends_with("qkv/bias") {
            // A number that is added to all keys changes no softmax.
            let has: Vec<bool> =
                gradient.chunks(gradient.len() / 3).map(|part| part.iter().any(|g| *g != 0.0)).collect();
            assert_eq!(has, [true, false, true], "{name}: of queries, keys and values");
        }
    }
    check("the state that was read", state_bar, 901, &|change| {
        let state: Vec<f32> = state.iter().zip(change).map(|(x, d)| x + d).collect();
        value(&params, &state, &views, c)
    });
}

#[test]
fn a_state_has_the_same_size_for_any_images_and_they_matter() {
    let params = params();
    let ready = Ready::new(TINY, &params);
    let none = ready.no_state();
    let (one, saved) = ready.read(&none, &[view(1, [8, 8])], None);
    assert!(saved.is_none(), "nothing was to be kept");
    let (many, _) = ready.read(&one, &[view(2, [24, 8]), view(3, [8, 16]), view(4, [8, 8])], None);
    assert_eq!((one.len(), many.len()), (none.len(), none.len()));
    let (other, _) = ready.read(&none, &[view(2, [24, 8]), view(3, [8, 16]), view(4, [8, 8])], None);
    assert_ne!(many, other, "the last state enters");
    // With a gain of 1 and a bias of 0 the rows of a state have the mean 0 and the variance 1: it is what
    // follows the final norm.
    let params = first(&TINY, 1);
    let ready = Ready::new(TINY, &params);
    let (state, _) = ready.read(&ready.no_state(), &[view(1, [16, 16])], None);
    for row in state.chunks(TINY.width) {
        let mean = |f: fn(f64) -> f64| row.iter().fold(0.0, |s, x| s + f(f64::from(*x))) / row.len() as f64;
        let [mean, square] = [mean(|x| x), mean(|x| x * x)];
        assert!(mean.abs() < 1e-6 && (square - 1.0).abs() < 1e-3, "{mean} {square}");
    }
    let rule = ready.decode(&state, RENDERING, PLACEMENT).settings.rule;
    assert_eq!(rule, crate::scene::field::Rule::Analytic);
}
