//! Scores of a LIRM state: where its surface is compared, what controls break, and the baselines.

use super::ball;
use data_gen::cameras;
use lastlight::fit::field::benchmark::Shape;
use lastlight::fit::field::scores::{FEWEST, materials};
use lastlight::fit::field::{Target, mesh};
use lastlight::lirm::baselines::{Hull, nearest};
use lastlight::lirm::evaluate::{
    Control, Order, Protocol, SET, score_object, score_state, score_views, settings, typical_materials,
};
use lastlight::lirm::r#gen::{Lighting, Settings, Version};
use lastlight::lirm::model::config::Config;
use lastlight::lirm::model::decode::Rendering;
use lastlight::lirm::model::params::first;
use lastlight::lirm::model::transformer::Input;
use lastlight::lirm::model::weights::Ready;
use lastlight::lirm::subject::Subject;
use lastlight::lirm::views::{View, Views};
use lastlight::loss::metric::orb;
use lastlight::scene::field::Placement;

const TINY: Config =
    Config { blocks: 1, width: 16, heads: 2, plane_tokens: 2, embed_tokens: 0, ..Config::SMALL };

/// One output of 32² after one set.
fn protocol() -> Protocol {
    Protocol {
        set: Settings { size: 32, ..settings(2, 1) },
        version: Version::Uniform,
        order: Order::Random,
        rendering: Rendering::of_field(16, 40.0),
        control: Control::None,
        sets: 1,
        outputs: 1,
        typical: None,
        baselines: true,
        shapes: true,
    }
}

#[test]
fn an_albedo_is_aligned_on_more_than_a_few_pixels() {
    let target = ball::target(0, 32);
    let count = target.foreground.len();
    let albedo: Vec<f32> = (0..3 * count).map(|i| 0.2 + 0.01 * (i % 50) as f32).collect();
    let of = |opaque: usize| {
        let mut left = opaque;
        let opacity: Vec<f32> = (0..count)
            .map(|i| {
                let is_opaque = target.foreground[i] == 1.0 && left > 0;
                left -= usize::from(is_opaque);
                f32::from(u8::from(is_opaque))
            })
            .collect();
        materials(Some(&albedo), None, &opacity, &target).expect("finite")
    };
    let few = of(1);
    assert!(few.albedo_db.is_some_and(f64::is_finite), "as it is, one pixel is enough");
    assert_eq!(few.albedo_aligned_db, None, "scales fit one pixel exactly");
    assert_eq!(of(FEWEST - 1).albedo_aligned_db, None);
    assert!(of(FEWEST).albedo_aligned_db.is_some_and(f64::is_finite));
}

#[test]
fn an_albedo_error_has_one_factor_for_all_channels() {
    let mut target = ball::target(0, 32);
    let count = target.foreground.len();
    let covered = vec![1.0; count];
    let everywhere = |color: [f32; 3]| -> Vec<f32> { (0..count).flat_map(|_| color).collect() };
    let linear = |x: f32| orb::decode(f64::from(x));
    let of = |truth: [f32; 3], found: [f32; 3], target: &mut Target| {
        target.albedo = Some(everywhere(truth));
        materials(Some(&everywhere(found)), None, &covered, target).expect("finite")
    };
    // An object of one colour: after a factor per channel every constant is exact, after one factor hues differ.
    let (brown, gray) = ([0.5, 0.35, 0.2], [0.6; 3]);
    let found = of(brown, gray, &mut target);
    let y = brown.map(linear);
    let mean = (y[0] + y[1] + y[2]) / 3.0;
    let off = y.map(|y| (y - mean) * (y - mean));
    let by_hand = (off[0] + off[1] + off[2]) / 3.0;
    let error = found.albedo_error.expect("enough pixels");
    assert!((error - by_hand.sqrt()).abs() < 1e-6, "{error} {by_hand}");
    assert!(found.albedo_aligned_db.is_some_and(|db| db > 60.0), "{:?}", found.albedo_aligned_db);
    let twice = brown.map(|x| orb::encode(0.5 * linear(x)) as f32);
    let error = of(brown, twice, &mut target).albedo_error.expect("enough pixels");
    assert!(error < 1e-6, "half as bright: {error}");
    let error = of(brown, [0.0; 3], &mut target).albedo_error.expect("enough pixels");
    assert!(
        (error - ((y[0] * y[0] + y[1] * y[1] + y[2] * y[2]) / 3.0).sqrt()).abs() < 1e-6,
        "black: {error}"
    );
}

