//! Under another light: the mesh of a reconstruction, path-traced under a map that none of its images show,
//! beside the true object under that map (§13).
//!
//! Object k is read under its own map, and scored under the map and from the test cameras of object k + 1.
//! Truth and renders are linear; every render has one least-squares factor per channel, as in Stanford-ORB
//! ([`crate::fit::field::benchmark`]). Four other images are compared on the same pixels: the field with the
//! colours of the old light, which is no relighting; the mesh with these colours as emission, which has the
//! holes and edges of the relit one; the mesh under the old map, which has the same materials too, and shows
//! what the new light is worth; and the mesh under the new map with the mean materials of training objects,
//! which shows what the materials are worth. Behind all of them is black: where a mesh does not cover the object,
//! it would show the map, and the field would not.

use super::setup::{SEED, Setup, is_complete, shown};
use crate::experiment::{Cell, Chart, Experiment, Outcome, Report, Summary, Values, of};
use crate::fit::field::benchmark::{Relighting, truth, view as compared};
use crate::fit::field::mesh::{Baked, Base, Settings as Form, try_bake};
use crate::fit::field::targets::target;
use crate::fit::field::{score, view};
use crate::fit::training::Watch;
use crate::loss::metric::orb;
use crate::scene::field::Field;
use crate::scene::light::Environment;
use crate::scene::material::Material;
use crate::scene::mesh::Object;
use crate::shade::render::Settings as Tracing;
use crate::{Error, Result};
use data_gen::cameras;
use lastlight_lirm::evaluate::{Typical, settings};
use lastlight_lirm::r#gen::Version;
use lastlight_lirm::model::weights::Ready;
use lastlight_lirm::subject::Light;
use lastlight_lirm::views::Views;
use serde_json::{Value, json};
use std::sync::atomic::AtomicBool;

/// Version of the objects.
const VERSION: Version = Version::Environment;
/// Sets that are read.
const SETS: usize = 2;
/// Images that are relit.
const IMAGES: usize = 4;
/// Points of the grid of the mesh.
const GRID: usize = 96;
/// Texels per side of its maps; if the charts of a ragged surface do not fit, the next number is tried.
const TEXELS: [usize; 3] = [512, 1024, 2048];

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
/// What is compared: name in values, title, and name in a chart.
const IMAGES_OF: [[&str; 3]; 5] = [
    ["relit_db", "mesh under the new map", "relit"],
    ["old_colors_db", "field, colours of the old light", "old colours"],
    ["old_emission_db", "mesh, colours of the old light", "old colours, mesh"],
    ["old_map_db", "mesh under the old map", "old map"],
    ["mean_materials_db", "mesh under the new map, mean materials of training objects", "mean materials"],
];

/// The mesh of a field; `None` without a surface.
fn baked(field: &Field, base: Base) -> Result<Option<Baked>> {
    let of = |texture: usize| try_bake(field, &Form { side: GRID, texture, base, ..Form::default() });
    let [first, others @ ..] = TEXELS;
    others.into_iter().fold(of(first), |made, texture| made.or_else(|_| of(texture)))
}

/// The object with one material everywhere.
fn with_mean_materials(object: &Object, typical: &Typical) -> Object {
    let [r, g, b] = typical.albedo.map(|x| orb::decode(f64::from(x)) as f32);
    let [roughness, metallic] = typical.mean;
    let material = Material { base_color: [r, g, b, 1.0], roughness, metallic, ..Material::default() };
    Object { materials: vec![material; object.materials.len()], ..object.clone() }
}

