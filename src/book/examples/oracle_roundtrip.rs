//! Writes the inputs of an operator, runs it in f64, runs it in f32 on the plan of the f64 run, and compares the results.
//!
//! `cargo run --release --example oracle_roundtrip`

use lastlight::io::npz;
use lastlight::ops;
use lastlight::oracle::run::{Options, Precision, run};
use lastlight::oracle::{compare, mint};
use lastlight::{Error, Result};

fn main() -> Result<()> {
    let folder = tempfile::tempdir().map_err(|e| Error::input("temporary folder").got(e.to_string()))?;
    let file = |name: &str| folder.path().join(name);
    let mut tell = |text: &str| {
        if !text.starts_with("ignored") {
            println!("  {text}");
        }
    };

    // A generated case with its cotangents, as a user's program would write it. Results in the file are ignored, with a note.
    npz::write(&file("in.npz"), &mint::golden(ops::find("splat.render")?, 0)?)?;

    let options = |out: &str, precision| Options {
        op: "splat.render".to_owned(),
        input: file("in.npz"),
        out: file(out),
        precision,
        dump: true,
        ..Options::default()
    };
    println!("f64, the twin:");
    let twin = run(&options("f64.npz", Precision::F64), &mut tell)?;
    println!("  digest {}", twin.digest);
    println!("f32, the shipped operator, on the decisions of the twin:");
    let on_plan = Options { plan: Some(file("f64.plan.npz")), ..options("f32.npz", Precision::F32) };
    let shipped = run(&on_plan, &mut tell)?;
    println!("  digest {}, plan {}", shipped.digest, shipped.plan_digest);

    let report = compare::compare(&compare::Options {
        yours: file("f32.npz"),
        reference: file("f64.npz"),
        op: Some("splat.render".to_owned()),
        tol: compare::TOLERANCE,
        present_only: false,
    })?
    .report;
    print!("{report}");
    if report.passed {
        Ok(())
    } else {
        Err(Error::check("oracle_roundtrip").expected("f32 and f64 to match"))
    }
}