#[test]
fn typical_materials_are_means_and_medians_of_covered_pixels() {
    let found = typical_materials(0, Version::Shiny).expect("objects");
    let settings =
        Settings { size: 64, views: 4, samples: 1, lighting: Lighting::Both, ..Settings::default() };
    let (mut albedo, mut material) = (Vec::new(), Vec::new());
    for k in 0..24 {
        let views = Views::rendered(&settings, k, Version::Shiny).expect("an object");
        for target in (0..4).map(|i| views.target(i)) {
            for i in (0..64 * 64).filter(|i| target.foreground[*i] == 1.0) {
                albedo.push(orb::decode(f64::from(target.albedo.as_ref().expect("a pass")[3 * i])));
                material.push(f64::from(target.material.as_ref().expect("a pass")[2 * i]));
            }
        }
    }
    let mean = |x: &[f64]| x.iter().fold(0.0, |sum, x| sum + x) / x.len() as f64;
    assert!((orb::decode(f64::from(found.albedo[0])) - mean(&albedo)).abs() < 1e-5, "red, linear");
    assert!((f64::from(found.mean[0]) - mean(&material)).abs() < 1e-5, "roughness");
    let below = material.iter().filter(|x| **x < f64::from(found.median[0])).count();
    let above = material.iter().filter(|x| **x > f64::from(found.median[0])).count();
    assert!(2 * below <= material.len() && 2 * above <= material.len(), "{below} {above}");
    assert!(
        found.mean != found.median && found.albedo[0] > found.albedo[2],
        "objects are rather red than blue"
    );
}

#[test]
fn mean_colors_are_compared_and_exchanged_ones_reach_the_state() {
    let params = first(&TINY, 5);
    let ready = Ready::new(TINY, &params);
    let p = Protocol { shapes: false, ..protocol() };
    let views = Views::rendered(&p.set, 0, Version::Uniform).expect("an object");
    let whole = score_views(&ready, &p, 0, &views, None).expect("finite");
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
    let swapped = score_views(&ready, &p, 0, &views, None).expect("finite");
    assert_ne!(swapped.images[0][0], *image, "the model reads other colours");
    assert_eq!(swapped.images[0][1], *truth, "the truth stays as it is");
    let p = Protocol { control: Control::None, ..p };
    let tinted = score_object(&ready, &p, 0, 0.9).expect("finite");
    assert_ne!(tinted.images[0], whole.images[0], "image and truth have other colours");
    assert!(tinted.rounds[0]["gray"] > numbers["gray"] + 0.05, "{}", tinted.rounds[0]["gray"]);
}

#[test]
fn surfaces_are_compared_in_the_world() {
    let (config, params) = (TINY, first(&TINY, 5));
    let ready = Ready::new(config, &params);
    let p = protocol();
    let views = Views::rendered(&p.set, 0, Version::Uniform).expect("an object");
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
    let (own, ..) =
        mesh::shape(&ready.decode(&tokens, p.rendering, at), &made).expect("finite").expect("a surface");
    let mut moved = own.clone();
    for x in &mut moved.positions {
        *x = [0.25 - x[1], x[0] - 0.125, 0.5 + x[2]];
    }
    let [there, unmoved] = [&moved, &own].map(|m| Shape::of(m, &truth, 2).expect("an area").distance());
    let scored = score_state(&ready, &p, (&tokens, at), 0, &views).expect("finite")["distance_radii"];
    assert!((scored - there).abs() < 1e-6, "{scored} in the world, {there} by hand");
    assert!((there - unmoved).abs() > 0.05, "{there} and {unmoved} differ");
}

/// The images of the first two sets as a model reads them, with the axes of set `first`.
fn two_sets(ready: &Ready<'_>, p: &Protocol, views: &Views, first: usize) -> (Placement, [Vec<Input>; 2]) {
    let order = cameras::test(p.set.seed, 0, p.set.size).inputs;
    let at = views.posed(ready.config.pose, &order[SET * first..SET * (first + 1)]).expect("upright");
    let small = views.small(2).expect("even sides");
    let set = |n: usize| {
        order[SET * n..SET * (n + 1)].iter().map(|i| Input::of(&small.all[*i], &at, &ready.config)).collect()
    };
    (at, [set(0), set(1)])
}

