//! Small fits of a field, one for each kind of what is optimised.

use super::ball;
use super::runs::Entry;
use lastlight::fit::field::{Beta, FieldFit, HeadForm, Materials, Settings, Targets};
use lastlight::fit::training::Fit;
use lastlight::num::array::Arrays;
use lastlight::scene::field::{Combine, Rule};

/// Iterations of each; planes grow after half of them, and the grid of cells is filled several times.
const ITERATIONS: usize = 50;

/// Kinds of fits: name, settings.
fn kinds() -> [(&'static str, Settings); 5] {
    let base = Settings {
        iterations: ITERATIONS,
        seed: 9,
        side: 16,
        channels: 4,
        samples: 24,
        crop: 16,
        crops: 1,
        inverse_beta: [20.0, 80.0],
        eikonal: 1e-3,
        ..Settings::default()
    };
    let shaded = Settings { materials: Materials::Shaded, ..base.clone() };
    let trunk = Settings {
        heads: HeadForm::Trunk,
        rule: Rule::Midpoint,
        combine: Combine::Sum,
        planes: 3,
        channels: 8,
        ..base.clone()
    };
    let learned =
        Settings { beta: Beta::Learned, rule: Rule::Left, inverse_beta: [40.0, 80.0], ..base.clone() };
    [
        ("passes", Settings { materials: Materials::Passes, ..base.clone() }),
        ("shaded", shaded),
        ("embedding", Settings { embedding: true, ..base }),
        ("trunk", trunk),
        ("learned beta", learned),
    ]
}

/// Names of [`entries`].
pub(crate) fn names() -> Vec<String> {
    kinds().iter().map(|(kind, _)| name(kind)).collect()
}

fn name(kind: &str) -> String {
    format!("field.fit/{kind} {ITERATIONS} iterations")
}

/// Complete state and losses of each fit.
pub(crate) fn entries() -> Vec<Entry> {
    let with_passes = ball::targets(5, 20);
    let photos: Targets = ball::without_passes(with_passes.clone());
    let one = |(kind, settings): (&str, Settings)| {
        let targets = if settings.materials == Materials::Passes { &with_passes } else { &photos };
        let mut fit = FieldFit::new(settings, targets, None, None).expect("valid settings");
        let step = |fit: &mut FieldFit<'_>, i: usize| fit.step(i, &mut ()).expect("the fit continues").loss;
        let losses: Vec<f32> = (0..ITERATIONS).map(|i| step(&mut fit, i)).collect();
        let mut state = Arrays::new();
        fit.save(&mut state);
        let cells = state.get("occupied").expect("stored").to_f32();
        let part = cells.iter().filter(|c| **c > 0.0).count() as f64 / cells.len() as f64;
        assert!(part > 0.0 && part < 1.0, "{kind}: rays skip cells, or the digest proves little: {part}");
        state.put("loss", &[losses.len()], losses);
        Entry::new(name(kind), state)
    };
    kinds().into_iter().map(one).collect()
}
