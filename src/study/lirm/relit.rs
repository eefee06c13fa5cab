//! Under another light: the mesh of a reconstruction, path-traced under a map that none of its images show,
//! beside the true object under that map (§13).
//!
//! Object k is read under its own map, and scored under the map and from the test cameras of object k + 1.
//! Truth and renders are linear; every render has one least-squares factor per channel, as in Stanford-ORB
//! ([`crate::fit::field::benchmark`]). Beside it stands the field as it is, with the colours of the old light
//! from the new cameras: relighting has to beat no relighting.

use super::setup::{SEED, Setup, is_complete, shown};
use crate::Result;
use crate::experiment::{Cell, Chart, Experiment, Outcome, Report, Summary, Values, of};
use crate::fit::field::benchmark::{Relighting, truth, view as compared};
use crate::fit::field::mesh::{Settings as Form, try_bake};
use crate::fit::field::targets::target;
use crate::fit::field::{score, view};
use crate::fit::training::Watch;
use crate::shade::render::Settings as Tracing;
use data_gen::cameras;
use lastlight_lirm::evaluate::settings;
use lastlight_lirm::r#gen::Version;
use lastlight_lirm::model::weights::Ready;
use lastlight_lirm::subject::Light;
use lastlight_lirm::views::Views;
use serde_json::Value;
use std::sync::atomic::AtomicBool;

/// Version of the objects.
const VERSION: Version = Version::Environment;
/// Sets that are read.
const SETS: usize = 2;
/// Images that are relit.
const IMAGES: usize = 4;
/// Points of the grid of the mesh, and texels per side of its maps.
const FORM: [usize; 2] = [96, 512];

/// The experiment.
#[derive(Debug)]
pub struct Relit<'a> {
    setup: &'a Setup,
}

/// Makes the experiment.
pub fn relit(setup: &Setup) -> Relit<'_> {
    Relit { setup }
}

const ROW: &str = "relit";

impl Experiment for Relit<'_> {
    fn id(&self) -> &'static str {
        "relit"
    }

    fn cells(&self) -> Vec<Cell> {
        let cell = |k: u64| Cell { key: format!("{k:03}"), row: ROW.into(), seed: k };
        (0..self.setup.size.objects).map(cell).collect()
    }

    fn settings(&self, _: usize) -> Value {
        self.setup.record(self.setup.model())
    }

    fn run(&self, cell: usize, watch: &mut dyn Watch, _: &AtomicBool) -> Result<Values> {
        let (k, model) = (cell as u64, self.setup.model());
        // A model of the first stages has no materials.
        if !model.config.is_whole {
            return Ok(Values::from([("has_materials".to_owned(), 0.0)]));
        }
        let set = settings(SEED, self.setup.size.samples);
        let views = self.setup.object(k, VERSION)?;
        let other = k + 1;
        let new = Views::of_subject(&set, other, VERSION, &self.setup.subject(k)?)?;
        let map = Light::new(&set, other)?.map;
        watch.lap("images");
        let ready = Ready::new(model.config, &model.params);
        let (state, at) = self.setup.read(&ready, &views, k, SETS)?;
        let field = ready.decode(&state, self.setup.protocol(model, VERSION).rendering, at);
        let cells = view::occupancy(&field)?;
        let [side, texture] = FORM;
        // A field without a surface cannot be relit; how many have one is a number of its own.
        let baked = try_bake(&field, &Form { side, texture, ..Form::default() })?;
        let mut out = Values::from([("has_surface".to_owned(), if baked.is_some() { 1.0 } else { 0.0 })]);
        let Some(baked) = baked else { return Ok(out) };
        watch.lap("meshes");
        let tracing = Tracing { samples: self.setup.size.samples, seed: SEED, ..Tracing::default() };
        let job = Relighting::new(&baked.object, tracing);
        let outputs = cameras::test(SEED, other, set.size).outputs;
        let (mut relit, mut as_it_is) = (Vec::new(), Vec::new());
        for (n, i) in outputs.into_iter().take(Ord::min(IMAGES, self.setup.size.outputs)).enumerate() {
            let picture = &new.all[i].picture;
            let linear = truth(picture, 1.0);
            let own = job.score(picture, &linear, n, &map, None)?.scores;
            let seen = target(picture, &at);
            let old = compared(&score(&field, &cells, &seen)?, &seen, &linear, at.scale, None)?.image;
            // Pixels at the border show the map behind, which the old colours do not have.
            let both = own.psnr_eroded_db.zip(old.and_then(|old| old.psnr_eroded_db));
            if let Some((own, old)) = both {
                relit.push(own);
                as_it_is.push(old);
            }
        }
        watch.lap("relighting");
        if !relit.is_empty() {
            out.insert("relit_db".into(), Summary::of(&relit).mean);
            out.insert("old_light_db".into(), Summary::of(&as_it_is).mean);
        }
        Ok(out)
    }

    fn report(&self, results: &[(Cell, Values)]) -> Report {
        let scored: Vec<(Cell, Values)> =
            results.iter().filter(|(_, v)| v.contains_key("relit_db")).cloned().collect();
        let pair = |name: &str| of(&scored, ROW, name);
        let gain = Summary::of_pairs(&pair("relit_db"), &pair("old_light_db"));
        let line = |what: &str, x: &[f64], digits| vec![what.to_owned(), shown(&Summary::of(x), digits)];
        Report {
            id: "relit",
            claim: "Materials show an object under a light that none of its images have: closer to the truth than its old colours (reported: the paper relights scans of real objects).",
            head: vec!["after 8 images", ">value"],
            rows: vec![
                line("relit, PSNR in the eroded mask, dB", &pair("relit_db"), 2),
                line("colours of the old light, dB", &pair("old_light_db"), 2),
                line("objects with a surface", &of(results, ROW, "has_surface"), 2),
            ],
            chart_labels: ["relit − old colours, dB", ""],
            chart: Chart::Intervals(vec![("all objects".into(), gain)]),
            outcome: Outcome::of((is_complete(self, results) && gain.count > 1).then(|| gain.is_positive())),
            verdict: match gain.count {
                0 => "The model has no materials, or its fields no surfaces.".into(),
                _ => format!("Relighting gains {} dB.", shown(&gain, 2)),
            },
        }
    }
}
