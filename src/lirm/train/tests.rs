//! What a step compares: every set or the last one, with the state before it as a constant or not.

use super::source::BuiltInObjects;
use super::stage::USES;
use super::*;
use crate::tape::Grads;

const TINY: Config =
    Config { blocks: 1, width: 16, heads: 2, plane_tokens: 2, embed_tokens: 1, channels: 4, ..Config::SMALL };

/// Compares losses and gradients of a step of two sets with difference quotients, by which sets are compared
/// and whether gradients flow through the state.
#[test]
fn gradients_of_two_sets_are_difference_quotients_with_a_detached_state_and_through_it() {
    let stage = Stage {
        sets: [2, 2],
        samples: 64,
        target: [64, 16],
        inverse_beta: [200.0; 2],
        ..Stage::named("1b").expect("a name")
    };
    let settings = |state_gradient: bool, last_set: bool| Settings {
        stage: Stage { state_gradient, last_set, ..stage.clone() },
        optimizer: Kind::AdamW,
        head_rate: 1.0,
        seed: 0,
        batch: 1,
        block: 1,
        uses: USES,
        at_once: 1,
        recompute: false,
        average_last: 0,
    };
    let source = BuiltInObjects::new(0);
    let mut usual = Training::new(settings(false, false), TINY, None, &source).expect("valid");
    let config = usual.config;
    let draws = Draws { seed: 0, stage: &stage, batch: 1, block: 1, uses: USES };
    usual.pool.fill(&draws, 0).expect("an object");
    let object = Object::new(&draws, &config, 0, 0, &usual.pool).expect("valid");
    let params = usual.params.clone();
    let rendering = stage.rendering(0);
    // The losses of both sets; with `states` given, these enter the sets.
    let of = |params: &Params, states: Option<&[Vec<f32>; 2]>| {
        let ready = Ready::new(config, params);
        let mut state = ready.no_state();
        let (mut losses, mut entered) = (Vec::new(), Vec::new());
        for (set, inputs) in object.sets.iter().enumerate() {
            let before = states.map_or(&state, |states| &states[set]).clone();
            let next = ready.read(&before, inputs, None).0;
            let field = ready.decode(&next, rendering, object.placement);
            losses.push(object.losses(&field, 0.5, &stage).expect("finite").loss);
            entered.push(before);
            state = next;
        }
        (losses, entered)
    };
    let (both, entered) = of(&params, None);
    let states: [Vec<f32>; 2] = entered.try_into().expect("two sets");
    assert!(states[0].iter().all(|x| *x == 0.0) && states[1].iter().any(|x| *x != 0.0), "a state");
    assert!(both.iter().all(|x| *x > 0.01), "{both:?}");
    let ready = Ready::new(config, &params);
    for (state_gradient, last_set) in [(false, false), (true, false), (false, true), (true, true)] {
        let own = settings(state_gradient, last_set);
        let training = Training::new(own, TINY, None, &source).expect("valid");
        let (losses, mut gradients) =
            training.losses(&ready, std::slice::from_ref(&object), 0, &mut ()).expect("finite");
        let [first, second] = if last_set { [0.0, 2.0] } else { [1.0, 1.0] };
        let what = format!("state gradient {state_gradient}, last set alone {last_set}");
        assert_eq!(losses, [first * both[0] + second * both[1]], "{what}: the mean over the compared sets");
        let Grads(mut g) = ready.finish(gradients.remove(0));
        // Those of the layer that makes the state.
        g.retain(|name, _| name.starts_with("norm/"));
        let square = g.values().flatten().fold(0.0, |s, g| s + f64::from(*g) * f64::from(*g));
        let length = square.sqrt();
        let slope = |states: Option<&[Vec<f32>; 2]>| {
            let moved = |h: f64| {
                let mut params = params.clone();
                for (name, g) in &g {
                    let array = params.get_mut(name).expect("a parameter");
                    array.iter_mut().zip(g).for_each(|(x, g)| *x += (h * f64::from(*g) / length) as f32);
                }
                let losses = of(&params, states).0;
                f64::from(first) * f64::from(losses[0]) + f64::from(second) * f64::from(losses[1])
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
