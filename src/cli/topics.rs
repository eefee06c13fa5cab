//! `help`: the help of a command, or a page on a topic that belongs to several.

use crate::choices::{Choices, Known};
use crate::console as cli;
use crate::mistakes;
use crate::{Error, Result};
use serde_json::json;

/// Pages that belong to no single command: name, one line, text.
pub(crate) const TOPICS: [(&str, &str, &str); 4] = [
    ("captures", "Layouts of input images with camera poses", CAPTURES),
    ("profiles", "Semantics of the renderer: exact, gsplat, inria, unlimited", PROFILES),
    ("exit-codes", "Exit codes, errors, and what an interruption leaves", EXIT_CODES),
    ("env", "Environment variables", ENVIRONMENT),
];

/// Names and lines of the topics; the name of a command is accepted too.
const NAMES: &Choices = &{
    let mut names = [("", ""); TOPICS.len()];
    let mut at = 0;
    while at < names.len() {
        names[at] = (TOPICS[at].0, TOPICS[at].1);
        at += 1;
    }
    names
};

const CAPTURES: &str = "\
Captures of a scene (splat fit, splat eval, --cameras)

A capture is a folder with images and their camera poses. It contains one of these:

  transforms_train.json, transforms_test.json    NeRF-synthetic; held-out images are those of the test file
  transforms.json                                instant-ngp, nerfstudio
  sparse/0 or sparse, and images next to it      COLMAP, binary or text; images in images, images_2, images_4, images_8 or input

The transforms.json itself can be given too. Images are PNG, JPEG, WebP, TIFF or BMP; their EXIF orientation is ignored, as in COLMAP, unless the declared size fits only the upright image. Lens distortion (OpenCV radial-tangential and fisheye) is removed on load. Images that are listed and missing are left out with a note; --strict refuses such a capture. --images DIR names another folder of images. Paths that are absolute or lead out of the capture's folder need --allow-outside.

Masks are mask_path in a transforms.json, or the folder masks of a COLMAP model; black pixels are excluded. --masks ignore: they count neither in the loss nor in scores (default); background: they are trained toward the background colour; off: masks are not read.

`splat render --cameras` also takes the folder of a fit, and a camera_path.json of nerfstudio.

A folder of photos without poses is not a capture. COLMAP (version 3.9 or later) computes poses:

  mkdir -p scene
  colmap automatic_reconstructor --workspace_path scene --image_path photos --dense 0
  lastlight splat fit scene --images photos --out fit

Or step by step, for images of a video of one camera:

  mkdir -p scene/images
  ffmpeg -i phone.mp4 -vf fps=2 -q:v 2 scene/images/%04d.jpg
  colmap feature_extractor --database_path scene/database.db --image_path scene/images --ImageReader.single_camera 1 --ImageReader.camera_model OPENCV
  colmap sequential_matcher --database_path scene/database.db
  mkdir scene/sparse
  colmap mapper --database_path scene/database.db --image_path scene/images --output_path scene/sparse
  lastlight splat fit scene --out fit

Or, with nerfstudio: ns-process-data images --data photos --output-dir scene

Take 60 to 200 sharp images from two heights, with exposure and focus locked, and with much overlap.

Captures of one object (field fit, field eval)

The same layouts, with the object's foreground: an alpha channel, a mask, or foreground_path in a transforms.json. There, radiance_path (EXR), depth_path, normal_path, albedo_path, material_path, environment_path and exposure name further passes. `lirm gen` and `mesh render` write them. `field import` makes such a capture from two published layouts:

  Stanford-ORB   blender_LDR/NAME, blender_HDR/NAME: transforms_{train,test,novel}.json, train_mask, ground_truth/NAME beside them
  DTC renders    images/CameraRig.json, images/rgb/rgb0000000.png, mask0000000.png, depth, normal, albedo

Captures of a person (last fit, last eval, last tune, last intervene)

  transforms_train.json, transforms_test.json    cameras, masks, moments
  body.npz, poses.npz                            a body with skinning weights, one pose per moment

`last gen` writes this layout, `last import` converts published data sets to it, and `last inspect` reports whether a capture is complete. A phone video of a person needs a body model fitted to every frame first; that program is not part of this one.";

