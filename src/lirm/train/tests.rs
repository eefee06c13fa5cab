//! What a step compares: every set or the last one, with the state before it as a constant or not.

use super::source::BuiltInObjects;
use super::stage::USES;
use super::*;
use crate::tape::Grads;

const TINY: Config =
    Config { blocks: 1, width: 16, heads: 2, plane_tokens: 2, embed_tokens: 2, channels: 4, ..Config::SMALL };
/// Weight of a set.
const THIRD: f32 = 1.0 / 3.0;

/// Compares losses and gradients of a step of three sets of a model with panoramas with difference quotients, by
/// which sets are compared and whether gradients flow through the state.
#[test]
fn gradients_of_three_sets_are_difference_quotients_with_a_detached_state_and_through_it() {
    // With an object that is added, later sets are compared with another truth.
    let stage = Stage {
        sets: [3, 3],
        added: 1.0,
        samples: 64,
        target: [64, 16],
        inverse_beta: [200.0; 2],
        ..Stage::named("2a").expect("a name")
    };
    let settings = |state_gradient: bool, last_set_only: bool| Settings {
        stage: Stage { state_gradient, last_set_only, ..stage.clone() },
        optimizer: Kind::AdamW,
        head_rate: 1.0,
        seed: 0,
        batch: 1,
        block: 1,
        uses: USES,
        at_once: 1,
        recompute: false,
        average_last: 0,
        start_share: 0.0,
    };
    let source = BuiltInObjects::new(0);
    let mut usual = Training::new(settings(false, false), TINY, None, &source).expect("valid");
    let config = usual.config;
    let draws = Draws { seed: 0, stage: &stage, batch: 1, block: 1, uses: USES };
    usual.pool.fill(&draws, 0).expect("an object");
    let object = Object::new(&draws, &config, 0, 0, &usual.pool).expect("valid");
    let params = usual.params.clone();
    let rendering = stage.rendering(0);
    // The losses of all sets; with `states` given, these enter the sets.
    let of = |params: &Params, states: Option<&[Vec<f32>; 3]>| {
        let ready = Ready::new(config, params);
        let mut state = ready.no_state();
        let (mut losses, mut entered) = (Vec::new(), Vec::new());
        for (set, inputs) in object.sets.iter().enumerate() {
            let before = states.map_or(&state, |states| &states[set]).clone();
            let next = ready.read(&before, inputs, None).0;
            let field = ready.decode(&next, rendering, object.placement);
            losses.push(object.truth(set).losses(&field, THIRD, &stage).expect("finite").loss);
            entered.push(before);
            state = next;
        }
        (losses, entered)
    };
    let (all, entered) = of(&params, None);
    let states: [Vec<f32>; 3] = entered.try_into().expect("three sets");
    assert!(states[0].iter().all(|x| *x == 0.0) && states[2].iter().any(|x| *x != 0.0), "a state");
    assert!(all.iter().all(|x| *x > 0.01), "{all:?}");
    let ready = Ready::new(config, &params);
    for (state_gradient, last_set_only) in [(false, false), (true, false), (false, true), (true, true)] {
        let own = settings(state_gradient, last_set_only);
        let training = Training::new(own, TINY, None, &source).expect("valid");
        let (losses, mut gradients) =
            training.losses(&ready, std::slice::from_ref(&object), 0, &mut ()).expect("finite");
        let weights = if last_set_only { [0.0, 0.0, 3.0] } else { [1.0; 3] };
        let mean = |losses: &[f32]| {
            losses.iter().zip(weights).fold(0.0, |sum, (loss, weight)| sum + weight * f64::from(*loss))
        };
        let what = format!("state gradient {state_gradient}, last set alone {last_set_only}");
        let found = f64::from(losses[0]) / mean(&all) - 1.0;
        assert!(found.abs() < 1e-6, "{what}: the mean over the compared sets, {found}");
        let Grads(mut g) = ready.finish(gradients.remove(0));
        // Those of the layer that makes the state.
        g.retain(|name, _| name.starts_with("norm/"));
        let square = g.values().flatten().fold(0.0, |s, g| s + f64::from(*g) * f64::from(*g));
        let length = square.sqrt();
        let slope = |states: Option<&[Vec<f32>; 3]>| {
            let moved = |h: f64| {
                let mut params = params.clone();
                for (name, g) in &g {
                    let array = params.get_mut(name).expect("a parameter");
                    array.iter_mut().zip(g).for_each(|(x, g)| *x += (h * f64::from(*g) / length) as f32);
                }
                mean(&of(&params, states).0)
            };
            (moved(1e-3) - moved(-1e-3)) / 2e-3
        };
        let constant = (slope(Some(&states)) / length - 1.0).abs();
        let free = (slope(None) / length - 1.0).abs();
        let [own, other] = if state_gradient { [free, constant] } else { [constant, free] };
        assert!(own < 0.01, "{what}: {own}");
        assert!(other > 3.0 * own, "{what}: the other way differs: {other} beside {own}");
    }
}
