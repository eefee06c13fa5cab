//! Scores of an avatar, for `last fit` and `last eval`: groups of images, tables, records.

use crate::Result;
use crate::meter::Meter;
use crate::report;
use crate::report::person::{Group, TRAINED};
use lastlight_last::avatar::evaluate::{self, Evaluation};
use serde_json::{Map, Value, json};

/// Training images that are scored: evenly spaced, at most.
const TRAIN_PICTURES: usize = 20;

/// Scores of evenly spaced training images, and of the held-out ones if there are any.
///
/// # Errors
/// When an image cannot be read or rendered.
pub(super) fn groups(of: Evaluation<'_>, meter: &mut Meter) -> Result<Vec<Group>> {
    let capture = of.capture;
    let step = Ord::max(1, capture.train.len().div_ceil(TRAIN_PICTURES));
    let train: Vec<usize> = capture.train.iter().copied().step_by(step).collect();
    let total = train.len() + capture.test.len();
    let (mut done, mut out) = (0, Vec::new());
    for (name, which) in [(TRAINED, &train), ("held out", &capture.test)] {
        let mut scored = Vec::with_capacity(which.len());
        for &shot in which {
            meter.count(done, total, "scoring");
            scored.push(of.score(shot)?);
            done += 1;
        }
        if !scored.is_empty() {
            let (cameras, mean) = evaluate::means(&scored)?;
            out.push(Group { name, scored, cameras, mean });
        }
    }
    meter.done();
    Ok(out)
}

/// A table for the terminal: the metrics by group.
pub(super) fn text(groups: &[Group]) -> String {
    let mut lines =
        vec![groups.iter().fold(format!("{:24}", ""), |line, g| line + &format!("{:>18}", g.name))];
    for (name, values) in report::person::by_metric(groups) {
        let cell = |x: &Option<f64>| x.map_or_else(|| format!("{:>18}", "–"), |x| format!("{x:>18.4}"));
        lines.push(values.iter().fold(format!("{name:24}"), |line, x| line + &cell(x)));
    }
    lines.join("\n")
}

/// Means by group, by camera and by image.
pub(super) fn json(groups: &[Group]) -> Value {
    let of = |g: &Group| {
        let cameras: Map<String, Value> =
            g.cameras.iter().map(|(c, s)| (c.to_string(), evaluate::json(s))).collect();
        let pictures: Vec<Value> = (g.scored.iter())
            .map(|s| json!({"name": s.name, "camera": s.camera, "time": s.time, "scores": evaluate::json(&s.scores)}))
            .collect();
        json!({"mean": evaluate::json(&g.mean), "cameras": cameras, "images": pictures})
    };
    Value::Object(groups.iter().map(|g| (g.name.to_owned(), of(g))).collect())
}

/// Mean PSNR-box of the last group, dB: the held-out images where there are any.
pub(super) fn held_out_db(groups: &[Group]) -> f64 {
    groups.last().map_or(f64::NAN, |g| g.mean.boxed.db.finite().unwrap_or(f64::INFINITY))
}
