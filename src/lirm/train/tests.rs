//! What a step compares: every set, with the state before it as a constant.

use super::source::BuiltInObjects;
use super::stage::USES;
use super::*;
use crate::tape::Grads;

const TINY: Config =
    Config { blocks: 1, width: 16, heads: 2, plane_tokens: 2, embed_tokens: 1, channels: 4, ..Config::SMALL };

#[test]
fn every_set_is_compared_and_no_gradient_flows_through_the_state() {
    let stage = Stage {
        sets: [2, 2],
        samples: 64,
        target: [64, 16],
        inverse_beta: [200.0; 2],
        ..Stage::named("1b").expect("a name")
    };
    let settings = Settings {
        stage,
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
    let mut training = Training::new(settings, TINY, None, &source).expect("valid");
    let (s, config) = (training.settings.clone(), training.config);
    let draws = Draws { seed: s.seed, stage: &s.stage, batch: 1, block: 1, uses: s.uses };
    training.pool.fill(&draws, 0).expect("an object");
    let object = Object::new(&draws, &config, 0, 0, &training.pool).expect("valid");
    let params = training.params.clone();
    let rendering = s.stage.rendering(0);
    // The losses of both sets; with `states` given, these enter the sets.
    let of = |params: &Params, states: Option<&[Vec<f32>; 2]>| {
        let ready = Ready::new(config, params);
        let mut state = ready.no_state();
        let (mut losses, mut entered) = (Vec::new(), Vec::new());
        for (set, inputs) in object.sets.iter().enumerate() {
            let before = states.map_or(&state, |states| &states[set]).clone();
            let next = ready.read(&before, inputs, None).0;
            let field = ready.decode(&next, rendering, object.placement);
            losses.push(object.losses(&field, 0.5, &s.stage).expect("finite").loss);
            entered.push(before);
            state = next;
        }
        (losses, entered)
    };
    let (both, entered) = of(&params, None);
    let states: [Vec<f32>; 2] = entered.try_into().expect("two sets");
    assert!(states[0].iter().all(|x| *x == 0.0) && states[1].iter().any(|x| *x != 0.0), "a state");
    let ready = Ready::new(config, &params);
    let (losses, mut gradients) =
        training.losses(&ready, std::slice::from_ref(&object), 0, &mut ()).expect("finite");
    assert!(both.iter().all(|x| *x > 0.01), "{both:?}");
    assert_eq!(losses, [both[0] + both[1]], "the mean over the sets");
    let Grads(mut g) = ready.finish(gradients.remove(0));
    // Those of the layer that makes the state.
    g.retain(|name, _| name.starts_with("norm/"));
    let square = g.values().flatten().fold(0.0, |s, g| s + f64::from(*g) * f64::from(*g));
    let slope = |states: Option<&[Vec<f32>; 2]>| {
        let moved = |h: f64| {
            let mut params = params.clone();
            for (name, g) in &g {
                let array = params.get_mut(name).expect("a parameter");
                array.iter_mut().zip(g).for_each(|(x, g)| *x += (h * f64::from(*g) / square.sqrt()) as f32);
            }
            of(&params, states).0.iter().fold(0.0, |sum, x| sum + f64::from(*x))
        };
        (moved(1e-3) - moved(-1e-3)) / 2e-3
    };
    let length = square.sqrt();
    let [constant, free] = [Some(&states), None].map(slope);
    let [constant, free] = [constant, free].map(|slope| (slope / length - 1.0).abs());
    assert!(constant < 0.01, "states are constants: {constant}");
    assert!(
        free > 3.0 * constant,
        "a state that moves with the weights counts too: {free} beside {constant}"
    );
}
