//! The run behind `lirm reconstruct`, `lirm update` and the object of `demo`: what it takes is printed, then sets are read
//! ([`lastlight_lirm::reconstruct`]), then the results are written.

use crate::field::page;
use crate::fit::field::HALF_SIZE;
use crate::fit::field::scores::means;
use crate::fit::render::flat_name;
use crate::fit::training::Watch;
use crate::io::{atomic, memory};
use crate::meter::Meter;
use crate::num::gemm::{Finish, View, gemm};
use crate::report::images::data_uri;
use crate::report::run::Run;
use crate::report::{self};
use crate::scene::field::{FILE as FIELD, Placement};
use crate::shared::{Outcome, name};
use crate::training::RESULT;
use crate::units::counted;
use crate::{Result, console as cli, units, version};
use lastlight_lirm::model::state::FILE as STATE;
use lastlight_lirm::reconstruct::{Products, ReadImage, Reconstruction, Start};
use serde_json::{Value, json};
use std::path::Path;

/// Rows, columns and inner numbers of the products by which the speed of the machine is measured.
const SAMPLE: usize = 512;
/// Floating-point operations from which the time is estimated before they start.
const LONG: f64 = 1e12;
/// Change in dB on held-out images that is called little; a choice.
const LITTLE: f64 = 0.1;

/// Sets of images to read.
pub(crate) struct Job<'a> {
    pub(crate) kind: &'static str,
    pub(crate) capture: &'a Path,
    pub(crate) reading: Reconstruction<'a>,
    /// The settings in the record.
    pub(crate) settings: Value,
}

/// What is printed beside a change of the score, in dB.
fn remark(gain: f64) -> &'static str {
    match gain {
        gain if gain <= -LITTLE => ": the new images made it worse",
        gain if gain < LITTLE => ": more images will change little",
        _ => "",
    }
}