const PROFILES: &str = "\
Profiles of the Gaussian renderer (--profile)

  exact      this program's own: all constants as in the equations, exact footprints (default)
  gsplat     constants and cut-offs of gsplat
  inria      constants and cut-offs of the original 3DGS implementation
  unlimited  as exact, with no smallest alpha and no early stop: the reference of error curves, slower

A profile fixes the dilation of projected covariances, the largest alpha, the smallest alpha that counts, the radius at which a Gaussian ends, the transmittance at which a ray stops, and the clamp of the projection's derivative. `oracle show splat.render` lists the settings, and `oracle run --set KEY=VALUE` overrides one.

To compare with a scene fitted by another program, render it with the profile of that program:

  lastlight splat eval theirs.ply photos --profile inria

The chapter `profiles` of the book derives the differences.";

const EXIT_CODES: &str = "\
Exit codes

  0      done
  1      a check failed: doctor, gradcheck, oracle compare, last inspect, demo, or a score below --min-psnr
  2      wrong usage, invalid input, or a file that cannot be read or written
  130    interrupted by Ctrl-C, SIGTERM or SIGHUP

Results go to standard output, as text or with --json as one JSON document. Progress, notes and errors go to standard error. An error is one line that begins with `error:`; with --json it is one line of JSON:

  {\"error\":{\"kind\":\"input\",\"message\":\"nowhere: no such folder\",\"exit_code\":2}}

`kind` is usage, input, check or interrupted. Errors of the command line itself are of kind usage; without --json they also show the usage.

An interrupted run finishes its iteration, writes a checkpoint, and continues with --resume to the bits of an uninterrupted run. A second Ctrl-C ends it at once. Files are complete or do not exist. An interruption before the first file is written saves nothing, and the message states it.";

const ENVIRONMENT: &str = "\
Environment variables

  NO_COLOR            not empty: no colours, as --color never
  LASTLIGHT_LANES     8: matrix products in registers of eight lanes, also where the processor has AVX-512; no bit of a result changes

Only in tests and benchmarks:

  LASTLIGHT_DATA         folder of published captures and models; tests that need them are skipped without it
  LASTLIGHT_LONG         1: also run the tests that take minutes
  LASTLIGHT_REMINT       1: write the digests anew (cargo bits)
  LASTLIGHT_BENCH_SMOKE  1: run benchmarks at their smallest sizes

No variable changes a bit of a result. Options are given on the command line only; there is no configuration file.";

/// Print the help of a command or a topic.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  lastlight help splat fit
  lastlight help captures
  lastlight help exit-codes

Topics: captures (layouts of input images), profiles (semantics of the renderer), exit-codes (also errors and interruptions), env (environment variables).")]
pub(crate) struct Args {
    /// A command, or one of the topics captures, profiles, exit-codes, env
    #[arg(value_name = "TOPIC", value_parser = Known { names: NAMES, accepts: |_| true })]
    words: Vec<String>,
}

/// Prints a topic, or the whole help of a command of `tree`.
///
/// # Errors
/// When there is neither, or standard output cannot be written.
pub(crate) fn run(args: &Args, mut tree: clap::Command) -> Result<()> {
    if let [word] = args.words.as_slice()
        && let Some((name, _, text)) = TOPICS.iter().find(|(name, ..)| name == word)
    {
        if cli::is_json() {
            return cli::say_json(&json!({ "topic": name, "text": text }));
        }
        return cli::say(text);
    }
    // Global options reach the commands when the tree is built.
    tree.build();
    let all = tree.clone();
    let mut command = &mut tree;
    for word in &args.words {
        let names: Vec<String> = command.get_subcommands().map(|c| c.get_name().to_owned()).collect();
        let topics = TOPICS.iter().map(|(name, ..)| (*name).to_owned());
        command = command.find_subcommand_mut(word).ok_or_else(|| {
            let known: Vec<String> = names.into_iter().chain(topics).collect();
            let related = mistakes::related(word, &all, &TOPICS);
            let e = Error::input("help").got(word.as_str());
            if related.is_empty() {
                return e.expected(format!("a command or a topic: {}", known.join(", ")));
            }
            let related: Vec<String> = related.iter().map(|name| format!("`lastlight {name}`")).collect();
            e.expected("a command or a topic").hint(format!("see {}", related.join(", ")))
        })?;
    }
    let text = command.render_long_help();
    if cli::is_json() {
        return cli::say_json(&json!({ "command": args.words, "text": text.to_string() }));
    }
    cli::say(text.to_string().trim_end())
}
