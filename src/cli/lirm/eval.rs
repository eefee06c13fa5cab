//! `lirm eval`: a model on built-in objects that it was not trained on.

use super::weights;
use crate::choices::{Choices, choices};
use crate::console as cli;
use crate::fit::training::Watch;
use crate::io::memory;
use crate::meter::Meter;
use crate::units::counted;
use crate::{Error, Result};
use lastlight_lirm::evaluate::{self, Control, Order, Protocol, SET};
use lastlight_lirm::r#gen::Version;
use lastlight_lirm::model::config::PATCH;
use lastlight_lirm::model::decode::Rendering;
use lastlight_lirm::model::file::digest;
use lastlight_lirm::model::origin::training_seed;
use lastlight_lirm::model::params::count;
use lastlight_lirm::model::weights::Ready;
use lastlight_lirm::reading::INPUT_SIDE;
use serde_json::{Value, json};
use std::path::PathBuf;

/// Values of `--light`.
const LIGHTS: &Choices = &[
    ("uniform", "a white dome"),
    ("environment", "an environment map"),
    ("shiny", "the map, and smoother materials"),
];
/// Values of `--input-order`.
const ORDERS: &Choices =
    &[("random", "in a random order"), ("sequential", "around the object: every set shows one side")];

/// Numbers that are printed: name, title, digits. What a number is compared with follows it, indented.
const ROWS: [(&str, &str, usize); 32] = [
    ("psnr_db", "PSNR, dB", 2),
    ("hull_db", "  visual hull", 2),
    ("small_hull_db", "  visual hull of 64x64", 2),
    ("blurred_hull_db", "  visual hull, blurred", 2),
    ("nearest_db", "  nearest input", 2),
    ("psnr_h_db", "PSNR-H, dB", 2),
    ("psnr_l_db", "PSNR-L, dB", 2),
    ("ssim", "SSIM", 3),
    ("orb_ssim", "SSIM-3", 3),
    ("rfd", "RFD (not LPIPS)", 1),
    ("foreground_iou", "IoU of foregrounds", 3),
    ("hull_iou", "  visual hull", 3),
    ("color", "mean colour, error", 3),
    ("gray", "  a grey", 3),
    ("numerical_normals_deg", "normals, degrees", 1),
    ("orb_normals", "normals, 1 - cos", 4),
    ("depth", "depth", 4),
    ("orb_depth", "depth, squared error", 5),
    ("distance_radii", "surface, radii", 4),
    ("orb_shape", "surface, squared distance", 5),
    ("has_surface", "  objects that have one", 2),
    ("albedo_error", "albedo, error", 3),
    ("mean_albedo_error", "  mean of training objects", 3),
    ("input_albedo_error", "  mean colour of the inputs", 3),
    ("albedo_db", "albedo, dB", 2),
    ("mean_albedo_db", "  mean of training objects", 2),
    ("roughness", "roughness, error", 3),
    ("mean_roughness", "  mean of training objects", 3),
    ("median_roughness", "  their median", 3),
    ("metallic", "metallic, error", 3),
    ("mean_metallic", "  mean of training objects", 3),
    ("median_metallic", "  their median", 3),
];

/// Width of the titles.
const TITLE: usize = 28;

/// Values of `--control`.
const CONTROLS: &Choices = &[
    ("none", "nothing is broken"),
    (
        "zeroed-state",
        "before every set after the first the state is zero, and the set is read in the axes of its own images",
    ),
    ("permuted-cameras", "the images of every set have each other's cameras"),
    ("other-object", "from the second set on, the images show another object"),
    ("swapped-colors", "red and green of all images are exchanged"),
    ("at-once", "no state: after every set, all images so far are read in one round"),
];

/// Score a LIRM model on built-in objects, after every set of four images.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight lirm eval                                       24 objects of seed 2
  lastlight lirm eval s1c --seed 1 --no-baselines           for comparing trainings
  lastlight lirm eval s3 --light environment --input-order sequential

Every object has 48 views (lirm gen --cameras test): 16 inputs in four sets, read at 64x64, and 12 outputs, compared at 128x128. Baselines, all with the true foregrounds: the nearest input image; the visual hull of the inputs with their mean colours, from 128x128, from the 64x64 that the model reads, and the former blurred by one pixel. Materials count where the object covers a pixel and the model is opaque, beside means and medians of training objects. The error of albedo is the root mean square of its linear values after one factor for all channels; in dB it has a factor per channel. PSNR is over white; RFD is a distance of responses to random filters; the error of the mean colour is beside that of a grey of the true brightness; depth is the mean absolute difference in units in which the object's ball has the radius ½. PSNR-H, PSNR-L, SSIM-3, 1 - cos and squared errors are defined as in Stanford-ORB, in the object's units. With --shapes, surface is the mean distance of the surfaces in radii of the object. All are means over outputs, then objects.")]
pub(crate) struct Args {
    /// Model, or the folder of a training [default: the included model]
    #[arg(value_name = "FILE")]
    model: Option<PathBuf>,
    /// Number of objects
    #[arg(long, value_name = "N", default_value_t = 24, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    objects: u32,
    /// Index of the first object
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u64).range(..=u64::from(u32::MAX)))]
    first: u64,
    /// Light
    #[arg(long, value_name = "NAME", default_value = "uniform", value_parser = choices(LIGHTS))]
    light: String,
    /// Order of the inputs
    #[arg(long, value_name = "NAME", default_value = "random", value_parser = choices(ORDERS))]
    input_order: String,
    /// Samples per pixel of the objects' images; their noise limits the scores
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    samples: u32,
    /// Samples of a ray along the diagonal of the box
    #[arg(long, value_name = "N", default_value_t = 128, value_parser = clap::value_parser!(u32).range(8..=4096))]
    ray_samples: u32,
    /// 1/β, the largest density [default: that of the last step of the training]
    #[arg(long, value_name = "X")]
    inverse_beta: Option<f32>,
    /// Break one input of the model; if the score does not fall, the model does not use that input
    #[arg(long, value_name = "NAME", default_value = "none", value_parser = choices(CONTROLS))]
    control: String,
    /// Multiply the colours of every object by a random one, whose channels lose up to this part of the largest: built-in objects are nearly grey
    #[arg(long, value_name = "X", default_value_t = 0.0)]
    tint: f64,
    /// Sets that are read
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u8).range(1..=4))]
    sets: u8,
    /// Compare surfaces too
    #[arg(long)]
    shapes: bool,
    /// Leave out nearest input and visual hulls, which take two fifths of the time
    #[arg(long)]
    no_baselines: bool,
    /// Seed of the objects
    #[arg(long, value_name = "N", default_value_t = 2)]
    seed: u64,
}

