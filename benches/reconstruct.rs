//! Four images to a field with LIRM's small model: inputs, transformer, texels.
//!
//! `cargo bench --workspace --bench reconstruct`. Images have 64² or 128² pixels and are read as they are; the model is whole, with first values, which take
//! as long as others. An element is one operation of the transformer (a product or a sum), so Gelem/s are GFLOP/s.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use lastlight::fit::field::targets::Picture;
use lastlight::lirm::model::config::Config;
use lastlight::lirm::model::decode::Rendering;
use lastlight::lirm::model::params::first;
use lastlight::lirm::model::transformer::Input;
use lastlight::lirm::model::weights::Ready;
use lastlight::lirm::views::View;
use lastlight::num::rng::Rng;
use lastlight::scene::camera::{Camera, Model};
use lastlight::scene::field::{Field, Placement};
use lastlight::scene::passes::PassImages;
use std::hint::black_box;

/// Images of a set.
const SET: usize = 4;

/// An image of noise from one of four directions.
fn view(k: usize, side: usize) -> View {
    let rng = Rng::new(2);
    let color: Vec<f32> = (0..3 * side * side).map(|i| rng.uniform_f32(i as u64, 0, 0, k as u16)).collect();
    let [x, y] = [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]][k];
    let camera = Camera {
        rotation: [[-y, x, 0.0], [0.0, 0.0, -1.0], [-x, -y, 0.0]],
        translation: [0.0, 0.0, 1.4],
        focal_px: [1.1 * side as f32; 2],
        center_px: [0.5 * side as f32; 2],
        width: side,
        height: side,
        model: Model::Pinhole,
    };
    let picture = Picture {
        name: format!("{k:04}.png"),
        camera,
        foreground: vec![1.0; side * side],
        color: color.clone(),
        kept: None,
        colored: None,
        passes: PassImages::default(),
        environment: None,
    };
    View { picture, photo: color }
}

fn small(c: &mut Criterion) {
    let config = Config { is_whole: true, ..Config::SMALL };
    let params = first(&config, 0);
    let ready = Ready::new(config, &params);
    let at = Placement::default();
    for side in [64, 128] {
        let views: Vec<View> = (0..SET).map(|k| view(k, side)).collect();
        let inputs = || -> Vec<Input> { views.iter().map(|v| Input::of(v, &at, &config)).collect() };
        let read = |set: &[Input]| ready.read(&ready.no_state(), set, None).0;
        let decode = |state: &[f32]| -> Field { ready.decode(state, Rendering::of_field(128, 60.0), at) };
        let set = inputs();
        let state = read(&set);
        let tokens = set.iter().fold(0, |sum, x| sum + x.tokens());
        let mut group = c.benchmark_group(format!("four views of {side}x{side}"));
        group.sample_size(10).throughput(Throughput::Elements(config.flops(tokens)[0] as u64));
        group.bench_function("to a field", |b| b.iter(|| black_box(decode(&read(&inputs())))));
        group.bench_function("inputs alone", |b| b.iter(|| black_box(inputs())));
        group.bench_function("transformer alone", |b| b.iter(|| black_box(read(&set))));
        group.bench_function("texels alone", |b| b.iter(|| black_box(decode(&state))));
        group.finish();
    }
}

criterion_group!(benches, small);
criterion_main!(benches);
