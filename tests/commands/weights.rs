//! The model included in the program: it is the one described in `reference/weights/README.md`, and the
//! commands listed there produce it.

use crate::common::long;
use crate::program::{code, lastlight, stderr};
use lastlight::last::model::encoder::Input;
use lastlight::last::model::file::Trained;
use lastlight::last::model::shipped;

/// What is shipped is at most this large.
const MOST_BYTES: usize = 4 << 20;

const README: &str = include_str!("../../reference/weights/README.md");

/// The digest in the table of the page.
fn recorded() -> &'static str {
    let row = README.lines().find(|l| l.starts_with("| `figure64.safetensors`")).expect("a row of the table");
    let digest = row.split('`').nth(3).expect("a digest in code style");
    assert_eq!(digest.len(), 16, "16 hexadecimal digits: {digest}");
    digest
}

#[test]
fn the_shipped_model_is_the_recorded_one() {
    assert!(shipped::BYTES.len() <= MOST_BYTES, "{} bytes, at most {MOST_BYTES}", shipped::BYTES.len());
    let trained = shipped::figure().expect("a model");
    assert_eq!(trained.digest().expect("no NaN"), recorded(), "the digest of its page");
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
    let commands: Vec<&str> = README.lines().filter_map(|l| l.strip_prefix("lastlight ")).collect();
    assert_eq!(commands.len(), 2, "gen and pretrain: {commands:?}");
    for command in commands {
        let words: Vec<&str> = command.split_whitespace().collect();
        let o = lastlight(&words, dir.path());
        assert_eq!(code(&o), 0, "{command}: {}", stderr(&o));
    }
    let made = Trained::read(&dir.path().join("model/model.safetensors")).expect("a model");
    assert_eq!(made.digest().expect("no NaN"), recorded(), "the same bits");
}
