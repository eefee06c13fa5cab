//! E1–E3, E5–E9, E13–E15: persons fitted with and without what the image-to-point model says (`last.md` §14).
//!
//! ```text
//! setup        sizes, models, captures: what the experiments share
//! run        one cell: a person fitted and scored, at equal iterations and at equal renders
//! budget       how many pictures a fit renders, and how long it may be for a number of them
//! constants    the scale of the latent criterion, the search for the strongest setting
//! experiments  which runs each experiment compares
//! question     what an experiment asks; report: tables and charts of the results; judge: whether a claim holds
//! ```
//!
//! # A cell
//! *Subject* = appearance and motion (a number) × true graph. The video of a subject is that of `last gen` with its default seed, so that its factors
//! follow the equations on which the model of that graph was trained; it is made under `subjects/` when it is first needed. *Setting* = a whole
//! [`Settings`](lastlight_last::avatar::settings::Settings) of the host with the subject's number as its seed, and which graph the model is told to have.
//! The file of a cell names all of that and the digest of the model, and experiments that ask for the same cell share its file.
//!
//! A cell is two fits: one of the iterations of the study, and one whose iterations are as many as it takes to render as many pictures as the full system
//! does in those; the progressive update renders once per level, so that without it a fit may go on for longer. Values of the second end in `@renders`.
//! Both are scored on the held-out pictures: test cameras, every 30th frame.
//!
//! | value | |
//! |---|---|
//! | `PSNR-box`, `SSIM-g`, … | means over the held-out pictures, names of [`Scores::named`](crate::loss::metric::person::Scores::named) |
//! | `PSNR-box training` | of some training pictures |
//! | `gaussians`, `iterations`, `renders`, `encodings` | at the end of the fit; encodings are passes of the model's encoder |
//! | `bound`, `blind`, `turned away` | share of child steps that λ bound, of the picture where the encoder does not look, candidates beyond the largest number |
//! | `curve I` | PSNR-box of the held-out pictures after I iterations |
//! | `factor J I` | E13: mean distance of points decoded with factor J of the photograph instead of the render's |
//! | `edges`, `changed`, `moved` | edges of the graph; E9: how many tuning changed, Σ of the change of the probabilities |
//!
//! # Pairs
//! Two rows are compared over the subjects that both have: same capture, same seed. The interval is Student's over subjects, the only thing here that is
//! drawn anew; a second seed of one subject would not be independent. Subject 0 is the one on which constants are found, and is in no other experiment.
//!
//! # What "structure off" means
//! The graph is empty and everything else of the model stays. Then ε = Ẑ, no factor has a parent, and the progressive update has one level, which is the
//! update of all at once, bit for bit: of the eight combinations of E2 some coincide by construction, and the table shows it. The standard deviations t of
//! ε, by which L_lat is divided, are those of the pre-training set for the learned graph; for another one they are multiplied by the ratio of the deviations
//! that ε has under the two graphs over the subject's training pictures. A mechanism that has parents which it never saw in training gives what it gives.

pub mod budget;
pub mod constants;
pub mod experiments;
pub mod fit_run;
mod judge;
mod question;
mod report;
pub mod setup;
