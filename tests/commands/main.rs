//! Tests of the built program: exit codes, messages, interruption and results of every command.

#[path = "../common/ball_layouts.rs"]
mod ball_layouts;
mod cli;
mod cli_field;
mod cli_field_import;
mod cli_gen;
mod cli_last;
mod cli_lirm;
mod cli_lirm_captures;
mod cli_lirm_model;
mod cli_study;
#[path = "../common/mod.rs"]
mod common;
mod fits;
mod globals;
mod guidance;
#[path = "../common/lpips_weights.rs"]
mod lpips_weights;
mod mesh_cli;
#[path = "../common/mini_person.rs"]
mod mini_person;
mod mistakes;
mod oracle;
mod orbits;
mod person;
mod program;
#[path = "../common/python.rs"]
mod python;
mod readme;
mod report;
mod resumed;
mod robust;
#[path = "../samples/mod.rs"]
mod samples;
mod streams;
mod tree;
mod weights;
