//! The field renderer: the scenes that are compared with PyTorch.
//!
//! `cargo bench --workspace --bench crop` prints the time of one run of each scene, for
//! `benches/crop/pytorch.py`.

mod scene;

use lastlight::field::render::{self, OutBar, Plan};
use scene::Setup;
use std::time::Instant;

fn main() {
    for setup in [Setup::trunk(3), Setup::trunk(6), Setup::heads()] {
        let scene = setup.scene();
        let mut best = [f64::MAX; 2];
        for _ in 0..5 {
            let start = Instant::now();
            let mut plan = Plan::new(setup.intervals());
            let out = render::forward(&scene, &mut plan);
            best[0] = best[0].min(start.elapsed().as_secs_f64());
            let values: Vec<f32> =
                out.values.iter().map(|v| (v - 0.5) * (2.0 / out.values.len() as f32)).collect();
            let mut bar = render::InBar::zeros_like(&scene);
            let cotangents = OutBar { values: &values, ..OutBar::default() };
            render::adjoint(&scene, &plan, &out, &cotangents, usize::MAX / 2, &mut bar);
            best[1] = best[1].min(start.elapsed().as_secs_f64());
            assert!(bar.planes.iter().any(|g| *g != 0.0));
        }
        println!(
            "{}: forward {:.1} ms, forward and gradients {:.1} ms, {} samples",
            setup.name,
            1e3 * best[0],
            1e3 * best[1],
            setup.intervals().samples()
        );
    }
}