impl Job<'_> {
    /// The place of the object ([`Reconstruction::place`]).
    ///
    /// # Errors
    /// Those of it.
    pub(crate) fn place(&self, start: &Start, meter: &Meter) -> Result<Placement> {
        let (place, up) = self.reading.place(start)?;
        if let Some([x, y, z]) = up {
            meter.note(&format!(
                "up in the images is ({x:.2}, {y:.2}, {z:.2}), not z: the object is read with --field-axes upright"
            ));
        }
        Ok(place)
    }

    /// Prints the size of the work before it starts; refuses what does not fit into the memory.
    fn announce(&self, meter: &mut Meter) -> Result<()> {
        let work = self.reading.work()?;
        memory::check(self.kind, work.bytes).map_err(|e| {
            e.hint("--images-per-set and --downscale lower the estimate, --max-memory raises the limit")
        })?;
        let mut line = format!(
            "{} parameters, {} tokens in the largest set, about {}, {:.0} GFLOP",
            work.parameters,
            work.tokens,
            units::bytes(work.bytes),
            1e-9 * work.operations
        );
        if work.operations > LONG {
            let factor = vec![0.5; SAMPLE * SAMPLE];
            let mut product = vec![0.0; SAMPLE * SAMPLE];
            let of = || View::new(&factor, SAMPLE, SAMPLE);
            gemm(of(), of(), Finish::Store, &mut product);
            let before = meter.seconds();
            (0..4).for_each(|_| gemm(of(), of(), Finish::Store, &mut product));
            let rate = 8.0 * (SAMPLE * SAMPLE * SAMPLE) as f64 / (meter.seconds() - before);
            let seconds = report::seconds(work.operations / rate);
            line += &format!(", at least {seconds} at {:.0} GFLOP/s", 1e-9 * rate);
        }
        meter.note(&line);
        Ok(())
    }

    /// Reads the sets, then writes all that was made of them into a folder that is there.
    ///
    /// # Errors
    /// When an image cannot be read, the work does not fit into the memory, a number is not finite, or a file cannot be
    /// written.
    pub(crate) fn run(
        &self,
        start: Start,
        place: Placement,
        dir: &Path,
        meter: &mut Meter,
    ) -> Result<(Products, Outcome)> {
        meter.lap("reading");
        self.announce(meter)?;
        let made = self.reading.run(start, place, meter)?;
        meter.done();
        if made.again > 0 {
            let n = made.again;
            meter.note(&format!("images that have names of images that the state has read already: {n}"));
        }
        if made.unscored > 0 {
            meter.note(&format!(
                "test images of the capture that have names of images that were read, and are not scored: {}",
                made.unscored
            ));
        }
        if made.state.is_settled() {
            meter
                .note("the last two sets changed the state by less than 1 %: more images will change little");
        }
        made.state.write(&dir.join(STATE))?;
        made.field.write(&dir.join(FIELD))?;
        let outcome = self.outcome(&made, dir, meter)?;
        Ok((made, outcome))
    }

    /// Writes the renders and the record; gives the record, the report and the lines for a terminal.
    fn outcome(&self, made: &Products, dir: &Path, meter: &Meter) -> Result<Outcome> {
        let Products { state, field, changes, scored, .. } = made;
        let earlier = (!made.before.is_empty()).then(|| means(&made.before));
        let mut names = vec![FIELD.to_owned(), STATE.to_owned(), RESULT.to_owned()];
        names.extend(page::write_renders(dir, scored, &flat_name)?);
        let means = means(scored);
        let views: Vec<Value> = scored.iter().map(|s| s.json()).collect();
        let digest = field.digest()?;
        let held_out_db = means["psnr_db"].as_f64().unwrap_or(f64::NAN);
        let place = &state.placement;
        let half_size = f64::from(HALF_SIZE) / place.scale;
        let mut record = json!({
            "kind": self.kind, "lastlight": env!("CARGO_PKG_VERSION"), "digest": digest, "model": state.model, "sets": state.sets, "changes": changes, "exposure": state.exposure.map(|common| common.factor),
            "placement": {"center": place.center, "half_size": half_size, "rotation": place.rotation},
            "arguments": cli::arguments(), "build": version::record(), "settings": self.settings, "seconds": meter.seconds(),
            "evaluation": {"mean": means, "views": views},
        });
        if let Some(earlier) = &earlier {
            record["evaluation"]["before"] = earlier.clone();
        }
        atomic::write_bytes(&dir.join(RESULT), format!("{record:#}\n").as_bytes())?;
        let images = self.reading.sets.iter().flatten().count();
        let [x, y, z] = place.center;
        let cube = format!("{x:.3},{y:.3},{z:.3} ± {half_size:.3}");
        let uri = |image: &ReadImage| {
            let [width, height] = image.size;
            Ok((image.name.clone(), data_uri(&image.rgb, width, height, width.max(height))?))
        };
        let read = made.read.iter().map(uri).collect::<Result<Vec<_>>>()?;
        let all = counted(state.images.len(), "image");
        let mut title = format!("Object from {all} of {}", name(self.capture));
        let mut facts = vec![("model", state.model.clone()), ("box", cube.clone())];
        if state.sets.len() > self.reading.sets.len() {
            title += &format!(", {images} of them new");
        }
        if let Some(before) = earlier.as_ref().and_then(|means| means["psnr_db"].as_f64()) {
            facts.push(("before", format!("{before:.2} dB")));
        }
        let page = page::page(&page::Input {
            kind: self.kind,
            title,
            digest: Some(digest.clone()),
            means: &means,
            scored,
            read: &read,
            facts,
            benchmark: None,
            run: Run::new(&record["settings"], None, meter, dir, &names),
        })?;
        let mut lines = vec![page::summary(&means)];
        if let Some(before) = earlier.as_ref().and_then(|means| means["psnr_db"].as_f64()) {
            let gain = held_out_db - before;
            lines.push(format!(
                "before      {before:.2} dB on the same images ({gain:+.2} dB{})",
                remark(gain)
            ));
        }
        lines.extend([
            format!("images      {images} in {}", counted(self.reading.sets.len(), "set")),
            format!(
                "change      {}: length of what each set changed of the state, over that of the state",
                changes.iter().map(|c| format!("{c:.3}")).collect::<Vec<_>>().join(", ")
            ),
            format!("box         {cube}"),
            format!("digest      {digest}"),
            format!("time        {}", report::seconds(meter.seconds())),
            format!("field       {}", dir.join(FIELD).display()),
            format!("next        lastlight field mesh {} --out mesh.glb", dir.display()),
        ]);
        Ok(Outcome { record, page: Some(page), lines, held_out_db })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_change_of_the_score_is_called_little_or_worse() {
        assert!(remark(-3.0).contains("worse") && remark(-LITTLE).contains("worse"));
        assert!(remark(-0.05).contains("little") && remark(0.05).contains("little"));
        assert_eq!((remark(LITTLE), remark(2.0)), ("", ""));
    }
}
