//! Scores of a LIRM state: where its surface is compared.

use lastlight::fit::field::benchmark::Shape;
use lastlight::fit::field::mesh;
use lastlight::lirm::evaluate::{Control, Order, Protocol, object, settings, state, views as scores};
use lastlight::lirm::r#gen::Settings;
use lastlight::lirm::model::config::Config;
use lastlight::lirm::model::decode::Look;
use lastlight::lirm::model::params::first;
use lastlight::lirm::model::weights::Ready;
use lastlight::lirm::subject::Subject;
use lastlight::lirm::views::Views;
use lastlight::scene::field::Placement;

const TINY: Config =
    Config { blocks: 1, width: 16, heads: 2, plane_tokens: 2, embed_tokens: 0, ..Config::SMALL };

/// One output of 32² after one set.
fn protocol() -> Protocol {
    Protocol {
        set: Settings { size: 32, ..settings(2, 1) },
        version: "uniform".into(),
        order: Order::Random,
        look: Look::of_field(16, 40.0),
        control: Control::None,
        sets: 1,
        outputs: 1,
        means: None,
        shapes: true,
    }
}

#[test]
fn mean_colors_are_compared_and_exchanged_ones_reach_the_state() {
    let params = first(&TINY, 5);
    let ready = Ready::new(TINY, &params);
    let p = Protocol { shapes: false, ..protocol() };
    let views = Views::rendered(&p.set, 0, "uniform").expect("an object");
    let whole = scores(&ready, &p, 0, &views, None).expect("finite");
    let [image, truth] = &whole.images[0];
    let output = views.all.iter().find(|v| v.picture.color == *truth).expect("one of the views");
    let covered: Vec<usize> = (0..truth.len() / 3).filter(|i| output.picture.foreground[*i] == 1.0).collect();
    assert!(covered.len() > 20, "{} pixels", covered.len());
    let mean = |x: &[f32]| -> [f64; 3] {
        std::array::from_fn(|c| {
            covered.iter().fold(0.0, |s, i| s + f64::from(x[3 * i + c])) / covered.len() as f64
        })
    };
    let ([r, g, b], found) = (mean(truth), mean(image));
    let by_hand = |x: [f64; 3]| ((x[0] - r).abs() + (x[1] - g).abs() + (x[2] - b).abs()) / 3.0;
    let numbers = &whole.rounds[0];
    assert!((numbers["color"] - by_hand(found)).abs() < 1e-12, "{}", numbers["color"]);
    assert!((numbers["gray"] - by_hand([(r + g + b) / 3.0; 3])).abs() < 1e-12, "{}", numbers["gray"]);
    let p = Protocol { control: Control::SwappedColors, ..p };
    let swapped = scores(&ready, &p, 0, &views, None).expect("finite");
    assert_ne!(swapped.images[0][0], *image, "the model reads other colours");
    assert_eq!(swapped.images[0][1], *truth, "the truth stays as it is");
    let p = Protocol { control: Control::None, ..p };
    let tinted = object(&ready, &p, 0, 0.9).expect("finite");
    assert_ne!(tinted.images[0], whole.images[0], "image and truth have other colours");
    assert!(tinted.rounds[0]["gray"] > numbers["gray"] + 0.05, "{}", tinted.rounds[0]["gray"]);
}

#[test]
fn surfaces_are_compared_in_the_world() {
    let (config, params) = (TINY, first(&TINY, 5));
    let ready = Ready::new(config, &params);
    let p = protocol();
    let views = Views::rendered(&p.set, 0, "uniform").expect("an object");
    let truth = Subject::new(&p.set, 0).expect("an object").object.mesh;
    // A state far from the mean of a LayerNorm: a surface without any symmetry.
    let tokens: Vec<f32> =
        (0..config.state_tokens() * config.width).map(|i| ((i * i) % 17) as f32 - 8.0).collect();
    // x = Q·(X − c): a quarter turn about the vertical, and the object beside the origin.
    let at = Placement {
        rotation: [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
        ..Placement::new([0.25, -0.125, 0.5], 1.0)
    };
    let made = mesh::Settings { side: 96, ..mesh::Settings::default() };
    let (own, ..) = mesh::shape(&ready.decode(&tokens, p.look, at), &made).expect("a surface");
    let mut moved = own.clone();
    for x in &mut moved.positions {
        *x = [0.25 - x[1], x[0] - 0.125, 0.5 + x[2]];
    }
    let [there, unmoved] = [&moved, &own].map(|m| Shape::of(m, &truth, 2).expect("an area").distance());
    let scored = state(&ready, &p, (&tokens, at), 0, &views).expect("finite")["distance_radii"];
    assert!((scored - there).abs() < 1e-6, "{scored} in the world, {there} by hand");
    assert!((there - unmoved).abs() > 0.05, "{there} and {unmoved} differ");
}
