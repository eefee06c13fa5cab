//! E1–E3, E5–E9, E13–E15: persons fitted with and without guidance by the image-to-point model.
//!
//! ```text
//! setup        sizes, models, captures: common to the experiments
//! fit_run      one cell: the fit of a person and its scores, at equal iterations and at equal renders
//! budget       number of renders of a fit, and number of iterations for a given number of renders
//! constants    the scale of the latent criterion, the hyper-parameter search
//! experiments  the runs that each experiment compares
//! comparison   the comparison of an experiment; report: tables and charts; evaluation: whether the claim holds
//! ```
//!
//! The *host* is the avatar fit without LAST.
//!
//! # A cell
//! A *subject* is an appearance and a motion (one number) and a true graph. Its video is that of `last gen`
//! with the default seed, so that its factors follow the equations on which the model of that graph was
//! trained; it is generated under `subjects/` when it is first needed. A *setting* is a complete
//! [`Settings`](lastlight_last::avatar::settings::Settings) of the host, with the number of the subject as
//! seed, and the graph that the model uses. The file of a cell contains all of these and the digest of the
//! model; experiments with the same cell share its file.
//!
//! A cell has two fits: one with the iterations of the study, and one with as many renders as the full system
//! needs for those iterations. The progressive update renders once per level, so a fit without it runs for
//! more iterations. Values of the second fit end in `@renders`. Both are scored on the held-out images: test
//! cameras, every 30th frame.
//!
//! | value | |
//! |---|---|
//! | `PSNR-box`, `SSIM-g`, … | means over the held-out images, names of [`Scores::named`](crate::loss::metric::person::Scores::named) |
//! | `PSNR-box training` | mean over some training images |
//! | `gaussians`, `iterations`, `renders`, `encodings` | at the end of the fit; encodings are passes of the model's encoder |
//! | `bound`, `blind`, `rejected` | share of child steps limited by λ; share of gradients outside the crop of the encoder; candidates rejected because of the maximum number |
//! | `curve I` | PSNR-box of the held-out images after I iterations |
//! | `factor J I` | E13: mean displacement of the decoded points if factor J of the render is replaced by that of the input image |
//! | `edges`, `changed`, `moved` | edges of the graph; E9: number of edges changed by tuning, sum of the changes of the probabilities |
//!
//! # Pairs
//! Two rows are compared over their common subjects, with the same capture and seed. The interval is
//! Student's over subjects, which are the only independent samples; a second seed of one subject would not be
//! independent. Subject 0 is used for calibration and search and in no other experiment.
//!
//! # What "structure off" means
//! The graph is empty and the rest of the model is unchanged. Then ε = Ẑ, no factor has a parent, and the
//! progressive update has one level, which is bit-identical to the update of all Gaussians at once; some of
//! the eight combinations of E2 therefore coincide by construction. The standard deviations t of ε, by which
//! L_lat is divided, are those of the pre-training set for the learned graph; for another graph they are
//! multiplied by the ratio of the deviations of ε under the two graphs over the training images of the
//! subject. A mechanism with parents that it did not have in training is evaluated as it is.

pub mod budget;
mod comparison;
pub mod constants;
mod evaluation;
pub mod experiments;
pub mod fit_run;
mod report;
pub mod setup;