pub(super) fn run(args: &Args) -> Result<()> {
    if !(0.0..=1.0).contains(&args.tint) {
        return Err(Error::input("--tint").expected("0 to 1").got(args.tint.to_string()));
    }
    let mut meter = Meter::new();
    let (model, name) = weights::model(args.model.as_deref(), &meter)?;
    let inverse_beta = weights::inverse_beta(args.inverse_beta, &model)?;
    let trained = training_seed(&model.training);
    if model.training.iter().any(|part| part.objects() == Some(args.seed)) {
        meter.note(&format!(
            "the model was trained with objects of seed {}: objects it has seen are not a test of it",
            args.seed
        ));
    }
    let version = Version::named(&args.light).expect("a value of LIGHTS");
    let control = Control::named(&args.control).expect("a value of CONTROLS");
    if args.sets == 1 && matches!(control, Control::ZeroedState | Control::OtherObject | Control::AtOnce) {
        return Err(Error::input("--control")
            .expected("at least two sets: it changes nothing in the first")
            .got(format!("{} with --sets 1", args.control)));
    }
    // All images so far in one round, or those of a set.
    let sets = if control == Control::AtOnce { usize::from(args.sets) } else { 1 };
    let tokens = sets * SET * (INPUT_SIDE / PATCH) * (INPUT_SIDE / PATCH);
    memory::check("lirm eval", model.config.memory(count(&model.config), tokens))?;
    let ready = Ready::new(model.config, &model.params);
    let p = Protocol {
        set: evaluate::settings(args.seed, args.samples),
        version,
        order: Order::named(&args.input_order).expect("a value of ORDERS"),
        rendering: Rendering::of_field(args.ray_samples as usize, inverse_beta),
        control,
        sets: usize::from(args.sets),
        outputs: 12,
        typical: trained
            .filter(|_| model.config.is_whole)
            .map(|seed| evaluate::typical_materials(seed, version))
            .transpose()?,
        baselines: !args.no_baselines,
        shapes: args.shapes,
    };
    meter.lap("reading");
    let mut all = Vec::new();
    for i in 0..args.objects as usize {
        meter.count(i, args.objects as usize, "scoring");
        all.push(evaluate::score_object(&ready, &p, args.first + i as u64, args.tint)?);
    }
    meter.done();
    let means = evaluate::means(&all);
    let objects: Vec<Value> = all.iter().map(|s| json!({ "object": s.object, "rounds": s.rounds })).collect();
    let record = json!({
        "model": name, "digest": digest(&model.params), "stages": model.stages(), "light": args.light, "order": args.input_order, "control": args.control, "tint": args.tint,
        "seed": args.seed, "samples": args.samples, "ray_samples": args.ray_samples, "sets": args.sets, "inverse_beta": p.rendering.inverse_beta,
        "rounds": means, "objects": objects,
    });
    if cli::is_json() {
        return cli::say_json(&record);
    }
    let rounds = || record["rounds"].as_array().into_iter().flatten();
    let line = |title: &str, values: Vec<String>| {
        values.iter().fold(format!("{title:<TITLE$}"), |line, x| format!("{line}  {x:>8}"))
    };
    let what = counted(args.objects as usize, "object");
    let tint = if args.tint > 0.0 { format!(", tint {}", args.tint) } else { String::new() };
    let head = format!(
        "{what} of seed {} from {}, light {}, {} order, control {}{tint}; model {}",
        args.seed,
        args.first,
        args.light,
        args.input_order,
        args.control,
        digest(&model.params)
    );
    let mut lines = vec![head, line("images", rounds().map(|r| r["images"].to_string()).collect())];
    for (name, title, digits) in ROWS.iter().filter(|(name, ..)| rounds().any(|r| !r[name].is_null())) {
        let number = |r: &Value| r[name].as_f64().map_or_else(|| "–".to_owned(), |x| format!("{x:.digits$}"));
        lines.push(line(title, rounds().map(number).collect()));
    }
    cli::say(&lines.join("\n"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_value_of_an_option_has_a_meaning_and_titles_fit() {
        let names = |list: &Choices| list.iter().map(|(name, _)| *name).collect::<Vec<_>>();
        assert_eq!(names(LIGHTS), Version::ALL.map(Version::name));
        assert_eq!(names(ORDERS), Order::ALL.map(Order::name));
        assert_eq!(names(CONTROLS), Control::ALL.map(Control::name));
        assert!(ROWS.iter().all(|(_, title, _)| title.chars().count() <= TITLE), "titles fit");
    }
}
