//! Tests of LAST, LIRM and the training loop: what they rest on, what they make, what they must show.

#[path = "../common/ball.rs"]
mod ball;
#[path = "../common/mod.rs"]
mod common;
mod field;
mod last;
mod last_character;
mod last_gen;
mod last_subjects;
mod lirm_evaluate;
mod lirm_gen;
mod lirm_train;
mod lirm_truth;
mod lirm_views;
#[path = "../common/lpips_weights.rs"]
mod lpips_weights;
mod passes;
mod resume;
#[path = "../samples/mod.rs"]
mod samples;