impl Experiment for Relit<'_> {
    fn id(&self) -> &'static str {
        "relit"
    }

    fn cells(&self) -> Vec<Cell> {
        let cell = |k: u64| Cell { key: format!("{k:03}"), row: ROW.into(), seed: k };
        (0..self.setup.size.objects).map(cell).collect()
    }

    fn settings(&self, _: usize) -> Value {
        let mut record = self.setup.record(self.setup.model());
        record["compared"] = json!(IMAGES_OF.map(|[name, ..]| name));
        record
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
        let [old_map, map] = [Light::new(&set, k)?.map, Light::new(&set, other)?.map];
        watch.lap("images");
        let ready = Ready::new(model.config, &model.params);
        let (state, at) = self.setup.read(&ready, &views, k, SETS)?;
        let field = ready.decode(&state, self.setup.protocol(model, VERSION).rendering, at);
        let cells = view::occupancy(&field)?;
        // A field without a surface cannot be relit; how many have one is a number of its own.
        let both = [baked(&field, Base::Albedo)?, baked(&field, Base::Color)?];
        let mut out = Values::from([("has_surface".to_owned(), if both[0].is_some() { 1.0 } else { 0.0 })]);
        let [Some(lit), Some(colored)] = both else { return Ok(out) };
        watch.lap("meshes");
        let tracing = Tracing { samples: self.setup.size.samples, seed: SEED, ..Tracing::default() };
        let plain = with_mean_materials(&lit.object, &self.setup.typical(VERSION)?);
        let [own, colored, plain] =
            [&lit.object, &colored.object, &plain].map(|object| Relighting::new(object, tracing));
        let outputs = cameras::test(SEED, other, set.size).outputs;
        let mut all = [(); IMAGES_OF.len()].map(|()| Vec::new());
        for (n, i) in outputs.into_iter().take(Ord::min(IMAGES, self.setup.size.outputs)).enumerate() {
            let picture = &new.all[i].picture;
            let mut linear = truth(picture, 1.0);
            for (x, m) in linear.as_chunks_mut::<3>().0.iter_mut().zip(&picture.foreground) {
                *x = if *m > 0.0 { *x } else { [0.0; 3] };
            }
            let seen = target(picture, &at);
            let old = compared(&score(&field, &cells, &seen)?, &seen, &linear, at.scale, None)?.image;
            let under = |job: &Relighting<'_>, map: &Environment| {
                Ok::<_, Error>(Some(job.score(picture, &linear, n, map, None)?.scores))
            };
            let images = [
                under(&own, &map)?,
                old,
                under(&colored, &map)?,
                under(&own, &old_map)?,
                under(&plain, &map)?,
            ];
            // In the truth, pixels at the border show the map behind, which the renders do not have.
            let eroded = images.map(|image| image.and_then(|scores| scores.psnr_eroded_db));
            if eroded.iter().all(Option::is_some) {
                all.iter_mut().zip(eroded.into_iter().flatten()).for_each(|(all, db)| all.push(db));
            }
        }
        watch.lap("relighting");
        if !all[0].is_empty() {
            let named = IMAGES_OF.iter().zip(&all);
            out.extend(named.map(|([name, ..], x)| ((*name).to_owned(), Summary::of(x).mean)));
        }
        Ok(out)
    }

    fn report(&self, results: &[(Cell, Values)]) -> Report {
        let scored: Vec<(Cell, Values)> =
            results.iter().filter(|(_, v)| v.contains_key("relit_db")).cloned().collect();
        let pair = |name: &str| of(&scored, ROW, name);
        let gains = [1, 2, 3, 4].map(|i| Summary::of_pairs(&pair(IMAGES_OF[0][0]), &pair(IMAGES_OF[i][0])));
        let line = |what: &str, x: &[f64], digits| vec![what.to_owned(), shown(&Summary::of(x), digits)];
        let surfaces = of(results, ROW, "has_surface");
        let found = surfaces.iter().filter(|x| **x > 0.0).count();
        Report {
            id: "relit",
            claim: "Materials show an object under a light that none of its images have: closer to the truth than its old colours as a field and as a mesh, than the same mesh under the old light, and than the same mesh with mean materials (the paper relights scans of real objects).",
            head: vec!["after 8 images", ">PSNR in the eroded mask, dB"],
            rows: IMAGES_OF.iter().map(|[name, title, _]| line(title, &pair(name), 2)).collect(),
            chart_labels: ["relit − the others, dB", ""],
            chart: Chart::Intervals(
                IMAGES_OF[1..]
                    .iter()
                    .zip(gains)
                    .map(|([.., name], gain)| ((*name).to_owned(), gain))
                    .collect(),
            ),
            outcome: Outcome::of(
                (is_complete(self, results) && gains[0].count > 1)
                    .then(|| gains.iter().all(Summary::is_positive) && found == results.len()),
            ),
            verdict: match gains[0].count {
                0 => "The model has no materials, or its fields no surfaces.".into(),
                _ => {
                    let [colors, mesh, map, materials] = gains.map(|gain| shown(&gain, 2));
                    format!(
                        "Relighting gains {colors} dB over the field in its old colours, {mesh} over the mesh in these, {map} over the same mesh under the old map, {materials} over mean materials; {found} of {} objects have a surface.",
                        results.len()
                    )
                }
            },
        }
    }
}