#[test]
fn controls_break_what_they_name_and_nothing_else() {
    let params = first(&TINY, 5);
    let ready = Ready::new(TINY, &params);
    let p = Protocol { shapes: false, sets: 2, ..protocol() };
    let views = Views::rendered(&p.set, 0, Version::Uniform).expect("an object");
    let other = Views::rendered(&p.set, 1, Version::Uniform).expect("another object");
    let (at, sets) = two_sets(&ready, &p, &views, 0);
    let (_, others) = two_sets(&ready, &p, &other, 0);
    let (at_second, in_second) = two_sets(&ready, &p, &views, 1);
    assert_ne!(at, at_second, "every set has its own axes");
    let of = |control: Control| {
        let p = Protocol { control, ..p.clone() };
        score_views(&ready, &p, 0, &views, (control == Control::OtherObject).then_some(&other))
            .expect("finite")
    };
    // The scores of a state that is made by hand.
    let placed =
        |tokens: &[f32], at| score_state(&ready, &p, (tokens, at), 0, &views).expect("finite")["psnr_db"];
    let by_hand = |tokens: &[f32]| placed(tokens, at);
    let none = ready.no_state();
    let read = |before: &[f32], set: &[Input]| ready.read(before, set, None).0;
    let one = read(&none, &sets[0]);
    let db = |control: Control, round: usize| of(control).rounds[round]["psnr_db"];
    assert_eq!(db(Control::None, 0), by_hand(&one));
    assert_eq!(db(Control::None, 1), by_hand(&read(&one, &sets[1])), "the second set after the first");
    assert_eq!(db(Control::ZeroedState, 0), by_hand(&one));
    let alone = read(&none, &in_second[1]);
    assert_eq!(
        db(Control::ZeroedState, 1),
        placed(&alone, at_second),
        "the second set alone, as a first one"
    );
    assert_eq!(db(Control::OtherObject, 0), by_hand(&one));
    assert_eq!(
        db(Control::OtherObject, 1),
        by_hand(&read(&one, &others[1])),
        "the cameras of both objects are equal"
    );
    assert_eq!(db(Control::AtOnce, 0), by_hand(&one));
    assert_eq!(db(Control::AtOnce, 1), by_hand(&read(&none, &sets.concat())), "both sets in one round");
    let permuted = |set: &[Input]| -> Vec<Input> {
        let with = |n: usize| Input { rays: set[(n + 1) % set.len()].rays.clone(), ..set[n].clone() };
        (0..set.len()).map(with).collect()
    };
    let one = read(&none, &permuted(&sets[0]));
    assert_eq!(db(Control::PermutedCameras, 0), by_hand(&one), "every image with the rays of the next");
    assert_eq!(db(Control::PermutedCameras, 1), by_hand(&read(&one, &permuted(&sets[1]))));
    let all = [
        Control::None,
        Control::ZeroedState,
        Control::OtherObject,
        Control::PermutedCameras,
        Control::AtOnce,
    ];
    let second: Vec<f64> = all.into_iter().map(|c| db(c, 1)).collect();
    assert!((1..all.len()).all(|i| second[i] != second[0]), "each of them shows: {second:?}");
}

/// The ball from one of its eight cameras, in one colour.
fn ball_view(k: usize, color: [f32; 3]) -> View {
    let mut picture = ball::picture(k, 48);
    let pixels = picture.color.as_chunks_mut::<3>().0.iter_mut().zip(&picture.foreground);
    pixels.for_each(|(x, m)| *x = color.map(|c| c * m + (1.0 - m)));
    View { photo: picture.color.clone(), picture }
}

#[test]
fn baselines_know_a_ball_of_one_colour() {
    let color = [0.75, 0.5, 0.25];
    let all: Vec<View> = (0..8).map(|k| ball_view(k, color)).collect();
    let inputs: Vec<&View> = all[..7].iter().collect();
    let unseen = &all[7].picture;
    let (image, covered) = Hull::new(&inputs).image(&unseen.camera);
    let (mut both, mut one) = (0, 0);
    for (i, m) in covered.iter().enumerate() {
        let [a, b] = [*m >= 0.5, unseen.foreground[i] >= 0.5];
        (both, one) = (both + usize::from(a && b), one + usize::from(a || b));
        assert!(!b || *m > 0.0, "pixel {i}: the hull contains the object");
        if *m == 1.0 {
            let pixel = &image[3 * i..3 * i + 3];
            assert!(pixel.iter().zip(color).all(|(x, c)| (x - c).abs() < 1e-5), "pixel {i}: {pixel:?}");
        }
    }
    assert!(
        both as f64 > 0.85 * one as f64 && both < one,
        "seven cones are a little more than a ball: {both} of {one}"
    );
    // The shares of white in pixels at the edge are not mixed in, and a colour that only hidden sides have is not either.
    let opposite: Vec<View> = [0, 2]
        .into_iter()
        .map(|k| ball_view(k, if k == 0 { [1.0, 0.0, 0.0] } else { [0.0, 0.0, 1.0] }))
        .collect();
    let inputs: Vec<&View> = opposite.iter().collect();
    let (image, covered) = Hull::new(&inputs).image(&opposite[0].picture.camera);
    let middle = 24 * 48 + 24;
    assert!(covered[middle] == 1.0, "the ball is in the middle");
    let [r, g, b] = [0, 1, 2].map(|c| image[3 * middle + c]);
    assert!(
        r > 0.99 && g < 0.01 && b < 0.01,
        "what the first camera sees is hidden from the other: {r} {g} {b}"
    );
    let found = nearest(&[&all[0], &all[3], &all[7]], &all[7].picture.camera);
    assert_eq!(found.picture.name, all[7].picture.name, "the camera itself");
    assert_eq!(
        nearest(&[&all[3], &all[3], &all[0]], &all[3].picture.camera).picture.name,
        all[3].picture.name
    );
}
