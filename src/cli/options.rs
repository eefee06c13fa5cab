//! Where every option is listed: one heading and one rank per option, whatever command has it.

/// Headings of a help page, in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Heading {
    /// what is read
    Input,
    /// what is written
    Output,
    /// what is computed, and how
    Method,
    /// how the program runs
    Run,
}

/// Arguments that say what is read; so are all positional arguments but those in [`OUTPUT`].
const INPUT: &[&str] = &[
    "allow-outside",
    "animation",
    "body",
    "box",
    "cameras",
    "character",
    "downscale",
    "drop-invalid",
    "elbow",
    "env",
    "env-axes",
    "env-linear",
    "env-mirror",
    "env-rotate",
    "env-scale",
    "env-width",
    "exec",
    "first",
    "gender",
    "graph-model",
    "hide",
    "images",
    "image",
    "in",
    "init",
    "layout",
    "like",
    "lpips",
    "masks",
    "mesh",
    "model",
    "normals",
    "only",
    "plan",
    "pose",
    "pose-from",
    "probe-axes",
    "probe-mirror",
    "split",
    "strict",
    "subject",
    "test-camera",
    "test-frames",
    "time",
    "train-camera",
    "train-frames",
];

/// Arguments that say what is written.
const OUTPUT: &[&str] = &[
    "dump",
    "force",
    "html",
    "max-images",
    "min-psnr",
    "no-truth",
    "out",
    "output",
    "passes",
    "report-only",
    "set-size",
    "size",
    "transparent",
    "video-size",
];

/// Arguments that change no result, and those that say which random numbers it is made from.
const RUN: &[&str] = &[
    "checkpoint-every",
    "color",
    "help",
    "jobs",
    "json",
    "max-memory",
    "quiet",
    "resume",
    "seed",
    "threads",
    "verbose",
    "version",
];

/// Options that `-h` leaves out.
const RARE: &[&str] = &[
    "absolute-albedo",
    "added",
    "allow-outside",
    "animate",
    "appearances",
    "arc",
    "average-last",
    "batch-groups",
    "batch-images",
    "batch-points",
    "body-points",
    "bounces",
    "box",
    "center",
    "channels",
    "checkpoint-every",
    "chunk",
    "color",
    "combine",
    "crop-side",
    "crops",
    "density",
    "drop-invalid",
    "eikonal",
    "elbow",
    "elevation",
    "entries",
    "env-axes",
    "env-linear",
    "env-mirror",
    "env-rotate",
    "env-scale",
    "env-width",
    "every",
    "exposure",
    "factor-dim",
    "first",
    "first-inverse-beta",
    "fov",
    "gender",
    "gradients-at-once",
    "graph-from",
    "head-rate",
    "heads",
    "hide",
    "independence-on",
    "initial",
    "jobs",
    "json",
    "key-share",
    "keys",
    "lambda",
    "lambda-mode",
    "last-set-only",
    "latent-every",
    "latent-weight",
    "lpips-raw",
    "material-weight",
    "max-memory",
    "mechanism",
    "network-rate",
    "no-cosine",
    "no-density-adapter",
    "no-progressive",
    "no-standardize",
    "no-truth",
    "normal-weight",
    "order",
    "plane-rate",
    "points",
    "pose-network",
    "radius",
    "rate",
    "reading",
    "render-as",
    "room",
    "rule",
    "seams",
    "set-render-as",
    "set-size",
    "shape-steps",
    "ssim-weight",
    "start-share",
    "state-gradient",
    "strict",
    "subject",
    "tau-rec",
    "tau-scale",
    "test-camera",
    "test-frames",
    "texture",
    "tile",
    "tint",
    "train-camera",
    "train-frames",
    "until",
    "up",
    "updates",
    "uses",
    "variation",
    "version",
    "video-render-as",
    "video-size",
    "warmup-iterations",
    "weight",
    "weights-network",
];

/// Commands whose record `--like` takes.
pub(crate) const RECORDED: &[&str] = &[
    "demo",
    "splat fit",
    "last pretrain",
    "last fit",
    "last study",
    "field fit",
    "lirm train",
    "lirm reconstruct",
    "lirm update",
    "lirm study",
];

/// Commands whose result is a model: theirs is the heading `Model` where others have `Method`.
const FITS: &[&str] = &["splat fit", "last pretrain", "last tune", "last fit", "field fit"];

impl Heading {
    /// The heading of an argument, positional or by its long name.
    pub(crate) fn of(argument: &clap::Arg) -> Self {
        let name = argument.get_long().unwrap_or_else(|| argument.get_id().as_str());
        match name {
            _ if OUTPUT.contains(&name) => Self::Output,
            _ if RUN.contains(&name) => Self::Run,
            _ if INPUT.contains(&name) || argument.is_positional() => Self::Input,
            _ => Self::Method,
        }
    }

    /// Its text for the command at `path`.
    pub(crate) fn text(self, path: &str) -> &'static str {
        match self {
            Self::Input => "Input",
            Self::Output => "Output",
            Self::Method if FITS.contains(&path) => "Model",
            Self::Method => "Method",
            Self::Run => "Run",
        }
    }
}

/// Whether only `--help` lists the option.
pub(crate) fn is_rare(argument: &clap::Arg) -> bool {
    argument.get_long().is_some_and(|name| RARE.contains(&name))
}
