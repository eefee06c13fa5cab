//! The models included in the program: they are the ones described in `reference/weights/README.md`, and the
//! commands listed there produce them.

use crate::common::long;
use crate::program::{code, json, lastlight, stderr};
use lastlight::io::safetensors::Precision;
use lastlight::last::model::encoder::Input;
use lastlight::last::model::file::Trained;
use lastlight::last::model::shipped;
use lastlight::lirm::model::file::{Model, digest};
use lastlight::lirm::model::params::first;
use lastlight::lirm::model::{Config, shipped as objects};
use lastlight::lirm::train::stage::NAMES;

/// The image-to-point model is at most this large.
const MOST_BYTES: usize = 4 << 20;
/// And LIRM's.
const MOST_BYTES_OF_OBJECTS: usize = 12 << 20;

const README: &str = include_str!("../../reference/weights/README.md");

/// The digest in the table of the page.
fn recorded(file: &str) -> &'static str {
    let row = README.lines().find(|l| l.starts_with(&format!("| `{file}`"))).expect("a row of the table");
    let digest = row.split('`').nth(3).expect("a digest in code style");
    assert_eq!(digest.len(), 16, "16 hexadecimal digits: {digest}");
    digest
}

/// The commands of the page that begin like this.
fn commands(start: &str) -> Vec<Vec<&'static str>> {
    let all = README.lines().filter_map(|l| l.strip_prefix("lastlight "));
    all.filter(|l| l.starts_with(start)).map(|l| l.split_whitespace().collect()).collect()
}

#[test]
fn the_shipped_model_is_the_recorded_one() {
    assert!(shipped::BYTES.len() <= MOST_BYTES, "{} bytes, at most {MOST_BYTES}", shipped::BYTES.len());
    let trained = shipped::figure().expect("a model");
    assert_eq!(trained.digest().expect("no NaN"), recorded(shipped::NAME), "the digest of its page");
    let Input::Picture { side } = trained.model.encoder.input() else { panic!("a model of images") };
    assert!(side == 64, "pictures of 64 pixels");
    assert_eq!((trained.model.sizes.factors, trained.settings.width), (4, 4), "four factors of four numbers");
    assert!(trained.graph.is_acyclic(), "a graph without cycles");
}

#[test]
fn the_commands_of_its_page_make_it() {
    if !long("training the shipped model anew, about half an hour") {
        return;
    }
    let dir = tempfile::tempdir().expect("a temporary folder");
    let commands = commands("last ");
    assert_eq!(commands.len(), 2, "gen and pretrain: {commands:?}");
    for words in commands {
        let o = lastlight(&words, dir.path());
        assert_eq!(code(&o), 0, "{words:?}: {}", stderr(&o));
    }
    let made = Trained::read(&dir.path().join("model/model.safetensors")).expect("a model");
    assert_eq!(made.digest().expect("no NaN"), recorded(shipped::NAME), "the same bits");
}

/// Rows of the table of LIRM's trainings: stage, steps, digests of the weights before and after.
fn trainings() -> Vec<[&'static str; 4]> {
    let rows =
        README.lines().filter(|l| l.starts_with("| 1") || l.starts_with("| 2") || l.starts_with("| 3"));
    let cells = |row: &'static str| -> [&'static str; 4] {
        let cells: Vec<&str> = row.split('|').map(|cell| cell.trim().trim_matches('`')).collect();
        [cells[1], cells[2], cells[3], cells[4]]
    };
    rows.map(cells).collect()
}

#[test]
fn the_shipped_model_of_objects_is_the_recorded_one() {
    let bytes = objects::BYTES.len();
    assert!(bytes <= MOST_BYTES_OF_OBJECTS, "{bytes} bytes, at most {MOST_BYTES_OF_OBJECTS}");
    let model = objects::objects();
    assert_eq!(digest(&model.params), recorded(objects::NAME), "the digest of its page");
    assert_eq!(Config { is_whole: false, ..model.config }, Config::SMALL);
    let rows = trainings();
    assert_eq!(rows.len(), model.training.len(), "a row for each part of the training");
    assert_eq!(rows.len(), commands("lirm train").len(), "and a command");
    assert_eq!(rows.last().expect("at least one")[3], recorded(objects::NAME), "the last part made it");
    assert_eq!(
        rows[0][2],
        digest(&first(&Config::SMALL, 0)),
        "the first part began with first values of seed 0"
    );
    for (part, [stage, steps, start, _]) in model.training.iter().zip(&rows) {
        let [first, last] = part.range;
        assert_eq!((part.stage.as_str(), part.start.as_str()), (*stage, *start), "{part:?}");
        assert_eq!(*steps, format!("{first}–{last} of {}", part.steps), "{part:?}");
    }
    // Stage 2a makes a whole model of a plain one first.
    for pair in rows.windows(2).filter(|pair| !(pair[0][0].starts_with('1') && pair[1][0] == "2a")) {
        assert_eq!(pair[0][3], pair[1][2], "every part begins with the result of the one before it");
    }
}

/// The first step of a stage with the options of its training, or of trainings to come, and eight objects in memory.
fn first_step(stage: &'static str) -> Vec<&'static str> {
    let is_of = |words: &Vec<&str>| words.windows(2).any(|pair| pair == ["--stage", stage]);
    let listed = commands("lirm train").into_iter().find(is_of);
    let words = listed.unwrap_or_else(|| {
        vec!["lirm", "train", "--stage", stage, "--optimizer", "muon", "--distances", "600", "--updates"]
    });
    let mut own = Vec::new();
    let mut rest = words.into_iter();
    while let Some(word) = rest.next() {
        match word {
            "--out" | "--from" | "--until" | "--objects-at-once" => drop(rest.next()),
            word => own.push(word),
        }
    }
    own.extend(["--until", "1", "--objects-at-once", "8", "--out", stage, "--json", "-q"]);
    if stage != NAMES[0] {
        own.extend(["--from", objects::NAME]);
    }
    own
}

#[test]
fn first_steps_of_its_stages_have_the_recorded_digests() {
    if !long("the first step of each stage of LIRM's small model, a minute each") {
        return;
    }
    let dir = tempfile::tempdir().expect("a temporary folder");
    // Without its history, so that a stage that is not complete begins anew.
    let model = Model { training: Vec::new(), ..objects::objects() };
    model.write(&dir.path().join(objects::NAME), Precision::Half).expect("written");
    let rows: Vec<&str> = README.lines().filter(|l| l.starts_with("| first step of ")).collect();
    assert_eq!(rows.len(), NAMES.len(), "one for each stage");
    let found = NAMES.iter().map(|stage| {
        let record = json(&first_step(stage), dir.path());
        format!("| first step of `{stage}` | `{}` |", record["digest"].as_str().expect("a digest"))
    });
    assert_eq!(found.collect::<Vec<_>>(), rows, "the digests of the page");
}
