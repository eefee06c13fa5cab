//! Tests of levels 2 and 3: files of every format, captures, models and persons.

#[path = "../common/ball_layouts.rs"]
mod ball_layouts;
mod captures;
#[path = "../common/mod.rs"]
mod common;
mod images;
mod io;
mod layouts;
#[path = "../common/mini_person.rs"]
mod mini_person;
mod missing;
mod models;
#[path = "../common/mutate.rs"]
mod mutate;
mod objects;
mod person_captures;
mod person_layout;
#[path = "../common/person_layouts.rs"]
mod person_layouts;
mod pickles;
#[path = "../common/python.rs"]
mod python;
#[path = "../samples/mod.rs"]
mod samples;
