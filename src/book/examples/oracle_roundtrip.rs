//! Arrays through an operator: written, run in f32 and in f64, compared, and run again on a frozen plan.
//!
//! `cargo run --release --example oracle_roundtrip`

use lastlight::io::npz;
use lastlight::ops::{self, draw_cotangents};
use lastlight::oracle::run::{Options, Precision, run};
use lastlight::oracle::{compare, mint};
use lastlight::{Error, Result};

fn main() -> Result<()> {
    let folder = tempfile::tempdir().map_err(|e| Error::input("temporary folder").got(e.to_string()))?;
    let file = |name: &str| folder.path().join(name);
    let mut tell = |text: &str| println!("  {text}");

    // Inputs and cotangents of a generated case, as somebody's program would write them.
    let op = ops::find("splat.render")?;
    let golden = mint::golden(op, 0)?;
    let mut input = (op.case)(0).inputs;
    let outputs: Vec<&str> = op.outputs.iter().map(|port| port.name).collect();
    let mut drawn = golden.clone();
    drawn.0.retain(|name, _| outputs.contains(&name.as_str()));
    for (name, bar) in draw_cotangents(op, &drawn).0 {
        input.0.insert(format!("{name}_bar"), bar);
    }
    npz::write(&file("in.npz"), &input)?;

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
        theirs: file("f32.npz"),
        ours: file("f64.npz"),
        op: Some("splat.render".to_owned()),
        tol: compare::TOLERANCE,
        html: None,
    })?;
    print!("{report}");
    if report.passed { Ok(()) } else { Err(Error::check("oracle_roundtrip").expected("f32 and f64 to agree")) }
}
